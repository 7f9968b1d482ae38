//! Inspections and calibrations that an earlier process left.

use std::str::FromStr;

use sqlx::{QueryBuilder, Row, Sqlite};

use super::Store;
use crate::service::error::Error;
use crate::wire::{CalibrationId, InspectionId};

/// An inspection or a calibration that had not ended when the process did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LeftOver<I> {
    pub id: I,
    /// Number of processes that died while they computed it.
    pub attempts: u32,
}

impl Store {
    /// Inspections that have not ended, oldest first. The death of the process counts as an attempt at those that it computed.
    pub(crate) async fn inspections_left_over(&self) -> Result<Vec<LeftOver<InspectionId>>, Error> {
        self.left_over("inspection").await
    }

    /// Calibrations that have not ended, oldest first. The death of the process counts as an attempt at those that it computed.
    pub(crate) async fn calibrations_left_over(&self) -> Result<Vec<LeftOver<CalibrationId>>, Error> {
        self.left_over("calibration").await
    }

    /// Marks an inspection that cannot be read as failed: it harms itself alone, and can be deleted.
    pub(crate) async fn give_up_inspection(&self, id: InspectionId) -> Result<(), Error> {
        self.give_up("inspection", id.to_string()).await
    }

    /// Marks a calibration that cannot be read as failed: it harms itself alone, and can be deleted.
    pub(crate) async fn give_up_calibration(&self, id: CalibrationId) -> Result<(), Error> {
        self.give_up("calibration", id.to_string()).await
    }

    async fn left_over<I: FromStr>(&self, table: &str) -> Result<Vec<LeftOver<I>>, Error> {
        let mut tx = self.writer.begin().await?;
        let count = format!("UPDATE {table} SET attempts = attempts + 1 WHERE state IN ('running', 'cancelling')");
        QueryBuilder::<Sqlite>::new(count).build().execute(&mut *tx).await?;
        let open = format!("SELECT id, attempts FROM {table} WHERE state IN ('queued', 'running', 'cancelling') ORDER BY id");
        let rows = QueryBuilder::<Sqlite>::new(open).build().fetch_all(&mut *tx).await?;
        tx.commit().await?;
        let mut left = Vec::new();
        for row in &rows {
            let (id, attempts): (String, u32) = (row.try_get("id")?, row.try_get("attempts")?);
            match id.parse() {
                Ok(id) => left.push(LeftOver { id, attempts }),
                Err(_) => tracing::error!(table, id, "an id cannot be read; the row is left as it is"),
            }
        }
        Ok(left)
    }

    async fn give_up(&self, table: &str, id: String) -> Result<(), Error> {
        let mut tx = self.writer.begin().await?;
        let mut query = QueryBuilder::<Sqlite>::new(format!("UPDATE {table} SET state = 'failed' WHERE id = "));
        query.push_bind(id).build().execute(&mut *tx).await?;
        tx.commit().await
    }
}
