//! ABB controller with Externally Guided Motion.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::address::check_socket;
use crate::cell::field_error::Findings;

/// ABB controller with Externally Guided Motion, joint guidance (`EGMActJoint`, `EGMRunJoint`). Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct AbbEgmSpec {
    /// Address of this machine that the controller sends to, `HOST:PORT`; the port is 6510 as a rule.
    pub address: String,
    /// Host that frames are taken from, a number address. Default: the one that sends first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<String>)]
    pub controller_host: Option<core::net::IpAddr>,
    /// Sample time of `EGMActJoint`, ms, 4 to 100, a multiple of 4. Default 4.
    #[serde(default = "default_cycle_ms")]
    pub cycle_ms: u32,
    /// External axis that turns the table, 1 to 6, with `with_arm`. Default 1.
    #[serde(default = "default_table_axis")]
    pub table_axis: u8,
}

fn default_cycle_ms() -> u32 {
    4
}

fn default_table_axis() -> u8 {
    1
}

impl AbbEgmSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket(&format!("{pointer}/address"), &self.address, findings);
        findings.range(format!("{pointer}/cycle_ms"), self.cycle_ms.into(), 4.0, 100.0, "ms");
        findings.require(self.cycle_ms.is_multiple_of(4), format!("{pointer}/cycle_ms"), || {
            format!("is {} ms; the controller samples every 4 ms or a multiple of it", self.cycle_ms)
        });
        findings.range(format!("{pointer}/table_axis"), self.table_axis.into(), 1.0, 6.0, "");
    }
}
