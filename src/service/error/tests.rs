//! Transient errors and permanent ones.

use sqlx::{Connection, Executor, SqliteConnection};

use super::*;

#[test]
fn shortages_of_the_machine_are_transient() {
    for code in [24, 23, 5, 28] {
        let error = Error::from(std::io::Error::from_raw_os_error(code));
        assert!(error.is_transient(), "errno {code}: {error}");
    }
    for code in [2, 13, 20] {
        let error = Error::from(std::io::Error::from_raw_os_error(code));
        assert!(!error.is_transient(), "errno {code}: {error}");
    }
    assert!(Error::StorageFull.is_transient());
    assert!(!Error::Draining.is_transient());
    assert!(!Error::FileDamaged { sha256: "ab".to_owned(), missing: true }.is_transient());
    assert!(Error::from(sqlx::Error::PoolTimedOut).is_transient());
}

/// A database without room for its next page, as SQLite itself tells it.
#[tokio::test]
async fn a_full_database_is_a_full_disk() {
    let mut database = SqliteConnection::connect("sqlite::memory:").await.expect("a database");
    database.execute("CREATE TABLE a (b); PRAGMA max_page_count = 2").await.expect("small");
    let full = database.execute("INSERT INTO a VALUES (zeroblob(100000))").await.expect_err("full");
    assert!(is_full_database(&full), "{full:?}");
    assert!(matches!(Error::from(full), Error::StorageFull));
    let quota = || std::io::Error::from(std::io::ErrorKind::QuotaExceeded);
    assert!(is_full_io(&quota()) && is_full_database(&sqlx::Error::Io(quota())));
    assert!(!is_full_database(&sqlx::Error::PoolTimedOut));
}

/// Errors as SQLite itself returns them, with their extended codes.
#[tokio::test]
async fn a_locked_database_is_transient_and_a_broken_statement_is_not() {
    let folder = tempfile::tempdir().expect("a folder");
    let url = format!("sqlite://{}?mode=rwc", folder.path().join("a.db").display());
    let mut one = SqliteConnection::connect(&url).await.expect("a database");
    one.execute("PRAGMA busy_timeout = 0; CREATE TABLE a (b UNIQUE); BEGIN EXCLUSIVE").await.expect("locked");
    let mut other = SqliteConnection::connect(&url).await.expect("a connection");
    other.execute("PRAGMA busy_timeout = 0").await.expect("set");
    let locked = Error::from(other.execute("INSERT INTO a VALUES (1)").await.expect_err("locked"));
    assert!(locked.is_transient(), "{locked:?}");
    let causes = std::iter::successors(Some(&locked as &(dyn std::error::Error + 'static)), |error| error.source());
    let causes: Vec<String> = causes.map(ToString::to_string).collect();
    assert!(causes.last().is_some_and(|cause| cause.contains("database is locked")), "the log tells the cause: {causes:?}");
    one.execute("COMMIT; INSERT INTO a VALUES (1)").await.expect("written");
    let text = sqlx::query_scalar::<_, String>("SELECT CAST(x'ff' AS TEXT)").fetch_one(&mut one).await;
    let unreadable = Error::from(text.expect_err("no text"));
    assert!(matches!(unreadable, Error::Internal(InternalError::Row(_))), "{unreadable:?}");
    for wrong in ["INSERT INTO a VALUES (1)", "INSERT INTO nothing VALUES (1)"] {
        let error = Error::from(other.execute(wrong).await.expect_err("refused"));
        assert!(!error.is_transient(), "{error:?}");
    }
    let nowhere = format!("sqlite://{}?mode=ro", folder.path().join("none/b.db").display());
    let cannot_open = Error::from(SqliteConnection::connect(&nowhere).await.expect_err("no such file"));
    assert!(cannot_open.is_transient(), "{cannot_open:?}");
    // A quota may be the cause: a file that is written beside the database tells.
    assert!(cannot_open.may_be_over_quota() && !locked.may_be_over_quota(), "{cannot_open:?}");
    let probed = |kind: std::io::ErrorKind| cannot_open.clone().or_full(Err(std::io::Error::from(kind).into()));
    assert!(matches!(probed(std::io::ErrorKind::QuotaExceeded), Error::StorageFull));
    assert!(matches!(probed(std::io::ErrorKind::PermissionDenied), Error::StorageBusy(_)));
    assert!(matches!(cannot_open.or_full(Ok(())), Error::StorageBusy(_)));
}

#[test]
fn what_is_missing_is_told_with_what_is_there() {
    let job = JobId::generate();
    let told = |setup: usize, programs: usize| Error::NoProgram { job, setup, programs }.to_string();
    assert_eq!(told(1, 1), format!("job {job} has one setup, and setup is 1; allowed is 0"));
    assert_eq!(told(5, 3), format!("job {job} has 3 setups, and setup is 5; allowed are 0 to 2"));
    assert!(told(0, 0).contains("without a cell") && !told(1, 1).contains("plan"), "{}", told(0, 0));
    let full = Error::QueueFull { queued: 2, asked: 3, limit: 4 }.to_string();
    assert_eq!(full, "2 of at most 4 entries are queued, which leaves no room for 3 more; wait, or cancel queued ones");
}

/// Refusals said what was wrong, and left it to the reader to find out what to do.
#[test]
fn a_refusal_says_what_to_do_next() {
    for (refusal, next) in [
        (Error::LeaseNotFound(LeaseId::generate()), "; take it anew with POST /api/v1/leases"),
        (Error::UploadTooLarge { limit_bytes: 9 }, "; send a smaller one, or raise limits.upload_bytes of the server"),
        (Error::DigestMismatch { found: "ab".into(), announced: "cd".into() }, "; upload the file again"),
        (Error::PreconditionFailed(Some("\"7\"".into())), "is \"7\"; read this version, and send its tag in If-Match"),
        (Error::PreconditionFailed(None), "; leave out If-Match to store the first version"),
        (Error::IdempotencyMismatch, "; use a new key"),
        (Error::BadPageToken, "; list again without page_token"),
        (Error::StorageFull, "; delete jobs or meshes, or free space on the disk"),
        (Error::TooSlow, "; send it again"),
        (Error::Draining, "; send the request again once it has been restarted"),
    ] {
        assert!(refusal.to_string().ends_with(next), "{refusal}");
    }
}
