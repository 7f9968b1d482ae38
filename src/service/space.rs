//! Free space on the store's disk. A part of it is reserved for running jobs: on a full disk, new uploads and jobs are
//! refused first. What cancels and deletes has room even then: a file is kept that is given up for it.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::app::App;
use super::error::Error;
use super::store::RESERVE;

/// Size of the file that is given up on a full disk: room for what the database writes to delete a job.
const RESERVE_BYTES: usize = 1 << 20;

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

/// True if two folders lie on one disk; false if one of them cannot be looked at.
pub(super) fn share_a_disk(one: &Path, other: &Path) -> bool {
    let device = |folder: &Path| rustix::fs::stat(folder).map(|about| about.st_dev).ok();
    device(one).is_some_and(|one| device(other) == Some(one))
}

impl App {
    /// Space of the store's disk, and the reserve in bytes: the smaller of two settings, so that small disks can be used too.
    pub(super) fn space(&self) -> Result<(DiskSpace, u64), Error> {
        let options = &self.0.options;
        let space = space_at(&options.data_dir)?;
        let share = (space.total_bytes as f64 * options.min_free_share) as u64;
        Ok((space, options.min_free_bytes.min(share)))
    }

    /// Refuses `wanted_bytes` that would leave less than the reserve on the disk.
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

    /// Keeps the reserve, where the disk has room for it.
    pub(super) fn keep_reserve(&self) {
        let path = self.reserve();
        let is_whole = fs::metadata(&path).is_ok_and(|about| about.len() == RESERVE_BYTES as u64);
        if is_whole || self.check_space(RESERVE_BYTES as u64).is_err() {
            return;
        }
        // Zeros take no room on a file system that compresses.
        let mut bytes = vec![0; RESERVE_BYTES];
        if getrandom::fill(&mut bytes).is_err() {
            return;
        }
        if let Err(error) = fs::write(&path, bytes) {
            tracing::warn!(error = &error as &dyn std::error::Error, "no room is kept for deleting on a full disk");
            // What there is of it is of no use.
            let _ = fs::remove_file(&path);
        }
    }

    /// Does what cancels or deletes; once more without the reserve where the disk is full.
    pub(super) async fn freeing<T, F: Future<Output = Result<T, Error>>>(&self, work: impl Fn() -> F) -> Result<T, Error> {
        match work().await {
            Err(Error::StorageFull) if fs::remove_file(self.reserve()).is_ok() => {
                tracing::warn!("the disk is full; the room that was kept for cancelling and deleting is given up");
                work().await
            }
            done => done,
        }
    }
}
