//! Demand of a further round of views: what is still to be measured of a part that was planned, and how often the scanner returns what
//! it sees. Samples are those of the plan, whose parameters give the same ones again.

use std::sync::Arc;

use crate::cell::closed_list;
use crate::planning::context::{PlanError, Refusal};
use crate::planning::ids::SampleId;
use crate::planning::plan::Outcome;
use crate::planning::surface::Surface;
use crate::planning::visibility::{SampleSet, SightLine};

/// Samples that are still to be measured, and the rules for further views.
#[derive(Clone, Copy)]
pub struct Demand<'a> {
    /// Samples still to be measured.
    pub open: &'a SampleSet,
    /// Rate at which the scanner returns a sample that it sees, 0 to 1.
    pub rate: &'a (dyn Fn(&SightLine) -> f64 + Sync),
    /// Area that is expected to be needed for the target, mm².
    pub needed_mm2: f64,
    /// Minimum area that a view has to be expected to add, mm².
    pub min_gain_mm2: f64,
    /// Area that all candidates together have to be expected to add, mm².
    pub min_left_mm2: f64,
    /// Largest number of views.
    pub max_views: usize,
}

closed_list! {
    /// The rule that ended a further round of views.
    pub enum DemandStop {
        /// The views are expected to reach the target.
        Target = "target",
        /// The best view is expected to add too little.
        MinGain = "min_gain",
        /// The largest number of views was chosen.
        MaxViews = "max_views",
        /// All views that there could be are expected to add too little.
        LittleLeft = "little_left",
    }
}

/// Further views, and what is expected of them.
#[derive(Clone, Debug)]
pub struct FurtherViews {
    /// Plan of the further views, which asks for the open samples alone; `None` where no view is worth it.
    pub outcome: Option<Outcome>,
    /// Area that each view is expected to add, in the order chosen, mm².
    pub expected_mm2: Vec<f64>,
    /// Area that all candidates together are expected to add, mm².
    pub left_mm2: f64,
    /// The rule that ended the choice.
    pub stopped_because: DemandStop,
}

impl Demand<'_> {
    /// Leaves asked of a surface what is open.
    ///
    /// # Errors
    /// A set for another number of samples: the parameters are not those of the plan.
    pub(in crate::planning) fn mask(&self, surface: &mut Surface) -> Result<(), PlanError> {
        let samples = surface.sample_mm.len();
        if self.open.words().len() != samples.div_ceil(64) {
            return Err(PlanError::param("/part", &Refusal::OtherSamples { samples }));
        }
        let open = |(sample, asked): (SampleId, &mut bool)| *asked &= self.open.holds(sample);
        SampleId::number(&mut surface.asked).for_each(open);
        Ok(())
    }
}

/// Leaves asked of other samples of the same patches what the nearest of `first` in their patch is asked.
pub(in crate::planning) fn mask_alike(first: &Arc<Surface>, second: &mut Surface) {
    let nearest = |sample: SampleId| {
        let patch = &first.patches[second.sample_patch[sample.index()].index()];
        let point_mm = &second.sample_mm[sample.index()];
        let distance = |of: &SampleId| (first.sample_mm[of.index()] - point_mm).norm_squared();
        let of_patch = (patch.first_sample.index()..patch.first_sample.index() + patch.samples as usize).map(SampleId::at);
        of_patch.min_by(|a, b| distance(a).total_cmp(&distance(b)))
    };
    let asked = second.samples().map(|sample| nearest(sample).is_some_and(|near| first.asked[near.index()]));
    second.asked = asked.collect();
}
