//! Scans for tests: a part seen by the nominal scanner, cell by cell, without or with noise.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::ingest::merged::{MergedImage, merged_images};
use super::ingest::{CleanOptions, IngestWorld, PlannedCapture};
use super::rehearsal::in_context;
use super::{PixelGrid, ViewScan};
use crate::cell::Scanner;
use crate::geometry::{Mesh, NearestFace, Part, PointCloud, Pose, RayScene, ScannerFrame, SimdLevel};
use crate::testing::nominal_scanner;

/// Largest incidence at which a device returns a point, degrees.
const MAX_INCIDENCE_DEG: f64 = 75.0;

/// A number in 0 … 1 that depends on its place alone (SplitMix64).
pub(super) fn unit(place: u64) -> f64 {
    let mut bits = place.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A normal number of mean 0 and deviation 1 (Box and Muller).
pub(super) fn normal(place: u64) -> f64 {
    let radius = (-2.0 * unit(2 * place).max(1e-300).ln()).sqrt();
    radius * (std::f64::consts::TAU * unit(2 * place + 1)).cos()
}

/// A motion of normal components.
pub(super) fn motion(place: u64, deg: f64, mm: f64) -> Isometry3<f64> {
    let three = |from: u64| Vector3::new(normal(6 * place + from), normal(6 * place + from + 1), normal(6 * place + from + 2));
    Isometry3::from_parts(Translation3::from(three(0) * mm), UnitQuaternion::from_scaled_axis(three(3) * deg.to_radians()))
}

/// A motion of this turn and this shift in a random direction.
pub(super) fn motion_of(place: u64, deg: f64, mm: f64) -> Isometry3<f64> {
    let drawn = motion(place, 1.0, 1.0);
    let turn = drawn.rotation.scaled_axis().normalize() * deg.to_radians();
    let shift = drawn.translation.vector.normalize() * mm;
    Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::from_scaled_axis(turn))
}

/// Images of the cloud that scans of a part are merged to.
pub(super) fn merged(scans: &[ViewScan], scanner: &Scanner, mesh: &Mesh) -> Vec<ViewScan> {
    let placed = |scan: &ViewScan| -> Vec<[f32; 3]> {
        let point = |(_, point)| scan.part_from_scanner.point(&point).coords.map(|mm| mm as f32).into();
        scan.scanner_cloud.finite().map(point).collect()
    };
    let part_mm: Vec<[f32; 3]> = scans.iter().flat_map(placed).collect();
    let capture = |scan: &ViewScan| PlannedCapture {
        viewpoint: scan.viewpoint,
        part_from_scanner: scan.part_from_scanner,
        scanner_from_cloud: None,
        part_from_plate: None,
        part_from_table: None,
        part_from_base: None,
    };
    let captures: Vec<PlannedCapture> = scans.iter().map(capture).collect();
    let nearest = NearestFace::new(mesh);
    let world = IngestWorld { scanner, nearest: &nearest, captures: &captures, fixtures: &[] };
    let images = in_context(|ctx| merged_images(&part_mm, &world, &CleanOptions::default(), ctx)).expect("nobody cancels");
    let scan = |(scan, image): (&ViewScan, MergedImage)| ViewScan { scanner_cloud: image.scanner_cloud, ..scan.clone() };
    scans.iter().zip(images).map(scan).collect()
}

/// The part as built, before the scanner.
pub(super) struct Shots<'m> {
    pub(super) scanner: Scanner,
    mesh: &'m Mesh,
    scene: RayScene,
    step_px: u32,
}

impl<'m> Shots<'m> {
    pub(super) fn of(mesh: &'m Mesh, step_px: u32) -> Self {
        Self { scanner: nominal_scanner(), mesh, scene: RayScene::new([mesh]), step_px }
    }

    /// Poses around a part that look at its middle from the best distance: from above and from the sides.
    pub(super) fn poses(&self, count: usize) -> Vec<Pose<Part, ScannerFrame>> {
        let centre = self.mesh.aabb().centre();
        let pose = |view: usize| {
            // Golden-angle spiral over the sphere down to a little below the horizon.
            let height = 0.95 - 1.1 * view as f64 / (count.max(2) - 1) as f64;
            let around = 2.399_963 * view as f64;
            let flat = (1.0 - height * height).sqrt();
            let from = Vector3::new(flat * around.cos(), flat * around.sin(), height);
            let turn = UnitQuaternion::face_towards(&-from, &Vector3::new(0.3, 0.2, 0.9));
            Pose::from_parts(centre.coords + from * self.scanner.best_mm, turn)
        };
        (0..count).map(pose).collect()
    }

    /// Cloud taken from a pose, with noise along each ray.
    pub(super) fn cloud(&self, part_from_scanner: &Pose<Part, ScannerFrame>, noise_mm: f64, seed: u64) -> PointCloud {
        let grid = PixelGrid::new(&self.scanner, self.step_px);
        let eye = part_from_scanner.point(&grid.centre_mm());
        let directions: Vec<Vector3<f64>> = (0..grid.cells()).map(|cell| part_from_scanner.direction(&grid.ray(cell))).collect();
        let mut hits = Vec::new();
        self.scene.first_hits_from(SimdLevel::widest(), &eye, &directions, &mut hits);
        let found: Vec<Option<(Point3<f64>, Vector3<f64>)>> = hits
            .iter()
            .zip(&directions)
            .map(|(hit, direction)| {
                let face = hit.as_ref()?.triangle as usize;
                let normal = self.mesh.scaled_normal(face).normalize();
                let share = normal.dot(&(self.mesh.corners(face)[0] - eye)) / normal.dot(direction);
                Some((eye + direction * share, normal))
            })
            .collect();
        let mut cloud = PointCloud { points_mm: vec![[f32::NAN; 3]; directions.len()], grid: Some(grid.size) };
        let scanner_from_part = part_from_scanner.inverse();
        for (cell, (point, _)) in
            self.seen(part_from_scanner, &found).iter().enumerate().filter_map(|(cell, seen)| seen.map(|seen| (cell, seen)))
        {
            let noisy = point + directions[cell].normalize() * (noise_mm * normal(seed * 1_000_003 + cell as u64));
            let own = scanner_from_part.point(&noisy);
            cloud.points_mm[cell] = [own.x as f32, own.y as f32, own.z as f32];
        }
        cloud
    }

    /// Points that all three devices see.
    fn seen(
        &self,
        part_from_scanner: &Pose<Part, ScannerFrame>,
        found: &[Option<(Point3<f64>, Vector3<f64>)>],
    ) -> Vec<Option<(Point3<f64>, Vector3<f64>)>> {
        let mut seen = found.to_vec();
        let min_cos = MAX_INCIDENCE_DEG.to_radians().cos();
        let scanner_from_part = part_from_scanner.inverse();
        for device in [&self.scanner.devices.left, &self.scanner.devices.right, &self.scanner.devices.projector] {
            let eye = (*part_from_scanner * device.scanner_from_device).origin_mm();
            let targets: Vec<Point3<f64>> = found.iter().map(|found| found.map_or(eye, |(point, _)| point)).collect();
            let mut blocked = Vec::new();
            self.scene.blocked_from(SimdLevel::widest(), &eye, &targets, 1.0 - 1e-5, &mut blocked);
            for (cell, own) in seen.iter_mut().enumerate() {
                let keeps = own.is_some_and(|(point, normal)| {
                    let in_scanner = scanner_from_part.point(&point);
                    let in_device = device.scanner_from_device.inverse().point(&in_scanner);
                    let cos = normal.dot(&(eye - point).normalize());
                    let in_depth = (self.scanner.near_mm..=self.scanner.far_mm).contains(&in_scanner.z);
                    cos >= min_cos && in_depth && device.lens.project(&in_device).is_some() && !blocked[cell]
                });
                *own = own.filter(|_| keeps);
            }
        }
        seen
    }

    /// Scans from poses; each stated pose is that of the capture moved by `error(view)` in the scanner's frame.
    pub(super) fn scans(
        &self,
        poses: &[Pose<Part, ScannerFrame>],
        noise_mm: f64,
        error: impl Fn(u64) -> Isometry3<f64>,
    ) -> Vec<ViewScan> {
        let scan = |(view, pose): (usize, &Pose<Part, ScannerFrame>)| ViewScan {
            viewpoint: view as u32 + 1,
            part_from_scanner: Pose::claim(pose.isometry() * error(view as u64)),
            scanner_cloud: self.cloud(pose, noise_mm, view as u64 + 1),
        };
        poses.iter().enumerate().map(scan).collect()
    }
}
