//! Brightness of the projector: one level for all views, or a level for each.

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use utoipa::openapi::schema::{KnownFormat, Type};
use utoipa::openapi::{ObjectBuilder, OneOfBuilder, RefOr, Schema, SchemaFormat};
use utoipa::{PartialSchema, ToSchema};

use super::knob::Ranged;
use crate::cell::{Findings, LEVELS, REFERENCE_LEVEL};

/// Brightness of the projector: a level from 0 (darkest) to 9 (brightest), or `auto`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Brightness {
    /// This level for every view.
    Level(u8),
    /// The best level for each view, and a second one where that pays.
    Auto,
}

impl Brightness {
    /// Levels that a view may be captured at.
    #[must_use]
    pub fn levels(self) -> std::ops::RangeInclusive<u8> {
        match self {
            Self::Level(level) => level..=level,
            Self::Auto => 0..=LEVELS as u8 - 1,
        }
    }

    /// Level of a view of which nothing more is known.
    #[must_use]
    pub fn usual_level(self) -> u8 {
        match self {
            Self::Level(level) => level,
            Self::Auto => REFERENCE_LEVEL,
        }
    }
}

impl Ranged for Brightness {
    fn check_range(&self, at: &str, range: [f64; 2], unit: &str, findings: &mut Findings) {
        if let Self::Level(level) = self {
            level.check_range(at, range, unit, findings);
        }
    }
}

impl Serialize for Brightness {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Level(level) => serializer.serialize_u8(*level),
            Self::Auto => serializer.serialize_str("auto"),
        }
    }
}

impl<'de> Deserialize<'de> for Brightness {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;

        impl de::Visitor<'_> for Visitor {
            type Value = Brightness;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a level from 0 to 9 or \"auto\"")
            }

            fn visit_u64<E: de::Error>(self, level: u64) -> Result<Brightness, E> {
                let level = u8::try_from(level).map_err(|_| E::invalid_value(de::Unexpected::Unsigned(level), &self))?;
                Ok(Brightness::Level(level))
            }

            fn visit_i64<E: de::Error>(self, level: i64) -> Result<Brightness, E> {
                let level = u64::try_from(level).map_err(|_| E::invalid_value(de::Unexpected::Signed(level), &self))?;
                self.visit_u64(level)
            }

            fn visit_str<E: de::Error>(self, text: &str) -> Result<Brightness, E> {
                match text {
                    "auto" => Ok(Brightness::Auto),
                    _ => Err(E::invalid_value(de::Unexpected::Str(text), &self)),
                }
            }
        }

        deserializer.deserialize_any(Visitor)
    }
}

impl PartialSchema for Brightness {
    fn schema() -> RefOr<Schema> {
        let level = ObjectBuilder::new()
            .schema_type(Type::Integer)
            .format(Some(SchemaFormat::KnownFormat(KnownFormat::Int32)))
            .minimum(Some(0))
            .maximum(Some(9));
        let auto = ObjectBuilder::new().schema_type(Type::String).enum_values(Some(["auto"]));
        let about = "Brightness of the projector: a level from 0 (darkest) to 9 (brightest), or `auto`.";
        let one_of = OneOfBuilder::new().item(level).item(auto).description(Some(about));
        RefOr::T(Schema::OneOf(one_of.build()))
    }
}

impl ToSchema for Brightness {}

#[cfg(test)]
mod tests {
    use super::Brightness;

    #[test]
    fn a_brightness_is_a_number_or_auto_and_nothing_else() {
        let read = |text: &str| serde_json::from_str::<Brightness>(text).map_err(|error| error.to_string());
        assert_eq!([read("7"), read("\"auto\"")], [Ok(Brightness::Level(7)), Ok(Brightness::Auto)]);
        for brightness in [Brightness::Level(0), Brightness::Auto] {
            let text = serde_json::to_string(&brightness).expect("JSON");
            assert_eq!(read(&text), Ok(brightness), "{text}");
        }
        for bad in ["\"bright\"", "-1", "300", "null", "2.5"] {
            let error = read(bad).expect_err(bad);
            assert!(error.contains("a level from 0 to 9 or \"auto\""), "{bad}: {error}");
        }
    }
}
