//! Rows of uploaded meshes.

use sqlx::sqlite::SqliteRow;
use sqlx::{Connection, Row};

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
        let _no_sweep = self.sweep.read().await;
        let (sha256, size_bytes) = (received.sha256.clone(), received.size_bytes);
        let files = self.files.clone();
        blocking(move || {
            failpoint::hit("upload", "before_rename");
            files.adopt(received)?;
            failpoint::hit("upload", "after_rename");
            Ok(())
        })
        .await?;
        let mut writer = self.writer.lock().await;
        let mut tx = writer.begin_with("BEGIN IMMEDIATE").await?;
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
        let next_page_token = page.cut(&mut items, |mesh| mesh.id.to_string());
        Ok(MeshPage { items, next_page_token })
    }

    /// All meshes.
    pub(crate) async fn all_meshes(&self) -> Result<Vec<Mesh>, Error> {
        let rows = sqlx::query("SELECT id, sha256, unit, name, size_bytes, health, created_at FROM mesh")
            .fetch_all(&self.reader)
            .await?;
        rows.iter().map(read).collect()
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
        let _no_sweep = self.sweep.read().await;
        let files = self.files.clone();
        let sha256 = blocking(move || Ok(files.put(&bytes)?)).await?;
        let mut writer = self.writer.lock().await;
        let kept = sqlx::query("UPDATE mesh SET preview = ?2 WHERE id = ?1")
            .bind(id.to_string())
            .bind(&sha256)
            .execute(&mut *writer)
            .await?;
        if kept.rows_affected() == 0 { Err(Error::MeshNotFound(id)) } else { Ok(sha256) }
    }

    /// Deletes a mesh that no unfinished job needs.
    pub(crate) async fn delete_mesh(&self, id: MeshId) -> Result<(), Error> {
        let orphans = {
            let mut writer = self.writer.lock().await;
            let mut tx = writer.begin_with("BEGIN IMMEDIATE").await?;
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
        health: serde_json::from_str(&row.try_get::<String, _>("health")?)?,
    })
}
