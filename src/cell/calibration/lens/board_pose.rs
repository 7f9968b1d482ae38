//! Pose of a board before a camera that is known, from the pixels of its points, with the covariance that their spread gives it.
//!
//! The closed form (homography of a plane, else the direct linear transformation) is refined by Levenberg–Marquardt over the
//! reprojection error. A hand-eye adjustment that weighs each pose by the inverse of this covariance minimises, to the second order of
//! the increments, the reprojection errors of all points together, as M. Koide and E. Menegatti do (*General Hand–Eye Calibration Based
//! on Reprojection Error Minimization*, IEEE RA-L 4 (2019)): a pose of least squares holds all that its points tell.

use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Rotation3, UnitQuaternion, Vector2, Vector3};

use super::model::LensParameters;
use super::observations::DeviceSighting;
use super::resect;
use super::start::{board_pose, homography};
use crate::geometry::sort_descending;

/// Largest thickness of points that count as a plane at the start, as a share of their length.
const MAX_THICKNESS: f64 = 0.01;

/// A board before a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardInCamera {
    /// Pose of the board in the camera's frame.
    pub camera_from_board: Isometry3<f64>,
    /// Covariance of that for pixels of a standard deviation of 1 px: body increment of the board, rad and mm.
    pub unit_covariance: Matrix6<f64>,
    /// Root mean square of the reprojection errors, px.
    pub rms_px: f64,
}

/// The board whose points, mm, are imaged at these pixels. `None` for fewer than four points on a plane or six in space, points on a
/// line, or points behind the camera.
#[must_use]
pub fn board_in_camera(lens: &LensParameters, points: &[(Point3<f64>, Vector2<f64>)]) -> Option<BoardInCamera> {
    let without_distortion = |(board_mm, pixel): &(Point3<f64>, Vector2<f64>)| {
        let ray = lens.ray(pixel)?;
        Some((*board_mm, Vector2::new(lens.fx * ray.x + lens.cx, lens.fy * ray.y + lens.cy)))
    };
    let straight: Vec<_> = points.iter().map(without_distortion).collect::<Option<_>>()?;
    let start = of_plane(lens, &straight).or_else(|| resect::direct(&straight, lens.size_px).map(|(_, pose)| pose))?;
    resect::pose(points, lens, &start)
}

/// Pose in closed form of points that lie on a plane but for little, by its homography; `None` of other points.
fn of_plane(lens: &LensParameters, points: &[(Point3<f64>, Vector2<f64>)]) -> Option<Isometry3<f64>> {
    let middle = points.iter().map(|(point, _)| point.coords).sum::<Vector3<f64>>() / points.len() as f64;
    let off = |point: &Point3<f64>| point.coords - middle;
    let axes = points.iter().map(|(point, _)| off(point) * off(point).transpose()).sum::<Matrix3<f64>>().symmetric_eigen();
    let mut order = [0, 1, 2];
    sort_descending(&mut order, |axis| axes.eigenvalues[*axis]);
    let [length, _, thickness] = order.map(|axis| axes.eigenvalues[axis].max(0.0).sqrt());
    if thickness > MAX_THICKNESS * length {
        return None;
    }
    let [x, y] = [order[0], order[1]].map(|axis| axes.eigenvectors.column(axis).into_owned());
    let turn =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)])));
    let plane_from_board = Isometry3::from_parts(middle.into(), turn).inverse();
    let on_plane = |(index, (point, pixel)): (usize, &(Point3<f64>, Vector2<f64>))| {
        let point_mm = plane_from_board * point;
        DeviceSighting { point: index as u32, board_mm: Point3::new(point_mm.x, point_mm.y, 0.0), pixel: *pixel }
    };
    let seen: Vec<DeviceSighting> = points.iter().enumerate().map(on_plane).collect();
    Some(board_pose(lens, &homography(&seen)?)? * plane_from_board)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::calibration::se3::log;
    use crate::cell::calibration::tests::Noise;

    const LENS: LensParameters = LensParameters {
        size_px: [1920, 1080],
        fx: 1400.0,
        fy: 1402.0,
        cx: 955.0,
        cy: 541.0,
        skew: 0.0,
        distortion: [-0.1, 0.05, 1e-3, -5e-4, 0.0],
    };

    fn image(pose: &Isometry3<f64>, points: &[Point3<f64>]) -> Vec<(Point3<f64>, Vector2<f64>)> {
        points.iter().map(|point| (*point, LENS.project(&(pose * point)))).collect()
    }

    fn chessboard() -> Vec<Point3<f64>> {
        (0..54).map(|index| Point3::new(f64::from(index % 9) * 20.0, f64::from(index / 9) * 20.0, 0.0)).collect()
    }

    fn pose() -> Isometry3<f64> {
        Isometry3::new(Vector3::new(-60.0, 40.0, 620.0), Vector3::new(2.8, 0.3, -0.4))
    }

    /// The chessboard with heights.
    fn lifted(height_mm: impl Fn(usize, &Point3<f64>) -> f64) -> Vec<Point3<f64>> {
        let lift = |(index, point): (usize, Point3<f64>)| Point3::new(point.x, point.y, height_mm(index, &point));
        chessboard().into_iter().enumerate().map(lift).collect()
    }

    #[test]
    fn exact_pixels_give_the_pose_of_a_plane_and_of_points_in_space() {
        let uneven = |mm: f64| move |index: usize, _: &Point3<f64>| mm * (1.7 * index as f64).sin();
        let far_off: Vec<Point3<f64>> = chessboard().into_iter().map(|point| point + Vector3::new(0.0, 2000.0, 0.0)).collect();
        let upright = chessboard().into_iter().map(|point| Point3::new(point.x, 0.0, point.y)).collect();
        for points in [
            chessboard(),
            lifted(|_, _| 5.0),
            lifted(uneven(0.02)),
            lifted(uneven(0.3)),
            lifted(uneven(3.0)),
            lifted(|_, point| 0.002 * point.x * point.y),
            upright,
        ] {
            let found = board_in_camera(&LENS, &image(&pose(), &points)).unwrap_or_else(|| panic!("a pose of {points:?}"));
            assert!(log(&(pose().inverse() * found.camera_from_board)).norm() < 1e-6 && found.rms_px < 1e-7, "{found:?}");
        }
        // Its own origin is beside the image.
        let beside = pose() * Isometry3::translation(0.0, -2000.0, 0.0);
        let found = board_in_camera(&LENS, &image(&beside, &far_off)).expect("a pose");
        assert!(log(&(beside.inverse() * found.camera_from_board)).norm() < 1e-5, "{found:?}");
    }

    #[test]
    fn the_covariance_is_that_of_many_noisy_images() {
        const SIGMA_PX: f64 = 0.2;
        const IMAGES: usize = 400;
        let (exact, mut noise) = (image(&pose(), &chessboard()), Noise(11));
        let mut sum = 0.0;
        for _ in 0..IMAGES {
            let noisy: Vec<_> = exact
                .iter()
                .map(|(point, pixel)| (*point, pixel + Vector2::new(noise.normal(), noise.normal()) * SIGMA_PX))
                .collect();
            let found = board_in_camera(&LENS, &noisy).expect("a pose");
            let off = log(&(found.camera_from_board.inverse() * pose()));
            let information = (found.unit_covariance * SIGMA_PX.powi(2)).try_inverse().expect("redundant");
            sum += off.dot(&(information * off));
        }
        // χ² of 6 freedoms: the mean of 400 is 6 ± 0.17.
        let mean = sum / IMAGES as f64;
        assert!((mean - 6.0).abs() < 0.7, "{mean}");
    }

    #[test]
    fn points_that_tell_no_pose_give_none() {
        let line: Vec<Point3<f64>> = (0..9).map(|index| Point3::new(f64::from(index) * 20.0, 0.0, 0.0)).collect();
        assert_eq!(board_in_camera(&LENS, &image(&pose(), &line)), None);
        assert_eq!(board_in_camera(&LENS, &image(&pose(), &chessboard()[..3])), None);
    }
}
