//! Joint estimation of both cameras, the projector and the board's poses from observations.
//!
//! Start: each camera alone ([`super::start`]), their relative pose as the mean over common views, the projector by resection from
//! the boards that the cameras place ([`super::resect`]). Then all together ([`super::equations`]) under Huber's loss on the length
//! of a residual in standard deviations, which are estimated beside it, a value a device (Huber's proposal 2, *Robust
//! Statistics*, 1981, section 6.4): σ² = Σ min(r, kσ)² / (n β), β = 2 (1 − exp(−k²/2)) for two coordinates. Sightings whose
//! residual is beyond 5 σ, which 4 in a million normal ones are, are left out and the rest is estimated anew.

use nalgebra::{DMatrix, Isometry3, Vector2};

use super::equations::{BundleProblem, BundleState, HUBER, POSES, SHARED, seen_by};
use super::fault::{LensError, LensFault};
use super::model::{LENS, LensParameters, PARAMETER_NAMES};
use super::observations::{BoardObservations, BoardView, DeviceSighting};
use super::resect;
use super::start::{MIN_POINTS, board_pose, camera_matrix, homography, mean_pose, placed};
use crate::cell::{DeviceName, PerDevice};

/// Fewest views of each camera, and fewest common views of two devices.
const MIN_VIEWS: usize = 3;
/// Length of a residual, in standard deviations, from which a sighting is left out.
const OUTLIER: f64 = 5.0;
/// Rounds in which standard deviations are estimated anew.
const ROUNDS: usize = 12;
/// Steps of a round.
const STEPS: usize = 25;
/// Smallest standard deviation that is believed, px: below it lies rounding.
const MIN_SIGMA_PX: f64 = 1e-9;
/// Largest standard deviation of a focal length, as a share of it, beyond which the observations leave it open.
const MAX_FOCAL_SIGMA: f64 = 0.05;

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
    /// All residuals, in the order of the observations.
    pub residuals: Vec<PixelResidual>,
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
    let (left, left_boards) = camera(DeviceName::Left)?;
    let (right, right_boards) = camera(DeviceName::Right)?;
    let pairs: Vec<Isometry3<f64>> =
        left_boards.iter().zip(&right_boards).filter_map(|(left, right)| Some((*right)? * (*left)?.inverse())).collect();
    let right_from_left = mean_pose(&pairs).filter(|_| pairs.len() >= MIN_VIEWS).ok_or_else(|| {
        let detail = format!("{} views are seen by both cameras; at least {MIN_VIEWS}, better 15", pairs.len());
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
        lens: [left, right, projector_lens],
        device_from_left: [Isometry3::identity(), right_from_left, projector_from_left],
        left_from_board: placed_boards.iter().flatten().copied().collect(),
    };
    let mut is_held = [false; SHARED];
    for (index, held) in is_held.iter_mut().enumerate() {
        let (device, is_pose) = if index < POSES { (index / LENS, false) } else { (1 + (index - POSES) / 6, true) };
        *held = (device == 2 && projector.is_none()) || (!is_pose && options.is_held[index % LENS]);
    }
    let views = if projector.is_some() { views } else { views.into_iter().map(without_projector).collect() };
    let solved = solve(&views, state, is_held)?;
    solved.check()?;
    Ok(solved.finish(observations, &kept, &views, projector.is_some()))
}

fn missing(device: DeviceName, detail: &str) -> LensError {
    LensError::new(LensFault::MissingDevice, format!("/{}", device.as_str()), detail)
}

fn without_projector(view: BoardView) -> BoardView {
    BoardView { seen: PerDevice { projector: Vec::new(), ..view.seen }, ..view }
}

/// Lens of a camera, and the poses of the board before it by view.
type CameraStart = (LensParameters, Vec<Option<Isometry3<f64>>>);

/// One camera alone: its lens and the poses of the board before it.
fn single(views: &[BoardView], device: DeviceName, size_px: [u32; 2], options: &AdjustOptions) -> Result<CameraStart, LensError> {
    let homographies: Vec<Option<nalgebra::Matrix3<f64>>> = views.iter().map(|view| homography(&view.seen[device])).collect();
    let found: Vec<nalgebra::Matrix3<f64>> = homographies.iter().flatten().copied().collect();
    let pointer = format!("/views/*/{}", device.as_str());
    let off_plane_mm =
        views.iter().flat_map(|view| &view.seen[device]).map(|sighting| sighting.board_mm.z.abs()).fold(0.0, f64::max);
    if found.len() < MIN_VIEWS && off_plane_mm > 0.0 {
        let detail = format!(
            "{} views can be started from: points of the board lie up to {off_plane_mm} mm off z = 0, and the start needs a plane board; \
             give its points in the plane z = 0 of its own frame",
            found.len()
        );
        return Err(LensError::new(LensFault::TooFew, pointer, detail));
    }
    if found.len() < MIN_VIEWS {
        let detail = format!(
            "{} views show {MIN_POINTS} points or more that are not on a line; at least {MIN_VIEWS}, better 15 with tilts about two axes",
            found.len()
        );
        return Err(LensError::new(LensFault::TooFew, pointer, detail));
    }
    let degenerate =
        || LensError::new(LensFault::Degenerate, pointer.clone(), "no lens explains the views; are the points in order?");
    let start = camera_matrix(&found, size_px).ok_or_else(degenerate)?;
    let poses: Vec<Option<Isometry3<f64>>> = homographies.iter().map(|h| board_pose(&start, &(*h)?)).collect();
    let kept: Vec<usize> = (0..views.len()).filter(|view| poses[*view].is_some()).collect();
    let alone = |view: &usize| {
        let seen = PerDevice { left: views[*view].seen[device].clone(), right: Vec::new(), projector: Vec::new() };
        BoardView { id: String::new(), seen, stated_distance_mm: None }
    };
    let own: Vec<BoardView> = kept.iter().map(alone).collect();
    let state = BundleState {
        lens: [start; 3],
        device_from_left: [Isometry3::identity(); 3],
        left_from_board: poses.iter().flatten().copied().collect(),
    };
    let is_held = std::array::from_fn(|index| index >= LENS || options.is_held[index]);
    let solved = solve(&own, state, is_held)?;
    let mut boards = vec![None; views.len()];
    for (view, board) in kept.iter().zip(&solved.state.left_from_board) {
        boards[*view] = Some(*board);
    }
    Ok((solved.state.lens[0], boards))
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
    state: BundleState,
    is_used: Vec<[Vec<bool>; 3]>,
    is_held: [bool; SHARED],
    sigma_px: [f64; 3],
    covariance: Box<nalgebra::SMatrix<f64, SHARED, SHARED>>,
    board_covariance: Vec<Option<nalgebra::Matrix6<f64>>>,
}

fn lengths(views: &[BoardView], state: &BundleState, is_used: &[[Vec<bool>; 3]], device: usize) -> Vec<f64> {
    let of_view = |view: usize| {
        let seen = seen_by(&views[view], device).iter().zip(&is_used[view][device]).filter(|(_, used)| **used);
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

/// Estimates from a start, with outliers left out.
fn solve(views: &[BoardView], state: BundleState, is_held: [bool; SHARED]) -> Result<Solved, LensError> {
    let all = |view: &BoardView| std::array::from_fn(|device| vec![true; seen_by(view, device).len()]);
    let mut is_used: Vec<[Vec<bool>; 3]> = views.iter().map(all).collect();
    let (mut state, mut sigma_px) = rounds(views, state, is_held, &is_used)?;
    if drop_outliers(views, &state, &mut is_used, sigma_px) {
        (state, sigma_px) = rounds(views, state, is_held, &is_used)?;
    }
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
    Ok(Solved { state, is_used, is_held, sigma_px, covariance, board_covariance })
}

fn not_converged() -> LensError {
    LensError::new(
        LensFault::NotConverged,
        "/views",
        "the estimate does not converge; are the points of the board in the same order everywhere?",
    )
}

/// Alternates estimates of the unknowns and of the standard deviations.
fn rounds(
    views: &[BoardView],
    mut state: BundleState,
    is_held: [bool; SHARED],
    is_used: &[[Vec<bool>; 3]],
) -> Result<(BundleState, [f64; 3]), LensError> {
    let scales =
        |state: &BundleState| -> [f64; 3] { std::array::from_fn(|device| scale(lengths(views, state, is_used, device))) };
    let mut sigma_px = scales(&state);
    for _ in 0..ROUNDS {
        let problem = BundleProblem { views, is_used, is_held, sigma_px };
        state = descend(&problem, state).ok_or_else(not_converged)?;
        let next = scales(&state);
        let change = next.iter().zip(&sigma_px).map(|(next, before)| (next / before - 1.0).abs()).fold(0.0, f64::max);
        sigma_px = next;
        if change < 1e-3 {
            break;
        }
    }
    if sigma_px.iter().all(|sigma| sigma.is_finite()) { Ok((state, sigma_px)) } else { Err(not_converged()) }
}

/// Levenberg–Marquardt to the least cost.
fn descend(problem: &BundleProblem<'_>, mut state: BundleState) -> Option<BundleState> {
    let mut damping = 1e-4;
    let mut normal = problem.normal(&state)?;
    for _ in 0..STEPS {
        let trial = normal.step(damping).map(|step| state.after(&step));
        let cost = trial.as_ref().map_or(f64::INFINITY, |trial| problem.cost(trial));
        match trial.filter(|_| cost <= normal.cost) {
            Some(next) => {
                let is_done = normal.cost - cost <= 1e-9 * normal.cost;
                state = next;
                if is_done {
                    break;
                }
                normal = problem.normal(&state)?;
                damping = (damping * 0.1_f64).max(1e-12);
            }
            None => {
                damping *= 10.0;
                if damping > 1e10 {
                    break;
                }
            }
        }
    }
    normal.cost.is_finite().then_some(state)
}

/// Leaves out sightings beyond the limit; true if there were any.
fn drop_outliers(views: &[BoardView], state: &BundleState, is_used: &mut [[Vec<bool>; 3]], sigma_px: [f64; 3]) -> bool {
    let mut dropped = false;
    for (view, used) in is_used.iter_mut().enumerate() {
        for (device, used) in used.iter_mut().enumerate() {
            for (sighting, used) in seen_by(&views[view], device).iter().zip(used) {
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
        for (device, name) in DeviceName::ALL.into_iter().enumerate() {
            let lens = &self.state.lens[device];
            for index in 0..2 {
                let (value, sigma) =
                    (lens.values()[index], self.covariance[(device * LENS + index, device * LENS + index)].sqrt());
                if !self.is_held[device * LENS + index] && (sigma > MAX_FOCAL_SIGMA * value.abs() || sigma.is_nan()) {
                    let detail = format!(
                        "is {value:.1} ± {sigma:.1} px: the views leave it open; tilt the board by 20 to 40° about both axes, \
                         and move it in depth",
                    );
                    return Err(LensError::new(
                        LensFault::Degenerate,
                        format!("/{}/{}", name.as_str(), PARAMETER_NAMES[index]),
                        detail,
                    ));
                }
            }
            lens.check(&format!("/{}", name.as_str()))?;
        }
        Ok(())
    }

    fn finish(self, observations: &BoardObservations, kept: &[usize], views: &[BoardView], has_projector: bool) -> Adjusted {
        let residuals = self.residuals(kept, views);
        let device =
            |place: usize, name: DeviceName| (place < 2 || has_projector).then(|| self.device_residuals(&residuals, place, name));
        let devices = PerDevice {
            left: device(0, DeviceName::Left),
            right: device(1, DeviceName::Right),
            projector: device(2, DeviceName::Projector),
        };
        let mut boards = vec![None; observations.views.len()];
        let mut board_covariance = vec![None; observations.views.len()];
        for (place, view) in kept.iter().enumerate() {
            boards[*view] = Some(self.state.left_from_board[place]);
            board_covariance[*view] = self.board_covariance[place];
        }
        let [left, right, projector] = self.state.lens;
        let [left_from_left, right_from_left, projector_from_left] = self.state.device_from_left;
        Adjusted {
            lens: PerDevice { left: Some(left), right: Some(right), projector: has_projector.then_some(projector) },
            device_from_left: PerDevice { left: left_from_left, right: right_from_left, projector: projector_from_left },
            left_from_board: boards,
            board_covariance,
            covariance: DMatrix::from_fn(SHARED, SHARED, |row, column| self.covariance[(row, column)]),
            is_held: self.is_held.to_vec(),
            devices,
            residuals,
        }
    }

    fn residuals(&self, kept: &[usize], views: &[BoardView]) -> Vec<PixelResidual> {
        let mut residuals = Vec::new();
        for (place, view) in kept.iter().enumerate() {
            for (device, name) in DeviceName::ALL.into_iter().enumerate() {
                for (sighting, used) in seen_by(&views[place], device).iter().zip(&self.is_used[place][device]) {
                    let Some(off_px) = self.state.residual(place, device, sighting) else { continue };
                    let (point, pixel) = (sighting.point, sighting.pixel);
                    residuals.push(PixelResidual { view: *view, device: name, point, pixel, off_px, is_used: *used });
                }
            }
        }
        residuals
    }

    fn device_residuals(&self, residuals: &[PixelResidual], place: usize, name: DeviceName) -> DeviceResiduals {
        let own = || residuals.iter().filter(|residual| residual.device == name);
        let used: Vec<f64> = own().filter(|residual| residual.is_used).map(|residual| residual.off_px.norm_squared()).collect();
        DeviceResiduals {
            rms_px: (used.iter().sum::<f64>() / used.len().max(1) as f64).sqrt(),
            sigma_px: self.sigma_px[place],
            used: used.len(),
            left_out: own().count() - used.len(),
        }
    }
}

impl Adjusted {
    /// Standard deviations of a lens's parameters; `None` for one that was held.
    #[must_use]
    pub fn lens_sigma(&self, device: DeviceName) -> [Option<f64>; LENS] {
        let place = DeviceName::ALL.iter().position(|name| *name == device).unwrap_or_default();
        std::array::from_fn(|index| self.sigma(place * LENS + index))
    }

    /// Standard deviations of a device's pose from the left camera: turn, rad, and shift, mm; `None` for the left camera.
    #[must_use]
    pub fn pose_sigma(&self, device: DeviceName) -> Option<[f64; 6]> {
        let first = match device {
            DeviceName::Left => return None,
            DeviceName::Right => POSES,
            DeviceName::Projector => POSES + 6,
        };
        let all: Vec<f64> = (first..first + 6).filter_map(|index| self.sigma(index)).collect();
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
