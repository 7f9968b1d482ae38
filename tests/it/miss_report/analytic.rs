//! Causes and areas without mesh, tree or engine: the definition in `vantage::planning::method::visibility` for a point of a body
//! whose only way out leads through openings in horizontal planes.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};
use vantage::cell::{PerDevice, Scanner};
use vantage::geometry::{Part, Pose, ScannerFrame};
use vantage::planning::plan::Cause;

/// Points along each side of a face.
const GRID: u32 = 500;

/// A device as one view places it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Eye {
    /// Optical centre, part frame, mm.
    pub(super) centre: Point3<f64>,
    pub(super) limit_rad: f64,
}

pub(super) fn eyes_of(
    scanner: &Scanner,
    view: &Pose<Part, ScannerFrame>,
    (camera_deg, projector_deg): (f64, f64),
) -> PerDevice<Eye> {
    let limits_deg = PerDevice::of_cameras(camera_deg, projector_deg);
    scanner.devices.zip(limits_deg).map(|(device, limit_deg)| Eye {
        centre: view.point(&device.scanner_from_device.origin_mm()),
        limit_rad: limit_deg.to_radians(),
    })
}

/// Opening that a line which crosses a horizontal plane has to pass through.
#[derive(Clone, Copy, Debug)]
pub(super) struct Opening {
    z_mm: f64,
    through: Through,
}

#[derive(Clone, Copy, Debug)]
enum Through {
    /// Within this radius of the z axis.
    Disc(f64),
    /// Between one x and another.
    Slot(f64, f64),
}

impl Opening {
    pub(super) fn round_at_top(radius_mm: f64) -> Self {
        Self { z_mm: 0.0, through: Through::Disc(radius_mm) }
    }

    pub(super) fn slot(z_mm: f64, from_x_mm: f64, to_x_mm: f64) -> Self {
        Self { z_mm, through: Through::Slot(from_x_mm, to_x_mm) }
    }

    fn lets_pass(&self, p: &Point3<f64>, eye: &Eye) -> bool {
        if p.z >= self.z_mm {
            return true;
        }
        let crossing = p + (eye.centre - p) * ((self.z_mm - p.z) / (eye.centre.z - p.z));
        match self.through {
            Through::Disc(radius_mm) => crossing.x.hypot(crossing.y) <= radius_mm,
            Through::Slot(from_mm, to_mm) => (from_mm..=to_mm).contains(&crossing.x),
        }
    }
}

/// The first failing cause of one view; `None` where it measures. Depth and frames are left out: the bodies lie well
/// within both.
fn cause(p: &Point3<f64>, normal: &Vector3<f64>, eyes: &PerDevice<Eye>, openings: &[Opening]) -> Option<Cause> {
    if eyes.iter().any(|eye| normal.dot(&(eye.centre - p)) <= 0.0) {
        return Some(Cause::Facing);
    }
    let oblique = PerDevice { left: Cause::IncidenceLeft, right: Cause::IncidenceRight, projector: Cause::IncidenceProjector };
    let shadow = PerDevice { left: Cause::ShadowLeft, right: Cause::ShadowRight, projector: Cause::ShadowProjector };
    let too_oblique = |eye: &Eye| normal.angle(&(eye.centre - p)) > eye.limit_rad;
    let hidden = |eye: &Eye| openings.iter().any(|opening| !opening.lets_pass(p, eye));
    let first = |fails: &dyn Fn(&Eye) -> bool, causes: PerDevice<Cause>| {
        eyes.iter().zip(causes).find(|(eye, _)| fails(eye)).map(|(_, c)| c)
    };
    first(&too_oblique, oblique).or_else(|| first(&hidden, shadow))
}

/// Area of a face by what becomes of it with several views: measured (`None`), or the cause of the view that gets
/// furthest. `point` maps the unit square evenly onto the face.
pub(super) fn area_by_cause(
    views: &[PerDevice<Eye>],
    openings: &[Opening],
    area_mm2: f64,
    point: impl Fn(f64, f64) -> (Point3<f64>, Vector3<f64>),
) -> BTreeMap<Option<Cause>, f64> {
    let mut areas = BTreeMap::new();
    let middle = |i: u32| (f64::from(i) + 0.5) / f64::from(GRID);
    for (i, j) in (0..GRID).flat_map(|i| (0..GRID).map(move |j| (i, j))) {
        let (p, normal) = point(middle(i), middle(j));
        let causes: Vec<_> = views.iter().map(|eyes| cause(&p, &normal, eyes, openings)).collect();
        let verdict = if causes.contains(&None) { None } else { causes.into_iter().max().flatten() };
        *areas.entry(verdict).or_default() += area_mm2 / f64::from(GRID * GRID);
    }
    areas
}
