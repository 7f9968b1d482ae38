//! Drivers by the protocols of a cell file: one device for each, so that a session is begun in one place for all of them.

use std::sync::Arc;
use std::time::Duration;

use crate::cell::{ArmControllerSpec, ControllersSpec, Kinematics, TableControllerSpec};
use crate::execution::device::{DeviceError, DeviceState, FaultCode, Identity, MotionDevice, StopAcknowledged, Target, WireLog};
use crate::execution::drivers::hans::HansArm;
use crate::execution::drivers::minas_a6::MinasA6Table;
use crate::execution::drivers::modbus_plc::PlcTable;
use crate::execution::drivers::stream::Wiring;
use crate::execution::drivers::trigger::ScannerTrigger;
use crate::execution::session::{self, Authority, ObservedPair, Pair, RunHandle, RunJob, RunOptions};

/// Begins a run that reads the devices.
///
/// # Errors
/// A protocol without a driver.
pub(super) fn dry_run(controllers: &ControllersSpec, job: RunJob, options: RunOptions) -> Result<RunHandle, String> {
    let log = log_of(&options);
    let arm = arm(controllers, &job.cell().robot.kinematics, &log)?;
    let table = table(controllers, &log).ok_or_else(|| without_driver(controllers))?;
    Ok(session::dry_run(job, ObservedPair::new(arm, table), options))
}

/// Begins a run that moves the devices.
///
/// # Errors
/// A protocol or a trigger without a driver.
pub(super) fn live(
    controllers: &ControllersSpec,
    job: RunJob,
    authority: Authority,
    options: RunOptions,
) -> Result<RunHandle, String> {
    let log = log_of(&options);
    let trigger = ScannerTrigger::new(&controllers.trigger, Arc::clone(&log))?;
    let arm = arm(controllers, &job.cell().robot.kinematics, &log)?;
    let table = table(controllers, &log).ok_or_else(|| without_driver(controllers))?;
    Ok(session::live(job, Pair { arm, table }, trigger, authority, options))
}

fn log_of(options: &RunOptions) -> Arc<dyn WireLog> {
    match &options.audit {
        Some(audit) => Arc::<crate::execution::audit::AuditLog>::clone(audit),
        None => Arc::new(()),
    }
}

/// The arm's controller.
fn arm(controllers: &ControllersSpec, kinematics: &Kinematics, log: &Arc<dyn WireLog>) -> Result<HansArm, String> {
    match &controllers.arm {
        ArmControllerSpec::Hans(spec) => {
            Ok(HansArm::new(spec.clone(), kinematics.clone(), Wiring::over_tcp("arm", Arc::clone(log))))
        }
        ArmControllerSpec::Ur(_)
        | ArmControllerSpec::FanucRmi(_)
        | ArmControllerSpec::KukaRsi(_)
        | ArmControllerSpec::AbbEgm(_) => Err(without_driver(controllers)),
    }
}

/// The table's own controller; `None` if the arm's turns it.
fn table(controllers: &ControllersSpec, log: &Arc<dyn WireLog>) -> Option<TableDevice> {
    let wiring = Wiring::over_tcp("table", Arc::clone(log));
    match &controllers.table {
        TableControllerSpec::MinasA6(spec) => Some(TableDevice::MinasA6(MinasA6Table::new(spec.clone(), wiring))),
        TableControllerSpec::ModbusPlc(spec) => Some(TableDevice::Plc(PlcTable::new(spec.clone(), wiring))),
        TableControllerSpec::WithArm {} => None,
    }
}

fn without_driver(controllers: &ControllersSpec) -> String {
    let (arm, table) = (controllers.arm.name(), controllers.table.name());
    format!("this version has no driver for an arm by {arm} with a table by {table}; rehearse in the mode simulate")
}

/// Declares a device that is one of several, each driven as itself.
macro_rules! one_of {
    ($(#[$doc:meta])* $name:ident <$axes:literal> { $($variant:ident($device:ty)),+ $(,)? }) => {
        $(#[$doc])*
        enum $name {
            $($variant($device)),+
        }

        impl MotionDevice<$axes> for $name {
            async fn connect(&mut self) -> Result<Identity, DeviceError> {
                match self { $(Self::$variant(device) => device.connect().await),+ }
            }

            async fn state(&mut self) -> Result<DeviceState<$axes>, DeviceError> {
                match self { $(Self::$variant(device) => device.state().await),+ }
            }

            async fn arm(&mut self, watchdog: Duration) -> Result<(), DeviceError> {
                match self { $(Self::$variant(device) => device.arm(watchdog).await),+ }
            }

            async fn start(&mut self, target: &Target<$axes>) -> Result<(), DeviceError> {
                match self { $(Self::$variant(device) => device.start(target).await),+ }
            }

            async fn keep_alive(&mut self) -> Result<(), DeviceError> {
                match self { $(Self::$variant(device) => device.keep_alive().await),+ }
            }

            async fn stop(&mut self) -> Result<StopAcknowledged, DeviceError> {
                match self { $(Self::$variant(device) => device.stop().await),+ }
            }

            async fn release(&mut self) -> Result<(), DeviceError> {
                match self { $(Self::$variant(device) => device.release().await),+ }
            }

            fn fault_text(&self, fault: FaultCode) -> Option<&'static str> {
                match self { $(Self::$variant(device) => device.fault_text(fault)),+ }
            }
        }
    };
}

one_of! {
    /// Table of a cell file.
    TableDevice<1> { MinasA6(MinasA6Table), Plc(PlcTable) }
}
