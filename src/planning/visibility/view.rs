//! The definition of [`crate::planning::method::visibility`] for one sample and one viewpoint, step by step in the order in
//! which causes are named, and the quality of [`crate::planning::method::quality`]. What an engine adds is only how it decides
//! that nothing lies between.
//!
//! Written without a branch, in f64, so that an engine may run it on many samples at a time and get the same bits.

use std::ops::RangeInclusive;

use nalgebra::{Isometry3, Point3, Vector3};

use crate::cell::{DeviceName, Exposure, Lens, LevelRange, Lighting, Material, PerDevice, Scanner};
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::planning::params::{PlanParams, ScoreAngle};
use crate::planning::surface::requirements::{Requirement, Requirements};
use crate::planning::verdict::Cause;

/// Causes by device where it does not see a sample.
pub(super) const SHADOWS: PerDevice<Cause> =
    PerDevice { left: Cause::ShadowLeft, right: Cause::ShadowRight, projector: Cause::ShadowProjector };
/// Stands where a number of a cause may stand: no step before a shadow fails.
pub(super) const PASSES: u8 = u8::MAX;

/// Minimum half range of the working depth.
const MIN_HALF_RANGE_MM: f64 = 1e-3;

/// The number of a cause, as wide as the values beside which it is computed.
const fn number(cause: Cause) -> u64 {
    cause as u64
}

/// The scanner and the limits of the job, ready for many samples.
pub struct Optics {
    near_mm: f64,
    best_mm: f64,
    far_mm: f64,
    /// D of [`crate::planning::method::quality`] below and above best focus.
    half_range_mm: [f64; 2],
    devices: PerDevice<DeviceOptics>,
    angle_weight: f64,
    distance_weight: f64,
    angle: ScoreAngle,
    /// δ_max of [`crate::planning::method::quality`]: the projector's own limit, so that grades of two jobs mean the same.
    incidence_reference_rad: f64,
    requirements: Vec<Requirement>,
    /// Limits of each kind of requirement.
    incidence_min: Vec<IncidenceMin>,
    /// Smallest focal length of the cameras, pixels.
    focal_px: f64,
    /// σ_F and g of [`crate::planning::surface::requirements`].
    noise_best_mm: f64,
    noise_depth_gain: f64,
    exposure: ExposureLimits,
}

/// Light of the job, and the brightness levels that it may use.
struct ExposureLimits {
    exposure: Exposure,
    /// Distance from the projector to the best focus, mm.
    best_mm: f64,
    ambient: f64,
    levels: RangeInclusive<u8>,
}

struct DeviceOptics {
    device_from_scanner: Isometry3<f64>,
    /// Optical centre, scanner frame.
    centre_mm: Point3<f64>,
    lens: Lens,
    in_focus_mm: [f64; 2],
}

/// Minimum cosines of the incidence against each device.
pub(super) type IncidenceMin = PerDevice<f64>;

impl Optics {
    /// Takes the limits from what is asked of the samples, else from `params`, and from the scanner where its own are tighter.
    #[must_use]
    pub fn new(scanner: &Scanner, params: &PlanParams, requirements: &Requirements) -> Self {
        let limits_rad =
            scanner.devices.as_ref().map(|device| (params.limits.incidence_max_rad(device), device.incidence_max_rad));
        let devices = scanner.devices.as_ref().map(|device| DeviceOptics {
            device_from_scanner: *device.scanner_from_device.inverse().isometry(),
            centre_mm: device.scanner_from_device.origin_mm(),
            lens: device.lens,
            in_focus_mm: device.in_focus_mm,
        });
        let limits = |requirement: &Requirement| {
            let required_rad = PerDevice::of_cameras(requirement.camera_max_rad, requirement.projector_max_rad);
            let in_force_rad = required_rad.zip(limits_rad);
            in_force_rad.map(|(required_rad, (job_rad, own_rad))| required_rad.map_or(job_rad, |rad| rad.min(own_rad)).cos())
        };
        // Best focus may lie at an end of a device's depth of field: half a range of nothing would divide by zero.
        let [near_mm, far_mm] = scanner.working_depth_mm();
        let half_range_mm = [scanner.best_mm - near_mm, far_mm - scanner.best_mm].map(|half_mm| half_mm.max(MIN_HALF_RANGE_MM));
        Self {
            half_range_mm,
            near_mm: scanner.near_mm,
            best_mm: scanner.best_mm,
            far_mm: scanner.far_mm,
            devices,
            angle_weight: params.score.c,
            distance_weight: params.score.d,
            angle: params.score.angle,
            incidence_reference_rad: scanner.devices.projector.incidence_max_rad,
            requirements: requirements.kinds.clone(),
            incidence_min: requirements.kinds.iter().map(limits).collect(),
            focal_px: scanner.devices.cameras().into_iter().map(|camera| camera.lens.focal_px()).fold(f64::INFINITY, f64::min),
            noise_best_mm: params.regions.noise.best_mm,
            noise_depth_gain: params.regions.noise.depth_gain,
            exposure: ExposureLimits {
                exposure: scanner.exposure,
                best_mm: (scanner.best_focus_mm() - scanner.devices.projector.scanner_from_device.origin_mm()).norm(),
                ambient: params.scan.ambient.unwrap_or(0.0),
                levels: params.scan.brightness.levels(),
            },
        }
    }

    /// The optics for light of any brightness: what a view sees, whether it is lit well or not.
    #[must_use]
    pub(in crate::planning) fn at_any_brightness(mut self) -> Self {
        self.requirements.iter_mut().for_each(|requirement| requirement.material = None);
        self
    }

    /// D of [`crate::planning::method::quality`]: the half range of the working depth on that side of F.
    #[inline(always)]
    fn half_range_mm(&self, depth_mm: f64) -> f64 {
        let [below_mm, above_mm] = self.half_range_mm;
        if depth_mm < self.best_mm { below_mm } else { above_mm }
    }

    /// The viewpoint's side of everything that does not depend on the sample.
    #[must_use]
    pub fn at<'a>(&'a self, part_from_scanner: &Pose<Part, ScannerFrame>) -> View<'a> {
        let scanner_from_part = *part_from_scanner.inverse().isometry();
        View {
            optics: self,
            scanner: Rigid::new(&scanner_from_part),
            devices: self.devices.as_ref().map(|device| Rigid::new(&device.device_from_scanner)),
            device_from_part: self.devices.as_ref().map(|device| device.device_from_scanner * scanner_from_part),
            centres_mm: self.devices.as_ref().map(|device| part_from_scanner.point(&device.centre_mm)),
        }
    }

    /// Limits of each kind of requirement.
    pub(super) fn incidence_min(&self) -> &[IncidenceMin] {
        &self.incidence_min
    }

    /// Lenses of the devices.
    pub(super) fn lenses(&self) -> PerDevice<&Lens> {
        self.devices.as_ref().map(|device| &device.lens)
    }
}

/// A rigid motion as plain numbers.
struct Rigid {
    rows: [[f64; 3]; 3],
    offset: [f64; 3],
}

impl Rigid {
    fn new(isometry: &Isometry3<f64>) -> Self {
        let matrix = isometry.rotation.to_rotation_matrix();
        let rows = std::array::from_fn(|r| std::array::from_fn(|c| matrix[(r, c)]));
        Self { rows, offset: isometry.translation.vector.into() }
    }

    #[inline(always)]
    fn turn(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [a, b, c] = &self.rows;
        [a[0] * x + a[1] * y + a[2] * z, b[0] * x + b[1] * y + b[2] * z, c[0] * x + c[1] * y + c[2] * z]
    }

    #[inline(always)]
    fn apply(&self, p: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = self.turn(p);
        [x + self.offset[0], y + self.offset[1], z + self.offset[2]]
    }
}

/// One viewpoint.
pub struct View<'a> {
    optics: &'a Optics,
    scanner: Rigid,
    devices: PerDevice<Rigid>,
    pub(super) device_from_part: PerDevice<Isometry3<f64>>,
    /// Optical centres, part frame, mm.
    pub(super) centres_mm: PerDevice<Point3<f64>>,
}

/// Expected precision of a point on a surface ([`crate::planning::surface::requirements`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuringPrecision {
    /// Cosine of the angle between the normal and the direction to the viewpoint; not above 0 where the surface faces away.
    pub cos: f64,
    /// Standard deviation across the surface, mm.
    pub noise_mm: f64,
    /// Distance between the points of neighbouring pixels, mm.
    pub spacing_mm: f64,
}

impl MeasuringPrecision {
    /// Information on a surface's place along its normal, per area, mm⁻⁴: points an area over the variance of one, if their noise
    /// is independent. 0 where the surface faces away.
    #[must_use]
    pub fn information(&self) -> f64 {
        // A pixel's footprint is stretched by the incidence along one side alone.
        let footprint_mm2 = self.spacing_mm * self.spacing_mm * self.cos;
        if self.cos > 0.0 { 1.0 / (footprint_mm2 * self.noise_mm * self.noise_mm) } else { 0.0 }
    }
}

/// Angles and depth under which a view sees a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SightLine {
    /// Largest angle between the sample's normal and the direction to a device, rad.
    pub worst_incidence_rad: f64,
    /// Smallest angle between the mirrored ray of the projector and the direction to a camera, rad.
    pub mirror_rad: f64,
    /// z in the scanner's frame, mm.
    pub depth_mm: f64,
}

/// One device's view of a sample.
struct Seen {
    faces: bool,
    /// Incidence within the limit.
    within: bool,
    in_frame: bool,
    in_focus: bool,
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

impl View<'_> {
    /// The first step before any shadow at which a sample fails; else its quality.
    ///
    /// # Errors
    /// The cause of the failing step.
    pub fn before_shadow(&self, p: &Point3<f64>, normal: &Vector3<f64>, kind: u16) -> Result<f32, Cause> {
        let limits = self.optics.incidence_min[usize::from(kind)];
        let cause = self.first_failing_step((*p).into(), (*normal).into(), limits);
        if cause == u64::from(PASSES) { Ok(self.quality_at(p, normal)) } else { Err(Cause::ALL[cause as usize]) }
    }

    /// The number of the first step before any shadow at which a sample fails, [`PASSES`] if none does.
    #[inline(always)]
    pub(super) fn first_failing_step(&self, p: [f64; 3], normal: [f64; 3], min_cos: IncidenceMin) -> u64 {
        let optics = self.optics;
        let in_scanner = self.scanner.apply(p);
        // Spelled out: a loop over the devices would keep the caller's loop over samples from being vectorised.
        let left = self.seen_by(DeviceName::Left, p, normal, in_scanner, min_cos.left);
        let right = self.seen_by(DeviceName::Right, p, normal, in_scanner, min_cos.right);
        let projector = self.seen_by(DeviceName::Projector, p, normal, in_scanner, min_cos.projector);
        let faces = left.faces & right.faces & projector.faces;
        let in_slab = (optics.near_mm <= in_scanner[2]) & (in_scanner[2] <= optics.far_mm);
        let in_depth = in_slab & left.in_focus & right.in_focus & projector.in_focus;
        let mut cause = u64::from(PASSES);
        cause = if projector.within { cause } else { number(Cause::IncidenceProjector) };
        cause = if right.within { cause } else { number(Cause::IncidenceRight) };
        cause = if left.within { cause } else { number(Cause::IncidenceLeft) };
        cause = if projector.in_frame { cause } else { number(Cause::FrameProjector) };
        cause = if right.in_frame { cause } else { number(Cause::FrameRight) };
        cause = if left.in_frame { cause } else { number(Cause::FrameLeft) };
        cause = if in_depth { cause } else { number(Cause::Depth) };
        if faces { cause } else { number(Cause::Facing) }
    }

    /// Evaluates a device at a sample.
    #[inline(always)]
    fn seen_by(&self, device: DeviceName, p: [f64; 3], normal: [f64; 3], in_scanner: [f64; 3], min_cos: f64) -> Seen {
        let (lens, centre) = (&self.optics.devices[device].lens, &self.centres_mm[device]);
        let towards = [centre.x - p[0], centre.y - p[1], centre.z - p[2]];
        let along_normal = dot(normal, towards);
        let [x, y, z] = self.devices[device].apply(in_scanner);
        let [near_mm, far_mm] = self.optics.devices[device].in_focus_mm;
        Seen {
            faces: along_normal > 0.0,
            within: along_normal >= min_cos * dot(towards, towards).sqrt(),
            in_frame: lens.image(x, y, z).2,
            in_focus: (near_mm <= z) & (z <= far_mm),
        }
    }

    /// The quality of a sample that is measured.
    pub(super) fn quality_at(&self, p: &Point3<f64>, normal: &Vector3<f64>) -> f32 {
        self.quality_of((*p).into(), (*normal).into()) as f32
    }

    /// The quality of a sample that is measured.
    #[inline(always)]
    pub(super) fn quality_of(&self, p: [f64; 3], normal: [f64; 3]) -> f64 {
        self.quality(self.scanner.apply(p), normal)
    }

    /// Brightness levels at which a sample that this view sees can be measured.
    pub(in crate::planning) fn levels_at(&self, p: &Point3<f64>, normal: &Vector3<f64>, material: &Material) -> LevelRange {
        let light = &self.optics.exposure;
        light.exposure.levels(material, &self.lighting(p, normal), light.ambient)
    }

    /// Angles and depth under which this view sees a sample.
    pub(in crate::planning) fn sight_line(&self, p: &Point3<f64>, normal: &Vector3<f64>) -> SightLine {
        SightLine {
            worst_incidence_rad: self.incidence_rad(p, normal).into_iter().fold(0.0, f64::max),
            mirror_rad: self.lighting(p, normal).mirror_rad.into_iter().fold(f64::INFINITY, f64::min),
            depth_mm: self.scanner.apply((*p).into())[2],
        }
    }

    fn lighting(&self, p: &Point3<f64>, normal: &Vector3<f64>) -> Lighting {
        let PerDevice { left, right, projector } = &self.centres_mm;
        let (towards, distance_mm) = (projector - p, (projector - p).norm());
        let cos_projector = normal.dot(&towards) / distance_mm;
        let mirrored = normal * (2.0 * normal.dot(&towards)) - towards;
        let mirror_rad = [left, right].map(|camera| mirrored.angle(&(camera - p)));
        Lighting { cos_projector, nearness: self.optics.exposure.best_mm / distance_mm, mirror_rad }
    }

    /// The quality by which a sample that is measured counts, or the cause for which it does not: it is lit at no brightness level, or not
    /// measured as well as is asked. Inside the mirror cone of a glossy surface it is the lowest that there is: a view from elsewhere is
    /// better.
    pub(super) fn counted_quality(&self, p: &Point3<f64>, normal: &Vector3<f64>, quality: f32, kind: u16) -> Result<f32, Cause> {
        let requirement = &self.optics.requirements[usize::from(kind)];
        let Some(material) = &requirement.material else {
            return self.meets_requirement(p, normal, quality, kind).then_some(quality).ok_or(Cause::BelowGrade);
        };
        let (light, lighting) = (&self.optics.exposure, self.lighting(p, normal));
        let range = light.exposure.levels(material, &lighting, light.ambient);
        let in_lobe = material.gloss > 0.0 && lighting.mirror_rad.iter().any(|angle_rad| *angle_rad < material.lobe_rad);
        let quality = if in_lobe { -(self.optics.angle_weight + self.optics.distance_weight) as f32 } else { quality };
        if !range.is_lit_at_any(light.levels.clone()) {
            return Err(Cause::Exposure);
        }
        self.meets_requirement(p, normal, quality, kind).then_some(quality).ok_or(Cause::BelowGrade)
    }

    /// Returns true if a sample that is measured is measured as well as is asked.
    fn meets_requirement(&self, p: &Point3<f64>, normal: &Vector3<f64>, quality: f32, kind: u16) -> bool {
        let optics = self.optics;
        let requirement = &optics.requirements[usize::from(kind)];
        if !requirement.requires_quality() {
            return true;
        }
        let MeasuringPrecision { cos, noise_mm, spacing_mm } = self.precision_at(p, normal);
        (cos > 0.0)
            && requirement.min_grade.is_none_or(|grade| f64::from(quality) > grade.above())
            && requirement.noise_max_mm.is_none_or(|max_mm| noise_mm <= max_mm)
            && requirement.spacing_max_mm.is_none_or(|max_mm| spacing_mm <= max_mm)
    }

    /// The expected precision at a sample that is measured.
    #[must_use]
    pub fn precision_at(&self, p: &Point3<f64>, normal: &Vector3<f64>) -> MeasuringPrecision {
        let (optics, in_scanner) = (self.optics, self.scanner.apply((*p).into()));
        let cos = -dot(self.scanner.turn((*normal).into()), in_scanner) / dot(in_scanner, in_scanner).sqrt();
        let off = (in_scanner[2] - optics.best_mm) / optics.half_range_mm(in_scanner[2]);
        let noise_mm = optics.noise_best_mm * (1.0 + optics.noise_depth_gain * off * off) / cos;
        MeasuringPrecision { cos, noise_mm, spacing_mm: in_scanner[2] / (optics.focal_px * cos) }
    }

    /// Optical centres, part frame.
    #[must_use]
    pub fn centres_mm(&self) -> &PerDevice<Point3<f64>> {
        &self.centres_mm
    }

    /// The angles at which the devices see a point with this unit normal.
    #[must_use]
    pub fn incidence_rad(&self, p: &Point3<f64>, normal: &Vector3<f64>) -> PerDevice<f64> {
        self.centres_mm.map(|centre| normal.angle(&(centre - p)))
    }

    /// c·Q_δ + d·Q_dis ([`crate::planning::method::quality`]), each clamped to [−1, 1]. D is the half range on the sample's
    /// side of F.
    #[inline(always)]
    fn quality(&self, in_scanner: [f64; 3], normal: [f64; 3]) -> f64 {
        let optics = self.optics;
        let facing = self.scanner.turn(normal);
        let along_ray = -dot(facing, in_scanner) / dot(in_scanner, in_scanner).sqrt();
        let cos = if optics.angle == ScoreAngle::Ray { along_ray } else { -facing[2] };
        let q_angle = within_one(1.0 - 2.0 * arc_cosine(cos) / optics.incidence_reference_rad);
        let off_mm = in_scanner[2] - optics.best_mm;
        let q_distance = within_one(1.0 - 2.0 * off_mm.abs() / optics.half_range_mm(in_scanner[2]));
        optics.angle_weight * q_angle + optics.distance_weight * q_distance
    }
}

#[inline(always)]
fn within_one(x: f64) -> f64 {
    let x = if x < -1.0 { -1.0 } else { x };
    if x > 1.0 { 1.0 } else { x }
}

/// acos to 3e-8 rad, the argument held within [−1, 1] (Abramowitz and Stegun 1964, *Handbook of Mathematical Functions*,
/// 4.4.46); unlike the library's it is plain arithmetic, which vectorises and has the same bits everywhere.
#[inline(always)]
fn arc_cosine(cos: f64) -> f64 {
    const A: [f64; 8] = [
        1.570_796_305_0,
        -0.214_598_801_6,
        0.088_978_987_4,
        -0.050_174_304_6,
        0.030_891_881_0,
        -0.017_088_125_6,
        0.006_670_090_1,
        -0.001_262_491_1,
    ];
    let x = within_one(cos).abs();
    let polynomial = A[0] + x * (A[1] + x * (A[2] + x * (A[3] + x * (A[4] + x * (A[5] + x * (A[6] + x * A[7]))))));
    let angle_rad = (1.0 - x).sqrt() * polynomial;
    if cos < 0.0 { std::f64::consts::PI - angle_rad } else { angle_rad }
}

#[cfg(test)]
mod tests {
    use super::arc_cosine;

    #[test]
    fn the_arc_cosine_is_good_to_its_stated_error() {
        for i in -100_000..=100_000 {
            let cos = f64::from(i) / 1e5;
            assert!((arc_cosine(cos) - cos.acos()).abs() < 3e-8, "at {cos}");
        }
        assert_eq!(arc_cosine(1.0 + 1e-12), 0.0);
    }
}
