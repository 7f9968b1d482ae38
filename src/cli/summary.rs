//! Text of `vantage plan` about a plan: the summary that every output has, then details that a person at the command line may
//! ask for next.

use crate::cli::CliError;
use crate::report::text::{NOTHING_OPEN, reached_percent};
use crate::service::plan_job::Artifact;
use crate::wire::parse;
use crate::wire::plan::{PlanDocument, RegionCoverageDocument, SetupDocument};
use crate::wire::summary::{HeadlineDocument, SUMMARY_FILE, Summary};
use crate::wire::words::{
    MEANING_OF_INDEPENDENT, NOTHING_IN_REGION, area_mm2, at_risk_sentence, counted, first_lie, limits_mm, percent_below,
    region_verdict, stability_sentence,
};

/// Lines on a plan, by its files.
///
/// # Errors
/// [`CliError`] if a file cannot be read.
pub(super) fn lines(artifacts: &[Artifact]) -> Result<Vec<String>, CliError> {
    let (summary, plan) = (of(artifacts)?, read::<PlanDocument>(artifacts, "plan.json")?);
    let mut lines = summary.lines();
    lines.extend(share_lines(&summary.headline));
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

/// Table of the shares that head a plan, with their meanings; nothing without any.
fn share_lines(headline: &[HeadlineDocument]) -> Vec<String> {
    let title = (!headline.is_empty()).then(|| format!("Shares (independent: on {MEANING_OF_INDEPENDENT}):"));
    let row = |HeadlineDocument { name, share, independent, meaning }: &HeadlineDocument| {
        let on = if *independent { "independent" } else { "" };
        format!("  {name:<25} {:>6} %  {on:<11}  {meaning}", percent_below(*share, 1.0, 2))
    };
    title.into_iter().chain(headline.iter().map(row)).collect()
}

/// Lines on what the summary leaves to details: area at risk, setups, and regions.
fn details(plan: &PlanDocument) -> Vec<String> {
    let coverage = &plan.coverage;
    let mut lines: Vec<String> = coverage.at_risk.iter().map(at_risk_sentence).collect();
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
    let tolerance = region.tolerance_mm.map_or_else(String::new, |mm| format!(", tolerance {} mm", limits_mm(mm)));
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The shares were told on one line, without a word on what they are of.
    #[test]
    fn the_table_of_shares_tells_the_meaning_of_each() {
        let of = |name: &str, independent| HeadlineDocument {
            name: name.to_owned(),
            share: 0.999_96,
            independent,
            meaning: "visible: it can be seen".to_owned(),
        };
        let told = share_lines(&[of("measured of visible", true), of("measured of coverable", false)]);
        assert_eq!(
            told,
            [
                "Shares (independent: on samples that were not used to choose views):",
                "  measured of visible        99.99 %  independent  visible: it can be seen",
                "  measured of coverable      99.99 %               visible: it can be seen",
            ]
        );
        assert!(share_lines(&[]).is_empty());
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
