//! KUKA controller with the Robot Sensor Interface.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::address::check_socket;
use crate::cell::field_error::Findings;

/// KUKA controller with the Robot Sensor Interface. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct KukaRsiSpec {
    /// Address of this machine that the controller sends to, `HOST:PORT`; the port is that of its configuration.
    pub address: String,
}

impl KukaRsiSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket(&format!("{pointer}/address"), &self.address, findings);
    }
}
