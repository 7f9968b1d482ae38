//! The table of faults of Han's controllers and the MINAS A6, each in each state of a run: held against `FAULTS.md`, which is
//! written from it.

use std::fmt::Write as _;
use std::time::Duration;

use super::fault_table::{STATES, fault_in_each_state};
use super::protocol::minas_a6::coil;
use super::rough_cell::{RoughCell, RoughFault};
use super::session::{DeviceRole, RunState, RunStatus};
use super::simulated_network::Passage;
use super::simulators::faults::FaultCommand;

/// A fault: in words, the state that it ends in once armed, and whether a run may get by it.
type Row = (&'static str, RoughFault, RunState, bool);

const LATE: Duration = Duration::from_millis(150);

/// Faults of the simulated devices themselves.
const OF_DEVICES: [Row; 18] = {
    use FaultCommand::{Alarm, EmergencyStop, Guard, Late, Silent, WordOrder};
    use RoughFault::{Coil, Of, Pendant};
    use RunState::{Failed, Stopped};
    [
        ("arm: emergency stop", Of(DeviceRole::Arm, EmergencyStop(true)), Stopped, false),
        ("arm: guard open", Of(DeviceRole::Arm, Guard(true)), Stopped, false),
        ("arm: drive alarm", Of(DeviceRole::Arm, Alarm(Some(2400))), Failed, false),
        ("arm: answers nothing", Of(DeviceRole::Arm, Silent(true)), Stopped, false),
        ("arm: answers 150 ms late", Of(DeviceRole::Arm, Late(LATE)), Stopped, false),
        ("arm: switched off at the pendant", Pendant("GrpPowerOff"), Stopped, true),
        ("arm: held at the pendant", Pendant("GrpInterrupt"), Stopped, true),
        ("arm: stopped at the pendant", Pendant("GrpStop"), Failed, true),
        ("arm: guided by hand", Pendant("GrpOpenFreeDriver"), Stopped, false),
        ("table: emergency stop", Of(DeviceRole::Table, EmergencyStop(true)), Stopped, false),
        ("table: guard open", Of(DeviceRole::Table, Guard(true)), Stopped, false),
        ("table: drive alarm", Of(DeviceRole::Table, Alarm(Some(2400))), Failed, false),
        ("table: answers nothing", Of(DeviceRole::Table, Silent(true)), Stopped, false),
        ("table: answers 150 ms late", Of(DeviceRole::Table, Late(LATE)), Stopped, false),
        ("table: 32-bit values in the other order", Of(DeviceRole::Table, WordOrder(true)), Failed, false),
        ("table: servo switched off by another master", Coil(coil::SERVO_ON, false), Stopped, true),
        ("table: decelerated by another master", Coil(coil::DECELERATION_STOP, true), Failed, true),
        ("table: stopped at once by another master", Coil(coil::IMMEDIATE_STOP, true), Failed, true),
    ]
};

/// Faults of networks.
const OF_NETWORKS: [Row; 13] = {
    use Passage::{Held, Lost, Refused};
    use RoughFault::{Cut, Garbled, Net, NetOfBoth};
    use RunState::{Failed, Stopped};
    [
        ("arm: connection cut", Cut(DeviceRole::Arm), Stopped, true),
        ("arm: connection cut, none taken", Net(DeviceRole::Arm, Refused), Stopped, false),
        ("arm: connection half open", Net(DeviceRole::Arm, Lost), Stopped, false),
        ("arm: network holds everything", Net(DeviceRole::Arm, Held), Stopped, false),
        ("arm: bytes changed on the way", Garbled(DeviceRole::Arm), Failed, false),
        ("table: connection cut", Cut(DeviceRole::Table), Stopped, true),
        ("table: connection cut, none taken", Net(DeviceRole::Table, Refused), Stopped, false),
        ("table: connection half open", Net(DeviceRole::Table, Lost), Stopped, false),
        ("table: network holds everything", Net(DeviceRole::Table, Held), Stopped, false),
        ("table: bytes changed on the way", Garbled(DeviceRole::Table), Stopped, false),
        ("both: connections cut, none taken", NetOfBoth(Refused), Stopped, false),
        ("both: connections half open", NetOfBoth(Lost), Stopped, false),
        ("both: networks hold everything", NetOfBoth(Held), Stopped, false),
    ]
};

/// Faults around the cell.
const AROUND: [Row; 10] = {
    use RoughFault::*;
    use RunState::{Done, Failed, Stopped};
    [
        ("scanner: acknowledges nothing", ScannerSilent, Done, false),
        ("client: gone", ClientGone, Stopped, false),
        ("client: stops the run", StoppedByClient, Stopped, false),
        ("lease: given back", LeaseGivenBack, Stopped, false),
        ("lease: taken by a second client", LeaseToAnother, Stopped, false),
        ("server: nobody holds the run any more", ServerGone, Stopped, false),
        ("server: disk of the audit log full", AuditDiskFull, Stopped, false),
        ("plan: not the one approved", OtherPlan, Failed, false),
        ("cell: not the one approved", OtherCell, Failed, false),
        ("compensation: not the one approved", OtherCompensation, Failed, false),
    ]
};

const HEAD: &str = "\
# Faults, and the state that each ends a run in

Written by the test `every_fault_of_the_real_drivers_ends_as_documented` (`UPDATE_GOLDEN=1` writes it anew): the drivers of Han's
controllers and of the MINAS A6 against their simulated controllers, each fault brought about in each state of a live run. After each
end nothing moves; a stop that cannot reach an arm by Han's leaves it to finish the one move that it holds, and a table on a MINAS A6
to its own communication time-out. Words after the colon are the reason's code. Nothing is resumed by itself.

";

fn markdown(rows: &[(&str, Vec<RunStatus>)]) -> String {
    let mut text = HEAD.to_owned();
    let states: Vec<&str> = STATES.iter().map(|state| state.as_str()).collect();
    let _ = writeln!(text, "| fault | {} |\n|---|{}", states.join(" | "), "---|".repeat(states.len()));
    for (name, row) in rows {
        let ends: Vec<String> = row.iter().map(|end| format!("{}: {}", end.state.as_str(), end.reason.code())).collect();
        let _ = writeln!(text, "| {name} | {} |", ends.join(" | "));
    }
    text
}

#[tokio::test(start_paused = true)]
async fn every_fault_of_the_real_drivers_ends_as_documented_and_nothing_moves_after() {
    let mut rows = Vec::new();
    for (name, fault, ends, may_end_well) in OF_DEVICES.into_iter().chain(OF_NETWORKS).chain(AROUND) {
        rows.push((name, fault_in_each_state::<RoughCell>(fault, ends, may_end_well).await));
    }
    let found = markdown(&rows);
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/src/execution/FAULTS.md");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(path, &found).expect("written");
    }
    let documented = std::fs::read_to_string(path).unwrap_or_default();
    assert!(found == documented, "{path} differs; UPDATE_GOLDEN=1 writes it anew. Found:\n{found}");
}
