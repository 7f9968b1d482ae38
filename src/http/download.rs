//! Downloads: parts of files (`Range`, RFC 9110, section 14) and the names under which browsers keep them
//! (`Content-Disposition`, RFC 6266).

use std::io::{self, Read};
use std::ops::Range;

use axum::http::header::{CONTENT_RANGE, IF_RANGE, RANGE};
use axum::http::{HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};

use super::extract::header_text;
use super::problem::{ApiError, Code};
use crate::service::PartNames;
use crate::wire::words::is_control;

/// Part of a file that a request asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum AskedPart {
    /// All of it.
    Whole,
    /// A range of bytes.
    Bytes(Range<u64>),
    /// Bytes beyond the end.
    BeyondEnd,
}

/// Reads `Range`, with `If-Range`, for a file of `length` bytes and this strong tag. Several ranges, other units and what
/// cannot be read are ignored, as RFC 9110 allows: the answer is then the whole file.
pub(super) fn asked_part(headers: &HeaderMap, etag: &str, length: u64) -> AskedPart {
    let is_current = match headers.get(IF_RANGE) {
        None => true,
        Some(tag) => tag.as_bytes() == etag.as_bytes(),
    };
    let single = header_text(headers, &RANGE).filter(|_| is_current && headers.get_all(RANGE).iter().count() == 1);
    single.and_then(|range| part(range, length)).unwrap_or(AskedPart::Whole)
}

/// Part that a range such as `bytes=0-99`, `bytes=100-` or `bytes=-100` names; `None` if it is not one of these.
fn part(range: &str, length: u64) -> Option<AskedPart> {
    let (unit, range) = range.split_once('=')?;
    let (first, last) = range.trim().split_once('-')?;
    let is_number = |text: &str| text.bytes().all(|c| c.is_ascii_digit());
    if !unit.trim().eq_ignore_ascii_case("bytes") || !is_number(first) || !is_number(last) {
        return None;
    }
    // A number that is too large lies beyond every end.
    let number = |text: &str| text.parse().unwrap_or(u64::MAX);
    let bytes = match (first, last) {
        ("", "") => return None,
        ("", count) => length.saturating_sub(number(count))..length,
        (first, "") => number(first)..length,
        (first, last) if number(last) < number(first) => return None,
        (first, last) => number(first)..number(last).saturating_add(1).min(length),
    };
    Some(if bytes.start < bytes.end { AskedPart::Bytes(bytes) } else { AskedPart::BeyondEnd })
}

/// The value of `Content-Range` for bytes of a file.
pub(super) fn content_range(bytes: &Range<u64>, length: u64) -> HeaderValue {
    header(&format!("bytes {}-{}/{length}", bytes.start, bytes.end - 1))
}

/// The 416 response, with the file's length.
pub(super) fn beyond_end(length: u64) -> Response {
    let mut response = ApiError::header(
        Code::RangeNotSatisfiable,
        "Range",
        &format!("begins at or after the end; the length is {length} bytes"),
    )
    .into_response();
    response.headers_mut().insert(CONTENT_RANGE, header(&format!("bytes */{length}")));
    response
}

/// Bytes of another reader, from some offset on.
pub(super) struct PartReader<R> {
    inner: R,
    skip: u64,
    left: u64,
}

impl<R: Read> PartReader<R> {
    /// The given bytes of `inner`; those before are read and dropped.
    pub(super) fn new(inner: R, bytes: &Range<u64>) -> Self {
        Self { inner, skip: bytes.start, left: bytes.end - bytes.start }
    }
}

impl<R: Read> Read for PartReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.skip > 0 {
            io::copy(&mut self.inner.by_ref().take(self.skip), &mut io::sink())?;
            self.skip = 0;
        }
        let limit = usize::try_from(self.left).map_or(buffer.len(), |left| left.min(buffer.len()));
        let count = self.inner.read(&mut buffer[..limit])?;
        self.left -= count as u64;
        Ok(count)
    }
}

/// Treatment of a file by a browser.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Disposition {
    /// Shows it, and keeps it under the name if asked to.
    Inline,
    /// Keeps it.
    Attachment,
}

/// The value of `Content-Disposition`. A name with other letters than those of ASCII is given twice, as RFC 6266 has it.
pub(super) fn content_disposition(disposition: Disposition, name: &str) -> HeaderValue {
    let kind = match disposition {
        Disposition::Inline => "inline",
        Disposition::Attachment => "attachment",
    };
    let name = plain_name(name);
    let ascii: String = name.chars().map(|c| if c.is_ascii() { c } else { '_' }).collect();
    let extended = if name.is_ascii() { String::new() } else { format!("; filename*=UTF-8''{}", percent_encoded(&name)) };
    header(&format!("{kind}; filename=\"{ascii}\"{extended}"))
}

/// File name of a job's result, by the part: part number and serial number, else the mesh, else `other`.
pub(super) fn result_name(part: &PartNames, other: &str, file: &str) -> String {
    let given = [&part.part_number, &part.serial].into_iter().flatten().map(|number| number.trim());
    let numbers = given.filter(|number| !number.is_empty()).collect::<Vec<_>>().join("_");
    let mesh = part.mesh.as_deref().map(|name| name.rsplit_once('.').map_or(name, |(stem, _)| stem));
    let stem = [Some(numbers.as_str()), mesh].into_iter().flatten().map(str::trim).find(|stem| !stem.is_empty()).unwrap_or(other);
    format!("{}_{file}", shortened(stem))
}

/// File name of an upload: the last part of the path that a browser may send, without control characters.
pub(super) fn upload_name(name: &str, max_chars: usize) -> Option<String> {
    let last = name.rsplit(['/', '\\']).next().unwrap_or(name);
    let name: String = last.chars().filter(|c| !is_control(*c)).take(max_chars).collect();
    Some(name).filter(|name| !name.trim().is_empty())
}

/// Largest number of characters of a name's stem, so that a file system takes it with what follows.
const MAX_STEM_CHARS: usize = 80;

fn shortened(stem: &str) -> String {
    stem.chars().take(MAX_STEM_CHARS).collect()
}

/// The name without what some file system or header refuses; a leading dot would hide it.
fn plain_name(name: &str) -> String {
    let is_refused = |c: char| is_control(c) || "\"\\/:*?<>|%;".contains(c);
    let plain: String = name.chars().map(|c| if is_refused(c) { '_' } else { c }).collect();
    let trimmed = plain.trim().trim_start_matches('.').trim_end_matches('.');
    if trimmed.is_empty() { "file".to_owned() } else { trimmed.to_owned() }
}

/// The text in the encoding of RFC 8187: attribute characters as they are, all other bytes as `%XX`.
fn percent_encoded(text: &str) -> String {
    let is_plain = |c: u8| c.is_ascii_alphanumeric() || b"!#$&+-.^_`|~".contains(&c);
    text.bytes().map(|c| if is_plain(c) { char::from(c).to_string() } else { format!("%{c:02X}") }).collect()
}

fn header(text: &str) -> HeaderValue {
    // Only visible ASCII was written.
    HeaderValue::from_str(text).unwrap_or(HeaderValue::from_static("attachment"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(range: &str, if_range: Option<&str>) -> AskedPart {
        let mut headers = HeaderMap::new();
        headers.insert(RANGE, range.parse().expect("a header"));
        if let Some(tag) = if_range {
            headers.insert(IF_RANGE, tag.parse().expect("a header"));
        }
        asked_part(&headers, "\"tag\"", 100)
    }

    #[test]
    fn a_single_range_is_cut_to_the_file() {
        for (range, bytes) in [
            ("bytes=0-0", 0..1),
            ("bytes=10-19", 10..20),
            ("bytes=90-", 90..100),
            ("bytes=90-1000", 90..100),
            ("bytes=-10", 90..100),
            ("bytes=-1000", 0..100),
            ("Bytes=5-99999999999999999999999", 5..100),
        ] {
            assert_eq!(asked(range, None), AskedPart::Bytes(bytes), "{range}");
        }
        for range in ["bytes=100-", "bytes=100-200", "bytes=-0", "bytes=99999999999999999999-"] {
            assert_eq!(asked(range, None), AskedPart::BeyondEnd, "{range}");
        }
        for range in
            ["", "bytes", "bytes=", "bytes=-", "bytes=9-5", "bytes=a-b", "bytes=0-1,5-6", "lines=0-1", "bytes=+1-2", "0-1"]
        {
            assert_eq!(asked(range, None), AskedPart::Whole, "{range}");
        }
        assert_eq!(asked_part(&HeaderMap::new(), "\"tag\"", 100), AskedPart::Whole);
    }

    #[test]
    fn a_range_of_another_version_is_no_range() {
        assert_eq!(asked("bytes=0-1", Some("\"tag\"")), AskedPart::Bytes(0..2));
        for other in ["\"other\"", "W/\"tag\"", "Sun, 06 Nov 1994 08:49:37 GMT"] {
            assert_eq!(asked("bytes=0-1", Some(other)), AskedPart::Whole, "{other}");
        }
    }

    #[test]
    fn a_part_is_what_lies_there() {
        let text: Vec<u8> = (0..=255).collect();
        for bytes in [0..256, 0..1, 100..200, 255..256] {
            let mut found = Vec::new();
            PartReader::new(&text[..], &bytes).read_to_end(&mut found).expect("read");
            assert_eq!(found, text[bytes.start as usize..bytes.end as usize]);
        }
    }

    #[test]
    fn names_come_from_the_part_and_suit_every_file_system() {
        let part = |number: Option<&str>, serial: Option<&str>, mesh: Option<&str>| PartNames {
            part_number: number.map(str::to_owned),
            serial: serial.map(str::to_owned),
            mesh: mesh.map(str::to_owned),
        };
        let name = |part: &PartNames| result_name(part, "job", "plan.json");
        assert_eq!(name(&part(Some("P-1"), Some("S 2"), Some("a.stl"))), "P-1_S 2_plan.json");
        assert_eq!(name(&part(None, Some("S 2"), Some("a.stl"))), "S 2_plan.json");
        assert_eq!(name(&part(None, None, Some("housing.v2.stl"))), "housing.v2_plan.json");
        assert_eq!(name(&part(Some(" "), None, None)), "job_plan.json");
        assert_eq!(name(&part(Some(""), Some(""), Some("a.stl"))), "a_plan.json", "blank numbers are none");
        assert_eq!(name(&part(Some(" "), Some("S 2"), Some("a.stl"))), "S 2_plan.json");
        assert_eq!(name(&part(Some(&"x".repeat(128)), None, None)).len(), 80 + "_plan.json".len());
        for (name, value) in [
            ("plan.json", "inline; filename=\"plan.json\""),
            ("../a\\b:\"c\"\n.json", "inline; filename=\"_a_b__c__.json\""),
            ("Gehäuse 1.json", "inline; filename=\"Geh_use 1.json\"; filename*=UTF-8''Geh%C3%A4use%201.json"),
            ("a\u{202e}b.stl", "inline; filename=\"a_b.stl\""),
            ("..", "inline; filename=\"file\""),
        ] {
            assert_eq!(content_disposition(Disposition::Inline, name), value, "{name}");
        }
        assert_eq!(content_disposition(Disposition::Attachment, "a.stl"), "attachment; filename=\"a.stl\"");
    }

    #[test]
    fn an_upload_keeps_the_name_of_its_file_alone() {
        for (sent, kept) in [
            ("part.stl", Some("part.stl")),
            ("../../part.stl", Some("part.stl")),
            ("C:\\parts\\part.stl", Some("part.stl")),
            ("Gehäuse\u{7}.stl", Some("Gehäuse.stl")),
            ("\u{5e9}\u{5dc}\u{202e}cod.stl", Some("\u{5e9}\u{5dc}cod.stl")),
            ("", None),
            ("folder/", None),
            (" ", None),
        ] {
            assert_eq!(upload_name(sent, 200).as_deref(), kept, "{sent:?}");
        }
        assert_eq!(upload_name(&"x".repeat(300), 200).map(|name| name.len()), Some(200));
    }
}
