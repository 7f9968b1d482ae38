//! Idempotency keys (IETF draft-ietf-httpapi-idempotency-key-header): for 24 hours, a key gives the same answer to the same
//! request and is refused for any other. Its row is written in the transaction that inserts the jobs.

use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest, Sha256};
use sqlx::{Row, SqliteConnection};

use super::clock::Clock;
use super::now;
use super::stored::{VERSION, read_leniently};
use crate::service::error::{Error, InternalError};
use crate::wire::hex;

/// An idempotency key and the fingerprint of its request.
#[derive(Clone, Debug)]
pub(crate) struct IdempotencyKey {
    key: String,
    fingerprint: String,
}

impl IdempotencyKey {
    /// A key with the fingerprint of `request`, in canonical form with method and path.
    pub(crate) fn new(key: &str, request: &str) -> Self {
        Self { key: key.to_owned(), fingerprint: hex(&Sha256::digest(request)) }
    }

    /// Earlier answer to this request, if any; deletes expired keys.
    pub(super) async fn replay<T: DeserializeOwned>(&self, tx: &mut SqliteConnection, clock: &Clock) -> Result<Option<T>, Error> {
        delete_expired(&mut *tx, clock).await?;
        self.answer(tx, clock).await
    }

    /// Answer given to this request within the last 24 hours, if any; without such a limit while the clock is not steady.
    pub(super) async fn answer<T: DeserializeOwned>(
        &self,
        connection: &mut SqliteConnection,
        clock: &Clock,
    ) -> Result<Option<T>, Error> {
        let row = sqlx::query(
            "SELECT fingerprint, answer FROM idempotency
             WHERE key = ?1 AND (NOT ?2 OR created_at >= strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-24 hours'))",
        )
        .bind(&self.key)
        .bind(clock.is_steady())
        .fetch_optional(connection)
        .await?;
        let Some(row) = row else { return Ok(None) };
        if row.try_get::<String, _>("fingerprint")? != self.fingerprint {
            return Err(Error::IdempotencyMismatch);
        }
        let (answer, _) = read_leniently(VERSION, &row.try_get::<String, _>("answer")?).map_err(InternalError::Row)?;
        Ok(Some(answer))
    }

    /// Records the answer.
    pub(super) async fn record(&self, tx: &mut SqliteConnection, answer: &impl Serialize) -> Result<(), Error> {
        // The clock may have become steady again since an older key was looked for.
        sqlx::query(concat!(
            "INSERT OR REPLACE INTO idempotency (key, fingerprint, answer, created_at) VALUES (?1, ?2, ?3, ",
            now!(),
            ")"
        ))
        .bind(&self.key)
        .bind(&self.fingerprint)
        .bind(serde_json::to_string(answer)?)
        .execute(tx)
        .await?;
        Ok(())
    }
}

/// Deletes keys older than 24 hours; none while the clock is not steady.
pub(super) async fn delete_expired(tx: &mut SqliteConnection, clock: &Clock) -> Result<(), Error> {
    if !clock.is_steady() {
        return Ok(());
    }
    sqlx::query("DELETE FROM idempotency WHERE created_at < strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-24 hours')")
        .execute(tx)
        .await?;
    Ok(())
}
