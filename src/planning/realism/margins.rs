//! Margins in the images of one view: samples near the border of an image, or near a jump of depth in it.
//!
//! A jump is looked for on a ring around the sample: eight rays from the device, as many pixels off as the margin. It is between
//! the sample and a ray that hits nothing, or that hits a surface so much nearer or farther that no surface a device may still
//! measure, by the job's limits of incidence, joins the two. Cost: at most 24 rays a sample, in packets.

use std::f64::consts::TAU;

use nalgebra::{Isometry3, Point3, Vector3};

use super::{RiskInput, RiskView};
use crate::cell::{DeviceName, OpticalDevice, PerDevice};
use crate::geometry::SimdLevel;
use crate::planning::ids::SampleId;
use crate::planning::verdict::RiskReason;

/// Rays of a ring. An edge that passes within 92 % of the margin is met by one.
const RING: usize = 8;
/// Incidence beyond which a surface that joins two depths is not taken for one, radians (85°).
const MAX_SLOPE_RAD: f64 = 85.0 * std::f64::consts::PI / 180.0;
/// Difference of depth that is never a jump, mm: what the engines leave to rounding and to narrow patches.
const MIN_JUMP_MM: f64 = 0.06;

/// One view whose margins are looked into.
pub(super) struct Margins<'a> {
    input: &'a RiskInput<'a>,
    view: &'a RiskView<'a>,
    device_from_part: PerDevice<Isometry3<f64>>,
    level: SimdLevel,
}

impl<'a> Margins<'a> {
    pub(super) fn new(input: &'a RiskInput<'a>, view: &'a RiskView<'a>, level: SimdLevel) -> Self {
        let scanner_from_part = *view.part_from_scanner.inverse().isometry();
        let devices = input.scanner.devices.as_ref();
        let device_from_part = devices.map(|device| *device.scanner_from_device.inverse().isometry() * scanner_from_part);
        Self { input, view, device_from_part, level }
    }

    /// The margin that each of some samples is in, the frame's before the silhouette's.
    pub(super) fn of(&self, samples: &[SampleId]) -> Vec<Option<RiskReason>> {
        let realism = &self.input.params.realism;
        let near_border = |sample: &SampleId| {
            let is_near = self.devices().any(|device| self.is_near_border(device, *sample, realism.frame_margin_px));
            is_near.then_some(RiskReason::FrameMargin)
        };
        let mut found: Vec<_> = samples.iter().map(near_border).collect();
        if realism.silhouette_margin_px > 0.0 {
            for device in self.devices() {
                self.add_silhouettes(device, samples, &mut found);
            }
        }
        found
    }

    fn devices(&self) -> impl Iterator<Item = &'a OpticalDevice> {
        self.input.scanner.devices.iter()
    }

    /// The sample in the frame of a device.
    fn in_device(&self, device: DeviceName, sample: SampleId) -> Point3<f64> {
        self.device_from_part[device] * self.input.surface.sample_mm[sample.index()]
    }

    fn is_near_border(&self, device: &OpticalDevice, sample: SampleId, margin_px: f64) -> bool {
        let point = self.in_device(device.name, sample);
        let (u, v, _) = device.lens.image(point.x, point.y, point.z);
        let is_inside = |pixel: f64, size_px: f64| margin_px <= pixel && pixel < size_px - margin_px;
        margin_px > 0.0 && !(is_inside(u, device.lens.width_px) && is_inside(v, device.lens.height_px))
    }

    /// Marks the samples, of those not marked yet, that lie beside a jump of depth.
    fn add_silhouettes(&self, device: &OpticalDevice, samples: &[SampleId], found: &mut [Option<RiskReason>]) {
        let margin_px = self.input.params.realism.silhouette_margin_px;
        let part_from_device = self.device_from_part[device.name].inverse();
        let open: Vec<usize> = (0..samples.len()).filter(|place| found[*place].is_none()).collect();
        let ring = ring(margin_px).map(|[du, dv]| [du / device.lens.fx, dv / device.lens.fy]);
        let rays = open.iter().flat_map(|place| {
            let point = self.in_device(device.name, samples[*place]);
            let (x, y) = (point.x / point.z, point.y / point.z);
            // Depth 1, so that the share of a hit is its depth.
            ring.map(move |[dx, dy]| part_from_device * Vector3::new(x + dx, y + dy, 1.0))
        });
        let (rays, mut hits) = (rays.collect::<Vec<_>>(), Vec::new());
        let centre_mm = Point3::from(part_from_device.translation.vector);
        self.view.surfaces.first_hits_from(self.level, &centre_mm, &rays, &mut hits);
        for (place, hits) in open.into_iter().zip(hits.chunks(RING)) {
            let depth_mm = self.in_device(device.name, samples[place]).z;
            let jump_mm = self.jump_mm(device, depth_mm, margin_px);
            if hits.iter().any(|hit| hit.is_none_or(|hit| (hit.share - depth_mm).abs() > jump_mm)) {
                found[place] = Some(RiskReason::SilhouetteMargin);
            }
        }
    }

    /// Largest difference of depth, over the margin, of a surface that the device may still measure.
    fn jump_mm(&self, device: &OpticalDevice, depth_mm: f64, margin_px: f64) -> f64 {
        let slope_rad = self.input.params.limits.incidence_max_rad(device).min(MAX_SLOPE_RAD);
        MIN_JUMP_MM + margin_px * depth_mm / device.lens.focal_px() * slope_rad.tan()
    }
}

/// Pixel offsets of the rays of a ring.
fn ring(radius_px: f64) -> [[f64; 2]; RING] {
    std::array::from_fn(|ray| {
        let (sin, cos) = (TAU * ray as f64 / RING as f64).sin_cos();
        [radius_px * cos, radius_px * sin]
    })
}
