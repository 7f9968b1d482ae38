//! Backup and restore. A backup is itself the folder of a store: `vantage.db`, `files/` and `store-id`. Files never change,
//! so a repeated backup into the same folder is incremental.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use sqlx::{Connection, SqliteConnection};

use super::files::Files;
use super::{DATABASE, OpenError, connect_options, identity, lock, open_database};
use crate::service::error::Error;

/// Max snapshots of the database before a backup of a busy store fails: files may be deleted while they are copied.
const MAX_ROUNDS: usize = 10;

/// Counts of a backup or a restore.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BackupReport {
    /// Files that the database refers to.
    pub files: usize,
    /// Files copied this time.
    pub copied: usize,
    /// Bytes of the copied files, without the database.
    pub copied_bytes: u64,
}

/// Reasons why a backup or a restore failed. Existing data is left unchanged.
#[derive(Debug, thiserror::Error)]
pub enum BackupError {
    /// The folder is not that of a store.
    #[error("{0} is not the folder of a store: it has no vantage.db")]
    NoStore(PathBuf),
    /// The target folder of a backup is the store itself.
    #[error("{0} is the folder of the store itself; choose another folder for the backup")]
    OntoItself(PathBuf),
    /// The target folder of a restore is not empty.
    #[error("{0} is not empty; restore into a new folder")]
    NotEmpty(PathBuf),
    /// The folder has a backup of another store.
    #[error("{0} has a backup of another store; choose another folder")]
    OtherStore(PathBuf),
    /// Files are missing or damaged.
    #[error("missing or damaged files: {} ({})", .0.len(), listed(.0))]
    Damaged(Vec<String>),
    /// Files kept being deleted during the copy.
    #[error("files were deleted during the copy in each of {MAX_ROUNDS} attempts; try again when fewer jobs are being deleted")]
    Busy,
    /// The database cannot be used.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The database cannot be read or copied.
    #[error("the database cannot be copied")]
    Database(#[from] sqlx::Error),
    /// A file cannot be read or written.
    #[error("{path}")]
    File {
        /// The file.
        path: PathBuf,
        /// The I/O error.
        #[source]
        source: io::Error,
    },
}

/// The first few names of a list, as text.
fn listed(names: &[String]) -> String {
    const SHOWN: usize = 10;
    let shown = names.iter().take(SHOWN).map(String::as_str).collect::<Vec<_>>().join(", ");
    if names.len() > SHOWN { format!("{shown}, …") } else { shown }
}

fn at(path: &Path) -> impl Fn(io::Error) -> BackupError + '_ {
    |source| BackupError::File { path: path.to_owned(), source }
}

/// Copies the store in `data` to the folder `to`, even while a server uses it. Every file is checked during the copy.
///
/// # Errors
/// [`BackupError`]. An earlier backup in `to` stays usable.
pub async fn backup(data: &Path, to: &Path) -> Result<BackupReport, BackupError> {
    let database = data.join(DATABASE);
    if !database.is_file() {
        return Err(BackupError::NoStore(data.to_owned()));
    }
    let mut source = open_database(&connect_options(&database), &database).await?;
    let id = id_of(&mut source).await?;
    fs::create_dir_all(to).map_err(at(to))?;
    if fs::canonicalize(to).map_err(at(to))? == fs::canonicalize(data).map_err(at(data))? {
        return Err(BackupError::OntoItself(to.to_owned()));
    }
    // Against another backup into the folder, and a server whose store it is.
    let _in_use = lock(to)?;
    if let (Some(there), Some(id)) = (identity::read(to).map_err(at(to))?, &id)
        && there != *id
    {
        return Err(BackupError::OtherStore(to.to_owned()));
    }
    let (from, into, mut report) = (Files::at(data), Files::at(to), BackupReport::default());
    for _ in 0..MAX_ROUNDS {
        let snapshot = to.join("snapshot.db");
        remove_database(&snapshot)?;
        sqlx::query("VACUUM INTO ?1").bind(snapshot.to_string_lossy().into_owned()).execute(&mut source).await?;
        let referenced = referenced_files(&snapshot).await?;
        report.files = referenced.len();
        let missing = copy_files(&from, &into, &referenced, &mut report)?;
        if missing.is_empty() {
            install_snapshot(&snapshot, to, id.as_deref())?;
            remove_unreferenced(&into, &referenced).map_err(at(to))?;
            return Ok(report);
        }
        let still_referenced = referenced_files(&database).await?;
        let damaged: Vec<String> = missing.into_iter().filter(|sha256| still_referenced.contains(sha256)).collect();
        if !damaged.is_empty() {
            remove_database(&snapshot)?;
            return Err(BackupError::Damaged(damaged));
        }
    }
    Err(BackupError::Busy)
}

/// Restores the backup in `from` into the new or empty folder `data`. Everything is checked.
///
/// # Errors
/// [`BackupError`].
pub async fn restore(from: &Path, data: &Path) -> Result<BackupReport, BackupError> {
    let database = from.join(DATABASE);
    if !database.is_file() {
        return Err(BackupError::NoStore(from.to_owned()));
    }
    fs::create_dir_all(data).map_err(at(data))?;
    let _in_use = lock(data)?;
    let others = fs::read_dir(data).map_err(at(data))?.filter_map(Result::ok).filter(|entry| entry.file_name() != "in-use");
    if others.count() > 0 {
        return Err(BackupError::NotEmpty(data.to_owned()));
    }
    // The backup may be on a read-only medium, and SQLite needs to write: so its copy is opened.
    let snapshot = data.join("snapshot.db");
    fs::copy(&database, &snapshot).map_err(at(&database))?;
    let log = from.join("vantage.db-wal");
    if log.is_file() {
        fs::copy(&log, data.join("snapshot.db-wal")).map_err(at(&log))?;
    }
    let mut source = open_database(&connect_options(&snapshot), &snapshot).await?;
    let id = id_of(&mut source).await?;
    source.close().await?;
    let referenced = referenced_files(&snapshot).await?;
    let mut report = BackupReport { files: referenced.len(), ..BackupReport::default() };
    let damaged = copy_files(&Files::at(from), &Files::at(data), &referenced, &mut report)?;
    if !damaged.is_empty() {
        // The folder was empty and becomes so again, for the next attempt.
        remove_database(&snapshot)?;
        if data.join("files").exists() {
            fs::remove_dir_all(data.join("files")).map_err(at(data))?;
        }
        return Err(BackupError::Damaged(damaged));
    }
    install_snapshot(&snapshot, data, id.as_deref())?;
    Ok(report)
}

/// Id of a store; `None` before its migration to the schema with ids.
async fn id_of(database: &mut SqliteConnection) -> Result<Option<String>, sqlx::Error> {
    let has_id: bool =
        sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM sqlite_master WHERE name = 'store')").fetch_one(&mut *database).await?;
    if has_id { sqlx::query_scalar("SELECT id FROM store").fetch_optional(database).await } else { Ok(None) }
}

/// Hashes of all files that a database refers to.
async fn referenced_files(database: &Path) -> Result<BTreeSet<String>, BackupError> {
    const MESHES: &str = "SELECT sha256 FROM mesh UNION SELECT preview FROM mesh WHERE preview IS NOT NULL";
    const RESULTS_BEFORE_0002: &str = "SELECT sha256 FROM artifact";
    const RESULTS_BEFORE_0008: &str = "SELECT file_sha256 FROM artifact";
    const ALL: &str = "SELECT DISTINCT sha256 FROM file_reference";
    let mut connection = SqliteConnection::connect_with(&connect_options(database)).await?;
    let has_view = "SELECT EXISTS (SELECT 1 FROM sqlite_master WHERE name = 'file_reference')";
    let queries: &[&str] = if sqlx::query_scalar(has_view).fetch_one(&mut connection).await? {
        &[ALL]
    } else if id_of(&mut connection).await?.is_some() {
        &[MESHES, RESULTS_BEFORE_0008]
    } else {
        &[MESHES, RESULTS_BEFORE_0002]
    };
    let mut referenced = BTreeSet::new();
    for query in queries.iter().copied() {
        referenced.extend(sqlx::query_scalar::<_, String>(query).fetch_all(&mut connection).await?);
    }
    connection.close().await?;
    Ok(referenced)
}

/// Copies files that the target lacks; returns those that are missing or damaged in the source.
fn copy_files(
    from: &Files,
    into: &Files,
    referenced: &BTreeSet<String>,
    report: &mut BackupReport,
) -> Result<Vec<String>, BackupError> {
    let mut missing = Vec::new();
    for sha256 in referenced {
        let path = into.path(sha256);
        match into.open_checked(sha256) {
            Ok(_) => continue,
            Err(Error::FileDamaged { .. }) => {}
            Err(error) => return Err(at(&path)(io::Error::other(error))),
        }
        let mut source = match from.open_checked(sha256) {
            Ok(source) => source,
            Err(Error::FileDamaged { .. }) => {
                missing.push(sha256.clone());
                continue;
            }
            Err(error) => return Err(at(&from.path(sha256))(io::Error::other(error))),
        };
        report.copied_bytes += copy(&mut source, &path).map_err(at(&path))?;
        report.copied += 1;
    }
    Ok(missing)
}

/// Copies a file atomically: the target appears complete or not at all.
fn copy(source: &mut fs::File, path: &Path) -> io::Result<u64> {
    let folder = path.parent().unwrap_or(path);
    fs::create_dir_all(folder)?;
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    let bytes = io::copy(source, &mut file)?;
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(bytes)
}

/// Moves the copied database to its place and writes the store's id.
fn install_snapshot(snapshot: &Path, folder: &Path, id: Option<&str>) -> Result<(), BackupError> {
    fs::File::open(snapshot).and_then(|file| file.sync_all()).map_err(at(snapshot))?;
    let database = folder.join(DATABASE);
    // A log of an earlier database must not be mistaken for this one's.
    for log in ["vantage.db-wal", "vantage.db-shm", "snapshot.db-wal", "snapshot.db-shm"] {
        remove(&folder.join(log))?;
    }
    fs::rename(snapshot, &database).map_err(at(&database))?;
    match id {
        Some(id) => identity::write(folder, id).map_err(at(folder)),
        None => fs::File::open(folder).and_then(|folder| folder.sync_all()).map_err(at(folder)),
    }
}

/// Removes files of an earlier backup that the database no longer refers to.
fn remove_unreferenced(files: &Files, referenced: &BTreeSet<String>) -> io::Result<()> {
    for file in files.list()? {
        if !referenced.contains(&file.sha256) {
            files.remove(&file.sha256)?;
        }
    }
    Ok(())
}

fn remove_database(path: &Path) -> Result<(), BackupError> {
    for end in ["", "-wal", "-shm", "-journal"] {
        remove(&PathBuf::from(format!("{}{end}", path.display())))?;
    }
    Ok(())
}

fn remove(path: &Path) -> Result<(), BackupError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(at(path)(error)),
        _ => Ok(()),
    }
}
