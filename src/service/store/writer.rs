//! The one connection that writes. A transaction takes the connection with it and gives it back at its commit; one that
//! ends in any other way closes it, and the next transaction opens another. After a full disk or an I/O error SQLite may
//! have rolled back by itself, so a fresh connection is the only one whose state is known.

use std::ops::{Deref, DerefMut};

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection, SqliteConnection};
use tokio::sync::{Mutex, MutexGuard};

use crate::service::error::Error;

/// The connection that writes, or none until the next transaction opens it.
pub(super) struct Writer {
    options: SqliteConnectOptions,
    connection: Mutex<Option<SqliteConnection>>,
}

/// A transaction that holds the database's write lock; rolled back when dropped.
pub(super) struct Transaction<'a> {
    // Declared before the place, so that it is closed before the next writer begins.
    connection: SqliteConnection,
    place: MutexGuard<'a, Option<SqliteConnection>>,
}

impl Writer {
    /// A writer that begins with this connection.
    pub(super) fn new(options: SqliteConnectOptions, connection: SqliteConnection) -> Self {
        Self { options, connection: Mutex::new(Some(connection)) }
    }

    /// Begins a transaction, once the one before has ended.
    pub(super) async fn begin(&self) -> Result<Transaction<'_>, Error> {
        let mut place = self.connection.lock().await;
        let mut connection = match place.take() {
            Some(connection) => connection,
            None => self.options.connect().await?,
        };
        sqlx::query("BEGIN IMMEDIATE").execute(&mut connection).await?;
        Ok(Transaction { connection, place })
    }

    /// Moves everything from the write-ahead log into the database file and closes the connection.
    pub(super) async fn close(&self) -> Result<(), Error> {
        let mut place = self.connection.lock().await;
        let mut connection = match place.take() {
            Some(connection) => connection,
            None => self.options.connect().await?,
        };
        sqlx::query("PRAGMA wal_checkpoint(TRUNCATE)").execute(&mut connection).await?;
        Ok(connection.close().await?)
    }
}

impl<'a> Transaction<'a> {
    /// Commits.
    pub(super) async fn commit(self) -> Result<(), Error> {
        self.commit_and_hold().await.map(drop)
    }

    /// Commits, and holds the writer until the guard is dropped, so that events are told in the order of their numbers.
    pub(super) async fn commit_and_hold(mut self) -> Result<MutexGuard<'a, Option<SqliteConnection>>, Error> {
        sqlx::query("COMMIT").execute(&mut self.connection).await?;
        let Self { connection, mut place } = self;
        *place = Some(connection);
        Ok(place)
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
