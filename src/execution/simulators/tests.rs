//! A planned part on real sockets: a live session, the drivers, the simulated controllers.

use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::Duration;

use tokio::task::JoinHandle;
use tokio::time::sleep;

use super::faults::{FaultCommand, Faults};
use super::hans::HansSimulator;
use super::minas_a6::{DriveSetup, MinasA6Simulator};
use crate::cell::{MinasA6Spec, Presets, SpecLibrary};
use crate::execution::drivers::hans::HansArm;
use crate::execution::drivers::minas_a6::MinasA6Table;
use crate::execution::drivers::stream::Wiring;
use crate::execution::protocol::modbus::ModbusFraming;
use crate::execution::session::{Authority, Fence, Leases, Pair, RunHandle, RunOptions, RunState, live};
use crate::execution::tests::rehearsal::{job, planned, until};
use crate::execution::twin::TwinTrigger;

const CELL: &str = "e05-transcan";

/// Simulated controllers at the program's home, and a live run on them.
struct Rehearsal {
    handle: RunHandle,
    leases: Leases,
    token: Fence,
    faults: [Arc<Faults>; 2],
    joints: Box<dyn Fn() -> [f64; 6] + Send>,
    position: Box<dyn Fn() -> f64 + Send>,
    servers: [JoinHandle<()>; 2],
}

impl Drop for Rehearsal {
    fn drop(&mut self) {
        self.servers.iter().for_each(JoinHandle::abort);
    }
}

async fn rehearsal() -> Rehearsal {
    let home = planned().program.home_rad;
    let robot = Presets.robot("hans-e05").expect("a preset").build().expect("a valid preset");
    let arm_side = HansSimulator::listen("127.0.0.1:0", robot.clone(), home.joints_rad, 1.0).await.expect("a socket");
    let arm_spec = serde_json::json!({"address": arm_side.addresses().expect("addresses").text.to_string()});
    let arm_spec = serde_json::from_value(arm_spec).expect("a specification");
    let position = (home.table_rad / TAU * 1_600_000.0).round() as i32;
    let table_side = MinasA6Simulator::new(&DriveSetup { position, ..DriveSetup::default() });
    let (listener, address) = MinasA6Simulator::listen("127.0.0.1:0").await.expect("a socket");
    let table_spec = serde_json::json!({"address": format!("tcp://{address}"), "units_per_turn": 1_600_000, "gear_ratio": 40});
    let table_spec: MinasA6Spec = serde_json::from_value(table_spec).expect("a specification");
    let machine = Pair {
        arm: HansArm::new(arm_spec, robot.kinematics, Wiring::over_tcp("arm", Arc::new(()))),
        table: MinasA6Table::new(
            table_spec,
            planned().cell.turntable.axis.max_acceleration_rad_per_s2,
            Wiring::over_tcp("table", Arc::new(())),
        ),
    };
    let leases = Leases::default();
    let token = leases.acquire(CELL, "operator", Duration::from_secs(2)).expect("free").token;
    let faults = [arm_side.faults(), table_side.faults()];
    let (joints, position) = (Box::new(arm_side.joints()), Box::new(table_side.position()));
    let servers = [tokio::spawn(arm_side.serve()), tokio::spawn(table_side.serve(listener, ModbusFraming::Rtu))];
    let authority = Authority { leases: leases.clone(), cell: CELL.into() };
    let handle = live(job(), machine, TwinTrigger::new(1.0), authority, RunOptions::default());
    Rehearsal { handle, leases, token, faults, joints, position, servers }
}

impl Rehearsal {
    /// Arms the run and keeps lease and heartbeat alive.
    async fn begin(&self) {
        assert_eq!(until(&self.handle, RunState::Ready).await, RunState::Ready, "{}", self.handle.status().reason);
        self.handle.arm(self.token).await.expect("may");
        let (handle, leases, token) = (self.handle.clone(), self.leases.clone(), self.token);
        tokio::spawn(async move {
            while handle.heartbeat(Some(token)).is_ok() && leases.renew(CELL, token).is_ok() {
                sleep(Duration::from_millis(100)).await;
            }
        });
    }

    /// Returns true if nothing moves for half a second.
    async fn rests(&self) -> bool {
        sleep(Duration::from_millis(500)).await;
        let found = ((self.joints)(), (self.position)());
        sleep(Duration::from_millis(500)).await;
        found == ((self.joints)(), (self.position)())
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "long: tests/all runs it"]
async fn a_planned_part_runs_through_both_simulators_in_the_planned_time() {
    let run = rehearsal().await;
    run.begin().await;
    let record = run.handle.ended().await;
    assert_eq!(record.status.state, RunState::Done, "{}", record.status.reason);
    assert_eq!((record.steps.len(), record.scans().count()), (planned().program.steps.len(), 3));
    let most = record.max_deviation();
    assert!(most.optical_axis_deg < 0.1 && most.max_axis_deg <= 0.1, "{most:?}");
    let (planned, real) = (planned().program.cycle_secs, record.real_secs);
    println!("planned {planned:.2} s, took {real:.2} s");
    assert!(real / planned - 1.0 > -0.05, "planned {planned} s, took {real} s");
    // A busy machine is late; how late a quiet one is, is printed.
    assert!(real / planned - 1.0 < 0.25, "planned {planned} s, took {real} s");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "long: tests/all runs it"]
async fn a_fault_of_either_device_stops_both() {
    for (device, fault) in [
        (0, FaultCommand::EmergencyStop(true)),
        (0, FaultCommand::Cut),
        (0, FaultCommand::Silent(true)),
        (1, FaultCommand::Alarm(Some(2400))),
        (1, FaultCommand::Cut),
        (1, FaultCommand::Silent(true)),
    ] {
        let run = rehearsal().await;
        run.begin().await;
        assert_eq!(until(&run.handle, RunState::Running).await, RunState::Running);
        sleep(Duration::from_millis(700)).await;
        run.faults[device].apply(fault);
        let record = run.handle.ended().await;
        assert!(record.status.state.is_final() && record.status.state != RunState::Done, "{fault:?}: {:?}", record.status);
        assert!(run.rests().await, "{fault:?} of {device}: something moves");
    }
}
