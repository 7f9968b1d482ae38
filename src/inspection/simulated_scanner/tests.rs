use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::{CellFate, ScannedScene, SimulatedScanner, SimulatedView, SimulationParams, crop, in_unit, swap};
use crate::geometry::{Mesh, Part, Pose, RayScene, ScannerFrame};
use crate::inspection::rehearsal::in_context;
use crate::planning::params::PlanParams;
use crate::planning::surface::requirements::Requirements;
use crate::planning::visibility::{Optics, RAY_END_SHARE};
use crate::testing::{box_mesh, nominal_scanner};

/// Looks down on the origin from so far above, the part turned by an angle about x.
fn above(distance_mm: f64, tilt_deg: f64) -> Pose<Part, ScannerFrame> {
    let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let tilt = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), tilt_deg.to_radians());
    let from_above = Isometry3::from_parts(Translation3::new(0.0, 0.0, distance_mm), down);
    Pose::claim(Isometry3::from_parts(Translation3::identity(), tilt) * from_above)
}

fn scene(as_built: &Mesh) -> ScannedScene<'_> {
    ScannedScene { as_built, fixture: None, plate: None, unknown: None, face_albedo: None }
}

fn scan(sim: &SimulationParams, scene: ScannedScene<'_>, poses: &[Pose<Part, ScannerFrame>]) -> Vec<SimulatedView> {
    let scanner = nominal_scanner();
    let views: Vec<_> = (0..).zip(poses.iter().copied()).collect();
    in_context(|ctx| SimulatedScanner::new(&scanner, &PlanParams::default(), sim, scene, ctx)?.scan(&views, ctx))
        .expect("nobody cancels")
}

fn noiseless(step_px: u32) -> SimulationParams {
    SimulationParams { step_px, noise_best_mm: Some(0.0), ..SimulationParams::default() }
}

fn share_of(view: &SimulatedView, fate: CellFate) -> f64 {
    let count = |is: &dyn Fn(CellFate) -> bool| view.fates.iter().filter(|fate| is(**fate)).count() as f64;
    count(&|other| other == fate) / count(&|other| !matches!(other, CellFate::Empty | CellFate::Unseen))
}

#[test]
fn a_cell_returns_if_and_only_if_the_definition_of_visibility_says_so() {
    let mesh = box_mesh([-30.0, -20.0, -25.0], [30.0, 20.0, 0.0]);
    let second = box_mesh([-10.0, -8.0, 5.0], [6.0, 9.0, 20.0]);
    let pose = above(480.0, 25.0);
    let scanner = nominal_scanner();
    let optics = Optics::new(&scanner, &PlanParams::default(), &Requirements::default());
    let (view, surfaces) = (optics.at(&pose), RayScene::new([&mesh, &second]));
    let simulated = &scan(&noiseless(16), ScannedScene { fixture: Some(&second), ..scene(&mesh) }, &[pose])[0];
    let mut returned = 0;
    for (number, point) in simulated.scan.scanner_cloud.finite() {
        let point = pose.point(&point);
        let side = (point.z.abs() < 1e-3, (point.y - 20.0).abs() < 1e-3, (point.y + 20.0).abs() < 1e-3, point.x.abs() > 29.999);
        let normal = match side {
            (true, ..) => Vector3::z(),
            (_, true, ..) => Vector3::y(),
            (_, _, true, _) => -Vector3::y(),
            (.., true) => Vector3::x() * point.x.signum(),
            _ => panic!("cell {number} is off the part: {point}"),
        };
        assert!(view.before_shadow(&point, &normal, 0).is_ok());
        // A little above the surface: coordinates of clouds are in single precision.
        let lifted = point + normal * 1e-3;
        assert!(view.centres_mm().iter().all(|centre| !surfaces.blocked(centre, &lifted, RAY_END_SHARE)), "at {point}");
        returned += 1;
    }
    let count = |fate| simulated.fates.iter().filter(|other| **other == fate).count();
    assert_eq!(count(CellFate::Returned), returned);
    assert!(returned > 1000 && count(CellFate::Unseen) > 100 && count(CellFate::Surroundings) > 100);
}

#[test]
fn noise_across_a_surface_is_that_of_the_plan() {
    let mesh = box_mesh([-60.0, -60.0, -5.0], [60.0, 60.0, 0.0]);
    let scanner = nominal_scanner();
    let optics = Optics::new(&scanner, &PlanParams::default(), &Requirements::default());
    for (distance_mm, tilt_deg) in [(480.0, 0.0), (480.0, 50.0), (425.0, 30.0), (550.0, 60.0)] {
        let pose = above(distance_mm, tilt_deg);
        let simulated = &scan(&SimulationParams { step_px: 8, ..SimulationParams::default() }, scene(&mesh), &[pose])[0];
        let (view, mut squares, mut count) = (optics.at(&pose), 0.0, 0.0);
        for (_, point) in simulated.scan.scanner_cloud.finite() {
            let point = pose.point(&point);
            if point.x.abs() < 50.0 && point.y.abs() < 50.0 && point.z > -2.0 {
                let foot = Point3::new(point.x, point.y, 0.0);
                squares += (point.z / view.precision_at(&foot, &Vector3::z()).noise_mm).powi(2);
                count += 1.0;
            }
        }
        let deviation = f64::sqrt(squares / count);
        assert!(
            (deviation - 1.0).abs() < 0.03,
            "{deviation} of what is expected at {distance_mm} mm and {tilt_deg}°, {count} points"
        );
    }
}

#[test]
fn correlated_noise_is_shared_by_neighbours() {
    let mesh = box_mesh([-60.0, -60.0, -5.0], [60.0, 60.0, 0.0]);
    let sim = SimulationParams { correlated_noise_px: 0.3, ..noiseless(4) };
    let simulated = &scan(&sim, scene(&mesh), &[above(480.0, 0.0)])[0];
    let cloud = &simulated.scan.scanner_cloud;
    let columns = cloud.grid.expect("organised").columns;
    let height = |cell: usize| cloud.points_mm.get(cell).map(|point| f64::from(point[2]) - 480.0).filter(|mm| mm.is_finite());
    let correlation = |offset: usize| {
        let pairs: Vec<[f64; 2]> =
            (0..cloud.points_mm.len()).filter_map(|cell| Some([height(cell)?, height(cell + offset)?])).collect();
        let sum = |of: &dyn Fn(&[f64; 2]) -> f64| pairs.iter().map(of).sum::<f64>() / pairs.len() as f64;
        (sum(&|pair| pair[0] * pair[1]) / sum(&|pair| pair[0] * pair[0]), sum(&|pair| pair[0] * pair[0]).sqrt())
    };
    // 0.3 px at 0.171 mm a pixel.
    let (beside, deviation_mm) = correlation(1);
    assert!((deviation_mm - 0.3 * 480.0_f64.powi(2) / (6668.0 * 202.0)).abs() < 0.004, "{deviation_mm} mm");
    assert!(beside > 0.8 && correlation(12 * columns).0.abs() < 0.2, "{beside}, {}", correlation(12 * columns).0);
}

#[test]
fn the_same_bytes_come_from_any_number_of_threads() {
    let mesh = box_mesh([-30.0, -20.0, -25.0], [30.0, 20.0, 0.0]);
    let sim = SimulationParams {
        step_px: 16,
        grazing_deg: vec![20.0, 80.0],
        edge_px: 20.0,
        view_error_deg: 0.1,
        view_error_mm: 0.3,
        part_error_deg: 1.0,
        part_error_mm: 1.0,
        correlated_noise_px: 0.2,
        ..SimulationParams::default()
    };
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| scan(&sim, scene(&mesh), &[above(480.0, 25.0), above(470.0, -10.0)]))
    };
    for (one, three) in with_threads(1).iter().zip(with_threads(3)) {
        let bits = |view: &SimulatedView| -> Vec<[u32; 3]> {
            view.scan.scanner_cloud.points_mm.iter().map(|point| point.map(f32::to_bits)).collect()
        };
        assert_eq!(bits(one), bits(&three));
        assert_eq!(one.fates, three.fates);
    }
    let other = scan(&SimulationParams { seed: 1, ..sim.clone() }, scene(&mesh), &[above(480.0, 25.0)]);
    assert_ne!(other[0].fates, with_threads(1)[0].fates, "the seed counts");
}

#[test]
fn poses_are_off_by_what_is_asked_for() {
    let mesh = box_mesh([-30.0, -20.0, -25.0], [30.0, 20.0, 0.0]);
    let pose = above(480.0, 10.0);
    let view_error = SimulationParams { view_error_deg: 0.5, view_error_mm: 0.7, ..noiseless(32) };
    let part_error = SimulationParams { part_error_deg: 1.0, part_error_mm: 2.0, ..noiseless(32) };
    let view = &scan(&view_error, scene(&mesh), &[pose])[0];
    let off = pose.isometry().inverse() * view.true_part_from_scanner.isometry();
    assert!((off.rotation.angle().to_degrees() - 0.5).abs() < 1e-9 && (off.translation.vector.norm() - 0.7).abs() < 1e-9);
    let views = scan(&part_error, scene(&mesh), &[pose, above(470.0, 0.0)]);
    let moves: Vec<_> = views
        .iter()
        .map(|view| view.scan.part_from_scanner.isometry() * view.true_part_from_scanner.isometry().inverse())
        .collect();
    assert!((moves[0].inverse() * moves[1]).translation.vector.norm() < 1e-9, "one motion for all views");
    let centre = mesh.aabb().centre();
    assert!(((moves[0] * centre - centre).norm() - 2.0).abs() < 1e-9);
    // At the true pose the points lie on the part.
    for view in [view, &views[0], &views[1]] {
        for (_, point) in view.scan.scanner_cloud.finite() {
            let point = view.true_part_from_scanner.point(&point);
            let beyond = (point.x.abs() - 30.0).max(point.y.abs() - 20.0).max((point.z + 12.5).abs() - 12.5);
            assert!(beyond.abs() < 1e-3, "{point}");
        }
    }
}

#[test]
fn each_weakness_takes_what_it_is_said_to_take() {
    let step = crate::testing::box_mesh([-40.0, -40.0, -30.0], [40.0, 40.0, 0.0]);
    let tower = box_mesh([-10.0, -10.0, 0.0], [10.0, 10.0, 12.0]);
    let pose = above(480.0, 20.0);
    let of = |sim: &SimulationParams, fate| share_of(&scan(sim, scene(&step), &[pose])[0], fate);
    assert_eq!(of(&noiseless(16), CellFate::Returned), 1.0);
    // The top is seen at 20° by the axis and at 23.2° by the cameras, a side at about 70°.
    let side = of(&SimulationParams { grazing_deg: vec![40.0, 60.0], ..noiseless(16) }, CellFate::Grazing);
    assert!((0.05..0.15).contains(&side), "{side}");
    assert_eq!(of(&SimulationParams { grazing_deg: vec![1.0, 5.0], ..noiseless(16) }, CellFate::Grazing), 1.0);
    assert_eq!(of(&SimulationParams { signal: vec![2.0, 10.0], ..noiseless(16) }, CellFate::Dark), 1.0);
    assert_eq!(of(&SimulationParams { signal: vec![0.0, 0.1], ..noiseless(16) }, CellFate::Saturated), 1.0);
    let brighter = SimulationParams { signal: vec![2.0, 10.0], brightness: 9, ..noiseless(16) };
    // Four levels are four times the light: enough for the top, still too little for the side at 70°.
    let [returned, dark] = [CellFate::Returned, CellFate::Dark].map(|fate| of(&brighter, fate));
    assert!((0.85..0.95).contains(&returned) && (returned + dark - 1.0).abs() < 1e-9, "{returned} {dark}");
    // A mirror that faces the bisector of camera and projector.
    let mirror = |tilt_deg| {
        share_of(
            &scan(&SimulationParams { lobe_deg: 4.0, ..noiseless(16) }, scene(&step), &[above(480.0, tilt_deg)])[0],
            CellFate::Specular,
        )
    };
    assert!(mirror(0.0) > 0.02 && mirror(30.0) == 0.0, "{} {}", mirror(0.0), mirror(30.0));
    let edges = SimulationParams { edge_px: 32.0, ..noiseless(16) };
    let wide = SimulationParams { edge_px: 64.0, ..edges.clone() };
    let [narrow, wide] = [edges, wide].map(|sim| of(&sim, CellFate::Edge));
    assert!(narrow > 0.03 && wide > 1.5 * narrow && wide < 3.0 * narrow, "{narrow} {wide}");
    let joined = crate::geometry::Mesh {
        vertices_mm: step.vertices_mm.iter().chain(&tower.vertices_mm).copied().collect(),
        faces: step.faces.iter().copied().chain(tower.faces.iter().map(|face| face.map(|corner| corner + 8))).collect(),
        source_face: (0..24).collect(),
        groups: Vec::new(),
    };
    let unknown = ScannedScene { unknown: Some(&tower), ..scene(&step) };
    let hidden = &scan(&noiseless(16), unknown, &[pose])[0];
    let known = &scan(&noiseless(16), scene(&joined), &[pose])[0];
    assert!(hidden.fates.iter().filter(|fate| **fate == CellFate::UnmodelledOccluder).count() > 50);
    let returned = |view: &SimulatedView| view.scan.scanner_cloud.finite().count();
    assert_eq!(returned(hidden), returned(known), "who knows of the body changes nothing that is seen");
}

#[test]
fn files_are_spoilt_as_said() {
    let mesh = box_mesh([-30.0, -20.0, -25.0], [30.0, 20.0, 0.0]);
    let mut views = scan(&noiseless(32), scene(&mesh), &[above(480.0, 10.0), above(470.0, 0.0)]);
    let columns = views[0].scan.scanner_cloud.grid.expect("organised").columns;
    crop(&mut views[0], 0.5);
    assert!(views[0].scan.scanner_cloud.finite().all(|(cell, _)| cell % columns < columns / 2));
    assert!(views[0].fates.contains(&CellFate::OutsideFile));
    let mut scans: Vec<_> = views.iter().map(|view| view.scan.clone()).collect();
    swap(&mut scans, 0, 1);
    let finite = |scan: &crate::inspection::ViewScan| scan.scanner_cloud.finite().count();
    assert_eq!([finite(&scans[0]), finite(&scans[1])], [finite(&views[1].scan), finite(&views[0].scan)]);
    assert_eq!([scans[0].viewpoint, scans[1].viewpoint], [0, 1]);
    in_unit(&mut scans[0], 1000.0);
    assert!(scans[0].scanner_cloud.finite().all(|(_, point)| (0.4..0.6).contains(&point.z)));
}

#[test]
fn values_out_of_range_are_named() {
    let sim = SimulationParams { step_px: 0, grazing_deg: vec![80.0, 60.0], ..SimulationParams::default() };
    let errors = sim.check().expect_err("two errors");
    let pointers: Vec<&str> = errors.iter().map(|error| error.pointer.as_str()).collect();
    assert_eq!(pointers, ["/sim/step_px", "/sim/grazing_deg"]);
    assert!(SimulationParams::default().check().is_ok());
}
