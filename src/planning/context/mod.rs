//! The surroundings of a running plan: its cancel flag, the observer of its progress, its limits, and the errors that end it.
//! No clock: an observer that wants stage times measures them itself.

use std::sync::atomic::{AtomicBool, Ordering};

mod error;
mod refusal;

pub use error::{NoPlan, PlanError};
pub(super) use refusal::Refusal;

use crate::cell::closed_list;
use crate::geometry::{Interrupted, SimdLevel};

closed_list! {
    /// The stages of a job, in order.
    pub enum Stage {
        /// Files of meshes to meshes.
        Reading = "reading",
        /// Mesh to patches and samples, with the structures that rays need.
        Surface = "surface",
        /// Cell, part and fixture to what collisions are tested with.
        CollisionScene = "collision_scene",
        /// Patches to viewpoints.
        Candidates = "candidates",
        /// Viewpoints to stations of the cell.
        Stations = "stations",
        /// Viewpoints to the table of what each measures.
        Visibility = "visibility",
        /// The table to chosen views.
        Selection = "selection",
        /// The cell to places that its arm can go to, and the edges between them.
        Roadmap = "roadmap",
        /// Stations to an order and joint paths.
        Sequence = "sequence",
        /// Causes of the area that is missed, and remedies.
        Missed = "missed",
        /// Coverage of the chosen views on other samples, and with poses that are off.
        Certificate = "certificate",
        /// The sets that views were chosen from to the bound of their number, as far as it is not known yet: it is computed beside the
        /// stages since the choice.
        Bound = "bound",
        /// The outcome to files.
        Report = "report",
    }
}

/// Observes the progress of a plan. Called from pool threads.
pub trait Observer: Sync {
    /// `stage` begins (again, when selection and sequence repeat).
    fn begin(&self, stage: Stage);
    /// `done` of `total` units of the running stage are finished. Calls may come out of order.
    fn progress(&self, done: usize, total: usize);
    /// A stage begins within the running one, or has ended if it is `None`.
    fn within(&self, _: Option<Stage>) {}
}

/// An observer that listens to nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Observer for Silent {
    fn begin(&self, _: Stage) {}
    fn progress(&self, _: usize, _: usize) {}
}

/// The job was cancelled.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

impl From<Interrupted> for Cancelled {
    fn from(_: Interrupted) -> Self {
        Self
    }
}

/// Limits of memory and time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Allowance {
    /// Bytes held at once.
    pub bytes: f64,
    /// Seconds of one core.
    pub core_secs: f64,
}

impl Default for Allowance {
    /// An allowance without limits.
    fn default() -> Self {
        Self { bytes: f64::INFINITY, core_secs: f64::INFINITY }
    }
}

/// Cancel flag, observer, vector instructions and limits of one plan.
pub struct Context<'a> {
    cancel: &'a AtomicBool,
    observer: &'a dyn Observer,
    simd_level: SimdLevel,
    allowance: Allowance,
}

impl<'a> Context<'a> {
    /// A context that stops once `cancel` is true.
    #[must_use]
    pub fn new(cancel: &'a AtomicBool, observer: &'a dyn Observer) -> Self {
        Self { cancel, observer, simd_level: SimdLevel::widest(), allowance: Allowance::default() }
    }

    /// Sets the vector instructions, which change how fast a plan is made and nothing else.
    #[must_use]
    pub fn with_simd_level(self, simd_level: SimdLevel) -> Self {
        Self { simd_level, ..self }
    }

    /// Makes a context for a plan that is refused, before anything is allocated for it, if it would take more.
    #[must_use]
    pub fn with_allowance(self, allowance: Allowance) -> Self {
        Self { allowance, ..self }
    }

    /// Limits of memory and time of the plan.
    pub(super) fn allowance(&self) -> &Allowance {
        &self.allowance
    }

    /// Returns a context for a detail of the running stage: it stops as this one does and reports no progress.
    #[must_use]
    pub fn silent(&self) -> Self {
        Self { observer: &Silent, ..*self }
    }

    /// The vector instructions to use.
    #[must_use]
    pub fn simd_level(&self) -> SimdLevel {
        self.simd_level
    }

    /// Does the work of a stage, which lasts until the next one begins, and tells the observer before.
    ///
    /// # Errors
    /// [`Cancelled`]; the errors of the work.
    pub fn stage<T, E: From<Cancelled>>(&self, stage: Stage, work: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        self.check()?;
        self.observer.begin(stage);
        work()
    }

    /// Does the work of a stage that belongs within the running one, which goes on afterwards.
    pub fn within<T>(&self, stage: Stage, work: impl FnOnce() -> T) -> T {
        self.observer.within(Some(stage));
        let done = work();
        self.observer.within(None);
        done
    }

    /// Tells the observer how far the stage is.
    pub fn progress(&self, done: usize, total: usize) {
        self.observer.progress(done, total);
    }

    /// Every loop asks this at least every 10 ms.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn check(&self) -> Result<(), Cancelled> {
        if self.cancel.load(Ordering::Relaxed) { Err(Cancelled) } else { Ok(()) }
    }
}
