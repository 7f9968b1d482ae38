//! The reasons why no plan is possible as stable readable text. mm, mm².

use std::fmt::{self, Write};

use crate::planning::context::NoPlan;
use crate::planning::plan::share;
use crate::report::html::{NoPlanInput, NoPlanReason};
use crate::wire::part_size::size_text;
use crate::wire::words::{advice_sentence, area_mm2, changed_params, counted, percent_below};

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
        let of_asked = percent_below(share(*mm2, *asked_mm2), 1.0, 2);
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
        more if more > SHOWN => writeln!(out, "  and {}", counted(more - SHOWN, "more pair")),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::{Contact, Presets, SpecLibrary};
    use crate::planning::plan::{Advice, CandidateCounts, Cause, Obstruction};

    #[test]
    fn one_more_pair_is_no_pairs_and_a_share_below_the_whole_is_not_rounded_up_to_it() {
        let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
        let pair = |number: usize| Obstruction {
            bodies: Contact { a: "forearm".into(), b: format!("guard {number}").into() },
            without_station: 1,
            without_path: 0,
            configuration: cell.home_rad,
            separation: None,
            advice: Advice::MoveFoot,
        };
        let told = |pairs: usize| {
            let finding = NoPlan::NothingMeasured {
                candidates: CandidateCounts::default(),
                asked_mm2: 1e6,
                missed_mm2: vec![(Cause::Collision, 999_999.0), (Cause::Facing, 1.0)],
                obstructions: (0..pairs).map(pair).collect(),
                setups: Vec::new(),
            };
            let mut out = String::new();
            write_reasons(&mut out, &finding).expect("a String takes all");
            out
        };
        assert!(told(SHOWN + 1).ends_with("  and 1 more pair\n") && told(SHOWN + 2).ends_with("  and 2 more pairs\n"));
        assert!(!told(SHOWN).contains("more"), "{}", told(SHOWN));
        assert!(told(0).contains(" 99.99 % of asked"), "{}", told(0));
    }
}
