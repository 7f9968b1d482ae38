//! Backup and restore. A backup is itself the folder of a store: `vantage.db`, `files/`, `audit/` and `store-id`. Files never change,
//! and audit logs only grow, so a repeated backup into the same folder is incremental.

use std::collections::BTreeSet;
use std::fmt;
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};

use sqlx::{Connection, SqliteConnection};

use super::files::{Files, create_folder, folders, private_file};
use super::{DATABASE, IN_USE, OpenError, connect_options, identity, lock, open_database};
use crate::service::error::{Error, is_read_failure};
use crate::wire::RunId;

/// Max snapshots of the database before a backup of a busy store fails: files may be deleted while they are copied.
const MAX_ROUNDS: usize = 10;
/// Folder of the audit logs, a folder a run, unless the settings name another.
const AUDIT: &str = "audit";
/// Names of temporary files, as `tempfile` makes them: the beginning and the length.
const TEMPORARY: (&str, usize) = (".tmp", 10);
/// Folder that a new file system of Linux comes with.
const LOST_AND_FOUND: &str = "lost+found";

/// Counts of a backup or a restore.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BackupReport {
    /// Files that the database refers to.
    pub files: usize,
    /// Files copied this time.
    pub copied: usize,
    /// Files of audit logs copied this time.
    pub audit_logs: usize,
    /// Bytes of the copied files, without the database.
    pub copied_bytes: u64,
    /// Files that are missing or damaged, and so were left out.
    pub damaged: Vec<DamagedFile>,
}

/// A file that is missing or damaged.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DamagedFile {
    /// Name of the file: the hash of its original bytes, or the path of an audit log.
    pub name: String,
    /// Meshes, jobs and runs that it belongs to, such as `mesh ID`.
    pub named_by: Vec<String>,
}

impl fmt::Display for DamagedFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const SHOWN: usize = 3;
        f.write_str(&self.name)?;
        if self.named_by.is_empty() { Ok(()) } else { write!(f, " ({})", listed(&self.named_by, SHOWN)) }
    }
}

/// Reasons why a backup or a restore failed. Existing data is left unchanged.
#[derive(Debug, thiserror::Error)]
pub enum BackupError {
    /// The folder is not that of a store.
    #[error("{0} is not the folder of a store: it has no vantage.db")]
    NoStore(PathBuf),
    /// The target folder lies below the source.
    #[error("{to} lies below {from}, and would be lost with it; choose a folder outside")]
    BelowSource {
        /// The target.
        to: PathBuf,
        /// The source.
        from: PathBuf,
    },
    /// The target folder of a backup is the store itself.
    #[error("{0} is the folder of the store itself; choose another folder for the backup")]
    OntoItself(PathBuf),
    /// The target folder of a restore is not empty.
    #[error("{0} is not empty; restore into a new folder")]
    NotEmpty(PathBuf),
    /// The folder has a backup of another store.
    #[error("{0} has a backup of another store; choose another folder")]
    OtherStore(PathBuf),
    /// Files are missing or damaged in the store. All others are in the backup.
    #[error(
        "complete but for {} missing or damaged file{} of the store: {}; upload the meshes again and plan the jobs again, \
         or put the files back from an earlier backup",
        .0.len(), if .0.len() == 1 { "" } else { "s" }, listed(.0, MAX_LISTED)
    )]
    Incomplete(Vec<DamagedFile>),
    /// Files are missing or damaged in the backup. Nothing was restored.
    #[error(
        "{} missing or damaged file{} in the backup: {}; nothing was restored. Choose another backup, or restore all but these \
         with --keep-damaged",
        .0.len(), if .0.len() == 1 { "" } else { "s" }, listed(.0, MAX_LISTED)
    )]
    Damaged(Vec<DamagedFile>),
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

/// Max files that an error lists.
const MAX_LISTED: usize = 100;

/// First few entries of a list, as text.
fn listed(entries: &[impl ToString], max: usize) -> String {
    let shown = entries.iter().take(max).map(ToString::to_string).collect::<Vec<_>>().join(", ");
    if entries.len() > max { format!("{shown}, …") } else { shown }
}

fn at(path: &Path) -> impl Fn(io::Error) -> BackupError + '_ {
    |source| BackupError::File { path: path.to_owned(), source }
}

/// Copies the store in `data` to the folder `to`, even while a server uses it. Every file is checked during the copy; those of audit
/// logs change and have no hash to be checked against.
///
/// # Errors
/// [`BackupError`]. An earlier backup in `to` stays usable. [`BackupError::Incomplete`] if all is copied that is not damaged.
pub async fn backup(data: &Path, to: &Path) -> Result<BackupReport, BackupError> {
    let database = data.join(DATABASE);
    if !database.is_file() {
        return Err(BackupError::NoStore(data.to_owned()));
    }
    let mut source = open_database(&connect_options(&database), &database).await?;
    let id = id_of(&mut source).await?;
    create_outside(to, data)?;
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
    for place in into.folders().map_err(at(to))?.into_iter().chain(folders(&to.join(AUDIT)).map_err(at(to))?) {
        remove_temporary(&place).map_err(at(&place))?;
    }
    for _ in 0..MAX_ROUNDS {
        let snapshot = to.join("snapshot.db");
        remove_database(&snapshot)?;
        private_file().write(true).create_new(true).open(&snapshot).map_err(at(&snapshot))?;
        sqlx::query("VACUUM INTO ?1").bind(snapshot.to_string_lossy().into_owned()).execute(&mut source).await?;
        let referenced = referenced_files(&snapshot).await?;
        report.files = referenced.len();
        let missing = copy_files(&from, &into, &referenced, &mut report)?;
        // A file that was deleted during the copy is not needed by the next snapshot; one that is still needed never will be there.
        let still_referenced = if missing.is_empty() { BTreeSet::new() } else { referenced_files(&database).await? };
        if missing.iter().all(|sha256| still_referenced.contains(sha256)) {
            report.damaged = damaged_files(&snapshot, missing).await?;
            let runs = run_ids(&snapshot).await?;
            install_snapshot(&snapshot, to, id.as_deref())?;
            remove_unreferenced(&into, &referenced).map_err(at(to))?;
            copy_audit(data, to, &mut report)?;
            remove_audit_of_deleted(data, to, runs.as_ref()).map_err(at(to))?;
            return if report.damaged.is_empty() { Ok(report) } else { Err(BackupError::Incomplete(report.damaged)) };
        }
    }
    Err(BackupError::Busy)
}

/// Restores the backup in `from` into the new or empty folder `data`. Everything is checked. With `keep_damaged`, files that are missing
/// or damaged in the backup are left out and told; what they belong to is told by the server as damaged.
///
/// # Errors
/// [`BackupError`].
pub async fn restore(from: &Path, data: &Path, keep_damaged: bool) -> Result<BackupReport, BackupError> {
    if !from.join(DATABASE).is_file() {
        return Err(BackupError::NoStore(from.to_owned()));
    }
    let made = create_outside(data, from)?;
    // Held until a failed restore is cleaned up: nothing that another process has put there is removed.
    let in_use = lock(data)?;
    let is_other = |entry: &fs::DirEntry| entry.file_name() != IN_USE && entry.file_name() != LOST_AND_FOUND;
    let others = fs::read_dir(data).map_err(at(data))?.filter_map(Result::ok).filter(is_other);
    if others.count() > 0 {
        return Err(BackupError::NotEmpty(data.to_owned()));
    }
    let restored = restore_into(from, data, keep_damaged).await;
    if restored.is_err() {
        clear(data);
        if !made.is_empty() {
            let _ = fs::remove_file(data.join(IN_USE));
            remove_empty(&made);
        }
    }
    drop(in_use);
    restored
}

/// Restores into an empty folder that is locked; what it has put there if it fails, [`clear`] removes.
async fn restore_into(from: &Path, data: &Path, keep_damaged: bool) -> Result<BackupReport, BackupError> {
    let database = from.join(DATABASE);
    // The backup may be on a read-only medium, and SQLite needs to write: so its copy is opened.
    let snapshot = data.join("snapshot.db");
    fs::copy(&database, &snapshot).map_err(at(&database))?;
    let log = from.join("vantage.db-wal");
    if log.is_file() {
        fs::copy(&log, data.join("snapshot.db-wal")).map_err(at(&log))?;
    }
    let mut source = open_database(&connect_options(&snapshot), &snapshot).await?;
    let id = id_of(&mut source).await?;
    skip_versions(&mut source).await?;
    skip_tokens(&mut source).await?;
    source.close().await?;
    let referenced = referenced_files(&snapshot).await?;
    let mut report = BackupReport { files: referenced.len(), ..BackupReport::default() };
    let missing = copy_files(&Files::at(from), &Files::at(data), &referenced, &mut report)?;
    report.damaged = damaged_files(&snapshot, missing).await?;
    copy_audit(from, data, &mut report)?;
    if !report.damaged.is_empty() && !keep_damaged {
        return Err(BackupError::Damaged(report.damaged));
    }
    install_snapshot(&snapshot, data, id.as_deref())?;
    Ok(report)
}

/// Removes what a failed restore has put into an empty folder, so that the next one may use it. What cannot be removed stays.
fn clear(data: &Path) {
    for database in ["snapshot.db", DATABASE] {
        let _ = remove_database(&data.join(database));
    }
    let _ = remove(&data.join(identity::FILE));
    for folder in ["files", AUDIT] {
        let _ = fs::remove_dir_all(data.join(folder));
    }
}

/// Removes folders that are empty, in their order.
fn remove_empty(folders: &[PathBuf]) {
    for folder in folders {
        let _ = fs::remove_dir(folder);
    }
}

/// Creates a target folder; returns the folders that it made, the innermost first. Refuses one below the source, which would be
/// lost with it.
fn create_outside(to: &Path, from: &Path) -> Result<Vec<PathBuf>, BackupError> {
    let source = fs::canonicalize(from).map_err(at(from))?;
    let target = resolved(to).map_err(at(to))?;
    // The source itself is refused for what it is.
    if target != source && target.starts_with(&source) {
        return Err(BackupError::BelowSource { to: to.to_owned(), from: from.to_owned() });
    }
    let made: Vec<PathBuf> = target.ancestors().take_while(|folder| !folder.exists()).map(Path::to_owned).collect();
    create_folder(to).map_err(at(to)).inspect_err(|_| remove_empty(&made))?;
    Ok(made)
}

/// Path without links and `..`, as it will be once the folders that are missing are made: those will be no links.
fn resolved(path: &Path) -> io::Result<PathBuf> {
    let mut there = PathBuf::new();
    for component in std::path::absolute(path)?.components() {
        if component == Component::ParentDir {
            there.pop();
        } else {
            there.push(component);
        }
        there = fs::canonicalize(&there).unwrap_or(there);
    }
    Ok(there)
}

/// Skips versions of specifications, and so entity tags: those given after the backup are not given again to other contents.
async fn skip_versions(database: &mut SqliteConnection) -> Result<(), sqlx::Error> {
    const SKIP: &str = "INSERT INTO spec_version (only_row, last) VALUES (1, 1 + (random() & 0xffffffffff))
        ON CONFLICT (only_row) DO UPDATE SET last = last + excluded.last";
    sqlx::query(SKIP).execute(database).await.map(drop)
}

/// Skips fencing tokens of leases: those given after the backup are not given again, or whoever holds one from then could move a cell that
/// another has leased. Databases before the schema with runs have none.
async fn skip_tokens(database: &mut SqliteConnection) -> Result<(), sqlx::Error> {
    const HAS_TOKENS: &str = "SELECT EXISTS (SELECT 1 FROM sqlite_master WHERE name = 'run_fence')";
    const SKIP: &str = "UPDATE run_fence SET last = last + 0x100000000 + (random() & 0xffffffff)";
    let has_tokens: bool = sqlx::query_scalar(HAS_TOKENS).fetch_one(&mut *database).await?;
    if has_tokens { sqlx::query(SKIP).execute(database).await.map(drop) } else { Ok(()) }
}

/// Adds to the files what they belong to. Databases before the schema that says so tell nothing.
async fn damaged_files(database: &Path, hashes: Vec<String>) -> Result<Vec<DamagedFile>, BackupError> {
    const HAS_NAMES: &str = "SELECT EXISTS (SELECT 1 FROM pragma_table_info('job_mesh') WHERE name = 'sha256')";
    const NAMES: &str = "SELECT 'mesh ' || id FROM mesh WHERE sha256 = ?1 OR preview = ?1
        UNION SELECT 'job ' || job_id FROM job_mesh WHERE sha256 = ?1
        UNION SELECT 'job ' || job_id FROM artifact WHERE file_sha256 = ?1
        UNION SELECT 'job ' || job_id FROM scan WHERE sha256 = ?1
        UNION SELECT 'job ' || job_id FROM inspection_file JOIN inspection ON inspection.id = inspection_id WHERE file_sha256 = ?1
        ORDER BY 1 DESC";
    let mut damaged = Vec::with_capacity(hashes.len());
    if hashes.is_empty() {
        return Ok(damaged);
    }
    let mut connection = SqliteConnection::connect_with(&connect_options(database)).await?;
    let has_names: bool = sqlx::query_scalar(HAS_NAMES).fetch_one(&mut connection).await?;
    for sha256 in hashes {
        let named_by =
            if has_names { sqlx::query_scalar(NAMES).bind(&sha256).fetch_all(&mut connection).await? } else { Vec::new() };
        damaged.push(DamagedFile { name: sha256, named_by });
    }
    connection.close().await?;
    Ok(damaged)
}

/// Ids of all runs; `None` before the schema with runs.
async fn run_ids(database: &Path) -> Result<Option<BTreeSet<String>>, BackupError> {
    let mut connection = SqliteConnection::connect_with(&connect_options(database)).await?;
    let has_runs = "SELECT EXISTS (SELECT 1 FROM sqlite_master WHERE name = 'run')";
    let ids: Option<Vec<String>> = if sqlx::query_scalar(has_runs).fetch_one(&mut connection).await? {
        Some(sqlx::query_scalar("SELECT id FROM run").fetch_all(&mut connection).await?)
    } else {
        None
    };
    connection.close().await?;
    Ok(ids.map(BTreeSet::from_iter))
}

/// Copies the files of audit logs that have grown or are new. One that is written meanwhile is copied as far as it has come; one that
/// the disk does not give back is left out and told.
fn copy_audit(from: &Path, into: &Path, report: &mut BackupReport) -> Result<(), BackupError> {
    let from = from.join(AUDIT);
    for run in folders(&from).map_err(at(&from))? {
        let Some(name) = run.file_name() else { continue };
        let (run_id, copies) = (name.display().to_string(), into.join(AUDIT).join(name));
        let entries = match fs::read_dir(&run) {
            // The run, or the oldest file of its log, may be deleted meanwhile.
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            entries => entries.map_err(at(&run))?,
        };
        for entry in entries {
            let path = entry.map_err(at(&run))?.path();
            let Some(name) = path.file_name() else { continue };
            match copy_log(&path, &copies.join(name)) {
                Ok(0) => {}
                Ok(bytes) => {
                    report.copied_bytes += bytes;
                    report.audit_logs += 1;
                }
                Err(error) if error.kind() == io::ErrorKind::NotFound && !path.exists() => {}
                Err(error) if is_read_failure(&error) => report.damaged.push(DamagedFile {
                    name: format!("{AUDIT}/{run_id}/{}", name.display()),
                    named_by: vec![format!("run {run_id}")],
                }),
                Err(error) => return Err(at(&path)(error)),
            }
        }
    }
    Ok(())
}

/// Copies a file unless the copy has its size and modification time; returns the bytes copied.
fn copy_log(path: &Path, copied: &Path) -> io::Result<u64> {
    let about = fs::metadata(path)?;
    let has_changed = |copy: &fs::Metadata| copy.len() != about.len() || copy.modified().ok() != about.modified().ok();
    if !about.is_file() || fs::metadata(copied).is_ok_and(|copy| !has_changed(&copy)) {
        return Ok(0);
    }
    let bytes = copy(&mut fs::File::open(path)?, copied)?;
    // Taken before the copy: what is appended during it makes the next backup copy the file again.
    fs::File::options().write(true).open(copied)?.set_modified(about.modified()?)?;
    Ok(bytes)
}

/// Removes the copied logs of runs that were deleted with their logs. A log that is merely missing in the store is kept, and one of a
/// run that began after the snapshot.
fn remove_audit_of_deleted(data: &Path, to: &Path, runs: Option<&BTreeSet<String>>) -> io::Result<()> {
    let Some(runs) = runs else { return Ok(()) };
    for log in folders(&to.join(AUDIT))? {
        let Some(name) = log.file_name().and_then(|name| name.to_str()) else { continue };
        let is_of_deleted = name.parse::<RunId>().is_ok_and(|id| !runs.contains(&id.to_string()));
        if is_of_deleted && !data.join(AUDIT).join(name).exists() {
            fs::remove_dir_all(log)?;
        }
    }
    Ok(())
}

/// Removes the temporary files that a killed backup left in a folder.
fn remove_temporary(folder: &Path) -> io::Result<()> {
    let (start, length) = TEMPORARY;
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let is_temporary = entry.file_name().to_str().is_some_and(|name| name.starts_with(start) && name.len() == length);
        if is_temporary && entry.file_type()?.is_file() {
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
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
        match into.open_compared(sha256) {
            Ok(_) => continue,
            Err(Error::FileDamaged { .. }) => {}
            Err(error) => return Err(at(&path)(io::Error::other(error))),
        }
        let mut source = match from.open_compared(sha256) {
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
    create_folder(folder)?;
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
