//! Size of a job, by which it is decided what may run beside it: the estimate of its plan, made from the same input before the job
//! is started.

use std::sync::Arc;

use super::cells::KeptCells;
use super::planner::{JobError, JobInput, MeshSource, opened_with};
use crate::planning::{Estimate, PlanInput};

/// Memory and time that a job takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JobSize {
    /// Seconds of one core.
    pub core_secs: f64,
    /// Bytes held at once.
    pub bytes: f64,
}

/// The function that tells a job's size: [`size_of`], or a test's replacement.
pub type Sizer = Arc<dyn Fn(&JobInput, &dyn Fn() -> bool) -> JobSize + Send + Sync>;

impl JobSize {
    /// Size of a job that is not known: as large as any.
    pub const UNKNOWN: Self = Self { core_secs: f64::INFINITY, bytes: f64::INFINITY };
    /// Size of a job that fails with the reason as soon as it is started.
    pub const NOTHING: Self = Self { core_secs: 0.0, bytes: 0.0 };
}

/// Size of a job on `threads` threads: reads its meshes and builds its cell unless `cells` has it; stops once `stop` returns true. A mesh
/// that is temporarily unreadable is not waited for, since other jobs wait for the size.
pub(super) fn size_of(input: &JobInput, cells: &KeptCells, threads: usize, stop: &dyn Fn() -> bool) -> JobSize {
    let read = |source: &MeshSource, pointer: &str| source.read(pointer, input.max_triangles, stop);
    let (part, hardware) = match opened_with(&read, input, cells) {
        Ok(opened) => opened,
        Err(JobError::Cancelled | JobError::Unavailable(_) | JobError::Unread(_)) => return JobSize::UNKNOWN,
        Err(JobError::BadInput(_) | JobError::PartRefused { .. } | JobError::NoPlan { .. } | JobError::Damaged(_)) => {
            return JobSize::NOTHING;
        }
    };
    let params = input.params.preset.apply(&input.params);
    let plan = PlanInput {
        mesh: &part.mesh,
        fixture: part.fixture.as_ref(),
        part_sha256: &input.mesh.sha256,
        scanner: hardware.scanner(),
        cell: hardware.cell(),
        roadmaps: None,
    };
    let estimate = Estimate::of(&plan, &params, threads);
    JobSize { core_secs: estimate.core_secs.sum(), bytes: estimate.bytes.sum() }
}

#[cfg(test)]
mod tests;
