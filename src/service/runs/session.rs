//! Sessions for the server and the command line alike: from a checked program and the operator's controllers to a run that is under
//! way. Must be called on the runtime that carries it.

#[cfg(target_os = "linux")]
use std::io::ErrorKind;
#[cfg(target_os = "linux")]
use std::os::unix::net::{SocketAddr, UnixListener};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

#[cfg(target_os = "linux")]
use sha2::{Digest, Sha256};

use crate::cell::{Cell, CollisionScene, ControllersSpec, TableControllerSpec, WorkspaceSpec};
use crate::execution::audit::{AuditHead, AuditLimits, AuditLog};
use crate::execution::located::Relocate;
use crate::execution::session::{self, Authority, RunHandle, RunJob, RunOptions, Safeguards, Workspace};
use crate::program::{Program, interlock};
#[cfg(target_os = "linux")]
use crate::wire::hex;
use crate::wire::run::{RunMode, RunRequest};

use super::devices;

/// Longest wait for the audit log of a run that has ended to be on the disk.
const CLOSING: Duration = Duration::from_secs(10);

/// A run that is to begin.
pub struct SessionOrder<'a> {
    /// Name of the run, which captures carry.
    pub name: String,
    /// The checked program.
    pub job: RunJob,
    /// Mode, speed, steps.
    pub request: &'a RunRequest,
    /// Controllers of the operator's cell file, unless the run is simulated.
    pub controllers: Option<&'a ControllersSpec>,
    /// Leases that a live run needs one of.
    pub authority: Option<Authority>,
    /// True if the program was never completed live in this cell: its speed is capped.
    pub is_first: bool,
    /// Time without a heartbeat of its client after which a live run stops.
    pub heartbeat_timeout: Duration,
    /// Check of the program with the part where a locating scan finds it.
    pub relocate: Option<Arc<dyn Relocate>>,
    /// Place of the audit log, unless the run is simulated.
    pub audit: Option<AuditPlace>,
}

/// Place and bounds of an audit log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditPlace {
    /// Folder, of this log alone.
    pub folder: PathBuf,
    /// Size at which a file is closed, bytes.
    pub file_bytes: u64,
    /// Files kept.
    pub files: usize,
}

/// Begins a run; returns with it its audit log, for [`close_log`] once the run has ended.
///
/// # Errors
/// A sentence: the audit log cannot be begun, or a live run lacks a lease or controllers.
pub fn begin(order: SessionOrder<'_>) -> Result<(RunHandle, Option<Arc<AuditLog>>), String> {
    let audit = order.audit.as_ref().map(open_audit).transpose()?;
    let log = audit.clone();
    let options = RunOptions {
        run: order.name,
        speed_override: order.request.speed_override,
        single_step: order.request.single_step,
        from_step: order.request.from_step,
        time_factor: order.request.time_factor,
        is_first_live: order.is_first && order.request.mode == RunMode::Live,
        safeguards: safeguards(order.controllers, order.heartbeat_timeout),
        relocate: order.relocate,
        audit,
    };
    let controllers = || order.controllers.ok_or_else(|| "the cell file names no controllers".to_owned());
    let handle = match order.request.mode {
        RunMode::Simulate => session::simulate(order.job, options),
        RunMode::DryRun => devices::dry_run(controllers()?, order.job, options)?,
        RunMode::Live => {
            let authority = order.authority.ok_or_else(|| "a live run needs the lease of its cell".to_owned())?;
            let locks = lock(controllers()?)?;
            let handle = devices::live(controllers()?, order.job, authority, options)?;
            let end = handle.end();
            tokio::spawn(async move {
                end.await;
                drop(locks);
            });
            handle
        }
    };
    Ok((handle, log))
}

/// Ends an audit log and waits until it is on the disk, for [`CLOSING`] at most: a disk that does not answer does not hold back the end
/// of a run. Returns its head, to be kept with the run.
///
/// # Errors
/// The reason why the log may lack its end.
pub async fn close_log(log: Arc<AuditLog>) -> Result<AuditHead, String> {
    let closing = tokio::task::spawn_blocking(move || log.close());
    match tokio::time::timeout(CLOSING, closing).await {
        Ok(Ok(closed)) => closed,
        Ok(Err(error)) => Err(error.to_string()),
        Err(_) => Err(format!("its disk has not answered for {} s", CLOSING.as_secs())),
    }
}

/// Program for the devices of a run, which stop at every point, so that its times are those of stops. Two controllers do not keep in
/// step with each other: where arm and table have one each, they move one after the other, as in the languages of controllers without
/// an external axis.
///
/// # Errors
/// A sentence: they have to move together.
pub fn program_for(
    program: Program,
    (mode, controllers): (RunMode, Option<&ControllersSpec>),
    (cell, scene): (&Cell, &CollisionScene),
) -> Result<Program, String> {
    let program = program.with_stops(&cell.axes());
    let has_one_each = controllers.is_some_and(|spec| !matches!(spec.table, TableControllerSpec::WithArm {}));
    if mode == RunMode::Simulate || !has_one_each {
        return Ok(program);
    }
    interlock(&program, cell, scene).map_err(|together| together.to_string())
}

/// Locks the controllers against other processes of this machine: a lease holds among the clients of one server alone. A lock is a name
/// of the system's (unix(7), abstract sockets), which needs no file and ends with the process, however that ends. A container with
/// a network of its own, or another spelling of an address, is not noticed.
#[cfg(target_os = "linux")]
fn lock(controllers: &ControllersSpec) -> Result<Vec<UnixListener>, String> {
    use std::os::linux::net::SocketAddrExt as _;
    let table = controllers.table.address().zip(controllers.table.unit());
    let table = table.map(|(address, unit)| format!("{} unit {unit}", address.trim_start_matches("tcp://")));
    let lock_one = |device: String| {
        let name = format!("vantage-controller {device}");
        let bound = SocketAddr::from_abstract_name(hex(&Sha256::digest(name))).and_then(|name| UnixListener::bind_addr(&name));
        bound.map_err(|error| {
            if error.kind() == ErrorKind::AddrInUse {
                return format!("controller {device} is driven by another live run on this machine; stop that run first");
            }
            format!("controller {device} cannot be locked: {error}")
        })
    };
    std::iter::once(controllers.arm.address().to_owned()).chain(table).map(lock_one).collect()
}

/// Locks nothing: the system has no such names.
#[cfg(not(target_os = "linux"))]
fn lock(_: &ControllersSpec) -> Result<Vec<()>, String> {
    Ok(Vec::new())
}

/// Limits of the cell file.
fn safeguards(controllers: Option<&ControllersSpec>, heartbeat_timeout: Duration) -> Safeguards {
    let defaults = Safeguards { heartbeat_timeout, ..Safeguards::default() };
    let Some(spec) = controllers else { return defaults };
    Safeguards {
        watchdog: Duration::from_millis(spec.watchdog_ms.into()),
        state_max_age: Duration::from_millis(spec.state_max_age_ms.into()),
        position_tolerance_rad: spec.position_tolerance_deg.to_radians(),
        start_tolerance_rad: spec.start_tolerance_deg.to_radians(),
        first_run_speed: spec.first_run_speed,
        workspace: spec.workspace.map(|WorkspaceSpec { min_mm, max_mm }| Workspace { min_mm, max_mm }),
        trigger_timeout: Duration::from_millis(spec.trigger.deadline_ms().into()),
        ..defaults
    }
}

/// Opens the log in its folder.
fn open_audit(place: &AuditPlace) -> Result<Arc<AuditLog>, String> {
    let limits = AuditLimits { file_bytes: place.file_bytes, files: place.files };
    AuditLog::open(&place.folder, limits)
        .map_err(|error| format!("the audit log in {} cannot be begun: {error}", place.folder.display()))
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn a_controller_has_one_live_run_at_a_time() {
        // Addresses of this test alone: the locks hold for the machine.
        let cell = |arm: u16, unit: u8| -> ControllersSpec {
            let host = format!("test-{}.invalid", std::process::id());
            serde_json::from_value(serde_json::json!({
                "arm": {"protocol": "hans", "address": format!("{host}:{arm}")},
                "table": {"protocol": "minas_a6", "address": format!("tcp://{host}:502"), "node": unit,
                    "units_per_turn": 1_600_000, "gear_ratio": 40},
            }))
            .expect("controllers")
        };
        let held = lock(&cell(1, 1)).expect("free");
        for other in [cell(1, 2), cell(2, 1)] {
            assert!(lock(&other).expect_err("in use").contains("another live run"));
        }
        lock(&cell(2, 2)).expect("another arm, and another table of the same gateway");
        drop(held);
        lock(&cell(1, 1)).expect("free again");
    }
}
