//! Facts of a scanner that `vantage inspect` shows, schema `vantage.scanner_facts/1`: rig, depth of field, fields, volume.
//! Scanner frame, millimetres and degrees.

use nalgebra::{Point3, Vector3};
use serde::Serialize;
use utoipa::ToSchema;

use crate::cell::{
    DepthBound, DepthBoundSource, DepthOfField, Field, MeasurementVolume, OpticalDevice, PlanarConstruction, Scanner,
    hyperfocal_distance_mm,
};
use crate::geometry::box_half_spaces;

/// Schema name in the document.
pub const SCANNER_FACTS_SCHEMA: &str = "vantage.scanner_facts/1";
/// F-numbers for which depth of field is listed.
const F_NUMBERS: [f64; 4] = [4.0, 5.6, 8.0, 11.0];
/// Circle of confusion of that list, pixels.
const CIRCLE_PX: f64 = 2.0;

/// Facts of a scanner.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct ScannerFacts {
    /// Schema name, `vantage.scanner_facts/1`.
    pub schema: &'static str,
    /// Name of the scanner specification.
    pub name: String,
    /// Distance between the cameras' optical centres.
    pub baseline_mm: f64,
    /// Angle between the cameras' optical axes.
    pub axes_angle_deg: f64,
    /// Left camera, right camera and projector, in this order.
    pub devices: Vec<DeviceFacts>,
    /// Fields of view at the nearest, the best and the farthest working depth.
    pub fields: Vec<FieldFacts>,
    /// Limits of the working depth: the practical one, then depth of field of devices that state one.
    pub depth_bounds: Vec<DepthBoundFacts>,
    /// Limit that ends the working depth on the axis towards the scanner.
    pub near_bound: DepthBoundSource,
    /// Limit that ends the working depth on the axis away from the scanner.
    pub far_bound: DepthBoundSource,
    /// Depth of field of the left camera's lens; `null` if its pixel pitch is not given.
    pub depth_of_field: Option<DepthOfFieldFacts>,
    /// Measurement volume; `null` if the devices share none around best focus.
    pub volume: Option<VolumeFacts>,
    /// Planar construction of the thesis; `null` if its lines leave no depth.
    pub planar_construction: Option<PlanarFacts>,
}

/// Planar construction of the measurement volume (thesis §3.1.1.2–3), for comparison; planning goes by `volume`.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct PlanarFacts {
    /// Points A₁ to A₄ of the construction, each as x and depth z.
    pub corners_mm: [[f64; 2]; 4],
    /// Distances along the axes of the left and the right camera at which their depth of field is taken to begin: at the near
    /// end of the working depth on the scanner's axis.
    pub near_mm: [f64; 2],
    /// L_opt: mean width along x.
    pub width_mm: f64,
    /// Height of the common field along y at the best plane.
    pub height_mm: f64,
    /// W_opt: depth along z.
    pub depth_mm: f64,
    /// Depth of the best plane, y₁ + W_opt / 2.
    pub best_mm: f64,
    /// H_opt as printed, y₁ + W_opt, which counts the half height twice.
    pub printed_best_mm: f64,
    /// Box of the specification to compare with, x, y, z; `null` if it states none.
    pub stated_mm: Option<[f64; 3]>,
}

/// A camera or the projector.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct DeviceFacts {
    /// `left`, `right` or `projector`.
    pub name: &'static str,
    /// Position of the optical centre.
    pub centre_mm: [f64; 3],
    /// Direction of the optical axis, a unit vector.
    pub axis: [f64; 3],
    /// Full angles of view along u and v.
    pub field_of_view_deg: [f64; 2],
    /// Max angle of incidence.
    pub incidence_max_deg: f64,
}

/// Depths that one limit leaves.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct DepthBoundFacts {
    /// The limit.
    pub source: DepthBoundSource,
    /// Nearest depth on the scanner's axis; `null` without an end.
    pub near_mm: Option<f64>,
    /// Farthest depth on the scanner's axis; `null` without an end.
    pub far_mm: Option<f64>,
    /// Nearest depth from which all of the common field at best focus is within the limit; `null` without an end.
    pub field_near_mm: Option<f64>,
    /// Farthest depth to which all of the common field at best focus is within the limit; `null` without an end.
    pub field_far_mm: Option<f64>,
}

/// Fields of view at one depth.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct FieldFacts {
    /// Depth along z.
    pub depth_mm: f64,
    /// Fields of the left camera, the right camera and the projector.
    pub devices: Vec<IntervalFacts>,
    /// Field that all three share.
    pub common: IntervalFacts,
}

/// Bounds of a field on the lines y = 0 and x = 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct IntervalFacts {
    /// Bounds along x at y = 0.
    pub x_mm: [f64; 2],
    /// Bounds along y at x = 0.
    pub y_mm: [f64; 2],
}

/// Depth of field of a lens focused at best focus.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct DepthOfFieldFacts {
    /// Focal length.
    pub focal_mm: f64,
    /// Circle of confusion assumed for `by_f_number`.
    pub circle_mm: f64,
    /// Depth of field at several f-numbers.
    pub by_f_number: Vec<StopFacts>,
    /// Working depth in front of best focus and behind it.
    pub working_mm: [f64; 2],
    /// Products of circle of confusion and effective f-number that would explain the working depth in front and behind.
    pub working_blur_mm: [f64; 2],
}

/// Depth of field at one f-number.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, ToSchema)]
pub struct StopFacts {
    /// Effective f-number.
    pub f_number: f64,
    /// Depth of field towards the camera.
    pub front_mm: f64,
    /// Depth of field away from the camera; `null` if it is infinite.
    pub rear_mm: Option<f64>,
    /// Hyperfocal distance: `rear_mm` is infinite from this focus distance on.
    pub hyperfocal_mm: f64,
}

/// The measurement volume and what fits in it.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct VolumeFacts {
    /// Volume of the polytope.
    pub volume_mm3: f64,
    /// Corners of the polytope.
    pub vertices_mm: Vec<[f64; 3]>,
    /// Max bow of a side through distortion at best focus, which the polytope leaves out.
    pub bow_mm: f64,
    /// Largest cuboid by volume that is aligned with the scanner and centred on best focus.
    pub largest_cuboid_mm: [f64; 3],
    /// Edge of the largest cube of that kind.
    pub largest_cube_mm: f64,
    /// Boxes of the specification, centred on best focus, compared with the polytope.
    pub stated: Vec<StatedBox>,
}

/// A box of the specification compared with the polytope.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct StatedBox {
    /// Name of the box: `stated`, `practical` or `block_cube`.
    pub name: &'static str,
    /// Edge lengths.
    pub size_mm: [f64; 3],
    /// Share of its volume that lies inside the polytope.
    pub inside: f64,
    /// Limits that its corners exceed, each with the corner that lies farthest outside.
    pub excess: Vec<Excess>,
}

/// Excess of a box over the field of one device, or over the working depth.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub struct Excess {
    /// Exceeded limit: `left`, `right`, `projector` or `depth`.
    pub of: &'static str,
    /// Corner that lies farthest outside.
    pub corner_mm: [f64; 3],
    /// Distance by which it lies outside.
    pub outside_mm: f64,
}

impl ScannerFacts {
    /// Collects the facts of a scanner.
    #[must_use]
    pub fn new(scanner: &Scanner) -> Self {
        let depths = [scanner.near_mm, scanner.best_mm, scanner.far_mm];
        let bounds = scanner.depth_bounds();
        let [near_bound, far_bound] = binding(&bounds);
        Self {
            depth_bounds: bounds.into_iter().map(DepthBoundFacts::from).collect(),
            near_bound,
            far_bound,
            schema: SCANNER_FACTS_SCHEMA,
            name: scanner.name.clone(),
            baseline_mm: scanner.baseline_mm(),
            axes_angle_deg: scanner.axes_angle_rad().to_degrees(),
            devices: scanner.devices.iter().map(DeviceFacts::from).collect(),
            fields: depths.map(|depth_mm| field_facts(scanner, depth_mm)).to_vec(),
            depth_of_field: depth_of_field(scanner),
            volume: scanner.measurement_volume().map(|volume| volume_facts(scanner, &volume)),
            planar_construction: scanner.planar_construction().map(|planar| planar_facts(scanner, planar)),
        }
    }
}

impl From<&OpticalDevice> for DeviceFacts {
    fn from(device: &OpticalDevice) -> Self {
        Self {
            name: device.name.as_str(),
            centre_mm: device.scanner_from_device.origin_mm().into(),
            axis: device.scanner_from_device.direction(&Vector3::z()).into(),
            field_of_view_deg: device.lens.field_of_view_rad().map(f64::to_degrees),
            incidence_max_deg: device.incidence_max_rad.to_degrees(),
        }
    }
}

impl From<DepthBound> for DepthBoundFacts {
    fn from(bound: DepthBound) -> Self {
        let finite = |[near, far]: [f64; 2]| [near, far].map(|mm| mm.is_finite().then_some(mm));
        let ([near_mm, far_mm], [field_near_mm, field_far_mm]) = (finite(bound.on_axis_mm), finite(bound.over_field_mm));
        Self { source: bound.source, near_mm, far_mm, field_near_mm, field_far_mm }
    }
}

/// Limits with the farthest near end and with the nearest far end on the axis; the first of equal ones.
fn binding(bounds: &[DepthBound]) -> [DepthBoundSource; 2] {
    let start = (f64::NEG_INFINITY, DepthBoundSource::Practical);
    let near = bounds.iter().map(|bound| (bound.on_axis_mm[0], bound.source));
    let far = bounds.iter().map(|bound| (-bound.on_axis_mm[1], bound.source));
    let tightest = |best: (f64, DepthBoundSource), next: (f64, DepthBoundSource)| if next.0 > best.0 { next } else { best };
    [near.fold(start, tightest).1, far.fold(start, tightest).1]
}

impl From<Field> for IntervalFacts {
    fn from(field: Field) -> Self {
        Self { x_mm: field.x_mm, y_mm: field.y_mm }
    }
}

fn field_facts(scanner: &Scanner, depth_mm: f64) -> FieldFacts {
    FieldFacts {
        depth_mm,
        devices: scanner.devices.iter().map(|device| device.field_at(depth_mm).into()).collect(),
        common: scanner.common_field_at(depth_mm).into(),
    }
}

fn depth_of_field(scanner: &Scanner) -> Option<DepthOfFieldFacts> {
    let left = &scanner.devices.left;
    let pitch_mm = left.pixel_pitch_mm?;
    let (focal_mm, circle_mm) = (left.lens.fx * pitch_mm, CIRCLE_PX * pitch_mm);
    let working = DepthOfField { front_mm: scanner.best_mm - scanner.near_mm, rear_mm: scanner.far_mm - scanner.best_mm };
    let stop = |f_number: f64| {
        let blur_mm = circle_mm * f_number;
        let field = DepthOfField::at(scanner.best_mm, focal_mm, blur_mm);
        StopFacts {
            f_number,
            front_mm: field.front_mm,
            rear_mm: field.rear_mm.is_finite().then_some(field.rear_mm),
            hyperfocal_mm: hyperfocal_distance_mm(focal_mm, blur_mm),
        }
    };
    Some(DepthOfFieldFacts {
        focal_mm,
        circle_mm,
        by_f_number: F_NUMBERS.map(stop).to_vec(),
        working_mm: [working.front_mm, working.rear_mm],
        working_blur_mm: working.blur_mm(scanner.best_mm, focal_mm),
    })
}

fn volume_facts(scanner: &Scanner, volume: &MeasurementVolume) -> VolumeFacts {
    let cube = [scanner.block_cube_mm; 3];
    let boxes = [("practical", scanner.practical_volume_mm), ("block_cube", cube)];
    let stated = scanner.stated_volume_mm.map(|size_mm| ("stated", size_mm));
    VolumeFacts {
        volume_mm3: volume.polytope.volume_mm3,
        vertices_mm: volume.polytope.vertices_mm.iter().map(|vertex| (*vertex).into()).collect(),
        bow_mm: volume.bow_mm,
        largest_cuboid_mm: volume.largest_cuboid_mm.into(),
        largest_cube_mm: volume.largest_cube_mm,
        stated: stated.into_iter().chain(boxes).map(|(name, size_mm)| stated_box(scanner, volume, name, size_mm)).collect(),
    }
}

fn planar_facts(scanner: &Scanner, planar: PlanarConstruction) -> PlanarFacts {
    let PlanarConstruction { corners_mm, near_mm, width_mm, height_mm, depth_mm, best_mm, printed_best_mm } = planar;
    let stated_mm = scanner.stated_volume_mm;
    PlanarFacts { corners_mm, near_mm, width_mm, height_mm, depth_mm, best_mm, printed_best_mm, stated_mm }
}

fn stated_box(scanner: &Scanner, volume: &MeasurementVolume, name: &'static str, size_mm: [f64; 3]) -> StatedBox {
    let size = Vector3::from(size_mm);
    let best = scanner.best_focus_mm();
    let common_mm3 = volume.polytope.cut(box_half_spaces(&best, &size)).map_or(0.0, |common| common.volume_mm3);
    let corners: Vec<Point3<f64>> = (0..8_u32)
        .map(|octant| best + Vector3::from_fn(|axis, _| if octant >> axis & 1 == 0 { -0.5 } else { 0.5 } * size[axis]))
        .collect();
    let by_device =
        scanner.devices.iter().filter_map(|device| worst(device.name.as_str(), &corners, |corner| device.outside_mm(corner)));
    let by_depth = worst("depth", &corners, |corner| (scanner.near_mm - corner.z).max(corner.z - scanner.far_mm));
    StatedBox { name, size_mm, inside: common_mm3 / size.product(), excess: by_device.chain(by_depth).collect() }
}

/// The corner that lies farthest outside; `None` if none does.
fn worst(of: &'static str, corners: &[Point3<f64>], outside_mm: impl Fn(&Point3<f64>) -> f64) -> Option<Excess> {
    let far = corners.iter().max_by(|a, b| outside_mm(a).total_cmp(&outside_mm(b)))?;
    let outside_mm = outside_mm(far);
    (outside_mm > 1e-6).then(|| Excess { of, corner_mm: (*far).into(), outside_mm })
}
