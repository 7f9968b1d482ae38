//! The command line: one binary, `vantage`, its commands and their exit codes.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{CommandFactory, Parser, Subcommand};

use self::signals::on_signals;

pub mod backup;
pub mod cell;
pub mod check;
pub mod demo;
mod features;
pub mod files;
pub mod healthcheck;
pub mod inspect;
pub mod inspect_scanner;
mod limits;
mod open_files;
mod out;
pub mod part;
pub mod plan;
pub mod program;
pub mod progress;
pub mod reach;
pub mod robot;
pub mod scanner;
pub mod serve;
mod signals;
pub mod study;
mod telemetry;

/// Plan automated 3D scans: mesh and cell in; viewpoints, proof of coverage and robot program out.
#[derive(Debug, Parser)]
#[command(
    name = "vantage",
    version,
    max_term_width = 110,
    after_help = "Examples:
  vantage demo                                     start a server with a sample part that is already being planned
  vantage plan part.stl --unit mm --out plan       plan a part without a server
  vantage serve --data /var/lib/vantage            start the server at http://127.0.0.1:8080

Exit codes: 0 success, 1 system error, 2 bad input, 3 no plan possible, or with `plan --strict` a region below its target,
4 interrupted."
)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Serve(serve::ServeArgs),
    Demo(demo::DemoArgs),
    Plan(plan::PlanArgs),
    Study(study::StudyArgs),
    Inspect(inspect::InspectArgs),
    Check(check::CheckArgs),
    Program(program::ProgramArgs),
    Part(part::PartArgs),
    Robot(robot::RobotArgs),
    Scanner(Box<scanner::ScannerArgs>),
    Cell(Box<cell::CellArgs>),
    Backup(backup::BackupArgs),
    Restore(backup::RestoreArgs),
    Completions(CompletionsArgs),
    Healthcheck(healthcheck::HealthcheckArgs),
}

/// Print a completion script for a shell.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:
  vantage completions bash > /etc/bash_completion.d/vantage")]
struct CompletionsArgs {
    /// Shell to complete for.
    shell: clap_complete::Shell,
}

/// Error that ends a command, with an exit code (contract: 2, 3, 4); 3 stands for every lack of a plan that does what is asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CliError {
    /// System error: an address in use, a disk that cannot be written to, a server that does not answer.
    #[error("{0}")]
    Failed(String),
    /// Input that cannot be used.
    #[error("{0}")]
    BadInput(String),
    /// Planning that found no plan, with the reasons.
    #[error("{0}")]
    NoPlan(String),
    /// Plan with regions below their targets, where that is asked to be an error.
    #[error("{0}")]
    RegionsUnmet(String),
    /// Interruption by the user.
    #[error("{0}")]
    Cancelled(String),
}

impl CliError {
    /// Exit code of the process.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Failed(_) => 1,
            Self::BadInput(_) => 2,
            Self::NoPlan(_) | Self::RegionsUnmet(_) => 3,
            Self::Cancelled(_) => 4,
        }
    }
}

impl Cli {
    /// Runs the command.
    ///
    /// # Errors
    /// [`CliError`].
    pub fn run(self) -> Result<(), CliError> {
        match self.command {
            Command::Serve(args) => serve::run(&args),
            Command::Demo(args) => demo::run(&args),
            Command::Plan(args) => plan::run(&args, &*raised_by_signal()?),
            Command::Study(args) => study::run(&args, &*raised_by_signal()?),
            Command::Inspect(args) => inspect::run(&args),
            Command::Check(args) => check::run(&args),
            Command::Program(args) => program::run(&args),
            Command::Part(args) => part::run(&args),
            Command::Robot(args) => robot::run(&args),
            Command::Scanner(args) => scanner::run(&args),
            Command::Cell(args) => cell::run(&args),
            Command::Backup(args) => backup::run_backup(&args),
            Command::Restore(args) => backup::run_restore(&args),
            Command::Completions(CompletionsArgs { shell }) => {
                clap_complete::generate(shell, &mut Self::command(), "vantage", &mut std::io::stdout());
                Ok(())
            }
            Command::Healthcheck(args) => healthcheck::run(&args),
        }
    }
}

/// Flag that the first ctrl-c or SIGTERM raises; a second signal ends the process.
fn raised_by_signal() -> Result<Arc<AtomicBool>, CliError> {
    let flag = Arc::new(AtomicBool::new(false));
    let raised = flag.clone();
    on_signals(move |_| raised.store(true, Ordering::Relaxed), None)?;
    Ok(flag)
}

/// Exit code that a shell reports for a process ended by ctrl-c.
const EXIT_INTERRUPTED: i32 = 130;

/// Joins an error and its causes on one line.
fn failed(what: &str, error: &(dyn std::error::Error + 'static)) -> CliError {
    let causes = std::iter::successors(Some(error), |error| error.source());
    let causes: Vec<String> = causes.map(ToString::to_string).collect();
    CliError::Failed(format!("{what}: {}", causes.join(": ")))
}

#[cfg(test)]
mod tests;
