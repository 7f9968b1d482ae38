//! The scanner and the viewpoints of the benchmarks: the nominal rig of `vantage::planning::method::scanner` with a projector of
//! the cameras' resolution, so that a viewpoint has 3 × 4000 × 3036 = 36.4 million pixel rays, as the thesis casts; 480 mm from
//! the part's centre, which is the origin.
//!
//! Pixel (i, j) covers i ≤ u < i + 1, j ≤ v < j + 1; its ray goes through the middle.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use vantage::cell::{Lens, PerDevice, Presets, Scanner, SpecLibrary};
use vantage::geometry::{Mesh, Part, Pose, ScannerFrame};

/// The rig.
pub(crate) fn scanner() -> Scanner {
    let mut spec = Presets.scanner("transcan-c-nominal").expect("a preset");
    spec.projector.width_px = spec.left.width_px;
    spec.projector.height_px = spec.left.height_px;
    (spec.projector.fx, spec.projector.fy) = (spec.left.fx, spec.left.fy);
    (spec.projector.cx, spec.projector.cy) = (spec.left.cx, spec.left.cy);
    spec.build().expect("the preset is valid")
}

/// Viewpoints that look at the origin from all sides, none along an axis.
pub(crate) fn views(scanner: &Scanner) -> Vec<Pose<Part, ScannerFrame>> {
    const FROM: [[f64; 3]; 4] = [[0.3, -0.8, 0.5], [-0.7, 0.2, 0.6], [0.6, 0.7, -0.2], [-0.1, -0.4, 0.9]];
    FROM.iter().map(|from| looking_from(scanner, Vector3::from(*from))).collect()
}

/// `count` viewpoints all around, evenly: a Fibonacci lattice on the sphere.
pub(crate) fn views_around(scanner: &Scanner, count: usize) -> Vec<Pose<Part, ScannerFrame>> {
    let golden_angle_rad = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count)
        .map(|i| {
            let z = 1.0 - (2 * i + 1) as f64 / count as f64;
            let (azimuth, radius) = (i as f64 * golden_angle_rad, (1.0 - z * z).sqrt());
            looking_from(scanner, Vector3::new(radius * azimuth.cos(), radius * azimuth.sin(), z))
        })
        .collect()
}

fn looking_from(scanner: &Scanner, direction: Vector3<f64>) -> Pose<Part, ScannerFrame> {
    let eye = Point3::from(direction.normalize() * scanner.best_mm);
    Pose::claim(Isometry3::face_towards(&eye, &Point3::origin(), &Vector3::z()))
}

/// A device at a viewpoint, as a pinhole.
pub(crate) struct Eye {
    /// Optical centre, part frame, mm.
    pub(crate) centre_mm: Point3<f64>,
    /// Part to device frame.
    pub(crate) device_from_part: Isometry3<f64>,
    /// Intrinsics; no distortion, no skew.
    pub(crate) lens: Lens,
}

/// A rectangle of pixels, both ends excluded at the far side.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PixelBox {
    /// First and past-the-last column.
    pub(crate) columns: [u32; 2],
    /// First and past-the-last row.
    pub(crate) rows: [u32; 2],
}

/// The three devices of `scanner` at a viewpoint.
pub(crate) fn eyes(scanner: &Scanner, part_from_scanner: &Pose<Part, ScannerFrame>) -> PerDevice<Eye> {
    scanner.devices.map(|device| {
        let part_from_device = *part_from_scanner * device.scanner_from_device;
        Eye {
            centre_mm: part_from_device.origin_mm(),
            device_from_part: *part_from_device.inverse().isometry(),
            lens: device.lens,
        }
    })
}

impl Eye {
    /// The intrinsic matrix.
    pub(crate) fn intrinsic(&self) -> Matrix3<f64> {
        let lens = &self.lens;
        Matrix3::new(lens.fx, 0.0, lens.cx, 0.0, lens.fy, lens.cy, 0.0, 0.0, 1.0)
    }

    /// Direction of the ray through the middle of a pixel, part frame, of length 1 along the optical axis.
    pub(crate) fn ray(&self, column: u32, row: u32) -> [f32; 3] {
        let (u, v) = (f64::from(column) + 0.5, f64::from(row) + 0.5);
        let in_device = Vector3::new((u - self.lens.cx) / self.lens.fx, (v - self.lens.cy) / self.lens.fy, 1.0);
        self.device_from_part.rotation.inverse_transform_vector(&in_device).map(|x| x as f32).into()
    }

    /// The pixels that can show `mesh`, all of which lies in front of the device.
    pub(crate) fn scissor(&self, mesh: &Mesh) -> PixelBox {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for p in &mesh.vertices_mm {
            let p = self.device_from_part * p;
            let pixel = [self.lens.fx * p.x / p.z + self.lens.cx, self.lens.fy * p.y / p.z + self.lens.cy];
            for axis in 0..2 {
                low[axis] = low[axis].min(pixel[axis]);
                high[axis] = high[axis].max(pixel[axis]);
            }
        }
        let span =
            |axis: usize, size: f64| [(low[axis] - 1.0).clamp(0.0, size) as u32, (high[axis] + 2.0).clamp(0.0, size) as u32];
        PixelBox { columns: span(0, self.lens.width_px), rows: span(1, self.lens.height_px) }
    }
}

impl PixelBox {
    /// Pixels of the box in squares of 4 × 4, so that every sixteen in turn look almost the same way.
    pub(crate) fn pixels(self) -> impl Iterator<Item = (u32, u32)> {
        let ([left, right], [top, bottom]) = (self.columns, self.rows);
        (top..bottom).step_by(4).flat_map(move |row| {
            (left..right).step_by(4).flat_map(move |column| {
                (row..(row + 4).min(bottom)).flat_map(move |v| (column..(column + 4).min(right)).map(move |u| (u, v)))
            })
        })
    }
}
