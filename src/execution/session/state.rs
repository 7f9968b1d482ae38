//! States of a run and the events that lead from one to another: a total function without time or devices.
//!
//! ```text
//! preparing → ready → armed → running ⇄ paused
//!     any of them → stopped | failed        running → done        preparing, ready → done (a dry run)
//! ```
//! A stop that is sent changes no state, but its reason, until arm and table are at rest.
//! Nothing leads out of `done`, `stopped` and `failed`, and nothing but a client's command out of `paused` into motion.

use super::cause::{PauseCause, RunReason, StopCause};

/// State of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum RunState {
    /// Connects, reads and checks.
    Preparing,
    /// Waits to be armed.
    Ready,
    /// May move, and has not begun to.
    Armed,
    /// Carries out steps.
    Running,
    /// Stands still between two commands of its client.
    Paused,
    /// Carried out every step.
    Done,
    /// Was stopped: by somebody, or by the loss of something that motion needs.
    Stopped,
    /// Could not do what the program says.
    Failed,
}

impl RunState {
    /// Every state.
    pub const ALL: [Self; 8] =
        [Self::Preparing, Self::Ready, Self::Armed, Self::Running, Self::Paused, Self::Done, Self::Stopped, Self::Failed];

    /// Name in interfaces.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Preparing => "preparing",
            Self::Ready => "ready",
            Self::Armed => "armed",
            Self::Running => "running",
            Self::Paused => "paused",
            Self::Done => "done",
            Self::Stopped => "stopped",
            Self::Failed => "failed",
        }
    }

    /// Returns true if nothing follows.
    #[must_use]
    pub const fn is_final(self) -> bool {
        matches!(self, Self::Done | Self::Stopped | Self::Failed)
    }

    /// Returns true if the devices may hold the right to move.
    #[must_use]
    pub const fn is_armed(self) -> bool {
        matches!(self, Self::Armed | Self::Running | Self::Paused)
    }
}

/// State of a run, with its reason.
#[derive(Clone, Debug, PartialEq)]
pub struct RunStatus {
    /// State.
    pub state: RunState,
    /// Reason.
    pub reason: RunReason,
}

/// Events of a run.
#[derive(Clone, Debug, PartialEq)]
pub enum RunEvent {
    /// Devices and program were found in order.
    Prepared,
    /// The devices gave the right to move.
    Armed,
    /// The first step begins.
    Started,
    /// Motion has come to rest for a while.
    Paused(PauseCause),
    /// A client goes on.
    Resumed,
    /// Every step is done.
    Finished,
    /// A dry run has read what it wanted.
    Read,
    /// A stop is asked for, for an end with that cause, or for a pause.
    Stopping(Option<StopCause>),
    /// Something ends it.
    Stopped(StopCause),
}

impl RunStatus {
    /// Status that a run begins in.
    pub const FIRST: Self = Self { state: RunState::Preparing, reason: RunReason::Connecting };

    /// Status after `event`; `None` where the event does not happen in this state, and changes nothing.
    #[must_use]
    pub fn after(&self, event: RunEvent) -> Option<Self> {
        let state = self.state;
        let (state, reason) = match event {
            RunEvent::Stopped(cause) if !state.is_final() => (cause.ends_in(state), RunReason::Ended(cause)),
            RunEvent::Stopping(cause) if !state.is_final() => (state, RunReason::Stopping(cause)),
            RunEvent::Prepared if state == RunState::Preparing => (RunState::Ready, RunReason::AwaitsArm),
            RunEvent::Armed if state == RunState::Ready => (RunState::Armed, RunReason::AwaitsStart),
            RunEvent::Started if state == RunState::Armed => (RunState::Running, RunReason::UnderWay),
            RunEvent::Paused(cause) if state == RunState::Running => (RunState::Paused, RunReason::Paused(cause)),
            RunEvent::Resumed if state == RunState::Paused => (RunState::Running, RunReason::UnderWay),
            RunEvent::Finished if state == RunState::Running => (RunState::Done, RunReason::AllSteps),
            RunEvent::Read if matches!(state, RunState::Preparing | RunState::Ready) => (RunState::Done, RunReason::Read),
            RunEvent::Stopped(_)
            | RunEvent::Prepared
            | RunEvent::Armed
            | RunEvent::Started
            | RunEvent::Paused(_)
            | RunEvent::Resumed
            | RunEvent::Finished
            | RunEvent::Read
            | RunEvent::Stopping(_) => return None,
        };
        Some(Self { state, reason })
    }
}

#[cfg(test)]
mod tests;
