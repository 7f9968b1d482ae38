//! An uploaded mesh and its facts.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::ids::MeshId;
use super::mesh_health::MeshHealthReport;

/// Unit of length of a file of a mesh or of scans.
#[derive(ToSchema)]
#[schema(rename_all = "lowercase")]
pub enum MeshUnit {
    /// Millimetres.
    Mm,
    /// Centimetres.
    Cm,
    /// Metres.
    M,
    /// Inches of 25.4 mm.
    Inch,
}

/// An uploaded mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = Mesh)]
pub struct UploadedMesh {
    /// Id of the mesh.
    pub id: MeshId,
    /// Name given at upload.
    pub name: Option<String>,
    /// Unit of the file's coordinates.
    #[schema(value_type = MeshUnit)]
    pub unit: String,
    /// SHA-256 of the file, lower-case hexadecimal.
    pub sha256: String,
    /// Size of the file.
    pub size_bytes: u64,
    /// Time of the last upload of this file with this unit and name, UTC.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// Health report of the mesh.
    pub health: MeshHealthReport,
}

/// A page of meshes, by their first upload: the newest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MeshPage {
    /// Meshes on this page.
    pub items: Vec<UploadedMesh>,
    /// Token of the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next_page_token: Option<String>,
}
