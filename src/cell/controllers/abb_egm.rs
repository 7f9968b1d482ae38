//! ABB controller with Externally Guided Motion.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::address::check_socket;
use crate::cell::field_error::Findings;

/// ABB controller with Externally Guided Motion. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct AbbEgmSpec {
    /// Address of this machine that the controller sends to, `HOST:PORT`; the port is 6510 as a rule.
    pub address: String,
}

impl AbbEgmSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket(&format!("{pointer}/address"), &self.address, findings);
    }
}
