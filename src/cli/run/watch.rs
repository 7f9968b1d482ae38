//! Progress of a run while it is under way: on a terminal a bar over its steps, else a line for each change. A signal stops it in
//! order, whether or not anything can be printed; lines of standard input take it on step by step.

use std::io::{BufRead, IsTerminal, stdin};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use crate::cli::{CliError, output};
use crate::execution::session::{Fence, LiveEvent, PauseCause, RunHandle, RunReason, RunState, StopCause};
use crate::program::{Program, Step};
use crate::wire::run::RunMode;

/// Effect of a line of standard input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LineEffect {
    /// Goes on after a pause. At another moment it is no order.
    Resumes,
    /// Takes one step, where the run waits for that. A line that is typed at another moment is no order.
    StepsIfAwaited,
    /// Takes one step. Lines of a pipe wait until the run does.
    StepsInTurn,
}

/// State and step that were told last, and whether a stop was.
type Told = (RunState, Option<usize>, bool);

/// A run that is watched.
pub(super) struct RunWatch {
    handle: RunHandle,
    steps: Vec<String>,
    stop: CancellationToken,
    token: Option<Fence>,
    lines: Option<mpsc::Receiver<()>>,
    effect: LineEffect,
    /// True while the run waits for a line: from when it is armed or pauses until a line takes it on.
    awaits_line: bool,
    bar: ProgressBar,
    told: Option<Told>,
    last_id: u64,
}

impl RunWatch {
    /// Begins to watch.
    pub(super) fn new(
        handle: RunHandle,
        (program, mode): (&Program, RunMode),
        stop: CancellationToken,
        token: Option<Fence>,
        steps_by: Option<(mpsc::Receiver<()>, LineEffect)>,
    ) -> Self {
        let (lines, effect) = steps_by.map_or((None, LineEffect::Resumes), |(lines, effect)| (Some(lines), effect));
        // A dry run takes no step, and a bar over the steps would stay at none.
        let has_bar = effect == LineEffect::Resumes && mode != RunMode::DryRun;
        // Read from the start, so that a line from before a pause is no answer to it.
        let lines = lines.or_else(|| stdin().is_terminal().then(lines_of_stdin).and_then(Result::ok));
        let steps: Vec<String> = program.steps.iter().map(words_of).collect();
        // Log lines and JSON would be torn by a bar, and so would the lines that take steps.
        let has_bar = !output::is_quiet() && !output::is_json() && output::verbosity() == 0 && has_bar;
        let target = if has_bar { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(steps.len() as u64), target);
        if let Ok(style) = ProgressStyle::with_template("{prefix:>9} [{bar:30}] {pos}/{len}  {msg}") {
            bar.set_style(style.progress_chars("=> "));
        }
        Self { handle, steps, stop, token, lines, effect, awaits_line: false, bar, told: None, last_id: 0 }
    }

    /// Watches until the run has ended.
    pub(super) async fn until_the_end(mut self) {
        let stopper = tokio::spawn(stop_when_cancelled(self.stop.clone(), self.handle.clone()));
        let (kept, mut live) = self.handle.events_after(0);
        kept.iter().for_each(|event| self.show(event));
        let mut is_stopping = false;
        while !self.handle.status().state.is_final() {
            tokio::select! {
                event = live.recv() => match event {
                    Ok(event) => self.show(&event),
                    Err(RecvError::Lagged(_)) => {
                        let (kept, again) = self.handle.events_after(self.last_id);
                        kept.iter().for_each(|event| self.show(event));
                        live = again;
                    }
                    Err(RecvError::Closed) => break,
                },
                () = self.stop.cancelled(), if !is_stopping => {
                    is_stopping = true;
                    output::note("stopping in a controlled way; ctrl-c again ends the process at once");
                }
                line = next_line(&mut self.lines), if self.reads_lines() => match line {
                    Some(()) => self.take_line().await,
                    None => self.take_end_of_input(),
                },
            }
        }
        stopper.abort();
        self.bar.finish_and_clear();
    }

    /// Returns true if a line would be heard now: those of a pipe are not read before the run waits for one.
    fn reads_lines(&self) -> bool {
        self.awaits_line || self.effect != LineEffect::StepsInTurn
    }

    async fn take_line(&mut self) {
        match self.effect {
            LineEffect::Resumes if self.handle.status().state == RunState::Paused => drop(self.handle.resume(self.token).await),
            // Until it has left this pause, no other line is meant for it.
            LineEffect::StepsIfAwaited | LineEffect::StepsInTurn if self.awaits_line => {
                self.awaits_line = self.handle.step(self.token).await.is_err();
            }
            LineEffect::Resumes | LineEffect::StepsIfAwaited | LineEffect::StepsInTurn => {}
        }
    }

    /// Stops a run that waits for a line; the step that is under way is done first.
    fn take_end_of_input(&mut self) {
        let status = self.handle.status();
        let is_paused = status.state == RunState::Paused;
        match self.effect {
            LineEffect::Resumes if !is_paused => self.lines = None,
            // It is read again where the run waits.
            LineEffect::StepsIfAwaited if !self.awaits_line => self.effect = LineEffect::StepsInTurn,
            LineEffect::Resumes | LineEffect::StepsIfAwaited | LineEffect::StepsInTurn => {
                self.lines = None;
                self.handle.stop(unattended(&status.reason));
                output::note("standard input has ended; the run stops");
            }
        }
    }

    /// A pause that nobody asked for: standard input decides how it goes on, and without somebody there it does not.
    fn ask(&mut self, reason: &RunReason) {
        if self.lines.is_none() {
            self.handle.stop(unattended(reason));
        }
        self.bar.suspend(|| output::note(format_args!("paused: {reason}")));
        match &self.lines {
            Some(_) if self.effect == LineEffect::Resumes => {
                self.bar.suspend(|| output::prompt("press Enter to resume, ctrl-c to stop\n"));
            }
            Some(_) => {}
            None => output::note("nobody can resume: standard input is not a terminal; the run stops"),
        }
    }

    fn show(&mut self, event: &LiveEvent) {
        self.last_id = event.id;
        let (state, step) = (event.status.state, event.step);
        let is_stopping = matches!(event.status.reason, RunReason::Stopping(_));
        let now = Some((state, step, is_stopping));
        if self.told == now {
            return;
        }
        let is_new_state = self.told.is_none_or(|(before, ..)| before != state);
        let begins_step = begins_step(self.effect, self.told, state);
        self.told = now;
        if is_stopping {
            // On a terminal too: whoever stands at the cell has to know that it is not at rest yet.
            self.bar.suspend(|| output::note(format_args!("{}: {}", state.as_str(), event.status.reason)));
            self.awaits_line = false;
            return;
        }
        if is_new_state {
            self.awaits_line = matches!(state, RunState::Armed | RunState::Paused);
        }
        if is_new_state && state == RunState::Paused {
            self.ask(&event.status.reason);
        }
        let words = step.and_then(|step| self.steps.get(step)).map_or("", String::as_str);
        if self.bar.is_hidden() {
            if is_new_state && state != RunState::Paused {
                output::note(format_args!("{}: {}", state.as_str(), event.status.reason));
            }
            if let Some(step) = step.filter(|_| begins_step) {
                output::note(format_args!("step {step} of {}: {words}", self.steps.len()));
            }
        }
        self.bar.set_prefix(state.as_str());
        self.bar.set_message(words.to_owned());
        self.bar.set_position(step.unwrap_or_default() as u64);
    }
}

/// Returns true if a step that is told now begins. Where steps are taken one by one, one that is told when another is done begins with
/// the next line.
fn begins_step(effect: LineEffect, before: Option<Told>, state: RunState) -> bool {
    let only_comes_next = || before.is_some_and(|(former, step, _)| former == state && step.is_some());
    state == RunState::Running && (effect == LineEffect::Resumes || !only_comes_next())
}

/// Cause of a stop for want of somebody who resumes: of a capture that is not acknowledged, nobody asked for the end.
fn unattended(reason: &RunReason) -> StopCause {
    if let RunReason::Paused(cause @ PauseCause::Trigger { .. }) = reason {
        return StopCause::Unattended(cause.clone());
    }
    StopCause::Client
}

/// Stops the run on a signal. Prints nothing: a terminal that takes no bytes holds up whoever prints, and must not hold up a stop.
async fn stop_when_cancelled(stop: CancellationToken, handle: RunHandle) {
    stop.cancelled().await;
    handle.stop(StopCause::Client);
}

/// Lines of standard input, as they come; the channel closes with it.
pub(super) fn lines_of_stdin() -> Result<mpsc::Receiver<()>, CliError> {
    let (sender, lines) = mpsc::channel(1);
    let read = move || {
        for line in stdin().lock().lines() {
            if line.is_err() || sender.blocking_send(()).is_err() {
                return;
            }
        }
    };
    let thread = std::thread::Builder::new().name("lines".to_owned()).spawn(read);
    thread.map_err(|error| CliError::Failed(format!("the thread for standard input: {error}")))?;
    Ok(lines)
}

async fn next_line(lines: &mut Option<mpsc::Receiver<()>>) -> Option<()> {
    match lines {
        Some(lines) => lines.recv().await,
        None => std::future::pending().await,
    }
}

fn words_of(step: &Step) -> String {
    match step {
        Step::Move(step) => format!("move, {:.1} s", step.duration_secs),
        Step::Settle { secs } => format!("settle, {secs:.1} s"),
        Step::Scan { view, .. } => format!("scan viewpoint {}", view.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_that_comes_next_is_told_with_the_line_that_begins_it() {
        let (armed, running, paused) = (RunState::Armed, RunState::Running, RunState::Paused);
        let begins = |effect: LineEffect, before: (RunState, Option<usize>)| {
            begins_step(effect, Some((before.0, before.1, false)), running)
        };
        for effect in [LineEffect::StepsIfAwaited, LineEffect::StepsInTurn] {
            assert!(begins(effect, (running, None)), "the first, as the run begins");
            assert!(!begins(effect, (running, Some(0))), "the one before is just done");
            assert!(begins(effect, (paused, Some(1))), "a line takes it");
        }
        assert!(begins(LineEffect::Resumes, (running, Some(0))), "one follows the other");
        assert!(!begins_step(LineEffect::Resumes, Some((armed, None, false)), paused));
    }
}
