//! Drivers by the protocols of a cell file: one device for each, so that a session is begun in one place for all of them.

use std::sync::Arc;
use std::time::Duration;

use tokio::time::Instant;

use crate::cell::{ArmControllerSpec, Cell, ControllersSpec, Kinematics, TableControllerSpec};
use crate::execution::device::{DeviceError, DeviceState, FaultCode, Identity, MotionDevice, Target, WireLog};
use crate::execution::drivers::egm::{AbbArm, AbbEgm};
use crate::execution::drivers::fanuc_rmi::FanucArm;
use crate::execution::drivers::hans::HansArm;
use crate::execution::drivers::kuka_rsi::{KukaArm, KukaRsi};
use crate::execution::drivers::minas_a6::MinasA6Table;
use crate::execution::drivers::modbus_plc::PlcTable;
use crate::execution::drivers::stream::Wiring;
use crate::execution::drivers::trigger::ScannerTrigger;
use crate::execution::drivers::ur::{UniversalRobots, UrArm};
use crate::execution::session::streamer::Jitter;
use crate::execution::session::{self, Authority, Joined, ObservedJoined, ObservedPair, Pair, RunHandle, RunJob, RunOptions};

/// Begins a run that reads the devices.
///
/// # Errors
/// A table on a controller whose driver has no external axis.
pub(super) fn dry_run(controllers: &ControllersSpec, job: RunJob, options: RunOptions) -> Result<RunHandle, String> {
    let log = log_of(&options);
    Ok(match table(controllers, job.cell(), &log) {
        Some(table) => {
            let arm = arm(&controllers.arm, &job.cell().robot.kinematics, &log);
            session::dry_run(job, ObservedPair::new(arm, table), options)
        }
        None => session::dry_run(job, ObservedJoined::new(joined(&controllers.arm, &log)?), options),
    })
}

/// Begins a run that moves the devices.
///
/// # Errors
/// A table on a controller whose driver has no external axis; a trigger without a driver.
pub(super) fn live(
    controllers: &ControllersSpec,
    job: RunJob,
    authority: Authority,
    options: RunOptions,
) -> Result<RunHandle, String> {
    let log = log_of(&options);
    let trigger = ScannerTrigger::new(controllers, Arc::clone(&log))?;
    Ok(match table(controllers, job.cell(), &log) {
        Some(table) => {
            let arm = arm(&controllers.arm, &job.cell().robot.kinematics, &log);
            session::live(job, Pair { arm, table }, trigger, authority, options)
        }
        None => session::live(job, Joined(joined(&controllers.arm, &log)?), trigger, authority, options),
    })
}

fn log_of(options: &RunOptions) -> Arc<dyn WireLog> {
    match &options.audit {
        Some(audit) => Arc::<crate::execution::audit::AuditLog>::clone(audit),
        None => Arc::new(()),
    }
}

fn arm(spec: &ArmControllerSpec, kinematics: &Kinematics, log: &Arc<dyn WireLog>) -> ArmDevice {
    let wiring = Wiring::over_tcp("arm", Arc::clone(log));
    match spec {
        ArmControllerSpec::Hans(spec) => ArmDevice::Hans(HansArm::new(spec.clone(), kinematics.clone(), wiring)),
        ArmControllerSpec::Ur(spec) => ArmDevice::Ur(UniversalRobots::arm(spec, wiring)),
        ArmControllerSpec::FanucRmi(spec) => ArmDevice::Fanuc(FanucArm::new(spec, wiring)),
        ArmControllerSpec::KukaRsi(spec) => ArmDevice::Kuka(KukaRsi::arm(spec, Arc::clone(log))),
        ArmControllerSpec::AbbEgm(spec) => ArmDevice::Abb(AbbEgm::arm(spec, Arc::clone(log))),
    }
}

/// The table's own controller; `None` if the arm's turns it.
fn table(controllers: &ControllersSpec, cell: &Cell, log: &Arc<dyn WireLog>) -> Option<TableDevice> {
    let wiring = Wiring::over_tcp("table", Arc::clone(log));
    match &controllers.table {
        TableControllerSpec::MinasA6(spec) => {
            let rated = cell.turntable.axis.max_acceleration_rad_per_s2;
            Some(TableDevice::MinasA6(MinasA6Table::new(spec.clone(), rated, wiring)))
        }
        TableControllerSpec::ModbusPlc(spec) => Some(TableDevice::Plc(PlcTable::new(spec.clone(), wiring))),
        TableControllerSpec::WithArm {} => None,
    }
}

/// An arm whose controller turns the table.
fn joined(spec: &ArmControllerSpec, log: &Arc<dyn WireLog>) -> Result<JoinedDevice, String> {
    match spec {
        ArmControllerSpec::FanucRmi(spec) => {
            Ok(JoinedDevice::Fanuc(FanucArm::new(spec, Wiring::over_tcp("arm", Arc::clone(log)))))
        }
        ArmControllerSpec::KukaRsi(spec) => Ok(JoinedDevice::Kuka(KukaRsi::arm(spec, Arc::clone(log)))),
        ArmControllerSpec::AbbEgm(spec) => Ok(JoinedDevice::Abb(AbbEgm::arm(spec, Arc::clone(log)))),
        ArmControllerSpec::Hans(_) | ArmControllerSpec::Ur(_) => {
            Err(format!("the driver of {} has no external axis; give the table a controller of its own", spec.name()))
        }
    }
}

/// Declares a device that is one of several, each driven as itself.
macro_rules! one_of {
    ($(#[$doc:meta])* $name:ident <$axes:literal> { $($variant:ident($device:ty)),+ $(,)? }) => {
        $(#[$doc])*
        #[allow(clippy::large_enum_variant, reason = "one lives a run, and moves once; not all are large")]
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

            async fn stop(&mut self, sent_at: &mut Option<Instant>) -> Result<Instant, DeviceError> {
                match self { $(Self::$variant(device) => device.stop(sent_at).await),+ }
            }

            async fn release(&mut self) -> Result<(), DeviceError> {
                match self { $(Self::$variant(device) => device.release().await),+ }
            }

            fn jitter(&self) -> Option<Jitter> {
                match self { $(Self::$variant(device) => device.jitter()),+ }
            }

            fn fault_text(&self, fault: FaultCode) -> Option<&'static str> {
                match self { $(Self::$variant(device) => device.fault_text(fault)),+ }
            }
        }
    };
}

one_of! {
    /// Arm of a cell file.
    ArmDevice<6> { Hans(HansArm), Ur(UrArm), Fanuc(FanucArm<6>), Kuka(KukaArm<6>), Abb(AbbArm<6>) }
}
one_of! {
    /// Table of a cell file.
    TableDevice<1> { MinasA6(MinasA6Table), Plc(PlcTable) }
}
one_of! {
    /// Arm of a cell file whose controller turns the table.
    JoinedDevice<7> { Fanuc(FanucArm<7>), Kuka(KukaArm<7>), Abb(AbbArm<7>) }
}
