//! Helpers that all sections of a page share: escaping of text, and numbers formatted for people.

use crate::wire::words::{self, fixed};

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
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}') => {
                safe.push('\u{fffd}');
            }
            c => safe.push(c),
        }
    }
    safe
}

/// Formats a number with so many decimals, a narrow space between thousands, and a true minus sign.
pub(in crate::report) fn number(value: f64, decimals: usize) -> String {
    let text = fixed(value, decimals);
    let (sign, digits) = text.strip_prefix('-').map_or(("", text.as_str()), |digits| ("−", digits));
    let (whole, fraction) = digits.split_at(digits.find('.').unwrap_or(digits.len()));
    let mut grouped = String::from(sign);
    for (position, digit) in whole.chars().enumerate() {
        if position > 0 && (whole.len() - position).is_multiple_of(3) {
            grouped.push('\u{202f}');
        }
        grouped.push(digit);
    }
    grouped + fraction
}

/// Formats a share as a percentage with two decimals.
pub(in crate::report) fn percent(share: f64) -> String {
    format!("{}\u{a0}%", number(share * 100.0, 2))
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
    if secs < 100.0 {
        return format!("{}\u{a0}s", number(secs, 1));
    }
    let whole = secs.round() as u64;
    format!("{}\u{a0}min {}\u{a0}s", whole / 60, whole % 60)
}
