//! Names and signals between robot programs, scanner and table.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::Findings;

/// Largest length of a program's name, characters; each language shortens it to what it allows.
const MAX_NAME_CHARS: usize = 64;

/// Names and signals in the programs for robot controllers. Which numbers a controller has, its dialect checks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields, expecting = "an object")]
pub struct DialectParams {
    /// Name of the program, 1 to 64 characters; a second setup adds `_2`, and so on. Default `vantage`.
    pub program_name: String,
    /// Digital output that starts a capture, 0 to 4096. Default 1.
    pub scan_output: u32,
    /// Digital input that is on once a capture is done, 0 to 4096; the scanner has to take it away before the pulse
    /// ends. Default 1.
    pub scan_input: u32,
    /// Time for which the output is on, s, 0.01 to 10. Default 0.1.
    pub pulse_secs: f64,
    /// Time for which the end of a capture is waited for, s, 0.1 to 300; then the program stops. Default 30.
    pub timeout_secs: f64,
    /// External axis that turns the table, 1 to 6, where the controller has such axes. Default 1.
    pub table_axis: u32,
    /// Largest length of a FANUC program's name, 8 to 36: 8 fits every controller, 36 those since R-30iA. Default 8.
    pub fanuc_name_chars: u32,
}

impl Default for DialectParams {
    fn default() -> Self {
        Self {
            program_name: "vantage".to_owned(),
            scan_output: 1,
            scan_input: 1,
            pulse_secs: 0.1,
            timeout_secs: 30.0,
            table_axis: 1,
            fanuc_name_chars: 8,
        }
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
        findings.range("/dialects/scan_output", f64::from(self.scan_output), 0.0, 4096.0, "");
        findings.range("/dialects/scan_input", f64::from(self.scan_input), 0.0, 4096.0, "");
        findings.range("/dialects/pulse_secs", self.pulse_secs, 0.01, 10.0, "s");
        findings.range("/dialects/timeout_secs", self.timeout_secs, 0.1, 300.0, "s");
        findings.range("/dialects/table_axis", f64::from(self.table_axis), 1.0, 6.0, "");
        findings.range("/dialects/fanuc_name_chars", f64::from(self.fanuc_name_chars), 8.0, 36.0, "characters");
    }
}
