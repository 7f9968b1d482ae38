//! KUKA controller with the Robot Sensor Interface.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::address::check_socket;
use crate::cell::field_error::Findings;

/// KUKA controller with the Robot Sensor Interface: axis corrections against the pose where it was switched on, `#ABSOLUTE`.
/// Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct KukaRsiSpec {
    /// Address of this machine that the controller sends to, `HOST:PORT`; the port is that of its configuration.
    pub address: String,
    /// Host that telegrams are taken from, a number address. Default: the one that sends first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    pub controller_host: Option<core::net::IpAddr>,
    /// Interpolation cycle of the controller, ms, 1 to 50: 4 (`IPO_FAST`) or 12. Default 4.
    #[serde(default = "default_cycle_ms")]
    pub cycle_ms: u32,
    /// `SENTYPE` of the controller's configuration. Default `ImFree`.
    #[serde(default = "default_sender_type")]
    pub sender_type: String,
    /// Element that takes the corrections of `A1` to `A6`. Default `AK`.
    #[serde(default = "default_axis_tag")]
    pub axis_tag: String,
    /// Element that takes the correction of the table, with `with_arm`. Default `EK`.
    #[serde(default = "default_table_tag")]
    pub table_tag: String,
    /// External axis that turns the table, 1 to 6: its attribute is `E1` to `E6`. Default 1.
    #[serde(default = "default_table_axis")]
    pub table_axis: u8,
}

fn default_cycle_ms() -> u32 {
    4
}

fn default_sender_type() -> String {
    "ImFree".to_owned()
}

fn default_axis_tag() -> String {
    "AK".to_owned()
}

fn default_table_tag() -> String {
    "EK".to_owned()
}

fn default_table_axis() -> u8 {
    1
}

impl KukaRsiSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket(&format!("{pointer}/address"), &self.address, findings);
        findings.range(format!("{pointer}/cycle_ms"), self.cycle_ms.into(), 1.0, 50.0, "ms");
        findings.range(format!("{pointer}/table_axis"), self.table_axis.into(), 1.0, 6.0, "");
        for (field, name) in [("sender_type", &self.sender_type), ("axis_tag", &self.axis_tag), ("table_tag", &self.table_tag)] {
            findings.require(is_name(name), format!("{pointer}/{field}"), || {
                format!("is {name:?}; allowed are 1 to 40 letters, digits and underscores, a letter first")
            });
        }
    }
}

/// Returns true for a name that needs no escape in XML.
fn is_name(name: &str) -> bool {
    let starts_well = name.starts_with(|c: char| c.is_ascii_alphabetic());
    starts_well && name.len() <= 40 && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}
