//! Which form an answer takes: by `?format=` where given, else by `Accept` (RFC 9110, section 12.5.1).

use axum::http::HeaderMap;
use axum::http::header::{ACCEPT, ACCEPT_ENCODING};

use super::problem::{Code, Problem};

/// A form of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Form {
    /// Name in the query.
    pub name: &'static str,
    /// Media type.
    pub media_type: &'static str,
    /// Name of the file that has it.
    pub file: &'static str,
}

/// Chooses among `forms`, of which the first is the default.
pub(super) fn choose<'a>(headers: &HeaderMap, asked: Option<&str>, forms: &'a [Form]) -> Result<&'a Form, Problem> {
    if let Some(name) = asked {
        return forms.iter().find(|form| form.name == name).ok_or_else(|| not_acceptable(&format!("{name:?}"), forms));
    }
    let accept: Vec<&str> = headers.get_all(ACCEPT).iter().filter_map(|value| value.to_str().ok()).collect();
    if accept.is_empty() {
        return forms.first().ok_or_else(|| not_acceptable("nothing", forms));
    }
    let accept = accept.join(",");
    let ranges: Vec<Range<'_>> = accept.split(',').filter_map(Range::parse).collect();
    // The last of equal ones is what max_by gives, so the order is turned: the first form wins.
    let rated = forms.iter().rev().map(|form| (weight(&ranges, form), form)).filter(|(weight, _)| *weight > 0);
    rated.max_by_key(|(weight, _)| *weight).map(|(_, form)| form).ok_or_else(|| not_acceptable(&accept, forms))
}

fn not_acceptable(asked: &str, forms: &[Form]) -> Problem {
    let offered: Vec<_> = forms.iter().map(|form| format!("{} ({})", form.media_type, form.name)).collect();
    Problem::new(Code::NotAcceptable, format!("asked for {asked}; this is given as {}", offered.join(", ")))
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

    /// How exactly the range names the type; `None` when it does not.
    fn exactness(&self, media_type: &str) -> Option<u8> {
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

/// The weight that the most exact range gives the form; 0 when none names it.
fn weight(ranges: &[Range<'_>], form: &Form) -> u16 {
    let fitting = ranges.iter().filter_map(|range| range.exactness(form.media_type).map(|exactness| (exactness, range.weight)));
    fitting.max_by_key(|(exactness, _)| *exactness).map_or(0, |(_, weight)| weight)
}

/// Whether the client takes an answer compressed with gzip (RFC 9110, section 12.5.3).
pub(super) fn takes_gzip(headers: &HeaderMap) -> bool {
    let accept = headers.get_all(ACCEPT_ENCODING).iter().filter_map(|value| value.to_str().ok());
    let codings = accept.flat_map(|value| value.split(',')).filter_map(|coding| {
        let mut parts = coding.split(';').map(str::trim);
        let name = parts.next()?.to_ascii_lowercase();
        let quality = parts.find_map(|parameter| parameter.strip_prefix("q=").or_else(|| parameter.strip_prefix("Q=")));
        Some((name, quality.map_or(Some(1.0_f32), |q| q.parse().ok())? > 0.0))
    });
    let codings: Vec<(String, bool)> = codings.collect();
    let named = |name: &str| codings.iter().find(|(coding, _)| coding == name).map(|(_, taken)| *taken);
    named("gzip").or_else(|| named("x-gzip")).or_else(|| named("*")).unwrap_or(false)
}
