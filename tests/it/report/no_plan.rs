//! The report of a job for which no plan is possible: from the planner's own finding, with pictures of what is in the way.

use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use vantage::cell::{Body, Cell, Shape};
use vantage::geometry::{Mesh, Pose};
use vantage::planning::context::{Context, NoPlan, PlanError, Silent};
use vantage::planning::params::{CandidateParams, PlanParams};
use vantage::planning::{PlanInput, plan};
use vantage::report::html::{NoPlanInput, NoPlanReason, ReportSubject, render_no_plan};
use vantage::report::no_plan_text;
use vantage::wire::echo::Echo;

use super::default_cell;
use super::markup::{data_uris, well_formed};
use crate::support::box_mesh;

fn block() -> Mesh {
    box_mesh([-20.0, -20.0, 0.0], [20.0, 20.0, 40.0])
}

/// The default cell with a wall around its table, in which the scanner gets nowhere.
fn walled_cell() -> Cell {
    let mut cell = default_cell();
    let axis = cell.base_from_table.origin_mm().coords;
    for (place, (along, size_mm)) in [
        (Vector3::new(320.0, 0.0, 0.0), [20.0, 700.0, 1600.0]),
        (Vector3::new(-320.0, 0.0, 0.0), [20.0, 700.0, 1600.0]),
        (Vector3::new(0.0, 320.0, 0.0), [700.0, 20.0, 1600.0]),
        (Vector3::new(0.0, -320.0, 0.0), [700.0, 20.0, 1600.0]),
        (Vector3::new(0.0, 0.0, 400.0), [700.0, 700.0, 20.0]),
    ]
    .into_iter()
    .enumerate()
    {
        let owner_from_body = Isometry3::from_parts((axis + along).into(), UnitQuaternion::identity());
        cell.obstacles.push(Body { name: format!("wall <{place}>"), owner_from_body, shape: Shape::Box { size_mm } });
    }
    cell
}

fn quick() -> PlanParams {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    params.part.samples_per_mm2 = Some(0.05);
    params.part.patch_edge_mm = Some(20.0);
    params
}

fn finding(mesh: &Mesh, cell: &Cell, params: &PlanParams) -> NoPlan {
    let cancel = AtomicBool::new(false);
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(cell), roadmaps: None };
    match plan(&input, params, &Context::new(&cancel, &Silent)) {
        Err(PlanError::NoPlan(finding)) => finding,
        Err(error) => panic!("{error}"),
        Ok(outcome) => panic!("a plan of {} views", outcome.plan.views.len()),
    }
}

/// Page and text of a finding.
fn report(mesh: &Mesh, cell: Option<&Cell>, params: &PlanParams, finding: &NoPlan) -> (String, String) {
    let (scanner, echo, flag) = (crate::support::nominal_scanner(), Echo::default(), AtomicBool::new(false));
    let subject = ReportSubject {
        mesh,
        fixture: None,
        part_sha256: "ab12",
        part_name: "block <1>",
        scanner: &scanner,
        cell,
        echo: &echo,
        date: Some("2026-01-31T08:15:00Z"),
        size_warnings: &[],
    };
    let input = NoPlanInput { subject, params, reason: NoPlanReason::NoPlan(finding) };
    let page = render_no_plan(&input, &Context::new(&flag, &Silent)).expect("not cancelled");
    (page, no_plan_text(&input))
}

#[test]
#[ignore = "long: tests/all runs it"]
fn what_is_in_the_way_is_counted_and_pictured() {
    let (mesh, cell, params) = (block(), walled_cell(), quick());
    let finding = finding(&mesh, &cell, &params);
    let NoPlan::NothingMeasured { candidates, obstructions, setups, .. } = &finding else { panic!("{finding:?}") };
    assert!(candidates.kept == 0 && !obstructions.is_empty() && setups.len() == 1, "{finding:?}");
    let (page, text) = report(&mesh, Some(&cell), &params, &finding);
    well_formed(&page).expect("well-formed");
    let wall =
        obstructions.iter().take(10).find(|found| found.bodies.to_string().contains("wall <")).expect("a wall is in the way");
    let escaped = wall.bodies.to_string().replace('<', "&lt;").replace('>', "&gt;");
    for said in
        ["No plan is possible", "What is in the way", "Try first:", "From above, table at 0°", "2026-01-31 08:15 UTC", &escaped]
    {
        assert!(page.contains(said), "the page lacks {said:?}");
    }
    for (reason, count) in &candidates.rejected {
        let row = format!("<code>{}</code></td><td class=\"n\">{count}</td>", reason.as_str());
        assert!(page.contains(&row), "the page lacks {row:?}");
        assert!(text.contains(&format!("rejected, {}: {count}", reason.as_str())), "{text}");
    }
    // Two sides of each pair of bodies; the two colours of the pair are in each picture.
    let pictures = data_uris(&page);
    assert_eq!(pictures.len(), 2 * obstructions.len().min(4));
    for picture in &pictures {
        let has = |colour: [u8; 3]| {
            let unit = |rgb: [u8; 3]| Vector3::from(rgb.map(f64::from)).normalize();
            let pixels = (0..480).flat_map(|y| (0..640).map(move |x| (x, y))).map(|(x, y)| picture.at(x, y));
            pixels.filter(|[r, g, b, a]| *a == 255 && unit([*r, *g, *b]).dot(&unit(colour)) > 0.95).count() > 30
        };
        assert!(has([0xb3, 0x31, 0x07]) && has([0x00, 0x18, 0xb1]), "both bodies are seen");
    }
    assert!(
        text.starts_with("no plan is possible: none of ") && text.contains("in the way of viewpoints") && text.contains("wall <"),
        "{text}"
    );
}

#[test]
fn a_part_out_of_reach_is_shown_in_the_cell_with_the_robot_at_home() {
    let (mesh, mut cell, params) = (block(), default_cell(), quick());
    let away = cell.base_from_table.origin_mm().coords + Vector3::new(3000.0, 0.0, 0.0);
    cell.base_from_table = Pose::from_parts(away, UnitQuaternion::identity());
    let finding = finding(&mesh, &cell, &params);
    let (page, text) = report(&mesh, Some(&cell), &params, &finding);
    well_formed(&page).expect("well-formed");
    assert_eq!(data_uris(&page).len(), 2, "the cell from both sides");
    for said in ["The part in the cell", "Out of the robot’s reach", "vantage study reach", "How the part lies on the plate"] {
        assert!(page.contains(said), "the page lacks {said:?}");
    }
    assert!(text.contains("rejected, unreachable: ") && !text.contains("in the way"), "{text}");
}

#[test]
fn without_a_cell_the_part_is_shown_alone() {
    let (mesh, params) = (block(), quick());
    let (page, text) = report(&mesh, None, &params, &NoPlan::NothingInStudy);
    well_formed(&page).expect("well-formed");
    assert_eq!(data_uris(&page).len(), 3);
    assert!(page.contains("check the part&#39;s unit and size") && !page.contains("class=\"lay\""));
    assert!(text.contains("check the part's unit and size"), "{text}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn the_same_finding_gives_the_same_bytes_on_any_number_of_threads() {
    let (mesh, cell, params) = (block(), walled_cell(), quick());
    let finding = finding(&mesh, &cell, &params);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| report(&mesh, Some(&cell), &params, &finding))
    };
    assert!(on(1) == on(3));
}
