//! The raster engine against the reference engine, sample for sample: on open, non-manifold and many-bodied parts, with
//! a lens that distorts, where a part is wider than the image, and where surfaces reach behind a device. The same bits
//! with every vector width and number of threads. The pixel set against one ray a pixel.

use std::io::Read;
use std::sync::atomic::AtomicBool;

use flate2::read::GzDecoder;
use nalgebra::{Point3, Rotation3, UnitQuaternion, Vector3};
use vantage::cell::{DeviceSpec, Presets, Scanner, SpecLibrary};
use vantage::geometry::demo_parts;
use vantage::geometry::mesh_io::{self, Limits};
use vantage::geometry::{LengthUnit, Mesh, Part, Pose, RayScene, ScannerFrame, SimdLevel, assess};
use vantage::planning::context::{Context, Silent};
use vantage::planning::ids::SampleId;
use vantage::planning::params::{CandidateParams, Engine, PlanParams};
use vantage::planning::surface::{self, Surface};
use vantage::planning::visibility::{self, Occluders, VisibilityMatrix};
use vantage::wire::echo::Echo;
use vantage::wire::plan::PlanDocument;

use crate::support::{box_mesh, glb, nominal_scanner, plan_viewpoints, preset_scanner, shapes, shared};

type View = Pose<Part, ScannerFrame>;

/// A part and everything else that is needed to ask what views measure of it.
struct Case {
    mesh: Mesh,
    around: Vec<Mesh>,
    scanner: Scanner,
    views: Vec<View>,
}

impl Case {
    /// `mesh` scaled to `extent_mm`, seen from `views` directions spread over the sphere.
    fn of(mut mesh: Mesh, extent_mm: f64, scanner: Scanner, views: usize) -> Self {
        let (centre, scale) = (mesh.aabb().centre(), extent_mm / mesh.aabb().extent_mm().max());
        mesh.vertices_mm.iter_mut().for_each(|p| *p = Point3::from((*p - centre) * scale));
        let views = (0..views).map(|i| looking_from(direction(i, views), 480.0)).collect();
        Self { mesh, around: Vec::new(), scanner, views }
    }

    fn surface(&self, samples: f64) -> Surface {
        let mut params = PlanParams::default();
        params.part.samples_per_mm2 = Some(samples / self.mesh.area_mm2());
        surface::sample(&self.mesh, &params.part, &params.regions, 0).expect("valid parameters")
    }

    fn table(&self, surface: &Surface, engine: Engine, usable: &[bool], level: SimdLevel) -> VisibilityMatrix {
        let (occluders, cancel) = (Occluders::new([&self.mesh].into_iter().chain(&self.around)), AtomicBool::new(false));
        let mut params = PlanParams::default();
        params.visibility.engine = engine;
        let ctx = Context::new(&cancel, &Silent).with_simd_level(level);
        visibility::cast(surface, &self.views, usable, &self.scanner, &occluders, &params, &ctx).expect("not cancelled")
    }

    fn engines_agree(&self, what: &str) {
        self.engines_agree_on(30_000.0, what);
    }

    /// Both engines' tables differ in few of so many samples and in less area.
    fn engines_agree_on(&self, samples: f64, what: &str) {
        let surface = self.surface(samples);
        let usable = vec![true; self.views.len()];
        let raster = self.table(&surface, Engine::Raster, &usable, SimdLevel::widest());
        let rays = self.table(&surface, Engine::Rays, &usable, SimdLevel::widest());
        let (mut judged, mut differ_mm2, mut measured_mm2, mut excess_mm2) = (0, 0.0, 0.0, 0.0);
        for (raster, rays) in raster.rows.iter().zip(&rays.rows) {
            for sample in surface.samples() {
                let (mine, theirs, area_mm2) = (raster.holds(sample), rays.holds(sample), surface.sample_area_mm2(sample));
                judged += usize::from(mine || theirs);
                differ_mm2 += if mine == theirs { 0.0 } else { area_mm2 };
                measured_mm2 += if theirs { area_mm2 } else { 0.0 };
                excess_mm2 += area_mm2 * (f64::from(mine) - f64::from(theirs));
            }
        }
        let (differ, excess) = (differ_mm2 / measured_mm2, excess_mm2 / measured_mm2);
        println!("{what}: {judged} answers, {:.0} ppm of the area differ, in sum {:+.0}", 1e6 * differ, 1e6 * excess);
        assert!(judged > 3_000, "{what}: too little is measured to say anything: {judged}");
        // The band before a sample's own facet lets pass 83 ppm at ribs of 1 mm, and less elsewhere.
        assert!(differ < 2e-4, "{what}: {differ} of the area differ");
    }
}

fn base() -> Mesh {
    demo_parts::base(40_000).expect("a part")
}

fn figurine() -> Mesh {
    demo_parts::figurine(12_000).expect("a part")
}

/// Directions spread evenly over the sphere.
fn direction(i: usize, count: usize) -> Vector3<f64> {
    let (z, angle) = (1.0 - (2 * i + 1) as f64 / count as f64, 2.399_963_229_728_653 * i as f64);
    let radius = (1.0 - z * z).sqrt();
    Vector3::new(radius * angle.cos(), radius * angle.sin(), z)
}

fn looking_from(from: Vector3<f64>, distance_mm: f64) -> View {
    let rotation = Rotation3::face_towards(&-from, &Vector3::new(0.3, -0.8, 0.5));
    Pose::from_parts(from * distance_mm, UnitQuaternion::from_rotation_matrix(&rotation))
}

fn shared_part(name: &str) -> Option<Mesh> {
    let bytes = std::fs::read(shared(name)?).expect("readable");
    if name.ends_with(".glb") {
        return Some(glb::read(&bytes));
    }
    let mut plain = Vec::new();
    let bytes = if name.ends_with(".gz") {
        GzDecoder::new(&bytes[..]).read_to_end(&mut plain).expect("gzip of the test data");
        plain
    } else {
        bytes
    };
    Some(mesh_io::read(&bytes, Some(LengthUnit::Millimetre), &Limits::default()).expect("a mesh").mesh)
}

#[test]
#[ignore = "long: tests/all runs it"]
fn engines_agree_on_open_and_non_manifold_parts() {
    let parts = [
        ("meshes/watering_can_thin_shell_38k.stl", 180.0),
        ("meshes/gearbox_assembly_217k.stl.gz", 126.0),
        ("meshes/cylinder_head_118k.stl", 180.0),
        ("meshes/engine_2cyl_121k.glb", 200.0),
        ("meshes/bunny_69k_binary.stl", 120.0),
    ];
    for (name, extent_mm) in parts {
        let Some(mesh) = shared_part(name) else { return };
        Case::of(mesh, extent_mm, nominal_scanner(), 3).engines_agree(name);
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn engines_agree_through_a_lens_that_distorts() {
    for (name, part) in [("base", base()), ("figurine", figurine())] {
        assert!(assess(&part).watertight);
        Case::of(part, 120.0, preset_scanner("transcan-c"), 6).engines_agree(name);
    }
}

/// Parts with facets no larger than a few pixels, on which a map may be nearer than a sample's facet by more than elsewhere.
/// Samples are so many that maps are drawn.
#[test]
#[ignore = "long: tests/all runs it"]
fn engines_agree_on_facets_of_a_few_pixels() {
    let part = demo_parts::figurine(60_000).expect("a part");
    Case::of(part, 40.0, nominal_scanner(), 2).engines_agree_on(150_000.0, "figurine of fine facets");
}

/// A sheet of fine facets with steep ribs: what hid a sample of a facet smaller than four pixels by less than 0.06 mm did not count.
#[test]
fn engines_agree_on_ribs_of_fine_facets() {
    const STEP_MM: f64 = 0.2;
    let steps = |from: f64, to: f64, count: u32| (0..count).map(move |i| from + (to - from) * f64::from(i) / f64::from(count));
    let rib = |start_mm: f64| {
        let up = steps(0.0, 1.0, 5).map(move |z| [start_mm, z]);
        let on_top = steps(0.0, 1.0, 5).map(move |x| [start_mm + x, 1.0]);
        let down = steps(1.0, 0.0, 5).map(move |z| [start_mm + 1.0, z]);
        up.chain(on_top).chain(down).chain(steps(1.0, 2.0, 5).map(move |x| [start_mm + x, 0.0]))
    };
    let profile: Vec<[f64; 2]> = (0..10).flat_map(|i| rib(2.0 * f64::from(i))).collect();
    let rows = 100;
    let (width, mut faces) = (profile.len() as u32, Vec::new());
    let at = |row: u32, x: f64, z: f64| Point3::new(x, STEP_MM * f64::from(row), z);
    let vertices_mm = (0..=rows).flat_map(|row| profile.iter().map(move |[x, z]| at(row, *x, *z))).collect();
    for (row, column) in (0..rows).flat_map(|row| (0..width - 1).map(move |column| (row, column))) {
        let [a, b] = [row * width + column, row * width + column + 1];
        faces.extend([[a, b, b + width], [a, b + width, a + width]]);
    }
    let source_face = (0..faces.len() as u32).collect();
    let mesh = Mesh { vertices_mm, faces, source_face, groups: Vec::new() };
    Case::of(mesh, 20.0, nominal_scanner(), 8).engines_agree_on(60_000.0, "ribs of fine facets");
}

#[test]
fn engines_agree_on_a_part_wider_than_the_image() {
    let mut case = Case::of(base(), 700.0, preset_scanner("transcan-c"), 12);
    case.views = (0..12).map(|i| looking_from(direction(i, 12), 560.0)).collect();
    case.engines_agree("base of 700 mm");
}

/// A wall beside the line of sight that reaches from behind the part to far behind the devices, a bar across the view
/// of one camera, right before it, and a plate so large that its corners lie behind every device.
#[test]
fn engines_agree_where_surfaces_reach_behind_a_device() {
    let mut case = Case::of(figurine(), 120.0, nominal_scanner(), 1);
    case.views = vec![Pose::from_parts(Vector3::new(0.0, 0.0, 480.0), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 3.1))];
    case.around = vec![
        box_mesh([40.0, 20.0, -300.0], [44.0, 900.0, 2000.0]),
        box_mesh([-140.0, 1.0, 430.0], [-60.0, 40.0, 2500.0]),
        box_mesh([-4000.0, -30.0, -70.0], [4000.0, -26.0, 1500.0]),
    ];
    case.engines_agree("figurine behind walls");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn every_vector_width_and_number_of_threads_gives_the_same_table() {
    let case = Case::of(figurine(), 120.0, preset_scanner("transcan-c"), 5);
    let surface = case.surface(20_000.0);
    let on = |threads: usize, level: SimdLevel| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| case.table(&surface, Engine::Raster, &[true; 5], level))
    };
    let first = on(1, SimdLevel::PORTABLE);
    assert!(first.rows.iter().all(|row| row.count() > 100));
    for (threads, level) in SimdLevel::available().into_iter().flat_map(|level| [(1, level), (2, level), (3, level), (7, level)])
    {
        let other = on(threads, level);
        assert!(
            first.rows == other.rows && first.furthest_cause == other.furthest_cause,
            "{threads} threads, {}",
            level.as_str()
        );
    }
}

#[test]
fn views_that_cannot_be_chosen_are_asked_only_what_the_others_leave_open() {
    let case = Case::of(base(), 120.0, nominal_scanner(), 7);
    let surface = case.surface(20_000.0);
    let usable = [true, false, true, false, false, true, false];
    let all = case.table(&surface, Engine::Raster, &[true; 7], SimdLevel::widest());
    let some = case.table(&surface, Engine::Raster, &usable, SimdLevel::widest());
    let by_usable = |sample: SampleId| (0..7).any(|view| usable[view] && all.rows[view].holds(sample));
    let mut left_open = 0;
    for sample in surface.samples() {
        for view in 0..7 {
            let wanted = all.rows[view].holds(sample) && (usable[view] || !by_usable(sample));
            assert_eq!(some.rows[view].holds(sample), wanted, "{sample:?}, view {view}");
        }
        let measured = all.rows.iter().any(|row| row.holds(sample));
        left_open += usize::from(measured && !by_usable(sample));
        assert!(measured || some.furthest_cause[sample.index()] == all.furthest_cause[sample.index()], "{sample:?}");
    }
    assert!(left_open > 100, "the views that cannot be chosen have something of their own: {left_open}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_plan_has_the_same_bytes_with_every_vector_width() {
    let scanner = nominal_scanner();
    let part = shapes::step(90.0, 45.0, 40.0);
    let params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    let outcome = plan_viewpoints(&part, &scanner, &params);
    let wanted = PlanDocument::new(&outcome, &scanner, None, Echo::default()).to_bytes();
    let cancel = AtomicBool::new(false);
    for level in SimdLevel::available() {
        let input = vantage::planning::PlanInput {
            mesh: &part,
            fixture: None,
            part_sha256: "",
            scanner: &scanner,
            cell: None,
            roadmaps: None,
        };
        let ctx = Context::new(&cancel, &Silent).with_simd_level(level);
        let outcome = vantage::planning::plan(&input, &params, &ctx).expect("a plan");
        let bytes = PlanDocument::new(&outcome, &scanner, None, Echo::default()).to_bytes();
        assert!(bytes == wanted, "{} gives another plan", level.as_str());
    }
}

/// A device with a tenth of the pixels, so that one ray a pixel is soon cast.
fn coarse(spec: &mut DeviceSpec) {
    (spec.width_px, spec.height_px) = (spec.width_px / 10, spec.height_px / 10);
    for value in [&mut spec.fx, &mut spec.fy, &mut spec.cx, &mut spec.cy] {
        *value /= 10.0;
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn the_pixel_set_is_that_of_one_ray_a_pixel() {
    let mut spec = Presets.scanner("transcan-c-nominal").expect("a preset");
    for device in [&mut spec.left, &mut spec.right, &mut spec.projector] {
        coarse(device);
    }
    let case = Case::of(figurine(), 120.0, spec.build().expect("valid"), 4);
    let (occluders, rays) = (Occluders::new([&case.mesh]), RayScene::new([&case.mesh]));
    let cancel = AtomicBool::new(false);
    let (mut hits, mut differ, mut shown) = (Vec::new(), 0, 0);
    for view in &case.views {
        let set = visibility::pixel_set(&occluders, &case.scanner, view, &Context::new(&cancel, &Silent)).expect("not cancelled");
        let mut wanted = vec![0_u8; case.mesh.faces.len()];
        for (d, device) in case.scanner.devices.iter().enumerate() {
            let part_from_device = view.isometry() * device.scanner_from_device.isometry();
            let (width, height) = (device.lens.width_px as usize, device.lens.height_px as usize);
            let pixel = |i: usize| nalgebra::Vector2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let directions: Vec<_> = (0..width * height).map(|i| part_from_device * device.lens.unproject(&pixel(i))).collect();
            let origin = part_from_device * Point3::origin();
            rays.first_hits_from(SimdLevel::widest(), &origin, &directions, &mut hits);
            hits.iter().flatten().for_each(|hit| wanted[hit.triangle as usize] |= 1 << d);
        }
        differ += set.iter().zip(&wanted).filter(|(mine, theirs)| mine != theirs).count();
        shown += wanted.iter().filter(|devices| **devices != 0).count();
    }
    println!("{differ} of {shown} triangles differ");
    assert!(shown > 2_000 && differ as f64 <= 5e-4 * shown as f64, "{differ} of {shown} triangles differ");
}

/// A box from all sides: pixels hit every face from some view. From one view they hit the faces that it looks at, and
/// count one view each.
#[test]
#[ignore = "long: tests/all runs it"]
fn a_plan_counts_by_pixels_where_asked_to() {
    let (mesh, scanner) = (box_mesh([0.0; 3], [60.0, 40.0, 30.0]), nominal_scanner());
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    assert!(plan_viewpoints(&mesh, &scanner, &params).pixel_views.is_none());
    params.visibility.pixel_set = true;
    let outcome = plan_viewpoints(&mesh, &scanner, &params);
    let coverage = PlanDocument::new(&outcome, &scanner, None, Echo::default()).coverage;
    assert!((coverage.pixel_set_of_total.expect("asked for") - 1.0).abs() < 1e-12, "{coverage:?}");
    params.selection.max_views = Some(1);
    let outcome = plan_viewpoints(&mesh, &scanner, &params);
    let pose = &outcome.plan.views[0].part_from_scanner;
    let occluders = Occluders::new([&mesh]);
    let cancel = AtomicBool::new(false);
    let devices = visibility::pixel_set(&occluders, &scanner, pose, &Context::new(&cancel, &Silent)).expect("not cancelled");
    let hits: Vec<u32> = devices.iter().map(|devices| u32::from(*devices == 7)).collect();
    assert!(hits.contains(&0) && hits.contains(&1));
    assert_eq!(outcome.pixel_views.as_ref(), Some(&hits));
    let csv = vantage::wire::coverage::csv(&outcome, &mesh, "");
    let views: Vec<_> = csv.lines().map(|line| line.rsplit(',').nth(1).expect("a cell")).collect();
    assert_eq!(views[0], "pixel_views");
    assert_eq!(views[1..], hits.iter().map(u32::to_string).collect::<Vec<_>>());
}
