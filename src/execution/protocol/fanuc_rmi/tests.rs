//! Packets as B-84184EN/03 prints them, and as `fanuc_ucl` and a public simulator write theirs.

use proptest::prelude::*;

use super::*;
use crate::execution::protocol::mangled::each_mangled;

const MOTION: &str = "{\"Instruction\": \"FRC_JointMotionJRep\", \"SequenceID\": 1, \"JointAngle\": {\"J1\": 5.000000, \
    \"J2\": 0.000000, \"J3\": 0.000000, \"J4\": 0.000000, \"J5\": -90.000000, \"J6\": 0.000000}, \"SpeedType\": \"mSec\", \"Speed\": 1500, \"TermType\": \"FINE\", \
    \"TermValue\": 1}\r\n";
const STATUS: &str = "{\"Command\" : \"FRC_GetStatus\", \"ErrorID\" : 0, \"ServoReady\" : 1, \"TPMode\" : 0, \"RMIMotionStatus\" : 1, \
    \"ProgramStatus\" : 1, \"SingleStepMode\" : 0, \"NumberUTool\" : 10, \"NextSequenceID\" : 7, \"NumberUFrame\" : 9, \"Override\" : 25 } \r\n";

fn motion() -> RmiJointMotion {
    let joints = RmiJoints { arm_deg: [5.0, 0.0, 0.0, 0.0, -90.0, 0.0], extended_deg: [None; 3] };
    RmiJointMotion { sequence: 1, joints, speed: RmiSpeed::Milliseconds(1500) }
}

#[test]
fn requests_are_those_of_the_manual() {
    assert_eq!(RmiRequest::Connect.encode(), "{\"Communication\": \"FRC_Connect\"}\r\n");
    assert_eq!(RmiRequest::GetStatus.encode(), "{\"Command\": \"FRC_GetStatus\"}\r\n");
    assert_eq!(RmiRequest::SetOverRide(25).encode(), "{\"Command\": \"FRC_SetOverRide\", \"Value\": 25}\r\n");
    let initialize = RmiRequest::Initialize { group_mask: Some(1) };
    assert_eq!(initialize.encode(), "{\"Command\": \"FRC_Initialize\", \"GroupMask\": 1}\r\n");
    assert_eq!(RmiRequest::JointMotion(motion()).encode(), MOTION);
}

#[test]
fn replies_of_the_manual_are_read() {
    let read = |line: &str| RmiReply::decode(line.as_bytes()).expect(line);
    let connect = "{\"Communication\" : \"FRC_Connect\", \"ErrorID\" : 0, \"PortNumber\" : 16002, \"MajorVersion\" : 7, \"MinorVersion\" : 1}\r\n";
    assert_eq!(read(connect), RmiReply::Connected { port: 16002, version: (7, 1) });
    let status = RmiStatus {
        servo_ready: true,
        pendant_enabled: false,
        motion_running: true,
        program: RmiProgram::Paused,
        next_sequence: Some(7),
        override_percent: Some(25),
    };
    assert_eq!(read(STATUS), RmiReply::Status(status));
    let moved = "{\"Instruction\" : \"FRC_JointMotionJRep\", \"ErrorID\" : 0, \"SequenceID\" : 3}";
    assert_eq!(read(moved), RmiReply::Moved { sequence: 3 });
    let refused = "{\"Instruction\" : \"FRC_JointMotionJRep\", \"ErrorID\" : 2556957, \"SequenceID\" : 3}";
    let command = "FRC_JointMotionJRep".to_owned();
    assert_eq!(read(refused), RmiReply::Refused { command, sequence: Some(3), error: 2_556_957 });
    assert_eq!(error_text(2_556_957), "number of the instruction out of order");
    let unknown = "{\"Command\" : \"Unknown\", \"ErrorID\" : 2556941}";
    assert_eq!(read(unknown), RmiReply::Refused { command: "Unknown".to_owned(), sequence: None, error: 2_556_941 });
    assert_eq!(read("{\"Communication\":\"FRC_SystemFault\",\"SequenceID\":4}"), RmiReply::SystemFault { sequence: Some(4) });
    assert_eq!(read("{\"Communication\":\"FRC_Terminate\"}"), RmiReply::Terminated);
}

#[test]
fn joint_3_is_counted_from_the_ground_on_the_wire() {
    // Upper arm leant by 30 degrees, forearm turned by 20 against it: over the ground the forearm is at -10.
    let program = [0.1, 30_f64.to_radians(), 20_f64.to_radians(), 0.2, 0.3, 0.4];
    let coupled = RmiJoints::of_program(&program, JointThreeOrigin::UpperArm, [None; 3]);
    assert!((coupled.arm_deg[2] + 10.0).abs() < 1e-9 && (coupled.arm_deg[1] - 30.0).abs() < 1e-9);
    let plain = RmiJoints::of_program(&program, JointThreeOrigin::Ground, [None; 3]);
    assert!((plain.arm_deg[2] - 20.0).abs() < 1e-9);
    // A turn of joint 2 alone leaves the forearm's slope, and so the program's joint 3 turns against it.
    let back: [f64; 6] = coupled.to_program(JointThreeOrigin::UpperArm).expect("six joints");
    assert!(back.iter().zip(&program).all(|(back, there)| (back - there).abs() < 1e-12));
    assert_eq!(coupled.to_program::<7>(JointThreeOrigin::Ground), None, "no table");
}

#[test]
fn extended_axes_that_are_not_the_table_stay() {
    let rail = [Some(500.0), Some(7.0), None];
    let six = RmiJoints::of_program(&[0.0; 6], JointThreeOrigin::Ground, rail);
    assert_eq!(six.extended_deg, rail);
    let seven = RmiJoints::of_program(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], JointThreeOrigin::Ground, rail);
    assert_eq!(seven.extended_deg, [Some(1_f64.to_degrees()), Some(7.0), None]);
}

#[test]
fn times_are_rounded_up_and_too_long_ones_refused() {
    let lasting = |secs: f64| RmiSpeed::lasting(Duration::from_secs_f64(secs));
    assert_eq!(lasting(1.2001), Ok(RmiSpeed::Milliseconds(1201)));
    assert_eq!(lasting(0.0), Ok(RmiSpeed::Milliseconds(1)));
    assert_eq!(lasting(32.768), Ok(RmiSpeed::Tenths(328)));
    assert!(lasting(3276.8).is_err());
}

#[test]
fn faults_are_told_apart() {
    let fault = |text| RmiFault::read(text);
    assert!(fault("SRVO-002").is_some_and(|fault| fault.is_emergency_stop() && !fault.is_guard()));
    assert!(fault("SRVO-004 Fence open").is_some_and(|fault| fault.is_guard()));
    assert!(fault("MOTN-017").is_some_and(|fault| !fault.is_emergency_stop() && fault.number == 17));
    assert_eq!((fault("No Error"), fault(""), fault("srvo-1"), fault("SRVO-x")), (None, None, None, None));
}

proptest! {
    #[test]
    fn what_is_written_is_read(joints in prop::array::uniform7(-360_000_i32..360_000), sequence in 1..=MAX_SEQUENCE, ms in 1_u16..=32_767) {
        let deg = joints.map(|joint| f64::from(joint) / 1000.0);
        let joints = RmiJoints { arm_deg: std::array::from_fn(|joint| deg[joint]), extended_deg: [Some(deg[6]), None, None] };
        let request = RmiRequest::JointMotion(RmiJointMotion { sequence, joints, speed: RmiSpeed::Milliseconds(ms) });
        prop_assert_eq!(RmiRequest::decode(request.encode().as_bytes()), Ok(request));
        let replies = [
            RmiReply::Joints(joints),
            RmiReply::Moved { sequence },
            RmiReply::Refused { command: "FRC_Abort".to_owned(), sequence: None, error: i64::from(ms) },
            RmiReply::SystemFault { sequence: Some(sequence) },
            RmiReply::Connected { port: ms, version: (ms, 1) },
        ];
        for reply in replies {
            prop_assert_eq!(RmiReply::decode(reply.encode().as_bytes()), Ok(reply));
        }
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_million_inputs_do_no_harm() {
    let joints = RmiReply::Joints(motion().joints).encode();
    let mut read = 0;
    each_mangled(&[MOTION.as_bytes(), STATUS.as_bytes(), joints.as_bytes()], |input| {
        read += usize::from(RmiReply::decode(input).is_ok()) + usize::from(RmiRequest::decode(input).is_ok());
    });
    assert!(read > 1000, "{read} were packets");
}
