//! Documents of the files that were taken in, and the sentences of what is found about them.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::geometry::{LengthUnit, sort_descending};
use crate::inspection::ingest::{
    FrameAttempt, IngestCode, IngestFinding, MAX_UNSEEN_SHARE, MIN_SHARE, RemovedBecause, ScanFrame, TakenScan,
};
use crate::wire::MeshUnit;
use crate::wire::part_size::unit_text;
use crate::wire::words::percent_to;

/// Ranges of viewpoints that a sentence lists: it stands once for each file, of which there may be hundreds.
const MAX_RANGES: usize = 8;

/// A scan as it was read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TakenScanDocument {
    /// Viewpoint of the plan.
    pub viewpoint: u32,
    /// Name of its file; for E57 also that of the scan in it.
    pub file: String,
    /// Unit that its coordinates were taken to be in.
    #[schema(value_type = MeshUnit)]
    pub unit: String,
    /// Frame that its coordinates were taken to be in.
    pub frame: ScanFrame,
    /// Number of points in the file.
    pub points: usize,
    /// Share of the points that lie in the view's field.
    pub in_frusta: f64,
    /// Share of the points that lie in the view's field and near the part.
    pub on_part: f64,
    /// Columns and rows of the grid; `null` for a cloud that is not organised.
    pub grid: Option<[usize; 2]>,
    /// Points that were removed, by reason.
    pub removed: Vec<RemovedDocument>,
}

/// Points that were removed for a reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct RemovedDocument {
    /// Reason.
    pub reason: RemovedBecause,
    /// Number of these points.
    pub points: usize,
}

/// Finding about a file or a view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct IngestFindingDocument {
    /// Kind of finding.
    pub code: IngestCode,
    /// File that it is about; `null` for a view without a file.
    pub file: Option<String>,
    /// Viewpoint of the plan; for `view_unknown` and `merged`, the number that the file gives, which is not the one viewpoint that it
    /// shows.
    pub viewpoint: Option<u32>,
    /// Sentence for people.
    pub detail: String,
}

impl From<&TakenScan> for TakenScanDocument {
    fn from(taken: &TakenScan) -> Self {
        let removed = |(reason, points): (&RemovedBecause, &usize)| RemovedDocument { reason: *reason, points: *points };
        Self {
            viewpoint: taken.scan.viewpoint,
            file: taken.file.clone(),
            unit: taken.unit.as_str().to_owned(),
            frame: taken.frame,
            points: taken.points,
            in_frusta: taken.fit.in_frusta,
            on_part: taken.fit.on_part,
            grid: taken.scan.scanner_cloud.grid.map(|grid| [grid.columns, grid.rows]),
            removed: taken.removed.by_reason.iter().map(removed).collect(),
        }
    }
}

impl From<&IngestFinding> for IngestFindingDocument {
    fn from(finding: &IngestFinding) -> Self {
        Self { code: finding.code, file: finding.file.clone(), viewpoint: finding.viewpoint, detail: ingest_sentence(finding) }
    }
}

fn tried(attempts: &[FrameAttempt]) -> String {
    let mut best: Vec<&FrameAttempt> = attempts.iter().collect();
    sort_descending(&mut best, |file| file.on_part);
    let words = |attempt: &&FrameAttempt| {
        format!("{} as {} in the {} frame", percent_to(attempt.on_part, 0), unit_text(attempt.unit), attempt.frame.as_str())
    };
    best.iter().take(4).map(words).collect::<Vec<_>>().join(", ")
}

/// Words on the units that a file was not tried in, where it fits in none that it was tried in; empty elsewhere.
fn untried(finding: &IngestFinding) -> String {
    if finding.tried.is_empty() || fitting(finding).is_some() {
        return String::new();
    }
    let is_untried = |unit: &LengthUnit| finding.tried.iter().all(|attempt| attempt.unit != *unit);
    let units: Vec<&str> = LengthUnit::ALL.into_iter().filter(is_untried).map(LengthUnit::as_str).collect();
    if units.is_empty() {
        return String::new();
    }
    let (units, first) = (units.join(" or "), units[0]);
    format!("; not tried as {units}, which has to be given (--scan-unit {first}; over HTTP, unit={first})")
}

/// Numbers of viewpoints in ranges, such as `0 to 4, 6`: the first [`MAX_RANGES`], and how many viewpoints are left out.
pub(crate) fn ranges(viewpoints: &[u32]) -> String {
    let words = |run: &[u32]| match run {
        [first, .., last] => format!("{first} to {last}"),
        run => run.iter().map(u32::to_string).collect(),
    };
    let runs: Vec<&[u32]> = viewpoints.chunk_by(|a, b| a + 1 == *b).collect();
    let (told, left_out) = runs.split_at(runs.len().min(MAX_RANGES));
    let told = told.iter().map(|run| words(run)).collect::<Vec<_>>().join(", ");
    match left_out.iter().map(|run| run.len()).sum::<usize>() {
        0 => told,
        more => format!("{told} and {more} more"),
    }
}

/// Sentence for a file of no view of the plan, by its number or without one.
fn unknown_view_sentence(finding: &IngestFinding, file: &str) -> String {
    let known = ranges(&finding.viewpoints);
    let own = match finding.viewpoint {
        Some(number) => {
            format!("{file} belongs to no viewpoint of the plan: its number is {number}, but those of the plan are {known}")
        }
        None => format!("{file} names no viewpoint of the plan, whose numbers are {known}"),
    };
    let as_merged = match &finding.tried[..] {
        [] => String::new(),
        attempts => {
            format!("; as a cloud of all views it does not lie on the part either; points near the part: {}", tried(attempts))
        }
    };
    format!("{own}; name its view, or put its number into the name of the file{as_merged}")
}

/// Unit and frame in which most of the points lie near the part; none if too few do in any.
fn fitting(finding: &IngestFinding) -> Option<&FrameAttempt> {
    let fits = finding.tried.iter().filter(|attempt| attempt.on_part >= MIN_SHARE);
    fits.max_by(|a, b| a.on_part.total_cmp(&b.on_part))
}

/// Sentence for a file in another unit or frame than was given, or in none: the one that fits, and the option and the parameter of a
/// request that give it.
fn mismatch_sentence(file: &str, (what, fits): (&str, Option<&str>), [option, parameter]: [&str; 2], shares: &str) -> String {
    match fits {
        Some(fits) => format!(
            "{file} does not lie on the part in the {what} that was given; points near the part: {shares}. Give the {what} {fits} \
             ({option} {fits}; over HTTP, {parameter}={fits})"
        ),
        None => format!(
            "{file} does not lie on the part in any {what} that was tried; points near the part: {shares}. Is it a scan of this \
             part? If so, give its {what} ({option}; over HTTP, the parameter {parameter})"
        ),
    }
}

/// Sentence for a file that does not show what its view sees.
fn wrong_view_sentence(file: &str, view: &str, fits: Option<u32>) -> String {
    let own = format!("{file} does not show what viewpoint {view} sees");
    match fits {
        Some(other) => {
            format!("{own}. It fits viewpoint {other}: were files swapped? Name its own view, or leave it out")
        }
        None => format!(
            "{own}, and fits no other viewpoint: is it a scan of this part and this plan? Compare it with the plan that it was \
             taken with, or leave it out"
        ),
    }
}

/// Sentence for a file that holds the points of another view's scan.
fn same_scan_sentence(file: &str, view: &str, original: Option<u32>) -> String {
    let original = original.map_or_else(|| "another viewpoint".to_owned(), |original| format!("viewpoint {original}"));
    format!("{file} holds the same points as the scan of {original}, and is left out: give the one taken from viewpoint {view}")
}

/// Sentence for a second file of a view.
fn second_scan_sentence(finding: &IngestFinding, file: &str, view: &str) -> String {
    let taken = finding.taken_file.as_deref().unwrap_or("the other one");
    format!(
        "{file} is a second scan of viewpoint {view}, and is left out; {taken} is used, the first by its name: leave out the wrong one \
         (over HTTP, name in scans those to compare)"
    )
}

/// Sentence of the views of which a run has no scan.
fn planned_pose_sentence(viewpoints: &[u32]) -> String {
    let words = if viewpoints.len() == 1 { "viewpoint" } else { "viewpoints" };
    format!("the run has no scan of {words} {}: the poses of the plan are taken there", ranges(viewpoints))
}

/// Sentence for a file that fits its view where most of the others, of these views, do not.
fn other_plan_sentence(file: &str, view: &str, misfits: &[u32]) -> String {
    let (own, words) = (format!("{file} fits viewpoint {view}"), if misfits.len() == 1 { "viewpoint" } else { "viewpoints" });
    let of_views = if misfits.is_empty() { String::new() } else { format!(" (those of {words} {})", ranges(misfits)) };
    format!(
        "{own}, but most files of its setup do not fit theirs{of_views}, so that none of them is compared. Are these scans of this part \
         and this plan? If not, compare them with the plan that they were taken with. If they are, mend what is said of each file that \
         does not fit, or leave those files out (over HTTP, name in scans those to compare)"
    )
}

/// End of the sentence for a cloud of several views whose name has a number.
fn merged_number_sentence(number: u32, viewpoints: &[u32]) -> String {
    if viewpoints.contains(&number) {
        return format!(
            ". Its name has the number of viewpoint {number}, which cannot have seen more than {} of its points on the part: if it \
             is the scan of one view, export it in the frame of the scanner (over HTTP, name the viewpoint)",
            percent_to(MAX_UNSEEN_SHARE, 0)
        );
    }
    let known = ranges(viewpoints);
    format!(". Its number, {number}, is not a viewpoint of the plan ({known}): if it shows only one view, name that view")
}

/// Sentence for a scan of which most points lie farther apart than this.
fn sparse_sentence(file: &str, apart_mm: f64) -> String {
    format!(
        "most points of {file} are more than {apart_mm:.1} mm apart: the surface between them counts as not measured (too few \
         points). Export the scan with more of its points"
    )
}

/// Sentence for a scan whose cells, each with a point, have this size.
fn thinned_sentence(file: &str, cell_mm: f64) -> String {
    format!(
        "{file} has one point in about {cell_mm:.1} mm, fewer than the scanner takes: surface beside edges and on steep walls counts as \
         not measured (too few points). Export the scan with all of its points"
    )
}

/// Sentence for a finding.
fn ingest_sentence(finding: &IngestFinding) -> String {
    let file = finding.file.as_deref().unwrap_or("the file");
    let view = finding.viewpoint.map_or_else(|| "none".to_owned(), |view| view.to_string());
    let shares = tried(&finding.tried) + &untried(finding);
    match finding.code {
        IngestCode::UnitMismatch => {
            let unit = fitting(finding).map(|fits| fits.unit.as_str());
            mismatch_sentence(file, ("unit", unit), ["--scan-unit", "unit"], &shares)
        }
        IngestCode::FrameMismatch => {
            let frame = fitting(finding).map(|fits| fits.frame.as_str());
            mismatch_sentence(file, ("frame", frame), ["--frame", "frame"], &shares)
        }
        IngestCode::WrongView => wrong_view_sentence(file, &view, finding.fits_viewpoint),
        IngestCode::SameScan => same_scan_sentence(file, &view, finding.fits_viewpoint),
        IngestCode::OtherPlan => other_plan_sentence(file, &view, &finding.viewpoints),
        IngestCode::Merged => {
            let number = finding.viewpoint.map_or_else(String::new, |number| merged_number_sentence(number, &finding.viewpoints));
            let is_of_view = finding.viewpoint.is_some_and(|number| finding.viewpoints.contains(&number));
            let holds = if is_of_view { "seems to hold" } else { "holds" };
            format!(
                "{file} {holds} several views: coverage is known to about one percentage point, and losses by view are not known; \
                 the uncertainty of deviations includes the error of merging only as far as align.prior_mm and align.prior_deg \
                 state it; export single shots{number}"
            )
        }
        // Near the part, and refused nevertheless.
        IngestCode::NoPart if finding.tried.iter().any(|attempt| attempt.on_part >= MIN_SHARE) => {
            format!(
                "{file} is near the part, but no view sees enough of it to fix its pose; is it a scan of this part, in its unit? \
                 Points near the part: {shares}"
            )
        }
        IngestCode::NoPart => format!("{file} does not lie on the part in any unit and frame; points near the part: {shares}"),
        IngestCode::PartElsewhere => {
            "the part is not where it was planned; it was searched for, and is compared in the pose found".to_owned()
        }
        IngestCode::AmbiguousPose => {
            format!(
                "several poses of the part explain the scans about equally well, so that its pose is not known, and {file} is \
                 left out; add scans from other sides, or put the part where it was planned"
            )
        }
        IngestCode::SymmetricPart => {
            format!(
                "the part in {file} is not where it was planned, and looks the same in several poses; put it where it was planned"
            )
        }
        IngestCode::FilledHoles => {
            let longest = finding.longest_mm.unwrap_or_default();
            format!("triangles of {file} up to {longest:.0} mm long fill holes; they were not measured and are left out")
        }
        IngestCode::SparseCloud => sparse_sentence(file, finding.longest_mm.unwrap_or_default()),
        IngestCode::ThinnedCloud => thinned_sentence(file, finding.longest_mm.unwrap_or_default()),
        IngestCode::ViewMissing => format!("there is no scan of viewpoint {view}"),
        IngestCode::PlannedPose => planned_pose_sentence(&finding.viewpoints),
        IngestCode::ViewUnknown => unknown_view_sentence(finding, file),
        IngestCode::ViewDouble => second_scan_sentence(finding, file, &view),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The number that was found was told, and not those that the plan has.
    #[test]
    fn a_file_of_no_viewpoint_is_told_with_its_number_and_those_of_the_plan() {
        let finding = |code: IngestCode, viewpoint: Option<u32>| IngestFinding {
            code,
            file: Some("view_99.ply".to_owned()),
            viewpoint,
            taken_file: None,
            fits_viewpoint: None,
            tried: Vec::new(),
            longest_mm: None,
            viewpoints: vec![0, 1, 2, 3, 5, 7, 8],
        };
        let attempt = FrameAttempt { unit: LengthUnit::Millimetre, frame: ScanFrame::Part, in_frusta: 1.0, on_part: 0.25 };
        let unknown = finding(IngestCode::ViewUnknown, Some(99));
        let missed = IngestFinding { tried: vec![attempt], ..unknown.clone() };
        for (finding, wanted) in [
            (
                &unknown,
                "view_99.ply belongs to no viewpoint of the plan: its number is 99, but those of the plan are 0 to 3, 5, 7 to 8;",
            ),
            (&missed, "as a cloud of all views it does not lie on the part either; points near the part: 25 % as mm"),
            (&finding(IngestCode::ViewUnknown, None), "view_99.ply names no viewpoint of the plan, whose numbers are 0 to 3, 5,"),
            (&finding(IngestCode::Merged, Some(99)), "Its number, 99, is not a viewpoint of the plan (0 to 3, 5, 7 to 8): if it"),
            (
                &finding(IngestCode::Merged, Some(7)),
                "has the number of viewpoint 7, which cannot have seen more than 3 % of its points on the part: if it is",
            ),
        ] {
            let told = ingest_sentence(finding);
            assert!(told.contains(wanted), "{told}");
        }
        let told = ingest_sentence(&finding(IngestCode::Merged, None));
        assert!(told.ends_with("align.prior_deg state it; export single shots"), "{told}");
    }

    /// "Give that frame" was told of a scan for which none was given, and in which none fits.
    #[test]
    fn another_unit_or_frame_is_told_with_the_option_that_gives_it() {
        let attempt = |unit: LengthUnit, on_part: f64| FrameAttempt { unit, frame: ScanFrame::Part, in_frusta: 1.0, on_part };
        let told = |code: IngestCode, on_part: f64| {
            ingest_sentence(&IngestFinding {
                code,
                file: Some("view_3.ply".to_owned()),
                viewpoint: Some(3),
                taken_file: None,
                fits_viewpoint: None,
                tried: vec![attempt(LengthUnit::Millimetre, 0.0), attempt(LengthUnit::Inch, on_part)],
                longest_mm: None,
                viewpoints: Vec::new(),
            })
        };
        let frame = told(IngestCode::FrameMismatch, 0.9);
        assert!(frame.contains("90 % as inches in the part frame, 0 % as mm"), "{frame}");
        assert!(frame.ends_with("Give the frame part (--frame part; over HTTP, frame=part)"), "{frame}");
        let short = told(IngestCode::FrameMismatch, 0.996);
        assert!(short.contains("99 % as inches"), "a share below the whole is not told as the whole: {short}");
        let unit = told(IngestCode::UnitMismatch, 0.9);
        assert!(unit.ends_with("Give the unit inch (--scan-unit inch; over HTTP, unit=inch)"), "{unit}");
        let no_frame = told(IngestCode::FrameMismatch, 0.0);
        assert!(no_frame.contains("view_3.ply does not lie on the part in any frame that was tried;"), "{no_frame}");
        assert!(no_frame.ends_with("give its frame (--frame; over HTTP, the parameter frame)"), "{no_frame}");
    }

    /// Centimetres are not guessed, and nothing said so.
    #[test]
    fn a_unit_that_was_not_tried_is_told_where_no_other_fits() {
        let attempt = |unit: LengthUnit, on_part: f64| FrameAttempt { unit, frame: ScanFrame::Part, in_frusta: 1.0, on_part };
        let told = |on_part: f64, units: &[LengthUnit]| {
            ingest_sentence(&IngestFinding {
                code: IngestCode::NoPart,
                file: Some("view_3.ply".to_owned()),
                viewpoint: Some(3),
                taken_file: None,
                fits_viewpoint: None,
                tried: units.iter().map(|unit| attempt(*unit, on_part)).collect(),
                longest_mm: None,
                viewpoints: Vec::new(),
            })
        };
        let guessed = [LengthUnit::Millimetre, LengthUnit::Metre, LengthUnit::Inch];
        let refused = told(0.0, &guessed);
        let ending = "; not tried as cm, which has to be given (--scan-unit cm; over HTTP, unit=cm)";
        assert!(refused.ends_with(ending), "{refused}");
        assert!(!told(0.9, &guessed).contains("not tried"), "it fits as it is");
        assert!(!told(0.0, &LengthUnit::ALL).contains("not tried"), "all were tried");
    }

    #[test]
    fn a_sparse_scan_is_told_with_the_distance_between_its_points() {
        let told = |code: IngestCode| {
            ingest_sentence(&IngestFinding {
                code,
                file: Some("view_3.xyz".to_owned()),
                viewpoint: Some(3),
                taken_file: None,
                fits_viewpoint: None,
                tried: Vec::new(),
                longest_mm: Some(2.31),
                viewpoints: Vec::new(),
            })
        };
        let sparse = told(IngestCode::SparseCloud);
        assert!(sparse.starts_with("most points of view_3.xyz are more than 2.3 mm apart"), "{sparse}");
        assert!(sparse.ends_with("Export the scan with more of its points"), "{sparse}");
        let thinned = told(IngestCode::ThinnedCloud);
        assert!(thinned.starts_with("view_3.xyz has one point in about 2.3 mm, fewer than the scanner takes: "), "{thinned}");
        assert!(thinned.ends_with("not measured (too few points). Export the scan with all of its points"), "{thinned}");
    }

    /// "Give only the files that fit" left open which those are.
    #[test]
    fn a_file_that_fits_where_most_do_not_is_told_with_the_views_of_the_others_and_what_to_do() {
        let told = |viewpoints: &[u32]| {
            ingest_sentence(&IngestFinding {
                code: IngestCode::OtherPlan,
                file: Some("view_7.ply".to_owned()),
                viewpoint: Some(7),
                taken_file: None,
                fits_viewpoint: None,
                tried: Vec::new(),
                longest_mm: None,
                viewpoints: viewpoints.to_vec(),
            })
        };
        let several = told(&[0, 1, 2, 5]);
        let begin =
            "view_7.ply fits viewpoint 7, but most files of its setup do not fit theirs (those of viewpoints 0 to 2, 5), so";
        assert!(several.starts_with(begin), "{several}");
        assert!(
            several.ends_with("does not fit, or leave those files out (over HTTP, name in scans those to compare)"),
            "{several}"
        );
        assert!(told(&[4]).contains("do not fit theirs (those of viewpoint 4), so"), "{}", told(&[4]));
        // The list grew with the plan, in the sentence of each file.
        let every_second: Vec<u32> = (0..100).map(|view| 2 * view).collect();
        let many = told(&every_second);
        assert!(many.contains("(those of viewpoints 0, 2, 4, 6, 8, 10, 12, 14 and 92 more), so"), "{many}");
    }

    /// "Does not fit viewpoint 3." was all that was told of a scan that fits none, and of copies and other plans nothing.
    #[test]
    fn a_file_of_another_view_or_plan_is_told_with_what_to_do() {
        let told = |code: IngestCode, fits_viewpoint: Option<u32>| {
            ingest_sentence(&IngestFinding {
                code,
                file: Some("view_7.ply".to_owned()),
                viewpoint: Some(7),
                taken_file: (code == IngestCode::ViewDouble).then(|| "again.ply".to_owned()),
                fits_viewpoint,
                tried: Vec::new(),
                longest_mm: None,
                viewpoints: Vec::new(),
            })
        };
        for (code, fits_viewpoint, wanted) in [
            (IngestCode::WrongView, Some(0), "viewpoint 7 sees. It fits viewpoint 0: were files swapped? Name its own"),
            (IngestCode::WrongView, None, "fits no other viewpoint: is it a scan of this part and this plan? Compare it"),
            (IngestCode::SameScan, Some(0), "holds the same points as the scan of viewpoint 0, and is left out: give the one"),
            (
                IngestCode::ViewDouble,
                None,
                "second scan of viewpoint 7, and is left out; again.ply is used, the first by its name",
            ),
            (IngestCode::OtherPlan, None, "view_7.ply fits viewpoint 7, but most files of its setup do not fit theirs, so"),
        ] {
            let told = told(code, fits_viewpoint);
            assert!(told.contains(wanted) && told.starts_with("view_7.ply "), "{told}");
        }
    }
}
