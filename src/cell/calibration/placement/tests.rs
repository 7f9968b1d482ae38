use nalgebra::UnitQuaternion;

use super::super::se3::{exp, log, twist};
use super::super::tests::Noise;
use super::*;

fn pose() -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::new(40.0, -25.0, 12.0), UnitQuaternion::from_euler_angles(0.1, -0.2, 1.1))
}

const CORNERS: [[f64; 3]; 5] = [[0.0, 0.0, 0.0], [120.0, 0.0, 5.0], [0.0, 80.0, 0.0], [110.0, 75.0, 30.0], [60.0, 20.0, 45.0]];

fn pairs(count: usize) -> Vec<[Point3<f64>; 2]> {
    CORNERS[..count].iter().map(|corner| Point3::from(*corner)).map(|corner| [corner, pose() * corner]).collect()
}

fn apart(found: &Isometry3<f64>, truth: &Isometry3<f64>) -> f64 {
    log(&(truth.inverse() * found)).norm()
}

#[test]
fn three_points_and_more_tell_the_pose() {
    for count in 3..=5 {
        let placed = from_points(&pairs(count), None).expect("a pose");
        assert!(apart(&placed.pose, &pose()) < 1e-12 && placed.rms_mm < 1e-12, "{count}");
        assert_eq!(placed.covariance.is_some(), count > 3, "three points leave too little over to tell their scatter");
    }
    assert!(from_points(&pairs(3), Some(0.05)).expect("a pose").covariance.is_some());
}

/// Errors of 300 fits beside the covariance that each states.
#[test]
fn the_covariance_of_a_pose_from_points_is_true() {
    let (mut noise, runs, mut nees) = (Noise(4), 300, 0.0);
    for _ in 0..runs {
        let mut measured = pairs(5);
        measured.iter_mut().for_each(|[_, to]| *to += Vector3::new(noise.normal(), noise.normal(), noise.normal()) * 0.05);
        let placed = from_points(&measured, Some(0.05)).expect("a pose");
        let by = log(&(placed.pose.inverse() * pose()));
        let covariance = placed.covariance.expect("a covariance");
        nees += by.dot(&covariance.cholesky().expect("positive").solve(&by)) / f64::from(runs);
    }
    println!("placement NEES of 6: {nees:.2}");
    // 6 ± 2.576 √(12 / 300).
    assert!((5.48..=6.52).contains(&nees), "{nees}");
}

#[test]
fn points_that_tell_no_pose_are_refused_with_what_they_look_like() {
    assert_eq!(from_points(&pairs(2), None), Err(PlacementError::TooFew(2)));
    let line: Vec<_> = (0..4).map(|i| Point3::new(10.0 * f64::from(i), 0.0, 0.0)).map(|p| [p, pose() * p]).collect();
    assert!(matches!(from_points(&line, None), Err(PlacementError::Collinear { .. })));
    let mirrored: Vec<_> = pairs(5).into_iter().map(|[from, to]| [Point3::new(-from.x, from.y, from.z), to]).collect();
    assert!(matches!(from_points(&mirrored, None), Err(PlacementError::Mirrored { .. })));
    let metres: Vec<_> = pairs(5).into_iter().map(|[from, to]| [from, to / 1000.0]).collect();
    let Err(PlacementError::Scale { ratio }) = from_points(&metres, None) else { panic!("metres are another scale") };
    assert!((ratio - 1e-3).abs() < 1e-9);
}

#[test]
fn one_point_that_is_off_is_named_and_honest_points_are_not() {
    let mut noise = Noise(12);
    let mut measured = pairs(5);
    measured.iter_mut().for_each(|[_, to]| *to += Vector3::new(noise.normal(), noise.normal(), noise.normal()) * 0.03);
    let placed = from_points(&measured, None).expect("a pose");
    assert!(placed.rms_mm < rms_max_mm(5, None) && stray_point(&measured, &placed, None).is_none());
    for index in 0..5 {
        let mut wrong = measured.clone();
        wrong[index][1].x += 8.0;
        let placed = from_points(&wrong, None).expect("a pose");
        let stray = stray_point(&wrong, &placed, None).expect("a point that is off");
        assert!(stray.index == index && (stray.off_mm - 8.0).abs() < 0.5, "{index}: {stray:?}");
    }
    assert_eq!(stray_point(&pairs(3), &from_points(&pairs(3), None).expect("a pose"), None), None);
}

#[test]
fn swapped_points_exceed_the_limit_and_name_no_single_point() {
    let mut swapped = pairs(5);
    let second = swapped[1][1];
    swapped[1][1] = swapped[2][1];
    swapped[2][1] = second;
    // A mirrored fit may be told instead.
    if let Ok(placed) = from_points(&swapped, None) {
        assert!(placed.rms_mm > rms_max_mm(5, None) && stray_point(&swapped, &placed, None).is_none(), "{placed:?}");
    }
    assert!((rms_max_mm(3, Some(0.1)) - 0.3).abs() < 1e-12, "three points have as many residuals free as points");
}

#[test]
fn a_registered_cloud_and_a_seat_place_the_part() {
    let base_from_plate = Isometry3::translation(560.0, 10.0, 120.0) * exp(&twist(&Vector3::z(), &Vector3::zeros()));
    let base_from_cloud = Isometry3::translation(500.0, 0.0, 620.0) * exp(&twist(&(Vector3::x() * 3.0), &Vector3::zeros()));
    let cloud_from_part = base_from_cloud.inverse() * base_from_plate * pose();
    assert!(apart(&from_cloud(&base_from_plate, &base_from_cloud, &cloud_from_part), &pose()) < 1e-12);
    let seats = [
        Seat { name: "left".into(), table_from_seat: Isometry3::translation(-100.0, 0.0, 20.0) },
        Seat { name: "right".into(), table_from_seat: pose() },
    ];
    let part_from_seat = exp(&twist(&Vector3::new(0.2, 0.0, -0.4), &Vector3::new(5.0, 6.0, 7.0)));
    let placed = from_seat(&seats, "right", &part_from_seat).expect("a seat");
    assert!(apart(&(placed * part_from_seat), &pose()) < 1e-12);
    assert_eq!(from_seat(&seats, "middle", &part_from_seat), Err(PlacementError::UnknownSeat));
}

/// Poses drawn from the two covariances scatter as the one that is carried to the part says.
#[test]
fn the_scanners_uncertainty_is_carried_to_the_part() {
    let cloud_from_part =
        Isometry3::translation(20.0, -10.0, 480.0) * exp(&twist(&Vector3::new(2.9, 0.3, 0.2), &Vector3::zeros()));
    let diagonal = |turn: f64, shift: f64| {
        Matrix6::from_diagonal(&nalgebra::Vector6::new(turn, turn, turn, shift, shift, shift).map(|sd: f64| sd * sd))
    };
    let (of_part, of_scanner) = (diagonal(1e-4, 0.02), diagonal(2e-4, 0.05));
    let expected = from_cloud_covariance(&cloud_from_part, &of_part, Some(&of_scanner));
    let (mut noise, runs, mut found) = (Noise(8), 4000, Matrix6::zeros());
    for _ in 0..runs {
        let (scanner, part) = (exp(&noise.twist(2e-4, 0.05)), exp(&noise.twist(1e-4, 0.02)));
        let by = log(&(cloud_from_part.inverse() * scanner * cloud_from_part * part));
        found += by * by.transpose() / f64::from(runs);
    }
    for axis in 0..6 {
        let ratio = found[(axis, axis)] / expected[(axis, axis)];
        assert!((ratio - 1.0).abs() < 0.08, "{axis}: {ratio}");
    }
    assert_eq!(from_cloud_covariance(&cloud_from_part, &of_part, None), of_part);
}
