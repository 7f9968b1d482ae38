//! Rows of stored hardware specifications. Versions come from one counter for all, so that a name never gets the same version
//! twice, even after a deletion.

use sqlx::{Row, SqliteConnection};

use super::{Store, parsed};
use crate::cell::preset_text;
use crate::service::error::Error;
use crate::wire::SpecCollection;

/// A stored specification.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct StoredSpec {
    /// Name of the specification.
    pub name: String,
    /// JSON of the specification.
    pub body: String,
    /// Strong entity tag of the specification, quotes included.
    pub etag: String,
}

/// Precondition of a change (RFC 9110, section 13).
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Precondition {
    /// A change without a precondition.
    None,
    /// `If-Match` with these tags; empty for `*`, which matches any existing specification.
    Match(Vec<String>),
    /// `If-None-Match: *`: it must not exist.
    Absent,
    /// Both of them, which is never true.
    Never,
}

impl Precondition {
    /// Returns true if the precondition holds for the current entity tag `now`.
    fn holds(&self, now: Option<&str>) -> bool {
        match (self, now) {
            (Self::None, _) | (Self::Absent, None) => true,
            (Self::Match(tags), Some(now)) => tags.is_empty() || tags.iter().any(|tag| tag == now),
            (Self::Absent, Some(_)) | (Self::Match(_), None) | (Self::Never, _) => false,
        }
    }
}

/// Result of storing a specification.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct PutResult {
    /// True if it is new.
    pub created: bool,
    /// The new entity tag.
    pub etag: String,
}

impl Store {
    /// One specification.
    pub(crate) async fn spec(&self, kind: SpecCollection, name: &str) -> Result<Option<StoredSpec>, Error> {
        let row = sqlx::query("SELECT name, version, body FROM spec WHERE kind = ?1 AND name = ?2")
            .bind(kind.as_str())
            .bind(name)
            .fetch_optional(&self.reader)
            .await?;
        row.map(|row| read(&row)).transpose()
    }

    /// Names and entity tags of all specifications of a kind, sorted by name. None of them is read.
    pub(crate) async fn specs(&self, kind: SpecCollection) -> Result<Vec<(String, String)>, Error> {
        let versions: Vec<(String, i64)> = sqlx::query_as("SELECT name, version FROM spec WHERE kind = ?1 ORDER BY name")
            .bind(kind.as_str())
            .fetch_all(&self.reader)
            .await?;
        Ok(versions.into_iter().map(|(name, version)| (name, etag(version))).collect())
    }

    /// Names of the specifications of a kind, sorted; `limit` at most.
    pub(crate) async fn spec_names(&self, kind: SpecCollection, limit: u32) -> Result<Vec<String>, Error> {
        let names = sqlx::query_scalar("SELECT name FROM spec WHERE kind = ?1 ORDER BY name LIMIT ?2")
            .bind(kind.as_str())
            .bind(limit)
            .fetch_all(&self.reader)
            .await?;
        Ok(names)
    }

    /// Stores a specification whose meshes and devices exist. Replacing one needs [`Precondition::Match`].
    pub(crate) async fn put_spec(
        &self,
        kind: SpecCollection,
        name: &str,
        body: &str,
        only_if: &Precondition,
    ) -> Result<PutResult, Error> {
        let mut tx = self.writer.begin().await?;
        let now = etag_now(&mut tx, kind, name).await?;
        if !only_if.holds(now.as_deref()) {
            return Err(Error::PreconditionFailed(now));
        }
        if let (Some(etag), Precondition::None) = (&now, only_if) {
            return Err(Error::PreconditionRequired { kind, name: name.to_owned(), etag: etag.clone() });
        }
        check_named(&mut tx, kind, body).await?;
        let version: i64 = sqlx::query_scalar(
            "INSERT INTO spec_version (only_row, last) VALUES (1, 1)
             ON CONFLICT (only_row) DO UPDATE SET last = last + 1 RETURNING last",
        )
        .fetch_one(&mut *tx)
        .await?;
        sqlx::query("INSERT OR REPLACE INTO spec (kind, name, version, body) VALUES (?1, ?2, ?3, ?4)")
            .bind(kind.as_str())
            .bind(name)
            .bind(version)
            .bind(body)
            .execute(&mut *tx)
            .await?;
        tx.commit().await?;
        Ok(PutResult { created: now.is_none(), etag: etag(version) })
    }

    /// Deletes a specification that no stored cell names.
    pub(crate) async fn delete_spec(&self, kind: SpecCollection, name: &str, only_if: &Precondition) -> Result<(), Error> {
        let mut tx = self.writer.begin().await?;
        let now = etag_now(&mut tx, kind, name).await?;
        if now.is_none() {
            return Err(Error::SpecNotFound { kind, name: name.to_owned() });
        }
        if !only_if.holds(now.as_deref()) {
            return Err(Error::PreconditionFailed(now));
        }
        let cell: Option<String> = sqlx::query_scalar(
            "SELECT name FROM spec WHERE kind = ?1 AND CASE WHEN json_valid(body) THEN body ->> ('$.' || ?2) END = ?3 LIMIT 1",
        )
        .bind(SpecCollection::Cell.as_str())
        .bind(kind.as_str())
        .bind(name)
        .fetch_optional(&mut *tx)
        .await?;
        if let Some(cell) = cell {
            return Err(Error::SpecInUse { kind, name: name.to_owned(), cell });
        }
        sqlx::query("DELETE FROM spec WHERE kind = ?1 AND name = ?2").bind(kind.as_str()).bind(name).execute(&mut *tx).await?;
        tx.commit().await?;
        Ok(())
    }
}

/// Checks that what a cell names still exists: it may have been deleted since the cell was checked. Other specifications name nothing
/// that is stored.
async fn check_named(tx: &mut SqliteConnection, kind: SpecCollection, body: &str) -> Result<(), Error> {
    if kind != SpecCollection::Cell {
        return Ok(());
    }
    let mesh: Option<String> = sqlx::query_scalar(
        "SELECT node.value FROM json_tree(CASE WHEN json_valid(?1) THEN ?1 ELSE '{}' END) AS node
         WHERE node.key = 'mesh' AND node.type = 'text' AND NOT EXISTS (SELECT 1 FROM mesh WHERE id = lower(node.value)) LIMIT 1",
    )
    .bind(body)
    .fetch_optional(&mut *tx)
    .await?;
    if let Some(id) = mesh {
        return Err(Error::MeshNotFound(parsed("mesh", &id)?));
    }
    for device in SpecCollection::ALL.into_iter().filter(|device| *device != kind) {
        let name: Option<String> = sqlx::query_scalar(
            "SELECT node.value FROM json_each(CASE WHEN json_valid(?1) THEN ?1 ELSE '{}' END) AS node
             WHERE node.key = ?2 AND node.type = 'text'
                AND NOT EXISTS (SELECT 1 FROM spec WHERE spec.kind = ?2 AND spec.name = node.value)",
        )
        .bind(body)
        .bind(device.as_str())
        .fetch_optional(&mut *tx)
        .await?;
        if let Some(name) = name.filter(|name| preset_text(device.kind(), name).is_none()) {
            return Err(Error::SpecNotFound { kind: device, name });
        }
    }
    Ok(())
}

async fn etag_now(tx: &mut SqliteConnection, kind: SpecCollection, name: &str) -> Result<Option<String>, Error> {
    let version: Option<i64> = sqlx::query_scalar("SELECT version FROM spec WHERE kind = ?1 AND name = ?2")
        .bind(kind.as_str())
        .bind(name)
        .fetch_optional(tx)
        .await?;
    Ok(version.map(etag))
}

fn etag(version: i64) -> String {
    format!("\"{version}\"")
}

fn read(row: &sqlx::sqlite::SqliteRow) -> Result<StoredSpec, Error> {
    Ok(StoredSpec { name: row.try_get("name")?, body: row.try_get("body")?, etag: etag(row.try_get("version")?) })
}
