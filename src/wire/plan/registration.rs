//! Registration of setups, and of views, by the surface that they share.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::Scanner;
use crate::planning::params::PlanParams;
use crate::planning::plan::{Plan, SetupId, Stability};
use crate::wire::words::freedom;

/// Stability of a registration by shared surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct StabilityDocument {
    /// Area that both measure.
    pub shared_area_mm2: f64,
    /// True if the shared surface constrains all six degrees of freedom.
    pub fixed: bool,
    /// Resistance to the weakest motion: the mean square displacement of the shared surface along its normals per unit of that
    /// motion, with rotations measured at the radius of the part. At 0.01 or more, all degrees of freedom count as constrained.
    pub resistance: f64,
    /// The weakest motion in words, with its axis in the part frame.
    pub weakest: String,
    /// Expected error of a registration along the weakest motion, mm (1 σ), from the noise of the scanner alone; `null` if the
    /// motion is not resisted at all.
    pub expected_error_mm: Option<f64>,
}

/// Registration of two setups to each other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct SetupLinkDocument {
    /// The setups, counted from 0.
    pub setups: [u32; 2],
    /// Stability of the registration.
    #[serde(flatten)]
    pub stability: StabilityDocument,
}

/// The weakest link between two views of a setup. Views of one setup share the table's frame, so this is for information only.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct ViewLinkDocument {
    /// The setup, counted from 0.
    pub setup: u32,
    /// Ids of the viewpoints.
    pub viewpoints: [u32; 2],
    /// Stability of the registration.
    #[serde(flatten)]
    pub stability: StabilityDocument,
}

impl StabilityDocument {
    /// The document, by the noise model of the job and the spacing of points at best focus.
    #[must_use]
    pub fn new(stability: &Stability, scanner: &Scanner, params: &PlanParams) -> Self {
        let focal_px = scanner.devices.cameras().into_iter().map(|camera| camera.lens.focal_px()).fold(f64::INFINITY, f64::min);
        let spacing_mm = scanner.best_mm / focal_px;
        Self {
            shared_area_mm2: stability.shared_area_mm2,
            fixed: stability.is_fixed(),
            resistance: stability.resistance,
            weakest: freedom(stability),
            expected_error_mm: stability.expected_error_mm(params.regions.noise.best_mm, spacing_mm),
        }
    }
}

/// Registration of every two setups.
pub(super) fn setup_links(plan: &Plan, scanner: &Scanner) -> Vec<SetupLinkDocument> {
    let link = |link: &crate::planning::plan::SetupLink| SetupLinkDocument {
        setups: link.setups.map(|setup| setup.0),
        stability: StabilityDocument::new(&link.stability, scanner, &plan.params),
    };
    plan.setup_links.iter().map(link).collect()
}

/// The weakest link of the views of each setup.
pub(super) fn view_links(plan: &Plan, scanner: &Scanner) -> Vec<ViewLinkDocument> {
    let link = |(setup, planned): (SetupId, &crate::planning::plan::SetupPlan)| {
        let (views, stability) = planned.weakest_link.as_ref()?;
        Some(ViewLinkDocument {
            setup: setup.0,
            viewpoints: views.map(|view| view.0),
            stability: StabilityDocument::new(stability, scanner, &plan.params),
        })
    };
    SetupId::number(&plan.setups).filter_map(link).collect()
}
