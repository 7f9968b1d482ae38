//! Knobs: numbers of a job with their default, range and unit. Each is declared once, by [`params!`]; the range checks, the
//! API document, the help of the command line and `api/parameters.md` are made from that.

use utoipa::openapi::{RefOr, Schema};

use crate::cell::Findings;
pub(crate) use crate::cell::Ranged;

/// A parameter, with its range if it has one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knob {
    /// Name of the field.
    pub field: &'static str,
    /// Range of the number, or of each entry of a list, bounds included.
    pub range: Option<[f64; 2]>,
    /// Unit of the number; empty where it has none.
    pub unit: &'static str,
    /// Smallest and largest number of entries of a list.
    pub entries: Option<[usize; 2]>,
}

/// Knobs of one struct of parameters.
#[derive(Clone, Copy, Debug)]
pub struct KnobGroup {
    /// Name of the struct, as in the API document.
    pub name: &'static str,
    /// Fields of the struct, in order.
    pub knobs: &'static [Knob],
    /// Schema of the struct, with the descriptions of its fields.
    pub schema: fn() -> RefOr<Schema>,
}

/// Records a list that is too short or too long.
pub(crate) fn check_entries(count: usize, at: &str, [min, max]: [usize; 2], findings: &mut Findings) {
    findings.require((min..=max).contains(&count), at, || {
        let entries = if count == 1 { "entry" } else { "entries" };
        format!("has {count} {entries}; allowed is {min} to {max}")
    });
}

/// Declares a struct of parameters: `name: type = default, [min, max] "unit", entries [min, max];` for each field, where range
/// and number of entries are optional. With `required` before the name, fields have no default and name their own in `#[serde]`.
macro_rules! params {
    (
        $(#[$meta:meta])* $name:ident {$(
            $(#[$field_meta:meta])* $field:ident: $type:ty = $default:expr
            $(, [$min:literal, $max:literal] $unit:literal)? $(, entries [$fewest:literal, $most:literal])?;
        )*}
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, utoipa::ToSchema)]
        #[serde(default, deny_unknown_fields, expecting = "an object")]
        pub struct $name {$(
            $(#[$field_meta])*
            #[doc = concat!("\n\nDefault: `", stringify!($default), "`.")]
            $(#[doc = concat!("Range: ", stringify!($min), " to ", stringify!($max), " ", $unit, ".")])?
            $(#[doc = concat!("Entries: ", stringify!($fewest), " to ", stringify!($most), ".")])?
            pub $field: $type,
        )*}

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default,)* }
            }
        }

        crate::planning::params::knob::knobs! {
            $name {$($field $(, [$min, $max] $unit)? $(, entries [$fewest, $most])?;)*}
        }
    };
    (
        $(#[$meta:meta])* required $name:ident {$(
            $(#[$field_meta:meta])* $field:ident: $type:ty
            $(, [$min:literal, $max:literal] $unit:literal)?;
        )*}
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, utoipa::ToSchema)]
        #[serde(deny_unknown_fields, expecting = "an object")]
        pub struct $name {$(
            $(#[$field_meta])*
            $(#[doc = concat!("\n\nRange: ", stringify!($min), " to ", stringify!($max), " ", $unit, ".")])?
            pub $field: $type,
        )*}

        crate::planning::params::knob::knobs! {
            $name {$($field $(, [$min, $max] $unit)?;)*}
        }
    };
}

/// Implements [`KnobGroup`] and the range checks of a struct.
macro_rules! knobs {
    ($name:ident {$(
        $field:ident $(, [$min:literal, $max:literal] $unit:literal)? $(, entries [$fewest:literal, $most:literal])?;
    )*}) => {
        impl $name {
            /// Fields, with their ranges.
            pub const KNOBS: crate::planning::params::KnobGroup = crate::planning::params::KnobGroup {
                name: stringify!($name),
                knobs: &[$(crate::planning::params::Knob {
                    field: stringify!($field),
                    range: crate::planning::params::knob::first(&[$([$min, $max])?]),
                    unit: concat!($($unit)?),
                    entries: crate::planning::params::knob::first(&[$([$fewest, $most])?]),
                }),*],
                schema: <Self as utoipa::PartialSchema>::schema,
            };

            /// Records what is out of its range; `at` is the pointer to this object.
            fn check_ranges(&self, at: &str, findings: &mut crate::cell::Findings) {
                let pointer = |field: &str| format!("{at}/{field}");
                // A struct may be without ranges.
                let _ = (&pointer, &findings);
                $(
                    $(crate::planning::params::knob::Ranged::check_range(
                        &self.$field, &pointer(stringify!($field)), [$min, $max], $unit, findings,
                    );)?
                    $(crate::planning::params::knob::check_entries(
                        self.$field.len(), &pointer(stringify!($field)), [$fewest, $most], findings,
                    );)?
                )*
            }
        }
    };
}

/// The first item, if there is one.
pub(crate) const fn first<T: Copy>(items: &[T]) -> Option<T> {
    if items.is_empty() { None } else { Some(items[0]) }
}

pub(crate) use {knobs, params};
