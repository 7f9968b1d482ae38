//! Limits, ends and stops of streamed ways.

use proptest::prelude::*;

use super::*;

const CYCLE: Duration = Duration::from_millis(4);

fn target(positions_rad: [f64; 3], duration: Duration) -> Target<3> {
    let (max_speed_rad_s, max_acceleration_rad_s2) = ([1.0, 0.5, 2.0], [4.0, 2.0, 3.0]);
    Target { sequence: 1, positions_rad, max_speed_rad_s, max_acceleration_rad_s2, duration }
}

/// Every set point until it stands, the start first.
fn way(mut points: SetPoints<3>, stop_at: Option<usize>) -> Vec<[f64; 3]> {
    let mut way = vec![points.at_rad()];
    while points.is_moving() && way.len() < 100_000 {
        if stop_at == Some(way.len()) {
            points.ramp_down();
        }
        way.push(points.advance(CYCLE));
    }
    way
}

#[test]
fn it_takes_the_time_asked_for_or_that_of_its_limits() {
    let secs = |to: [f64; 3], duration: f64| {
        let mut points = SetPoints::still([0.0; 3]);
        points.go(&target(to, Duration::from_secs_f64(duration)));
        (way(points, None).len() - 1) as f64 * CYCLE.as_secs_f64()
    };
    // Axis 2 is the slowest: 1 rad at 0.5 rad/s and 2 rad/s² takes 2.25 s.
    assert!((secs([0.5, 1.0, 0.0], 0.0) - 2.25).abs() < 0.01);
    assert!((secs([0.5, 1.0, 0.0], 4.0) - 4.0).abs() < 0.005);
    // A triangle: 0.02 rad at 3 rad/s².
    assert!((secs([0.0, 0.0, 0.02], 0.0) - 2.0 * (0.02_f64 / 3.0).sqrt()).abs() < 0.005);
    assert_eq!(secs([0.0; 3], 1.0), 0.0, "nowhere to go");
}

#[test]
fn an_axis_beside_the_program_does_not_hold_up_the_others() {
    // By the program joint 1 turns by a radian in three seconds and the others stay; they stand up to 0.04° beside.
    let mut target = target([1.0, 0.0, 0.0], Duration::from_secs(3));
    (target.max_speed_rad_s, target.max_acceleration_rad_s2) = ([0.5, 0.0, 0.0], [0.5, 0.0, 0.0]);
    let mut points = SetPoints::still([0.0, 0.0007, -0.0003]);
    points.go(&target);
    let way = way(points, None);
    assert_eq!(way[way.len() - 1], target.positions_rad);
    assert!(((way.len() - 1) as f64 * CYCLE.as_secs_f64() - 3.0).abs() < 0.005, "{}", way.len());
}

#[test]
fn what_was_not_taken_is_sent_again_and_nothing_jumps() {
    let mut points = SetPoints::still([0.0; 3]);
    points.go(&target([0.5, 1.0, 0.0], Duration::ZERO));
    let plain = way(points.clone(), None);
    // Every third answer is late: the arm has taken the others, each once.
    let mut taken = vec![points.at_rad()];
    for step in 1.. {
        let set_point = points.advance(CYCLE);
        if step % 3 == 0 {
            points.take_back(CYCLE);
        } else {
            taken.push(set_point);
        }
        if !points.is_moving() {
            break;
        }
    }
    for (taken, plain) in taken.iter().zip(&plain) {
        assert!((0..3).all(|axis| (taken[axis] - plain[axis]).abs() < 1e-9), "{taken:?} {plain:?}");
    }
    assert!(taken.len() + 1 >= plain.len(), "{} of {}", taken.len(), plain.len());
}

proptest! {
    #[test]
    fn every_cycle_keeps_to_the_limits(
        from in prop::array::uniform3(-3.0..3.0_f64), to in prop::array::uniform3(-3.0..3.0_f64), secs in 0.0..5.0_f64,
        stop_at in prop::option::of(1_usize..1500),
    ) {
        let target = target(to, Duration::from_secs_f64(secs));
        let mut points = SetPoints::still(from);
        points.go(&target);
        let way = way(points, stop_at);
        let dt = CYCLE.as_secs_f64();
        // Made up on the way by those that do not lead.
        let longest = (0..3).map(|axis| (to[axis] - from[axis]).abs()).fold(BESIDE_RAD, f64::max);
        let more = |largest: f64| largest * BESIDE_RAD / longest;
        let speeds: Vec<[f64; 3]> = way.windows(2).map(|pair| std::array::from_fn(|axis| (pair[1][axis] - pair[0][axis]) / dt)).collect();
        for axis in 0..3 {
            let rest = [[0.0; 3]];
            let padded: Vec<f64> = rest.iter().chain(&speeds).chain(&rest).map(|speed| speed[axis]).collect();
            prop_assert!(padded.iter().all(|speed| speed.abs() <= (target.max_speed_rad_s[axis] + more(2.0)) * (1.0 + 1e-9)));
            let hardest = padded.windows(2).map(|pair| (pair[1] - pair[0]).abs() / dt).fold(0.0, f64::max);
            prop_assert!(hardest <= (target.max_acceleration_rad_s2[axis] + more(4.0)) * (1.0 + 1e-6), "{} rad/s²", hardest);
            let between = |at: f64| at >= from[axis].min(to[axis]) - 1e-12 && at <= from[axis].max(to[axis]) + 1e-12;
            prop_assert!(way.iter().all(|point| between(point[axis])));
        }
        let end = way[way.len() - 1];
        prop_assert!(stop_at.is_some() || end == to);
    }
}
