//! Persistent state: SQLite rows (WAL, `synchronous=FULL`, one writer) and content-addressed files that the rows refer to.
//! Once a function has returned, its change is on the disk.
//!
//! Order of writes: a file is written before a row refers to it, and removed after its row; so a crash leaves at most
//! orphans: files that no row refers to. They are moved to `swept/` once they are old enough, and removed from there later.

mod artifacts;
mod attempts;
mod backup;
mod calibrations;
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

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use sqlx::migrate::{Migration, MigrationType, Migrator};
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{Connection, SqlSafeStr, SqliteConnection, SqlitePool};
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

use super::error::{Error, InternalError};
use crate::wire::JobEvent;

/// SQL expression of the current time as text. Every time in the store is written with it.
macro_rules! now {
    () => {
        "strftime('%Y-%m-%dT%H:%M:%fZ', 'now')"
    };
}
pub(crate) use now;

/// Events that a listener may fall behind before it has to read them from the database.
const FEED_LENGTH: usize = 1024;
/// Max connections that read.
const MAX_READERS: u32 = 4;
/// File name of the database in a store's folder.
const DATABASE: &str = "vantage.db";

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
    /// The database cannot be migrated to this version's schema.
    #[error("cannot migrate the database to this version of the program")]
    Migration(#[from] sqlx::migrate::MigrateError),
}

/// The open store.
pub(crate) struct Store {
    data: PathBuf,
    reader: SqlitePool,
    writer: writer::Writer,
    files: Files,
    feed: broadcast::Sender<Arc<JobEvent>>,
    pinned: pinned::PinnedFiles,
    damage: scrub::KnownDamage,
    _in_use: File,
}

impl Store {
    /// Opens the store in the folder `data`; creates it if needed.
    pub(crate) async fn open(data: &Path) -> Result<Self, OpenError> {
        let folder = |source| OpenError::Folder { path: data.display().to_string(), source };
        std::fs::create_dir_all(data).map_err(folder)?;
        let in_use = lock(data)?;
        let database = data.join(DATABASE);
        let files = Files::at(data);
        identity::check_file(data, &files, &database)?;
        let options = connect_options(&database).create_if_missing(true);
        let mut writer = open_database(&options, &database).await?;
        identity::check_tables(data, &files, &mut writer).await?;
        migrator().run_direct(None, &mut writer, false).await?;
        identity::check_id(data, &files, &mut writer).await?;
        let files = Files::open(data).map_err(folder)?;
        let reader = SqlitePoolOptions::new().max_connections(MAX_READERS).connect_with(options.clone()).await?;
        Ok(Self {
            data: data.to_owned(),
            reader,
            writer: writer::Writer::new(options, writer),
            files,
            feed: broadcast::channel(FEED_LENGTH).0,
            pinned: pinned::PinnedFiles::default(),
            damage: scrub::KnownDamage::default(),
            _in_use: in_use,
        })
    }

    /// Writes everything to the database file and closes it: from then on a copy of the folder is a backup.
    pub(crate) async fn close(&self) -> Result<(), Error> {
        self.reader.close().await;
        self.writer.close().await
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
        idempotency::delete_expired(&mut tx).await?;
        tx.commit().await?;
        Ok(())
    }
}

/// Locks the folder for this process.
fn lock(data: &Path) -> Result<File, OpenError> {
    let in_use =
        File::create(data.join("in-use")).map_err(|source| OpenError::Folder { path: data.display().to_string(), source })?;
    in_use.try_lock().map_err(|_| OpenError::InUse(data.display().to_string()))?;
    Ok(in_use)
}

fn connect_options(database: &Path) -> SqliteConnectOptions {
    SqliteConnectOptions::new()
        .filename(database)
        .foreign_keys(true)
        .journal_mode(SqliteJournalMode::Wal)
        .synchronous(SqliteSynchronous::Full)
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
