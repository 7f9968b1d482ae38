//! Retries of what a full disk or a store that is temporarily unavailable refused: what was computed is not thrown away for it, and no
//! final state is lost.

use std::time::Duration;

use super::app::App;
use super::error::Error;

/// First pause before work is done again; each further one is twice as long, up to [`MAX_STORE_RETRY`].
const FIRST_PAUSE: Duration = Duration::from_millis(250);
/// Pause after the store failed.
pub(super) const STORE_RETRY: Duration = Duration::from_secs(1);
/// Max pause after the store failed.
pub(super) const MAX_STORE_RETRY: Duration = Duration::from_secs(10);

impl App {
    /// Does `work`, which `what` names for the log. While the disk is full or the store is temporarily unavailable, it is done again,
    /// until the service stops or `is_over` returns true: only then is the error a transient one.
    pub(super) async fn retried<T, F: Future<Output = Result<T, Error>>>(
        &self,
        what: &str,
        is_over: impl Fn() -> bool,
        work: impl Fn() -> F,
    ) -> Result<T, Error> {
        let mut pause = FIRST_PAUSE;
        loop {
            let error = match work().await {
                Err(error) if error.is_transient() => error,
                done => return done,
            };
            tracing::warn!(error = &error as &dyn std::error::Error, "{what} is not possible at the moment; retrying");
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
