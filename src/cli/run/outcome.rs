//! End of a run: its record as a file, its words, its exit code.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use super::missing;
use crate::cell::Cell;
use crate::check::Reference;
use crate::cli::{CliError, files, output};
use crate::execution::record::RunRecord;
use crate::planning::context::{Context, Silent};
use crate::service::runs::coverage;
use crate::wire::json_file_bytes;
use crate::wire::run::{
    DeviceStopDocument, RUN_RECORD_SCHEMA, ReportedReason, ReportedState, Run, RunMode, RunRecordDocument, RunStepOp,
    RunStepRecord,
};
use crate::wire::words::counted;

/// File for the record.
pub(super) struct RecordFile {
    path: PathBuf,
    is_csv: bool,
}

impl RecordFile {
    /// Refuses a path that can be no file before anything moves.
    pub(super) fn new(path: &Path) -> Result<Self, CliError> {
        let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty());
        if path.is_dir() || parent.is_some_and(|parent| !parent.is_dir()) {
            return Err(CliError::BadInput(format!("--record {}: is a folder, or its folder does not exist", path.display())));
        }
        let is_csv = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv"));
        Ok(Self { path: path.to_owned(), is_csv })
    }

    /// Writes the record.
    pub(super) fn write(&self, document: &RunRecordDocument) -> Result<(), CliError> {
        let bytes = if self.is_csv { document.to_csv().into_bytes() } else { json_file_bytes(document) };
        files::write(&self.path, &bytes)
    }
}

/// End of a run.
pub(super) struct RunOutcome {
    pub(super) document: RunRecordDocument,
    /// Need of a live run that is not met, with the way to meet it.
    pub(super) lacks: Option<(&'static str, &'static str)>,
}

impl RunOutcome {
    /// The record as a document, with the coverage at the measured poses.
    pub(super) fn new(mut run: Run, cell: &Cell, reference: &Reference, record: &RunRecord) -> Result<Self, CliError> {
        run.conclude(record);
        run.ended_at = Some(crate::cli::plan::now());
        if run.state == ReportedState::Done {
            let never = AtomicBool::new(false);
            let ctx = Context::new(&never, &Silent);
            let covered = tokio::task::block_in_place(|| coverage(reference, cell, run.setup, record, &ctx));
            run.coverage = covered.map_err(|error| CliError::Failed(format!("coverage at the measured poses: {error}")))?;
        }
        let steps = record.steps.iter().map(RunStepRecord::from).collect();
        let document = RunRecordDocument { schema: RUN_RECORD_SCHEMA.to_owned(), run, steps };
        Ok(Self { document, lacks: missing(reference) })
    }

    /// Prints how it ended.
    pub(super) fn print(&self) -> Result<(), CliError> {
        output::result(&self.document, self.words())
    }

    /// The error that the exit code tells, unless the run is done.
    pub(super) fn judge(&self) -> Result<(), CliError> {
        let run = &self.document.run;
        let detail = run.detail.clone().unwrap_or_default();
        let ended = match run.mode {
            RunMode::DryRun => format!("{} before arm and table were read", run.state.as_str()),
            RunMode::Simulate | RunMode::Live => format!("{} at step {} of {}", run.state.as_str(), run.step, run.steps),
        };
        match (run.state, run.reason) {
            (ReportedState::Done, _) => Ok(()),
            (ReportedState::Stopped, ReportedReason::ByClient) => Err(CliError::Cancelled(ended)),
            (
                ReportedState::Preparing
                | ReportedState::Ready
                | ReportedState::Armed
                | ReportedState::Running
                | ReportedState::Paused
                | ReportedState::Stopped
                | ReportedState::Failed,
                _,
            ) => Err(CliError::Failed(format!("{ended}: {detail}"))),
        }
    }

    fn words(&self) -> String {
        let RunRecordDocument { run, steps, .. } = &self.document;
        let mut words = match run.mode {
            RunMode::DryRun => words_of_reading(run, self.lacks),
            RunMode::Simulate | RunMode::Live => format!(
                "{}: {} of {} steps, {}, {:.1} s{}\n",
                run.state.as_str(),
                steps.iter().filter(|step| step.op != RunStepOp::Locate).count(),
                run.steps,
                counted(run.scans, "scan"),
                run.elapsed_secs,
                // The time of a step that was cut short is not counted.
                if run.state == ReportedState::Done { "" } else { " in finished steps" }
            ),
        };
        let scans = || steps.iter().filter(|step| step.op == RunStepOp::Scan);
        if scans().next().is_some() {
            let max = |value: fn(&RunStepRecord) -> f64| scans().map(value).fold(0.0, f64::max);
            let axis_deg = max(|step| step.optical_axis_deviation_deg);
            let position_mm = max(|step| step.position_deviation_mm);
            let planned: f64 = steps.iter().map(|step| step.planned_secs).sum();
            // Strings take every write.
            let _ = writeln!(
                words,
                "largest deviation at a scan {axis_deg:.3}° and {position_mm:.2} mm; predicted time at full speed {planned:.1} s"
            );
        }
        if let Some(coverage) = &run.coverage {
            let (measured, planned) = (100.0 * coverage.measured_of_asked, 100.0 * coverage.planned_of_asked);
            let _ = writeln!(words, "coverage from the measured poses {measured:.2} % of the asked area; planned {planned:.2} %");
        }
        for (name, stop) in run.stop.iter().flat_map(|stop| [("arm", &stop.arm), ("table", &stop.table)]) {
            if let Some(stop) = stop {
                let _ = writeln!(words, "{name}: {}", words_of_stop(stop));
            }
        }
        run.objections.iter().for_each(|objection| {
            let _ = writeln!(words, "would refuse motion: {objection}");
        });
        words
    }
}

/// Words of a dry run, which takes no step of the program.
fn words_of_reading(run: &Run, lacks: Option<(&str, &str)>) -> String {
    let read = "arm and table were read, and nothing was moved";
    let how = match lacks {
        _ if run.state != ReportedState::Done => "ended before arm and table were read; nothing was moved".to_owned(),
        _ if !run.objections.is_empty() => format!("{read}; mend what would refuse motion before a run with --mode live"),
        Some((what, remedy)) => format!("{read}; no objection was found, but a run with --mode live also needs {what}; {remedy}"),
        None => format!("{read}; nothing stands against a run with --mode live"),
    };
    format!("{}: {how}\n", run.state.as_str())
}

/// Stages of a stop.
fn words_of_stop(stop: &DeviceStopDocument) -> String {
    let stage = |name: &str, ms: Option<f64>| ms.map_or_else(|| format!("not {name}"), |ms| format!("{name} after {ms:.0} ms"));
    let stages =
        [stage("sent", stop.sent_ms), stage("acknowledged", stop.acknowledged_ms), stage("at rest", stop.at_rest_ms)].join(", ");
    match &stop.error {
        Some(error) => format!("stop {stages} ({error})"),
        None => format!("stop {stages}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::{Presets, SpecLibrary};
    use crate::cli::run::tests::program;
    use crate::program::Step;
    use crate::wire::JobId;
    use crate::wire::run::RunRequest;

    /// A run of a program of one step that took none.
    fn outcome(mode: RunMode, state: ReportedState, objections: &[&str]) -> RunOutcome {
        let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("builds");
        let program = program(&cell, vec![Step::Settle { secs: 0.1 }]);
        let request = RunRequest { mode, ..RunRequest::new(JobId::generate()) };
        let run = Run::new(&request, None, &cell.name, &program, &"cd".repeat(32));
        let objections = objections.iter().map(ToString::to_string).collect();
        let run = Run { state, detail: Some("the arm is silent".to_owned()), objections, ..run };
        let document = RunRecordDocument { schema: RUN_RECORD_SCHEMA.to_owned(), run, steps: Vec::new() };
        RunOutcome { document, lacks: None }
    }

    /// A scan at home that was predicted to take so long.
    fn scan_of(planned_secs: f64) -> RunStepRecord {
        let home_rad = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("builds").home_rad;
        RunStepRecord {
            step: 0,
            op: RunStepOp::Scan,
            viewpoint: Some(7),
            commanded: (&home_rad).into(),
            measured: (&home_rad).into(),
            axis_deviation_deg: 0.0,
            optical_axis_deviation_deg: 0.0,
            position_deviation_mm: 0.0,
            planned_secs,
            actual_secs: planned_secs,
            attempts: 1,
            capture_secs: None,
            capture_id: None,
        }
    }

    /// "done: 0 of 28 steps" read as a program that was not carried out.
    #[test]
    fn a_dry_run_is_told_by_what_it_read_and_not_by_steps() {
        let told = |state: ReportedState, objections: &[&str]| outcome(RunMode::DryRun, state, objections).words();
        let (read, unmoved) = ("done: arm and table were read, and nothing was moved; ", "nothing was moved\n");
        assert_eq!(told(ReportedState::Done, &[]), format!("{read}nothing stands against a run with --mode live\n"));
        let objected = told(ReportedState::Done, &["the arm moves already"]);
        assert!(objected.starts_with(read) && objected.ends_with("\nwould refuse motion: the arm moves already\n"), "{objected}");
        assert!(objected.contains("mend what would refuse motion before a run with --mode live"), "{objected}");
        let lacks = Some(("the part, which the check for collisions needs", "give --mesh"));
        let without_part = RunOutcome { lacks, ..outcome(RunMode::DryRun, ReportedState::Done, &[]) }.words();
        assert!(without_part.starts_with(read) && !without_part.contains("nothing stands against"), "{without_part}");
        let wanted = "--mode live also needs the part, which the check for collisions needs; give --mesh\n";
        assert!(without_part.ends_with(wanted), "{without_part}");
        let failed = told(ReportedState::Failed, &[]);
        assert!(failed.starts_with("failed: ended before arm and table were read") && failed.ends_with(unmoved), "{failed}");
        for (mode, wanted) in [
            (RunMode::DryRun, "failed before arm and table were read: the arm is silent"),
            (RunMode::Simulate, "failed at step 0 of 1: the arm is silent"),
        ] {
            let judged = outcome(mode, ReportedState::Failed, &[]).judge().expect_err("failed");
            assert_eq!(judged.to_string(), wanted);
        }
        assert!(outcome(RunMode::Simulate, ReportedState::Failed, &[]).words().starts_with("failed: 0 of 1 steps"));
    }

    /// A run that gave up for want of somebody who resumes ended as if on request, save in its exit code.
    #[test]
    fn a_run_that_ended_on_request_is_told_from_one_that_nobody_could_resume() {
        let judged = |reason: ReportedReason| {
            let mut ended = outcome(RunMode::Simulate, ReportedState::Stopped, &[]);
            ended.document.run.reason = reason;
            ended.judge().expect_err("stopped")
        };
        assert!(matches!(judged(ReportedReason::ByClient), CliError::Cancelled(_)));
        let untaken = judged(ReportedReason::TriggerSilent);
        assert!(matches!(untaken, CliError::Failed(_)) && untaken.to_string() == "stopped at step 0 of 1: the arm is silent");
    }

    /// "0.0 s" was told of a run that was stopped in the middle of its first step.
    #[test]
    fn the_time_of_a_run_that_did_not_end_is_that_of_its_finished_steps() {
        let told = |state: ReportedState| outcome(RunMode::Simulate, state, &[]).words();
        assert_eq!(told(ReportedState::Stopped), "stopped: 0 of 1 steps, 0 scans, 0.0 s in finished steps\n");
        assert_eq!(told(ReportedState::Done), "done: 0 of 1 steps, 0 scans, 0.0 s\n");
    }

    /// A run at a tenth of the speed was told beside its time at full speed, as if it had taken six times as long as predicted.
    #[test]
    fn the_predicted_time_is_told_as_that_at_full_speed() {
        let mut slow = outcome(RunMode::Simulate, ReportedState::Done, &[]);
        slow.document.steps = vec![scan_of(3.6)];
        let words = slow.words();
        assert!(words.ends_with("; predicted time at full speed 3.6 s\n"), "{words}");
    }
}
