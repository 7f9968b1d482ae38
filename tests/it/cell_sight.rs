//! Obstacles of the cell hide what lies behind them: views are taken from stations at which every line from a device to what it
//! measures is clear, held here against a test of segment and box of its own; and what no station sees is missed for that.

use std::sync::atomic::AtomicBool;

use nalgebra::Point3;
use vantage::cell::{BodySpec, Cell, PoseSpec, Presets, ShapeSpec, SpecLibrary};
use vantage::geometry::{Base, Mesh, Part, Pose, plate_from_placed};
use vantage::planning::certificate::recheck::{self, TakenView};
use vantage::planning::context::{Context, Silent};
use vantage::planning::ids::SampleId;
use vantage::planning::params::{CandidateParams, PlanParams, Region, RegionMaterialParams};
use vantage::planning::plan::{Cause, Outcome, RemedyKind, Verdict};
use vantage::planning::{PlanInput, plan};
use vantage::program::{compile, off_coverage, scan_configurations, scan_poses};

use crate::support::box_mesh;

/// A box beside or above the plate: middle from the plate's centre, and edges, mm, along the base's axes.
type BoxMm = ([f64; 3], [f64; 3]);

/// A roof close above the part.
const ROOF: BoxMm = ([0.0, 0.0, 52.0], [80.0, 60.0, 4.0]);

fn cell_with(bodies: &[BoxMm]) -> Cell {
    let mut spec = Presets.cell("e05-transcan").expect("a preset");
    let table_mm = spec.base_from_table.translation_mm;
    spec.obstacles.extend(bodies.iter().map(|(middle_mm, size_mm)| BodySpec {
        name: "screen".into(),
        owner_from_body: PoseSpec {
            translation_mm: [0, 1, 2].map(|axis| table_mm[axis] + middle_mm[axis]),
            ..PoseSpec::default()
        },
        shape: ShapeSpec::Box { size_mm: *size_mm },
    }));
    spec.build(&Presets).expect("a valid cell")
}

fn block() -> Mesh {
    box_mesh([-30.0, -20.0, 0.0], [30.0, 20.0, 40.0])
}

fn quick() -> PlanParams {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    params.part.samples_per_mm2 = Some(0.3);
    params.missed.remedies = 0;
    params
}

fn planned(mesh: &Mesh, cell: &Cell) -> Outcome {
    planned_with(mesh, cell, &quick())
}

fn planned_with(mesh: &Mesh, cell: &Cell, params: &PlanParams) -> Outcome {
    let cancel = AtomicBool::new(false);
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(cell), roadmaps: None };
    plan(&input, params, &Context::new(&cancel, &Silent)).expect("a plan")
}

/// Wherever the scanner stands, the roof lies between it and some corner of the part's box: no view was told as the remedy of a side
/// that one more view measures.
#[test]
#[ignore = "long: tests/all runs it"]
fn one_more_view_is_told_where_obstacles_hide_nothing_that_it_measures() {
    let (mesh, cell) = (block(), cell_with(&[ROOF]));
    let mut params = quick();
    (params.selection.max_views, params.missed.remedies) = (Some(1), 8);
    let outcome = planned_with(&mesh, &cell, &params);
    let spots = outcome.plan.missed.iter().filter(|missed| missed.cause == Cause::NotChosen).flat_map(|missed| &missed.spots);
    let remedies: Vec<_> = spots.filter_map(|spot| spot.remedy.as_ref()).map(|remedy| (remedy.kind, remedy.works())).collect();
    assert!(remedies.contains(&(RemedyKind::View, true)), "{remedies:?}");
}

/// Returns true if a segment meets a box (slabs).
fn meets(from: &Point3<f64>, to: &Point3<f64>, (middle_mm, size_mm): &BoxMm, table_mm: &Point3<f64>) -> bool {
    let (mut enters, mut leaves) = (0.0_f64, 1.0_f64);
    for axis in 0..3 {
        let (start, way) = (from[axis] - table_mm[axis] - middle_mm[axis], to[axis] - from[axis]);
        let ends = [-0.5, 0.5].map(|side| (side * size_mm[axis] - start) / way);
        (enters, leaves) = (enters.max(ends[0].min(ends[1])), leaves.min(ends[0].max(ends[1])));
    }
    enters < leaves
}

/// Measured samples that a body hides from a device of the view that measures them, counted for each view.
fn hidden_by(outcome: &Outcome, cell: &Cell, body: &BoxMm) -> Vec<usize> {
    let lies = outcome.plan.table_from_part.expect("a cell");
    let views = outcome.plan.views.iter().zip(&outcome.measured_by_view);
    let of_view = views.filter_map(|(view, row)| {
        let station = view.station?;
        let base_from_part: Pose<Base, Part> = cell.base_from_plate(station.table_angle_rad) * plate_from_placed(&lies);
        let base_from_scanner = cell.base_from_scanner(&station.joints_rad);
        let centres =
            cell.scanner.devices.as_ref().map(|device| base_from_scanner.point(&device.scanner_from_device.origin_mm()));
        let is_hidden = |sample: &SampleId| {
            let p = base_from_part.point(&outcome.surface.sample_mm[sample.index()]);
            centres.iter().any(|centre| meets(centre, &p, body, &cell.base_from_table.origin_mm()))
        };
        Some(row.samples().filter(is_hidden).count())
    });
    of_view.collect()
}

/// A screen halfway between the part and the scanner as it takes the first view.
fn screen_before_first_view(outcome: &Outcome, cell: &Cell) -> BoxMm {
    let station = outcome.plan.views[0].station.expect("a station");
    let scanner_mm = cell.base_from_scanner(&station.joints_rad).origin_mm() - cell.base_from_table.origin_mm();
    ([0, 1, 2].map(|axis| 0.5 * scanner_mm[axis]), [30.0; 3])
}

#[test]
#[ignore = "long: tests/all runs it"]
fn views_are_taken_past_a_screen_that_stands_before_the_part() {
    let mesh = block();
    let open = cell_with(&[]);
    let without = planned(&mesh, &open);
    let screen = screen_before_first_view(&without, &open);
    let screened = cell_with(&[screen]);
    let crossing = hidden_by(&without, &open, &screen);
    assert!(crossing[0] > 0, "no view would look through the screen: {crossing:?}");
    let outcome = planned(&mesh, &screened);
    let crossing = hidden_by(&outcome, &screened, &screen);
    assert!(!crossing.is_empty() && crossing.iter().all(|count| *count == 0), "{crossing:?}");
    let (plan, before) = (&outcome.plan, &without.plan);
    assert!(plan.coverage.measured.area_mm2 <= before.coverage.coverable_area_mm2 + 1e-6);
    let optically = [plan, before].map(|plan| plan.coverage.optically_coverable_area_mm2);
    assert!((optically[0] - optically[1]).abs() < 1e-6, "what the cell hides is seen optically: {optically:?}");
    let missed: f64 = plan.missed.iter().map(|missed| missed.area_mm2).sum();
    assert!((plan.coverage.measured.area_mm2 + missed - plan.coverage.asked_area_mm2).abs() < 1e-6);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_roof_hides_the_middle_of_what_lies_under_it_from_every_station() {
    let mesh = block();
    let (open, roofed) = (cell_with(&[]), cell_with(&[ROOF]));
    let missed_mm2 = |outcome: &Outcome| {
        let missed = outcome.plan.missed.iter().filter(|missed| missed.cause == Cause::HiddenByCell);
        missed.map(|missed| missed.area_mm2).sum::<f64>()
    };
    let without = planned(&mesh, &open);
    assert_eq!(missed_mm2(&without), 0.0);
    assert!((without.plan.coverage.coverable_area_mm2 - 10_400.0).abs() < 1e-6, "all but the underside");
    let outcome = planned(&mesh, &roofed);
    assert_eq!(hidden_by(&outcome, &roofed, &ROOF).iter().sum::<usize>(), 0);
    // Every viewpoint of these looks down by 28° and more: at a rise of 10 mm a line is 19 mm further on, and the roof reaches
    // 30 mm and more from its middle. So a disc of 8 mm is hidden at every table angle.
    let (mut under, mut hidden) = (0, 0);
    for (sample, p) in SampleId::number(&outcome.surface.sample_mm) {
        let verdict = outcome.verdicts[sample.index()];
        if outcome.surface.patch_of(sample).normal.z > 0.9 && p.x.hypot(p.y) < 8.0 {
            assert_eq!(verdict, Verdict::Missed(Cause::HiddenByCell), "{p}");
            under += 1;
        }
        hidden += usize::from(verdict == Verdict::Missed(Cause::HiddenByCell));
    }
    assert!(under > 30 && hidden >= under, "{under} of {hidden}");
    let coverage = &outcome.plan.coverage;
    assert!(coverage.coverable_area_mm2 < 10_400.0 - 150.0, "a disc of 8 mm is 201 mm²: {coverage:?}");
    assert!((coverage.optically_coverable_area_mm2 - without.plan.coverage.optically_coverable_area_mm2).abs() < 1e-6);
    assert!(coverage.independent.of_asked() < without.plan.coverage.independent.of_asked() - 0.01);
}

/// Surface that no light shows and a roof hides was told as dark, and as seen.
#[test]
#[ignore = "long: tests/all runs it"]
fn what_a_roof_hides_from_every_station_is_not_told_as_dark() {
    let mut params = quick();
    params.materials.albedo = Some(0.8);
    // Half the disc that is hidden at every table angle, of a black that no level lights.
    params.materials.regions = vec![RegionMaterialParams {
        region: Region::Sphere { centre_mm: [0.0, 0.0, 40.0], radius_mm: 4.0 },
        finish: None,
        albedo: Some(0.001),
        gloss: Some(0.0),
        lobe_deg: None,
    }];
    let told = |cell: &Cell| {
        let Outcome { plan, .. } = planned_with(&block(), cell, &params);
        let dark_mm2: Vec<f64> = plan.views.iter().filter_map(|view| Some(view.exposure.as_ref()?.dark_area_mm2)).collect();
        (plan.coverage.exposure.expect("known materials").dark_area_mm2, dark_mm2)
    };
    let (open_mm2, by_view_mm2) = told(&cell_with(&[]));
    assert!(open_mm2 > 25.0 && by_view_mm2.iter().any(|mm2| *mm2 > 25.0), "a disc of 4 mm is 50 mm²: {open_mm2} {by_view_mm2:?}");
    let (roofed_mm2, by_view_mm2) = told(&cell_with(&[ROOF]));
    assert!(!by_view_mm2.is_empty() && by_view_mm2.iter().all(|mm2| *mm2 == 0.0), "{by_view_mm2:?}");
    assert_eq!(roofed_mm2, 0.0);
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_second_opinion_on_a_program_sees_the_roof_too() {
    let (mesh, roofed) = (block(), cell_with(&[ROOF]));
    let Outcome { plan, .. } = planned(&mesh, &roofed);
    let input =
        PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &roofed.scanner, cell: Some(&roofed), roadmaps: None };
    let lies = plan.table_from_part.expect("a cell");
    let program = compile(plan.sequences().next().expect("a sequence"), 0, &roofed, &"00".repeat(32), &plan.params);
    let poses = scan_poses(&program, &roofed, &lies);
    let cancel = AtomicBool::new(false);
    let ctx = Context::new(&cancel, &Silent);
    let angles = scan_configurations(&program).into_iter().map(|here| here.table_rad);
    let taken: Vec<TakenView> = poses
        .iter()
        .zip(angles)
        .map(|(pose, table_rad)| TakenView { part_from_scanner: *pose, table_rad: Some(table_rad) })
        .collect();
    let measured = recheck::measured_in_cell(&input, &plan.params, &lies, &taken, &ctx).expect("parameters of a plan");
    assert_eq!(off_coverage(measured.measured_mm2 / measured.asked_mm2, plan.coverage.of_asked()), None);
    // The views alone, without what stands around them, measure more than the plan says.
    let unaware = recheck::measured(&input, &plan.params, &lies, &poses, &ctx).expect("parameters of a plan");
    assert!(unaware.measured_mm2 > measured.measured_mm2 + 100.0, "{unaware:?} and {measured:?}");
}
