//! FANUC controller with the Remote Motion Interface.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::address::check_socket;
use crate::cell::closed_list::closed_list;
use crate::cell::field_error::Findings;

closed_list! {
    /// Link from which a program counts joint 3. The controller counts it from the ground.
    pub enum JointThreeOrigin {
        /// Counted from the ground, as the controller does: nothing is converted. Robots with `joint_3_from_ground` are planned so.
        Ground = "ground",
        /// Counted from the upper arm: the controller's joint 3 is the program's less joint 2.
        UpperArm = "upper_arm",
    }
}

/// FANUC controller with the Remote Motion Interface. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct FanucRmiSpec {
    /// Address, `HOST:PORT`; the port is 16001.
    pub address: String,
    /// Link from which programs count joint 3. It has no default, since a wrong one sends the arm elsewhere: without it nothing is sent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub joint_3_from: Option<JointThreeOrigin>,
    /// Motion groups of a session as a bit mask, 1 to 128, one bit of it; needed where the controller has several. Default: not sent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group_mask: Option<u8>,
}

impl FanucRmiSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket(&format!("{pointer}/address"), &self.address, findings);
        if let Some(mask) = self.group_mask {
            findings.require(mask.is_power_of_two(), format!("{pointer}/group_mask"), || {
                format!("is {mask}; allowed is one group: 1, 2, 4, 8, 16, 32, 64 or 128")
            });
        }
    }
}
