//! Frames by the *RTDE Guide*, and the program by its text.

use std::time::Duration;

use proptest::prelude::*;

use super::rtde::{OUTPUTS, RtdeFrame, RtdeReply, RtdeRequest, RtdeState};
use super::*;
use crate::cell::UrMotion;
use crate::execution::protocol::mangled::each_mangled;

fn reply(bytes: &[u8]) -> Result<RtdeReply, DeviceError> {
    let (frame, length) = RtdeFrame::first(bytes)?.ok_or_else(|| malformed("cut"))?;
    assert_eq!(length, bytes.len());
    RtdeReply::decode(frame)
}

fn request(bytes: &[u8]) -> Result<RtdeRequest, DeviceError> {
    let (frame, _) = RtdeFrame::first(bytes)?.ok_or_else(|| malformed("cut"))?;
    RtdeRequest::decode(frame)
}

fn state() -> RtdeState {
    RtdeState {
        timestamp_secs: 1.5,
        joints_rad: [0.1, -1.5, 1.2, 0.0, 0.5, 3.0],
        speeds_rad_s: [0.0, 0.2, 0.0, 0.0, 0.0, -0.1],
        runtime: 2,
        robot_bits: 0b11,
        safety_bits: 0b1,
        mode: 7,
    }
}

#[test]
fn requests_are_those_of_the_guide() {
    assert_eq!(RtdeRequest::Version(2).encode(), [0, 5, b'V', 0, 2]);
    assert_eq!(RtdeRequest::ControlVersion.encode(), [0, 3, b'v']);
    assert_eq!(RtdeRequest::Start.encode(), [0, 3, b'S']);
    assert_eq!(RtdeRequest::Pause.encode(), [0, 3, b'P']);
    let outputs = RtdeRequest::Outputs { rate_hz: 125.0, names: "timestamp,actual_q".to_owned() };
    assert_eq!(outputs.encode(), *b"\0\x1dO\x40\x5f\x40\0\0\0\0\0timestamp,actual_q");
    let inputs = RtdeRequest::Inputs { names: "speed_slider_mask".to_owned() };
    assert_eq!(inputs.encode(), *b"\0\x14Ispeed_slider_mask");
    let data = RtdeRequest::Data { recipe: 1, values: vec![0, 0, 0, 1] };
    assert_eq!(data.encode(), [0, 8, b'U', 1, 0, 0, 0, 1]);
}

#[test]
fn replies_of_the_guide_are_read() {
    assert_eq!(reply(&[0, 4, b'V', 1]), Ok(RtdeReply::Version(true)));
    let version = [0, 19, b'v', 0, 0, 0, 5, 0, 0, 0, 11, 0, 0, 0, 0, 0, 0, 0, 108];
    assert_eq!(reply(&version), Ok(RtdeReply::ControlVersion([5, 11, 0, 108])));
    let types = OUTPUTS.map(|(_, kind)| kind).join(",");
    let outputs = RtdeReply::Outputs { recipe: 1, types };
    assert_eq!(reply(&outputs.encode()), Ok(outputs));
    assert_eq!(reply(b"\0\x0dM\x03Hi!\x04RTDE\x02"), Ok(RtdeReply::Text("Hi!".to_owned())));
    let data = RtdeReply::Data { recipe: 1, values: state().encode() };
    assert_eq!(data.encode().len(), 3 + 1 + 8 + 48 + 48 + 16);
    assert_eq!(RtdeState::decode(&state().encode()), Ok(state()));
    assert!(RtdeState::decode(&state().encode()[1..]).is_err());
    assert!(RtdeState::decode(&RtdeState { joints_rad: [f64::NAN; 6], ..state() }.encode()).is_err());
}

#[test]
fn frames_wait_for_their_end() {
    let whole = RtdeReply::Version(true).encode();
    assert_eq!(RtdeFrame::first(&whole[..2]), Ok(None));
    assert_eq!(RtdeFrame::first(&whole[..3]), Ok(None));
    assert!(RtdeFrame::first(&[0, 2, b'V']).is_err(), "shorter than its own header");
}

#[test]
fn bits_tell_the_condition() {
    let safety = |bit: u32| RtdeState { safety_bits: 1 << bit, ..state() };
    assert!([5, 6, 7].into_iter().all(|bit| safety(bit).is_emergency_stopped()) && !safety(4).is_emergency_stopped());
    assert!(safety(4).is_guard_stopped() && safety(2).fault_bit() == Some(2) && safety(0).fault_bit().is_none());
    // Power alone, and brakes that one joint is moved against by hand: neither is an arm that can be led.
    assert!([5, 6].into_iter().all(|mode| !RtdeState { mode, ..state() }.are_brakes_open()) && state().are_brakes_open());
    assert!(state().is_powered() && state().is_program_running() && !state().is_hand_guided() && !state().is_paused());
}

#[test]
fn the_program_stops_by_itself_and_its_blocks_close() {
    let tuning = ServoTuning { lookahead_ms: 100, gain: 300 };
    for motion in UrMotion::ALL {
        let reverse = "10.0.0.1:50001".parse().expect("an address");
        let text = program_text(motion, tuning, reverse, Duration::from_millis(200));
        let words = |line: &str| line.trim().split([' ', '(']).next().unwrap_or_default().to_owned();
        let opened = text.lines().filter(|line| ["def", "thread", "while", "if"].contains(&words(line).as_str())).count();
        let closed = text.lines().filter(|line| line.trim() == "end").count();
        assert_eq!(opened, closed, "{text}");
        assert!(text.contains("socket_open(\"10.0.0.1\", 50001, \"vantage\")") && text.contains("wait_secs = 0.200"), "{text}");
        assert!(text.is_ascii() && text.lines().all(|line| line.len() < 160) && text.ends_with("end\n"), "{text}");
        assert!(text.contains(&format!("{}(vantage_q", motion.as_str())), "{text}");
        assert!(text.contains("stopj(vantage_a)\n  socket_close"), "{text}");
    }
}

#[test]
fn the_program_acknowledges_a_stop_before_it_brakes() {
    let tuning = ServoTuning { lookahead_ms: 100, gain: 300 };
    let reverse = "10.0.0.1:50001".parse().expect("an address");
    let text = program_text(UrMotion::Movej, tuning, reverse, Duration::from_millis(200));
    let (_, stop) = text.split_once("elif c[1] == 3:\n").expect("a stop");
    let lines: Vec<&str> = stop.lines().take(3).map(str::trim).collect();
    assert_eq!(lines, ["socket_send_int(c[2], \"vantage\")", "kill leader", "stopj(c[10] / 1000000.0)"]);
}

fn commands(joints_rad: [f64; 6], sequence: u32, value: f64) -> [UrCommand; 5] {
    [
        UrCommand::KeepAlive,
        UrCommand::SetPoint(joints_rad),
        UrCommand::Move { sequence, joints_rad, speed_rad_s: value, acceleration_rad_s2: 2.0 * value },
        UrCommand::Stop { sequence, acceleration_rad_s2: value },
        UrCommand::End,
    ]
}

proptest! {
    #[test]
    fn what_is_written_is_read(micro in prop::array::uniform6(-7_000_000_i32..7_000_000), sequence in 0..=i32::MAX as u32, value in 0_u32..1000) {
        for command in commands(micro.map(|micro| f64::from(micro) / 1e6), sequence, f64::from(value)) {
            prop_assert_eq!(UrCommand::decode(&command.encode()), Ok(command));
        }
        let version = [sequence, value, 0, 1];
        let text = "x".repeat(value as usize);
        for message in [
            RtdeReply::ControlVersion(version),
            RtdeReply::Outputs { recipe: 1, types: text.clone() },
            RtdeReply::Inputs { recipe: 2, types: text.clone() },
            RtdeReply::Start(true),
            RtdeReply::Pause(false),
            RtdeReply::Data { recipe: 3, values: vec![7; value as usize] },
            RtdeReply::Text(text.chars().take(255).collect()),
        ] {
            prop_assert_eq!(reply(&message.encode()), Ok(message));
        }
        for message in [RtdeRequest::outputs(f64::from(value)), RtdeRequest::Inputs { names: text }, RtdeRequest::Version(2)] {
            prop_assert_eq!(request(&message.encode()), Ok(message));
        }
    }
}

#[test]
fn a_million_inputs_do_no_harm() {
    let data = RtdeReply::Data { recipe: 1, values: state().encode() }.encode();
    let outputs = RtdeRequest::outputs(500.0).encode();
    let command = commands([0.1; 6], 1, 1.0)[2].encode();
    let mut read = 0;
    each_mangled(&[&data[..], &outputs[..], &command[..], &[0, 4, b'V', 1][..]], |input| {
        if let Ok(Some((frame, length))) = RtdeFrame::first(input) {
            assert!(length <= input.len());
            let state = match RtdeReply::decode(frame) {
                Ok(RtdeReply::Data { values, .. }) => RtdeState::decode(&values).is_ok(),
                other => other.is_ok(),
            };
            read += usize::from(state) + usize::from(RtdeRequest::decode(frame).is_ok());
        }
        if let Some((command, _)) = input.split_first_chunk() {
            read += usize::from(UrCommand::decode(command).is_ok());
        }
    });
    assert!(read > 1000, "{read} were messages");
}
