//! Our sequencing on the public task of RoboTSP (F. Suárez-Ruiz, T. S. Lembono and Q.-C. Pham, "RoboTSP – A Fast Solution to
//! the Robotic Task Sequencing Problem", ICRA 2018, arXiv 1709.09343): 245 holes of a panel, each drilled from eight
//! rotations about the drill and from every branch of the arm, from home and back. `tests/benches/robotsp.py` writes the task
//! from the peer's public files; then `cargo bench --bench robotsp -- FOLDER` writes `tests/benches/ROBOTSP.md`. A number
//! after the folder: only columns of up to so many targets, and the file is left alone.
//!
//! Seconds are by the clock, from targets to checked moves: inverse kinematics, collision, order, moves.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rayon::ThreadPoolBuilder;
use rayon::prelude::*;
use serde::Deserialize;

use rustix::time::{ClockId, clock_gettime};
use vantage::cell::urdf::{UrdfOptions, import};
use vantage::cell::{
    Body, BodySpec, Cell, CollisionScene, Configuration, Named, PoseSpec, Presets, RobotSpec, RotationSpec, ScannerSpec, Shape,
    SpecLibrary, TurntableSpec,
};
use vantage::geometry::mesh_io::{self, Limits};
use vantage::geometry::{Base, LengthUnit, Mesh, Pose, ScannerFrame as Tool};
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::PlanParams;
use vantage::planning::plan::ViewId;
use vantage::planning::sequence::{Sequence, bounded, order};
use vantage::planning::stations::Station;

/// Threads that plan.
const THREADS: usize = 2;

/// Task that `robotsp.py` writes.
#[derive(Deserialize)]
struct Task {
    targets: Vec<Target>,
    subsets: Vec<Vec<usize>>,
    accelerations_rad_per_s2: [f64; 6],
    home_deg: [f64; 6],
    standoff_mm: f64,
    step_deg: f64,
    flange_from_tip: PoseSpec,
    tool: Vec<BodySpec>,
    obstacles: Vec<BodySpec>,
    published: BTreeMap<String, Published>,
    published_configurations: Vec<usize>,
}

#[derive(Deserialize)]
struct Target {
    position_mm: [f64; 3],
    direction: [f64; 3],
}

/// A figure for each column; none where the peer failed.
#[derive(Deserialize)]
struct Published {
    cpu_secs: Vec<Option<f64>>,
    execution_secs: Vec<Option<f64>>,
}

/// Results of one column.
struct Column {
    targets: usize,
    left_out: usize,
    stations: usize,
    stations_secs: f64,
    wall_secs: f64,
    cpu_secs: f64,
    sequence: Sequence,
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    let Some(folder) = words.first().map(PathBuf::from) else {
        return println!("no folder named: see the head of tests/benches/robotsp.rs");
    };
    let most: Option<usize> = words.get(1).map(|word| word.parse().expect("a number of targets"));
    let text = fs::read_to_string(folder.join("task.json")).expect("task.json, which robotsp.py writes");
    let task: Task = serde_json::from_str(&text).expect("what robotsp.py writes");
    let cell = cell(&task, &folder);
    let pool = ThreadPoolBuilder::new().num_threads(THREADS).build().expect("threads");
    let chosen = task.subsets.iter().filter(|subset| most.is_none_or(|most| subset.len() <= most));
    let columns: Vec<_> = chosen.map(|subset| pool.install(|| column(&task, subset, &cell))).collect();
    let text = report(&task, &columns);
    println!("{text}");
    if most.is_none() {
        fs::write(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/benches/ROBOTSP.md"), text).expect("ROBOTSP.md can be written");
    }
}

/// The peer's arm, drill and world as a cell; its table stands aside and does not turn.
fn cell(task: &Task, folder: &Path) -> Cell {
    let mut spec = Presets.cell("e05-transcan").expect("a preset");
    let mut scanner: ScannerSpec = Presets.scanner("transcan-c").expect("a preset");
    (scanner.body, scanner.mass_kg) = (Vec::new(), 0.1);
    let mut table: TurntableSpec = Presets.turntable("minas-a6-500").expect("a preset");
    (table.rotation, table.body) = (RotationSpec::Limited { min_deg: 0.0, max_deg: 1e-6 }, Vec::new());
    spec.robot = Named::Inline(Box::new(robot(task, folder)));
    spec.scanner = Named::Inline(Box::new(scanner));
    spec.turntable = Named::Inline(Box::new(table));
    spec.base_from_table.translation_mm = [0.0, 0.0, -1200.0];
    spec.flange_from_scanner = task.flange_from_tip;
    spec.mount.clone_from(&task.tool);
    spec.obstacles.clone_from(&task.obstacles);
    spec.floor_mm = None;
    spec.home_deg = std::array::from_fn(|axis| task.home_deg.get(axis).copied().unwrap_or(0.0));
    let mut cell = spec.build(&Presets).expect("a sound cell");
    let shape = Shape::Mesh(Arc::new(mesh(&folder.join("jig.stl")).expect("a mesh")));
    // Out of the way, where a cell that scans may not have it.
    cell.base_from_table = Pose::from_parts(Vector3::new(0.0, 0.0, -5000.0), UnitQuaternion::identity());
    cell.obstacles.push(Body { name: "jig".into(), owner_from_body: Isometry3::identity(), shape });
    cell
}

fn robot(task: &Task, folder: &Path) -> RobotSpec {
    let text = fs::read_to_string(folder.join("arm.urdf")).expect("readable");
    // A payload is not among the peer's files, and nothing here depends on it.
    let options = UrdfOptions { name: None, base_link: None, tip_link: None, payload_kg: 10.0, ramp_secs: 1.0 };
    let mut spec = import(&text, &options, &mut |name: &str| mesh(&folder.join(name))).expect("a robot").robot;
    for (joint, acceleration) in spec.joints.iter_mut().zip(task.accelerations_rad_per_s2) {
        joint.max_acceleration_deg_per_s2 = acceleration.to_degrees();
    }
    spec
}

/// Numbers as they stand.
fn mesh(path: &Path) -> Result<Mesh, String> {
    let bytes = fs::read(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let read = mesh_io::read(&bytes, Some(LengthUnit::Millimetre), &Limits::default());
    read.map(|read| read.mesh).map_err(|error| error.to_string())
}

fn column(task: &Task, subset: &[usize], cell: &Cell) -> Column {
    let (never, params) = (AtomicBool::new(false), params());
    let (began, cpu_secs_before) = (Instant::now(), cpu_secs());
    let scene = CollisionScene::without_part(cell, params.motion.clearance_mm);
    let stations_of =
        |(number, target): (usize, &usize)| (ViewId::at(number), stations(task, &task.targets[*target], cell, &scene));
    let stations: Vec<(ViewId, Vec<Station>)> = subset.par_iter().enumerate().map(stations_of).collect();
    let stations_secs = began.elapsed().as_secs_f64();
    let reached: Vec<_> = stations.iter().filter(|(_, of)| !of.is_empty()).map(|(view, of)| (*view, &of[..])).collect();
    let ctx = Context::new(&never, &Silent);
    let ordered = order(&reached, cell, &scene, &params, None, false, &ctx).expect("not cancelled");
    let ordered = bounded(ordered, cell, &params, &ctx).expect("not cancelled");
    let column = Column {
        targets: subset.len(),
        left_out: subset.len() - ordered.sequence.visits.len(),
        stations: stations.iter().map(|(_, of)| of.len()).sum(),
        stations_secs,
        wall_secs: began.elapsed().as_secs_f64(),
        cpu_secs: cpu_secs() - cpu_secs_before,
        sequence: ordered.sequence,
    };
    eprintln!(
        "{} targets, {} left out, {} stations in {:.2} s; {:.1} s, CPU {:.1} s; cycle {:.2} s, at least {:.2} s",
        column.targets,
        column.left_out,
        column.stations,
        column.stations_secs,
        column.wall_secs,
        column.cpu_secs,
        column.sequence.motion_secs(),
        column.sequence.lower_bound_secs
    );
    column
}

/// Seconds of all threads of this process so far.
fn cpu_secs() -> f64 {
    let now = clock_gettime(ClockId::ProcessCPUTime);
    now.tv_sec as f64 + 1e-9 * now.tv_nsec as f64
}

/// The arm's rated speeds, which the task gives, and the least clearance that we know: the peer keeps none.
fn params() -> PlanParams {
    let mut params = PlanParams::default();
    (params.motion.speed_fraction, params.motion.clearance_mm) = (1.0, 1.0);
    params
}

/// Every way to stand before a hole: rotations about the drill, branches, whole turns.
fn stations(task: &Task, target: &Target, cell: &Cell, scene: &CollisionScene) -> Vec<Station> {
    let direction = Vector3::from(target.direction);
    let at = Vector3::from(target.position_mm) - direction * task.standoff_mm;
    let towards = UnitQuaternion::rotation_between(&Vector3::z(), &direction).expect("not backwards");
    let (axes, mut stations) = (cell.axes(), Vec::new());
    for step in 0..(360.0 / task.step_deg).round() as u32 {
        let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), (f64::from(step) * task.step_deg).to_radians());
        let base_from_tool: Pose<Base, Tool> = Pose::claim(Isometry3::from_parts(Translation3::from(at), towards * turned));
        for joints_rad in cell.robot.kinematics.ik_solutions(&(base_from_tool * cell.flange_from_scanner.inverse())) {
            let wound = axes.windings(&Configuration { joints_rad, table_rad: 0.0 });
            if wound.first().is_some_and(|configuration| scene.check(configuration).is_none()) {
                stations.extend(wound.into_iter().map(Station::from));
            }
        }
    }
    stations
}

/// The file: what was run, a row for each column, and how the two set-ups differ.
fn report(task: &Task, columns: &[Column]) -> String {
    let mut text = format!("{HEAD}\n| targets |{}\n", columns.iter().map(|c| format!(" {} |", c.targets)).collect::<String>());
    text += &format!("| --- |{}\n", " --: |".repeat(columns.len()));
    let mut row = |name: &str, cell: &dyn Fn(usize, &Column) -> String| {
        let cells: String = columns.iter().enumerate().map(|(index, column)| format!(" {} |", cell(index, column))).collect();
        text += &format!("| {name} |{cells}\n");
    };
    row("**ours: cycle, s**", &|_, column| format!("**{:.1}**", column.sequence.motion_secs()));
    row("ours: lower bound of the cycle, s", &|_, column| format!("{:.1}", column.sequence.lower_bound_secs));
    row("**ours: wall, s**", &|_, column| format!("**{:.1}**", column.wall_secs));
    row("ours: CPU of all threads, s", &|_, column| format!("{:.1}", column.cpu_secs));
    row("ours: stations", &|_, column| column.stations.to_string());
    row("ours: holes left out", &|_, column| column.left_out.to_string());
    for method in ["RoboTSP", "GLKH1000", "GLKH500", "GLKH100", "TSP C-Space"] {
        let figures = &task.published[method];
        let number = |secs: Option<f64>| secs.map_or_else(|| "fails".to_owned(), |secs| format!("{secs:.1}"));
        row(&format!("{method}: cycle, s"), &|index, _| number(figures.execution_secs[index]));
        row(&format!("{method}: wall, s"), &|index, _| number(figures.cpu_secs[index]));
    }
    row("RoboTSP: stations", &|index, _| task.published_configurations[index].to_string());
    let cpuinfo = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model =
        cpuinfo.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": ")).map_or("unknown CPU", |(_, m)| m);
    let load = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load = load.split(' ').nth(1).unwrap_or("unknown");
    text + &format!(
        "\nOurs on {model}, {THREADS} threads; load of the machine over the five minutes before the end: {load}.\n\n{NOTES}"
    )
}

const HEAD: &str = "# Sequencing compared with RoboTSP

Written by `tests/benches/robotsp.rs`, after `python tests/benches/robotsp.py ROBOTSP RAVEUTILS FOLDER` on checkouts of
[crigroup/robotsp](https://github.com/crigroup/robotsp) and
[crigroup/raveutils](https://github.com/crigroup/raveutils): `cargo bench --bench robotsp -- FOLDER`. The
task: the 245 holes of the panel and the random subsets of its benchmark, its Denso VS060 with drill and camera, its speeds
and accelerations, its home position, 10 mm in front of each hole, eight rotations about the drill. The figures of RoboTSP,
GLKH (with 1000, 500 and 100 trials) and the tour in joint space are those in its `data/benchmarks.hdf5`; its paper is arXiv
1709.09343.
";

const NOTES: &str =
    "- **Cycle** is the time of all moves from home through every hole and back, stopping at each. Wall time is from the targets to
  moves checked along their whole length: inverse kinematics, collision, order, moves; the peer counts the same.
- **Another machine.** The peer's seconds are from its authors' computer, with Python 2 and OpenRAVE in one thread.
- **Names of the GLKH rows** are those in the file. The script that filled it runs 100 trials for the row named GLKH1000 and
  1000 for the row named GLKH100, which their times confirm.
- **The time parameterisation** is slightly slower here: all axes start and stop together, each move as one trapezoid, like a
  controller's joint move; OpenRAVE's parabolic smoother lets each axis ramp by itself.
- **Collision.** The same world: base, jig as a mesh, panel and its boxes, drill and camera as the peer's boxes and cylinders.
  The arm is modelled by capsules around its meshes, which are wider, hence fewer stations; the flange's disc has none. Our
  moves keep a clearance of 1 mm, proved along their whole length; the peer samples its moves and keeps no clearance.
- **Full turns** of joints 4 and 6 count as separate stations here.
- **The lower bound** is over the stations that were reached; moves that were not checked count as straight and free.
";
