//! The linter: from a program alone, with the cell it is for, what is wrong with it. Limits, times, collisions along every
//! segment, and where the scanner is at each capture are derived anew; nothing is taken over from the planner.

use std::collections::{BTreeMap, BTreeSet};

use super::{Move, Program, ProgramCalibration, Step};
use crate::cell::time_parameterisation::SmoothPath;
use crate::cell::{Axes, CalibrationObjection, Cell, CollisionScene, Configuration, Contact, UseConditions};
use crate::geometry::{Part, Pose, ScannerFrame, Table, plate_from_placed};
use crate::planning::params::{Corners, PlanParams};
use crate::planning::plan::ViewId;

/// Shares of the speed that went through a file are off by this at most.
const ROUNDING_SPEED: f64 = 1e-9;
/// Angles that went through degrees and back are off by this at most, radians.
const ROUNDING_RAD: f64 = 1e-9;
/// Times that went through a file are off by this at most, seconds.
const ROUNDING_SECS: f64 = 1e-6;
/// Largest distance of the scanner from its viewpoint, mm.
const MAX_OFFSET_MM: f64 = 0.1;
/// Largest angle between the scanner and its viewpoint, degrees.
const MAX_OFFSET_DEG: f64 = 0.01;
/// Largest difference of the measured share from the plan's: views may be off by [`MAX_OFFSET_MM`] and [`MAX_OFFSET_DEG`].
const MAX_COVERAGE_DIFFERENCE: f64 = 5e-4;
/// Highest brightness level.
const MAX_BRIGHTNESS: u8 = 9;

/// The plan's side of the check.
#[derive(Clone, Debug)]
pub struct Expected {
    /// SHA-256 of the plan's file, lower-case hexadecimal.
    pub plan_sha256: String,
    /// Pose of the part on the table.
    pub table_from_part: Pose<Table, Part>,
    /// Is true if arm and table move one after the other.
    pub table_alone: bool,
    /// Views that are to be scanned.
    pub views: Vec<(ViewId, Pose<Part, ScannerFrame>)>,
}

/// Something wrong.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// Step it is in, counted from 0; `None` when it is about the whole.
    pub step: Option<usize>,
    /// The fault.
    pub fault: Fault,
}

impl std::fmt::Display for Finding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.pointer() {
            whole if whole.is_empty() => self.fault.fmt(f),
            pointer => write!(f, "{pointer}: {}", self.fault),
        }
    }
}

impl Finding {
    /// Pointer to the step or field of the program that it concerns; empty for the whole.
    #[must_use]
    pub fn pointer(&self) -> String {
        match (self.step, &self.fault) {
            (Some(step), _) => format!("/steps/{step}"),
            (None, Fault::CycleTime { .. }) => "/cycle_secs".to_owned(),
            (None, Fault::OtherHome) => "/home_deg".to_owned(),
            (None, Fault::OtherPlan { .. }) => "/plan_sha256".to_owned(),
            (None, _) => String::new(),
        }
    }
}

/// Kinds of faults, with what was found and what is allowed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Fault {
    /// Made for other hardware.
    #[error("is for {what} {program:?}; the cell has {cell:?}")]
    OtherHardware {
        /// `robot` or `turntable`.
        what: &'static str,
        /// Name in the program.
        program: String,
        /// Name in the cell.
        cell: String,
    },
    /// Calibrated poses of the cell that may not be used.
    #[error(transparent)]
    Calibration(#[from] CalibrationObjection),
    /// Made with another calibration than the cell has.
    #[error("is made with calibration {}, the cell has {}", named(program.as_ref()), named(cell.as_ref()))]
    OtherCalibration {
        /// Calibration of the program.
        program: Option<ProgramCalibration>,
        /// Calibration of the cell.
        cell: Option<ProgramCalibration>,
    },
    /// Made from another plan.
    #[error("is made from plan {program}, not from {plan}")]
    OtherPlan {
        /// Hash in the program.
        program: String,
        /// Hash of the plan.
        plan: String,
    },
    /// Made from a plan that has no motion.
    #[error("the plan has no cell, and so no program")]
    PlanWithoutCell,
    /// Made for a setup that the plan does not have.
    #[error("is for setup {setup}; the plan has {setups}")]
    NoSuchSetup {
        /// Number of the setup, from 1.
        setup: usize,
        /// Number of setups of the plan.
        setups: usize,
    },
    /// Home is not the cell's.
    #[error("differs from the cell's home")]
    OtherHome,
    /// An axis beyond its limits.
    #[error("axis {axis} is at {angle_deg:.4}°; allowed is {min_deg:.4} to {max_deg:.4}°")]
    OutsideLimits {
        /// 1 to 6, or 7 for the table.
        axis: usize,
        /// Angle found.
        angle_deg: f64,
        /// Lowest allowed.
        min_deg: f64,
        /// Highest allowed.
        max_deg: f64,
    },
    /// A value that is not a share of the rated speed.
    #[error("speed_fraction is {0}; allowed is above 0 to 1")]
    SpeedFraction(f64),
    /// Quicker than the axes allow, or slower than needed.
    #[error("duration_secs is {stated:.6}; at this speed the move takes {derived:.6} s")]
    Duration {
        /// Value in the program.
        stated: f64,
        /// Value from the axes.
        derived: f64,
    },
    /// Arm and table at once, where the plan has them move one after the other.
    #[error("segment {segment} moves arm and table together; the plan has motion.table = \"alone\"")]
    Together {
        /// 0 leads to the first via point, or to the target.
        segment: usize,
    },
    /// Part, fixture or calibration board meets what stands around it, wherever the arm is.
    #[error(
        "{contact} meet wherever the arm is, as what is on the table lies (table_from_part of a plan, the board's size and height of \
         calibration poses) or as the table turns; move it, or what it meets, and plan again"
    )]
    Placement {
        /// The bodies.
        contact: Contact,
    },
    /// Two bodies too close on the way: on a segment, or on the curve that passes the point at its end.
    #[error("collides on segment {segment}: {contact}")]
    Collision {
        /// 0 leads to the first via point, or to the target.
        segment: usize,
        /// The bodies.
        contact: Contact,
    },
    /// A capture somewhere else than planned.
    #[error(
        "viewpoint {view} is scanned {mm:.4} mm and {deg:.5}° off its pose; allowed is {MAX_OFFSET_MM} mm and {MAX_OFFSET_DEG}°"
    )]
    OffPose {
        /// The view.
        view: u32,
        /// Distance.
        mm: f64,
        /// Angle.
        deg: f64,
    },
    /// A capture that the plan does not know.
    #[error("viewpoint {0} is not one of the plan's")]
    UnknownView(u32),
    /// A second capture of one view.
    #[error("viewpoint {0} is scanned a second time")]
    Twice(u32),
    /// A view of the plan that is never captured.
    #[error("viewpoint {0} of the plan is never scanned")]
    NeverScanned(u32),
    /// The scans together measure something else than the plan says.
    #[error("the scans measure {:.2} % of the asked area; the plan says {:.2} %", 100.0 * measured, 100.0 * planned)]
    Coverage {
        /// Share that the scans measure.
        measured: f64,
        /// Share that the plan says.
        planned: f64,
    },
    /// Faster than planned.
    #[error("speed_fraction is {found}; the plan has {planned}, which is the most allowed")]
    TooFast {
        /// Value in the program.
        found: f64,
        /// Value of the plan.
        planned: f64,
    },
    /// Points passed farther off than planned.
    #[error(
        "passed_within_deg is {found_deg}; the plan's motion.corners and motion.path_tolerance_deg allow {planned_deg} at most, where 0 \
         is a stop at each point"
    )]
    PassedWide {
        /// Value in the program, degrees.
        found_deg: f64,
        /// Value of the plan, degrees; 0 where it stops.
        planned_deg: f64,
    },
    /// A capture before everything stands still.
    #[error(
        "viewpoint {view} is scanned {found} s after the move; the plan has settle_secs {planned}, which is the least allowed"
    )]
    Unsettled {
        /// The view.
        view: u32,
        /// Time of settling before it.
        found: f64,
        /// Value of the plan.
        planned: f64,
    },
    /// A capture that ends too soon.
    #[error("capture_secs is {found}; the plan has {planned}, which is the least allowed")]
    ShortCapture {
        /// Value in the program.
        found: f64,
        /// Value of the plan.
        planned: f64,
    },
    /// Captures of other brightness, or another number of them, than planned.
    #[error("viewpoint {view} is captured at brightness {found:?}; the plan has {planned:?}")]
    OtherLevels {
        /// The view.
        view: u32,
        /// Levels in the program, in order.
        found: Vec<u8>,
        /// Levels of the plan, in order.
        planned: Vec<u8>,
    },
    /// A brightness level that does not exist.
    #[error("brightness is {0}; allowed is 0 to {MAX_BRIGHTNESS}")]
    Brightness(u8),
    /// A time that is none.
    #[error("lasts {0} s; a time is finite and not negative")]
    Time(f64),
    /// The last step ends elsewhere.
    #[error("the program does not end at home")]
    NotHome,
    /// The sum is wrong.
    #[error("is {stated:.6}; the steps take {derived:.6} s")]
    CycleTime {
        /// Value in the program.
        stated: f64,
        /// Sum of the steps.
        derived: f64,
    },
}

fn named(calibration: Option<&ProgramCalibration>) -> String {
    calibration.map_or_else(|| "none".to_owned(), ToString::to_string)
}

/// Everything that is wrong with `program` in `cell`, in the order of its steps; empty when it is sound. `scene` holds the
/// part, if known, and the clearance to keep; with `expected` every capture is held against its viewpoint.
#[must_use]
pub fn check(program: &Program, cell: &Cell, scene: &CollisionScene, expected: Option<&Expected>) -> Vec<Finding> {
    let mut linter =
        Linter { cell, scene, axes: cell.axes(), expected, findings: Vec::new(), scanned: BTreeSet::new(), captured: None };
    linter.whole(program);
    let mut here = program.home_rad;
    for (index, step) in program.steps.iter().enumerate() {
        linter.step(index, step, &mut here);
    }
    linter.end(program, &here);
    linter.findings
}

/// Objections to the calibrated poses of a cell under these conditions, ages and temperature among them.
#[must_use]
pub fn check_calibration(cell: &Cell, conditions: &UseConditions) -> Vec<Finding> {
    let objections = cell.calibration_objections(conditions).into_iter();
    objections.map(|objection| Finding { step: None, fault: Fault::Calibration(objection) }).collect()
}

/// Poses of the scanner at each scan, as seen from the part.
#[must_use]
pub fn scan_poses(program: &Program, cell: &Cell, table_from_part: &Pose<Table, Part>) -> Vec<Pose<Part, ScannerFrame>> {
    scan_configurations(program).iter().map(|here| part_from_scanner(cell, table_from_part, here)).collect()
}

/// Joints and table angle at each scan.
#[must_use]
pub fn scan_configurations(program: &Program) -> Vec<Configuration> {
    let mut here = program.home_rad;
    let mut scans = Vec::new();
    for step in &program.steps {
        match step {
            Step::Move(step) => here = step.target_rad,
            Step::Scan { .. } => scans.push(here),
            Step::Settle { .. } => {}
        }
    }
    scans
}

/// [`Fault::Coverage`] where the shares of the asked area differ by more than the poses' tolerance explains.
#[must_use]
pub fn off_coverage(measured: f64, planned: f64) -> Option<Fault> {
    // A share that is no number agrees with nothing.
    let agrees = (measured - planned).abs() <= MAX_COVERAGE_DIFFERENCE;
    (!agrees).then_some(Fault::Coverage { measured, planned })
}

fn part_from_scanner(
    cell: &Cell,
    table_from_part: &Pose<Table, Part>,
    configuration: &Configuration,
) -> Pose<Part, ScannerFrame> {
    let base_from_part = cell.base_from_plate(configuration.table_rad) * plate_from_placed(table_from_part);
    base_from_part.inverse() * cell.base_from_scanner(&configuration.joints_rad)
}

/// [`Fault::OffPose`] where the scanner is not on `wanted` at these joints and this table angle.
#[must_use]
pub fn off_pose(
    cell: &Cell,
    table_from_part: &Pose<Table, Part>,
    view: ViewId,
    configuration: &Configuration,
    wanted: &Pose<Part, ScannerFrame>,
) -> Option<Fault> {
    let found = part_from_scanner(cell, table_from_part, configuration);
    let mm = (found.origin_mm() - wanted.origin_mm()).norm();
    let deg = found.isometry().rotation.angle_to(&wanted.isometry().rotation).to_degrees();
    // A pose that is none is on no viewpoint.
    let is_on = mm <= MAX_OFFSET_MM && deg <= MAX_OFFSET_DEG;
    (!is_on).then_some(Fault::OffPose { view: view.0, mm, deg })
}

impl Program {
    /// Findings on speed, settling and captures that are not as the plan orders them. A lower speed, a longer settling and a longer
    /// capture are as good. `params` and the `levels` of each view, in order, are the plan's.
    #[must_use]
    pub fn check_orders(&self, params: &PlanParams, levels: &BTreeMap<ViewId, Vec<u8>>) -> Vec<Finding> {
        let mut orders = Orders { params, still_secs: Some(0.0), captured: BTreeMap::new(), findings: Vec::new() };
        for (index, step) in self.steps.iter().enumerate() {
            orders.step(index, step);
        }
        orders.end(levels)
    }
}

/// Check of a program against the plan's parameters of motion and capture.
struct Orders<'a> {
    params: &'a PlanParams,
    /// Time of settling since the last move; `None` once a capture followed.
    still_secs: Option<f64>,
    /// First step of the captures of each view, and their levels.
    captured: BTreeMap<ViewId, (usize, Vec<u8>)>,
    findings: Vec<Finding>,
}

impl Orders<'_> {
    fn find(&mut self, step: usize, fault: Fault) {
        self.findings.push(Finding { step: Some(step), fault });
    }

    /// Checks how far off its points a move passes. A closer pass, and a stop, are as good.
    fn passed(&mut self, index: usize, passed_within_rad: Option<f64>) {
        let Some(found_rad) = passed_within_rad else { return };
        let motion = &self.params.motion;
        let planned_deg = if motion.corners == Corners::Round { motion.path_tolerance_deg } else { 0.0 };
        let is_allowed = planned_deg > 0.0 && found_rad <= planned_deg.to_radians() + ROUNDING_RAD;
        if !is_allowed {
            // As documents give it, without what radians and back leave.
            let found_deg = (found_rad.to_degrees() * 1e9).round() / 1e9;
            self.find(index, Fault::PassedWide { found_deg, planned_deg });
        }
    }

    fn step(&mut self, index: usize, step: &Step) {
        match step {
            Step::Move(step) => {
                self.still_secs = Some(0.0);
                let (found, planned) = (step.speed_fraction, self.params.motion.speed_fraction);
                let is_allowed = found <= planned + ROUNDING_SPEED;
                if !is_allowed {
                    self.find(index, Fault::TooFast { found, planned });
                }
                self.passed(index, step.passed_within_rad);
            }
            Step::Settle { secs } => self.still_secs = self.still_secs.map(|still_secs| still_secs + secs),
            Step::Scan { view, brightness, capture_secs } => {
                self.settled(index, *view);
                self.captured.entry(*view).or_insert_with(|| (index, Vec::new())).1.push(*brightness);
                let (found, planned) = (*capture_secs, self.params.scan.capture_secs);
                let is_allowed = found >= planned - ROUNDING_SECS;
                if !is_allowed {
                    self.find(index, Fault::ShortCapture { found, planned });
                }
            }
        }
    }

    /// Holds the first capture after a move against the time of settling.
    fn settled(&mut self, index: usize, view: ViewId) {
        let Some(found) = self.still_secs.take() else { return };
        let planned = self.params.scan.settle_secs;
        let is_allowed = found >= planned - ROUNDING_SECS;
        if !is_allowed {
            self.find(index, Fault::Unsettled { view: view.0, found, planned });
        }
    }

    /// Everything found; a view that is never or not to be scanned is left to [`check`].
    fn end(mut self, levels: &BTreeMap<ViewId, Vec<u8>>) -> Vec<Finding> {
        for (view, (index, found)) in std::mem::take(&mut self.captured) {
            if let Some(planned) = levels.get(&view).filter(|planned| **planned != found) {
                self.find(index, Fault::OtherLevels { view: view.0, found, planned: planned.clone() });
            }
        }
        self.findings
    }
}

struct Linter<'a> {
    cell: &'a Cell,
    scene: &'a CollisionScene,
    axes: Axes,
    expected: Option<&'a Expected>,
    findings: Vec<Finding>,
    scanned: BTreeSet<ViewId>,
    /// View and brightness of the capture since which nothing has moved.
    captured: Option<(ViewId, u8)>,
}

impl Linter<'_> {
    fn find(&mut self, step: Option<usize>, fault: Fault) {
        self.findings.push(Finding { step, fault });
    }

    fn whole(&mut self, program: &Program) {
        // Ages and temperatures are for whoever has a clock: `check_calibration`.
        self.findings.extend(check_calibration(self.cell, &UseConditions::default()));
        let present = ProgramCalibration::of(self.cell);
        if program.calibration != present {
            self.find(None, Fault::OtherCalibration { program: program.calibration.clone(), cell: present });
        }
        let hardware =
            [("robot", &program.robot, &self.cell.robot.name), ("turntable", &program.turntable, &self.cell.turntable.name)];
        for (what, program, cell) in hardware.map(|(what, program, cell)| (what, program.clone(), cell.clone())) {
            if program != cell {
                self.find(None, Fault::OtherHardware { what, program, cell });
            }
        }
        if let Some(expected) = self.expected.filter(|expected| expected.plan_sha256 != program.plan_sha256) {
            let (program, plan) = (program.plan_sha256.clone(), expected.plan_sha256.clone());
            self.find(None, Fault::OtherPlan { program, plan });
        }
        if !is_same(&program.home_rad, &self.cell.home_rad) {
            self.find(None, Fault::OtherHome);
        }
        // No check of a move tests part and fixture against what stands below the plate, on which they may lie.
        if let Some(contact) = self.scene.placement_contact() {
            self.find(None, Fault::Placement { contact });
        }
    }

    fn step(&mut self, index: usize, step: &Step, here: &mut Configuration) {
        if !(step.secs().is_finite() && step.secs() >= 0.0) {
            self.find(Some(index), Fault::Time(step.secs()));
        }
        match step {
            Step::Move(step) => {
                self.captured = None;
                self.travel(index, step, here);
                *here = step.target_rad;
            }
            Step::Settle { .. } => {}
            Step::Scan { view, brightness, .. } => self.capture(index, *view, *brightness, here),
        }
    }

    fn travel(&mut self, index: usize, step: &Move, here: &Configuration) {
        let points: Vec<_> = std::iter::once(here).chain(&step.via_rad).chain([&step.target_rad]).copied().collect();
        if points[1..].iter().filter(|point| !self.within_limits(index, point)).count() > 0 {
            return;
        }
        if !(step.speed_fraction > 0.0 && step.speed_fraction <= 1.0) {
            return self.find(Some(index), Fault::SpeedFraction(step.speed_fraction));
        }
        let (stated, derived) = (step.duration_secs, step.derived_secs(here, &self.axes));
        // A time that is no number agrees with nothing.
        let agrees = (stated - derived).abs() <= ROUNDING_SECS;
        if !agrees {
            self.find(Some(index), Fault::Duration { stated, derived });
        }
        let table_alone = self.expected.is_some_and(|expected| expected.table_alone);
        for (segment, ends) in points.windows(2).enumerate() {
            if table_alone && ends[0].turns_table(&ends[1]) && ends[0].moves_arm(&ends[1]) {
                self.find(Some(index), Fault::Together { segment });
            }
            if let Some(contact) = self.scene.check_segment(&ends[0], &ends[1]) {
                self.find(Some(index), Fault::Collision { segment, contact });
            }
        }
        if let Some(within_rad) = step.passed_within_rad {
            self.pass(index, &points, within_rad, table_alone);
        }
    }

    /// Checks the curve that passes points without stopping, beside the straight segments, which executors may follow too. It
    /// moves table and arm between a segment of the one and a segment of the other.
    fn pass(&mut self, index: usize, points: &[Configuration], within_rad: f64, table_alone: bool) {
        for bend in SmoothPath::through(points, within_rad).bends() {
            let is_together =
                table_alone && bend.windows(2).any(|ends| ends[0].turns_table(&ends[1]) && ends[0].moves_arm(&ends[1]));
            let contact = bend.windows(2).find_map(|ends| self.scene.check_segment(&ends[0], &ends[1]));
            if !is_together && contact.is_none() {
                continue;
            }
            let middle = &bend[bend.len() / 2];
            let corners = points.iter().enumerate().skip(1);
            let nearest = corners.min_by(|(_, a), (_, b)| a.distance_rad(middle).total_cmp(&b.distance_rad(middle)));
            let segment = nearest.map_or(0, |(corner, _)| corner - 1);
            let together = Finding { step: Some(index), fault: Fault::Together { segment } };
            // A segment that moves both is a finding already.
            if is_together && !self.findings.contains(&together) {
                self.findings.push(together);
            }
            if let Some(contact) = contact {
                self.find(Some(index), Fault::Collision { segment, contact });
            }
        }
    }

    fn within_limits(&mut self, index: usize, point: &Configuration) -> bool {
        let mut within = true;
        for (axis, (limits, angle)) in self.axes.0.into_iter().zip(point.axes_rad()).enumerate() {
            let (min_rad, max_rad) = (limits.min_rad - ROUNDING_RAD, limits.max_rad + ROUNDING_RAD);
            if !(min_rad <= angle && angle <= max_rad) {
                within = false;
                let [angle_deg, min_deg, max_deg] = [angle, limits.min_rad, limits.max_rad].map(f64::to_degrees);
                self.find(Some(index), Fault::OutsideLimits { axis: axis + 1, angle_deg, min_deg, max_deg });
            }
        }
        within
    }

    fn capture(&mut self, index: usize, view: ViewId, brightness: u8, here: &Configuration) {
        if brightness > MAX_BRIGHTNESS {
            self.find(Some(index), Fault::Brightness(brightness));
        }
        // Two captures of one pose differ in their brightness.
        let is_second = self.captured.replace((view, brightness)).is_some_and(|(last, level)| last == view && level < brightness);
        if !self.scanned.insert(view) && !is_second {
            self.find(Some(index), Fault::Twice(view.0));
        }
        let Some(expected) = self.expected else { return };
        let Some((_, wanted)) = expected.views.iter().find(|(id, _)| *id == view) else {
            return self.find(Some(index), Fault::UnknownView(view.0));
        };
        if let Some(fault) = off_pose(self.cell, &expected.table_from_part, view, here, wanted) {
            self.find(Some(index), fault);
        }
    }

    fn end(&mut self, program: &Program, here: &Configuration) {
        if !is_same(here, &program.home_rad) {
            self.find(None, Fault::NotHome);
        }
        for (view, _) in self.expected.iter().flat_map(|expected| &expected.views) {
            if !self.scanned.contains(view) {
                self.findings.push(Finding { step: None, fault: Fault::NeverScanned(view.0) });
            }
        }
        // Adding 0 turns −0, the sum of no steps, into 0.
        let (stated, derived) = (program.cycle_secs, program.steps.iter().map(Step::secs).sum::<f64>() + 0.0);
        // A cycle time that is no number agrees with nothing.
        let agrees = (stated - derived).abs() <= ROUNDING_SECS;
        if !agrees {
            self.find(None, Fault::CycleTime { stated, derived });
        }
    }
}

fn is_same(a: &Configuration, b: &Configuration) -> bool {
    a.travel_rad(b).iter().all(|turn| turn.abs() <= ROUNDING_RAD)
}
