//! Conditions of motion: those of the devices, which hold all the time; those of a run, before it is armed; those of a target,
//! before it goes out, from where the devices were measured. Pure functions.

use std::f64::consts::PI;
use std::fmt;
use std::ops::RangeInclusive;
use std::sync::Arc;
use std::time::Duration;

use tokio::time::Instant;

use super::cause::{AxisName, DeviceRole, StopCause};
use super::machine::MachineState;
use super::state::RunState;
use crate::cell::{CalibrationObjection, Cell, CollisionScene, Configuration, Contact, UseConditions};
use crate::execution::device::Target;
use crate::program::{Expected, Finding, Program, check};

/// Largest distance beyond the workspace that goes unseen between two points at which it is asked, mm: our choice, far below what
/// the tolerances of position let pass.
const WORKSPACE_MARGIN_MM: f64 = 0.1;
/// Largest rounding of a number that went through degrees or a quotient, as a share of it.
const ROUNDING: f64 = 1e-9;
/// Seconds of an hour.
const SECS_PER_HOUR: f64 = 3600.0;

/// Shares of the program's speed that a client may ask for.
pub const OVERRIDES: RangeInclusive<f64> = 0.01..=1.0;

/// Refusal of a speed override outside of [`OVERRIDES`], in words.
pub(super) struct OverrideRefusal(pub(super) f64);

impl fmt::Display for OverrideRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "the speed override is {}; allowed is {} to {}", self.0, OVERRIDES.start(), OVERRIDES.end())
    }
}

/// Limits that a session keeps; from the cell file alone.
#[derive(Clone, Debug, PartialEq)]
pub struct Safeguards {
    /// Time that the devices' own watchdogs are set to.
    pub watchdog: Duration,
    /// Age beyond which a measured state is stale.
    pub state_max_age: Duration,
    /// Largest distance of any axis from a target that is reached.
    pub position_tolerance_rad: f64,
    /// Largest distance of any axis from the path where a run or a segment begins.
    pub start_tolerance_rad: f64,
    /// Largest distance of any axis from its straight way while moving.
    pub path_tolerance_rad: f64,
    /// Largest share of the program's speed on the first live run.
    pub first_run_speed: f64,
    /// Box that flange and scanner stay in, base frame.
    pub workspace: Option<Workspace>,
    /// States in a row in which a target has to be reached before the scanner is triggered.
    pub in_position_cycles: u32,
    /// Time beyond the predicted one in which a target has to be reached.
    pub reach_timeout: Duration,
    /// Time beyond the predicted one in which a capture has to be acknowledged.
    pub trigger_timeout: Duration,
    /// Time to connect.
    pub connect_timeout: Duration,
    /// Time that a request may take which is neither a state nor arming.
    pub request_timeout: Duration,
    /// Time that arming may take. Han's driver waits 10 s for the drives, FANUC's as long for the end of a program and for the
    /// start of another.
    pub arm_timeout: Duration,
    /// Time that a run may stay armed without being told to move.
    pub arm_expiry: Duration,
    /// Time without a heartbeat of the client after which a live run stops.
    pub heartbeat_timeout: Duration,
}

impl Default for Safeguards {
    fn default() -> Self {
        Self {
            watchdog: Duration::from_millis(200),
            state_max_age: Duration::from_millis(100),
            position_tolerance_rad: 0.1_f64.to_radians(),
            start_tolerance_rad: 0.5_f64.to_radians(),
            path_tolerance_rad: 5.0_f64.to_radians(),
            first_run_speed: 0.25,
            workspace: None,
            in_position_cycles: 3,
            reach_timeout: Duration::from_secs(5),
            trigger_timeout: Duration::from_secs(2),
            connect_timeout: Duration::from_secs(10),
            request_timeout: Duration::from_secs(2),
            arm_timeout: Duration::from_secs(30),
            arm_expiry: Duration::from_secs(60),
            heartbeat_timeout: Duration::from_millis(500),
        }
    }
}

/// A box in the base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Workspace {
    /// Lowest corner.
    pub min_mm: [f64; 3],
    /// Highest corner.
    pub max_mm: [f64; 3],
}

/// Hashes of what a run was approved with, and of what is in force.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hashes {
    /// SHA-256 of the plan.
    pub plan: String,
    /// SHA-256 of the cell.
    pub cell: String,
    /// SHA-256 of the compensation, where there is one.
    pub compensation: Option<String>,
}

/// A program with the cell that it is for, which the linter found nothing in.
#[derive(Clone, Debug)]
pub struct RunJob {
    pub(super) program: Arc<Program>,
    pub(super) cell: Arc<Cell>,
    pub(super) scene: Arc<CollisionScene>,
    pub(super) approved: Hashes,
    pub(super) present: Hashes,
    /// Age and temperature of the calibration when the job was made.
    conditions: UseConditions,
    made_at: Instant,
}

impl RunJob {
    /// Runs the linter; `scene` holds the part and the plan's clearance. On the way half of the clearance is kept, as
    /// measured poses are off the planned ones.
    ///
    /// # Errors
    /// Every finding of the linter.
    pub fn new(
        program: Program,
        cell: Arc<Cell>,
        scene: &CollisionScene,
        expected: Option<&Expected>,
        [approved, present]: [Hashes; 2],
    ) -> Result<Self, Vec<Finding>> {
        let findings = check(&program, &cell, scene, expected);
        if !findings.is_empty() {
            return Err(findings);
        }
        let scene = Arc::new(scene.with_half_clearance());
        let (conditions, made_at) = (UseConditions::default(), Instant::now());
        Ok(Self { program: Arc::new(program), cell, scene, approved, present, conditions, made_at })
    }

    /// The job under these conditions, as they are now: ages grow from here on.
    #[must_use]
    pub fn under(self, conditions: UseConditions) -> Self {
        Self { conditions, made_at: Instant::now(), ..self }
    }

    /// Conditions at this moment.
    fn conditions(&self) -> UseConditions {
        let hours = self.made_at.elapsed().as_secs_f64() / SECS_PER_HOUR;
        UseConditions {
            calibration_age_hours: self.conditions.calibration_age_hours.map(|age| age + hours),
            compensation_age_hours: self.conditions.compensation_age_hours.map(|age| age + hours),
            ..self.conditions
        }
    }

    /// The program.
    #[must_use]
    pub fn program(&self) -> &Program {
        &self.program
    }

    /// The cell.
    #[must_use]
    pub fn cell(&self) -> &Cell {
        &self.cell
    }
}

/// Reason why a run may not begin, or a target may not go out.
#[derive(Clone, Debug, PartialEq)]
pub enum Objection {
    /// Approved with something else.
    OtherHash {
        /// `plan`, `cell` or `compensation`.
        what: &'static str,
        /// Hash that was approved.
        approved: String,
        /// Hash in force.
        present: String,
    },
    /// Calibrated poses that may not be used, or not any longer.
    Calibration(CalibrationObjection),
    /// The program has no such step.
    NoSuchStep {
        /// Step asked for, from 0.
        step: usize,
        /// Number of steps.
        steps: usize,
    },
    /// Override out of range.
    Override(f64),
    /// A device that moves already.
    Moves(DeviceRole),
    /// A measured angle that is NaN or infinite.
    MeasuredNotFinite,
    /// A target with a number that is NaN or infinite.
    TargetNotFinite,
    /// Beyond the limits of an axis.
    OutsideLimits {
        /// Axis, 1 to 6, or 7 for the table.
        axis: usize,
        /// Angle asked for, degrees.
        angle_deg: f64,
    },
    /// Quicker than an axis may be.
    TooFast {
        /// Axis, 1 to 6, or 7 for the table.
        axis: usize,
    },
    /// Measured too far from where the way begins.
    OffStart {
        /// Axis that is furthest from it, 1 to 6, or 7 for the table.
        axis: usize,
        /// Distance found, degrees.
        off_deg: f64,
        /// Distance allowed, degrees.
        allowed_deg: f64,
    },
    /// Outside the box of the cell file.
    OutsideWorkspace {
        /// Point outside, base frame.
        at_mm: [f64; 3],
    },
    /// Two bodies too close on the way from where the devices are.
    Collision(Contact),
}

impl fmt::Display for Objection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OtherHash { what, approved, present } => {
                write!(
                    f,
                    "the {what} was changed since the run was approved (SHA-256 now {present:.12}, then {approved:.12}); put back \
                     the {what} of then, or plan again and approve that"
                )
            }
            Self::Calibration(objection) => objection.fmt(f),
            Self::NoSuchStep { step, steps } => {
                write!(f, "there is no step {step}: the program has {steps}, counted from 0; begin with one of them")
            }
            Self::Override(value) => OverrideRefusal(*value).fmt(f),
            Self::Moves(device) => write!(f, "the {device} moves already; wait until it stands still"),
            Self::MeasuredNotFinite => write!(
                f,
                "the controller reports an angle that is not a number; check its link, then start a new run from this step"
            ),
            Self::TargetNotFinite => {
                write!(f, "a target has an angle, a speed or an acceleration that is not a number; plan again")
            }
            Self::OutsideLimits { axis, angle_deg } => {
                write!(f, "{} would go to {angle_deg:.3}°, beyond its limits; plan again with this cell", AxisName(*axis))
            }
            Self::TooFast { axis } => {
                write!(f, "{} would be quicker than it may be; plan again with this cell", AxisName(*axis))
            }
            Self::OffStart { axis, off_deg, allowed_deg } => write!(
                f,
                "{} stands {off_deg:.2}° off the program's way; allowed are {allowed_deg:.2}°: bring the cell there by \
                 hand or by its own controller",
                AxisName(*axis)
            ),
            Self::OutsideWorkspace { at_mm: [x, y, z] } => write!(
                f,
                "the way leads to [{x:.0}, {y:.0}, {z:.0}] mm, outside the workspace of the cell file; plan a program \
                 that stays in it, or enlarge controllers.workspace where that space is really free"
            ),
            Self::Collision(contact) => write!(
                f,
                "on the way from where the cell stands, {contact} come too close; bring the cell nearer to the program's way by \
                 hand"
            ),
        }
    }
}

/// Condition that forbids motion in this state of a run, the gravest first.
pub(super) fn unfit(state: &MachineState, run: RunState, now: Instant, max_age: Duration) -> Option<StopCause> {
    let conditions = state.conditions();
    let first = |is: &dyn Fn(DeviceRole) -> Option<StopCause>| conditions.iter().find_map(|(device, _)| is(*device));
    let of = |device: DeviceRole| conditions[usize::from(device == DeviceRole::Table)].1;
    let age = |device: DeviceRole| {
        now.saturating_duration_since(if device == DeviceRole::Table { state.table.at } else { state.arm.at })
    };
    first(&|device| of(device).emergency_stop.then_some(StopCause::EmergencyStop(device)))
        .or_else(|| first(&|device| of(device).guard_open.then_some(StopCause::GuardOpen(device))))
        .or_else(|| first(&|device| of(device).fault.map(|fault| StopCause::Fault { device, code: fault.0, text: None })))
        .or_else(|| first(&|device| of(device).hand_guided.then_some(StopCause::HandGuided(device))))
        .or_else(|| {
            let is_held = |device| of(device).paused && run != RunState::Paused;
            first(&|device| is_held(device).then_some(StopCause::HeldAtDevice(device)))
        })
        .or_else(|| {
            let is_off = |device| run.is_armed() && !(of(device).powered && of(device).brakes_open);
            first(&|device| is_off(device).then_some(StopCause::PowerLost(device)))
        })
        .or_else(|| {
            let is_stale = |device| age(device) > max_age;
            first(&|device| is_stale(device).then(|| StopCause::Stale { device, age: age(device), by_reply_timeout: false }))
        })
}

/// Objections to a run as such, before anything is connected.
pub(super) fn to_run(job: &RunJob, from_step: usize, speed_override: f64) -> Vec<Objection> {
    let text = |hash: &Option<String>| hash.clone().unwrap_or_else(|| "none".to_owned());
    let (approved, present) = (&job.approved, &job.present);
    let pairs = [
        ("plan", approved.plan.clone(), job.program.plan_sha256.clone()),
        ("plan", approved.plan.clone(), present.plan.clone()),
        ("cell", approved.cell.clone(), present.cell.clone()),
        ("compensation", text(&approved.compensation), text(&present.compensation)),
    ];
    let other = pairs.into_iter().filter(|(_, approved, present)| approved != present);
    let mut found: Vec<_> = other.map(|(what, approved, present)| Objection::OtherHash { what, approved, present }).collect();
    found.extend(job.cell.calibration_objections(&job.conditions()).into_iter().map(Objection::Calibration));
    let steps = job.program.steps.len();
    if from_step >= steps.max(1) {
        found.push(Objection::NoSuchStep { step: from_step, steps });
    }
    if !OVERRIDES.contains(&speed_override) {
        found.push(Objection::Override(speed_override));
    }
    found
}

/// Objection to beginning at `measured` where the way passes `nearest`.
pub(super) fn to_start(measured: &Configuration, nearest: &Configuration, safeguards: &Safeguards) -> Option<Objection> {
    let (axis, off_rad) = furthest_axis(measured, nearest);
    if !off_rad.is_finite() {
        return Some(Objection::MeasuredNotFinite);
    }
    let allowed_deg = safeguards.start_tolerance_rad.to_degrees();
    (off_rad > safeguards.start_tolerance_rad).then_some(Objection::OffStart { axis, off_deg: off_rad.to_degrees(), allowed_deg })
}

/// Objection to a target, from where the devices are measured. Costs a check of one segment for collisions.
pub(super) fn to_target(
    job: &RunJob,
    measured: &Configuration,
    target: &Target<7>,
    safeguards: &Safeguards,
) -> Option<Objection> {
    let to = Configuration::from_axes_rad(target.positions_rad);
    let mut numbers = target.positions_rad.iter().chain(&target.max_speed_rad_s).chain(&target.max_acceleration_rad_s2);
    if !measured.axes_rad().iter().all(|angle| angle.is_finite()) {
        return Some(Objection::MeasuredNotFinite);
    }
    if !numbers.all(|number| number.is_finite()) {
        return Some(Objection::TargetNotFinite);
    }
    let axes = job.cell.axes();
    let limits = axes.0.iter().zip(target.positions_rad).enumerate();
    let outside = limits.clone().find(|(_, (axis, angle))| !axis.allows(*angle));
    let is_fast = |speed: f64, max: f64| speed > max * (1.0 + ROUNDING);
    let fast = axes.0.iter().enumerate().find(|(index, axis)| {
        is_fast(target.max_speed_rad_s[*index], axis.max_speed_rad_per_s)
            || is_fast(target.max_acceleration_rad_s2[*index], axis.max_acceleration_rad_per_s2)
    });
    outside
        .map(|(index, (_, angle))| Objection::OutsideLimits { axis: index + 1, angle_deg: angle.to_degrees() })
        .or_else(|| fast.map(|(index, _)| Objection::TooFast { axis: index + 1 }))
        .or_else(|| outside_workspace(job, measured, &to, safeguards))
        .or_else(|| job.scene.check_segment(measured, &to).map(Objection::Collision))
}

/// Objection to a segment on which the origin of flange or scanner leaves the workspace by [`WORKSPACE_MARGIN_MM`] or more.
fn outside_workspace(job: &RunJob, from: &Configuration, to: &Configuration, safeguards: &Safeguards) -> Option<Objection> {
    let workspace = safeguards.workspace?;
    let is_outside = |at: &[f64; 3]| (0..3).any(|k| at[k] < workspace.min_mm[k] || at[k] > workspace.max_mm[k]);
    let pieces = workspace_pieces(&job.cell, from, to);
    let mut points = (0..=pieces).flat_map(|piece| {
        let share = f64::from(piece) / f64::from(pieces);
        watched_mm(&job.cell, &from.toward(to, share))
    });
    points.find(is_outside).map(|at_mm| Objection::OutsideWorkspace { at_mm })
}

/// Origins of flange and scanner, base frame.
fn watched_mm(cell: &Cell, here: &Configuration) -> [[f64; 3]; 2] {
    let base_from_flange = cell.robot.base_from_flange(&here.joints_rad);
    [base_from_flange.origin_mm(), (base_from_flange * cell.flange_from_scanner).origin_mm()].map(<[f64; 3]>::from)
}

/// Number of equal pieces of a segment between whose ends the watched points stay within [`WORKSPACE_MARGIN_MM`] of a box that
/// holds them at the ends.
///
/// A box holds the chords between points in it, and a curve x(s) is at most h²/8 · max |x″| off the chord of a piece of length h.
/// With joints that turn by Δ_j, about axes from which the point is at most R_j away, R_1 ≥ R_2 ≥ …, |x″| ≤ Σ_j Σ_k |Δ_j| |Δ_k|
/// R_max(j, k) ≤ Σ|Δ_j| · Σ|Δ_j| R_j: x″ is made of the centripetal parts and of the turns of later axes by the joints before.
fn workspace_pieces(cell: &Cell, from: &Configuration, to: &Configuration) -> u32 {
    let mut turns_rad: [f64; 6] = std::array::from_fn(|joint| (to.joints_rad[joint] - from.joints_rad[joint]).abs());
    // Where joint 3 is counted from the ground, its axis turns by what both joints tell; elsewhere by less than that.
    turns_rad[2] += turns_rad[1];
    let moved_mm: f64 = turns_rad.iter().zip(reach_mm(cell)).map(|(turn, reach)| turn * reach).sum();
    let off_chord_mm = 0.125 * turns_rad.iter().sum::<f64>() * moved_mm;
    (off_chord_mm / WORKSPACE_MARGIN_MM).sqrt().ceil().max(1.0) as u32
}

/// Upper bound on the distance of the watched points from the axis of each joint, at any joints, mm. The origins of neighbouring
/// frames keep their distance, save that a flange beside axis 6 goes round it in a circle, whose diameter half a turn shows.
fn reach_mm(cell: &Cell) -> [f64; 6] {
    let origins_mm = |joint_6_rad: f64| {
        let joints_rad = [0.0, 0.0, 0.0, 0.0, 0.0, joint_6_rad];
        cell.robot.link_frames(&joints_rad).map(|frame| frame.translation.vector)
    };
    let [straight, turned] = [0.0, PI].map(origins_mm);
    let beyond_wrist_mm = cell.flange_from_scanner.origin_mm().coords.norm() + (turned[6] - straight[6]).norm();
    let between_mm = |from: usize| (straight[from + 1] - straight[from]).norm();
    std::array::from_fn(|joint| beyond_wrist_mm + (joint + 1..6).map(between_mm).sum::<f64>())
}

/// Axis that differs most, from 1, and by how much; an angle that is not a number differs more than any.
pub(super) fn furthest_axis(a: &Configuration, b: &Configuration) -> (usize, f64) {
    let turns = a.travel_rad(b).map(f64::abs).into_iter().enumerate();
    turns.fold((1, 0.0), |most, (index, turn)| if turn.total_cmp(&most.1).is_gt() { (index + 1, turn) } else { most })
}

#[cfg(test)]
mod tests;
