//! Audit logs on the disk: a folder a run, in the folder of the settings.

use std::collections::BTreeMap;
use std::fs::{self, DirEntry, File};
use std::io::{self, ErrorKind, Read as _, Seek as _, SeekFrom};
use std::path::Path;

use sha2::{Digest, Sha256};

use crate::execution::audit::{self, AuditHead};
use crate::wire::{RunId, hex};

/// Bytes at the end of a file of a log that hold its last whole line: no line is longer than 1 MiB, and half of one may follow it.
const TAIL_BYTES: u64 = 2 << 20;

/// Sizes of audit logs, as far as they can be read.
#[derive(Debug, Default)]
pub(in crate::service) struct LogSizes {
    /// Bytes of each log that can be read.
    pub(in crate::service) bytes: BTreeMap<RunId, u64>,
    /// First error; with one, `bytes` is without some or all logs.
    pub(in crate::service) fault: Option<io::Error>,
}

/// Bytes of each audit log in a folder. What is not named by a run, as in a folder that others use too, does not count. Blocks.
pub(in crate::service) fn log_sizes(audit_dir: &Path) -> LogSizes {
    let mut found = LogSizes::default();
    let folders = match entries(audit_dir) {
        Ok(folders) => folders,
        Err(error) => return LogSizes { fault: Some(error), ..found },
    };
    for folder in folders {
        let Some(run) = folder.file_name().to_str().and_then(|name| name.parse().ok()) else { continue };
        match log_bytes(&folder) {
            Ok(Some(bytes)) => {
                found.bytes.insert(run, bytes);
            }
            Ok(None) => {}
            Err(error) => {
                found.fault.get_or_insert(error);
            }
        }
    }
    found
}

/// Bytes of the log in an entry of the folder; `None` for one that is no folder.
fn log_bytes(entry: &DirEntry) -> io::Result<Option<u64>> {
    if entry.file_type()?.is_dir() { size_bytes(&entry.path()).map(Some) } else { Ok(None) }
}

/// End of an audit log as it lies on the disk: its last whole line. A process that was killed may have left half a line behind it, and what
/// it had not written yet is lost. `None` where there is no log. Blocks.
pub(super) fn end_of_log(folder: &Path) -> io::Result<Option<AuditHead>> {
    let files = match audit::files(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        files => files?,
    };
    for path in files.iter().rev() {
        let head = last_line(path)?.and_then(|line| {
            let lines = line.split(' ').next()?.parse().ok()?;
            Some(AuditHead { lines, sha256: hex(&Sha256::digest(line.as_bytes())) })
        });
        // A file that was just begun has none.
        if head.is_some() {
            return Ok(head);
        }
    }
    Ok(None)
}

/// Last whole line of a file, without its end.
fn last_line(path: &Path) -> io::Result<Option<String>> {
    let mut file = File::open(path)?;
    let length_bytes = file.metadata()?.len();
    file.seek(SeekFrom::Start(length_bytes.saturating_sub(TAIL_BYTES)))?;
    let mut tail = Vec::new();
    file.take(TAIL_BYTES).read_to_end(&mut tail)?;
    let Some(end) = tail.iter().rposition(|byte| *byte == b'\n') else { return Ok(None) };
    let whole = &tail[..end];
    let begin = whole.iter().rposition(|byte| *byte == b'\n').map_or(0, |before| before + 1);
    Ok(String::from_utf8(whole[begin..].to_vec()).ok())
}

/// Bytes of the files in a folder. One may be deleted while it is looked at: logs are rotated, and go with their runs.
fn size_bytes(folder: &Path) -> io::Result<u64> {
    let mut bytes = 0;
    for file in entries(folder)? {
        match file.metadata() {
            Ok(about) if about.is_file() => bytes += about.len(),
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            Ok(_) | Err(_) => {}
        }
    }
    Ok(bytes)
}

/// Entries of a folder; none if it does not exist.
fn entries(folder: &Path) -> io::Result<Vec<DirEntry>> {
    match fs::read_dir(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(Vec::new()),
        entries => entries?.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_files_of_runs_count_and_no_others() {
        let folder = tempfile::tempdir().expect("a folder");
        let [one, other] = [RunId::generate(), RunId::generate()];
        let write = |path: String, bytes: usize| {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().expect("a folder")).expect("created");
            fs::write(path, vec![b'x'; bytes]).expect("written");
        };
        write(format!("{one}/audit-00000001.log"), 300);
        write(format!("{one}/audit-00000002.log"), 40);
        write(format!("{other}/audit-00000001.log"), 5);
        write("syslog".to_owned(), 1000);
        write("journal/system".to_owned(), 1000);
        write(RunId::generate().to_string(), 1000);
        let found = log_sizes(folder.path());
        assert_eq!((found.bytes, found.fault.is_none()), (BTreeMap::from([(one, 340), (other, 5)]), true));
        let none_yet = log_sizes(&folder.path().join("nowhere"));
        assert_eq!((none_yet.bytes, none_yet.fault.is_none()), (BTreeMap::new(), true));
        let no_folder = log_sizes(&folder.path().join("syslog"));
        assert_eq!((no_folder.bytes, no_folder.fault.is_some()), (BTreeMap::new(), true));
    }

    #[test]
    fn the_end_of_a_log_is_its_last_whole_line() {
        let folder = tempfile::tempdir().expect("a folder");
        let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).expect("written");
        let end = || end_of_log(folder.path()).expect("read");
        let head = |lines: u64, line: &str| Some(AuditHead { lines, sha256: hex(&Sha256::digest(line)) });
        assert_eq!(end_of_log(&folder.path().join("nowhere")).expect("none yet"), None);
        assert_eq!(end(), None);
        write("audit-00000001.log", "1 0 session noted 00 aa\n2 5 arm sent 00 bb\n");
        assert_eq!(end(), head(2, "2 5 arm sent 00 bb"));
        write("audit-00000002.log", "3 7 ar");
        assert_eq!(end(), head(2, "2 5 arm sent 00 bb"), "the newest file has no whole line");
        write("audit-00000002.log", "3 7 arm sent 00 cc\n4 8 ta");
        assert_eq!(end(), head(3, "3 7 arm sent 00 cc"));
        let long = format!("{}\n5 9 arm sent 00 dd\n", "x".repeat(3 << 20));
        write("audit-00000003.log", &long);
        assert_eq!(end(), head(5, "5 9 arm sent 00 dd"), "only the tail is read");
    }
}
