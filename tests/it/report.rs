//! Reports that a person looks at after a plan, made from a plan whose answers are known in closed form: a sphere seen from four
//! sides. The text report is held by `tests/golden/plan_report.txt`; `UPDATE_GOLDEN=1` writes it anew.

mod browser;
pub(crate) mod markup;
mod no_plan;

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use vantage::cell::{Cell, Configuration, Contact, Posture, Presets, Separation, SpecLibrary};
use vantage::geometry::{LazyStablePoses, Mesh, NOT_DRAWN, Part, Poll, Pose, ScannerFrame, preview};
use vantage::planning::candidates::{Label, Rejection};
use vantage::planning::context::{Context, Silent};
use vantage::planning::ids::SampleId;
use vantage::planning::params::{PartParams, PlanParams, Region, RegionParams};
use vantage::planning::plan::{
    Advice, AtRisk, Bound, CandidateCounts, CandidateId, Cause, ChosenOn, Coverage, Grade, Independent, MeasuredArea,
    MissedCause, MissedSpot, Obstruction, Outcome, PartFacts, Plan, PlannedView, Remedy, RemedyKind, RemedyView, SetupId,
    SetupPlan, Stance, StopReason, Verdict, ViewId,
};
use vantage::planning::sequence::{Leg, Sequence};
use vantage::planning::stations::Station;
use vantage::planning::surface::{self, Surface};
use vantage::planning::visibility::Row;
use vantage::report::html::{ReportInput, ReportSubject, render};
use vantage::report::text::text;
use vantage::wire::echo::Echo;
use vantage::wire::summary::Summary;
use vantage::wire::{coverage, missed, viewpoints};

use markup::{data_uris, well_formed};

const RADIUS_MM: f64 = 40.0;
/// Digest of the plan that every derived file names.
const PLAN_SHA256: &str = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";
/// A view measures what it sees at less than this angle.
const MEASURED_WITHIN: f64 = 60.0 * std::f64::consts::PI / 180.0;

/// A sphere about the origin: 48 meridians, 24 rings of quads, each cut in two; a quad is a face of the file.
fn sphere() -> Mesh {
    let point = |ring: u32, meridian: u32| {
        let (polar, azimuth) = (f64::from(ring) * 7.5f64.to_radians(), f64::from(meridian) * 7.5f64.to_radians());
        Point3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos()) * RADIUS_MM
    };
    let vertices_mm = (0..=24).flat_map(|ring| (0..48).map(move |meridian| point(ring, meridian))).collect();
    let index = |ring: u32, meridian: u32| ring * 48 + meridian % 48;
    let mut mesh = Mesh { vertices_mm, faces: Vec::new(), source_face: Vec::new(), groups: Vec::new() };
    for (ring, meridian) in (0..24).flat_map(|ring| (0..48).map(move |meridian| (ring, meridian))) {
        let [a, b, c, d] =
            [index(ring, meridian), index(ring + 1, meridian), index(ring + 1, meridian + 1), index(ring, meridian + 1)];
        let halves = [(ring < 23, [a, b, c]), (ring > 0, [a, c, d])];
        for (_, face) in halves.into_iter().filter(|(has_area, _)| *has_area) {
            mesh.faces.push(face);
            mesh.source_face.push(ring * 48 + meridian);
        }
    }
    mesh
}

/// Looks at the origin from 480 mm off the surface, baseline level.
fn looking_from(direction: Vector3<f64>) -> Pose<Part, ScannerFrame> {
    let z = -direction.normalize();
    let x = z.cross(&Vector3::z()).try_normalize(1e-9).unwrap_or(Vector3::x());
    let axes = Rotation3::from_basis_unchecked(&[x, z.cross(&x), z]);
    let origin = Translation3::from(-z * (480.0 + RADIUS_MM));
    Pose::claim(Isometry3::from_parts(origin, UnitQuaternion::from_rotation_matrix(&axes)))
}

fn row(surface: &Surface, pose: &Pose<Part, ScannerFrame>) -> Row {
    let graded = SampleId::number(&surface.sample_mm).filter_map(|(sample, p)| {
        let angle = surface.patch_of(sample).normal.angle(&(pose.origin_mm() - p));
        (angle < MEASURED_WITHIN).then(|| (sample, (1.0 - 2.0 * angle / 77.5f64.to_radians()) as f32))
    });
    Row::from_samples(surface.sample_mm.len(), graded)
}

fn verdicts(surface: &Surface, rows: &[Row]) -> Vec<Verdict> {
    let mut best = vec![f32::NEG_INFINITY; surface.sample_mm.len()];
    for (sample, quality) in rows.iter().flat_map(Row::graded) {
        best[sample.index()] = best[sample.index()].max(quality);
    }
    let missed = |p: &Point3<f64>| if p.z < -0.8 * RADIUS_MM { Cause::ExcludedResting } else { Cause::ShadowLeft };
    (0..best.len())
        .map(|sample| match best[sample] {
            _ if !surface.asked[sample] => Verdict::NotAsked,
            quality if quality > f32::NEG_INFINITY => Verdict::Measured(Grade::of(f64::from(quality))),
            _ => Verdict::Missed(missed(&surface.sample_mm[sample])),
        })
        .collect()
}

fn coverage_of(surface: &Surface, verdicts: &[Verdict], rows: &[Row]) -> Coverage {
    let area = |keep: &(dyn Fn(SampleId) -> bool + Sync)| surface.area_where(keep);
    let measured = area(&|sample| matches!(verdicts[sample.index()], Verdict::Measured(_)));
    let seen_by = |first: usize| area(&|s| surface.asked[s.index()] && rows[..first].iter().any(|row| row.holds(s)));
    Coverage {
        total_area_mm2: area(&|_| true),
        asked_area_mm2: area(&|sample| surface.asked[sample.index()]),
        visible_area_mm2: measured * 1.03,
        coverable_area_mm2: measured * 1.01,
        optically_coverable_area_mm2: measured * 1.02,
        measured: MeasuredArea {
            area_mm2: measured,
            grade_area_mm2: [Grade::A, Grade::B, Grade::C, Grade::D]
                .map(|grade| area(&|sample| verdicts[sample.index()] == Verdict::Measured(grade))),
            within_area_mm2: [0.4 * measured, 0.9 * measured],
        },
        curve_area_mm2: (1..=rows.len()).map(seen_by).collect(),
        at_risk: AtRisk { is_counted: true, ..AtRisk::default() },
        regions: Vec::new(),
        independent: Independent::default(),
        robust: None,
        exposure: None,
        pixel_set_area_mm2: None,
        is_of_open: false,
    }
}

fn missed_of(mesh: &Mesh, surface: &Surface, verdicts: &[Verdict]) -> Vec<MissedCause> {
    let spot = |cause: Cause| {
        let samples: Vec<SampleId> =
            surface.samples().filter(|sample| verdicts[sample.index()] == Verdict::Missed(cause)).collect();
        let area_mm2: f64 = samples.iter().map(|sample| surface.sample_area_mm2(*sample)).sum();
        let centre: Vector3<f64> =
            samples.iter().map(|s| surface.sample_mm[s.index()].coords * surface.sample_area_mm2(*s) / area_mm2).sum();
        let mut source_faces: Vec<u32> = samples.iter().map(|s| mesh.source_face[surface.patch_of(*s).face as usize]).collect();
        source_faces.dedup();
        MissedCause {
            cause,
            area_mm2,
            spots: vec![MissedSpot {
                area_mm2,
                centre_mm: centre.into(),
                extent_mm: Vector3::new(12.0, 34.5, 6.0),
                source_faces,
                remedy: (cause == Cause::ShadowLeft).then(|| tilt(area_mm2)),
            }],
        }
    };
    vec![spot(Cause::ExcludedResting), spot(Cause::ShadowLeft)]
}

/// A tilted view that measures three quarters of a spot.
fn tilt(spot_mm2: f64) -> Remedy {
    let area_mm2 = 0.75 * spot_mm2;
    let view = RemedyView {
        candidate: CandidateId(7),
        roll_rad: 0.0,
        tilt_rad: 20f64.to_radians(),
        standoff_mm: 480.0,
        part_from_scanner: looking_from(Vector3::new(1.0, 1.0, 1.0)),
        area_mm2,
    };
    Remedy {
        kind: RemedyKind::Tilt,
        views: vec![view],
        table_from_part: None,
        turn: None,
        camera_deg: None,
        projector_deg: None,
        area_mm2,
        of_spot: 0.75,
        tried: 321,
    }
}

fn station(turns: f64) -> Station {
    Station { table_angle_rad: turns, joints_rad: [0.1 * turns, -1.2, 1.1, 0.4, -0.3, 2.0] }
}

fn sequence(views: usize) -> Sequence {
    let leg = |turns: f64| Leg {
        via_rad: vec![Configuration { joints_rad: [0.0; 6], table_rad: 0.0 }; turns as usize % 2],
        target: station(turns),
        duration_secs: 1.25 + turns,
        turning_secs: 0.5,
        passed_within_rad: None,
    };
    let visits = (0..views as u32).rev().map(|view| (ViewId(view), leg(f64::from(view)))).collect();
    Sequence { visits, return_home: leg(0.0), ordered_secs: 12.5, lower_bound_secs: 11.5, moving_lower_secs: 11.0 }
}

fn obstruction() -> Obstruction {
    let bodies = Contact { a: "camera <left>".into(), b: "post".into() };
    let separation = Separation { bodies: bodies.clone(), distance_mm: -2.5, place_in_base_mm: Point3::new(300.0, -40.0, 210.0) };
    Obstruction {
        bodies,
        without_station: 3,
        without_path: 1,
        configuration: Configuration { joints_rad: [0.1; 6], table_rad: 0.1 },
        separation: Some(separation),
        advice: Advice::MoveObstacle("post".into()),
    }
}

/// The sphere seen from +x, −y, −x and above, its +y side left out of what is asked for, standing on its lowest part.
fn sphere_outcome(mesh: &Mesh) -> Outcome {
    let part = PartParams { patch_edge_mm: Some(5.0), samples_per_mm2: Some(0.1), ..PartParams::default() };
    let regions = RegionParams {
        exclude: vec![Region::HalfSpace { point_mm: [0.0, 0.8 * RADIUS_MM, 0.0], normal: [0.0, -1.0, 0.0] }],
        ..RegionParams::default()
    };
    let surface = std::sync::Arc::new(surface::sample(mesh, &part, &regions, 0).expect("a surface"));
    let params = PlanParams { part, regions, ..PlanParams::default() };
    let sides =
        [(Vector3::x(), Label::Right), (-Vector3::y(), Label::Front), (-Vector3::x(), Label::Left), (Vector3::z(), Label::Top)];
    let poses = sides.map(|(direction, _)| looking_from(direction));
    let rows: Vec<Row> = poses.iter().map(|pose| row(&surface, pose)).collect();
    let verdicts = verdicts(&surface, &rows);
    let coverage = coverage_of(&surface, &verdicts, &rows);
    let gain = |view: usize| coverage.curve_area_mm2[view] - if view == 0 { 0.0 } else { coverage.curve_area_mm2[view - 1] };
    let posture = Posture { shoulder_back: false, elbow_down: false, wrist_flipped: true };
    let views = (0..sides.len()).map(|view| PlannedView {
        id: ViewId::at(view),
        candidate: CandidateId::at(view * 7),
        setup: SetupId(0),
        label: sides[view].1,
        part_from_scanner: poses[view],
        gain_of_asked: gain(view) / coverage.asked_area_mm2,
        score: gain(view) * 0.7,
        station: Some(station(view as f64)),
        stance: Some(Stance { posture, singularity_margin: 0.2, clearance_mm: Some(31.5) }),
        rejected: None,
        exposure: None,
    });
    let table_from_part = Pose::from_parts(Vector3::new(0.0, 0.0, RADIUS_MM), UnitQuaternion::identity());
    let setup = SetupPlan {
        table_from_part,
        views: ViewId::first(sides.len()).collect(),
        coverable_area_mm2: coverage.coverable_area_mm2,
        measured_area_mm2: coverage.measured.area_mm2,
        sequence: Some(sequence(sides.len())),
        weakest_link: None,
    };
    let plan = Plan {
        part: PartFacts { sha256: "ab".repeat(32), triangles: mesh.faces.len(), area_mm2: mesh.area_mm2(), aabb: mesh.aabb() },
        table_from_part: Some(table_from_part),
        params,
        candidates: CandidateCounts { generated: 62, kept: 50, rejected: [(Rejection::BelowTable, 12)].into() },
        views: views.collect(),
        setups: vec![setup],
        setup_links: Vec::new(),
        obstructions: vec![obstruction()],
        missed: missed_of(mesh, &surface, &verdicts),
        advice: Vec::new(),
        stopped_because: StopReason::Target,
        bound: Bound { views_lower: sides.len() as u32, ..Bound::default() },
        chosen_on: ChosenOn::default(),
        coverage,
    };
    let (scenes, stable_poses) = (Vec::new(), LazyStablePoses::default());
    Outcome { plan, surface, verdicts, measured_by_view: rows, pixel_views: None, candidates: None, scenes, stable_poses }
}

fn page(mesh: &Mesh, outcome: &Outcome, part_name: &str, echo: &Echo) -> String {
    dated_page(mesh, outcome, part_name, echo, None)
}

fn dated_page(mesh: &Mesh, outcome: &Outcome, part_name: &str, echo: &Echo, date: Option<&str>) -> String {
    let (cell, flag) = (Cell { name: part_name.to_owned(), ..default_cell() }, AtomicBool::new(false));
    let part_sha256 = &outcome.plan.part.sha256;
    let subject = ReportSubject {
        mesh,
        fixture: None,
        part_sha256,
        part_name,
        scanner: &cell.scanner,
        cell: Some(&cell),
        echo,
        date,
        size_warnings: &[],
    };
    let summary = Summary { cycle_secs: Some(143.2), ..Summary::of(&outcome.plan) };
    let input = ReportInput { subject, outcome, plan_sha256: PLAN_SHA256, summary: &summary, warnings: &[] };
    render(&input, &Context::new(&flag, &Silent)).expect("not cancelled")
}

fn default_cell() -> Cell {
    Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset")
}

/// An outcome with so many views: those of the sphere again and again, in one sequence.
fn with_views(mut outcome: Outcome, count: usize) -> Outcome {
    let views = outcome.plan.views.len();
    let nth = |view: usize| PlannedView { id: ViewId::at(view), ..outcome.plan.views[view % views].clone() };
    let all: Vec<PlannedView> = (0..count).map(nth).collect();
    outcome.measured_by_view = (0..count).map(|view| outcome.measured_by_view[view % views].clone()).collect();
    outcome.plan.views = all;
    outcome.plan.setups[0].views = ViewId::first(count).collect();
    outcome.plan.setups[0].sequence = Some(sequence(count));
    outcome
}

/// A second setup, in which the sphere is turned upside down and 12 mm off the axis, and half of the views are taken.
fn turned_over(mut outcome: Outcome) -> Outcome {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let mut second = outcome.plan.setups[0].clone();
    second.table_from_part = Pose::from_parts(Vector3::new(12.0, 0.0, RADIUS_MM), turn);
    let split = |sequence: &Sequence, visits: std::ops::Range<usize>| Sequence {
        visits: sequence.visits[visits].to_vec(),
        ..sequence.clone()
    };
    let whole = outcome.plan.setups[0].sequence.clone().expect("a sequence");
    second.sequence = Some(split(&whole, 2..4));
    outcome.plan.setups[0].sequence = Some(split(&whole, 0..2));
    outcome.plan.setups.push(second);
    outcome
}

#[test]
fn text_report_matches_its_golden_file() {
    let text = text(&sphere_outcome(&sphere()).plan);
    let file = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/golden/plan_report.txt"));
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&file, &text).expect("written");
    }
    let golden = std::fs::read_to_string(&file).expect("the golden file; UPDATE_GOLDEN=1 writes it");
    for (line, (is, was)) in (1..).zip(text.lines().zip(golden.lines())) {
        assert_eq!(is, was, "line {line}");
    }
    assert_eq!(text.lines().count(), golden.lines().count());
}

#[test]
fn page_is_well_formed_fetches_nothing_and_runs_nothing() {
    let mesh = sphere();
    let page = page(&mesh, &sphere_outcome(&mesh), "sphere", &Echo::default());
    well_formed(&page).expect("well-formed");
    for outside in ["http:", "https:", "src=\"//", "url(", "@import", "<script", "<link", "<iframe", "javascript:"] {
        assert!(!page.contains(outside), "the page contains {outside}");
    }
    for said in [
        "Can be scanned",
        "<p class=\"action\">Next: ",
        "4</b><span>views",
        "2\u{a0}min 23\u{a0}s</b><span>cycle time",
        "4 × 1.3 s scanning",
        "Hidden from the left camera",
        "coverage.csv",
        "The largest spots",
        "12.0 × 34.5 × 6.0",
        "Only 75 % of it, 1 013.8 mm²: add tilted views: put their poses into candidates.poses",
        "Turn the part over: it stands on this surface, or the surface faces the table<br/><code>--set setups=2</code>",
        "<code>--set selection.target=0.9907</code>",
        "<b>75 % of it: another tilt</b>",
        "only 75 % of it, 1 013.8 mm²: tilt candidate 7 by 20°",
        "It is not a measurement",
        "not safety-rated",
    ] {
        assert!(page.contains(said), "the page lacks {said:?}");
    }
}

#[test]
fn text_of_others_stays_text() {
    let mesh = sphere();
    let nasty = "\"><script>alert(1)</script><img src=x onerror='alert(2)'>&amp;\u{0}\u{202e}";
    let echo = Echo {
        labels: [(nasty.to_owned(), format!("]]>{nasty}"))].into(),
        part_number: Some(format!("</title>{nasty}")),
        serial: Some(format!("<!-- {nasty}")),
    };
    let page = page(&mesh, &sphere_outcome(&mesh), nasty, &echo);
    well_formed(&page).expect("well-formed");
    assert!(!page.contains("<script") && !page.contains("<img src=x") && !page.contains("<!-- "));
    assert_eq!(page.matches("&lt;script&gt;alert(1)&lt;/script&gt;").count(), 7);
    assert!(page.contains("&amp;amp;"));
}

#[test]
fn pictures_decode_and_stay_small() {
    let mesh = sphere();
    let page = page(&mesh, &sphere_outcome(&mesh), "sphere", &Echo::default());
    let pictures = data_uris(&page);
    assert_eq!(pictures.len(), 3 + 4 + 3, "three sides, four views, three sides of misses");
    assert_eq!(page.matches("<img ").count(), page.matches("alt=\"").count());
    assert!(pictures.iter().all(|picture| picture.size_px == [640, 480]));
    assert!(page.len() < 1_000_000, "{} bytes", page.len());
}

#[test]
#[ignore = "long: tests/all runs it"]
fn of_very_many_views_the_first_have_pictures() {
    let mesh = sphere();
    let page = page(&mesh, &with_views(sphere_outcome(&mesh), 130), "sphere", &Echo::default());
    well_formed(&page).expect("well-formed");
    let pictures = data_uris(&page);
    assert_eq!(pictures.len(), 3 + 120 + 3);
    assert!(pictures[3..123].iter().all(|picture| picture.size_px == [320, 240]), "thumbnails are small");
    assert_eq!(page.matches("<details class=\"stop\"").count(), 130, "every view has its figures");
    assert!(page.contains("The first 120 have pictures."));
}

/// Places at which texts begin, which must ascend.
fn ascend(page: &str, texts: &[&str]) {
    let places: Vec<usize> =
        texts.iter().map(|text| page.find(text).unwrap_or_else(|| panic!("the page lacks {text:?}"))).collect();
    assert!(places.is_sorted(), "{texts:?} at {places:?}");
}

#[test]
fn the_page_is_a_work_instruction_in_the_order_of_the_work() {
    let mesh = sphere();
    let page = page(&mesh, &sphere_outcome(&mesh), "sphere", &Echo::default());
    ascend(
        &page,
        &[
            "<h2>Can be scanned, but ",
            "<h2>How the part lies on the plate</h2>",
            "<h2>Stops in the robot’s order</h2>",
            "<h2>What is missed, and how to fix it</h2>",
            "<h3>Fixes for the spots</h3>",
            "<h2>Why these figures can be trusted</h2>",
            "<h2>Appendix</h2>",
        ],
    );
    // The sequence visits the views in reverse; moves take 1.25 s and as many more as the view's number, a scan 1.3 s.
    ascend(&page, &["data-view=\"3\"", "data-view=\"2\"", "data-view=\"1\"", "data-view=\"0\""]);
    ascend(&page, &["table 171.9° · at ", "table 114.6° · at 8.8\u{a0}s", "table 57.3° · at "]);
}

/// Further views were told as a plan of the whole part, with parameters that a rescan does not take.
#[test]
fn the_page_of_further_views_names_the_rules_of_the_rescan() {
    let mesh = sphere();
    let mut outcome = sphere_outcome(&mesh);
    outcome.plan.coverage.is_of_open = true;
    (outcome.plan.stopped_because, outcome.plan.bound) = (StopReason::MaxViews, Bound::default());
    let spot = outcome.plan.missed.iter_mut().flat_map(|missed| &mut missed.spots).next().expect("a spot");
    spot.remedy = Some(Remedy { kind: RemedyKind::View, of_spot: 1.0, ..tilt(spot.area_mm2) });
    let page = page(&mesh, &outcome, "sphere", &Echo::default());
    well_formed(&page).expect("well-formed");
    for said in [
        "<title>Plan of further views: sphere</title>",
        ": further views measure ",
        "(open: asked area that earlier scans left open, but for losses that no further view mends)",
        "<td class=\"soft\">open: asked area that earlier scans left open, but for losses that no further view mends</td>",
        "The choice of views ended because the rescan has as many views as its max_views allows, 4. No lower bound on the number",
        "Choose more views: raise max_views of the rescan",
        "raise max_views of the rescan so that candidate 7 is chosen too",
    ] {
        assert!(page.contains(said), "the page lacks {said:?}");
    }
    for unknown in ["selection.max_views", "selection.min_growth", "put their poses into", "of what was asked is not measured"] {
        assert!(!page.contains(unknown), "a rescan takes no {unknown:?}");
    }
    for other in [">Of asked<", "measured of asked", "Measured share of the asked area"] {
        assert!(!page.contains(other), "asked is what the job asks of the part, not what scans left open: {other:?}");
    }
}

#[test]
fn views_without_a_path_stand_apart_and_do_not_count() {
    let mesh = sphere();
    let mut outcome = sphere_outcome(&mesh);
    let left_out = &mut outcome.plan.views[0];
    (left_out.rejected, left_out.station, left_out.stance) = (Some(Cause::NoPath), None, None);
    let sequence = outcome.plan.setups[0].sequence.as_mut().expect("a sequence");
    sequence.visits.retain(|(view, _)| *view != ViewId(0));
    let page = page(&mesh, &outcome, "sphere", &Echo::default());
    well_formed(&page).expect("well-formed");
    for said in [
        "Can be scanned, with gaps",
        "3</b><span>views",
        "no collision-free path leads to 1 of 4 chosen views",
        "Chosen, but not executed",
    ] {
        assert!(page.contains(said), "the page lacks {said:?}");
    }
    ascend(&page, &["data-view=\"1\"", "Chosen, but not executed", "data-view=\"0\""]);
}

#[test]
fn date_version_and_part_number_stand_on_the_page_and_in_print_only_where_they_are_given() {
    let mesh = sphere();
    let outcome = sphere_outcome(&mesh);
    let echo = Echo { part_number: Some("PN-4711".into()), ..Echo::default() };
    let dated = dated_page(&mesh, &outcome, "sphere", &echo, Some("2026-01-31T08:15:42.123Z"));
    let version = env!("CARGO_PKG_VERSION");
    for said in ["<dd>2026-01-31 08:15 UTC</dd>", "<dd>PN-4711</dd>", &format!("<dd>Vantage {version}</dd>"), "counter(page)"] {
        assert!(dated.contains(said), "the page lacks {said:?}");
    }
    let foot = dated.split("@bottom-left { content: ").nth(1).and_then(|rest| rest.split(';').next()).expect("a foot");
    for said in ["PN\\2d 4711", "2026\\2d 01\\2d 31\\20 08\\3a 15", "Vantage\\20 "] {
        assert!(foot.contains(said), "{said:?} is not in {foot}");
    }
    let undated = page(&mesh, &outcome, "sphere", &Echo::default());
    assert!(!undated.contains("<dt>Date</dt>") && !undated.contains("UTC"));
}

#[test]
fn a_drawing_a_setup_has_the_offsets_from_the_axis_and_the_side_up() {
    let mesh = sphere();
    let page = page(&mesh, &turned_over(sphere_outcome(&mesh)), "sphere", &Echo::default());
    well_formed(&page).expect("well-formed");
    let figures: Vec<&str> =
        page.split("<figure class=\"lay\"").skip(1).map(|rest| rest.split("</figure>").next().expect("its end")).collect();
    assert_eq!(figures.len(), 2);
    assert!(figures[0].contains("Setup 1: as placed<") && figures[1].contains("Setup 2, from setup 1: turn it upside down"));
    let lengths = |figure: &str| -> Vec<String> {
        let texts = figure.split("<text class=\"dimension").skip(1);
        texts.map(|rest| rest.split('>').nth(1).and_then(|text| text.split('<').next()).expect("a text").to_owned()).collect()
    };
    assert_eq!(lengths(figures[0]), ["40.0", "40.0", "40.0", "40.0", "80.0"], "along x, along y, and up");
    assert_eq!(lengths(figures[1]), ["28.0", "52.0", "40.0", "40.0", "80.0"], "12 mm off the axis");
    for (figure, up, span) in [(figures[0], "+z", "x −40.0 to 40.0"), (figures[1], "−z", "x −28.0 to 52.0")] {
        assert!(figure.contains(&format!("<text class=\"up\" x=\"42\" y=\"198\">{up}</text>")), "{up}");
        assert!(figure.contains(&format!("{up} of the file")) && figure.contains(span), "{span}");
        for drawn in ["class=\"plate\"", ">0°</text>", "class=\"robot\"", "class=\"outline\"", "href=\"data:image/png"] {
            assert!(figure.contains(drawn), "the drawing lacks {drawn}");
        }
    }
    // The robot's foot, as the cell has it.
    let foot = default_cell().base_from_table.inverse().origin_mm();
    let facts = format!(
        "{:.0} mm from the axis, at {:.1}° of the table",
        foot.x.hypot(foot.y),
        (foot.y + 0.0).atan2(foot.x).to_degrees()
    );
    assert!(figures[0].contains(&facts.replace('-', "−")), "{facts}");
    let stops = page.split("<h2>Stops in the robot’s order</h2>").nth(1).expect("the stops");
    ascend(
        stops,
        &["<h3>Setup 1</h3>", "data-view=\"2\"", "<h3>Setup 2, from setup 1: turn it upside down</h3>", "data-view=\"1\""],
    );
}

#[test]
fn numbers_of_spots_are_the_same_in_the_list_and_in_the_pictures() {
    let mesh = sphere();
    let page = page(&mesh, &sphere_outcome(&mesh), "sphere", &Echo::default());
    let section = page.split("<h2>What is missed, and how to fix it</h2>").nth(1).expect("the section");
    let (pictures, list) = section.split_once("<h3>Fixes for the spots</h3>").expect("fixes");
    for number in 1..=2 {
        assert!(pictures.contains(&format!("<g class=\"spot\" data-spot=\"{number}\">")), "spot {number} is seen from a side");
        assert!(list.contains(&format!("<b>{number}</b>")), "spot {number} is listed");
    }
    assert!(!pictures.contains("data-spot=\"3\"") && !pictures.contains("spot hidden"));
}

#[test]
fn a_view_shows_what_it_measures_where_it_looks() {
    let mesh = sphere();
    let outcome = sphere_outcome(&mesh);
    let page = page(&mesh, &outcome, "sphere", &Echo::default());
    // View 0 is the last stop, after three sides and three stops. It looks from +x: the sphere fills 90 % of the height about the
    // middle, right of the picture is +y.
    let picture = &data_uris(&page)[3 + 3];
    let unit = |rgb: [u8; 3]| Vector3::from(rgb.map(f64::from)).normalize();
    let is = |[r, g, b, a]: [u8; 4], colour: [u8; 3]| a == 255 && unit([r, g, b]).dot(&unit(colour)) > 0.999;
    let grades = [[0x00, 0x18, 0xb1], [0x19, 0xdd, 0x7c], [0xff, 0xef, 0x14], [0xb3, 0x31, 0x07]];
    let is_measured = |pixel: [u8; 4]| grades.iter().any(|grade| is(pixel, *grade));
    let is_missed = |pixel: [u8; 4]| is(pixel, [0xe5, 0x64, 0xe4]);
    let is_grey = |[r, g, b, a]: [u8; 4]| a == 255 && r.max(g).max(b) - r.min(g).min(b) < 12;
    assert!(is(picture.at(320, 240), grades[0]), "the middle has grade A: {:?}", picture.at(320, 240));
    assert_eq!(picture.at(10, 10)[3], 0, "the corner is empty");
    // At 205 of 216 px from the middle the view is too oblique. Above, the view from above takes over, on the left the
    // one from the front; the right is not asked for.
    assert!(is_grey(picture.at(320, 240 - 205)), "{:?}", picture.at(320, 35));
    assert!(is_grey(picture.at(320 - 205, 240)), "{:?}", picture.at(115, 240));
    let right = picture.at(320 + 205, 240);
    assert!(is_grey(right) && right[0] < picture.at(115, 240)[0], "not asked for is darker: {right:?}");
    // The direction (0.45, 0.50, −0.74) is farther than 60° from every view.
    let below_right = picture.at(320 + 111, 240 + 165);
    assert!(is_missed(below_right), "{below_right:?}");
    for (x, y) in [(320, 240 - 150), (320 + 150, 240)] {
        assert!(is_measured(picture.at(x, y)), "{:?}", picture.at(x, y));
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn same_bytes_on_any_number_of_threads() {
    let mesh = sphere();
    let outcome = sphere_outcome(&mesh);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| page(&mesh, &outcome, "sphere", &Echo::default()))
    };
    assert!(on(1) == on(3));
    assert_eq!(text(&outcome.plan), text(&sphere_outcome(&mesh).plan));
}

#[test]
fn face_table_adds_up() {
    let mesh = sphere();
    let outcome = sphere_outcome(&mesh);
    let csv = coverage::csv(&outcome, &mesh, PLAN_SHA256);
    let mut lines = csv.split("\r\n");
    assert_eq!(lines.next(), Some("face,area_mm2,measured_fraction,best_grade,reason,plan_sha256"));
    let rows: Vec<Vec<&str>> = lines.filter(|line| !line.is_empty()).map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 24 * 48);
    assert!(rows.iter().enumerate().all(|(face, row)| row.len() == 6 && row[0] == face.to_string()));
    assert!(rows.iter().enumerate().all(|(face, row)| row[5] == if face == 0 { PLAN_SHA256 } else { "" }));
    let number = |cell: &str| cell.parse::<f64>().expect("a number");
    let area: f64 = rows.iter().map(|row| number(row[1])).sum();
    let measured: f64 = rows.iter().map(|row| number(row[1]) * number(row[2])).sum();
    let coverage = &outcome.plan.coverage;
    assert!((area / coverage.total_area_mm2 - 1.0).abs() < 1e-9);
    assert!((measured - coverage.measured.area_mm2).abs() < 1e-3 * coverage.measured.area_mm2);
    assert!(rows.iter().any(|row| row[4] == "shadow_left") && rows.iter().any(|row| row[4] == "not_asked"));
    let document = coverage::json(&outcome, &mesh, PLAN_SHA256);
    let counts = document.faces;
    assert_eq!(counts.total, 24 * 48);
    assert_eq!(counts.total, counts.measured + counts.partly_measured + counts.missed + counts.not_asked);
    assert!(counts.measured > 0 && counts.partly_measured > 0 && counts.missed > 0 && counts.not_asked > 0);
}

#[test]
fn preview_bytes_tell_the_same_story_on_fewer_faces() {
    let mesh = sphere();
    let outcome = sphere_outcome(&mesh);
    let shares = |max_triangles: usize| {
        let preview = preview(&mesh, max_triangles, &Poll::never()).expect("not interrupted");
        let bytes = coverage::bin(&outcome, &preview);
        assert_eq!(bytes.len(), preview.faces.len());
        assert!(preview.face_of_triangle.iter().all(|face| *face != NOT_DRAWN));
        assert!(bytes.iter().all(|byte| matches!(byte, 0..=3 | 16..=31 | 255)));
        let area_of = |face: usize| {
            let [a, b, c] = preview.faces[face].map(|v| Point3::from(preview.positions_mm[v as usize].map(f64::from)));
            0.5 * (b - a).cross(&(c - a)).norm()
        };
        let total: f64 = (0..bytes.len()).map(area_of).sum();
        [0..4, 16..32, 255..256].map(|class: std::ops::Range<u16>| {
            (0..bytes.len()).filter(|face| class.contains(&u16::from(bytes[*face]))).map(area_of).sum::<f64>() / total
        })
    };
    let (all, fewer) = (shares(1_000_000), shares(900));
    let measured = outcome.plan.coverage.of_total();
    assert!((all[0] - measured).abs() < 0.02, "{all:?} {measured}");
    assert!((0..3).all(|class| (all[class] - fewer[class]).abs() < 0.05), "{all:?} {fewer:?}");
}

#[test]
fn listings_carry_the_contracts_names() {
    let mesh = sphere();
    let outcome = sphere_outcome(&mesh);
    let views = serde_json::to_value(viewpoints::json(&outcome.plan, PLAN_SHA256)).expect("JSON");
    assert_eq!(views["sequence"], serde_json::json!([3, 2, 1, 0]));
    for key in ["id", "candidate", "label", "part_from_scanner", "gain_of_asked", "score", "station", "rejected"] {
        assert!(views["viewpoints"][2].get(key).is_some(), "{key}");
    }
    let csv = viewpoints::csv(&outcome.plan, PLAN_SHA256);
    let rows: Vec<Vec<&str>> = csv.split("\r\n").filter(|line| !line.is_empty()).map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 1 + 4);
    assert!(rows.iter().all(|row| row.len() == rows[0].len()));
    let column = |name: &str| rows[0].iter().position(|header| *header == name).expect("a column");
    assert_eq!((rows[2][column("label")], rows[2][column("visit")], rows[4][column("visit")]), ("front", "2", "0"));
    assert!(rows[1..].iter().all(|row| row[column("plan_sha256")] == PLAN_SHA256), "{csv}");
    assert_eq!(rows[1][column("x_mm")].parse::<f64>().expect("a number"), 520.0);

    let listing = serde_json::to_value(missed::json(&outcome.plan, PLAN_SHA256)).expect("JSON");
    assert_eq!((&listing["plan_sha256"], &views["plan_sha256"]), (&PLAN_SHA256.into(), &PLAN_SHA256.into()));
    let shadow = &listing["missed"][1];
    assert_eq!(
        (shadow["reason"].as_str(), shadow["spots"].as_u64(), shadow["remedy"]["kind"].as_str()),
        (Some("shadow_left"), Some(1), Some("tilt"))
    );
    assert!(listing["missed"][0]["remedy"].is_null(), "none was sought");
    let treated = &shadow["largest"][0];
    assert_eq!((&treated["remedy"], &shadow["listing"][0]["remedy"]), (&shadow["remedy"], &shadow["remedy"]));
    assert_eq!(treated["extent_mm"], serde_json::json!([12.0, 34.5, 6.0]));
    let tilt_deg = treated["remedy"]["views"][0]["tilt_deg"].as_f64().expect("an angle");
    assert!((tilt_deg - 20.0).abs() < 1e-9 && treated["remedy"]["views"][0]["part_from_scanner"].is_object());
    let faces = shadow["listing"][0]["faces"].as_array().expect("faces");
    assert!(!faces.is_empty() && faces.iter().all(|face| face.as_u64() < Some(24 * 48)));
}
