use std::sync::atomic::AtomicBool;

use serde_json::Value;

use super::*;
use crate::planning::context::{Context, Silent};
use crate::planning::params::{CandidateParams, Engine, PlanParams};
use crate::planning::{PlanInput, plan};
use crate::testing::{nominal_scanner, trough};

/// A field and the kind of its value.
type Field = (&'static str, fn(&Value) -> bool);

/// Every field that the benchmark's reader (`Log.py`) asks for or its readme lists.
const FIELDS: [Field; 24] = [
    ("/Log/Camera/DistanceMM", Value::is_f64),
    ("/Log/Camera/FocalLength", Value::is_f64),
    ("/Log/Camera/Model", Value::is_string),
    ("/Log/Camera/PixSizeMM", Value::is_f64),
    ("/Log/Camera/ResHeight", Value::is_u64),
    ("/Log/Camera/ResWidth", Value::is_u64),
    ("/Log/Coverage/InTriangles", Value::is_u64),
    ("/Log/Coverage/Percentage", Value::is_f64),
    ("/Log/CoveragePerVP/0", Value::is_f64),
    ("/Log/Duration/OptimizationSec", Value::is_f64),
    ("/Log/Duration/RayTracingSec", Value::is_f64),
    ("/Log/Model/FaceCount", Value::is_u64),
    ("/Log/Model/Name", Value::is_string),
    ("/Log/Model/VertexCount", Value::is_u64),
    ("/Log/OptimizationType", Value::is_string),
    ("/Log/TimeStamp", Value::is_string),
    ("/Log/TriangleCoveragePerVP/0", Value::is_u64),
    ("/Log/VPC/Count", Value::is_u64),
    ("/Log/VPC/DiscardedCount", Value::is_u64),
    ("/Log/VPC/Functional", Value::is_string),
    ("/Log/VPC/ListName", Value::is_string),
    ("/Log/VPC/Threshold", Value::is_string),
    ("/Log/VPSelectionOrder/0", Value::is_u64),
    ("/OVP/Count", Value::is_u64),
];

#[test]
fn the_log_has_the_benchmarks_fields_and_its_counts_add_up() {
    let (mesh, scanner) = (trough(), nominal_scanner());
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.01), Some(20.0));
    (params.visibility.engine, params.missed.remedies) = (Engine::Rays, 0);
    params.candidates.even_directions = Some(20);
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    let outcome = plan(&input, &params, &Context::new(&AtomicBool::new(false), &Silent)).expect("a plan");
    let seconds = BTreeMap::from([("visibility", 1.5), ("selection", 0.25)]);
    let log = OvpDocument::new(&outcome, &mesh, &scanner, "part.stl", "ab", &seconds, "2020-01-02T03:04:05Z".into());
    let json = serde_json::to_value(&log).expect("JSON");
    for (pointer, is_kind) in FIELDS {
        assert!(json.pointer(pointer).is_some_and(is_kind), "{pointer}: {:?}", json.pointer(pointer));
    }

    let (views, counts) = (outcome.plan.views.len(), &outcome.plan.candidates);
    let lengths = [log.log.coverage_per_vp.len(), log.log.triangle_coverage_per_vp.len(), log.log.vp_selection_order.len()];
    assert_eq!(lengths, [views; 3]);
    assert_eq!((log.ovp.count, log.ovp.list.len()), (views, views));
    assert_eq!(log.log.triangle_coverage_per_vp.iter().sum::<usize>(), log.log.coverage.in_triangles);
    assert!((log.log.coverage_per_vp.iter().sum::<f64>() - log.log.coverage.percentage).abs() < 1e-12);
    assert_eq!(log.log.vpc.count + log.log.vpc.discarded_count, counts.generated);
    // Two boxes stand on the third: four of 36 triangles are hidden.
    assert!((28..=32).contains(&log.log.coverage.in_triangles), "{:?}", log.log.coverage);
    // 6668 pixels of 1.85 µm.
    assert!((log.log.camera.focal_length - 12.336).abs() < 1e-3, "{:?}", log.log.camera);
    assert_eq!((log.log.duration.ray_tracing_sec, log.log.duration.optimization_sec), (1.5, 0.25));
    assert_eq!((log.log.vpc.functional.as_str(), log.log.optimization_type.as_str()), ("ellipsoid", "local"));
}
