//! The turntable: a plate that turns about the table frame's +z, its limits, and what stands below it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::axis::{Axis, AxisSpec};
use super::field_error::{FieldError, Findings};
use super::field_ranges;
use super::runout::{RunoutHarmonic, RunoutSpec, error_motion, max_displacement_mm};
use super::shape_spec::BodySpec;
use crate::geometry::{Plate, Pose, Table, table_from_plate};

/// Angle range that is planned on for a table without end stops, degrees: a turn each way, so that a program's angles
/// stay absolute.
const CONTINUOUS_DEG: f64 = 360.0;
/// Angle range of a table that stands still, degrees: every axis has one.
const FIXED_DEG: f64 = 0.001;

/// A turntable. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct TurntableSpec {
    /// Name, unique among turntables.
    pub name: String,
    /// Diameter of the plate, mm, 1 to 10000.
    pub plate_diameter_mm: f64,
    /// Thickness of the plate, mm, 0.1 to 1000; its upper face is z = 0 of the table frame.
    pub plate_thickness_mm: f64,
    /// Range of the rotation.
    pub rotation: RotationSpec,
    /// Rated speed, degrees per second, 0.1 to 3600.
    pub max_speed_deg_per_s: f64,
    /// Rated acceleration, degrees per second squared, 0.1 to 100000.
    pub max_acceleration_deg_per_s2: f64,
    /// Bodies that stand below the plate and do not turn, in the table frame.
    #[serde(default)]
    pub body: Vec<BodySpec>,
    /// Runout of the plate as harmonics of its angle, each order once, at most 8: from a calibration. Default: none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub runout: Vec<RunoutSpec>,
}

/// Range of a table's rotation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum RotationSpec {
    /// Turns without end stops; plans stay within a turn each way.
    Continuous {},
    /// Turns between end stops: -3600 ≤ min < max ≤ 3600.
    Limited {
        /// Lowest angle, degrees.
        min_deg: f64,
        /// Highest angle, degrees.
        max_deg: f64,
    },
}

field_ranges! {
    TurntableSpec {
        PLATE_DIAMETER_MM = "plate_diameter_mm", [1.0, 1e4] "mm";
        PLATE_THICKNESS_MM = "plate_thickness_mm", [0.1, 1000.0] "mm";
        MAX_SPEED = "max_speed_deg_per_s", [0.1, 3600.0] "°/s";
        MAX_ACCELERATION = "max_acceleration_deg_per_s2", [0.1, 1e5] "°/s²";
    }
}

field_ranges! {
    RotationSpec {
        MIN_DEG = "min_deg", [-3600.0, 3600.0] "°";
        MAX_DEG = "max_deg", [-3600.0, 3600.0] "°";
    }
}

impl TurntableSpec {
    /// Checks every field and builds the turntable.
    ///
    /// # Errors
    /// All fields that are out of range or inconsistent.
    pub fn build(&self) -> Result<Turntable, Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check(&mut findings);
        findings.into_result()?;
        Ok(Turntable {
            name: self.name.clone(),
            plate_radius_mm: 0.5 * self.plate_diameter_mm,
            plate_thickness_mm: self.plate_thickness_mm,
            axis: self.axis().build(),
            runout: self.runout.iter().map(RunoutSpec::build).collect(),
        })
    }

    fn axis(&self) -> AxisSpec {
        let (min_deg, max_deg) = match self.rotation {
            RotationSpec::Continuous {} => (-CONTINUOUS_DEG, CONTINUOUS_DEG),
            RotationSpec::Limited { min_deg, max_deg } => (min_deg, max_deg),
        };
        let (max_speed_deg_per_s, max_acceleration_deg_per_s2) = (self.max_speed_deg_per_s, self.max_acceleration_deg_per_s2);
        AxisSpec { min_deg, max_deg, max_speed_deg_per_s, max_acceleration_deg_per_s2 }
    }

    fn check(&self, findings: &mut Findings) {
        findings.require(!self.name.is_empty(), "/name", || "is empty; name the turntable".into());
        Self::PLATE_DIAMETER_MM.check("", &self.plate_diameter_mm, findings);
        Self::PLATE_THICKNESS_MM.check("", &self.plate_thickness_mm, findings);
        if let RotationSpec::Limited { min_deg, max_deg } = self.rotation {
            RotationSpec::MIN_DEG.check("/rotation", &min_deg, findings);
            RotationSpec::MAX_DEG.check("/rotation", &max_deg, findings);
            findings.require(min_deg < max_deg, "/rotation/min_deg", || {
                let fixed = format!("; for a table that stands still, give a max_deg {FIXED_DEG}° above it");
                format!("is {min_deg}°, not below max_deg {max_deg}°{}", if max_deg < min_deg { "" } else { fixed.as_str() })
            });
        }
        Self::MAX_SPEED.check("", &self.max_speed_deg_per_s, findings);
        Self::MAX_ACCELERATION.check("", &self.max_acceleration_deg_per_s2, findings);
        for (index, body) in self.body.iter().enumerate() {
            body.check(&format!("/body/{index}"), findings);
        }
        RunoutSpec::check_all(&self.runout, "/runout", findings);
    }
}

/// A turntable, checked and in radians. Made from a [`TurntableSpec`].
#[derive(Clone, Debug, PartialEq)]
pub struct Turntable {
    /// Name of the specification.
    pub name: String,
    /// Radius of the plate.
    pub plate_radius_mm: f64,
    /// Thickness of the plate, below z = 0 of the table frame.
    pub plate_thickness_mm: f64,
    /// Limits.
    pub axis: Axis,
    /// Runout of the plate.
    pub runout: Vec<RunoutHarmonic>,
}

impl Turntable {
    /// The plate after the table has turned, with its runout.
    #[must_use]
    pub fn table_from_plate(&self, angle_rad: f64) -> Pose<Table, Plate> {
        let turned = table_from_plate(angle_rad);
        if self.runout.is_empty() {
            return turned;
        }
        Pose::<Table, Table>::claim(error_motion(&self.runout, angle_rad)) * turned
    }

    /// Largest displacement of plate or part by the runout, mm.
    #[must_use]
    pub fn runout_displacement_mm(&self) -> f64 {
        max_displacement_mm(&self.runout, self.plate_radius_mm)
    }
}
