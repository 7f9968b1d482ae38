//! `vantage rescan`: further views for what scans of a part lack.

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use super::limits::LimitArgs;
use super::out::{FILES_OF_EVERY_PLAN, FileOrigin, OutputFolder, OutputWriter, programs};
use super::plan::{now, pool, print_summary, require_a_view, to_cli_error, warn_of_refused};
use super::progress::{Course, Progress};
use super::ranges::whole;
use super::scanned_part::{ScannedPartArgs, read_state, with_sets};
use super::{CliError, files, output, params};
use crate::planning::context::Context;
use crate::planning::params::RescanParams;
use crate::planning::sequence::Roadmaps;
use crate::service::plan_job::{PLAN_FILE, PlanJob, Reports, bytes_of, plan_sha256};
use crate::service::rescan_job::RescanJob;
use crate::wire::parameters;

const EXAMPLES: &str = "Examples:
  vantage compare plan scans --mesh part.stl --unit mm --out inspection
  vantage rescan inspection plan --mesh part.stl --unit mm --out plan2
  vantage rescan inspection plan --mesh part.stl --unit mm --set max_views=8 \\
      --out plan2

Vantage chooses the views that are expected to add the most area, given the rates at which the scanner returned points. Surface \
that no view recovers, such as concave corners, is left out. Vantage stops at max_views (default 4), when the best view is \
expected to add less than min_gain (0.002 of the asked area), when all further views together would add less than min_left \
(0.005 of it), or after max_rounds (2). `vantage rescan --help` lists these parameters with their ranges. The result is a plan \
like that of `vantage plan`, with its program.

Exit codes: 0 success, 1 system error, 2 bad input, 3 no further view worth taking or none that has a path, 4 interrupted.";

/// Plan further views for surface that the scans missed.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = EXAMPLES, after_long_help = format!("{EXAMPLES}{}", params::for_help(&parameters::of_rescans())))]
pub struct RescanArgs {
    /// Inspection: the folder that `vantage compare` wrote, or its rescan.json.
    #[arg(value_name = "INSPECTION")]
    inspection: PathBuf,
    #[command(flatten)]
    part: ScannedPartArgs,
    /// Set one parameter, such as `max_views=8`: max_views, min_gain, max_rounds or min_left. Repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    sets: Vec<String>,
    /// Folder for the plan; created if it does not exist.
    #[arg(long)]
    out: PathBuf,
    /// Number of threads, 0 to 1024; 0 for all cores. The plan does not depend on it.
    #[arg(long, default_value_t = 0, value_parser = whole::<u16>(0..=1024))]
    threads: u16,
    #[command(flatten)]
    limits: LimitArgs,
}

/// Runs the command.
///
/// # Errors
/// [`CliError`].
pub fn run(args: &RescanArgs, cancel: &AtomicBool) -> Result<(), CliError> {
    let params = with_sets(&args.sets, RescanParams::check)?;
    let state = read_state(&args.inspection)?;
    let shown = args.inspection.display().to_string();
    state.check_found().map_err(|error| files::findings(&shown, &[error]))?;
    let pool = pool(args.threads)?;
    let scanned = pool.install(|| args.part.load(cancel))?;
    // The state of a later round is that of several plans.
    if state.rounds == 0 && state.plan_sha256 != scanned.plan_sha256 {
        return Err(CliError::BadInput(format!(
            "{}: the inspection is of another plan\n  → name the plan that `vantage compare` was given",
            args.inspection.display()
        )));
    }
    let setups = scanned.plan.setups.len().max(1);
    let names: Vec<String> =
        scanned.cell.as_ref().map_or_else(Vec::new, |cell| programs(setups, |dialect| cell.robot.takes(dialect)));
    let names: Vec<&str> = FILES_OF_EVERY_PLAN.iter().copied().chain(names.iter().map(String::as_str)).collect();
    let folder = OutputFolder::prepare(&args.out, OutputWriter::Plan, &names)?;
    let (rescan, roadmaps) = (RescanJob { state, params }, Roadmaps::default());
    let job = PlanJob {
        mesh: &scanned.mesh,
        fixture: scanned.fixture.as_ref(),
        fixture_sha256: scanned.fixture_sha256.as_deref(),
        part_name: scanned.name.clone(),
        part_sha256: &scanned.plan.part.sha256,
        unit: args.part.unit(),
        scanner: &scanned.scanner,
        cell: scanned.cell.as_ref(),
        roadmaps: Some(&roadmaps),
        rescan: Some(&rescan),
        params: &scanned.plan.params,
        echo: scanned.plan.echo.clone(),
        date: Some(now()),
    };
    let progress = Progress::start(&Course::of_plan(&scanned.plan.params, scanned.cell.is_some()));
    let planned = || {
        let ctx = Context::new(cancel, &progress).with_allowance(args.limits.allowance(rayon::current_num_threads()));
        let outcome = job.plan(&ctx)?;
        let views = (outcome.plan.executed_views(), outcome.plan.views.len());
        Ok((job.render(&outcome, Reports::Html, &ctx)?, views))
    };
    let planned = args.limits.within(cancel, || pool.install(planned).map_err(to_cli_error));
    let _ = progress.finish();
    let (artifacts, (executed, chosen)) = planned?;
    let sha256 = plan_sha256(bytes_of(&artifacts, PLAN_FILE));
    folder.replace(&artifacts, &FileOrigin { plan_sha256: Some(sha256), made_from: None })?;
    warn_of_refused(scanned.cell.as_ref(), &artifacts, folder.path());
    print_summary(output::is_json(), folder.path(), &artifacts)?;
    require_a_view(executed, chosen)
}
