//! Pace of a line in the log that would fill it if it came as often as its cause.

use std::time::{Duration, Instant};

/// Pace of a line in the log: one in each interval, with the number of occasions since the one before.
#[derive(Debug)]
pub(crate) struct LogPace {
    interval: Duration,
    /// Time of the latest line.
    told: Option<Instant>,
    /// Number of occasions since then.
    untold: u64,
}

impl LogPace {
    /// Pace of one line in `interval`.
    pub(crate) const fn every(interval: Duration) -> Self {
        Self { interval, told: None, untold: 0 }
    }

    /// Counts an occasion. Returns the number of those since the latest line where another one is due.
    pub(crate) fn count(&mut self, now: Instant) -> Option<u64> {
        self.untold += 1;
        if self.told.is_some_and(|told| now.saturating_duration_since(told) < self.interval) {
            return None;
        }
        self.told = Some(now);
        Some(std::mem::take(&mut self.untold))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A full disk gave two lines a second of every job.
    #[test]
    fn a_line_comes_once_in_an_interval_and_counts_the_occasions_since_the_one_before() {
        let (mut pace, began) = (LogPace::every(Duration::from_secs(60)), Instant::now());
        let told = [0, 1, 59, 60, 61, 200].map(|secs| pace.count(began + Duration::from_secs(secs)));
        assert_eq!(told, [Some(1), None, None, Some(3), None, Some(2)]);
    }
}
