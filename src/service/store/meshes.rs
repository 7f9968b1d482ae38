//! Rows of uploaded meshes.

use serde_json::Value;
use sqlx::sqlite::SqliteRow;
use sqlx::{Row, SqliteConnection};

use super::files::Received;
use super::pages::{Page, entry};
use super::stored::text;
use super::{Store, blocking, now, parsed};
use crate::service::error::Error;
use crate::service::failpoint;
use crate::wire::{MeshHealthReport, MeshId, MeshPage, UploadedMesh, decode, example};

/// A mesh to be stored.
pub(crate) struct NewMesh {
    pub received: Received,
    pub unit: String,
    pub name: Option<String>,
    pub health: MeshHealthReport,
}

/// File of a mesh and the unit of its coordinates.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct MeshFile {
    pub sha256: String,
    pub unit: String,
}

impl Store {
    /// Stores a mesh. An upload with the same bytes, unit and name as a stored mesh returns that mesh, uploaded now.
    pub(crate) async fn add_mesh(&self, new: NewMesh) -> Result<UploadedMesh, Error> {
        let NewMesh { received, unit, name, health } = new;
        let (sha256, size_bytes) = (received.sha256.clone(), received.size_bytes);
        let _pin = self.pinned.pin(vec![sha256.clone()]).await;
        let files = self.files.clone();
        blocking(move || {
            failpoint::hit("upload", "before_rename");
            files.persist(received)?;
            failpoint::hit("upload", "after_rename");
            Ok(())
        })
        .await?;
        let mut tx = self.writer.begin().await?;
        let same = sqlx::query(concat!(
            "UPDATE mesh SET created_at = ",
            now!(),
            " WHERE sha256 = ?1 AND unit = ?2 AND name IS ?3
             RETURNING id, sha256, unit, name, size_bytes, health, created_at"
        ))
        .bind(&sha256)
        .bind(&unit)
        .bind(&name)
        .fetch_optional(&mut *tx)
        .await?;
        if let Some(row) = same {
            tx.commit().await?;
            return read(&row);
        }
        let row = sqlx::query(
            "INSERT INTO mesh (id, sha256, unit, name, size_bytes, health) VALUES (?1, ?2, ?3, ?4, ?5, ?6)
             RETURNING id, sha256, unit, name, size_bytes, health, created_at",
        )
        .bind(new_id(&mut tx, &sha256).await?.to_string())
        .bind(sha256)
        .bind(unit)
        .bind(name)
        .bind(i64::try_from(size_bytes).unwrap_or(i64::MAX))
        .bind(serde_json::to_string(&health)?)
        .fetch_one(&mut *tx)
        .await?;
        tx.commit().await?;
        failpoint::hit("upload", "committed");
        read(&row)
    }

    /// One mesh.
    pub(crate) async fn mesh(&self, id: MeshId) -> Result<UploadedMesh, Error> {
        let row = sqlx::query("SELECT id, sha256, unit, name, size_bytes, health, created_at FROM mesh WHERE id = ?1")
            .bind(id.to_string())
            .fetch_optional(&self.reader)
            .await?;
        read(&row.ok_or(Error::MeshNotFound(id))?)
    }

    /// A page of meshes, by their first upload: the newest first. Rows that cannot be read are left out.
    pub(crate) async fn meshes(&self, page: &Page) -> Result<MeshPage, Error> {
        let rows = sqlx::query(
            "SELECT id, sha256, unit, name, size_bytes, health, created_at FROM mesh
             WHERE id < ?1 ORDER BY id DESC LIMIT ?2",
        )
        .bind(page.before())
        .bind(page.limit())
        .fetch_all(&self.reader)
        .await?;
        let (items, next_page_token) = page.cut(rows.iter().map(|row| entry(row, read)))?;
        Ok(MeshPage { items, next_page_token })
    }

    /// Hash of a mesh's stored preview, if any.
    pub(crate) async fn preview(&self, id: MeshId) -> Result<Option<String>, Error> {
        let row = sqlx::query_scalar("SELECT preview FROM mesh WHERE id = ?1")
            .bind(id.to_string())
            .fetch_optional(&self.reader)
            .await?;
        row.ok_or(Error::MeshNotFound(id))
    }

    /// Stores the preview of a mesh; returns its hash.
    pub(crate) async fn put_preview(&self, id: MeshId, bytes: Vec<u8>) -> Result<String, Error> {
        let files = self.files.clone();
        let received = blocking(move || Ok(files.write(&bytes)?)).await?;
        let (sha256, size_bytes) = (received.sha256.clone(), received.size_bytes);
        let _pin = self.pinned.pin(vec![sha256.clone()]).await;
        let files = self.files.clone();
        blocking(move || files.persist(received)).await?;
        let mut tx = self.writer.begin().await?;
        let updated = sqlx::query("UPDATE mesh SET preview = ?2, preview_bytes = ?3 WHERE id = ?1")
            .bind(id.to_string())
            .bind(&sha256)
            .bind(i64::try_from(size_bytes).unwrap_or(i64::MAX))
            .execute(&mut *tx)
            .await?;
        tx.commit().await?;
        if updated.rows_affected() == 0 { Err(Error::MeshNotFound(id)) } else { Ok(sha256) }
    }

    /// Deletes a mesh that no unfinished job needs and no stored specification names, unless it was uploaded in the last `min_days` days:
    /// then it is not found. Its file stays as long as a job that read it.
    pub(crate) async fn delete_mesh(&self, id: MeshId, min_days: u32) -> Result<(), Error> {
        let orphans = {
            let mut tx = self.writer.begin().await?;
            let in_use: bool = sqlx::query_scalar(
                "SELECT EXISTS (SELECT 1 FROM job_mesh JOIN job ON job.id = job_mesh.job_id
                 WHERE job_mesh.mesh_id = ?1 AND job.state IN ('queued', 'running', 'cancelling'))",
            )
            .bind(id.to_string())
            .fetch_one(&mut *tx)
            .await?;
            if in_use {
                return Err(Error::MeshInUse(id));
            }
            let named = sqlx::query(
                "SELECT kind, name FROM spec, json_tree(CASE WHEN json_valid(spec.body) THEN spec.body ELSE '{}' END) AS node
                 WHERE node.key = 'mesh' AND node.type = 'text' AND lower(node.value) = ?1 LIMIT 1",
            )
            .bind(id.to_string())
            .fetch_optional(&mut *tx)
            .await?;
            if let Some(spec) = named {
                return Err(Error::MeshInSpec { mesh: id, kind: spec.try_get("kind")?, name: spec.try_get("name")? });
            }
            let row = sqlx::query(
                "DELETE FROM mesh WHERE id = ?1
                    AND (?2 = 0 OR created_at < strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-' || ?2 || ' days'))
                 RETURNING sha256, preview",
            )
            .bind(id.to_string())
            .bind(min_days)
            .fetch_optional(&mut *tx)
            .await?
            .ok_or(Error::MeshNotFound(id))?;
            tx.commit().await?;
            let preview: Option<String> = row.try_get("preview")?;
            preview.into_iter().chain([row.try_get::<String, _>("sha256")?]).collect()
        };
        self.remove_unreferenced(orphans).await
    }
}

/// Id of a new mesh. The part of the examples has a fixed one, in the first unit and under the first name it comes with.
async fn new_id(tx: &mut SqliteConnection, sha256: &str) -> Result<MeshId, Error> {
    if sha256 != example::MESH_SHA256 {
        return Ok(MeshId::generate());
    }
    let taken: bool = sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM mesh WHERE id = ?1)")
        .bind(MeshId::EXAMPLE.to_string())
        .fetch_one(tx)
        .await?;
    Ok(if taken { MeshId::generate() } else { MeshId::EXAMPLE })
}

fn read(row: &SqliteRow) -> Result<UploadedMesh, Error> {
    Ok(UploadedMesh {
        id: parsed("mesh.id", &row.try_get::<String, _>("id")?)?,
        name: row.try_get("name")?,
        unit: row.try_get("unit")?,
        sha256: row.try_get("sha256")?,
        size_bytes: row.try_get::<i64, _>("size_bytes")?.unsigned_abs(),
        created_at: row.try_get("created_at")?,
        // The mesh itself is usable even if its report is unreadable.
        health: text(row, "health")
            .and_then(|health| read_health(&health))
            .unwrap_or_else(|reason| MeshHealthReport::unreadable(&reason)),
    })
}

/// Reads a stored health report. Fields that an earlier version did not store get their defaults.
pub(super) fn read_health(text: &str) -> Result<MeshHealthReport, String> {
    let mut fields = serde_json::to_value(MeshHealthReport::default()).map_err(|error| error.to_string())?;
    let stored: serde_json::Map<String, Value> = serde_json::from_str(text).map_err(|error| error.to_string())?;
    if let Value::Object(fields) = &mut fields {
        fields.extend(stored);
    }
    decode(&fields).map_err(|error| error.to_string())
}
