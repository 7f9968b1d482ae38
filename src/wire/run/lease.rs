//! Leases, the right to move a cell. One holder at a time, for a short time, renewed by a heartbeat.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::{FieldError, Findings};
use crate::wire::ids::LeaseId;
use crate::wire::words::is_control;

/// A request for the lease of a cell. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct LeaseRequest {
    /// Name of the cell, 1 to 128 characters: of one of the operator's (`execution.cells`), a stored one or a preset.
    #[schema(min_length = 1, max_length = 128)]
    pub cell: String,
    /// Name of the holder, for others to read, up to 128 characters. Default: empty.
    #[serde(default)]
    #[schema(max_length = 128)]
    pub holder: String,
}

impl LeaseRequest {
    /// Checks the lengths.
    ///
    /// # Errors
    /// All invalid fields.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        for (pointer, text, min) in [("/cell", &self.cell, 1), ("/holder", &self.holder, 0)] {
            let is_text = (min..=128).contains(&text.chars().count()) && !text.chars().any(is_control);
            findings.require(is_text, pointer, || format!("must have {min} to 128 characters, none of them a control character"));
        }
        findings.into_result()
    }
}

/// Lease of a cell: the right of one client to move it. It ends unless it is renewed in time, and a live run then stops.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LeaseDocument {
    /// Id of the lease; only its holder knows it.
    pub id: LeaseId,
    /// Name of the cell.
    pub cell: String,
    /// Name of the holder.
    pub holder: String,
    /// Fencing token, which rises with every lease of any cell; requests that move a cell name it.
    pub token: u64,
    /// Time after which it ends unless it is renewed, ms.
    pub ttl_ms: u64,
    /// Interval at which a holder should renew it, ms.
    pub heartbeat_ms: u64,
    /// Time left, ms.
    pub expires_in_ms: u64,
}

/// A lease as others see it, without its id.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HeldLease {
    /// Name of the cell.
    pub cell: String,
    /// Name of the holder.
    pub holder: String,
    /// Time left, ms.
    pub expires_in_ms: u64,
}

/// Leases that are held, sorted by cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LeaseList {
    /// Leases.
    pub items: Vec<HeldLease>,
}
