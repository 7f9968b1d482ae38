//! Pose of a board before a camera that is known, from the pixels of its points, with the covariance that their spread gives it.
//!
//! The closed form (homography of a plane, else the direct linear transformation) is refined by Levenberg–Marquardt over the
//! reprojection error. A hand-eye adjustment that weighs each pose by the inverse of this covariance minimises, to the second order of
//! the increments, the reprojection errors of all points together, as M. Koide and E. Menegatti do (*General Hand–Eye Calibration Based
//! on Reprojection Error Minimization*, IEEE RA-L 4 (2019)): a pose of least squares holds all that its points tell.

use nalgebra::{Isometry3, Matrix6, Point3, Vector2};

use super::model::LensParameters;
use super::observations::DeviceSighting;
use super::resect;
use super::start::{board_pose, homography};

/// A board before a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct BoardInCamera {
    /// Its pose.
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
    let sighting = |(index, (board_mm, pixel)): (usize, &(Point3<f64>, Vector2<f64>))| DeviceSighting {
        point: index as u32,
        board_mm: *board_mm,
        pixel: *pixel,
    };
    let seen: Vec<DeviceSighting> = straight.iter().enumerate().map(sighting).collect();
    let of_plane = homography(&seen).and_then(|homography| board_pose(lens, &homography));
    let start = of_plane.or_else(|| resect::direct(&straight, lens.size_px).map(|(_, pose)| pose))?;
    resect::pose(points, lens, &start)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

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

    #[test]
    fn exact_pixels_give_the_pose_of_a_plane_and_of_points_in_space() {
        let in_space: Vec<Point3<f64>> =
            chessboard().into_iter().map(|point| Point3::new(point.x, point.y, 0.002 * point.x * point.y)).collect();
        for points in [chessboard(), in_space] {
            let found = board_in_camera(&LENS, &image(&pose(), &points)).expect("a pose");
            assert!(log(&(pose().inverse() * found.camera_from_board)).norm() < 1e-7 && found.rms_px < 1e-8, "{found:?}");
        }
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
