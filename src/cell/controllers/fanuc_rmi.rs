//! FANUC controller with the Remote Motion Interface.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::address::check_socket;
use crate::cell::field_error::Findings;

/// FANUC controller with the Remote Motion Interface. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct FanucRmiSpec {
    /// Address, `HOST:PORT`; the port is 16001.
    pub address: String,
}

impl FanucRmiSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket(&format!("{pointer}/address"), &self.address, findings);
    }
}
