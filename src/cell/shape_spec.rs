//! Rigid bodies as they are written in specifications: obstacles of a cell, the envelopes of a scanner and a cable, the
//! surfaces of an arm.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::field_error::Findings;
use super::field_ranges;
use super::pose_spec::{PoseInput, PoseSpec};

/// A rigid body and where it is in its owner's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct BodySpec {
    /// Name used in reports of collisions.
    pub name: String,
    /// Pose of the body in the frame of what it belongs to (base for obstacles, scanner for its envelope).
    #[serde(default)]
    #[schema(value_type = PoseInput)]
    pub owner_from_body: PoseSpec,
    /// Shape of the body.
    pub shape: ShapeSpec,
}

/// A shape, centred on its own origin.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum ShapeSpec {
    /// Box with edges along the axes.
    Box {
        /// Edge lengths, mm, above 0.
        #[schema(min_items = 3, max_items = 3)]
        size_mm: [f64; 3],
    },
    /// Cylinder along z.
    Cylinder {
        /// Radius, mm, above 0.
        radius_mm: f64,
        /// Length along z, mm, above 0.
        height_mm: f64,
    },
    /// Capsule along z.
    Capsule {
        /// Radius, mm, above 0.
        radius_mm: f64,
        /// Distance between the centres of its two half balls, mm.
        length_mm: f64,
    },
    /// Mesh in millimetres, which has a file of its own.
    Mesh {
        /// Id of the mesh over HTTP; in a file the path of the mesh file, from the folder of that file.
        mesh: String,
    },
}

/// A rigid body that a link of the arm carries.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct LinkBodySpec {
    /// Frame that it moves with: 0 the foot, 1 to 6 the joints, 6 the flange.
    pub link: u8,
    /// Name used in reports of collisions.
    pub name: String,
    /// Pose of the body in the link's frame.
    #[serde(default)]
    #[schema(value_type = PoseInput)]
    pub owner_from_body: PoseSpec,
    /// Shape of the body.
    pub shape: ShapeSpec,
}

field_ranges! {
    ShapeSpec {
        SIZE_MM = "size_mm", [0.01, 1e5] "mm";
        RADIUS_MM = "radius_mm", [0.01, 1e5] "mm";
        HEIGHT_MM = "height_mm", [0.01, 1e5] "mm";
        LENGTH_MM = "length_mm", [0.01, 1e5] "mm";
    }
}

field_ranges! {
    LinkBodySpec {
        LINK = "link", [0.0, 6.0] "";
    }
}

impl LinkBodySpec {
    /// The body without its link.
    #[must_use]
    pub fn body(&self) -> BodySpec {
        BodySpec { name: self.name.clone(), owner_from_body: self.owner_from_body, shape: self.shape.clone() }
    }

    /// Records what is wrong with this body, below `pointer`.
    pub fn check(&self, pointer: &str, findings: &mut Findings) {
        Self::LINK.check(pointer, &self.link, findings);
        self.body().check(pointer, findings);
    }
}

impl BodySpec {
    /// Records what is wrong with this body, below `pointer`.
    pub fn check(&self, pointer: &str, findings: &mut Findings) {
        findings.require(!self.name.is_empty(), format!("{pointer}/name"), || "is empty; name the body".into());
        self.owner_from_body.check(&format!("{pointer}/owner_from_body"), findings);
        let at = format!("{pointer}/shape");
        match &self.shape {
            ShapeSpec::Box { size_mm } => ShapeSpec::SIZE_MM.check(&at, size_mm, findings),
            ShapeSpec::Cylinder { radius_mm, height_mm } => {
                ShapeSpec::RADIUS_MM.check(&at, radius_mm, findings);
                ShapeSpec::HEIGHT_MM.check(&at, height_mm, findings);
            }
            ShapeSpec::Capsule { radius_mm, length_mm } => {
                ShapeSpec::RADIUS_MM.check(&at, radius_mm, findings);
                ShapeSpec::LENGTH_MM.check(&at, length_mm, findings);
            }
            ShapeSpec::Mesh { mesh } => {
                findings.require(!mesh.is_empty(), format!("{at}/mesh"), || "is empty; name a mesh".into());
            }
        }
    }
}
