//! Checks on the document of a plan, whoever wrote it: names from closed lists, shares in range that add up, ids and sequence
//! that are consistent, parameters that the rest of the plan bears out; and with the cell, that the plan was made in it and
//! every station puts the scanner on its viewpoint.

mod elsewhere;
pub(super) mod params;
mod regions;

use std::collections::BTreeSet;

use nalgebra::Point3;

use super::place::CheckPlace;
use super::{setup_count, table_from_part, views_in};
use crate::cell::{Cell, Configuration, DeviceName, FieldError, Findings, Scanner};
use crate::geometry::{Device, ScannerFrame};
use crate::planning::candidates::Label;
use crate::planning::plan::{AdviceKind, Cause, RemedyKind, RiskReason, StopReason, ViewId};
use crate::program;
use crate::wire::plan::{
    CellDocument, CoverageDocument, PartDocument, PlanDocument, RemedyDocument, StationDocument, ViewpointDocument,
    VisibleSharesDocument,
};

/// Tolerance of sums of shares.
const SHARE_TOLERANCE: f64 = 1e-9;
/// Tolerance of areas, as a share of the asked area: they are sums in different orders.
const AREA_TOLERANCE: f64 = 1e-6;
/// Tolerance of depths, mm: they went through a file.
const ROUNDING_MM: f64 = 1e-6;
/// Tolerance of times, s: they are sums in different orders.
const ROUNDING_SECS: f64 = 1e-6;
/// Difference of a time from its lower bound that is rounding, s, and as a share of it.
const BOUND_ROUNDING_SECS: f64 = 0.005;
const BOUND_ROUNDING: f64 = 1e-4;
/// Tolerance of angles, °: they were converted to degrees and back.
const ROUNDING_DEG: f64 = 1e-6;
/// Causes for which a chosen view may measure nothing.
const REJECTED: [Cause; 3] = [Cause::Unreachable, Cause::Collision, Cause::NoPath];

/// Checks the document; every finding.
pub(super) fn check(document: &PlanDocument, place: Option<CheckPlace<'_>>) -> Result<(), Vec<FieldError>> {
    let mut findings = Findings::default();
    match document.params.check_of_plan() {
        Ok(()) => params::check(document, &mut findings),
        Err(errors) => {
            errors.into_iter().for_each(|error| findings.push(format!("/params{}", error.pointer), error.detail));
        }
    }
    let elsewhere = place.map(|place| elsewhere::found(document, place)).unwrap_or_default();
    // In other surroundings than the plan's everything else would differ too.
    let place = place.filter(|_| elsewhere.is_empty());
    let scanner = place.and_then(CheckPlace::scanner);
    elsewhere.into_iter().for_each(|error| findings.push(error.pointer, error.detail));
    check_part(&document.part, &mut findings);
    check_fixture(document, &mut findings);
    check_devices(document, &mut findings);
    check_limits(document, scanner, &mut findings);
    check_depth(document, scanner, &mut findings);
    check_candidates(document, &mut findings);
    check_coverage(&document.coverage, &mut findings);
    check_total(document, &mut findings);
    regions::check(document, &mut findings);
    check_views(document, &mut findings);
    check_motion(document, &mut findings);
    check_missed(document, &mut findings);
    check_advice(document, &mut findings);
    check_bound(document, &mut findings);
    one_of("/stopped_because", &document.stopped_because, &StopReason::ALL.map(StopReason::as_str), &mut findings);
    check_setups(document, &mut findings);
    document.cell.iter().for_each(|planned_in| check_cell(planned_in, &mut findings));
    if let Some(cell) = place.and_then(CheckPlace::cell) {
        (0..setup_count(document)).for_each(|setup| check_stations(document, cell, setup, &mut findings));
    }
    findings.into_result()
}

/// Joints and table angle of a station.
pub(super) fn configuration(station: &StationDocument) -> Configuration {
    Configuration { joints_rad: station.joints_deg.map(f64::to_radians), table_rad: station.table_angle_deg.to_radians() }
}

fn one_of(pointer: impl std::fmt::Display, name: &str, allowed: &[&str], findings: &mut Findings) {
    findings.require(allowed.contains(&name), pointer, || format!("is {name:?}; allowed is one of {}", allowed.join(", ")));
}

fn above_zero(pointer: &str, value: f64, unit: &str, findings: &mut Findings) {
    let is_above = value.is_finite() && value > 0.0;
    findings.require(is_above, pointer, || format!("is {value} {unit}; allowed is above 0 {unit}"));
}

/// Requires a share of 0 to 1, within rounding.
fn share(pointer: impl std::fmt::Display, value: f64, findings: &mut Findings) {
    let is_share = (-SHARE_TOLERANCE..=1.0 + SHARE_TOLERANCE).contains(&value);
    findings.require(is_share, pointer, || format!("is {value}; allowed is 0 to 1"));
}

/// Requires a SHA-256 as lower-case hexadecimal.
fn check_sha256(pointer: &str, sha256: &str, findings: &mut Findings) {
    let is_hash = sha256.len() == 64 && sha256.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
    findings.require(is_hash, pointer, || format!("is {sha256:?}; allowed are 64 of 0-9 and a-f"));
}

fn check_part(part: &PartDocument, findings: &mut Findings) {
    check_sha256("/part/sha256", &part.sha256, findings);
    findings.require(part.triangles > 0, "/part/triangles", || "is 0; allowed is 1 and more".into());
    above_zero("/part/area_mm2", part.area_mm2, "mm²", findings);
    let (min, max) = (part.bbox_mm.min, part.bbox_mm.max);
    findings.require((0..3).all(|axis| min[axis] <= max[axis]), "/part/bbox_mm/min", || {
        format!("is {min:?}; allowed is up to max, {max:?}, in every axis")
    });
}

/// Requires the name of a fixture that the plan tells of: without it the parameters are those of a part without a fixture, and
/// views that are planned by them again may collide with it.
fn check_fixture(document: &PlanDocument, findings: &mut Findings) {
    let Some(fixture) = &document.fixture else { return };
    check_sha256("/fixture/sha256", &fixture.sha256, findings);
    findings.require(document.params.part.fixture_mesh.is_some(), "/fixture", || {
        "is given, and params.part.fixture_mesh is null: by that the part was planned without a fixture; plan again".into()
    });
}

/// Requires optics that are some: with a pose that is none, or without a focal length, nothing would be found to be seen.
fn check_devices(document: &PlanDocument, findings: &mut Findings) {
    for (index, device) in document.scanner.devices.iter().enumerate() {
        let at = format!("/scanner/devices/{index}");
        device.scanner_from_device.check(&format!("{at}/scanner_from_device"), findings);
        for (field, value) in [("fx", device.fx), ("fy", device.fy)] {
            above_zero(&format!("{at}/{field}"), value, "px", findings);
        }
    }
}

/// Requires of each device the limit of incidence that is in force: its own or the job's, whichever is tighter.
fn check_limits(document: &PlanDocument, scanner: Option<&Scanner>, findings: &mut Findings) {
    let limits_beyond = scanner.and_then(|scanner| document.params.check_limits(scanner).err()).unwrap_or_default();
    limits_beyond.into_iter().for_each(|error| findings.push(format!("/params{}", error.pointer), error.detail));
    for (index, device) in document.scanner.devices.iter().enumerate() {
        let Some(name) = DeviceName::ALL.into_iter().find(|name| name.as_str() == device.name) else { continue };
        let of_scanner_deg = scanner.map(|scanner| scanner.devices[name].incidence_max_rad.to_degrees());
        let limits_deg = [of_scanner_deg, device.incidence_own_deg, document.params.limits.given_deg(name)];
        let max_deg = limits_deg.into_iter().flatten().fold(f64::INFINITY, f64::min);
        let is_within = device.incidence_max_deg <= max_deg + ROUNDING_DEG;
        findings.require(is_within, format!("/scanner/devices/{index}/incidence_max_deg"), || {
            format!(
                "is {} °; allowed is up to {max_deg} °, the tighter of the device's own limit and the job's",
                device.incidence_max_deg
            )
        });
        // The device's own limit is told where that of the job is tighter, and so in force.
        let is_in_force = device.incidence_own_deg.is_none() || device.incidence_max_deg >= max_deg - ROUNDING_DEG;
        findings.require(is_in_force, format!("/scanner/devices/{index}/incidence_max_deg"), || {
            format!("is {} °; by incidence_own_deg and params.limits it is {max_deg} °", device.incidence_max_deg)
        });
    }
}

/// Requires best focus within the working depth and in focus for every device; with the scanner, no depth beyond its own.
fn check_depth(document: &PlanDocument, scanner: Option<&Scanner>, findings: &mut Findings) {
    let depth = &document.scanner.depth_mm;
    let is_ordered = 0.0 < depth.near && depth.near < depth.best && depth.best < depth.far && depth.far.is_finite();
    findings.require(is_ordered, "/scanner/depth_mm", || {
        format!("is near {}, best {}, far {} mm; allowed is 0 < near < best < far", depth.near, depth.best, depth.far)
    });
    if let Some(scanner) = scanner {
        let range = [scanner.near_mm, scanner.far_mm];
        within_slab("/scanner/depth_mm", ["near", "far"], [Some(depth.near), Some(depth.far)], range, findings);
    }
    for (index, device) in document.scanner.devices.iter().enumerate() {
        let at = format!("/scanner/devices/{index}");
        let in_focus_mm = [device.in_focus_from_mm, device.in_focus_to_mm];
        let best = Point3::new(0.0, 0.0, depth.best);
        let best_mm = device.scanner_from_device.pose::<ScannerFrame, Device>().inverse().point(&best).z;
        let [from_mm, to_mm] = [in_focus_mm[0].unwrap_or(f64::NEG_INFINITY), in_focus_mm[1].unwrap_or(f64::INFINITY)];
        let is_in_focus = (from_mm - ROUNDING_MM..=to_mm + ROUNDING_MM).contains(&best_mm);
        findings.require(is_in_focus, format!("{at}/in_focus_from_mm"), || {
            format!("to in_focus_to_mm is {from_mm} to {to_mm} mm; best focus, {best_mm:.3} mm from the device, must lie in it")
        });
        let of_scanner = DeviceName::ALL.into_iter().find(|name| name.as_str() == device.name).zip(scanner);
        if let Some((name, scanner)) = of_scanner {
            let range = scanner.devices[name].in_focus_mm;
            within_slab(&at, ["in_focus_from_mm", "in_focus_to_mm"], in_focus_mm, range, findings);
        }
    }
}

/// Requires the two ends of a range of depths within that of the scanner; an end that is missing is an infinite one.
fn within_slab(at: &str, fields: [&str; 2], ends_mm: [Option<f64>; 2], [near_mm, far_mm]: [f64; 2], findings: &mut Findings) {
    let [low, high] = [ends_mm[0].unwrap_or(f64::NEG_INFINITY), ends_mm[1].unwrap_or(f64::INFINITY)];
    let shown = |end: Option<f64>| end.map_or_else(|| "without a limit".to_owned(), |mm| format!("{mm} mm"));
    findings.require(low >= near_mm - ROUNDING_MM, format!("{at}/{}", fields[0]), || {
        format!("is {}; allowed is {near_mm} mm and more, as in the scanner itself", shown(ends_mm[0]))
    });
    findings.require(high <= far_mm + ROUNDING_MM, format!("{at}/{}", fields[1]), || {
        format!("is {}; allowed is up to {far_mm} mm, as in the scanner itself", shown(ends_mm[1]))
    });
}

fn check_candidates(document: &PlanDocument, findings: &mut Findings) {
    let (kept, generated) = (document.candidates.kept, document.candidates.generated);
    findings.require(kept <= generated, "/candidates/kept", || format!("is {kept}; allowed is up to generated, {generated}"));
    let views = document.viewpoints.len();
    findings.require(views <= kept, "/viewpoints", || format!("has {views} entries; allowed is up to candidates.kept, {kept}"));
    let Some(chosen_on) = &document.chosen_on else { return };
    findings.require(chosen_on.samples <= chosen_on.of_samples, "/chosen_on/samples", || {
        format!("is {}; allowed is up to of_samples, {}", chosen_on.samples, chosen_on.of_samples)
    });
}

fn check_coverage(coverage: &CoverageDocument, findings: &mut Findings) {
    let asked_mm2 = coverage.asked_area_mm2;
    above_zero("/coverage/asked_area_mm2", asked_mm2, "mm²", findings);
    let areas = [
        ("measured_area_mm2", coverage.measured_area_mm2, coverage.coverable_area_mm2),
        ("coverable_area_mm2", coverage.coverable_area_mm2, coverage.optically_coverable_area_mm2),
        ("optically_coverable_area_mm2", coverage.optically_coverable_area_mm2, asked_mm2),
        ("visible_area_mm2", coverage.visible_area_mm2, asked_mm2),
    ];
    for (field, area_mm2, whole_mm2) in areas {
        let fits = (0.0..=whole_mm2 + AREA_TOLERANCE * asked_mm2).contains(&area_mm2);
        findings.require(fits, format!("/coverage/{field}"), || format!("is {area_mm2} mm²; allowed is 0 to {whole_mm2} mm²"));
    }
    check_visible("/coverage", &coverage.visible, findings);
    let shares = [("of_asked", coverage.of_asked), ("of_coverable", coverage.of_coverable), ("of_total", coverage.of_total)];
    for (field, value) in shares {
        share(format!("/coverage/{field}"), value, findings);
    }
    for (field, value, whole_mm2) in
        [("of_asked", coverage.of_asked, asked_mm2), ("of_coverable", coverage.of_coverable, coverage.coverable_area_mm2)]
    {
        let derived = if whole_mm2 > 0.0 { coverage.measured_area_mm2 / whole_mm2 } else { 0.0 };
        findings.require((value - derived).abs() <= AREA_TOLERANCE, format!("/coverage/{field}"), || {
            format!("is {value}; by measured_area_mm2 it is {derived}")
        });
    }
    if coverage.visible_area_mm2 > 0.0 {
        let derived = coverage.measured_area_mm2 / coverage.visible_area_mm2;
        let value = coverage.visible.of_visible;
        findings.require((value - derived).abs() <= SHARE_TOLERANCE, "/coverage/of_visible", || {
            format!("is {value}; by measured_area_mm2 and visible_area_mm2 it is {derived}")
        });
    }
    check_grades(coverage, findings);
    check_curve(coverage, findings);
    check_certificate(coverage, findings);
    check_at_risk(coverage, findings);
}

/// Requires the share of the whole surface that follows from the area of the part.
fn check_total(document: &PlanDocument, findings: &mut Findings) {
    let (coverage, area_mm2) = (&document.coverage, document.part.area_mm2);
    let derived = coverage.measured_area_mm2 / area_mm2;
    let has_area = area_mm2 > 0.0;
    // An area that is none is a finding of its own.
    let agrees = !has_area || (coverage.of_total - derived).abs() <= AREA_TOLERANCE;
    findings.require(agrees, "/coverage/of_total", || {
        format!("is {}; by measured_area_mm2 and part.area_mm2 it is {derived}", coverage.of_total)
    });
}

/// Requires area at risk within the asked area, and no more for a reason than in all.
fn check_at_risk(coverage: &CoverageDocument, findings: &mut Findings) {
    let Some(at_risk) = &coverage.at_risk else { return };
    let asked_mm2 = coverage.asked_area_mm2;
    let mut within = |at: String, area_mm2: f64, whole_mm2: f64| {
        let fits = (0.0..=whole_mm2 + AREA_TOLERANCE * asked_mm2).contains(&area_mm2);
        findings.require(fits, at, || format!("is {area_mm2} mm²; allowed is 0 to {whole_mm2} mm²"));
    };
    let measured_mm2 = if at_risk.counted { coverage.measured_area_mm2 } else { asked_mm2 - coverage.measured_area_mm2 };
    within("/coverage/at_risk/area_mm2".to_owned(), at_risk.area_mm2, measured_mm2);
    for (index, reason) in at_risk.reasons.iter().enumerate() {
        within(format!("/coverage/at_risk/reasons/{index}/area_mm2"), reason.area_mm2, at_risk.area_mm2);
    }
    for (index, reason) in at_risk.reasons.iter().enumerate() {
        let at = format!("/coverage/at_risk/reasons/{index}/reason");
        one_of(at, &reason.reason, &RiskReason::ALL.map(RiskReason::as_str), findings);
    }
}

/// Requires shares of the visible area, none of a part larger than that of the whole.
fn check_visible(at: &str, shares: &VisibleSharesDocument, findings: &mut Findings) {
    share(format!("{at}/of_visible"), shares.of_visible, findings);
    let parts = [
        ("grades_a_b_of_visible", shares.grades_a_b_of_visible, shares.of_visible),
        ("within_35_deg_of_visible", shares.within_35_deg_of_visible, shares.within_60_deg_of_visible),
        ("within_60_deg_of_visible", shares.within_60_deg_of_visible, shares.of_visible),
    ];
    for (field, value, whole) in parts {
        let fits = (0.0..=whole + SHARE_TOLERANCE).contains(&value);
        findings.require(fits, format!("{at}/{field}"), || format!("is {value}; allowed is 0 to {whole}"));
    }
}

fn check_certificate(coverage: &CoverageDocument, findings: &mut Findings) {
    if let Some(independent) = &coverage.independent {
        share("/coverage/independent/of_asked", independent.of_asked, findings);
        share("/coverage/independent/of_total", independent.of_total, findings);
        check_visible("/coverage/independent", &independent.visible, findings);
        let (of_asked, of_visible) = (independent.of_asked, independent.visible.of_visible);
        // Plans from before the visible area was told have 0 there.
        let is_told = coverage.visible_area_mm2 > 0.0;
        findings.require(!is_told || of_asked <= of_visible + SHARE_TOLERANCE, "/coverage/independent/of_asked", || {
            format!("is {of_asked}; allowed is up to of_visible, {of_visible}: what is visible is part of what is asked")
        });
    }
    let Some(robust) = &coverage.robust else { return };
    let mut cases =
        vec![("/coverage/robust/of_asked", robust.of_asked), ("/coverage/robust/part/of_asked", robust.part.of_asked)];
    cases.extend(robust.hand_eye.map(|hand_eye| ("/coverage/robust/hand_eye/of_asked", hand_eye.of_asked)));
    for (at, drawn) in cases {
        share(format!("{at}/nominal"), drawn.nominal, findings);
        share(format!("{at}/mean"), drawn.mean, findings);
        let ordered = 0.0 <= drawn.worst && drawn.worst <= drawn.p5 && drawn.p5 <= 1.0;
        findings.require(ordered, format!("{at}/worst"), || {
            format!("is {}, p5 {}; allowed is 0 ≤ worst ≤ p5 ≤ 1", drawn.worst, drawn.p5)
        });
    }
}

fn check_grades(coverage: &CoverageDocument, findings: &mut Findings) {
    let grades = &coverage.grades;
    for (grade, value) in [("A", grades.a), ("B", grades.b), ("C", grades.c), ("D", grades.d)] {
        share(format!("/coverage/grades/{grade}"), value, findings);
    }
    let (sum, of_asked) = (grades.a + grades.b + grades.c + grades.d, coverage.of_asked);
    findings.require((sum - of_asked).abs() <= SHARE_TOLERANCE, "/coverage/grades", || {
        format!("add up to {sum}; of_asked is {of_asked}")
    });
}

fn check_curve(coverage: &CoverageDocument, findings: &mut Findings) {
    let mut before = 0.0;
    for (index, value) in coverage.curve.iter().copied().enumerate() {
        let at = format!("/coverage/curve/{index}");
        share(&at, value, findings);
        findings.require(value >= before - SHARE_TOLERANCE, at, || {
            format!("is {value}; allowed is the one before, {before}, and more")
        });
        before = value;
    }
    let of_asked = coverage.of_asked;
    findings.require((before - of_asked).abs() <= SHARE_TOLERANCE, "/coverage/curve", || {
        format!("ends at {before}; of_asked is {of_asked}")
    });
}

fn check_bound(document: &PlanDocument, findings: &mut Findings) {
    let (bound, views) = (&document.bound, document.viewpoints.len());
    findings.require(u64::from(bound.views_lower) + u64::from(bound.gap) == views as u64, "/bound/gap", || {
        format!("is {}; viewpoints are {views} and views_lower is {}", bound.gap, bound.views_lower)
    });
    for (field, value) in [("of_asked_upper", bound.of_asked_upper), ("gap_of_asked", bound.gap_of_asked)] {
        if let Some(value) = value {
            share(format!("/bound/{field}"), value, findings);
        }
    }
}

fn check_views(document: &PlanDocument, findings: &mut Findings) {
    let stations: BTreeSet<u32> = document.viewpoints.iter().filter(|view| view.station.is_some()).map(|view| view.id).collect();
    let mut visited = BTreeSet::new();
    for (index, id) in document.sequence.iter().enumerate() {
        let at = format!("/sequence/{index}");
        findings.require(stations.contains(id), &at, || format!("is {id}; allowed are ids of viewpoints with a station"));
        findings.require(visited.insert(*id), at, || format!("visits {id} a second time"));
    }
    for (index, view) in document.viewpoints.iter().enumerate() {
        check_view(index, view, document.cell.is_some(), &visited, findings);
    }
    // A view that is rejected has its entry too: that of the view before.
    let (entries, views) = (document.coverage.curve.len(), document.viewpoints.len());
    findings.require(entries == views, "/coverage/curve", || {
        format!("has {entries} entries; allowed is one for each of the {views} viewpoints, rejected ones among them")
    });
}

/// Requires times that are some, and that the parts of the cycle time add up to it; files of earlier releases have no sum.
fn check_motion(document: &PlanDocument, findings: &mut Findings) {
    let Some(motion) = &document.motion else { return };
    let times = [
        ("moving_secs", motion.moving_secs),
        ("turning_secs", motion.turning_secs),
        ("settling_secs", motion.settling_secs),
        ("scanning_secs", motion.scanning_secs),
        ("ordered_secs", motion.ordered_secs),
        ("ordered_secs_lower", motion.ordered_secs_lower),
        ("moving_secs_lower", motion.moving_secs_lower),
    ];
    for (field, secs) in times {
        let is_time = secs.is_finite() && secs >= -ROUNDING_SECS;
        findings.require(is_time, format!("/motion/{field}"), || format!("is {secs} s; allowed is 0 s and more"));
    }
    let bounded = [
        ("turning_secs", motion.turning_secs, "moving_secs", motion.moving_secs),
        ("moving_secs_lower", motion.moving_secs_lower, "moving_secs", motion.moving_secs),
        ("ordered_secs_lower", motion.ordered_secs_lower, "ordered_secs", motion.ordered_secs),
    ];
    for (field, secs, of, whole_secs) in bounded {
        // Bounds of long tours are sums in single precision; files of earlier releases have no time of the order found.
        let is_within = whole_secs == 0.0 || secs <= whole_secs + BOUND_ROUNDING_SECS.max(BOUND_ROUNDING * whole_secs);
        findings.require(is_within, format!("/motion/{field}"), || format!("is {secs} s, above {of} = {whole_secs} s"));
    }
    if motion.cycle_secs == 0.0 {
        return;
    }
    let sum_secs = motion.moving_secs + motion.settling_secs + motion.scanning_secs;
    findings.require((motion.cycle_secs - sum_secs).abs() <= ROUNDING_SECS, "/motion/cycle_secs", || {
        format!("is {} s; moving, settling and scanning add up to {sum_secs} s", motion.cycle_secs)
    });
}

/// Requires poses of the cell that are poses: with a damaged one nothing would be found to collide.
fn check_cell(cell: &CellDocument, findings: &mut Findings) {
    let poses = [
        ("base_from_table", &cell.base_from_table),
        ("table_from_part", &cell.table_from_part),
        ("flange_from_scanner", &cell.flange_from_scanner),
    ];
    for (field, pose) in poses {
        pose.check(&format!("/cell/{field}"), findings);
    }
}

/// Requires that each viewpoint belongs to exactly one setup, if the part is turned over, and that no setup measures more than
/// the plan.
fn check_setups(document: &PlanDocument, findings: &mut Findings) {
    let mut taken = BTreeSet::new();
    let tolerance_mm2 = AREA_TOLERANCE * document.coverage.asked_area_mm2;
    for (number, setup) in document.setups.iter().enumerate() {
        let whole_mm2 = setup.coverable_area_mm2.min(document.coverage.measured_area_mm2);
        let fits = (-tolerance_mm2..=whole_mm2 + tolerance_mm2).contains(&setup.measured_area_mm2);
        findings.require(fits, format!("/setups/{number}/measured_area_mm2"), || {
            format!("is {} mm²; allowed is 0 to {whole_mm2} mm²", setup.measured_area_mm2)
        });
        setup.table_from_part.check(&format!("/setups/{number}/table_from_part"), findings);
        for (index, id) in setup.viewpoints.iter().enumerate() {
            let at = format!("/setups/{number}/viewpoints/{index}");
            findings
                .require((*id as usize) < document.viewpoints.len(), &at, || format!("is {id}; allowed are ids of viewpoints"));
            findings.require(taken.insert(*id), at, || format!("takes {id} a second time"));
        }
    }
    let all = document.setups.is_empty() || taken.len() == document.viewpoints.len();
    findings.require(all, "/setups", || "leave viewpoints out; allowed is each viewpoint in one setup".into());
}

fn check_view(index: usize, view: &ViewpointDocument, with_cell: bool, visited: &BTreeSet<u32>, findings: &mut Findings) {
    let at = format!("/viewpoints/{index}");
    findings.require(view.id as usize == index, format!("{at}/id"), || {
        format!("is {}; allowed is {index}: viewpoints count from 0 in the order chosen", view.id)
    });
    one_of(format!("{at}/label"), &view.label, &Label::ALL.map(Label::as_str), findings);
    view.part_from_scanner.check(&format!("{at}/part_from_scanner"), findings);
    share(format!("{at}/gain_of_asked"), view.gain_of_asked, findings);
    if let Some(rejected) = &view.rejected {
        one_of(format!("{at}/rejected"), rejected, &REJECTED.map(Cause::as_str), findings);
    }
    let station = match (view.station.is_some(), with_cell, view.rejected.is_some()) {
        (true, false, _) => Some("is given, but the plan has no cell; allowed is null"),
        (true, _, true) => Some("is given, but the view is rejected; allowed is null"),
        (true, ..) if !visited.contains(&view.id) => Some("is given, but the sequence leaves it out"),
        (false, true, false) => Some("is missing; a plan with a cell has one, or says why in rejected"),
        _ => None,
    };
    findings.require(station.is_none(), format!("{at}/station"), || station.unwrap_or_default().into());
}

fn check_missed(document: &PlanDocument, findings: &mut Findings) {
    let mut causes = BTreeSet::new();
    for (index, missed) in document.missed.iter().enumerate() {
        let at = format!("/missed/{index}");
        one_of(format!("{at}/reason"), &missed.reason, &Cause::ALL.map(Cause::as_str), findings);
        findings.require(causes.insert(&missed.reason), format!("{at}/reason"), || {
            format!("is {:?} a second time; allowed is one entry a cause", missed.reason)
        });
        above_zero(&format!("{at}/area_mm2"), missed.area_mm2, "mm²", findings);
        for (spot, treated) in missed.largest.iter().enumerate() {
            let at = format!("{at}/largest/{spot}/remedy");
            check_remedy(&at, &treated.remedy, findings);
            check_raised_limits(&at, &treated.remedy, document, findings);
        }
    }
    let coverage = &document.coverage;
    let left_mm2 = coverage.asked_area_mm2 - coverage.measured_area_mm2;
    let missed_mm2: f64 = document.missed.iter().fold(0.0, |sum, missed| sum + missed.area_mm2);
    findings.require((missed_mm2 - left_mm2).abs() <= AREA_TOLERANCE * coverage.asked_area_mm2, "/missed", || {
        format!("adds up to {missed_mm2} mm²; asked less measured is {left_mm2} mm²")
    });
}

fn check_advice(document: &PlanDocument, findings: &mut Findings) {
    for (index, advice) in document.advice.iter().enumerate() {
        let at = format!("/advice/{index}");
        one_of(format!("{at}/kind"), &advice.kind, &AdviceKind::ALL.map(AdviceKind::as_str), findings);
        share(format!("{at}/of_asked"), advice.of_asked, findings);
        share(format!("{at}/of_visible"), advice.of_visible, findings);
        let is_for_grades = advice.kind == AdviceKind::BetterGrades.as_str();
        findings.require(advice.grade_a_of_asked.is_some() == is_for_grades, format!("{at}/grade_a_of_asked"), || {
            format!("belongs to kind better_grades, and to no other; kind is {:?}", advice.kind)
        });
        advice.grade_a_of_asked.into_iter().for_each(|of_asked| share(format!("{at}/grade_a_of_asked"), of_asked, findings));
    }
}

fn check_remedy(at: &str, remedy: &RemedyDocument, findings: &mut Findings) {
    one_of(format!("{at}/kind"), &remedy.kind, &RemedyKind::ALL.map(RemedyKind::as_str), findings);
    share(format!("{at}/of_spot"), remedy.of_spot, findings);
    let works = remedy.kind != RemedyKind::None.as_str();
    findings.require(works != remedy.views.is_empty(), format!("{at}/views"), || {
        format!("has {} entries with kind {:?}; only none has no view", remedy.views.len(), remedy.kind)
    });
}

/// Requires that a remedy raises no limit beyond the own limit of a device.
fn check_raised_limits(at: &str, remedy: &RemedyDocument, document: &PlanDocument, findings: &mut Findings) {
    for device in &document.scanner.devices {
        let (field, raised_deg) = match device.name.as_str() {
            "projector" => ("projector_deg", remedy.projector_deg),
            _ => ("camera_deg", remedy.camera_deg),
        };
        let (Some(own_deg), Some(raised_deg)) = (device.incidence_own_deg, raised_deg) else { continue };
        findings.require(raised_deg <= own_deg + ROUNDING_DEG, format!("{at}/{field}"), || {
            format!("is {raised_deg} °; allowed is up to {own_deg} °, the own limit of the device {}", device.name)
        });
    }
}

/// Requires stations of a setup within the limits of the axes and at their views.
fn check_stations(document: &PlanDocument, cell: &Cell, setup: usize, findings: &mut Findings) {
    let Some(table_from_part) = table_from_part(document, setup) else { return };
    let axes = cell.axes();
    for (index, view) in views_in(document, setup) {
        let Some(station) = &view.station else { continue };
        let configuration = configuration(station);
        let at = format!("/viewpoints/{index}/station");
        for (axis, (limits, angle)) in axes.0.iter().zip(configuration.axes_rad()).enumerate() {
            let (min_deg, max_deg) = (limits.min_rad.to_degrees(), limits.max_rad.to_degrees());
            let field = if axis < configuration.joints_rad.len() {
                format!("{at}/joints_deg/{axis}")
            } else {
                format!("{at}/table_angle_deg")
            };
            findings.range(field, angle.to_degrees(), min_deg - ROUNDING_DEG, max_deg + ROUNDING_DEG, "°");
        }
        let wanted = view.part_from_scanner.pose();
        if let Some(fault) = program::off_pose(cell, &table_from_part, ViewId(view.id), &configuration, &wanted) {
            findings.push(at, fault.to_string());
        }
    }
}
