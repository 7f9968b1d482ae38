//! `vantage run`: carries out a program on a twin of arm and table, or on the controllers of a cell file, without a server.

mod outcome;
mod planned_cell;
#[cfg(test)]
mod tests;
mod watch;

use std::io::{BufRead, IsTerminal, stdin};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use sha2::{Digest, Sha256};
use tokio_util::sync::CancellationToken;

use self::outcome::{RecordFile, RunOutcome};
use self::watch::{LineEffect, RunWatch, lines_of_stdin};
use super::check::{ReferenceArgs, warn};
use super::files::{self, FileLibrary};
use super::program::{plan_beside, unplaced, without_program};
use super::ranges::number;
use super::serve::run_to_completion;
use super::signals::on_signals;
use super::{CliError, FileFinding, doubts, output, telemetry};
use crate::cell::{Cell, ControllersSpec, FieldError};
use crate::check::{Reference, field_errors};
use crate::execution::session::{Authority, Fence, Hashes, LeaseError, Leases, RunHandle, RunJob, RunState};
use crate::program::{Finding, check_calibration};
use crate::service::plan_job::program_stem;
use crate::service::runs::session::{self, AuditPlace, SessionOrder};
use crate::wire::program::ProgramDocument;
use crate::wire::run::{NOT_SAFETY_RATED, Run, RunMode, RunRequest};
use crate::wire::words::is_control;
use crate::wire::{DocumentKind, hex};

/// Time after which the lease of this process ends unless its heartbeat renews it.
const LEASE: Duration = Duration::from_secs(2);
/// Interval of the heartbeat.
const HEARTBEAT: Duration = Duration::from_millis(200);
/// Size at which a file of the audit log is closed, bytes.
const AUDIT_FILE_BYTES: u64 = 16 << 20;
/// Files kept of the audit log.
const AUDIT_FILES: usize = 64;

/// Run a program on a simulated twin of the cell, or on the controllers named in a cell file.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage run plan/program.json --cell e05-transcan --speed 20
  vantage run plan/program.json --cell cell.toml --mesh part.stl --unit mm \\
      --mode dry_run
  vantage run plan/program.json --cell cell.toml --mesh part.stl --unit mm \\
      --mode live --override 0.1 --record run.json --audit audit

The program is checked first, as by `vantage check`, against the plan.json beside it if there is one. --mesh needs that plan, \
and the fixture if the plan has one: --fixture, or the file that the plan names.

`simulate` moves a twin in real time, or --speed times as fast. `dry_run` connects to the controllers named in the [controllers] \
section of the cell file and reads their state, but sends no motion. `live` moves arm and table: the operator types the name of \
the cell, or --armed-by names the operator who releases the motion. The speed never exceeds `first_run_speed` of the cell file.

With --step, each line on standard input, from a terminal or a pipe, starts one step, and takes a capture again that was not \
acknowledged. Lines of a pipe wait until the step before is done; a line that is typed during a step is ignored. When the input ends, the run stops after the step that is under way.

Ctrl-C stops the run in a controlled way and reports when the stop was sent, when it was acknowledged, and when arm and table \
were at rest; a second ctrl-c ends the process at once. Closing the terminal stops the run in the same controlled way.

Vantage is not safety-rated, and its stop is not an emergency stop. Guards, emergency stops and speed limits are the cell's own.

Exit codes: 0 done; 1 ended by a fault; 2 bad input; 4 stopped by ctrl-c.")]
pub struct RunArgs {
    /// Program: a folder that `vantage plan` wrote, or a program.json.
    program: PathBuf,
    /// Cell: a preset name, or a TOML or JSON file; dry_run and live need a file with a `[controllers]` section.
    #[arg(long)]
    cell: String,
    /// Mode: simulate (twin only), dry_run (connect, but send no motion) or live (move arm and table).
    #[arg(long, value_name = "MODE", default_value = "simulate")]
    mode: RunMode,
    #[command(flatten)]
    reference: ReferenceArgs,
    /// Speed of the twin, 1 (real time) to 100 times real time.
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = factor)]
    speed: f64,
    /// Speed override, as a share of the program's speed, 0.01 to 1.
    #[arg(long = "override", value_name = "SHARE", default_value = "1", value_parser = number)]
    speed_override: f64,
    /// Pause after each step, until a line on standard input (Enter) starts the next.
    #[arg(long)]
    step: bool,
    /// First step to run, counted from 0; arm and table must be where it begins.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = step)]
    from_step: usize,
    /// File for the record of commanded and measured poses and times of each step: CSV if its name ends in .csv, otherwise JSON.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Folder for the log of every byte exchanged with the controllers [default: with --mode live, `audit` beside the program;
    /// otherwise none].
    #[arg(long, value_name = "DIR")]
    audit: Option<PathBuf>,
    /// Name of the operator who releases the motion; for scripts, with --mode live.
    #[arg(long, value_name = "NAME")]
    armed_by: Option<String>,
}

/// Reads `20`, `x20` or `×20`.
fn factor(text: &str) -> Result<f64, String> {
    let number = text.trim_start_matches(['x', '×']);
    number.parse().map_err(|_| format!("{text:?} is not a number; give 1 to 100, for example 20"))
}

fn step(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| format!("is {text}; allowed is a whole number, 0 or more"))
}

/// A program that was found sound, with all that its run needs.
struct PreparedRun {
    run: Run,
    job: RunJob,
    cell: Arc<Cell>,
    reference: Reference,
    controllers: Option<ControllersSpec>,
    request: RunRequest,
}

/// Runs the command.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &RunArgs) -> Result<(), CliError> {
    // Nothing that moves may wait for standard error.
    let _log = telemetry::detach()?;
    let record = args.record.as_deref().map(RecordFile::new).transpose()?;
    let mut prepared = PreparedRun::load(args)?;
    prepared.warn_of_levels(args);
    prepared.run.created_at = super::plan::now();
    if args.mode == RunMode::Live {
        prepared.run.armed_by = Some(operator(args.armed_by.as_deref(), &prepared.cell.name)?);
    }
    let stop = CancellationToken::new();
    let raised = stop.clone();
    on_signals(move |_| raised.cancel(), None)?;
    run_to_completion(async {
        let further = further_setups(&args.program);
        let outcome = prepared.carry_out(args, &stop).await?;
        if let Some(file) = &record {
            file.write(&outcome.document)?;
        }
        outcome.print()?;
        let judged = outcome.judge();
        if further > 0 && judged.is_ok() {
            let (next, setups) = (args.program.join(format!("{}.json", program_stem(1))), further + 1);
            output::note(format_args!(
                "setup 1 of {setups} is done; turn the part as its plan says, then run {}",
                next.display()
            ));
        }
        judged
    })
}

/// The operator's release of motion: the name given, or the cell's name typed on a terminal.
fn operator(armed_by: Option<&str>, cell: &str) -> Result<String, CliError> {
    if let Some(name) = armed_by {
        let is_name = !name.trim().is_empty() && !name.chars().any(is_control);
        return if is_name {
            Ok(name.to_owned())
        } else {
            Err(CliError::BadInput("--armed-by: give the operator's name".into()))
        };
    }
    if !stdin().is_terminal() {
        let what = "--mode live: an operator must release the motion; run it on a terminal, or name the operator with --armed-by";
        return Err(CliError::BadInput(what.into()));
    }
    output::prompt(format_args!(
        "{NOT_SAFETY_RATED}\nThe arm and the table of cell {cell} are about to move. Make sure that nobody is in the cell, then type its name: "
    ));
    let mut line = String::new();
    stdin().lock().read_line(&mut line).map_err(|error| CliError::Failed(format!("standard input: {error}")))?;
    if line.trim() == cell {
        return Ok(std::env::var("USER").unwrap_or_else(|_| "the operator".to_owned()));
    }
    Err(CliError::BadInput(format!("{:?} is not the name of the cell, {cell:?}; nothing moved", line.trim())))
}

/// Part of the reference that a live run needs and that is not given, with the way to give it.
fn missing(reference: &Reference) -> Option<(&'static str, &'static str)> {
    match (&reference.plan, &reference.part) {
        (None, _) => Some(("its plan, against which cell and part are checked", "keep plan.json beside it, or give --plan")),
        (Some(_), None) => {
            Some(("the part, which the check for collisions needs", "give --mesh and --unit, and the fixture if there is one"))
        }
        (Some(_), Some(_)) => None,
    }
}

/// Says what a program cannot be checked against, and refuses to move an arm with it.
fn check_known(mode: RunMode, shown: &str, reference: &Reference) -> Result<(), CliError> {
    // A twin hurts nothing, and its part lies where the plan says.
    let is_harmless = mode == RunMode::Simulate && reference.plan.is_some();
    let Some(missing) = missing(reference).filter(|_| !is_harmless) else { return Ok(()) };
    if mode == RunMode::Live {
        return Err(CliError::BadInput(format!("{shown}: a live run needs {}; {}", missing.0, missing.1)));
    }
    reference.check_placed().map_err(|reason| unplaced(&shown, reason))?;
    output::warning(shown, "", &format!("is run without {}", missing.0), missing.1);
    Ok(())
}

/// Requires a step of the program to begin with.
fn check_step(from_step: usize, steps: usize) -> Result<(), CliError> {
    if from_step < steps.max(1) {
        return Ok(());
    }
    let last = steps.saturating_sub(1);
    Err(CliError::BadInput(format!("--from-step {from_step}: the program has steps 0 to {last}")))
}

/// Findings on a run's request, each at the option that gave the value.
fn at_options(errors: &[FieldError]) -> CliError {
    let option = |pointer: &str| match pointer {
        "/speed_override" => "--override".to_owned(),
        "/time_factor" => "--speed".to_owned(),
        other => format!("--{}", other.trim_start_matches('/').replace('_', "-")),
    };
    let finding =
        |error: &FieldError| FileFinding { file: option(&error.pointer), pointer: String::new(), detail: error.detail.clone() };
    CliError::Findings(errors.iter().map(finding).collect())
}

impl PreparedRun {
    /// Reads every file and checks the program.
    fn load(args: &RunArgs) -> Result<Self, CliError> {
        let request = RunRequest {
            mode: args.mode,
            speed_override: args.speed_override,
            time_factor: args.speed,
            single_step: args.step,
            from_step: args.from_step,
            ..RunRequest::new(crate::wire::JobId::generate())
        };
        request.check().map_err(|errors| at_options(&errors))?;
        let (mut spec, controllers) = files::cell(&args.cell)?;
        if args.mode != RunMode::Simulate && controllers.is_none() {
            let what = "has no [controllers] section for arm and table, which every mode but simulate needs";
            let next = "add one to a cell file (`vantage presets NAME > cell.toml` writes a preset), and give that file";
            return Err(CliError::BadInput(format!("{}: {what}\n  → {next}", args.cell)));
        }
        spec.inline_devices(&FileLibrary);
        let cell = Arc::new(spec.build(&FileLibrary).map_err(|errors| files::findings(&args.cell, &errors))?);
        let (path, bytes) = program_file(&args.program)?;
        let shown = path.display().to_string();
        let kind = ("a program", Some(DocumentKind::Program));
        let document: ProgramDocument = files::of_kind(files::value(&path)?, kind, &shown)?;
        let program = document.program().map_err(|errors| files::findings(&shown, &errors))?;
        let mut reference = args.reference.clone();
        reference.plan = reference.plan.or(plan_beside(&args.program)?);
        let reference = reference.load()?;
        check_known(args.mode, &shown, &reference)?;
        let conditions = reference.present.conditions(&cell);
        let refused = |found: &[Finding]| files::findings(&shown, &field_errors(found));
        reference.owns(&program).map_err(|finding| refused(&[finding]))?;
        planned_cell::check(&args.cell, &cell, &program, &reference)?;
        let run = Run::new(&request, None, &cell.name, &program, &hex(&Sha256::digest(&bytes)));
        let expected = reference.expected(program.setup);
        let scene = reference.scene(&cell, expected.as_ref());
        let compensation = cell.calibrated.as_ref().and_then(|calibrated| calibrated.compensation_sha256.clone());
        let present = Hashes { plan: program.plan_sha256.clone(), cell: files::cell_sha256_of(&spec)?, compensation };
        let planned_in = reference.plan.as_ref().and_then(|(plan, _)| plan.cell.as_ref());
        let approved = planned_in.map_or_else(
            || present.clone(),
            |planned| {
                let compensation = planned.calibrated.as_ref().and_then(|calibrated| calibrated.compensation_sha256.clone());
                Hashes { compensation, ..present.clone() }
            },
        );
        check_step(args.from_step, program.steps.len())?;
        let off_orders = reference.off_orders(&program);
        let program = session::program_for(program, (args.mode, controllers.as_ref()), (&cell, &scene))
            .map_err(|together| CliError::BadInput(format!("{shown}: {together}")))?;
        let run = Run { planned_secs: program.cycle_secs, ..run };
        let job = RunJob::new(program, Arc::clone(&cell), &scene, expected.as_ref(), [approved, present])
            .map_err(|found| planned_cell::refused(&args.cell, &cell, &reference, &shown, &found))?
            .under(conditions);
        let found = [check_calibration(&cell, &conditions), off_orders].concat();
        if !found.is_empty() {
            return Err(refused(&found));
        }
        Ok(Self { run, job, cell, reference, controllers, request })
    }

    /// Warns of brightness levels that the scanner is not told; a twin has none.
    fn warn_of_levels(&self, args: &RunArgs) {
        let controllers = self.controllers.as_ref().filter(|_| self.request.mode != RunMode::Simulate);
        let doubt = controllers.and_then(|controllers| doubts::of_levels(controllers, self.job.program()));
        warn(&args.program.display().to_string(), doubt.as_slice());
    }

    /// Carries out the run to its end.
    async fn carry_out(mut self, args: &RunArgs, stop: &CancellationToken) -> Result<RunOutcome, CliError> {
        let leases = Leases::default();
        let is_live = self.request.mode == RunMode::Live;
        let lease = is_live.then(|| leases.acquire(&self.cell.name, "vantage run", LEASE)).transpose().map_err(refused_lease)?;
        let folder = args.audit.clone().or_else(|| is_live.then(|| audit_beside(&args.program)));
        let audit = folder.map(|folder| AuditPlace { folder, file_bytes: AUDIT_FILE_BYTES, files: AUDIT_FILES });
        let (handle, log) = session::begin(SessionOrder {
            name: self.run.id.to_string(),
            job: self.job.clone(),
            request: &self.request,
            controllers: self.controllers.as_ref(),
            authority: is_live.then(|| Authority { leases: leases.clone(), cell: self.cell.name.clone() }),
            is_first: true,
            heartbeat_timeout: LEASE,
            relocate: None,
            audit,
        })
        .map_err(CliError::Failed)?;
        let token = lease.as_ref().map(|lease| lease.token);
        let heart = tokio::spawn(beat(leases, self.cell.name.clone(), token, handle.clone()));
        let effect = if stdin().is_terminal() { LineEffect::StepsIfAwaited } else { LineEffect::StepsInTurn };
        let steps_by = if args.step { Some((lines_of_stdin()?, effect)) } else { None };
        let watch = RunWatch::new(handle.clone(), (self.job.program(), args.mode), stop.clone(), token, steps_by);
        watch.until_the_end().await;
        let record = handle.ended().await;
        heart.abort();
        if let Some(log) = log {
            match session::close_log(log).await {
                Ok(head) => self.run.audit = Some(head.into()),
                Err(reason) => {
                    let shown = args.program.display().to_string();
                    output::warning(
                        &shown,
                        "",
                        &format!("the end of its audit log may be missing: {reason}"),
                        "check the disk that holds the log",
                    );
                }
            }
        }
        RunOutcome::new(self.run, &self.cell, &self.reference, &record)
    }
}

/// Renews the lease, says that the client is there, and arms the run once it is ready.
async fn beat(leases: Leases, cell: String, token: Option<Fence>, handle: RunHandle) {
    let Some(token) = token else { return };
    let (mut beats, mut is_armed) = (tokio::time::interval(HEARTBEAT), false);
    loop {
        beats.tick().await;
        if leases.renew(&cell, token).is_err() || handle.heartbeat(Some(token)).is_err() {
            return;
        }
        if !is_armed && handle.status().state == RunState::Ready {
            is_armed = handle.arm(token).await.is_ok();
        }
    }
}

fn refused_lease(error: LeaseError) -> CliError {
    CliError::Failed(error.to_string())
}

/// Folder of the log of a live run for which none was named: what moved an arm can always be looked up.
fn audit_beside(program: &Path) -> PathBuf {
    let folder = if program.is_dir() { program } else { program.parent().unwrap_or(Path::new("")) };
    folder.join("audit")
}

/// Setups of a plan's folder after the first, whose program a folder stands for.
fn further_setups(from: &Path) -> usize {
    (1..).take_while(|setup| from.join(format!("{}.json", program_stem(*setup))).is_file()).count()
}

/// The program's file and its bytes.
fn program_file(from: &Path) -> Result<(PathBuf, Vec<u8>), CliError> {
    let path = if from.is_dir() { from.join(format!("{}.json", program_stem(0))) } else { from.to_owned() };
    if from.is_dir() && !path.is_file() {
        return Err(without_program(from));
    }
    let bytes = std::fs::read(&path).map_err(|error| files::unreadable(&path, &error))?;
    Ok((path, bytes))
}
