//! Motion of the cell in a plan: the time of the cycle by its parts, and the obstructions.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::planning::plan::{Obstruction, Plan};
use crate::planning::sequence::Sequence;
use crate::wire::angle::degrees;

/// Predicted time of a cycle and where it goes, setups added up; between setups nothing is counted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct MotionDocument {
    /// All of it, s.
    #[serde(default)]
    pub cycle_secs: f64,
    /// Moves, s.
    pub moving_secs: f64,
    /// Part of the moves in which the table turns, s.
    #[serde(default)]
    pub turning_secs: f64,
    /// Waiting for everything to stand still, s.
    #[serde(default)]
    pub settling_secs: f64,
    /// Captures, s.
    #[serde(default)]
    pub scanning_secs: f64,
    /// Moves as the order was found, before its stations were moved along the table's angle and rolled, every corner a stop, s.
    #[serde(default)]
    pub ordered_secs: f64,
    /// No order, over the stations and moves that were considered, takes less than this, s: `ordered_secs` where the order is
    /// proved the best.
    pub moving_secs_lower: f64,
}

impl MotionDocument {
    /// Sums up a plan with a cell.
    pub(super) fn of(plan: &Plan) -> Option<Self> {
        plan.sequences().next()?;
        let (visits, scan) = (plan.visits().count() as f64, &plan.params.scan);
        let moving_secs: f64 = plan.sequences().map(Sequence::motion_secs).sum();
        let [settling_secs, scanning_secs] = [scan.settle_secs, scan.capture_secs].map(|secs| secs * visits);
        Some(Self {
            cycle_secs: moving_secs + settling_secs + scanning_secs,
            moving_secs,
            turning_secs: plan.sequences().map(Sequence::turning_secs).sum(),
            settling_secs,
            scanning_secs,
            ordered_secs: plan.sequences().map(|sequence| sequence.ordered_secs).sum(),
            moving_secs_lower: plan.sequences().map(|sequence| sequence.lower_bound_secs).sum(),
        })
    }
}

/// Two bodies that keep the cell from candidates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct ObstructionDocument {
    /// Their names.
    pub bodies: [String; 2],
    /// Candidates that have no station for it.
    pub without_station: usize,
    /// Candidates to whose stations no path was found for it.
    pub without_path: usize,
    /// Joints 1 to 6 and the table angle at which they meet, for one of the candidates.
    pub configuration_deg: [f64; 7],
    /// Distance of the two there, mm; below zero the depth of one in the other; `null` where that is not known.
    pub apart_mm: Option<f64>,
    /// Where, robot base frame, mm.
    pub place_in_base_mm: Option<[f64; 3]>,
    /// Advice, in words.
    pub help: String,
}

impl From<&Obstruction> for ObstructionDocument {
    fn from(obstruction: &Obstruction) -> Self {
        let Obstruction { bodies, without_station, without_path, configuration, separation, help } = obstruction;
        Self {
            bodies: [bodies.a.to_string(), bodies.b.to_string()],
            without_station: *without_station,
            without_path: *without_path,
            configuration_deg: configuration.map(degrees),
            apart_mm: separation.as_ref().map(|found| found.distance_mm),
            place_in_base_mm: separation.as_ref().map(|found| found.place_mm.into()),
            help: help.clone(),
        }
    }
}
