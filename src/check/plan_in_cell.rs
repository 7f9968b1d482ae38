//! A plan in the cell that it was made in: collisions at its stations, and with the part the coverage that it states. Both are
//! derived anew, with the definitions that the planner has: a station is free where [`CollisionScene::check`] finds nothing.

use super::coverage::PlanCoverage;
use super::plan::configuration;
use super::{Reference, measured_as_planned, setup_count, table_from_part, views_in, whole};
use crate::cell::{Cell, CollisionScene, Configuration, Contact, FieldError, Findings};
use crate::planning::context::{Context, PlanError};
use crate::wire::plan::PlanDocument;

/// Extent of the checks without a cell, in words that follow those on the plan.
pub(super) const WITHOUT_CELL: &str =
    " (structure and ranges checked; given a cell, stations and collisions too, and given the part, coverage)";

/// Result for a plan without findings.
pub(super) struct PlanInCell {
    /// Extent of the checks, in words that follow those on the plan.
    pub(super) extent: String,
    /// Share of the asked area that its views measure, where it was derived anew.
    pub(super) measured_of_asked: Option<f64>,
}

/// Checks a plan that is sound by itself and whose stations are at their views.
///
/// # Errors
/// Every collision; without one, the coverage that is not as stated.
pub(super) fn check(
    document: &PlanDocument,
    cell: &Cell,
    reference: &Reference,
    ctx: &Context<'_>,
) -> Result<PlanInCell, Vec<FieldError>> {
    check_collisions(document, cell, reference, ctx)?;
    let coverage = reference.coverage(document, cell, ctx)?;
    let extent = extent(document, cell, reference, &coverage);
    let measured_of_asked = match coverage {
        PlanCoverage::AsStated(measured) => Some(measured),
        PlanCoverage::Unchecked(_) => None,
    };
    Ok(PlanInCell { extent, measured_of_asked })
}

/// Extent of the checks, in words: what was checked, and what was not.
fn extent(document: &PlanDocument, cell: &Cell, reference: &Reference, coverage: &PlanCoverage) -> String {
    let with_part = match (&reference.part, &reference.fixture) {
        (Some(_), Some(_)) => "with the part and its fixture",
        (Some(_), None) if reference.lacks_fixture(document) => "with the part, without its fixture",
        (Some(_), None) => "with the part",
        (None, _) => "without the part",
    };
    let (measured, unchecked) = match coverage {
        PlanCoverage::AsStated(of_asked) => (
            measured_as_planned("views", *of_asked),
            "coverage of regions, by grade, by setup and on independent samples".to_owned(),
        ),
        PlanCoverage::Unchecked(reason) => (String::new(), format!("coverage ({reason})")),
    };
    if document.cell.is_none() {
        return format!(", made without a cell{measured}; not checked: {unchecked}");
    }
    let name = &cell.name;
    format!(
        ", sound in cell {name}: stations, collisions {with_part}{measured}; not checked: {unchecked}, moves between stations \
         (check its program)"
    )
}

/// Requires at every station the clearance that the plan keeps, with the part where it is given.
fn check_collisions(
    document: &PlanDocument,
    cell: &Cell,
    reference: &Reference,
    ctx: &Context<'_>,
) -> Result<(), Vec<FieldError>> {
    if document.cell.is_none() {
        return Ok(());
    }
    let mut findings = Findings::default();
    let clearance_mm = document.params.motion.clearance_mm;
    for setup in 0..setup_count(document) {
        let scene = reference.scene_with(cell, clearance_mm, table_from_part(document, setup).as_ref());
        for (index, view) in views_in(document, setup) {
            let Some(station) = &view.station else { continue };
            ctx.check().map_err(|cancelled| whole(PlanError::from(cancelled).to_string()))?;
            let here = configuration(station);
            if let Some(contact) = scene.check(&here) {
                findings.push(format!("/viewpoints/{index}/station"), too_close(cell, &scene, &contact, &here, clearance_mm));
            }
        }
    }
    findings.into_result()
}

/// Sentence on two bodies that are too close at a station: how far apart they are, against the clearance.
fn too_close(cell: &Cell, scene: &CollisionScene, contact: &Contact, here: &Configuration, clearance_mm: f64) -> String {
    // What the plate runs out by is kept free beside the clearance.
    let runout_mm = cell.turntable.runout_displacement_mm();
    let kept_mm = clearance_mm + runout_mm;
    let nearest = scene.nearest_on(contact, &[*here; 2], kept_mm);
    let found = match nearest.map(|(_, separation)| separation.distance_mm) {
        Some(mm) if mm > 0.0 => format!("are {:.2} mm apart", mm.min(kept_mm)),
        Some(mm) if mm < 0.0 => format!("are {:.2} mm deep in each other", -mm),
        Some(_) => "meet".to_owned(),
        None => "are too close".to_owned(),
    };
    let runout = if runout_mm > 0.0 { format!(", and {runout_mm:.2} mm by which the plate runs out") } else { String::new() };
    format!(
        "collides: {contact} {found}; allowed is {clearance_mm} mm apart and more (params.motion.clearance_mm){runout}; plan \
         again in this cell"
    )
}
