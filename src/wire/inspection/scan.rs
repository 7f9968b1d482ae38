//! Uploaded scans as resources.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::inspection::ingest::ScanFrame;
use crate::wire::{JobId, MeshUnit, ScanId};

/// A scan that was uploaded for a job: one file with the points of one view, or of all views together. It never changes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Scan {
    /// Id.
    pub id: ScanId,
    /// Job whose plan was scanned.
    pub job_id: JobId,
    /// Viewpoint of the plan from which it was taken; `null` for a file of several views, or to take the number from the file's
    /// name.
    pub view: Option<u32>,
    /// Name of the file.
    pub name: Option<String>,
    /// Unit of the coordinates; `null` to detect it.
    #[schema(value_type = Option<MeshUnit>)]
    pub unit: Option<String>,
    /// Frame of the coordinates; `null` to detect it.
    pub frame: Option<ScanFrame>,
    /// SHA-256 of the file.
    pub sha256: String,
    /// Size of the file.
    pub size_bytes: u64,
    /// Time at which it was uploaded, UTC.
    #[schema(format = DateTime)]
    pub created_at: String,
}

/// A page of scans, oldest first.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct ScanPage {
    /// Scans on this page.
    pub items: Vec<Scan>,
    /// Token of the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next_page_token: Option<String>,
}
