//! Table of all candidates, with what each that was evaluated measures and how well; made where a job asks for it.
//!
//! Rows of candidates that the cell cannot take lack what usable ones measure ([`visibility::cast`]), and those of candidates
//! that were dropped as not needed were not kept: both are cast again here, so that the plan is the same with and without the
//! table.

use std::mem;

use rayon::prelude::*;

use super::Surroundings;
use crate::planning::candidates::{Candidate, Rejection};
use crate::planning::context::{Cancelled, Context};
use crate::planning::plan::{CandidateFate, CandidateTable, Fate, TableEntry};
use crate::planning::problem::ViewPlanningProblem;
use crate::planning::setups::Setup;
use crate::planning::visibility::{self, Occluders, Row};

/// Makes the table of a problem, whose candidates and rows it takes; `fates` are those of the candidates that no filter
/// dropped.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn of(
    problem: &mut ViewPlanningProblem<'_>,
    fates: Vec<CandidateFate>,
    surroundings: &Surroundings<'_>,
    ctx: &Context<'_>,
) -> Result<CandidateTable, Cancelled> {
    let usable: Vec<bool> = problem.candidates.indices().map(|candidate| problem.blocked(candidate).is_none()).collect();
    let (candidates, rows) = (mem::take(&mut problem.candidates), mem::take(&mut problem.matrix.rows));
    let remaining = candidates.remaining.into_iter().zip(fates).zip(rows.into_iter().zip(usable));
    // On every sample, candidates that were not chosen have rows of what the views miss alone.
    let some_alone = problem.chosen_on.is_part();
    let remaining = remaining.map(|((candidate, fate), (row, usable))| {
        let is_partial = !usable || some_alone && fate.view.is_none();
        (TableEntry { candidate, fate, row: Some(row) }, is_partial)
    });
    let rejected =
        candidates.rejected.into_iter().map(|(candidate, reason)| (dropped(candidate, reason), reason.is_of_evaluated()));
    let (mut entries, is_partial): (Vec<TableEntry>, Vec<bool>) = remaining.chain(rejected).unzip();
    let partial: Vec<usize> = is_partial.iter().enumerate().filter(|(_, partial)| **partial).map(|(at, _)| at).collect();
    for (at, mut row) in partial.iter().zip(rows_of(problem, &partial, &entries, surroundings.occluders, ctx)?) {
        take_out_hidden(problem, &entries[*at], &mut row, surroundings.setups, ctx)?;
        entries[*at].row = Some(row);
    }
    grade(problem, &mut entries, ctx)?;
    entries.sort_unstable_by_key(|entry| entry.candidate.id);
    Ok(CandidateTable { setups: problem.setups.clone(), entries })
}

fn dropped(candidate: Candidate, reason: Rejection) -> TableEntry {
    TableEntry { candidate, fate: CandidateFate { fate: Fate::Dropped, view: None, rejection: Some(reason) }, row: None }
}

/// Whole rows of some of the entries.
fn rows_of(
    problem: &ViewPlanningProblem<'_>,
    of: &[usize],
    entries: &[TableEntry],
    occluders: &Occluders,
    ctx: &Context<'_>,
) -> Result<Vec<Row>, Cancelled> {
    let poses: Vec<_> = of.iter().map(|at| entries[*at].candidate.part_from_scanner).collect();
    let (usable, scanner) = (vec![true; poses.len()], problem.input.scanner);
    let matrix = visibility::cast(&problem.surface, &poses, &usable, scanner, occluders, problem.params, &ctx.silent())?;
    Ok(matrix.rows)
}

/// Takes out of the row of a candidate that the cell can take what obstacles hide from it.
fn take_out_hidden(
    problem: &ViewPlanningProblem<'_>,
    entry: &TableEntry,
    row: &mut Row,
    setups: &[Setup<'_>],
    ctx: &Context<'_>,
) -> Result<(), Cancelled> {
    let Candidate { part_from_scanner: pose, setup, .. } = &entry.candidate;
    let scene = setups[setup.index()].scene.as_ref().filter(|scene| !scene.sight().has_no_obstacles());
    let can_be_taken = entry.fate.rejection.is_none_or(Rejection::is_of_evaluated);
    let Some(scene) = scene.filter(|_| can_be_taken) else { return Ok(()) };
    if let Some(Ok(mut stations)) = scene.reach(&[*pose], &ctx.silent())?.pop() {
        scene.keep_in_sight(&problem.surface, pose, &mut stations, row, ctx)?;
    }
    Ok(())
}

/// Adds the quality to rows that a selection by area alone left without it.
fn grade(problem: &ViewPlanningProblem<'_>, entries: &mut [TableEntry], ctx: &Context<'_>) -> Result<(), Cancelled> {
    entries.par_iter_mut().try_for_each(|entry| {
        ctx.check()?;
        let pose = &entry.candidate.part_from_scanner;
        let ungraded = entry.row.take_if(|row| row.quality().is_none());
        let graded = ungraded.map(|row| visibility::grade(&problem.surface, pose, problem.input.scanner, problem.params, &row));
        entry.row = graded.or(entry.row.take());
        Ok(())
    })
}
