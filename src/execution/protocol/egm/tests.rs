//! Golden frames were written by Google's protobuf from ABB's description, as `abb-robot-client` 0.4.0 carries it.

use proptest::prelude::*;

use super::*;
use crate::execution::protocol::mangled::each_mangled;

/// A report with fields that are skipped here: pose, clock, test signals, utilisation.
const REPORT: &str = "0a0908ac0210f0a2041802128e010a3609000000000000f83f0900000000000034c0090000000000003e40090000000000000000\
    090000000000a046400900000000008066c012430a1b09000000000000f03f110000000000000040190000000000000840122409000000000000f03f\
    1100000000000000001900000000000000002100000000000000001a090900000000008056402204080510061a380a36090000000000002240090000\
    00000000224009000000000000224009000000000000224009000000000000224009000000000000224022\
    0208012a02080330013a0909000000000000f03f42020802510000000000002940";
const GUIDE: &str = "0a07080710e807180312430a3609000000000000f83f0900000000000034c0090000000000003e4009000000000000000009000000\
    0000a046400900000000008066c01a09090000000000805640";
const JOINTS_DEG: [f64; 6] = [1.5, -20.0, 30.0, 0.0, 45.25, -180.0];

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).expect("hex")).collect()
}

fn table() -> ExternalAxes {
    ExternalAxes { deg: [90.0, 0.0, 0.0, 0.0, 0.0, 0.0], count: 1 }
}

#[test]
fn a_report_of_protobuf_is_read() {
    let report = EgmReport {
        sequence: 300,
        time_ms: 70_000,
        joints_deg: JOINTS_DEG,
        external: table(),
        planned: Some(([9.0; 6], ExternalAxes::default())),
        motors: EgmMotors::On,
        guidance: EgmGuidance::Running,
        converged: true,
        rapid: EgmRapid::Running,
    };
    assert_eq!(EgmReport::decode(&bytes(REPORT)), Ok(report));
}

#[test]
fn a_guide_is_that_of_protobuf_byte_for_byte() {
    let guide = EgmGuide { sequence: 7, time_ms: 1000, joints_deg: JOINTS_DEG, external: table() };
    assert_eq!(guide.encode(), bytes(GUIDE));
    assert_eq!(EgmGuide::decode(&bytes(GUIDE)), Ok(guide));
}

#[test]
fn frames_without_six_finite_joints_are_refused() {
    let guide = |joints: &[f64]| {
        let mut frame = WireWriter::default();
        frame.message(2, &positions(joints, &ExternalAxes::default()));
        EgmGuide::decode(&frame.bytes)
    };
    for joints in [&[0.0; 5][..], &[0.0; 7], &[0.0, 0.0, f64::NAN, 0.0, 0.0, 0.0], &[f64::INFINITY; 6], &[]] {
        assert!(guide(joints).is_err(), "{joints:?}");
    }
    assert!(EgmGuide::decode(&[]).is_err());
    assert!(EgmGuide::decode(&vec![0; MAX_FRAME_BYTES + 1]).is_err());
    assert!(EgmGuide::decode(&bytes(&GUIDE[..GUIDE.len() - 2])).is_err(), "cut by a byte");
}

proptest! {
    #[test]
    fn what_is_written_is_read(sequence: u32, time_ms: u32, axes: [f64; 12], count in 0_usize..=6, state in 0_u64..4) {
        prop_assume!(axes.iter().all(|axis| axis.is_finite()));
        let joints_deg = std::array::from_fn(|axis| axes[axis]);
        let deg = std::array::from_fn(|axis| if axis < count { axes[6 + axis] } else { 0.0 });
        let external = ExternalAxes { deg, count };
        let guide = EgmGuide { sequence, time_ms, joints_deg, external };
        prop_assert_eq!(EgmGuide::decode(&guide.encode()), Ok(guide));
        let (motors, guidance, rapid) = (motors(state), guidance(state), rapid(state));
        let planned = (state > 1).then_some((joints_deg.map(|deg| deg / 2.0), external));
        let report =
            EgmReport { sequence, time_ms, joints_deg, external, planned, motors, guidance, converged: state == 1, rapid };
        prop_assert_eq!(EgmReport::decode(&report.encode()), Ok(report));
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_million_inputs_do_no_harm() {
    let (report, guide) = (bytes(REPORT), bytes(GUIDE));
    let mut read = 0;
    each_mangled(&[&report[..], &guide[..]], |input| {
        let outcome = (EgmReport::decode(input), EgmGuide::decode(input));
        read += usize::from(outcome.0.is_ok()) + usize::from(outcome.1.is_ok());
    });
    assert!(read > 1000, "{read} were frames");
}
