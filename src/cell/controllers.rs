//! The section `[controllers]` of a cell file: which controllers move the arm and the table of a cell, what triggers its scanner,
//! and how far they are trusted. Addresses are reached from the server's machine, so the section is read from the operator's file
//! alone: [`super::CellSpec`], which requests carry, has no such field.

mod abb_egm;
mod address;
mod fanuc_rmi;
mod hans;
mod kuka_rsi;
mod minas_a6;
mod modbus_plc;
mod trigger;
mod universal_robots;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

pub use abb_egm::AbbEgmSpec;
pub use fanuc_rmi::{FanucRmiSpec, JointThreeOrigin};
pub use hans::{HansServoSpec, HansSpec};
pub use kuka_rsi::KukaRsiSpec;
pub use minas_a6::{GatewayFraming, MinasA6Spec, SerialParity, WordOrder};
pub use modbus_plc::ModbusPlcSpec;
pub use trigger::{CommandTriggerSpec, DigitalTriggerSpec, HttpTriggerSpec, NoTriggerSpec, TriggerSpec};
pub use universal_robots::{UrControllerSpec, UrMotion};

use super::dialect::Dialect;
use super::field_error::{FieldError, Findings};

/// Controllers of a cell. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ControllersSpec {
    /// Time without a sign of life after which a device stops by itself, where it can, ms, 50 to 500. Default 200.
    #[serde(default = "default_watchdog_ms")]
    pub watchdog_ms: u32,
    /// Largest age of a measured state that motion is based on, ms, 10 to 1000. Default 100.
    #[serde(default = "default_state_max_age_ms")]
    pub state_max_age_ms: u32,
    /// Largest distance of an axis from its target where it counts as reached, degrees, 0.001 to 5. Default 0.1.
    #[serde(default = "default_position_tolerance_deg")]
    pub position_tolerance_deg: f64,
    /// Largest distance of an axis from the program's start before the first move, degrees, 0.01 to 10. Default 0.5.
    #[serde(default = "default_start_tolerance_deg")]
    pub start_tolerance_deg: f64,
    /// Largest speed override until a run of the program has been completed live in the cell, 0.01 to 1. Default 0.25.
    #[serde(default = "default_first_run_speed")]
    pub first_run_speed: f64,
    /// Box in the base frame that the flange does not leave. Default: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub workspace: Option<WorkspaceSpec>,
    /// Controller of the arm.
    pub arm: ArmControllerSpec,
    /// Controller of the table.
    pub table: TableControllerSpec,
    /// Trigger of the scanner. Default: none.
    #[serde(default)]
    pub trigger: TriggerSpec,
}

fn default_watchdog_ms() -> u32 {
    200
}

fn default_state_max_age_ms() -> u32 {
    100
}

fn default_position_tolerance_deg() -> f64 {
    0.1
}

fn default_start_tolerance_deg() -> f64 {
    0.5
}

fn default_first_run_speed() -> f64 {
    0.25
}

/// Box in the base frame. Unknown fields are refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct WorkspaceSpec {
    /// Lowest corner, mm, -10000 to 10000.
    #[schema(min_items = 3, max_items = 3)]
    pub min_mm: [f64; 3],
    /// Highest corner, mm, -10000 to 10000; above the lowest in every axis.
    #[schema(min_items = 3, max_items = 3)]
    pub max_mm: [f64; 3],
}

/// Controller of an arm, by its protocol.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "protocol", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum ArmControllerSpec {
    /// Han's CPS, text commands over TCP.
    Hans(HansSpec),
    /// Universal Robots, RTDE and URScript.
    Ur(UrControllerSpec),
    /// FANUC Remote Motion Interface.
    FanucRmi(FanucRmiSpec),
    /// KUKA Robot Sensor Interface.
    KukaRsi(KukaRsiSpec),
    /// ABB Externally Guided Motion.
    AbbEgm(AbbEgmSpec),
}

/// Controller of a table, by its protocol.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "protocol", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum TableControllerSpec {
    /// Panasonic MINAS A6, block operation over Modbus.
    MinasA6(MinasA6Spec),
    /// A PLC with a register map, Modbus TCP.
    ModbusPlc(ModbusPlcSpec),
    /// An external axis of the arm's controller.
    WithArm {},
}

impl ControllersSpec {
    /// Name of the section.
    pub const SECTION: &str = "controllers";

    /// Takes the section out of the text of a cell file, so that the rest is a [`super::CellSpec`]; `None` if there is none.
    #[must_use]
    pub fn take_section(file: &mut Value) -> Option<Value> {
        file.as_object_mut()?.remove(Self::SECTION)
    }

    /// Checks the range of every field.
    ///
    /// # Errors
    /// All fields out of range, with pointers below the section.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        findings.range("/watchdog_ms", self.watchdog_ms.into(), 50.0, 500.0, "ms");
        findings.range("/state_max_age_ms", self.state_max_age_ms.into(), 10.0, 1000.0, "ms");
        findings.range("/position_tolerance_deg", self.position_tolerance_deg, 0.001, 5.0, "°");
        findings.range("/start_tolerance_deg", self.start_tolerance_deg, 0.01, 10.0, "°");
        findings.range("/first_run_speed", self.first_run_speed, 0.01, 1.0, "");
        if let Some(workspace) = &self.workspace {
            workspace.check("/workspace", &mut findings);
        }
        self.arm.check("/arm", &mut findings);
        self.table.check("/table", &mut findings);
        self.trigger.check("/trigger", &mut findings);
        // Several tables may share the address of a serial gateway; an arm's controller is none.
        let address = self.table.address().map(|address| address.trim_start_matches("tcp://"));
        findings.require(address != Some(self.arm.address()), "/table/address", || {
            format!("is {}, the arm's; give the address of the table's own controller", self.arm.address())
        });
        let is_carried = self.arm.has_external_axis();
        findings.require(is_carried || self.table != TableControllerSpec::WithArm {}, "/table/protocol", || {
            format!("is with_arm; the driver of {} has no external axis: give the table a controller of its own", self.arm.name())
        });
        findings.into_result()
    }
}

impl WorkspaceSpec {
    fn check(&self, pointer: &str, findings: &mut Findings) {
        for axis in 0..3 {
            let (low, high) = (self.min_mm[axis], self.max_mm[axis]);
            findings.range(format!("{pointer}/min_mm/{axis}"), low, -1e4, 1e4, "mm");
            findings.range(format!("{pointer}/max_mm/{axis}"), high, -1e4, 1e4, "mm");
            findings
                .require(low < high, format!("{pointer}/min_mm/{axis}"), || format!("is {low} mm, not below max_mm {high} mm"));
        }
    }
}

impl ArmControllerSpec {
    /// Name of the protocol.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Hans(_) => "hans",
            Self::Ur(_) => "ur",
            Self::FanucRmi(_) => "fanuc_rmi",
            Self::KukaRsi(_) => "kuka_rsi",
            Self::AbbEgm(_) => "abb_egm",
        }
    }

    /// Address of the controller.
    #[must_use]
    pub fn address(&self) -> &str {
        match self {
            Self::Hans(spec) => &spec.address,
            Self::Ur(spec) => &spec.address,
            Self::FanucRmi(spec) => &spec.address,
            Self::KukaRsi(spec) => &spec.address,
            Self::AbbEgm(spec) => &spec.address,
        }
    }

    /// Language of the controllers that speak the protocol: it tells their maker.
    #[must_use]
    pub fn dialect(&self) -> Dialect {
        match self {
            Self::Hans(_) => Dialect::Hans,
            Self::Ur(_) => Dialect::Urscript,
            Self::FanucRmi(_) => Dialect::Fanuc,
            Self::KukaRsi(_) => Dialect::Krl,
            Self::AbbEgm(_) => Dialect::Rapid,
        }
    }

    /// True if the driver moves an external axis with the arm.
    fn has_external_axis(&self) -> bool {
        match self {
            Self::Hans(_) | Self::Ur(_) => false,
            Self::FanucRmi(_) | Self::KukaRsi(_) | Self::AbbEgm(_) => true,
        }
    }

    /// Returns true if the driver sets outputs of the controller and reads its inputs.
    #[must_use]
    pub fn has_digital_signals(&self) -> bool {
        match self {
            Self::Hans(_) => true,
            Self::Ur(_) | Self::FanucRmi(_) | Self::KukaRsi(_) | Self::AbbEgm(_) => false,
        }
    }

    fn check(&self, pointer: &str, findings: &mut Findings) {
        match self {
            Self::Hans(spec) => spec.check(pointer, findings),
            Self::Ur(spec) => spec.check(pointer, findings),
            Self::FanucRmi(spec) => spec.check(pointer, findings),
            Self::KukaRsi(spec) => spec.check(pointer, findings),
            Self::AbbEgm(spec) => spec.check(pointer, findings),
        }
    }
}

impl TableControllerSpec {
    /// Number of the device behind the address.
    #[must_use]
    pub fn unit(&self) -> Option<u8> {
        match self {
            Self::MinasA6(spec) => Some(spec.node),
            Self::ModbusPlc(spec) => Some(spec.unit),
            Self::WithArm {} => None,
        }
    }

    /// Address of a controller of its own.
    #[must_use]
    pub fn address(&self) -> Option<&str> {
        match self {
            Self::MinasA6(spec) => Some(&spec.address),
            Self::ModbusPlc(spec) => Some(&spec.address),
            Self::WithArm {} => None,
        }
    }

    /// Name of the protocol.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::MinasA6(_) => "minas_a6",
            Self::ModbusPlc(_) => "modbus_plc",
            Self::WithArm {} => "with_arm",
        }
    }

    fn check(&self, pointer: &str, findings: &mut Findings) {
        match self {
            Self::MinasA6(spec) => spec.check(pointer, findings),
            Self::ModbusPlc(spec) => spec.check(pointer, findings),
            Self::WithArm {} => {}
        }
    }
}

#[cfg(test)]
mod tests;
