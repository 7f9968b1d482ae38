use super::{commanded_before, nearest, off_segment, points};
use crate::cell::Configuration;
use crate::execution::tests::rehearsal::planned;
use crate::program::Step;

fn at(first: f64, table_rad: f64) -> Configuration {
    Configuration { joints_rad: [first, 0.0, 0.0, 0.0, 0.0, 0.0], table_rad }
}

#[test]
fn a_step_begins_where_the_last_move_ended() {
    let program = &planned().program;
    let mut here = program.home_rad;
    for (index, step) in program.steps.iter().enumerate() {
        assert_eq!(commanded_before(program, index), here);
        let way = points(program, index);
        assert_eq!(way[0], here);
        if let Step::Move(step) = step {
            assert_eq!((way.len(), way[way.len() - 1]), (step.via_rad.len() + 2, step.target_rad));
            here = step.target_rad;
        } else {
            assert_eq!(way.len(), 1);
        }
    }
}

#[test]
fn the_nearest_point_is_on_the_latest_segment_that_passes_it() {
    let way = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
    assert_eq!(nearest(&way, &at(0.25, 0.01)).0, 0);
    assert_eq!(nearest(&way, &at(1.0, 0.0)), (1, at(1.0, 0.0)));
    assert_eq!(nearest(&way, &at(0.5, 1.2)), (2, at(0.5, 1.0)));
    assert_eq!(nearest(&way[..1], &at(0.5, 1.2)), (0, at(0.0, 0.0)));
    assert_eq!(nearest(&way, &at(-1.0, -0.5)).1, at(0.0, 0.0));
}

#[test]
fn arm_and_table_may_be_out_of_step_but_not_off_their_ways() {
    let (from, to) = (at(0.0, 0.0), at(1.0, 1.0));
    assert!(off_segment(&from, &to, &at(0.2, 0.9)).1 < 1e-12);
    // Paused there, it goes on from there.
    assert_eq!(nearest(&[from, to], &at(0.2, 0.9)), (0, at(0.2, 0.9)));
    assert_eq!(off_segment(&from, &to, &at(0.2, 1.5)), (7, 0.5));
    let aside = Configuration { joints_rad: [0.5, 0.2, 0.0, 0.0, 0.0, 0.0], table_rad: 0.0 };
    let (axis, off) = off_segment(&from, &to, &aside);
    assert!(axis == 2 && (off - 0.2).abs() < 1e-12);
}
