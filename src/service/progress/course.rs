//! Stages that a command is expected to go through, each with its typical share of the time.

use crate::planning::context::Stage;
use crate::planning::params::{CandidateParams, PlanParams, Strategy};
use crate::planning::studies::Study;

/// Share of the time that a later round of candidates takes, of that of the first.
const LATER_ROUND: f64 = 0.4;

/// Stages that a command is expected to go through, in order, each with its cost. Costs are relative to each other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Course {
    pub(super) legs: Vec<(Stage, f64)>,
}

/// Typical share of a plan's time, rounded from both demo parts with and without a cell; larger parts spend more of it on visibility.
fn cost(stage: Stage) -> f64 {
    match stage {
        // In no course: the first comes before it, the others are within other stages.
        Stage::Reading | Stage::CollisionScene | Stage::Roadmap => 0.0,
        Stage::Surface => 0.01,
        Stage::Candidates => 0.02,
        Stage::Stations => 0.03,
        Stage::Visibility => 0.27,
        Stage::Selection => 0.40,
        Stage::Sequence => 0.05,
        Stage::Missed => 0.08,
        Stage::Certificate => 0.05,
        Stage::Bound => 0.01,
        Stage::Report => 0.08,
    }
}

fn leg(stage: Stage) -> (Stage, f64) {
    (stage, cost(stage))
}

impl Course {
    /// Course of a plan with its files.
    #[must_use]
    pub fn of_plan(params: &PlanParams, with_cell: bool) -> Self {
        let params = params.preset.apply(params);
        let mut legs = vec![leg(Stage::Surface)];
        (0..params.setups.max(1)).for_each(|_| legs.extend(rounds(&params.candidates)));
        legs.push(leg(Stage::Selection));
        legs.extend(with_cell.then(|| leg(Stage::Sequence)));
        legs.extend([Stage::Missed, Stage::Certificate, Stage::Bound, Stage::Report].map(leg));
        Self { legs }
    }

    /// Course of a study: visibility once, or for each value that is varied; then views chosen for each.
    #[must_use]
    pub fn of_study(study: Study, params: &PlanParams) -> Self {
        let table = || [leg(Stage::Surface)].into_iter().chain(rounds(&params.candidates));
        // Greedy alone is quicker than the solver of a plan.
        let choice = (Stage::Selection, 0.1 * cost(Stage::Selection));
        let legs = match study {
            Study::Weights => table().chain([choice; 5]).collect(),
            Study::Limits => (0..5).flat_map(|_| table().chain([choice])).collect(),
            Study::Candidates => (0..=Strategy::ALL.len()).flat_map(|_| table().chain([choice])).collect(),
        };
        Self { legs }
    }
}

/// Rounds of candidates of a setup.
fn rounds(params: &CandidateParams) -> impl Iterator<Item = (Stage, f64)> {
    let iterative = if params.uses(Strategy::Iterative) { params.iterative_rounds } else { 0 };
    let later = iterative + u32::from(params.uses(Strategy::Targeted));
    let weights = [1.0].into_iter().chain((0..later).map(|_| LATER_ROUND));
    weights.flat_map(|weight| [Stage::Candidates, Stage::Stations, Stage::Visibility].map(|stage| (stage, weight * cost(stage))))
}
