//! A part that a locating scan found elsewhere than planned: the program for it, with every view at its place on the part, or in
//! words how to put the part right.
//!
//! Within bounds, each view's station is derived anew: the table takes the turn about its own axis where its limits and the bodies
//! of the cell let it, else another angle near it, the arm the rest, in the posture and the winding of before. Ways keep their
//! points, moved along with their ends where that is free, or unmoved; where neither is, a free way is searched for. What comes out
//! has passed the linter with the part where it lies, and the reference engine says what it measures.

use std::f64::consts::{FRAC_PI_4, TAU};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use nalgebra::Vector3;

use crate::cell::{Cell, CollisionScene, Configuration};
use crate::geometry::{Mesh, Part, Plate, Pose, ScannerFrame, Table, plate_from_placed, sort_ascending};
use crate::planning::PlanInput;
use crate::planning::certificate::recheck::{self, TakenView};
use crate::planning::context::{Cancelled, Context, Silent};
use crate::planning::params::{MotionParams, PlanParams, TableMotion};
use crate::planning::plan::ViewId;
use crate::planning::sequence::join;
use crate::planning::stations;
use crate::program::{Expected, Finding, Move, Program, Step, check, interlock, scan_configurations, scan_poses};

/// Turn of a joint from the planned station up to which a station stands as planned. One that stands otherwise is taken where none of
/// these is free.
const MAX_TURN_RAD: f64 = FRAC_PI_4;
/// Table angles that are tried beside the derived one, nearest first, degrees.
const TABLE_OFFSETS_DEG: [f64; 6] = [10.0, -10.0, 20.0, -20.0, 30.0, -30.0];
/// Largest difference of coverage, share of the asked area.
const MAX_COVERAGE_LOSS: f64 = 0.005;

/// Bounds of what is corrected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocateBounds {
    /// Largest angle, degrees.
    pub max_deg: f64,
    /// Largest distance of the part's middle, mm.
    pub max_mm: f64,
}

impl Default for LocateBounds {
    fn default() -> Self {
        Self { max_deg: 5.0, max_mm: 15.0 }
    }
}

/// A program for the part where it lies.
#[derive(Clone, Debug)]
pub struct Relocated {
    /// Program with re-derived targets; step by step that of before.
    pub program: Program,
    /// The cell with the part where it lies.
    pub scene: CollisionScene,
    /// Shares of the asked area that the planned and the re-derived scans measure, where parameters were given.
    pub coverage: Option<[f64; 2]>,
}

/// Reason why a program does not fit the part where it lies.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Misplaced {
    /// Further off than is corrected.
    #[error(
        "the part lies {mm:.1} mm and {deg:.1}° off, more than the {max_mm} mm and {max_deg}° that are corrected; {correction}"
    )]
    TooFar {
        /// Distance of its middle.
        mm: f64,
        /// Angle, degrees.
        deg: f64,
        /// Distance allowed.
        max_mm: f64,
        /// Angle allowed, degrees.
        max_deg: f64,
        /// Words for how to correct it.
        correction: String,
    },
    /// Out of reach.
    #[error("viewpoint {view} is out of the arm's reach with the part {mm:.1} mm and {deg:.1}° off; {correction}")]
    Unreachable {
        /// Number of the view.
        view: u32,
        /// Distance of its middle.
        mm: f64,
        /// Angle, degrees.
        deg: f64,
        /// Words for how to correct it.
        correction: String,
    },
    /// The program is not free of collisions, or not sound, with the part there.
    #[error("with the part {mm:.1} mm and {deg:.1}° off the program is not sound ({finding}); {correction}")]
    Unsound {
        /// First finding of the linter.
        finding: String,
        /// Distance of its middle.
        mm: f64,
        /// Angle, degrees.
        deg: f64,
        /// Words for how to correct it.
        correction: String,
    },
    /// Less to be seen.
    #[error(
        "with the part {mm:.1} mm and {deg:.1}° off the scans measure {:.2} % of the asked area instead of {:.2} %; \
         {correction}",
        100.0 * measured, 100.0 * planned
    )]
    Coverage {
        /// Share measured.
        measured: f64,
        /// Share planned.
        planned: f64,
        /// Distance of its middle.
        mm: f64,
        /// Angle, degrees.
        deg: f64,
        /// Words for how to correct it.
        correction: String,
    },
    /// Nobody waits for the program any longer.
    #[error("cancelled")]
    Cancelled,
}

impl From<Cancelled> for Misplaced {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

/// Derives the program for a part from the pose that it was found in.
pub trait Relocate: Send + Sync {
    /// The program for the part at `table_from_part`. Takes as long as the linter and an evaluation of coverage, and some seconds
    /// for each station or way that is searched for; ends soon after `cancelled` is true.
    ///
    /// # Errors
    /// [`Misplaced`].
    fn relocate(
        &self,
        program: &Program,
        table_from_part: &Pose<Table, Part>,
        cancelled: &AtomicBool,
    ) -> Result<Relocated, Misplaced>;
}

/// Inputs for rederiving a program for a located part.
#[derive(Clone, Debug)]
pub struct Locating {
    /// The cell.
    pub cell: Arc<Cell>,
    /// The part.
    pub part: Arc<Mesh>,
    /// Fixture that holds it, in part coordinates.
    pub fixture: Option<Arc<Mesh>>,
    /// Requirements of the plan on the program, with the part where it was planned.
    pub planned: Expected,
    /// Clearance of the plan.
    pub clearance_mm: f64,
    /// Bounds.
    pub bounds: LocateBounds,
    /// Parameters of the plan with the hash of the part, for coverage; `None` leaves it out.
    pub coverage: Option<(PlanParams, String)>,
}

/// Configuration of a scan as planned, and the pose of the scanner there.
type PlannedScan = (Configuration, Pose<Part, ScannerFrame>);

/// Distance of the part from where it was planned.
struct PartOffset {
    mm: f64,
    deg: f64,
    correction: String,
}

impl Relocate for Locating {
    fn relocate(
        &self,
        program: &Program,
        table_from_part: &Pose<Table, Part>,
        cancelled: &AtomicBool,
    ) -> Result<Relocated, Misplaced> {
        let ctx = Context::new(cancelled, &Silent);
        let offset = self.offset(table_from_part);
        let LocateBounds { max_deg, max_mm } = self.bounds;
        // A pose that is not a number is not within.
        if !(offset.mm <= max_mm && offset.deg <= max_deg) {
            return Err(Misplaced::TooFar { mm: offset.mm, deg: offset.deg, max_mm, max_deg, correction: offset.correction });
        }
        ctx.check()?;
        let fixture = self.fixture.as_deref();
        let scene = CollisionScene::new(&self.cell, &self.part, fixture, table_from_part, self.clearance_mm);
        ctx.check()?;
        // No check of a move tests part and fixture against what stands below the plate, on which they may lie.
        if let Some(contact) = scene.placement_contact() {
            let finding = format!("as it lies, {contact} meet");
            return Err(Misplaced::Unsound { finding, mm: offset.mm, deg: offset.deg, correction: offset.correction });
        }
        let stations = self.stations(program, &scene, table_from_part, &ctx)?;
        let program = self.first_sound_program(program, &stations, &scene, table_from_part, &ctx)?;
        let coverage = self.coverage_of(&program, table_from_part, offset, &ctx)?;
        Ok(Relocated { program, scene, coverage })
    }
}

impl Locating {
    fn offset(&self, located: &Pose<Table, Part>) -> PartOffset {
        let (planned, aabb) = (&self.planned.table_from_part, self.part.aabb());
        let middle = nalgebra::center(&aabb.min, &aabb.max);
        let moved = located.point(&middle) - planned.point(&middle);
        let turned = located.isometry().rotation * planned.isometry().rotation.inverse();
        let about_z = yaw(located, planned).to_degrees();
        let tilt = turned.transform_vector(&Vector3::z()).angle(&Vector3::z()).to_degrees();
        let side =
            |value: f64, axis: &str| format!("{:.1} mm towards {}{axis}", value.abs(), if value > 0.0 { "−" } else { "+" });
        let sense = if about_z > 0.0 { "clockwise" } else { "counter-clockwise" };
        let mut correction = format!(
            "move it {} and {} of the plate, and turn it {:.1}° {sense} seen from above",
            side(moved.x, "x"),
            side(moved.y, "y"),
            about_z.abs()
        );
        if moved.z.abs() > 1.0 || tilt > 0.5 {
            correction += &format!(
                "; it lies {:.1} mm {} and tilted by {tilt:.1}°: see that it rests as planned",
                moved.z.abs(),
                if moved.z > 0.0 { "too high" } else { "too low" }
            );
        }
        PartOffset { mm: moved.norm(), deg: turned.angle().to_degrees(), correction }
    }

    /// Station of each scan, free where one is.
    ///
    /// # Errors
    /// [`Misplaced::Unreachable`], of the first view that has none; [`Misplaced::Cancelled`].
    fn stations(
        &self,
        program: &Program,
        scene: &CollisionScene,
        located: &Pose<Table, Part>,
        ctx: &Context<'_>,
    ) -> Result<Vec<Configuration>, Misplaced> {
        let poses = scan_poses(program, &self.cell, &self.planned.table_from_part);
        let views = program.steps.iter().filter_map(|step| match step {
            Step::Scan { view, .. } => Some(*view),
            Step::Move(_) | Step::Settle { .. } => None,
        });
        let axes = self.cell.axes();
        let turn_rad = yaw(located, &self.planned.table_from_part);
        let scans = scan_configurations(program).into_iter().zip(poses).zip(views);
        let unreachable = |view: ViewId| {
            let PartOffset { mm, deg, correction } = self.offset(located);
            Misplaced::Unreachable { view: view.0, mm, deg, correction }
        };
        let station = |((planned, part_from_scanner), view): (PlannedScan, ViewId)| -> Result<_, Misplaced> {
            ctx.check()?;
            let plate_from_scanner = plate_from_placed(located) * part_from_scanner;
            let derived_rad = planned.table_rad - turn_rad;
            let beside = TABLE_OFFSETS_DEG.map(|offset_deg| derived_rad + offset_deg.to_radians());
            let angles = [derived_rad, planned.table_rad].into_iter().chain(beside);
            let mut near = angles.flat_map(|table_rad| self.stations_at(&planned, table_rad, &plate_from_scanner)).peekable();
            let first = near.peek().copied();
            let is_free = |station: &Configuration| scene.check(station).is_none();
            if let Some(station) = near.find(is_free) {
                return Ok(station);
            }
            let found = stations::solve(&[part_from_scanner], &self.cell, scene, located, ctx)?.pop();
            let free = found.and_then(Result::ok).into_iter().flatten().map(|station| station.configuration());
            let anywhere = free.min_by(|a, b| axes.move_secs(&planned, a, 1.0).total_cmp(&axes.move_secs(&planned, b, 1.0)));
            anywhere.or(first).ok_or_else(|| unreachable(view))
        };
        scans.map(station).collect()
    }

    /// Stations at a table angle that stand as the planned one does, nearest first.
    fn stations_at(
        &self,
        planned: &Configuration,
        table_rad: f64,
        plate_from_scanner: &Pose<Plate, ScannerFrame>,
    ) -> Vec<Configuration> {
        let base_from_scanner = self.cell.base_from_plate(table_rad) * *plate_from_scanner;
        let base_from_flange = base_from_scanner * self.cell.flange_from_scanner.inverse();
        let wound = |joints: [f64; 6]| {
            let joints_rad = std::array::from_fn(|joint| {
                let turns = ((planned.joints_rad[joint] - joints[joint]) / TAU).round();
                joints[joint] + TAU * turns
            });
            Configuration { joints_rad, table_rad }
        };
        let solutions = self.cell.robot.kinematics.ik_solutions(&base_from_flange).into_iter().map(wound);
        let axes = self.cell.axes();
        let turn = |station: &Configuration| {
            let joints = planned.joints_rad.iter().zip(station.joints_rad);
            joints.map(|(planned, joint)| (planned - joint).abs()).fold(0.0, f64::max)
        };
        let fits = |station: &Configuration| axes.allow(station) && turn(station) <= MAX_TURN_RAD;
        let mut stations: Vec<_> = solutions.filter(fits).collect();
        sort_ascending(&mut stations, |station| turn(station));
        stations
    }

    /// The first of the programs over these stations that the linter finds nothing in.
    ///
    /// # Errors
    /// [`Misplaced::Unsound`], with the finding in the first of them; [`Misplaced::Cancelled`].
    fn first_sound_program(
        &self,
        program: &Program,
        stations: &[Configuration],
        scene: &CollisionScene,
        located: &Pose<Table, Part>,
        ctx: &Context<'_>,
    ) -> Result<Program, Misplaced> {
        let expected = Expected { table_from_part: *located, ..self.planned.clone() };
        let is_interlocked = expected.table_alone || moves_alone(program);
        let search = Search::new(&self.cell, scene, is_interlocked, ctx);
        let mut first = None;
        for points in [Points::Moved, Points::Kept, Points::PlannedStations, Points::Searched] {
            let derived = over(program, stations, points, &search)?;
            ctx.check()?;
            let derived = if is_interlocked { interlock(&derived, &self.cell, scene) } else { Ok(derived) };
            let found = match derived {
                Err(together) => together.to_string(),
                Ok(derived) => match check(&derived, &self.cell, scene, Some(&expected)).first() {
                    None => return Ok(derived),
                    Some(finding) => Finding::to_string(finding),
                },
            };
            first.get_or_insert(found);
        }
        let PartOffset { mm, deg, correction } = self.offset(located);
        Err(Misplaced::Unsound { finding: first.unwrap_or_default(), mm, deg, correction })
    }

    fn coverage_of(
        &self,
        program: &Program,
        located: &Pose<Table, Part>,
        offset: PartOffset,
        ctx: &Context<'_>,
    ) -> Result<Option<[f64; 2]>, Misplaced> {
        let Some((params, part_sha256)) = &self.coverage else { return Ok(None) };
        let input = PlanInput {
            mesh: &self.part,
            fixture: self.fixture.as_deref(),
            part_sha256,
            scanner: &self.cell.scanner,
            cell: Some(&self.cell),
            roadmaps: None,
        };
        let stations = scan_configurations(program);
        let PartOffset { mm, deg, correction } = offset;
        let share = |table_from_part: &Pose<Table, Part>, views: &[TakenView]| -> Result<f64, Misplaced> {
            let measured = recheck::measured_in_cell(&input, params, table_from_part, views, ctx);
            ctx.check()?;
            let measured = measured.map_err(|error| Misplaced::Unsound {
                finding: error.to_string(),
                mm,
                deg,
                correction: correction.clone(),
            });
            measured.map(|measured| measured.measured_mm2 / measured.asked_mm2)
        };
        let planned_views: Vec<TakenView> = (self.planned.views.iter())
            .map(|(_, part_from_scanner)| TakenView { part_from_scanner: *part_from_scanner, table_rad: None })
            .collect();
        let views = scan_poses(program, &self.cell, located).into_iter().zip(stations);
        let views: Vec<TakenView> =
            views.map(|(part_from_scanner, here)| TakenView { part_from_scanner, table_rad: Some(here.table_rad) }).collect();
        let (planned, measured) = (share(&self.planned.table_from_part, &planned_views)?, share(located, &views)?);
        if planned - measured > MAX_COVERAGE_LOSS {
            return Err(Misplaced::Coverage { measured, planned, mm, deg, correction });
        }
        Ok(Some([planned, measured]))
    }
}

/// Treatment of the points between stations.
#[derive(Clone, Copy, PartialEq)]
enum Points {
    /// Moved along with the ends.
    Moved,
    /// Left as planned.
    Kept,
    /// Left as planned, with the planned stations at both ends.
    PlannedStations,
    /// Moved along with the ends where that is free, else searched for.
    Searched,
}

/// Search for free ways with the part where it lies.
struct Search<'a> {
    cell: &'a Cell,
    scene: &'a CollisionScene,
    motion: MotionParams,
    ctx: &'a Context<'a>,
}

impl<'a> Search<'a> {
    fn new(cell: &'a Cell, scene: &'a CollisionScene, is_interlocked: bool, ctx: &'a Context<'a>) -> Self {
        let table = if is_interlocked { TableMotion::Alone } else { TableMotion::WithArm };
        Self { cell, scene, motion: MotionParams { table, ..MotionParams::default() }, ctx }
    }

    /// Returns these points, or others where the way through them is not free; these too where no other way is found, for the
    /// linter to say what is in the way.
    fn free_path(
        &self,
        from: &Configuration,
        via_rad: Vec<Configuration>,
        to: &Configuration,
    ) -> Result<Vec<Configuration>, Cancelled> {
        let points: Vec<_> = std::iter::once(*from).chain(via_rad.iter().copied()).chain([*to]).collect();
        let found = join(self.cell, self.scene, &self.motion, &points, self.ctx)?;
        Ok(found.unwrap_or(via_rad))
    }
}

/// The program with other stations for its scans.
fn over(program: &Program, stations: &[Configuration], points: Points, search: &Search<'_>) -> Result<Program, Cancelled> {
    let (axes, mut scans) = (search.cell.axes(), 0);
    let (mut planned_here, mut here) = (program.home_rad, program.home_rad);
    let mut steps = Vec::with_capacity(program.steps.len());
    for (index, step) in program.steps.iter().enumerate() {
        let Step::Move(step) = step else {
            scans += usize::from(matches!(step, Step::Scan { .. }));
            steps.push(step.clone());
            continue;
        };
        let target_rad = if scans_next(&program.steps[index + 1..]) {
            stations.get(scans).copied().unwrap_or(step.target_rad)
        } else {
            step.target_rad
        };
        let mut via_rad = between(step, [&planned_here, &here, &target_rad], points);
        if points == Points::Searched {
            via_rad = search.free_path(&here, via_rad, &target_rad)?;
        }
        let mut derived = Move { via_rad, target_rad, ..step.clone() };
        derived.duration_secs = derived.derived_secs(&here, &axes);
        (planned_here, here) = (step.target_rad, target_rad);
        steps.push(Step::Move(derived));
    }
    Ok(Program { cycle_secs: steps.iter().map(Step::secs).sum(), steps, ..program.clone() })
}

fn scans_next(steps: &[Step]) -> bool {
    let next = steps.iter().find(|step| !matches!(step, Step::Settle { .. }));
    matches!(next, Some(Step::Scan { .. }))
}

fn between(step: &Move, [planned_from, from, to]: [&Configuration; 3], points: Points) -> Vec<Configuration> {
    let (at_start, at_end) = (planned_from.travel_rad(from), step.target_rad.travel_rad(to));
    let count = step.via_rad.len() as f64 + 1.0;
    let moved = |(index, via): (usize, &Configuration)| {
        let share = (index as f64 + 1.0) / count;
        via.along(&at_start, 1.0 - share).along(&at_end, share)
    };
    match points {
        Points::Moved | Points::Searched => step.via_rad.iter().enumerate().map(moved).collect(),
        Points::Kept => step.via_rad.clone(),
        Points::PlannedStations => {
            let mut all = vec![*planned_from];
            all.extend(&step.via_rad);
            all.push(step.target_rad);
            all
        }
    }
}

/// Returns true if no segment of the program moves arm and table together.
pub(super) fn moves_alone(program: &Program) -> bool {
    let mut here = program.home_rad;
    program.steps.iter().all(|step| {
        let Step::Move(step) = step else { return true };
        let points: Vec<_> = std::iter::once(here).chain(step.via_rad.iter().copied()).chain([step.target_rad]).collect();
        here = step.target_rad;
        points.windows(2).all(|ends| !(ends[0].turns_table(&ends[1]) && ends[0].moves_arm(&ends[1])))
    })
}

/// Turn about the plate's axis from where the part was planned to where it lies.
fn yaw(located: &Pose<Table, Part>, planned: &Pose<Table, Part>) -> f64 {
    let turned = located.isometry().rotation * planned.isometry().rotation.inverse();
    // The twist about z (swing-twist decomposition). After half a turn about an axis in the plate any twist is right: 0.
    2.0 * (turned.k * turned.w.signum()).atan2(turned.w.abs())
}

#[cfg(test)]
mod tests;
