//! Log of the program, on standard error.

use tracing_subscriber::EnvFilter;

use super::CliError;
use crate::settings::{LogFormat, TelemetrySettings};

/// Starts logging.
pub(super) fn start(settings: &TelemetrySettings) -> Result<(), CliError> {
    let filter = EnvFilter::try_new(&settings.log)
        .map_err(|error| CliError::BadInput(format!("telemetry.log {:?}: {error}", settings.log)))?;
    let builder = tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr);
    let started = match settings.format {
        LogFormat::Text => builder.with_ansi(std::io::IsTerminal::is_terminal(&std::io::stderr())).try_init(),
        LogFormat::Json => builder.json().try_init(),
    };
    started.map_err(|error| CliError::Failed(format!("the log: {error}")))
}
