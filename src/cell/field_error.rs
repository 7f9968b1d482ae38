//! Errors in single fields of a specification, and the check of a specification field by field.

use std::fmt;

use serde::Serialize;

/// One finding: where, and what would be allowed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FieldError {
    /// JSON pointer of the field (RFC 6901), also for files in TOML; empty for the whole.
    pub pointer: String,
    /// The value found and the allowed range.
    pub detail: String,
}

impl FieldError {
    /// The error with the pointer from the root of a document that holds this one at `prefix`.
    #[must_use]
    pub fn below(self, prefix: &str) -> Self {
        Self { pointer: format!("{prefix}{}", self.pointer), ..self }
    }
}

impl fmt::Display for FieldError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.pointer.as_str() {
            "" => f.write_str(&self.detail),
            pointer => write!(f, "{pointer}: {}", self.detail),
        }
    }
}

/// Collects every finding of a specification, so that its author sees all of them at once.
#[derive(Debug, Default)]
pub struct Findings {
    prefix: String,
    errors: Vec<FieldError>,
}

impl Findings {
    /// Findings below `prefix`, for a specification that is part of another.
    #[must_use]
    pub fn below(prefix: impl Into<String>) -> Self {
        Self { prefix: prefix.into(), errors: Vec::new() }
    }

    /// Records one finding.
    pub fn push(&mut self, pointer: impl fmt::Display, detail: impl Into<String>) {
        self.errors.push(FieldError { pointer: format!("{}{pointer}", self.prefix), detail: detail.into() });
    }

    /// Requires `low <= value <= high` (and a finite number); `unit` is named in the message.
    pub fn range(&mut self, pointer: impl fmt::Display, value: f64, low: f64, high: f64, unit: &str) {
        if !(value.is_finite() && low <= value && value <= high) {
            let space = if unit.is_empty() { "" } else { " " };
            let percent = if unit.is_empty() && high <= 1.0 { as_percent(value) } else { String::new() };
            let [value, low, high] = [value, low, high].map(told);
            self.push(pointer, format!("is {value}{space}{unit}; allowed is {low} to {high}{space}{unit}{percent}"));
        }
    }

    /// Requires `condition`, else records `detail`.
    pub fn require(&mut self, condition: bool, pointer: impl fmt::Display, detail: impl FnOnce() -> String) {
        if !condition {
            self.push(pointer, detail());
        }
    }

    /// Takes over the findings of a part.
    pub fn extend(&mut self, other: Findings) {
        self.errors.extend(other.errors);
    }

    /// `Ok` when nothing was found.
    ///
    /// # Errors
    /// Every finding, in the order in which it was recorded.
    pub fn into_result(self) -> Result<(), Vec<FieldError>> {
        if self.errors.is_empty() { Ok(()) } else { Err(self.errors) }
    }
}

/// The number as it is written; very large and small ones with a power of ten, which would have hundreds of digits.
fn told(value: f64) -> String {
    const PLAIN: std::ops::Range<f64> = 1e-9..1e9;
    let is_plain = value == 0.0 || !value.is_finite() || PLAIN.contains(&value.abs());
    if is_plain { value.to_string() } else { format!("{value:e}") }
}

/// Hint for a share that was given in percent; empty for a number that hardly was.
fn as_percent(value: f64) -> String {
    if !(5.0..=100.0).contains(&value) {
        return String::new();
    }
    // Rounded, so that 97.3 becomes 0.973 and no neighbour of it.
    format!("; {value} % is {}", (value * 100.0).round() / 1e4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_of_hundreds_of_digits_is_told_with_a_power_of_ten() {
        let told = |value: f64, high: f64| {
            let mut findings = Findings::default();
            findings.range("/table_angle_deg", value, 0.0, high, "°");
            findings.into_result().expect_err("out of range")[0].detail.clone()
        };
        assert_eq!(told(1e308, 180.0), "is 1e308 °; allowed is 0 to 180 °");
        assert_eq!(told(-2.5e-300, 1e12), "is -2.5e-300 °; allowed is 0 to 1e12 °");
        assert_eq!(told(123_456_789.5, 0.25), "is 123456789.5 °; allowed is 0 to 0.25 °");
        assert_eq!(told(f64::INFINITY, 1.0), "is inf °; allowed is 0 to 1 °");
    }

    #[test]
    fn a_share_in_percent_is_told_as_a_share() {
        let told = |value: f64, high: f64, unit: &str| {
            let mut findings = Findings::default();
            findings.range("/target", value, 0.0, high, unit);
            findings.into_result().expect_err("out of range")[0].detail.clone()
        };
        assert_eq!(told(97.3, 1.0, ""), "is 97.3; allowed is 0 to 1; 97.3 % is 0.973");
        assert_eq!(told(90.0, 1.0, ""), "is 90; allowed is 0 to 1; 90 % is 0.9");
        for (value, high, unit, expected) in [
            (2.0, 1.0, "", "is 2; allowed is 0 to 1"),
            (500.0, 1.0, "", "is 500; allowed is 0 to 1"),
            (90.0, 1.0, "mm", "is 90 mm; allowed is 0 to 1 mm"),
            (90.0, 4.0, "", "is 90; allowed is 0 to 4"),
        ] {
            assert_eq!(told(value, high, unit), expected);
        }
    }
}
