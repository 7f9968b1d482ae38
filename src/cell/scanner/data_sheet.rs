//! A scanner from the figures of a data sheet: field, working distance, working depth, baseline.
//!
//! Model: three pinholes without distortion ([`crate::planning::method::scanner`]). The viewpoint is the middle of the baseline and
//! the scanner's +z axis meets the middle of the field, P = (0, 0, d), at the working distance d. The cameras' optical centres are
//! C = (∓b/2, 0, 0), b the baseline; each optical axis goes through P, so that the cameras converge by α = atan(b / 2d) each. The
//! projector stands at the viewpoint, or where it is said to, and looks at P too. No device is rolled: its x axis lies in the
//! plane of its optical axis and the scanner's x.
//!
//! The field W × H is the rectangle (±W/2, ±H/2, d). A focal length is the longest with which the whole rectangle is in the image:
//! with (X, Y, Z) a corner of it in the device frame, mm, and w × h the image, px,
//!
//! ```text
//! f_x = (w / 2) / max |X / Z|        f_y = (h / 2) / max |Y / Z|        c = (w / 2, h / 2)
//! ```
//!
//! So the three fields have W × H in common at d, which is the field of the data sheet. The practical volume is the field at the
//! near end n of the working depth n … f, by similar triangles, over its whole length: W n/d × H n/d × (f − n). (For the TransCAN C,
//! 300 × 190 mm at 480, 410 … 565 mm, these are 256 × 162 × 155; its maker's practical volume is 260 × 165 × 140.) The block
//! cube is left to its default. A data sheet has no limits of incidence; the defaults here are cautious.

use nalgebra::{Point3, Rotation3, UnitQuaternion, Vector3};

use super::spec::{DepthSpec, DeviceSpec, ScannerSpec};
use crate::cell::field_error::{FieldError, Findings};
use crate::cell::pose_spec::PoseSpec;
use crate::cell::shape_spec::{BodySpec, ShapeSpec};
use crate::geometry::{Device, Pose, ScannerFrame};

/// Largest field and baseline, in working distances: beyond it a pinhole would have to show more than a lens does.
const MAX_WIDTH_OF_DISTANCE: f64 = 3.0;
/// Width by which the housing exceeds the baseline, both sides together, mm.
const HOUSING_BESIDE_MM: f64 = 100.0;
/// Height and depth of the housing, mm, as of the TransCAN C.
const HOUSING_MM: [f64; 2] = [130.0, 110.0];

/// Figures of a data sheet. Lengths are millimetres, angles degrees.
#[derive(Clone, Debug, PartialEq)]
pub struct DataSheet {
    /// Name of the scanner.
    pub name: String,
    /// Width and height of the field at the working distance.
    pub field_mm: [f64; 2],
    /// Working distance: from the middle of the baseline to the depth of best focus.
    pub at_mm: f64,
    /// Nearest and farthest working depth.
    pub depth_mm: [f64; 2],
    /// Distance between the cameras' optical centres.
    pub baseline_mm: f64,
    /// Width and height of the cameras' images, px.
    pub camera_px: [u32; 2],
    /// Width and height of the projector's image, px.
    pub projector_px: [u32; 2],
    /// Optical centre of the projector, scanner frame.
    pub projector_mm: [f64; 3],
    /// Largest incidence of the cameras.
    pub camera_incidence_deg: f64,
    /// Largest incidence of the projector.
    pub projector_incidence_deg: f64,
    /// Mass, kg.
    pub mass_kg: f64,
    /// Width, height and depth of the housing, whose front is at the baseline. Default: 100 mm wider than the baseline, 130 high and
    /// 110 deep.
    pub housing_mm: Option<[f64; 3]>,
    /// Distance between the cameras' pixels, µm.
    pub pixel_pitch_um: Option<f64>,
}

impl DataSheet {
    /// A sheet of the figures that have no default.
    #[must_use]
    pub fn new(field_mm: [f64; 2], at_mm: f64, depth_mm: [f64; 2], baseline_mm: f64) -> Self {
        Self {
            name: "my-scanner".to_owned(),
            field_mm,
            at_mm,
            depth_mm,
            baseline_mm,
            camera_px: [2448, 2048],
            projector_px: [1920, 1200],
            projector_mm: [0.0; 3],
            camera_incidence_deg: 60.0,
            projector_incidence_deg: 55.0,
            mass_kg: 3.0,
            housing_mm: None,
            pixel_pitch_um: None,
        }
    }

    /// The specification.
    ///
    /// # Errors
    /// All figures that are out of range or contradict each other, each at the name of its option.
    pub fn spec(&self) -> Result<ScannerSpec, Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check(&mut findings);
        findings.into_result()?;
        let half = 0.5 * self.baseline_mm;
        let camera = |x_mm: f64| self.device([x_mm, 0.0, 0.0], self.camera_px, self.camera_incidence_deg, self.pixel_pitch_um);
        let [near, far] = self.depth_mm;
        let [width, height] = self.field_mm.map(|edge_mm| edge_mm * near / self.at_mm);
        let spec = ScannerSpec {
            name: self.name.clone(),
            depth_mm: DepthSpec { near, best: self.at_mm, far },
            left: camera(-half),
            right: camera(half),
            projector: self.device(self.projector_mm, self.projector_px, self.projector_incidence_deg, None),
            board_poses: None,
            scanner_from_cloud: None,
            mass_kg: self.mass_kg,
            centre_of_mass_mm: None,
            body: vec![self.housing()],
            stated_volume_mm: None,
            practical_volume_mm: [width, height, far - near],
            block_cube_mm: None,
            depth_origin_mm: None,
            exposure: None,
            calibrated: None,
        };
        spec.build().map(|_| spec)
    }

    /// Edge lengths of the housing.
    #[must_use]
    pub fn housing_mm(&self) -> [f64; 3] {
        let [height, depth] = HOUSING_MM;
        self.housing_mm.unwrap_or([self.baseline_mm + HOUSING_BESIDE_MM, height, depth])
    }

    fn housing(&self) -> BodySpec {
        let size_mm = self.housing_mm();
        BodySpec {
            name: "scanner body".to_owned(),
            owner_from_body: PoseSpec { translation_mm: [0.0, 0.0, -0.5 * size_mm[2]], ..PoseSpec::default() },
            shape: ShapeSpec::Box { size_mm },
        }
    }

    /// The pinhole at `centre_mm` that looks at the middle of the field and has all of it in its image.
    fn device(&self, centre_mm: [f64; 3], size_px: [u32; 2], incidence_max_deg: f64, pixel_pitch_um: Option<f64>) -> DeviceSpec {
        let (centre, target) = (Vector3::from(centre_mm), Vector3::new(0.0, 0.0, self.at_mm));
        let z = (target - centre).normalize();
        let x = (Vector3::x() - z * z.x).normalize();
        let axes = Rotation3::from_basis_unchecked(&[x, z.cross(&x), z]);
        let pose: Pose<ScannerFrame, Device> = Pose::from_parts(centre, UnitQuaternion::from_rotation_matrix(&axes));
        let [u, v] = self.widest_slopes(&pose);
        let [width, height] = size_px.map(f64::from);
        DeviceSpec {
            scanner_from_device: Some(PoseSpec::from(&pose)),
            width_px: size_px[0],
            height_px: size_px[1],
            fx: 0.5 * width / u,
            fy: 0.5 * height / v,
            cx: 0.5 * width,
            cy: 0.5 * height,
            skew: 0.0,
            distortion: [0.0; 5],
            incidence_max_deg,
            pixel_pitch_um,
            f_number: None,
            circle_of_confusion_um: None,
            focus_mm: None,
            in_focus_mm: None,
        }
    }

    /// Largest |X / Z| and |Y / Z| of the field's corners in a device's frame; infinite where one is not in front of the device.
    fn widest_slopes(&self, pose: &Pose<ScannerFrame, Device>) -> [f64; 2] {
        let [half_width, half_height] = self.field_mm.map(|edge_mm| 0.5 * edge_mm);
        let corners = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
        corners.into_iter().fold([0.0; 2], |[u, v], (right, down): (f64, f64)| {
            let corner = pose.inverse().point(&Point3::new(right * half_width, down * half_height, self.at_mm));
            let slope = |across: f64| if corner.z > 0.0 { (across / corner.z).abs() } else { f64::INFINITY };
            [u.max(slope(corner.x)), v.max(slope(corner.y))]
        })
    }

    fn check(&self, findings: &mut Findings) {
        findings.require(!self.name.is_empty(), "--name", || "is empty; name the scanner".into());
        findings.range("--at", self.at_mm, 1.0, 1e4, "mm");
        let ([near, far], at) = (self.depth_mm, self.at_mm);
        // What depends on another figure is checked where that one is in range: the first error is the one to mend.
        let is_distance = |mm: f64| (1.0..=1e4).contains(&mm);
        let max_mm = if is_distance(at) { MAX_WIDTH_OF_DISTANCE * at } else { MAX_WIDTH_OF_DISTANCE * 1e4 };
        for edge_mm in self.field_mm {
            findings.range("--field", edge_mm, 1.0, max_mm, "mm");
        }
        findings.range("--depth", near, 1.0, 1e4, "mm");
        findings.range("--depth", far, 1.0, 1e4, "mm");
        let are_distances = [near, at, far].into_iter().all(is_distance);
        findings.require(!are_distances || (near < at && at < far), "--depth", || {
            if near > far {
                return format!("is {near}..{far} mm; the near end must be less than the far end; did you mean {far}..{near}?");
            }
            format!("is {near}..{far} mm; the working distance --at {at} mm must lie between the two")
        });
        findings.range("--baseline", self.baseline_mm, 1.0, max_mm, "mm");
        for (option, size_px) in [("--resolution", self.camera_px), ("--projector-resolution", self.projector_px)] {
            for px in size_px {
                findings.range(option, f64::from(px), 16.0, 1e5, "px");
            }
        }
        // In front of the field, so that the device can look at it.
        let [x, y, z] = self.projector_mm;
        findings.range("--projector", x, -5000.0, 5000.0, "mm");
        findings.range("--projector", y, -5000.0, 5000.0, "mm");
        findings.range("--projector", z, -5000.0, 0.5 * near.clamp(1.0, 1e4), "mm");
        findings.range("--camera-incidence", self.camera_incidence_deg, 1.0, 89.9, "°");
        findings.range("--projector-incidence", self.projector_incidence_deg, 1.0, 89.9, "°");
        findings.range("--mass", self.mass_kg, 0.01, 100.0, "kg");
        for edge_mm in self.housing_mm.into_iter().flatten() {
            findings.range("--housing", edge_mm, 1.0, 5000.0, "mm");
        }
        if let Some(pitch_um) = self.pixel_pitch_um {
            findings.range("--pixel-pitch", pitch_um, 0.1, 100.0, "µm");
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::DataSheet;
    use crate::cell::ScannerSpec;

    fn sheet() -> DataSheet {
        DataSheet::new([300.0, 200.0], 500.0, [440.0, 560.0], 200.0)
    }

    #[test]
    fn all_three_devices_see_the_field_and_the_cameras_no_more_than_it_asks() {
        for projector_mm in [[0.0; 3], [30.0, -60.0, 10.0]] {
            let scanner = DataSheet { projector_mm, ..sheet() }.spec().expect("valid").build().expect("valid");
            let inside = |x: f64, y: f64| {
                let point = Point3::new(x, y, 500.0);
                scanner.devices.iter().all(|d| d.lens.project(&d.scanner_from_device.inverse().point(&point)).is_some())
            };
            for (x, y) in [(149.9, 99.9), (-149.9, 99.9), (149.9, -99.9), (-149.9, -99.9), (0.0, 0.0)] {
                assert!(inside(x, y), "({x}, {y}) with the projector at {projector_mm:?}");
            }
            // The sides of the cameras' common field are those of the data sheet.
            assert!(!inside(150.1, 0.0) && !inside(-150.1, 0.0));
            let [width, height] = scanner.common_field_at(500.0).size_mm();
            assert!((width - 300.0).abs() < 1e-6 && (199.9..230.0).contains(&height), "{width} × {height}");
        }
    }

    #[test]
    fn the_cameras_converge_on_the_working_distance() {
        let scanner = sheet().spec().expect("valid").build().expect("valid");
        assert!((scanner.baseline_mm() - 200.0).abs() < 1e-9);
        // 2 · atan(100 / 500).
        assert!((scanner.axes_angle_rad().to_degrees() - 22.6199).abs() < 1e-3);
        for camera in scanner.devices.cameras() {
            let axis = camera.scanner_from_device.direction(&Vector3::z());
            let centre = camera.scanner_from_device.origin_mm();
            let met = centre + axis * (500.0 / axis.z);
            assert!(met.coords.xy().norm() < 1e-9, "{met}");
        }
        assert_eq!((scanner.near_mm, scanner.best_mm, scanner.far_mm), (440.0, 500.0, 560.0));
        assert!(scanner.measurement_volume().is_some());
    }

    #[test]
    fn the_sheet_of_the_transcan_gives_its_nominal_preset() {
        let figures = DataSheet {
            camera_px: [4000, 3036],
            projector_px: [2000, 2000],
            ..DataSheet::new([300.0, 190.0], 480.0, [410.0, 565.0], 202.0)
        };
        let spec = figures.spec().expect("valid");
        let preset: ScannerSpec =
            toml::from_str(include_str!("../../../config/scanners/transcan-c-nominal.toml")).expect("a preset");
        // Its projector is exactly this; its cameras see a little more than the field.
        assert!((spec.projector.fx - preset.projector.fx).abs() < 1e-9 && (spec.projector.fy - preset.projector.fy).abs() < 1e-9);
        assert!((spec.left.fx / preset.left.fx - 1.0).abs() < 0.08, "{} beside {}", spec.left.fx, preset.left.fx);
        let [x, y, z] = spec.practical_volume_mm;
        assert!((x - 256.25).abs() < 1e-9 && (y - 162.29).abs() < 0.01 && (z - 155.0).abs() < 1e-9);
    }

    #[test]
    fn what_a_sheet_says_wrongly_is_named_by_its_option() {
        type Change = fn(&mut DataSheet);
        let cases: [(&str, Change); 11] = [
            ("--name", |s| s.name.clear()),
            ("--field", |s| s.field_mm[1] = 0.0),
            ("--at", |s| s.at_mm = f64::NAN),
            ("--depth", |s| s.depth_mm = [510.0, 560.0]),
            ("--depth", |s| s.depth_mm[1] = 20_000.0),
            ("--baseline", |s| s.baseline_mm = 0.0),
            ("--resolution", |s| s.camera_px[0] = 8),
            ("--projector", |s| s.projector_mm[2] = 490.0),
            ("--camera-incidence", |s| s.camera_incidence_deg = 95.0),
            ("--mass", |s| s.mass_kg = -1.0),
            ("--housing", |s| s.housing_mm = Some([0.0, 100.0, 100.0])),
        ];
        for (option, change) in cases {
            let mut changed = sheet();
            change(&mut changed);
            let errors = changed.spec().expect_err(option);
            assert!(errors.iter().any(|error| error.pointer == option), "{option}: {errors:?}");
        }
        let swapped = DataSheet { depth_mm: [560.0, 440.0], ..sheet() }.spec().expect_err("the ends swapped");
        assert!(swapped[0].detail.ends_with("the near end must be less than the far end; did you mean 440..560?"), "{swapped:?}");
        let wide = DataSheet { field_mm: [1501.0, 200.0], ..sheet() }.spec().expect_err("more than 3 working distances");
        assert_eq!((wide.len(), wide[0].to_string().as_str()), (1, "--field: is 1501 mm; allowed is 1 to 1500 mm"));
    }
}
