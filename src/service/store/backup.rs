//! Copies of a store, and stores from copies. A backup is itself the folder of a store: `vantage.db`, `files/` and
//! `store-id`. Files never change, so a backup into the same folder again copies only what is new.

use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use sqlx::{Connection, SqliteConnection};

use super::files::Files;
use super::{DATABASE, OpenError, connect_options, identity, lock, open_database};
use crate::service::error::Error;

/// Looks at the database before a backup of a busy store is given up: between two looks jobs may be deleted.
const MAX_ROUNDS: usize = 10;

/// What a backup or a restore copied.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BackupReport {
    /// Files that the database names.
    pub files: usize,
    /// Of those, copied this time.
    pub copied: usize,
    /// Bytes copied this time, the database left out.
    pub copied_bytes: u64,
}

/// Why a backup or a restore is refused or broke off. Nothing that was there before is lost.
#[derive(Debug, thiserror::Error)]
pub enum BackupError {
    /// There is no store.
    #[error("{0} is not the folder of a store: it has no vantage.db")]
    NoStore(PathBuf),
    /// There is something where a store is to be restored.
    #[error("{0} is not empty; restore into a new folder")]
    NotEmpty(PathBuf),
    /// The backup in the folder is that of another store.
    #[error("{0} holds the backup of another store; choose another folder")]
    OfAnother(PathBuf),
    /// Files are missing or damaged.
    #[error("{} of the files that the database names are missing or damaged: {}", .0.len(), listed(.0))]
    Damaged(Vec<String>),
    /// Deletions went on for too long.
    #[error("files were deleted while they were copied, {MAX_ROUNDS} times over; try again when less is deleted")]
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
        /// Which.
        path: PathBuf,
        /// Why.
        #[source]
        source: io::Error,
    },
}

/// The first few of a list.
fn listed(names: &[String]) -> String {
    const SHOWN: usize = 10;
    let shown = names.iter().take(SHOWN).map(String::as_str).collect::<Vec<_>>().join(", ");
    if names.len() > SHOWN { format!("{shown}, …") } else { shown }
}

fn at(path: &Path) -> impl Fn(io::Error) -> BackupError + '_ {
    |source| BackupError::File { path: path.to_owned(), source }
}

/// Copies the store in `data` to the folder `to`; a server may be working on it. Every file is checked on the way.
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
    if let (Some(there), Some(id)) = (identity::read(to).map_err(at(to))?, &id)
        && there != *id
    {
        return Err(BackupError::OfAnother(to.to_owned()));
    }
    fs::create_dir_all(to).map_err(at(to))?;
    let (from, into, mut report) = (Files::at(data), Files::at(to), BackupReport::default());
    for _ in 0..MAX_ROUNDS {
        let snapshot = to.join("snapshot.db");
        remove_database(&snapshot)?;
        sqlx::query("VACUUM INTO ?1").bind(snapshot.to_string_lossy().into_owned()).execute(&mut source).await?;
        let named = named_files(&snapshot).await?;
        report.files = named.len();
        let missing = copy_files(&from, &into, &named, &mut report)?;
        if missing.is_empty() {
            keep_snapshot(&snapshot, to, id.as_deref())?;
            remove_unnamed(&into, &named).map_err(at(to))?;
            return Ok(report);
        }
        let still_named = named_files(&database).await?;
        let damaged: Vec<String> = missing.into_iter().filter(|sha256| still_named.contains(sha256)).collect();
        if !damaged.is_empty() {
            remove_database(&snapshot)?;
            return Err(BackupError::Damaged(damaged));
        }
    }
    Err(BackupError::Busy)
}

/// Makes the store in the new folder `data` from the backup in `from`. Everything is checked.
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
    // The backup may lie where nothing can be written, which SQLite would want to: so its copy is opened.
    let snapshot = data.join("snapshot.db");
    fs::copy(&database, &snapshot).map_err(at(&database))?;
    let log = from.join("vantage.db-wal");
    if log.is_file() {
        fs::copy(&log, data.join("snapshot.db-wal")).map_err(at(&log))?;
    }
    let mut source = open_database(&connect_options(&snapshot), &snapshot).await?;
    let id = id_of(&mut source).await?;
    source.close().await?;
    let named = named_files(&snapshot).await?;
    let mut report = BackupReport { files: named.len(), ..BackupReport::default() };
    let damaged = copy_files(&Files::at(from), &Files::at(data), &named, &mut report)?;
    if !damaged.is_empty() {
        // The folder was empty: whoever tries again finds it so.
        remove_database(&snapshot)?;
        if data.join("files").exists() {
            fs::remove_dir_all(data.join("files")).map_err(at(data))?;
        }
        return Err(BackupError::Damaged(damaged));
    }
    keep_snapshot(&snapshot, data, id.as_deref())?;
    Ok(report)
}

/// The id of a store; none before its upgrade to the version that gave stores ids.
async fn id_of(database: &mut SqliteConnection) -> Result<Option<String>, sqlx::Error> {
    let has_id: bool =
        sqlx::query_scalar("SELECT EXISTS (SELECT 1 FROM sqlite_master WHERE name = 'store')").fetch_one(&mut *database).await?;
    if has_id { sqlx::query_scalar("SELECT id FROM store").fetch_optional(database).await } else { Ok(None) }
}

/// Hashes of all files that a database names.
async fn named_files(database: &Path) -> Result<BTreeSet<String>, BackupError> {
    const MESHES: &str = "SELECT sha256 FROM mesh UNION SELECT preview FROM mesh WHERE preview IS NOT NULL";
    const RESULTS: &str = "SELECT file_sha256 FROM artifact";
    const RESULTS_BEFORE_0002: &str = "SELECT sha256 FROM artifact";
    let mut connection = SqliteConnection::connect_with(&connect_options(database)).await?;
    let results = if id_of(&mut connection).await?.is_some() { RESULTS } else { RESULTS_BEFORE_0002 };
    let mut named = BTreeSet::new();
    for query in [MESHES, results] {
        named.extend(sqlx::query_scalar::<_, String>(query).fetch_all(&mut connection).await?);
    }
    connection.close().await?;
    Ok(named)
}

/// Copies files that are not there yet; returns those that are missing or damaged.
fn copy_files(
    from: &Files,
    into: &Files,
    named: &BTreeSet<String>,
    report: &mut BackupReport,
) -> Result<Vec<String>, BackupError> {
    let mut missing = Vec::new();
    for sha256 in named {
        let path = into.path(sha256);
        match into.check(sha256) {
            Ok(_) => continue,
            Err(Error::FileDamaged { .. }) => {}
            Err(error) => return Err(at(&path)(io::Error::other(error))),
        }
        let mut source = match from.check(sha256) {
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

/// Copies to a file that appears whole.
fn copy(source: &mut fs::File, path: &Path) -> io::Result<u64> {
    let folder = path.parent().unwrap_or(path);
    fs::create_dir_all(folder)?;
    let mut file = tempfile::NamedTempFile::new_in(folder)?;
    let bytes = io::copy(source, &mut file)?;
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(bytes)
}

/// Puts the copied database in its place, and the id beside it.
fn keep_snapshot(snapshot: &Path, folder: &Path, id: Option<&str>) -> Result<(), BackupError> {
    fs::File::open(snapshot).and_then(|file| file.sync_all()).map_err(at(snapshot))?;
    let database = folder.join(DATABASE);
    // The log of an earlier database must not be taken for this one's.
    for log in ["vantage.db-wal", "vantage.db-shm", "snapshot.db-wal", "snapshot.db-shm"] {
        remove(&folder.join(log))?;
    }
    fs::rename(snapshot, &database).map_err(at(&database))?;
    match id {
        Some(id) => identity::write(folder, id).map_err(at(folder)),
        None => fs::File::open(folder).and_then(|folder| folder.sync_all()).map_err(at(folder)),
    }
}

/// Removes files of an earlier backup that the database does not name any more.
fn remove_unnamed(files: &Files, named: &BTreeSet<String>) -> io::Result<()> {
    for file in files.list()? {
        if !named.contains(&file.sha256) {
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
