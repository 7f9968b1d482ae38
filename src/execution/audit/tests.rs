use std::fs;
use std::io::{self, Write};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use super::{AuditBreach, AuditHead, AuditLimits, AuditLog, NOTHING, SYNC_INTERVAL, Sink, files, verify};
use crate::execution::device::{Direction, WireLog};

/// A disk with room for so many bytes.
struct Full(usize);

impl Write for Full {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 = self.0.checked_sub(bytes.len()).ok_or(io::ErrorKind::StorageFull)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Sink for Full {
    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A log on a disk with room for so many bytes.
pub(in crate::execution) fn log_on_full_disk(room: usize) -> Arc<AuditLog> {
    let head = AuditHead { lines: 0, sha256: NOTHING.to_owned() };
    AuditLog::onto(Box::new(move |_| Ok(Box::new(Full(room)))), 1 << 20, SYNC_INTERVAL, head).expect("opens")
}

fn fill(log: &AuditLog, entries: u8) {
    for entry in 0..entries {
        log.record("arm", Direction::Sent, &[entry; 40]);
        log.record("table", Direction::Received, &[]);
        log.record("table", Direction::Received, b"ReadActPos,OK,;");
    }
}

#[test]
fn a_log_is_a_chain_through_rotated_files_and_reopening() {
    let folder = tempfile::tempdir().expect("folder");
    let limits = AuditLimits { file_bytes: 2000, files: 4 };
    let first = AuditLog::open(folder.path(), limits).expect("opens");
    fill(&first, 4);
    let head = first.close().expect("kept");
    assert_eq!(head.lines, 1 + 2 * 4, "an entry without bytes is none");
    assert_eq!(verify(folder.path()).expect("whole"), head);
    let second = AuditLog::open(folder.path(), limits).expect("opens");
    fill(&second, 40);
    let head = second.close().expect("kept");
    assert_eq!(head.lines, 9 + 1 + 2 * 40);
    assert_eq!(verify(folder.path()).expect("whole"), head);
    let kept = files(folder.path()).expect("listed");
    assert_eq!(kept.len(), 4);
    let sizes = kept.iter().map(|file| fs::metadata(file).expect("there").len());
    assert!(sizes.clone().all(|size| size <= 2200), "{:?}", sizes.collect::<Vec<_>>());
}

#[test]
fn every_tampering_with_a_line_is_found() {
    let folder = tempfile::tempdir().expect("folder");
    let log = AuditLog::open(folder.path(), AuditLimits::default()).expect("opens");
    fill(&log, 3);
    let head = log.close().expect("kept");
    let file = files(folder.path()).expect("listed").remove(0);
    let whole = fs::read_to_string(&file).expect("read");
    let lines: Vec<&str> = whole.lines().collect();
    let written = |lines: &[&str]| fs::write(&file, lines.join("\n") + "\n").expect("written");
    let breach = || match verify(folder.path()) {
        Err(AuditBreach::Line { line, .. }) => Some(line),
        Err(AuditBreach::Unreadable { .. }) | Ok(_) => None,
    };
    for (number, line) in lines.iter().enumerate().take(lines.len() - 1) {
        let changed = line.replacen("sent", "SENT", 1).replacen("noted", "NOTED", 1).replacen("received", "RECEIVED", 1);
        let mut tampered = lines.clone();
        tampered[number] = &changed;
        written(&tampered);
        assert_eq!(breach(), Some(number as u64 + 2), "line {} changed", number + 1);
    }
    let without: Vec<&str> = [&lines[..2], &lines[3..]].concat();
    written(&without);
    assert_eq!(breach(), Some(3));
    let swapped: Vec<&str> = [&lines[..2], &[lines[3], lines[2]], &lines[4..]].concat();
    written(&swapped);
    assert_eq!(breach(), Some(3));
    // A tail that was cut is whole in itself, and told by the head that was kept elsewhere.
    written(&lines[..4]);
    assert_ne!(verify(folder.path()).expect("whole in itself"), head);
    fs::write(&file, "garbage").expect("written");
    assert!(verify(folder.path()).is_err());
}

#[test]
fn a_full_disk_is_a_failure_and_never_an_error_where_it_is_logged() {
    let log = log_on_full_disk(500);
    assert_eq!(log.failure(), None);
    fill(&log, 20);
    assert!(log.close().is_err());
    assert!(log.failure().expect("noticed").contains("no storage space"), "{:?}", log.failure());
}

/// A disk that tells of each time that it is synced, and how many bytes it then has.
struct Synced {
    bytes: usize,
    told: Sender<usize>,
}

impl Write for Synced {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.bytes += bytes.len();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Sink for Synced {
    fn sync(&mut self) -> io::Result<()> {
        // Nobody may be listening any more.
        let _ = self.told.send(self.bytes);
        Ok(())
    }
}

/// A log that is synced at an interval, and what tells of it.
fn synced(interval: Duration) -> (Arc<AuditLog>, Receiver<usize>) {
    let (told, syncs) = channel();
    let head = AuditHead { lines: 0, sha256: NOTHING.to_owned() };
    let next = Box::new(move |_: u64| -> io::Result<Box<dyn Sink>> { Ok(Box::new(Synced { bytes: 0, told: told.clone() })) });
    (AuditLog::onto(next, 1 << 20, interval, head).expect("opens"), syncs)
}

#[test]
fn a_log_comes_onto_the_disk_while_it_is_open_and_once_nobody_holds_it() {
    let (log, syncs) = synced(Duration::from_millis(1));
    let opened = syncs.recv().expect("synced");
    log.record("arm", Direction::Sent, &[0; 40]);
    assert!(syncs.recv().expect("synced") > opened);
    let (log, syncs) = synced(Duration::from_secs(3600));
    log.record("arm", Direction::Sent, &[0; 40]);
    drop(log);
    assert!(syncs.recv().expect("synced") > opened);
    // The writer has ended.
    syncs.recv().expect_err("over");
}

#[test]
fn what_comes_after_the_end_is_no_failure() {
    let folder = tempfile::tempdir().expect("folder");
    let log = AuditLog::open(folder.path(), AuditLimits::default()).expect("opens");
    let head = log.close().expect("kept");
    log.record("arm", Direction::Received, b"bye");
    assert_eq!((log.failure(), verify(folder.path()).expect("whole")), (None, head));
}
