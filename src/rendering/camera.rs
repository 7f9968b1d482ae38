//! Camera of a picture: a pinhole without distortion. Its frame is that of an optical device (+z forward, +x right, +y down),
//! so that a scanner's own frame can serve as one.

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::geometry::{Aabb, Device, Part, Pose};

/// Distance of the near plane; nothing nearer to the camera is drawn, mm.
const NEAR_MM: f64 = 5.0;
/// Share of the picture that stays free on each side.
const MARGIN: f64 = 0.05;
/// Tangent of half the max angle of view: about 100° across.
const MAX_TANGENT: f64 = 1.2;
/// Max points that a picture is fitted to.
const FIT_POINTS: usize = 20_000;
/// Distance of the camera of an overview, in radii of the part: mild perspective.
const OVERVIEW_RADII: f64 = 5.0;
/// Distance of the camera of a drawing to scale, in radii of the part: what is nearer by a radius appears larger by 0.25 %.
const AFAR_RADII: f64 = 400.0;

/// A pinhole camera and its picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Pose of the camera.
    pub camera_from_part: Pose<Device, Part>,
    /// Width and height, pixels.
    pub size_px: [usize; 2],
    /// Focal length, pixels.
    pub focal_px: f64,
    /// Principal point, pixels; may lie outside the picture.
    pub centre_px: [f64; 2],
}

impl Camera {
    /// The camera at `camera_from_part`, zoomed and shifted so that the part fills the picture as far as it lies within the max
    /// angle of view.
    pub fn fitted(camera_from_part: Pose<Device, Part>, size_px: [usize; 2], vertices_mm: &[Point3<f64>]) -> Self {
        let stride = vertices_mm.len().div_ceil(FIT_POINTS).max(1);
        let seen = vertices_mm.iter().step_by(stride).map(|p| camera_from_part.point(p)).filter(|p| p.z > NEAR_MM);
        let tangents = seen.map(|p| Point3::new(p.x / p.z, p.y / p.z, 0.0).coords.map(|c| c.clamp(-MAX_TANGENT, MAX_TANGENT)));
        let mut window = tangents.fold(Aabb::empty(), |window, tangent| window.with(&tangent.into()));
        if window.min.x >= window.max.x || window.min.y >= window.max.y {
            window = Aabb { min: Point3::new(-MAX_TANGENT, -MAX_TANGENT, 0.0), max: Point3::new(MAX_TANGENT, MAX_TANGENT, 0.0) };
        }
        let [width, height] = size_px.map(|n| n as f64);
        let (extent, middle) = (window.extent_mm(), window.centre());
        let focal_px = (1.0 - 2.0 * MARGIN) * (width / extent.x).min(height / extent.y);
        let centre_px = [width / 2.0 - focal_px * middle.x, height / 2.0 - focal_px * middle.y];
        Self { camera_from_part, size_px, focal_px, centre_px }
    }

    /// A camera that looks at the part from the direction `towards_camera` (part frame), with `up` pointing up in the picture.
    pub fn looking_at(vertices_mm: &[Point3<f64>], towards_camera: Vector3<f64>, up: Vector3<f64>, size_px: [usize; 2]) -> Self {
        let aabb = Aabb::around(vertices_mm);
        let z = -towards_camera.normalize();
        let x = z.cross(&up).normalize();
        let part_from_axes = Rotation3::from_basis_unchecked(&[x, z.cross(&x), z]);
        let distance_mm = OVERVIEW_RADII * 0.5 * aabb.extent_mm().norm() + 2.0 * NEAR_MM;
        let part_from_camera = Isometry3::from_parts(
            Translation3::from(aabb.centre().coords - z * distance_mm),
            UnitQuaternion::from_rotation_matrix(&part_from_axes),
        );
        Self::fitted(Pose::<Part, Device>::claim(part_from_camera).inverse(), size_px, vertices_mm)
    }

    /// A camera so far from `at_mm` (part frame) that it shows a parallel projection to a pixel: `px_per_mm` there, which is the
    /// centre of the picture. `radius_mm` is that of the part.
    pub fn from_afar(
        at_mm: &Point3<f64>,
        [towards_camera, up]: [Vector3<f64>; 2],
        radius_mm: f64,
        px_per_mm: f64,
        size_px: [usize; 2],
    ) -> Self {
        let z = -towards_camera.normalize();
        let x = z.cross(&up).normalize();
        let part_from_axes = Rotation3::from_basis_unchecked(&[x, z.cross(&x), z]);
        let distance_mm = AFAR_RADII * radius_mm + 2.0 * NEAR_MM;
        let part_from_camera = Isometry3::from_parts(
            Translation3::from(at_mm.coords - z * distance_mm),
            UnitQuaternion::from_rotation_matrix(&part_from_axes),
        );
        let camera_from_part = Pose::<Part, Device>::claim(part_from_camera).inverse();
        let centre_px = size_px.map(|n| n as f64 / 2.0);
        Self { camera_from_part, size_px, focal_px: px_per_mm * distance_mm, centre_px }
    }

    /// Pixel of a point given in the camera's frame; `None` in front of the near plane.
    #[inline(always)]
    pub fn pixel(&self, p: &Point3<f64>) -> Option<[f64; 2]> {
        let [x, y] = [self.centre_px[0] + self.focal_px * p.x / p.z, self.centre_px[1] + self.focal_px * p.y / p.z];
        if p.z >= NEAR_MM { Some([x, y]) } else { None }
    }

    /// Direction (z = 1), in the camera's frame, of the ray through a pixel.
    pub fn direction(&self, pixel: [f64; 2]) -> Vector3<f64> {
        Vector3::new((pixel[0] - self.centre_px[0]) / self.focal_px, (pixel[1] - self.centre_px[1]) / self.focal_px, 1.0)
    }

    /// Clips a triangle (camera frame) at the near plane; returns the corners of a fan, at most a quadrangle, and their number.
    pub fn clip_near(corners: [Point3<f64>; 3]) -> ([Point3<f64>; 4], usize) {
        let mut fan = [Point3::origin(); 4];
        let mut count = 0;
        for (i, a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % 3];
            if a.z >= NEAR_MM {
                fan[count] = *a;
                count += 1;
            }
            if (a.z >= NEAR_MM) != (b.z >= NEAR_MM) {
                let mut crossing = a + (b - a) * ((NEAR_MM - a.z) / (b.z - a.z));
                crossing.z = NEAR_MM;
                fan[count] = crossing;
                count += 1;
            }
        }
        (fan, count)
    }
}
