//! Single views of one surface, one after the other or side by side: samples and buffers are made once for all of them.

use std::sync::{Mutex, MutexGuard, PoisonError};

use super::{Optics, QualityScale, RasterEngine, Row, Scratch};
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::planning::context::{Cancelled, Context};
use crate::planning::surface::Surface;
use crate::planning::visibility::{Occluders, SampleSet};

/// The engine with the buffers that threads borrow while they work on a view.
pub(in crate::planning::visibility) struct OneByOne<'a> {
    engine: RasterEngine<'a>,
    free: Mutex<Vec<Scratch>>,
}

impl<'a> OneByOne<'a> {
    pub(in crate::planning::visibility) fn new(
        surface: &'a Surface,
        optics: &'a Optics,
        quality_scale: Option<QualityScale>,
        occluders: &'a Occluders,
        ctx: &'a Context<'a>,
    ) -> Self {
        Self { engine: RasterEngine::new(surface, optics, quality_scale, occluders, ctx), free: Mutex::default() }
    }

    /// Samples outside `known` that a view measures. With `is_shared` the threads share its samples.
    pub(in crate::planning::visibility) fn row(
        &self,
        pose: &Pose<Part, ScannerFrame>,
        known: &SampleSet,
        is_shared: bool,
    ) -> Result<Row, Cancelled> {
        let open = self.engine.samples.outside(known);
        let mut scratch = self.lock().pop().unwrap_or_else(|| self.engine.scratch());
        let row = self.engine.row(pose, &open, &mut scratch, if is_shared { 1 } else { usize::MAX })?;
        self.lock().push(scratch);
        Ok(row)
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Scratch>> {
        self.free.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
