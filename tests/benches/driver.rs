//! Times of the driver against the simulated controllers on loopback sockets: `cargo bench --bench driver`, or with `-- --brief` in
//! a tenth of the time. From a stop that a client asks for to its bytes on the wire; from the last message to the table's own stop;
//! and the jitter of set points while all cores are busy at the priority of planning threads.

use std::num::NonZero;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{available_parallelism, sleep, spawn};
use std::time::{Duration, Instant};

use serde_json::json;
use vantage::cell::{Cell, CollisionScene, Configuration, Presets, SpecLibrary};
use vantage::execution::device::{Direction, MotionDevice, Target, WireLog};
use vantage::execution::drivers::hans::HansArm;
use vantage::execution::drivers::minas_a6::MinasA6Table;
use vantage::execution::drivers::stream::Wiring;
use vantage::execution::protocol::modbus::ModbusFraming;
use vantage::execution::session::streamer::Streamer;
use vantage::execution::session::{Authority, Hashes, Leases, Pair, RunJob, RunOptions, RunState, Safeguards, StopCause, live};
use vantage::execution::simulators::hans::HansSimulator;
use vantage::execution::simulators::minas_a6::{DriveSetup, MinasA6Simulator};
use vantage::execution::twin::TwinTrigger;
use vantage::program::{Move, Program, Step};

const UNITS_PER_TURN: u32 = 1_600_000;
const CELL: &str = "e05-transcan";

/// Times at which a stop went out, of arm and table.
#[derive(Default)]
struct StopLog([Mutex<Option<Instant>>; 2]);

impl WireLog for StopLog {
    fn record(&self, device: &'static str, direction: Direction, bytes: &[u8]) {
        let is_table = device == "table";
        // GrpStop; and the coil 0124h of node 1, on.
        let stop: &[u8] = if is_table { &[1, 5, 0x01, 0x24, 0xFF, 0] } else { b"GrpStop" };
        if direction == Direction::Sent && bytes.windows(stop.len()).any(|window| window == stop) {
            self.0[usize::from(is_table)].lock().expect("whole").get_or_insert_with(Instant::now);
        }
    }
}

/// A slow move there and back.
fn job(cell: &Arc<Cell>) -> RunJob {
    let home_rad = cell.home_rad;
    let away = Configuration { joints_rad: home_rad.joints_rad.map(|joint| joint - 0.1), table_rad: home_rad.table_rad + 0.2 };
    let step = |from: Configuration, target_rad: Configuration| {
        let mut step =
            Move { via_rad: Vec::new(), target_rad, speed_fraction: 0.05, duration_secs: 0.0, passed_within_rad: None };
        step.duration_secs = step.derived_secs(&from, &cell.axes());
        Step::Move(step)
    };
    let steps = vec![step(home_rad, away), step(away, home_rad)];
    let hashes = || Hashes { plan: "ab".repeat(32), cell: "cd".repeat(32), compensation: None };
    let program = Program {
        plan_sha256: hashes().plan,
        setup: 0,
        calibration: None,
        robot: cell.robot.name.clone(),
        turntable: cell.turntable.name.clone(),
        home_rad,
        cycle_secs: steps.iter().map(Step::secs).sum(),
        steps,
    };
    let scene = CollisionScene::without_part(cell, 5.0);
    RunJob::new(program, Arc::clone(cell), &scene, None, [hashes(), hashes()]).expect("sound")
}

fn quantile(times: &[Duration], share: f64) -> Duration {
    times[((times.len() - 1) as f64 * share).round() as usize]
}

fn print(what: &str, mut times: Vec<Duration>) {
    times.sort_unstable();
    let [half, most, all] = [0.5, 0.99, 1.0].map(|share| quantile(&times, share));
    println!("{what}: p50 {half:.2?}, p99 {most:.2?}, largest {all:.2?} of {}", times.len());
}

async fn stops(count: u32) {
    let cell: Arc<Cell> = Arc::new(Presets.cell(CELL).expect("a preset").build(&Presets).expect("sound"));
    let job = job(&cell);
    let (mut arm_times, mut table_times) = (Vec::new(), Vec::new());
    for number in 0..count {
        let home = cell.home_rad;
        let arm = HansSimulator::listen("127.0.0.1:0", cell.robot.clone(), home.joints_rad, 1.0).await.expect("a socket");
        let position = (home.table_rad / std::f64::consts::TAU * f64::from(UNITS_PER_TURN)).round() as i32;
        let (listener, table_address) = MinasA6Simulator::listen("127.0.0.1:0").await.expect("a socket");
        let drive = MinasA6Simulator::new(&DriveSetup { position, ..DriveSetup::default() });
        let arm_address = arm.addresses().expect("addresses").text;
        let servers = [tokio::spawn(arm.serve()), tokio::spawn(drive.serve(listener, ModbusFraming::Rtu))];
        let log = Arc::<StopLog>::default();
        let wiring = |device| Wiring::over_tcp(device, Arc::clone(&log) as Arc<dyn WireLog>);
        let arm = serde_json::from_value(json!({"address": arm_address.to_string()})).expect("sound");
        let table = json!({"address": format!("tcp://{table_address}"), "units_per_turn": UNITS_PER_TURN, "gear_ratio": 40});
        let table = serde_json::from_value(table).expect("sound");
        let machine = Pair {
            arm: HansArm::new(arm, cell.robot.kinematics.clone(), wiring("arm")),
            table: MinasA6Table::new(table, cell.turntable.axis.max_acceleration_rad_per_s2, wiring("table")),
        };
        let leases = Leases::default();
        let token = leases.acquire(CELL, "bench", Duration::from_secs(30)).expect("free").token;
        let patient = Duration::from_secs(20);
        // Whatever else is busy here: it is the stop that is timed.
        let safeguards =
            Safeguards { heartbeat_timeout: patient, state_max_age: Duration::from_secs(1), ..Safeguards::default() };
        let options = RunOptions { safeguards, ..RunOptions::default() };
        let handle = live(job.clone(), machine, TwinTrigger::new(1.0), Authority { leases, cell: CELL.into() }, options);
        let mut status = handle.watch_status();
        for state in [RunState::Ready, RunState::Running] {
            let found = status.wait_for(|status| status.state == state || status.state.is_final()).await.expect("told").clone();
            assert_eq!(found.state, state, "{}", found.reason);
            if state == RunState::Ready {
                handle.arm(token).await.expect("may");
            }
        }
        tokio::time::sleep(Duration::from_millis(100 + u64::from(number * 37 % 100))).await;
        let asked = Instant::now();
        handle.stop(StopCause::Client);
        let report = handle.ended().await.stop.clone().expect("stopped");
        assert!(
            [report.arm, report.table].into_iter().flatten().all(|stop| stop.acknowledged.is_some() && stop.at_rest.is_some())
        );
        let [arm, table] = [0, 1].map(|place| log.0[place].lock().expect("whole").expect("on the wire") - asked);
        arm_times.push(arm);
        table_times.push(table);
        servers.iter().for_each(tokio::task::JoinHandle::abort);
    }
    print("stop from handle to wire, Han's", arm_times);
    print("stop from handle to wire, MINAS A6", table_times);
}

/// Time from the last message to the beginning of the drive's own stop.
async fn watchdog(setting: Duration) {
    let (listener, address) = MinasA6Simulator::listen("127.0.0.1:0").await.expect("a socket");
    let drive = MinasA6Simulator::new(&DriveSetup::default());
    let position = drive.position();
    let server = tokio::spawn(drive.serve(listener, ModbusFraming::Rtu));
    let spec = json!({"address": format!("tcp://{address}"), "units_per_turn": UNITS_PER_TURN, "gear_ratio": 40});
    let spec = serde_json::from_value(spec).expect("sound");
    let mut table = MinasA6Table::new(spec, std::f64::consts::PI, Wiring::over_tcp("table", Arc::new(())));
    table.connect().await.expect("a drive");
    table.arm(setting).await.expect("armed");
    let target = Target {
        sequence: 1,
        positions_rad: [3.0],
        max_speed_rad_s: [0.5],
        max_acceleration_rad_s2: [20.0],
        duration: Duration::from_secs(6),
    };
    table.start(&target).await.expect("accepted");
    for _ in 0..20 {
        table.keep_alive().await.expect("alive");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    table.keep_alive().await.expect("alive");
    let last = Instant::now();
    let (mut before, mut slow) = ((last, position()), None);
    let cruise = 0.5 / std::f64::consts::TAU * f64::from(UNITS_PER_TURN);
    while last.elapsed() < 4 * setting {
        sleep(Duration::from_millis(1));
        let here = (Instant::now(), position());
        let speed = (here.1 - before.1) / (here.0 - before.0).as_secs_f64();
        if speed < 0.9 * cruise {
            slow = slow.or(Some(before.0 - last));
        }
        before = here;
    }
    println!("the table's own stop, set to {setting:?}: begins {:.2?} after the last message", slow.expect("it stops"));
    server.abort();
}

/// Jitter of the period while threads as those that plan keep every core busy; with `busy` false, that of the machine itself, below
/// which no thread can be.
fn jitter(period: Duration, over: Duration, busy: bool) {
    let is_over = Arc::new(AtomicBool::new(false));
    let cores = if busy { available_parallelism().map_or(1, NonZero::get) } else { 0 };
    let threads = (0..cores).map(|_| {
        let is_over = Arc::clone(&is_over);
        spawn(move || {
            // As the server's planning threads.
            rustix::process::setpriority_process(Some(rustix::thread::gettid()), 10).expect("a lower priority");
            while !is_over.load(Ordering::Relaxed) {}
        })
    });
    let threads: Vec<_> = threads.collect();
    let streamer = Streamer::start("bench", period, |_| ControlFlow::Continue(())).expect("starts");
    sleep(over);
    let jitter = streamer.jitter();
    is_over.store(true, Ordering::Relaxed);
    threads.into_iter().for_each(|thread| thread.join().expect("ends"));
    let [half, most, nearly_all] = [0.5, 0.99, 0.999].map(|share| jitter.quantile(share));
    println!(
        "jitter at {period:?}, {}: p50 {half:?}, p99 {most:?}, p99.9 {nearly_all:?} ({:.1} % of the period), largest \
         {:.2?}, {} of {} left out",
        if busy { "all cores busy" } else { "nothing else to do" },
        100.0 * nearly_all.as_secs_f64() / period.as_secs_f64(),
        jitter.max,
        jitter.missed,
        jitter.periods
    );
}

fn main() {
    let is_brief = std::env::args().any(|argument| argument == "--brief");
    let runtime = tokio::runtime::Runtime::new().expect("a runtime");
    runtime.block_on(stops(if is_brief { 50 } else { 500 }));
    for setting in [100, 200, 500] {
        runtime.block_on(watchdog(Duration::from_millis(setting)));
    }
    let over = Duration::from_secs(if is_brief { 6 } else { 60 });
    for busy in [false, true] {
        jitter(Duration::from_millis(4), over, busy);
        jitter(Duration::from_millis(20), over, busy);
    }
}
