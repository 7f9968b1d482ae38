//! Triples of neighbours on one plane, from organised clouds at their registered poses. Rows are cut into triples that share no
//! point, so that their second differences are independent. A triple counts where the rays of its three points from the left camera
//! meet the model on one plane, near the points. Cost: a ray a point, in packets; at most 600 000 triples of all views together.

use nalgebra::{Point3, Vector3};

use super::NoiseTriple;
use crate::cell::Scanner;
use crate::geometry::{Hit, Mesh, RayScene};
use crate::inspection::{RegisteredView, ViewScan};
use crate::planning::context::{Cancelled, Context};

/// Triples that are looked at, of all views.
const MAX_TRIPLES: usize = 600_000;
/// Largest distance of a point from the model's surface along its ray, mm.
const MAX_OFF_MM: f64 = 1.0;
/// Largest distance of a plane's corner from another's plane, mm, and of their unit normals from each other.
const SAME_PLANE_MM: f64 = 1e-3;
const SAME_NORMAL: f64 = 1e-5;
/// Minimum cosine of the incidence: beyond it, facets of one plane are seen as a line.
const MIN_COS: f64 = 0.05;
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
            let Some(points) = scan.scanner_cloud.points_mm.get(row * grid.columns..(row + 1) * grid.columns) else { break };
            of_row(input, view, points, ctx, &mut triples);
        }
    }
    Ok(triples)
}

fn of_row(
    input: &TripleInput<'_>,
    view: &RegisteredView,
    points_mm: &[[f32; 3]],
    ctx: &Context<'_>,
    triples: &mut Vec<NoiseTriple>,
) {
    let whole = |three: &&[[f32; 3]]| three.iter().flatten().all(|coordinate| coordinate.is_finite());
    let threes: Vec<[Point3<f64>; 3]> = points_mm
        .chunks_exact(3)
        .filter(whole)
        .map(|three| [0, 1, 2].map(|at: usize| Point3::from(three[at].map(f64::from))))
        .collect();
    let left_mm = input.scanner.devices.left.scanner_from_device.origin_mm();
    let camera_mm = view.part_from_scanner.point(&left_mm);
    let directions: Vec<Vector3<f64>> =
        threes.iter().flatten().map(|point| view.part_from_scanner.point(point) - camera_mm).collect();
    let mut hits = Vec::new();
    input.surfaces.first_hits_from(ctx.simd_level(), &camera_mm, &directions, &mut hits);
    for ((three, hits), directions) in threes.iter().zip(hits.chunks_exact(3)).zip(directions.chunks_exact(3)) {
        let Some(normal) = plane_of(input.mesh, hits, directions) else { continue };
        let scanner_normal = view.part_from_scanner.inverse().direction(&normal);
        let [a, b, c] = three;
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
        let hit = hit.filter(|hit| (hit.share - 1.0).abs() * direction.norm() <= MAX_OFF_MM)?;
        *face = hit.triangle as usize;
    }
    if faces.iter().any(|face| *face >= mesh.faces.len()) {
        return None;
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
