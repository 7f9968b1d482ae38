//! Content negotiation: by the query parameter where given, else by `Accept` (RFC 9110, section 12.5.1).

use std::borrow::Cow;

use axum::http::HeaderMap;
use axum::http::header::{ACCEPT, ACCEPT_ENCODING};

use super::problem::{ApiError, Code};

/// A representation of a result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Representation {
    /// Value of the query parameter.
    pub name: &'static str,
    /// Media type.
    pub media_type: &'static str,
    /// Name of the result file.
    pub file: Cow<'static, str>,
}

/// Chooses among `offered`, of which the first is the default: by `asked`, the query parameter and its value, where given.
///
/// # Errors
/// `not_acceptable` if none fits.
pub(super) fn choose<'a>(
    headers: &HeaderMap,
    asked: Option<(&str, &str)>,
    offered: &'a [Representation],
) -> Result<&'a Representation, ApiError> {
    if let Some((parameter, name)) = asked {
        let refused = || not_acceptable(parameter, &format!("{name:?}"), offered);
        return offered.iter().find(|offer| offer.name == name).ok_or_else(refused);
    }
    let refused = |accept: &str| not_acceptable("Accept", accept, offered);
    let accept: Vec<&str> = headers.get_all(ACCEPT).iter().filter_map(|value| value.to_str().ok()).collect();
    if accept.is_empty() {
        return offered.first().ok_or_else(|| refused("nothing"));
    }
    let accept = accept.join(",");
    let ranges: Vec<Range<'_>> = accept.split(',').filter_map(Range::parse).collect();
    // max_by_key gives the last of equal ones, so the order is reversed: the first representation wins.
    let rated = offered.iter().rev().map(|offer| (weight(&ranges, offer), offer)).filter(|(weight, _)| *weight > 0);
    rated.max_by_key(|(weight, _)| *weight).map(|(_, offer)| offer).ok_or_else(|| refused(&accept))
}

/// The error at the header or the query parameter `field`.
fn not_acceptable(field: &str, asked: &str, offered: &[Representation]) -> ApiError {
    let offered: Vec<_> = offered.iter().map(|offer| format!("{} ({})", offer.media_type, offer.name)).collect();
    ApiError::at(Code::NotAcceptable, field, format!("asked for {asked}; available: {}", offered.join(", ")))
}

/// One media range of `Accept`.
struct Range<'a> {
    kind: &'a str,
    subtype: &'a str,
    /// Weight in thousandths.
    weight: u16,
}

impl<'a> Range<'a> {
    fn parse(text: &'a str) -> Option<Self> {
        let mut parts = text.split(';').map(str::trim);
        let (kind, subtype) = parts.next()?.split_once('/')?;
        let quality = parts.find_map(|parameter| parameter.strip_prefix("q=").or_else(|| parameter.strip_prefix("Q=")));
        let quality: f32 = quality.map_or(Some(1.0), |q| q.parse().ok())?;
        (0.0..=1.0).contains(&quality).then_some(Self { kind, subtype, weight: (quality * 1000.0) as u16 })
    }

    /// Specificity with which the range matches the type; `None` if it does not match.
    fn specificity(&self, media_type: &str) -> Option<u8> {
        let essence = media_type.split(';').next().unwrap_or_default();
        let (kind, subtype) = essence.split_once('/')?;
        match (self.kind, self.subtype) {
            ("*", "*") => Some(0),
            (k, "*") if k.eq_ignore_ascii_case(kind) => Some(1),
            (k, s) if k.eq_ignore_ascii_case(kind) && s.eq_ignore_ascii_case(subtype) => Some(2),
            _ => None,
        }
    }
}

/// The weight that the most specific range gives the representation; 0 if none matches.
fn weight(ranges: &[Range<'_>], offer: &Representation) -> u16 {
    let matching = ranges.iter().filter_map(|range| range.specificity(offer.media_type).map(|found| (found, range.weight)));
    matching.max_by_key(|(specificity, _)| *specificity).map_or(0, |(_, weight)| weight)
}

/// Returns true if the client accepts gzip (RFC 9110, section 12.5.3).
pub(super) fn accepts_gzip(headers: &HeaderMap) -> bool {
    let accept = headers.get_all(ACCEPT_ENCODING).iter().filter_map(|value| value.to_str().ok());
    let codings = accept.flat_map(|value| value.split(',')).filter_map(|coding| {
        let mut parts = coding.split(';').map(str::trim);
        let name = parts.next()?.to_ascii_lowercase();
        let quality = parts.find_map(|parameter| parameter.strip_prefix("q=").or_else(|| parameter.strip_prefix("Q=")));
        Some((name, quality.map_or(Some(1.0_f32), |q| q.parse().ok())? > 0.0))
    });
    let codings: Vec<(String, bool)> = codings.collect();
    let named = |name: &str| codings.iter().find(|(coding, _)| coding == name).map(|(_, accepted)| *accepted);
    named("gzip").or_else(|| named("x-gzip")).or_else(|| named("*")).unwrap_or(false)
}
