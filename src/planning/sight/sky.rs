//! Open sky: the directions in which a line from a surface point leaves the part. A point without any is enclosed, whatever
//! scanner looks for it; one whose open directions all begin below the plate can be measured only when the part is turned over
//! ([`crate::planning::method::causes`]).
//!
//! Directions are spread evenly over the half-space in front of the point, few at first, and [`DIRECTIONS`] where those are
//! hidden: about 4° apart, so that an opening narrower than that may be overlooked. Ahead of them stand those in which neighbours
//! were found open; of the others only those are looked into that could still change the answer. Neighbours share them out: each
//! looks into one of [`SHARES`] shares, and into the others unless none of the [`GROUP`] found any way, as deep inside an assembly.
//! Cost: a few rays where the sky is open beside an open neighbour, a share of [`DIRECTIONS`] and [`REMEMBERED`] rays among
//! neighbours that are enclosed, at most [`DIRECTIONS`] and twice [`REMEMBERED`] elsewhere.

#[cfg(test)]
mod tests;

use std::f64::consts::PI;

use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::geometry::parallel;
use crate::geometry::{Mesh, Part, Pose, RayScene, SimdLevel, Table};
use crate::planning::candidates::{spiral, stands_above};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::surface::Surface;

/// Directions that are looked into.
const DIRECTIONS: usize = 1024;
/// Stride of the directions that are looked into together: one such part is spread over the half-space, and most points are found
/// open in the first.
const STRIDE: usize = 16;
/// Directions in such a part.
const PART: usize = DIRECTIONS / STRIDE;
/// Shares of the directions, each of every so many of those parts. With four, at most 0.035 % of the asked area changed hands on six
/// public parts (more of it was found visible), and an assembly of 81 bodies took 71 s of CPU in place of 160 s.
const SHARES: usize = 4;
/// Neighbours, one after the other, that are enclosed if none finds a way in its share.
const GROUP: usize = 16;
/// Directions in which neighbours were found open that are kept: a packet of rays.
const REMEMBERED: usize = 16;
/// Smallest cosine between a normal and a direction that is taken over from a neighbour: that of the lowest of a point's own.
const MIN_RISE: f64 = 0.5 / DIRECTIONS as f64;
/// Points that a thread looks from, neighbours one after the other.
const NEIGHBOURS: usize = 256;
/// Height above the surface at which lines begin, mm: clear of the point's own facet.
const ABOVE_MM: f64 = 0.02;

/// Rounding error of a sine.
const ROUNDING: f64 = 1e-9;

/// Largest distance from the plate of a sample that the part rests on, mm.
const RESTING_WITHIN_MM: f64 = 0.1;
/// Cosine below which such a sample faces down: within 8° of the vertical.
const RESTING_NORMAL_COS: f64 = -0.99;

/// Returns true if a sample belongs to the faces that the part stands on, on a plate of this radius.
#[must_use]
pub(in crate::planning) fn stands_on(
    surface: &Surface,
    sample: SampleId,
    table_from_part: &Pose<Table, Part>,
    plate_radius_mm: f64,
) -> bool {
    let at = table_from_part.point(&surface.sample_mm[sample.index()]);
    let down = table_from_part.direction(&surface.patch_of(sample).normal).z;
    at.z.abs() <= RESTING_WITHIN_MM && down <= RESTING_NORMAL_COS && at.xy().coords.norm() <= plate_radius_mm
}

/// Sky of a surface point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::planning) enum Sky {
    /// A line leaves the part, and not only from below the plate.
    Open,
    /// Lines that a device could look along leave the part, but only from viewpoints below the plate.
    BelowPlate,
    /// No line leaves the part.
    Closed,
}

/// Value of the best open direction that was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Way {
    /// Every direction is blocked.
    None,
    /// An open direction that no device could look along.
    Grazing,
    /// An open direction that a device could look along, from below the plate.
    BelowPlate,
    /// The best direction that there can be.
    Open,
}

impl From<Way> for Sky {
    fn from(way: Way) -> Self {
        match way {
            Way::None => Self::Closed,
            Way::BelowPlate => Self::BelowPlate,
            Way::Grazing | Way::Open => Self::Open,
        }
    }
}

/// Directions in which neighbours were found open, the latest last.
#[derive(Default)]
struct FoundOpen {
    directions: Vec<Vector3<f64>>,
}

impl FoundOpen {
    fn add(&mut self, direction: Vector3<f64>) {
        if self.directions.len() == REMEMBERED {
            self.directions.remove(0);
        }
        self.directions.push(direction);
    }
}

/// Directions of one point on their way through the part.
#[derive(Default)]
struct Rays {
    looked: Vec<(Vector3<f64>, Way)>,
    ends_mm: Vec<Point3<f64>>,
    hidden: Vec<bool>,
}

/// One point that is looked from.
struct Look<'p, 'a> {
    probe: &'p SkyProbe<'a>,
    point_mm: &'p Point3<f64>,
    normal: &'p Vector3<f64>,
    /// The best way found.
    way: Way,
    rays: Rays,
}

impl Look<'_, '_> {
    /// Looks into those of some directions that are worth more than the way found, and returns an open one of the most worth.
    fn cast(&mut self, directions: &[Vector3<f64>]) -> Option<Vector3<f64>> {
        let Self { probe, point_mm, normal, way, rays } = self;
        let from_mm = *point_mm + *normal * ABOVE_MM;
        let worth = directions.iter().map(|direction| (*direction, probe.way(point_mm, normal, direction)));
        rays.looked.clear();
        rays.looked.extend(worth.filter(|(_, worth)| *worth > *way));
        rays.ends_mm.clear();
        rays.ends_mm.extend(rays.looked.iter().map(|(direction, _)| from_mm + direction * probe.beyond_mm));
        probe.part.blocked_from(probe.level, &from_mm, &rays.ends_mm, 1.0, &mut rays.hidden);
        let mut found = None;
        for ((direction, worth), _) in rays.looked.iter().zip(&rays.hidden).filter(|(_, hidden)| !**hidden) {
            if *worth > *way {
                (*way, found) = (*worth, Some(*direction));
            }
        }
        found
    }
}

/// A part whose points are asked for their sky.
pub(in crate::planning) struct SkyProbe<'a> {
    part: &'a RayScene,
    level: SimdLevel,
    /// Distance that is beyond the part from any of its points, mm.
    beyond_mm: f64,
    /// Directions in front of a surface that faces +z.
    directions: Vec<Vector3<f64>>,
    /// Poses of the part whose plates hide what is below them; empty without a plate.
    setups: &'a [Pose<Table, Part>],
    /// Smallest elevation of a viewpoint over such a plate.
    min_elevation_deg: f64,
    /// Distance at which a viewpoint stands, mm, and the cosine of the largest incidence.
    best_mm: f64,
    min_cos: f64,
}

impl<'a> SkyProbe<'a> {
    /// `part` is the scene of `mesh` alone. A viewpoint stands `best_mm` away, at an incidence of at most `incidence_max_rad`,
    /// and over each plate at an elevation of at least `min_elevation_deg`.
    pub(in crate::planning) fn new(
        mesh: &Mesh,
        part: &'a RayScene,
        (setups, min_elevation_deg): (&'a [Pose<Table, Part>], f64),
        best_mm: f64,
        incidence_max_rad: f64,
        level: SimdLevel,
    ) -> Self {
        let beyond_mm = mesh.aabb().extent_mm().norm() + 1.0;
        let evenly: Vec<_> = spiral(DIRECTIONS, 0.0).collect();
        // Every `STRIDE`th first: each such part is spread over the half-space too.
        let directions = (0..STRIDE).flat_map(|first| evenly.iter().skip(first).step_by(STRIDE).copied()).collect();
        Self { part, level, beyond_mm, directions, setups, min_elevation_deg, best_mm, min_cos: incidence_max_rad.cos() }
    }

    /// The sky of each of some samples; those near each other in the list share directions found open. Does not depend on the
    /// number of threads.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub(in crate::planning) fn skies(
        &self,
        surface: &Surface,
        samples: &[SampleId],
        ctx: &Context<'_>,
    ) -> Result<Vec<Sky>, Cancelled> {
        let of_neighbours = |samples: &[SampleId]| {
            let place = |sample: &SampleId| (&surface.sample_mm[sample.index()], &surface.patch_of(*sample).normal);
            let (mut found_open, mut ways) = (FoundOpen::default(), Vec::with_capacity(samples.len()));
            for (number, sample) in samples.iter().enumerate() {
                ctx.check()?;
                ways.push(self.first_look(place(sample), number % SHARES, &mut found_open));
            }
            for (ways, samples) in ways.chunks_mut(GROUP).zip(samples.chunks(GROUP)) {
                if samples.len() >= SHARES && ways.iter().all(|way| *way == Way::None) {
                    continue;
                }
                for (number, (way, sample)) in ways.iter_mut().zip(samples).enumerate() {
                    ctx.check()?;
                    *way = self.second_look(place(sample), (number % SHARES, *way), &mut found_open);
                }
            }
            Ok(ways.into_iter().map(Sky::from).collect::<Vec<_>>())
        };
        let skies = parallel::try_map_chunks::<_, _, Cancelled>(samples, NEIGHBOURS, of_neighbours)?;
        Ok(skies.concat())
    }

    /// The sky of a surface point with this unit normal; part frame, mm.
    #[cfg(test)]
    fn sky(&self, point_mm: &Point3<f64>, normal: &Vector3<f64>) -> Sky {
        let (place, mut found_open) = ((point_mm, normal), FoundOpen::default());
        let way = self.first_look(place, 0, &mut found_open);
        self.second_look(place, (0, way), &mut found_open).into()
    }

    /// The best way of a surface point in the directions in which neighbours were found open, to which its own is added, and in a
    /// share of all.
    fn first_look(&self, place: (&Point3<f64>, &Vector3<f64>), share: usize, found_open: &mut FoundOpen) -> Way {
        let rest = (1..STRIDE / SHARES).map(|more| share + more * SHARES).collect();
        self.looked(place, Way::None, &[vec![share], rest], found_open)
    }

    /// The best way in the other shares too.
    fn second_look(&self, place: (&Point3<f64>, &Vector3<f64>), (share, way): (usize, Way), found_open: &mut FoundOpen) -> Way {
        let others = (0..STRIDE).filter(|part| part % SHARES != share).collect();
        self.looked(place, way, &[others], found_open)
    }

    /// The best way, `known` or found by neighbours or in some batches of parts of the directions.
    fn looked(
        &self,
        (point_mm, normal): (&Point3<f64>, &Vector3<f64>),
        known: Way,
        batches: &[Vec<usize>],
        found_open: &mut FoundOpen,
    ) -> Way {
        let half_turn = || UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
        let best = self.best_way(point_mm, normal);
        let mut look = Look { probe: self, point_mm, normal, way: known, rays: Rays::default() };
        if look.way >= best {
            return look.way;
        }
        let remembered: Vec<_> =
            found_open.directions.iter().filter(|towards| normal.dot(towards) >= MIN_RISE).copied().collect();
        look.cast(&remembered);
        let part_from_point = UnitQuaternion::rotation_between(&Vector3::z(), normal).unwrap_or_else(half_turn);
        for parts in batches {
            if look.way >= best {
                break;
            }
            let directions = parts.iter().flat_map(|part| &self.directions[part * PART..(part + 1) * PART]);
            let batch: Vec<_> = directions.map(|direction| part_from_point * direction).collect();
            if let Some(open) = look.cast(&batch) {
                found_open.add(open);
            }
        }
        look.way
    }

    /// Value of an open direction.
    fn way(&self, point_mm: &Point3<f64>, normal: &Vector3<f64>, direction: &Vector3<f64>) -> Way {
        match normal.dot(direction) >= self.min_cos {
            _ if self.setups.is_empty() => Way::Open,
            false => Way::Grazing,
            true if self.is_above(point_mm, direction) => Way::Open,
            true => Way::BelowPlate,
        }
    }

    /// Bound of the value of any direction of a point: where the highest viewpoint that could be used stands below every plate,
    /// there is none above.
    fn best_way(&self, point_mm: &Point3<f64>, normal: &Vector3<f64>) -> Way {
        let max_sin = (1.0 - self.min_cos * self.min_cos).max(0.0).sqrt();
        let may_be_above = |table_from_part: &Pose<Table, Part>| {
            let up = table_from_part.direction(normal).z;
            let rise = if up >= self.min_cos { 1.0 } else { up * self.min_cos + (1.0 - up * up).max(0.0).sqrt() * max_sin };
            table_from_part.point(point_mm).z + self.best_mm * (rise + ROUNDING) > 0.0
        };
        if self.setups.is_empty() || self.setups.iter().any(may_be_above) { Way::Open } else { Way::BelowPlate }
    }

    /// Returns true if the viewpoint in this direction stands above the plate in some setup.
    fn is_above(&self, point_mm: &Point3<f64>, direction: &Vector3<f64>) -> bool {
        let viewpoint_mm = point_mm + direction * self.best_mm;
        self.setups.iter().any(|table_from_part| stands_above(&table_from_part.point(&viewpoint_mm), self.min_elevation_deg))
    }
}
