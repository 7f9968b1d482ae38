//! Doubts about a plan that come before its figures. The one place that states which of them has the title and which the best action.

use super::action::{StandingRemedy, another_home, placed_to_stand};
use super::missed::with_home_remedy;
use super::{PlanLevel, Summary};
use crate::wire::warnings::{FieldWarning, WarningCode};

/// Doubts about a plan, which a summary tells before its figures. The default has none.
#[derive(Clone, Copy, Debug, Default)]
pub struct PlanDoubts<'a> {
    /// Request to check the unit of a part of an implausible size: a plan of a part of another size is of no use, however good.
    pub unit_question: Option<&'a str>,
    /// Number of setups in which the part would tip over.
    pub unstable_setups: usize,
    /// Way to place the part so that it stands, where it would tip over: all but its size depends on how it lies.
    pub standing: Option<&'a StandingRemedy>,
    /// Warnings on the plan, of which that on a blocked home counts.
    pub warnings: &'a [FieldWarning],
}

impl Summary {
    /// The summary of a plan with these doubts.
    ///
    /// Title: the question on the unit, else that the part tips over, else what is measured. With either of the first two, a plan that can be
    /// executed is not ready.
    ///
    /// Best action: none while the unit is in question, else to place the part so that it stands, else another home, else that of the plan.
    /// Another home is also the fix of all that is missed for want of a path, whatever the best action.
    #[must_use]
    pub fn with_doubts(mut self, doubts: &PlanDoubts<'_>) -> Self {
        let of_asked = 1.0 - self.missed_of_asked;
        let tips_over = doubts.unstable_setups > 0 && self.level != PlanLevel::NotExecutable;
        let unstable = || tips_over.then(|| unstable_title(self.setups, doubts.unstable_setups));
        if let Some(title) = doubts.unit_question.map(str::to_owned).or_else(unstable) {
            self.title = title;
            self.level = if self.level == PlanLevel::Ready { PlanLevel::Limited } else { self.level };
        }
        let home = home_remedy(doubts.warnings);
        self.action = match (doubts.unit_question, doubts.standing, &home) {
            (Some(_), _, _) => None,
            (None, Some(remedy), _) => Some(placed_to_stand(remedy, of_asked)),
            (None, None, Some(remedy)) => Some(another_home(remedy, of_asked)),
            (None, None, None) => self.action,
        };
        if let Some(remedy) = home {
            self.missed = with_home_remedy(self.missed, &remedy, self.of_open);
        }
        self
    }
}

/// Title of the summary of a plan in so many of whose setups the part would tip over, in place of what is measured.
fn unstable_title(setups: usize, unstable: usize) -> String {
    match setups {
        0 | 1 => {
            "Not ready to scan: the part does not stand stably as placed and would tip over; plan with the fixture that holds it \
                  (part.fixture_mesh), or lay it on a side on which it stands (part.table_from_part, --up)"
                .to_owned()
        }
        setups => format!(
            "Not ready to scan: the part does not stand stably in {unstable} of {setups} setups and would tip over; lay it on sides on \
             which it stands (part.table_from_part, part.resting_poses)"
        ),
    }
}

/// Remedy of a blocked home, in plain text as the sentences of a summary are; `None` where the home is free.
fn home_remedy(warnings: &[FieldWarning]) -> Option<String> {
    let blocked = warnings.iter().find(|warning| warning.code == WarningCode::HomeBlocked)?;
    Some(blocked.remedy.replace('`', ""))
}
