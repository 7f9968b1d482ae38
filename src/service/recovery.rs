//! Recovery of what an earlier process left unfinished. It begins with the service and must end before anything new is begun: jobs, runs,
//! calibrations and inspections of before could not be told from new ones. On a full disk it waits for room, and the service is there
//! meanwhile: whoever cancels and deletes makes that room.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tokio::sync::oneshot;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::app::App;
use super::error::{Error, InternalError};
use super::jobs;
use super::retry::{Attempts, MAX_STORE_RETRY};
use super::space::PIECE_BYTES;

/// First pause before a part of the recovery is tried again; each further one is twice as long, up to [`MAX_STORE_RETRY`].
const FIRST_PAUSE: Duration = Duration::from_millis(500);

/// Time after which a part of the recovery for which the reserve was too small is tried on it again although the disk has no more room:
/// the database may need less by then. More often, the reserve would be removed and written for nothing.
const RESERVE_RETRY: Duration = Duration::from_secs(60);

/// Vain use of the reserve.
#[derive(Clone, Copy)]
struct VainUse {
    /// Room of the disk after it, the reserve included.
    room_bytes: u64,
    /// Time of its end.
    at: Instant,
}

impl VainUse {
    /// Returns true if another use may be less vain: the disk has got more room, or much time has passed.
    fn is_past(self, room_bytes: u64, now: Instant) -> bool {
        room_bytes >= self.room_bytes.saturating_add(PIECE_BYTES) || now.saturating_duration_since(self.at) >= RESERVE_RETRY
    }
}

/// State of the recovery.
#[derive(Default)]
pub(super) struct Recovery {
    /// Cancelled once the recovery waits for room.
    waits: CancellationToken,
    is_done: AtomicBool,
}

impl Recovery {
    /// Returns true if a part of the recovery is tried again after `error`: on a full disk always, after another error that may pass
    /// only while the service is there already. Before, the start fails, and whoever started the server does so again.
    fn tries_after(&self, error: &Error) -> bool {
        matches!(error, Error::StorageFull) || (self.waits.is_cancelled() && error.is_transient())
    }
}

impl App {
    /// Recovers everything, then starts the dispatcher. On a full disk, both go on in the background.
    pub(super) async fn begin(&self) -> Result<(), Error> {
        let (sender, mut ended) = oneshot::channel();
        let app = self.clone();
        self.spawn(async move {
            let recovered = app.recover_all().await;
            if recovered.is_ok() {
                app.0.recovery.is_done.store(true, Ordering::Relaxed);
                app.spawn(jobs::dispatch(app.clone()));
            }
            if let Err(Err(error)) = sender.send(recovered)
                && !app.0.stopping.is_cancelled()
            {
                let error = &error as &dyn std::error::Error;
                tracing::error!(error, "what an earlier process left unfinished cannot be recovered; restart the server");
            }
        });
        tokio::select! {
            biased;
            ended = &mut ended => ended.map_err(|error| InternalError::Task(error.to_string()))?,
            () = self.0.recovery.waits.cancelled() => Ok(()),
        }
    }

    async fn recover_all(&self) -> Result<(), Error> {
        self.recover().await?;
        self.recover_runs().await?;
        self.recover_calibrations().await?;
        self.recover_inspections().await
    }

    /// Does a part of the recovery, on the room that is kept for it; on a disk without any, again and again until there is room.
    pub(super) async fn recovering<T, F: Future<Output = Result<T, Error>>>(&self, work: impl Fn() -> F) -> Result<T, Error> {
        let (mut pause, mut vain_use, mut attempts) = (FIRST_PAUSE, None::<VainUse>, Attempts::new());
        loop {
            let is_on_reserve = vain_use.is_none_or(|vain| vain.is_past(self.room_bytes(), Instant::now()));
            let done = if is_on_reserve { self.with_reserve(&work).await } else { self.told_full(work().await).await };
            let error = match done {
                Err(error) if self.0.recovery.tries_after(&error) && !self.0.stopping.is_cancelled() => error,
                done => return done,
            };
            if is_on_reserve {
                let is_full = matches!(error, Error::StorageFull);
                vain_use = is_full.then(|| VainUse { room_bytes: self.room_bytes(), at: Instant::now() });
            }
            if !matches!(error, Error::StorageFull) {
                if let Some(failed) = attempts.count_failed(std::time::Instant::now()) {
                    let error = &error as &dyn std::error::Error;
                    let told = "what an earlier process left unfinished cannot be recovered at the moment; retrying";
                    tracing::warn!(failed, error, "{told}");
                }
            } else if !self.0.recovery.waits.is_cancelled() {
                let folder = self.data_dir().display();
                tracing::error!(
                    %folder,
                    "the disk of the data folder is full: no job is planned and no run begins until what an earlier process \
                     left unfinished is recovered; free space on it, or cancel and delete jobs"
                );
            }
            self.0.recovery.waits.cancel();
            self.pause(pause).await;
            pause = (pause * 2).min(MAX_STORE_RETRY);
        }
    }

    /// Reason why nothing new is begun, until everything is recovered.
    pub(super) fn unrecovered(&self) -> Option<String> {
        let reason = "what an earlier process left unfinished is not recovered, since the disk of the data folder has no room for \
                      that: free space on it, or cancel and delete jobs; the server's log gives any other cause";
        (!self.0.recovery.is_done.load(Ordering::Relaxed)).then(|| reason.to_owned())
    }

    /// Refuses what is new until everything is recovered.
    pub(super) fn check_recovered(&self) -> Result<(), Error> {
        self.unrecovered().map_or(Ok(()), |reason| Err(Error::Unrecovered(reason)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service::tests::service;

    impl App {
        /// Makes everything count as not recovered yet.
        pub(in crate::service) fn forget_recovery(&self) {
            self.0.recovery.is_done.store(false, Ordering::Relaxed);
        }
    }

    /// Refusals said "the disk is full", whatever the cause.
    #[tokio::test]
    async fn what_is_new_is_refused_with_the_reason_that_readiness_gives() {
        let (app, _folder) = service().await;
        app.check_recovered().expect("recovered");
        app.forget_recovery();
        let refused = app.check_recovered().expect_err("not recovered");
        assert!(refused.is_transient() && matches!(refused, Error::Unrecovered(_)), "{refused:?}");
        assert_eq!(Some(refused.to_string()), app.unrecovered());
    }

    /// The reserve was removed and written anew every ten seconds.
    #[test]
    fn a_reserve_that_was_too_small_is_used_again_once_there_is_more_room_or_after_a_minute() {
        let at = Instant::now();
        let vain = VainUse { room_bytes: 10 * PIECE_BYTES, at };
        let soon = at + MAX_STORE_RETRY;
        assert!(!vain.is_past(vain.room_bytes, soon) && !vain.is_past(vain.room_bytes + PIECE_BYTES - 1, soon));
        assert!(!vain.is_past(0, soon), "less room");
        assert!(vain.is_past(vain.room_bytes + PIECE_BYTES, soon));
        assert!(vain.is_past(vain.room_bytes, at + RESERVE_RETRY));
    }

    /// A busy database ended the recovery, and nothing was planned until the server was restarted.
    #[test]
    fn what_may_pass_is_waited_for_while_the_service_is_there() {
        let recovery = Recovery::default();
        let reason = || InternalError::Row("locked".to_owned());
        let errors = [Error::StorageFull, Error::StorageBusy(reason()), Error::Internal(reason())];
        let is_tried_after = |recovery: &Recovery| errors.each_ref().map(|error| recovery.tries_after(error));
        assert_eq!(is_tried_after(&recovery), [true, false, false]);
        recovery.waits.cancel();
        assert_eq!(is_tried_after(&recovery), [true, true, false]);
    }
}
