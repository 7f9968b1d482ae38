//! Helpers that all sections of a page share: escaping of text, and numbers formatted for people.

use crate::wire::words::{self, by_thousands, fixed, is_control};

/// Head of an option of the command line that sets a parameter.
const SET: &str = "--set ";

/// Escapes untrusted text for use between tags and inside quoted attributes. Characters that markup forbids become the
/// replacement character.
pub(in crate::report) fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&#39;"),
            '\t' | '\n' | '\r' => safe.push(' '),
            c if is_control(c) || matches!(c, '\u{fffe}' | '\u{ffff}') => {
                safe.push('\u{fffd}');
            }
            c => safe.push(c),
        }
    }
    safe
}

/// Escapes our own text; what it quotes in backticks becomes code.
pub(in crate::report) fn prose(text: &str) -> String {
    let mut pieces = text.split('`').map(escape);
    let mut html = pieces.next().unwrap_or_default();
    while let Some(quoted) = pieces.next() {
        html += &match pieces.next() {
            Some(rest) => format!("<code>{quoted}</code>{rest}"),
            None => format!("`{quoted}"),
        };
    }
    html
}

/// Escapes our own text; each option `--set KEY=VALUE` in it becomes code of its own, which no line breaks that has room for it.
pub(in crate::report) fn with_options(text: &str) -> String {
    let (mut html, mut rest) = (String::new(), text);
    while let Some(at) = rest.find(SET) {
        let (before, from_option) = rest.split_at(at);
        let (option, after) = from_option.split_at(option_length(from_option));
        html += &format!("{}<code>{}</code>", escape(before), escape(option));
        rest = after;
    }
    html + &escape(rest)
}

/// Bytes of the option that a text begins with: to the quote that closes its value, or to the space or the punctuation after it.
fn option_length(text: &str) -> usize {
    let value = text.strip_prefix(SET).unwrap_or(text);
    let length = match value.strip_prefix('\'') {
        Some(quoted) => quoted.find('\'').map_or(value.len(), |end| end + 2),
        None => {
            let word = value.split(' ').next().unwrap_or_default();
            word.trim_end_matches([',', ';', ':', '.', ')']).len()
        }
    };
    text.len() - value.len() + length
}

/// Formats a number with so many decimals, a narrow space between thousands, and a true minus sign.
pub(in crate::report) fn number(value: f64, decimals: usize) -> String {
    by_thousands(&fixed(value, decimals))
}

/// Formats a number as [`number`] does, with more decimals where it would be told as zero and is not.
pub(in crate::report) fn nonzero(value: f64, decimals: usize) -> String {
    by_thousands(&words::fixed_nonzero(value, decimals))
}

/// Groups the digits of numbers in our own text as [`number`] does.
pub(in crate::report) fn grouped(text: &str) -> String {
    text.split(' ').map(grouped_word).collect::<Vec<String>>().join(" ")
}

/// A word of our own text, with its digits grouped if it is a number, whatever punctuation stands around it.
fn grouped_word(word: &str) -> String {
    let digits = word.trim_start_matches('(').trim_end_matches([',', ';', ':', '.', ')']);
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let is_number = [whole, fraction].iter().all(|digits| digits.bytes().all(|byte| byte.is_ascii_digit()));
    if is_number && whole.len() > 3 { word.replacen(digits, &by_thousands(digits), 1) } else { word.to_owned() }
}

/// Formats the edges of a box, with a decimal unless they are so long that nobody needs it.
pub(in crate::report) fn edges(edges_mm: [f64; 3]) -> String {
    const LONG_MM: f64 = 10_000.0;
    let decimals = usize::from(edges_mm.iter().all(|edge_mm| *edge_mm < LONG_MM));
    format!("{}\u{a0}mm", edges_mm.map(|edge_mm| number(edge_mm, decimals)).join(" × "))
}

/// Formats a row of a table, of cells that are markup.
pub(in crate::report) fn row(cells: &[String]) -> String {
    format!("<tr>{}</tr>\n", cells.iter().map(|cell| format!("<td>{cell}</td>")).collect::<String>())
}

/// Formats a share as a percentage with two decimals.
pub(in crate::report) fn percent(share: f64) -> String {
    // One below the whole is not rounded up to it.
    format!("{}\u{a0}%", by_thousands(&words::percent_below(share, 1.0, 2)))
}

/// Formats an area, with three digits or one decimal if it is small.
pub(in crate::report) fn area(area_mm2: f64) -> String {
    let text = if area_mm2.abs() < 100.0 { words::area_mm2(area_mm2) } else { number(area_mm2, 0) };
    format!("{text}\u{a0}mm²")
}

/// Formats a point or direction, its coordinates with so many decimals.
pub(in crate::report) fn triple(values: [f64; 3], decimals: usize) -> String {
    format!("({})", values.map(|value| number(value, decimals)).join(", "))
}

/// Formats a duration in seconds, or in minutes and seconds.
pub(in crate::report) fn duration(secs: f64) -> String {
    // No more than 99.9 with one decimal.
    if secs < 99.95 {
        return format!("{}\u{a0}s", number(secs, 1));
    }
    let whole = secs.round() as u64;
    format!("{}\u{a0}min {}\u{a0}s", whole / 60, whole % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_text_quotes_in_backticks_is_code() {
        assert_eq!(prose("`vantage study reach` compares <a>"), "<code>vantage study reach</code> compares &lt;a&gt;");
        assert_eq!(prose("`a` and `b`"), "<code>a</code> and <code>b</code>");
        assert_eq!((prose("plain"), prose("half `open")), ("plain".to_owned(), "half `open".to_owned()));
    }

    /// A line of the report was broken between `--set` and its parameter, or within one.
    #[test]
    fn an_option_in_a_sentence_is_code_of_its_own() {
        let code = |option: &str| format!("<code>--set {option}</code>");
        let told = with_options("turn it: --set setups=2; then (--set limits.camera_deg=60.0): a<b");
        assert_eq!(told, format!("turn it: {}; then ({}): a&lt;b", code("setups=2"), code("limits.camera_deg=60.0")));
        let both = format!("{} {}", code("selection.target=0.99"), code("robust.pose_error=…"));
        assert_eq!(with_options("--set selection.target=0.99 --set robust.pose_error=…"), both);
        let quoted = with_options("scan: --set 'part.resting_poses=[{\"a\": 1}]', on its back");
        assert_eq!(quoted, format!("scan: {}, on its back", code("&#39;part.resting_poses=[{&quot;a&quot;: 1}]&#39;")));
        assert_eq!((with_options("plain"), with_options("--set ")), ("plain".to_owned(), code("")));
        assert!(
            include_str!("style.css").contains("code { display: inline-block; max-width: 100%;"),
            "it is broken where it has no room"
        );
    }

    #[test]
    fn a_size_has_the_same_digits_in_a_table_and_in_a_sentence() {
        assert_eq!(edges([121_000.0, 73_000.0, 99.94]), "121\u{202f}000 × 73\u{202f}000 × 100\u{a0}mm");
        assert_eq!(edges([121.0, 73.04, 37.0]), "121.0 × 73.0 × 37.0\u{a0}mm");
        assert_eq!(grouped("is 121000 × 73.5 mm (3073 × 85)"), "is 121\u{202f}000 × 73.5 mm (3\u{202f}073 × 85)");
    }

    #[test]
    fn digits_of_a_sentence_are_grouped_whatever_punctuation_follows() {
        assert_eq!(
            grouped("133343 are compared; 1200, 50800.0 mm² of 1778: (see"),
            "133\u{202f}343 are compared; 1\u{202f}200, 50\u{202f}800.0 mm² of 1\u{202f}778: (see"
        );
        let others = "vantage 1.2.3 of part-12345.stl, x=5000 and 999.5 mm";
        assert_eq!(grouped(others), others);
    }
}
