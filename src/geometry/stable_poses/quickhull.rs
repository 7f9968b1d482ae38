//! Convex hull of points on a grid, exact (C. B. Barber, D. P. Dobkin, H. Huhdanpaa 1996, *The quickhull algorithm for convex
//! hulls*, ACM Transactions on Mathematical Software 22(4)). Integers keep it convex and closed where many corners lie in one
//! plane but for rounding; that of floating-point numbers has holes there and facets that face inwards.
//!
//! Points that the hull does not hold yet are kept in outside sets, each above a facet; the farthest of a set is the next apex,
//! and a point that lies above none of its new facets is inside for good. The side of a plane that a point lies on is told by
//! floating-point numbers where their rounding cannot change it, else by 128-bit integers (J. R. Shewchuk 1997, *Adaptive
//! precision floating-point arithmetic and fast robust geometric predicates*, Discrete & Computational Geometry 18(3)): the hull
//! is that of the integers.
//!
//! Facets come in the order in which they are made, on any number of threads: apexes are added one after another, and large
//! outside sets, most of the work where few points are corners, are shared out on all cores.
//! Cost: O(n log n) for n points of a ball, about 1 µs a point; 64 bytes for each facet of the hull, and some 60 for each point.

use crate::geometry::poll::{Interrupted, Poll};
use crate::geometry::side_by_side::{self, PIECE};

#[cfg(test)]
mod tests;

/// Largest coordinate, either way: a difference of two fits into 31 bits, a normal into 63, a height into 128.
pub(super) const MAX_STEP: i32 = 1 << 29;
/// Error of a height in floating-point numbers, as a share of the sum of the normal's components. Differences of coordinates, up
/// to 2³⁰, are exact. The normal, the products and two sums round by a share of 2⁻⁵³ each: 4 · 2⁻⁵³ · 2³⁰ and terms of higher
/// order, for which, and for the rounding of the bound itself, as much again is allowed.
const HEIGHT_ROUNDING: f64 = 1.0 / (1 << 20) as f64;
/// Points that are shared out on all cores; for fewer it takes longer.
const MANY_POINTS: usize = 2 * PIECE;
/// Number of a facet that is gone.
const GONE: u32 = u32::MAX;
/// Place, among planes, of a point that lies above none.
const INSIDE: u32 = u32::MAX;

/// A point in steps of the grid, up to [`MAX_STEP`].
pub(super) type LatticePoint = [i32; 3];

/// A triangle of the hull.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ExactFacet {
    /// Counter-clockwise seen from outside.
    pub(super) corners: [LatticePoint; 3],
}

impl ExactFacet {
    /// Outward normal, twice as long as the area.
    pub(super) fn normal(&self) -> [i64; 3] {
        let [a, b, c] = &self.corners;
        cross(&difference(b, a), &difference(c, a))
    }

    /// Height of a point above it, in lengths of its normal.
    pub(super) fn height(&self, point: &LatticePoint) -> i128 {
        dot(&self.normal(), &difference(point, &self.corners[0]))
    }

    /// Side that begins at a corner.
    fn side_from(&self, corner: &LatticePoint) -> Option<usize> {
        self.corners.iter().position(|other| other == corner)
    }
}

fn difference(a: &LatticePoint, b: &LatticePoint) -> [i64; 3] {
    [0, 1, 2].map(|axis| i64::from(a[axis]) - i64::from(b[axis]))
}

fn cross(a: &[i64; 3], b: &[i64; 3]) -> [i64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: &[i64; 3], b: &[i64; 3]) -> i128 {
    let term = |axis: usize| i128::from(a[axis]) * i128::from(b[axis]);
    term(0) + term(1) + term(2)
}

/// Facets of the convex hull of points, which are sorted and of which no two are equal; `None` for what is flat.
///
/// # Errors
/// [`Interrupted`].
pub(super) fn quickhull(points: &[LatticePoint], poll: &Poll<'_>) -> Result<Option<Vec<ExactFacet>>, Interrupted> {
    let Some(first) = tetrahedron(points, poll)? else { return Ok(None) };
    let mut hull = GrowingHull::new(first);
    hull.share_out(points, poll)?;
    while !hull.waiting.is_empty() {
        hull.raise_all(poll)?;
    }
    Ok(Some(hull.into_facets()))
}

/// Four points far apart, as a hull; `None` where all points lie in a plane.
fn tetrahedron(points: &[LatticePoint], poll: &Poll<'_>) -> Result<Option<[LinkedFacet; 4]>, Interrupted> {
    let Some(a) = points.first() else { return Ok(None) };
    let squared = |length: &[i64; 3]| dot(length, length);
    let Some(b) = farthest(points, |p| squared(&difference(p, a)), poll)? else { return Ok(None) };
    let edge = difference(&b, a);
    let Some(c) = farthest(points, |p| squared(&cross(&edge, &difference(p, a))), poll)? else { return Ok(None) };
    let normal = cross(&edge, &difference(&c, a));
    let Some(d) = farthest(points, |p| dot(&normal, &difference(p, a)).abs(), poll)? else { return Ok(None) };
    // Seen from outside the first three corners are counter-clockwise if the fourth lies below them.
    let [b, c] = if dot(&normal, &difference(&d, a)) > 0 { [c, b] } else { [b, c] };
    let facet = |number, corners, beyond| LinkedFacet { facet: ExactFacet { corners }, beyond, number, begin: 0, count: 0 };
    Ok(Some([
        facet(0, [*a, b, c], [1, 2, 3]),
        facet(1, [*a, d, b], [3, 2, 0]),
        facet(2, [b, d, c], [1, 3, 0]),
        facet(3, [c, d, *a], [2, 1, 0]),
    ]))
}

/// The point at the greatest distance, the last of equals; `None` where none is at any.
fn farthest(
    points: &[LatticePoint],
    distance: impl Fn(&LatticePoint) -> i128 + Sync,
    poll: &Poll<'_>,
) -> Result<Option<LatticePoint>, Interrupted> {
    let pieces: Vec<&[LatticePoint]> = points.chunks(PIECE).collect();
    let of_piece =
        |piece: &&[LatticePoint]| piece.iter().map(|point| (distance(point), *point)).max_by_key(|(distance, _)| *distance);
    let of_pieces = side_by_side::map(&pieces, of_piece, poll)?;
    let farthest = of_pieces.into_iter().flatten().max_by_key(|(distance, _)| *distance);
    Ok(farthest.filter(|(distance, _)| *distance > 0).map(|(_, point)| point))
}

/// A facet of a hull that grows: one line of the cache.
#[derive(Clone, Copy)]
struct LinkedFacet {
    facet: ExactFacet,
    /// Place of the facet beyond the side from each corner to the next.
    beyond: [u32; 3],
    /// Number of facets that were made before it; [`GONE`] once another apex lies above it.
    number: u32,
    /// Number of points in its outside set.
    count: u32,
    /// Number of points that were put into outside sets before these.
    begin: u64,
}

/// A facet with an outside set.
struct Waiting {
    place: u32,
    /// Number of the facet: another facet may have taken its place.
    number: u32,
    /// The farthest point of the set.
    apex: LatticePoint,
}

/// Side of a facet that an apex lies above, next to one that it does not lie above.
struct HorizonSide {
    from: LatticePoint,
    to: LatticePoint,
    /// Place of the facet beyond it.
    beyond: u32,
}

/// A side of a facet that is gone and still at its place.
struct RemovedSide {
    place: u32,
    side: usize,
}

struct GrowingHull {
    /// A facet takes the place of one that is gone, if there is one.
    facets: Vec<LinkedFacet>,
    free: Vec<u32>,
    /// Number of facets that were ever made.
    made: u32,
    /// Facets with outside sets, in the order of their numbers. Some may be gone.
    waiting: Vec<Waiting>,
    /// Outside sets, one after another, without the first ones, which are empty by now.
    sets: Vec<LatticePoint>,
    /// Number of points in those.
    emptied: u64,
    /// Places of the facets that were made last.
    newest: Vec<u32>,
    scratch: Scratch,
}

/// Room for the work on one apex.
#[derive(Default)]
struct Scratch {
    open: Vec<u32>,
    horizon: Vec<HorizonSide>,
    outside: Vec<LatticePoint>,
    planes: Vec<Plane>,
    above: Vec<u32>,
    tallies: Vec<Tally>,
}

impl GrowingHull {
    fn new(first: [LinkedFacet; 4]) -> Self {
        Self {
            facets: first.into(),
            free: Vec::new(),
            made: 4,
            waiting: Vec::new(),
            sets: Vec::new(),
            emptied: 0,
            newest: vec![0, 1, 2, 3],
            scratch: Scratch::default(),
        }
    }

    /// Facets in the order in which they were made.
    fn into_facets(self) -> Vec<ExactFacet> {
        let mut place_of = vec![GONE; self.made as usize];
        for (place, facet) in (0..).zip(&self.facets) {
            if facet.number != GONE {
                place_of[facet.number as usize] = place;
            }
        }
        place_of.retain(|place| *place != GONE);
        place_of.into_iter().map(|place| self.facets[place as usize].facet).collect()
    }

    /// Raises the hull to the farthest point of every outside set that there is. Only new facets have outside sets then.
    fn raise_all(&mut self, poll: &Poll<'_>) -> Result<(), Interrupted> {
        let end = self.sets.len();
        for Waiting { place, number, apex } in std::mem::take(&mut self.waiting) {
            if self.facets[place as usize].number == number {
                self.raise(place, &apex, poll)?;
            }
        }
        self.sets.drain(..end);
        self.emptied += end as u64;
        Ok(())
    }

    /// Replaces the facets below an apex, `first` among them, by those from the horizon to it.
    fn raise(&mut self, first: u32, apex: &LatticePoint, poll: &Poll<'_>) -> Result<(), Interrupted> {
        let mut outside = std::mem::take(&mut self.scratch.outside);
        outside.clear();
        let (side, count) = self.remove_below(apex, first, &mut outside);
        self.walk_horizon(side, count);
        self.close(apex);
        self.share_out(&outside, poll)?;
        self.scratch.outside = outside;
        Ok(())
    }

    /// Removes the facets below an apex, `first` among them, and adds their outside sets to `outside`. Returns a side of the horizon,
    /// and how many there are. Until new facets are made the removed ones stay at their places.
    fn remove_below(&mut self, apex: &LatticePoint, first: u32, outside: &mut Vec<LatticePoint>) -> (RemovedSide, usize) {
        let open = &mut self.scratch.open;
        let (mut count, mut last) = (0, RemovedSide { place: first, side: 0 });
        self.facets[first as usize].number = GONE;
        open.push(first);
        while let Some(place) = open.pop() {
            let facet = self.facets[place as usize];
            self.free.push(place);
            if facet.count > 0 {
                let begin = (facet.begin - self.emptied) as usize;
                outside.extend_from_slice(&self.sets[begin..begin + facet.count as usize]);
            }
            for (side, beyond) in facet.beyond.into_iter().enumerate() {
                let other = &mut self.facets[beyond as usize];
                if other.number == GONE {
                    continue;
                }
                if other.facet.height(apex) > 0 {
                    other.number = GONE;
                    open.push(beyond);
                } else {
                    (count, last) = (count + 1, RemovedSide { place, side });
                }
            }
        }
        (last, count)
    }

    /// Lists the sides of the horizon, each beginning where the one before ends.
    fn walk_horizon(&mut self, mut from: RemovedSide, count: usize) {
        let mut horizon = std::mem::take(&mut self.scratch.horizon);
        horizon.clear();
        for _ in 0..count {
            let LinkedFacet { facet, beyond, .. } = &self.facets[from.place as usize];
            let next = (from.side + 1) % 3;
            horizon.push(HorizonSide { from: facet.corners[from.side], to: facet.corners[next], beyond: beyond[from.side] });
            from = self.turned_around(&facet.corners[next], RemovedSide { place: from.place, side: next });
        }
        self.scratch.horizon = horizon;
    }

    /// The side of the horizon that begins at a corner: turns around the corner, from one removed facet to the next.
    fn turned_around(&self, corner: &LatticePoint, mut from: RemovedSide) -> RemovedSide {
        loop {
            let place = self.facets[from.place as usize].beyond[from.side];
            let other = &self.facets[place as usize];
            match other.facet.side_from(corner) {
                Some(side) if other.number == GONE => from = RemovedSide { place, side },
                _ => return from,
            }
        }
    }

    /// Closes the hull by facets from the horizon to an apex.
    fn close(&mut self, apex: &LatticePoint) {
        self.newest.clear();
        for HorizonSide { from, to, beyond } in &self.scratch.horizon {
            let facet = ExactFacet { corners: [*from, *to, *apex] };
            let new = LinkedFacet { facet, beyond: [*beyond; 3], number: self.made, begin: 0, count: 0 };
            self.made += 1;
            let place = self.free.pop().unwrap_or(self.facets.len() as u32);
            match self.facets.get_mut(place as usize) {
                Some(gone) => *gone = new,
                None => self.facets.push(new),
            }
            let other = &mut self.facets[*beyond as usize];
            if let Some(side) = other.facet.side_from(to) {
                other.beyond[side] = place;
            }
            self.newest.push(place);
        }
        let count = self.newest.len();
        for (at, place) in self.newest.iter().enumerate() {
            let [next, last] = [1, count - 1].map(|step| self.newest[(at + step) % count]);
            let beyond = &mut self.facets[*place as usize].beyond;
            (beyond[1], beyond[2]) = (next, last);
        }
    }

    /// Puts each point into the outside set of the first of the newest facets that it lies above; the hull holds the others.
    fn share_out(&mut self, outside: &[LatticePoint], poll: &Poll<'_>) -> Result<(), Interrupted> {
        poll.spend(100 * self.newest.len() + 30 * outside.len())?;
        if outside.is_empty() {
            return Ok(());
        }
        let Scratch { planes, above, tallies, .. } = &mut self.scratch;
        planes.clear();
        planes.extend(self.newest.iter().map(|place| Plane::of(&self.facets[*place as usize].facet)));
        above.clear();
        above.resize(outside.len(), INSIDE);
        tallies.clear();
        tallies.resize(planes.len(), Tally::default());
        if outside.len() < MANY_POINTS {
            find_planes(outside, planes, above, tallies);
        } else {
            find_planes_of_many(outside, planes, above, tallies, poll)?;
        }
        for (place, tally) in self.newest.iter().zip(tallies.iter_mut()) {
            let facet = &mut self.facets[*place as usize];
            (facet.begin, facet.count) = (self.emptied + self.sets.len() as u64, tally.count);
            if let Some(Farthest { point, .. }) = &tally.farthest {
                self.waiting.push(Waiting { place: *place, number: facet.number, apex: *point });
            }
            tally.next = self.sets.len();
            self.sets.resize(self.sets.len() + tally.count as usize, [0; 3]);
        }
        for (point, above) in outside.iter().zip(above.iter()) {
            if *above != INSIDE {
                let tally = &mut tallies[*above as usize];
                self.sets[tally.next] = *point;
                tally.next += 1;
            }
        }
        Ok(())
    }
}

/// Plane of a facet, with the heights of points above it in floating-point numbers.
struct Plane {
    normal: [f64; 3],
    base: [f64; 3],
    /// Bound of the error of a height.
    error: f64,
    facet: ExactFacet,
}

impl Plane {
    fn of(facet: &ExactFacet) -> Self {
        let normal = facet.normal().map(|c| c as f64);
        let error = HEIGHT_ROUNDING * normal.iter().map(|c| c.abs()).sum::<f64>();
        Self { normal, base: facet.corners[0].map(f64::from), error, facet: *facet }
    }

    /// Height of a point, with an error of up to `error`.
    fn height(&self, point: &[f64; 3]) -> f64 {
        let term = |axis: usize| self.normal[axis] * (point[axis] - self.base[axis]);
        term(0) + term(1) + term(2)
    }

    /// Returns true if a point whose height in floating-point numbers is known lies above the plane.
    fn is_below(&self, point: &LatticePoint, height: f64) -> bool {
        height > self.error || (height >= -self.error && self.facet.height(point) > 0)
    }
}

/// Outside set of a facet, while it is counted.
#[derive(Clone, Default)]
struct Tally {
    count: u32,
    farthest: Option<Farthest>,
    /// Place of its next point.
    next: usize,
}

#[derive(Clone)]
struct Farthest {
    point: LatticePoint,
    height: f64,
    exact: i128,
}

impl Tally {
    /// Counts a point above the plane. Of equally far ones the last is the farthest.
    fn add(&mut self, point: &LatticePoint, height: f64, plane: &Plane) {
        self.count += 1;
        // Each height has an error, and the comparison rounds too.
        if self.farthest.as_ref().is_some_and(|farthest| height < farthest.height - 4.0 * plane.error) {
            return;
        }
        let exact = plane.facet.height(point);
        if self.farthest.as_ref().is_none_or(|farthest| exact >= farthest.exact) {
            self.farthest = Some(Farthest { point: *point, height, exact });
        }
    }

    /// Adds a tally of later points.
    fn append(&mut self, later: Self) {
        self.count += later.count;
        if let Some(other) = later.farthest
            && self.farthest.as_ref().is_none_or(|farthest| other.exact >= farthest.exact)
        {
            self.farthest = Some(other);
        }
    }
}

/// Finds the first plane that each point lies above.
fn find_planes(points: &[LatticePoint], planes: &[Plane], above: &mut [u32], tallies: &mut [Tally]) {
    for (point, above) in points.iter().zip(above) {
        let at = point.map(f64::from);
        for (place, plane) in planes.iter().enumerate() {
            let height = plane.height(&at);
            if plane.is_below(point, height) {
                *above = place as u32;
                tallies[place].add(point, height, plane);
                break;
            }
        }
    }
}

/// [`find_planes`] on all cores.
fn find_planes_of_many(
    points: &[LatticePoint],
    planes: &[Plane],
    above: &mut [u32],
    tallies: &mut [Tally],
    poll: &Poll<'_>,
) -> Result<(), Interrupted> {
    // Where there are many planes the tallies take no more memory than the points.
    let piece = PIECE.max(8 * planes.len());
    let mut tallies_of: Vec<Vec<Tally>> = points.chunks(piece).map(|_| vec![Tally::default(); planes.len()]).collect();
    let pieces: Vec<_> = points.chunks(piece).zip(above.chunks_mut(piece)).zip(&mut tallies_of).collect();
    side_by_side::for_each(pieces, |((points, above), tallies)| find_planes(points, planes, above, tallies), poll)?;
    for of_piece in tallies_of {
        tallies.iter_mut().zip(of_piece).for_each(|(tally, later)| tally.append(later));
    }
    Ok(())
}
