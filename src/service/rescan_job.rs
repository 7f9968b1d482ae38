//! Plans of further views, from the state that an inspection left.

use crate::inspection::rescan::{Rescan, RescanInput, rescan};
use crate::planning::PlanInput;
use crate::planning::context::{Context, NoPlan, PlanError};
use crate::planning::params::RescanParams;
use crate::planning::plan::Outcome;
use crate::planning::surface::requirements;
use crate::wire::inspection::RescanState;

/// State of the file that inspections leave for the next round.
pub const RESCAN_STATE_FILE: &str = "rescan.json";

/// A round of further views.
#[derive(Clone, Debug, PartialEq)]
pub struct RescanJob {
    /// State of the part.
    pub state: RescanState,
    /// Rules on when further views are worth it.
    pub params: RescanParams,
}

impl RescanJob {
    /// Chooses and plans the further views.
    ///
    /// # Errors
    /// [`PlanError`]; a state that is not of this part.
    pub fn rescan(&self, input: &PlanInput<'_>, ctx: &Context<'_>) -> Result<Rescan, PlanError> {
        let unread = |error| PlanError::BadParams(vec![error]);
        let (measured, hopeless) = (self.state.measured().map_err(unread)?, self.state.hopeless().map_err(unread)?);
        let plan_params = &self.state.plan_params;
        let surface = requirements::sampled(input.mesh, plan_params, plan_params.seed, ctx)?;
        self.state.check_samples(surface.sample_mm.len()).map_err(unread)?;
        let part = RescanInput {
            input,
            params: plan_params,
            target_of_mm2: self.state.target_of_mm2,
            surface: &surface,
            measured: &measured,
            hopeless: &hopeless,
            model: &self.state.model(),
            rounds: self.state.rounds,
        };
        rescan(&part, &self.params, ctx)
    }

    /// The plan of the further views.
    ///
    /// # Errors
    /// Errors of [`RescanJob::rescan`]; [`NoPlan::NoFurtherView`] where no view is worth it.
    pub fn plan(&self, input: &PlanInput<'_>, ctx: &Context<'_>) -> Result<Outcome, PlanError> {
        let found = self.rescan(input, ctx)?;
        found.outcome.ok_or(PlanError::NoPlan(NoPlan::NoFurtherView {
            measured_of_asked: found.measured,
            left_of_asked: found.left,
            hopeless_of_asked: found.hopeless,
            rule: found.stopped_because.as_str(),
        }))
    }
}
