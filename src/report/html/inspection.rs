//! The page of an inspection, in the order in which users of measuring software read one: verdict, alignment, deviation, losses by
//! cause, regions and features, what the scans teach about the scanner, files.

use std::fmt::Write;

use super::album::Album;
use super::markup::{area, escape, number, percent, triple};
use super::page::document;
use super::pictures::{PicturedPart, in_inks};
use super::views::{swatch, three_sides};
use crate::geometry::{Mesh, Part, Pose, Table};
use crate::inspection::Inspection;
use crate::inspection::losses::LossCause;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::plan::Grade;
use crate::planning::visibility::SampleSet;
use crate::rendering::{Ink, MissGroup, SampledModel};
use crate::report::study::svg::Svg;
use crate::wire::inspection::{
    InspectionDocument, LearnedDocument, LossDocument, RateBinDocument, RegionDeviationDocument, StatisticsDocument,
    colour_limit_mm, deviation_step, excluded_sentence, remedy_words,
};

/// Plot: width, height and margins, px.
const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 260.0;
const LEFT: f64 = 60.0;
const TOP: f64 = 44.0;
const BOTTOM: f64 = 40.0;

/// An inspection and the part that it is of.
#[derive(Clone, Copy)]
pub struct InspectionReport<'a> {
    /// Samples and their verdicts.
    pub inspection: &'a Inspection,
    /// The result.
    pub document: &'a InspectionDocument,
    /// Findings about the scanner.
    pub learned: &'a LearnedDocument,
    /// The part as it was to be.
    pub mesh: &'a Mesh,
    /// Name of the part.
    pub part_name: &'a str,
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
    let mut album = Album::new(SampledModel::new(report.mesh, &report.inspection.surface, None, ctx)?);
    let body = [
        header(report),
        "<main>\n".to_owned(),
        verdict(report),
        alignment(report),
        deviation(report, &mut album),
        losses(report, &mut album),
        rounds(report, &mut album),
        regions(report),
        learned(report),
        views(report),
        files(report),
        "</main>\n".to_owned(),
    ];
    album.into_draft(document(&format!("Inspection: {}", report.part_name), &body.concat())).draw(ctx)
}

fn section(name: &str, body: &str) -> String {
    if body.is_empty() { String::new() } else { format!("<section>\n<h2>{name}</h2>\n{body}</section>\n") }
}

fn table(head: &[&str], rows: &str) -> String {
    let head: String = head.iter().map(|name| format!("<th>{name}</th>")).collect();
    format!("<div class=\"card\"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{rows}</tbody>\n</table></div>\n")
}

fn row(cells: &[String]) -> String {
    format!("<tr>{}</tr>\n", cells.iter().map(|cell| format!("<td>{cell}</td>")).collect::<String>())
}

fn header(report: &InspectionReport<'_>) -> String {
    let (coverage, scans) = (&report.document.coverage, report.document.scans.len());
    let facts = [
        ("Planned", percent(coverage.planned_of_asked)),
        ("Measured", percent(coverage.measured_of_asked)),
        ("Scans", scans.to_string()),
        ("Plan", report.document.plan_sha256.chars().take(12).collect()),
    ];
    let facts = facts.map(|(name, value)| format!("<div><dt>{name}</dt><dd>{}</dd></div>", escape(&value)));
    format!(
        "<header>\n<p class=\"kind\">Inspection</p>\n<h1>{}</h1>\n<dl class=\"facts\">{}</dl>\n</header>\n",
        escape(report.part_name),
        facts.concat()
    )
}

fn verdict(report: &InspectionReport<'_>) -> String {
    let offers: String = report.document.offers.iter().map(|offer| format!("<li>{}</li>\n", escape(&offer.detail))).collect();
    let offers = if offers.is_empty() { offers } else { format!("<h3>Before the next plan</h3>\n<ul>\n{offers}</ul>\n") };
    format!("<section>\n<h2>Result</h2>\n<p>{}</p>\n{offers}</section>\n", escape(&report.document.verdict))
}

fn alignment(report: &InspectionReport<'_>) -> String {
    let alignment = &report.document.alignment;
    let place = if alignment.holds_part() {
        format!(
            "The part lies {} mm and {}° from where it was planned (± {} mm, {}°). {} of the points lie on it, with a spread of {} mm.",
            number(alignment.part_shifted_mm, 3),
            number(alignment.part_turned_deg, 3),
            number(alignment.part_sd.translation_mm, 4),
            number(alignment.part_sd.rotation_deg, 4),
            percent(alignment.inlier_share),
            number(alignment.noise_mm, 4),
        )
    } else {
        let on_part = percent(alignment.inlier_share);
        format!("The place of the part was not found: {on_part} of the points lie on it. Are these scans of this part?")
    };
    let method = alignment.method.as_str().replace('_', " ");
    let part = format!("<p>{place} Deviations are at the alignment <b>{method}</b>.</p>\n");
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
    let head = ["View", "Shift, mm", "Turn, °", "Residual, mm", "On the part", "Pose"];
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
    let part = PicturedPart { mesh: report.mesh, table_from_part: report.table_from_part };
    let figures = three_sides(|side| in_inks(&part, album, side, &inks, alt));
    format!("{figures}<ul class=\"legend\">{legend}</ul>\n")
}

fn deviation(report: &InspectionReport<'_>, album: &mut Album) -> String {
    let (found, limit_mm) = (&report.document.deviation, colour_limit_mm(report.inspection));
    let excluded = format!("<p>{}</p>\n", escape(&excluded_sentence(found)));
    let Some(figures) = &found.statistics else {
        return section("Deviation", &format!("<p>Nothing was measured.</p>\n{excluded}"));
    };
    let samples = &report.inspection.deviations().samples;
    let ink = |sample: &crate::inspection::deviation::SampleDeviation| {
        let step = deviation_step(f64::from(sample.distance_mm), limit_mm);
        if sample.points > 0 { Ink::Deviation(step) } else { Ink::NotAsked }
    };
    let codes: Vec<u8> = samples.iter().map(|sample| ink(sample).code()).collect();
    let entry = |step: u8| {
        let middle_mm = (f64::from(step) - 3.0) / 3.0 * limit_mm;
        format!("<li>{}{} mm</li>", swatch(Ink::Deviation(step)), number(middle_mm, 3))
    };
    let legend: String = (0..7).map(entry).collect();
    let legend = format!("{legend}<li>{}Not measured</li>", swatch(Ink::NotAsked));
    let head = ["", "Mean, mm", "RMS, mm", "1 %, mm", "Median, mm", "99 %, mm", "Largest, mm"];
    let extents = found.extents.iter().zip(["Length (x)", "Width (y)", "Height (z)"]).map(|(extent, name)| {
        let measured = extent.measured_mm.map_or("not measured".to_owned(), |measured| {
            format!("{} mm ({} mm)", number(measured, 3), number(measured - extent.nominal_mm, 3))
        });
        row(&[name.to_owned(), format!("{} mm", number(extent.nominal_mm, 3)), measured])
    });
    let extents: String = extents.collect();
    let worst = found.worst.iter().take(10).map(|spot| {
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
        table(&["Material", "Largest, mm", "Mean, mm", "Area", "At, mm"], &worst)
    };
    let heaps = off_surface(report);
    let body = excluded
        + &pictures(report, album, &codes, "the part, coloured by deviation", &legend)
        + &format!("<div class=\"card\">{}</div>\n", histogram(report))
        + &table(&head, &statistics_row("Whole part", figures))
        + "<h3>Extents</h3>\n"
        + &table(&["", "Nominal", "Measured"], &extents)
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
            "<p>No spot of what is compared deviates by more than 0.1 mm and its uncertainty; {off} of the area lies beyond the search \
             distance and is not compared.</p>\n"
        );
    }
    "<p>No spot deviates by more than 0.1 mm and its uncertainty.</p>\n".to_owned()
}

/// Points off the surface.
fn off_surface(report: &InspectionReport<'_>) -> String {
    let heaps = report.document.deviation.off_surface.iter().take(10).map(|heap| {
        row(&[heap.kind.as_str().to_owned(), heap.points.to_string(), number(heap.mean_mm, 2), triple(heap.centre_mm, 1)])
    });
    let heaps: String = heaps.collect();
    if heaps.is_empty() {
        return heaps;
    }
    format!("<h3>Points off the surface</h3>\n{}", table(&["Material", "Points", "Mean distance, mm", "At, mm"], &heaps))
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
    let mut svg = Svg::new(WIDTH, HEIGHT, "Area by deviation", "Histogram of the measured area by its deviation");
    let most = histogram.area_mm2.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
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
        LossCause::Pose | LossCause::UnmodelledOccluder => (MissGroup::Shadow, "View off its pose, or something in the way"),
        LossCause::PartDeviates => (MissGroup::Resting, "The part deviates"),
        LossCause::Grazing => (MissGroup::Incidence, "Too flat for this scanner"),
        LossCause::Specular | LossCause::Dark | LossCause::Saturated => (MissGroup::Facing, "Glare, dark or saturated"),
        LossCause::Edge | LossCause::Concave => (MissGroup::Frame, "Edge or concave corner"),
        LossCause::DepthBlur | LossCause::Sparse | LossCause::Noisy => (MissGroup::Depth, "Blurred, sparse or noisy"),
        LossCause::Filtered | LossCause::Unexplained => (MissGroup::NotChosen, "Cleaned away, or unexplained"),
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
            format!("<b>{}</b>", escape(&loss.cause.as_str().replace('_', " "))),
            percent(loss.of_asked),
            area(loss.area_mm2),
            loss.spots.to_string(),
            escape(&loss.detail),
            remedy.to_owned(),
        ])
    };
    let rows: String = losses.iter().map(of_cause).collect();
    let head = ["Cause", "Of asked", "Area", "Spots", "", "Remedy"];
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

fn regions(report: &InspectionReport<'_>) -> String {
    let rows: String = report.document.deviation.regions.iter().map(region_row).collect();
    if rows.is_empty() {
        return rows;
    }
    let head = ["Region", "Verdict", "Tolerance, mm", "Measured", "Left out", "Largest, mm", "U (k = 2), mm"];
    section(
        "Regions and features",
        &(table(&head, &rows)
            + "<p>Verdicts after ISO 14253-1: <i>undecided</i> where the deviation lies within its uncertainty of the limit, where too \
         little is measured, or where surface is <i>off</i>: points before or behind it lie beyond the search distance; raise \
         <code>compare.search_mm</code> so that it is judged. <i>Steep</i> points show a surface that is turned too far against the \
         model: where most are, and beyond the limit, the area counts as not measured.</p>\n"),
    )
}

fn region_row(region: &RegionDeviationDocument) -> String {
    let verdict = region.verdict.map_or("no tolerance", |verdict| verdict.as_str());
    let mm = |value: Option<f64>| value.map_or("–".to_owned(), |value| number(value, 3));
    let excluded = region.excluded;
    let [points, steep, off] = [excluded.turned_of_points, excluded.turned_of_area, excluded.off_of_area].map(percent);
    row(&[
        escape(&region.name),
        format!("<b>{verdict}</b>"),
        mm(region.tolerance_mm),
        percent(region.measured),
        format!("{points} of the points steep; area: {steep} steep, {off} off"),
        mm(region.statistics.map(|figures| figures.max_mm)),
        mm(region.expanded_uncertainty_mm),
    ])
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
    let noise = learned.noise_best_mm.map_or_else(String::new, |noise| {
        let [low, high] = noise.interval;
        format!(
            "<p>Noise at best focus: {} mm ({} to {} mm, {} triples of points).</p>\n",
            number(noise.value, 4),
            number(low, 4),
            number(high, 4),
            noise.count
        )
    });
    section("What the scans teach about the scanner", &(noise + &body))
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

fn views(report: &InspectionReport<'_>) -> String {
    let of_view = |view: &crate::wire::inspection::ViewCoverageDocument| {
        let share = if view.planned_area_mm2 > 0.0 { view.planned_and_measured_area_mm2 / view.planned_area_mm2 } else { 0.0 };
        row(&[
            view.viewpoint.to_string(),
            view.scans.to_string(),
            area(view.planned_area_mm2),
            area(view.measured_area_mm2),
            percent(share),
        ])
    };
    let rows: String = report.document.coverage.by_view.iter().map(of_view).collect();
    section("Views", &table(&["View", "Scans", "Planned", "Measured", "Of planned"], &rows))
}

fn files(report: &InspectionReport<'_>) -> String {
    let of_scan = |scan: &crate::wire::inspection::TakenScanDocument| {
        let removed: Vec<String> = scan
            .removed
            .iter()
            .map(|removed| format!("{} {}", removed.points, removed.reason.as_str().replace('_', " ")))
            .collect();
        row(&[
            escape(&scan.file),
            scan.viewpoint.to_string(),
            scan.points.to_string(),
            format!("{}, {} frame", scan.unit, scan.frame.as_str()),
            percent(scan.on_part),
            escape(&removed.join(", ")),
        ])
    };
    let rows: String = report.document.scans.iter().map(of_scan).collect();
    let findings: String =
        report.document.findings.iter().map(|finding| format!("<li>{}</li>\n", escape(&finding.detail))).collect();
    let findings = if findings.is_empty() { findings } else { format!("<ul>\n{findings}</ul>\n") };
    section("Files", &(findings + &table(&["File", "View", "Points", "Read as", "On the part", "Removed"], &rows)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inspection::deviation::Conformity;
    use crate::wire::inspection::ExcludedSharesDocument;

    #[test]
    fn no_spot_is_told_with_the_share_that_is_not_compared() {
        assert!(no_spot(0.0).contains("No spot deviates"), "{}", no_spot(0.0));
        let told = no_spot(0.03).replace('\u{a0}', " ");
        assert!(!told.contains("No spot deviates") && told.contains("3.00 % of the area lies beyond"), "{told}");
    }

    #[test]
    fn a_region_tells_what_its_verdict_leaves_out() {
        let region = RegionDeviationDocument {
            name: "top".into(),
            tolerance_mm: Some(0.1),
            measured: 0.9,
            excluded: ExcludedSharesDocument { turned_of_points: 0.25, turned_of_area: 0.05, off_of_area: 0.03 },
            verdict: Some(Conformity::Undecided),
            expanded_uncertainty_mm: None,
            statistics: None,
        };
        let row = region_row(&region).replace('\u{a0}', " ");
        assert!(row.contains("25.00 % of the points steep; area: 5.00 % steep, 3.00 % off"), "{row}");
    }
}
