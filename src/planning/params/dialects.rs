//! Names and signals between robot programs, scanner and table.

use super::knob::params;
use crate::cell::{Findings, JointThreeOrigin};

/// Largest length of a program's name, characters; each language shortens it to what it allows.
const MAX_NAME_CHARS: usize = 64;

params! {
    /// Names and signals in the programs for robot controllers. Which numbers a controller has, its dialect checks.
    DialectParams {
        /// Name of the program, 1 to 64 characters; a second setup adds `_2`, and so on.
        program_name: String = "vantage".to_owned();
        /// Digital output that starts a capture.
        scan_output: u32 = 1, [0.0, 4096.0] "";
        /// Digital input that is on once a capture is done; the scanner has to take it away before the pulse ends.
        scan_input: u32 = 1, [0.0, 4096.0] "";
        /// Time for which the output is on, s.
        pulse_secs: f64 = 0.1, [0.01, 10.0] "s";
        /// Time for which the end of a capture is waited for, s; then the program stops.
        timeout_secs: f64 = 30.0, [0.1, 300.0] "s";
        /// External axis that turns the table, where the controller has such axes.
        table_axis: u32 = 1, [1.0, 6.0] "";
        /// Largest length of a FANUC program's name: 8 fits every controller, 36 those since R-30iA.
        fanuc_name_chars: u32 = 8, [8.0, 36.0] "characters";
        /// Link from which the model of a FANUC arm counts joint 3: `upper_arm` for models in URDF. Not needed for a robot with
        /// `joint_3_from_ground`. Default: no FANUC program of another model.
        fanuc_joint_3_from: Option<JointThreeOrigin> = None;
    }
}

impl DialectParams {
    /// Records what is out of range.
    pub(super) fn check(&self, findings: &mut Findings) {
        let chars = self.program_name.chars().count();
        let is_name = (1..=MAX_NAME_CHARS).contains(&chars) && !self.program_name.chars().any(char::is_control);
        findings.require(is_name, "/dialects/program_name", || {
            format!("has {chars} characters; allowed is 1 to {MAX_NAME_CHARS}, none of them control")
        });
        self.check_ranges("/dialects", findings);
    }
}
