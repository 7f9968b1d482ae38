use nalgebra::{Point3, Vector2, Vector3};

use super::{Field, PerDevice, Scanner, ScannerSpec};

const CALIBRATED: &str = include_str!("../../../config/scanners/transcan-c.toml");
const NOMINAL: &str = include_str!("../../../config/scanners/transcan-c-nominal.toml");

fn spec(text: &str) -> ScannerSpec {
    toml::from_str(text).expect("the preset is TOML of a scanner")
}

fn scanner(text: &str) -> Scanner {
    spec(text).build().expect("the preset is consistent")
}

fn rigs() -> [Scanner; 2] {
    [CALIBRATED, NOMINAL].map(scanner)
}

fn close(a: f64, b: f64, tolerance: f64) {
    assert!((a - b).abs() <= tolerance, "{a} is not {b} ± {tolerance}");
}

fn interval_close(a: [f64; 2], b: [f64; 2]) {
    close(a[0], b[0], 0.6);
    close(a[1], b[1], 0.6);
}

#[test]
fn projection_inverts_unprojection_over_every_image() {
    for rig in rigs() {
        for device in &rig.devices {
            let lens = &device.lens;
            let mut worst = 0.0_f64;
            for i in 0..=100 {
                for j in 0..=100 {
                    // Edge to edge, but for what rounding could put outside.
                    let share = |k: i32| (f64::from(k) / 100.0).clamp(1e-14, 1.0 - 1e-14);
                    let pixel = Vector2::new(share(i) * lens.width_px, share(j) * lens.height_px);
                    let ray = lens.unproject(&pixel);
                    let again = lens.project(&Point3::from(ray * 480.0)).expect("a pixel of the image is seen");
                    worst = worst.max((again - pixel).norm());
                }
            }
            assert!(worst < 1e-9, "{} of {}: {worst} px", device.name.as_str(), rig.name);
        }
    }
}

#[test]
fn image_ends_where_its_pixels_end() {
    let lens = scanner(NOMINAL).devices.left.lens;
    let seen = |u: f64, v: f64| {
        let point = Point3::new((u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, 1.0);
        lens.project(&point).is_some()
    };
    assert!(seen(1e-9, 1e-9) && seen(3999.999, 3035.999));
    assert!(!seen(-1e-6, 100.0) && !seen(4000.001, 100.0) && !seen(100.0, -1e-6) && !seen(100.0, 3036.001));
    assert_eq!(lens.project(&Point3::new(0.0, 0.0, -480.0)), None, "behind the camera");
    assert_eq!(lens.project(&Point3::new(0.0, 0.0, 0.0)), None, "at the camera");
}

#[test]
fn skew_and_distortion_follow_bouguet() {
    // By hand for x = 0.2, y = -0.1: r² = 0.05.
    let mut wanted = spec(NOMINAL);
    wanted.left.skew = 0.01;
    wanted.left.distortion = [-0.1, 0.2, 0.001, -0.002, 0.3];
    let lens = wanted.build().expect("a mild lens").devices.left.lens;
    let radial = 1.0 - 0.1 * 0.05 + 0.2 * 0.0025 + 0.3 * 0.000125;
    let x = 0.2 * radial + 2.0 * 0.001 * 0.2 * -0.1 + -0.002 * (0.05 + 2.0 * 0.04);
    let y = -0.1 * radial + 0.001 * (0.05 + 2.0 * 0.01) + 2.0 * -0.002 * 0.2 * -0.1;
    let pixel = lens.project(&Point3::new(0.2, -0.1, 1.0)).expect("inside");
    close(pixel.x, 6668.0 * (x + 0.01 * y) + 2000.0, 1e-9);
    close(pixel.y, 6668.0 * y + 1518.0, 1e-9);
}

#[test]
fn points_far_outside_the_field_do_not_fold_back_into_the_image() {
    // r (1 - r² + 0.28 r⁴) rises, falls and rises again: at r = 1.4 it is back at 0.16, inside an image of radius 0.3.
    let mut wanted = spec(NOMINAL);
    wanted.left.distortion = [-1.0, 0.28, 0.0, 0.0, 0.0];
    let lens = wanted.build().expect("one-to-one within the field").devices.left.lens;
    let r = 1.4_f64;
    let folded = r * (1.0 - r * r + 0.28 * r.powi(4));
    assert!(folded.abs() * lens.fx < 2000.0, "the polynomial puts it inside: {folded}");
    assert_eq!(lens.project(&Point3::new(r, 0.0, 1.0)), None);
    assert!(lens.project(&Point3::new(0.2, 0.0, 1.0)).is_some());
}

#[test]
fn lens_that_folds_inside_its_image_is_refused() {
    let mut wanted = spec(NOMINAL);
    wanted.right.distortion = [-5.0, 0.0, 0.0, 0.0, 0.0];
    let errors = wanted.build().expect_err("r - 5 r³ turns at r = 0.26, inside the image");
    assert_eq!(errors.iter().map(|e| e.pointer.as_str()).collect::<Vec<_>>(), ["/right/distortion"]);
}

#[test]
fn calibrated_rig_has_the_figures_derived_from_its_board_poses() {
    let rig = scanner(CALIBRATED);
    close(rig.baseline_mm(), 209.94, 0.005);
    close(rig.axes_angle_rad().to_degrees(), 21.3, 0.05);
    let [left, right] = rig.devices.cameras().map(|camera| camera.scanner_from_device);
    close((left.origin_mm().coords + right.origin_mm().coords).norm(), 0.0, 1e-9);
    close((right.origin_mm() - left.origin_mm()).normalize().x, 1.0, 1e-12);
    let mean_axis = left.direction(&Vector3::z()) + right.direction(&Vector3::z());
    close(mean_axis.y, 0.0, 1e-12);
    assert!(mean_axis.z > 1.9, "both look along +z");
}

#[test]
fn board_poses_relate_the_cameras_as_they_relate_the_board() {
    // Without the rig's frame: a point of the board must come out at the same scanner position by way of each camera.
    let rig = scanner(CALIBRATED);
    let boards = spec(CALIBRATED).board_poses.expect("board poses");
    let [left, right] = rig.devices.cameras().map(|camera| camera.scanner_from_device);
    for point in [Vector3::new(0.0, 0.0, 0.0), Vector3::new(40.0, -30.0, 0.0), Vector3::new(-55.0, 20.0, 0.0)] {
        let camera = |board: &super::BoardPoseSpec| {
            let [a, b, c] = board.rotation_rows.map(Vector3::from);
            Point3::from(Vector3::new(a.dot(&point), b.dot(&point), c.dot(&point)) + Vector3::from(board.translation_mm))
        };
        let apart = left.point(&camera(&boards.left)) - right.point(&camera(&boards.right));
        // The printed rotations are orthonormal to 2e-5 only.
        assert!(apart.norm() < 0.01, "{apart}");
    }
}

#[test]
fn fields_at_480_mm_are_those_of_the_method() {
    let rig = scanner(CALIBRATED);
    let PerDevice { left, right, projector } = rig.devices.map(|device| device.field_at(480.0));
    interval_close(left.x_mm, [-168.0, 128.0]);
    interval_close(right.x_mm, [-162.0, 141.0]);
    interval_close(projector.x_mm, [-150.0, 150.0]);
    let cameras = left.common(&right);
    interval_close(cameras.x_mm, [-162.0, 128.0]);
    // Printed without its decimals.
    close(cameras.size_mm()[0], 289.5, 0.5);
    let common = rig.common_field_at(480.0);
    interval_close(common.x_mm, [-150.0, 128.0]);
    close(common.size_mm()[0], 278.0, 0.6);
    close(common.size_mm()[1], 190.0, 0.6);

    let nominal = scanner(NOMINAL).common_field_at(480.0);
    interval_close(nominal.x_mm, [-145.0, 145.0]);
    close(nominal.size_mm()[0], 289.5, 0.5);
    close(nominal.size_mm()[1], 190.0, 0.6);
}

#[test]
fn fields_end_where_projection_ends() {
    for rig in rigs() {
        let bow_mm = rig.measurement_volume().expect("a volume").bow_mm;
        for device in &rig.devices {
            let field: Field = device.field_at(480.0);
            let device_from_scanner = device.scanner_from_device.inverse();
            let sees = |x: f64, y: f64| device.lens.project(&device_from_scanner.point(&Point3::new(x, y, 480.0))).is_some();
            // The plane lies inside the bent side by at most the bow, seen at up to 12° here.
            let beyond = 1.2 * bow_mm + 1e-6;
            let name = device.name.as_str();
            for (at, out) in [(field.x_mm[0], -1.0), (field.x_mm[1], 1.0)] {
                assert!(sees(at - out * 1e-6, 0.0) && !sees(at + out * beyond, 0.0), "{name} x {at}");
            }
            for (at, out) in [(field.y_mm[0], -1.0), (field.y_mm[1], 1.0)] {
                assert!(sees(0.0, at - out * 1e-6) && !sees(0.0, at + out * beyond), "{name} y {at}");
            }
        }
    }
}

#[test]
fn angles_of_view_are_those_of_the_camera() {
    let [horizontal, vertical] = scanner(NOMINAL).devices.left.lens.field_of_view_rad().map(f64::to_degrees);
    close(horizontal, 33.4, 0.05);
    close(vertical, 25.66, 0.05);
}

mod depth_of_field {
    use super::super::{DepthOfField, hyperfocal_distance_mm};
    use super::close;

    /// Limits of sharpness from the blur circle itself: a point at distance z is imaged at v(z) = f z / (z − f); its
    /// circle on a sensor at v(x) behind an aperture f / Fe is aperture · |v(x) − v(z)| / v(z).
    fn blur_circle_mm(focal: f64, f_number: f64, focus: f64, z: f64) -> f64 {
        let image = |distance: f64| focal * distance / (distance - focal);
        focal / f_number * (image(focus) - image(z)).abs() / image(z)
    }

    #[test]
    fn limits_are_where_the_blur_circle_reaches_its_tolerance() {
        let (focal, f_number, circle, focus) = (12.336, 8.0, 0.0037, 480.0);
        let field = DepthOfField::at(focus, focal, circle * f_number);
        // The formula is the thin lens's with focus − f taken as focus: f / focus = 2.6 %.
        close(blur_circle_mm(focal, f_number, focus, focus - field.front_mm) / circle, 1.0, 0.03);
        close(blur_circle_mm(focal, f_number, focus, focus + field.rear_mm) / circle, 1.0, 0.03);
        assert!(field.rear_mm > field.front_mm, "the field behind the focus is the larger one");
    }

    #[test]
    fn rear_is_infinite_from_the_hyperfocal_distance_on() {
        let (focal, blur) = (12.336, 0.03);
        let hyperfocal = hyperfocal_distance_mm(focal, blur);
        close(hyperfocal, 12.336 * 12.336 / 0.03, 1e-9);
        assert!(DepthOfField::at(hyperfocal * 0.999, focal, blur).rear_mm.is_finite());
        assert_eq!(DepthOfField::at(hyperfocal * 1.001, focal, blur).rear_mm, f64::INFINITY);
        // Focused there, sharpness begins at half the distance.
        close(DepthOfField::at(hyperfocal, focal, blur).front_mm, hyperfocal / 2.0, 1e-6);
    }

    #[test]
    fn blur_is_recovered_from_either_side() {
        let [front, rear] = DepthOfField::at(480.0, 12.336, 0.05).blur_mm(480.0, 12.336);
        close(front, 0.05, 1e-12);
        close(rear, 0.05, 1e-12);
    }
}

mod volume {
    use nalgebra::{Point3, Vector3};

    use super::super::Scanner;
    use super::{close, rigs};

    /// SplitMix64 (Steele, Lea and Flood, 2014), for points that are the same on every run.
    struct Random(u64);

    impl Random {
        fn unit(&mut self) -> f64 {
            self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = self.0;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
        }

        fn within(&mut self, low: &Point3<f64>, high: &Point3<f64>) -> Point3<f64> {
            let size = high - low;
            low + Vector3::new(self.unit() * size.x, self.unit() * size.y, self.unit() * size.z)
        }
    }

    fn measured_by_projection(rig: &Scanner, p: &Point3<f64>) -> bool {
        rig.near_mm <= p.z
            && p.z <= rig.far_mm
            && rig.devices.iter().all(|d| d.lens.project(&d.scanner_from_device.inverse().point(p)).is_some())
    }

    #[test]
    fn polytope_agrees_with_monte_carlo_over_the_devices_themselves() {
        const POINTS: u32 = 200_000;
        for rig in rigs() {
            let volume = rig.measurement_volume().expect("a volume");
            let (low, high) = (Point3::new(-200.0, -150.0, 400.0), Point3::new(200.0, 150.0, 580.0));
            let mut random = Random(1);
            let (mut seen, mut held_unseen) = (0_u32, 0_u32);
            for _ in 0..POINTS {
                let p = random.within(&low, &high);
                let by_projection = measured_by_projection(&rig, &p);
                seen += u32::from(by_projection);
                held_unseen += u32::from(volume.polytope.holds(&p) && !by_projection);
            }
            assert_eq!(held_unseen, 0, "{}: the polytope lies inside what is seen", rig.name);
            let size = high - low;
            let share = f64::from(seen) / f64::from(POINTS);
            let sampled = share * size.product();
            // Three standard deviations of the count, and what the bent sides hold outside their planes.
            let sigma = (share * (1.0 - share) / f64::from(POINTS)).sqrt() * size.product();
            let bent = volume.bow_mm * 155.0 * 2.0 * (300.0 + 200.0);
            assert!(volume.polytope.volume_mm3 <= sampled + 3.0 * sigma, "{}", rig.name);
            assert!(volume.polytope.volume_mm3 >= sampled - 3.0 * sigma - bent, "{}", rig.name);
            assert!(bent < 0.02 * sampled, "{}: the bow of {} mm matters little", rig.name, volume.bow_mm);
        }
    }

    #[test]
    fn nominal_rig_has_no_bow() {
        let [_, nominal] = rigs();
        assert!(nominal.measurement_volume().expect("a volume").bow_mm < 1e-9);
    }

    #[test]
    fn cuboid_is_inside_and_touches() {
        for rig in rigs() {
            let volume = rig.measurement_volume().expect("a volume");
            for size in [volume.largest_cuboid_mm, Vector3::repeat(volume.largest_cube_mm)] {
                let corner = |scale: f64, i: u32| {
                    let sign = |bit: u32| if i >> bit & 1 == 0 { -0.5 } else { 0.5 };
                    rig.best_focus_mm() + size.component_mul(&Vector3::new(sign(0), sign(1), sign(2))) * scale
                };
                for i in 0..8 {
                    assert!(measured_by_projection(&rig, &corner(1.0 - 1e-9, i)), "{} corner {i}", rig.name);
                }
                // 1e-4 larger it leaves the polytope.
                assert!((0..8).any(|i| !volume.polytope.holds(&corner(1.0 + 1e-4, i))), "{} touches", rig.name);
            }
            let side = volume.largest_cube_mm;
            assert!(volume.largest_cuboid_mm.product() >= side.powi(3));
        }
    }

    #[test]
    fn practical_box_leaves_the_frusta_at_its_near_face() {
        // The 260 wide practical box leaves the frusta at its near face.
        for rig in rigs() {
            let [x, _, z] = rig.practical_volume_mm;
            let near = rig.best_mm - z / 2.0;
            let super::PerDevice { left, right, projector } = rig.devices.map(|d| d.field_at(near).x_mm);
            assert!(left[1] < x / 2.0 && right[0] > -x / 2.0, "{}: {left:?} {right:?}", rig.name);
            // 300 mm at 480 mm leave 256 mm at 410 mm.
            close(projector[1], 150.0 * near / rig.best_mm, 1e-9);
        }
    }

    #[test]
    fn common_field_is_as_high_as_the_projectors() {
        let [_, nominal] = rigs();
        close(nominal.common_field_at(nominal.near_mm).size_mm()[1], 190.0 * 410.0 / 480.0, 1e-6);
    }
}

mod refusals {
    use super::{CALIBRATED, NOMINAL, spec};
    use crate::cell::ScannerSpec;

    /// Pointers of everything that is wrong once `change` is made to the nominal preset.
    fn refused(text: &str, change: impl FnOnce(&mut ScannerSpec)) -> Vec<String> {
        let mut changed = spec(text);
        change(&mut changed);
        let errors = changed.build().expect_err("this specification must be refused");
        errors.into_iter().map(|error| error.pointer).collect()
    }

    type Change = (&'static str, fn(&mut ScannerSpec));

    #[test]
    fn every_field_out_of_range_is_named() {
        let changes: &[Change] = &[
            ("/name", |s| s.name.clear()),
            ("/mass_kg", |s| s.mass_kg = 0.0),
            ("/mass_kg", |s| s.mass_kg = f64::NAN),
            ("/practical_volume_mm/2", |s| s.practical_volume_mm[2] = 0.5),
            ("/stated_volume_mm/0", |s| s.stated_volume_mm = Some([0.0, 1.0, 1.0])),
            ("/block_cube_mm", |s| s.block_cube_mm = Some(10_001.0)),
            ("/depth_mm/near", |s| s.depth_mm.near = 0.0),
            ("/depth_mm/far", |s| s.depth_mm.far = 20_000.0),
            ("/depth_mm", |s| s.depth_mm.near = 480.0),
            ("/depth_mm", |s| s.depth_mm.far = 470.0),
            ("/left/width_px", |s| (s.left.width_px, s.left.cx) = (15, 7.0)),
            ("/right/height_px", |s| s.right.height_px = 100_001),
            ("/projector/fx", |s| s.projector.fx = 0.5),
            ("/left/fy", |s| s.left.fy = f64::NAN),
            ("/right/cx", |s| s.right.cx = 4000.5),
            ("/left/cy", |s| s.left.cy = -1.0),
            ("/projector/skew", |s| s.projector.skew = 0.2),
            ("/left/distortion/4", |s| s.left.distortion[4] = 11.0),
            ("/right/incidence_max_deg", |s| s.right.incidence_max_deg = 90.0),
            ("/left/pixel_pitch_um", |s| s.left.pixel_pitch_um = Some(0.0)),
            ("/left/scanner_from_device", |s| s.left.scanner_from_device = None),
            ("/right/scanner_from_device/quaternion_xyzw", |s| {
                s.right.scanner_from_device.as_mut().expect("nominal").quaternion_xyzw = [0.0, 0.0, 0.0, 0.9];
            }),
            ("/right/scanner_from_device/translation_mm/2", |s| {
                s.right.scanner_from_device.as_mut().expect("nominal").translation_mm[2] = 1e6;
            }),
            ("/body/0/name", |s| s.body[0].name.clear()),
        ];
        for (pointer, change) in changes {
            assert_eq!(refused(NOMINAL, change), [*pointer]);
        }
    }

    #[test]
    fn board_poses_are_checked() {
        let boards = |s: &mut ScannerSpec| s.board_poses.expect("calibrated");
        assert_eq!(
            refused(CALIBRATED, |s| s.board_poses.as_mut().expect("calibrated").left.rotation_rows[0][0] = 0.9),
            ["/board_poses/left/rotation_rows"]
        );
        assert_eq!(
            refused(CALIBRATED, |s| s.board_poses.as_mut().expect("calibrated").right.rotation_rows[2] = [f64::NAN; 3]),
            ["/board_poses/right/rotation_rows"]
        );
        // A mirror is orthonormal and no rotation.
        assert_eq!(
            refused(CALIBRATED, |s| {
                let rows = &mut s.board_poses.as_mut().expect("calibrated").left.rotation_rows;
                rows[0] = rows[0].map(|c| -c);
            }),
            ["/board_poses/left/rotation_rows"]
        );
        assert_eq!(refused(CALIBRATED, |s| s.board_poses.as_mut().expect("calibrated").right = boards(s).left), ["/board_poses"]);
        assert_eq!(
            refused(CALIBRATED, |s| s.left.scanner_from_device = Some(crate::cell::PoseSpec::default())),
            ["/left/scanner_from_device"]
        );
    }

    #[test]
    fn a_focal_length_in_millimetres_is_refused_with_the_one_in_pixels() {
        let changes: &[Change] = &[
            ("/left/fx", |s| s.left.fx = 16.0),
            ("/right/fy", |s| s.right.fy = 16.0),
            ("/projector/fx", |s| s.projector.fx = 35.0),
        ];
        for (pointer, change) in changes {
            assert_eq!(refused(NOMINAL, change), [*pointer]);
        }
        let detail = |pitch_um: Option<f64>| {
            let mut changed = spec(NOMINAL);
            (changed.left.fx, changed.left.pixel_pitch_um) = (16.0, pitch_um);
            changed.build().expect_err("refused").remove(0).detail
        };
        let told = detail(Some(1.85));
        for part in ["is 16 px", "4000 px show 179.1 °", "allowed is 536 to 1000000 px", "16 mm at 1.85 µm a pixel are 8648.6 px"]
        {
            assert!(told.contains(part), "{part:?} is not in {told}");
        }
        assert!(detail(None).contains("divide it by the pixel pitch in mm"));
        // A wide lens is one: 4000 px at 540 px show 149.8°.
        assert!(!refused(NOMINAL, |s| (s.left.fx, s.name) = (540.0, String::new())).contains(&"/left/fx".to_owned()));
    }

    #[test]
    fn the_block_cube_is_the_largest_in_the_practical_volume_unless_given() {
        let edge_mm = |given: Option<f64>| {
            let mut changed = spec(NOMINAL);
            (changed.block_cube_mm, changed.practical_volume_mm) = (given, [260.0, 165.0, 120.0]);
            changed.build().expect("valid").block_cube_mm
        };
        assert_eq!((edge_mm(None), edge_mm(Some(90.0))), (120.0, 90.0));
    }

    #[test]
    fn rig_that_contradicts_itself_is_refused() {
        // Cameras swapped.
        assert_eq!(
            refused(NOMINAL, |s| std::mem::swap(&mut s.left.scanner_from_device, &mut s.right.scanner_from_device)),
            ["/right/scanner_from_device"]
        );
        // A camera turned away sees nothing of the working volume.
        assert_eq!(
            refused(NOMINAL, |s| {
                s.left.scanner_from_device.as_mut().expect("nominal").quaternion_xyzw = [0.0, 1.0, 0.0, 0.0];
            }),
            ["/left"]
        );
    }

    #[test]
    fn unknown_fields_are_refused() {
        let error = toml::from_str::<ScannerSpec>(&format!("colour = \"white\"\n{NOMINAL}")).expect_err("no such field");
        assert!(error.to_string().contains("colour"), "{error}");
    }
}

mod working_depth {
    use nalgebra::{Point3, Vector3};

    use super::super::{DepthBoundSource, ScannerSpec};
    use super::{CALIBRATED, NOMINAL, close, rigs, scanner, spec};

    fn pointers(spec: &ScannerSpec) -> Vec<String> {
        spec.build().expect_err("must be refused").into_iter().map(|error| error.pointer).collect()
    }

    #[test]
    fn presets_have_the_practical_limit_alone() {
        for rig in rigs() {
            let bounds = rig.depth_bounds();
            assert_eq!(bounds.len(), 1);
            assert_eq!((bounds[0].source, bounds[0].on_axis_mm), (DepthBoundSource::Practical, [410.0, 565.0]));
            assert!(rig.devices.iter().all(|device| !device.has_focus_limit()));
        }
    }

    #[test]
    fn a_projector_in_focus_over_less_depth_cuts_the_volume() {
        let mut wanted = spec(NOMINAL);
        wanted.projector.in_focus_mm = Some([430.0, 540.0]);
        let rig = wanted.build().expect("valid");
        let bounds = rig.depth_bounds();
        assert_eq!((bounds[1].source, bounds[1].on_axis_mm), (DepthBoundSource::Projector, [430.0, 540.0]));
        let volume = rig.measurement_volume().expect("a volume");
        let depths = || volume.polytope.vertices_mm.iter().map(|vertex| vertex.z);
        close(depths().fold(f64::INFINITY, f64::min), 430.0, 1e-6);
        close(depths().fold(0.0, f64::max), 540.0, 1e-6);
    }

    #[test]
    fn the_working_depth_is_what_all_limits_leave() {
        assert_eq!(scanner(NOMINAL).working_depth_mm(), [410.0, 565.0]);
        let mut wanted = spec(NOMINAL);
        wanted.projector.in_focus_mm = Some([430.0, 600.0]);
        wanted.left.in_focus_mm = Some([300.0, 520.0]);
        let rig = wanted.build().expect("valid");
        let [near, far] = rig.working_depth_mm();
        let left = rig.devices.left.scanner_from_device.inverse();
        close(near, 430.0, 1e-9);
        close(left.point(&Point3::new(0.0, 0.0, far)).z, 520.0, 1e-9);
        for (depth, is_in) in [(far - 0.01, true), (far + 0.01, false), (429.9, false), (480.0, true)] {
            assert_eq!(rig.is_in_depth(&Point3::new(0.0, 0.0, depth)), is_in, "{depth}");
        }
    }

    #[test]
    fn the_slab_of_a_camera_is_square_to_its_own_axis() {
        let mut wanted = spec(CALIBRATED);
        (wanted.left.f_number, wanted.left.circle_of_confusion_um) = (Some(8.0), Some(9.0));
        let rig = wanted.build().expect("valid");
        let left = &rig.devices.left;
        let device_from_scanner = left.scanner_from_device.inverse();
        let at = |z: f64| device_from_scanner.point(&Point3::new(0.0, 0.0, z)).z;
        // By the formulas: b = δ·Fe, f = fx·pitch.
        let (focus, focal, b) = (at(480.0), (wanted.left.fx * wanted.left.fy).sqrt() * 0.00185, 0.009 * 8.0);
        close(left.in_focus_mm[0], focus - b * focus * focus / (focal * focal + b * focus), 1e-9);
        close(left.in_focus_mm[1], focus + b * focus * focus / (focal * focal - b * focus), 1e-9);
        let bound = rig.depth_bounds()[1];
        close(at(bound.on_axis_mm[0]), left.in_focus_mm[0], 1e-9);
        close(at(bound.on_axis_mm[1]), left.in_focus_mm[1], 1e-9);
        // The slab is tilted against the scanner's, so that less depth is sharp over the whole field.
        let lost = bound.over_field_mm[0] - bound.on_axis_mm[0] + bound.on_axis_mm[1] - bound.over_field_mm[1];
        let slope = left.scanner_from_device.direction(&Vector3::z());
        let [width, height] = rig.common_field_at(480.0).size_mm();
        close(lost, width * (slope.x / slope.z).abs() + height * (slope.y / slope.z).abs(), 1e-6);
        let volume = rig.measurement_volume().expect("a volume");
        let off = |vertex: &Point3<f64>| {
            let depth = device_from_scanner.point(vertex).z;
            (left.in_focus_mm[0] - depth).max(depth - left.in_focus_mm[1])
        };
        assert!(volume.polytope.vertices_mm.iter().map(off).fold(f64::NEG_INFINITY, f64::max) < 1e-6);
    }

    #[test]
    fn working_distances_may_count_from_the_front_of_the_housing() {
        let mut wanted = spec(NOMINAL);
        wanted.depth_origin_mm = Some(20.0);
        let rig = wanted.build().expect("valid");
        assert_eq!((rig.near_mm, rig.best_mm, rig.far_mm), (430.0, 500.0, 585.0));
        assert_eq!(scanner(NOMINAL).best_mm, 480.0);
    }

    #[test]
    fn what_contradicts_itself_is_named() {
        let mut wanted = spec(NOMINAL);
        wanted.left.f_number = Some(8.0);
        assert_eq!(pointers(&wanted), ["/left/circle_of_confusion_um"]);
        wanted.left.circle_of_confusion_um = Some(9.0);
        wanted.left.in_focus_mm = Some([400.0, 500.0]);
        assert_eq!(pointers(&wanted), ["/left/in_focus_mm"]);
        let mut wanted = spec(NOMINAL);
        wanted.projector.in_focus_mm = Some([500.0, 600.0]);
        assert_eq!(pointers(&wanted), ["/projector"], "best focus is not in it");
        wanted.projector.in_focus_mm = Some([600.0, 500.0]);
        assert_eq!(pointers(&wanted), ["/projector/in_focus_mm"]);
        let mut wanted = spec(NOMINAL);
        (wanted.left.cy, wanted.projector.cy, wanted.depth_origin_mm) = (-1.0, -4001.0, Some(1e4));
        assert_eq!(pointers(&wanted), ["/left/cy", "/projector/cy", "/depth_origin_mm"]);
    }

    #[test]
    fn a_projector_with_a_shifted_lens_is_accepted() {
        let mut wanted = spec(NOMINAL);
        // Its picture is above its axis: turned down by as much, it still lights the middle of the field.
        wanted.projector.cy = -500.0;
        let tilt = ((1000.0_f64 + 500.0) / wanted.projector.fy).atan();
        let pose = wanted.projector.scanner_from_device.as_mut().expect("a pose");
        let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), tilt);
        pose.quaternion_xyzw = [turn.i, turn.j, turn.k, turn.w];
        let rig = wanted.build().expect("valid");
        assert!(rig.common_field_at(480.0).size_mm()[1] > 100.0);
    }
}
