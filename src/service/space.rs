//! Free space on the store's disk. A part of it is reserved for running jobs: on a full disk, new uploads and jobs are
//! refused first.

use std::io;
use std::path::Path;

use super::app::App;
use super::error::Error;

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
}
