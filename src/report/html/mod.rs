//! `report.html`, the first thing that an operator looks at. It is one file that loads nothing: styles, drawings and pictures
//! are embedded, and there is no script. It is also well-formed XML. Equal inputs give equal bytes.
//!
//! Cost: about a dozen renderings of the part, in the rayon pool of the caller.

mod camera;
mod chart;
mod depth_buffer;
mod image;
pub(super) mod markup;
pub(super) mod page;
pub(super) mod palette;
mod pictures;
mod quantise;
mod regions;
mod renderer;
mod sections;
mod shading;
mod size;
mod views;
mod words;

#[cfg(test)]
mod tests;

use crate::cell::Scanner;
use crate::geometry::Mesh;
use crate::planning::context::{Cancelled, Context};
use crate::planning::plan::Outcome;
use crate::wire::echo::Echo;
use crate::wire::warnings::FieldWarning;

/// Input of a report.
#[derive(Clone, Copy)]
pub struct ReportInput<'a> {
    /// The plan and the verdict on each sample.
    pub outcome: &'a Outcome,
    /// The planned mesh.
    pub mesh: &'a Mesh,
    /// The scanner that was planned for.
    pub scanner: &'a Scanner,
    /// Name of the cell; `None` for viewpoints only.
    pub cell_name: Option<&'a str>,
    /// Predicted cycle time; `None` without a program.
    pub cycle_secs: Option<f64>,
    /// Name of the part.
    pub part_name: &'a str,
    /// Labels, part number and serial number, as given with the job.
    pub echo: &'a Echo,
    /// Warnings on the part's size.
    pub size_warnings: &'a [FieldWarning],
}

/// Renders the page.
///
/// # Errors
/// [`Cancelled`].
pub fn render(input: &ReportInput<'_>, ctx: &Context<'_>) -> Result<String, Cancelled> {
    let scene = renderer::Scene::new(input.mesh, &input.outcome.surface, ctx)?;
    let body = [
        sections::header(input),
        "<main>\n".to_owned(),
        size::notices(input.size_warnings),
        sections::headline(input),
        regions::section(input),
        sections::advice(input),
        views::overviews(input, &scene),
        views::chosen(input, &scene, ctx)?,
        sections::curve(input),
        sections::certificate(input),
        sections::at_risk(input),
        views::misses(input, &scene),
        sections::registration(input),
        sections::missed(input),
        sections::order(input),
        sections::obstructions(input),
        sections::settings(input),
        "</main>\n".to_owned(),
        sections::footer(),
    ];
    Ok(page::document(&format!("Scan plan: {}", input.part_name), &body.concat()))
}
