use proptest::prelude::*;

use super::{Trapezoid, segment};
use crate::cell::Configuration;
use crate::execution::tests::rehearsal::planned;

#[test]
fn a_segment_takes_the_time_that_the_program_was_planned_with() {
    let axes = planned().cell.axes();
    let from = planned().program.home_rad;
    for travel in [[0.3, -0.2, 0.1, 0.0, 0.5, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.01], [1e-6; 7]] {
        let to = from.along(&travel, 1.0);
        let target = segment(&axes, &from, &to, 0.4, 3).expect("moves");
        let secs = axes.move_secs(&from, &to, 0.4);
        assert!((target.duration.as_secs_f64() - secs).abs() < 1e-6);
        let own = Trapezoid::within(&from.travel_rad(&to), &target.max_speed_rad_s, &target.max_acceleration_rad_s2);
        assert!((own.expect("moves").secs() - secs).abs() < 1e-9);
        assert!(target.max_speed_rad_s.iter().zip(travel).all(|(speed, travel)| (*speed == 0.0) == (travel == 0.0)));
    }
    assert_eq!(segment(&axes, &from, &from, 1.0, 1), None);
}

#[test]
fn limits_that_are_none_give_no_motion() {
    for (speed, acceleration) in [(0.0, 1.0), (1.0, 0.0), (f64::NAN, 1.0), (-1.0, 1.0)] {
        assert!(Trapezoid::within(&[1.0], &[speed], &[acceleration]).is_none(), "{speed} {acceleration}");
    }
}

proptest! {
    #[test]
    fn the_share_rises_within_its_limits_and_brakes_to_rest(
        travel in 0.001..3.0_f64, speed in 0.01..4.0_f64, acceleration in 0.01..10.0_f64, at in 0.0..1.0_f64, part in 0.0..1.0_f64,
    ) {
        let way = Trapezoid::within(&[travel], &[speed], &[acceleration]).expect("moves");
        let (secs, step) = (way.secs(), way.secs() / 500.0);
        prop_assert_eq!((way.share(0.0), way.share(secs)), (0.0, 1.0));
        for number in 0..500 {
            let (a, b) = (way.share(f64::from(number) * step), way.share(f64::from(number + 1) * step));
            prop_assert!(a <= b && (b - a) * travel <= speed * step * (1.0 + 1e-9));
        }
        let from = at * secs;
        let (rest, takes) = way.braked(from);
        prop_assert!(rest <= 1.0 && rest >= way.share(from));
        prop_assert!(way.rate(from) * travel <= speed * (1.0 + 1e-9));
        let (early, late) = (way.braking(from, part * takes), way.braking(from, takes));
        prop_assert!(early <= late + 1e-12 && (late - rest).abs() < 1e-12);
        prop_assert!(early >= way.share(from) - 1e-12);
    }
}

#[test]
fn shares_of_one_motion_keep_arm_and_table_in_step() {
    let axes = planned().cell.axes();
    let from = planned().program.home_rad;
    let to = Configuration { table_rad: from.table_rad + 1.0, joints_rad: from.joints_rad.map(|joint| joint + 0.05) };
    let target = segment(&axes, &from, &to, 1.0, 1).expect("moves");
    let table = Trapezoid::within(&[1.0], &[target.max_speed_rad_s[6]], &[target.max_acceleration_rad_s2[6]]).expect("moves");
    let arm = Trapezoid::within(&[0.05], &[target.max_speed_rad_s[0]], &[target.max_acceleration_rad_s2[0]]).expect("moves");
    assert!((table.secs() - arm.secs()).abs() < 1e-9);
    assert!((table.share(0.3) - arm.share(0.3)).abs() < 1e-9);
}
