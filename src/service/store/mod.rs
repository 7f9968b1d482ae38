//! What must outlive the process: SQLite rows (WAL, `synchronous=FULL`, one writer) and content-addressed files that
//! the rows refer to. A function that returns has its change on the disk.
//!
//! Order of writes: a file is there before a row names it, and its row is gone before it is removed; so a crash leaves
//! at most files that nothing names, and those are swept when the store is opened.

mod events;
mod files;
mod idempotency;
mod jobs;
mod meshes;
mod pages;
mod specs;

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use sqlx::migrate::{Migration, MigrationType, Migrator};
use sqlx::sqlite::{SqliteConnectOptions, SqliteJournalMode, SqlitePoolOptions, SqliteSynchronous};
use sqlx::{Connection, SqlSafeStr, SqliteConnection, SqlitePool};
use tokio::sync::{Mutex, RwLock, broadcast};

pub(crate) use files::{Files, Received, hex};
pub(crate) use idempotency::IdempotencyKey;
pub(crate) use jobs::{Attempt, JobFilter, NewJob, Outcome};
pub(crate) use meshes::{MeshFile, NewMesh};
pub(crate) use pages::Page;
pub use specs::Precondition;
pub(crate) use specs::{Put, StoredSpec};

use super::error::{Error, Fault};
use crate::wire::JobEvent;

/// The time of the database as text; every time in the store is written with it.
macro_rules! now {
    () => {
        "strftime('%Y-%m-%dT%H:%M:%fZ', 'now')"
    };
}
pub(crate) use now;

/// Events that a slow reader may be behind before it has to read them from the database.
const FEED_LENGTH: usize = 1024;
/// Connections that read.
const READERS: u32 = 4;

/// Why a store cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Another process has it open.
    #[error("{0} is in use by another process")]
    InUse(String),
    /// The folder cannot be used.
    #[error("cannot use {path}")]
    Folder {
        /// Which.
        path: String,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// The database cannot be used.
    #[error("cannot open the database")]
    Database(#[from] sqlx::Error),
    /// There are no threads to plan on.
    #[error("cannot start the planning threads")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// What an earlier process left cannot be put in order.
    #[error("cannot put in order what an earlier process left")]
    Recovery(#[from] Error),
    /// The database is of another version of the program.
    #[error("cannot bring the database to this version of the program")]
    Migration(#[from] sqlx::migrate::MigrateError),
}

/// The open store.
pub(crate) struct Store {
    reader: SqlitePool,
    writer: Mutex<SqliteConnection>,
    files: Files,
    feed: broadcast::Sender<Arc<JobEvent>>,
    /// Held for reading from the moment a file gets its name until a row refers to it, for writing while files that no
    /// row refers to are removed.
    sweep: RwLock<()>,
    _in_use: File,
}

impl Store {
    /// Opens the store in the folder `data`, making it if need be.
    pub(crate) async fn open(data: &Path) -> Result<Self, OpenError> {
        let folder = |source| OpenError::Folder { path: data.display().to_string(), source };
        std::fs::create_dir_all(data).map_err(folder)?;
        let in_use = File::create(data.join("in-use")).map_err(folder)?;
        in_use.try_lock().map_err(|_| OpenError::InUse(data.display().to_string()))?;
        let files = Files::open(data).map_err(folder)?;
        let options = SqliteConnectOptions::new()
            .filename(data.join("vantage.db"))
            .create_if_missing(true)
            .foreign_keys(true)
            .journal_mode(SqliteJournalMode::Wal)
            .synchronous(SqliteSynchronous::Full);
        let mut writer = SqliteConnection::connect_with(&options).await?;
        migrator().run_direct(None, &mut writer, false).await?;
        let reader = SqlitePoolOptions::new().max_connections(READERS).connect_with(options).await?;
        let (feed, _) = broadcast::channel(FEED_LENGTH);
        let store = Self { reader, writer: Mutex::new(writer), files, feed, sweep: RwLock::new(()), _in_use: in_use };
        store.sweep_files().await?;
        Ok(store)
    }

    /// The files.
    pub(crate) fn files(&self) -> &Files {
        &self.files
    }

    /// Whether rows and files can be written now.
    pub(crate) async fn probe(&self) -> Result<(), Error> {
        let files = self.files.clone();
        blocking(move || Ok(files.probe()?)).await?;
        let mut writer = self.writer.lock().await;
        let mut tx = writer.begin_with("BEGIN IMMEDIATE").await?;
        sqlx::query("DELETE FROM idempotency WHERE created_at < strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-24 hours')")
            .execute(&mut *tx)
            .await?;
        tx.commit().await?;
        Ok(())
    }

    /// Removes every file that no row names: what a crash left between file and row.
    async fn sweep_files(&self) -> Result<(), Error> {
        let files = self.files.clone();
        let candidates = blocking(move || Ok(files.list()?)).await?;
        self.remove_unreferenced(candidates).await
    }

    /// Removes those of the files that no row names.
    async fn remove_unreferenced(&self, candidates: Vec<String>) -> Result<(), Error> {
        let _alone = self.sweep.write().await;
        for sha256 in candidates {
            let referenced: bool = sqlx::query_scalar(
                "SELECT EXISTS (SELECT 1 FROM mesh WHERE sha256 = ?1 OR preview = ?1)
                     OR EXISTS (SELECT 1 FROM artifact WHERE sha256 = ?1)",
            )
            .bind(&sha256)
            .fetch_one(&self.reader)
            .await?;
            if !referenced {
                let files = self.files.clone();
                blocking(move || Ok(files.remove(&sha256)?)).await?;
            }
        }
        Ok(())
    }
}

fn migrator() -> Migrator {
    let first = include_str!("migrations/0001_first.sql");
    Migrator::with_migrations(vec![Migration::new(1, "first".into(), MigrationType::Simple, first.into_sql_str(), false)])
}

/// Runs what blocks on a thread that may be blocked.
pub(crate) async fn blocking<T: Send + 'static>(work: impl FnOnce() -> Result<T, Error> + Send + 'static) -> Result<T, Error> {
    tokio::task::spawn_blocking(work).await?
}

/// A value of a row, read by its type.
fn parsed<T: std::str::FromStr>(column: &str, text: &str) -> Result<T, Error> {
    text.parse().map_err(|_| Fault::Row(format!("{column} {text:?}")).into())
}

#[cfg(test)]
mod tests;
