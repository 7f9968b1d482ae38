//! Telegrams as the configurations of `kuka_experimental` and of `RSIPI` make them.

use proptest::prelude::*;

use super::*;
use crate::execution::protocol::mangled::each_mangled;

const REPORT: &str = "<Rob TYPE=\"KUKA\">\r\n<RIst X=\"0.0\" Y=\"0.0\" Z=\"0.0\" A=\"0.0\" B=\"0.0\" C=\"0.0\" />\
    <RSol X=\"0.0\" Y=\"0.0\" Z=\"0.0\" A=\"0.0\" B=\"0.0\" C=\"0.0\"/><AIPos A1=\"0.0\" A2=\"-90.0\" A3=\"90.0\" A4=\"0.0\" \
    A5='90.0' A6=\"1.5e1\" /><ASPos A1=\"0.0\" A2=\"-90.0\" A3=\"90.0\" A4=\"0.0\" A5=\"90.0\" A6=\"0.0\"/>\
    <EIPos E1=\"45.0\" E2=\"0\" E3=\"0\" E4=\"0\" E5=\"0\" E6=\"0\"/><Delay D=\"3\" /><DiL>7</DiL><IPOC> 4208163634 </IPOC></Rob>\r\n";

fn names() -> RsiNames {
    RsiNames { sender_type: "ImFree".to_owned(), axis_tag: "AK".to_owned(), table_tag: "EK".to_owned() }
}

#[test]
fn a_telegram_of_a_controller_is_read() {
    let read = RsiReport::decode(REPORT.as_bytes()).expect("a telegram");
    assert_eq!(read.axes_deg, [0.0, -90.0, 90.0, 0.0, 90.0, 15.0]);
    assert_eq!(read.commanded_deg, Some([0.0, -90.0, 90.0, 0.0, 90.0, 0.0]));
    assert_eq!(read.external_deg.map(|deg| deg[0]), Some(45.0));
    assert_eq!((read.late, read.ipoc), (Some(3), 4_208_163_634));
}

#[test]
fn an_answer_echoes_the_time_stamp_under_the_configured_names() {
    let correction = RsiCorrection { axes_deg: [0.5, -1.0, 0.0, 0.0, 0.0, 2.0], table: Some((2, -3.0)), ipoc: 42 };
    let names = RsiNames { sender_type: "Scan".to_owned(), axis_tag: "AKorr".to_owned(), table_tag: "EKorr".to_owned() };
    assert_eq!(
        correction.encode(&names),
        "<Sen Type=\"Scan\"><AKorr A1=\"0.500000\" A2=\"-1.000000\" A3=\"0.000000\" A4=\"0.000000\" A5=\"0.000000\" \
         A6=\"2.000000\"/><EKorr E2=\"-3.000000\"/><IPOC>42</IPOC></Sen>"
    );
    assert_eq!(RsiCorrection::decode(correction.encode(&names).as_bytes(), &names), Ok(correction));
}

#[test]
fn telegrams_that_lack_something_are_refused() {
    for (from, to) in [
        ("AIPos", "AIPoz"),
        ("IPOC", "IPOX"),
        ("-90.0\" A3", "NaN\" A3"),
        ("A5='90.0'", "A5='90.0"),
        ("A4=\"0.0\"", "A4=\"inf\""),
        ("4208163634", "-1"),
        ("<Rob", "<Sen"),
        ("</Rob>", ""),
        ("</IPOC>", "</IPOC"),
        ("D=\"3\"", "D=\"three\""),
    ] {
        assert!(RsiReport::decode(REPORT.replace(from, to).as_bytes()).is_err(), "{from} to {to}");
    }
    assert!(RsiReport::decode(b"\xff<Rob>").is_err());
}

proptest! {
    #[test]
    fn what_is_written_is_read(axes in prop::array::uniform6(-400_i32..400), table in -400_i32..400, late: u32, ipoc: u64) {
        let deg = axes.map(|axis| f64::from(axis) / 8.0);
        let report = RsiReport { axes_deg: deg, commanded_deg: Some(deg), external_deg: Some(deg), late: Some(late), ipoc };
        prop_assert_eq!(RsiReport::decode(report.encode().as_bytes()), Ok(report));
        let correction = RsiCorrection { axes_deg: deg, table: Some((6, f64::from(table) / 8.0)), ipoc };
        prop_assert_eq!(RsiCorrection::decode(correction.encode(&names()).as_bytes(), &names()), Ok(correction));
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_million_inputs_do_no_harm() {
    let answer = RsiCorrection { axes_deg: [1.0; 6], table: Some((1, 2.0)), ipoc: 9 }.encode(&names());
    let mut read = 0;
    each_mangled(&[REPORT.as_bytes(), answer.as_bytes()], |input| {
        read += usize::from(RsiReport::decode(input).is_ok()) + usize::from(RsiCorrection::decode(input, &names()).is_ok());
    });
    assert!(read > 1000, "{read} were telegrams");
}
