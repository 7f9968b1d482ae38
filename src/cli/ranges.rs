//! Numbers of options, refused in words: clap tells a range as `0..=1024`, and what is no number as an "invalid float literal".

use std::ops::RangeInclusive;

use crate::cell::decimal_comma_advice;

/// Returns the parser of a whole number in a range.
pub(super) fn whole<N: TryFrom<i64> + 'static>(
    range: RangeInclusive<i64>,
) -> impl Fn(&str) -> Result<N, String> + Clone + Send + Sync + 'static {
    move |text: &str| {
        let number = text.parse::<i64>().ok().filter(|number| range.contains(number));
        let (low, high) = (range.start(), range.end());
        number
            .and_then(|number| N::try_from(number).ok())
            .ok_or_else(|| format!("is {text}; allowed is a whole number from {low} to {high}"))
    }
}

/// Reads a number.
pub(super) fn number(text: &str) -> Result<f64, String> {
    text.parse().map_err(|_| format!("{text:?} is not a number{}", decimal_comma_advice(text)))
}

#[cfg(test)]
mod tests {
    use super::{number, whole};
    use crate::cli::parse;

    #[test]
    fn numbers_in_the_range_are_taken_and_no_others() {
        let threads = whole::<u16>(0..=1024);
        assert_eq!(["0", "7", "1024"].map(&threads), [Ok(0), Ok(7), Ok(1024)]);
        for text in ["1025", "-1", "70000", "1.5", "many", "", "99999999999999999999"] {
            assert_eq!(threads(text), Err(format!("is {text}; allowed is a whole number from 0 to 1024")));
        }
    }

    #[test]
    fn a_number_is_taken_and_anything_else_is_told_to_be_none() {
        assert_eq!(["-1.5", "30", "1e3"].map(number), [Ok(-1.5), Ok(30.0), Ok(1000.0)]);
        assert_eq!(number("abc"), Err("\"abc\" is not a number".to_owned()));
        assert_eq!(number("0,5"), Err("\"0,5\" is not a number; use a point as decimal separator".to_owned()));
        for (command, option) in [("scanner", "--at"), ("cell", "--adapter"), ("study", "--cube"), ("calibrate", "--height")] {
            let below = match command {
                "study" => Some("reach"),
                "calibrate" => Some("poses"),
                _ => None,
            };
            let arguments = ["vantage", command].into_iter().chain(below).chain([option, "wide"]);
            let told = parse(arguments).expect_err(option).to_string();
            assert!(told.contains(option) && told.contains("\"wide\" is not a number"), "{told}");
        }
    }

    /// The range was told as `0..=1024`.
    #[test]
    fn a_number_out_of_its_range_is_told_the_range_in_words() {
        let scanner = ["sim", "scanner", "plan", "--mesh", "part.stl", "--out", "scans"];
        for (words, option, allowed) in [
            (&["compare", "plan", "scans", "--mesh", "part.stl", "--out", "inspection"][..], "--threads", "0 to 1024"),
            (&["rescan", "inspection", "--mesh", "part.stl", "--out", "more"][..], "--threads", "0 to 1024"),
            (&["study", "reach"][..], "--threads", "0 to 1024"),
            (&["study", "candidates", "part.stl"][..], "--threads", "0 to 1024"),
            (&scanner[..], "--threads", "0 to 1024"),
            (&["study", "candidates", "part.stl"][..], "--views", "1 to 1000"),
            (&["study", "candidates", "part.stl"][..], "--at", "1 to 1000"),
            (&["calibrate", "poses"][..], "--count", "4 to 200"),
            (&["calibrate", "poses"][..], "--hold-out", "0 to 50"),
            (&["calibrate", "cell", "data.json"][..], "--hold-out", "0 to 1000"),
            (&["sim", "turntable"][..], "--units-per-turn", "1000 to 2147483647"),
            (&["sim", "turntable"][..], "--gear-ratio", "1 to 512"),
            (&["part", "base"][..], "--triangles", "8000 to 2000000"),
            (&["demo"][..], "--port", "0 to 65535"),
        ] {
            let arguments = ["vantage"].into_iter().chain(words.iter().copied()).chain([option, "9999999999"]);
            let told = parse(arguments).expect_err(option).to_string();
            let range = format!("is 9999999999; allowed is a whole number from {allowed}");
            assert!(told.contains(option) && told.contains(&range) && !told.contains("..="), "{words:?}: {told}");
        }
    }
}
