//! The command line: one binary, `vantage`, its commands and their exit codes.

#![warn(clippy::print_stdout, clippy::print_stderr)]

use std::fmt;
use std::io::Write as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::error::ErrorKind;
use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use serde::Serialize;

use self::output::OutputArgs;
use self::signals::on_signals;
use crate::wire::{VERSION_LINE, Version};

pub mod backup;
pub mod calibrate;
pub mod cell;
pub mod check;
pub mod compare;
mod completions;
pub mod demo;
mod doubts;
mod features;
pub mod files;
mod given_params;
pub mod healthcheck;
pub mod inspect;
pub mod inspect_scanner;
mod limits;
mod man;
mod open_files;
mod out;
mod output;
mod params;
pub mod part;
mod parts;
pub mod plan;
#[cfg(test)]
mod planned_block;
mod presets;
pub mod program;
pub mod progress;
mod ranges;
pub mod reach;
pub mod rescan;
pub mod robot;
pub mod run;
mod scanned_part;
pub mod scanner;
pub mod serve;
mod set_value;
mod signals;
pub mod sim;
mod sim_scanner;
mod spec_paths;
pub mod study;
mod summary;
mod telemetry;

/// Plan automated 3D scans: from a mesh and a cell to viewpoints, their coverage, motion and a robot program.
#[derive(Debug, Parser)]
#[command(
    name = "vantage",
    version = VERSION_LINE,
    max_term_width = 110,
    after_help = "Examples:
  vantage demo                                 try Vantage with a sample part
  vantage plan part.stl --unit mm --out plan   plan a part without a server
  vantage serve --data /var/lib/vantage        run the server at 127.0.0.1:8080

Exit codes: 0 success; 1 system error; 2 bad input; 3 no plan possible, a region or feature below its target (`plan --strict`), \
no further view worth taking (`rescan`), or a calibration that no longer holds (`calibrate check`); 4 interrupted.

With --json, the error that ends a command is one JSON object {level, code, title, detail, exit_code, errors} on standard error. \
If the reader closes the pipe, as `head` does, the command finishes its work and keeps its exit code."
)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    output: OutputArgs,
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
    Run(Box<run::RunArgs>),
    Params(params::ParamsArgs),
    Presets(presets::PresetsArgs),
    Part(part::PartArgs),
    Robot(robot::RobotArgs),
    Scanner(Box<scanner::ScannerArgs>),
    Sim(sim::SimArgs),
    Compare(Box<compare::CompareArgs>),
    Rescan(Box<rescan::RescanArgs>),
    Calibrate(Box<calibrate::CalibrateArgs>),
    Cell(Box<cell::CellArgs>),
    Backup(backup::BackupArgs),
    Restore(backup::RestoreArgs),
    Completions(completions::CompletionsArgs),
    Man(man::ManArgs),
    Healthcheck(healthcheck::HealthcheckArgs),
}

/// Error that ends a command, with its [exit code](Self::exit_code); 3 stands for every lack of a plan that does what is asked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CliError {
    /// System error: an address in use, a disk that cannot be written to, a server that does not answer.
    #[error("{0}")]
    Failed(String),
    /// Input that cannot be used.
    #[error("{0}")]
    BadInput(String),
    /// Input of which fields cannot be used, each with its place.
    #[error("{}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))]
    Findings(Vec<FileFinding>),
    /// Planning that found no plan, with the reasons.
    #[error("{0}")]
    NoPlan(String),
    /// Plan with regions below their targets, where that is asked to be an error.
    #[error("{0}")]
    RegionsUnmet(String),
    /// Calibration that does not hold any more.
    #[error("{0}")]
    NotCalibrated(String),
    /// Interruption by the user.
    #[error("{0}")]
    Cancelled(String),
}

/// Fault in a file or in parameters: where, and what is allowed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FileFinding {
    /// The file, or `parameters`.
    pub file: String,
    /// JSON pointer of the field; empty for the whole.
    pub pointer: String,
    /// Value found, and what is allowed.
    pub detail: String,
}

impl fmt::Display for FileFinding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.pointer.as_str() {
            "" => write!(f, "{}: {}", self.file, self.detail),
            pointer => write!(f, "{}: {pointer}: {}", self.file, self.detail),
        }
    }
}

impl CliError {
    /// Exit code of the process.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Failed(_) => 1,
            Self::BadInput(_) | Self::Findings(_) => 2,
            Self::NoPlan(_) | Self::RegionsUnmet(_) | Self::NotCalibrated(_) => 3,
            Self::Cancelled(_) => 4,
        }
    }

    /// Stable code for programs, and its title.
    fn code(&self) -> (&'static str, &'static str) {
        match self {
            Self::Failed(_) => ("system_error", "System error"),
            Self::BadInput(_) => ("bad_input", "The input cannot be used"),
            Self::Findings(_) => ("invalid_fields", "Fields of the input are invalid"),
            Self::NoPlan(_) => ("no_plan", "No plan is possible"),
            Self::RegionsUnmet(_) => ("regions_unmet", "Regions are below their targets"),
            Self::NotCalibrated(_) => ("not_calibrated", "The calibration does not hold"),
            Self::Cancelled(_) => ("cancelled", "The command was interrupted"),
        }
    }
}

/// Parses the arguments of the process, runs the command and prints the error that ends it; the exit code.
#[must_use]
pub fn main() -> u8 {
    let ended = match parse(std::env::args_os()) {
        Ok(cli) => cli.run(),
        Err(error) => {
            // Nothing is parsed, but an answer is still owed in the form that was asked for.
            let json = std::env::args_os().any(|argument| argument == "--json");
            OutputArgs { json, ..OutputArgs::default() }.apply();
            if error.use_stderr() && !json {
                // It has its colours; nobody can be told if standard error is gone.
                let _ = error.print();
                return error.exit_code().try_into().unwrap_or(2);
            }
            answer(&error)
        }
    };
    let Err(error) = ended else { return 0 };
    output::error(&error);
    error.exit_code()
}

/// Parses arguments; a negative number is always a value, so that its range is told where it is wrong.
fn parse(arguments: impl IntoIterator<Item = impl Into<std::ffi::OsString> + Clone>) -> Result<Cli, clap::Error> {
    let mut command = with_negative_numbers(Cli::command());
    let matches = command.try_get_matches_from_mut(arguments)?;
    Cli::from_arg_matches(&matches).map_err(|error| error.format(&mut command))
}

/// The command with every argument that has a value taking negative numbers.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let command = command.mut_args(|arg| if arg.get_action().takes_values() { arg.allow_negative_numbers(true) } else { arg });
    command.mut_subcommands(with_negative_numbers)
}

/// Prints help or version, which clap hands over as an error; other errors become the command's.
fn answer(error: &clap::Error) -> Result<(), CliError> {
    if error.use_stderr() {
        let text = error.render().to_string();
        return Err(CliError::BadInput(text.trim().trim_start_matches("error: ").to_owned()));
    }
    if error.kind() == ErrorKind::DisplayVersion && output::is_json() {
        return output::json(&Version::of_this_program());
    }
    output::written(error.print().and_then(|()| std::io::stdout().flush()))
}

impl Cli {
    /// Runs the command.
    ///
    /// # Errors
    /// [`CliError`].
    pub fn run(self) -> Result<(), CliError> {
        self.output.apply();
        if !matches!(self.command, Command::Serve(_) | Command::Demo(_)) {
            telemetry::start_if_verbose()?;
        }
        match self.command {
            Command::Serve(args) => serve::run(&args),
            Command::Demo(args) => demo::run(&args),
            Command::Plan(args) => plan::run(&args, &*raised_by_signal()?),
            Command::Study(args) => study::run(&args, &*raised_by_signal()?),
            Command::Inspect(args) => inspect::run(&args),
            Command::Check(args) => check::run(&args),
            Command::Program(args) => program::run(&args),
            Command::Run(args) => run::run(&args),
            Command::Params(args) => params::run(&args),
            Command::Presets(args) => presets::run(&args),
            Command::Part(args) => part::run(&args),
            Command::Robot(args) => robot::run(&args),
            Command::Scanner(args) => scanner::run(&args),
            Command::Sim(args) => sim::run(&args),
            Command::Compare(args) => compare::run(&args, &*raised_by_signal()?),
            Command::Rescan(args) => rescan::run(&args, &*raised_by_signal()?),
            Command::Calibrate(args) => calibrate::run(&args),
            Command::Cell(args) => cell::run(&args),
            Command::Backup(args) => backup::run_backup(&args),
            Command::Restore(args) => backup::run_restore(&args),
            Command::Completions(args) => completions::run(&args),
            Command::Man(args) => man::run(&args),
            Command::Healthcheck(args) => healthcheck::run(&args),
        }
    }
}

/// Flag that the first ctrl-c, SIGTERM, SIGHUP or SIGQUIT raises; a second signal ends the process.
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
