use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector2, Vector3};

use super::*;
use crate::cell::{CalibratedScannerSpec, DeviceName, PerDevice, Scanner, ScannerSpec};

mod formats;
mod malformed;

const THESIS: &str = include_str!("../../../../config/scanners/transcan-c.toml");

/// SplitMix64 (Steele, Lea and Flood, 2014), and normal deviates of it by Box and Muller.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.unit()).ln()).sqrt() * (std::f64::consts::TAU * self.unit()).cos()
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

fn thesis() -> Scanner {
    let spec: ScannerSpec = toml::from_str(THESIS).expect("the preset");
    spec.build().expect("the preset is valid")
}

fn parameters(scanner: &Scanner, device: DeviceName) -> LensParameters {
    let lens = &scanner.devices[device].lens;
    LensParameters {
        size_px: [lens.width_px as u32, lens.height_px as u32],
        fx: lens.fx,
        fy: lens.fy,
        cx: lens.cx,
        cy: lens.cy,
        skew: lens.skew,
        distortion: lens.distortion,
    }
}

fn provenance() -> CalibratedScannerSpec {
    CalibratedScannerSpec { by: "test".into(), at: None, data_sha256: "0".repeat(64), residuals: None }
}

/// Pixels of a board of 15 × 10 points, 16 mm apart, in `count` poses before the rig, with noise.
fn observed(scanner: &Scanner, count: usize, noise_px: f64, seed: u64) -> BoardObservations {
    let mut random = Random(seed);
    let (columns, rows, square) = (15_u32, 10_u32, 16.0);
    let spec = BoardSpec { columns: Some(columns), rows: Some(rows), square_mm: Some(square), points_mm: None };
    let points = spec.points().expect("a board");
    let middle = Translation3::new(-0.5 * 14.0 * square, -0.5 * 9.0 * square, 0.0);
    let views = (0..count).map(|index| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), random.within(-0.6, 0.6))
            * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), random.within(-0.6, 0.6))
            * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), random.within(-0.5, 0.5));
        let at = Translation3::new(random.within(-50.0, 50.0), random.within(-40.0, 40.0), random.within(420.0, 560.0));
        let scanner_from_board = Isometry3::from_parts(at, turn) * middle;
        let mut seen = |device: DeviceName| {
            let optical = &scanner.devices[device];
            let device_from_board = optical.scanner_from_device.inverse().isometry() * scanner_from_board;
            let lit = points.iter().zip(0..).filter_map(|(point, number)| {
                let pixel = optical.lens.project(&(device_from_board * point))?;
                let noise = Vector2::new(random.normal(), random.normal()) * noise_px;
                Some(DeviceSighting { point: number, board_mm: *point, pixel: pixel + noise })
            });
            lit.collect::<Vec<_>>()
        };
        let seen =
            PerDevice { left: seen(DeviceName::Left), right: seen(DeviceName::Right), projector: seen(DeviceName::Projector) };
        BoardView { id: format!("v{:03}", index + 1), seen, stated_distance_mm: None }
    });
    let size = |device| Some(parameters(scanner, device).size_px);
    BoardObservations {
        size_px: PerDevice {
            left: size(DeviceName::Left),
            right: size(DeviceName::Right),
            projector: size(DeviceName::Projector),
        },
        views: views.collect(),
        pitch: (0..149).filter(|i| i % 15 != 14).map(|i| ([i, i + 1], square)).collect(),
        taken_at: None,
    }
}

/// Difference of estimate and truth in standard deviations, of every free parameter.
fn standardised(adjusted: &Adjusted, scanner: &Scanner) -> Vec<(String, f64)> {
    let mut out = Vec::new();
    for device in DeviceName::ALL {
        let (Some(found), truth) = (adjusted.lens[device], parameters(scanner, device)) else { continue };
        let sigma = adjusted.lens_sigma(device);
        for (index, (found, truth)) in found.values().into_iter().zip(truth.values()).enumerate() {
            let Some(sigma) = sigma[index] else { continue };
            out.push((format!("{} {}", device.as_str(), PARAMETER_NAMES[index]), (found - truth) / sigma));
        }
        let from_left = scanner.devices[device].scanner_from_device.inverse() * scanner.devices.left.scanner_from_device;
        let (truth, found) = (from_left.isometry(), &adjusted.device_from_left[device]);
        let Some(sigma) = adjusted.pose_sigma(device) else { continue };
        let turn = (found.rotation * truth.rotation.inverse()).scaled_axis();
        let shift = found.translation.vector - truth.translation.vector;
        for (axis, value) in turn.iter().chain(shift.iter()).enumerate() {
            out.push((format!("{} pose {axis}", device.as_str()), value / sigma[axis]));
        }
    }
    out
}

#[test]
fn noise_free_observations_give_the_rig_back() {
    let scanner = thesis();
    let adjusted = adjust(&observed(&scanner, 20, 0.0, 1), &AdjustOptions::default()).expect("a rig");
    for device in DeviceName::ALL {
        let (found, truth) = (adjusted.lens[device].expect("estimated"), parameters(&scanner, device));
        for (found, truth) in found.values().into_iter().zip(truth.values()) {
            assert!((found - truth).abs() <= 1e-5 * truth.abs().max(1.0), "{}: {found} {truth}", device.as_str());
        }
    }
    let baseline = adjusted.device_from_left.right.translation.vector.norm();
    assert!((baseline - scanner.baseline_mm()).abs() < 1e-5, "{baseline}");
    assert!(adjusted.is_converged, "{} steps down to rounding", adjusted.iterations);
}

#[test]
fn noise_of_a_tenth_of_a_pixel_leaves_every_parameter_within_three_standard_deviations() {
    let scanner = thesis();
    let observations = observed(&scanner, 40, 0.1, 7);
    let adjusted = adjust(&observations, &AdjustOptions::default()).expect("a rig");
    for device in DeviceName::ALL {
        let residuals = adjusted.devices[device].expect("residuals");
        assert!((residuals.sigma_px / 0.1 - 1.0).abs() < 0.02, "{}: σ {}", device.as_str(), residuals.sigma_px);
    }
    assert!(adjusted.is_converged, "{} steps", adjusted.iterations);
    let all = standardised(&adjusted, &scanner);
    for (name, off) in &all {
        println!("{name}: {off:.2} σ");
        assert!(off.abs() < 3.0, "{name} is off by {off} σ");
    }
    assert_eq!(all.len(), 42);
    let quality = quality(&observations, &adjusted);
    let (rms_mm, mean_mm, count) = quality.pitch.expect("pitch");
    println!(
        "epipolar {:?} px, pitch {rms_mm} ± {mean_mm} mm over {count}, coverage {:?}",
        quality.epipolar_rms_px, quality.coverage
    );
    // A perpendicular distance in two images of noise 0.1 each: their mean has about 0.1 √2 / 2 · √2.
    assert!((0.05..0.2).contains(&quality.epipolar_rms_px.expect("pairs")));
    assert!(rms_mm < 0.05 && mean_mm.abs() < 0.002 && count > 4000, "{rms_mm} {mean_mm} {count}");
    assert!(quality.views.iter().all(|view| view.leave_out.is_none()), "no view is bad");
    let draft = ScannerDraft::new(
        &Rig::from(&adjusted),
        &DraftFigures { field_mm: Some([300.0, 190.0, 480.0]), ..DraftFigures::default() },
        provenance(),
    )
    .expect("a draft");
    let found = draft.spec.build().expect("valid");
    let axis = |scanner: &Scanner| scanner.devices.projector.scanner_from_device.direction(&Vector3::z());
    let off_deg = axis(&found).angle(&axis(&scanner)).to_degrees();
    println!("baseline {} axes {} projector's axis off by {off_deg}°", draft.checks.baseline_mm, draft.checks.axes_angle_deg);
    assert!(off_deg < 0.05, "{off_deg}");
    let [width, height] = draft.checks.common_field.size_mm();
    let [true_width, true_height] = scanner.common_field_at(480.0).size_mm();
    assert!((width - true_width).abs() < 0.1 && (height - true_height).abs() < 0.1, "{width} × {height}");
    let [baseline_sigma, angle_sigma] = adjusted.rig_sigma();
    assert!((draft.checks.baseline_mm - scanner.baseline_mm()).abs() < 3.0 * baseline_sigma);
    assert!((draft.checks.axes_angle_deg - scanner.axes_angle_rad().to_degrees()).abs() < 3.0 * angle_sigma.to_degrees());
}

/// Normalised estimation error squared of all 42 unknowns together: χ² of 42 degrees if the covariance is true. 200 runs, 99 % band.
#[test]
#[ignore = "long: tests/all runs it"]
fn the_whole_covariance_is_true() {
    let scanner = thesis();
    let runs = 200;
    let (mut sum, mut lenses) = (0.0, 0.0);
    for run in 0..runs {
        let adjusted = adjust(&observed(&scanner, 10, 0.1, 5000 + run), &AdjustOptions::default()).expect("a rig");
        let off = errors(&adjusted, &scanner);
        let scale = nalgebra::DVector::from_fn(42, |row, _| adjusted.covariance[(row, row)].sqrt());
        let unit =
            nalgebra::DMatrix::from_fn(42, 42, |row, column| adjusted.covariance[(row, column)] / (scale[row] * scale[column]));
        let whitened = off.component_div(&scale);
        lenses += whitened.norm_squared() / 42.0 / runs as f64;
        sum += whitened.dot(&unit.cholesky().expect("positive").solve(&whitened)) / runs as f64;
    }
    println!("lens NEES of 42 over {runs} runs: {sum:.2}; mean square of single errors {lenses:.3}");
    // 42 ± 2.576 √(2 · 42 / 200).
    assert!((40.33..=43.67).contains(&sum), "{sum}");
}

/// Errors in the order of the covariance: ten of each lens, then turn and shift of right camera and projector.
fn errors(adjusted: &Adjusted, scanner: &Scanner) -> nalgebra::DVector<f64> {
    let mut all = Vec::new();
    for device in DeviceName::ALL {
        let (found, truth) = (adjusted.lens[device].expect("estimated"), parameters(scanner, device));
        all.extend(found.values().into_iter().zip(truth.values()).map(|(found, truth)| found - truth));
    }
    for device in [DeviceName::Right, DeviceName::Projector] {
        let from_left = scanner.devices[device].scanner_from_device.inverse() * scanner.devices.left.scanner_from_device;
        let (truth, found) = (from_left.isometry(), &adjusted.device_from_left[device]);
        all.extend((found.rotation * truth.rotation.inverse()).scaled_axis().iter());
        all.extend((found.translation.vector - truth.translation.vector).iter());
    }
    nalgebra::DVector::from_vec(all)
}

/// A board whose points lie off its plane z = 0 is told so.
#[test]
fn a_board_off_its_plane_is_told_so() {
    let mut observations = observed(&thesis(), 12, 0.0, 1);
    for sighting in observations.views.iter_mut().flat_map(|view| &mut view.seen.left) {
        sighting.board_mm.z = 3.0;
    }
    let error = adjust(&observations, &AdjustOptions::default()).expect_err("off its plane");
    assert_eq!((error.code, error.pointer.as_str()), (LensFault::TooFew, "/views/*/left"));
    assert!(error.detail.contains("lie up to 3 mm off z = 0"), "{error}");
}

#[test]
fn wrong_points_are_left_out_and_a_bad_view_is_named() {
    let scanner = thesis();
    let mut observations = observed(&scanner, 25, 0.1, 3);
    let mut random = Random(9);
    let mut wrong = [0, 0];
    for view in &mut observations.views {
        for sighting in view.seen.left.iter_mut().filter(|sighting| sighting.point == 17) {
            sighting.pixel += Vector2::new(8.0, -5.0);
            wrong[0] += 1;
        }
        for sighting in view.seen.projector.iter_mut().filter(|sighting| sighting.point == 40) {
            sighting.pixel += Vector2::new(-30.0, 4.0);
            wrong[1] += 1;
        }
    }
    // Moved while it was taken: every point of one device is off.
    for sighting in &mut observations.views[11].seen.right {
        sighting.pixel += Vector2::new(random.normal(), random.normal()) * 3.0;
    }
    let adjusted = adjust(&observations, &AdjustOptions::default()).expect("a rig");
    let dropped = |device: DeviceName, point: u32| {
        adjusted.residuals.iter().filter(|r| r.device == device && r.point == point && !r.is_used).count()
    };
    assert_eq!([dropped(DeviceName::Left, 17), dropped(DeviceName::Projector, 40)], wrong);
    assert!(wrong.iter().all(|count| *count > 5), "{wrong:?}");
    let bad: Vec<String> =
        quality(&observations, &adjusted).views.into_iter().filter(|view| view.leave_out.is_some()).map(|view| view.id).collect();
    assert_eq!(bad, ["v012"]);
    for (name, off) in standardised(&adjusted, &scanner) {
        assert!(off.abs() < 4.0, "{name} is off by {off} σ");
    }
}

/// One view with corners of another board, mirrored or in another order, ended the calibration: nothing fixed the board of a view
/// whose sightings were all left out.
#[test]
fn an_image_of_something_else_is_named_and_the_rest_is_solved() {
    let scanner = thesis();
    let good = observed(&scanner, 20, 0.1, 3);
    // By row and column of the board of 15 × 10 points.
    let renumbered = |seen: &mut Vec<DeviceSighting>, to: &dyn Fn(u32) -> u32| {
        seen.iter_mut().for_each(|sighting| {
            sighting.point = to(sighting.point);
            sighting.board_mm = Point3::new(f64::from(sighting.point % 15) * 16.0, f64::from(sighting.point / 15) * 16.0, 0.0);
        });
    };
    let mirrored = |number: u32| number / 15 * 15 + 14 - number % 15;
    // 37 has no factor in common with 150: each number comes once.
    let shuffled = |number: u32| number * 37 % 150;
    type Spoil<'a> = &'a dyn Fn(&mut BoardView);
    let cases: [(&str, Spoil<'_>); 4] = [
        ("another board", &|view| {
            for seen in [&mut view.seen.left, &mut view.seen.right, &mut view.seen.projector] {
                seen.iter_mut().for_each(|sighting| sighting.board_mm *= 0.75);
            }
        }),
        ("mirrored in one camera", &|view| renumbered(&mut view.seen.left, &mirrored)),
        ("shuffled in one camera", &|view| renumbered(&mut view.seen.left, &shuffled)),
        ("shuffled in both", &|view| {
            renumbered(&mut view.seen.left, &shuffled);
            renumbered(&mut view.seen.right, &shuffled);
        }),
    ];
    for (name, spoil) in cases {
        let mut observations = good.clone();
        spoil(&mut observations.views[7]);
        let adjusted = adjust(&observations, &AdjustOptions::default()).unwrap_or_else(|error| panic!("{name}: {error}"));
        println!("{name}: {:?}", adjusted.refused);
        assert!(adjusted.refused.iter().all(|(view, _)| *view == 7), "{name}: {:?}", adjusted.refused);
        for (parameter, off) in standardised(&adjusted, &scanner) {
            assert!(off.abs() < 5.0, "{name}: {parameter} is off by {off} σ");
        }
        let judged = quality(&observations, &adjusted);
        assert!(judged.refused.len() == 1 && judged.refused[0].0 == "v008", "{name}: {:?}", judged.refused);
        assert!(judged.pitch.expect("pitch").0 < 0.05, "{name}: the figures of the rig are those of the good images");
    }
    assert!(adjust(&good, &AdjustOptions::default()).expect("a rig").refused.is_empty());
}

#[test]
fn views_that_leave_a_parameter_open_are_refused() {
    let scanner = thesis();
    let few = BoardObservations { views: observed(&scanner, 2, 0.1, 5).views, ..observed(&scanner, 2, 0.1, 5) };
    assert_eq!(adjust(&few, &AdjustOptions::default()).expect_err("two views").code, LensFault::TooFew);
    // One pose of the board, taken ten times.
    let mut same = observed(&scanner, 1, 0.0, 5);
    same.views = (0..10).map(|_| same.views[0].clone()).collect();
    let error = adjust(&same, &AdjustOptions::default()).expect_err("one pose");
    assert!(matches!(error.code, LensFault::Degenerate | LensFault::NotConverged), "{error}");
}

#[test]
fn a_hundred_views_take_less_than_two_seconds() {
    let scanner = thesis();
    let mut observations = observed(&scanner, 100, 0.1, 11);
    for view in &mut observations.views {
        view.seen.left.truncate(100);
        view.seen.right.truncate(100);
        view.seen.projector.truncate(100);
    }
    let begin = std::time::Instant::now();
    adjust(&observations, &AdjustOptions::default()).expect("a rig");
    let elapsed = begin.elapsed();
    println!("100 views, 3 devices, 100 points: {elapsed:?}");
    // Ten times as long as on one free core, for machines that do other things too.
    assert!(elapsed.as_secs() < 20, "{elapsed:?}");
}

#[test]
fn derivatives_are_those_of_differences() {
    let lens = LensParameters {
        size_px: [4000, 3036],
        fx: 6668.0,
        fy: 6650.0,
        cx: 1990.0,
        cy: 1500.0,
        skew: 0.003,
        distortion: [-0.1, 0.2, 0.001, -0.002, 0.3],
    };
    let point = Point3::new(60.0, -35.0, 470.0);
    let (pixel, by) = lens.differentiate(&point);
    assert!((pixel - lens.project(&point)).norm() < 1e-9);
    for index in 0..10 {
        let mut values = lens.values();
        let step = 1e-6 * values[index].abs().max(1.0);
        values[index] += step;
        let slope = (lens.with_values(values).project(&point) - pixel) / step;
        assert!((slope - by.by_lens.column(index)).norm() < 1e-3 * slope.norm().max(1.0), "{}", PARAMETER_NAMES[index]);
    }
    for axis in 0..3 {
        let mut moved = point;
        moved[axis] += 1e-5;
        let slope = (lens.project(&moved) - pixel) / 1e-5;
        assert!((slope - by.by_point.column(axis)).norm() < 1e-3 * slope.norm().max(1.0), "axis {axis}");
    }
}

#[test]
fn a_projector_is_found_from_the_rectangle_that_it_lights() {
    let plane = |z: f64, width: f64, height: f64| LitPlaneSpec {
        z_mm: Some(z),
        size_mm: Some([width, height]),
        middle_mm: None,
        corners_mm: None,
    };
    // The thesis's 300 × 190 at 480 mm, from an apex at the scanner's origin.
    let planes = [410.0, 480.0, 565.0].map(|z| plane(z, 300.0 * z / 480.0, 190.0 * z / 480.0));
    let spec = LitRectangleSpec { width_px: 2000, height_px: 2000, planes: planes.to_vec() };
    let (device, device_from_scanner) = lit_rectangle(&spec).expect("a projector");
    assert!((device.lens.fx - 3200.0).abs() < 1e-5 && (device.lens.fy - 5_052.631_578_947).abs() < 1e-5, "{:?}", device.lens);
    assert!((device.lens.cx - 1000.0).abs() < 1e-5 && (device.lens.cy - 1000.0).abs() < 1e-5);
    assert!(device_from_scanner.translation.vector.norm() < 1e-5 && device_from_scanner.rotation.angle() < 1e-8);
    // A shifted lens, tilted and off the baseline, by corners as they were measured to 0.05 mm.
    let truth = LensParameters { cy: 1350.0, ..device.lens };
    let pose = Isometry3::new(Vector3::new(5.0, -40.0, 12.0), Vector3::new(0.2, -0.05, 0.01));
    let mut random = Random(4);
    let lit = |z: f64, random: &mut Random| {
        let corner = |u: f64, v: f64, random: &mut Random| {
            let ray = pose.inverse().rotation * truth.ray(&Vector2::new(u, v)).expect("a ray");
            let centre = pose.inverse().translation.vector;
            let at = centre + ray * ((z - centre.z) / ray.z);
            let noise = Vector3::new(random.normal(), random.normal(), random.normal()) * 0.05;
            <[f64; 3]>::from(at + noise)
        };
        let corners =
            [corner(0.0, 0.0, random), corner(2000.0, 0.0, random), corner(2000.0, 2000.0, random), corner(0.0, 2000.0, random)];
        LitPlaneSpec { z_mm: None, size_mm: None, middle_mm: None, corners_mm: Some(corners) }
    };
    let planes: Vec<LitPlaneSpec> = [400.0, 480.0, 560.0].into_iter().map(|z| lit(z, &mut random)).collect();
    let (device, found) = lit_rectangle(&LitRectangleSpec { planes, ..spec.clone() }).expect("a projector");
    let sigma = device.sigma.expect("twelve corners leave redundancy");
    for (index, (value, truth)) in device.lens.values().into_iter().zip(truth.values()).enumerate().take(4) {
        let sigma = sigma[index].expect("estimated");
        assert!((value - truth).abs() < 4.0 * sigma, "{}: {value} ± {sigma}, {truth}", PARAMETER_NAMES[index]);
    }
    assert!(found.rotation.angle_to(&pose.rotation).to_degrees() < 1.0);
    let one = LitRectangleSpec { planes: vec![plane(480.0, 300.0, 190.0)], ..spec.clone() };
    assert_eq!(lit_rectangle(&one).expect_err("one depth").code, LensFault::TooFew);
    let same = LitRectangleSpec { planes: vec![plane(480.0, 300.0, 190.0); 2], ..spec };
    assert_eq!(lit_rectangle(&same).expect_err("equal depths").code, LensFault::Degenerate);
}

#[test]
fn three_planes_say_where_working_distances_count_from() {
    let planes = |offset: f64, scale: f64| -> Vec<StatedPlane> {
        let plane = |(stated_mm, noise): (f64, f64)| StatedPlane { stated_mm, measured_mm: offset + scale * stated_mm + noise };
        [(410.0, 0.02), (480.0, -0.03), (565.0, 0.01)].into_iter().map(plane).collect()
    };
    let centres = depth_origin(&planes(0.3, 1.0), Some(25.0)).expect("an origin");
    assert_eq!(centres.datum, DepthDatum::OpticalCentres);
    assert!((centres.origin_mm - 0.3).abs() < 1e-9 && centres.sigma_mm < 0.05, "{centres:?}");
    assert_eq!(depth_origin(&planes(24.5, 1.0), Some(25.0)).expect("an origin").datum, DepthDatum::HousingFront);
    assert_eq!(depth_origin(&planes(60.0, 1.0), Some(25.0)).expect("an origin").datum, DepthDatum::Other);
    assert_eq!(depth_origin(&planes(0.0, 1.02), None).expect_err("not to scale").code, LensFault::UnitMismatch);
    assert_eq!(depth_origin(&planes(0.0, 1.0)[..2], None).expect_err("two").code, LensFault::TooFew);
    let same = [StatedPlane { stated_mm: 480.0, measured_mm: 480.0 }; 3];
    assert_eq!(depth_origin(&same, None).expect_err("one distance").code, LensFault::Degenerate);
}
