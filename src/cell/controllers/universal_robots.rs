//! Universal Robots controller.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::address::check_socket;
use crate::cell::closed_list::closed_list;
use crate::cell::field_error::Findings;

closed_list! {
    /// Way in which a Universal Robots arm is led to a target.
    pub enum UrMotion {
        /// Set points at every cycle of the controller, `servoj`.
        Servoj = "servoj",
        /// The target at once, `movej`: the controller leads the arm there.
        Movej = "movej",
    }
}

/// Controller of Universal Robots. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct UrControllerSpec {
    /// Address of its real-time data exchange, `HOST:PORT`; the port is 30004.
    pub address: String,
    /// Address that takes URScript, `HOST:PORT`; the port is 30002.
    pub script_address: String,
    /// Address of this machine that the arm's program connects back to, `HOST:PORT`, a number address; port 50001 is usual.
    #[schema(value_type = String)]
    pub reverse_address: core::net::SocketAddr,
    /// Way in which the arm is led to a target. Default `servoj`.
    #[serde(default = "default_motion")]
    pub motion: UrMotion,
    /// Rate at which the state comes, and with `servoj` the set points go, Hz, 10 to 500: 500, on CB3 125. Default 500.
    #[serde(default = "default_rate_hz")]
    pub rate_hz: u32,
    /// Look-ahead of `servoj`, ms, 30 to 200. Default 100.
    #[serde(default = "default_lookahead_ms")]
    pub lookahead_ms: u32,
    /// Gain of `servoj`, 100 to 2000. Default 300.
    #[serde(default = "default_gain")]
    pub gain: u32,
}

fn default_motion() -> UrMotion {
    UrMotion::Servoj
}

fn default_rate_hz() -> u32 {
    500
}

fn default_lookahead_ms() -> u32 {
    100
}

fn default_gain() -> u32 {
    300
}

impl UrControllerSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        check_socket(&format!("{pointer}/address"), &self.address, findings);
        check_socket(&format!("{pointer}/script_address"), &self.script_address, findings);
        let reverse = self.reverse_address;
        findings.require(!reverse.ip().is_unspecified() && reverse.port() > 0, format!("{pointer}/reverse_address"), || {
            format!("is {reverse}; give the address under which the arm reaches this machine, and a port")
        });
        findings.range(format!("{pointer}/rate_hz"), self.rate_hz.into(), 10.0, 500.0, "Hz");
        findings.range(format!("{pointer}/lookahead_ms"), self.lookahead_ms.into(), 30.0, 200.0, "ms");
        findings.range(format!("{pointer}/gain"), self.gain.into(), 100.0, 2000.0, "");
    }
}
