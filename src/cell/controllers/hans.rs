//! Han's CPS controller.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::address::check_socket;
use crate::cell::field_error::Findings;

/// Han's controller (CPS). Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct HansSpec {
    /// Address of its command interface, `HOST:PORT`; the port is 10003 as delivered.
    pub address: String,
    /// Part of the model that the controller names, whatever its case; another robot is refused. Default: not compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<String>,
    /// Longest wait for a connection, with further attempts, ms, 100 to 60000. Default 3000.
    #[serde(default = "default_connect_timeout_ms")]
    pub connect_timeout_ms: u32,
    /// Longest wait for a reply, ms, 10 to 5000. Default 200.
    #[serde(default = "default_reply_timeout_ms")]
    pub reply_timeout_ms: u32,
    /// Interval at which the controller is asked while something is awaited, ms, 5 to 100. Default 20.
    #[serde(default = "default_poll_ms")]
    pub poll_ms: u32,
    /// Override that the controller is set to when it is armed, 0.01 to 1. Default: the pendant's stays.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub override_fraction: Option<f64>,
    /// True if arming may enable the drives of a robot that is disabled; what was enabled is disabled at release. Default
    /// true.
    #[serde(default = "default_enables_drives")]
    pub enables_drives: bool,
    /// Largest distance between the flange where the controller has it and where the cell's kinematics have it, mm, 0.01 to
    /// 100. Default 1.
    #[serde(default = "default_kinematics_tolerance_mm")]
    pub kinematics_tolerance_mm: f64,
    /// Tool frame on the controller. Default `TCP`.
    #[serde(default = "default_tool")]
    pub tool: String,
    /// User frame on the controller. Default `Base`.
    #[serde(default = "default_user_frame")]
    pub user_frame: String,
    /// Servo streaming. Default: moves are sent as way points.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub servo: Option<HansServoSpec>,
}

/// Servo streaming to Han's controller. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct HansServoSpec {
    /// Address of the servo interface, `HOST:PORT`; the port is 8892 as delivered. It takes one client.
    pub address: String,
    /// Address of the binary real-time state, `HOST:PORT`; the port is 8893 as delivered.
    pub state_address: String,
    /// Period of streaming, ms, 1 to 100: the cycle that the real-time state names, or arming is refused. Default 4.
    #[serde(default = "default_servo_period_ms")]
    pub period_ms: u32,
    /// First argument of `StartServo`, 0 to 1000000: the period in seconds or a gain, by the firmware.
    pub start_argument: f64,
    /// Second argument of `StartServo`, the look-ahead, s, 0.001 to 1.
    pub lookahead_secs: f64,
}

fn default_connect_timeout_ms() -> u32 {
    3000
}

fn default_reply_timeout_ms() -> u32 {
    200
}

fn default_poll_ms() -> u32 {
    20
}

fn default_enables_drives() -> bool {
    true
}

fn default_kinematics_tolerance_mm() -> f64 {
    1.0
}

fn default_tool() -> String {
    "TCP".to_owned()
}

fn default_user_frame() -> String {
    "Base".to_owned()
}

fn default_servo_period_ms() -> u32 {
    4
}

impl HansSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket(&format!("{pointer}/address"), &self.address, findings);
        findings.range(format!("{pointer}/connect_timeout_ms"), self.connect_timeout_ms.into(), 100.0, 60_000.0, "ms");
        findings.range(format!("{pointer}/reply_timeout_ms"), self.reply_timeout_ms.into(), 10.0, 5000.0, "ms");
        findings.range(format!("{pointer}/poll_ms"), self.poll_ms.into(), 5.0, 100.0, "ms");
        if let Some(fraction) = self.override_fraction {
            findings.range(format!("{pointer}/override_fraction"), fraction, 0.01, 1.0, "");
        }
        findings.range(format!("{pointer}/kinematics_tolerance_mm"), self.kinematics_tolerance_mm, 0.01, 100.0, "mm");
        for (field, name) in [("tool", &self.tool), ("user_frame", &self.user_frame)] {
            let is_name = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
            findings
                .require(is_name, format!("{pointer}/{field}"), || format!("is {name:?}; allowed are letters, digits and '_'"));
        }
        if let Some(servo) = &self.servo {
            servo.check(&format!("{pointer}/servo"), findings);
        }
    }
}

impl HansServoSpec {
    fn check(&self, pointer: &str, findings: &mut Findings) {
        for (field, address) in [("address", &self.address), ("state_address", &self.state_address)] {
            check_socket(&format!("{pointer}/{field}"), address, findings);
        }
        findings.range(format!("{pointer}/period_ms"), self.period_ms.into(), 1.0, 100.0, "ms");
        findings.range(format!("{pointer}/start_argument"), self.start_argument, 0.0, 1e6, "");
        findings.range(format!("{pointer}/lookahead_secs"), self.lookahead_secs, 0.001, 1.0, "s");
    }
}
