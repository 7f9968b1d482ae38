//! Names and signals between robot programs, scanner and table.

use super::knob::params;
use crate::cell::{Findings, JointThreeOrigin};

/// Largest length of a program's name, characters; each language shortens it to what it allows.
const MAX_NAME_CHARS: usize = 64;

params! {
    /// Names and signals in the programs for robot controllers. Each dialect checks that its controllers have the numbers given.
    DialectParams {
        /// Name of the program, 1 to 64 characters, shortened to what a language allows. The program of a second setup gets `_2`
        /// at its end, and so on.
        program_name: String = "vantage".to_owned();
        /// Number of the digital output whose pulse starts a capture.
        scan_output: u32 = 1, [0.0, 4096.0] "";
        /// Number of the digital input that the scanner turns on when a capture is done. It must be off again before the next
        /// capture: the program waits for that before it starts one, and stops after `timeout_secs`.
        scan_input: u32 = 1, [0.0, 4096.0] "";
        /// Length of the start pulse, s.
        pulse_secs: f64 = 0.1, [0.01, 10.0] "s";
        /// Maximum time to wait for the end of a capture, and before it for the input to be off, s; then the program stops.
        timeout_secs: f64 = 30.0, [0.1, 300.0] "s";
        /// Number of the external axis that turns the table, for controllers with external axes. FANUC programs take 1 alone.
        table_axis: u32 = 1, [1.0, 6.0] "";
        /// Maximum length of the name of a FANUC program: 8 fits every controller, 36 those since R-30iA.
        fanuc_name_chars: u32 = 8, [8.0, 36.0] "characters";
        /// Link from which the robot model counts joint 3, for FANUC programs: `ground`, as the controller does, or `upper_arm`,
        /// as models from URDF do. Not needed for a robot with `joint_3_from_ground`. Default: none; no FANUC program is written
        /// for other models.
        fanuc_joint_3_from: Option<JointThreeOrigin> = None;
    }
}

impl DialectParams {
    /// Records what is out of range.
    pub(super) fn check(&self, findings: &mut Findings) {
        let chars = self.program_name.chars().count();
        let is_name = (1..=MAX_NAME_CHARS).contains(&chars) && !self.program_name.chars().any(char::is_control);
        findings.require(is_name, "/dialects/program_name", || {
            format!("has {chars} characters; allowed are 1 to {MAX_NAME_CHARS}, none of them a control character")
        });
        self.check_ranges("/dialects", findings);
    }
}
