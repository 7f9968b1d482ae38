//! The single connection that writes. A transaction takes the connection and returns it at its commit; if it ends in any other
//! way, the connection is closed and the next transaction opens a new one. After a full disk or an I/O error SQLite may have
//! rolled back on its own, so only a new connection has a known state.

use std::ops::{Deref, DerefMut};

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection, SqliteConnection};
use tokio::sync::{Mutex, MutexGuard};

use crate::service::error::Error;

/// The connection that writes, if any; otherwise the next transaction opens one.
pub(super) struct Writer {
    options: SqliteConnectOptions,
    connection: Mutex<Option<SqliteConnection>>,
}

/// A transaction that holds the database's write lock; rolled back when dropped.
pub(super) struct Transaction<'a> {
    // Declared before the guard, so that it is closed before the next writer begins.
    connection: SqliteConnection,
    guard: MutexGuard<'a, Option<SqliteConnection>>,
}

impl Writer {
    /// A writer with this connection.
    pub(super) fn new(options: SqliteConnectOptions, connection: SqliteConnection) -> Self {
        Self { options, connection: Mutex::new(Some(connection)) }
    }

    /// Begins a transaction, once the previous one has ended.
    pub(super) async fn begin(&self) -> Result<Transaction<'_>, Error> {
        let mut guard = self.connection.lock().await;
        let mut connection = self.taken(&mut guard).await?;
        sqlx::query("BEGIN IMMEDIATE").execute(&mut connection).await?;
        Ok(Transaction { connection, guard })
    }

    /// Moves everything from the write-ahead log into the database file, and empties it, unless somebody still reads from it.
    pub(super) async fn checkpoint(&self) -> Result<(), Error> {
        let mut guard = self.connection.lock().await;
        let mut connection = self.taken(&mut guard).await?;
        truncate_log(&mut connection).await?;
        *guard = Some(connection);
        Ok(())
    }

    /// Moves everything from the write-ahead log into the database file and closes the connection.
    pub(super) async fn close(&self) -> Result<(), Error> {
        let mut guard = self.connection.lock().await;
        let mut connection = self.taken(&mut guard).await?;
        truncate_log(&mut connection).await?;
        Ok(connection.close().await?)
    }

    /// The connection, or a new one.
    async fn taken(&self, kept: &mut Option<SqliteConnection>) -> Result<SqliteConnection, sqlx::Error> {
        match kept.take() {
            Some(connection) => Ok(connection),
            None => self.options.connect().await,
        }
    }
}

async fn truncate_log(connection: &mut SqliteConnection) -> Result<(), sqlx::Error> {
    sqlx::query("PRAGMA wal_checkpoint(TRUNCATE)").execute(connection).await.map(drop)
}

impl<'a> Transaction<'a> {
    /// Commits the transaction.
    pub(super) async fn commit(self) -> Result<(), Error> {
        self.commit_and_keep_lock().await.map(drop)
    }

    /// Commits, and keeps the writer locked until the guard is dropped, so that events are published in the order of their
    /// numbers.
    pub(super) async fn commit_and_keep_lock(mut self) -> Result<MutexGuard<'a, Option<SqliteConnection>>, Error> {
        sqlx::query("COMMIT").execute(&mut self.connection).await?;
        let Self { connection, mut guard } = self;
        *guard = Some(connection);
        Ok(guard)
    }
}

impl Deref for Transaction<'_> {
    type Target = SqliteConnection;

    fn deref(&self) -> &SqliteConnection {
        &self.connection
    }
}

impl DerefMut for Transaction<'_> {
    fn deref_mut(&mut self) -> &mut SqliteConnection {
        &mut self.connection
    }
}
