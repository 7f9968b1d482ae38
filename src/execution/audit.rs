//! Log of every byte that went to and came from the devices: append-only text, a line an entry, each carrying the SHA-256 of the
//! line before, so that a line changed, left out or put in shows. Rotated into a stated number of files; the chain goes on from
//! file to file. A thread of its own writes: whoever logs never waits for the disk, and what cannot be kept is a failure that the
//! run asks for. It puts the log on the disk every second, and at the end.
//!
//! `NUMBER NANOSECONDS DEVICE DIRECTION HEX SHA256`, with monotonic time since the log was opened. A tail that was cut off shows
//! only against the head that [`AuditLog::close`] gives, which is kept with the run.

use std::fmt::Write as _;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufRead, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use sha2::{Digest, Sha256};
use tokio::time::Instant;

use super::device::{Direction, WireLog};

/// Entries that may wait to be written.
const WAITING: usize = 8192;
/// Bytes that may wait to be written.
const WAITING_BYTES: usize = 16 << 20;
/// Longest line that is read back; no entry is longer.
const MAX_LINE: u64 = 1 << 20;
/// Bytes of an entry; more are several entries.
const MAX_ENTRY: usize = 64 << 10;
/// Longest time for which a line may be lost by a power failure.
const SYNC_INTERVAL: Duration = Duration::from_secs(1);
/// Direction of words among the bytes.
const NOTED: &str = "noted";
/// Hash before the first line.
const NOTHING: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// Size of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AuditLimits {
    /// Size at which a file is followed by the next.
    pub file_bytes: u64,
    /// Number of files that are kept, the oldest going first.
    pub files: usize,
}

impl Default for AuditLimits {
    fn default() -> Self {
        Self { file_bytes: 16 << 20, files: 8 }
    }
}

/// End of a chain.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditHead {
    /// Number of the last line, from 1; 0 without any.
    pub lines: u64,
    /// SHA-256 of it, lower-case hexadecimal.
    pub sha256: String,
}

/// Break of a chain.
#[derive(Debug, thiserror::Error)]
pub enum AuditBreach {
    /// A log that cannot be read.
    #[error("{file} cannot be read: {error}")]
    Unreadable {
        /// File.
        file: String,
        /// Words of the operating system.
        #[source]
        error: io::Error,
    },
    /// A line that does not follow the one before.
    #[error("{file}, line {line}: {what}")]
    Line {
        /// File.
        file: String,
        /// Line in it, from 1.
        line: u64,
        /// Words for what is wrong.
        what: &'static str,
    },
}

enum Message {
    Entry { at: Instant, device: &'static str, direction: &'static str, bytes: Vec<u8> },
    Close,
}

#[derive(Debug, Default)]
struct State {
    failure: Mutex<Option<String>>,
    is_closed: AtomicBool,
    waiting_bytes: AtomicUsize,
}

/// An open log.
#[derive(Debug)]
pub struct AuditLog {
    messages: SyncSender<Message>,
    state: Arc<State>,
    writer: Mutex<Option<JoinHandle<AuditHead>>>,
}

impl AuditLog {
    /// Opens the log in a folder, and goes on with the chain that it finds there.
    ///
    /// # Errors
    /// A folder that cannot be made, or files in it that cannot be read or written.
    pub fn open(folder: &Path, limits: AuditLimits) -> io::Result<Arc<Self>> {
        fs::create_dir_all(folder)?;
        let (number, head) = match files(folder)?.last() {
            None => (1, AuditHead { lines: 0, sha256: NOTHING.to_owned() }),
            Some(last) => (number_of(last).unwrap_or(0) + 1, last_head(folder)?),
        };
        let folder = folder.to_owned();
        // Each opening begins a file: nothing is appended to what an interrupted write may have left half a line of.
        let next = Box::new(move |next: u64| open_file(&folder, number + next, limits.files));
        Self::onto(next, limits.file_bytes, SYNC_INTERVAL, head)
    }

    /// Opens the log on whatever `next` gives for a file.
    pub(super) fn onto(mut next: OpenNext, file_bytes: u64, sync_interval: Duration, head: AuditHead) -> io::Result<Arc<Self>> {
        let (messages, received) = sync_channel(WAITING);
        let (state, began) = (Arc::new(State::default()), Instant::now());
        let sink = next(0)?;
        let chain = Chain { next, opened: 0, sink, written: 0, file_bytes, sync_interval, head, began };
        let shared = Arc::clone(&state);
        let writer = std::thread::Builder::new().name("audit".into()).spawn(move || chain.write(&received, &shared))?;
        let log = Arc::new(Self { messages, state, writer: Mutex::new(Some(writer)) });
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        log.mark(&format!("opened {}.{:03} s after 1970", unix.as_secs(), unix.subsec_millis()));
        Ok(log)
    }

    /// Notes words among the bytes: what a run was told.
    pub fn mark(&self, words: &str) {
        self.enter("session", NOTED, words.as_bytes());
    }

    /// Words of why it can no longer be kept; from then on nothing is.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        self.state.failure.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Writes what waits, to the disk, and ends the log; its head, to be kept with the run. Entries that come later are dropped.
    /// Blocks until the disk has answered.
    ///
    /// # Errors
    /// The failure, if there was one.
    pub fn close(&self) -> Result<AuditHead, String> {
        self.state.is_closed.store(true, Ordering::Relaxed);
        // A full channel is emptied by the writer.
        let _ = self.messages.send(Message::Close);
        let writer = self.writer.lock().unwrap_or_else(PoisonError::into_inner).take();
        let head = writer.map(JoinHandle::join).transpose().map_err(|_| "its thread panicked".to_owned())?;
        match (self.failure(), head) {
            (Some(failure), _) => Err(failure),
            (None, Some(head)) => Ok(head),
            (None, None) => Err("it was closed before".to_owned()),
        }
    }

    fn enter(&self, device: &'static str, direction: &'static str, bytes: &[u8]) {
        let at = Instant::now();
        for bytes in bytes.chunks(MAX_ENTRY) {
            let waiting = self.state.waiting_bytes.fetch_add(bytes.len(), Ordering::Relaxed);
            let entry = Message::Entry { at, device, direction, bytes: bytes.to_vec() };
            let refused = match self.messages.try_send(entry) {
                Ok(()) => (waiting > WAITING_BYTES).then_some("its disk does not keep up"),
                Err(TrySendError::Full(_)) => Some("its disk does not keep up"),
                // A driver that is being dropped may still have something to say.
                Err(TrySendError::Disconnected(_)) if self.state.is_closed.load(Ordering::Relaxed) => None,
                Err(TrySendError::Disconnected(_)) => Some("its thread has ended"),
            };
            if let Some(words) = refused {
                self.state.fail(words.to_owned());
            }
        }
    }
}

impl WireLog for AuditLog {
    fn record(&self, device: &'static str, direction: Direction, bytes: &[u8]) {
        let direction = match direction {
            Direction::Sent => "sent",
            Direction::Received => "received",
        };
        self.enter(device, direction, bytes);
    }

    fn note(&self, device: &'static str, words: &str) {
        self.enter(device, NOTED, words.as_bytes());
    }
}

impl State {
    /// Keeps the first failure.
    fn fail(&self, words: String) {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(words);
    }
}

/// A file of a log.
pub(super) trait Sink: Write + Send {
    /// Puts everything on the disk.
    fn sync(&mut self) -> io::Result<()>;
}

impl Sink for BufWriter<File> {
    fn sync(&mut self) -> io::Result<()> {
        self.flush()?;
        self.get_ref().sync_data()
    }
}

/// Opens a file by the number of those opened before.
pub(super) type OpenNext = Box<dyn FnMut(u64) -> io::Result<Box<dyn Sink>> + Send>;

/// The writer's side.
struct Chain {
    next: OpenNext,
    opened: u64,
    sink: Box<dyn Sink>,
    written: u64,
    file_bytes: u64,
    sync_interval: Duration,
    head: AuditHead,
    began: Instant,
}

impl Chain {
    fn write(mut self, received: &Receiver<Message>, state: &State) -> AuditHead {
        let mut has_failed = false;
        // Time of the oldest line that may not be on the disk yet.
        let mut unsynced: Option<std::time::Instant> = None;
        loop {
            let left = |since: std::time::Instant| self.sync_interval.saturating_sub(since.elapsed());
            let mut message = next_message(received, unsynced.map(left));
            let mut is_due = message.is_none();
            while let Some(Message::Entry { at, device, direction, bytes }) = message {
                state.waiting_bytes.fetch_sub(bytes.len(), Ordering::Relaxed);
                // After a failure nothing is written: a chain has no holes.
                if !has_failed && let Err(error) = self.append(at, device, direction, &bytes) {
                    state.fail(error.to_string());
                    has_failed = true;
                }
                is_due = unsynced.get_or_insert_with(std::time::Instant::now).elapsed() >= self.sync_interval;
                message = if is_due { None } else { next_message(received, Some(Duration::ZERO)) };
            }
            let is_closed = message.is_some();
            let kept = if is_closed || is_due {
                unsynced = None;
                self.sink.sync()
            } else {
                self.sink.flush()
            };
            if let Err(error) = kept {
                state.fail(error.to_string());
                has_failed = true;
            }
            if is_closed {
                break;
            }
        }
        self.head
    }

    fn append(&mut self, at: Instant, device: &str, direction: &str, bytes: &[u8]) -> io::Result<()> {
        let nanoseconds = at.saturating_duration_since(self.began).as_nanos();
        let mut line = format!("{} {nanoseconds} {device} {direction} ", self.head.lines + 1);
        for byte in bytes {
            // Writing to a string does not fail.
            let _ = write!(line, "{byte:02x}");
        }
        line.push(' ');
        line += &self.head.sha256;
        if self.written > 0 && self.written + line.len() as u64 >= self.file_bytes {
            self.sink.sync()?;
            self.opened += 1;
            self.sink = (self.next)(self.opened)?;
            self.written = 0;
        }
        self.sink.write_all(line.as_bytes())?;
        self.sink.write_all(b"\n")?;
        self.written += line.len() as u64 + 1;
        self.head = AuditHead { lines: self.head.lines + 1, sha256: hash(&line) };
        Ok(())
    }
}

/// The next message, if one comes within `limit`. A log that nobody holds any more is closed.
fn next_message(received: &Receiver<Message>, limit: Option<Duration>) -> Option<Message> {
    let Some(limit) = limit else { return Some(received.recv().unwrap_or(Message::Close)) };
    match received.recv_timeout(limit) {
        Ok(message) => Some(message),
        Err(RecvTimeoutError::Timeout) => None,
        Err(RecvTimeoutError::Disconnected) => Some(Message::Close),
    }
}

/// Files of the log in a folder, oldest first.
///
/// # Errors
/// A folder that cannot be read.
pub fn files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        files.extend(number_of(&path).map(|number| (number, path)));
    }
    files.sort();
    Ok(files.into_iter().map(|(_, path)| path).collect())
}

/// Follows the chain through all files that are there; its head.
///
/// # Errors
/// The first [`AuditBreach`].
pub fn verify(folder: &Path) -> Result<AuditHead, AuditBreach> {
    let unreadable = |path: &Path| {
        let file = name_of(path);
        move |error| AuditBreach::Unreadable { file, error }
    };
    let mut former: Option<AuditHead> = None;
    for path in files(folder).map_err(unreadable(folder))? {
        let mut lines = BufReader::new(File::open(&path).map_err(unreadable(&path))?);
        let mut number = 0;
        while let Some(line) = read_line(&mut lines).map_err(unreadable(&path))? {
            number += 1;
            let breach = |what| AuditBreach::Line { file: name_of(&path), line: number, what };
            former = Some(follow(former.as_ref(), &line).map_err(breach)?);
        }
    }
    Ok(former.unwrap_or_else(|| AuditHead { lines: 0, sha256: NOTHING.to_owned() }))
}

/// The head after a line, if it follows the former. The first line that is left may be any.
fn follow(former: Option<&AuditHead>, line: &str) -> Result<AuditHead, &'static str> {
    let mut parts = line.split(' ');
    let (number, sha256) = (parts.next().and_then(|number| number.parse::<u64>().ok()), parts.next_back());
    let (Some(lines), Some(sha256), 4) = (number, sha256, parts.count()) else {
        return Err("is no entry of six parts; it was cut or changed");
    };
    let Some(former) = former else {
        let is_whole = lines > 1 || sha256 == NOTHING;
        return if is_whole { Ok(AuditHead { lines, sha256: hash(line) }) } else { Err("begins a chain with another hash") };
    };
    match () {
        () if lines != former.lines + 1 => Err("does not have the next number; lines are missing or put in"),
        () if sha256 != former.sha256 => Err("does not carry the hash of the line before, which was changed"),
        () => Ok(AuditHead { lines, sha256: hash(line) }),
    }
}

fn read_line(lines: &mut impl BufRead) -> io::Result<Option<String>> {
    let mut line = String::new();
    lines.by_ref().take(MAX_LINE).read_line(&mut line)?;
    match line.pop() {
        None => Ok(None),
        Some('\n') => Ok(Some(line)),
        Some(_) => Err(io::Error::new(io::ErrorKind::InvalidData, "the last line has no end, or is too long")),
    }
}

/// Head of the newest file that has one. A line that was cut by a power failure is left where it is; the chain goes on behind the
/// last whole one, and [`verify`] then names the cut line.
fn last_head(folder: &Path) -> io::Result<AuditHead> {
    for path in files(folder)?.iter().rev() {
        let (mut lines, mut last) = (BufReader::new(File::open(path)?), None);
        while let Ok(Some(line)) = read_line(&mut lines) {
            last = Some(line);
        }
        let head = last.and_then(|line| {
            let lines = line.split(' ').next()?.parse().ok()?;
            Some(AuditHead { lines, sha256: hash(&line) })
        });
        if let Some(head) = head {
            return Ok(head);
        }
    }
    Ok(AuditHead { lines: 0, sha256: NOTHING.to_owned() })
}

fn open_file(folder: &Path, number: u64, keep: usize) -> io::Result<Box<dyn Sink>> {
    let file = OpenOptions::new().append(true).create_new(true).open(folder.join(format!("audit-{number:08}.log")))?;
    let all = files(folder)?;
    for oldest in &all[..all.len().saturating_sub(keep.max(1))] {
        fs::remove_file(oldest)?;
    }
    Ok(Box::new(BufWriter::new(file)))
}

fn number_of(path: &Path) -> Option<u64> {
    path.file_name()?.to_str()?.strip_prefix("audit-")?.strip_suffix(".log")?.parse().ok()
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

fn hash(line: &str) -> String {
    Sha256::digest(line.as_bytes()).iter().fold(String::with_capacity(64), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
pub(super) mod tests;
