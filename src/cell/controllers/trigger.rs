//! Trigger of the scanner.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::field_error::Findings;

/// Trigger of the scanner, by its protocol. A capture that is not acknowledged in time holds the run; it is never skipped.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "protocol", rename_all = "snake_case", deny_unknown_fields, expecting = "an object")]
pub enum TriggerSpec {
    /// A digital output of the arm's controller, acknowledged by a digital input.
    Digital(DigitalTriggerSpec),
    /// A request to the scanner's software.
    Http(HttpTriggerSpec),
    /// A program of the operator's.
    Command(CommandTriggerSpec),
    /// No trigger: the run waits for the program's capture time.
    None(NoTriggerSpec),
}

impl Default for TriggerSpec {
    fn default() -> Self {
        Self::None(NoTriggerSpec {})
    }
}

/// Absence of a trigger. Unknown fields are refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct NoTriggerSpec {}

/// Trigger by signals of the arm's controller: the digital outputs and inputs of Han's control box, whose driver alone has such
/// signals. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct DigitalTriggerSpec {
    /// Number of the output that starts a capture, 0 to 7.
    pub output: u8,
    /// Number of the input that acknowledges it, 0 to 7.
    pub input: u8,
    /// Time within which it is acknowledged, ms, 10 to 600000. Default 10000.
    #[serde(default = "default_deadline_ms")]
    pub deadline_ms: u32,
}

/// Trigger by a request: `POST`, with run, step, view and brightness as JSON; 2xx acknowledges. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct HttpTriggerSpec {
    /// Address, `http://…`.
    pub url: String,
    /// Time within which it is acknowledged, ms, 10 to 600000. Default 10000.
    #[serde(default = "default_deadline_ms")]
    pub deadline_ms: u32,
}

/// Trigger by a program, started without a shell; exit code 0 acknowledges. Unknown fields are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct CommandTriggerSpec {
    /// Path of the program.
    pub program: String,
    /// Arguments; `{run}`, `{step}`, `{view}` and `{brightness}` are replaced. Default: none.
    #[serde(default)]
    pub arguments: Vec<String>,
    /// Time within which it ends, ms, 10 to 600000. Default 10000.
    #[serde(default = "default_deadline_ms")]
    pub deadline_ms: u32,
}

/// Last digital output, and input, of Han's control box; the first is 0.
const LAST_SIGNAL: f64 = 7.0;

fn default_deadline_ms() -> u32 {
    10_000
}

impl TriggerSpec {
    /// Name of the protocol.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Digital(_) => "digital",
            Self::Http(_) => "http",
            Self::Command(_) => "command",
            Self::None(_) => "none",
        }
    }

    /// Time within which a capture is acknowledged, ms.
    #[must_use]
    pub fn deadline_ms(&self) -> u32 {
        match self {
            Self::Digital(spec) => spec.deadline_ms,
            Self::Http(spec) => spec.deadline_ms,
            Self::Command(spec) => spec.deadline_ms,
            Self::None(_) => default_deadline_ms(),
        }
    }

    /// Returns true if the scanner is told the brightness level of each capture: a signal says only when, a program only what its
    /// arguments ask for.
    #[must_use]
    pub fn tells_brightness(&self) -> bool {
        match self {
            Self::Http(_) => true,
            Self::Command(spec) => spec.arguments.iter().any(|argument| argument.contains("{brightness}")),
            Self::Digital(_) | Self::None(_) => false,
        }
    }

    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        match self {
            Self::Http(HttpTriggerSpec { url, .. }) => {
                let is_url = url.strip_prefix("http://").is_some_and(|rest| !rest.is_empty() && !rest.starts_with('/'));
                findings.require(is_url, format!("{pointer}/url"), || format!("is {url:?}; allowed is http://HOST:PORT/PATH"));
            }
            Self::Command(CommandTriggerSpec { program, .. }) => {
                let is_path = program.starts_with('/') && !program.contains('\0');
                findings.require(is_path, format!("{pointer}/program"), || format!("is {program:?}; give its whole path"));
            }
            Self::Digital(DigitalTriggerSpec { output, input, .. }) => {
                for (field, number) in [("output", output), ("input", input)] {
                    findings.range(format!("{pointer}/{field}"), f64::from(*number), 0.0, LAST_SIGNAL, "");
                }
            }
            Self::None(_) => {}
        }
        findings.range(format!("{pointer}/deadline_ms"), self.deadline_ms().into(), 10.0, 600_000.0, "ms");
    }
}
