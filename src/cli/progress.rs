//! Progress of planning on the command line: a progress bar on a terminal, else one line per stage; and the seconds of each
//! stage, since the planner itself reads no clock.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::planning::context::{Observer, Stage};

/// Seconds of each stage that ran, by its name.
pub type StageTimes = BTreeMap<&'static str, f64>;

/// Progress bar and stopwatch of a plan.
pub struct Progress {
    bar: ProgressBar,
    running: Mutex<(StageTimes, Option<(Stage, Instant)>)>,
}

impl Progress {
    /// Starts the clock.
    #[must_use]
    pub fn start() -> Self {
        let bar = ProgressBar::with_draw_target(Some(1), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{msg:>10} [{bar:30}] {percent:>3} %  {elapsed}") {
            bar.set_style(style.progress_chars("=> "));
        }
        Self { bar, running: Mutex::default() }
    }

    /// Ends the last stage and returns the seconds of each.
    #[must_use]
    pub fn finish(self) -> StageTimes {
        self.switch(None);
        self.bar.finish_and_clear();
        self.running.into_inner().unwrap_or_else(PoisonError::into_inner).0
    }

    fn switch(&self, next: Option<Stage>) {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        if let Some((stage, since)) = running.1 {
            *running.0.entry(stage.as_str()).or_default() += (now - since).as_secs_f64();
        }
        running.1 = next.map(|stage| (stage, now));
    }
}

impl Observer for Progress {
    fn begin(&self, stage: Stage) {
        self.switch(Some(stage));
        if self.bar.is_hidden() {
            eprintln!("{}", stage.as_str());
        }
        self.bar.set_message(stage.as_str());
        self.bar.set_position(0);
    }

    fn progress(&self, done: usize, total: usize) {
        self.bar.set_length(total as u64);
        self.bar.set_position(done.min(total) as u64);
    }
}
