//! Check of a document, on request.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use utoipa::ToSchema;

use super::ids::MeshId;
use super::problem::ProblemField;
use super::warnings::FieldWarning;
use crate::cell::{CellSpec, Named, ScannerSpec, closed_list, field_ranges};

closed_list! {
    /// Kind of a document.
    pub enum DocumentKind {
        /// Specification of a scanner.
        Scanner = "scanner",
        /// Specification of a robot.
        Robot = "robot",
        /// Specification of a turntable.
        Turntable = "turntable",
        /// Specification of a cell.
        Cell = "cell",
        /// Parameters of a plan.
        Params = "params",
        /// Plan, `vantage.plan/1`.
        Plan = "plan",
        /// Program, `vantage.program/1`.
        Program = "program",
    }
}

/// A request to check a document. Unknown fields are refused, and so are fields that do not apply to the kind of the document.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CheckRequest {
    /// Specification, parameters, plan or program; its kind is recognised by its content.
    #[schema(value_type = Object)]
    pub document: Map<String, Value>,
    /// Cell in which plans and programs are checked: name of a stored one, a specification, or `"none"` for a plan that was made
    /// without a cell. Without one, only structure and ranges are checked. Incidence limits in parameters are compared with those
    /// of its scanner.
    #[serde(default)]
    pub cell: Option<Named<CellSpec>>,
    /// Scanner, used if `cell` is `"none"`: name of a stored one, or a specification. Default: the one that the plan names, for
    /// parameters `transcan-c`. A cell has its own.
    #[serde(default)]
    pub scanner: Option<Named<ScannerSpec>>,
    /// Plan that a program has to carry out, as `/jobs/{id}/plan` returns it.
    #[serde(default)]
    #[schema(value_type = Option<Object>)]
    pub plan: Option<Map<String, Value>>,
    /// Mesh of the part. A plan is compared with it and, in the cell, checked for collisions with it and for the coverage that it
    /// states. A program is checked for collisions and for the area that its scans measure; that takes its `plan`, which says
    /// where the part lies.
    #[serde(default)]
    pub mesh_id: Option<MeshId>,
    /// Fixture, in the part's coordinates, beside `mesh_id`: the one that the plan was made with. It is compared with `fixture`
    /// of the plan; for a plan of an earlier release, which has none, with the mesh that its `params.part.fixture_mesh` names, if
    /// this server has it.
    #[serde(default)]
    pub fixture_mesh_id: Option<MeshId>,
    /// Temperature in the cell now, °C, -50 to 100. For a program, a calibration that is valid only at other temperatures is a
    /// finding.
    #[serde(default)]
    pub temperature_c: Option<f64>,
}

field_ranges! {
    CheckRequest {
        TEMPERATURE_C = "temperature_c", [-50.0, 100.0] "°C";
    }
}

/// Statement of a document that a check did not verify.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct UnverifiedStatement {
    /// Statement: fields of the document, or what follows from them.
    pub statement: String,
    /// Reason for which it was not verified, or what to give so that it is.
    pub reason: String,
}

/// Result of a check.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CheckReport {
    /// Kind of the document; `null` if it is of no known kind.
    pub kind: Option<DocumentKind>,
    /// True if there are no findings.
    pub sound: bool,
    /// Description of a sound document.
    pub description: Option<String>,
    /// Share of the asked area that the views of a plan (with `cell` and `mesh_id`) or the scans of a program (with `plan` too)
    /// measure, 0 to 1.
    pub measured_of_asked: Option<f64>,
    /// Min and max length of the longest edge of a part's bounding box, mm, for the part to suit the scanner and the plate of the
    /// cell, or the scanner alone without one; `null` if no scanner is given.
    #[serde(default)]
    pub part_edge_mm: Option<[f64; 2]>,
    /// Findings, each with the pointer into the document; empty for the whole.
    pub findings: Vec<ProblemField>,
    /// Warnings on a sound document: parameters that cannot be reached, or a cell or a part that is probably not what was meant.
    #[serde(default)]
    pub warnings: Vec<FieldWarning>,
    /// Statements of a sound document that were verified: recomputed, or compared with the other inputs.
    #[serde(default)]
    pub verified: Vec<String>,
    /// Statements of a sound document that were not verified, or that nothing can verify.
    #[serde(default)]
    pub unverified: Vec<UnverifiedStatement>,
}
