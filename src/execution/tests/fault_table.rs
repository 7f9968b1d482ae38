//! The table of faults: each fault, of each device, in each state of a run, with the state that it has to end in, for whatever devices
//! implement [`FaultyCell`]. Nothing moves after the end, and nothing was ever asked to that was not armed.

use std::fmt::Debug;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::task::JoinHandle;
use tokio::time::sleep;

use super::rehearsal::{CELL, attend, job, until};
use crate::execution::audit::AuditLog;
use crate::execution::audit::tests::log_on_full_disk;
use crate::execution::device::{FaultCode, Trigger};
use crate::execution::session::{Authority, Drive, Fence, Leases, RunHandle, RunJob, RunOptions, RunState, RunStatus, live};
use crate::execution::twin::Planted;

/// Longest time of a run.
const PATIENCE: Duration = Duration::from_secs(90);
/// Bytes that the disk of the audit log has room for: fewer than a file of it may have.
pub(crate) const ROOM: usize = 1 << 18;

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

/// A run that a fault comes upon.
pub(crate) struct FaultStage {
    /// The run; taken away, nobody holds it any more.
    pub(crate) handle: Mutex<Option<RunHandle>>,
    pub(crate) leases: Leases,
    pub(crate) token: Fence,
    pub(crate) attendant: JoinHandle<()>,
    pub(crate) audit: Arc<AuditLog>,
}

impl FaultStage {
    pub(crate) fn handle(&self) -> RunHandle {
        self.handle.lock().expect("whole").clone().expect("held")
    }
}

/// Devices of a cell, at home, with a way to plant faults in them.
pub(crate) trait FaultyCell: Send + Sync + Sized {
    /// Fault.
    type Fault: Copy + Debug + Send + Sync;
    /// The session's side of arm and table.
    type Machine: Drive + 'static;
    /// The session's side of the trigger.
    type Trigger: Trigger + 'static;

    /// New devices.
    fn begin() -> impl Future<Output = (Self::Machine, Self::Trigger, Self)> + Send;

    /// Job of a run that the fault comes upon.
    fn job(_fault: Self::Fault) -> RunJob {
        job()
    }

    /// Plants a fault in place of the last.
    fn plant(&self, fault: Self::Fault, stage: &FaultStage) -> impl Future<Output = ()> + Send;

    /// Takes all faults away.
    fn heal(&self);

    /// Positions of all axes, without any error.
    fn positions_rad(&self) -> [f64; 7];

    /// Number of targets taken so far.
    fn targets(&self) -> u64;

    /// Number of targets so far that were not to be asked: unarmed, or out of order.
    fn breaches(&self) -> u64;

    /// Asserts that nothing moves any more, and nothing was asked that was not to be.
    fn assert_rests(&self, name: &str) -> impl Future<Output = ()> + Send {
        async move {
            self.heal();
            // A link that is cut leaves a device to its own watchdog, or to the end of its move.
            sleep(Duration::from_secs(4)).await;
            let before = (self.positions_rad(), self.targets());
            sleep(Duration::from_secs(10)).await;
            assert_eq!(before, (self.positions_rad(), self.targets()), "{name}: moves after the end");
            assert_eq!(self.breaches(), 0, "{name}");
        }
    }
}

/// States that faults come in.
pub(crate) const STATES: [RunState; 5] =
    [RunState::Preparing, RunState::Ready, RunState::Armed, RunState::Running, RunState::Paused];

/// Runs one row of the table: the end in each state.
pub(crate) async fn fault_in_each_state<C: FaultyCell>(fault: C::Fault, ends: &[RunState]) -> Vec<RunStatus> {
    let mut row = Vec::new();
    for state in STATES {
        let name = format!("{fault:?} while {}", state.as_str());
        let status = fault_in::<C>(fault, state, &name).await;
        let was_armed = !matches!(state, RunState::Preparing | RunState::Ready);
        let found = status.state;
        // What was not armed fails, or stays ready.
        let fits = ends.contains(&found) || (!was_armed && matches!(found, RunState::Failed | RunState::Ready));
        assert!(fits, "{name}: {found:?}, {}", status.reason);
        row.push(status);
    }
    row
}

async fn fault_in<C: FaultyCell>(fault: C::Fault, state: RunState, name: &str) -> RunStatus {
    let (machine, trigger, cell) = C::begin().await;
    let leases = Leases::default();
    let token = leases.acquire(CELL, "operator", Duration::from_secs(30)).expect("free").token;
    let audit = log_on_full_disk(ROOM);
    let options = RunOptions { single_step: state == RunState::Armed, audit: Some(Arc::clone(&audit)), ..RunOptions::default() };
    let handle = live(C::job(fault), machine, trigger, Authority { leases: leases.clone(), cell: CELL.into() }, options);
    let attendant = attend(&handle, &leases, token);
    let (mut status, last) = (handle.watch_status(), handle.watch_status());
    let stage = FaultStage { handle: Mutex::new(Some(handle)), leases, token, attendant, audit };
    lead_into(&cell, fault, state, &stage).await;
    let resuming = async {
        loop {
            sleep(Duration::from_secs(2)).await;
            let handle = stage.handle.lock().expect("whole").clone();
            if let Some(handle) = handle {
                // A run that a silent scanner holds goes on when it is told to; others refuse.
                let _ = handle.resume(Some(token)).await;
            }
        }
    };
    let found = tokio::select! {
        found = status.wait_for(|status| status.state.is_final()) => found.expect("told").clone(),
        () = resuming => unreachable!("it never ends"),
        () = sleep(PATIENCE) => last.borrow().clone(),
    };
    stage.attendant.abort();
    cell.assert_rests(name).await;
    found
}

/// Takes a run into a state and plants the fault there.
async fn lead_into<C: FaultyCell>(cell: &C, fault: C::Fault, state: RunState, stage: &FaultStage) {
    let (handle, token) = (stage.handle(), stage.token);
    if state == RunState::Preparing {
        cell.plant(fault, stage).await;
    }
    if until(&handle, RunState::Ready).await != RunState::Ready {
        return;
    }
    if state == RunState::Ready {
        cell.plant(fault, stage).await;
    }
    // A run that has ended by now refuses, and one whose lease is lost.
    if handle.arm(token).await.is_err() {
        return;
    }
    if state == RunState::Armed && until(&handle, RunState::Armed).await == RunState::Armed {
        cell.plant(fault, stage).await;
        let _ = handle.resume(Some(token)).await;
    } else if until(&handle, RunState::Running).await == RunState::Running {
        sleep(Duration::from_millis(600)).await;
        if state == RunState::Paused {
            handle.pause().await.expect("runs");
            until(&handle, RunState::Paused).await;
        }
        if matches!(state, RunState::Running | RunState::Paused) {
            cell.plant(fault, stage).await;
        }
        if state == RunState::Paused {
            sleep(Duration::from_secs(1)).await;
            let _ = handle.resume(Some(token)).await;
        }
    }
}
