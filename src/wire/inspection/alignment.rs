//! Documents of where the scans lie.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::PoseSpec;
use crate::inspection::Inspection;
use crate::inspection::deviation::Alignment;
use crate::inspection::registration::{KeptPose, PartNotFound, RegistrationOptions, ViewRegistration, why_not_found};

/// Registered poses of the scans, and how well they are known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AlignmentDocument {
    /// Method.
    pub method: Alignment,
    /// Takes the part's coordinates by the stated poses to those of the mesh: where the part lies other than planned.
    pub mesh_from_stated: PoseSpec,
    /// Pose of the part on the table as its scans show it, for `POST /runs/{id}/located` and for a plan of its own; `null` without a
    /// cell, where the alignment was not found, and with several setups.
    #[serde(default)]
    pub table_from_part: Option<PoseSpec>,
    /// Angle by which the part is turned, degrees.
    pub part_turned_deg: f64,
    /// Distance by which the middle of the part is off, mm.
    pub part_shifted_mm: f64,
    /// Largest standard deviation of the pose about or along an axis, degrees and mm.
    pub part_sd: RigidSdDocument,
    /// Standard deviation of a point's distance from the part, robust, mm.
    pub noise_mm: f64,
    /// Reason for which the alignment counts as not found, so that no place of the part is known; `null` where it was found.
    #[serde(default)]
    pub not_found: Option<PartNotFound>,
    /// Share of all points that lies on the part.
    pub inlier_share: f64,
    /// Views.
    pub views: Vec<ViewAlignmentDocument>,
}

/// Standard deviations of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RigidSdDocument {
    /// Standard deviation of the rotation, degrees.
    pub rotation_deg: f64,
    /// Standard deviation of the translation, mm.
    pub translation_mm: f64,
}

/// Registered pose of one scan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ViewAlignmentDocument {
    /// Viewpoint of the plan.
    pub viewpoint: u32,
    /// Points that were matched.
    pub points: usize,
    /// Share of them that lies on the part.
    pub inlier_share: f64,
    /// Root mean square of their distances, mm.
    pub rms_mm: f64,
    /// Angle by which the view is off its stated pose, beyond the part's, degrees.
    pub turned_deg: f64,
    /// Distance by which it is off, mm.
    pub shifted_mm: f64,
    /// Reason for which the view keeps its stated pose; `null` where it does not.
    pub kept_pose: Option<KeptPose>,
}

impl ViewAlignmentDocument {
    fn new(found: &ViewRegistration) -> Self {
        let correction = found.correction;
        Self {
            viewpoint: found.viewpoint,
            points: found.points,
            inlier_share: found.inlier_share,
            rms_mm: found.rms_mm,
            turned_deg: correction.fixed_rows::<3>(0).norm().to_degrees(),
            shifted_mm: correction.fixed_rows::<3>(3).norm(),
            kept_pose: found.kept_pose,
        }
    }
}

impl AlignmentDocument {
    /// Reason for which the alignment counts as not found, also of a document from before [`Self::not_found`] was introduced.
    #[must_use]
    pub fn why_not_found(&self) -> Option<PartNotFound> {
        why_not_found(self.inlier_share, self.views.iter().map(|view| view.kept_pose))
    }

    /// Words on points that are too few to hold the part in place.
    #[must_use]
    pub fn few_points_words(&self) -> String {
        let points: usize = self.views.iter().map(|view| view.points).sum();
        let needed = RegistrationOptions::default().min_points;
        format!("too few points: {points} in all; a view needs {needed} on the part")
    }

    /// Document of where the scans of an inspection lie; `centre_mm` is the middle of the part.
    #[must_use]
    pub fn new(method: Alignment, inspection: &Inspection, centre_mm: &nalgebra::Point3<f64>) -> Self {
        let registration = &inspection.registration;
        let pose = registration.mesh_from_stated;
        let sd = registration.sd;
        Self {
            method,
            mesh_from_stated: PoseSpec::from(&pose),
            table_from_part: inspection.table_from_part.as_ref().map(PoseSpec::from),
            part_turned_deg: pose.isometry().rotation.angle().to_degrees(),
            part_shifted_mm: (pose.point(centre_mm) - centre_mm).norm(),
            part_sd: RigidSdDocument {
                rotation_deg: sd.fixed_rows::<3>(0).max().to_degrees(),
                translation_mm: sd.fixed_rows::<3>(3).max(),
            },
            noise_mm: registration.noise_mm,
            not_found: registration.not_found(),
            inlier_share: registration.inlier_share,
            views: registration.found.iter().map(ViewAlignmentDocument::new).collect(),
        }
    }
}
