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
    /// Address of its pushed state, `HOST:PORT`; the port is 10004 as delivered. Default: the state is polled.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub state_address: Option<String>,
    /// Address of its servo interface, `HOST:PORT`; the port is 8892 as delivered. Default: moves are sent as way points.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub servo_address: Option<String>,
    /// First argument of StartServo, which is a period or a gain by the firmware. Default 0.02.
    #[serde(default = "default_servo_argument")]
    pub servo_argument: f64,
    /// Period of servo streaming, ms, 1 to 100. Default 20.
    #[serde(default = "default_servo_period_ms")]
    pub servo_period_ms: u32,
    /// Look-ahead of servo streaming, ms, 1 to 1000. Default 200.
    #[serde(default = "default_servo_lookahead_ms")]
    pub servo_lookahead_ms: u32,
    /// Tool frame on the controller. Default `TCP`.
    #[serde(default = "default_tool")]
    pub tool: String,
    /// User frame on the controller. Default `Base`.
    #[serde(default = "default_user_frame")]
    pub user_frame: String,
    /// Interval at which the state is polled, ms, 5 to 100. Default 20.
    #[serde(default = "default_poll_ms")]
    pub poll_ms: u32,
}

fn default_servo_argument() -> f64 {
    0.02
}

fn default_servo_period_ms() -> u32 {
    20
}

fn default_servo_lookahead_ms() -> u32 {
    200
}

fn default_tool() -> String {
    "TCP".to_owned()
}

fn default_user_frame() -> String {
    "Base".to_owned()
}

fn default_poll_ms() -> u32 {
    20
}

impl HansSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket(&format!("{pointer}/address"), &self.address, findings);
        for (field, address) in [("state_address", &self.state_address), ("servo_address", &self.servo_address)] {
            if let Some(address) = address {
                check_socket(&format!("{pointer}/{field}"), address, findings);
            }
        }
        findings.range(format!("{pointer}/servo_argument"), self.servo_argument, 0.0, 1e6, "");
        findings.range(format!("{pointer}/servo_period_ms"), self.servo_period_ms.into(), 1.0, 100.0, "ms");
        findings.range(format!("{pointer}/servo_lookahead_ms"), self.servo_lookahead_ms.into(), 1.0, 1000.0, "ms");
        findings.range(format!("{pointer}/poll_ms"), self.poll_ms.into(), 5.0, 100.0, "ms");
        for (field, name) in [("tool", &self.tool), ("user_frame", &self.user_frame)] {
            let is_name = !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
            findings
                .require(is_name, format!("{pointer}/{field}"), || format!("is {name:?}; allowed are letters, digits and '_'"));
        }
    }
}
