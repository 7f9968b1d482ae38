//! Triples of neighbours on one plane, from organised clouds at their registered poses. Rows are cut into triples that share no
//! point, so that their second differences are independent. A triple counts where the rays of its three points from the left camera
//! meet the model on one plane, near the points. Cost: a ray a point, in packets; at most 600 000 triples of all views together.
//!
//! The normal is that of the surface itself, by points to four sides that go on evenly through the triple: of a part that is bent by one or
//! two degrees the model's is wrong by as much, and the noise along a ray by twice the change of the cosine, which depends on the side from
//! which a view looks and so on the depth. Where no such points are, it is the model's.

use nalgebra::{Point3, Vector3};

use super::NoiseTriple;
use crate::cell::Scanner;
use crate::geometry::{CloudGrid, Hit, Mesh, PointCloud, RayScene};
use crate::inspection::{RegisteredView, ViewScan};
use crate::planning::context::{Cancelled, Context};

/// Triples that are looked at, of all views.
const MAX_TRIPLES: usize = 600_000;
/// Largest distance of a point from the model's surface, across it, mm. Along the ray it would leave out points by their noise where a
/// surface that deviates is seen flatly, those of the most noise first.
const MAX_OFF_MM: f64 = 1.0;
/// Largest distance of a plane's corner from another's plane, mm, and of their unit normals from each other.
const SAME_PLANE_MM: f64 = 1e-3;
const SAME_NORMAL: f64 = 1e-5;
/// Minimum cosine of the incidence: beyond it, facets of one plane are seen as a line.
const MIN_COS: f64 = 0.05;
/// Distance of the points that tell the surface's own normal, mm: noise of 0.03 mm turns it by no more than half a degree. The nearest that
/// may be used are two cells off, which are none of the triple's.
const NORMAL_REACH_MM: f64 = 3.0;
const MIN_REACH: usize = 2;
/// Largest distance of the middle point from the middle of two such points, across the model's plane, mm: beyond it the surface is curved or
/// has an edge. And largest sine of the angle between both normals (5°): beyond it the points are of another face. Both are our choice.
const EVEN_MM: f64 = 0.1;
const MAX_TURN_SIN: f64 = 0.087;
/// Factor that gives a second difference the deviation of one point: 1² + 2 · ½² = 1.5.
const SCALE: f64 = 1.5;

/// The part that scans are of.
#[derive(Clone, Copy)]
pub struct TripleInput<'a> {
    /// The part.
    pub mesh: &'a Mesh,
    /// Rays against it.
    pub surfaces: &'a RayScene,
    /// The scanner.
    pub scanner: &'a Scanner,
}

/// Collects the triples of organised clouds, each with its registered view.
///
/// # Errors
/// [`Cancelled`].
pub fn triples(
    input: &TripleInput<'_>,
    scans: &[(&ViewScan, &RegisteredView)],
    ctx: &Context<'_>,
) -> Result<Vec<NoiseTriple>, Cancelled> {
    let cells: usize = scans
        .iter()
        .filter(|(scan, _)| scan.scanner_cloud.grid.is_some())
        .map(|(scan, _)| scan.scanner_cloud.points_mm.len())
        .sum();
    let every = (cells / 3).div_ceil(MAX_TRIPLES).max(1);
    let mut triples = Vec::new();
    for (scan, view) in scans {
        let Some(grid) = scan.scanner_cloud.grid else { continue };
        for row in (0..grid.rows).step_by(every) {
            ctx.check()?;
            of_row(input, view, &CloudRow { cloud: &scan.scanner_cloud, grid, row }, ctx, &mut triples);
        }
    }
    Ok(triples)
}

/// Row of an organised cloud.
struct CloudRow<'a> {
    cloud: &'a PointCloud,
    grid: CloudGrid,
    row: usize,
}

impl CloudRow<'_> {
    /// Point of a column, so many rows further down.
    fn point(&self, column: Option<usize>, down: isize) -> Option<Point3<f64>> {
        let (column, row) = (column.filter(|column| *column < self.grid.columns)?, self.row.checked_add_signed(down)?);
        let point = self.cloud.points_mm.get(row * self.grid.columns + column)?;
        point.iter().all(|coordinate| coordinate.is_finite()).then(|| Point3::from(point.map(f64::from)))
    }

    /// Triples of the row that are whole, each with the column of its middle point.
    fn threes(&self) -> Vec<(usize, [Point3<f64>; 3])> {
        let three = |first: usize| {
            let [a, b, c] = [0, 1, 2].map(|right| self.point(Some(first + right), 0));
            Some((first + 1, [a?, b?, c?]))
        };
        (0..self.grid.columns.saturating_sub(2)).step_by(3).filter_map(three).collect()
    }

    /// Vector between points to both sides of a column's, along the row or across it, where the surface goes on evenly through that one.
    fn along(&self, column: usize, middle_mm: &Point3<f64>, normal: &Vector3<f64>, is_row: bool) -> Option<Vector3<f64>> {
        let at = |away: isize| {
            if is_row { self.point(column.checked_add_signed(away), 0) } else { self.point(Some(column), away) }
        };
        let spacing_mm = 0.5 * (at(1)? - at(-1)?).norm();
        let reach = ((NORMAL_REACH_MM / spacing_mm).ceil() as usize).clamp(MIN_REACH, self.grid.columns) as isize;
        let (before_mm, after_mm) = (at(-reach)?, at(reach)?);
        let off_mm = (nalgebra::center(&before_mm, &after_mm) - middle_mm).dot(normal);
        let vector = after_mm - before_mm;
        (off_mm.abs() <= EVEN_MM && vector.dot(normal).abs() <= MAX_TURN_SIN * vector.norm()).then_some(vector)
    }

    /// The surface's own unit normal at a point, on the side of the model's, scanner frame.
    fn own_normal(&self, column: usize, middle_mm: &Point3<f64>, normal: &Vector3<f64>) -> Option<Vector3<f64>> {
        let [along, across] = [true, false].map(|is_row| self.along(column, middle_mm, normal, is_row));
        let own = along?.cross(&across?).try_normalize(0.0)?;
        Some(if own.dot(normal) < 0.0 { -own } else { own })
    }
}

fn of_row(input: &TripleInput<'_>, view: &RegisteredView, row: &CloudRow<'_>, ctx: &Context<'_>, triples: &mut Vec<NoiseTriple>) {
    let threes = row.threes();
    let left_mm = input.scanner.devices.left.scanner_from_device.origin_mm();
    let camera_mm = view.part_from_scanner.point(&left_mm);
    let directions: Vec<Vector3<f64>> =
        threes.iter().flat_map(|(_, three)| three).map(|point| view.part_from_scanner.point(point) - camera_mm).collect();
    let mut hits = Vec::new();
    input.surfaces.first_hits_from(ctx.simd_level(), &camera_mm, &directions, &mut hits);
    for (((column, three), hits), directions) in threes.iter().zip(hits.chunks_exact(3)).zip(directions.chunks_exact(3)) {
        let Some(normal) = plane_of(input.mesh, hits, directions) else { continue };
        let [a, b, c] = three;
        let of_model = view.part_from_scanner.inverse().direction(&normal);
        let scanner_normal = row.own_normal(*column, b, &of_model).unwrap_or(of_model);
        let cos_incidence = -scanner_normal.dot(&b.coords) / b.coords.norm();
        if cos_incidence < MIN_COS {
            continue;
        }
        let second = b - nalgebra::center(a, c);
        triples.push(NoiseTriple { depth_mm: b.z, cos_incidence, across_mm: second.dot(&scanner_normal) / SCALE.sqrt() });
    }
}

/// Unit normal of the plane on which rays meet the model, near the points that they lead to.
fn plane_of(mesh: &Mesh, hits: &[Option<Hit>], directions: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    let mut faces = [0; 3];
    for ((face, hit), direction) in faces.iter_mut().zip(hits).zip(directions) {
        let hit = hit.filter(|hit| (hit.triangle as usize) < mesh.faces.len())?;
        let normal = mesh.scaled_normal(hit.triangle as usize).try_normalize(0.0)?;
        if ((hit.share - 1.0) * direction.dot(&normal)).abs() > MAX_OFF_MM {
            return None;
        }
        *face = hit.triangle as usize;
    }
    let normal = mesh.scaled_normal(faces[1]).try_normalize(0.0)?;
    let corner = mesh.corners(faces[1])[0];
    let is_same = |face: &usize| {
        *face == faces[1]
            || mesh.scaled_normal(*face).try_normalize(0.0).is_some_and(|other| (other - normal).norm() <= SAME_NORMAL)
                && (mesh.corners(*face)[0] - corner).dot(&normal).abs() <= SAME_PLANE_MM
    };
    faces.iter().all(is_same).then_some(normal)
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix6;

    use super::*;
    use crate::geometry::{Part, Pose, ScannerFrame};
    use crate::inspection::identification::noise;
    use crate::inspection::rehearsal::in_context;
    use crate::inspection::shots::Shots;
    use crate::inspection::simulated_scanner::{ScannedScene, SimulatedScanner, SimulatedView, SimulationParams};
    use crate::planning::params::PlanParams;

    /// Sheet of 160 × 100 mm, bent up at both ends by so much.
    fn sheet(bend_mm: f64) -> Mesh {
        const COLUMNS: u32 = 80;
        let vertex = |number: u32| {
            let x_mm = 160.0 * f64::from(number / 2) / f64::from(COLUMNS) - 80.0;
            Point3::new(x_mm, if number.is_multiple_of(2) { -50.0 } else { 50.0 }, bend_mm * (x_mm / 80.0).powi(2))
        };
        let strip = |column: u32| [[0, 2, 3], [0, 3, 1]].map(|face| face.map(|corner: u32| 2 * column + corner));
        let faces: Vec<[u32; 3]> = (0..COLUMNS).flat_map(strip).collect();
        let vertices_mm = (0..2 * (COLUMNS + 1)).map(vertex).collect();
        Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
    }

    /// The gain was told as 0.88 for 1: points were left out by their distance along the ray, and noise was taken across the model's surface.
    #[test]
    fn the_noise_of_a_bent_part_grows_with_depth_as_that_of_the_scanner_does() {
        let (flat, built) = (sheet(0.0), sheet(2.0));
        let shots = Shots::of(&flat, 10);
        let views: Vec<(u32, Pose<Part, ScannerFrame>)> = (1..).zip(shots.poses(6).into_iter().take(4)).collect();
        let surfaces = RayScene::new([&flat]);
        let input = TripleInput { mesh: &flat, surfaces: &surfaces, scanner: &shots.scanner };
        let gain = |seed: u64| {
            let scene = ScannedScene { as_built: &built, fixture: None, plate: None, unknown: None, face_albedo: None };
            let (params, sim) = (PlanParams::default(), SimulationParams { step_px: 10, seed, ..SimulationParams::default() });
            let scans = in_context(|ctx| SimulatedScanner::new(&shots.scanner, &params, &sim, scene, ctx)?.scan(&views, ctx));
            let scans = scans.expect("nobody cancels");
            let placed = |view: &SimulatedView| RegisteredView {
                viewpoint: view.scan.viewpoint,
                part_from_scanner: view.true_part_from_scanner,
                covariance: Matrix6::zeros(),
                is_in_prior: true,
            };
            let poses: Vec<RegisteredView> = scans.iter().map(placed).collect();
            let placed: Vec<_> = scans.iter().map(|view| &view.scan).zip(&poses).collect();
            let found = in_context(|ctx| triples(&input, &placed, ctx)).expect("nobody cancels");
            noise(&found, &shots.scanner).expect("enough triples").depth_gain.value
        };
        let gain = [1, 2].map(gain).iter().sum::<f64>() / 2.0;
        assert!((gain - 1.0).abs() < 0.07, "{gain}");
    }
}
