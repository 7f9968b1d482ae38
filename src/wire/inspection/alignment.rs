//! Documents of where the scans lie.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::PoseSpec;
use crate::geometry::counted;
use crate::inspection::Inspection;
use crate::inspection::deviation::Alignment;
use crate::inspection::registration::{KeptPose, PartNotFound, RegistrationOptions, ViewRegistration, why_not_found};

/// Registered poses of the scans, and how well they are known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AlignmentDocument {
    /// Alignment method.
    pub method: Alignment,
    /// Transform from part coordinates, as the stated poses give them, to mesh coordinates: how far the part is from its planned
    /// pose.
    pub mesh_from_stated: PoseSpec,
    /// Pose of the part on the table as its scans show it, for `POST /runs/{id}/located` and for a new plan; `null` without a
    /// cell, with several setups, and if the alignment was not found.
    #[serde(default)]
    pub table_from_part: Option<PoseSpec>,
    /// Angle by which the part is rotated from its planned pose, degrees.
    pub part_turned_deg: f64,
    /// Distance of the part's centre from its planned position, mm.
    pub part_shifted_mm: f64,
    /// Standard deviations of the part's pose, each the largest over all axes.
    pub part_sd: RigidSdDocument,
    /// Robust standard deviation of the points' distances from the part, mm.
    pub noise_mm: f64,
    /// Reason for which the alignment counts as not found, so that the pose of the part is unknown; `null` if it was found.
    #[serde(default)]
    pub not_found: Option<PartNotFound>,
    /// Share of all points that lie on the part. If its place was searched for, points of scans that fit nowhere and were left out count
    /// too.
    pub inlier_share: f64,
    /// Registered pose of each scan.
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
    /// Number of points matched.
    pub points: usize,
    /// Share of these points that lie on the part.
    pub inlier_share: f64,
    /// Root mean square of their distances from the part, mm.
    pub rms_mm: f64,
    /// Angle by which the view is rotated from its stated pose, beyond the part's own rotation, degrees.
    pub turned_deg: f64,
    /// Distance by which the view is off its stated pose, beyond the part's own shift, mm.
    pub shifted_mm: f64,
    /// Reason for which the view keeps its stated pose; `null` if it was corrected.
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
        self.not_found.or_else(|| why_not_found(self.inlier_share, self.views.iter().map(|view| view.kept_pose)))
    }

    /// Sentence on views whose poses may be off by more than is stated; `None` where all could be registered, or have too few points.
    #[must_use]
    pub fn unregistered_sentence(&self) -> Option<String> {
        let is_unregistered = |view: &&ViewAlignmentDocument| view.kept_pose.is_some_and(|kept| kept != KeptPose::FewPoints);
        let count = self.views.iter().filter(is_unregistered).count();
        let all = counted(self.views.len(), "view");
        (count > 0).then(|| {
            format!(
                "{count} of {all} could not be registered, and may be off by more than is stated: what they show of deviation and \
                 material is doubtful. Calibrate, or scan again."
            )
        })
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
