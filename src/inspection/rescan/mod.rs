//! The fewest further views for what a scan lacks: a plan like any other, with order and program, that asks for the missing samples
//! alone. Views are chosen by what they are expected to add ([`crate::planning::plan_further`]), with the identified rates of return in
//! place of the scanner's specification. What no further view mends, such as concave corners or a part that deviates, leaves the
//! demand. The arm begins at home, where every program ends.
//!
//! Measured to its target without a rule of gain, a part takes ever more views for ever less area; so a round ends by the first of
//! [`RescanStop`], and it is said by which.

#[cfg(test)]
mod tests;

use super::identification::ReturnModel;
use super::losses::{LossCause, Losses};
use crate::cell::closed_list;
use crate::planning::context::{Context, PlanError};
use crate::planning::ids::SampleId;
use crate::planning::params::{PlanParams, Preset, RescanParams, Strategy};
use crate::planning::plan::Outcome;
use crate::planning::surface::Surface;
use crate::planning::visibility::SampleSet;
use crate::planning::{Demand, DemandStop, PlanInput, SightLine, plan_further};

/// Rate below which candidates are not aimed: beyond that incidence a scanner returns next to nothing.
const AIM_RATE: f64 = 0.25;
/// Tightest limit that candidates are generated with, degrees: rates from few pairs are not to keep all surface from being seen.
const MIN_AIM_DEG: f64 = 30.0;

closed_list! {
    /// The rule that ended a rescan.
    pub enum RescanStop {
        /// The target of the plan is measured, or expected to be.
        Target = "target",
        /// The best view is expected to add less than `rescan.min_gain`.
        MinGain = "min_gain",
        /// `rescan.max_views` views were chosen.
        MaxViews = "max_views",
        /// `rescan.max_rounds` rounds were made.
        MaxRounds = "max_rounds",
        /// All views that there could be are expected to add less than `rescan.min_left`.
        LittleLeft = "little_left",
        /// Nothing that a view could mend is missing.
        NothingMissing = "nothing_missing",
    }
}

impl From<DemandStop> for RescanStop {
    fn from(stop: DemandStop) -> Self {
        match stop {
            DemandStop::Target => Self::Target,
            DemandStop::MinGain => Self::MinGain,
            DemandStop::MaxViews => Self::MaxViews,
            DemandStop::LittleLeft => Self::LittleLeft,
        }
    }
}

/// A part that was planned and scanned.
#[derive(Clone, Copy)]
pub struct RescanInput<'a> {
    /// Part, scanner and cell.
    pub input: &'a PlanInput<'a>,
    /// Parameters of the first plan, as it states them.
    pub params: &'a PlanParams,
    /// Area of which the plan's target is a share, mm².
    pub target_of_mm2: f64,
    /// Samples of the part.
    pub surface: &'a Surface,
    /// Samples that scans have measured.
    pub measured: &'a SampleSet,
    /// Samples that no further view mends.
    pub hopeless: &'a SampleSet,
    /// Rates of return, as far as they are known.
    pub model: &'a ReturnModel,
    /// Rescans that were made.
    pub rounds: u32,
}

/// Further views, with what is expected of them.
#[derive(Clone, Debug)]
pub struct Rescan {
    /// Plan of the further views; `None` where no view is worth it.
    pub outcome: Option<Outcome>,
    /// Share of the asked area that is measured.
    pub measured: f64,
    /// Share of the asked area that each view is expected to add, in the order chosen.
    pub expected_gain: Vec<f64>,
    /// Share of the asked area that all further views together are expected to add.
    pub left: f64,
    /// Share of the asked area that is missing and that no further view mends.
    pub hopeless: f64,
    /// The rule that ended the choice.
    pub stopped_because: RescanStop,
}

/// Samples, of so many, that no further view mends: in concave corners, beside steps of depth, or where the part is not as its model.
#[must_use]
pub fn hopeless(losses: &Losses, samples: usize) -> SampleSet {
    let mut hopeless = SampleSet::none_of(samples);
    let is_hopeless = |cause: LossCause| matches!(cause, LossCause::Concave | LossCause::Edge | LossCause::PartDeviates);
    let of_samples = losses.of_samples.iter().filter(|(_, cause)| is_hopeless(*cause));
    of_samples.for_each(|(sample, _)| hopeless.insert(*sample));
    hopeless
}

/// Chooses and plans the views of the next round.
///
/// # Errors
/// Parameters out of range; [`PlanError`], as of [`crate::planning::plan()`].
pub fn rescan(part: &RescanInput<'_>, params: &RescanParams, ctx: &Context<'_>) -> Result<Rescan, PlanError> {
    params.check()?;
    let areas = Areas::of(part);
    let asked_mm2 = areas.asked_mm2.max(f64::MIN_POSITIVE);
    let share = |area_mm2: f64| area_mm2 / asked_mm2;
    let nothing = |stopped_because: RescanStop| Rescan {
        outcome: None,
        measured: share(areas.measured_mm2),
        expected_gain: Vec::new(),
        left: 0.0,
        hopeless: share(areas.hopeless_mm2),
        stopped_because,
    };
    let needed_mm2 = part.params.selection.target * part.target_of_mm2 - areas.measured_mm2;
    if needed_mm2 <= 0.0 {
        return Ok(nothing(RescanStop::Target));
    }
    if areas.open.count() == 0 {
        return Ok(nothing(RescanStop::NothingMissing));
    }
    if part.rounds >= params.max_rounds {
        return Ok(nothing(RescanStop::MaxRounds));
    }
    let rate = |line: &SightLine| part.model.rate(line.worst_incidence_rad, line.mirror_rad, line.depth_mm);
    let demand = Demand {
        open: &areas.open,
        rate: &rate,
        needed_mm2,
        min_gain_mm2: params.min_gain * asked_mm2,
        min_left_mm2: params.min_left * asked_mm2,
        max_views: params.max_views as usize,
    };
    let further = plan_further(part.input, &params_of(part), &demand, ctx)?;
    Ok(Rescan {
        expected_gain: further.expected_mm2.iter().map(|mm2| share(*mm2)).collect(),
        left: share(further.left_mm2),
        outcome: further.outcome,
        ..nothing(further.stopped_because.into())
    })
}

/// Areas of a scanned part, and what of it is open.
struct Areas {
    asked_mm2: f64,
    measured_mm2: f64,
    hopeless_mm2: f64,
    open: SampleSet,
}

impl Areas {
    fn of(part: &RescanInput<'_>) -> Self {
        let samples = part.surface.sample_mm.len();
        let mut areas = Self { asked_mm2: 0.0, measured_mm2: 0.0, hopeless_mm2: 0.0, open: SampleSet::none_of(samples) };
        for sample in part.surface.samples().filter(|sample: &SampleId| part.surface.asked[sample.index()]) {
            let area_mm2 = part.surface.sample_area_mm2(sample);
            areas.asked_mm2 += area_mm2;
            if part.measured.holds(sample) {
                areas.measured_mm2 += area_mm2;
            } else if part.hopeless.holds(sample) {
                areas.hopeless_mm2 += area_mm2;
            } else {
                areas.open.insert(sample);
            }
        }
        areas
    }
}

/// Parameters of the plan, with candidates aimed at what is open, within the angles at which the scanner returns something.
fn params_of(part: &RescanInput<'_>) -> PlanParams {
    let mut params = part.params.clone();
    // What a preset set stands in the parameters of the plan.
    params.preset = Preset::Vantage;
    if !params.candidates.uses(Strategy::Targeted) {
        params.candidates.strategies.push(Strategy::Targeted);
    }
    let [left, right] = part.input.scanner.devices.cameras().map(|camera| params.limits.incidence_max_rad(camera).to_degrees());
    if let Some(aim_deg) = part.model.incidence.falls_to(AIM_RATE).filter(|aim_deg| *aim_deg < left.min(right)) {
        params.limits.camera_deg = Some(aim_deg.max(MIN_AIM_DEG));
    }
    params.output.candidates = false;
    params
}
