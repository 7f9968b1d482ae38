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
            self.push(pointer, format!("is {value}{space}{unit}; allowed is {low} to {high}{space}{unit}"));
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
