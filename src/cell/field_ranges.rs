//! Ranges of the numbers of a specification. Each is declared once, by [`field_ranges!`]; the check and the API document have it
//! from there.

use super::field_error::Findings;

/// Range of a number of a specification, bounds included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldRange {
    /// Name of the field.
    pub field: &'static str,
    /// Smallest and largest value of the number, or of each number of a list.
    pub range: [f64; 2],
    /// Unit of the number; empty where it has none.
    pub unit: &'static str,
}

impl FieldRange {
    /// Records what is out of the range; `at` is the pointer to the object that has the field.
    pub fn check(&self, at: &str, value: &impl Ranged, findings: &mut Findings) {
        value.check_range(&format!("{at}/{}", self.field), self.range, self.unit, findings);
    }
}

/// Ranges of the numbers of one specification.
#[derive(Clone, Copy, Debug)]
pub struct RangeGroup {
    /// Name of the specification, as in the API document.
    pub name: &'static str,
    /// Ranges of the numbers.
    pub ranges: &'static [FieldRange],
}

/// A value with a range: a number, or a list of them.
pub trait Ranged {
    /// Records what is out of `[min, max]`.
    fn check_range(&self, at: &str, range: [f64; 2], unit: &str, findings: &mut Findings);
}

impl Ranged for f64 {
    fn check_range(&self, at: &str, [min, max]: [f64; 2], unit: &str, findings: &mut Findings) {
        findings.range(at, *self, min, max, unit);
    }
}

impl Ranged for u8 {
    fn check_range(&self, at: &str, range: [f64; 2], unit: &str, findings: &mut Findings) {
        f64::from(*self).check_range(at, range, unit, findings);
    }
}

impl Ranged for u16 {
    fn check_range(&self, at: &str, range: [f64; 2], unit: &str, findings: &mut Findings) {
        f64::from(*self).check_range(at, range, unit, findings);
    }
}

impl Ranged for i32 {
    fn check_range(&self, at: &str, range: [f64; 2], unit: &str, findings: &mut Findings) {
        f64::from(*self).check_range(at, range, unit, findings);
    }
}

impl Ranged for u32 {
    fn check_range(&self, at: &str, range: [f64; 2], unit: &str, findings: &mut Findings) {
        f64::from(*self).check_range(at, range, unit, findings);
    }
}

impl Ranged for u64 {
    fn check_range(&self, at: &str, range: [f64; 2], unit: &str, findings: &mut Findings) {
        (*self as f64).check_range(at, range, unit, findings);
    }
}

impl Ranged for usize {
    fn check_range(&self, at: &str, range: [f64; 2], unit: &str, findings: &mut Findings) {
        (*self as f64).check_range(at, range, unit, findings);
    }
}

impl<T: Ranged> Ranged for Option<T> {
    fn check_range(&self, at: &str, range: [f64; 2], unit: &str, findings: &mut Findings) {
        self.iter().for_each(|value| value.check_range(at, range, unit, findings));
    }
}

impl<T: Ranged> Ranged for [T] {
    fn check_range(&self, at: &str, range: [f64; 2], unit: &str, findings: &mut Findings) {
        self.iter().enumerate().for_each(|(index, value)| value.check_range(&format!("{at}/{index}"), range, unit, findings));
    }
}

impl<T: Ranged, const N: usize> Ranged for [T; N] {
    fn check_range(&self, at: &str, range: [f64; 2], unit: &str, findings: &mut Findings) {
        self.as_slice().check_range(at, range, unit, findings);
    }
}

impl<T: Ranged> Ranged for Vec<T> {
    fn check_range(&self, at: &str, range: [f64; 2], unit: &str, findings: &mut Findings) {
        self.as_slice().check_range(at, range, unit, findings);
    }
}

/// Declares ranges of a specification: `NAME = "field", [min, max] "unit";` for each. `Self::NAME` is the range, for the check,
/// and `RANGES` has all of them.
#[macro_export]
#[doc(hidden)]
macro_rules! field_ranges {
    ($spec:ident {$($name:ident = $field:literal, [$min:expr, $max:expr] $unit:literal;)*}) => {
        impl $spec {
            $(pub(crate) const $name: $crate::cell::FieldRange =
                $crate::cell::FieldRange { field: $field, range: [$min, $max], unit: $unit };)*

            /// Ranges of its numbers.
            pub const RANGES: $crate::cell::RangeGroup =
                $crate::cell::RangeGroup { name: stringify!($spec), ranges: &[$(Self::$name),*] };
        }
    };
}

pub use field_ranges;
