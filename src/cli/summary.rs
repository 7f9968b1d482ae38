//! Text of `vantage plan` about a plan: the summary that every output has, then details that a person at the command line may
//! ask for next.

use crate::cli::CliError;
use crate::service::plan_job::Artifact;
use crate::wire::parse;
use crate::wire::plan::{DrawnDocument, PlanDocument, RegionCoverageDocument, RobustDocument, SetupDocument};
use crate::wire::summary::{SUMMARY_FILE, Summary};
use crate::wire::words::{area_mm2, at_risk_sentence, counted, percent_below, stability_sentence};

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
    lines.extend(coverage.robust.as_ref().map(under_pose_errors));
    lines.extend(setup_lines(plan));
    lines.extend(
        plan.setup_links.iter().map(|link| {
            format!("Setups {} and {} {}", link.setups[0] + 1, link.setups[1] + 1, stability_sentence(&link.stability))
        }),
    );
    lines.extend(coverage.regions.iter().map(region_summary));
    lines
}

/// Setups with how the part lies in each and the views that are executed, one on a line.
fn setup_lines(plan: &PlanDocument) -> Vec<String> {
    let executed: Vec<u32> = plan.viewpoints.iter().filter(|view| view.rejected.is_none()).map(|view| view.id).collect();
    let line = |(number, setup): (usize, &SetupDocument)| {
        let turn = setup.turn.as_ref().map_or_else(|| "as placed first".to_owned(), |turn| turn.text.clone());
        let views = setup.viewpoints.iter().filter(|view| executed.contains(view)).count();
        format!("Setup {}: {turn}; {}", number + 1, counted(views, "view"))
    };
    plan.setups.iter().enumerate().map(line).collect()
}

/// Coverage of a region: what is asked and what is reached on one line, and the reasons on another if that is too little.
pub(super) fn region_summary(region: &RegionCoverageDocument) -> String {
    let tolerance = region.tolerance_mm.map_or_else(String::new, |mm| format!(", tolerance {mm} mm"));
    let target = match (region.target, region.met) {
        (Some(target), Some(true)) => format!("target {:.2} %: met", 100.0 * target),
        (Some(target), _) => format!("target {:.2} %: NOT MET", 100.0 * target),
        (None, _) => "no target".to_owned(),
    };
    let why = region.why_unmet.as_ref().map_or_else(String::new, |why| format!("\n  missed: {why}"));
    format!(
        "Region {:?} ({}{tolerance}; {} mm², {} samples): {} %, {target}{why}",
        region.name,
        region.kind,
        area_mm2(region.asked_area_mm2),
        region.samples,
        percent_below(region.of_asked, region.target.unwrap_or(1.0), 2)
    )
}

/// Worst shares of the asked area under pose errors, on one line.
fn under_pose_errors(robust: &RobustDocument) -> String {
    let worst = |name: &str, drawn: &DrawnDocument| format!("{:.2} % with {name} off", 100.0 * drawn.worst);
    let mut cases = vec![worst("each view", &robust.of_asked), worst("the part", &robust.part.of_asked)];
    cases.extend(robust.hand_eye.as_ref().map(|hand_eye| worst("the hand-eye calibration", &hand_eye.of_asked)));
    let error = robust.pose_error;
    format!(
        "Worst coverage of the asked area if poses are off by {}° and {} mm ({} trials each): {}",
        error.angle_deg,
        error.translation_mm,
        robust.draws,
        cases.join(", ")
    )
}
