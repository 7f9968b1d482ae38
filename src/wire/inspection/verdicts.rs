//! The result of an inspection in its first sentences: features by verdict, and material that is missing or extra.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::deviation::{DeviationDocument, DeviationSpotDocument, OffSurfaceDocument, RegionDeviationDocument, place};
use crate::inspection::MAX_SPOTS;
use crate::inspection::deviation::{Conformity, DeviationOptions, MAX_HEAPS, MaterialKind};
use crate::wire::total::total;
use crate::wire::words::{area_mm2, counted, fixed, percent_below};

/// Max features that fail which the first sentence names.
const MAX_NAMED: usize = 3;
/// Min area of a spot that the first sentences count, mm²: our choice. On sound parts noise makes single samples deviate, of some tenths
/// of a square millimetre; the table has them too.
const MIN_SPOT_MM2: f64 = 1.0;

/// Numbers of features by their verdict.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct VerdictCounts {
    /// Number of features that fail.
    pub fail: usize,
    /// Number of features that pass.
    pub pass: usize,
    /// Number of features that are undecided.
    pub undecided: usize,
}

impl VerdictCounts {
    /// Numbers of these regions; `None` where none of them has a verdict.
    #[must_use]
    pub fn of(regions: &[RegionDeviationDocument]) -> Option<Self> {
        let count = |verdict: Conformity| regions.iter().filter(|region| region.verdict == Some(verdict)).count();
        let [fail, pass, undecided] = [Conformity::Fail, Conformity::Pass, Conformity::Undecided].map(count);
        (fail + pass + undecided > 0).then_some(Self { fail, pass, undecided })
    }

    /// Number of features that have a verdict.
    #[must_use]
    pub fn all(self) -> usize {
        self.fail + self.pass + self.undecided
    }

    /// Words for a title: the verdict that weighs most, and how many features have it.
    #[must_use]
    pub fn title(self) -> String {
        let of_all = |count: usize| format!("{count} of {}", counted(self.all(), "feature"));
        match self {
            Self { fail: 1, .. } => format!("{} fails", of_all(1)),
            Self { fail: 2.., .. } => format!("{} fail", of_all(self.fail)),
            Self { undecided: 1, .. } => format!("{} is undecided", of_all(1)),
            Self { undecided: 2.., .. } => format!("{} are undecided", of_all(self.undecided)),
            Self { pass: 1, .. } => "The one feature passes".to_owned(),
            _ => format!("All {} pass", counted(self.pass, "feature")),
        }
    }

    /// Words for a list: `1 fail, 2 pass, 3 undecided`.
    #[must_use]
    pub fn list(self) -> String {
        format!("{} fail, {} pass, {} undecided", self.fail, self.pass, self.undecided)
    }
}

/// Sentence on the features by their verdict, which names those that fail; `None` where no region has a verdict.
pub(super) fn verdicts_sentence(regions: &[RegionDeviationDocument]) -> Option<String> {
    let counts = VerdictCounts::of(regions)?;
    let mut parts = vec![counts.title()];
    if counts.fail > 0 {
        let failed = regions.iter().filter(|region| region.verdict == Some(Conformity::Fail));
        let failed: Vec<String> = failed.enumerate().map(|(place, region)| failed_words(region, place == 0)).collect();
        let more = failed.len().saturating_sub(MAX_NAMED);
        let named = failed.into_iter().take(MAX_NAMED).collect::<Vec<String>>().join("; ");
        parts[0] += &if more > 0 { format!(" ({named}; and {more} more)") } else { format!(" ({named})") };
    }
    if counts.pass > 0 && counts.pass < counts.all() {
        parts.push(if counts.pass == 1 { "1 passes".to_owned() } else { format!("{} pass", counts.pass) });
    }
    match (counts.fail, counts.undecided) {
        (_, 0) => {}
        (0, _) => parts.push("and none fails".to_owned()),
        (_, 1) => parts.push("1 is undecided".to_owned()),
        (_, undecided) => parts.push(format!("{undecided} are undecided")),
    }
    Some(parts.join(", ") + ".")
}

/// A feature that fails: its name, its deviation farthest from zero, and its uncertainty, with its coverage factor where that is asked for.
fn failed_words(region: &RegionDeviationDocument, with_factor: bool) -> String {
    // No name breaks a line.
    let name: String = region.name.chars().map(|sign| if sign.is_control() { ' ' } else { sign }).collect();
    let largest = region.statistics.map(|figures| format!("largest {} mm", fixed(figures.max_mm, 3)));
    let factor = if with_factor { " (k = 2)" } else { "" };
    let uncertainty = region.expanded_uncertainty_mm.map(|mm| format!("U {} mm{factor}", fixed(mm, 3)));
    let figures: Vec<String> = [largest, uncertainty].into_iter().flatten().collect();
    if figures.is_empty() { name } else { format!("{name}: {}", figures.join(", ")) }
}

/// Sentences on material that is missing or extra: spots that deviate, and points beyond the search distance.
pub(super) fn material_sentences(deviation: &DeviationDocument, search_mm: f64) -> Vec<String> {
    let spots: Vec<String> = MaterialKind::ALL.into_iter().filter_map(|kind| spots_words(deviation, kind)).collect();
    let heaps: Vec<String> = MaterialKind::ALL.into_iter().filter_map(|kind| heaps_words(&deviation.off_surface, kind)).collect();
    let mut told = Vec::new();
    if !spots.is_empty() {
        let limit_mm = DeviationOptions::default().spot_mm;
        told.push(format!(
            "Beyond {limit_mm} mm plus the points' own uncertainty, without that of the poses: {}.",
            spots.join(", and ")
        ));
    }
    let off = deviation.excluded.off_of_area;
    let share = percent_below(off, 1.0, 2);
    let not_compared = (off > 0.0).then(|| format!("{share} % of the area is not compared for such points"));
    let clusters = (!heaps.is_empty()).then(|| heaps.join(", and "));
    let beyond: Vec<String> = [clusters, not_compared].into_iter().flatten().collect();
    if !beyond.is_empty() {
        told.push(format!("Beyond the search distance of {search_mm} mm: {}.", beyond.join("; ")));
    }
    told
}

/// Number of spots of a kind, with the words that it is a bound where the list of all is full.
fn spot_count(count: usize, is_full: bool, kind: &str) -> String {
    let at_least = if is_full { "at least " } else { "" };
    format!("{at_least}{} of {kind}", counted(count, "spot"))
}

/// Spots of a kind that deviate, with their area and the deviation farthest from zero; specks are left out.
fn spots_words(deviation: &DeviationDocument, kind: MaterialKind) -> Option<String> {
    let is_told = |spot: &&DeviationSpotDocument| spot.kind == kind && spot.area_mm2 >= MIN_SPOT_MM2;
    let spots: Vec<_> = deviation.worst.iter().filter(is_told).collect();
    // They are listed by their deviation.
    let farthest = spots.first()?;
    let count = spot_count(spots.len(), deviation.worst.len() >= MAX_SPOTS, material(kind));
    let all_mm2 = area_mm2(total(spots.iter().map(|spot| spot.area_mm2)));
    Some(format!("{count}, {all_mm2} mm² (largest {} mm, around {})", fixed(farthest.max_mm, 3), place(farthest.centre_mm)))
}

/// Clusters of a kind beyond the search distance, with the place of the largest.
fn heaps_words(all: &[OffSurfaceDocument], kind: MaterialKind) -> Option<String> {
    let heaps: Vec<&OffSurfaceDocument> = all.iter().filter(|heap| heap.kind == kind).collect();
    // They are listed by their points.
    let largest = heaps.first()?;
    let what = match kind {
        MaterialKind::Missing => "missing material",
        MaterialKind::Extra => "extra material or another body",
    };
    let count = spot_count(heaps.len(), all.len() >= MAX_HEAPS, what);
    let most = if heaps.len() > 1 { "the largest " } else { "" };
    Some(format!("{count} ({most}{} mm on average, around {})", fixed(largest.mean_mm, 2), place(largest.centre_mm)))
}

fn material(kind: MaterialKind) -> &'static str {
    match kind {
        MaterialKind::Missing => "missing material",
        MaterialKind::Extra => "extra material",
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn region(name: &str, verdict: Option<&str>) -> RegionDeviationDocument {
        let statistics = json!({
            "area_mm2": 1806.4, "mean_mm": 0.198, "rms_mm": 0.198, "p1_mm": 0.158, "p5_mm": 0.174, "p50_mm": 0.2, "p95_mm": 0.217,
            "p99_mm": 0.228, "max_mm": 0.2487, "in_tolerance": 0.006,
        });
        let region = json!({
            "name": name, "tolerance_mm": 0.3, "measured": 0.99, "verdict": verdict, "expanded_uncertainty_mm": 0.0226,
            "statistics": statistics,
        });
        serde_json::from_value(region).expect("a region")
    }

    /// A feature that failed stood in a table alone, far below sentences of its coverage.
    #[test]
    fn the_first_sentence_counts_verdicts_and_names_what_fails() {
        let told = |verdicts: &[&str]| {
            let regions: Vec<_> = verdicts.iter().map(|&verdict| region("st\nep", Some(verdict))).collect();
            verdicts_sentence(&regions).expect("verdicts")
        };
        let figures = "st ep: largest 0.249 mm, U 0.023 mm";
        let six = ["undecided", "fail", "pass", "undecided", "undecided", "pass"];
        assert_eq!(told(&six), format!("1 of 6 features fails ({figures} (k = 2)), 2 pass, 3 are undecided."));
        let four = told(&["fail"; 4]);
        assert_eq!(four, format!("4 of 4 features fail ({figures} (k = 2); {figures}; {figures}; and 1 more)."));
        assert_eq!(told(&["undecided", "pass"]), "1 of 2 features is undecided, 1 passes, and none fails.");
        assert_eq!(told(&["undecided"; 2]), "2 of 2 features are undecided, and none fails.");
        assert_eq!((told(&["pass"]), told(&["pass"; 6])), ("The one feature passes.".into(), "All 6 features pass.".into()));
        assert_eq!(verdicts_sentence(&[region("bore", None)]), None, "it has no tolerance");
        let counts = VerdictCounts::of(&[region("a", Some("fail")), region("b", None)]).expect("a verdict");
        assert_eq!(counts.list(), "1 fail, 0 pass, 0 undecided");
    }

    fn deviation(worst: &[(&str, f64)], off: &[(&str, f64)], off_of_area: f64) -> DeviationDocument {
        let extent = json!({"nominal_mm": 10.0, "measured_mm": null});
        let centre_mm = [27.05, 31.65, 30.0];
        // A spot and a cluster have the same fields but for their size.
        let found = |(kind, mm): &(&str, f64)| {
            json!({
                "kind": kind, "centre_mm": centre_mm, "area_mm2": 76.5, "points": 230, "mean_mm": mm, "max_mm": mm,
            })
        };
        let document = json!({
            "alignment": "best_fit", "mesh_from_placed": crate::cell::PoseSpec::default(), "fixed_freedoms": 6,
            "compared_points": 900, "statistics": null, "histogram": {"begin_mm": -1.0, "width_mm": 1.0, "area_mm2": []},
            "excluded": {"turned_of_points": 0.0, "turned_of_area": 0.0, "off_of_area": off_of_area},
            "extents": [extent, extent, extent], "regions": [], "worst": worst.iter().map(found).collect::<Vec<_>>(),
            "off_surface": off.iter().map(found).collect::<Vec<_>>(),
        });
        serde_json::from_value(document).expect("a deviation")
    }

    /// A boss that was missing was in no sentence of the result.
    #[test]
    fn material_that_is_missing_or_extra_is_told_with_its_place() {
        assert_eq!(material_sentences(&deviation(&[], &[], 0.0), 5.0), Vec::<String>::new());
        let found = deviation(&[("missing", -8.8459), ("extra", 0.21), ("missing", -0.2)], &[("missing", -11.047)], 0.0112);
        let place = "around (27.1, 31.6, 30.0) mm";
        let spots = format!(
            "Beyond 0.1 mm plus the points' own uncertainty, without that of the poses: 2 spots of missing material, 153.0 mm² (largest -8.846 mm, {place}), \
             and 1 spot of extra material, 76.5 mm² (largest 0.210 mm, {place})."
        );
        let heaps = format!(
            "Beyond the search distance of 5 mm: 1 spot of missing material (-11.05 mm on average, {place}); 1.12 % of the area \
             is not compared for such points."
        );
        assert_eq!(material_sentences(&found, 5.0), [spots, heaps]);
        let full = deviation(&[("extra", 0.2); MAX_SPOTS], &[("extra", 6.0); MAX_HEAPS], 0.0);
        let told = material_sentences(&full, 5.0);
        assert!(told[0].contains("at least 20 spots of extra material, 1"), "{told:?}");
        assert!(told[1].contains("at least 20 spots of extra material or another body (the largest 6.00 mm"), "{told:?}");
        let area = material_sentences(&deviation(&[], &[], 0.03), 2.5);
        assert_eq!(area, ["Beyond the search distance of 2.5 mm: 3.00 % of the area is not compared for such points."]);
        // A speck headed the report of a sound part.
        let mut sound = deviation(&[("extra", 0.185)], &[], 0.0);
        sound.worst[0].area_mm2 = 0.305;
        assert_eq!(material_sentences(&sound, 5.0), Vec::<String>::new());
    }
}
