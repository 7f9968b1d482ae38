//! Units of length that mesh files are drawn in. Everything inside is millimetres.

use std::fmt;
use std::str::FromStr;

/// The unit a mesh file is drawn in. None of the formats we read says it, so it is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LengthUnit {
    /// `mm`
    Millimetre,
    /// `cm`
    Centimetre,
    /// `m`
    Metre,
    /// `inch`
    Inch,
}

/// The text is not the name of a known unit.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is not a unit of length; use one of mm, cm, m, inch (in, inches, millimetres and the like are understood too)")]
pub struct UnknownUnit(String);

impl LengthUnit {
    /// Every unit, smallest first but for the inch.
    pub const ALL: [Self; 4] = [Self::Millimetre, Self::Centimetre, Self::Metre, Self::Inch];

    /// Millimetres in one of this unit.
    #[must_use]
    pub fn mm(self) -> f64 {
        match self {
            Self::Millimetre => 1.0,
            Self::Centimetre => 10.0,
            Self::Metre => 1000.0,
            Self::Inch => 25.4,
        }
    }

    /// Names under which it is understood, in lower case; the first is its own.
    #[must_use]
    pub fn names(self) -> &'static [&'static str] {
        match self {
            Self::Millimetre => &["mm", "millimetre", "millimetres", "millimeter", "millimeters"],
            Self::Centimetre => &["cm", "centimetre", "centimetres", "centimeter", "centimeters"],
            Self::Metre => &["m", "metre", "metres", "meter", "meters"],
            Self::Inch => &["inch", "inches", "in", "\"", "\u{2033}"],
        }
    }

    /// Name of the unit in files, queries and options.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        self.names()[0]
    }
}

impl fmt::Display for LengthUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl FromStr for LengthUnit {
    type Err = UnknownUnit;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let plain = name.trim().to_lowercase();
        Self::ALL.into_iter().find(|unit| unit.names().contains(&plain.as_str())).ok_or_else(|| UnknownUnit(name.into()))
    }
}

#[cfg(test)]
mod tests {
    use super::LengthUnit;

    #[test]
    fn units_are_understood_as_people_write_them() {
        for (unit, names) in [
            (LengthUnit::Millimetre, &["mm", "MM", "Mm", " mm", "millimetre", "Millimeters"][..]),
            (LengthUnit::Centimetre, &["cm", "CM", "centimetres", "centimeter"]),
            (LengthUnit::Metre, &["m", "M", "metre", "Meters"]),
            (LengthUnit::Inch, &["inch", "Inch", "in", "IN", "inches", "\"", "\u{2033}"]),
        ] {
            for name in names {
                assert_eq!(name.parse(), Ok(unit), "{name}");
            }
            assert_eq!(unit.as_str().parse(), Ok(unit), "what is written is read");
        }
        for wrong in ["", "feet", "mmm", "in.", "1", "µm"] {
            let error = wrong.parse::<LengthUnit>().expect_err(wrong).to_string();
            assert!(error.contains("use one of mm, cm, m, inch"), "{error}");
        }
    }

    #[test]
    fn no_name_stands_for_two_units() {
        let names: Vec<_> = LengthUnit::ALL.iter().flat_map(|unit| unit.names()).collect();
        let distinct: std::collections::BTreeSet<_> = names.iter().collect();
        assert_eq!(distinct.len(), names.len());
        assert!(names.iter().all(|name| name.to_lowercase() == ***name), "lower case, as they are looked up");
    }
}
