//! Joint estimation of both cameras, the projector and the board's poses from observations.
//!
//! Start: each camera alone ([`super::start`]), their relative pose as the mean over common views, the projector by resection
//! from the boards that the cameras place ([`super::resect`]). Then all together ([`super::equations`]) under Huber's loss on the
//! length of a residual in standard deviations, which are estimated beside it, a value a device (Huber's proposal 2, *Robust
//! Statistics*, 1981, section 6.4): σ² = Σ min(r, kσ)² / (n β), β = 2 (1 − exp(−k²/2)) for two coordinates. Sightings whose
//! residual is beyond 5 σ, which 4 in a million normal ones are, are left out and the rest is estimated anew. An image most of
//! whose sightings are left out shows something else than the board as the others see it, and is refused as a whole; a view
//! without another image is taken out, since nothing fixes its board. Most points of images of few, if not on a line, fix one.

use std::borrow::Cow;

use nalgebra::{DMatrix, Isometry3, Matrix3, Point3, Vector2};

use super::equations::{BundleProblem, BundleState, HUBER, POSES, SHARED, lens_unknowns, pose_unknowns};
use super::fault::{LensError, LensFault};
use super::model::{LENS, LensParameters, PARAMETER_NAMES};
use super::observations::{BoardObservations, BoardView, DeviceSighting};
use super::resect;
use super::start::{MIN_POINTS, board_pose, camera_matrix, homography, mean_pose, placed, transfer_rms_px};
use crate::cell::{DeviceName, PerDevice};
use crate::geometry::counted;

/// Fewest views of each camera, and fewest common views of two devices.
const MIN_VIEWS: usize = 3;
/// Length of a residual, in standard deviations, from which a sighting is left out.
const OUTLIER: f64 = 5.0;
/// Rounds in which standard deviations are estimated anew.
const ROUNDS: usize = 12;
/// Steps of a round.
const STEPS: usize = 25;
/// Square of the step, in standard deviations, that an estimate which has converged may have left before it: a hundredth of a
/// deviation changes no figure that is told. Chosen, with no source.
const SETTLED: f64 = 1e-4;
/// Root mean square of the pixels' changes by that step, px, up to which an estimate has converged as well, however small the
/// deviations: those of pixels without noise are rounding. Chosen, with no source.
const SETTLED_PX: f64 = 1e-6;
/// Smallest standard deviation that is believed, px: below it lies rounding.
const MIN_SIGMA_PX: f64 = 1e-9;
/// Largest standard deviation of a focal length, as a share of it, beyond which the observations leave it open.
const MAX_FOCAL_SIGMA: f64 = 0.05;

/// Misfit of an image to every homography, as a share of the image's width, beyond which its points are not those of the board,
/// or not in their order: distortion leaves a few thousandths, exchanged points a tenth. Chosen between the two; no source.
const MAX_START_MISFIT: f64 = 0.05;
/// Median residual of an image, px, below which it is not refused, however small the standard deviation: no other board is so
/// near.
const MIN_REFUSED_PX: f64 = 1.0;
/// Images of a device, and views, of which one may be refused: where more do not fit, nothing says which of them are right.
const IMAGES_FOR_A_REFUSED: usize = 4;
/// Distance of points from a line, as a share of their length, from which their pixels fix a pose. Chosen; no source.
const MIN_CORNER: f64 = 0.02;
/// Views that are taken out at most: each costs an estimate anew.
const MAX_TAKEN_OUT: usize = 32;

/// Choices of the estimation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AdjustOptions {
    /// Parameters of the lenses that are held at 0, in the order of [`PARAMETER_NAMES`]; only `skew` and the five coefficients can
    /// be.
    pub is_held: [bool; LENS],
}

/// Residual of one sighting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelResidual {
    /// Place of the view.
    pub view: usize,
    /// The device.
    pub device: DeviceName,
    /// Number of the point.
    pub point: u32,
    /// Pixel observed.
    pub pixel: Vector2<f64>,
    /// Observed minus computed, px.
    pub off_px: Vector2<f64>,
    /// False for a sighting that was left out.
    pub is_used: bool,
}

/// Residuals of a device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceResiduals {
    /// Root mean square length, px, of the sightings used.
    pub rms_px: f64,
    /// Standard deviation of a coordinate, px, as it was estimated.
    pub sigma_px: f64,
    /// Sightings used.
    pub used: usize,
    /// Sightings left out.
    pub left_out: usize,
}

/// Result of the estimation; poses are target_from_source in mm.
#[derive(Clone, Debug)]
pub struct Adjusted {
    /// Lenses; `None` for a projector that was not observed.
    pub lens: PerDevice<Option<LensParameters>>,
    /// Poses from the left camera.
    pub device_from_left: PerDevice<Isometry3<f64>>,
    /// Poses of the board; `None` for views that no camera sees well enough.
    pub left_from_board: Vec<Option<Isometry3<f64>>>,
    /// Covariances of the poses of the board, turn then shift, left camera frame, mm and rad.
    pub board_covariance: Vec<Option<nalgebra::Matrix6<f64>>>,
    /// Covariance of the 42 shared unknowns: ten of each lens, then turn and shift of right camera and projector.
    pub covariance: DMatrix<f64>,
    /// Unknowns that were held.
    pub is_held: Vec<bool>,
    /// Residuals by device.
    pub devices: PerDevice<Option<DeviceResiduals>>,
    /// All residuals, in the order of the observations; without those of views that were taken out.
    pub residuals: Vec<PixelResidual>,
    /// Images that were refused, by place of the view and device: most of their points do not fit the other views.
    pub refused: Vec<(usize, DeviceName)>,
    /// True if no further step would change the unknowns, set beside their deviations; false if the estimate ended at its limits
    /// of rounds and steps before.
    pub is_converged: bool,
    /// Steps of the last estimate, over all of its rounds.
    pub iterations: usize,
}

/// Estimates lenses and poses from observations.
///
/// # Errors
/// [`LensError`]: too few views or points, views that leave an unknown open, no convergence, a lens that folds.
pub fn adjust(observations: &BoardObservations, options: &AdjustOptions) -> Result<Adjusted, LensError> {
    let sizes = observations.size_px;
    let camera = |device: DeviceName| -> Result<CameraStart, LensError> {
        let size_px = sizes[device].ok_or_else(|| missing(device, "its image size is not given"))?;
        single(&observations.views, device, size_px, options)
    };
    let CameraStart { lens: left, boards: left_boards, refused: left_refused } = camera(DeviceName::Left)?;
    let CameraStart { lens: right, boards: right_boards, refused: right_refused } = camera(DeviceName::Right)?;
    let pairs: Vec<Isometry3<f64>> =
        left_boards.iter().zip(&right_boards).filter_map(|(left, right)| Some((*right)? * (*left)?.inverse())).collect();
    let right_from_left = mean_pose(&pairs).filter(|_| pairs.len() >= MIN_VIEWS).ok_or_else(|| {
        let detail = format!("{} seen by both cameras; at least {MIN_VIEWS}, better 15", counted(pairs.len(), "view"));
        LensError::new(LensFault::TooFew, "/views", detail)
    })?;
    let placed_boards: Vec<Option<Isometry3<f64>>> = left_boards
        .iter()
        .zip(&right_boards)
        .map(|(left, right)| left.or_else(|| right.map(|board| right_from_left.inverse() * board)))
        .collect();
    let projector = projector_start(observations, &placed_boards, options)?;
    let kept: Vec<usize> = (0..placed_boards.len()).filter(|view| placed_boards[*view].is_some()).collect();
    let views: Vec<BoardView> = kept.iter().map(|view| observations.views[*view].clone()).collect();
    let (projector_lens, projector_from_left) = projector.unwrap_or((left, Isometry3::identity()));
    let state = BundleState {
        lens: PerDevice { left, right, projector: projector_lens },
        device_from_left: PerDevice { left: Isometry3::identity(), right: right_from_left, projector: projector_from_left },
        left_from_board: placed_boards.iter().flatten().copied().collect(),
    };
    let mut is_held = [false; SHARED];
    for device in DeviceName::ALL {
        is_held[lens_unknowns(device)].copy_from_slice(&options.is_held);
    }
    if projector.is_none() {
        is_held[lens_unknowns(DeviceName::Projector)].fill(true);
        is_held[pose_unknowns(DeviceName::Projector)].fill(true);
    }
    let views = if projector.is_some() { views } else { views.into_iter().map(without_projector).collect() };
    let solved = solve(&views, state, is_held)?;
    solved.check()?;
    let mut adjusted = solved.finish(observations, &kept, &views, projector.is_some());
    // A view that the other camera places is judged with all others; one that no camera places is refused here.
    let alone = [(DeviceName::Left, left_refused), (DeviceName::Right, right_refused)];
    let alone = alone.into_iter().flat_map(|(device, views)| views.into_iter().map(move |view| (view, device)));
    adjusted.refused.extend(alone.filter(|(view, _)| placed_boards[*view].is_none()));
    adjusted.refused.sort_unstable();
    Ok(adjusted)
}

fn missing(device: DeviceName, detail: &str) -> LensError {
    LensError::new(LensFault::MissingDevice, format!("/{}", device.as_str()), detail)
}

fn without_projector(view: BoardView) -> BoardView {
    BoardView { seen: PerDevice { projector: Vec::new(), ..view.seen }, ..view }
}

/// One camera alone.
struct CameraStart {
    lens: LensParameters,
    /// Poses of the board before it, by view.
    boards: Vec<Option<Isometry3<f64>>>,
    /// Views whose image does not fit the others.
    refused: Vec<usize>,
}

/// One camera alone: its lens and the poses of the board before it.
fn single(views: &[BoardView], device: DeviceName, size_px: [u32; 2], options: &AdjustOptions) -> Result<CameraStart, LensError> {
    let mut homographies: Vec<Option<Matrix3<f64>>> = views.iter().map(|view| homography(&view.seen[device])).collect();
    let mut refused = refuse_misfits(&mut homographies, views, device, size_px);
    let found: Vec<Matrix3<f64>> = homographies.iter().flatten().copied().collect();
    let pointer = format!("/views/*/{}", device.as_str());
    require_views(found.len(), views, device, &pointer)?;
    let degenerate =
        || LensError::new(LensFault::Degenerate, pointer.clone(), "no lens explains the views; are the points in order?");
    let start = camera_matrix(&found, size_px).ok_or_else(degenerate)?;
    let poses: Vec<Option<Isometry3<f64>>> = homographies.iter().map(|h| board_pose(&start, &(*h)?)).collect();
    let kept: Vec<usize> = (0..views.len()).filter(|view| poses[*view].is_some()).collect();
    let alone = |view: &usize| {
        let seen = PerDevice { left: views[*view].seen[device].clone(), right: Vec::new(), projector: Vec::new() };
        BoardView { id: views[*view].id.clone(), seen, stated_distance_mm: None }
    };
    let own: Vec<BoardView> = kept.iter().map(alone).collect();
    let state = BundleState {
        lens: PerDevice::of_cameras(start, start),
        device_from_left: PerDevice::of_cameras(Isometry3::identity(), Isometry3::identity()),
        left_from_board: poses.iter().flatten().copied().collect(),
    };
    let is_held = std::array::from_fn(|index| index >= LENS || options.is_held[index]);
    let Solved { state, kept: solved, refused: unfit, .. } = solve(&own, state, is_held)?;
    let mut boards = vec![None; views.len()];
    for (place, board) in solved.iter().zip(&state.left_from_board) {
        boards[kept[*place]] = Some(*board);
    }
    // The lists of `own` are the left camera's, whichever device it is.
    refused.extend(unfit.iter().map(|(place, _)| kept[*place]));
    Ok(CameraStart { lens: state.lens.left, boards, refused })
}

/// Requires views that a camera can be started from.
fn require_views(found: usize, views: &[BoardView], device: DeviceName, pointer: &str) -> Result<(), LensError> {
    if found >= MIN_VIEWS {
        return Ok(());
    }
    let off_plane_mm =
        views.iter().flat_map(|view| &view.seen[device]).map(|sighting| sighting.board_mm.z.abs()).fold(0.0, f64::max);
    let found = counted(found, "view");
    let detail = if off_plane_mm > 0.0 {
        format!(
            "{found} can be started from: points of the board lie up to {off_plane_mm} mm off z = 0, and the start needs a plane \
             board; give its points in the plane z = 0 of its own frame"
        )
    } else {
        format!(
            "{found} with {MIN_POINTS} points or more that are not on a line; at least {MIN_VIEWS}, better 15 with tilts about two \
             axes"
        )
    };
    Err(LensError::new(LensFault::TooFew, pointer, detail))
}

/// Takes away the homographies of images that no homography explains, if they are few enough; returns their views.
fn refuse_misfits(
    homographies: &mut [Option<Matrix3<f64>>],
    views: &[BoardView],
    device: DeviceName,
    size_px: [u32; 2],
) -> Vec<usize> {
    let limit_px = MAX_START_MISFIT * f64::from(size_px[0]);
    let is_misfit = |view: &usize| {
        homographies[*view].as_ref().is_some_and(|found| {
            let rms_px = transfer_rms_px(&views[*view].seen[device], found);
            rms_px.is_nan() || rms_px > limit_px
        })
    };
    let misfits: Vec<usize> = (0..views.len()).filter(is_misfit).collect();
    if misfits.len() * IMAGES_FOR_A_REFUSED > homographies.iter().flatten().count() {
        return Vec::new();
    }
    misfits.iter().for_each(|view| homographies[*view] = None);
    misfits
}

/// The projector from the boards that the cameras place; `None` if it was not observed.
fn projector_start(
    observations: &BoardObservations,
    boards: &[Option<Isometry3<f64>>],
    options: &AdjustOptions,
) -> Result<Option<(LensParameters, Isometry3<f64>)>, LensError> {
    let Some(size_px) = observations.size_px.projector else { return Ok(None) };
    let seen: Vec<(&[DeviceSighting], Isometry3<f64>)> = observations
        .views
        .iter()
        .zip(boards)
        .filter_map(|(view, board)| Some((view.seen.projector.as_slice(), (*board)?)))
        .filter(|(seen, _)| seen.len() >= MIN_POINTS)
        .collect();
    if seen.is_empty() {
        return Ok(None);
    }
    let points: Vec<_> = seen.iter().flat_map(|(seen, board)| placed(seen, board)).collect();
    let degenerate = |detail: &str| LensError::new(LensFault::Degenerate, "/views/*/projector", detail);
    let start = resect::direct(&points, size_px)
        .ok_or_else(|| degenerate("the points lie on one plane, or on none that a projector lights; tilt and move the board"))?;
    let refined = resect::refine(&points, start, &std::array::from_fn(|index| index >= LENS || options.is_held[index]));
    let refined = refined.ok_or_else(|| degenerate("no lens explains the pixels of the projector"))?;
    Ok(Some((refined.lens, refined.device_from_points)))
}

/// An estimate with what it rests on.
struct Solved {
    /// Places of the views that it rests on, among those given.
    kept: Vec<usize>,
    /// Images that were refused, by place of the view among those given.
    refused: Vec<(usize, DeviceName)>,
    state: BundleState,
    is_used: Vec<PerDevice<Vec<bool>>>,
    is_held: [bool; SHARED],
    sigma_px: PerDevice<f64>,
    covariance: Box<nalgebra::SMatrix<f64, SHARED, SHARED>>,
    board_covariance: Vec<Option<nalgebra::Matrix6<f64>>>,
    is_converged: bool,
    iterations: usize,
}

/// End of an estimate of unknowns and standard deviations.
struct Estimated {
    state: BundleState,
    sigma_px: PerDevice<f64>,
    is_converged: bool,
    iterations: usize,
}

fn lengths(views: &[BoardView], state: &BundleState, is_used: &[PerDevice<Vec<bool>>], device: DeviceName) -> Vec<f64> {
    let of_view = |view: usize| {
        let seen = views[view].seen[device].iter().zip(&is_used[view][device]).filter(|(_, used)| **used);
        seen.map(move |(sighting, _)| state.residual(view, device, sighting).map_or(f64::INFINITY, |off| off.norm()))
    };
    (0..views.len()).flat_map(of_view).collect()
}

/// Standard deviation of a coordinate by proposal 2, from the median as a start (a length in two dimensions has median
/// σ √(2 ln 2)).
fn scale(mut lengths: Vec<f64>) -> f64 {
    if lengths.is_empty() {
        return 1.0;
    }
    lengths.sort_by(f64::total_cmp);
    let beta = 2.0 * (1.0 - (-0.5 * HUBER * HUBER).exp());
    let mut sigma = (lengths[lengths.len() / 2] / (2.0 * 2.0_f64.ln()).sqrt()).max(MIN_SIGMA_PX);
    for _ in 0..50 {
        let sum: f64 = lengths.iter().map(|length| length.min(HUBER * sigma).powi(2)).sum();
        let next = (sum / (beta * lengths.len() as f64)).sqrt().max(MIN_SIGMA_PX);
        let is_done = (next / sigma - 1.0).abs() < 1e-9;
        sigma = next;
        if is_done {
            break;
        }
    }
    sigma
}

/// Views that fit each other, with the estimate that they give.
struct Fitted<'a> {
    views: Cow<'a, [BoardView]>,
    kept: Vec<usize>,
    refused: Vec<(usize, DeviceName)>,
    is_used: Vec<PerDevice<Vec<bool>>>,
    estimated: Estimated,
}

/// Estimates from a start, with outliers left out. Views without an image that fits are taken out one by one, the worst first: it
/// may be what the others do not fit to.
fn fit(given: &[BoardView], mut state: BundleState, is_held: [bool; SHARED]) -> Result<Fitted<'_>, LensError> {
    let mut views = Cow::Borrowed(given);
    let mut kept: Vec<usize> = (0..given.len()).collect();
    let mut refused: Vec<(usize, DeviceName)> = Vec::new();
    loop {
        let mut is_used = all_used(&views);
        let mut estimated = rounds(&views, state, is_held, &is_used, [ROUNDS, STEPS])?;
        if drop_outliers(&views, &estimated, &mut is_used) {
            let images = refuse_images(&views, &estimated.state, &mut is_used);
            let mut worst = worst_view(&views, &estimated.state, &is_used);
            if worst.is_none() && !images.is_empty() {
                // What did not fit beside them may fit without them, and what fitted may not.
                is_used = all_used(&views);
                images.iter().for_each(|(place, device)| is_used[*place][*device].fill(false));
                estimated = rounds(&views, estimated.state, is_held, &is_used, [ROUNDS, STEPS])?;
                drop_outliers(&views, &estimated, &mut is_used);
                worst = worst_view(&views, &estimated.state, &is_used);
            }
            state = estimated.state;
            if let Some(worst) = worst {
                let taken_out = given.len() - views.len();
                if taken_out == MAX_TAKEN_OUT || (taken_out + 1) * IMAGES_FOR_A_REFUSED > given.len() {
                    return Err(unfit(given, &refused, &views[worst]));
                }
                let devices = DeviceName::ALL.into_iter().filter(|device| !views[worst].seen[*device].is_empty());
                refused.extend(devices.map(|device| (kept[worst], device)));
                state.left_from_board.remove(worst);
                kept.remove(worst);
                views.to_mut().remove(worst);
                continue;
            }
            refused.extend(images.iter().map(|(place, device)| (kept[*place], *device)));
            estimated = rounds(&views, state, is_held, &is_used, [ROUNDS, STEPS])?;
        }
        return Ok(Fitted { views, kept, refused, is_used, estimated });
    }
}

/// All sightings, by view and device.
fn all_used(views: &[BoardView]) -> Vec<PerDevice<Vec<bool>>> {
    views.iter().map(|view| view.seen.as_ref().map(|seen| vec![true; seen.len()])).collect()
}

/// Error that names the views that do not fit, where they are too many to go on without them.
fn unfit(given: &[BoardView], refused: &[(usize, DeviceName)], worst: &BoardView) -> LensError {
    let mut names: Vec<&str> = refused.iter().map(|(place, _)| given[*place].id.as_str()).collect();
    names.dedup();
    names.push(&worst.id);
    let detail = format!(
        "views {}: no image of them fits the other views, and they are too many of {} to go on without them; corners of another board, \
         mirrored or in another order? Take them again, or leave them out",
        names.join(", "),
        given.len()
    );
    LensError::new(LensFault::Degenerate, "/views", detail)
}

/// Lengths of the residuals of one image, px, in ascending order.
fn image_lengths(view: &BoardView, state: &BundleState, place: usize, device: DeviceName) -> Vec<f64> {
    let length = |sighting: &DeviceSighting| state.residual(place, device, sighting).map_or(f64::INFINITY, |off| off.norm());
    let mut lengths: Vec<f64> = view.seen[device].iter().map(length).collect();
    lengths.sort_by(f64::total_cmp);
    lengths
}

/// Median residual of one image, px; 0 without points.
fn image_median_px(view: &BoardView, state: &BundleState, place: usize, device: DeviceName) -> f64 {
    let lengths = image_lengths(view, state, place, device);
    lengths.get(lengths.len() / 2).copied().unwrap_or(0.0)
}

/// Leaves out all sightings of images most of whose sightings are outliers, if those of a device are few enough; returns the
/// images by place of the view and device.
fn refuse_images(views: &[BoardView], state: &BundleState, is_used: &mut [PerDevice<Vec<bool>>]) -> Vec<(usize, DeviceName)> {
    let mut images = Vec::new();
    for device in DeviceName::ALL {
        let is_unfit = |place: &usize| {
            let left_out = is_used[*place][device].iter().filter(|used| !**used).count();
            2 * left_out > is_used[*place][device].len()
                && image_median_px(&views[*place], state, *place, device) > MIN_REFUSED_PX
        };
        let unfit: Vec<usize> = (0..views.len()).filter(is_unfit).collect();
        let seen = views.iter().filter(|view| !view.seen[device].is_empty()).count();
        if unfit.len() * IMAGES_FOR_A_REFUSED > seen {
            continue;
        }
        for place in unfit {
            is_used[place][device].fill(false);
            images.push((place, device));
        }
    }
    images
}

/// View without an image that fixes its board, by the sightings that are used; of several the one with the largest residuals.
fn worst_view(views: &[BoardView], state: &BundleState, is_used: &[PerDevice<Vec<bool>>]) -> Option<usize> {
    let is_open = |place: &usize| {
        let is_fixed_by_none = is_used[*place].iter().all(|used| used.iter().filter(|used| **used).count() < MIN_POINTS);
        is_fixed_by_none && !is_fixed_by_most(&views[*place], &is_used[*place])
    };
    let size_px = |place: usize| {
        let medians = DeviceName::ALL.into_iter().map(|device| image_median_px(&views[place], state, place, device));
        medians.fold(0.0, f64::max)
    };
    (0..views.len()).filter(is_open).max_by(|a, b| size_px(*a).total_cmp(&size_px(*b)))
}

/// Returns true if most sightings of the images that were not refused are used, and they fix the board, though no image does with
/// [`MIN_POINTS`]: an image of few points does not show something else because one of them is wrong.
fn is_fixed_by_most(view: &BoardView, is_used: &PerDevice<Vec<bool>>) -> bool {
    let images = DeviceName::ALL.into_iter().filter(|device| is_used[*device].iter().any(|used| *used));
    let sightings: Vec<(&DeviceSighting, bool)> =
        images.flat_map(|device| view.seen[device].iter().zip(is_used[device].iter().copied())).collect();
    let points: Vec<_> = sightings.iter().filter(|(_, used)| *used).map(|(sighting, _)| sighting.board_mm).collect();
    2 * points.len() > sightings.len() && has_corner(&points)
}

/// Returns true if three of the points are not on a line: their pixels fix a pose.
fn has_corner(points: &[Point3<f64>]) -> bool {
    let Some(first) = points.first() else { return false };
    let farthest = points.iter().map(|point| point - first).max_by(|a, b| a.norm().total_cmp(&b.norm()));
    let Some(along) = farthest else { return false };
    let off_mm2 = points.iter().map(|point| along.cross(&(point - first)).norm()).fold(0.0, f64::max);
    off_mm2 > MIN_CORNER * along.norm_squared()
}

/// Estimates from a start, with the covariance.
fn solve(given: &[BoardView], state: BundleState, is_held: [bool; SHARED]) -> Result<Solved, LensError> {
    let Fitted { views, kept, refused, is_used, estimated } = fit(given, state, is_held)?;
    let Estimated { state, sigma_px, is_converged, iterations } = estimated;
    let views: &[BoardView] = &views;
    // Unknowns that were fitted made the residuals smaller.
    let used: usize = is_used.iter().flatten().flatten().filter(|used| **used).count();
    let unknowns = is_held.iter().filter(|held| !**held).count() + 6 * views.len();
    let redundancy = (2 * used).checked_sub(unknowns).filter(|redundancy| *redundancy > 0).ok_or_else(|| {
        LensError::new(LensFault::TooFew, "/views", format!("{used} pixels for {unknowns} unknowns; give more views or points"))
    })?;
    let inflation = (2.0 * used as f64 / redundancy as f64).sqrt();
    let problem = BundleProblem { views, is_used: &is_used, is_held, sigma_px: sigma_px.map(|sigma| sigma * inflation) };
    let normal = problem.normal(&state).ok_or_else(not_converged)?;
    let covariance = normal.covariance().ok_or_else(|| {
        LensError::new(
            LensFault::Degenerate,
            "/views",
            "the views leave a parameter open; tilt the board by 20 to 40° about both axes",
        )
    })?;
    let board_covariance = (0..views.len()).map(|view| normal.board_covariance(view, &covariance)).collect();
    let sigma_px = problem.sigma_px;
    Ok(Solved { kept, refused, state, is_used, is_held, sigma_px, covariance, board_covariance, is_converged, iterations })
}

fn not_converged() -> LensError {
    LensError::new(
        LensFault::NotConverged,
        "/views",
        "the estimate does not converge; are the points of the board in the same order everywhere?",
    )
}

/// Alternates estimates of the unknowns and of the standard deviations, for so many rounds of so many steps at most.
fn rounds(
    views: &[BoardView],
    mut state: BundleState,
    is_held: [bool; SHARED],
    is_used: &[PerDevice<Vec<bool>>],
    [max_rounds, max_steps]: [usize; 2],
) -> Result<Estimated, LensError> {
    let scales = |state: &BundleState| PerDevice::from_fn(|device| scale(lengths(views, state, is_used, device)));
    let mut sigma_px = scales(&state);
    let (mut is_converged, mut iterations) = (false, 0);
    for _ in 0..max_rounds {
        let problem = BundleProblem { views, is_used, is_held, sigma_px };
        let descent = descend(&problem, state, max_steps).ok_or_else(not_converged)?;
        state = descent.state;
        iterations += descent.steps;
        let next = scales(&state);
        let change = next.iter().zip(&sigma_px).map(|(next, before)| (next / before - 1.0).abs()).fold(0.0, f64::max);
        sigma_px = next;
        if change < 1e-3 {
            is_converged = descent.is_done;
            break;
        }
    }
    if !sigma_px.iter().all(|sigma| sigma.is_finite()) {
        return Err(not_converged());
    }
    let is_converged = is_converged || is_settled(&BundleProblem { views, is_used, is_held, sigma_px }, &state);
    Ok(Estimated { state, sigma_px, is_converged, iterations })
}

/// Returns true if the undamped step from here is short beside the deviations of the unknowns, or moves the pixels by rounding
/// alone.
fn is_settled(problem: &BundleProblem<'_>, state: &BundleState) -> bool {
    let count =
        |device: DeviceName| problem.is_used.iter().map(|used| used[device].iter().filter(|used| **used).count()).sum::<usize>();
    let counts = PerDevice::from_fn(count);
    let used = counts.iter().sum::<usize>().max(1) as f64;
    let sigma_px =
        problem.sigma_px.iter().zip(counts).filter(|(_, count)| *count > 0).map(|(sigma, _)| *sigma).fold(0.0, f64::max);
    let square = problem.normal(state).and_then(|normal| normal.step_square());
    square.is_some_and(|square| square <= SETTLED || sigma_px * (square / used).sqrt() <= SETTLED_PX)
}

/// End of a descent.
struct Descent {
    state: BundleState,
    /// True if the last step, which was not damped much, changed the cost by rounding alone.
    is_done: bool,
    steps: usize,
}

/// Levenberg–Marquardt to the least cost, in so many steps at most.
fn descend(problem: &BundleProblem<'_>, mut state: BundleState, max_steps: usize) -> Option<Descent> {
    let mut damping = 1e-4;
    let mut normal = problem.normal(&state)?;
    let (mut is_done, mut steps) = (false, 0);
    while steps < max_steps && damping <= 1e10 {
        steps += 1;
        let trial = normal.step(damping).map(|step| state.after(&step));
        let cost = trial.as_ref().map_or(f64::INFINITY, |trial| problem.cost(trial));
        match trial.filter(|_| cost <= normal.cost) {
            Some(next) => {
                let is_last = normal.cost - cost <= 1e-9 * normal.cost;
                state = next;
                if is_last {
                    // A step that heavy damping made short tells nothing.
                    is_done = damping <= 1.0;
                    break;
                }
                normal = problem.normal(&state)?;
                damping = (damping * 0.1_f64).max(1e-12);
            }
            None => damping *= 10.0,
        }
    }
    normal.cost.is_finite().then_some(Descent { state, is_done, steps })
}

/// Leaves out sightings beyond the limit; true if there were any.
fn drop_outliers(views: &[BoardView], estimated: &Estimated, is_used: &mut [PerDevice<Vec<bool>>]) -> bool {
    let Estimated { state, sigma_px, .. } = estimated;
    let mut dropped = false;
    for (view, used) in is_used.iter_mut().enumerate() {
        for device in DeviceName::ALL {
            for (sighting, used) in views[view].seen[device].iter().zip(&mut used[device]) {
                let length = state.residual(view, device, sighting).map_or(f64::INFINITY, |off| off.norm());
                if length > OUTLIER * sigma_px[device] {
                    (*used, dropped) = (false, true);
                }
            }
        }
    }
    dropped
}

impl Solved {
    /// Requires focal lengths that the views fix, and lenses that do not fold.
    fn check(&self) -> Result<(), LensError> {
        for device in DeviceName::ALL {
            let lens = &self.state.lens[device];
            for (index, unknown) in lens_unknowns(device).enumerate().take(2) {
                let (value, sigma) = (lens.values()[index], self.covariance[(unknown, unknown)].sqrt());
                if !self.is_held[unknown] && (sigma > MAX_FOCAL_SIGMA * value.abs() || sigma.is_nan()) {
                    let detail = format!(
                        "is {value:.1} ± {sigma:.1} px: the views leave it open; tilt the board by 20 to 40° about both axes, \
                         and move it in depth",
                    );
                    return Err(LensError::new(
                        LensFault::Degenerate,
                        format!("/{}/{}", device.as_str(), PARAMETER_NAMES[index]),
                        detail,
                    ));
                }
            }
            lens.check(&format!("/{}", device.as_str()))?;
        }
        Ok(())
    }

    fn finish(self, observations: &BoardObservations, kept: &[usize], views: &[BoardView], has_projector: bool) -> Adjusted {
        let residuals = self.residuals(kept, views);
        let is_observed = |device: DeviceName| device != DeviceName::Projector || has_projector;
        let residuals_of = |device: DeviceName| is_observed(device).then(|| self.device_residuals(&residuals, device));
        let devices = PerDevice::from_fn(residuals_of);
        let mut boards = vec![None; observations.views.len()];
        let mut board_covariance = vec![None; observations.views.len()];
        for (place, from) in self.kept.iter().enumerate() {
            boards[kept[*from]] = Some(self.state.left_from_board[place]);
            board_covariance[kept[*from]] = self.board_covariance[place];
        }
        let refused = self.refused.iter().map(|(from, device)| (kept[*from], *device)).collect();
        Adjusted {
            lens: PerDevice::from_fn(|device| is_observed(device).then_some(self.state.lens[device])),
            device_from_left: self.state.device_from_left,
            left_from_board: boards,
            board_covariance,
            covariance: DMatrix::from_fn(SHARED, SHARED, |row, column| self.covariance[(row, column)]),
            is_held: self.is_held.to_vec(),
            devices,
            residuals,
            refused,
            is_converged: self.is_converged,
            iterations: self.iterations,
        }
    }

    fn residuals(&self, kept: &[usize], views: &[BoardView]) -> Vec<PixelResidual> {
        let mut residuals = Vec::new();
        for (place, from) in self.kept.iter().enumerate() {
            for device in DeviceName::ALL {
                for (sighting, used) in views[*from].seen[device].iter().zip(&self.is_used[place][device]) {
                    let Some(off_px) = self.state.residual(place, device, sighting) else { continue };
                    let (view, point, pixel) = (kept[*from], sighting.point, sighting.pixel);
                    residuals.push(PixelResidual { view, device, point, pixel, off_px, is_used: *used });
                }
            }
        }
        residuals
    }

    fn device_residuals(&self, residuals: &[PixelResidual], device: DeviceName) -> DeviceResiduals {
        let own = || residuals.iter().filter(|residual| residual.device == device);
        let used: Vec<f64> = own().filter(|residual| residual.is_used).map(|residual| residual.off_px.norm_squared()).collect();
        DeviceResiduals {
            rms_px: (used.iter().sum::<f64>() / used.len().max(1) as f64).sqrt(),
            sigma_px: self.sigma_px[device],
            used: used.len(),
            left_out: own().count() - used.len(),
        }
    }
}

impl Adjusted {
    /// Standard deviations of a lens's parameters; `None` for one that was held.
    #[must_use]
    pub fn lens_sigma(&self, device: DeviceName) -> [Option<f64>; LENS] {
        let first = lens_unknowns(device).start;
        std::array::from_fn(|index| self.sigma(first + index))
    }

    /// Standard deviations of a device's pose from the left camera: turn, rad, and shift, mm; `None` for the left camera.
    #[must_use]
    pub fn pose_sigma(&self, device: DeviceName) -> Option<[f64; 6]> {
        let all: Vec<f64> = pose_unknowns(device).filter_map(|index| self.sigma(index)).collect();
        all.try_into().ok()
    }

    fn sigma(&self, index: usize) -> Option<f64> {
        (!self.is_held[index]).then(|| self.covariance[(index, index)].max(0.0).sqrt())
    }

    /// Standard deviations of the baseline, mm, and of the angle between the cameras' axes, rad.
    #[must_use]
    pub fn rig_sigma(&self) -> [f64; 2] {
        let pose = &self.device_from_left.right;
        let shift = pose.translation.vector;
        let along = shift / shift.norm();
        // cos θ = e_z · R e_z; its change under a turn ω is (ω × R e_z) · e_z.
        let axis = pose.rotation * nalgebra::Vector3::z();
        let slope = axis.cross(&nalgebra::Vector3::z()) / axis.xy().norm().max(1e-12);
        let block = |first: usize| self.covariance.fixed_view::<3, 3>(first, first).into_owned();
        let spread =
            |direction: &nalgebra::Vector3<f64>, first: usize| direction.dot(&(block(first) * direction)).max(0.0).sqrt();
        [spread(&along, POSES + 3), spread(&slope, POSES)]
    }
}

#[cfg(test)]
mod tests;
