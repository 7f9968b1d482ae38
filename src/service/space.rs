//! Free space on the store's disk. A part of it is reserved for running jobs: on a full disk, new uploads and jobs are
//! refused first. What cancels and deletes has room even then: a file is kept, the reserve, that is given up for it, and filled again
//! with what is left as soon as that is done.

use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError};
use std::time::Instant;

use super::app::App;
use super::error::Error;
use super::planner::Artifact;
use super::store::{RESERVE, StoredArtifacts, blocking};

/// Max size of the reserve: room for the write-ahead log, and for what its checkpoint adds to the database.
const MAX_RESERVE_BYTES: u64 = 16 << 20;
/// Min size of the reserve: room for what the database writes to delete a job.
const MIN_RESERVE_BYTES: u64 = 1 << 20;
/// Part of the reserve that is given up first: room for what the database writes to cancel a job, several times over. Our choice.
const STEP_BYTES: u64 = 256 << 10;
/// Bytes of the reserve that are written at a time, and the least that it grows by before it is whole.
pub(super) const PIECE_BYTES: u64 = 1 << 16;

/// Free and total space of a disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct DiskSpace {
    /// Space available to this process.
    pub free_bytes: u64,
    /// Total space.
    pub total_bytes: u64,
}

/// Space of the disk that holds `folder`.
pub(super) fn space_at(folder: &Path) -> io::Result<DiskSpace> {
    let about = rustix::fs::statvfs(folder)?;
    let bytes = |blocks: u64| blocks.saturating_mul(about.f_frsize);
    Ok(DiskSpace { free_bytes: bytes(about.f_bavail), total_bytes: bytes(about.f_blocks) })
}

/// Returns true if two folders lie on one disk; false if one of them cannot be looked at.
pub(super) fn share_a_disk(one: &Path, other: &Path) -> bool {
    let device = |folder: &Path| rustix::fs::stat(folder).map(|about| about.st_dev).ok();
    device(one).is_some_and(|one| device(other) == Some(one))
}

impl App {
    /// Space of the store's disk, and the floor of free space in bytes: the smaller of two settings, so that small disks can be used too.
    pub(super) fn space(&self) -> Result<(DiskSpace, u64), Error> {
        let options = &self.0.options;
        let space = space_at(&options.data_dir)?;
        let share = (space.total_bytes as f64 * options.min_free_share) as u64;
        Ok((space, options.min_free_bytes.min(share)))
    }

    /// Refuses `wanted_bytes` that would leave less than the floor on the disk.
    pub(super) fn check_space(&self, wanted_bytes: u64) -> Result<(), Error> {
        let (space, floor_bytes) = self.space()?;
        if space.free_bytes < floor_bytes.saturating_add(wanted_bytes) {
            return Err(Error::StorageLow { free_bytes: space.free_bytes, floor_bytes });
        }
        Ok(())
    }

    fn reserve(&self) -> PathBuf {
        self.0.options.data_dir.join(RESERVE)
    }

    /// Size of the reserve as it is, and as it is to be.
    fn reserve_sizes(&self) -> Result<(u64, u64), Error> {
        let (_, floor_bytes) = self.space()?;
        // What is no file holds nothing that can be given up.
        let kept = fs::metadata(self.reserve()).ok().filter(fs::Metadata::is_file);
        Ok((kept.map_or(0, |about| about.len()), reserve_bytes(floor_bytes)))
    }

    /// Room that the disk has once the reserve is given up, bytes.
    pub(super) fn room_bytes(&self) -> u64 {
        let kept_bytes = self.reserve_sizes().map_or(0, |(kept_bytes, _)| kept_bytes);
        self.space().map_or(0, |(space, _)| space.free_bytes.saturating_add(kept_bytes))
    }

    fn is_reserve_whole(&self) -> bool {
        self.reserve_sizes().is_ok_and(|(kept_bytes, wanted_bytes)| kept_bytes >= wanted_bytes)
    }

    /// Fills the reserve as far as the disk has room for it, whatever the floor of free space is: without it, nothing can be deleted
    /// on a full disk.
    pub(super) async fn keep_reserve(&self) -> Result<(), Error> {
        if self.is_reserve_whole() {
            return Ok(());
        }
        let _turn = self.0.reserve.lock().await;
        self.fill_reserve().await
    }

    async fn fill_reserve(&self) -> Result<(), Error> {
        let ((kept_bytes, wanted_bytes), (space, _)) = (self.reserve_sizes()?, self.space()?);
        let missing_bytes = wanted_bytes.saturating_sub(kept_bytes);
        // Not to the last byte: the next small write would ask for the reserve again.
        let more_bytes = space.free_bytes.saturating_sub(wanted_bytes / 8).min(missing_bytes);
        if more_bytes == 0 || more_bytes < PIECE_BYTES.min(missing_bytes) {
            return Ok(());
        }
        let path = self.reserve();
        blocking(move || Ok(lengthen(&path, kept_bytes, more_bytes, noise)?)).await
    }

    /// Stores the files of results, where the disk has room for all of them beside the reserve. While it has none, the error is a
    /// transient one.
    pub(super) async fn put_results(&self, files: Arc<Vec<Artifact>>) -> Result<StoredArtifacts, Error> {
        self.check_room_for_results().await?;
        let app = self.clone();
        // Tried all the same, they would fill the disk each time, and what others write meanwhile would fail.
        let check_room = move |new_bytes| check_room_for(new_bytes, app.space()?.0);
        self.0.store.put_artifacts_if(files, check_room).await
    }

    /// Refuses results while the reserve is not whole and less than the floor is free: on a disk that is so full, room is for what
    /// frees more.
    async fn check_room_for_results(&self) -> Result<(), Error> {
        if let Err(error) = self.keep_reserve().await {
            self.warn_of_reserve(&error);
        }
        if self.is_reserve_whole() { Ok(()) } else { self.check_space(0) }
    }

    /// Result of a change, told as a full disk where a quota is exhausted: the database tells that as any write that failed.
    pub(super) async fn told_full<T>(&self, done: Result<T, Error>) -> Result<T, Error> {
        let error = match done {
            Err(error) if error.may_be_over_quota() => error,
            done => return done,
        };
        let files = self.0.store.files().clone();
        Err(error.or_full(blocking(move || Ok(files.probe_room()?)).await))
    }

    /// Does what cancels or deletes; once more without the reserve where the disk is full. What it frees goes to the reserve first.
    pub(super) async fn freeing<T, F: Future<Output = Result<T, Error>>>(&self, work: impl Fn() -> F) -> Result<T, Error> {
        let done = self.with_reserve(work).await?;
        if let Err(error) = self.keep_reserve().await {
            self.warn_of_reserve(&error);
        }
        Ok(done)
    }

    /// Does a small change; on a full disk once more without a part of the reserve, then without any, and at last with the write-ahead log
    /// emptied too. What it leaves of the reserve is kept for the next.
    pub(super) async fn with_reserve<T, F: Future<Output = Result<T, Error>>>(&self, work: impl Fn() -> F) -> Result<T, Error> {
        match self.told_full(work().await).await {
            Err(Error::StorageFull) => {}
            done => return done,
        }
        // One at a time: another finds what this one leaves.
        let _turn = self.0.reserve.lock().await;
        let is_full = |done: &Result<T, Error>| matches!(done, Err(Error::StorageFull));
        let mut done = Err(Error::StorageFull);
        // Whatever else fills the disk takes its share of each byte that is given up.
        if self.shorten_reserve() {
            done = self.told_full(work().await).await;
        }
        if is_full(&done) && self.give_up_reserve() {
            done = self.told_full(work().await).await;
            // Last, since the log may need more room in the database than there is, and would leave none for the change.
            if is_full(&done) {
                self.empty_log().await;
                done = self.told_full(work().await).await;
            }
        }
        if let Err(error) = self.fill_reserve().await {
            self.warn_of_reserve(&error);
        }
        done
    }

    /// Gives up a part of the reserve; false if it is no larger than that.
    fn shorten_reserve(&self) -> bool {
        let Ok(file) = OpenOptions::new().write(true).open(self.reserve()) else { return false };
        let kept_bytes = file.metadata().map_or(0, |about| about.len());
        kept_bytes > STEP_BYTES && file.set_len(kept_bytes - STEP_BYTES).is_ok()
    }

    /// Gives up the reserve; false if there is none.
    fn give_up_reserve(&self) -> bool {
        let is_given_up = fs::remove_file(self.reserve()).is_ok();
        if is_given_up {
            tracing::warn!("the disk is full; the room that was kept for cancelling and deleting is given up");
        }
        is_given_up
    }

    /// Tells the log that the reserve is not whole; now and then, since each attempt to store results finds it so.
    fn warn_of_reserve(&self, error: &Error) {
        let times = self.0.unkept_reserve.lock().unwrap_or_else(PoisonError::into_inner).count(Instant::now());
        if let Some(times) = times {
            tracing::warn!(times, error = error as &dyn std::error::Error, "no room is kept for deleting on a full disk");
        }
    }

    /// Empties the write-ahead log of the database.
    async fn empty_log(&self) {
        if let Err(error) = self.0.store.checkpoint().await {
            tracing::warn!(error = &error as &dyn std::error::Error, "the write-ahead log of the database cannot be emptied");
        }
    }
}

/// Refuses files that are larger than the free space.
fn check_room_for(new_bytes: u64, space: DiskSpace) -> Result<(), Error> {
    if new_bytes > space.free_bytes { Err(Error::StorageFull) } else { Ok(()) }
}

/// Size of the reserve beside a floor of free space: half of that, within limits.
fn reserve_bytes(floor_bytes: u64) -> u64 {
    (floor_bytes / 2).clamp(MIN_RESERVE_BYTES, MAX_RESERVE_BYTES)
}

/// Adds bytes to the end of a file. Where a disk that somebody else fills meanwhile has no room for all of them, half of those that it
/// took are kept: without any, nothing can be deleted.
fn lengthen(path: &Path, kept_bytes: u64, more_bytes: u64, fill: impl Fn(&mut [u8]) -> io::Result<()>) -> io::Result<()> {
    let mut file = OpenOptions::new().append(true).create(true).open(path)?;
    let mut piece = [0; PIECE_BYTES as usize];
    let mut left = more_bytes;
    while left > 0 {
        let bytes = left.min(PIECE_BYTES);
        let piece = &mut piece[..bytes as usize];
        if let Err(error) = fill(piece).and_then(|()| file.write_all(piece)) {
            file.set_len(kept_bytes + (more_bytes - left) / 2)?;
            return Err(error);
        }
        left -= bytes;
    }
    Ok(())
}

/// Fills bytes with noise: zeros take no room on a file system that compresses.
fn noise(bytes: &mut [u8]) -> io::Result<()> {
    getrandom::fill(bytes).map_err(|error| io::Error::other(error.to_string()))
}

#[cfg(test)]
mod tests;
