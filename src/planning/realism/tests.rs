use std::f64::consts::PI;
use std::sync::atomic::AtomicBool;

use nalgebra::UnitQuaternion;

use super::concave::{self, ConcaveEdge, zone};
use super::*;
use crate::planning::context::Silent;
use crate::planning::params::{PartParams, RegionParams};
use crate::planning::surface::sample;
use crate::planning::visibility::{Occluders, cast};
use crate::testing::{box_mesh, nominal_scanner};

const RIGHT_ANGLE_AND_MORE_RAD: f64 = 120.0 * PI / 180.0;

/// A sheet along y over a profile in the x–z plane; the air is to the left of the profile as it runs.
fn sheet(profile_xz: &[[f64; 2]], half_length_mm: f64) -> Mesh {
    let n = profile_xz.len() as u32;
    let end = |y: f64| profile_xz.iter().map(move |[x, z]| Point3::new(*x, y, *z));
    let faces: Vec<_> = (0..n - 1).flat_map(|i| [[i, i + 1, i + 1 + n], [i, i + 1 + n, i + n]]).collect();
    Mesh {
        vertices_mm: end(-half_length_mm).chain(end(half_length_mm)).collect(),
        source_face: (0..faces.len() as u32).collect(),
        faces,
        groups: Vec::new(),
    }
}

fn sampled(mesh: &Mesh, density: f64) -> Surface {
    let part = PartParams { patch_edge_mm: Some(2.0), samples_per_mm2: Some(density), ..PartParams::default() };
    sample(mesh, &part, &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"))
}

fn with_ctx<T>(run: impl FnOnce(&Context<'_>) -> Result<T, Cancelled>) -> T {
    run(&Context::new(&AtomicBool::new(false), &Silent)).unwrap_or_else(|_| unreachable!("not cancelled"))
}

fn concave_edges(mesh: &Mesh, dihedral_max_rad: f64) -> Vec<ConcaveEdge> {
    with_ctx(|ctx| concave::concave_edges(mesh, dihedral_max_rad, ctx))
}

fn in_zone(surface: &Surface, mesh: &Mesh, zone_mm: f64) -> SampleSet {
    let edges = concave_edges(mesh, RIGHT_ANGLE_AND_MORE_RAD);
    let mut samples = SampleSet::none_of(surface.sample_mm.len());
    let zone = with_ctx(|ctx| zone(surface, (mesh, &edges), zone_mm, |_| true, ctx));
    zone.iter().for_each(|near| samples.insert(near.sample));
    samples
}

fn area_mm2(surface: &Surface, samples: &SampleSet) -> f64 {
    samples.iter().map(|sample| surface.sample_area_mm2(sample)).sum()
}

/// A slot 10 mm wide and 10 mm deep between two lands.
const SLOT: [[f64; 2]; 6] = [[-15.0, 10.0], [-5.0, 10.0], [-5.0, 0.0], [5.0, 0.0], [5.0, 10.0], [15.0, 10.0]];

#[test]
fn the_zone_of_a_slot_is_a_strip_along_either_corner_on_floor_and_walls() {
    let mesh = sheet(&SLOT, 10.0);
    assert_eq!(concave_edges(&mesh, RIGHT_ANGLE_AND_MORE_RAD).len(), 2, "where floor and walls meet, not at the lands");
    let surface = sampled(&mesh, 60.0);
    for width_mm in [0.5, 2.0, 4.0] {
        let zone = in_zone(&surface, &mesh, width_mm);
        for sample in surface.samples() {
            let (p, n) = (&surface.sample_mm[sample.index()], &surface.patch_of(sample).normal);
            let from_corner_mm = match () {
                () if n.z > 0.9 && p.z < 5.0 => 5.0 - p.x.abs(),
                () if n.x.abs() > 0.9 => p.z,
                () => f64::INFINITY,
            };
            if (from_corner_mm - width_mm).abs() > 1e-6 {
                assert_eq!(zone.holds(sample), from_corner_mm < width_mm, "{p} with {width_mm} mm");
            }
        }
        // w on the floor and w on the wall, on both sides, 20 mm long.
        let expected_mm2 = 4.0 * width_mm * 20.0;
        let share = area_mm2(&surface, &zone) / expected_mm2;
        assert!((share - 1.0).abs() < 0.03, "{share} of {expected_mm2} mm²");
    }
}

#[test]
fn the_zone_of_some_samples_is_that_of_all_which_holds_them() {
    let mesh = sheet(&SLOT, 10.0);
    let (surface, edges) = (sampled(&mesh, 20.0), concave_edges(&mesh, RIGHT_ANGLE_AND_MORE_RAD));
    for width_mm in [0.01, 0.5, 4.0] {
        let all = in_zone(&surface, &mesh, width_mm);
        let is_asked = |sample: SampleId| {
            let p = &surface.sample_mm[sample.index()];
            p.x > 3.0 && (1.0..2.5).contains(&p.y)
        };
        let some = with_ctx(|ctx| zone(&surface, (&mesh, &edges), width_mm, is_asked, ctx));
        let of_all: Vec<SampleId> = all.iter().filter(|sample| is_asked(*sample)).collect();
        assert_eq!(some.iter().map(|near| near.sample).collect::<Vec<_>>(), of_all, "{width_mm} mm");
        assert!(!of_all.is_empty() || width_mm < 0.1);
    }
}

#[test]
fn a_bracket_has_one_inside_corner_and_a_convex_box_none() {
    let bracket = sheet(&[[-20.0, 30.0], [0.0, 30.0], [0.0, 0.0], [60.0, 0.0]], 10.0);
    assert_eq!(concave_edges(&bracket, RIGHT_ANGLE_AND_MORE_RAD).len(), 1);
    let surface = sampled(&bracket, 60.0);
    let share = area_mm2(&surface, &in_zone(&surface, &bracket, 2.0)) / (2.0 * 2.0 * 20.0);
    assert!((share - 1.0).abs() < 0.03, "{share}");
    let block = box_mesh([-10.0; 3], [10.0; 3]);
    assert!(concave_edges(&block, 175.0_f64.to_radians()).is_empty());
    let surface = sampled(&block, 1.0);
    assert_eq!(in_zone(&surface, &block, 50.0).count(), 0);
}

#[test]
fn an_edge_is_concave_below_the_angle_of_air_between_its_faces() {
    // Two arms that leave `air_deg` between them, above.
    let edges = |air_deg: f64, max_deg: f64| {
        let (sin, cos) = (0.5 * air_deg.to_radians()).sin_cos();
        let mesh = sheet(&[[-10.0 * sin, 10.0 * cos], [0.0, 0.0], [10.0 * sin, 10.0 * cos]], 5.0);
        concave_edges(&mesh, max_deg.to_radians()).len()
    };
    for (air_deg, is_concave) in [(30.0, 1), (90.0, 1), (119.9, 1), (120.1, 0), (179.0, 0), (240.0, 0), (330.0, 0)] {
        assert_eq!(edges(air_deg, 120.0), is_concave, "{air_deg}° of air");
    }
    assert_eq!((edges(90.0, 80.0), edges(150.0, 160.0), edges(200.0, 175.0)), (0, 1, 0));
}

#[test]
fn a_fillet_in_fine_steps_is_no_corner_whatever_its_width() {
    // A quarter circle of 20 mm between wall and floor, in `steps` chords.
    let edges = |steps: u32, max_deg: f64| {
        let arc = (0..=steps).map(|step| {
            let (sin, cos) = (0.5 * PI * f64::from(step) / f64::from(steps)).sin_cos();
            [20.0 - 20.0 * cos, 20.0 - 20.0 * sin]
        });
        let profile: Vec<_> = [[0.0, 50.0]].into_iter().chain(arc).chain([[60.0, 0.0]]).collect();
        concave_edges(&sheet(&profile, 10.0), max_deg.to_radians()).len()
    };
    assert_eq!((edges(30, 120.0), edges(3, 120.0)), (0, 0));
    // One chord is a chamfer: two edges of 135°.
    assert_eq!((edges(1, 120.0), edges(1, 140.0)), (0, 2));
}

/// The zone and both margins left out.
fn no_risks() -> PlanParams {
    let mut params = PlanParams::default();
    (params.realism.concave_zone_mm, params.realism.frame_margin_px, params.realism.silhouette_margin_px) = (0.0, 0.0, 0.0);
    params
}

/// A scanner 480 mm above z = 0 that looks straight down, `x_mm` off the middle.
fn looking_down(x_mm: f64) -> Pose<Part, ScannerFrame> {
    Pose::from_parts(Vector3::new(x_mm, 0.0, 480.0), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI))
}

/// Samples that views measure of a mesh, and the risks of that.
fn judged(mesh: &Mesh, surface: &Surface, poses: &[Pose<Part, ScannerFrame>], params: &PlanParams) -> (SampleSet, Risks) {
    let (scanner, occluders) = (nominal_scanner(), Occluders::new([mesh]));
    with_ctx(|ctx| {
        let rows = cast(surface, poses, &vec![true; poses.len()], &scanner, &occluders, params, ctx)?.rows;
        let view =
            |(pose, row): (&Pose<Part, ScannerFrame>, _)| RiskView { part_from_scanner: *pose, row, surfaces: occluders.rays() };
        let views: Vec<RiskView<'_>> = poses.iter().zip(&rows).map(view).collect();
        let mut measured = SampleSet::none_of(surface.sample_mm.len());
        rows.iter().for_each(|row| measured.insert_all(row.measured()));
        Ok((measured, risks(&RiskInput { mesh, surface, scanner: &scanner, params }, &views, ctx)?))
    })
}

/// A block whose top, ±10 mm, lies at z = 0.
fn block() -> (Mesh, Surface) {
    let mesh = box_mesh([-10.0, -10.0, -10.0], [10.0, 10.0, 0.0]);
    let surface = sampled(&mesh, 20.0);
    (mesh, surface)
}

#[test]
fn half_the_image_as_margin_puts_everything_at_risk_and_none_nothing() {
    let (mesh, surface) = block();
    let at_risk = |margin_px: f64| {
        let mut params = no_risks();
        params.realism.frame_margin_px = margin_px;
        let (measured, risks) = judged(&mesh, &surface, &[looking_down(0.0)], &params);
        assert!(measured.count() > 1000, "the top is seen");
        assert!(risks.samples().iter().all(|sample| risks.has(sample, RiskReason::FrameMargin)));
        (risks.samples().count(), measured.count())
    };
    let (all, measured) = at_risk(2000.0);
    assert_eq!(all, measured);
    assert_eq!(at_risk(0.0).0, 0);
    // 10 mm are 105 pixels from the middle of the projector's 2000 by 2000, and less of the cameras'.
    assert_eq!(at_risk(800.0).0, 0);
}

#[test]
fn a_sample_that_one_view_measures_outside_the_margins_is_not_at_risk() {
    let (mesh, surface) = block();
    let mut params = no_risks();
    params.realism.frame_margin_px = 700.0;
    // 100 mm off the middle are 667 of the projector's 1000 pixels.
    let (measured, risks) = judged(&mesh, &surface, &[looking_down(100.0)], &params);
    assert!(measured.count() > 1000);
    assert_eq!(risks.samples(), measured, "at the border of the only view");
    for poses in [[looking_down(100.0), looking_down(0.0)], [looking_down(0.0), looking_down(100.0)]] {
        let (_, risks) = judged(&mesh, &surface, &poses, &params);
        assert_eq!(risks.samples().count(), 0, "in the middle of the other view");
    }
}

#[test]
fn the_silhouette_s_margin_runs_along_the_rim_of_a_block_as_wide_as_the_coarsest_device_s_pixels() {
    let (mesh, surface) = block();
    let mut params = no_risks();
    // Ten pixels of the projector are 10 · 480 / f mm, and fewer of the cameras'.
    params.realism.silhouette_margin_px = 10.0;
    let lens = nominal_scanner().devices.projector.lens;
    let [across_x_mm, across_y_mm] = [lens.fx, lens.fy].map(|focal_px| 10.0 * 480.0 / focal_px);
    let (measured, risks) = judged(&mesh, &surface, &[looking_down(0.0)], &params);
    let (mut inside, mut outside) = (0, 0);
    for sample in measured.iter() {
        let p = &surface.sample_mm[sample.index()];
        // How far within the margin, mm; negative beyond it.
        let within_mm = (across_x_mm - (10.0 - p.x.abs())).max(across_y_mm - (10.0 - p.y.abs()));
        if within_mm.abs() > 0.01 {
            assert_eq!(risks.has(sample, RiskReason::SilhouetteMargin), within_mm > 0.0, "{p}: {within_mm} mm");
        }
        (inside, outside) = if within_mm > 0.0 { (inside + 1, outside) } else { (inside, outside + 1) };
    }
    assert!(inside > 1000 && outside > 3000, "{inside} and {outside}");
}

#[test]
fn light_is_mirrored_onto_the_opposite_face_from_where_that_face_looks() {
    // A low wall at x = 0 that faces +x, and the floor before it.
    let mesh = sheet(&[[-20.0, 5.0], [0.0, 5.0], [0.0, 0.0], [60.0, 0.0]], 10.0);
    let (surface, scanner) = (sampled(&mesh, 10.0), nominal_scanner());
    let mut params = no_risks();
    params.realism.concave_zone_mm = 2.0;
    let is_floor = |sample: &SampleId| {
        let p = &surface.sample_mm[sample.index()];
        surface.patch_of(*sample).normal.z > 0.9 && p.z < 1.0 && p.x < 2.0
    };
    let floor: Vec<SampleId> = surface.samples().filter(is_floor).collect();
    assert!(floor.len() > 100);
    let row = Row::from_samples(surface.sample_mm.len(), floor.iter().map(|sample| (*sample, 0.5)));
    let surfaces = RayScene::new([&mesh]);
    let reflecting = |from_mm: &[f64]| {
        let view = |x_mm: &f64| RiskView { part_from_scanner: looking_down(*x_mm), row: &row, surfaces: &surfaces };
        let views: Vec<_> = from_mm.iter().map(view).collect();
        let input = RiskInput { mesh: &mesh, surface: &surface, scanner: &scanner, params: &params };
        let risks = with_ctx(|ctx| risks(&input, &views, ctx));
        assert_eq!(risks.samples(), *row.measured(), "all of it lies in the zone, wherever it is seen from");
        floor.iter().filter(|sample| risks.has(**sample, RiskReason::InterReflection)).count()
    };
    // Light from the wall's own side of the corner leaves towards the wall; from beyond the wall, away from it.
    assert_eq!(reflecting(&[60.0]), floor.len());
    assert_eq!(reflecting(&[-60.0]), 0);
    assert_eq!(reflecting(&[60.0, -60.0]), 0, "one view without it is enough");
    assert_eq!(reflecting(&[60.0, 90.0]), floor.len());
}

#[test]
fn threads_do_not_change_what_is_at_risk() {
    let mesh = sheet(&SLOT, 10.0);
    let surface = sampled(&mesh, 20.0);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| judged(&mesh, &surface, &[looking_down(0.0), looking_down(20.0)], &PlanParams::default()).1.bits)
    };
    let one = on(1);
    assert!(one.iter().any(|bits| *bits != 0));
    assert_eq!(one, on(3));
}
