//! Messages of deserializers in the words of those who write the files: `is "2.7 kg"; expected a number` for
//! ``invalid type: string "2.7 kg", expected f64``.

/// The message in plain words; one of another kind is returned as it is.
pub(super) fn in_plain_words(message: &str) -> String {
    let (text, place) = message.rfind(" at line ").map_or((message, ""), |at| message.split_at(at));
    plain(text).map_or_else(|| message.to_owned(), |told| told + &in_brackets(place))
}

/// ` at line 1 column 3` in brackets, so that it is not read as a part of the expected value.
fn in_brackets(place: &str) -> String {
    let place = place.strip_prefix(" at ").map(|place| place.replacen(" column ", ", column ", 1));
    place.map_or_else(String::new, |place| format!(" ({place})"))
}

fn plain(text: &str) -> Option<String> {
    let mismatch = ["invalid type: ", "invalid value: "].iter().find_map(|start| text.strip_prefix(start));
    if let Some((found, expected)) = mismatch.and_then(|rest| rest.rsplit_once(", expected ")) {
        let (found, expected) = (found_value(found), expected_of(found, expected));
        let advice = if expected == "a number" { decimal_comma_advice(found.trim_matches('"')) } else { "" };
        return Some(format!("is {found}; expected {expected}{advice}"));
    }
    if let Some((length, expected)) = text.strip_prefix("invalid length ").and_then(|rest| rest.split_once(", expected ")) {
        let noun = if length == "1" { "element" } else { "elements" };
        return Some(format!("has {length} {noun}; expected {}", expected_value(expected)));
    }
    if let Some(rest) = text.strip_prefix("unknown variant ") {
        return Some(format!("unknown value {}", rest.replacen(", expected ", "; expected ", 1)));
    }
    if text.starts_with("UUID parsing failed") {
        return Some("is not an id; expected a UUID".to_owned());
    }
    text.starts_with("data did not match any variant of").then(|| "has none of the allowed forms".to_owned())
}

/// Advice on a text that would be a number with a point in the place of its comma, after a semicolon; empty for any other.
#[must_use]
pub fn decimal_comma_advice(text: &str) -> &'static str {
    let is_number = text.contains(',') && text.replacen(',', ".", 1).trim().parse::<f64>().is_ok();
    if is_number { "; use a point as decimal separator" } else { "" }
}

/// A value that was found: as it was written, or its kind.
pub fn found_value(found: &str) -> String {
    match found {
        "sequence" => "a list".to_owned(),
        "map" => "an object".to_owned(),
        "unit value" | "null" | "Option value" => "null".to_owned(),
        // A kind before a value in backticks: integer `3`, floating point `1.5`, boolean `true`.
        _ => match found.split_once(" `").and_then(|(_, value)| value.strip_suffix('`')) {
            Some(value) => value.to_owned(),
            None => found.strip_prefix("string ").unwrap_or(found).to_owned(),
        },
    }
}

/// Kind of value that was expected, with its range for a whole number that is too large.
fn expected_of(found: &str, expected: &str) -> String {
    let max: u64 = match expected {
        "u32" => u32::MAX.into(),
        "u64" | "usize" => u64::MAX,
        _ => return expected_value(expected),
    };
    let is_beyond = found_value(found).parse::<f64>().is_ok_and(|number| number >= max as f64 && number.fract() == 0.0);
    if is_beyond { format!("a whole number from 0 to {max}") } else { expected_value(expected) }
}

/// Kind of value that was expected.
pub fn expected_value(expected: &str) -> String {
    let known = match expected {
        "f32" | "f64" | "a float" | "a floating point" => "a number",
        "i8" | "i16" | "i64" | "isize" | "an integer" => "a whole number",
        "i32" => "a whole number from -2147483648 to 2147483647",
        "u8" => "a whole number from 0 to 255",
        "u16" => "a whole number from 0 to 65535",
        "u32" | "u64" | "usize" => "a whole number, 0 or more",
        "bool" | "a boolean" => "true or false",
        "a map" => "an object",
        "a sequence" | "a seq" => "a list",
        "string or map" => "a name or an object",
        "variant identifier" => "a name",
        "fewer elements in array" | "fewer elements in tuple" | "fewer elements in sequence" => "fewer",
        _ => "",
    };
    if !known.is_empty() {
        return known.to_owned();
    }
    let count = ["an array of length ", "a tuple of size "].iter().find_map(|start| expected.strip_prefix(start));
    match count.or_else(|| expected.strip_suffix(" elements in sequence")) {
        Some(count) => format!("a list of {count}"),
        None if expected.starts_with("struct ") || expected.starts_with("internally tagged enum ") => "an object".to_owned(),
        None => expected.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;
    use serde_json::json;

    use super::*;

    #[derive(Debug, Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Word {
        One,
    }

    #[derive(Debug, Deserialize)]
    #[expect(dead_code, reason = "read, to be refused")]
    struct Every {
        number: f64,
        count: u32,
        triple: [f64; 3],
        word: Word,
        switch: bool,
    }

    fn told(field: &str, value: serde_json::Value) -> String {
        let mut whole = json!({"number": 1.0, "count": 1, "triple": [1, 2, 3], "word": "one", "switch": true});
        whole[field] = value;
        in_plain_words(&serde_json::from_value::<Every>(whole).expect_err("refused").to_string())
    }

    #[test]
    fn what_serde_refuses_is_told_in_plain_words() {
        for (field, value, wanted) in [
            ("number", json!("2.7 kg"), "is \"2.7 kg\"; expected a number"),
            ("number", json!("2,7"), "is \"2,7\"; expected a number; use a point as decimal separator"),
            ("number", json!("1,2,7"), "is \"1,2,7\"; expected a number"),
            ("number", json!([1]), "is a list; expected a number"),
            ("number", json!({}), "is an object; expected a number"),
            ("number", json!(null), "is null; expected a number"),
            ("count", json!(-1), "is -1; expected a whole number, 0 or more"),
            ("count", json!(1.5), "is 1.5; expected a whole number, 0 or more"),
            ("count", json!(4_294_967_296_u64), "is 4294967296; expected a whole number from 0 to 4294967295"),
            ("count", json!(1e30), "is 1e+30; expected a whole number from 0 to 4294967295"),
            ("triple", json!([1, 2]), "has 2 elements; expected a list of 3"),
            ("triple", json!("1 2 3"), "is \"1 2 3\"; expected a list of 3"),
            ("word", json!("two"), "unknown value `two`; expected `one`"),
            ("switch", json!("yes"), "is \"yes\"; expected true or false"),
        ] {
            assert_eq!(told(field, value.clone()), wanted, "{field}: {value}");
        }
    }

    #[test]
    fn places_and_other_messages_stay() {
        assert_eq!(
            in_plain_words("invalid type: map, expected f64 at line 1 column 3"),
            "is an object; expected a number (line 1, column 3)"
        );
        assert_eq!(in_plain_words("invalid type: integer `3`, expected struct CellSpec"), "is 3; expected an object");
        assert_eq!(
            in_plain_words("UUID parsing failed: invalid character: found `n` at 0 at line 1 column 18"),
            "is not an id; expected a UUID (line 1, column 18)"
        );
        assert_eq!(in_plain_words("invalid length 4, expected 3 elements in sequence"), "has 4 elements; expected a list of 3");
        for other in ["missing field `fx`", "unknown field `colour`, expected `angle`", "EOF while parsing an object"] {
            assert_eq!(in_plain_words(other), other);
        }
    }
}
