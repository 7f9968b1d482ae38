//! Persistent state: SQLite rows (WAL, `synchronous=FULL`, one writer) and content-addressed files that the rows refer to.
//! Once a function has returned, its change is on the disk.
//!
//! Order of writes: a file is written before a row refers to it, and removed after its row; so a crash leaves at most
//! orphans: files that no row refers to. They are moved to `swept/` once they are old enough, and removed from there later.

mod artifacts;
mod attempts;
mod backup;
mod calibrations;
mod clock;
mod events;
mod files;
mod idempotency;
mod identity;
mod inspections;
mod job_list;
mod job_rows;
mod jobs;
mod left_over;
mod meshes;
mod pages;
mod pinned;
mod retention;
mod runs;
mod scans;
mod scrub;
mod specs;
mod stored;
mod summaries;
mod sweep;
mod writer;

use std::fs::{File, TryLockError};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use sqlx::migrate::{MigrateError, Migration, MigrationType, Migrator};
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{Connection, QueryBuilder, Row, SqlSafeStr, Sqlite, SqliteConnection, SqlitePool};
use tokio::sync::broadcast;

pub use artifacts::PartNames;
pub(crate) use artifacts::{FileEncoding, ResultFile, StoredArtifacts};
pub(crate) use attempts::{Attempt, AttemptOutcome};
pub use backup::{BackupError, BackupReport, backup, restore};
pub(crate) use calibrations::CalibrationInput;
pub(crate) use files::{Files, Received};
pub(crate) use idempotency::IdempotencyKey;
pub(crate) use inspections::StoredInspection;
pub use job_list::JobQuery;
pub(crate) use jobs::NewJob;
pub(crate) use left_over::LeftOver;
pub(crate) use meshes::{MeshFile, NewMesh};
pub(crate) use pages::Page;
pub(crate) use retention::{Due, Policy};
pub use specs::Precondition;
pub(crate) use specs::{PutResult, StoredSpec};
pub(crate) use stored::read_leniently;

use super::error::{Error, InternalError, is_full_database, is_full_io, may_be_over_quota};
use crate::wire::{JobEvent, continue_after};

/// SQL expression of the current time as text. Every time in the store is written with it.
macro_rules! now {
    () => {
        "strftime('%Y-%m-%dT%H:%M:%fZ', 'now')"
    };
}
pub(crate) use now;

/// SQL expression of the current time as text, or of the time that an expression has where the clock was set back since: nothing ends
/// before it begins. What is no time is passed over.
macro_rules! now_since {
    ($since:literal) => {
        concat!("max(", now!(), ", CASE WHEN ", $since, " < '3' THEN ", $since, " ELSE '' END)")
    };
}
pub(crate) use now_since;

/// Events that a listener may fall behind before it has to read them from the database.
const FEED_LENGTH: usize = 1024;
/// Latest ids of a table that are looked at for one that can be read.
const MAX_LATEST: u32 = 16;
/// Max connections that read.
const MAX_READERS: u32 = 4;
/// File name of the database in a store's folder.
const DATABASE: &str = "vantage.db";
/// File in a store's folder that the process that uses it has locked.
const IN_USE: &str = "in-use";
/// File in a store's folder that is given up on a full disk.
pub(crate) const RESERVE: &str = "reserve";

/// Reasons why a store cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Another process has the store open.
    #[error("{0} is in use by another process")]
    InUse(String),
    /// The folder cannot be used.
    #[error("cannot use {path}")]
    Folder {
        /// The folder.
        path: String,
        /// The I/O error.
        #[source]
        source: std::io::Error,
    },
    /// A file lies where the folder is to be.
    #[error("{path} is a file, and the data folder is to be a folder; name another with --data, or move the file away")]
    NoFolder {
        /// The file.
        path: String,
    },
    /// A file lies where a folder above the folder is to be.
    #[error("{path} is a file, and the data folder {data} cannot lie below it; name another with --data, or move the file away")]
    BelowFile {
        /// The file.
        path: String,
        /// The folder.
        data: String,
    },
    /// The folder has files but no database.
    #[error(
        "{path} has the files of a store, but its database vantage.db is missing or empty; nothing was changed. Put the database \
         back (with vantage.db-wal, if there is one), restore a backup with `vantage restore`, or choose another folder \
         with --data; to discard the stored files, move everything out of {path}"
    )]
    DatabaseMissing {
        /// The folder.
        path: String,
    },
    /// The database belongs to another store.
    #[error(
        "the database in {path} belongs to another store: its id differs from the one in store-id; nothing was changed. Put the \
         right database back, or restore a backup with `vantage restore`; if the files do belong to this database, remove \
         store-id"
    )]
    ForeignDatabase {
        /// The folder.
        path: String,
    },
    /// The database file is damaged.
    #[error("the database {path} is damaged ({findings}); nothing was changed. Restore a backup with `vantage restore`")]
    DatabaseDamaged {
        /// The database.
        path: String,
        /// Findings of SQLite's check.
        findings: String,
    },
    /// The disk has no room even for opening the store.
    #[error(
        "the disk of {path} is full, and the store cannot be opened; remove other files on that disk, or files in {path}/swept, to \
         which no record of the store refers, until 16 MiB are free, and start the server again: it can cancel and delete jobs then"
    )]
    DiskFull {
        /// The folder.
        path: String,
        /// The refusal.
        #[source]
        source: Box<Self>,
    },
    /// The database cannot be used.
    #[error("cannot open the database")]
    Database(#[from] sqlx::Error),
    /// The planning threads cannot be started.
    #[error("cannot start the planning threads")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// The threads that carry runs cannot be started.
    #[error("cannot start the threads that carry runs")]
    Carrier(#[source] std::io::Error),
    /// Jobs that an earlier process left unfinished cannot be recovered.
    #[error("cannot recover the jobs that an earlier process left unfinished")]
    Recovery(#[from] Error),
    /// The database has the schema of a newer release.
    #[error(
        "{path} was written by a newer release of Vantage; nothing was changed. Start that release, or restore a backup that was \
         made before the upgrade, with `vantage restore`"
    )]
    Newer {
        /// The folder.
        path: String,
    },
    /// The database cannot be migrated to this version's schema.
    #[error("cannot migrate the database to this version of the program")]
    Migration(#[from] MigrateError),
}

/// The open store.
pub(crate) struct Store {
    data: PathBuf,
    reader: SqlitePool,
    writer: writer::Writer,
    files: Files,
    feed: broadcast::Sender<Arc<JobEvent>>,
    pinned: pinned::PinnedFiles,
    clock: clock::Clock,
    removed_bytes: AtomicU64,
    _in_use: FolderLock,
}

impl Store {
    /// Opens the store in the folder `data`; creates it if needed. What is kept for a full disk is given up where that is needed.
    pub(crate) async fn open(data: &Path) -> Result<Self, OpenError> {
        giving_up_reserve(data, || Self::open_once(data)).await
    }

    async fn open_once(data: &Path) -> Result<Self, OpenError> {
        let folder = |source| OpenError::Folder { path: data.display().to_string(), source };
        if data.is_file() {
            return Err(OpenError::NoFolder { path: data.display().to_string() });
        }
        if let Some(file) = data.ancestors().find(|above| above.is_file()) {
            return Err(OpenError::BelowFile { path: file.display().to_string(), data: data.display().to_string() });
        }
        files::create_folder(data).map_err(folder)?;
        let in_use = lock(data)?;
        let database = data.join(DATABASE);
        let files = Files::at(data);
        identity::check_file(data, &files, &database)?;
        // SQLite takes the permissions of its other files from this one.
        match files::private_file().write(true).create_new(true).open(&database) {
            Err(error) if error.kind() != ErrorKind::AlreadyExists => return Err(folder(error)),
            Ok(_) | Err(_) => {}
        }
        let options = connect_options(&database).create_if_missing(true);
        let mut writer = open_database(&options, &database).await?;
        identity::check_tables(data, &files, &mut writer).await?;
        migrator().run_direct(None, &mut writer, false).await.map_err(|error| {
            let is_newer = matches!(error, MigrateError::VersionMissing(_));
            if is_newer { OpenError::Newer { path: data.display().to_string() } } else { error.into() }
        })?;
        identity::check_id(data, &files, &mut writer).await?;
        continue_ids(&mut writer).await?;
        let files = Files::open(data).map_err(folder)?;
        let reader = SqlitePoolOptions::new().max_connections(MAX_READERS).connect_with(options.clone()).await?;
        Ok(Self {
            data: data.to_owned(),
            reader,
            writer: writer::Writer::new(options, writer),
            files,
            feed: broadcast::channel(FEED_LENGTH).0,
            pinned: pinned::PinnedFiles::default(),
            clock: clock::Clock::start(),
            removed_bytes: AtomicU64::new(0),
            _in_use: in_use,
        })
    }

    /// Writes everything to the database file and closes it: from then on a copy of the folder is a backup.
    pub(crate) async fn close(&self) -> Result<(), Error> {
        self.reader.close().await;
        self.writer.close().await
    }

    /// Moves the write-ahead log into the database file and empties it, where the disk has room for that: what it took is free then.
    pub(crate) async fn checkpoint(&self) -> Result<(), Error> {
        self.writer.checkpoint().await
    }

    /// The content-addressed files.
    pub(crate) fn files(&self) -> &Files {
        &self.files
    }

    /// Size of the database and its write-ahead log on the disk.
    pub(crate) fn database_bytes(&self) -> u64 {
        let size = |name: &str| std::fs::metadata(self.data.join(name)).map_or(0, |about| about.len());
        size(DATABASE) + size("vantage.db-wal")
    }

    /// Checks that rows and files can be written.
    pub(crate) async fn probe(&self) -> Result<(), Error> {
        let files = self.files.clone();
        blocking(move || Ok(files.probe()?)).await?;
        let mut tx = self.writer.begin().await?;
        idempotency::delete_expired(&mut tx, &self.clock).await?;
        tx.commit().await?;
        Ok(())
    }
}

/// Opens a store; where the disk is full, once more without what is kept for that.
async fn giving_up_reserve<T, F>(data: &Path, open: impl Fn() -> F) -> Result<T, OpenError>
where
    F: Future<Output = Result<T, OpenError>>,
{
    let full = |source| OpenError::DiskFull { path: data.display().to_string(), source: Box::new(source) };
    match open().await {
        Err(error) if is_out_of_room(&error, data) => {
            if std::fs::remove_file(data.join(RESERVE)).is_err() {
                return Err(full(error));
            }
            tracing::warn!("the disk is full; the room that was kept for cancelling and deleting is given up to open the store");
            open().await.map_err(|error| if is_out_of_room(&error, data) { full(error) } else { error })
        }
        opened => opened,
    }
}

/// Returns true if a full disk or quota is among the causes. Where the database may hide that, a file is written beside it.
fn is_out_of_room(error: &OpenError, data: &Path) -> bool {
    let mut causes = std::iter::successors(Some(error as &(dyn std::error::Error + 'static)), |error| error.source());
    let is_over_quota = || Files::at(data).probe_room().is_err_and(|error| is_full_io(&error));
    causes.any(|cause| {
        let is_of_database = |error: &sqlx::Error| is_full_database(error) || (may_be_over_quota(error) && is_over_quota());
        cause.downcast_ref::<sqlx::Error>().is_some_and(is_of_database)
            || cause.downcast_ref::<io::Error>().is_some_and(is_full_io)
    })
}

/// Locks of a folder that one process uses; given back when dropped.
struct FolderLock {
    _file: File,
    /// The folder itself: whoever deletes the file does not let a second process in. Not every file system can lock a folder.
    _folder: Option<File>,
}

/// Locks the folder for this process.
fn lock(data: &Path) -> Result<FolderLock, OpenError> {
    let in_use = |_| OpenError::InUse(data.display().to_string());
    let file =
        File::create(data.join(IN_USE)).map_err(|source| OpenError::Folder { path: data.display().to_string(), source })?;
    file.try_lock().map_err(in_use)?;
    let folder = match File::open(data).map(|folder| (folder.try_lock(), folder)) {
        Ok((Ok(()), folder)) => Some(folder),
        Ok((Err(error @ TryLockError::WouldBlock), _)) => return Err(in_use(error)),
        Ok((Err(TryLockError::Error(_)), _)) | Err(_) => None,
    };
    Ok(FolderLock { _file: file, _folder: folder })
}

fn connect_options(database: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(database)
        .foreign_keys(true)
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
        // Large sorts would go to the folder for temporary files, which may be read-only or small.
        .pragma("temp_store", "MEMORY")
}

/// Makes new ids follow those that the store has, in whose order it lists and starts: the clock may have been set back meanwhile.
async fn continue_ids(database: &mut SqliteConnection) -> Result<(), sqlx::Error> {
    for table in ["mesh", "job", "run", "calibration", "scan", "inspection"] {
        let latest = format!("SELECT CAST(id AS BLOB) FROM {table} ORDER BY id DESC LIMIT {MAX_LATEST}");
        let rows = QueryBuilder::<Sqlite>::new(latest).build().fetch_all(&mut *database).await?;
        for row in &rows {
            // What is no id is in no order.
            if let Ok(id) = String::from_utf8(row.try_get(0)?) {
                continue_after(&id);
            }
        }
    }
    Ok(())
}

/// Time of an end: now, or that of the beginning where the clock was set back since.
async fn end_time(tx: &mut SqliteConnection, began: &str) -> Result<String, Error> {
    Ok(sqlx::query_scalar(concat!("SELECT ", now_since!("?1"))).bind(began).fetch_one(tx).await?)
}

/// Opens the database after SQLite's quick check.
async fn open_database(options: &SqliteConnectOptions, path: &Path) -> Result<SqliteConnection, OpenError> {
    const CORRUPT: [&str; 2] = ["11", "26"];
    let damaged = |findings: String| OpenError::DatabaseDamaged { path: path.display().to_string(), findings };
    let checked = async {
        let mut connection = SqliteConnection::connect_with(options).await?;
        let findings: Vec<String> = sqlx::query_scalar("PRAGMA quick_check(10)").fetch_all(&mut connection).await?;
        Ok::<_, sqlx::Error>((connection, findings))
    };
    match checked.await {
        Ok((connection, findings)) if findings == ["ok"] => Ok(connection),
        Ok((_, findings)) => Err(damaged(findings.join("; "))),
        Err(error) => match error.as_database_error().and_then(|error| error.code()) {
            Some(code) if CORRUPT.contains(&code.as_ref()) => Err(damaged(error.to_string())),
            _ => Err(error.into()),
        },
    }
}

fn migrator() -> Migrator {
    let migration = |version, name: &'static str, sql: &'static str| {
        Migration::new(version, name.into(), MigrationType::Simple, sql.into_sql_str(), false)
    };
    Migrator::with_migrations(vec![
        migration(1, "first", include_str!("migrations/0001_first.sql")),
        migration(2, "growth", include_str!("migrations/0002_growth.sql")),
        migration(3, "lists", include_str!("migrations/0003_lists.sql")),
        migration(4, "summary", include_str!("migrations/0004_summary.sql")),
        migration(5, "sender", include_str!("migrations/0005_sender.sql")),
        migration(6, "runs", include_str!("migrations/0006_runs.sql")),
        migration(7, "calibrations", include_str!("migrations/0007_calibrations.sql")),
        migration(8, "inspections", include_str!("migrations/0008_inspections.sql")),
        migration(9, "job_files", include_str!("migrations/0009_job_files.sql")),
        migration(10, "attempts", include_str!("migrations/0010_attempts.sql")),
        migration(11, "run_events", include_str!("migrations/0011_run_events.sql")),
        migration(12, "previews", include_str!("migrations/0012_previews.sql")),
    ])
}

/// Runs blocking work on a thread that may block.
pub(crate) async fn blocking<T: Send + 'static>(work: impl FnOnce() -> Result<T, Error> + Send + 'static) -> Result<T, Error> {
    // One type of task for each result: tokio compiles fifty functions for every one.
    let work: Box<dyn FnOnce() -> Result<T, Error> + Send> = Box::new(work);
    tokio::task::spawn_blocking(work).await?
}

/// Parses a column's text as `T`.
fn parsed<T: std::str::FromStr>(column: &str, text: &str) -> Result<T, Error> {
    text.parse().map_err(|_| InternalError::Row(format!("{column} {text:?}")).into())
}

#[cfg(test)]
mod tests;
