//! The table of faults of Han's controllers and the MINAS A6, each in each state of a run: held against `FAULTS.md`, which is
//! written from it.

use std::fmt::Write as _;
use std::time::Duration;

use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::fault_table::{STATES, fault_in_each_state};
use super::rehearsal::{in_simulated_time, on_deep_stacks, planned};
use super::rough_cell::{RoughCell, RoughFault};
use super::simulated_network::Passage;
use crate::execution::protocol::minas_a6::coil;
use crate::execution::session::{DeviceRole, RunState, RunStatus};
use crate::execution::simulators::faults::FaultCommand;

/// A fault: in words, the states that it may end in once armed.
type Row = (&'static str, RoughFault, &'static [RunState]);

const LATE: Duration = Duration::from_millis(150);

/// Faults of the simulated devices themselves.
const OF_DEVICES: [Row; 18] = {
    use FaultCommand::{Alarm, EmergencyStop, Guard, Late, Silent, WordOrder};
    use RoughFault::{Coil, Of, Pendant};
    use RunState::{Done, Failed, Stopped};
    [
        ("arm: emergency stop", Of(DeviceRole::Arm, EmergencyStop(true)), &[Stopped]),
        ("arm: guard open", Of(DeviceRole::Arm, Guard(true)), &[Stopped]),
        ("arm: drive alarm", Of(DeviceRole::Arm, Alarm(Some(2400))), &[Failed]),
        ("arm: answers nothing", Of(DeviceRole::Arm, Silent(true)), &[Stopped]),
        ("arm: answers 150 ms late", Of(DeviceRole::Arm, Late(LATE)), &[Stopped]),
        ("arm: switched off at the pendant", Pendant("GrpPowerOff"), &[Stopped, Done]),
        ("arm: held at the pendant", Pendant("GrpInterrupt"), &[Stopped, Done]),
        ("arm: stopped at the pendant", Pendant("GrpStop"), &[Failed, Done]),
        ("arm: guided by hand", Pendant("GrpOpenFreeDriver"), &[Stopped]),
        ("table: emergency stop", Of(DeviceRole::Table, EmergencyStop(true)), &[Stopped]),
        ("table: guard open", Of(DeviceRole::Table, Guard(true)), &[Stopped]),
        ("table: drive alarm", Of(DeviceRole::Table, Alarm(Some(2400))), &[Failed]),
        ("table: answers nothing", Of(DeviceRole::Table, Silent(true)), &[Stopped]),
        ("table: answers 150 ms late", Of(DeviceRole::Table, Late(LATE)), &[Stopped]),
        ("table: 32-bit values in the other order", Of(DeviceRole::Table, WordOrder(true)), &[Failed]),
        ("table: servo switched off by another master", Coil(coil::SERVO_ON, false), &[Stopped, Done]),
        ("table: decelerated by another master", Coil(coil::DECELERATION_STOP, true), &[Failed, Done]),
        ("table: stopped at once by another master", Coil(coil::IMMEDIATE_STOP, true), &[Failed, Done]),
    ]
};

/// Faults of networks.
const OF_NETWORKS: [Row; 13] = {
    use Passage::{Held, Lost, Refused};
    use RoughFault::{Cut, Garbled, Net, NetOfBoth};
    use RunState::{Done, Failed, Stopped};
    [
        ("arm: connection cut", Cut(DeviceRole::Arm), &[Stopped, Done]),
        ("arm: connection cut, none taken", Net(DeviceRole::Arm, Refused), &[Stopped]),
        ("arm: connection half open", Net(DeviceRole::Arm, Lost), &[Stopped]),
        ("arm: network holds everything", Net(DeviceRole::Arm, Held), &[Stopped]),
        ("arm: bytes changed on the way", Garbled(DeviceRole::Arm), &[Failed, Stopped]),
        ("table: connection cut", Cut(DeviceRole::Table), &[Stopped, Done]),
        ("table: connection cut, none taken", Net(DeviceRole::Table, Refused), &[Stopped]),
        ("table: connection half open", Net(DeviceRole::Table, Lost), &[Stopped]),
        ("table: network holds everything", Net(DeviceRole::Table, Held), &[Stopped]),
        ("table: bytes changed on the way", Garbled(DeviceRole::Table), &[Failed, Stopped]),
        ("both: connections cut, none taken", NetOfBoth(Refused), &[Stopped]),
        ("both: connections half open", NetOfBoth(Lost), &[Stopped]),
        ("both: networks hold everything", NetOfBoth(Held), &[Stopped]),
    ]
};

/// Faults around the cell.
const AROUND: [Row; 10] = {
    use RoughFault::*;
    use RunState::{Done, Failed, Stopped};
    [
        ("scanner: acknowledges nothing for 30 s", ScannerSilent, &[Done]),
        ("client: gone", ClientGone, &[Stopped]),
        ("client: stops the run", StoppedByClient, &[Stopped]),
        ("lease: given back", LeaseGivenBack, &[Stopped]),
        ("lease: taken by a second client", LeaseToAnother, &[Stopped]),
        ("server: nobody holds the run any more", ServerGone, &[Stopped]),
        ("server: disk of the audit log full", AuditDiskFull, &[Stopped]),
        ("plan: not the one approved", OtherPlan, &[Failed]),
        ("cell: not the one approved", OtherCell, &[Failed]),
        ("compensation: not the one approved", OtherCompensation, &[Failed]),
    ]
};

const HEAD: &str = "\
# Faults, and the state that each ends a run in

Written by the test `every_fault_of_the_real_drivers_ends_as_documented_and_nothing_moves_after` (`UPDATE_GOLDEN=1` writes it anew):
the drivers of Han's controllers and of the MINAS A6 against their simulated controllers, each fault injected in each state of a live run. After
each end nothing moves, with two exceptions: a Han's arm that a stop cannot reach finishes the one move that it holds, and a MINAS A6 table
runs until its own communication time-out. A run that cannot be armed stays ready. A cell of the table reads `state: reason code`. Nothing is
resumed by itself.

";

/// Words for the ends of a row. Which of the allowed ends changed bytes lead to depends on the byte: they are not told apart.
fn ends_of((name, fault, _): &Row, found: &[RunStatus]) -> (&'static str, Vec<String>) {
    let words = |end: &RunStatus| {
        if matches!(fault, RoughFault::Garbled(_)) {
            return "failed or stopped: device_error or state_stale".to_owned();
        }
        format!("{}: {}", end.state.as_str(), end.reason.code())
    };
    (name, found.iter().map(words).collect())
}

fn markdown(rows: &[(&str, Vec<String>)]) -> String {
    let mut text = HEAD.to_owned();
    let states: Vec<&str> = STATES.iter().map(|state| state.as_str()).collect();
    let _ = writeln!(text, "| fault | {} |\n|---|{}", states.join(" | "), "---|".repeat(states.len()));
    for (name, ends) in rows {
        let _ = writeln!(text, "| {name} | {} |", ends.join(" | "));
    }
    text
}

#[test]
#[ignore = "long: tests/all runs it"]
fn every_fault_of_the_real_drivers_ends_as_documented_and_nothing_moves_after() {
    let rows: Vec<Row> = OF_DEVICES.into_iter().chain(OF_NETWORKS).chain(AROUND).collect();
    let in_each_state = |row: Row| ends_of(&row, &in_simulated_time(fault_in_each_state::<RoughCell>(row.1, row.2)));
    planned();
    let rows: Vec<_> = on_deep_stacks(|| rows.into_par_iter().map(in_each_state).collect());
    let found = markdown(&rows);
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/src/execution/FAULTS.md");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(path, &found).expect("written");
    }
    let documented = std::fs::read_to_string(path).unwrap_or_default();
    assert!(found == documented, "{path} differs; UPDATE_GOLDEN=1 writes it anew. Found:\n{found}");
}
