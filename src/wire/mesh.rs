//! An uploaded mesh and what is known of it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::ids::MeshId;
use super::mesh_health::MeshHealth;

/// An uploaded mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Mesh {
    /// Its id.
    pub id: MeshId,
    /// Name given at the upload.
    pub name: Option<String>,
    /// Unit of the file's coordinates: `mm`, `cm`, `m` or `inch`.
    pub unit: String,
    /// SHA-256 of the file, lower-case hexadecimal.
    pub sha256: String,
    /// Size of the file.
    pub size_bytes: u64,
    /// Time of the first upload, UTC.
    #[schema(format = DateTime)]
    pub created_at: String,
    /// Facts and faults of the mesh.
    pub health: MeshHealth,
}

/// One page of meshes, newest first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MeshPage {
    /// The meshes.
    pub items: Vec<Mesh>,
    /// Token of the next page; absent on the last one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next_page_token: Option<String>,
}
