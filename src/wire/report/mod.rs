//! `report.html`: what an operator looks at first. One file, nothing fetched: styles, drawings and pictures are inside,
//! and there is no script. Written so that it is also well-formed XML. Same input, same bytes.
//!
//! Cost: about a dozen renderings of the part; they share the rayon pool that it is called in.

mod camera;
mod chart;
mod depth_buffer;
mod image;
pub(super) mod markup;
pub(super) mod page;
pub(super) mod palette;
mod pictures;
mod quantise;
mod renderer;
mod sections;
mod shading;
mod views;
mod words;

#[cfg(test)]
mod tests;

use crate::cell::Scanner;
use crate::geometry::Mesh;
use crate::planning::context::{Cancelled, Context};
use crate::planning::plan::Outcome;
use crate::wire::echo::Echo;

/// Everything that a report tells.
#[derive(Clone, Copy)]
pub struct ReportInput<'a> {
    /// The plan and what became of each sample.
    pub outcome: &'a Outcome,
    /// The planned mesh.
    pub mesh: &'a Mesh,
    /// The scanner planned for.
    pub scanner: &'a Scanner,
    /// Name of the cell; `None` for viewpoints alone.
    pub cell_name: Option<&'a str>,
    /// Predicted cycle time, where there is a program.
    pub cycle_secs: Option<f64>,
    /// Name of the part.
    pub part_name: &'a str,
    /// Labels, part number and serial as given with the job.
    pub echo: &'a Echo,
}

/// The page.
///
/// # Errors
/// [`Cancelled`].
pub fn html(input: &ReportInput<'_>, ctx: &Context<'_>) -> Result<String, Cancelled> {
    let scene = renderer::Scene::new(input.mesh, &input.outcome.surface, ctx)?;
    let body = [
        sections::header(input),
        "<main>\n".to_owned(),
        sections::headline(input),
        views::overviews(input, &scene),
        views::chosen(input, &scene, ctx)?,
        sections::curve(input),
        sections::certificate(input),
        views::misses(input, &scene),
        sections::missed(input),
        sections::order(input),
        sections::obstructions(input),
        sections::settings(input),
        "</main>\n".to_owned(),
        sections::footer(),
    ];
    Ok(page::document(&format!("Scan plan: {}", input.part_name), &body.concat()))
}
