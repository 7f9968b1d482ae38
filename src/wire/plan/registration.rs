//! Registration of setups, and of views, by the surface that they share.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::planning::plan::{Plan, SetupId, SetupLink, SetupPlan, Stability};
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
    /// Expected error of a registration along the weakest motion, mm (1 σ), from the noise at each shared sample's depth and
    /// incidence in the views that measure it. It is a lower bound: each pixel counts as an independent point, and errors of
    /// calibration and of hand-eye are not in it. `null` if the motion is not resisted at all or if its error cannot be
    /// computed.
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

impl From<&Stability> for StabilityDocument {
    fn from(stability: &Stability) -> Self {
        Self {
            shared_area_mm2: stability.shared_area_mm2,
            fixed: stability.is_fixed(),
            resistance: stability.resistance,
            weakest: freedom(stability),
            expected_error_mm: stability.expected_error_mm,
        }
    }
}

impl SetupLinkDocument {
    /// Registration of every two setups of a plan.
    pub(crate) fn all_of(plan: &Plan) -> Vec<Self> {
        let link = |link: &SetupLink| Self {
            setups: link.setups.map(|setup| setup.0),
            stability: StabilityDocument::from(&link.stability),
        };
        plan.setup_links.iter().map(link).collect()
    }
}

impl ViewLinkDocument {
    /// The weakest link of the views of each setup of a plan.
    pub(crate) fn all_of(plan: &Plan) -> Vec<Self> {
        let link = |(setup, planned): (SetupId, &SetupPlan)| {
            let (views, stability) = planned.weakest_link.as_ref()?;
            Some(Self { setup: setup.0, viewpoints: views.map(|view| view.0), stability: StabilityDocument::from(stability) })
        };
        SetupId::number(&plan.setups).filter_map(link).collect()
    }
}
