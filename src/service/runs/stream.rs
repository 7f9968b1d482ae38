//! Streams of runs: stored events from the database and then live ones, exactly once and in order; between them samples of the
//! measured state, of which a slow reader loses some, and a reader that comes back gets those that are still kept; a new one gets
//! those since the last change of state.

use std::collections::VecDeque;
use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{broadcast, watch};

use crate::execution::session::{LiveEvent, RunHandle};
use crate::service::app::App;
use crate::service::error::Error;
use crate::wire::RunId;
use crate::wire::run::{RunEventDocument, RunSample};

/// Place in the stream of a run: the number of the last stored event, and of the last sample; `12` or `12.340`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RunCursor {
    /// Number of the last stored event.
    pub event: i64,
    /// Number of the last sample.
    pub sample: u64,
}

impl fmt::Display for RunCursor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.sample {
            0 => write!(f, "{}", self.event),
            sample => write!(f, "{}.{sample}", self.event),
        }
    }
}

impl FromStr for RunCursor {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (event, sample) = text.split_once('.').unwrap_or((text, "0"));
        let is_plain = |text: &str| !text.is_empty() && text.bytes().all(|c| c.is_ascii_digit());
        let parsed = event.parse().ok().zip(sample.parse().ok()).filter(|_| is_plain(event) && is_plain(sample));
        parsed.map(|(event, sample)| Self { event, sample }).ok_or_else(|| format!("{text:?} is not the id of an event of a run"))
    }
}

/// Message of a stream, each with the place behind it.
#[derive(Clone, Debug)]
pub enum RunMessage {
    /// A stored event.
    Event(Arc<RunEventDocument>, RunCursor),
    /// A sample of the measured state.
    Sample(Box<RunSample>, RunCursor),
}

/// Stream of a run until its end.
pub struct RunStream {
    app: App,
    run: RunId,
    /// Place behind what was told last.
    at: RunCursor,
    /// Number of the last event that was read from the database.
    through: i64,
    feed: broadcast::Receiver<Arc<RunEventDocument>>,
    past: VecDeque<Arc<RunEventDocument>>,
    samples: VecDeque<LiveEvent>,
    /// The session, once there is one; none for a run that has ended.
    session: Option<watch::Receiver<Option<RunHandle>>>,
    live: Option<broadcast::Receiver<LiveEvent>>,
    behind: bool,
    ended: bool,
    missed: bool,
    /// Place of the newest event when the stream of an ended run began, of which nothing but a gap is left to tell.
    only_gap: Option<RunCursor>,
}

impl App {
    /// Stream of a run, after a place in it; without one, from its beginning.
    ///
    /// # Errors
    /// [`Error::RunNotFound`], [`Error::Internal`].
    pub async fn run_events(&self, run: RunId, after: Option<RunCursor>) -> Result<RunStream, Error> {
        let feed = self.0.runs.subscribe();
        // Read before the events: of a run that ends after this, the end is still to come.
        let has_ended = self.run(run).await?.state.is_ended();
        let session = self.0.runs.get(run).map(|open| open.session.subscribe());
        let newest = self.0.store.newest_run_event().await?;
        let is_pruned = match after {
            Some(after) if has_ended => self.0.store.is_run_event_pruned_after(after.event).await?,
            // Events of an open run are never pruned.
            Some(_) | None => false,
        };
        // A number that was never given is of another database, one before a restore.
        let missed = is_pruned || after.is_some_and(|after| after.event > newest);
        let (is_new, after) = (after.is_none(), after.unwrap_or_default());
        let at = RunCursor { event: after.event.min(newest), ..after };
        let (past, samples) = (VecDeque::new(), VecDeque::new());
        let app = self.clone();
        let mut stream = RunStream {
            app,
            run,
            at,
            through: at.event,
            feed,
            past,
            samples,
            session,
            live: None,
            behind: true,
            ended: false,
            missed,
            only_gap: None,
        };
        stream.catch_up().await?;
        stream.ended = has_ended && stream.past.is_empty() && !stream.behind;
        // Whoever has seen nothing yet would have got the run's end, were it not pruned.
        stream.missed |= stream.ended && is_new;
        // Its reader may have missed the run's end: it is told to read the run anew, once.
        stream.only_gap = (stream.ended && stream.missed).then_some(RunCursor { event: newest, sample: 0 });
        Ok(stream)
    }
}

impl RunStream {
    /// Returns true if events after the requested place may have been pruned from the store, or it is not of this store; without a
    /// place, if none of an ended run's events is left.
    #[must_use]
    pub fn has_gap(&self) -> bool {
        self.missed
    }

    /// Place to resume after, with which nothing is missed any more; only where the run has ended and nothing but the gap is left
    /// to tell.
    #[must_use]
    pub fn only_gap(&self) -> Option<RunCursor> {
        self.only_gap
    }

    /// Returns true if nothing is left to tell: the run has ended, and all of its events were read.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.ended && self.only_gap.is_none()
    }

    /// Waits for what comes next; `None` after the last event and when the service stops.
    ///
    /// # Errors
    /// [`Error::Internal`].
    pub async fn next(&mut self) -> Result<Option<RunMessage>, Error> {
        let stopping = self.app.stopping();
        loop {
            if self.ended {
                return Ok(None);
            }
            if let Some(event) = self.past.pop_front() {
                self.at.event = self.at.event.max(event.id);
                self.ended = event.is_last();
                return Ok(Some(RunMessage::Event(event, self.at)));
            }
            if self.behind {
                self.catch_up().await?;
                continue;
            }
            if let Some(event) = self.samples.pop_front() {
                self.at.sample = event.id;
                if let Some(sample) = sample_of(self.run, &event) {
                    return Ok(Some(RunMessage::Sample(Box::new(sample), self.at)));
                }
                continue;
            }
            if self.attach() {
                continue;
            }
            let is_awaited = self.live.is_none();
            tokio::select! {
                () = stopping.cancelled() => return Ok(None),
                event = self.feed.recv() => match event {
                    Ok(event) if event.run_id == self.run && event.id > self.through => {
                        self.through = event.id;
                        self.past.push_back(event);
                    }
                    Ok(_) => {}
                    Err(RecvError::Lagged(_)) => self.behind = true,
                    Err(RecvError::Closed) => return Ok(None),
                },
                sample = next_sample(&mut self.live) => match sample {
                    Ok(sample) => self.samples.push_back(sample),
                    // A slow reader loses samples, never events.
                    Err(RecvError::Lagged(_)) => {}
                    Err(RecvError::Closed) => (self.live, self.session) = (None, None),
                },
                () = session_begun(&mut self.session, is_awaited) => {}
            }
        }
    }

    /// Begins to listen to the session, if there is one by now; true if it did.
    fn attach(&mut self) -> bool {
        if self.live.is_some() {
            return false;
        }
        let handle = self.session.as_ref().and_then(|session| session.borrow().clone());
        let Some(handle) = handle else { return false };
        let (kept, live) = handle.events_after(self.at.sample);
        // Whoever has seen no sample was told all states so far: samples from before the last of them would lead back.
        let first = if self.at.sample == 0 { begin_of_state(&kept) } else { 0 };
        self.samples.extend(kept.into_iter().skip(first));
        self.live = Some(live);
        true
    }

    async fn catch_up(&mut self) -> Result<(), Error> {
        let batch = self.app.0.store.run_events(self.run, self.through).await?;
        self.behind = batch.is_full;
        self.through = batch.through;
        self.past.extend(batch.events.into_iter().map(Arc::new));
        Ok(())
    }
}

/// Place of the first event in the state of the last.
fn begin_of_state(events: &[LiveEvent]) -> usize {
    let state = events.last().map(|event| event.status.state);
    events.iter().rposition(|event| Some(event.status.state) != state).map_or(0, |before| before + 1)
}

async fn next_sample(live: &mut Option<broadcast::Receiver<LiveEvent>>) -> Result<LiveEvent, RecvError> {
    match live {
        Some(live) => live.recv().await,
        None => std::future::pending().await,
    }
}

/// Waits for the session of a run, where one is still awaited.
async fn session_begun(session: &mut Option<watch::Receiver<Option<RunHandle>>>, is_awaited: bool) {
    match session {
        // Closed with the run: its last event follows.
        Some(waiting) if is_awaited => {
            if waiting.changed().await.is_err() {
                *session = None;
            }
        }
        Some(_) | None => std::future::pending().await,
    }
}

/// The measured part of a session's event, if it has one.
fn sample_of(run_id: RunId, event: &LiveEvent) -> Option<RunSample> {
    let (measured, pose) = (event.measured.as_ref()?, event.base_from_scanner.as_ref()?);
    Some(RunSample {
        run_id,
        sequence: event.id,
        state: event.status.state.into(),
        elapsed_secs: event.secs,
        step: event.step.unwrap_or_default(),
        measured: measured.into(),
        base_from_scanner: pose.into(),
        deviation_deg: event.off_path_rad.unwrap_or_default().to_degrees(),
    })
}

#[cfg(test)]
mod tests {
    use super::RunCursor;

    #[test]
    fn a_place_reads_back_and_nothing_else_is_one() {
        for (event, sample, text) in [(0, 0, "0"), (12, 0, "12"), (12, 340, "12.340")] {
            let cursor = RunCursor { event, sample };
            assert_eq!((cursor.to_string().as_str(), text.parse()), (text, Ok(cursor)));
        }
        for text in ["", ".", "1.", ".1", "-1", "+1", "1.2.3", "1.-2", "a", "99999999999999999999"] {
            text.parse::<RunCursor>().expect_err(text);
        }
    }
}
