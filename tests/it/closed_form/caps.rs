//! Area common to spherical caps on the unit sphere, by Gauss and Bonnet: 2π − Σ cos ψ · Δφ − Σ turns, where Δφ is the
//! angle about its axis of each arc of the border and a turn is the angle between the two circles at a corner.

use std::f64::consts::PI;

use nalgebra::Vector3;

/// All points at most `half_angle` from `axis` (unit).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cap {
    pub(crate) axis: Vector3<f64>,
    pub(crate) half_angle: f64,
}

impl Cap {
    fn holds(&self, p: &Vector3<f64>) -> bool {
        self.axis.dot(p) >= self.half_angle.cos() - 1e-12
    }

    fn point_at(&self, angle: f64) -> Vector3<f64> {
        let (u, v) = self.basis();
        self.axis * self.half_angle.cos() + (u * angle.cos() + v * angle.sin()) * self.half_angle.sin()
    }

    /// Angle about the axis, counter-clockwise seen from outside.
    fn angle_of(&self, p: &Vector3<f64>) -> f64 {
        let (u, v) = self.basis();
        p.dot(&v).atan2(p.dot(&u)).rem_euclid(2.0 * PI)
    }

    fn basis(&self) -> (Vector3<f64>, Vector3<f64>) {
        let other = if self.axis.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        let u = self.axis.cross(&other).normalize();
        (u, self.axis.cross(&u))
    }
}

/// Area common to `caps`, which must be smaller than half spheres; 0 where they have nothing in common.
pub(crate) fn common_area(caps: &[Cap]) -> f64 {
    let corners = corners(caps);
    if corners.is_empty() {
        // Nested or apart: the smallest one, if all others hold it.
        let smallest = caps.iter().min_by(|a, b| a.half_angle.total_cmp(&b.half_angle));
        return smallest
            .filter(|small| caps.iter().all(|cap| cap.holds(&small.point_at(0.0))))
            .map_or(0.0, |small| 2.0 * PI * (1.0 - small.half_angle.cos()));
    }
    let arcs: f64 = (0..caps.len()).map(|i| caps[i].half_angle.cos() * border_angle(caps, i, &corners)).sum();
    let turns: f64 = corners.iter().map(|(i, j, p)| caps[*i].axis.cross(p).angle(&caps[*j].axis.cross(p))).sum();
    2.0 * PI - arcs - turns
}

/// Points where the circles of two caps meet inside all the others.
fn corners(caps: &[Cap]) -> Vec<(usize, usize, Vector3<f64>)> {
    let mut found = Vec::new();
    for (i, a) in caps.iter().enumerate() {
        for (j, b) in caps.iter().enumerate().skip(i + 1) {
            // p = s·a + t·b ± w·(a × b), with p·a and p·b the cosines of the half angles.
            let (c, across) = (a.axis.dot(&b.axis), a.axis.cross(&b.axis));
            let (ca, cb) = (a.half_angle.cos(), b.half_angle.cos());
            let sine2 = 1.0 - c * c;
            let within = a.axis * ((ca - c * cb) / sine2) + b.axis * ((cb - c * ca) / sine2);
            let rest = 1.0 - within.norm_squared();
            if sine2 > 1e-12 && rest > 0.0 {
                for sign in [-1.0, 1.0] {
                    let p = within + across * (sign * (rest / sine2).sqrt());
                    if caps.iter().enumerate().all(|(k, cap)| k == i || k == j || cap.holds(&p)) {
                        found.push((i, j, p));
                    }
                }
            }
        }
    }
    found
}

/// Angle about the axis of cap `i` over which its circle borders the common area.
fn border_angle(caps: &[Cap], i: usize, corners: &[(usize, usize, Vector3<f64>)]) -> f64 {
    let on_circle = corners.iter().filter(|(a, b, _)| *a == i || *b == i);
    let mut angles: Vec<f64> = on_circle.map(|(_, _, p)| caps[i].angle_of(p)).collect();
    angles.sort_by(f64::total_cmp);
    let next = angles.iter().skip(1).copied().chain(angles.first().map(|first| first + 2.0 * PI));
    angles
        .iter()
        .zip(next)
        .filter(|(from, to)| {
            let middle = caps[i].point_at(0.5 * (*from + to));
            caps.iter().enumerate().all(|(k, cap)| k == i || cap.holds(&middle))
        })
        .map(|(from, to)| to - from)
        .sum()
}

#[test]
fn octant_is_an_eighth_of_the_sphere() {
    let nearly = PI / 2.0 - 1e-9;
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let caps = axes.map(|axis| Cap { axis, half_angle: nearly });
    assert!((common_area(&caps) - PI / 2.0).abs() < 1e-7);
}

#[test]
fn lune_and_nested_and_distant_caps() {
    let cap = |angle: f64, half_angle: f64| Cap { axis: Vector3::new(angle.sin(), 0.0, angle.cos()), half_angle };
    // Two half spheres 1 rad apart leave a lune of π − 1 rad: 2 (π − 1).
    let lune = common_area(&[cap(0.0, PI / 2.0 - 1e-9), cap(1.0, PI / 2.0 - 1e-9)]);
    assert!((lune - 2.0 * (PI - 1.0)).abs() < 1e-7, "{lune}");
    let nested = common_area(&[cap(0.0, 1.0), cap(0.1, 0.3), cap(0.0, 1.2)]);
    assert!((nested - 2.0 * PI * (1.0 - 0.3_f64.cos())).abs() < 1e-12);
    assert_eq!(common_area(&[cap(0.0, 0.2), cap(1.0, 0.3)]), 0.0);
}
