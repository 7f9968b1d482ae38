//! Registration of setups to each other.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Means of registering the measurements of different setups to each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Registration {
    /// Surface that both setups measure: it must constrain all six degrees of freedom, or the part is not planned.
    #[default]
    Surface,
    /// Markers on or beside the part.
    Markers,
    /// A fixture that puts the part in a known pose.
    Fixture,
    /// Setups that are not registered to each other: each is evaluated by itself.
    None,
}
