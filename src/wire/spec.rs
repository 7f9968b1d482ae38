//! Lists of stored hardware specifications.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::SpecKind;

/// Collections of hardware specifications.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SpecCollection {
    /// Structured-light scanners.
    Scanner,
    /// Robot arms.
    Robot,
    /// Turntables.
    Turntable,
    /// Cells.
    Cell,
}

impl SpecCollection {
    /// Every collection.
    pub const ALL: [Self; 4] = [Self::Scanner, Self::Robot, Self::Turntable, Self::Cell];

    /// Kind of its entries.
    #[must_use]
    pub fn kind(self) -> SpecKind {
        match self {
            Self::Scanner => SpecKind::Scanner,
            Self::Robot => SpecKind::Robot,
            Self::Turntable => SpecKind::Turntable,
            Self::Cell => SpecKind::Cell,
        }
    }

    /// Name of the kind: `scanner`, `robot`, `turntable` or `cell`.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        self.kind().as_str()
    }

    /// Name of the collection, in routes and as the folder of its presets.
    #[must_use]
    pub fn plural(self) -> &'static str {
        match self {
            Self::Scanner => "scanners",
            Self::Robot => "robots",
            Self::Turntable => "turntables",
            Self::Cell => "cells",
        }
    }
}

/// Returns true if `name` is a valid name of a specification: 1 to 64 of `a-z 0-9 . _ -`, beginning with a letter or digit.
#[must_use]
pub fn is_spec_name(name: &str) -> bool {
    let allowed = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || b"._-".contains(&c);
    (1..=64).contains(&name.len()) && name.bytes().all(allowed) && name.bytes().next().is_some_and(|c| c.is_ascii_alphanumeric())
}

/// An entry of a list of specifications.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SpecListItem {
    /// Name of the specification.
    pub name: String,
    /// True if it is a built-in preset, which cannot be changed.
    pub preset: bool,
    /// Entity tag of the specification, for `If-Match`.
    pub etag: String,
}

/// All specifications of one kind, sorted by name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SpecList {
    /// Entries of the list.
    pub items: Vec<SpecListItem>,
}
