//! Log of the program, on standard error. A log that cannot be written stops nothing.

use tracing_subscriber::EnvFilter;

use super::{CliError, output};
use crate::settings::{LogFormat, TelemetrySettings};

/// Starts the log of a server: as set, more with `--verbose`, errors only with `--quiet`.
pub(super) fn start(settings: &TelemetrySettings) -> Result<(), CliError> {
    let filter = match (output::is_quiet(), output::verbosity()) {
        (true, _) => "error",
        (false, 0) => settings.log.as_str(),
        (false, 1) => "debug",
        (false, _) => "trace",
    };
    let format = if output::is_json() { LogFormat::Json } else { settings.format };
    start_with(filter, format)
}

/// Starts the log of any other command, which has none without `--verbose`.
pub(super) fn start_if_verbose() -> Result<(), CliError> {
    let filter = match output::verbosity() {
        0 => return Ok(()),
        1 => "info",
        2 => "debug",
        _ => "trace",
    };
    start_with(filter, if output::is_json() { LogFormat::Json } else { LogFormat::Text })
}

fn start_with(filter: &str, format: LogFormat) -> Result<(), CliError> {
    let parsed = EnvFilter::try_new(filter);
    let parsed = parsed.map_err(|error| CliError::BadInput(format!("telemetry.log {filter:?}: {error}")))?;
    let builder = tracing_subscriber::fmt().with_env_filter(parsed).with_writer(std::io::stderr).log_internal_errors(false);
    let started = match format {
        LogFormat::Text => builder.with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr())).try_init(),
        LogFormat::Json => builder.json().try_init(),
    };
    started.map_err(|error| CliError::Failed(format!("the log: {error}")))
}
