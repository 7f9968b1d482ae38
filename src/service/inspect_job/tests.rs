//! Scans and records of runs, as an inspection reads them.

use std::sync::atomic::AtomicBool;

use sha2::{Digest, Sha256};

use super::*;
use crate::planning::context::Silent;
use crate::wire::hex;
use crate::wire::run::ConfigurationDocument;

#[test]
fn a_stored_scan_is_read_only_if_it_is_what_was_uploaded() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.xyz");
    std::fs::write(&path, "1 2 3\n4 5 6\n").expect("a file");
    let never = AtomicBool::new(false);
    let read = |sha256: String| {
        let (name, unit) = ("a.xyz".to_owned(), Some("mm".to_owned()));
        let source = ScanSource { path: path.clone(), sha256, name, is_named: true, view: None, unit, frame: None };
        source.read("/scans/0", &Context::new(&never, &Silent))
    };
    let uploaded = || hex(&Sha256::digest("1 2 3\n4 5 6\n"));
    assert_eq!(read(uploaded()).expect("whole")[0].cloud.points.len(), 2);
    std::fs::write(&path, "1 2 3\n4 5 7\n").expect("a file");
    let InspectError::Damaged(said) = read(uploaded()).expect_err("damaged") else { panic!("another error") };
    assert!(said.contains("a.xyz") && said.contains("upload the same file again"), "{said}");
    // Of a file in a folder no hash is known.
    assert_eq!(read(String::new()).expect("as it is")[0].cloud.points.len(), 2);
}

/// A scan without a name was inspected as of the view that the last digits of its id are.
#[test]
fn the_digits_of_an_id_are_not_taken_for_the_number_of_a_view() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.xyz");
    std::fs::write(&path, "1 2 3\n4 5 6\n").expect("a file");
    let never = AtomicBool::new(false);
    let cloud_name = |is_named: bool, view: Option<u32>| {
        let (name, unit) = ("01a2259b-44d0-7519-94fb-a834360dabf7".to_owned(), Some("mm".to_owned()));
        let source = ScanSource { path: path.clone(), sha256: String::new(), name, is_named, view, unit, frame: None };
        let read = source.read("/scans/0", &Context::new(&never, &Silent)).expect("as it is");
        read[0].cloud.name.clone()
    };
    assert_eq!(cloud_name(false, None).as_deref(), Some(UNNAMED));
    assert!(UNNAMED.chars().all(|c| !c.is_ascii_digit()), "no number is read from it");
    assert_eq!((cloud_name(false, Some(3)), cloud_name(true, None)), (None, None), "the view is given, or in the name");
}

#[test]
fn a_view_was_taken_where_it_was_scanned_and_not_where_the_part_was_located() {
    let step = |op: RunStepOp, viewpoint: Option<u32>, angle_deg: f64| {
        let at = ConfigurationDocument { joints_deg: [0.0; 6], table_angle_deg: angle_deg };
        RunStepRecord {
            step: 1,
            op,
            viewpoint,
            commanded: at,
            measured: at,
            axis_deviation_deg: 0.0,
            optical_axis_deviation_deg: 0.0,
            position_deviation_mm: 0.0,
            planned_secs: 0.0,
            actual_secs: 0.0,
            attempts: 1,
            capture_secs: None,
            capture_id: None,
        }
    };
    let steps = [
        step(RunStepOp::MoveJoints, None, 1.0),
        step(RunStepOp::Locate, Some(3), 2.0),
        step(RunStepOp::MoveJoints, None, 3.0),
        step(RunStepOp::Scan, Some(3), 4.0),
        step(RunStepOp::Scan, Some(1), 5.0),
    ];
    assert_eq!(scan_of(&steps, 3), Some(&steps[3]));
    assert_eq!(scan_of(&steps, 1), Some(&steps[4]));
    assert_eq!(scan_of(&steps[..3], 3), None);
}
