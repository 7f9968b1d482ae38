//! Drivers by the protocols of a cell file.

use crate::cell::ControllersSpec;
use crate::execution::session::{Authority, RunHandle, RunJob, RunOptions};

/// Begins a run that reads the devices.
///
/// # Errors
/// A protocol without a driver.
pub(super) fn dry_run(controllers: &ControllersSpec, _job: RunJob, _options: RunOptions) -> Result<RunHandle, String> {
    Err(without_driver(controllers))
}

/// Begins a run that moves the devices.
///
/// # Errors
/// A protocol without a driver.
pub(super) fn live(
    controllers: &ControllersSpec,
    _job: RunJob,
    _authority: Authority,
    _options: RunOptions,
) -> Result<RunHandle, String> {
    Err(without_driver(controllers))
}

fn without_driver(controllers: &ControllersSpec) -> String {
    let (arm, table) = (controllers.arm.name(), controllers.table.name());
    format!("this version has no driver for an arm by {arm} with a table by {table}; rehearse in the mode simulate")
}
