//! Text of `vantage plan` about a plan: the summary that every output has, then details that a person at the command line may
//! ask for next.

use crate::cli::CliError;
use crate::report::text::{NOTHING_OPEN, reached_percent};
use crate::service::plan_job::Artifact;
use crate::wire::parse;
use crate::wire::plan::{DrawnDocument, PlanDocument, RegionCoverageDocument, RobustDocument, SetupDocument};
use crate::wire::summary::{SUMMARY_FILE, Summary};
use crate::wire::words::{
    NOTHING_IN_REGION, area_mm2, asked_name, at_risk_sentence, counted, first_lie, percent_below, pose_error_sizes,
    region_verdict, stability_sentence,
};

/// Lines on a plan, by its files.
///
/// # Errors
/// [`CliError`] if a file cannot be read.
pub(super) fn lines(artifacts: &[Artifact]) -> Result<Vec<String>, CliError> {
    let (summary, plan) = (of(artifacts)?, read::<PlanDocument>(artifacts, "plan.json")?);
    let mut lines = summary.lines();
    lines.extend(details(&plan));
    Ok(lines)
}

/// Summary of a plan, from its file.
///
/// # Errors
/// [`CliError`] if the file cannot be read.
pub(super) fn of(artifacts: &[Artifact]) -> Result<Summary, CliError> {
    read(artifacts, SUMMARY_FILE)
}

fn read<T: serde::de::DeserializeOwned>(artifacts: &[Artifact], name: &str) -> Result<T, CliError> {
    let bytes = artifacts.iter().find(|artifact| artifact.name == name).map_or(&[][..], |artifact| &artifact.bytes);
    parse(bytes).map_err(|error| CliError::Failed(format!("{name}: {error}")))
}

/// Lines on what the summary leaves to details: area at risk, pose errors, setups, and regions.
fn details(plan: &PlanDocument) -> Vec<String> {
    let coverage = &plan.coverage;
    let mut lines: Vec<String> = coverage.at_risk.iter().map(at_risk_sentence).collect();
    lines.extend(coverage.robust.as_ref().map(|robust| under_pose_errors(robust, coverage.of_open)));
    lines.extend(setup_lines(plan));
    lines.extend(
        plan.setup_links.iter().map(|link| {
            format!("Setups {} and {} {}", link.setups[0] + 1, link.setups[1] + 1, stability_sentence(&link.stability))
        }),
    );
    lines.extend(coverage.regions.iter().map(|region| region_line(region, coverage.of_open)));
    lines
}

/// Setups with how the part lies in each and the views that are executed, one on a line.
fn setup_lines(plan: &PlanDocument) -> Vec<String> {
    let executed: Vec<u32> = plan.viewpoints.iter().filter(|view| view.rejected.is_none()).map(|view| view.id).collect();
    let line = |(number, setup): (usize, &SetupDocument)| {
        let first = || first_lie(plan.params.part.table_from_part.as_ref(), &setup.table_from_part.pose());
        let turn = setup.turn.as_ref().map(|turn| turn.text.clone()).or_else(first).unwrap_or_else(|| "as placed".to_owned());
        let views = setup.viewpoints.iter().filter(|view| executed.contains(view)).count();
        format!("Setup {}: {turn}; {}", number + 1, counted(views, "view"))
    };
    plan.setups.iter().enumerate().map(line).collect()
}

/// Coverage of a region, or that it holds nothing that is asked; of further views, that earlier scans left none of it open.
fn region_line(region: &RegionCoverageDocument, is_of_open: bool) -> String {
    if region.samples > 0 {
        return region_summary(region);
    }
    let told = match region.target {
        _ if is_of_open => NOTHING_OPEN.to_owned(),
        Some(target) => format!("{NOTHING_IN_REGION}, target {} %: NOT MET", percent_below(target, 1.0, 2)),
        None => NOTHING_IN_REGION.to_owned(),
    };
    format!("Region {:?} ({}): {told}", region.name, region.kind)
}

/// Coverage of a region: what is asked and what is reached on one line, and the reasons on another if that is too little.
pub(super) fn region_summary(region: &RegionCoverageDocument) -> String {
    let tolerance = region.tolerance_mm.map_or_else(String::new, |mm| format!(", tolerance {mm} mm"));
    let why = region.why_unmet.as_ref().map_or_else(String::new, |why| format!("\n  missed: {why}"));
    format!(
        "Region {:?} ({}{tolerance}; {} mm², {}): {} %, {}{why}",
        region.name,
        region.kind,
        area_mm2(region.asked_area_mm2),
        counted(region.samples, "sample"),
        reached_percent(region.of_asked, region.target),
        region_verdict(region)
    )
}

/// Worst shares of the asked area under pose errors, on one line.
fn under_pose_errors(robust: &RobustDocument, is_of_open: bool) -> String {
    let worst = |name: &str, drawn: &DrawnDocument, draws: usize| {
        format!("{} % with {name} off (worst of {})", percent_below(drawn.worst, 1.0, 2), counted(draws, "draw"))
    };
    let (part, hand_eye) = (&robust.part, robust.hand_eye.as_ref());
    let of_part = worst("the part and its support", &part.of_asked, part.draws);
    let mut cases = vec![worst("each view", &robust.of_asked, robust.draws), of_part];
    cases.extend(hand_eye.map(|hand_eye| worst("the hand-eye calibration", &hand_eye.of_asked, hand_eye.draws)));
    let [angle_deg, shift_mm] = pose_error_sizes(&robust.pose_error);
    let asked = asked_name(is_of_open);
    format!("Coverage of the {asked} area if poses are off by {angle_deg}° and {shift_mm} mm: {}", cases.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::params::PoseErrorParams;
    use crate::wire::plan::MisplacedDocument;

    #[test]
    fn each_kind_of_pose_error_is_told_with_its_own_number_of_draws() {
        let of_asked = |worst: f64| DrawnDocument { nominal: 1.0, worst, p5: 1.0, mean: 1.0 };
        let robust = RobustDocument {
            pose_error: PoseErrorParams { angle_deg: 0.004_691, translation_mm: 2.0 },
            draws: 21,
            of_asked: of_asked(0.999_96),
            part: MisplacedDocument { draws: 7, of_asked: of_asked(0.75) },
            hand_eye: Some(MisplacedDocument { draws: 1, of_asked: of_asked(0.5) }),
        };
        let told = "99.99 % with each view off (worst of 21 draws), 75.00 % with the part and its support off (worst of 7 draws), \
                    50.00 % with the hand-eye calibration off (worst of 1 draw)";
        let line = under_pose_errors(&robust, false);
        let begins = "Coverage of the asked area if poses are off by 0.00469° and 2 mm: ";
        assert!(line.ends_with(told) && line.starts_with(begins), "{line}");
        assert!(under_pose_errors(&robust, true).starts_with("Coverage of the open area if "), "of further views");
    }

    /// "0.00 %, no target" was told of a region beside the part.
    #[test]
    fn a_region_that_holds_nothing_is_told_so_in_place_of_shares() {
        let region = |target: Option<f64>| -> RegionCoverageDocument {
            let region = serde_json::json!({
                "name": "rim", "kind": "interest", "samples": 0, "asked_area_mm2": 0.0, "coverable_area_mm2": 0.0,
                "of_asked": 0.0, "of_coverable": 0.0, "target": target
            });
            serde_json::from_value(region).expect("a region")
        };
        assert_eq!(region_line(&region(None), false), "Region \"rim\" (interest): it contains none of the asked surface");
        let told = region_line(&region(Some(0.9)), false);
        assert_eq!(told, "Region \"rim\" (interest): it contains none of the asked surface, target 90.00 %: NOT MET");
        let told = region_line(&region(None), true);
        assert_eq!(told, "Region \"rim\" (interest): met: earlier scans left none of it open");
    }
}
