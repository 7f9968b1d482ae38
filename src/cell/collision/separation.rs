//! Distance of the two bodies that are nearest, and the place between them, which a check leaves out to be quick. Not for hot
//! loops: tens of microseconds, a few milliseconds where meshes overlap.

use nalgebra::Point3;
use parry3d::math::Pose as ParryPose;
use parry3d::query::{self, ClosestPoints};
use parry3d::shape::{Capsule, Shape};

use super::pairs::BodyPair;
use super::solid::Solid;
use super::{CollisionScene, Contact, Placement, Segment, spread_configuration};
use crate::cell::axis::Configuration;
use crate::cell::layout::Cell;

/// Distances between surfaces are found this exactly.
const PRECISION_MM: f64 = 0.05;
/// Share of a distance that queries in single precision find it to.
pub const QUERY_SHARE: f64 = 1e-3;
/// Places looked at along a segment.
const PROBES: u32 = 60;
/// Configurations from which the largest distance of a pair is known.
const FARTHEST_SAMPLES: u32 = 60;
/// A pair is nearer than it has to be if it is by more than this nearer than its largest distance, mm: our choice.
const NEARER_MM: f64 = 1.0;

/// Largest distance of each pair of bodies, as far as configurations spread over the ranges of all axes tell.
#[derive(Clone, Debug, PartialEq)]
pub struct Farthest {
    /// One for each pair of a scene, mm; infinite where the two can be farther apart than was looked for.
    apart_mm: Vec<f64>,
}

/// Two bodies near each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Separation {
    /// The two bodies.
    pub bodies: Contact,
    /// Distance of the two; below zero the depth of one in the other, as far as that is known.
    pub distance_mm: f64,
    /// Point between them, base frame, mm.
    pub place_in_base_mm: Point3<f64>,
}

impl CollisionScene {
    /// Evaluates the largest distance of each pair of bodies, where it is not more than `within_mm`: of bodies that no axis can
    /// bring farther apart. Cost: tens of milliseconds; `check` is asked in between.
    ///
    /// # Errors
    /// The error of `check`.
    pub fn farthest<E>(&self, cell: &Cell, within_mm: f64, check: impl Fn() -> Result<(), E>) -> Result<Farthest, E> {
        let axes = cell.axes();
        let mut apart_mm = vec![f64::NEG_INFINITY; self.pairs.len()];
        let mut near: Vec<usize> = (0..self.pairs.len()).collect();
        for sample in 1..=FARTHEST_SAMPLES {
            check()?;
            let placement = self.place(&spread_configuration(&axes, sample));
            near.retain(|index| {
                let pair = &self.pairs[*index];
                let is_near = self.is_closer(pair, &placement, within_mm);
                let found = is_near.then(|| self.separation(pair, &placement, within_mm)).flatten();
                let found_mm = found.map_or(f64::INFINITY, |separation| separation.distance_mm);
                apart_mm[*index] = apart_mm[*index].max(found_mm);
                found_mm < f64::INFINITY
            });
        }
        Ok(Farthest { apart_mm })
    }

    /// The two bodies that are nearest to each other, of those closer than `within_mm` and nearer to each other than they have to
    /// be: a pair that is as far apart as the axes can bring it says nothing of a configuration, such as what the flange carries
    /// and the link before it on the axis of the last joint. `farthest` is of this scene. Links of the arm that are closer than the
    /// clearance by construction are left out too.
    #[must_use]
    pub fn nearest(&self, configuration: &Configuration, farthest: &Farthest, within_mm: f64) -> Option<Separation> {
        let placement = self.place(configuration);
        let may_be_near = |pair: &BodyPair| pair.clearance_mm >= self.clearance_mm && self.is_closer(pair, &placement, within_mm);
        let pairs = self.pairs.iter().zip(&farthest.apart_mm).filter(|(pair, _)| may_be_near(pair));
        let separations = pairs.filter_map(|(pair, farthest_mm)| {
            let separation = self.separation(pair, &placement, within_mm)?;
            (separation.distance_mm < farthest_mm - NEARER_MM).then_some(separation)
        });
        separations.min_by(|a, b| a.distance_mm.total_cmp(&b.distance_mm))
    }

    /// The configuration on a straight segment in joint space at which two bodies are nearest to each other, or deepest in each
    /// other, of a few dozen places looked at, and how near: where a check finds them too close, less than they have to keep.
    #[must_use]
    pub fn nearest_on(&self, bodies: &Contact, ends: &[Configuration; 2], within_mm: f64) -> Option<(Configuration, Separation)> {
        let pair = self.pairs.iter().find(|pair| self.contact_of(pair) == *bodies)?;
        let segment = Segment { from: &ends[0], travel_rad: &ends[0].travel_rad(&ends[1]) };
        let probes = if ends[0] == ends[1] { 0 } else { PROBES };
        let places = (0..=probes).map(|probe| segment.at(f64::from(probe) / f64::from(PROBES)));
        let separations = places.filter_map(|place| Some((place, self.separation(pair, &self.place(&place), within_mm)?)));
        let (place, mut separation) = separations.min_by(|a, b| a.1.distance_mm.total_cmp(&b.1.distance_mm))?;
        // The check is another query, as exact as this: near the clearance the two may differ.
        if separation.distance_mm >= pair.clearance_mm && self.is_near(pair, &self.place(&place), &[0.0; 7]) {
            separation.distance_mm = (1.0 - QUERY_SHARE) * pair.clearance_mm;
        }
        Some((place, separation))
    }

    fn separation(&self, pair: &BodyPair, placement: &Placement, within_mm: f64) -> Option<Separation> {
        let ((a, pose_a), (b, pose_b)) = (self.placed(pair.a, placement), self.placed(pair.b, placement));
        let (a, b) = (a.shape(), b.shape());
        let (distance_mm, place) = match query::closest_points(&pose_a, a, &pose_b, b, within_mm as f32).ok()? {
            ClosestPoints::WithinMargin(p, q) => (f64::from((p - q).length()), (p + q) * 0.5),
            ClosestPoints::Disjoint => return None,
            ClosestPoints::Intersecting => match query::contact(&pose_a, a, &pose_b, b, 0.0) {
                Ok(Some(contact)) => (f64::from(contact.dist.min(0.0)), (contact.point1 + contact.point2) * 0.5),
                _ => (0.0, placement.boxes[pair.a].center()),
            },
        };
        let distance_mm = self.surface_distance_mm(pair, placement, within_mm)?.unwrap_or(distance_mm);
        Some(Separation {
            bodies: self.contact_of(pair),
            distance_mm,
            place_in_base_mm: Point3::new(place.x, place.y, place.z).cast(),
        })
    }

    /// The distance of what is in the two bodies where they only envelop it, by halving; `None` where they are farther apart
    /// than `within_mm`, and within that where only the envelopes can tell how deep they are in each other.
    #[expect(clippy::option_option, reason = "too far apart, and told by the envelopes, are not the same")]
    fn surface_distance_mm(&self, pair: &BodyPair, placement: &Placement, within_mm: f64) -> Option<Option<f64>> {
        let is_within = |mm: f64| self.is_confirmed(pair, placement, mm as f32);
        if !is_within(within_mm) {
            return None;
        }
        if is_within(0.0) {
            return Some(None);
        }
        let (mut low, mut high) = (0.0, within_mm);
        while high - low > PRECISION_MM {
            let middle = 0.5 * (low + high);
            if is_within(middle) { high = middle } else { low = middle }
        }
        Some(Some(high))
    }

    fn placed(&self, body: usize, placement: &Placement) -> (Placed<'_>, ParryPose) {
        let pose = placement.poses[body];
        match &self.bodies[body].solid {
            Solid::Segment { core, radius_mm } => (Placed::Own(Box::new(Capsule::new(core.a, core.b, *radius_mm))), pose),
            Solid::Box(core) => (Placed::Scene(core), pose),
            Solid::Cylinder { core, body_from_core } => (Placed::Scene(core), pose * *body_from_core),
            Solid::Mesh(surface) => (Placed::Scene(surface.as_ref()), pose),
        }
    }
}

/// A body as parry's queries take it.
enum Placed<'a> {
    Own(Box<dyn Shape>),
    Scene(&'a dyn Shape),
}

impl Placed<'_> {
    fn shape(&self) -> &dyn Shape {
        match self {
            Self::Own(shape) => shape.as_ref(),
            Self::Scene(shape) => *shape,
        }
    }
}
