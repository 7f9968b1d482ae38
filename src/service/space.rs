//! Free space on the store's disk, and how much of it is kept for jobs that run: when the disk is full, what is refused is
//! what has not begun.

use std::io;
use std::path::Path;

use super::app::App;
use super::error::Error;

/// Room on a disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Space {
    /// Free to this process.
    pub free_bytes: u64,
    /// In all.
    pub total_bytes: u64,
}

/// The room on the disk that `folder` lies on.
pub(super) fn space_at(folder: &Path) -> io::Result<Space> {
    let about = rustix::fs::statvfs(folder)?;
    let bytes = |blocks: u64| blocks.saturating_mul(about.f_frsize);
    Ok(Space { free_bytes: bytes(about.f_bavail), total_bytes: bytes(about.f_blocks) })
}

impl App {
    /// Room on the store's disk, and the free space that is kept: the smaller of two settings, so that small disks are
    /// of use too.
    pub(super) fn space(&self) -> Result<(Space, u64), Error> {
        let options = &self.0.options;
        let space = space_at(&options.data_dir)?;
        let share = (space.total_bytes as f64 * options.min_free_share) as u64;
        Ok((space, options.min_free_bytes.min(share)))
    }

    /// Refuses what would leave less than the floor on the disk.
    pub(super) fn check_space(&self, wanted_bytes: u64) -> Result<(), Error> {
        let (space, floor_bytes) = self.space()?;
        if space.free_bytes < floor_bytes.saturating_add(wanted_bytes) {
            return Err(Error::StorageLow { free_bytes: space.free_bytes, floor_bytes });
        }
        Ok(())
    }
}
