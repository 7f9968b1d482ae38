//! Measured state of a run, 10 to 50 times a second.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::ReportedState;
use crate::cell::{Configuration, PoseSpec};
use crate::wire::angle::degrees;
use crate::wire::ids::RunId;

/// Joints and table angle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ConfigurationDocument {
    /// Joints 1 to 6, degrees.
    #[schema(min_items = 6, max_items = 6)]
    pub joints_deg: [f64; 6],
    /// Table angle, degrees.
    pub table_angle_deg: f64,
}

impl From<&Configuration> for ConfigurationDocument {
    fn from(configuration: &Configuration) -> Self {
        let Configuration { joints_rad, table_rad } = configuration;
        Self { joints_deg: joints_rad.map(degrees), table_angle_deg: degrees(*table_rad) }
    }
}

impl ConfigurationDocument {
    /// The configuration, radians.
    #[must_use]
    pub fn configuration(&self) -> Configuration {
        Configuration { joints_rad: self.joints_deg.map(f64::to_radians), table_rad: self.table_angle_deg.to_radians() }
    }
}

/// Measured state of a run at one moment; the event `live`. Samples are not stored: the latest can be replayed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RunSample {
    /// Id of the run.
    pub run_id: RunId,
    /// Number of the sample in the run, from 1.
    pub sequence: u64,
    /// State of the run.
    pub state: ReportedState,
    /// Time since the session began, s, by a real clock in every mode.
    pub elapsed_secs: f64,
    /// Step that it is at, from 0.
    pub step: usize,
    /// Measured joints and table angle.
    pub measured: ConfigurationDocument,
    /// Measured pose of the scanner in the base frame.
    pub base_from_scanner: PoseSpec,
    /// Largest deviation of an axis from where it was last sent, degrees.
    pub deviation_deg: f64,
}
