//! Content-addressed files: a file's name is the SHA-256 of its bytes, so it never changes and is never incomplete.
//! Written as temporary file → fsync → rename → fsync of the directory. All of this blocks.
//!
//! A file is compared with its hash before its bytes are read, and again after [`CHECK_LIFETIME`] or when its size or
//! modification time has changed. A damaged file is never read; storing the same bytes again repairs it, whether or not the damage
//! was noticed: the file is replaced.

use std::collections::{BTreeSet, HashMap};
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use sha2::{Digest, Sha256};
use tempfile::{NamedTempFile, TempPath};

use super::scrub::KnownDamage;
use crate::service::error::{Error, is_read_failure};
use crate::service::failpoint;
use crate::wire::hex;

/// Time for which a checked file is trusted.
const CHECK_LIFETIME: Duration = Duration::from_secs(3600);
/// Max remembered checks; beyond that all are forgotten.
const MAX_CHECKED: usize = 100_000;
/// Max suspects remembered until they are looked at.
const MAX_SUSPECTS: usize = 1000;
/// Digits of a file's name.
const NAME_DIGITS: usize = 64;
/// Digits of the name of the folder that it lies in.
const FOLDER_DIGITS: usize = 2;
/// Bytes read at a time.
const PIECE_BYTES: usize = 256 * 1024;
/// Size of a file that is written to find out whether there is room: a few pages of the database.
const PROBED_BYTES: usize = 32 * 1024;

/// Folders of the content-addressed, the unfinished and the swept files, on one file system.
#[derive(Clone, Debug)]
pub(crate) struct Files {
    files: PathBuf,
    unfinished: PathBuf,
    swept: PathBuf,
    checked: Arc<Mutex<HashMap<String, Checked>>>,
    suspects: Arc<Mutex<BTreeSet<String>>>,
    pub(super) damage: KnownDamage,
}

/// Time, size and modification time of a file at its last check.
#[derive(Clone, Copy, Debug)]
struct Checked {
    at: Instant,
    size_bytes: u64,
    modified: Option<SystemTime>,
}

/// A finished temporary file; removed when dropped.
pub(crate) struct Received {
    /// The file, synced.
    pub file: NamedTempFile,
    /// SHA-256, lower-case hexadecimal.
    pub sha256: String,
    /// Size of the file.
    pub size_bytes: u64,
}

/// A file in transfer, hashed on the way.
pub(crate) struct Receiver {
    file: NamedTempFile,
    hash: Sha256,
    size_bytes: u64,
}

/// A file found in a folder of the store.
#[derive(Clone, Debug)]
pub(crate) struct StoredFile {
    /// Name of the file: the hash of its bytes.
    pub sha256: String,
    /// Modification time.
    pub modified: SystemTime,
}

impl Files {
    /// Opens the folders below `data`, and removes the unfinished files of an earlier process.
    pub(crate) fn open(data: &Path) -> io::Result<Self> {
        let files = Self::at(data);
        create_folder(&files.files)?;
        if files.unfinished.exists() {
            fs::remove_dir_all(&files.unfinished)?;
        }
        create_folder(&files.unfinished)?;
        File::open(data)?.sync_all()?;
        Ok(files)
    }

    /// Files below `data`; changes nothing on the disk.
    pub(crate) fn at(data: &Path) -> Self {
        let (files, unfinished, swept) = (data.join("files"), data.join("unfinished"), data.join("swept"));
        Self { files, unfinished, swept, checked: Arc::default(), suspects: Arc::default(), damage: KnownDamage::default() }
    }

    /// Begins to receive a file.
    pub(crate) fn receive(&self) -> io::Result<Receiver> {
        Ok(Receiver { file: self.begin()?, hash: Sha256::new(), size_bytes: 0 })
    }

    /// Creates a temporary file. Not with tempfile's own function, which hides the error number, by which a shortage of file
    /// descriptors is distinguished from a missing disk.
    fn begin(&self) -> io::Result<NamedTempFile> {
        let path = self.unfinished.join(uuid::Uuid::now_v7().to_string());
        let create = || private_file().read(true).write(true).create_new(true).open(&path);
        let file = match create() {
            // Where the folder of the files is gone too, the disk is: nothing must be written below its mount point.
            Err(error) if error.kind() == io::ErrorKind::NotFound && self.files.is_dir() => {
                create_folder(&self.unfinished)?;
                create()?
            }
            created => created?,
        };
        Ok(NamedTempFile::from_parts(file, TempPath::try_from_path(path)?))
    }

    /// Writes a finished temporary file.
    pub(crate) fn write(&self, bytes: &[u8]) -> io::Result<Received> {
        let mut receiver = self.receive()?;
        receiver.write(bytes)?;
        let received = receiver.finish()?;
        failpoint::hit("artifact", "before_rename");
        Ok(received)
    }

    /// Renames a received file to its hash, in place of an existing file: that one may be damaged, also where a check that is not
    /// [`CHECK_LIFETIME`] old found it whole, and its readers keep it. Known damage of it is repaired.
    pub(crate) fn persist(&self, received: Received) -> Result<PathBuf, Error> {
        let path = self.path(&received.sha256);
        let folder = path.parent().unwrap_or(&self.files);
        create_folder(folder)?;
        received.file.persist(&path).map_err(|error| error.error)?;
        self.lock().remove(&received.sha256);
        File::open(folder)?.sync_all()?;
        File::open(&self.files)?.sync_all()?;
        self.damage.set(format!("file {}", received.sha256), None);
        Ok(path)
    }

    /// Path of the file with this hash. `sha256` comes from the store, never from a request.
    pub(crate) fn path(&self, sha256: &str) -> PathBuf {
        self.files.join(sha256.get(..2).unwrap_or_default()).join(sha256)
    }

    /// Opens a file for reading, after its bytes were compared with its hash. One whose bytes the disk does not give back is damaged too.
    /// A damaged one becomes a suspect.
    pub(crate) fn open_checked(&self, sha256: &str) -> Result<File, Error> {
        self.open_compared(sha256).inspect_err(|error| {
            if matches!(error, Error::FileDamaged { .. }) {
                self.suspect(sha256);
            }
        })
    }

    /// Opens a file as [`Self::open_checked`] does, without making it a suspect.
    pub(super) fn open_compared(&self, sha256: &str) -> Result<File, Error> {
        let damaged = |missing| Error::FileDamaged { sha256: sha256.to_owned(), missing };
        let mut file = match File::open(self.path(sha256)) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Err(damaged(true)),
            opened => opened?,
        };
        let about = file.metadata()?;
        let now = Checked { at: Instant::now(), size_bytes: about.len(), modified: about.modified().ok() };
        if self.is_checked(sha256, &now) {
            return Ok(file);
        }
        match hash_of(&mut file) {
            Ok(found) if found == sha256 => {}
            // A sector that cannot be read stays so until the file is written anew.
            Err(error) if !is_read_failure(&error) => return Err(error.into()),
            Ok(_) | Err(_) => {
                self.lock().remove(sha256);
                return Err(damaged(false));
            }
        }
        io::Seek::rewind(&mut file)?;
        let mut checked = self.lock();
        if checked.len() >= MAX_CHECKED {
            checked.clear();
        }
        checked.insert(sha256.to_owned(), now);
        Ok(file)
    }

    /// Remembers a file that somebody found damaged.
    pub(super) fn suspect(&self, sha256: &str) {
        let mut suspects = self.suspects.lock().unwrap_or_else(PoisonError::into_inner);
        if suspects.len() < MAX_SUSPECTS {
            suspects.insert(sha256.to_owned());
        }
    }

    /// Takes the files that were found damaged since the last time. Some may have been deleted or repaired since.
    pub(super) fn take_suspects(&self) -> BTreeSet<String> {
        std::mem::take(&mut *self.suspects.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn is_checked(&self, sha256: &str, now: &Checked) -> bool {
        self.lock().get(sha256).is_some_and(|before| {
            before.size_bytes == now.size_bytes && before.modified == now.modified && before.at.elapsed() < CHECK_LIFETIME
        })
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, HashMap<String, Checked>> {
        // Entries are inserted whole, so a poisoned lock is usable.
        self.checked.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Bytes of a file, after they were compared with its hash.
    pub(crate) fn read(&self, sha256: &str) -> Result<Vec<u8>, Error> {
        let mut bytes = Vec::new();
        self.open_checked(sha256)?.read_to_end(&mut bytes).map_err(|error| self.read_error(sha256, error))?;
        Ok(bytes)
    }

    /// Error of a file that was opened and could not be read: it is damaged where the disk does not give it back, whatever was found
    /// before, and is compared anew when it is next opened.
    pub(crate) fn read_error(&self, sha256: &str, error: io::Error) -> Error {
        if !is_read_failure(&error) {
            return error.into();
        }
        self.lock().remove(sha256);
        self.suspect(sha256);
        Error::FileDamaged { sha256: sha256.to_owned(), missing: false }
    }

    /// Removes a file; returns its size, 0 if there was none.
    pub(crate) fn remove(&self, sha256: &str) -> io::Result<u64> {
        let path = self.path(sha256);
        let size_bytes = fs::symlink_metadata(&path).map_or(0, |about| about.len());
        ignore_absent(fs::remove_file(path))?;
        Ok(size_bytes)
    }

    /// Moves a file to the folder of swept files, from where it can still be restored.
    pub(crate) fn sweep(&self, sha256: &str) -> io::Result<()> {
        create_folder(&self.swept)?;
        let swept = self.swept.join(sha256);
        ignore_absent(fs::rename(self.path(sha256), &swept))?;
        // Its age there counts from now.
        ignore_absent(File::open(swept).and_then(|file| file.set_modified(SystemTime::now())))
    }

    /// Lists the files of the store. Files without such a name, which file managers leave there, are left out.
    pub(crate) fn list(&self) -> io::Result<Vec<StoredFile>> {
        let mut found = Vec::new();
        for folder in self.folders()? {
            if folder.file_name().and_then(|name| name.to_str()).is_some_and(|name| is_hex(name, FOLDER_DIGITS)) {
                found.extend(list_folder(&folder)?);
            }
        }
        Ok(found)
    }

    /// Returns true if no folder has anything in it, whatever its name.
    pub(crate) fn is_empty(&self) -> io::Result<bool> {
        for folder in self.folders()? {
            if fs::read_dir(folder)?.next().is_some() {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Folders that files lie in.
    pub(super) fn folders(&self) -> io::Result<Vec<PathBuf>> {
        folders(&self.files)
    }

    /// Lists the swept files.
    pub(crate) fn list_swept(&self) -> io::Result<Vec<StoredFile>> {
        list_folder(&self.swept)
    }

    /// Total size of the swept files.
    pub(crate) fn swept_bytes(&self) -> io::Result<u64> {
        let mut bytes = 0;
        for entry in read_dir(&self.swept)? {
            // A file may be removed after it was listed.
            bytes += entry?.metadata().map_or(0, |about| about.len());
        }
        Ok(bytes)
    }

    /// Removes a swept file for good.
    pub(crate) fn remove_swept(&self, sha256: &str) -> io::Result<()> {
        ignore_absent(fs::remove_file(self.swept.join(sha256)))
    }

    /// Checks that a file can be written and synced.
    pub(crate) fn probe(&self) -> io::Result<()> {
        self.try_to_write(b"probe")
    }

    /// Checks that there is room for a file of the size of what the database writes at a time.
    pub(crate) fn probe_room(&self) -> io::Result<()> {
        self.try_to_write(&[b'x'; PROBED_BYTES])
    }

    fn try_to_write(&self, bytes: &[u8]) -> io::Result<()> {
        let mut file = self.begin()?;
        file.as_file_mut().write_all(bytes)?;
        file.as_file().sync_all()
    }
}

/// Entries of a folder; none if it does not exist.
fn read_dir(folder: &Path) -> io::Result<Box<dyn Iterator<Item = io::Result<fs::DirEntry>>>> {
    match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Box::new(std::iter::empty())),
        entries => Ok(Box::new(entries?)),
    }
}

/// Folders in a folder; none if it does not exist.
pub(super) fn folders(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in read_dir(folder)? {
        let path = entry?.path();
        match fs::metadata(&path) {
            Ok(about) if about.is_dir() => found.push(path),
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            Ok(_) | Err(_) => {}
        }
    }
    Ok(found)
}

/// Creates a folder, and those above it, that are missing; only the owner may enter them.
pub(super) fn create_folder(folder: &Path) -> io::Result<()> {
    let mut builder = DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.recursive(true).create(folder)
}

/// Options that create a file that only the owner may read.
pub(super) fn private_file() -> OpenOptions {
    let mut options = File::options();
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options
}

/// Returns true for so many digits of a hash, lower-case hexadecimal.
fn is_hex(name: &str, length: usize) -> bool {
    name.len() == length && name.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'))
}

fn list_folder(folder: &Path) -> io::Result<Vec<StoredFile>> {
    let mut found = Vec::new();
    for entry in read_dir(folder)? {
        let entry = entry?;
        // A file may be removed after it was listed.
        let (Ok(about), Ok(sha256)) = (entry.metadata(), entry.file_name().into_string()) else { continue };
        if !is_hex(&sha256, NAME_DIGITS) {
            continue;
        }
        found.push(StoredFile { sha256, modified: about.modified()? });
    }
    Ok(found)
}

fn ignore_absent(result: io::Result<()>) -> io::Result<()> {
    match result {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// SHA-256 of a file's bytes from the current position on.
fn hash_of(file: &mut File) -> io::Result<String> {
    let (mut hash, mut piece) = (Sha256::new(), vec![0; PIECE_BYTES]);
    loop {
        match file.read(&mut piece)? {
            0 => return Ok(hex(&hash.finalize())),
            count => hash.update(&piece[..count]),
        }
    }
}

impl Receiver {
    /// Appends `bytes`.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hash.update(bytes);
        self.size_bytes += bytes.len() as u64;
        self.file.as_file_mut().write_all(bytes)
    }

    /// Syncs the received file.
    pub(crate) fn finish(self) -> io::Result<Received> {
        self.file.as_file().sync_all()?;
        Ok(Received { file: self.file, sha256: hex(&self.hash.finalize()), size_bytes: self.size_bytes })
    }
}
