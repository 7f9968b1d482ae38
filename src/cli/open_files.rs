//! How many files the process may have open: as many as the system allows it, and connections no more than leave some
//! for the database and for jobs. Every connection is a file, so that clients could else take them all.

use crate::http::RESERVED_CONNECTIONS;
use crate::settings::Settings;

/// Files that the database, the log and the runtime have open.
const OF_THE_STORE: u64 = 32;
/// Files left for jobs and whatever else comes.
const SPARE: u64 = 64;
/// A connection is one, and the file that its answer is read from another.
const PER_CONNECTION: u64 = 2;
/// Fewer connections than this are no server.
const MIN_CONNECTIONS: u64 = 8;

/// Raises the process's limit as far as it may, and lowers `server.max_connections` to what fits below it.
pub(super) fn fit(settings: &mut Settings) {
    let Some(limit) = raised() else { return };
    let wanted = settings.server.max_connections;
    let fitting = fitting(limit, settings.limits.uploads_at_once.into());
    if let Some(fewer) = u32::try_from(fitting).ok().filter(|fitting| *fitting < wanted) {
        tracing::warn!(
            open_files = limit,
            max_connections = fewer,
            wanted,
            "the system allows few open files: fewer connections than server.max_connections are taken; raise the hard limit"
        );
        settings.server.max_connections = fewer;
    }
}

/// Connections for which there is room below `limit` open files.
fn fitting(limit: u64, uploads: u64) -> u64 {
    let others = OF_THE_STORE + SPARE + RESERVED_CONNECTIONS as u64 + uploads;
    (limit.saturating_sub(others) / PER_CONNECTION).max(MIN_CONNECTIONS)
}

/// The limit after the attempt to raise it; `None` when there is none.
#[cfg(unix)]
fn raised() -> Option<u64> {
    use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    if current == maximum {
        return current;
    }
    match setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum }) {
        Ok(()) => maximum,
        Err(error) => {
            tracing::warn!(%error, ?current, ?maximum, "the limit of open files cannot be raised");
            current
        }
    }
}

#[cfg(not(unix))]
fn raised() -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn connections_leave_files_for_the_store_and_for_jobs() {
        assert_eq!(fitting(1024, 32), 416);
        assert_eq!(fitting(256, 32), 32);
        assert_eq!(fitting(64, 32), MIN_CONNECTIONS);
        assert!(fitting(20_000, 32) > 1024);
    }
}
