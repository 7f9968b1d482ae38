//! The database of a store that no server has open, to be looked at and damaged.

use std::path::Path;

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{AssertSqlSafe, Connection as _, SqliteConnection};

fn on<T>(data: &Path, work: impl AsyncFnOnce(&mut SqliteConnection) -> Result<T, sqlx::Error>) -> T {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
    runtime.block_on(async {
        let options = SqliteConnectOptions::new().filename(data.join("vantage.db"));
        let mut connection = SqliteConnection::connect_with(&options).await.expect("the database");
        let done = work(&mut connection).await.expect("done");
        connection.close().await.expect("closed");
        done
    })
}

/// Executes statements in one transaction.
pub(super) fn execute(data: &Path, statements: impl IntoIterator<Item = String>) {
    on(data, async |connection| {
        let mut transaction = connection.begin().await?;
        for statement in statements {
            sqlx::query(AssertSqlSafe(statement)).execute(&mut *transaction).await?;
        }
        transaction.commit().await
    });
}
