//! The table of faults: each fault, of each device, in each state of a run, with the state that it has to end in, for whatever devices
//! implement [`FaultyCell`]. Nothing moves after the end, and nothing was ever asked to that was not armed.

use std::time::Duration;

use tokio::time::sleep;

use super::device::{FaultCode, Trigger};
use super::rehearsal::{CELL, attend, job, until};
use super::session::{Authority, DeviceRole, Drive, Leases, RunOptions, RunState, live};
use super::twin::Planted;

/// Every fault, with the state that it ends in once a run is armed.
pub(crate) const FAULTS: [(Planted, RunState); 15] = [
    (Planted::EmergencyStop, RunState::Stopped),
    (Planted::GuardOpen, RunState::Stopped),
    (Planted::HandGuided, RunState::Stopped),
    (Planted::Held, RunState::Stopped),
    (Planted::PowerLost, RunState::Stopped),
    (Planted::BrakesClosed, RunState::Stopped),
    (Planted::Fault(FaultCode(42)), RunState::Failed),
    (Planted::Silent, RunState::Stopped),
    (Planted::Late(Duration::from_millis(150)), RunState::Stopped),
    (Planted::Aged(Duration::from_millis(150)), RunState::Stopped),
    (Planted::Closed, RunState::Stopped),
    (Planted::Refuses, RunState::Failed),
    (Planted::Stuck, RunState::Failed),
    (Planted::OffWay(0.2), RunState::Failed),
    (Planted::NotANumber, RunState::Failed),
];

/// Devices of a cell, at home, with a way to plant faults in them.
pub(crate) trait FaultyCell: Send + Sync + Sized {
    /// The session's side of arm and table.
    type Machine: Drive + 'static;
    /// The session's side of the trigger.
    type Trigger: Trigger + 'static;

    /// New devices.
    fn begin() -> impl Future<Output = (Self::Machine, Self::Trigger, Self)> + Send;

    /// Plants a fault in place of the last, or takes it away.
    fn plant(&self, device: DeviceRole, planted: Option<Planted>);

    /// Positions of all axes, without any error.
    fn positions_rad(&self) -> [f64; 7];

    /// Number of targets taken so far.
    fn targets(&self) -> u64;

    /// Number of targets so far that were not to be asked: unarmed, or out of order.
    fn breaches(&self) -> u64;

    /// Asserts that nothing moves any more, and nothing was asked that was not to be.
    fn assert_rests(&self, name: &str) -> impl Future<Output = ()> + Send {
        async move {
            self.plant(DeviceRole::Arm, None);
            self.plant(DeviceRole::Table, None);
            // A link that is cut leaves a device to its own watchdog.
            sleep(Duration::from_secs(4)).await;
            let before = (self.positions_rad(), self.targets());
            sleep(Duration::from_secs(10)).await;
            assert_eq!(before, (self.positions_rad(), self.targets()), "{name}: moves after the end");
            assert_eq!(self.breaches(), 0, "{name}");
        }
    }
}

/// Runs the table.
pub(crate) async fn fault_table<C: FaultyCell>(faults: &[(Planted, RunState)], devices: &[DeviceRole]) {
    for (planted, ends) in faults {
        for device in devices {
            for state in [RunState::Preparing, RunState::Ready, RunState::Armed, RunState::Running, RunState::Paused] {
                fault_in::<C>(*planted, *ends, *device, state).await;
            }
        }
    }
}

async fn fault_in<C: FaultyCell>(planted: Planted, ends: RunState, device: DeviceRole, state: RunState) {
    let name = format!("{planted:?} of the {device} while {}", state.as_str());
    let (machine, trigger, cell) = C::begin().await;
    let leases = Leases::default();
    let lease = leases.acquire(CELL, "operator", Duration::from_secs(30)).expect("free");
    let token = Some(lease.token);
    if state == RunState::Preparing {
        cell.plant(device, Some(planted));
    }
    let options = RunOptions { single_step: state == RunState::Armed, ..RunOptions::default() };
    let handle = live(job(), machine, trigger, Authority { leases: leases.clone(), cell: CELL.into() }, options);
    let attendant = attend(&handle, &leases, lease.token);
    if until(&handle, RunState::Ready).await == RunState::Ready {
        if state == RunState::Ready {
            cell.plant(device, Some(planted));
        }
        // A run that has ended by now refuses.
        let _ = handle.arm(lease.token).await;
        if state == RunState::Armed && until(&handle, RunState::Armed).await == RunState::Armed {
            cell.plant(device, Some(planted));
            let _ = handle.resume(token).await;
        } else if until(&handle, RunState::Running).await == RunState::Running {
            sleep(Duration::from_millis(600)).await;
            if state == RunState::Paused {
                handle.pause().await.expect("runs");
                until(&handle, RunState::Paused).await;
            }
            cell.plant(device, Some(planted));
            if state == RunState::Paused {
                sleep(Duration::from_secs(1)).await;
                let _ = handle.resume(token).await;
            }
        }
    }
    let record = handle.ended().await;
    attendant.abort();
    let found = record.status.state;
    // A refusal of targets that no further target meets hinders nothing.
    let may_end_well = matches!(planted, Planted::Refuses | Planted::Stuck);
    let was_armed = !matches!(state, RunState::Preparing | RunState::Ready);
    let fits = found == ends || (!was_armed && found == RunState::Failed) || (may_end_well && found == RunState::Done);
    assert!(fits, "{name}: {found:?}, {}", record.status.reason);
    cell.assert_rests(&name).await;
}
