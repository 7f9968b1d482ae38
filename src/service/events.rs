//! Event streams: first past events from the store, then live ones; a reader who falls behind goes back to the store. So
//! every event is delivered exactly once and in order, and a slow reader costs no memory.

use std::collections::VecDeque;
use std::sync::Arc;

use tokio::sync::broadcast;
use tokio::sync::broadcast::error::RecvError;

use super::app::App;
use super::error::Error;
use crate::wire::{JobEvent, JobId};

/// Max number of events read from the store at a time.
const BATCH: u32 = 256;

/// Stream of the events of one job until its end, or of all jobs.
pub struct EventStream {
    app: App,
    job: Option<JobId>,
    last: i64,
    live: broadcast::Receiver<Arc<JobEvent>>,
    past: VecDeque<Arc<JobEvent>>,
    behind: bool,
    ended: bool,
    missed: bool,
    /// Number of the newest event when the stream of an ended job began, of which nothing but a gap is left to tell.
    only_gap: Option<i64>,
}

impl App {
    /// Events after number `after`; without it, all events of a job, or of all jobs those from now on.
    ///
    /// # Errors
    /// [`Error::JobNotFound`], [`Error::Internal`].
    pub async fn events(&self, job: Option<JobId>, after: Option<i64>) -> Result<EventStream, Error> {
        let live = self.0.store.subscribe();
        // Read before the events: of a job that ends after this, the end is still to come.
        let has_ended = match job {
            Some(job) => self.0.store.job_state(job).await?.is_ended(),
            None => false,
        };
        let newest = self.0.store.newest_event().await?;
        let is_pruned = match after {
            Some(after) => self.0.store.is_pruned_after(after).await?,
            None => false,
        };
        // A number that was never given is of another database, one before a restore: its reader begins anew.
        let missed = is_pruned || after.is_some_and(|after| after > newest);
        let last = match (after, job) {
            (Some(after), _) => after.min(newest),
            (None, Some(_)) => 0,
            (None, None) => newest,
        };
        let past = VecDeque::new();
        let mut stream =
            EventStream { app: self.clone(), job, last, live, past, behind: true, ended: false, missed, only_gap: None };
        stream.catch_up().await?;
        stream.ended = has_ended && stream.past.is_empty() && !stream.behind;
        // Whoever has seen nothing yet would have got the job's end, were it not pruned.
        stream.missed |= stream.ended && after.is_none();
        // Its reader may have missed the job's end: it is told to read the job anew, once.
        stream.only_gap = (stream.ended && stream.missed).then_some(newest);
        Ok(stream)
    }
}

impl EventStream {
    /// Returns true if events after the requested one have been pruned from the store, or it is not of this store; without one, if none of
    /// an ended job's events is left.
    #[must_use]
    pub fn has_gap(&self) -> bool {
        self.missed
    }

    /// Number of an event to resume after, with which nothing is missed any more; only where the job has ended and nothing but the gap
    /// is left to tell.
    #[must_use]
    pub fn only_gap(&self) -> Option<i64> {
        self.only_gap
    }

    /// Returns true if nothing is left to tell: the job has ended, and all of its events were read.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.ended && self.only_gap.is_none()
    }

    /// Waits for the next event; `None` after a job's last one and when the service stops.
    ///
    /// # Errors
    /// [`Error::Internal`].
    pub async fn next(&mut self) -> Result<Option<Arc<JobEvent>>, Error> {
        let stopping = self.app.stopping();
        loop {
            if self.ended {
                return Ok(None);
            }
            if let Some(event) = self.past.pop_front() {
                self.last = self.last.max(event.id);
                self.ended = self.job.is_some() && event.kind.is_last();
                return Ok(Some(event));
            }
            if self.behind {
                self.catch_up().await?;
                continue;
            }
            tokio::select! {
                () = stopping.cancelled() => return Ok(None),
                event = self.live.recv() => match event {
                    Ok(event) if event.id > self.last && self.job.is_none_or(|job| job == event.job_id) => {
                        self.past.push_back(event);
                    }
                    Ok(_) => {}
                    Err(RecvError::Lagged(_)) => self.behind = true,
                    Err(RecvError::Closed) => return Ok(None),
                },
            }
        }
    }

    async fn catch_up(&mut self) -> Result<(), Error> {
        let batch = self.app.0.store.events_after(self.job, self.last, BATCH).await?;
        self.behind = batch.is_full;
        self.last = batch.through;
        self.past.extend(batch.events);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
