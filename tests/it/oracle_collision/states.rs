//! Verdicts on random states of cells.

use vantage::cell::{Cell, CollisionScene, Configuration};
use vantage::geometry::demo_parts;
use vantage::planning::resting;

use super::{ELFIN5, Nearest, Vendor, asked, default_cell, described};
use crate::arms::{imported, link_surfaces};
use crate::support::{all_asked, long_asked, oracle_python};

/// Clearance of the second question, mm: the default of a job.
const CLEARANCE_MM: f64 = 5.0;
/// Length by which the vendor's surface may stand out of its capsules, mm (`kinematics::capsules_hold_the_vendors_meshes`).
pub(super) const OUT_MM: f64 = 0.5;

/// Evenly spread over what the axes allow (additive recurrence with square roots of primes).
fn spread(cell: &Cell, count: u32) -> Vec<Configuration> {
    let steps = [2.0_f64, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0].map(f64::sqrt);
    let axes = cell.axes().0;
    let at = |i: u32, axis: usize| {
        axes[axis].min_rad + (axes[axis].max_rad - axes[axis].min_rad) * (f64::from(i) * steps[axis]).fract()
    };
    (1..=count).map(|i| Configuration::from_axes_rad(std::array::from_fn(|axis| at(i, axis)))).collect()
}

/// Compares and prints; fails where a collision is missed, and, where surfaces decide, where one is found that is none.
fn compare(cell: &Cell, vendor: &Vendor, count: u32) {
    let Some(python) = oracle_python() else { return };
    let part = demo_parts::base(8_000).expect("a part");
    let table_from_part = resting(&part);
    let Some(description) = described(cell, vendor, Some((&part, &table_from_part)), false) else { return };
    let states = spread(cell, count);
    let input: String = states.iter().map(|state| format!("[{:?}]\n", state.axes_rad())).collect();
    let widest = format!("{}", 2.0 * CLEARANCE_MM);
    let verdicts = asked(&python, ["1", &widest], description + &input);
    assert_eq!(verdicts.len(), states.len());
    let [bare, clear] = [0.0, CLEARANCE_MM].map(|mm| CollisionScene::new(cell, &part, None, &table_from_part, mm));
    let (mut contacts, mut missed, mut false_alarms, mut nearer, mut nearest_mm) = (0, 0, 0, 0, f64::INFINITY);
    for (state, verdict) in states.iter().zip(&verdicts) {
        let apart_mm = verdict.nearest().map_or(2.0 * CLEARANCE_MM, |(mm, _)| *mm);
        contacts += usize::from(!verdict.contacts.is_empty());
        match (bare.check(state), verdict.contacts.first()) {
            (None, Some(touch)) => {
                missed += 1;
                println!("missed: {:?} at {:?}", touch.pair, touch.at);
            }
            (Some(_), None) => false_alarms += usize::from(apart_mm > CLEARANCE_MM),
            _ => {}
        }
        if clear.check(state).is_none() {
            nearest_mm = apart_mm.min(nearest_mm);
            // What the flange carries is as near to the link before it as it is mounted.
            let is_nearer = |(mm, pair): &&Nearest| *mm < CLEARANCE_MM - OUT_MM && pair[1] != cell.mount[0].name;
            if verdict.own.iter().chain(&verdict.others).any(|found| is_nearer(&found)) {
                nearer += 1;
                println!("free at {CLEARANCE_MM} mm: {:?} at {:?}", verdict.nearest(), state.axes_rad());
            }
        }
    }
    let exact = if cell.link_surfaces.is_empty() { "" } else { ", by its surfaces" };
    println!(
        "{}{exact}: {count} states, {contacts} contacts by FCL, {missed} missed; {false_alarms} called contacts that are over \
         {CLEARANCE_MM} mm apart; called free at {CLEARANCE_MM} mm: nearest {nearest_mm:.2} mm, {nearer} below {} mm",
        cell.robot.name,
        CLEARANCE_MM - OUT_MM
    );
    assert_eq!((missed, nearer), (0, 0), "{}", cell.robot.name);
    assert!(exact.is_empty() || false_alarms == 0, "{}: {false_alarms}", cell.robot.name);
}

#[test]
fn no_collision_of_the_default_cell_is_missed() {
    compare(
        &default_cell(),
        &ELFIN5,
        if long_asked() {
            10_000
        } else if all_asked() {
            3000
        } else {
            100
        },
    );
}

/// The scanner of the default cell on arms whose capsules come from their URDF, as they are and confirmed by the surfaces.
#[test]
fn no_collision_of_an_imported_arm_is_missed() {
    let arms = [
        Vendor { urdf: "elfin5", base: "world", tip: "elfin_end_link" },
        Vendor { urdf: "ur5e", base: "base_link", tip: "tool0" },
        Vendor { urdf: "ur10e", base: "base_link", tip: "tool0" },
        Vendor { urdf: "irb1200_5_90", base: "base_link", tip: "tool0" },
        Vendor { urdf: "irb2600_12_165", base: "base_link", tip: "tool0" },
        Vendor { urdf: "kr10r1100sixx", base: "base_link", tip: "tool0" },
    ];
    let (arms, count) = if all_asked() { (&arms[..], if long_asked() { 2000 } else { 300 }) } else { (&arms[1..2], 100) };
    for vendor in arms {
        let Some(urdf) = imported(vendor.urdf) else { return };
        let mut cell = default_cell();
        cell.robot = urdf.robot.build().expect("a sound robot");
        compare(&cell, vendor, count);
        cell.link_surfaces = link_surfaces(&urdf);
        compare(&cell, vendor, count);
    }
}
