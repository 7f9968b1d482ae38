//! The page of an inspection, in the order in which users of measuring software read one: verdict, alignment, deviation, losses by
//! cause, regions and features, what the scans teach about the scanner, files.

mod features;

use std::fmt::Write;

use super::album::Album;
use super::markup::{area, escape, grouped, number, percent, row, triple};
use super::pictures::{PicturedPart, in_inks};
use super::views::{swatch, three_sides, together};
use super::{ReportSubject, sections};
use crate::geometry::{Part, Pose, Table};
use crate::inspection::Inspection;
use crate::inspection::losses::LossCause;
use crate::inspection::registration::PartNotFound;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::plan::Grade;
use crate::planning::visibility::SampleSet;
use crate::rendering::{Ink, MissGroup, SampledModel};
use crate::report::study::svg::Svg;
use crate::wire::inspection::{
    AlignmentDocument, EstimateDocument, InspectionDocument, LearnedDocument, LossDocument, MeasuredCoverageDocument,
    RateBinDocument, SIGN_SENTENCE, StatisticsDocument, TakenScanDocument, VerdictCounts, ViewCoverageDocument, colour_limit_mm,
    deviation_step, excluded_sentence, loss_phrase, remedy_words,
};

/// Plot: width, height and margins, px.
const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 260.0;
const LEFT: f64 = 60.0;
const TOP: f64 = 44.0;
const BOTTOM: f64 = 40.0;
/// Max spots that deviate, and max clusters of points off the surface, that have a row.
const LISTED: usize = 10;

/// An inspection and the part that it is of.
#[derive(Clone, Copy)]
pub struct InspectionReport<'a> {
    /// The part as it was to be, and what it was planned for; undated.
    pub subject: ReportSubject<'a>,
    /// Time at which the job was accepted that made the plan, RFC 3339; `None` where it is not known.
    pub planned_at: Option<&'a str>,
    /// Time at which the run was accepted that took the scans, RFC 3339; `None` without its record.
    pub run_at: Option<&'a str>,
    /// Samples and their verdicts.
    pub inspection: &'a Inspection,
    /// The result.
    pub document: &'a InspectionDocument,
    /// Findings about the scanner.
    pub learned: &'a LearnedDocument,
    /// Samples that scans of earlier rounds measured; none in the first round.
    pub before: Option<&'a SampleSet>,
    /// Pose of the part on the plate, for the sides of the pictures.
    pub table_from_part: Pose<Table, Part>,
}

/// Renders the page.
///
/// # Errors
/// [`Cancelled`].
pub fn inspection_html(report: &InspectionReport<'_>, ctx: &Context<'_>) -> Result<String, Cancelled> {
    let (subject, document) = (&report.subject, report.document);
    let mut album = Album::new(SampledModel::new(subject.mesh, &report.inspection.surface, None, ctx)?);
    let dates = [("Date of the plan", report.planned_at), ("Date of the run", report.run_at)];
    let counted = (document.verdict_counts(), document.scans.len());
    let own = facts(&document.coverage, counted, &document.plan_sha256, dates);
    let body = [
        sections::header(subject, "Inspection", &own),
        "<main>\n".to_owned(),
        features::result(document),
        alignment(report),
        deviation(report, &mut album),
        losses(report, &mut album),
        rounds(report, &mut album),
        features::list(report),
        learned(report),
        views(&report.document.coverage.by_view),
        files(report),
        "</main>\n".to_owned(),
    ];
    album.into_draft(sections::document(subject, "Inspection", &body.concat())).draw(ctx)
}

fn section(name: &str, body: &str) -> String {
    if body.is_empty() { String::new() } else { format!("<section>\n<h2>{name}</h2>\n{body}</section>\n") }
}

fn table(head: &[&str], rows: &str) -> String {
    let head: String = head.iter().map(|name| format!("<th>{name}</th>")).collect();
    format!("<div class=\"card\"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody>\n</table></div>\n")
}

/// Facts of an inspection beside those of its part; a date that is not known is left out.
fn facts(
    coverage: &MeasuredCoverageDocument,
    (verdicts, scans): (Option<VerdictCounts>, usize),
    plan_sha256: &str,
    dates: [(&'static str, Option<&str>); 2],
) -> Vec<(&'static str, String)> {
    let known = dates.into_iter().filter_map(|(name, date)| Some((name, date.filter(|date| !date.is_empty())?)));
    let mut facts: Vec<_> = known.map(|(name, date)| (name, escape(&sections::date_text(date)))).collect();
    facts.extend(verdicts.map(|verdicts| ("Features", verdicts.list())));
    facts.extend([
        ("Planned of asked", percent(coverage.planned_of_asked)),
        ("Measured of asked", percent(coverage.measured_of_asked)),
        ("Scans", number(scans as f64, 0)),
        ("SHA-256 of the plan", sections::digest(plan_sha256)),
    ]);
    facts
}

/// Sentences on where the part lies.
fn place(alignment: &AlignmentDocument) -> String {
    let on_part = percent(alignment.inlier_share);
    match alignment.why_not_found() {
        None => {}
        Some(PartNotFound::FewPoints) => {
            return format!("The pose of the part was not found: {}.", alignment.few_points_words());
        }
        Some(PartNotFound::FewInliers) => {
            return format!(
                "The pose of the part was not found: {on_part} of the points lie on it. Are these scans of this part?"
            );
        }
    }
    format!(
        "The part lies {} mm ± {} mm and {}° ± {}° (k = 2) from where it was planned. {on_part} of the points lie on it, and scatter \
         with a standard deviation of {} mm.",
        number(alignment.part_shifted_mm, 3),
        number(2.0 * alignment.part_sd.translation_mm, 4),
        number(alignment.part_turned_deg, 3),
        number(2.0 * alignment.part_sd.rotation_deg, 4),
        number(alignment.noise_mm, 4),
    )
}

fn alignment(report: &InspectionReport<'_>) -> String {
    let alignment = &report.document.alignment;
    let method = alignment.method.as_str().replace('_', " ");
    let part = format!("<p>{} Deviations are given for the <b>{method}</b> alignment.</p>\n", place(alignment));
    let of_view = |view: &crate::wire::inspection::ViewAlignmentDocument| {
        let kept = view.kept_pose.map_or("corrected", |reason| reason.as_str());
        row(&[
            view.viewpoint.to_string(),
            number(view.shifted_mm, 3),
            number(view.turned_deg, 4),
            number(view.rms_mm, 4),
            percent(view.inlier_share),
            kept.replace('_', " "),
        ])
    };
    let rows: String = alignment.views.iter().map(of_view).collect();
    let head = ["View", "Shift, mm", "Turn, °", "Residual, mm rms", "On the part", "Pose"];
    section("Alignment", &(part + &table(&head, &rows)))
}

fn statistics_row(name: &str, figures: &StatisticsDocument) -> String {
    let values = [figures.mean_mm, figures.rms_mm, figures.p1_mm, figures.p50_mm, figures.p99_mm, figures.max_mm];
    let mut cells = vec![escape(name)];
    cells.extend(values.map(|value| number(value, 3)));
    row(&cells)
}

/// Pictures of the part from three sides in some inks, with a legend.
fn pictures(report: &InspectionReport<'_>, album: &mut Album, codes: &[u8], alt: &str, legend: &str) -> String {
    let inks = album.inks(codes);
    let part = PicturedPart { mesh: report.subject.mesh, table_from_part: report.table_from_part };
    let figures = three_sides(|side| in_inks(&part, album, side, &inks, alt));
    together(&figures, &format!("<ul class=\"legend\">{legend}{}</ul>\n", back_entry(album.is_open())))
}

/// Entry of a legend for the inner side of the surface, which pictures of an open one show.
fn back_entry(is_open: bool) -> String {
    if is_open { format!("<li>{}{}</li>", swatch(Ink::Back), Ink::Back.label()) } else { String::new() }
}

/// Legend of the colours of deviations: the range that each stands for.
fn deviation_legend(limit_mm: f64) -> String {
    // Lower end of a step; all are equally wide.
    let from = |step: u8| number((2.0 * f64::from(step) / 7.0 - 1.0) * limit_mm, 3);
    let range = |step: u8| match step {
        0 => format!("below {}", from(1)),
        6 => format!("above {}", from(6)),
        _ => format!("{} to {}", from(step), from(step + 1)),
    };
    let entry = |step: u8| format!("<li>{}{} mm</li>", swatch(Ink::Deviation(step)), range(step));
    let entries: String = (0..7).map(entry).collect();
    format!("{entries}<li>{}Not measured</li>", swatch(Ink::NotAsked))
}

fn deviation(report: &InspectionReport<'_>, album: &mut Album) -> String {
    let (found, limit_mm) = (&report.document.deviation, colour_limit_mm(report.inspection));
    let excluded = format!("<p>{SIGN_SENTENCE} {}</p>\n", escape(&grouped(&excluded_sentence(found))));
    let Some(figures) = &found.statistics else {
        return section("Deviation", &format!("<p>Nothing was measured.</p>\n{excluded}"));
    };
    let samples = &report.inspection.deviations().samples;
    let ink = |sample: &crate::inspection::deviation::SampleDeviation| {
        let step = deviation_step(f64::from(sample.distance_mm), limit_mm);
        if sample.points > 0 { Ink::Deviation(step) } else { Ink::NotAsked }
    };
    let codes: Vec<u8> = samples.iter().map(|sample| ink(sample).code()).collect();
    let head = ["", "Mean, mm", "RMS, mm", "1 %, mm", "Median, mm", "99 %, mm", "Largest, mm"];
    let extents = found.extents.iter().zip(["Length (x)", "Width (y)", "Height (z)"]).map(|(extent, name)| {
        let measured = extent.measured_mm.map_or("not measured".to_owned(), |measured| {
            let expanded = extent.max_expanded_uncertainty_mm.map(|expanded| format!(" ± {}", number(expanded, 3)));
            format!("{}{} mm ({} mm)", number(measured, 3), expanded.unwrap_or_default(), number(measured - extent.nominal_mm, 3))
        });
        row(&[name.to_owned(), format!("{} mm", number(extent.nominal_mm, 3)), measured])
    });
    let extents: String = extents.collect();
    let worst = found.worst.iter().take(LISTED).map(|spot| {
        row(&[
            spot.kind.as_str().to_owned(),
            number(spot.max_mm, 3),
            number(spot.mean_mm, 3),
            area(spot.area_mm2),
            triple(spot.centre_mm, 1),
        ])
    });
    let worst: String = worst.collect();
    let worst = if worst.is_empty() {
        no_spot(found.excluded.off_of_area)
    } else {
        table(&["Material", "Largest, mm", "Mean, mm", "Area", "At, mm"], &worst) + &listed_of(found.worst.len())
    };
    let heaps = off_surface(report);
    let body = excluded
        + &pictures(report, album, &codes, "the part, coloured by deviation", &deviation_legend(limit_mm))
        + &format!("<div class=\"card\">{}</div>\n", histogram(report))
        + &table(&head, &statistics_row("Whole part", figures))
        + "<h3>Extents</h3>\n"
        + &table(&["", "Nominal", "Measured ± U at most (difference)"], &extents)
        + "<h3>Spots that deviate</h3>\n"
        + &worst
        + &heaps;
    section("Deviation", &body)
}

/// Sentence for a surface that has no spot among what is compared of it.
fn no_spot(off_of_area: f64) -> String {
    if off_of_area > 0.0 {
        let off = percent(off_of_area);
        return format!(
            "<p>No compared spot deviates by more than 0.1 mm plus its uncertainty (k = 2); {off} of the area lies beyond the search \
             distance and is not compared.</p>\n"
        );
    }
    "<p>No spot deviates by more than 0.1 mm plus its uncertainty (k = 2).</p>\n".to_owned()
}

/// Points off the surface.
fn off_surface(report: &InspectionReport<'_>) -> String {
    let off_surface = &report.document.deviation.off_surface;
    let heaps = off_surface.iter().take(LISTED).map(|heap| {
        let (points, mean) = (number(heap.points as f64, 0), number(heap.mean_mm, 2));
        row(&[heap.kind.as_str().to_owned(), points, mean, triple(heap.centre_mm, 1)])
    });
    let heaps: String = heaps.collect();
    if heaps.is_empty() {
        return heaps;
    }
    let heaps = table(&["Material", "Points", "Mean distance, mm", "At, mm"], &heaps);
    format!("<h3>Points off the surface</h3>\n{heaps}{}", listed_of(off_surface.len()))
}

/// Sentence below a table that has not all rows of the result; empty where it has.
fn listed_of(all: usize) -> String {
    if all <= LISTED {
        return String::new();
    }
    format!("<p class=\"soft\">The {LISTED} largest of {all} in <code>inspection.json</code>.</p>\n")
}

/// Side of the label of the axis' mark `part`, of 0 to 4, so that none is cut off.
fn anchor(part: u32) -> &'static str {
    match part {
        0 => "ink",
        4 => "end",
        _ => "middle",
    }
}

fn histogram(report: &InspectionReport<'_>) -> String {
    let histogram = &report.document.deviation.histogram;
    let most = histogram.area_mm2.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let title = format!("Area by deviation; highest bar {}, the outer bars with all beyond", area(most));
    let mut svg = Svg::new(WIDTH, HEIGHT, &title, "Histogram of the measured area by its deviation");
    let (classes, bottom) = (histogram.area_mm2.len().max(1), HEIGHT - BOTTOM);
    let width = (WIDTH - LEFT - 16.0) / classes as f64;
    let limit_mm = colour_limit_mm(report.inspection);
    for (class, area_mm2) in histogram.area_mm2.iter().enumerate() {
        let height = (bottom - TOP) * area_mm2 / most;
        let middle_mm = histogram.begin_mm + (class as f64 + 0.5) * histogram.width_mm;
        let fill = Ink::Deviation(deviation_step(middle_mm, limit_mm)).hex();
        svg.bar(&fill, [LEFT + class as f64 * width, bottom - height], [(width - 1.0).max(0.5), height]);
    }
    svg.line("grid", [LEFT, bottom], [WIDTH - 16.0, bottom]);
    for part in 0..=4 {
        let place = f64::from(part) / 4.0;
        let mm = histogram.begin_mm + place * histogram.width_mm * classes as f64;
        let label = format!("{} mm", number(mm, 3));
        svg.text(LEFT + place * (WIDTH - LEFT - 16.0), bottom + 20.0, anchor(part), &label);
    }
    svg.finish()
}

/// Group of causes that a picture has one colour for, and its name.
fn group_of(cause: LossCause) -> (MissGroup, &'static str) {
    match cause {
        LossCause::ViewMissing | LossCause::OutsideFile => (MissGroup::Reach, "No scan, or the file ends"),
        LossCause::Pose | LossCause::UnmodelledOccluder => (MissGroup::Shadow, "View off its pose, or obstructed"),
        LossCause::PartDeviates => (MissGroup::Resting, "The part deviates"),
        LossCause::Grazing => (MissGroup::Incidence, "Too oblique for this scanner"),
        LossCause::Specular | LossCause::Dark | LossCause::Saturated => (MissGroup::Facing, "Glare, dark or saturated"),
        LossCause::Edge | LossCause::Concave => (MissGroup::Frame, "Edge or concave corner"),
        LossCause::DepthBlur | LossCause::Sparse | LossCause::Noisy => (MissGroup::Depth, "Blurred, sparse or noisy"),
        LossCause::Filtered | LossCause::Unexplained => (MissGroup::NotChosen, "Filtered out, or unexplained"),
    }
}

fn losses(report: &InspectionReport<'_>, album: &mut Album) -> String {
    let losses = &report.document.losses;
    if losses.is_empty() {
        return section("Losses", "<p>Everything that was planned is measured.</p>\n");
    }
    let inspection = report.inspection;
    let ink = |sample: SampleId| match inspection.losses.cause_of(sample) {
        Some(cause) => Ink::Missed(group_of(cause).0),
        None if inspection.coverage.measured.holds(sample) => Ink::ByOthers,
        None => Ink::NotAsked,
    };
    let codes: Vec<u8> = inspection.surface.samples().map(|sample| ink(sample).code()).collect();
    let mut groups: Vec<(MissGroup, &str)> = losses.iter().map(|loss| group_of(loss.cause)).collect();
    groups.sort_unstable();
    groups.dedup();
    let mut legend = String::new();
    for (group, name) in groups {
        // Writing to a String cannot fail.
        let _ = write!(legend, "<li>{}{}</li>", swatch(Ink::Missed(group)), escape(name));
    }
    legend += &format!("<li>{}Measured</li><li>{}Not planned</li>", swatch(Ink::ByOthers), swatch(Ink::NotAsked));
    let of_cause = |loss: &LossDocument| {
        let remedy = loss.largest.first().map_or("", |spot| remedy_words(spot.remedy));
        row(&[
            format!("<b>{}</b>", loss_phrase(loss.cause)),
            percent(loss.of_asked),
            format!("<span class=\"whole\">{}</span>", area(loss.area_mm2)),
            number(loss.spots as f64, 0),
            escape(&loss.detail),
            remedy.to_owned(),
        ])
    };
    let rows: String = losses.iter().map(of_cause).collect();
    let head = ["Cause", "Of asked", "Area", "Spots", "Meaning", "Remedy"];
    section("Losses", &(pictures(report, album, &codes, "the part, lost surface by cause", &legend) + &table(&head, &rows)))
}

/// Surface that earlier rounds measured, and what these scans add.
fn rounds(report: &InspectionReport<'_>, album: &mut Album) -> String {
    let Some(before) = report.before else { return String::new() };
    let (surface, now) = (&report.inspection.surface, &report.inspection.coverage.measured);
    let ink = |sample: SampleId| match (before.holds(sample), now.holds(sample)) {
        (true, _) => Ink::ByOthers,
        (false, true) => Ink::Measured(Grade::A),
        (false, false) if surface.asked[sample.index()] => Ink::Unmeasured,
        (false, false) => Ink::NotAsked,
    };
    let codes: Vec<u8> = surface.samples().map(|sample| ink(sample).code()).collect();
    let legend: String = [
        (Ink::ByOthers, "Measured before"),
        (Ink::Measured(Grade::A), "Added by these scans"),
        (Ink::Unmeasured, "Not measured"),
        (Ink::NotAsked, "Not asked for"),
    ]
    .map(|(ink, name)| format!("<li>{}{name}</li>", swatch(ink)))
    .concat();
    let of_asked = |counts: &dyn Fn(SampleId) -> bool| {
        let area_mm2: f64 = surface
            .samples()
            .filter(|sample| surface.asked[sample.index()] && counts(*sample))
            .map(|sample| surface.sample_area_mm2(sample))
            .sum();
        area_mm2 / report.document.coverage.asked_area_mm2.max(f64::MIN_POSITIVE)
    };
    let earlier = of_asked(&|sample| before.holds(sample));
    let added = of_asked(&|sample| now.holds(sample) && !before.holds(sample));
    let rows = [("Before", earlier), ("Added by these scans", added), ("After", earlier + added)];
    let rows: String = rows.map(|(name, share)| row(&[name.to_owned(), percent(share)])).concat();
    let pictures = pictures(report, album, &codes, "the part, surface measured before and added", &legend);
    section("Before and after", &(pictures + &table(&["Measured", "Of asked"], &rows)))
}

fn learned(report: &InspectionReport<'_>) -> String {
    let learned = report.learned;
    let curves = [
        ("Return rate by worst incidence", "°", &learned.by_incidence),
        ("Return rate by angle to the mirror direction", "°", &learned.by_mirror),
        ("Return rate by depth", " mm", &learned.by_depth),
    ];
    let curves = curves.into_iter().filter(|(_, _, bins)| bins.len() > 1);
    let body: String =
        curves.map(|(name, unit, bins)| format!("<div class=\"card\">{}</div>\n", rates(name, unit, bins))).collect();
    let noise = learned.noise_best_mm.as_ref().map_or_else(String::new, noise_words);
    if report.document.alignment.why_not_found() == Some(PartNotFound::FewInliers) && body.is_empty() {
        return section("What the scans teach about the scanner", "<p>Nothing: the scans do not fit the part.</p>\n");
    }
    let withheld: String = learned.withheld.iter().map(|reason| format!("<p>Note: {}.</p>\n", escape(&reason.detail))).collect();
    section("What the scans teach about the scanner", &(withheld + &noise + &body))
}

fn noise_words(noise: &EstimateDocument) -> String {
    let [value, low, high] = [noise.value, noise.interval[0], noise.interval[1]].map(|mm| number(mm, 4));
    format!(
        "<p>Standard deviation of a point at best focus: {value} mm (95 % confidence: {low} to {high} mm, from {} triples of \
         points).</p>\n",
        number(noise.count as f64, 0)
    )
}

fn rates(name: &str, unit: &str, bins: &[RateBinDocument]) -> String {
    let mut svg = Svg::new(WIDTH, HEIGHT, name, name);
    let (first, last) = (bins[0].range[0], bins[bins.len() - 1].range[1]);
    let bottom = HEIGHT - BOTTOM;
    let x = |place: f64| LEFT + (WIDTH - LEFT - 16.0) * (place - first) / (last - first).max(f64::MIN_POSITIVE);
    let y = |rate: f64| bottom - (bottom - TOP) * rate;
    for part in 0..=4 {
        let share = f64::from(part) / 4.0;
        svg.line("grid", [LEFT, y(share)], [WIDTH - 16.0, y(share)]);
        svg.text(LEFT - 8.0, y(share) + 4.0, "end", &format!("{} %", number(100.0 * share, 0)));
        let place = first + share * (last - first);
        svg.text(x(place), bottom + 20.0, anchor(part), &format!("{}{unit}", number(place, 0)));
    }
    let rate = |bin: &RateBinDocument| bin.returned as f64 / (bin.expected as f64).max(1.0);
    let points: Vec<[f64; 2]> = bins.iter().map(|bin| [x(f64::midpoint(bin.range[0], bin.range[1])), y(rate(bin))]).collect();
    svg.series(0, &points);
    svg.finish()
}

fn views(views: &[ViewCoverageDocument]) -> String {
    let is_planned = |view: &ViewCoverageDocument| view.planned_area_mm2 > 0.0;
    let of_view = |view: &ViewCoverageDocument| {
        // A share of nothing is none: 0 % would say that the view failed.
        let share = is_planned(view).then(|| view.planned_and_measured_area_mm2 / view.planned_area_mm2);
        row(&[
            view.viewpoint.to_string(),
            view.scans.to_string(),
            area(view.planned_area_mm2),
            area(view.measured_area_mm2),
            share.map_or_else(|| "–".to_owned(), percent),
        ])
    };
    let rows: String = views.iter().map(of_view).collect();
    let legend = if views.iter().all(is_planned) {
        ""
    } else {
        "<p class=\"soft\">–: the plan expects no asked area from this view, so there is no share to state.</p>\n"
    };
    section("Views", &(table(&["View", "Scans", "Planned", "Measured", "Of planned"], &rows) + legend))
}

fn files(report: &InspectionReport<'_>) -> String {
    let rows: String = report.document.scans.iter().map(scan_row).collect();
    let findings: String =
        report.document.findings.iter().map(|finding| format!("<li>{}</li>\n", escape(&finding.detail))).collect();
    let findings = if findings.is_empty() { findings } else { format!("<ul>\n{findings}</ul>\n") };
    section("Files", &(findings + &table(&["File", "View", "Points", "Read as", "On the part", "Removed"], &rows)))
}

fn scan_row(scan: &TakenScanDocument) -> String {
    let removed = scan.removed.iter().map(|removed| {
        let points = number(removed.points as f64, 0);
        format!("{points} {}", removed.reason.as_str().replace('_', " "))
    });
    row(&[
        escape(&scan.file),
        scan.viewpoint.to_string(),
        number(scan.points as f64, 0),
        format!("{}, {} frame", scan.unit, scan.frame.as_str()),
        percent(scan.on_part),
        escape(&removed.collect::<Vec<String>>().join(", ")),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::PoseSpec;
    use crate::inspection::deviation::Alignment;
    use crate::inspection::ingest::{RemovedBecause, ScanFrame};
    use crate::inspection::registration::KeptPose;
    use crate::testing::{box_mesh, nominal_scanner};
    use crate::wire::echo::Echo;
    use crate::wire::inspection::{RemovedDocument, RigidSdDocument, ViewAlignmentDocument};

    #[test]
    fn the_head_has_the_facts_of_the_plan_s_report_and_the_dates_that_are_known() {
        let (mesh, scanner) = (box_mesh([0.0; 3], [60.0, 40.0, 30.0]), nominal_scanner());
        let echo = Echo { part_number: Some("PN-4711".into()), serial: Some("S <7>".into()), ..Echo::default() };
        let subject = ReportSubject {
            mesh: &mesh,
            fixture: None,
            part_sha256: "",
            part_name: "block",
            scanner: &scanner,
            cell: None,
            echo: &echo,
            date: None,
            size_warnings: &[],
        };
        let coverage = MeasuredCoverageDocument {
            asked_area_mm2: 100.0,
            planned_of_asked: 0.9,
            measured_of_asked: 0.8,
            measured_in_all_of_asked: 0.8,
            measured_of_coverable: None,
            both_of_asked: 0.8,
            lost_of_asked: 0.1,
            gained_of_asked: 0.0,
            neither_of_asked: 0.1,
            lost_near_limit_of_asked: 0.0,
            gained_near_limit_of_asked: 0.0,
            approximate: false,
            by_view: Vec::new(),
        };
        let verdicts = VerdictCounts { fail: 1, pass: 2, undecided: 3 };
        let dates = [("Date of the plan", Some("2026-01-31T08:15:42Z")), ("Date of the run", Some(""))];
        let own = facts(&coverage, (Some(verdicts), 5), &"ab".repeat(32), dates);
        let head = sections::header(&subject, "Inspection", &own).replace('\u{a0}', " ");
        for said in [
            "<dt>Part number</dt><dd>PN-4711</dd>",
            "<dt>Serial number</dt><dd>S &lt;7&gt;</dd>",
            "<dt>Version</dt><dd>Vantage ",
            "<dt>Scanner</dt>",
            "<dt>Cell</dt><dd>none: viewpoints only</dd>",
            "<dt>Date of the plan</dt><dd>2026-01-31 08:15 UTC</dd>",
            "<dt>Measured of asked</dt><dd>80.00 %</dd>",
            "<dt>Scans</dt><dd>5</dd>",
            "<dt>Features</dt><dd>1 fail, 2 pass, 3 undecided</dd>",
            ">abababababab…</code>",
        ] {
            assert!(head.contains(said), "{said:?} is not in {head}");
        }
        assert!(!head.contains("Date of the run") && !head.contains("<dt>Date</dt>"), "{head}");
    }

    /// The view was told as 0.00 % of what was planned, like a view that failed.
    #[test]
    fn a_view_for_which_nothing_was_planned_has_no_share_and_the_legend_says_why() {
        let view = |viewpoint: u32, planned_area_mm2: f64| ViewCoverageDocument {
            viewpoint,
            scans: 1,
            planned_area_mm2,
            measured_area_mm2: 5.0,
            planned_and_measured_area_mm2: 0.0,
        };
        let told = views(&[view(1, 20.0), view(2, 0.0)]).replace('\u{a0}', " ");
        assert!(told.contains("<td>5.00 mm²</td><td>0.00 %</td></tr>"), "one that failed has a share: {told}");
        for said in ["<td>5.00 mm²</td><td>–</td></tr>", "–: the plan expects no asked area"] {
            assert!(told.contains(said), "{said:?} is not in {told}");
        }
        assert!(!views(&[view(1, 20.0)]).contains('–'), "a legend without its sign");
    }

    #[test]
    fn the_place_of_the_part_is_told_with_its_expanded_uncertainty() {
        let view = ViewAlignmentDocument {
            viewpoint: 3,
            points: 900,
            inlier_share: 0.95,
            rms_mm: 0.02,
            turned_deg: 0.001,
            shifted_mm: 0.01,
            kept_pose: None,
        };
        let found = AlignmentDocument {
            method: Alignment::BestFit,
            mesh_from_stated: PoseSpec::default(),
            table_from_part: None,
            part_turned_deg: 0.12,
            part_shifted_mm: 0.412,
            part_sd: RigidSdDocument { rotation_deg: 0.0105, translation_mm: 0.0925 },
            noise_mm: 0.0123,
            not_found: None,
            inlier_share: 0.95,
            views: vec![view],
        };
        let told = place(&found);
        assert!(told.contains("0.412 mm ± 0.1850 mm and 0.120° ± 0.0210° (k = 2) from where it was planned"), "{told}");
        assert!(told.contains("a standard deviation of 0.0123 mm"), "{told}");
        let swapped = place(&AlignmentDocument { inlier_share: 0.373, ..found.clone() });
        assert!(swapped.contains("was not found") && swapped.contains("Are these scans of this part?"), "{swapped}");
        let few = ViewAlignmentDocument {
            points: 120,
            inlier_share: 1.0,
            kept_pose: Some(KeptPose::FewPoints),
            ..found.views[0].clone()
        };
        let told = place(&AlignmentDocument { inlier_share: 1.0, views: vec![few], ..found });
        assert!(told.contains("not found: too few points: 120 in all") && !told.contains("Are these"), "{told}");
    }

    #[test]
    fn the_legend_of_deviations_has_the_ranges_that_the_colours_stand_for() {
        let legend = deviation_legend(0.7);
        for (step, range) in
            [(0, "below −0.500 mm"), (1, "−0.500 to −0.300 mm"), (3, "−0.100 to 0.100 mm"), (6, "above 0.500 mm")]
        {
            assert!(legend.contains(&format!("{}{range}</li>", swatch(Ink::Deviation(step)))), "{range} of {step}: {legend}");
        }
        assert_eq!((back_entry(false).as_str(), back_entry(true).contains("Inner side")), ("", true));
        assert_eq!([-0.51, -0.49, -0.31, -0.09, 0.09, 0.51].map(|mm| deviation_step(mm, 0.7)), [0, 1, 1, 3, 3, 6]);
    }

    #[test]
    fn noise_says_what_its_interval_is_and_large_counts_are_grouped() {
        let noise = noise_words(&EstimateDocument { value: 0.0123, interval: [0.012, 0.0126], count: 133_343 });
        assert!(noise.contains("(95 % confidence: 0.0120 to 0.0126 mm, from 133\u{202f}343 triples of points)"), "{noise}");
        let scan = TakenScanDocument {
            viewpoint: 3,
            file: "view_03.ply".to_owned(),
            unit: "mm".to_owned(),
            frame: ScanFrame::Scanner,
            points: 50_800,
            in_frusta: 1.0,
            on_part: 0.9,
            grid: None,
            removed: vec![RemovedDocument { reason: RemovedBecause::MixedPixel, points: 1200 }],
        };
        let row = scan_row(&scan);
        assert!(row.contains("<td>50\u{202f}800</td>") && row.contains("<td>1\u{202f}200 mixed pixel</td>"), "{row}");
    }

    #[test]
    fn a_table_of_the_largest_says_of_how_many() {
        assert_eq!((listed_of(0), listed_of(10)), (String::new(), String::new()));
        assert_eq!(listed_of(11), "<p class=\"soft\">The 10 largest of 11 in <code>inspection.json</code>.</p>\n");
    }

    #[test]
    fn no_spot_is_told_with_the_share_that_is_not_compared() {
        assert!(no_spot(0.0).contains("No spot deviates"), "{}", no_spot(0.0));
        let told = no_spot(0.03).replace('\u{a0}', " ");
        assert!(!told.contains("No spot deviates") && told.contains("3.00 % of the area lies beyond"), "{told}");
    }
}
