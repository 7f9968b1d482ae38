//! `report.html`, a work instruction: the verdict, how the part lies on the plate, the stops in the robot's order, what is missed
//! and what helps, why to trust it, and everything else as an appendix. It is one file that loads nothing: styles, drawings and
//! pictures are embedded, and there is no script. It is also well-formed XML. Equal inputs give equal bytes; the date is an input.
//!
//! The page is written with the plan at hand; its pictures may be drawn later, from a [`Draft`] alone.
//!
//! Cost: a rendering of the part for each stop (at most 120), two for each setup and three more, in the rayon
//! pool of the caller; those of parts of more than 300 000 triangles cost no more (`rendering/model.rs`).

mod album;
mod appendix;
mod bodies;
mod chart;
mod draft_bytes;
mod drawing;
mod inspection;
mod lay;
pub(super) mod markup;
mod missed;
mod no_plan;
mod outline;
pub(super) mod page;
mod pictures;
mod regions;
mod sections;
mod size;
mod spots;
mod stops;
mod trust;
mod verdict;
mod views;
mod words;

#[cfg(test)]
mod tests;

pub use album::Draft;
pub use draft_bytes::NoDraft;
pub use inspection::{InspectionReport, inspection_html};
pub use no_plan::{NoPlanInput, NoPlanReason, render_no_plan};

use crate::cell::{Cell, Scanner};
use crate::geometry::{Mesh, Preview};
use crate::planning::context::{Cancelled, Context};
use crate::planning::plan::{Outcome, SetupId};
use crate::rendering::SampledModel;
use crate::wire::echo::Echo;
use crate::wire::summary::Summary;
use crate::wire::warnings::FieldWarning;
use crate::wire::words::first_lie;

/// Subject of a report, whether or not a plan is possible: the part and what it was planned for.
#[derive(Clone, Copy)]
pub struct ReportSubject<'a> {
    /// The part.
    pub mesh: &'a Mesh,
    /// The fixture that holds it, in the part's coordinates.
    pub fixture: Option<&'a Mesh>,
    /// SHA-256 of the part's file, lower-case hexadecimal.
    pub part_sha256: &'a str,
    /// Name of the part.
    pub part_name: &'a str,
    /// The scanner that was planned for.
    pub scanner: &'a Scanner,
    /// The cell; `None` for viewpoints only.
    pub cell: Option<&'a Cell>,
    /// Labels, part number and serial number, as given with the job.
    pub echo: &'a Echo,
    /// Time to print on the report, RFC 3339; a plan has none, so it is the caller's to say.
    pub date: Option<&'a str>,
    /// Warnings on the part's size.
    pub size_warnings: &'a [FieldWarning],
}

/// Input of the report of a plan.
#[derive(Clone, Copy)]
pub struct ReportInput<'a> {
    /// The part and what it was planned for.
    pub subject: ReportSubject<'a>,
    /// The plan and the verdict on each sample.
    pub outcome: &'a Outcome,
    /// SHA-256 of `plan.json`, lower-case hexadecimal; empty if it is not known.
    pub plan_sha256: &'a str,
    /// Summary of the plan.
    pub summary: &'a Summary,
    /// Warnings on the plan that stand at its head, those on the part's size excepted.
    pub warnings: &'a [FieldWarning],
}

/// Renders the page.
///
/// # Errors
/// [`Cancelled`].
pub fn render(input: &ReportInput<'_>, ctx: &Context<'_>) -> Result<String, Cancelled> {
    draft(input, None, ctx)?.draw(ctx)
}

/// Writes the page without its pictures. `preview` is that of the mesh to 300 000 triangles, if the caller has it.
///
/// # Errors
/// [`Cancelled`].
pub fn draft(input: &ReportInput<'_>, preview: Option<&Preview>, ctx: &Context<'_>) -> Result<Draft, Cancelled> {
    let (subject, plan) = (&input.subject, &input.outcome.plan);
    let kind = if plan.coverage.is_of_open { "Plan of further views" } else { "Scan plan" };
    let mut album = album::Album::new(SampledModel::new(subject.mesh, &input.outcome.surface, preview, ctx)?);
    let lays: Vec<lay::Lay> = SetupId::number(&plan.setups)
        .map(|(id, setup)| lay::Lay {
            table_from_part: setup.table_from_part,
            turn: plan.turn_into(id),
            first_lie: first_lie(plan.params.part.table_from_part.as_ref(), &setup.table_from_part),
        })
        .collect();
    let body = [
        sections::header(subject, kind, &[]),
        "<main>\n".to_owned(),
        size::notices(subject.size_warnings),
        size::notices_of_plan(input.warnings),
        verdict::section(input, &views::overviews(input, &mut album)),
        regions::section(input),
        lay::section(subject, &lays, &mut album),
        stops::section(input, &mut album, ctx)?,
        missed::section(input, &mut album, ctx.simd_level()),
        trust::section(input),
        appendix::sections(input),
        "</main>\n".to_owned(),
        sections::footer("<code>plan.json</code>, which holds every number at full precision"),
    ];
    Ok(album.into_draft(sections::document(subject, kind, &body.concat())))
}
