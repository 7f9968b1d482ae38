//! Parameters of a plan held against what the plan says elsewhere. A plan tells them so that it can be made again and so that
//! its program and its coverage are checked by them; those that an edit would change alone are found here. What steers the
//! choice of views leaves no trace that could be compared: [`tell`] says so.

use std::collections::BTreeMap;

use serde_json::Value;

use super::{ROUNDING_SECS, elsewhere};
use crate::cell::Findings;
use crate::check::Sound;
use crate::geometry::{Part, Pose, Table};
use crate::planning::params::{PoseErrorParams, Preset};
use crate::planning::plan::StopReason;
use crate::planning::surface::requirements;
use crate::wire::plan::PlanDocument;
use crate::wire::preset::set_by;
use crate::wire::words::counted;

/// Tolerance of poses that went through a file: mm and °.
const SAME_POSE: (f64, f64) = (1e-6, 1e-4);

/// Checks parameters that are in their ranges.
pub(super) fn check(document: &PlanDocument, findings: &mut Findings) {
    check_preset(document, findings);
    check_scan_times(document, findings);
    check_exposures(document, findings);
    check_regions(document, findings);
    check_counts(document, findings);
    check_robust(document, findings);
    check_what_counts(document, findings);
    check_pose(document, findings);
}

/// Returns true for a plan of this release: others may have set and told otherwise.
fn is_of_this_release(document: &PlanDocument) -> bool {
    document.version == env!("CARGO_PKG_VERSION")
}

/// Requires what the preset sets.
fn check_preset(document: &PlanDocument, findings: &mut Findings) {
    if !is_of_this_release(document) {
        return;
    }
    let params = serde_json::to_value(&document.params).unwrap_or_default();
    let mut otherwise = Vec::new();
    set_otherwise(&set_by(document.params.preset), &params, "", &mut otherwise);
    findings.require(otherwise.is_empty(), "/params/preset", || {
        format!("is {}, with which the plan was not made: it sets {}", params["preset"], otherwise.join(", "))
    });
}

/// Adds a phrase on each parameter in `set` that `params` have with another value.
fn set_otherwise(set: &Value, params: &Value, key: &str, otherwise: &mut Vec<String>) {
    if let Value::Object(fields) = set {
        for (name, field) in fields {
            let key = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
            set_otherwise(field, &params[name.as_str()], &key, otherwise);
        }
    } else if set != params {
        otherwise.push(format!("{key} to {set}, and the plan has {params}"));
    }
}

/// Requires the times of settling and of capture that the cycle has; files of earlier releases have none.
fn check_scan_times(document: &PlanDocument, findings: &mut Findings) {
    let Some(motion) = document.motion.as_ref().filter(|motion| motion.cycle_secs != 0.0) else { return };
    let captures_of: BTreeMap<u32, usize> = document
        .viewpoints
        .iter()
        .map(|view| (view.id, view.exposure.as_ref().map_or(1, |exposure| exposure.levels.len())))
        .collect();
    let captures: usize = document.sequence.iter().filter_map(|id| captures_of.get(id)).sum();
    let (scan, visits) = (&document.params.scan, document.sequence.len());
    let times = [
        ("settle_secs", scan.settle_secs, visits, "settling_secs", motion.settling_secs),
        ("capture_secs", scan.capture_secs, captures, "scanning_secs", motion.scanning_secs),
    ];
    for (field, once_secs, count, sum_field, sum_secs) in times {
        let derived_secs = once_secs * count as f64;
        let agrees = (sum_secs - derived_secs).abs() <= ROUNDING_SECS * derived_secs.max(1.0);
        findings.require(agrees, format!("/params/scan/{field}"), || {
            format!("is {once_secs} s; {count} times that are {derived_secs} s, and motion.{sum_field} is {sum_secs} s")
        });
    }
}

/// Requires an exposure of each view where materials or brightness ask for it, and levels that the brightness allows.
fn check_exposures(document: &PlanDocument, findings: &mut Findings) {
    let is_asked = document.params.material_of_part().is_some();
    let allowed = document.params.scan.brightness.levels();
    for (index, view) in document.viewpoints.iter().enumerate().filter(|(_, view)| view.rejected.is_none()) {
        let at = format!("/viewpoints/{index}/exposure");
        findings.require(view.exposure.is_some() == is_asked, &at, || {
            let asks = "params.materials or params.scan.brightness";
            if is_asked {
                format!("is missing; {asks} asks for it")
            } else {
                format!("is given; allowed where {asks} asks for it")
            }
        });
        let Some(exposure) = &view.exposure else { continue };
        let levels = &exposure.levels;
        let fits = !levels.is_empty() && levels.iter().all(|level| allowed.contains(level)) && levels.is_sorted();
        findings.require(fits, format!("{at}/levels"), || {
            let (low, high) = (allowed.start(), allowed.end());
            format!("is {levels:?}; allowed by params.scan.brightness are levels of {low} to {high}, ascending")
        });
    }
}

/// Returns false for a plan from before regions had a kind, which told less of them.
fn tells_regions(document: &PlanDocument) -> bool {
    document.coverage.regions.first().map_or_else(|| is_of_this_release(document), |region| !region.kind.is_empty())
}

/// Requires the coverage of each region of interest and feature that the parameters have, and no other.
fn check_regions(document: &PlanDocument, findings: &mut Findings) {
    let regions = &document.coverage.regions;
    if !tells_regions(document) {
        return;
    }
    let asked = requirements::regions(&document.params);
    findings.require(asked.len() == regions.len(), "/coverage/regions", || {
        format!("has {} entries; params.regions has {} regions of interest and features", regions.len(), asked.len())
    });
    for (index, (asked, region)) in asked.iter().zip(regions).enumerate() {
        let mut same = |field: &str, told: String, asked: String, is_same: bool| {
            findings.require(is_same, format!("/coverage/regions/{index}/{field}"), || {
                format!("is {told}; by params.regions it is {asked}")
            });
        };
        let (name, kind) = (format!("{:?}", asked.name), format!("{:?}", asked.kind.as_str()));
        same("name", format!("{:?}", region.name), name, region.name == asked.name);
        same("kind", format!("{:?}", region.kind), kind, region.kind == asked.kind.as_str());
        let (told_mm, asked_mm) = (region.tolerance_mm, asked.tolerance_mm);
        same("tolerance_mm", number(told_mm), number(asked_mm), is_same_number(told_mm, asked_mm));
        // The target of a region is one for all of it, and counts for nothing where the open rest alone is asked.
        if !document.coverage.of_open {
            let is_same = is_same_number(region.target, asked.target);
            same("target", number(region.target), number(asked.target), is_same);
        }
    }
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "null".to_owned(), |value| value.to_string())
}

/// Returns true for the same number to the last bit, as it is read back from a file.
fn is_same_number(one: Option<f64>, other: Option<f64>) -> bool {
    one.map(f64::to_bits) == other.map(f64::to_bits)
}

/// Requires no more setups and views than the parameters allow. Further views after a scan have a limit of their own.
fn check_counts(document: &PlanDocument, findings: &mut Findings) {
    let (setups, max_setups) = (document.setups.len(), document.params.setups);
    findings.require(setups <= max_setups.max(1) as usize, "/params/setups", || {
        format!("is {max_setups}; the plan has {}, and no more than this parameter allows", counted(setups, "setup"))
    });
    if document.coverage.of_open {
        return;
    }
    let (views, max_views) = (document.viewpoints.len(), document.params.selection.max_views);
    if let Some(max_views) = max_views {
        findings.require(views <= max_views as usize, "/params/selection/max_views", || {
            format!("is {max_views}; the plan has {}, and no more than this parameter allows", counted(views, "viewpoint"))
        });
    }
    let is_ended_by_it = document.stopped_because == StopReason::MaxViews.as_str();
    findings.require(!is_ended_by_it || max_views.is_some(), "/params/selection/max_views", || {
        format!("is null; the choice of views stopped because of {:?}", document.stopped_because)
    });
}

/// Requires that coverage with poses that are off is of the error in the parameters.
fn check_robust(document: &PlanDocument, findings: &mut Findings) {
    let words = |error: &PoseErrorParams| format!("{} ° and {} mm", error.angle_deg, error.translation_mm);
    let params = &document.params.robust;
    match (&document.coverage.robust, &params.pose_error) {
        (Some(robust), Some(error)) => {
            findings.require(robust.pose_error == *error, "/params/robust/pose_error", || {
                format!("is {}; coverage.robust is for {}", words(error), words(&robust.pose_error))
            });
            let hand_eye = robust.hand_eye.map(|hand_eye| ("hand_eye_draws", params.hand_eye_draws, hand_eye.draws));
            let draws = [("draws", params.draws, robust.draws), ("part_draws", params.part_draws, robust.part.draws)];
            for (field, asked, drawn) in draws.into_iter().chain(hand_eye) {
                findings.require(asked as usize == drawn, format!("/params/robust/{field}"), || {
                    format!("is {asked}; coverage.robust has {} of this kind", counted(drawn, "draw"))
                });
            }
        }
        (Some(robust), None) => {
            findings.push("/params/robust/pose_error", format!("is null; coverage.robust is for {}", words(&robust.pose_error)))
        }
        (None, Some(error)) if is_of_this_release(document) => {
            findings.push("/coverage/robust", format!("is missing; params.robust.pose_error is {}", words(error)));
        }
        (None, _) => {}
    }
}

/// Requires that area at risk counts as the parameters say, and the share by pixels where they ask for it.
fn check_what_counts(document: &PlanDocument, findings: &mut Findings) {
    let (coverage, params) = (&document.coverage, &document.params);
    if let Some(at_risk) = &coverage.at_risk {
        let count_at_risk = params.realism.count_at_risk;
        findings.require(at_risk.counted == count_at_risk, "/params/realism/count_at_risk", || {
            format!("is {count_at_risk}; coverage.at_risk.counted is {}", at_risk.counted)
        });
    }
    let (is_told, is_asked) = (coverage.pixel_set_of_total.is_some(), params.visibility.pixel_set);
    findings.require(is_told == is_asked, "/params/visibility/pixel_set", || {
        let told = if is_told { "given" } else { "missing" };
        format!("is {is_asked}; coverage.pixel_set_of_total is {told}")
    });
}

/// Requires that the part lies in the cell as the parameters say, where they leave no choice, and as in the first setup.
fn check_pose(document: &PlanDocument, findings: &mut Findings) {
    let Some(cell) = &document.cell else { return };
    let lies: Pose<Table, Part> = cell.table_from_part.pose();
    let mut require = |pose: Pose<Table, Part>, at: &str| {
        let (mm, deg) = elsewhere::offset(&pose, &lies);
        // A pose that is none is a finding of its own.
        let is_off = mm > SAME_POSE.0 || deg > SAME_POSE.1;
        findings.require(!is_off, at, || format!("is {mm:.3} mm and {deg:.4} ° off cell.table_from_part"));
    };
    if let Some(given) = document.params.part.table_from_part.filter(|_| document.params.setups <= 1) {
        require(given.pose(), "/params/part/table_from_part");
    }
    if let Some(first) = document.setups.first() {
        require(first.table_from_part.pose(), "/setups/0/table_from_part");
    }
}

/// Tells which parameters of a sound plan were held against the rest of it, and which leave no trace there.
pub(in crate::check) fn tell(document: &PlanDocument, sound: &mut Sound) {
    let preset = document.params.preset;
    match preset {
        Preset::Vantage => sound.leave("params.preset", "vantage sets nothing, so that no value contradicts it"),
        Preset::Thesis if is_of_this_release(document) => {
            sound.verify("params.preset: the plan has every value that thesis sets")
        }
        Preset::Thesis => {
            let version = &document.version;
            sound.leave("params.preset", format!("thesis may have set other values in release {version:?}, which made the plan"));
        }
    }
    sound.verify("params.limits: in force in scanner.devices");
    if document.motion.as_ref().is_some_and(|motion| motion.cycle_secs != 0.0) {
        sound.verify("params.scan.settle_secs and capture_secs: they add up to the times in motion");
    }
    if document.params.material_of_part().is_some() {
        sound.verify("params.scan.brightness: it allows the levels in the exposures of the viewpoints");
    } else {
        sound.leave("params.scan.brightness", "no viewpoint tells its level; check the program of the plan, whose captures do");
    }
    // Of further views after a scan neither the targets of regions nor the limit of views are those in the parameters.
    let is_whole = !document.coverage.of_open;
    if tells_regions(document) {
        let target = if is_whole { ", tolerance and target" } else { " and tolerance" };
        sound.verify(format!("params.regions: name, kind{target} of each are those in coverage.regions"));
    }
    let max_views = if is_whole { " and params.selection.max_views" } else { "" };
    sound.verify(format!("params.setups{max_views}: the plan has no more"));
    sound.verify("params.robust.pose_error and draws, realism.count_at_risk, visibility.pixel_set: as far as coverage has them");
    if document.cell.is_some() {
        if document.params.setups <= 1 && document.params.part.table_from_part.is_some() {
            sound.verify("params.part.table_from_part: by cell.table_from_part");
        } else {
            sound.leave("choice of cell.table_from_part", "not derived anew");
        }
    }
    sound.leave(
        "params.candidates, score, selection, motion, robust.select and seed, as far as they steer the choice of views and paths",
        "the choice is not repeated; plan with these parameters and compare",
    );
    sound.leave("candidates, bound, causes of missed area, remedies, advice and warnings", "the search is not repeated");
}
