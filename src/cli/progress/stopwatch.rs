//! Seconds of each stage of a command, and of the whole: at every moment some stage runs, so the stages add up to it.

use std::collections::BTreeMap;
use std::time::Instant;

use crate::cell::closed_list;

closed_list! {
    /// Stages of `vantage plan` around those of a plan.
    pub enum CommandStage {
        /// Parameters, scanner and cell from their files and presets, and the folder for the results.
        Loading = "loading",
        /// Welding and assessment of the part's mesh.
        Health = "health",
        /// Result files to the disk.
        Writing = "writing",
    }
}

/// Name of the seconds of the whole command among those of its stages.
pub(super) const TOTAL: &str = "total";

/// Seconds of each stage that ran, by its name.
pub(in crate::cli) type StageTimes = BTreeMap<&'static str, f64>;

/// A stopwatch that one stage after another holds.
#[derive(Debug)]
pub struct Stopwatch {
    began: Instant,
    times: StageTimes,
    running: Option<(&'static str, Instant)>,
    /// Stage that goes on when the one within it has ended.
    outer: Option<&'static str>,
}

impl Stopwatch {
    /// Starts with a stage, or with none.
    #[must_use]
    pub fn start(stage: Option<&'static str>) -> Self {
        let began = Instant::now();
        Self { began, times: StageTimes::new(), running: stage.map(|stage| (stage, began)), outer: None }
    }

    /// Seconds since the start.
    #[must_use]
    pub fn secs(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    /// Ends the running stage; the next one begins, if any.
    pub fn switch(&mut self, next: Option<&'static str>) {
        self.outer = None;
        self.hand_over(next);
    }

    /// Begins a stage within the running one, or ends it and goes on with that.
    pub fn within(&mut self, stage: Option<&'static str>) {
        let running = self.running.map(|(stage, _)| stage);
        self.hand_over(stage.or(self.outer));
        self.outer = stage.and(running);
    }

    fn hand_over(&mut self, next: Option<&'static str>) {
        let now = Instant::now();
        if let Some((stage, since)) = self.running {
            let secs = (now - since).as_secs_f64();
            *self.times.entry(stage).or_default() += secs;
            tracing::info!(stage, secs, "ended");
        }
        self.running = next.map(|stage| (stage, now));
    }

    /// Seconds of each stage so far, the running one included, and of the whole.
    #[must_use]
    pub(in crate::cli) fn times(&self) -> StageTimes {
        let (now, mut times) = (Instant::now(), self.times.clone());
        if let Some((stage, since)) = self.running {
            *times.entry(stage).or_default() += (now - since).as_secs_f64();
        }
        times.insert(TOTAL, (now - self.began).as_secs_f64());
        times
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::planning::context::Stage;

    #[test]
    fn stages_add_up_to_the_whole_with_those_within_others() {
        let mut watch = Stopwatch::start(Some("loading"));
        let pause = || std::thread::sleep(Duration::from_millis(15));
        pause();
        watch.switch(Some("surface"));
        watch.within(Some("collision_scene"));
        pause();
        watch.within(None);
        pause();
        watch.switch(Some("writing"));
        let times = watch.times();
        assert_eq!(times.keys().copied().collect::<Vec<_>>(), ["collision_scene", "loading", "surface", "total", "writing"]);
        let sum: f64 = times.iter().filter(|(stage, _)| **stage != TOTAL).map(|(_, secs)| secs).sum();
        assert!((sum - times[TOTAL]).abs() < 1e-6, "{times:?}");
        assert!(["loading", "collision_scene", "surface"].iter().all(|stage| times[stage] >= 0.015), "{times:?}");
    }

    #[test]
    fn no_two_stages_have_one_name() {
        let of_plan = Stage::ALL.map(Stage::as_str);
        assert!(CommandStage::ALL.iter().all(|stage| !of_plan.contains(&stage.as_str()) && stage.as_str() != TOTAL));
        assert!(!of_plan.contains(&TOTAL));
    }
}
