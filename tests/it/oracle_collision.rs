//! Motion beside FCL, the Flexible Collision Library, and OMPL, the Open Motion Planning Library: no collision is missed at
//! random states, none happens on an emitted way, and what is refused cannot be done. The arm's links are the vendor's triangle
//! meshes, put where the chain of the vendor's URDF puts them, by `tests/oracles/fcl_cell.py`.

mod clutter;
mod described;
mod paths;
mod states;

use std::path::Path;

use serde::Deserialize;
use vantage::cell::{Cell, Presets, SpecLibrary};

use self::described::{Vendor, described};
use crate::support::lines_of;

/// The vendor's own description of the default cell's arm.
const ELFIN5: Vendor = Vendor { urdf: "elfin5", base: "elfin_base_link", tip: "elfin_end_link" };

fn default_cell() -> Cell {
    Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset")
}

/// Distance between two bodies, mm, and their names.
type Nearest = (f64, [String; 2]);

/// The oracle's word on one way.
#[derive(Debug, Deserialize)]
struct Verdict {
    /// Configurations looked at.
    samples: usize,
    /// Some of the contacts.
    contacts: Vec<Touch>,
    /// Distance between the nearest two bodies of the arm, and their names; `None` where farther apart than was asked for.
    own: Option<Nearest>,
    /// Distance between the nearest two of any others, and their names.
    others: Option<Nearest>,
}

impl Verdict {
    fn nearest(&self) -> Option<&Nearest> {
        self.own.iter().chain(&self.others).min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

#[derive(Debug, Deserialize)]
struct Touch {
    pair: [String; 2],
    at: [f64; 7],
}

/// A verdict for each way of `input`, which begins with the cell; step, degrees, and distance looked for, mm.
fn asked(python: &Path, step_and_distance: [&str; 2], input: String) -> Vec<Verdict> {
    let lines = lines_of(python, "collision_oracle.py", &step_and_distance, input);
    let (left_out, verdicts) = lines.split_first().expect("an answer");
    if left_out != "[]" {
        println!("left out, since the vendor's own meshes overlap however the arm stands: {left_out}");
    }
    verdicts.iter().map(|line| serde_json::from_str(line).expect("a verdict")).collect()
}
