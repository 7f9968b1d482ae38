//! Surface that a scan shows around a sample's image beside the model: each point of 3 × 3 cells against the face that its own ray
//! meets. The points of an exact scan lie on those faces, whatever edges the cells straddle and however few there are.
//!
//! Where a view lies a little off sideways, the ray beside an edge meets the wrong face: the face of a neighbour's ray counts instead
//! where it lies twice as near. One of the same side, the other level of a step, is taken for its plane, and one of another side, a
//! wall, for itself.
//!
//! The scatter is that of second differences along rows and columns on even surface: neither an offset nor a tilt has any. Where there
//! are none, it is that of the differences of neighbours. Their medians, of two middle ones the smaller, are 0.6745·√6 and 0.6745·√2
//! of the standard deviation of independent normal errors.
//!
//! Cost: nine rays a sample.

use std::array;

use nalgebra::{Point3, Vector3};

use crate::geometry::{Mesh, Part, Pose, ScannerFrame, nearest_of_triangle, sort_ascending};
use crate::inspection::coverage::{NominalModel, SeenSample, ViewLookup};
use crate::planning::context::Context;

/// Cells along one side, all of them, and the place of the sample's own.
const SIDE: usize = 3;
const CELLS: usize = SIDE * SIDE;
const OWN: usize = CELLS / 2;
/// Fewest points beyond their tolerance on one side that show a surface.
const MIN_POINTS: usize = 3;
/// Multiple of the scatter by which such points lie off the model, unless so many and such a share of all lie on that side.
const SCATTERS: f64 = 4.0;
const SURE_POINTS: usize = 6;
const SURE_SHARE: f64 = 0.85;
/// Medians of the absolute second and first differences of errors of standard deviation 1.
const SECOND_OF_SIGMA: f64 = 1.652;
const FIRST_OF_SIGMA: f64 = 0.954;
/// Largest angle between the normals of even surface: cos 30°.
const EVEN_COS: f64 = 0.866;
/// Multiple of the expected noise from which on points scatter more than they should.
const NOISES: f64 = 2.0;
/// Scatter, as a share of the distance between the points that a normal is taken from, that may turn it by 30°.
const TURNING_SHARE: f64 = 0.1;

/// Distance of a point from the model.
#[derive(Clone, Copy, Debug)]
struct Off {
    /// Positive in front of the model.
    distance_mm: f64,
    tolerance_mm: f64,
}

impl Off {
    fn is_beyond(&self) -> bool {
        self.distance_mm.abs() > self.tolerance_mm
    }
}

/// Plane of the model where the ray of a point meets it.
struct MetPlane {
    face: usize,
    point_mm: Point3<f64>,
    normal: Vector3<f64>,
    tolerance_mm: f64,
    noise_mm: f64,
}

impl MetPlane {
    /// Distance of a point from the plane, positive in front of it.
    fn distance_mm(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&(point - self.point_mm))
    }

    fn is_of_side(&self, other: &Self) -> bool {
        self.normal.dot(&other.normal) >= EVEN_COS
    }

    /// Returns true if another plane goes on from this one, without an edge or a step between the points where they are met.
    fn is_even_with(&self, other: &Self) -> bool {
        let rise_mm = self.distance_mm(&other.point_mm).abs();
        self.is_of_side(other) && rise_mm <= 0.5 * (other.point_mm - self.point_mm).norm()
    }

    /// Distance of a point, whose own ray meets `own`, from the face of this plane.
    fn beside_mm(&self, point: &Point3<f64>, own: &Self, mesh: &Mesh) -> f64 {
        let distance_mm = self.distance_mm(point);
        if self.is_of_side(own) {
            return distance_mm;
        }
        (nearest_of_triangle(&mesh.corners(self.face), point).0 - point).norm().copysign(distance_mm)
    }
}

/// Points around a sample's image, row by row; `None` where there is no point, or no model on its ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShownSurface {
    off: [Option<Off>; CELLS],
    /// Standard deviation of the points' errors; 0 where no neighbours tell it.
    scatter_mm: f64,
    /// Largest noise expected of one of them.
    noise_mm: f64,
    /// Scatter that may turn the normals.
    turning_mm: f64,
}

impl ShownSurface {
    /// Surface around the image of a sample; `None` where its cell has no point.
    pub(super) fn of(
        lookup: &ViewLookup<'_>,
        seen: &SeenSample,
        pose: &Pose<Part, ScannerFrame>,
        model: &NominalModel<'_>,
        ctx: &Context<'_>,
    ) -> Option<Self> {
        let grid = lookup.cloud.grid();
        let cell = grid.cell_of(&seen.scanner_mm)?;
        let centre_mm = pose.point(&grid.centre_mm());
        let points: [Option<Point3<f64>>; CELLS] = array::from_fn(|place| {
            let [right, down] = [place % SIDE, place / SIDE].map(|number| number as isize - 1);
            lookup.cloud.neighbour(cell, right, down).map(|point| pose.point(&point))
        });
        let rays: Vec<Vector3<f64>> = points.iter().flatten().map(|point| point - centre_mm).collect();
        let mut hits = Vec::new();
        model.surfaces().first_hits_from(ctx.simd_level(), &centre_mm, &rays, &mut hits);
        let mut hits = hits.into_iter();
        let met: [Option<MetPlane>; CELLS] = points.map(|point| {
            let ray = point? - centre_mm;
            let hit = hits.next().flatten().filter(|hit| (hit.triangle as usize) < model.mesh().faces.len())?;
            let (face, point_mm) = (hit.triangle as usize, centre_mm + ray * hit.share);
            let normal = model.mesh().scaled_normal(face).normalize();
            let precision = lookup.view.precision_at(&point_mm, &normal);
            let tolerance_mm = lookup.tolerance_mm(&precision);
            (precision.cos > 0.0).then_some(MetPlane { face, point_mm, normal, tolerance_mm, noise_mm: precision.noise_mm })
        });
        points[OWN]?;
        let off_at = |place: usize| Some(off_of(&points[place]?, met[place].as_ref()?, &met, model.mesh()));
        let off: [Option<Off>; CELLS] = array::from_fn(off_at);
        let is_even = |a: usize, b: usize| met[a].as_ref().zip(met[b].as_ref()).is_some_and(|(a, b)| a.is_even_with(b));
        let reach_mm = lookup.reach(seen) as f64 * grid.step_px * seen.precision.spacing_mm * seen.precision.cos;
        let noise_mm = met.iter().flatten().map(|met| met.noise_mm).fold(0.0, f64::max);
        Some(Self { off, scatter_mm: scatter_mm(&off, is_even), noise_mm, turning_mm: TURNING_SHARE * reach_mm })
    }

    /// Returns true if points lie off the model on one side by more than their tolerance: some, farther than they scatter, or most.
    pub(super) fn deviates(&self) -> bool {
        [1.0, -1.0].into_iter().any(|side| {
            let of_side = |off: &&Off| off.is_beyond() && side * off.distance_mm > 0.0;
            let beyond: Vec<f64> = self.off.iter().flatten().filter(of_side).map(|off| off.distance_mm.abs()).collect();
            let count = beyond.len() as f64;
            let is_sure = beyond.len() >= SURE_POINTS && count >= SURE_SHARE * self.off.iter().flatten().count() as f64;
            let is_far = beyond.iter().sum::<f64>() > SCATTERS * self.scatter_mm * count;
            beyond.len() >= MIN_POINTS && (is_sure || is_far)
        })
    }

    /// Returns true if the sample's own point lies off the model by more than its tolerance, or if the points scatter by more than
    /// twice the expected noise and so much that they may turn a normal.
    pub(super) fn is_noisy(&self) -> bool {
        let is_beyond = self.off[OWN].is_some_and(|own| own.is_beyond());
        is_beyond || self.scatter_mm > (NOISES * self.noise_mm).max(self.turning_mm)
    }
}

/// Standard deviation of the points' errors, of those that lie on even surface with their neighbours.
fn scatter_mm(off: &[Option<Off>; CELLS], is_even: impl Fn(usize, usize) -> bool) -> f64 {
    let distance_mm = |place: usize| off[place].map(|off| off.distance_mm);
    let (mut first_mm, mut second_mm) = (Vec::new(), Vec::new());
    for line in 0..SIDE {
        for [a, b, c] in [[SIDE * line, SIDE * line + 1, SIDE * line + 2], [line, line + SIDE, line + 2 * SIDE]] {
            let differences_mm = [(a, b), (b, c)].map(|(from, to)| {
                let difference_mm = distance_mm(to)? - distance_mm(from)?;
                is_even(from, to).then_some(difference_mm)
            });
            first_mm.extend(differences_mm.into_iter().flatten());
            if let [Some(before_mm), Some(after_mm)] = differences_mm {
                second_mm.push(after_mm - before_mm);
            }
        }
    }
    let (mut differences_mm, of_sigma) =
        if second_mm.is_empty() { (first_mm, FIRST_OF_SIGMA) } else { (second_mm, SECOND_OF_SIGMA) };
    sort_ascending(&mut differences_mm, |difference_mm| difference_mm.abs());
    let middle = differences_mm.len().saturating_sub(1) / 2;
    differences_mm.get(middle).map_or(0.0, |difference_mm| difference_mm.abs() / of_sigma)
}

/// Distance of a point from the plane that its ray meets; beyond the tolerance, from that of a neighbour which is twice as near.
fn off_of(point: &Point3<f64>, own: &MetPlane, met: &[Option<MetPlane>; CELLS], mesh: &Mesh) -> Off {
    let off = Off { distance_mm: own.distance_mm(point), tolerance_mm: own.tolerance_mm };
    if !off.is_beyond() {
        return off;
    }
    let beside = |plane: &MetPlane| Off { distance_mm: plane.beside_mm(point, own, mesh), tolerance_mm: plane.tolerance_mm };
    let nearest = met.iter().flatten().map(beside).min_by(|a, b| a.distance_mm.abs().total_cmp(&b.distance_mm.abs()));
    nearest.filter(|nearest| 2.0 * nearest.distance_mm.abs() <= off.distance_mm.abs()).unwrap_or(off)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspection::shots::normal;

    /// Even surface whose points lie so far off the model.
    fn shown(distance_mm: impl Fn(usize) -> f64) -> ShownSurface {
        let off = array::from_fn(|place| Some(Off { distance_mm: distance_mm(place), tolerance_mm: 0.15 }));
        ShownSurface { off, scatter_mm: scatter_mm(&off, |_, _| true), noise_mm: 0.012, turning_mm: 0.05 }
    }

    #[test]
    fn a_surface_that_lies_off_deviates_and_one_that_is_exact_does_not() {
        let exact = shown(|_| 1e-4);
        assert!(!exact.deviates() && !exact.is_noisy());
        let off: [fn(usize) -> f64; 4] = [
            |_| 0.6,
            |_| -0.2,
            |place| 0.2 + 0.4 * (place % SIDE) as f64,
            |place| if place.is_multiple_of(SIDE) { 0.0 } else { 0.6 },
        ];
        for (case, distance_mm) in off.into_iter().enumerate() {
            assert!(shown(distance_mm).deviates(), "{case}");
        }
        // One point that is off shows no surface.
        let spike = shown(|place| if place == OWN { 0.6 } else { 0.0 });
        assert!(!spike.deviates() && spike.is_noisy());
    }

    #[test]
    fn scatter_is_noise_only_beyond_what_is_expected() {
        let counts = |sd_mm: f64| {
            let noisy = (0..1000_u64).map(|seed| shown(|place| sd_mm * normal(9 * seed + place as u64)));
            noisy.fold([0, 0], |[deviating, noisy], shown| {
                [deviating + usize::from(shown.deviates()), noisy + usize::from(shown.is_noisy())]
            })
        };
        assert_eq!(counts(0.012), [0, 0], "as expected");
        let [deviating, noisy] = counts(0.24);
        assert!(deviating < 50 && noisy > 900, "{deviating} deviate, {noisy} are noisy");
    }
}
