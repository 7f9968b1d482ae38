//! Content-addressed files: a file's name is the SHA-256 of its bytes, so it never changes and is never half there.
//! Written as temporary file → fsync → rename → fsync of the directory. All of this blocks.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;

use crate::service::error::{Error, Fault};
use crate::service::failpoint;

/// The folder of content-addressed files and the one of unfinished ones, on the same file system.
#[derive(Clone, Debug)]
pub(crate) struct Files {
    files: PathBuf,
    unfinished: PathBuf,
}

/// A finished file that has no name yet; gone when dropped.
pub(crate) struct Received {
    /// Its bytes, synced.
    pub file: NamedTempFile,
    /// SHA-256, lower-case hexadecimal.
    pub sha256: String,
    /// Its size.
    pub size_bytes: u64,
}

/// A file being received, hashed as it comes.
pub(crate) struct Receiver {
    file: NamedTempFile,
    hash: Sha256,
    size_bytes: u64,
}

impl Files {
    /// Opens the folders below `data`, and clears what an earlier process left unfinished.
    pub(crate) fn open(data: &Path) -> io::Result<Self> {
        let (files, unfinished) = (data.join("files"), data.join("unfinished"));
        fs::create_dir_all(&files)?;
        if unfinished.exists() {
            fs::remove_dir_all(&unfinished)?;
        }
        fs::create_dir_all(&unfinished)?;
        File::open(data)?.sync_all()?;
        Ok(Self { files, unfinished })
    }

    /// Begins to receive a file.
    pub(crate) fn receive(&self) -> io::Result<Receiver> {
        Ok(Receiver { file: NamedTempFile::new_in(&self.unfinished)?, hash: Sha256::new(), size_bytes: 0 })
    }

    /// Stores `bytes`; returns their SHA-256.
    pub(crate) fn put(&self, bytes: &[u8]) -> io::Result<String> {
        let mut receiver = self.receive()?;
        receiver.write(bytes)?;
        let received = receiver.finish()?;
        failpoint::hit("artifact", "before_rename");
        let sha256 = received.sha256.clone();
        self.adopt(received)?;
        Ok(sha256)
    }

    /// Gives a received file its name. A file that is there already stays as it is.
    pub(crate) fn adopt(&self, received: Received) -> io::Result<PathBuf> {
        let path = self.path(&received.sha256);
        let folder = path.parent().unwrap_or(&self.files);
        if !path.exists() {
            fs::create_dir_all(folder)?;
            received.file.persist(&path).map_err(|e| e.error)?;
        }
        // Also for a file that was there: another upload may have named it and not come to this line yet.
        File::open(folder)?.sync_all()?;
        File::open(&self.files)?.sync_all()?;
        Ok(path)
    }

    /// Where the file with this hash is. `sha256` comes from the store, never from a request.
    pub(crate) fn path(&self, sha256: &str) -> PathBuf {
        self.files.join(sha256.get(..2).unwrap_or_default()).join(sha256)
    }

    /// The bytes of a file, checked against its name.
    pub(crate) fn read(&self, sha256: &str) -> Result<Vec<u8>, Error> {
        let bytes = fs::read(self.path(sha256))?;
        if hex(&Sha256::digest(&bytes)) == sha256 { Ok(bytes) } else { Err(Fault::Damaged(sha256.to_owned()).into()) }
    }

    /// Removes a file that nothing refers to any more.
    pub(crate) fn remove(&self, sha256: &str) -> io::Result<()> {
        match fs::remove_file(self.path(sha256)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        }
    }

    /// Hashes of all files.
    pub(crate) fn list(&self) -> io::Result<Vec<String>> {
        let mut names = Vec::new();
        for folder in fs::read_dir(&self.files)? {
            for file in fs::read_dir(folder?.path())? {
                names.extend(file?.file_name().into_string());
            }
        }
        Ok(names)
    }

    /// Whether a file can be written and synced now.
    pub(crate) fn probe(&self) -> io::Result<()> {
        let mut file = NamedTempFile::new_in(&self.unfinished)?;
        file.write_all(b"probe")?;
        file.as_file().sync_all()
    }
}

impl Receiver {
    /// Appends `bytes`.
    pub(crate) fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hash.update(bytes);
        self.size_bytes += bytes.len() as u64;
        self.file.write_all(bytes)
    }

    /// Syncs what was received.
    pub(crate) fn finish(self) -> io::Result<Received> {
        self.file.as_file().sync_all()?;
        Ok(Received { file: self.file, sha256: hex(&self.hash.finalize()), size_bytes: self.size_bytes })
    }
}

/// Lower-case hexadecimal.
pub(crate) fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write;
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
