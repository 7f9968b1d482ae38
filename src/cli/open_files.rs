//! Limit of open files: raised as far as the system allows, and the limit of connections lowered to leave some files for the
//! database and for jobs. Every connection is an open file, so clients could otherwise take them all.

use crate::http::RESERVED_CONNECTIONS;
use crate::settings::Settings;

/// Files that the database, the log and the runtime keep open.
const STORE_FILES: u64 = 32;
/// Files left for jobs and everything else.
const SPARE_FILES: u64 = 64;
/// Files of a connection: its socket, and the file that its response is read from.
const FILES_PER_CONNECTION: u64 = 2;
/// Minimum number of connections, however few files may be open.
const MIN_CONNECTIONS: u64 = 8;

/// Raises the limit of open files to the hard limit, and lowers `server.max_connections` to what fits below it.
pub(super) fn raise_limit(settings: &mut Settings) {
    let Some(limit) = raised() else { return };
    let wanted = settings.server.max_connections;
    let fitting = fitting(limit, settings.limits.uploads_at_once.into());
    if let Some(fewer) = u32::try_from(fitting).ok().filter(|fitting| *fitting < wanted) {
        tracing::warn!(
            open_files = limit,
            max_connections = fewer,
            wanted,
            "the system allows few open files, so fewer connections than server.max_connections are taken; raise the hard limit"
        );
        settings.server.max_connections = fewer;
    }
}

/// Number of connections that fit below `limit` open files.
fn fitting(limit: u64, uploads: u64) -> u64 {
    let others = STORE_FILES + SPARE_FILES + RESERVED_CONNECTIONS as u64 + uploads;
    (limit.saturating_sub(others) / FILES_PER_CONNECTION).max(MIN_CONNECTIONS)
}

/// Limit after the attempt to raise it; `None` if there is none.
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
            tracing::warn!(%error, ?current, ?maximum, "the limit of open files could not be raised");
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
