//! Motion of the cell in a plan: cycle time, its components, and the obstructions.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::planning::plan::{Obstruction, Plan};
use crate::planning::sequence::Sequence;
use crate::wire::angle::degrees;
use crate::wire::words::advice_sentence;

/// Predicted cycle time and its components, summed over all setups; turning the part over between setups is not counted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct MotionDocument {
    /// Cycle time, s.
    #[serde(default)]
    pub cycle_secs: f64,
    /// Time of all moves, s.
    pub moving_secs: f64,
    /// Part of `moving_secs` in which the table turns, s; of moves with rounded corners an estimate: the share that it has with stops.
    #[serde(default)]
    pub turning_secs: f64,
    /// Time spent waiting for everything to stand still, s.
    #[serde(default)]
    pub settling_secs: f64,
    /// Time of all captures, s.
    #[serde(default)]
    pub scanning_secs: f64,
    /// Time of all moves in the order found, with a stop at every corner and before stations were refined in table angle and
    /// roll, s.
    #[serde(default)]
    pub ordered_secs: f64,
    /// Lower bound on `ordered_secs`, over all orders and all choices among the stations considered, s: each move counts as it
    /// was found, or as straight if no path was searched for. It bounds only that first tour; the order that is executed is
    /// proven optimal if `moving_secs` equals `moving_secs_lower` to within 0.005 s or 0.01 %. 0 if it was not computed.
    #[serde(default)]
    pub ordered_secs_lower: f64,
    /// Lower bound on `moving_secs`: the same stations in the best order, if every move were straight or, where corners are rounded, took
    /// as long as its slowest axis alone, s.
    pub moving_secs_lower: f64,
}

impl MotionDocument {
    /// Sums up the motion of a plan; `None` without a cell.
    pub(in crate::wire) fn of(plan: &Plan) -> Option<Self> {
        plan.sequences().next()?;
        let (visits, captures, scan) = (plan.visits().count() as f64, plan.captures() as f64, &plan.params.scan);
        let moving_secs: f64 = plan.sequences().map(Sequence::motion_secs).sum();
        let (settling_secs, scanning_secs) = (scan.settle_secs * visits, scan.capture_secs * captures);
        Some(Self {
            cycle_secs: moving_secs + settling_secs + scanning_secs,
            moving_secs,
            // The sum of nothing is -0.
            turning_secs: plan.sequences().map(Sequence::turning_secs).sum::<f64>() + 0.0,
            settling_secs,
            scanning_secs,
            ordered_secs: plan.sequences().map(|sequence| sequence.ordered_secs).sum(),
            ordered_secs_lower: plan.sequences().map(|sequence| sequence.lower_bound_secs).sum(),
            moving_secs_lower: plan.sequences().map(|sequence| sequence.moving_lower_secs).sum(),
        })
    }
}

/// Two bodies whose collision keeps the cell from reaching candidates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct ObstructionDocument {
    /// Names of the bodies.
    pub bodies: [String; 2],
    /// Number of candidates that have no station because of it.
    pub without_station: usize,
    /// Number of candidates for which no path to a station was found because of it.
    pub without_path: usize,
    /// Joints 1 to 6 and the table angle at which the bodies collide, for one of the candidates.
    pub configuration_deg: [f64; 7],
    /// Distance between the bodies there, mm; negative for a penetration depth; `null` if it is not known.
    pub apart_mm: Option<f64>,
    /// Position of the collision in the robot's base frame, mm; `null` if it is not known.
    pub place_in_base_mm: Option<[f64; 3]>,
    /// Advice on how to avoid it.
    pub help: String,
}

impl From<&Obstruction> for ObstructionDocument {
    fn from(obstruction: &Obstruction) -> Self {
        let Obstruction { bodies, without_station, without_path, configuration, separation, advice } = obstruction;
        Self {
            bodies: [bodies.a.to_string(), bodies.b.to_string()],
            without_station: *without_station,
            without_path: *without_path,
            configuration_deg: configuration.axes_rad().map(degrees),
            apart_mm: separation.as_ref().map(|found| found.distance_mm),
            place_in_base_mm: separation.as_ref().map(|found| found.place_in_base_mm.into()),
            help: advice_sentence(advice),
        }
    }
}
