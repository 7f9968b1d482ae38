//! `ovp.json`: a plan as a log of the public benchmark for optimal viewpoint placement (Gospodnetić, Mosbach, Rauhut,
//! Hagen 2020, *Flexible surface inspection planning pipeline*; repository gospodnetic/VOB, whose reader names the fields),
//! so that this planner can be compared with others. The names and their spelling are the benchmark's. The file holds times, so
//! it stands beside `timings.json` and is not covered by the plan's digest.
//!
//! The benchmark counts triangles. A triangle is covered once views measure half of its area, on the samples that views were
//! chosen on. `Percentage` and `CoveragePerVP` are fractions of all triangles, 0 to 1; each view counts what it adds to those
//! before it, so they add up. `VPC.Count` counts the candidates that could be chosen and `DiscardedCount` the others;
//! `VPSelectionOrder` numbers candidates in the order of generation. Beyond the benchmark's fields, `Vantage` has the plan's
//! own figures by area. Cost: samples × views.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::cell::{PoseSpec, Scanner};
use crate::geometry::Mesh;
use crate::planning::plan::{Outcome, Plan};
use crate::wire::words::changed_params;

#[cfg(test)]
mod tests;

/// Min measured share of a triangle's area for the triangle to count as covered.
const COVERED: f64 = 0.5;

/// The document, `ovp.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OvpDocument {
    /// Log of the run.
    #[serde(rename = "Log")]
    pub log: OvpLog,
    /// Viewpoints and their coverage.
    #[serde(rename = "OVP")]
    pub ovp: OptimalViewpoints,
}

/// Log of the run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct OvpLog {
    /// The left camera, at the scanner's best focus.
    pub camera: OvpCamera,
    /// Coverage by the viewpoints together.
    pub coverage: TriangleCoverage,
    /// Fraction of the triangles that each viewpoint adds.
    #[serde(rename = "CoveragePerVP")]
    pub coverage_per_vp: Vec<f64>,
    /// Duration of the run.
    pub duration: Duration,
    /// The part.
    pub model: Model,
    /// Name of the solver.
    pub optimization_type: String,
    /// Time of writing, RFC 3339, UTC.
    pub time_stamp: String,
    /// Triangles that each viewpoint adds.
    #[serde(rename = "TriangleCoveragePerVP")]
    pub triangle_coverage_per_vp: Vec<usize>,
    /// The candidates.
    #[serde(rename = "VPC")]
    pub vpc: Candidates,
    /// Number of the candidate behind each viewpoint.
    #[serde(rename = "VPSelectionOrder")]
    pub vp_selection_order: Vec<u32>,
    /// The plan's own figures, beyond the benchmark.
    pub vantage: OwnFigures,
}

/// The left camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct OvpCamera {
    /// Distance of best focus, mm.
    #[serde(rename = "DistanceMM")]
    pub distance_mm: f64,
    /// Focal length, mm; 0 if the size of a pixel is not known.
    pub focal_length: f64,
    /// Name of the scanner.
    pub model: String,
    /// Size of a pixel, mm; 0 if it is not known.
    #[serde(rename = "PixSizeMM")]
    pub pix_size_mm: f64,
    /// Image height, pixels.
    pub res_height: u32,
    /// Image width, pixels.
    pub res_width: u32,
}

/// Triangles covered.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct TriangleCoverage {
    /// Number of triangles.
    pub in_triangles: usize,
    /// Fraction of all triangles, 0 to 1.
    pub percentage: f64,
}

/// Duration of the run, by stage.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct Duration {
    /// Selection of views.
    pub optimization_sec: f64,
    /// Computation of visibility.
    pub ray_tracing_sec: f64,
}

/// The part.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct Model {
    /// Number of triangles.
    pub face_count: usize,
    /// Name of its file.
    pub name: String,
    /// Number of vertices.
    pub vertex_count: usize,
}

/// The candidates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct Candidates {
    /// Number of viewpoints that could be chosen.
    pub count: usize,
    /// Number of the other viewpoints that were generated.
    pub discarded_count: usize,
    /// Names of the strategies, joined by `+`.
    pub functional: String,
    /// Name of the list: the part's file and the strategies.
    pub list_name: String,
    /// Parameters of the candidates that are not at their defaults.
    pub threshold: String,
}

/// The plan's own figures, by area.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OwnFigures {
    /// SHA-256 of the bytes of `plan.json`.
    pub plan_sha256: String,
    /// Measured share of the asked area.
    pub of_asked: f64,
    /// Measured share of the coverable area.
    pub of_coverable: f64,
    /// Measured share of the whole surface.
    pub of_total: f64,
    /// Measured share of the whole surface, on the independent samples.
    pub of_total_independent: f64,
}

/// The viewpoints.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "PascalCase")]
pub struct OptimalViewpoints {
    /// Number of viewpoints.
    pub count: usize,
    /// The viewpoints, in the order chosen.
    pub list: Vec<Viewpoint>,
}

/// A viewpoint; the benchmark leaves its shape open.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Viewpoint {
    /// Number in the order chosen.
    pub id: u32,
    /// Pose of the scanner in the part frame.
    pub part_from_scanner: PoseSpec,
}

impl OvpDocument {
    /// Builds the log of an outcome. `plan_sha256` is the hash of the plan's file; `seconds` holds the time of each stage by
    /// name; `written_at` is a time as text.
    #[must_use]
    pub fn new(
        outcome: &Outcome,
        mesh: &Mesh,
        scanner: &Scanner,
        part_name: &str,
        plan_sha256: &str,
        seconds: &BTreeMap<&str, f64>,
        written_at: String,
    ) -> Self {
        let plan = &outcome.plan;
        let added = triangles_added(outcome, mesh);
        let of_all = |triangles: usize| triangles as f64 / mesh.faces.len() as f64;
        let in_triangles = added.iter().sum();
        let stage_secs = |stage: &str| seconds.get(stage).copied().unwrap_or_default();
        let view = |view: &crate::planning::plan::PlannedView| Viewpoint {
            id: view.id.0,
            part_from_scanner: PoseSpec::from(&view.part_from_scanner),
        };
        let log = OvpLog {
            camera: camera(scanner),
            coverage: TriangleCoverage { in_triangles, percentage: of_all(in_triangles) },
            coverage_per_vp: added.iter().map(|triangles| of_all(*triangles)).collect(),
            duration: Duration { optimization_sec: stage_secs("selection"), ray_tracing_sec: stage_secs("visibility") },
            model: Model { face_count: mesh.faces.len(), name: part_name.to_owned(), vertex_count: mesh.vertices_mm.len() },
            optimization_type: name(&plan.params.selection.solver),
            time_stamp: written_at,
            triangle_coverage_per_vp: added,
            vpc: candidates(plan, part_name),
            vp_selection_order: plan.views.iter().map(|view| view.candidate.0).collect(),
            vantage: OwnFigures {
                plan_sha256: plan_sha256.to_owned(),
                of_asked: plan.coverage.of_asked(),
                of_coverable: plan.coverage.of_coverable(),
                of_total: plan.coverage.of_total(),
                of_total_independent: plan.coverage.independent.of_total(),
            },
        };
        Self { log, ovp: OptimalViewpoints { count: plan.views.len(), list: plan.views.iter().map(view).collect() } }
    }
}

fn camera(scanner: &Scanner) -> OvpCamera {
    let device = &scanner.devices.left;
    let pix_size_mm = device.pixel_pitch_mm.unwrap_or_default();
    OvpCamera {
        distance_mm: scanner.best_mm,
        focal_length: device.lens.fx * pix_size_mm,
        model: scanner.name.clone(),
        pix_size_mm,
        res_height: device.lens.height_px as u32,
        res_width: device.lens.width_px as u32,
    }
}

fn candidates(plan: &Plan, part_name: &str) -> Candidates {
    let strategies: Vec<&str> = plan.params.candidates.strategies.iter().map(|strategy| strategy.as_str()).collect();
    let functional = strategies.join("+");
    let changed = changed_params(&plan.params);
    let changed = changed.iter().filter_map(|(key, value)| Some(format!("{}={value}", key.strip_prefix("candidates.")?)));
    Candidates {
        count: plan.candidates.kept,
        discarded_count: plan.candidates.generated - plan.candidates.kept,
        list_name: format!("{part_name} {functional}"),
        functional,
        threshold: changed.collect::<Vec<_>>().join(" "),
    }
}

/// Name of a value of an enumeration in files.
fn name(value: &impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default()
}

/// Number of triangles that each view covers and those before it do not.
fn triangles_added(outcome: &Outcome, mesh: &Mesh) -> Vec<usize> {
    let surface = &outcome.surface;
    let mut open = vec![true; surface.sample_mm.len()];
    let mut measured_mm2 = vec![0.0; mesh.faces.len()];
    let mut covered = vec![false; mesh.faces.len()];
    let mut added = Vec::with_capacity(outcome.measured_by_view.len());
    for row in &outcome.measured_by_view {
        let mut count = 0;
        for sample in row.samples() {
            if !std::mem::take(&mut open[sample.index()]) {
                continue;
            }
            let face = surface.patch_of(sample).face as usize;
            measured_mm2[face] += surface.sample_area_mm2(sample);
            if !covered[face] && measured_mm2[face] >= COVERED * mesh.face_area_mm2(face) {
                covered[face] = true;
                count += 1;
            }
        }
        added.push(count);
    }
    added
}
