//! Registration of setups to each other.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Means by which measurements of different setups are registered to each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Registration {
    /// Surface that both setups measure: it has to fix all six freedoms, else the part is not planned.
    #[default]
    Surface,
    /// Markers on the part or beside it.
    Markers,
    /// A fixture that puts the part where it is known to be.
    Fixture,
    /// None: each setup is evaluated by itself.
    None,
}
