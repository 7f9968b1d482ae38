//! Stored hardware specifications, as listed.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Kinds of hardware specification.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SpecKind {
    /// Structured-light scanners.
    Scanner,
    /// Robot arms.
    Robot,
    /// Turntables.
    Turntable,
    /// Cells.
    Cell,
}

impl SpecKind {
    /// Every kind.
    pub const ALL: [Self; 4] = [Self::Scanner, Self::Robot, Self::Turntable, Self::Cell];

    /// `scanner`, `robot`, …
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Scanner => "scanner",
            Self::Robot => "robot",
            Self::Turntable => "turntable",
            Self::Cell => "cell",
        }
    }

    /// Name of the collection: of the route, and of the folder of presets.
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

/// Whether `name` may name a specification: 1 to 64 of `a-z 0-9 . _ -`, beginning with a letter or digit.
#[must_use]
pub fn is_spec_name(name: &str) -> bool {
    let allowed = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit() || b"._-".contains(&c);
    (1..=64).contains(&name.len())
        && name.bytes().all(allowed)
        && name.bytes().next().is_some_and(|c| c.is_ascii_alphanumeric())
}

/// One entry of a list of specifications.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SpecListItem {
    /// Its name.
    pub name: String,
    /// Whether it came with the program and cannot be changed.
    pub preset: bool,
    /// Its entity tag, for `If-Match`.
    pub etag: String,
}

/// All specifications of one kind, by name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct SpecList {
    /// The entries.
    pub items: Vec<SpecListItem>,
}
