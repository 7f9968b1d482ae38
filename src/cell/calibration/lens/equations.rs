//! Bundle adjustment: normal equations of lenses, device poses and board poses, solved with the boards eliminated.
//!
//! Unknowns shared by all views: ten parameters of each lens, then rotation and translation of the right camera and of the
//! projector from the left camera; 42 in all. Each view adds the six of its board. Increments of a pose T are a turn about the
//! image of its source's origin and a shift: R ← exp(ω)·R, t ← t + δ. With J the derivatives of a pixel, e its residual and w its
//! weight: Σ w JᵀJ x = Σ w Jᵀe; boards are eliminated by the Schur complement (Triggs et al., *Bundle Adjustment — A Modern
//! Synthesis*, 2000, section 6.1), the rest is damped after Marquardt. Cost a step: 22² per observation, 42² · 6 per view.

use std::ops::Range;

use nalgebra::{Cholesky, Const, Isometry3, Matrix3, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};

use super::model::{LENS, LensParameters};
use super::observations::{BoardView, DeviceSighting};
use crate::cell::{DeviceName, PerDevice};
use crate::geometry::parallel;

/// Unknowns shared by all views.
pub(super) const SHARED: usize = 3 * LENS + 12;
/// First unknown of the right camera's pose; the projector's follows.
pub(super) const POSES: usize = 3 * LENS;
/// Unknowns that one observation depends on: its lens, its device's pose, its board.
const LOCAL: usize = LENS + 12;
/// Length of a residual, in standard deviations, from which it weighs less (Huber 1964): 95 % of the lengths of normal residuals in
/// two dimensions are below, √(−2 ln 0.05).
pub(super) const HUBER: f64 = 2.447_746_830_680_816;
/// Minimum depth of a point before a device, mm.
const MIN_DEPTH_MM: f64 = 1e-3;

/// Values of all unknowns.
#[derive(Clone, Debug)]
pub(super) struct BundleState {
    pub(super) lens: PerDevice<LensParameters>,
    pub(super) device_from_left: PerDevice<Isometry3<f64>>,
    pub(super) left_from_board: Vec<Isometry3<f64>>,
}

/// Observations with what is held and how they weigh.
pub(super) struct BundleProblem<'a> {
    pub(super) views: &'a [BoardView],
    /// Sightings that count, as `views` has them.
    pub(super) is_used: &'a [PerDevice<Vec<bool>>],
    /// Unknowns that keep their values.
    pub(super) is_held: [bool; SHARED],
    /// Standard deviation of a coordinate of a pixel.
    pub(super) sigma_px: PerDevice<f64>,
}

/// Sums of one view.
struct ViewSums {
    shared: Box<SMatrix<f64, SHARED, SHARED>>,
    shared_side: SVector<f64, SHARED>,
    board: SMatrix<f64, 6, 6>,
    board_side: SVector<f64, 6>,
    coupling: Box<SMatrix<f64, SHARED, 6>>,
    cost: f64,
}

/// Sums of one board: its square, its side, and its coupling to the shared unknowns.
type BoardSums = (SMatrix<f64, 6, 6>, SVector<f64, 6>, Box<SMatrix<f64, SHARED, 6>>);

/// Shared equations with the boards eliminated: factor, right-hand side, and the inverse of each board's square.
type Reduced = (Cholesky<f64, Const<SHARED>>, Box<SVector<f64, SHARED>>, Vec<SMatrix<f64, 6, 6>>);

/// Normal equations at a state.
pub(super) struct Normal {
    shared: Box<SMatrix<f64, SHARED, SHARED>>,
    shared_side: SVector<f64, SHARED>,
    boards: Vec<BoardSums>,
    /// Half the sum of robust squares.
    pub(super) cost: f64,
}

/// Increments of all unknowns.
pub(super) struct BundleStep {
    shared: SVector<f64, SHARED>,
    boards: Vec<SVector<f64, 6>>,
}

/// Unknowns of a device's lens, among those that the views share.
pub(super) fn lens_unknowns(device: DeviceName) -> Range<usize> {
    match device {
        DeviceName::Left => 0..LENS,
        DeviceName::Right => LENS..2 * LENS,
        DeviceName::Projector => 2 * LENS..POSES,
    }
}

/// Unknowns of a device's pose from the left camera, which has none itself.
pub(super) fn pose_unknowns(device: DeviceName) -> Range<usize> {
    match device {
        DeviceName::Left => POSES..POSES,
        DeviceName::Right => POSES..POSES + 6,
        DeviceName::Projector => POSES + 6..SHARED,
    }
}

/// Turns by a rotation vector, then shifts: the pose after an increment.
pub(super) fn moved(pose: &Isometry3<f64>, increment: &[f64]) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from_column_slice(&increment[..3]));
    let shift = Vector3::from_column_slice(&increment[3..6]);
    Isometry3::from_parts((pose.translation.vector + shift).into(), turn * pose.rotation)
}

fn cross(v: &Vector3<f64>) -> Matrix3<f64> {
    v.cross_matrix()
}

/// Huber's cost of a residual of this length, and its weight.
fn huber(length: f64) -> (f64, f64) {
    if length <= HUBER { (0.5 * length * length, 1.0) } else { (HUBER * (length - 0.5 * HUBER), HUBER / length) }
}

impl BundleState {
    /// The state after a step.
    pub(super) fn after(&self, step: &BundleStep) -> Self {
        let shared = step.shared.as_slice();
        let lens = PerDevice::from_fn(|device| {
            let mut values = self.lens[device].values();
            values.iter_mut().zip(&shared[lens_unknowns(device)]).for_each(|(value, increment)| *value += increment);
            self.lens[device].with_values(values)
        });
        let device_from_left = PerDevice::from_fn(|device| {
            let (pose, unknowns) = (&self.device_from_left[device], pose_unknowns(device));
            if unknowns.is_empty() { *pose } else { moved(pose, &shared[unknowns]) }
        });
        let boards = self.left_from_board.iter().zip(&step.boards);
        let left_from_board = boards.map(|(pose, increment)| moved(pose, increment.as_slice())).collect();
        Self { lens, device_from_left, left_from_board }
    }

    /// Residual of a sighting, observed minus computed, px; `None` behind the device.
    pub(super) fn residual(&self, view: usize, device: DeviceName, sighting: &DeviceSighting) -> Option<Vector2<f64>> {
        let point = self.device_from_left[device] * (self.left_from_board[view] * sighting.board_mm);
        (point.z > MIN_DEPTH_MM).then(|| sighting.pixel - self.lens[device].project(&point))
    }
}

impl BundleProblem<'_> {
    /// Half the sum of robust squares at a state; infinite where a point is behind a device.
    pub(super) fn cost(&self, state: &BundleState) -> f64 {
        let costs = parallel::map_range(self.views.len(), |view| {
            let mut sum = 0.0;
            for device in DeviceName::ALL {
                for (sighting, used) in self.views[view].seen[device].iter().zip(&self.is_used[view][device]) {
                    if *used {
                        let residual = state.residual(view, device, sighting);
                        sum += residual.map_or(f64::INFINITY, |off| huber(off.norm() / self.sigma_px[device]).0);
                    }
                }
            }
            sum
        });
        costs.into_iter().sum()
    }

    /// Normal equations at a state; `None` where a point is behind a device.
    pub(super) fn normal(&self, state: &BundleState) -> Option<Normal> {
        let sums = parallel::map_range(self.views.len(), |view| self.view_sums(state, view));
        let mut normal = Normal {
            shared: Box::new(SMatrix::zeros()),
            shared_side: SVector::zeros(),
            boards: Vec::with_capacity(sums.len()),
            cost: 0.0,
        };
        for sums in sums {
            let sums = sums?;
            *normal.shared += *sums.shared;
            normal.shared_side += sums.shared_side;
            normal.cost += sums.cost;
            normal.boards.push((sums.board, sums.board_side, sums.coupling));
        }
        for index in (0..SHARED).filter(|index| self.is_held[*index]) {
            normal.shared.row_mut(index).fill(0.0);
            normal.shared.column_mut(index).fill(0.0);
            normal.shared[(index, index)] = 1.0;
            normal.shared_side[index] = 0.0;
            normal.boards.iter_mut().for_each(|(_, _, coupling)| coupling.row_mut(index).fill(0.0));
        }
        Some(normal)
    }

    fn view_sums(&self, state: &BundleState, view: usize) -> Option<ViewSums> {
        let mut sums = ViewSums {
            shared: Box::new(SMatrix::zeros()),
            shared_side: SVector::zeros(),
            board: SMatrix::zeros(),
            board_side: SVector::zeros(),
            coupling: Box::new(SMatrix::zeros()),
            cost: 0.0,
        };
        for device in DeviceName::ALL {
            if self.views[view].seen[device].is_empty() {
                continue;
            }
            let (square, side, cost) = self.device_sums(state, view, device)?;
            sums.cost += cost;
            sums.add(&square, &side, device);
        }
        Some(sums)
    }

    /// Sums over the sightings of one device in one view, by the unknowns that they depend on.
    fn device_sums(
        &self,
        state: &BundleState,
        view: usize,
        device: DeviceName,
    ) -> Option<(Box<SMatrix<f64, LOCAL, LOCAL>>, SVector<f64, LOCAL>, f64)> {
        let (lens, pose, board) = (&state.lens[device], &state.device_from_left[device], &state.left_from_board[view]);
        let turn = pose.rotation.to_rotation_matrix();
        let mut square = Box::new(SMatrix::<f64, LOCAL, LOCAL>::zeros());
        let (mut side, mut cost) = (SVector::<f64, LOCAL>::zeros(), 0.0);
        for (sighting, used) in self.views[view].seen[device].iter().zip(&self.is_used[view][device]) {
            if !used {
                continue;
            }
            let on_board = board.rotation * sighting.board_mm.coords;
            let in_left = on_board + board.translation.vector;
            let turned = turn * in_left;
            let point = nalgebra::Point3::from(turned + pose.translation.vector);
            if point.z <= MIN_DEPTH_MM {
                return None;
            }
            let (pixel, by) = lens.differentiate(&point);
            let off = sighting.pixel - pixel;
            let (robust, weight) = huber(off.norm() / self.sigma_px[device]);
            cost += robust;
            let weight = weight / (self.sigma_px[device] * self.sigma_px[device]);
            let by_left = by.by_point * turn.matrix();
            let mut jacobian = SMatrix::<f64, 2, LOCAL>::zeros();
            jacobian.fixed_view_mut::<2, LENS>(0, 0).copy_from(&by.by_lens);
            jacobian.fixed_view_mut::<2, 3>(0, LENS).copy_from(&(-by.by_point * cross(&turned)));
            jacobian.fixed_view_mut::<2, 3>(0, LENS + 3).copy_from(&by.by_point);
            jacobian.fixed_view_mut::<2, 3>(0, LENS + 6).copy_from(&(-by_left * cross(&on_board)));
            jacobian.fixed_view_mut::<2, 3>(0, LENS + 9).copy_from(&by_left);
            // The upper triangle, column by column.
            for column in 0..LOCAL {
                let (a, b) = (weight * jacobian[(0, column)], weight * jacobian[(1, column)]);
                side[column] += a * off.x + b * off.y;
                for row in 0..=column {
                    square[(row, column)] += a * jacobian[(0, row)] + b * jacobian[(1, row)];
                }
            }
        }
        square.fill_lower_triangle_with_upper_triangle();
        Some((square, side, cost))
    }
}

impl ViewSums {
    /// Adds the sums of one device to where its unknowns are.
    fn add(&mut self, square: &SMatrix<f64, LOCAL, LOCAL>, side: &SVector<f64, LOCAL>, device: DeviceName) {
        let places: Vec<(usize, usize)> =
            (0..LENS).zip(lens_unknowns(device)).chain((LENS..).zip(pose_unknowns(device))).collect();
        for (local, global) in &places {
            self.shared_side[*global] += side[*local];
            for (other, to) in &places {
                self.shared[(*global, *to)] += square[(*local, *other)];
            }
            for board in 0..6 {
                self.coupling[(*global, board)] += square[(*local, LENS + 6 + board)];
            }
        }
        self.board += square.fixed_view::<6, 6>(LENS + 6, LENS + 6);
        self.board_side += side.fixed_rows::<6>(LENS + 6);
    }
}

impl Normal {
    /// The shared equations with the boards eliminated, each diagonal raised by `damping` of itself; `None` if they are singular.
    fn reduced(&self, damping: f64) -> Option<Reduced> {
        let mut left = self.shared.clone();
        let mut right = Box::new(self.shared_side);
        for index in 0..SHARED {
            left[(index, index)] *= 1.0 + damping;
        }
        let mut inverses = Vec::with_capacity(self.boards.len());
        for (board, side, coupling) in &self.boards {
            let mut damped = *board;
            (0..6).for_each(|index| damped[(index, index)] *= 1.0 + damping);
            let inverse = damped.cholesky()?.inverse();
            let through = **coupling * inverse;
            *left -= through * coupling.transpose();
            *right -= through * side;
            inverses.push(inverse);
        }
        left.cholesky().map(|factor| (factor, right, inverses))
    }

    /// The damped step; `None` if the equations are singular.
    pub(super) fn step(&self, damping: f64) -> Option<BundleStep> {
        let (factor, right, inverses) = self.reduced(damping)?;
        let shared = factor.solve(&right);
        let boards = self
            .boards
            .iter()
            .zip(&inverses)
            .map(|((_, side, coupling), inverse)| inverse * (side - coupling.transpose() * shared));
        Some(BundleStep { shared, boards: boards.collect() })
    }

    /// Square of the undamped step in standard deviations, the product of the step and the right-hand side: no unknown moves by
    /// more of its deviations than the root. `None` if the equations are singular.
    pub(super) fn step_square(&self) -> Option<f64> {
        let step = self.step(0.0)?;
        let of_boards = self.boards.iter().zip(&step.boards).map(|((_, side, _), board)| side.dot(board)).sum::<f64>();
        Some(self.shared_side.dot(&step.shared) + of_boards)
    }

    /// Covariance of the shared unknowns; `None` if the observations leave some open.
    pub(super) fn covariance(&self) -> Option<Box<SMatrix<f64, SHARED, SHARED>>> {
        // Scaled to a diagonal of 1, so that singular means singular whatever the units.
        let (factor, _, _) = self.reduced(0.0)?;
        let inverse = factor.inverse();
        inverse.iter().all(|value| value.is_finite()).then(|| Box::new(inverse))
    }

    /// Covariance of a board's pose, beside the shared unknowns.
    pub(super) fn board_covariance(&self, view: usize, shared: &SMatrix<f64, SHARED, SHARED>) -> Option<SMatrix<f64, 6, 6>> {
        let (board, _, coupling) = self.boards.get(view)?;
        let inverse = board.cholesky()?.inverse();
        let through = inverse * coupling.transpose();
        Some(inverse + through * shared * through.transpose())
    }
}
