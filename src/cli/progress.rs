//! Progress of planning on the command line: on a terminal one bar over all stages with a clock that ticks, else one line per
//! stage; and the seconds of each stage, since the planner itself reads no clock.

use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

mod stopwatch;
#[cfg(test)]
mod tests;

pub use stopwatch::{CommandStage, Stopwatch};

use super::output;
use crate::planning::context::{Observer, Stage};
pub use crate::service::progress::Course;
use crate::service::progress::{Overall, secs_left};

/// Positions of the bar.
const POSITIONS: f64 = 1000.0;
/// Time between two drawings of the bar.
const TICK: Duration = Duration::from_millis(100);

/// Progress bar and stopwatch of a plan.
pub struct Progress {
    bar: ProgressBar,
    running: Arc<Mutex<Running>>,
    ticker: Option<Ticker>,
}

/// Stages so far.
struct Running {
    watch: Stopwatch,
    overall: Overall,
}

/// Thread that draws the bar, so that its clock ticks within long stages too.
struct Ticker {
    stop: mpsc::Sender<()>,
    thread: JoinHandle<()>,
}

impl Progress {
    /// Starts the clock of a command that is expected to go through `course`.
    #[must_use]
    pub fn start(course: &Course) -> Self {
        Self::go_on(course, Stopwatch::start(None))
    }

    /// Goes on with the clock of a command that is expected to go through `course` from here.
    #[must_use]
    pub fn go_on(course: &Course, watch: Stopwatch) -> Self {
        // Log lines and JSON would be torn by a bar.
        let has_bar = !output::is_quiet() && !output::is_json() && output::verbosity() == 0;
        let target = if has_bar { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(POSITIONS as u64), target);
        if let Ok(style) = ProgressStyle::with_template("{prefix:>11} [{bar:30}] {percent:>3} %  {msg}") {
            bar.set_style(style.progress_chars("=> "));
        }
        let running = Arc::new(Mutex::new(Running { watch, overall: Overall::new(course) }));
        // Without a thread for it the bar moves only with the stages.
        let ticker = if bar.is_hidden() { None } else { Ticker::start(bar.clone(), running.clone()).ok() };
        Self { bar, running, ticker }
    }

    /// Ends the bar; the clock goes on.
    #[must_use]
    pub fn finish(self) -> Stopwatch {
        if let Some(Ticker { stop, thread }) = self.ticker {
            drop(stop);
            // A thread that panicked draws no more either.
            let _ = thread.join();
        }
        self.bar.finish_and_clear();
        std::mem::replace(&mut lock(&self.running).watch, Stopwatch::start(None))
    }
}

impl Ticker {
    fn start(bar: ProgressBar, running: Arc<Mutex<Running>>) -> std::io::Result<Self> {
        let (stop, stopped) = mpsc::channel();
        let draw = move || {
            while stopped.recv_timeout(TICK) == Err(RecvTimeoutError::Timeout) {
                let (fraction, clock) = lock(&running).now();
                bar.set_message(clock);
                bar.set_position((POSITIONS * fraction) as u64);
                bar.tick();
            }
        };
        let thread = std::thread::Builder::new().name("progress".to_owned()).spawn(draw)?;
        Ok(Self { stop, thread })
    }
}

impl Running {
    /// Share of the work that is done, and the clock beside it.
    fn now(&mut self) -> (f64, String) {
        let secs = self.watch.secs();
        let fraction = self.overall.fraction(secs);
        (fraction, clock(secs, fraction))
    }
}

fn lock(running: &Mutex<Running>) -> MutexGuard<'_, Running> {
    running.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Time that has passed, and the time left once it can be told.
fn clock(secs: f64, fraction: f64) -> String {
    let text = |secs: f64| format!("{}:{:02}", secs as u64 / 60, secs as u64 % 60);
    match secs_left(secs, fraction) {
        Some(left) => format!("{}, about {} left", text(secs), text(left)),
        None => text(secs),
    }
}

impl Observer for Progress {
    fn begin(&self, stage: Stage) {
        let mut running = lock(&self.running);
        running.watch.switch(Some(stage.as_str()));
        let secs = running.watch.secs();
        running.overall.begin(stage, secs);
        drop(running);
        if self.bar.is_hidden() {
            output::note(stage.as_str());
        }
        self.bar.set_prefix(stage.as_str());
    }

    fn progress(&self, done: usize, total: usize) {
        lock(&self.running).overall.progress(done, total);
    }

    fn within(&self, stage: Option<Stage>) {
        lock(&self.running).watch.within(stage.map(Stage::as_str));
    }
}
