//! A small planned part that tests of this room run, and twins that they plant faults in.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, OnceLock};

use nalgebra::{Isometry3, Rotation3, UnitQuaternion, Vector3};

use super::fault_table::{FaultStage, FaultyCell};
use crate::cell::{Cell, CollisionScene, Configuration, Presets, SpecLibrary};
use crate::execution::session::{DeviceRole, Fence, Hashes, Leases, Pair, RunHandle, RunJob, RunState};
use crate::execution::twin::{Asked, Planted, TriggerAccess, Twin, TwinAccess, TwinTrigger};
use crate::geometry::{Mesh, Part, Pose, ScannerFrame};
use crate::planning::context::{Context, Silent};
use crate::planning::params::PlanParams;
use crate::planning::plan::ViewId;
use crate::planning::sequence::order;
use crate::planning::stations::solve;
use crate::program::{Expected, Move, Program, Step, compile};
use crate::testing::box_mesh;

/// Three views of a box in the preset cell, from their poses to the program.
pub(crate) struct Planned {
    pub(crate) cell: Arc<Cell>,
    pub(crate) part: Arc<Mesh>,
    pub(crate) scene: CollisionScene,
    pub(crate) program: Program,
    pub(crate) expected: Expected,
}

fn view(polar: f64, azimuth: f64) -> Pose<Part, ScannerFrame> {
    let out = Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
    let x = Vector3::new(-azimuth.sin(), azimuth.cos(), 0.0);
    let axes = Rotation3::from_basis_unchecked(&[x, (-out).cross(&x), -out]);
    Pose::from_parts(Vector3::new(0.0, 0.0, 50.0) + out * 520.0, UnitQuaternion::from_rotation_matrix(&axes))
}

/// The part, planned once for all tests.
pub(crate) fn planned() -> &'static Planned {
    static PLANNED: OnceLock<Planned> = OnceLock::new();
    PLANNED.get_or_init(|| {
        let cell = Presets.cell("e05-transcan").expect("preset").build(&Presets).expect("builds");
        let table_from_part = Pose::claim(Isometry3::identity());
        let part = box_mesh([-50.0, -50.0, 0.0], [50.0, 50.0, 100.0]);
        let scene = CollisionScene::new(&cell, &part, None, &table_from_part, 5.0);
        let poses = [view(0.4, 0.2), view(0.9, 2.0), view(1.1, 4.5)];
        let flag = AtomicBool::new(false);
        let ctx = Context::new(&flag, &Silent);
        let stations = solve(&poses, &cell, &scene, &table_from_part, &ctx).expect("not cancelled");
        let listed: Vec<_> =
            stations.iter().enumerate().map(|(i, found)| (ViewId::at(i), found.as_deref().expect("reached"))).collect();
        let params = PlanParams::default();
        let ordered = order(&listed, &cell, &scene, &params, None, false, &ctx).expect("not cancelled");
        let plan_sha256 = "ab".repeat(32);
        let program = compile(&ordered.sequence, 0, &cell, &plan_sha256, &params);
        let views = poses.into_iter().enumerate().map(|(i, pose)| (ViewId::at(i), pose)).collect();
        let expected = Expected { plan_sha256, table_from_part, table_alone: false, views };
        Planned { cell: Arc::new(cell), part: Arc::new(part), scene, program, expected }
    })
}

pub(crate) fn hashes() -> Hashes {
    Hashes { plan: "ab".repeat(32), cell: "cd".repeat(32), compensation: None }
}

pub(crate) fn job() -> RunJob {
    job_of([hashes(), hashes()])
}

/// A program of one view near home, a second or two at half the rated speed.
pub(crate) fn short_job(speed_fraction: f64, hashes: [Hashes; 2]) -> RunJob {
    let Planned { cell, scene, program, .. } = planned();
    let (home, axes) = (program.home_rad, cell.axes());
    let away = Configuration { joints_rad: home.joints_rad.map(|joint| joint - 0.1), table_rad: home.table_rad + 0.2 };
    let move_to = |from: Configuration, target_rad: Configuration| {
        let mut step = Move { via_rad: Vec::new(), target_rad, speed_fraction, duration_secs: 0.0, passed_within_rad: None };
        step.duration_secs = step.derived_secs(&from, &axes);
        Step::Move(step)
    };
    let scan = Step::Scan { view: ViewId::at(0), brightness: 5, capture_secs: 0.2 };
    let steps = vec![move_to(home, away), Step::Settle { secs: 0.1 }, scan, move_to(away, home)];
    let cycle_secs = steps.iter().map(Step::secs).sum();
    let program = Program { steps, cycle_secs, ..program.clone() };
    RunJob::new(program, Arc::clone(cell), scene, None, hashes).expect("sound")
}

pub(crate) fn job_of(hashes: [Hashes; 2]) -> RunJob {
    let Planned { cell, scene, program, expected, .. } = planned();
    RunJob::new(program.clone(), Arc::clone(cell), scene, Some(expected), hashes).expect("sound")
}

/// Twins at home, with the ways into them.
pub(crate) struct Twins {
    pub(crate) arm: TwinAccess<6>,
    pub(crate) table: TwinAccess<1>,
    pub(crate) trigger: TriggerAccess,
}

pub(crate) type TwinPair = Pair<Twin<6>, Twin<1>>;

pub(crate) fn twins() -> (TwinPair, TwinTrigger, Twins) {
    let home = planned().program.home_rad;
    let (arm, table, trigger) = (Twin::at(home.joints_rad, 1.0), Twin::at([home.table_rad], 1.0), TwinTrigger::new(1.0));
    let access = Twins { arm: arm.access(), table: table.access(), trigger: trigger.access() };
    (Pair { arm, table }, trigger, access)
}

/// Waits until the run is in a state, or in a final one.
pub(crate) async fn until(handle: &RunHandle, state: RunState) -> RunState {
    let mut status = handle.watch_status();
    let found = status.wait_for(|status| status.state == state || status.state.is_final()).await;
    found.map_or(RunState::Failed, |status| status.state)
}

/// Numbers of chance: SplitMix64 (G. Steele, D. Lea and C. Flood, 2014).
#[derive(Clone, Debug)]
pub(crate) struct Chance(pub(crate) u64);

impl Chance {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number below `of`.
    pub(crate) fn of(&mut self, of: u64) -> u64 {
        self.next() % of
    }
}

/// The output of work on a clock that is paused, and a thread of its own.
pub(crate) fn in_simulated_time<T>(work: impl Future<Output = T>) -> T {
    let mut runtime = tokio::runtime::Builder::new_current_thread();
    let runtime = runtime.enable_all().start_paused(true).max_blocking_threads(1).build().expect("a runtime");
    runtime.block_on(work)
}

/// Runs work on all cores. Without optimisation the futures of a run take megabytes of stack while they are made.
pub(crate) fn on_deep_stacks<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().stack_size(32 << 20).build().expect("threads").install(work)
}

/// Name of the cell in leases.
pub(crate) const CELL: &str = "e05-transcan";

/// Keeps lease and heartbeat alive.
pub(crate) fn attend(handle: &RunHandle, leases: &Leases, token: Fence) -> tokio::task::JoinHandle<()> {
    let (handle, leases) = (handle.clone(), leases.clone());
    tokio::spawn(async move {
        while handle.heartbeat(Some(token)).is_ok() && leases.renew(CELL, token).is_ok() {
            tokio::time::sleep(std::time::Duration::from_millis(100)).await;
        }
    })
}

impl FaultyCell for Twins {
    type Fault = (DeviceRole, Planted);
    type Machine = TwinPair;
    type Trigger = TwinTrigger;

    async fn begin() -> (TwinPair, TwinTrigger, Self) {
        twins()
    }

    async fn plant(&self, (device, planted): (DeviceRole, Planted), _stage: &FaultStage) {
        match device {
            DeviceRole::Arm => self.arm.plant(Some(planted)),
            DeviceRole::Table | DeviceRole::Trigger => self.table.plant(Some(planted)),
        }
    }

    fn heal(&self) {
        self.arm.plant(None);
        self.table.plant(None);
    }

    fn positions_rad(&self) -> [f64; 7] {
        Configuration { joints_rad: self.arm.positions_rad(), table_rad: self.table.positions_rad()[0] }.axes_rad()
    }

    fn targets(&self) -> u64 {
        self.arm.asked().targets + self.table.asked().targets
    }

    fn breaches(&self) -> u64 {
        let breaches = |asked: Asked| asked.targets_unarmed + asked.targets_out_of_order;
        breaches(self.arm.asked()) + breaches(self.table.asked())
    }
}
