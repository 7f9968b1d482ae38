//! Pace of downloads: all together send at most so many bytes a second, so that they do not crowd out the requests that are
//! answered at once.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use tokio::time::{Instant, sleep_until};

/// A rate that all downloads share.
#[derive(Debug)]
pub(super) struct Pacer {
    bytes_per_sec: f64,
    /// Time at which the bytes granted so far have been sent, at that rate.
    sent_at: Mutex<Option<Instant>>,
}

impl Pacer {
    /// A pacer for this many bytes a second.
    pub(super) fn new(bytes_per_sec: u64) -> Self {
        Self { bytes_per_sec: bytes_per_sec as f64, sent_at: Mutex::default() }
    }

    /// Charges `bytes`; returns the time from which they may be sent. Requests are granted in the order of their calls.
    fn charge_at(&self, now: Instant, bytes: usize) -> Instant {
        // A value is consistent after every operation, so a poisoned lock is usable.
        let mut sent_at = self.sent_at.lock().unwrap_or_else(PoisonError::into_inner);
        let start = sent_at.map_or(now, |at| at.max(now));
        *sent_at = Some(start + Duration::from_secs_f64(bytes as f64 / self.bytes_per_sec));
        start
    }

    /// Charges `bytes` that are sent at once.
    pub(super) fn charge(&self, bytes: usize) {
        self.charge_at(Instant::now(), bytes);
    }

    /// Charges `bytes`, and waits until they may be sent.
    pub(super) async fn wait(&self, bytes: usize) {
        sleep_until(self.charge_at(Instant::now(), bytes)).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn downloads_share_the_rate_and_an_idle_server_saves_nothing_up() {
        let (pacer, began) = (Pacer::new(1_000_000), Instant::now());
        let after = |millis: u64| began + Duration::from_millis(millis);
        let granted = [0; 4].map(|_: u64| pacer.charge_at(began, 250_000));
        assert_eq!(granted, [0, 250, 500, 750].map(after));
        let later = [pacer.charge_at(after(10_000), 500_000), pacer.charge_at(after(10_000), 500_000)];
        assert_eq!(later, [10_000, 10_500].map(after));
    }
}
