//! Faults in the text of a JSON document in plain words, with line and column: `the document ends early` for `EOF while parsing a value`.

use super::json::GIVEN_TWICE;

/// Max number of characters that a message quotes.
const MAX_QUOTED: usize = 24;
/// Byte order mark in UTF-8.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// The message for a text that serde_json refuses; `None` for an error that is not about the form of the text.
pub(super) fn in_plain_words(text: &[u8], error: &serde_json::Error) -> Option<String> {
    if text.iter().all(u8::is_ascii_whitespace) {
        return Some("the document is empty; expected a JSON value".to_owned());
    }
    if text.starts_with(BYTE_ORDER_MARK) {
        return Some("the document begins with a byte order mark; send UTF-8 without one".to_owned());
    }
    // Of a fault at the end of a line serde_json tells the place before the next one.
    let is_line_end = error.column() == 0 && error.line() > 1;
    let number = error.line() - usize::from(is_line_end);
    let line = text.split(|byte| *byte == b'\n').nth(number.saturating_sub(1)).unwrap_or_default();
    let end = if is_line_end { line.len() } else { error.column().min(line.len()) };
    let at = if is_line_end { end } else { end.saturating_sub(1) };
    let message = error.to_string();
    let told = plain(message.rsplit_once(" at line ").map_or(&message[..], |(told, _)| told), line, at)?;
    // serde_json counts bytes.
    let column = String::from_utf8_lossy(&line[..end]).chars().count().max(1);
    Some(format!("{told} (line {number}, column {column})"))
}

/// The fault that serde_json calls `message`, at the byte `at` of `line`.
fn plain(message: &str, line: &[u8], at: usize) -> Option<String> {
    if let Some(within) = message.strip_prefix("EOF while parsing ") {
        let place = if within == "a value" { "where a value is expected".to_owned() } else { format!("within {within}") };
        return Some(format!("the document ends early, {place}"));
    }
    let told = match message {
        "expected value" | "expected ident" | "invalid number" => return Some(no_value(line, at)),
        "key must be a string" => "expected the name of a field, in double quotes",
        "trailing comma" => "nothing follows the last comma; leave it out",
        "trailing characters" => "more text follows the end of the document",
        "control character (\\u0000-\\u001F) found while parsing a string" => {
            "a string holds a line break or another control character; JSON writes it as an escape such as \\n"
        }
        "invalid escape" => "a string holds a backslash that begins no escape; JSON writes a backslash as \\\\",
        "invalid unicode code point" => "a string is not UTF-8",
        "lone leading surrogate in hex escape" | "unexpected end of hex escape" => "a string holds half of a surrogate pair",
        "number out of range" => "the number is too large; the largest is about 1.8e308",
        "recursion limit exceeded" => "lists and objects are nested too deep; allowed are 127 levels",
        message if message.starts_with("expected `") || message.ends_with(GIVEN_TWICE) => message,
        _ => return None,
    };
    Some(told.to_owned())
}

/// Fault of something in the place of a value.
fn no_value(line: &[u8], at: usize) -> String {
    let word = word_at(line, at);
    let quoted: String = word.chars().take(MAX_QUOTED).collect();
    let unsigned = word.trim_start_matches(['+', '-']).to_ascii_lowercase();
    match unsigned.as_str() {
        "" if line.get(at) == Some(&b'\'') => "a string is written in double quotes, not in single ones".to_owned(),
        "" => "expected a value".to_owned(),
        "nan" | "inf" | "infinity" => format!("`{quoted}` is not JSON, which has no NaN and no infinity"),
        "true" | "false" => format!("`{quoted}` is not JSON; write `{unsigned}`"),
        "null" | "none" | "nil" | "undefined" => format!("`{quoted}` is not JSON; write `null`"),
        number if number.starts_with(|first: char| first == '.' || first.is_ascii_digit()) => {
            format!("`{quoted}` is not a number as JSON writes it")
        }
        _ => format!("`{quoted}` is not a JSON value; strings are written in double quotes"),
    }
}

/// The word or number that the byte `at` is in, or that ends before it.
fn word_at(line: &[u8], at: usize) -> &str {
    let is_part = |byte: &&u8| byte.is_ascii_alphanumeric() || b"+-._".contains(byte);
    let (before, after) = line.split_at(at.min(line.len()));
    let begin = before.len() - before.iter().rev().take_while(is_part).count();
    let end = before.len() + after.iter().take_while(is_part).count();
    // ASCII throughout.
    std::str::from_utf8(&line[begin..end]).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::in_plain_words;

    #[track_caller]
    fn told(text: &[u8]) -> String {
        let error = serde_json::from_slice::<Value>(text).expect_err("no JSON");
        in_plain_words(text, &error).unwrap_or_else(|| panic!("{error}"))
    }

    #[test]
    fn a_text_that_is_not_json_is_told_in_plain_words_with_line_and_column() {
        for (text, wanted) in [
            ("", "the document is empty; expected a JSON value"),
            (" \n", "the document is empty; expected a JSON value"),
            ("\u{feff}{}", "the document begins with a byte order mark; send UTF-8 without one"),
            ("{\"a\": 1", "the document ends early, within an object (line 1, column 7)"),
            ("{\"a\": [1,\n 2", "the document ends early, within a list (line 2, column 2)"),
            ("{\"a\": \"x", "the document ends early, within a string (line 1, column 8)"),
            ("{\"a\":", "the document ends early, where a value is expected (line 1, column 5)"),
            ("{\"a\": NaN}", "`NaN` is not JSON, which has no NaN and no infinity (line 1, column 7)"),
            ("{\"a\": nan}", "`nan` is not JSON, which has no NaN and no infinity (line 1, column 8)"),
            ("{\"a\": -Infinity}", "`-Infinity` is not JSON, which has no NaN and no infinity (line 1, column 8)"),
            ("{\"a\": 1,\n \"b\": undefined}", "`undefined` is not JSON; write `null` (line 2, column 7)"),
            (
                "{\"a\": \"b\nc\"}",
                "a string holds a line break or another control character; JSON writes it as an escape such as \\n (line 1, column 8)",
            ),
            ("[nul\n]", "`nul` is not a JSON value; strings are written in double quotes (line 1, column 4)"),
            ("[True]", "`True` is not JSON; write `true` (line 1, column 2)"),
            ("[.5]", "`.5` is not a number as JSON writes it (line 1, column 2)"),
            ("[1.]", "`1.` is not a number as JSON writes it (line 1, column 4)"),
            ("{\"ä\": abc}", "`abc` is not a JSON value; strings are written in double quotes (line 1, column 7)"),
            ("['a']", "a string is written in double quotes, not in single ones (line 1, column 2)"),
            ("{'a': 1}", "expected the name of a field, in double quotes (line 1, column 2)"),
            ("[1,]", "nothing follows the last comma; leave it out (line 1, column 4)"),
            ("{} {}", "more text follows the end of the document (line 1, column 4)"),
            ("{\"a\" 1}", "expected `:` (line 1, column 6)"),
            ("[1e999]", "the number is too large; the largest is about 1.8e308 (line 1, column 6)"),
        ] {
            assert_eq!(told(text.as_bytes()), wanted, "{text}");
        }
    }

    #[test]
    fn a_fault_at_any_byte_of_any_text_is_told() {
        let text = b"{\"a\": [1.5, true, \"b\\n\", null], \"c\": {\"d\": -2e3}}";
        for at in 0..text.len() {
            for byte in [b'x', b'-', b'"', b'\n', 0x07, 0xff, b'\\', b'}', b',', b'\''] {
                let mut changed = text.to_vec();
                changed[at] = byte;
                let read = serde_json::from_slice::<Value>(&changed);
                assert!(read.is_ok() || told(&changed).contains("(line "), "{changed:?}");
            }
        }
    }
}
