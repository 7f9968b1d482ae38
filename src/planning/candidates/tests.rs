use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::*;
use crate::cell::{Presets, SpecLibrary};
use crate::planning::context::Silent;
use crate::planning::params::{Hemisphere, PartParams, PlanParams, RegionParams, ScoreParams, Standoff};
use crate::planning::resting;
use crate::planning::surface::sample;
use crate::testing::{box_mesh, nominal_scanner};

fn generated(extent_mm: [f64; 3], params: &CandidateParams) -> CandidateSet {
    generated_by(extent_mm, params, 0, None).unwrap_or_else(|error| panic!("{error}"))
}

fn generated_by(
    extent_mm: [f64; 3],
    params: &CandidateParams,
    seed: u64,
    cell: Option<&Cell>,
) -> Result<CandidateSet, PlanError> {
    let mesh = box_mesh([0.0; 3], extent_mm);
    let longest_mm = extent_mm.into_iter().fold(0.0, f64::max);
    let (patch_edge_mm, samples_per_mm2) = (Some(0.15 * longest_mm), Some(6000.0 / mesh.area_mm2()));
    let part = PartParams { patch_edge_mm, samples_per_mm2, ..PartParams::default() };
    let surface = sample(&mesh, &part, &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"));
    let (scanner, flag) = (nominal_scanner(), AtomicBool::new(false));
    let sight = Sight::of(&mesh, &surface, &scanner);
    let scope = Scope { seed, cell, ..scope(&mesh, &surface, &scanner, &sight) };
    generate(&scope, params, &Context::new(&flag, &Silent))
}

fn only(strategy: Strategy) -> CandidateParams {
    CandidateParams { strategies: vec![strategy], rolls_deg: vec![0.0], ..CandidateParams::default() }
}

/// The surface point that a viewpoint looks at, at F ahead; part frame.
fn aimed_at(pose: &Pose<Part, ScannerFrame>) -> Point3<f64> {
    pose.point(&Point3::new(0.0, 0.0, 480.0))
}

/// Distance from a point to the box from the origin to `extent_mm`.
fn distance_mm(p: &Point3<f64>, extent_mm: [f64; 3]) -> f64 {
    Vector3::from([0, 1, 2].map(|axis| (p[axis] - p[axis].clamp(0.0, extent_mm[axis])).abs())).norm()
}

/// Inputs of a slide.
struct Sight {
    occluders: Occluders,
    optics: Optics,
    score: ScoreParams,
}

impl Sight {
    fn of(mesh: &Mesh, surface: &Surface, scanner: &Scanner) -> Self {
        let params = PlanParams::default();
        let optics = Optics::new(scanner, &params, &surface.requirements);
        Self { occluders: Occluders::new([mesh]), optics, score: params.score }
    }
}

fn scope<'a>(mesh: &'a Mesh, surface: &'a Surface, scanner: &'a Scanner, sight: &'a Sight) -> Scope<'a> {
    let Sight { occluders, optics, score } = sight;
    Scope { part: mesh, surface, scanner, cell: None, table_from_part: resting(mesh), occluders, optics, score, seed: 0 }
}

fn poses(generated: &CandidateSet) -> Vec<Pose<Part, ScannerFrame>> {
    generated.remaining.iter().map(|candidate| candidate.part_from_scanner).collect()
}

#[test]
fn thirty_and_forty_five_degrees_give_54_distinct_candidates() {
    let generated = generated([100.0, 80.0, 60.0], &CandidateParams::ellipsoid());
    assert_eq!((generated.generated, generated.remaining.len()), (54, 54));
    let mut positions: Vec<_> = poses(&generated).iter().map(|pose| pose.origin_mm()).collect();
    positions.dedup_by(|a, b| (*a - *b).norm() < 1.0);
    assert_eq!(positions.len(), 54);
    let mut labels: BTreeMap<Label, usize> = BTreeMap::new();
    generated.remaining.iter().for_each(|candidate| *labels.entry(candidate.label).or_default() += 1);
    // Top: zenith, 8 at 30°, 12 at 60°. Bottom: nadir, 8 at 150°. The 24 at 90° and 120° fall on four sectors.
    let expected =
        [(Label::Top, 21), (Label::Bottom, 9), (Label::Right, 6), (Label::Back, 6), (Label::Left, 6), (Label::Front, 6)];
    assert_eq!(labels, BTreeMap::from(expected));
}

#[test]
fn every_scanner_looks_at_the_centre_with_a_level_baseline() {
    let params = CandidateParams { standoff: Standoff::Centre, ..CandidateParams::ellipsoid() };
    for pose in poses(&generated([100.0, 80.0, 60.0], &params)) {
        let aimed_at = pose.point(&Point3::new(0.0, 0.0, 480.0));
        assert!((aimed_at - Point3::new(50.0, 40.0, 30.0)).norm() < 1e-9);
        assert!(pose.direction(&Vector3::x()).z.abs() < 1e-12);
    }
}

#[test]
fn at_the_poles_the_baseline_lies_along_x() {
    for pose in &poses(&generated([100.0, 80.0, 60.0], &CandidateParams::ellipsoid()))[..2] {
        assert!((pose.direction(&Vector3::x()) - Vector3::x()).norm() < 1e-12);
    }
}

#[test]
fn the_slide_puts_the_seen_surface_at_best_focus() {
    // From straight above only the top face is seen: it must end at F.
    for standoff in [Standoff::Surface, Standoff::FirstSurface] {
        let params = CandidateParams { standoff, ..CandidateParams::ellipsoid() };
        let pose = poses(&generated([100.0, 80.0, 60.0], &params))[0];
        assert!((pose.origin_mm() - Point3::new(50.0, 40.0, 60.0 + 480.0)).norm() < 0.2, "{pose:?}");
    }
}

#[test]
fn the_slide_ends_where_all_devices_are_in_focus() {
    // Two blocks with a gap on the axis from above: the slide begins with their tops 450 mm away, out of the projector's 4 mm.
    let mesh = Mesh::joined(&[box_mesh([0.0; 3], [45.0, 80.0, 60.0]), box_mesh([55.0, 0.0, 0.0], [100.0, 80.0, 60.0])]);
    let part = PartParams { patch_edge_mm: Some(8.0), samples_per_mm2: Some(0.05), ..PartParams::default() };
    let surface = sample(&mesh, &part, &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"));
    let mut spec = Presets.scanner("transcan-c-nominal").expect("a preset");
    spec.projector.in_focus_mm = Some([478.0, 482.0]);
    let (scanner, flag) = (spec.build().expect("valid"), AtomicBool::new(false));
    let sight = Sight::of(&mesh, &surface, &scanner);
    let scope = scope(&mesh, &surface, &scanner, &sight);
    let generated = generate(&scope, &CandidateParams::ellipsoid(), &Context::new(&flag, &Silent));
    let zenith = poses(&generated.unwrap_or_else(|error| panic!("{error}")))[0];
    let depth_mm = zenith.origin_mm().z - 60.0;
    assert!((478.0..=482.0).contains(&depth_mm), "the tops are {depth_mm} mm away");
}

/// A blade along y, with its back at 300 mm and its edge at 500 mm: seen from the right its sides are steeper than any device looks.
fn blade() -> Mesh {
    let back = [[300.0, 59.0, 57.5], [300.0, 59.0, 63.5], [300.0, 61.0, 57.5], [300.0, 61.0, 63.5]];
    let edge = [[500.0, 59.0, 60.5], [500.0, 61.0, 60.5]];
    let faces = vec![[1, 5, 3], [1, 4, 5], [0, 2, 5], [0, 5, 4], [0, 4, 1], [2, 3, 5], [0, 1, 3], [0, 3, 2]];
    let vertices_mm = back.into_iter().chain(edge).map(Point3::from).collect();
    Mesh { source_face: (0..faces.len() as u32).collect(), faces, vertices_mm, groups: Vec::new() }
}

/// A wall hides the first block from the right. On the axis there, a blade on the wall stands out so far that the wall is out of depth where
/// the blade is at F: the view measured nothing.
#[test]
fn a_view_that_measures_nothing_where_its_axis_ends_slides_by_what_it_sees() {
    let wall = Mesh::joined(&[box_mesh([298.0, 0.0, 0.0], [300.0, 120.0, 120.0]), blade()]);
    let mesh = Mesh::joined(&[wall, box_mesh([0.0; 3], [100.0, 120.0, 120.0])]);
    let part = PartParams { patch_edge_mm: Some(8.0), samples_per_mm2: Some(0.05), ..PartParams::default() };
    let surface = sample(&mesh, &part, &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"));
    let (scanner, flag) = (nominal_scanner(), AtomicBool::new(false));
    let sight = Sight::of(&mesh, &surface, &scanner);
    let scope = scope(&mesh, &surface, &scanner, &sight);
    let generated = generate(&scope, &CandidateParams::ellipsoid(), &Context::new(&flag, &Silent));
    let all = poses(&generated.unwrap_or_else(|error| panic!("{error}")));
    let from_right = all.iter().filter(|pose| (pose.direction(&Vector3::z()) + Vector3::x()).norm() < 1e-6);
    let depths_mm: Vec<f64> = from_right.map(|pose| pose.origin_mm().x - 480.0).collect();
    let at = |x_mm: f64| depths_mm.iter().filter(|at_mm| (**at_mm - x_mm).abs() < 3.0).count();
    assert!(depths_mm.len() >= 2 && at(300.0) == depths_mm.len(), "{depths_mm:?}");
}

#[test]
fn the_slide_weighs_the_visible_surface_of_the_block_and_not_what_is_hidden() {
    // A low plate below a small table: from above, the table's top is on the axis, but most of what is seen is the plate 50 mm
    // below. The underside of the table and what it hides of the plate must not count.
    let mesh = Mesh::joined(&[box_mesh([0.0; 3], [120.0, 120.0, 2.0]), box_mesh([45.0, 45.0, 51.0], [75.0, 75.0, 52.0])]);
    let part = PartParams { patch_edge_mm: Some(4.0), samples_per_mm2: Some(0.05), ..PartParams::default() };
    let surface = sample(&mesh, &part, &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"));
    let (scanner, flag) = (nominal_scanner(), AtomicBool::new(false));
    let sight = Sight::of(&mesh, &surface, &scanner);
    let scope = scope(&mesh, &surface, &scanner, &sight);
    let zenith_mm = |standoff| {
        let params = CandidateParams { standoff, ..CandidateParams::ellipsoid() };
        let generated = generate(&scope, &params, &Context::new(&flag, &Silent)).unwrap_or_else(|error| panic!("{error}"));
        poses(&generated)[0].origin_mm().z
    };
    assert!((zenith_mm(Standoff::FirstSurface) - (52.0 + 480.0)).abs() < 0.1);
    assert!((zenith_mm(Standoff::Surface) - (2.0 + 480.0)).abs() < 2.0, "{}", zenith_mm(Standoff::Surface));
}

#[test]
fn rolls_turn_about_the_viewing_axis() {
    let params = CandidateParams { rolls_deg: vec![0.0, 90.0], standoff: Standoff::Centre, ..CandidateParams::ellipsoid() };
    let generated = generated([100.0, 80.0, 60.0], &params);
    assert_eq!(generated.remaining.len(), 108);
    for pair in poses(&generated).chunks(2) {
        assert!((pair[0].origin_mm() - pair[1].origin_mm()).norm() < 1e-9);
        assert!((pair[1].direction(&Vector3::x()) - pair[0].direction(&Vector3::y())).norm() < 1e-9);
    }
}

#[test]
fn a_long_part_is_split_into_the_fewest_equal_blocks() {
    // 300 mm needs three blocks of 140 mm; 140 mm exactly needs one.
    assert_eq!(generated([300.0, 140.0, 60.0], &CandidateParams::ellipsoid()).generated, 3 * 54);
}

#[test]
fn a_block_without_surface_gives_no_candidates() {
    // A 450 mm cube is split 4 × 4 × 4; only the 56 outer blocks hold surface.
    assert_eq!(generated([450.0, 450.0, 450.0], &CandidateParams::ellipsoid()).generated, 56 * 54);
}

#[test]
fn above_the_table_means_every_optical_centre() {
    let params = CandidateParams { hemisphere: Some(Hemisphere::AboveTable), ..CandidateParams::ellipsoid() };
    let generated = generated([100.0, 80.0, 60.0], &params);
    assert!(generated.rejected.iter().all(|(_, reason)| *reason == Rejection::BelowTable));
    // θ = 120°, 150° and 180° lie below; at 90° the scanner stands at half the part's height, its baseline level.
    assert_eq!((generated.remaining.len(), generated.rejected.len()), (33, 21));
}

#[test]
fn viewpoints_hardly_above_the_plate_are_dropped() {
    // The 12 views at 90° around a thin plate stand 1 mm above the table's plane, half a metre away.
    let dropped = |min_elevation_deg: f64| {
        let hemisphere = Some(Hemisphere::AboveTable);
        let params = CandidateParams { hemisphere, min_elevation_deg, ..CandidateParams::ellipsoid() };
        let generated = generated([100.0, 80.0, 2.0], &params);
        let low = generated.rejected.iter().filter(|(_, reason)| *reason == Rejection::LowElevation).count();
        (generated.remaining.len(), low)
    };
    assert_eq!(dropped(0.0), (33, 0));
    assert_eq!(dropped(CandidateParams::default().min_elevation_deg), (21, 12));
    // Zenith, 8 views at 30° and 12 at 60° from it are left; the last stand at about 28° over the plate.
    assert_eq!(dropped(45.0), (9, 24));
    let everywhere = CandidateParams { min_elevation_deg: 45.0, ..CandidateParams::ellipsoid() };
    assert_eq!(generated([100.0, 80.0, 2.0], &everywhere).remaining.len(), 54, "without a plate there is no elevation");
}

#[test]
fn a_viewpoint_in_the_middle_of_a_large_shell_is_dropped() {
    // A 1.2 m box: the inward blocks' viewpoints at the far side lie inside it.
    let params = CandidateParams { standoff: Standoff::Centre, ..CandidateParams::ellipsoid() };
    let generated = generated([1200.0, 1200.0, 1200.0], &params);
    assert!(generated.rejected.iter().any(|(_, reason)| *reason == Rejection::InsidePart));
    let inside = |candidate: &Candidate| {
        let p = candidate.part_from_scanner.origin_mm();
        (0..3).all(|axis| 1.0 < p[axis] && p[axis] < 1199.0)
    };
    assert!(!generated.remaining.iter().any(inside));
}

#[test]
fn absurd_numbers_of_candidates_are_refused_before_they_are_made() {
    let refused = |extent_mm: [f64; 3], params: &CandidateParams| {
        let mesh = box_mesh([0.0; 3], extent_mm);
        let part = PartParams { patch_edge_mm: Some(extent_mm[0]), samples_per_mm2: Some(1e-4), ..PartParams::default() };
        let surface = sample(&mesh, &part, &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"));
        let scanner = nominal_scanner();
        let sight = Sight::of(&mesh, &surface, &scanner);
        let scope = scope(&mesh, &surface, &scanner, &sight);
        let flag = AtomicBool::new(false);
        match generate(&scope, params, &Context::new(&flag, &Silent)) {
            Err(error) => error.to_string(),
            Ok(_) => "accepted".into(),
        }
    };
    let fine = CandidateParams { step_small_deg: 1.0, step_large_deg: 1.0, ..CandidateParams::ellipsoid() };
    assert!(refused([100.0, 100.0, 100.0], &fine).contains("allowed are 50000 candidates"));
    assert!(refused([20_000.0, 20_000.0, 20_000.0], &CandidateParams::ellipsoid()).contains("look at the part's unit"));
}

#[test]
fn even_directions_are_spread_evenly() {
    let directions: Vec<_> = even::spiral(150, -1.0).collect();
    assert!(directions.iter().all(|u| (u.norm() - 1.0).abs() < 1e-12));
    assert!(directions.iter().sum::<Vector3<f64>>().norm() < 0.5);
    let nearest = |u: &Vector3<f64>| directions.iter().map(|v| (u - v).norm()).filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
    let nearest: Vec<_> = directions.iter().map(nearest).collect();
    // A triangular grid of 150 equal cells on the unit sphere has its neighbours 0.311 apart.
    assert!(nearest.iter().all(|d| (0.2..0.33).contains(d)), "{nearest:?}");
}

#[test]
fn even_directions_above_the_table_are_all_above_it_and_as_many() {
    let params = CandidateParams { hemisphere: Some(Hemisphere::AboveTable), ..only(Strategy::Even) };
    let generated = generated([100.0, 80.0, 60.0], &params);
    assert_eq!(generated.generated, 150);
    assert!(generated.remaining.len() > 140, "{} remain", generated.remaining.len());
    let lowest = even::spiral(150, -0.1).map(|u| u.z).fold(f64::INFINITY, f64::min);
    assert!((-0.1..-0.09).contains(&lowest));
}

#[test]
fn blocks_share_even_directions_but_none_has_few() {
    assert_eq!(generated([300.0, 140.0, 60.0], &only(Strategy::Even)).generated, 3 * 87);
    assert_eq!([1, 4, 31, 400].map(|blocks| even::directions_a_block(150, blocks)), [150, 75, 27, 27]);
    assert_eq!(even::directions_a_block(12, 9), 12);
}

#[test]
fn even_directions_are_fewer_by_default_where_the_table_has_no_room() {
    let (mesh, scanner) = (box_mesh([0.0; 3], [100.0, 80.0, 60.0]), nominal_scanner());
    let part = PartParams { samples_per_mm2: Some(100.0), ..PartParams::default() };
    let surface = sample(&mesh, &part, &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"));
    let resolved = |params: &CandidateParams| resolve(&surface, &resting(&mesh), &scanner, params).even_directions;
    // 3.76 million samples leave room for 265 views, half of it for these, in two rolls.
    let room = 1_000_000_000 / surface.sample_mm.len() / 4;
    assert_eq!(resolved(&CandidateParams::default()), Some(room as u32));
    assert!((60..70).contains(&room));
    assert_eq!(resolved(&CandidateParams { even_directions: Some(7), ..CandidateParams::default() }), Some(7));
}

#[test]
fn facet_normals_look_at_the_largest_facets_from_f() {
    let extent_mm = [100.0, 80.0, 60.0];
    let all = generated(extent_mm, &only(Strategy::FacetNormal));
    assert_eq!(all.remaining.len(), 12, "the two triangles of a side lie farther apart than the spacing");
    for pose in poses(&all) {
        assert!(distance_mm(&aimed_at(&pose), extent_mm) < 1e-9);
        let axis = pose.direction(&Vector3::z());
        assert!((axis.abs().max() - 1.0).abs() < 1e-12, "along a normal: {axis}");
    }
    let params = CandidateParams { spacing_mm: Some(90.0), ..only(Strategy::FacetNormal) };
    assert_eq!(generated(extent_mm, &params).remaining.len(), 6, "one a side");
    let params = CandidateParams { facet_normals: 4, spacing_mm: Some(10.0), ..only(Strategy::FacetNormal) };
    let largest = generated(extent_mm, &params);
    assert!(poses(&largest).iter().all(|pose| pose.direction(&Vector3::z()).z.abs() > 0.99), "top and bottom are largest");
}

#[test]
fn surface_points_keep_their_spacing() {
    let params = CandidateParams { spacing_mm: Some(25.0), surface_points: 1000, ..only(Strategy::SurfacePoints) };
    let poses = poses(&generated([100.0, 80.0, 60.0], &params));
    assert!(poses.len() > 40, "{} points", poses.len());
    for (number, a) in poses.iter().enumerate() {
        for b in &poses[..number] {
            let alike = a.direction(&Vector3::z()).dot(&b.direction(&Vector3::z())) > 0.97;
            assert!(!alike || (aimed_at(a) - aimed_at(b)).norm() >= 25.0 - 1e-9);
        }
    }
    let few = CandidateParams { surface_points: 7, ..params };
    assert_eq!(generated([100.0, 80.0, 60.0], &few).remaining.len(), 7);
}

#[test]
fn random_viewpoints_have_the_surface_in_depth_and_are_drawn_to_it() {
    let extent_mm = [100.0, 80.0, 60.0];
    let generated = generated(extent_mm, &only(Strategy::Volume));
    assert_eq!(generated.generated, 200);
    for pose in poses(&generated) {
        let (origin, axis) = (pose.origin_mm(), pose.direction(&Vector3::z()));
        let nearest_mm = distance_mm(&origin, extent_mm);
        // The nearest sample is up to a few millimetres farther than the surface.
        assert!((405.0..=565.0).contains(&nearest_mm), "{nearest_mm} mm");
        let to_centre = Point3::new(50.0, 40.0, 30.0) - origin;
        assert!(axis.angle(&to_centre).to_degrees() < 8.0);
    }
}

#[test]
fn a_seed_gives_the_same_draws_and_another_seed_others() {
    let drawn = |strategy, seed| {
        let generated = generated_by([100.0, 80.0, 60.0], &only(strategy), seed, None);
        poses(&generated.unwrap_or_else(|error| panic!("{error}"))).iter().map(|pose| pose.origin_mm()).collect::<Vec<_>>()
    };
    for strategy in [Strategy::Volume, Strategy::SurfacePoints] {
        assert_eq!(drawn(strategy, 1), drawn(strategy, 1));
        assert_ne!(drawn(strategy, 1), drawn(strategy, 2));
    }
}

#[test]
fn reach_needs_a_cell_and_keeps_what_the_arm_takes() {
    let params = only(Strategy::Reach);
    let refused = generated_by([100.0, 80.0, 60.0], &params, 0, None).map(|_| ()).map_err(|error| error.to_string());
    assert_eq!(refused.map_err(|error| error.contains("plan with a cell")), Err(true));
    let cell = Presets.cell("e05-transcan").ok().and_then(|spec| spec.build(&Presets).ok()).unwrap_or_else(|| unreachable!());
    let taken = generated_by([100.0, 80.0, 60.0], &params, 0, Some(&cell)).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(taken.generated, 100);
    let centre = Point3::new(50.0, 40.0, 0.0);
    assert!(poses(&taken).iter().all(|pose| (pose.origin_mm() - centre).z > 0.0), "a hemisphere");
    // An arm three metres away takes nothing.
    let far = nalgebra::Vector3::new(3000.0, 0.0, 0.0);
    let beyond = Cell { base_from_table: Pose::from_parts(far, UnitQuaternion::identity()), ..cell };
    let none = generated_by([100.0, 80.0, 60.0], &params, 0, Some(&beyond)).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(none.generated, 0);
}

#[test]
fn re_sampling_stays_around_the_best_and_closes_in() {
    let (mesh, scanner, flag) = (box_mesh([0.0; 3], [100.0, 80.0, 60.0]), nominal_scanner(), AtomicBool::new(false));
    let surface =
        sample(&mesh, &PartParams::default(), &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"));
    let sight = Sight::of(&mesh, &surface, &scanner);
    let (scope, ctx) = (scope(&mesh, &surface, &scanner, &sight), Context::new(&flag, &Silent));
    let params = CandidateParams { standoff: Standoff::Centre, ..only(Strategy::Iterative) };
    let best =
        poses(&generated([100.0, 80.0, 60.0], &CandidateParams { standoff: Standoff::Centre, ..CandidateParams::ellipsoid() }));
    let widest_turn_deg = |round: u32| {
        let around = around_best(&scope, &params, &best[..2], round, &ctx).unwrap_or_else(|_| unreachable!());
        assert_eq!(around.generated, 50);
        let turns = poses(&around).into_iter().enumerate().map(|(number, pose)| {
            let of = &best[number % 2];
            assert!((aimed_at(&pose) - aimed_at(of)).norm() <= 35.0 * 2.0_f64.sqrt());
            pose.direction(&Vector3::z()).angle(&of.direction(&Vector3::z())).to_degrees()
        });
        turns.fold(0.0, f64::max)
    };
    let (first, third) = (widest_turn_deg(0), widest_turn_deg(2));
    assert!((20.0..=30.0 + 1e-9).contains(&first) && (7.0..=10.8 + 1e-9).contains(&third), "{first}°, {third}°");
    let none_yet = around_best(&scope, &params, &[], 0, &ctx).unwrap_or_else(|_| unreachable!());
    assert_eq!(none_yet.generated, 50);
}

#[test]
fn tilts_turn_about_the_aim_point_and_level_the_scanner() {
    let params = CandidateParams { tilts_deg: vec![20.0], standoff: Standoff::Centre, ..CandidateParams::ellipsoid() };
    let poses = poses(&generated([100.0, 80.0, 60.0], &params));
    assert_eq!(poses.len(), 54 * 5);
    // Beyond the poles, where level has no meaning.
    for five in poses.chunks(5).skip(2) {
        for tilted in &five[1..] {
            assert!((aimed_at(tilted) - aimed_at(&five[0])).norm() < 1e-9);
            let turned = tilted.direction(&Vector3::z()).angle(&five[0].direction(&Vector3::z()));
            assert!((turned.to_degrees() - 20.0).abs() < 1e-9);
            assert!(tilted.direction(&Vector3::x()).z.abs() < 1e-9);
        }
    }
}

#[test]
fn stand_offs_move_back_along_the_axis() {
    let params = CandidateParams { standoffs_mm: vec![0.0, 30.0], ..CandidateParams::ellipsoid() };
    for pair in poses(&generated([100.0, 80.0, 60.0], &params)).chunks(2) {
        let back = pair[1].origin_mm() - pair[0].origin_mm();
        assert!((back + pair[0].direction(&Vector3::z()) * 30.0).norm() < 1e-9);
    }
}

#[test]
fn a_pose_that_is_there_twice_is_dropped() {
    let params = CandidateParams { rolls_deg: vec![0.0, 360.0, 90.0], ..CandidateParams::ellipsoid() };
    let generated = generated([100.0, 80.0, 60.0], &params);
    assert_eq!((generated.generated, generated.remaining.len()), (3 * 54, 2 * 54));
    assert!(generated.rejected.iter().all(|(candidate, reason)| candidate.id.0 % 3 == 1 && *reason == Rejection::Duplicate));
}

#[test]
fn strategies_mix_in_the_order_named() {
    let mixed = CandidateParams { strategies: vec![Strategy::FacetNormal, Strategy::Ellipsoid], ..CandidateParams::ellipsoid() };
    let (mixed, normals) = (generated([100.0, 80.0, 60.0], &mixed), generated([100.0, 80.0, 60.0], &only(Strategy::FacetNormal)));
    assert_eq!(mixed.generated, 12 + 54);
    assert_eq!(poses(&mixed)[0].origin_mm(), poses(&normals)[0].origin_mm());
}

#[test]
fn ranges_are_refused_with_their_field() {
    let refused = |change: fn(&mut CandidateParams)| {
        let mut params = PlanParams::default();
        change(&mut params.candidates);
        params.check().map_or_else(|errors| errors[0].pointer.clone(), |()| "accepted".into())
    };
    assert_eq!(refused(|_| {}), "accepted");
    assert_eq!(refused(|c| c.strategies.clear()), "/candidates/strategies");
    assert_eq!(refused(|c| c.even_directions = Some(3)), "/candidates/even_directions");
    assert_eq!(refused(|c| c.facet_normals = 0), "/candidates/facet_normals");
    assert_eq!(refused(|c| c.targeted_max = 1001), "/candidates/targeted_max");
    assert_eq!(refused(|c| c.iterative_rounds = 21), "/candidates/iterative_rounds");
    assert_eq!(refused(|c| c.spacing_mm = Some(-1.0)), "/candidates/spacing_mm");
    assert_eq!(refused(|c| c.tilts_deg = vec![61.0]), "/candidates/tilts_deg/0");
    assert_eq!(refused(|c| c.standoffs_mm.clear()), "/candidates/standoffs_mm");
    assert_eq!(refused(|c| c.standoffs_mm = vec![0.0, f64::NAN]), "/candidates/standoffs_mm/1");
}

#[test]
fn views_are_looked_for_beside_others_at_the_point_that_these_look_at() {
    let mesh = box_mesh([0.0; 3], [100.0, 80.0, 60.0]);
    let surface =
        sample(&mesh, &PartParams::default(), &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"));
    let (scanner, flag) = (nominal_scanner(), AtomicBool::new(false));
    let sight = Sight::of(&mesh, &surface, &scanner);
    let (scope, ctx) = (scope(&mesh, &surface, &scanner, &sight), Context::new(&flag, &Silent));
    let params = CandidateParams::ellipsoid();
    let known = generate(&scope, &params, &ctx).unwrap_or_else(|error| panic!("{error}"));
    let views: Vec<&Candidate> = known.remaining.iter().take(3).collect();
    let beside = super::beside(&scope, &params, &views, known.generated, &ctx).unwrap_or_else(|_| unreachable!());
    assert_eq!((beside.generated, beside.remaining.len()), (24, 24));
    for (view, beside) in views.iter().zip(beside.remaining.chunks(8)) {
        let of_view = &view.part_from_scanner;
        for (place, candidate) in beside.iter().enumerate() {
            let pose = &candidate.part_from_scanner;
            assert!((aimed_at(pose) - aimed_at(of_view)).norm() < 1e-9, "the point at F ahead stays");
            let turned_deg = pose.direction(&Vector3::z()).angle(&of_view.direction(&Vector3::z())).to_degrees();
            assert!((turned_deg - if place < 4 { 6.0 } else { 12.0 }).abs() < 1e-6, "{turned_deg}");
        }
    }
    let already = max_candidates(surface.sample_mm.len()) - 5;
    let full = super::beside(&scope, &params, &views, already, &ctx).unwrap_or_else(|_| unreachable!());
    assert_eq!(full.generated, 5, "no more than there is room for");
}
