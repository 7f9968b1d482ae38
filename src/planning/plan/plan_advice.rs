//! Advice on a plan as a whole, above the remedies of single spots.

use super::Turn;
use crate::cell::closed_list;
use crate::geometry::{Part, Pose, Table};
use crate::planning::params::Registration;

closed_list! {
    /// A kind of advice.
    pub enum AdviceKind {
        /// Plan in one more setup, the part turned onto another side.
        TurnOver = "turn_over",
        /// Choose more views of those that were considered.
        MoreViews = "more_views",
        /// Take a further view for more area at grade A.
        BetterGrades = "better_grades",
    }
}

/// A parameter to change, with its new value.
#[derive(Clone, Debug, PartialEq)]
pub enum ParamChange {
    /// `setups`.
    Setups(u32),
    /// `part.resting_poses`, where a plan in so many setups would choose others by itself.
    RestingPoses(Vec<Pose<Table, Part>>),
    /// `registration`, where the setups share too little surface to be registered by it.
    Registration(Registration),
    /// `selection.target`.
    Target(f64),
    /// `selection.max_views`.
    MaxViews(u32),
    /// `selection.min_grade_a`.
    MinGradeA(f64),
}

/// A setup of a plan that is advised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdvisedSetup {
    /// Pose of the part in it.
    pub table_from_part: Pose<Table, Part>,
    /// Turn into that pose from the first setup of the plan that the advice is on.
    pub turn: Turn,
}

/// Advice on a plan, tried on the model: views were chosen for it among candidates that the cell can take, and of a setup ordered.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanAdvice {
    /// Kind of advice.
    pub kind: AdviceKind,
    /// Parameters to change, for a plan that does it.
    pub changes: Vec<ParamChange>,
    /// Pose of the part in the further setup; `None` where the part stays in its setups, or leaves some of them.
    pub table_from_part: Option<Pose<Table, Part>>,
    /// Turn into that pose from the plan's first setup.
    pub turn: Option<Turn>,
    /// All setups of the advised plan, where not all of this plan's are among them: then none is the further one.
    pub setups: Vec<AdvisedSetup>,
    /// Views of the plan with them beyond those that it has.
    pub added_views: usize,
    /// Views of the plan with those that were chosen for the advice, and without those of setups that it leaves.
    pub views: usize,
    /// Asked area that a plan with these parameters measures at least, if it meets its target; on the samples that views are chosen
    /// on.
    pub measured_area_mm2: f64,
    /// Asked area at grade A with the added view, whose part is from the samples that views are chosen on; of advice for better grades
    /// alone.
    pub grade_a_area_mm2: Option<f64>,
    /// Visible area of that plan.
    pub visible_area_mm2: f64,
    /// Cycle time with these views, turning the part over not counted; present with a cell.
    pub cycle_secs: Option<f64>,
    /// Names of regions that miss their target now and would meet it.
    pub regions_met: Vec<String>,
}
