//! Choice of the views that an estimate goes on without.

use nalgebra::{Translation3, UnitQuaternion, Vector3};

use super::*;

/// Pixels of a board of 4 × 4 points, 20 mm apart, in two cameras 150 mm apart, with noise of 0.1 px, and the true state.
fn rig(count: usize) -> (Vec<BoardView>, BundleState) {
    let (size_px, distortion) = ([2000, 1600], [0.0; 5]);
    let lens = LensParameters { size_px, fx: 2000.0, fy: 2000.0, cx: 1000.0, cy: 800.0, skew: 0.0, distortion };
    let board = |view: f64| {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3 * view.sin(), 0.3 * (1.7 * view).cos(), 0.0));
        Isometry3::from_parts(Translation3::new(-30.0, -30.0, 500.0), turn)
    };
    let state = BundleState {
        lens: PerDevice::of_cameras(lens, lens),
        device_from_left: PerDevice {
            left: Isometry3::identity(),
            right: Isometry3::translation(-150.0, 0.0, 0.0),
            projector: Isometry3::identity(),
        },
        left_from_board: (0..count).map(|view| board(view as f64)).collect(),
    };
    let seen = |view: usize, device: DeviceName, first: usize| -> Vec<DeviceSighting> {
        let sighting = |point: u32| {
            let board_mm = Point3::new(20.0 * f64::from(point % 4), 20.0 * f64::from(point / 4), 0.0);
            let at_origin = DeviceSighting { point, board_mm, pixel: Vector2::zeros() };
            let off_px = state.residual(view, device, &at_origin).expect("before the camera");
            let number = (view * 32 + first) as f64 + f64::from(point);
            let noise_px = Vector2::new((12.9898 * number).sin(), (78.233 * number).sin()) * 0.14;
            DeviceSighting { pixel: noise_px - off_px, ..at_origin }
        };
        (0..16).map(sighting).collect()
    };
    let views = (0..count).map(|view| {
        let seen =
            PerDevice { left: seen(view, DeviceName::Left, 0), right: seen(view, DeviceName::Right, 16), projector: Vec::new() };
        BoardView { id: format!("v{view:02}"), seen, stated_distance_mm: None }
    });
    (views.collect(), state)
}

/// A view of four points, one of them wrong in each image, was taken out, and told that most of its points do not fit.
#[test]
fn a_view_stays_where_most_of_its_few_points_fit() {
    let (mut views, state) = rig(2);
    let PerDevice { left, right, .. } = &mut views[1].seen;
    for seen in [left, right] {
        seen.retain(|sighting| [0, 3, 12, 15].contains(&sighting.point));
    }
    let mut is_used = all_used(&views);
    (is_used[1].left[3], is_used[1].right[0]) = (false, false);
    assert_eq!(worst_view(&views, &state, &is_used), None);
    // The image of one camera alone, as each camera is started, and beside one that was refused.
    is_used[1].left.fill(false);
    assert_eq!(worst_view(&views, &state, &is_used), None);
    is_used[1].right[1] = false;
    assert_eq!(worst_view(&views, &state, &is_used), Some(1), "half of them is not most");
}

/// Three points on a line leave the board free to turn about it.
#[test]
fn a_view_whose_points_are_left_on_a_line_is_taken_out() {
    let (mut views, state) = rig(2);
    views[1].seen.left.retain(|sighting| [0, 1, 3, 15].contains(&sighting.point));
    views[1].seen.right.clear();
    let mut is_used = all_used(&views);
    is_used[1].left[1] = false;
    assert_eq!(worst_view(&views, &state, &is_used), None);
    (is_used[1].left[1], is_used[1].left[3]) = (true, false);
    assert_eq!(worst_view(&views, &state, &is_used), Some(1));
}

/// Three wrong images make the deviation of their camera four times too large, and a fourth one fits by that. Without them
/// nothing fixed the board of its view, and the estimate ended without the view's name.
#[test]
fn a_view_that_fits_beside_wrong_images_alone_is_taken_out_with_them() {
    let (mut views, state) = rig(13);
    for sighting in views[..3].iter_mut().flat_map(|view| &mut view.seen.left) {
        let angle_rad = 2.4 * f64::from(sighting.point);
        sighting.pixel += Vector2::new(angle_rad.cos(), angle_rad.sin()) * 20.0;
    }
    for sighting in &mut views[12].seen.left {
        let place = sighting.point % 4 + sighting.point / 4;
        sighting.pixel.x += [1.3, -1.3][place as usize % 2];
    }
    views[12].seen.right.clear();
    let fitted = fit(&views, state, [true; SHARED]).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(fitted.kept, (0..12).collect::<Vec<_>>());
    let left = |view: usize| (view, DeviceName::Left);
    assert_eq!(fitted.refused, [left(12), left(0), left(1), left(2)]);
    let sigma_px = fitted.estimated.sigma_px;
    assert!((0.05..0.2).contains(&sigma_px.left), "{sigma_px:?}");
}

/// An estimate that ended at its limits was told as one that had converged.
#[test]
fn an_estimate_that_is_cut_short_says_so() {
    let (views, state) = rig(6);
    let off =
        Isometry3::from_parts(Translation3::new(8.0, -5.0, 20.0), UnitQuaternion::from_scaled_axis(Vector3::new(0.2, -0.1, 0.1)));
    let left_from_board = state.left_from_board.iter().map(|board| board * off).collect();
    let start = BundleState { left_from_board, ..state };
    let is_used = all_used(&views);
    let ended = |limits: [usize; 2]| {
        let end = rounds(&views, start.clone(), [true; SHARED], &is_used, limits).unwrap_or_else(|error| panic!("{error}"));
        (end.is_converged, end.iterations)
    };
    assert_eq!(ended([1, 1]), (false, 1));
    let (is_converged, iterations) = ended([ROUNDS, STEPS]);
    assert!(is_converged && (3..ROUNDS * STEPS).contains(&iterations), "{iterations}");
}
