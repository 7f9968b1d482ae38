//! A plan, and with its surroundings what it states of them: collisions at its stations, and with the part its placement and the
//! coverage. All are derived anew, with the definitions that the planner has: a station is free where [`CollisionScene::check`]
//! finds nothing, a placement where [`CollisionScene::placement_contact`] does.

use serde_json::Value;

use super::coverage::{PlanCoverage, beside_share};
use super::place::CheckPlace;
use super::plan::{self, configuration};
use super::{Reference, Sound, measured_as_planned, read_known, setup_count, table_from_part, views_in, whole};
use crate::cell::{Cell, CollisionScene, Configuration, Contact, FieldError, Findings};
use crate::geometry::Mesh;
use crate::planning::context::{Context, PlanError};
use crate::wire::plan::{PartDocument, PlanDocument};
use crate::wire::warnings;
use crate::wire::words::counted;

/// Extent of the checks without a cell, in words that follow those on the plan.
const WITHOUT_CELL: &str =
    " (structure and ranges checked; given a cell, stations and collisions too, and given the part, coverage)";
/// Statements on coverage that are not derived anew where others are.
const OTHER_COVERAGE: &str = "coverage of regions, by grade, by setup and on independent samples";
/// Tolerance of a sum of decimals, mm.
const ROUNDING_MM: f64 = 1e-9;
/// Relative tolerance of what is told of a part, which went through a file.
const SAME: f64 = 1e-6;

/// Checks the document of a plan.
///
/// # Errors
/// Every finding in the document and in its surroundings; where there is none every collision; without one, the coverage that
/// is not as stated.
pub(super) fn check(
    value: &Value,
    place: Option<CheckPlace<'_>>,
    reference: &Reference,
    mut sound: Sound,
    ctx: &Context<'_>,
) -> Result<Sound, Vec<FieldError>> {
    let document: PlanDocument = read_known(value)?;
    plan::check(&document, place)?;
    sound.verify("sums: areas, shares, grades, missed area and times add up; ids and sequence agree");
    plan::params::tell(&document, &mut sound);
    let extent = match place {
        None => {
            sound.leave("cell, scanner and stations", "give the cell that it was made in");
            sound.leave("coverage", "give the cell and the part");
            WITHOUT_CELL.to_owned()
        }
        Some(place) => check_in(&document, place, reference, &mut sound, ctx)?,
    };
    sound.warnings = warnings::of_params(&document.params, "/params");
    // The size of the part is in the plan, the unit of its file is not: what was said of it stands.
    sound.warnings.extend(document.warnings.iter().filter(|warning| warning.pointer == "/part/bbox_mm").cloned());
    sound.warnings.extend(place.and_then(CheckPlace::cell).map_or_else(Vec::new, |cell| warnings::of_sight(cell, "/cell")));
    Ok(sound.described(format!("plan with {}{extent}", counted(document.viewpoints.len(), "viewpoint"))))
}

/// Checks a plan that is sound by itself and whose stations are at their views; returns the extent of the checks in words.
fn check_in(
    document: &PlanDocument,
    place: CheckPlace<'_>,
    reference: &Reference,
    sound: &mut Sound,
    ctx: &Context<'_>,
) -> Result<String, Vec<FieldError>> {
    if let Some(part) = &reference.part {
        check_part_facts(&document.part, part)?;
        sound.verify("part.area_mm2 and part.bbox_mm: by the part");
    }
    let with_part = reference.with_part(reference.lacks_fixture(document));
    match place {
        CheckPlace::Cell(cell) => {
            check_collisions(document, cell, reference, ctx)?;
            sound.verify("cell and scanner: names, optics, poses and calibration of the given cell");
            sound.verify("stations: limits of the axes, and the scanner at its viewpoint");
            sound.verify(format!("stations: clearance from everything, {with_part}"));
            if reference.part.is_some() {
                sound.verify("placement: the part meets nothing as it lies, nor what stands below the plate as the table turns");
            }
            sound.leave("posture, singularity margin and clearance of stations", "not derived anew");
            sound.leave("moves between stations", "check the program of the plan");
        }
        CheckPlace::NoCell(Some(scanner)) => sound.verify(format!("scanner: optics, by scanner {}", scanner.name)),
        CheckPlace::NoCell(None) => sound.leave("scanner", "give the scanner that it was planned with"),
    }
    let coverage = reference.coverage(document, place, ctx)?;
    let extent = extent(document, place, with_part, &coverage);
    match coverage {
        PlanCoverage::AsStated { of_asked, is_on_same_samples, other_engine } => {
            sound.measured_of_asked = Some(of_asked);
            sound.verify("coverage.of_asked: by the viewpoints, within 0.0005");
            if is_on_same_samples {
                sound.verify("coverage.asked_area_mm2: by params.part, params.regions and the part");
            } else {
                let reason = "these parameters give another number of samples than the plan has: another release made it, or \
                              they were changed";
                sound.leave("params.part, params.regions and coverage.asked_area_mm2", reason);
            }
            sound.unverified.extend(other_engine);
            sound.leave(OTHER_COVERAGE, "not derived anew");
        }
        PlanCoverage::Unchecked(reason) => sound.leave("coverage", reason),
    }
    Ok(extent)
}

/// Extent of the checks, in words that follow those on the plan: what was checked, and what was not.
fn extent(document: &PlanDocument, place: CheckPlace<'_>, with_part: &str, coverage: &PlanCoverage) -> String {
    let (measured, unchecked) = match coverage {
        PlanCoverage::AsStated { of_asked, other_engine, .. } => {
            let measured = measured_as_planned("views", *of_asked) + &beside_share(other_engine.as_ref());
            (measured, OTHER_COVERAGE.to_owned())
        }
        PlanCoverage::Unchecked(reason) => (String::new(), format!("coverage ({reason})")),
    };
    let choice = "choice of views by its params (plan again)";
    match place.cell().filter(|_| document.cell.is_some()) {
        None => format!(", made without a cell{measured}; not checked: {unchecked}, {choice}"),
        Some(cell) => format!(
            ", sound in cell {}: stations, collisions {with_part}{measured}; not checked: {unchecked}, moves between stations \
             (check its program), {choice}",
            cell.name
        ),
    }
}

/// Requires the area and the place of the part in its frame, whose file and size are known to be the planned ones.
fn check_part_facts(planned: &PartDocument, part: &Mesh) -> Result<(), Vec<FieldError>> {
    let mut findings = Findings::default();
    let (area_mm2, aabb) = (part.area_mm2(), part.aabb());
    let is_same_area = (area_mm2 - planned.area_mm2).abs() <= SAME * area_mm2;
    findings
        .require(is_same_area, "/part/area_mm2", || format!("is {} mm²; that of the part is {area_mm2} mm²", planned.area_mm2));
    let size_mm = aabb.extent_mm().norm().max(1.0);
    for axis in 0..3 {
        let (stated_mm, found_mm) = (planned.bbox_mm.min[axis], aabb.min[axis]);
        let is_same_place = (stated_mm - found_mm).abs() <= SAME * size_mm.max(found_mm.abs());
        findings.require(is_same_place, format!("/part/bbox_mm/min/{axis}"), || {
            format!("is {stated_mm} mm; that of the part is {found_mm} mm")
        });
    }
    findings.into_result()
}

/// Requires of every setup a placement in which the part meets nothing, where it is given, and at every station the clearance
/// that the plan keeps.
fn check_collisions(
    document: &PlanDocument,
    cell: &Cell,
    reference: &Reference,
    ctx: &Context<'_>,
) -> Result<(), Vec<FieldError>> {
    let mut findings = Findings::default();
    let clearance_mm = document.params.motion.clearance_mm;
    for setup in 0..setup_count(document) {
        ctx.check().map_err(|cancelled| whole(PlanError::from(cancelled).to_string()))?;
        let scene = reference.scene_with(cell, clearance_mm, table_from_part(document, setup).as_ref());
        // No check of a station tests part and fixture against what stands below the plate, on which they may lie.
        if let Some(contact) = reference.part.as_ref().and_then(|_| scene.placement_contact()) {
            let owner = if document.setups.is_empty() { "/cell".to_owned() } else { format!("/setups/{setup}") };
            let detail =
                format!("lets {contact} meet, as it lies or as the table turns; move the part, or what it meets, and plan again");
            findings.push(format!("{owner}/table_from_part"), detail);
        }
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
        Some(mm) if mm > 0.0 => apart(mm, kept_mm),
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

/// Distance of two bodies that were found closer than `kept_mm`, in words: two decimals that would not be less tell that it is less.
fn apart(distance_mm: f64, kept_mm: f64) -> String {
    let told_mm = (distance_mm * 100.0).round() / 100.0;
    if told_mm < kept_mm - ROUNDING_MM {
        format!("are {told_mm:.2} mm apart")
    } else {
        format!("are less than {kept_mm:.2} mm apart")
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use nalgebra::Isometry3;

    use super::*;
    use crate::cell::{Body, PoseSpec, Presets, Shape, SpecLibrary};
    use crate::geometry::{Part, Pose, Table};
    use crate::planning::context::Silent;
    use crate::planning::params::PlanParams;
    use crate::planning::{PlanInput, plan};
    use crate::testing::box_mesh;
    use crate::wire::echo::Echo;
    use crate::wire::plan::CellDocument;

    /// Parameters of a plan of two views, quickly made.
    fn quick() -> PlanParams {
        let mut params = PlanParams::default();
        (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.05), Some(20.0));
        (params.candidates.even_directions, params.selection.max_views, params.limits.camera_deg) =
            (Some(24), Some(2), Some(50.0));
        (params.missed.remedies, params.missed.advice, params.robust.pose_error) = (0, false, None);
        params
    }

    /// A plan of views without stations, its part lying on the plate of `cell` as the frames have it.
    fn document(part: &Mesh, cell: &Cell, ctx: &Context<'_>) -> PlanDocument {
        let input = PlanInput { mesh: part, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: None, roadmaps: None };
        let outcome = plan(&input, &quick(), ctx).expect("a plan");
        let placed = CellDocument {
            name: cell.name.clone(),
            base_from_table: PoseSpec::from(&cell.base_from_table),
            table_from_part: PoseSpec::from(&Pose::<Table, Part>::identity()),
            flange_from_scanner: PoseSpec::from(&cell.flange_from_scanner),
            robot: cell.robot.name.clone(),
            turntable: cell.turntable.name.clone(),
            calibrated: None,
        };
        PlanDocument::new(&outcome, &cell.scanner, Some(placed), Echo::default())
    }

    /// The figure is another query's than the decision, and was told as the distance that is allowed.
    #[test]
    fn bodies_that_are_too_close_are_never_told_as_far_apart_as_is_allowed() {
        let told = [4.984, 4.996, 5.0, 5.0004].map(|distance_mm| apart(distance_mm, 5.0));
        assert_eq!(
            told,
            ["are 4.98 mm apart", "are less than 5.00 mm apart", "are less than 5.00 mm apart", "are less than 5.00 mm apart"]
        );
        assert_eq!([apart(5.018, 5.0 + 0.02), apart(5.014, 5.0 + 0.02)], ["are less than 5.02 mm apart", "are 5.01 mm apart"]);
    }

    /// The part hangs down over the rim of the plate, and a wall of the table stands a quarter turn away from it.
    #[test]
    fn a_part_that_runs_into_what_stands_below_the_plate_as_the_table_turns_is_refused() {
        let never = AtomicBool::new(false);
        let ctx = Context::new(&never, &Silent);
        let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("it is valid");
        let part = box_mesh([200.0, -10.0, -50.0], [240.0, 10.0, 50.0]);
        let planned = document(&part, &cell, &ctx);
        let wall = Body {
            name: "wall".into(),
            owner_from_body: Isometry3::translation(0.0, -220.0, -40.0),
            shape: Shape::Box { size_mm: [40.0; 3] },
        };
        let walled = Cell { table_bodies: vec![wall], ..cell.clone() };
        let with_part = Reference { part: Some(part), ..Reference::default() };
        let found = |cell: &Cell, reference: &Reference| {
            let errors = check_collisions(&planned, cell, reference, &ctx).err().unwrap_or_default();
            errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
        };
        assert_eq!((found(&cell, &with_part), found(&walled, &Reference::default())), (String::new(), String::new()));
        let told = found(&walled, &with_part);
        assert!(told.starts_with("/cell/table_from_part: lets wall and part meet") && told.lines().count() == 1, "{told}");
    }
}
