//! Rows of uploaded meshes.

use serde_json::Value;
use sqlx::Row;
use sqlx::sqlite::SqliteRow;

use super::files::Received;
use super::pages::Page;
use super::{Store, blocking, parsed};
use crate::service::error::Error;
use crate::service::failpoint;
use crate::wire::{Mesh, MeshHealth, MeshId, MeshPage};

/// A mesh to be stored.
pub(crate) struct NewMesh {
    pub received: Received,
    pub unit: String,
    pub name: Option<String>,
    pub health: MeshHealth,
}

/// Which file a mesh is, and how to read it.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct MeshFile {
    pub sha256: String,
    pub unit: String,
}

impl Store {
    /// Stores a mesh. The same file with the same unit and name is the same mesh: uploading it again gives it back.
    pub(crate) async fn add_mesh(&self, new: NewMesh) -> Result<Mesh, Error> {
        let NewMesh { received, unit, name, health } = new;
        let (sha256, size_bytes) = (received.sha256.clone(), received.size_bytes);
        let _hold = self.held.hold(vec![sha256.clone()]).await;
        let files = self.files.clone();
        blocking(move || {
            failpoint::hit("upload", "before_rename");
            files.adopt(received)?;
            failpoint::hit("upload", "after_rename");
            Ok(())
        })
        .await?;
        let mut tx = self.writer.begin().await?;
        let same = sqlx::query(concat!(
            "SELECT id, sha256, unit, name, size_bytes, health, created_at FROM mesh ",
            "WHERE sha256 = ?1 AND unit = ?2 AND name IS ?3"
        ))
        .bind(&sha256)
        .bind(&unit)
        .bind(&name)
        .fetch_optional(&mut *tx)
        .await?;
        if let Some(row) = same {
            return read(&row);
        }
        let row = sqlx::query(
            "INSERT INTO mesh (id, sha256, unit, name, size_bytes, health) VALUES (?1, ?2, ?3, ?4, ?5, ?6)
             RETURNING id, sha256, unit, name, size_bytes, health, created_at",
        )
        .bind(MeshId::generate().to_string())
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
    pub(crate) async fn mesh(&self, id: MeshId) -> Result<Mesh, Error> {
        let row = sqlx::query("SELECT id, sha256, unit, name, size_bytes, health, created_at FROM mesh WHERE id = ?1")
            .bind(id.to_string())
            .fetch_optional(&self.reader)
            .await?;
        read(&row.ok_or(Error::MeshNotFound(id))?)
    }

    /// A page of meshes, newest first.
    pub(crate) async fn meshes(&self, page: &Page) -> Result<MeshPage, Error> {
        let rows = sqlx::query(
            "SELECT id, sha256, unit, name, size_bytes, health, created_at FROM mesh
             WHERE id < ?1 ORDER BY id DESC LIMIT ?2",
        )
        .bind(&page.before)
        .bind(page.limit())
        .fetch_all(&self.reader)
        .await?;
        let mut items = rows.iter().map(read).collect::<Result<Vec<_>, _>>()?;
        let next_page_token = page.cut(&mut items, |mesh| mesh.id.to_string())?;
        Ok(MeshPage { items, next_page_token })
    }

    /// The hash of the preview made for a mesh earlier.
    pub(crate) async fn preview(&self, id: MeshId) -> Result<Option<String>, Error> {
        let row = sqlx::query_scalar("SELECT preview FROM mesh WHERE id = ?1")
            .bind(id.to_string())
            .fetch_optional(&self.reader)
            .await?;
        row.ok_or(Error::MeshNotFound(id))
    }

    /// Keeps the preview made for a mesh; returns its hash.
    pub(crate) async fn keep_preview(&self, id: MeshId, bytes: Vec<u8>) -> Result<String, Error> {
        let files = self.files.clone();
        let received = blocking(move || Ok(files.write(&bytes)?)).await?;
        let sha256 = received.sha256.clone();
        let _hold = self.held.hold(vec![sha256.clone()]).await;
        let files = self.files.clone();
        blocking(move || files.adopt(received)).await?;
        let mut tx = self.writer.begin().await?;
        let kept = sqlx::query("UPDATE mesh SET preview = ?2 WHERE id = ?1")
            .bind(id.to_string())
            .bind(&sha256)
            .execute(&mut *tx)
            .await?;
        tx.commit().await?;
        if kept.rows_affected() == 0 { Err(Error::MeshNotFound(id)) } else { Ok(sha256) }
    }

    /// Deletes a mesh that no unfinished job needs.
    pub(crate) async fn delete_mesh(&self, id: MeshId) -> Result<(), Error> {
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
            let row = sqlx::query("DELETE FROM mesh WHERE id = ?1 RETURNING sha256, preview")
                .bind(id.to_string())
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

fn read(row: &SqliteRow) -> Result<Mesh, Error> {
    Ok(Mesh {
        id: parsed("mesh.id", &row.try_get::<String, _>("id")?)?,
        name: row.try_get("name")?,
        unit: row.try_get("unit")?,
        sha256: row.try_get("sha256")?,
        size_bytes: row.try_get::<i64, _>("size_bytes")?.unsigned_abs(),
        created_at: row.try_get("created_at")?,
        // The mesh is none the worse for a report that cannot be read.
        health: read_health(&row.try_get::<String, _>("health")?).unwrap_or_else(|reason| MeshHealth::unreadable(&reason)),
    })
}

/// A stored health report. Facts that the version which stored it did not know are empty.
pub(super) fn read_health(text: &str) -> Result<MeshHealth, String> {
    let mut facts = serde_json::to_value(MeshHealth::default()).map_err(|error| error.to_string())?;
    let stored: serde_json::Map<String, Value> = serde_json::from_str(text).map_err(|error| error.to_string())?;
    if let Value::Object(facts) = &mut facts {
        facts.extend(stored);
    }
    serde_json::from_value(facts).map_err(|error| error.to_string())
}
