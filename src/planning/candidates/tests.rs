use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;

use nalgebra::{Point3, Vector3};

use super::*;
use crate::planning::context::Silent;
use crate::planning::params::{PartParams, RegionParams};
use crate::planning::resting;
use crate::planning::surface::sample;
use crate::testing::{box_mesh, nominal_scanner};

fn generated(extent_mm: [f64; 3], params: &CandidateParams) -> Generated {
    let mesh = box_mesh([0.0; 3], extent_mm);
    let longest_mm = extent_mm.into_iter().fold(0.0, f64::max);
    let (patch_edge_mm, samples_per_mm2) = (Some(0.15 * longest_mm), Some(6000.0 / mesh.area_mm2()));
    let part = PartParams { patch_edge_mm, samples_per_mm2, ..PartParams::default() };
    let surface = sample(&mesh, &part, &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"));
    let scanner = nominal_scanner();
    let scope = Scope { surface: &surface, scanner: &scanner, table_from_part: resting(&mesh) };
    let ctx_flag = AtomicBool::new(false);
    generate(&scope, params, &mesh, &Context::new(&ctx_flag, &Silent)).unwrap_or_else(|_| unreachable!())
}

fn poses(generated: &Generated) -> Vec<Pose<Part, ScannerFrame>> {
    generated.kept.iter().map(|candidate| candidate.part_from_scanner).collect()
}

#[test]
fn thirty_and_forty_five_degrees_give_54_distinct_candidates() {
    let generated = generated([100.0, 80.0, 60.0], &CandidateParams::default());
    assert_eq!((generated.generated, generated.kept.len()), (54, 54));
    let mut positions: Vec<_> = poses(&generated).iter().map(|pose| pose.origin_mm()).collect();
    positions.dedup_by(|a, b| (*a - *b).norm() < 1.0);
    assert_eq!(positions.len(), 54);
    let mut labels: BTreeMap<Label, usize> = BTreeMap::new();
    generated.kept.iter().for_each(|candidate| *labels.entry(candidate.label).or_default() += 1);
    // Top: zenith, 8 at 30°, 12 at 60°. Bottom: nadir, 8 at 150°. The 24 at 90° and 120° fall on four sectors.
    let expected =
        [(Label::Top, 21), (Label::Bottom, 9), (Label::Right, 6), (Label::Back, 6), (Label::Left, 6), (Label::Front, 6)];
    assert_eq!(labels, BTreeMap::from(expected));
}

#[test]
fn every_scanner_looks_at_the_centre_with_a_level_baseline() {
    let params = CandidateParams { standoff: Standoff::Centre, ..CandidateParams::default() };
    for pose in poses(&generated([100.0, 80.0, 60.0], &params)) {
        let aimed_at = pose.point(&Point3::new(0.0, 0.0, 480.0));
        assert!((aimed_at - Point3::new(50.0, 40.0, 30.0)).norm() < 1e-9);
        assert!(pose.direction(&Vector3::x()).z.abs() < 1e-12);
    }
}

#[test]
fn at_the_poles_the_baseline_lies_along_x() {
    for pose in &poses(&generated([100.0, 80.0, 60.0], &CandidateParams::default()))[..2] {
        assert!((pose.direction(&Vector3::x()) - Vector3::x()).norm() < 1e-12);
    }
}

#[test]
fn the_slide_puts_the_seen_surface_around_best_focus() {
    // From straight above only the top face is front-facing: it must end at exactly F.
    let pose = poses(&generated([100.0, 80.0, 60.0], &CandidateParams::default()))[0];
    assert!((pose.origin_mm() - Point3::new(50.0, 40.0, 60.0 + 480.0)).norm() < 0.2, "{pose:?}");
}

#[test]
fn rolls_turn_about_the_viewing_axis() {
    let params = CandidateParams { rolls_deg: vec![0.0, 90.0], standoff: Standoff::Centre, ..CandidateParams::default() };
    let generated = generated([100.0, 80.0, 60.0], &params);
    assert_eq!(generated.kept.len(), 108);
    for pair in poses(&generated).chunks(2) {
        assert!((pair[0].origin_mm() - pair[1].origin_mm()).norm() < 1e-9);
        assert!((pair[1].direction(&Vector3::x()) - pair[0].direction(&Vector3::y())).norm() < 1e-9);
    }
}

#[test]
fn a_long_part_is_split_into_the_fewest_equal_blocks() {
    // 300 mm needs three blocks of 140 mm; 140 mm exactly needs one.
    assert_eq!(generated([300.0, 140.0, 60.0], &CandidateParams::default()).generated, 3 * 54);
}

#[test]
fn a_block_without_surface_gives_no_candidates() {
    // A 450 mm cube is split 4 × 4 × 4; only the 56 outer blocks hold surface.
    assert_eq!(generated([450.0, 450.0, 450.0], &CandidateParams::default()).generated, 56 * 54);
}

#[test]
fn above_the_table_means_every_optical_centre() {
    let params = CandidateParams { hemisphere: Some(Hemisphere::AboveTable), ..CandidateParams::default() };
    let generated = generated([100.0, 80.0, 60.0], &params);
    assert!(generated.rejected.iter().all(|(_, reason)| *reason == Rejection::BelowTable));
    // θ = 120°, 150° and 180° lie below; at 90° the scanner stands at half the part's height, its baseline level.
    assert_eq!((generated.kept.len(), generated.rejected.len()), (33, 21));
}

#[test]
fn a_viewpoint_in_the_middle_of_a_large_shell_is_dropped() {
    // A 1.2 m box: the inward blocks' viewpoints at the far side lie inside it.
    let params = CandidateParams { standoff: Standoff::Centre, ..CandidateParams::default() };
    let generated = generated([1200.0, 1200.0, 1200.0], &params);
    assert!(generated.rejected.iter().any(|(_, reason)| *reason == Rejection::InsidePart));
    let inside = |candidate: &Candidate| {
        let p = candidate.part_from_scanner.origin_mm();
        (0..3).all(|axis| 1.0 < p[axis] && p[axis] < 1199.0)
    };
    assert!(!generated.kept.iter().any(inside));
}

#[test]
fn absurd_numbers_of_candidates_are_refused_before_they_are_made() {
    let refused = |extent_mm: [f64; 3], params: &CandidateParams| {
        let mesh = box_mesh([0.0; 3], extent_mm);
        let part = PartParams { patch_edge_mm: Some(extent_mm[0]), samples_per_mm2: Some(1e-4), ..PartParams::default() };
        let surface = sample(&mesh, &part, &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"));
        let scanner = nominal_scanner();
        let scope = Scope { surface: &surface, scanner: &scanner, table_from_part: resting(&mesh) };
        let flag = AtomicBool::new(false);
        match generate(&scope, params, &mesh, &Context::new(&flag, &Silent)) {
            Err(error) => error.to_string(),
            Ok(_) => "accepted".into(),
        }
    };
    let fine = CandidateParams { step_small_deg: 1.0, step_large_deg: 1.0, ..CandidateParams::default() };
    assert!(refused([100.0, 100.0, 100.0], &fine).contains("allowed are 50000 candidates"));
    assert!(refused([20_000.0, 20_000.0, 20_000.0], &CandidateParams::default()).contains("look at the part's unit"));
}
