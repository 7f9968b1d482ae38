//! Typed ids: UUIDs of version 7, so that their order is the order of creation.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

macro_rules! typed_id {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema)]
        #[serde(transparent)]
        pub struct $name(Uuid);

        impl $name {
            /// Generates an id that is later in order than every id generated before in this process.
            #[must_use]
            pub fn generate() -> Self {
                Self(Uuid::now_v7())
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.hyphenated().fmt(f)
            }
        }

        impl FromStr for $name {
            type Err = uuid::Error;

            /// Parses the hyphenated form only, so that each id has one spelling (case aside).
            fn from_str(text: &str) -> Result<Self, Self::Err> {
                text.parse::<uuid::fmt::Hyphenated>().map(|id| Self(id.into_uuid()))
            }
        }
    };
}

typed_id! {
    /// Id of an uploaded mesh.
    MeshId
}
typed_id! {
    /// Id of a planning job.
    JobId
}
typed_id! {
    /// Id of a run of a program.
    RunId
}
typed_id! {
    /// Id of a calibration that the server keeps.
    CalibrationId
}
typed_id! {
    /// Id of an uploaded scan.
    ScanId
}
typed_id! {
    /// Id of an inspection.
    InspectionId
}
typed_id! {
    /// Id of a lease of a cell.
    LeaseId
}

impl MeshId {
    /// Id of [`super::example::MESH`] once it is uploaded, so that other examples can name it.
    pub const EXAMPLE: Self = Self(Uuid::from_u128(0x0190_0000_0000_7000_8000_0000_0000_0001));
}
