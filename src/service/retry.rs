//! Retries of what a full disk or a store that is temporarily unavailable refused: what was computed is not thrown away for it, and no
//! final state is lost.

use std::time::{Duration, Instant};

use super::app::App;
use super::error::Error;
use super::log_pace::LogPace;

/// First pause before work is done again; each further one is twice as long, up to [`MAX_STORE_RETRY`].
const FIRST_PAUSE: Duration = Duration::from_millis(250);
/// Pause after the store failed.
pub(super) const STORE_RETRY: Duration = Duration::from_secs(1);
/// Max pause after the store failed.
pub(super) const MAX_STORE_RETRY: Duration = Duration::from_secs(10);

/// Time between two lines of the log on work that fails again and again.
const TOLD_INTERVAL: Duration = Duration::from_secs(60);

/// Attempts at work that is done again while it fails. The log tells the first that failed, then one in each interval, and the end.
#[derive(Debug)]
pub(super) struct Attempts {
    failed: u64,
    pace: LogPace,
}

impl Attempts {
    /// Attempts of which none has failed.
    pub(super) const fn new() -> Self {
        Self { failed: 0, pace: LogPace::every(TOLD_INTERVAL) }
    }

    /// Counts an attempt that failed. Returns the number of those so far where the log is to tell of this one.
    pub(super) fn count_failed(&mut self, now: Instant) -> Option<u64> {
        self.failed += 1;
        self.pace.count(now).map(|_| self.failed)
    }

    /// Number of attempts that failed before one that did not; `None` without any, of which the log is to tell nothing.
    pub(super) fn failed_before(&self) -> Option<u64> {
        (self.failed > 0).then_some(self.failed)
    }
}

impl App {
    /// Does `work`, which `what` names for the log. While the disk is full or the store is temporarily unavailable, it is done again,
    /// until the service stops or `is_over` returns true: only then is the error a transient one.
    pub(super) async fn retried<T, F: Future<Output = Result<T, Error>>>(
        &self,
        what: &str,
        is_over: impl Fn() -> bool,
        work: impl Fn() -> F,
    ) -> Result<T, Error> {
        let (mut pause, mut attempts) = (FIRST_PAUSE, Attempts::new());
        loop {
            let error = match work().await {
                Err(error) if error.is_transient() => error,
                done => {
                    if let Some(failed) = attempts.failed_before().filter(|_| done.is_ok()) {
                        tracing::info!(failed, "{what} was possible again");
                    }
                    return done;
                }
            };
            if let Some(failed) = attempts.count_failed(Instant::now()) {
                let error = &error as &dyn std::error::Error;
                tracing::warn!(failed, error, "{what} is not possible at the moment; retrying");
            }
            self.pause(pause).await;
            if self.0.stopping.is_cancelled() || is_over() {
                return Err(error);
            }
            pause = (pause * 2).min(MAX_STORE_RETRY);
        }
    }

    /// Sleeps, but returns when the service stops.
    pub(super) async fn pause(&self, pause: Duration) {
        tokio::select! {
            () = self.0.stopping.cancelled() => {}
            () = tokio::time::sleep(pause) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A store that was locked for an hour gave six lines a minute of every job.
    #[test]
    fn the_log_tells_the_first_failed_attempt_one_a_minute_and_how_many_there_were() {
        let (mut attempts, began) = (Attempts::new(), Instant::now());
        assert_eq!(attempts.failed_before(), None);
        let told = [0, 10, 20, 59, 60, 70].map(|secs| attempts.count_failed(began + Duration::from_secs(secs)));
        assert_eq!(told, [Some(1), None, None, None, Some(5), None]);
        assert_eq!(attempts.failed_before(), Some(6));
    }
}
