//! Choice of the poses to calibrate from: of candidates that the arm takes without a collision, with the whole board in the depth
//! range and in the images of all three devices, those that make the determinant of the Fisher information largest, one at a time
//! (V. V. Fedorov, *Theory of Optimal Experiments*, 1972, section 2.5; greedy as in M. C. Shewry, H. P. Wynn, *Maximum entropy
//! sampling*, J. Applied Statistics 14(2), 1987). The table's angles are spread over its range. Costs 16 × 16 determinants: poses × candidates.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Matrix6, Point3, UnitQuaternion, Vector3};

use super::data::{ChainEstimate, HandEyeSetup, Sighting, Sigma, Weighting};
use super::refine::{Adjustment, Free, Refined, Square, linearised};
use crate::cell::halton::halton;
use crate::cell::{Cell, CollisionScene, Configuration};
use crate::geometry::{Board, Cloud, Flange, Mesh, Plate, Pose, ScannerFrame, sort_ascending};

/// Views that are tried.
const VIEWS: u32 = 1500;
/// Largest tilt of the board to the scanner that is planned, rad (40°): beyond it corners are found badly.
const MAX_TILT_RAD: f64 = 40.0 * PI / 180.0;
/// Largest turn of the scanner about its axis, rad (60°).
const MAX_ROLL_RAD: f64 = PI / 3.0;
/// Steps of the table, over its whole turn.
const TABLE_STEPS: u32 = 24;
/// Information that is there before the first pose, as a share of what poses bring: it keeps determinants from being zero.
const FIRST_SHARE: f64 = 1e-9;

/// The board that is planned for.
#[derive(Clone, Copy, Debug)]
pub struct PlannedBoard {
    /// Extent along x and y from its origin, mm.
    pub size_mm: [f64; 2],
    /// The board on the plate.
    pub plate_from_board: Isometry3<f64>,
}

/// A pose to calibrate from.
#[derive(Clone, Debug)]
pub struct PlannedPose {
    /// Joints and table.
    pub configuration: Configuration,
    /// The board as it will be seen.
    pub scanner_from_board: Pose<ScannerFrame, Board>,
    /// Observation without noise.
    pub sighting: Sighting,
}

/// Chosen poses with what they will tell.
#[derive(Clone, Debug)]
pub struct PosePlan {
    /// Chosen poses, in the order chosen; those to hold out come last.
    pub poses: Vec<PlannedPose>,
    /// Poses that could have been chosen.
    pub candidates: usize,
    /// Covariance that they predict, of those that are not held out.
    pub covariance: Square,
}

/// Cell, board and limits that poses are planned for.
pub struct PosePlanner<'a> {
    /// The cell.
    pub cell: &'a Cell,
    /// The board.
    pub board: PlannedBoard,
    /// Deviations that are expected.
    pub sigma: Sigma,
    /// Distance that bodies keep, mm.
    pub clearance_mm: f64,
    /// Frame of the clouds in the scanner.
    pub scanner_from_cloud: Pose<ScannerFrame, Cloud>,
}

impl PosePlanner<'_> {
    fn nominal(&self) -> ChainEstimate {
        let flange_from_cloud: Pose<Flange, Cloud> = self.cell.flange_from_scanner * self.scanner_from_cloud;
        let base_from_table = *self.cell.base_from_table.isometry();
        ChainEstimate {
            flange_from_cloud: *flange_from_cloud.isometry(),
            base_from_table,
            plate_from_board: self.board.plate_from_board,
            scale: 1.0,
        }
    }

    fn weighting(&self) -> Weighting {
        Weighting::new(HandEyeSetup::EyeInHand, self.sigma)
    }

    /// The cell with the board on its plate.
    #[must_use]
    pub fn scene(&self) -> CollisionScene {
        let on_table = Pose::claim(Isometry3::identity());
        CollisionScene::new(self.cell, &board_mesh(&self.board), None, &on_table, self.clearance_mm)
    }

    /// Poses that the arm takes, each free of collisions with the board in view; the same for the same cell.
    #[must_use]
    pub fn candidates(&self) -> Vec<PlannedPose> {
        let scene = self.scene();
        (0..VIEWS).filter_map(|index| self.candidate(index, &scene)).collect()
    }

    fn candidate(&self, index: u32, scene: &CollisionScene) -> Option<PlannedPose> {
        let scanner_from_board = self.view(index);
        if !self.is_seen(&scanner_from_board) {
            return None;
        }
        let axis = &self.cell.turntable.axis;
        let turn = TAU * f64::from(index % TABLE_STEPS) / f64::from(TABLE_STEPS) - PI;
        let table_rad = axis.windings(turn).min_by(|a, b| a.abs().total_cmp(&b.abs()))?;
        let plate_from_board: Pose<Plate, Board> = Pose::claim(self.board.plate_from_board);
        let base_from_scanner = self.cell.base_from_plate(table_rad) * plate_from_board * scanner_from_board.inverse();
        let base_from_flange = base_from_scanner * self.cell.flange_from_scanner.inverse();
        let axes = self.cell.axes();
        let solutions = self.cell.robot.kinematics.ik_solutions(&base_from_flange).into_iter();
        let mut wound: Vec<Configuration> =
            solutions.flat_map(|joints_rad| axes.windings(&Configuration { joints_rad, table_rad })).collect();
        wound.retain(|configuration| configuration.table_rad.to_bits() == table_rad.to_bits());
        let home = self.cell.home_rad;
        sort_ascending(&mut wound, |joints| home.distance_rad(joints));
        let configuration = wound.into_iter().find(|configuration| scene.check(configuration).is_none())?;
        let cloud_from_board = *(self.scanner_from_cloud.inverse() * scanner_from_board).isometry();
        let base_from_flange = *self.cell.robot.base_from_flange(&configuration.joints_rad).isometry();
        let id = format!("candidate {index}");
        let (seen_covariance, points_mm) = (None, Vec::new());
        let sighting = Sighting { id, base_from_flange, table_rad, cloud_from_board, seen_covariance, points_mm };
        Some(PlannedPose { configuration, scanner_from_board, sighting })
    }

    /// View `index`: tilt and roll over their ranges, the board's middle about the axis within the depth range.
    fn view(&self, index: u32) -> Pose<ScannerFrame, Board> {
        let number = |base: u32| halton(index + 1, base);
        let [near_mm, far_mm] = self.cell.scanner.working_depth_mm();
        let (azimuth, tilt) = (TAU * number(2), MAX_TILT_RAD * number(3).sqrt());
        let (roll, depth) = (MAX_ROLL_RAD * (2.0 * number(5) - 1.0), near_mm + (far_mm - near_mm) * number(7));
        let tilted = UnitQuaternion::from_scaled_axis(Vector3::new(azimuth.cos(), azimuth.sin(), 0.0) * tilt);
        let facing = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
        let rolled = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll + PI * f64::from(index % 4) / 2.0);
        let rotation = tilted * facing * rolled;
        let [width, height] = self.board.size_mm;
        let aside = Vector3::new(0.2 * width * (number(11) - 0.5), 0.2 * height * (number(13) - 0.5), 0.0);
        let middle = Vector3::new(0.5 * width, 0.5 * height, 0.0);
        Pose::from_parts(Vector3::new(0.0, 0.0, depth) + aside - rotation * middle, rotation)
    }

    /// Returns true if all corners of the board are in the working depth, in focus for every device, and in every device's image.
    fn is_seen(&self, scanner_from_board: &Pose<ScannerFrame, Board>) -> bool {
        let scanner = &self.cell.scanner;
        let [width, height] = self.board.size_mm;
        [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]].into_iter().all(|[x, y]| {
            let corner = scanner_from_board.point(&Point3::new(x, y, 0.0));
            let is_imaged = (&scanner.devices)
                .into_iter()
                .all(|device| device.lens.project(&device.scanner_from_device.inverse().point(&corner)).is_some());
            scanner.is_in_depth(&corner) && is_imaged
        })
    }

    /// Information that an observation brings.
    fn information(&self, at: &ChainEstimate, sighting: &Sighting) -> Option<Square> {
        let (_, rows) = linearised(at, sighting);
        let weight: Matrix6<f64> = self.weighting().covariance(at, sighting).cholesky()?.inverse();
        Some(rows.transpose() * weight * rows)
    }

    /// Chooses `count` poses of candidates, and `hold_out` more to check by; `None` if there are too few candidates. Each step of the table
    /// has an equal share of them, and more only where no other has any left.
    #[must_use]
    pub fn choose(&self, candidates: &[PlannedPose], count: usize, hold_out: usize) -> Option<PosePlan> {
        let at = self.nominal();
        let informations: Vec<Square> =
            candidates.iter().map(|each| self.information(&at, &each.sighting)).collect::<Option<_>>()?;
        let mean: Square = informations.iter().sum::<Square>() / informations.len().max(1) as f64;
        // The scale of each unknown by what a pose tells of it: determinants then compare numbers without a unit.
        let mut sum = Square::from_diagonal(&mean.diagonal().map(|value| FIRST_SHARE * value.max(1e-300)));
        let (mut chosen, mut open): (Vec<usize>, Vec<usize>) = (Vec::new(), (0..candidates.len()).collect());
        // Each step of the table at most this often: its angles are spread.
        let most = (count + hold_out).div_ceil(TABLE_STEPS as usize / 2).max(1);
        while chosen.len() < count + hold_out {
            let turn = |index: usize| step_of(candidates[index].sighting.table_rad);
            let is_open = |index: &&usize| chosen.iter().filter(|other| turn(**other) == turn(**index)).count() < most;
            let scored = |index: &usize| (log_determinant(&(sum + informations[*index])), *index);
            // Of equals the first.
            let best_of = |best: (f64, usize), next: (f64, usize)| if next.0 > best.0 { next } else { best };
            let spread = open.iter().filter(is_open).map(scored).reduce(best_of);
            let (_, best) = spread.or_else(|| open.iter().map(scored).reduce(best_of))?;
            sum += informations[best];
            chosen.push(best);
            open.retain(|index| *index != best);
        }
        let poses: Vec<PlannedPose> = chosen.iter().map(|index| candidates[*index].clone()).collect();
        let covariance = self.predicted(&poses[..count])?;
        Some(PosePlan { poses, candidates: candidates.len(), covariance })
    }

    /// Covariance that observations from these poses will have.
    #[must_use]
    pub fn predicted(&self, poses: &[PlannedPose]) -> Option<Square> {
        let sightings: Vec<Sighting> = poses.iter().map(|each| each.sighting.clone()).collect();
        let problem = Adjustment { sightings: &sightings, free: Free::JOINT, prior: None };
        problem.refine(&self.nominal(), &self.weighting()).map(|Refined { covariance, .. }| covariance)
    }
}

/// Step of the table that an angle is at.
fn step_of(table_rad: f64) -> u32 {
    (table_rad.rem_euclid(TAU) / TAU * f64::from(TABLE_STEPS)).round() as u32 % TABLE_STEPS
}

/// Logarithm of the determinant over the unknowns of a joint calibration.
fn log_determinant(information: &Square) -> f64 {
    let block = information.fixed_view::<16, 16>(0, 0).into_owned();
    block
        .cholesky()
        .map_or(f64::NEG_INFINITY, |cholesky| 2.0 * cholesky.l_dirty().diagonal().iter().map(|value| value.ln()).sum::<f64>())
}

/// Plane of the board as two triangles, on the table at angle zero.
fn board_mesh(board: &PlannedBoard) -> Mesh {
    let [width, height] = board.size_mm;
    let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
    let vertices_mm = corners.map(|[x, y]| board.plate_from_board * Point3::new(x, y, 0.0)).to_vec();
    Mesh { vertices_mm, faces: vec![[0, 1, 2], [0, 2, 3]], source_face: vec![0, 1], groups: Vec::new() }
}

/// Board lying in the middle of the plate, `height_mm` above it, its z up.
#[must_use]
pub fn board_on_plate(size_mm: [f64; 2], height_mm: f64) -> Isometry3<f64> {
    Isometry3::translation(-0.5 * size_mm[0], -0.5 * size_mm[1], height_mm)
}
