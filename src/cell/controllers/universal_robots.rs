//! Universal Robots controller.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::address::check_socket;
use crate::cell::field_error::Findings;

/// Controller of Universal Robots. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct UrControllerSpec {
    /// Address of its real-time data exchange, `HOST:PORT`; the port is 30004.
    pub address: String,
    /// Address that takes URScript, `HOST:PORT`; the port is 30002.
    pub script_address: String,
}

impl UrControllerSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket(&format!("{pointer}/address"), &self.address, findings);
        check_socket(&format!("{pointer}/script_address"), &self.script_address, findings);
    }
}
