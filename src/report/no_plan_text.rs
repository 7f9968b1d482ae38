//! The reasons why no plan is possible as stable readable text. mm, mm².

use std::fmt::{self, Write};

use crate::planning::context::NoPlan;
use crate::planning::plan::share;
use crate::report::html::{NoPlanInput, NoPlanReason};
use crate::wire::part_size::size_text;
use crate::wire::words::{advice_sentence, area_mm2, changed_params, fixed};

/// Pairs of blocking bodies that are listed.
const SHOWN: usize = 10;

/// The text. Same input, same text; every line ends with a newline.
#[must_use]
pub fn no_plan_text(input: &NoPlanInput<'_>) -> String {
    let mut out = String::new();
    // Writing to a String cannot fail.
    let _ = write_no_plan(&mut out, input);
    out
}

fn write_no_plan(out: &mut String, input: &NoPlanInput<'_>) -> fmt::Result {
    let (subject, aabb) = (&input.subject, input.subject.mesh.aabb());
    let size = aabb.extent_mm();
    writeln!(out, "{}", input.sentence())?;
    if let Some(step) = input.first_step() {
        writeln!(out, "try first: {step}")?;
    }
    writeln!(out, "\npart {}", subject.part_sha256)?;
    writeln!(out, "  {} triangles, {} mm²", subject.mesh.faces.len(), area_mm2(subject.mesh.area_mm2()))?;
    writeln!(out, "  size {}", size_text(&size.into()))?;
    writeln!(out, "scanner {:?}", subject.scanner.name)?;
    writeln!(out, "cell {:?}", subject.cell.map_or("none", |cell| &cell.name))?;
    input.distance_sentence().map_or(Ok(()), |sentence| writeln!(out, "  {sentence}"))?;
    writeln!(out, "\nparameters changed from their defaults or derived")?;
    let changed = changed_params(&input.resolved());
    if changed.is_empty() {
        writeln!(out, "  none")?;
    }
    changed.iter().try_for_each(|(key, value)| writeln!(out, "  {key} = {value}"))?;
    match input.reason {
        NoPlanReason::NoPlan(finding) => write_reasons(out, finding),
        NoPlanReason::PartRefused(_) => Ok(()),
    }
}

fn write_reasons(out: &mut String, finding: &NoPlan) -> fmt::Result {
    let NoPlan::NothingMeasured { candidates, asked_mm2, missed_mm2, obstructions, .. } = finding else { return Ok(()) };
    writeln!(out, "\ncandidates: {} generated, {} kept", candidates.generated, candidates.kept)?;
    candidates.rejected.iter().try_for_each(|(reason, count)| writeln!(out, "  rejected, {}: {count}", reason.as_str()))?;
    writeln!(out, "\nmissed")?;
    for (cause, mm2) in missed_mm2 {
        let of_asked = fixed(100.0 * share(*mm2, *asked_mm2), 2);
        writeln!(out, "  {:<20} {:>10} mm² {of_asked:>6} % of asked", cause.as_str(), area_mm2(*mm2))?;
    }
    if !obstructions.is_empty() {
        writeln!(out, "\nin the way of viewpoints")?;
    }
    for obstruction in obstructions.iter().take(SHOWN) {
        let (bodies, advice) = (&obstruction.bodies, advice_sentence(&obstruction.advice));
        let (without_station, without_path) = (obstruction.without_station, obstruction.without_path);
        writeln!(out, "  {bodies}: {without_station} without a station, {without_path} without a path")?;
        writeln!(out, "       {advice}")?;
    }
    match obstructions.len() {
        more if more > SHOWN => writeln!(out, "  and {} more pairs", more - SHOWN),
        _ => Ok(()),
    }
}
