//! The measurement volume: what both cameras and the projector see within the working depth, as a convex polytope in the
//! scanner frame, mm ([`crate::planning::method::scanner`]; replaces the planar construction of Wang, section 3.1.1.2–3,
//! which [`super::PlanarConstruction`] has for comparison).
//!
//! A device sees a cone over its image. Distortion bends the cone's four sides; each is replaced by the plane through
//! the optical centre that is parallel to the side's chord (corner to corner) and touches the side from inside. So the
//! polytope is exact for a lens without distortion and lies inside the true volume for one with it; what it gives away
//! at best focus is [`MeasurementVolume::bow_mm`]. Cost: that of the polytope, 18 planes.

use nalgebra::{Point3, Vector3};

use super::{OpticalDevice, PerDevice, Scanner};
use crate::geometry::{ConvexPolytope, HalfSpace, largest_centred_box};

/// The polytope is cut off this many working depths to the sides: frusta that open to infinity stay bounded.
const SIDE_LIMIT: f64 = 100.0;

/// The measurement volume and what fits in it.
#[derive(Clone, Debug)]
pub struct MeasurementVolume {
    /// Points that all three devices see at a working depth; scanner frame.
    pub polytope: ConvexPolytope,
    /// Edge lengths of the largest cuboid by volume inside it, aligned with the scanner and centred on best focus.
    pub largest_cuboid_mm: Vector3<f64>,
    /// Edge length of the largest such cube.
    pub largest_cube_mm: f64,
    /// Largest distance at best focus between a side of a field as bent by distortion and its plane here.
    pub bow_mm: f64,
}

/// Field of view at one depth, on the lines y = 0 and x = 0 of the scanner frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Field {
    /// Range along x at y = 0, mm.
    pub x_mm: [f64; 2],
    /// Range along y at x = 0, mm.
    pub y_mm: [f64; 2],
}

impl Field {
    /// The field that both see.
    #[must_use]
    pub fn common(&self, other: &Self) -> Self {
        let overlap = |a: [f64; 2], b: [f64; 2]| [a[0].max(b[0]), a[1].min(b[1])];
        Self { x_mm: overlap(self.x_mm, other.x_mm), y_mm: overlap(self.y_mm, other.y_mm) }
    }

    /// Width and height, mm; 0 where nothing is seen.
    #[must_use]
    pub fn size_mm(&self) -> [f64; 2] {
        [self.x_mm, self.y_mm].map(|[from, to]| (to - from).max(0.0))
    }
}

impl OpticalDevice {
    /// The four sides of what it sees (see the module's header), scanner frame; each with the largest distance of the
    /// bent side from its plane, mm per mm of depth along the device's axis.
    fn sides(&self) -> [(HalfSpace, f64); 4] {
        let rays = self.lens.edge_rays();
        let centre = rays.iter().map(|edge| edge[0]).sum::<Vector3<f64>>() * 0.25;
        rays.map(|edge| {
            let (from, to) = (edge[0], edge[edge.len() - 1]);
            let chord = to - from;
            // In the plane z = 1: outward across the chord, then back to the innermost point of the bent side.
            let across = Vector3::new(chord.y, -chord.x, 0.0).normalize();
            let outward = if across.dot(&(from - centre)) < 0.0 { -across } else { across };
            let (lowest, highest) = edge
                .iter()
                .map(|ray| outward.dot(ray))
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
            let normal = Vector3::new(outward.x, outward.y, -lowest);
            let pose = &self.scanner_from_device;
            (HalfSpace::through(&pose.origin_mm(), &pose.direction(&normal)), highest - lowest)
        })
    }

    /// Distance of a point of the scanner frame outside the sides of what this device sees; negative inside.
    #[must_use]
    pub fn outside_mm(&self, point: &Point3<f64>) -> f64 {
        self.sides().iter().map(|(side, _)| -side.depth_mm(point)).fold(f64::NEG_INFINITY, f64::max)
    }

    /// Field that this device sees at `depth_mm` along z of the scanner.
    #[must_use]
    pub fn field_at(&self, depth_mm: f64) -> Field {
        let sides = self.sides().map(|(half_space, _)| half_space);
        let origin = Point3::new(0.0, 0.0, depth_mm);
        Field { x_mm: interval(&sides, &origin, &Vector3::x()), y_mm: interval(&sides, &origin, &Vector3::y()) }
    }
}

/// The part of the line `origin` + t·`direction` inside all half-spaces, as the interval of t; from > to when empty.
fn interval(half_spaces: &[HalfSpace], origin: &Point3<f64>, direction: &Vector3<f64>) -> [f64; 2] {
    let mut t = [f64::NEG_INFINITY, f64::INFINITY];
    for half_space in half_spaces {
        let (room, rate) = (half_space.depth_mm(origin), half_space.normal.dot(direction));
        if rate > 0.0 {
            t[1] = t[1].min(room / rate);
        } else if rate < 0.0 {
            t[0] = t[0].max(room / rate);
        } else if room < 0.0 {
            return [f64::INFINITY, f64::NEG_INFINITY];
        }
    }
    t
}

impl Scanner {
    /// Field that all three devices see at `depth_mm`.
    #[must_use]
    pub fn common_field_at(&self, depth_mm: f64) -> Field {
        let PerDevice { left, right, projector } = self.devices.map(|device| device.field_at(depth_mm));
        left.common(&right).common(&projector)
    }

    /// The measurement volume; `None` for devices that see too little in common to hold a cuboid about best focus.
    #[must_use]
    pub fn measurement_volume(&self) -> Option<MeasurementVolume> {
        let sides = self.devices.map(|device| device.sides());
        let reach_mm = SIDE_LIMIT * self.far_mm;
        let slab = [
            HalfSpace { normal: -Vector3::z(), offset_mm: -self.near_mm },
            HalfSpace { normal: Vector3::z(), offset_mm: self.far_mm },
        ];
        let focus = self.devices.iter().flat_map(OpticalDevice::focus_slab);
        let bounds = [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y()];
        let bounds = bounds.map(|normal| HalfSpace { normal, offset_mm: reach_mm });
        let half_spaces = sides.iter().flatten().map(|(half_space, _)| *half_space).chain(slab).chain(focus).chain(bounds);
        let polytope = ConvexPolytope::intersection(half_spaces)?;
        let best = self.best_focus_mm();
        let largest_cube_mm = polytope.half_spaces.iter().map(|h| 2.0 * h.depth_mm(&best) / h.normal.lp_norm(1));
        let bow = sides.iter().flatten().map(|(_, bow)| *bow).fold(0.0, f64::max);
        Some(MeasurementVolume {
            largest_cuboid_mm: largest_centred_box(&polytope.half_spaces, &best)?,
            largest_cube_mm: largest_cube_mm.fold(f64::INFINITY, f64::min),
            bow_mm: bow * self.best_mm,
            polytope,
        })
    }
}
