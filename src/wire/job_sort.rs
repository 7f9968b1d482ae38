//! Order of a list of jobs.

use std::fmt;
use std::str::FromStr;

use utoipa::openapi::RefOr;
use utoipa::openapi::extensions::ExtensionsBuilder;
use utoipa::openapi::schema::{ObjectBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

use crate::cell::closed_list;

closed_list! {
    /// Field that a list of jobs is sorted by.
    pub enum JobSortKey {
        /// Order in which jobs were accepted, that of their ids: also where the clock was set back meanwhile.
        CreatedAt = "created_at",
        /// Time at which the job ended; one that has not ended comes after those that have.
        EndedAt = "ended_at",
        /// Part number; jobs without one come first.
        PartNumber = "part_number",
        /// Serial number; jobs without one come first.
        Serial = "serial",
    }
}

/// Order of a list of jobs: by a field, and where it is the same by age. Written as the field, with `-` before it if descending.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JobSort {
    /// The field.
    pub key: JobSortKey,
    /// True if the greatest comes first.
    pub descending: bool,
}

impl Default for JobSort {
    fn default() -> Self {
        Self { key: JobSortKey::CreatedAt, descending: true }
    }
}

impl JobSort {
    /// Every order.
    pub fn all() -> impl Iterator<Item = Self> {
        JobSortKey::ALL.into_iter().flat_map(|key| [false, true].map(|descending| Self { key, descending }))
    }

    /// Names of all orders, as they are written.
    #[must_use]
    pub fn names() -> Vec<String> {
        Self::all().map(|sort| sort.to_string()).collect()
    }
}

impl fmt::Display for JobSort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", if self.descending { "-" } else { "" }, self.key.as_str())
    }
}

impl FromStr for JobSort {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::all().find(|sort| sort.to_string() == text).ok_or_else(|| format!("unknown order {text:?}"))
    }
}

impl PartialSchema for JobSort {
    fn schema() -> RefOr<Schema> {
        // Generators of clients make no name of a minus; these are theirs.
        let named = |sort: JobSort| format!("{}{}", sort.key.as_str(), if sort.descending { "_descending" } else { "" });
        let names: Vec<String> = Self::all().map(named).collect();
        ObjectBuilder::new()
            .schema_type(Type::String)
            .description(Some("Order of a list of jobs; `-` means descending."))
            .enum_values(Some(Self::names()))
            .extensions(Some(ExtensionsBuilder::new().add("x-enum-varnames", names).build()))
            .into()
    }
}

impl ToSchema for JobSort {}
