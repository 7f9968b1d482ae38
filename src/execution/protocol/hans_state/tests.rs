//! Tests of the pushed states.

use proptest::prelude::*;

use super::*;
use crate::execution::protocol::mangled::each_mangled;

#[test]
fn the_header_is_that_of_the_maker() {
    let frame = HansRealtimeState { cycle_ms: 4, ..HansRealtimeState::default() }.encode();
    assert_eq!(frame.len(), 1136);
    assert_eq!(frame[..16], [0x4C, 0x54, 0x42, 0x52, 0x70, 0x04, 0, 0, 0x60, 0x04, 0, 0, 4, 0, 0, 0]);
}

#[test]
fn values_stand_where_the_maker_reads_them() {
    let mut frame = HansRealtimeState::default().encode();
    // Behind the header of sixteen bytes: five groups of six numbers, then the measured joints.
    frame[16 + 30 * 8..][..8].copy_from_slice(&12.5_f64.to_le_bytes());
    // Sixteen groups, two numbers, two groups of forces; then the scaling, three numbers, the time, the state.
    frame[16 + 110 * 8..][..8].copy_from_slice(&0.25_f64.to_le_bytes());
    frame[16 + 115 * 8..][..4].copy_from_slice(&33_i32.to_le_bytes());
    let state = take_realtime(&mut frame).expect("a frame").expect("complete");
    assert_eq!(state.actual_deg[0], 12.5);
    assert_eq!((state.speed_scaling, state.fsm), (0.25, 33));
    assert!(frame.is_empty());
}

#[test]
fn pushed_states_are_read_leniently_and_bounded() {
    let json = r#"{"StateAndError":{"robotState":33,"robotEnabled":1,"InPos":1,"Error_Code":0,"new":[1]},"EndIO":{}}"#;
    let mut held = pushed_frame(json);
    let whole = held.clone();
    for length in 0..whole.len() {
        assert_eq!(take_pushed(&mut whole[..length].to_vec()), Ok(None));
    }
    let pushed = take_pushed(&mut held).expect("a frame").expect("complete");
    assert_eq!((pushed.state.fsm, pushed.state.enabled, pushed.state.in_position), (33, 1, 1));
    let mut endless = [whole[..4].to_vec(), u32::MAX.to_le_bytes().to_vec(), (u32::MAX - 12).to_le_bytes().to_vec()].concat();
    assert!(matches!(take_pushed(&mut endless), Err(HansFrameError::Header(_))));
    assert!(matches!(take_pushed(&mut pushed_frame("[")), Err(HansFrameError::Json(_))));
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_million_inputs_neither_panic_nor_pile_up() {
    let realtime = HansRealtimeState { cycle_ms: 1, ..HansRealtimeState::default() }.encode();
    let known = [realtime, pushed_frame(r#"{"StateAndError":{"robotState":33}}"#), pushed_frame("{}")];
    let mut held: [Vec<u8>; 2] = Default::default();
    each_mangled(&known, |input| {
        for (held, take) in held.iter_mut().zip([
            |held: &mut Vec<u8>| take_realtime(held).map(|state| state.is_some()),
            |held: &mut Vec<u8>| take_pushed(held).map(|state| state.is_some()),
        ]) {
            held.extend_from_slice(input);
            while let Ok(true) = take(held) {}
            if take(held).is_err() {
                *held = Vec::new();
            }
            assert!(held.len() <= (1 << 20) + 12 + input.len());
        }
    });
}

proptest! {
    #[test]
    fn realtime_states_survive_a_round_trip(
        cycle_ms in 1_i32..100, actual_deg: [f64; 6], target_deg: [f64; 6], time_us: u64, fsm: i32, speed_scaling in 0.0..1.0,
    ) {
        let state = HansRealtimeState {
            cycle_ms, actual_deg, target_deg, time_us, fsm, speed_scaling, actual_tool: target_deg, target_deg_s: actual_deg,
            actual_deg_s: target_deg,
        };
        prop_assume!(actual_deg.iter().chain(&target_deg).all(|value| !value.is_nan()));
        prop_assert_eq!(take_realtime(&mut state.encode()), Ok(Some(state)));
    }
}
