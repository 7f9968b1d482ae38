//! Depth buffer of patches. Triangles are rasterised with fixed-point edge functions (Pineda, *A Parallel Algorithm for Polygon
//! Rasterization*, 1988), which leave no cracks between neighbours and give the same result on every run. Camera frame: +z
//! forward, +x right, +y down.

use std::ops::Range;

use nalgebra::Point3;

use super::camera::Camera;

/// Steps of the fixed-point grid per sample.
const STEPS: i64 = 16;
/// Relative increase of the depth of back faces, so that of two coincident sheets the one that faces the camera is seen.
const BACK_BIAS: f64 = 1e-5;
/// Clamp on coordinates, in steps, far outside any picture: their products then fit 64 bits.
const FAR_STEPS: f64 = 1e9;
const NOTHING: u32 = u32::MAX;

/// The nearest patch at each sample, row-major.
pub(super) struct DepthBuffer {
    width: usize,
    height: usize,
    /// 1/z, which is linear across the picture of a plane; 0 where there is no patch.
    inverse_depth: Vec<f32>,
    patch: Vec<u32>,
}

/// A corner on the fixed-point grid.
#[derive(Clone, Copy)]
struct Corner {
    x: i64,
    y: i64,
    inverse_depth: f64,
}

/// An edge function over the fixed-point grid: not negative on the inner side.
struct Edge {
    dx: i64,
    dy: i64,
    at_origin: i64,
}

impl Edge {
    fn between(a: Corner, b: Corner) -> Self {
        let (dx, dy) = (b.x - a.x, b.y - a.y);
        Self { dx, dy, at_origin: dy * a.x - dx * a.y }
    }

    fn at(&self, x: i64, y: i64) -> i64 {
        self.dx * y - self.dy * x + self.at_origin
    }

    /// Value below 0 at one step outside the edge. Points within it are drawn too: where a long edge meets two short ones,
    /// as in some files, rounding would otherwise leave pinholes.
    fn tolerance(&self) -> i64 {
        self.dx.abs().max(self.dy.abs())
    }
}

impl DepthBuffer {
    /// An empty buffer.
    pub(super) fn new(size_px: [usize; 2]) -> Self {
        let [width, height] = size_px;
        Self { width, height, inverse_depth: vec![0.0; width * height], patch: vec![NOTHING; width * height] }
    }

    /// The patch seen at a sample.
    pub(super) fn patch_at(&self, x: usize, y: usize) -> Option<u32> {
        let inside = x < self.width && y < self.height;
        inside.then(|| self.patch[y * self.width + x]).filter(|patch| *patch != NOTHING)
    }

    /// Depth along +z of the camera at a sample, mm; infinite where there is no patch.
    pub(super) fn depth_mm(&self, x: usize, y: usize) -> f64 {
        1.0 / f64::from(self.inverse_depth[y * self.width + x])
    }

    /// Draws a triangle given in the camera's frame that is already clipped at the near plane.
    pub(super) fn draw(&mut self, fine: &Camera, corners_mm: [Point3<f64>; 3], patch: u32) {
        let [Some(a), Some(b), Some(c)] = corners_mm.map(|p| corner(fine, &p)) else { return };
        let (Some(triangle), Some(columns), Some(rows)) =
            (Triangle::new(a, b, c), span([a.x, b.x, c.x], self.width), span([a.y, b.y, c.y], self.height))
        else {
            return;
        };
        for y in rows {
            let mut values = triangle.values(columns.start, y);
            for at in columns.clone().map(|x| y * self.width + x) {
                if let Some(inverse_depth) = triangle.inverse_depth(&values).filter(|depth| *depth > self.inverse_depth[at]) {
                    self.inverse_depth[at] = inverse_depth;
                    self.patch[at] = patch;
                }
                triangle.step(&mut values);
            }
        }
    }
}

/// A triangle on the fixed-point grid.
struct Triangle {
    edges: [Edge; 3],
    /// Inverse depths at the corners opposite to the edges.
    inverse_depths: [f64; 3],
    twice_area: i64,
}

impl Triangle {
    /// Sets up a triangle; `None` if it is seen edge-on.
    fn new(a: Corner, b: Corner, c: Corner) -> Option<Self> {
        // With y down, a triangle that is counter-clockwise seen from outside has a negative area when it faces the camera.
        let (b, c, twice_area, bias) = match Edge::between(a, b).at(c.x, c.y) {
            0 => return None,
            facing if facing < 0 => (c, b, -facing, 1.0),
            away => (b, c, away, 1.0 - BACK_BIAS),
        };
        let edges = [Edge::between(b, c), Edge::between(c, a), Edge::between(a, b)];
        Some(Self { edges, inverse_depths: [a, b, c].map(|corner| corner.inverse_depth * bias), twice_area })
    }

    /// Edge functions at the centre of a sample.
    fn values(&self, x: usize, y: usize) -> [i64; 3] {
        let [x, y] = [x, y].map(|n| n as i64 * STEPS + STEPS / 2);
        [0, 1, 2].map(|i| self.edges[i].at(x, y))
    }

    /// Moves on to the next sample of the row.
    #[inline]
    fn step(&self, values: &mut [i64; 3]) {
        values.iter_mut().zip(&self.edges).for_each(|(value, edge)| *value -= edge.dy * STEPS);
    }

    /// 1/z where the edge functions have these values; `None` outside the triangle.
    #[inline]
    fn inverse_depth(&self, values: &[i64; 3]) -> Option<f32> {
        if (0..3).any(|i| values[i] + self.edges[i].tolerance() < 0) {
            return None;
        }
        let weighted: f64 = (0..3).map(|i| values[i] as f64 * self.inverse_depths[i]).sum();
        // Within the tolerance, the plane of a sliver would extrapolate far beyond its corners.
        let nearest = self.inverse_depths.into_iter().fold(0.0, f64::max);
        Some((weighted / self.twice_area as f64).min(nearest) as f32)
    }
}

fn corner(fine: &Camera, p: &Point3<f64>) -> Option<Corner> {
    let [x, y] = fine.pixel(p)?.map(|c| (c * STEPS as f64).round().clamp(-FAR_STEPS, FAR_STEPS) as i64);
    Some(Corner { x, y, inverse_depth: 1.0 / p.z })
}

/// Range of samples whose centres can lie between the lowest and the highest corner, one step of tolerance included.
fn span(corners: [i64; 3], size: usize) -> Option<Range<usize>> {
    let low = corners.into_iter().min()?.saturating_sub(1 + STEPS / 2).div_euclid(STEPS).max(0);
    let high = (corners.into_iter().max()? + 1).div_euclid(STEPS).min(size as i64 - 1);
    (low <= high).then(|| low as usize..high as usize + 1)
}
