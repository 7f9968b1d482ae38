//! Commands to runs. Each is answered once the session has obeyed or refused it, with the run as it then is. Pause and stop need no
//! token: anybody may.

use std::time::Duration;

use super::OpenRun;
use crate::execution::session::{CommandError, Fence, RunHandle, RunState};
use crate::service::app::App;
use crate::service::error::Error;
use crate::wire::RunId;
use crate::wire::run::{ArmRequest, LocatedRequest, OverrideRequest, ReportedState, Run, RunMode};

/// Longest wait for the state that a command leads to.
const SETTLING: Duration = Duration::from_secs(2);

impl App {
    /// Arms a live run: the operator's release of motion.
    ///
    /// # Errors
    /// [`Error::Invalid`], [`Error::RunNotFound`], [`Error::RunStateRefused`], [`Error::RunStopping`], [`Error::LeaseRequired`],
    /// [`Error::TokenRefused`], [`Error::RunRefused`], [`Error::Internal`].
    pub async fn arm_run(&self, id: RunId, request: ArmRequest, token: Option<u64>) -> Result<Run, Error> {
        request.check().map_err(Error::Invalid)?;
        let (open, session) = self.session(id, "armed").await?;
        if request.cell != open.cell {
            let detail = format!("is {:?}; the run is in cell {:?}", request.cell, open.cell);
            return Err(Error::Invalid(vec![crate::cell::FieldError { pointer: "/cell".to_owned(), detail }]));
        }
        if open.mode != RunMode::Live {
            return Err(Error::RunRefused(format!(
                "a run in the mode {} moves no controller and need not be armed",
                open.mode.as_str()
            )));
        }
        let token = self.check_token(&open.cell, token)?;
        let state = session.status().state;
        if state != RunState::Ready {
            return Err(Error::RunStateRefused { run: id, state: state.into(), deed: "armed" });
        }
        // Named before the run is armed, so that its event has the name; a refused request changes nothing.
        let before = open.set_armed_by(&request.operator);
        if let Err(error) = session.arm(token).await {
            open.restore_armed_by(&request.operator, before);
            return Err(refused(id, "armed", error));
        }
        self.run_when(id, SETTLING, |run| run.state != ReportedState::Ready).await
    }

    /// Pauses a run.
    ///
    /// # Errors
    /// [`Error::RunNotFound`], [`Error::RunStateRefused`], [`Error::RunStopping`], [`Error::Internal`].
    pub async fn pause_run(&self, id: RunId) -> Result<Run, Error> {
        let (_, session) = self.session(id, "paused").await?;
        // The session alone is asked: a store that cannot be read, or that is behind, must not leave arm and table moving.
        match session.pause().await {
            // It rests already.
            Ok(()) | Err(CommandError::NotNow { state: RunState::Paused, .. }) => {}
            Err(error) => return Err(refused(id, "paused", error)),
        }
        self.run_when(id, SETTLING, |run| run.state == ReportedState::Paused).await
    }

    /// Resumes a paused run, or begins an armed one.
    ///
    /// # Errors
    /// Errors of [`App::arm_run`].
    pub async fn resume_run(&self, id: RunId, token: Option<u64>) -> Result<Run, Error> {
        let (open, session) = self.session(id, "resumed").await?;
        session.resume(self.fence(&open, token)?).await.map_err(|error| refused(id, "resumed", error))?;
        self.run_when(id, SETTLING, |run| !matches!(run.state, ReportedState::Armed | ReportedState::Paused)).await
    }

    /// Takes a paused or armed run one step on.
    ///
    /// # Errors
    /// Errors of [`App::arm_run`].
    pub async fn step_run(&self, id: RunId, token: Option<u64>) -> Result<Run, Error> {
        let (open, session) = self.session(id, "stepped").await?;
        let before = self.run(id).await?;
        session.step(self.fence(&open, token)?).await.map_err(|error| refused(id, "stepped", error))?;
        let is_on = |run: &Run| (run.state, run.step) != (before.state, before.step);
        self.run_when(id, SETTLING, is_on).await
    }

    /// Changes the speed of a run.
    ///
    /// # Errors
    /// Errors of [`App::arm_run`].
    pub async fn override_run(&self, id: RunId, request: OverrideRequest, token: Option<u64>) -> Result<Run, Error> {
        request.check().map_err(Error::Invalid)?;
        let (open, session) = self.session(id, "changed in speed").await?;
        let token = self.fence(&open, token)?;
        session.set_override(token, request.speed_override).await.map_err(|error| refused(id, "changed in speed", error))?;
        // Of a program's first live run it is capped.
        let in_force = session.speed_override();
        self.run_when(id, SETTLING, |run| run.speed_override.total_cmp(&in_force).is_eq()).await
    }

    /// Tells a run where the part lies.
    ///
    /// # Errors
    /// Errors of [`App::arm_run`].
    pub async fn locate_run(&self, id: RunId, request: LocatedRequest, token: Option<u64>) -> Result<Run, Error> {
        let mut findings = crate::cell::Findings::default();
        request.table_from_part.check("/table_from_part", &mut findings);
        findings.into_result().map_err(Error::Invalid)?;
        let (open, session) = self.session(id, "told where the part lies").await?;
        let token = self.fence(&open, token)?;
        let pose = request.table_from_part.pose();
        session.located(token, pose).await.map_err(|error| refused(id, "told where the part lies", error))?;
        self.run_when(id, SETTLING, |run| run.state != ReportedState::Paused).await
    }

    /// Stops a run, whatever it does; an ended run is not changed.
    ///
    /// # Errors
    /// [`Error::RunNotFound`], [`Error::Internal`].
    pub async fn stop_run(&self, id: RunId) -> Result<Run, Error> {
        let Some(open) = self.0.runs.get(id) else { return self.run(id).await };
        open.stop.cancel();
        if let Some(session) = open.session() {
            session.stop(crate::execution::session::StopCause::Client);
        }
        self.run_when_ended(id, SETTLING).await
    }

    /// The session of a run that has not ended.
    async fn session(&self, id: RunId, deed: &'static str) -> Result<(std::sync::Arc<OpenRun>, RunHandle), Error> {
        let Some(open) = self.0.runs.get(id) else { return Err(self.ended_or_unknown(id, deed).await) };
        match open.session() {
            Some(session) => Ok((open, session)),
            None => Err(Error::RunStateRefused { run: id, state: ReportedState::Preparing, deed }),
        }
    }

    /// Token of a command that moves a live run; none is needed for another.
    fn fence(&self, open: &OpenRun, token: Option<u64>) -> Result<Option<Fence>, Error> {
        if open.mode == RunMode::Live { self.check_token(&open.cell, token).map(Some) } else { Ok(None) }
    }
}

fn refused(run: RunId, deed: &'static str, error: CommandError) -> Error {
    match error {
        CommandError::NotNow { state, .. } => Error::RunStateRefused { run, state: state.into(), deed },
        CommandError::Stopping { cause, .. } => Error::RunStopping { run, deed, cause: cause.to_string() },
        CommandError::Lease(error) => Error::TokenRefused(error.to_string()),
        error @ CommandError::Override(_) => Error::RunRefused(error.to_string()),
    }
}
