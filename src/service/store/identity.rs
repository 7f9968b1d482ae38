//! Identity of a store. The database has an id, and the folder has the same id in the file `store-id`. So a database that is
//! missing, empty or of another store is noticed before any file is touched.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

use sqlx::SqliteConnection;

use super::OpenError;
use super::files::Files;

/// File with the id in a store's folder.
pub(super) const FILE: &str = "store-id";

/// Refuses a folder with files whose database is missing or empty. Called before the database is opened, which would create it.
pub(super) fn check_file(data: &Path, files: &Files, database: &Path) -> Result<(), OpenError> {
    let size_bytes = fs::metadata(database).map_or(0, |about| about.len());
    if size_bytes > 0 { Ok(()) } else { check_is_new(data, files) }
}

/// Refuses a folder with files whose database has no tables. Called before the tables are created.
pub(super) async fn check_tables(data: &Path, files: &Files, database: &mut SqliteConnection) -> Result<(), OpenError> {
    let has_tables: bool =
        sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM sqlite_master WHERE name = 'mesh')").fetch_one(database).await?;
    if has_tables { Ok(()) } else { check_is_new(data, files) }
}

/// Refuses a folder that belonged to a store: it has files or an id.
fn check_is_new(data: &Path, files: &Files) -> Result<(), OpenError> {
    let is_new = || Ok(files.is_empty()? && read(data)?.is_none());
    match is_new().map_err(|source| folder_error(data, source))? {
        true => Ok(()),
        false => Err(OpenError::DatabaseMissing { path: data.display().to_string() }),
    }
}

/// Refuses a database of another store; writes the id to the folder if it is missing there.
pub(super) async fn check_id(data: &Path, files: &Files, database: &mut SqliteConnection) -> Result<(), OpenError> {
    let id: String = sqlx::query_scalar("SELECT id FROM store").fetch_one(&mut *database).await?;
    match read(data).map_err(|source| folder_error(data, source))? {
        Some(found) if found == id => return Ok(()),
        Some(_) => return Err(OpenError::ForeignDatabase { path: data.display().to_string() }),
        None => {}
    }
    let was_used: bool = sqlx::query_scalar(
        "SELECT EXISTS (SELECT 1 FROM mesh) OR EXISTS (SELECT 1 FROM job) OR EXISTS (SELECT 1 FROM sqlite_sequence)",
    )
    .fetch_one(database)
    .await?;
    if !was_used && !files.is_empty().map_err(|source| folder_error(data, source))? {
        return Err(OpenError::DatabaseMissing { path: data.display().to_string() });
    }
    write(data, &id).map_err(|source| folder_error(data, source))
}

/// Id in the folder, if any.
pub(super) fn read(data: &Path) -> io::Result<Option<String>> {
    match fs::read_to_string(data.join(FILE)) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        text => Ok(Some(text?.trim().to_owned()).filter(|id| !id.is_empty())),
    }
}

/// Writes the id to the folder.
pub(super) fn write(data: &Path, id: &str) -> io::Result<()> {
    let mut file = tempfile::NamedTempFile::new_in(data)?;
    writeln!(file, "{id}")?;
    file.as_file().sync_all()?;
    file.persist(data.join(FILE)).map_err(|error| error.error)?;
    fs::File::open(data)?.sync_all()
}

fn folder_error(data: &Path, source: io::Error) -> OpenError {
    OpenError::Folder { path: data.display().to_string(), source }
}
