//! Idempotency keys (IETF draft-ietf-httpapi-idempotency-key-header): the same key with the same request gives the same
//! answer for 24 hours, with another request it is refused. The row is written in the transaction that inserts the job.

use sha2::{Digest, Sha256};
use sqlx::{Row, SqliteConnection};

use super::files::hex;
use super::now;
use super::stored::{VERSION, read_leniently};
use crate::service::error::{Error, Fault};
use crate::wire::Job;

/// A key and what it was used for.
#[derive(Clone, Debug)]
pub(crate) struct IdempotencyKey {
    key: String,
    fingerprint: String,
}

impl IdempotencyKey {
    /// `request` in its canonical form, its method and path included.
    pub(crate) fn new(key: &str, request: &str) -> Self {
        Self { key: key.to_owned(), fingerprint: hex(&Sha256::digest(request)) }
    }

    /// The answer that was given to this request before.
    pub(super) async fn replay(&self, tx: &mut SqliteConnection) -> Result<Option<Job>, Error> {
        forget_old(&mut *tx).await?;
        self.answer(tx).await
    }

    /// The answer that was given to this request within a day.
    pub(super) async fn answer(&self, connection: &mut SqliteConnection) -> Result<Option<Job>, Error> {
        let row =
            sqlx::query("SELECT fingerprint, answer FROM idempotency WHERE key = ?1 AND created_at >= strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-24 hours')").bind(&self.key).fetch_optional(connection).await?;
        let Some(row) = row else { return Ok(None) };
        if row.try_get::<String, _>("fingerprint")? != self.fingerprint {
            return Err(Error::IdempotencyMismatch);
        }
        let (answer, _) = read_leniently(VERSION, &row.try_get::<String, _>("answer")?).map_err(Fault::Row)?;
        Ok(Some(answer))
    }

    /// Keeps the answer.
    pub(super) async fn keep(&self, tx: &mut SqliteConnection, answer: &Job) -> Result<(), Error> {
        sqlx::query(concat!("INSERT INTO idempotency (key, fingerprint, answer, created_at) VALUES (?1, ?2, ?3, ", now!(), ")"))
            .bind(&self.key)
            .bind(&self.fingerprint)
            .bind(serde_json::to_string(answer)?)
            .execute(tx)
            .await?;
        Ok(())
    }
}

/// Forgets keys that are older than a day.
pub(super) async fn forget_old(tx: &mut SqliteConnection) -> Result<(), Error> {
    sqlx::query("DELETE FROM idempotency WHERE created_at < strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-24 hours')")
        .execute(tx)
        .await?;
    Ok(())
}
