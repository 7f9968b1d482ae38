//! Quality of a calibration from observations: epipolar distances, triangulated pitch of the board, residuals by view, coverage of
//! images and depth.
//!
//! Epipolar: for a point in both cameras, the distance of each undistorted pixel from the epipolar line of the other (Hartley and
//! Zisserman, 2nd edition, section 11.4), E = \[t\]× R; mean of both. Pitch: points triangulated as the middle of the shortest
//! segment between both rays; distance between neighbours minus that on the board.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Vector3};

use super::adjust::{Adjusted, PixelResidual};
use super::observations::{BoardObservations, BoardView};
use crate::cell::scanner::left_from_scanner;
use crate::cell::{DeviceName, PerDevice};

/// Cells of an image along u and v.
const CELLS: [usize; 2] = [8, 6];
/// Factor beyond the median of all views at which a view's residual is large.
const LARGE: f64 = 2.0;
/// Standard deviations beyond the mean of squares that a view of this many points may have.
const SIGMAS: f64 = 4.0;
/// Share of a view's sightings that may be left out.
const MAX_LEFT_OUT: f64 = 0.2;

/// Quality of one view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewQuality {
    /// Name of the view.
    pub id: String,
    /// Residual of each device, root mean square of all sightings, px; `None` where the device does not see the board.
    pub rms_px: PerDevice<Option<f64>>,
    /// Sightings left out.
    pub left_out: usize,
    /// Depth of the board's middle, scanner frame, mm; `None` for a view that was not used.
    pub depth_mm: Option<f64>,
    /// Angle between the board's normal and the scanner's z, degrees.
    pub tilt_deg: Option<f64>,
    /// Device whose residual says that the view is better left out, and that residual in medians of all views.
    pub leave_out: Option<(DeviceName, f64)>,
}

/// Coverage of a device's image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceCoverage {
    /// Share of 8 × 6 cells of the image with a sighting.
    pub cells: f64,
    /// Largest distance of a sighting from the image's middle, as a share of that of the corners.
    pub radius: f64,
}

/// Quality of a calibration.
#[derive(Clone, Debug, PartialEq)]
pub struct Quality {
    /// Root mean square distance from epipolar lines, px; `None` without points in both cameras.
    pub epipolar_rms_px: Option<f64>,
    /// Root mean square and mean error of triangulated distances between neighbours of the board, mm, and their number.
    pub pitch: Option<(f64, f64, usize)>,
    /// Views.
    pub views: Vec<ViewQuality>,
    /// Coverage of images.
    pub coverage: PerDevice<Option<DeviceCoverage>>,
    /// Depths of the board's points, scanner frame, mm.
    pub depth_mm: Option<[f64; 2]>,
    /// Views with the devices whose image of them was refused: most of its points do not fit the other views.
    pub refused: Vec<(String, Vec<DeviceName>)>,
}

/// Judges observations by the calibration that was made of them.
#[must_use]
pub fn quality(observations: &BoardObservations, adjusted: &Adjusted) -> Quality {
    // An image that was refused says nothing about the rig.
    let is_refused =
        |place: usize| adjusted.refused.iter().any(|(view, device)| *view == place && *device != DeviceName::Projector);
    let of_view = |(place, view): (usize, &BoardView)| if is_refused(place) { Vec::new() } else { pairs(view, adjusted) };
    let pairs: Vec<Vec<Pair>> = observations.views.iter().enumerate().map(of_view).collect();
    let scanner_from_left = left_from_scanner(&adjusted.device_from_left.right.inverse()).inverse();
    let depths = observations.views.iter().zip(&adjusted.left_from_board).filter_map(|(view, board)| Some((view, (*board)?)));
    let depths = depths.flat_map(|(view, board)| {
        let seen = view.seen.iter().flatten();
        seen.map(move |sighting| (scanner_from_left * (board * sighting.board_mm)).z).collect::<Vec<_>>()
    });
    let depth = depths.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], z| [f64::min(low, z), f64::max(high, z)]);
    Quality {
        epipolar_rms_px: epipolar(&pairs, adjusted),
        pitch: pitch(observations, &pairs, adjusted),
        views: views(observations, adjusted, &scanner_from_left),
        coverage: coverage(observations),
        depth_mm: (depth[0] <= depth[1]).then_some(depth),
        refused: refused(observations, adjusted),
    }
}

fn refused(observations: &BoardObservations, adjusted: &Adjusted) -> Vec<(String, Vec<DeviceName>)> {
    let of_view = |(place, view): (usize, &BoardView)| {
        let own = adjusted.refused.iter().filter(|(refused, _)| *refused == place).map(|(_, device)| *device);
        let devices: Vec<DeviceName> = own.collect();
        (!devices.is_empty()).then(|| (view.id.clone(), devices))
    };
    observations.views.iter().enumerate().filter_map(of_view).collect()
}

/// A point in both cameras: its number, and its rays, each in its camera.
struct Pair {
    point: u32,
    left: Vector3<f64>,
    right: Vector3<f64>,
}

fn pairs(view: &BoardView, adjusted: &Adjusted) -> Vec<Pair> {
    let (Some(left_lens), Some(right_lens)) = (adjusted.lens.left, adjusted.lens.right) else { return Vec::new() };
    let right: BTreeMap<u32, Vector3<f64>> =
        view.seen.right.iter().filter_map(|sighting| Some((sighting.point, right_lens.ray(&sighting.pixel)?))).collect();
    let pair = |sighting: &super::observations::DeviceSighting| {
        let right = *right.get(&sighting.point)?;
        Some(Pair { point: sighting.point, left: left_lens.ray(&sighting.pixel)?, right })
    };
    view.seen.left.iter().filter_map(pair).collect()
}

fn epipolar(pairs: &[Vec<Pair>], adjusted: &Adjusted) -> Option<f64> {
    let (left_lens, right_lens) = (adjusted.lens.left?, adjusted.lens.right?);
    let pose = &adjusted.device_from_left.right;
    let essential = pose.translation.vector.cross_matrix() * pose.rotation.to_rotation_matrix();
    let focal = |fx: f64, fy: f64| (fx * fy).abs().sqrt();
    let (left_px, right_px) = (focal(left_lens.fx, left_lens.fy), focal(right_lens.fx, right_lens.fy));
    let squares = pairs.iter().flatten().map(|pair| {
        let (line, back) = (essential * pair.left, essential.transpose() * pair.right);
        let off = pair.right.dot(&line).abs();
        let mean_px = 0.5 * (off / line.xy().norm() * right_px + off / back.xy().norm() * left_px);
        mean_px * mean_px
    });
    let (sum, count) = squares.fold((0.0, 0_usize), |(sum, count), square| (sum + square, count + 1));
    (count > 0).then(|| (sum / count as f64).sqrt())
}

/// The point between two rays, left camera frame.
fn triangulate(pair: &Pair, right_from_left: &Isometry3<f64>) -> Option<Point3<f64>> {
    let centre = right_from_left.inverse().translation.vector;
    let (a, b) = (pair.left, right_from_left.rotation.inverse() * pair.right);
    let (aa, bb, ab) = (a.dot(&a), b.dot(&b), a.dot(&b));
    let determinant = aa * bb - ab * ab;
    let (s, t) =
        ((bb * a.dot(&centre) - ab * b.dot(&centre)) / determinant, (ab * a.dot(&centre) - aa * b.dot(&centre)) / determinant);
    let middle = (a * s + centre + b * t) * 0.5;
    middle.iter().all(|value| value.is_finite()).then(|| Point3::from(middle))
}

fn pitch(observations: &BoardObservations, pairs: &[Vec<Pair>], adjusted: &Adjusted) -> Option<(f64, f64, usize)> {
    let right_from_left = &adjusted.device_from_left.right;
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0_usize);
    for pairs in pairs {
        let points: BTreeMap<u32, Point3<f64>> =
            pairs.iter().filter_map(|pair| Some((pair.point, triangulate(pair, right_from_left)?))).collect();
        for ([a, b], distance) in &observations.pitch {
            let (Some(a), Some(b)) = (points.get(a), points.get(b)) else { continue };
            let error = (a - b).norm() - distance;
            (squares, sum, count) = (squares + error * error, sum + error, count + 1);
        }
    }
    (count > 0).then(|| ((squares / count as f64).sqrt(), sum / count as f64, count))
}

fn views(observations: &BoardObservations, adjusted: &Adjusted, scanner_from_left: &Isometry3<f64>) -> Vec<ViewQuality> {
    let mut by_view: Vec<PerDevice<Vec<&PixelResidual>>> =
        observations.views.iter().map(|_| PerDevice { left: Vec::new(), right: Vec::new(), projector: Vec::new() }).collect();
    for residual in &adjusted.residuals {
        let lists = &mut by_view[residual.view];
        match residual.device {
            DeviceName::Left => lists.left.push(residual),
            DeviceName::Right => lists.right.push(residual),
            DeviceName::Projector => lists.projector.push(residual),
        }
    }
    let rms = |list: &Vec<&PixelResidual>| {
        let sum: f64 = list.iter().map(|residual| residual.off_px.norm_squared()).sum();
        (!list.is_empty()).then(|| (sum / list.len() as f64).sqrt())
    };
    let all: Vec<PerDevice<Option<f64>>> = by_view.iter().map(|lists| lists.as_ref().map(rms)).collect();
    let median = |device: DeviceName| {
        let mut values: Vec<f64> = all.iter().filter_map(|rms| rms[device]).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or_default()
    };
    let medians =
        PerDevice { left: median(DeviceName::Left), right: median(DeviceName::Right), projector: median(DeviceName::Projector) };
    let described = observations.views.iter().enumerate().zip(by_view.iter().zip(&all));
    described
        .map(|((index, view), (lists, rms_px))| {
            let board = adjusted.left_from_board[index].map(|board| scanner_from_left * board);
            let middle = middle(view);
            let left_out = lists.iter().flatten().filter(|residual| !residual.is_used).count();
            let large = |device: DeviceName| {
                let (rms, count) = (rms_px[device]?, lists[device].len());
                // The mean of n squares of normal lengths scatters by 1/√n of itself; in its root by half of that.
                let expected = 1.0 + SIGMAS * 0.5 / (count as f64).sqrt();
                let own = lists[device].iter().filter(|residual| !residual.is_used).count();
                let is_large = rms > medians[device] * LARGE.max(expected) || own as f64 > MAX_LEFT_OUT * count as f64;
                is_large.then_some((device, rms / medians[device]))
            };
            ViewQuality {
                id: view.id.clone(),
                rms_px: *rms_px,
                left_out,
                depth_mm: board.map(|board| (board * middle).z),
                tilt_deg: board.map(|board| (board.rotation * Vector3::z()).z.abs().min(1.0).acos().to_degrees()),
                leave_out: DeviceName::ALL.into_iter().filter_map(large).max_by(|(_, a), (_, b)| a.total_cmp(b)),
            }
        })
        .collect()
}

/// Mean of the points that a view shows, board frame.
fn middle(view: &BoardView) -> Point3<f64> {
    let points: Vec<Vector3<f64>> = view.seen.iter().flatten().map(|sighting| sighting.board_mm.coords).collect();
    Point3::from(points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64)
}

fn coverage(observations: &BoardObservations) -> PerDevice<Option<DeviceCoverage>> {
    let of = |device: DeviceName| {
        let [width, height] = observations.size_px[device]?.map(f64::from);
        let mut cells = [false; CELLS[0] * CELLS[1]];
        let mut radius = 0.0_f64;
        let mut any = false;
        for sighting in observations.views.iter().flat_map(|view| &view.seen[device]) {
            let cell = |at: f64, size: f64, count: usize| ((at / size * count as f64).max(0.0) as usize).min(count - 1);
            cells[cell(sighting.pixel.y, height, CELLS[1]) * CELLS[0] + cell(sighting.pixel.x, width, CELLS[0])] = true;
            radius = radius.max((sighting.pixel.x - 0.5 * width).hypot(sighting.pixel.y - 0.5 * height));
            any = true;
        }
        let filled = cells.iter().filter(|filled| **filled).count() as f64;
        any.then(|| DeviceCoverage { cells: filled / cells.len() as f64, radius: radius / (0.5 * width).hypot(0.5 * height) })
    };
    PerDevice { left: of(DeviceName::Left), right: of(DeviceName::Right), projector: of(DeviceName::Projector) }
}
