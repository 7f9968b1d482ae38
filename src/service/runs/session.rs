//! Sessions for the server and the command line alike: from a checked program and the operator's controllers to a run that is under
//! way. Must be called on the runtime that carries it.

use std::fs::{File, TryLockError};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use sha2::{Digest, Sha256};

use crate::cell::{Cell, CollisionScene, ControllersSpec, TableControllerSpec, WorkspaceSpec};
use crate::execution::audit::{AuditLimits, AuditLog};
use crate::execution::located::Relocate;
use crate::execution::session::{self, Authority, RunHandle, RunJob, RunOptions, Safeguards, Workspace};
use crate::program::{Program, interlock};
use crate::wire::hex;
use crate::wire::run::{RunMode, RunRequest};

use super::devices;

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

/// Begins a run.
///
/// # Errors
/// A sentence: the audit log cannot be begun, or a live run lacks a lease or controllers.
pub fn begin(order: SessionOrder<'_>) -> Result<RunHandle, String> {
    let audit = order.audit.as_ref().map(open_audit).transpose()?;
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
    match order.request.mode {
        RunMode::Simulate => Ok(session::simulate(order.job, options)),
        RunMode::DryRun => devices::dry_run(controllers()?, order.job, options),
        RunMode::Live => {
            let authority = order.authority.ok_or_else(|| "a live run needs the lease of its cell".to_owned())?;
            let locks = lock(controllers()?)?;
            let handle = devices::live(controllers()?, order.job, authority, options)?;
            let end = handle.end();
            tokio::spawn(async move {
                end.await;
                drop(locks);
            });
            Ok(handle)
        }
    }
}

/// Program for the devices of a run: two controllers do not keep in step with each other, so where arm and table have one each, they
/// move one after the other, as in the languages of controllers without an external axis.
///
/// # Errors
/// A sentence: they have to move together.
pub fn program_for(
    program: Program,
    (mode, controllers): (RunMode, Option<&ControllersSpec>),
    (cell, scene): (&Cell, &CollisionScene),
) -> Result<Program, String> {
    let has_one_each = controllers.is_some_and(|spec| !matches!(spec.table, TableControllerSpec::WithArm {}));
    if mode == RunMode::Simulate || !has_one_each {
        return Ok(program);
    }
    interlock(&program, cell, scene).map_err(|together| together.to_string())
}

/// Locks the controllers against other processes of this machine: a lease holds among the clients of one server alone. The system
/// gives the locks back when the process ends, however it does.
fn lock(controllers: &ControllersSpec) -> Result<Vec<File>, String> {
    let folder = std::env::temp_dir().join("vantage-controllers");
    // Others may have made it, and their locks count too.
    let _ = std::fs::create_dir_all(&folder);
    let addresses = std::iter::once(controllers.arm.address()).chain(controllers.table.address());
    let lock_one = |address: &str| {
        let path = folder.join(hex(&Sha256::digest(address)));
        let opened = File::open(&path).or_else(|_| File::create(&path));
        let file = opened.map_err(|error| format!("the lock of controller {address} ({}): {error}", path.display()))?;
        match file.try_lock() {
            Ok(()) => Ok(file),
            Err(TryLockError::WouldBlock) => {
                Err(format!("controller {address} is driven by another live run on this machine; stop that run first"))
            }
            Err(TryLockError::Error(error)) => Err(format!("the lock of controller {address} ({}): {error}", path.display())),
        }
    };
    addresses.map(lock_one).collect()
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
