//! Commands of Han's CPS interface, after the vendor's Python SDK: `Name,argument,…,;`, and the lines for the sender that the
//! script's header defines.

use vantage::planning::params::DialectParams;
use vantage::program::dialects::DialectFile;

use super::Said;

/// Instructions that the script gives the robot and its sender.
pub(super) fn read(file: &DialectFile, params: &DialectParams) -> Vec<Said> {
    let lines: Vec<&str> = file.text.lines().filter(|line| !line.starts_with('#')).collect();
    let mut here = [f64::NAN; 7];
    let mut said = Vec::new();
    let mut index = 0;
    while index < lines.len() {
        let (line, next) = (lines[index], lines.get(index + 1).copied().unwrap_or_default());
        index += 1;
        if let Some(order) = line.strip_prefix('@') {
            let (word, rest) = order.split_once(' ').unwrap_or((order, ""));
            let numbers: Vec<f64> = rest.split(' ').filter(|n| !n.is_empty()).map(number).collect();
            match (word, numbers.as_slice()) {
                ("home", [joints @ .., table]) if joints.len() == 6 => {
                    here = std::array::from_fn(|axis| joints.get(axis).copied().unwrap_or(*table));
                    said.push(Said::Begin(here));
                }
                ("wait", [secs]) => said.push(Said::Wait(*secs)),
                ("table", [angle]) => {
                    here[6] = *angle;
                    said.push(Said::Go(here));
                }
                ("scan", [_, _]) => {
                    let pulse = lines[index..index + 5].join("|");
                    let (output, input) = (params.scan_output, params.scan_input);
                    let (pulse_secs, timeout_secs) = (params.pulse_secs, params.timeout_secs);
                    let wanted = format!(
                        "@off {input} {timeout_secs:.3}|SetBoxDO,{output},1,;|@wait {pulse_secs:.3}|SetBoxDO,{output},0,;|\
                         @input {input} {timeout_secs:.3}"
                    );
                    assert_eq!(pulse, wanted);
                    index += 5;
                    said.push(Said::Scan);
                }
                other => panic!("{other:?}"),
            }
        } else {
            here[..6].copy_from_slice(&way_point(line));
            assert_eq!(next, "@motion", "nothing is sent before the arm stands");
            index += 1;
            said.push(Said::Go(here));
        }
    }
    said
}

fn number(text: &str) -> f64 {
    text.parse().unwrap_or_else(|_| panic!("{text:?} is no number"))
}

/// The joints of `WayPoint,rbtID,pose (6),joints (6),TCP,UCS,speed,acceleration,radius,type,isJoint,isSeek,bit,state,cmdID,;`.
fn way_point(line: &str) -> [f64; 6] {
    let fields: Vec<&str> = line.split(',').collect();
    assert_eq!((fields.len(), fields[0], fields[1], fields[25]), (26, "WayPoint", "0", ";"), "{line}");
    assert_eq!(fields[14..16], ["TCP", "Base"]);
    assert!(number(fields[16]) > 0.0 && number(fields[17]) > 0.0);
    assert_eq!(fields[18..24], ["0", "0", "1", "0", "0", "0"], "a stop at the joints");
    std::array::from_fn(|joint| number(fields[8 + joint]))
}
