//! `vantage calibrate`: from observations, or from the results of other programs, to specifications that can be trusted.

use super::CliError;

pub mod scanner;

/// Calibrate the hardware.
#[derive(Clone, Debug, clap::Args)]
pub struct CalibrateArgs {
    #[command(subcommand)]
    command: CalibrateCommand,
}

#[derive(Clone, Debug, clap::Subcommand)]
enum CalibrateCommand {
    Scanner(Box<scanner::CalibrateScannerArgs>),
}

/// Runs the calibration.
///
/// # Errors
/// [`CliError`] of the calibration.
pub fn run(args: &CalibrateArgs) -> Result<(), CliError> {
    match &args.command {
        CalibrateCommand::Scanner(args) => scanner::run(args),
    }
}
