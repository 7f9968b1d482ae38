//! Tests of the text commands.

use proptest::prelude::*;

use super::*;
use crate::execution::protocol::mangled::each_mangled;

/// Messages of the maker's documents and SDK.
const GOLDEN: &[&str] = &[
    "ConnectToBox,;",
    "Electrify,;",
    "ReadVersion,0,;",
    "GrpPowerOn,0,;",
    "GrpStop,0,;",
    "ReadActPos,0,;",
    "ReadCurFSM,0,;",
    "SetOverride,0,0.5,;",
    "WayPoint,0,420,0,445,180,0,180,0,0,90,0,90,0,TCP,Base,50,100,50,0,0,0,0,0,ID1,;",
    "StartPushMovePath,0,scan,0.5,2,;",
    "PushMovePathJ,0,scan,0,0,90,0,90,0,;",
    "EndPushMovePath,0,scan,;",
    "ReadMovePathState,0,scan,;",
    "MovePath,0,scan,;",
    "StartServo,0,8000,0.004,;",
    "PushServoJ,0,1,2,3,4,5.5,-6,;",
    "SetBoxDO,3,1,;",
    "ReadBoxDI,4,;",
];

fn messages(stream: &[u8]) -> Vec<Result<String, HansSyntax>> {
    let mut frames = HansFrames::default();
    frames.push(stream);
    std::iter::from_fn(|| frames.next_message()).collect()
}

#[test]
fn requests_are_written_and_read_as_the_maker_has_them() {
    for text in GOLDEN {
        let [message] = &messages(text.as_bytes())[..] else { panic!("{text}") };
        let request = HansRequest::parse(message.as_ref().expect("text")).expect("a request");
        assert_eq!(&request.encode(), text);
    }
    let way_point = HansRequest::parse(GOLDEN[8].trim_end_matches(';')).expect("a way point");
    let HansRequest::WayPoint(point) = way_point else { panic!("{way_point:?}") };
    assert_eq!((point.pose[2], point.joints_deg[2], point.speed, point.radius_mm), (445.0, 90.0, 50.0, 50.0));
    assert_eq!((point.command_id.as_str(), point.is_linear, point.is_joint_target), ("ID1", false, false));
}

#[test]
fn a_message_ends_at_its_semicolon_wherever_a_packet_did() {
    let stream = b"ReadRobotState,OK,0,1,0,0,0,1,0,0,0,1,1,1,1,;GrpStop,Fail,20004,;errorcmd,Fail,40056,;";
    let mut frames = HansFrames::default();
    let mut read = Vec::new();
    for byte in stream {
        frames.push(&[*byte]);
        read.extend(frames.next_message());
    }
    assert_eq!(read, messages(stream));
    let replies: Vec<_> = read.into_iter().map(|text| HansReply::parse(&text.expect("text")).expect("a reply")).collect();
    let HansOutcome::Done(values) = &replies[0].outcome else { panic!("{replies:?}") };
    let flags = RobotFlags::read(values).expect("thirteen flags");
    assert!(flags.is_enabled && flags.are_brakes_open && flags.is_in_position && !flags.is_moving);
    assert_eq!((replies[1].command.as_str(), &replies[1].outcome), ("GrpStop", &HansOutcome::Fail(20004)));
    assert_eq!(replies[2].outcome, HansOutcome::Unknown);
}

#[test]
fn what_is_no_request_is_told_apart() {
    let parse = |text: &str| HansRequest::parse(text).expect_err(text);
    assert_eq!(parse("GrpFly,0,"), HansSyntax::UnknownCommand("GrpFly".into()));
    assert_eq!(parse(""), HansSyntax::UnknownCommand(String::new()));
    for text in [
        "GrpStop,",
        "GrpStop,1,",
        "GrpStop,0,7,",
        "SetOverride,0,",
        "SetOverride,0,nan,",
        "SetOverride,0,inf,",
        "PushServoJ,0,1,2,3,4,5,",
        "MovePath,0,",
        "WayPoint,0,1,2,3,",
    ] {
        assert!(matches!(parse(text), HansSyntax::Arguments(_)), "{text}");
    }
}

#[test]
fn a_stream_without_end_is_refused_and_forgotten() {
    let mut frames = HansFrames::default();
    frames.push(&vec![b'x'; MAX_MESSAGE_BYTES + 1]);
    assert_eq!(frames.next_message(), Some(Err(HansSyntax::TooLong)));
    assert_eq!(frames.held.capacity(), 0);
    frames.push(b"Gr\xFFpStop,0,;GrpStop,0,;");
    assert_eq!(frames.next_message(), Some(Err(HansSyntax::NotText)));
    assert_eq!(frames.next_message(), Some(Ok("GrpStop,0,".into())));
}

#[test]
fn a_position_has_pose_and_joints_first() {
    let text: Vec<String> = (1..=24).map(|value| value.to_string()).collect();
    let read = ActualPosition::read(&text).expect("a position");
    assert_eq!((read.pose[0], read.joints_deg[0], read.joints_deg[5]), (1.0, 7.0, 12.0));
    assert_eq!(ActualPosition::read(&text[..11]), None);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_million_inputs_neither_panic_nor_pile_up() {
    let mut known: Vec<Vec<u8>> = GOLDEN.iter().map(|text| text.as_bytes().to_vec()).collect();
    known.push(b"ReadRobotState,OK,0,1,0,0,0,1,0,0,0,1,1,1,1,;".to_vec());
    let mut frames = HansFrames::default();
    let mut understood = 0_usize;
    each_mangled(&known, |input| {
        frames.push(input);
        while let Some(message) = frames.next_message() {
            let Ok(text) = message else { continue };
            understood += usize::from(HansRequest::parse(&text).is_ok());
            if let Ok(HansReply { outcome: HansOutcome::Done(values), .. }) = HansReply::parse(&text) {
                let _ = (RobotFlags::read(&values), ActualPosition::read(&values));
            }
        }
        assert!(frames.held.len() <= MAX_MESSAGE_BYTES);
    });
    assert!(understood > 10_000, "{understood}");
}

prop_compose! {
    fn six()(values in prop::array::uniform6(-36_000_000_i64..36_000_000)) -> [f64; 6] {
        values.map(|value| value as f64 / 1e5)
    }
}

proptest! {
    #[test]
    fn requests_survive_a_round_trip(
        pose in six(), joints_deg in six(), speed in 1_u32..400, is_linear: bool, is_joint_target: bool, id in "[A-Za-z0-9]{1,12}",
    ) {
        let point = HansWayPoint {
            pose, joints_deg, tool: "TCP".into(), user_frame: "Base".into(), speed: speed.into(), acceleration: 720.5,
            radius_mm: 0.0, is_linear, is_joint_target, command_id: id.clone(),
        };
        for request in [
            HansRequest::WayPoint(Box::new(point)),
            HansRequest::PushServoJ { joints_deg },
            HansRequest::PushMovePathJ { name: id, joints_deg },
            HansRequest::Acs2Pcs { joints_deg, tool: pose, user_frame: [0.0; 6] },
        ] {
            let text = request.encode();
            prop_assert_eq!(HansRequest::parse(text.trim_end_matches(';')), Ok(request));
        }
    }

    #[test]
    fn replies_survive_a_round_trip(values in prop::collection::vec("[A-Za-z0-9.-]{1,9}", 0..30), code in -9_i64..70_000) {
        for outcome in [HansOutcome::Done(values), HansOutcome::Fail(code)] {
            let reply = HansReply { command: "ReadActPos".into(), outcome };
            prop_assert_eq!(HansReply::parse(reply.encode().trim_end_matches(';')), Ok(reply));
        }
    }

    #[test]
    fn flags_survive_a_round_trip(bits: [bool; 11], error_code in 0_i64..70_000, error_axis in 0_i64..6) {
        let flags = RobotFlags {
            is_moving: bits[0], is_enabled: bits[1], error_code, error_axis, are_brakes_open: bits[2], is_paused: bits[3],
            is_emergency_stop: bits[4], is_guard_open: bits[5], is_electrified: bits[6], is_box_connected: bits[7],
            is_blending_done: bits[8], is_in_position: bits[9],
        };
        prop_assert_eq!(RobotFlags::read(&flags.values()), Some(flags));
    }
}
