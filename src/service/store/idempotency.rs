//! Idempotency keys (IETF draft-ietf-httpapi-idempotency-key-header): the same key with the same request gives the same
//! answer for 24 hours, with another request it is refused. The row is written in the transaction that inserts the job.

use sha2::{Digest, Sha256};
use sqlx::{Row, SqliteConnection};

use super::files::hex;
use super::now;
use crate::service::error::Error;
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
        sqlx::query("DELETE FROM idempotency WHERE created_at < strftime('%Y-%m-%dT%H:%M:%fZ', 'now', '-24 hours')")
            .execute(&mut *tx)
            .await?;
        let row =
            sqlx::query("SELECT fingerprint, answer FROM idempotency WHERE key = ?1").bind(&self.key).fetch_optional(tx).await?;
        let Some(row) = row else { return Ok(None) };
        if row.try_get::<String, _>("fingerprint")? != self.fingerprint {
            return Err(Error::IdempotencyMismatch);
        }
        Ok(Some(serde_json::from_str(&row.try_get::<String, _>("answer")?)?))
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
