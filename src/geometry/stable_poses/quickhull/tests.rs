use super::*;

/// Numbers that look random; the same on every run (Steele, Lea and Flood 2014, SplitMix).
struct Draw(u64);

impl Draw {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number from −`max` to `max`.
    fn within(&mut self, max: i32) -> i32 {
        (self.next() % (2 * max as u64 + 1)) as i32 - max
    }

    /// A point with coordinates from −`max` to `max`.
    fn point(&mut self, max: i32) -> LatticePoint {
        [0; 3].map(|_| self.within(max))
    }

    /// A point next to a ball about the origin.
    fn on_ball(&mut self, radius: i32) -> LatticePoint {
        let towards = self.point(1 << 20).map(f64::from);
        let length = towards.iter().map(|c| c * c).sum::<f64>().sqrt().max(1.0);
        towards.map(|c| (c / length * f64::from(radius)).round() as i32)
    }
}

fn sorted(mut points: Vec<LatticePoint>) -> Vec<LatticePoint> {
    points.sort_unstable();
    points.dedup();
    points
}

fn hull(points: &[LatticePoint]) -> Option<Vec<ExactFacet>> {
    quickhull(points, &Poll::never()).expect("not interrupted")
}

/// Every facet faces outwards, no point lies above one, and each edge is that of two.
fn assert_closed_and_convex(facets: &[ExactFacet], points: &[LatticePoint], name: &str) {
    let is_below = |facet: &ExactFacet| facet.normal() != [0; 3] && points.iter().all(|point| facet.height(point) <= 0);
    assert!(facets.iter().all(is_below), "{name}");
    let edges = |facet: &ExactFacet| [0, 1, 2].map(|side| (facet.corners[side], facet.corners[(side + 1) % 3]));
    let mut forward: Vec<_> = facets.iter().flat_map(edges).collect();
    let mut backward: Vec<_> = forward.iter().map(|(from, to)| (*to, *from)).collect();
    forward.sort_unstable();
    backward.sort_unstable();
    assert_eq!(forward, backward, "{name}: each edge is that of two facets");
    assert!(forward.windows(2).all(|pair| pair[0] != pair[1]), "{name}: and of no more");
}

#[test]
fn the_hull_is_closed_and_convex_though_its_corners_lie_in_planes_but_for_rounding() {
    let turn = nalgebra::Rotation3::from_euler_angles(0.3, -0.7, 1.1);
    let corner = |number: u32| {
        let angle_rad = std::f64::consts::TAU * f64::from(number / 2) / 120.0;
        let z = f64::from(number % 2) * 60.0;
        let turned = turn * nalgebra::Vector3::new(25.0 * angle_rad.cos(), 25.0 * angle_rad.sin(), z);
        // Steps of 10 µm: the corners of an end do not lie in one plane.
        <[f64; 3]>::from(turned).map(|c| (c * 100.0).round() as i32)
    };
    let points = sorted((0..240).map(corner).collect());
    assert_closed_and_convex(&hull(&points).expect("a volume"), &points, "cylinder");
}

#[test]
fn points_in_a_plane_have_no_hull() {
    let points = sorted((0..20).map(|i| [i * i, 3 * i, i * i + 3 * i]).collect());
    assert!(hull(&points).is_none() && hull(&points[..2]).is_none() && hull(&[]).is_none());
    let line: Vec<LatticePoint> = (0..20).map(|i| [i, 2 * i, -i]).collect();
    assert!(hull(&line).is_none());
}

/// Planes of all sizes, with points in them, one step beside them, and anywhere.
fn planes_and_points() -> Vec<(ExactFacet, Vec<LatticePoint>)> {
    let mut draw = Draw(1);
    let mut cases = Vec::new();
    for size in [1, 2, 30, 1000, 1 << 14, 1 << 20, MAX_STEP / 4] {
        for _ in 0..40 {
            let shift = draw.point(MAX_STEP / 4);
            let shifted = |point: LatticePoint| [0, 1, 2].map(|axis| point[axis] + shift[axis]);
            let corners = [draw.point(size), draw.point(size), draw.point(size)].map(shifted);
            let facet = ExactFacet { corners };
            let [a, b, c] = corners;
            let mut points: Vec<LatticePoint> = corners.into();
            for (i, j) in [(1, 1), (-1, 1), (1, -1), (2, -1), (-1, 2)] {
                points.push([0, 1, 2].map(|axis| a[axis] + i * (b[axis] - a[axis]) + j * (c[axis] - a[axis])));
            }
            for at in 0..points.len() {
                for axis in 0..3 {
                    for step in [-1, 1] {
                        let mut beside = points[at];
                        beside[axis] += step;
                        points.push(beside);
                    }
                }
            }
            points.retain(|point| point.iter().all(|c| c.abs() <= MAX_STEP));
            points.extend((0..20).map(|_| draw.point(MAX_STEP)));
            cases.push((facet, points));
        }
    }
    cases
}

#[test]
fn the_side_of_a_plane_is_that_of_the_integers_in_it_and_one_step_beside_it() {
    let (mut doubtful, mut wrong_by_numbers_alone) = (0, 0);
    for (facet, points) in planes_and_points() {
        let plane = Plane::of(&facet);
        for point in points {
            let (height, exact) = (plane.height(&point.map(f64::from)), facet.height(&point));
            assert_eq!(plane.is_below(&point, height), exact > 0, "{facet:?} {point:?}");
            // The exact height, rounded here, is off by an eighth of the bound at most.
            assert!((height - exact as f64).abs() <= plane.error, "{facet:?} {point:?}: {height} {exact}");
            doubtful += usize::from(height.abs() <= plane.error);
            wrong_by_numbers_alone += usize::from((height > 0.0) != (exact > 0));
        }
    }
    assert!(doubtful > 1000 && wrong_by_numbers_alone > 10, "{doubtful} {wrong_by_numbers_alone}");
}

#[test]
fn the_farthest_point_is_that_of_the_integers_and_of_equals_the_last() {
    for (facet, points) in planes_and_points() {
        let planes = [Plane::of(&facet)];
        let (mut above, mut tallies) = (vec![INSIDE; points.len()], vec![Tally::default()]);
        find_planes(&points, &planes, &mut above, &mut tallies);
        let outside: Vec<_> = points.iter().filter(|point| facet.height(point) > 0).collect();
        assert_eq!(tallies[0].count as usize, outside.len());
        let farthest = outside.into_iter().max_by_key(|point| facet.height(point));
        assert_eq!(tallies[0].farthest.as_ref().map(|farthest| farthest.point), farthest.copied(), "{facet:?}");
    }
}

/// Points of which many lie in one plane, on one line, at one place or on a ball.
fn degenerate(draw: &mut Draw, kind: u32, max: i32) -> LatticePoint {
    let half = max / 2;
    match kind {
        0 => draw.point(max),
        1 => {
            let [x, y, warp] = [draw.within(half), draw.within(half), draw.within(1)];
            [x, y, x + y - x.signum() * warp.max(0)]
        }
        2 => {
            let along = draw.within(max);
            [along, -along, draw.within(1)]
        }
        3 => {
            let [x, y, _] = draw.on_ball(max);
            [x, y, draw.within(1) * half]
        }
        _ => draw.on_ball(max),
    }
}

#[test]
fn facets_and_their_order_are_those_of_the_plain_algorithm_on_degenerate_points() {
    let mut draw = Draw(2);
    let (mut flat, mut solid) = (0, 0);
    for round in 0..1500 {
        let max = [1, 2, 3, 8, 50, 1000, 1 << 20, MAX_STEP][(round % 8) as usize];
        let (kind, count) = (round % 5, 4 + round % 57);
        let points = sorted((0..count).map(|_| degenerate(&mut draw, kind, max)).collect());
        let found = hull(&points);
        assert_eq!(found, plain::quickhull(&points), "round {round}: {points:?}");
        match found {
            Some(facets) => {
                assert_closed_and_convex(&facets, &points, &format!("round {round}"));
                solid += 1;
            }
            None => flat += 1,
        }
    }
    assert!(flat > 20 && solid > 1000, "{flat} {solid}");
}

#[test]
fn facets_of_many_points_are_those_of_the_plain_algorithm() {
    let steps = |count: i32| (0..count).flat_map(move |x| (0..count).flat_map(move |y| (0..count).map(move |z| [x, y, z])));
    let mut draw = Draw(3);
    let rough: Vec<LatticePoint> = (0..40_000).map(|_| draw.on_ball(200)).collect();
    let ball: Vec<LatticePoint> = (0..3_000).map(|_| draw.on_ball(MAX_STEP)).collect();
    let solid: Vec<LatticePoint> = (0..60_000).map(|_| draw.point(MAX_STEP)).collect();
    for (name, points) in [("grid", steps(34).collect()), ("rough ball", rough), ("ball", ball), ("solid", solid)] {
        let points = sorted(points);
        assert!(points.len() > MANY_POINTS || name.ends_with("ball"), "{name}: {}", points.len());
        assert_eq!(hull(&points), plain::quickhull(&points), "{name}");
    }
}

/// The algorithm as it is published, on integers alone: a reference for facets and their order.
mod plain {
    use std::collections::HashMap;

    use super::super::{ExactFacet, LatticePoint, LinkedFacet, tetrahedron};
    use crate::geometry::poll::Poll;

    struct PlainFacet {
        facet: ExactFacet,
        beyond: [usize; 3],
        outside: Vec<LatticePoint>,
        is_gone: bool,
    }

    impl PlainFacet {
        fn new(facet: ExactFacet, beyond: [usize; 3]) -> Self {
            Self { facet, beyond, outside: Vec::new(), is_gone: false }
        }
    }

    pub(super) fn quickhull(points: &[LatticePoint]) -> Option<Vec<ExactFacet>> {
        let first = tetrahedron(points, &Poll::never()).expect("not interrupted")?;
        let plain = |LinkedFacet { facet, beyond, .. }: LinkedFacet| PlainFacet::new(facet, beyond.map(|place| place as usize));
        let mut facets: Vec<PlainFacet> = first.map(plain).into();
        share_out(points.to_vec(), &mut facets);
        let mut next = 0;
        while next < facets.len() {
            let PlainFacet { facet, outside, .. } = &facets[next];
            if let Some(apex) = outside.iter().copied().max_by_key(|point| facet.height(point)) {
                raise(&mut facets, next, apex);
            }
            next += 1;
        }
        Some(facets.iter().filter(|facet| !facet.is_gone).map(|facet| facet.facet).collect())
    }

    fn share_out(outside: Vec<LatticePoint>, facets: &mut [PlainFacet]) {
        for point in outside {
            if let Some(facet) = facets.iter_mut().find(|facet| facet.facet.height(&point) > 0) {
                facet.outside.push(point);
            }
        }
    }

    fn raise(facets: &mut Vec<PlainFacet>, first: usize, apex: LatticePoint) {
        let (mut open, mut outside, mut horizon) = (vec![first], Vec::new(), HashMap::new());
        let mut from = apex;
        facets[first].is_gone = true;
        while let Some(place) = open.pop() {
            outside.append(&mut std::mem::take(&mut facets[place].outside));
            for side in 0..3 {
                let other = facets[place].beyond[side];
                if facets[other].is_gone {
                    continue;
                }
                if facets[other].facet.height(&apex) > 0 {
                    facets[other].is_gone = true;
                    open.push(other);
                } else {
                    from = facets[place].facet.corners[side];
                    horizon.insert(from, (facets[place].facet.corners[(side + 1) % 3], other));
                }
            }
        }
        let (first_new, count) = (facets.len(), horizon.len());
        for place in 0..count {
            let (to, other) = horizon[&from];
            let [next, last] = [1, count - 1].map(|step| first_new + (place + step) % count);
            facets.push(PlainFacet::new(ExactFacet { corners: [from, to, apex] }, [other, next, last]));
            if let Some(side) = facets[other].facet.corners.iter().position(|corner| *corner == to) {
                facets[other].beyond[side] = first_new + place;
            }
            from = to;
        }
        share_out(outside, &mut facets[first_new..]);
    }
}
