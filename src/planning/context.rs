//! The surroundings of a running plan: its cancel flag, and the observer of its progress. No clock: an observer that
//! wants stage times measures them in the observer.

use std::sync::atomic::{AtomicBool, Ordering};

use super::estimate::Allowance;
use super::sequence::Roadmaps;
use crate::geometry::{Interrupted, SimdLevel};

/// The stages of a plan, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// Mesh to patches and samples, with the structures that rays need.
    Surface,
    /// Patches to viewpoints.
    Candidates,
    /// Viewpoints to stations of the cell.
    Stations,
    /// Viewpoints to the table of what each measures.
    Visibility,
    /// The table to chosen views.
    Selection,
    /// Stations to an order and joint paths.
    Sequence,
    /// Causes of the area that is missed, and remedies.
    Missed,
    /// Coverage of the chosen views on other samples, and with poses that are off.
    Certificate,
    /// The outcome to files.
    Report,
}

impl Stage {
    /// Every stage, in order.
    pub const ALL: [Self; 9] = [
        Self::Surface,
        Self::Candidates,
        Self::Stations,
        Self::Visibility,
        Self::Selection,
        Self::Sequence,
        Self::Missed,
        Self::Certificate,
        Self::Report,
    ];

    /// Name in files and events.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Surface => "surface",
            Self::Candidates => "candidates",
            Self::Stations => "stations",
            Self::Visibility => "visibility",
            Self::Selection => "selection",
            Self::Sequence => "sequence",
            Self::Missed => "missed",
            Self::Certificate => "certificate",
            Self::Report => "report",
        }
    }
}

/// Observes the progress of a plan. Called from pool threads.
pub trait Observer: Sync {
    /// `stage` begins (again, when selection and sequence repeat).
    fn begin(&self, stage: Stage);
    /// `done` of `total` units of the running stage are finished. Calls may come out of order.
    fn progress(&self, done: usize, total: usize);
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

/// Cancel flag, observer, vector instructions, what was kept of earlier plans and what may be taken, for one plan.
pub struct Context<'a> {
    cancel: &'a AtomicBool,
    observer: &'a dyn Observer,
    simd_level: SimdLevel,
    roadmaps: Option<&'a Roadmaps>,
    allowance: Allowance,
}

impl<'a> Context<'a> {
    /// A context that stops once `cancel` is true.
    #[must_use]
    pub fn new(cancel: &'a AtomicBool, observer: &'a dyn Observer) -> Self {
        Self { cancel, observer, simd_level: SimdLevel::widest(), roadmaps: None, allowance: Allowance::default() }
    }

    /// Sets the vector instructions, which change how fast a plan is made and nothing else.
    #[must_use]
    pub fn with_simd_level(self, simd_level: SimdLevel) -> Self {
        Self { simd_level, ..self }
    }

    /// Adds roadmaps of cells that were planned for before, which change how fast a plan is made and nothing else.
    #[must_use]
    pub fn with_roadmaps(self, roadmaps: &'a Roadmaps) -> Self {
        Self { roadmaps: Some(roadmaps), ..self }
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

    /// Roadmaps of cells that were planned for before.
    pub(super) fn roadmaps(&self) -> Option<&Roadmaps> {
        self.roadmaps
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

    /// Tells the observer that `stage` begins.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn begin(&self, stage: Stage) -> Result<(), Cancelled> {
        self.check()?;
        self.observer.begin(stage);
        Ok(())
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
