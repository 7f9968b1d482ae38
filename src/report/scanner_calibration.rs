//! Page on a calibration of a scanner's lenses: figures with their uncertainty, reprojection errors as vectors, coverage of the
//! images, residuals by view. Equal input gives equal bytes.

use super::html::markup::{escape, number};
use super::html::page::document;
use super::study::svg::Svg;
use crate::cell::calibration::lens::{Adjusted, BoardObservations, PixelResidual};
use crate::cell::{DeviceName, PerDevice};
use crate::wire::scanner_calibration::{DeviceFigures, ScannerCalibration, ViewFigures};
use crate::wire::words::counted;

/// Most vectors of one picture.
const MAX_VECTORS: usize = 3000;
/// Length of the largest drawn residual, in the drawing.
const VECTOR: f64 = 22.0;
/// Series of the residuals left out: the second colour, dashed.
const LEFT_OUT: usize = 7;
/// Width of the pictures.
const WIDTH: f64 = 980.0;

/// Residual at a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Arrow {
    pixel: [f64; 2],
    off_px: [f64; 2],
    is_used: bool,
}

/// Residuals that pictures are drawn of.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationPictures {
    /// Residuals that are drawn: where there are too many, every n-th, and all that were left out.
    arrows: PerDevice<Vec<Arrow>>,
    /// Number of all residuals, drawn or not.
    points: PerDevice<usize>,
    size_px: PerDevice<Option<[u32; 2]>>,
}

impl CalibrationPictures {
    /// Collects the residuals of each device.
    #[must_use]
    pub fn new(observations: &BoardObservations, adjusted: &Adjusted) -> Self {
        Self::of_residuals(&adjusted.residuals, observations.size_px)
    }

    fn of_residuals(residuals: &[PixelResidual], size_px: PerDevice<Option<[u32; 2]>>) -> Self {
        let all = |device: DeviceName| residuals.iter().filter(move |residual| residual.device == device);
        let of = |device: DeviceName| -> Vec<Arrow> {
            let own: Vec<_> = all(device).collect();
            let every = own.len().div_ceil(MAX_VECTORS).max(1);
            let kept = own.iter().enumerate().filter(|(index, residual)| index % every == 0 || !residual.is_used);
            kept.map(|(_, residual)| Arrow {
                pixel: residual.pixel.into(),
                off_px: residual.off_px.into(),
                is_used: residual.is_used,
            })
            .collect()
        };
        let arrows = PerDevice { left: of(DeviceName::Left), right: of(DeviceName::Right), projector: of(DeviceName::Projector) };
        let count = |device: DeviceName| all(device).count();
        let points =
            PerDevice { left: count(DeviceName::Left), right: count(DeviceName::Right), projector: count(DeviceName::Projector) };
        Self { arrows, points, size_px }
    }

    /// Number of the points of a device, and how many of them are drawn where not all are.
    fn counted_points(&self, device: DeviceName) -> String {
        let (all, drawn) = (self.points[device], self.arrows[device].len());
        let thinned = if drawn < all { format!(", {drawn} of them drawn") } else { String::new() };
        counted(all, "point") + &thinned
    }
}

/// Renders the page.
#[must_use]
pub fn html(calibration: &ScannerCalibration, pictures: Option<&CalibrationPictures>) -> String {
    let section = |name: &str, body: &str| format!("<section>\n<h2>{name}</h2>\n{body}</section>\n");
    let mut body = header(calibration);
    body += "<main>\n";
    if !calibration.warnings.is_empty() {
        let items: Vec<String> = calibration.warnings.iter().map(|warning| format!("<li>{}</li>\n", escape(warning))).collect();
        body += &section("Findings", &format!("<ul>\n{}</ul>\n", items.concat()));
    }
    body += &section("Rig", &rig(calibration));
    body += &section("Lenses", &calibration.devices.iter().map(lens_table).collect::<String>());
    if let Some(pictures) = pictures {
        let drawn = DeviceName::ALL.into_iter().filter(|device| !pictures.arrows[*device].is_empty());
        let cards = drawn.map(|device| card(&vectors_svg(device, pictures)) + &card(&coverage_svg(device, pictures)));
        body += &section("Reprojection errors and coverage", &cards.collect::<String>());
    }
    if !calibration.views.is_empty() {
        body += &section("Views", &(card(&views_svg(&calibration.views)) + &views_table(&calibration.views)));
    }
    body += "</main>\n";
    document(&format!("Calibration: {}", calibration.scanner), &body)
}

fn card(svg: &str) -> String {
    format!("<div class=\"card\">{svg}</div>\n")
}

fn header(calibration: &ScannerCalibration) -> String {
    let facts = [
        ("Scanner", calibration.scanner.clone()),
        ("Files", calibration.files.join(", ")),
        ("Measured", calibration.taken_at.clone().unwrap_or_else(|| "time not given".to_owned())),
        ("SHA-256 of the data", calibration.data_sha256.clone()),
    ];
    let facts = facts.map(|(name, value)| format!("<div><dt>{name}</dt><dd>{}</dd></div>", escape(&value)));
    let facts = facts.concat();
    format!(
        "<header>\n<p class=\"kind\">Calibration</p>\n<h1>Lenses and poses of the scanner</h1>\n<dl class=\"facts\">{facts}</dl>\n</header>\n"
    )
}

fn with_sigma(value: f64, sigma: Option<f64>, decimals: usize) -> String {
    let sigma =
        sigma.map_or_else(|| "uncertainty not known".to_owned(), |sigma| format!("standard deviation {}", significant(sigma)));
    format!("{} ({sigma})", number(value, decimals))
}

/// A value with three significant digits.
fn significant(value: f64) -> String {
    if value <= 0.0 || !value.is_finite() {
        return number(value, 0);
    }
    let decimals = (2.0 - value.log10().floor()).clamp(0.0, 12.0);
    number(value, decimals as usize)
}

fn optional(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| number(value, decimals))
}

fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let cells = |cells: &[String], tag: &str| -> String {
        cells
            .iter()
            .enumerate()
            .map(|(i, c)| format!("<{tag}{}>{}</{tag}>", if i > 0 { " class=\"n\"" } else { "" }, escape(c)))
            .collect()
    };
    let head: Vec<String> = head.iter().map(|&name| name.to_owned()).collect();
    let rows: String = rows.iter().map(|row| format!("<tr>{}</tr>\n", cells(row, "td"))).collect();
    format!(
        "<div class=\"card scroll\"><table>\n<thead><tr>{}</tr></thead>\n<tbody>\n{rows}</tbody></table></div>\n",
        cells(&head, "th")
    )
}

fn rig(calibration: &ScannerCalibration) -> String {
    let rig = &calibration.rig;
    let size = |[width, height]: [f64; 2]| format!("{} × {} mm", number(width, 1), number(height, 1));
    let field = &calibration.field;
    let mut rows = vec![
        vec!["Baseline, mm".to_owned(), with_sigma(rig.baseline_mm, rig.baseline_sigma_mm, 3)],
        vec!["Angle between the optical axes, °".to_owned(), with_sigma(rig.axes_angle_deg, rig.axes_angle_sigma_deg, 4)],
        vec![format!("Field of both cameras at {} mm", number(field.depth_mm, 0)), size(field.cameras_mm)],
        vec![format!("Field of all three devices at {} mm", number(field.depth_mm, 0)), size(field.common_mm)],
    ];
    rows.extend(field.stated_mm.map(|stated| vec!["Field as stated".to_owned(), size(stated)]));
    rows.extend(calibration.epipolar_rms_px.map(|rms| vec!["Distance from epipolar lines, px rms".to_owned(), number(rms, 3)]));
    if let Some(pitch) = calibration.board_pitch {
        let count = number(pitch.count as f64, 0);
        let said = format!("{} (mean {}, {count} distances)", number(pitch.rms_mm, 4), number(pitch.mean_mm, 4));
        rows.push(vec!["Triangulated board pitch, error, mm rms".to_owned(), said]);
    }
    if let Some([near, far]) = calibration.board_depth_mm {
        rows.push(vec!["Depths of the board, mm".to_owned(), format!("{} to {}", number(near, 0), number(far, 0))]);
    }
    if let Some(origin) = &calibration.depth_origin {
        let place = with_sigma(origin.origin_mm, Some(origin.sigma_mm), 2);
        let said = format!("{place}: {}", origin.datum.as_str().replace('_', " "));
        rows.push(vec!["Working distances are measured from z, mm".to_owned(), said]);
    }
    table(&["Figure", "Value"], &rows)
}

fn lens_table(device: &DeviceFigures) -> String {
    let rows: Vec<Vec<String>> = device
        .parameters
        .iter()
        .map(|parameter| {
            let decimals = if matches!(parameter.name, "fx" | "fy" | "cx" | "cy") { 3 } else { 6 };
            let sigma = parameter.sigma.map_or_else(|| "–".to_owned(), significant);
            vec![parameter.name.to_owned(), number(parameter.value, decimals), sigma]
        })
        .collect();
    let rms = device.rms_px.map_or_else(|| "reprojection error not given".to_owned(), |rms| format!("{} px rms", number(rms, 3)));
    let counted = device.used.map_or_else(String::new, |used| {
        let [used, left_out] = [used, device.left_out.unwrap_or_default()].map(|count| number(count as f64, 0));
        format!(", {used} points, {left_out} left out")
    });
    let [width, height] = device.size_px;
    let heading = format!("<h3>{}: {width} × {height} px, {rms}{counted}</h3>\n", device.name);
    heading + &table(&["Parameter", "Value", "Standard deviation"], &rows)
}

/// Scale and height of a picture of an image.
fn fit([width, height]: [u32; 2]) -> (f64, f64) {
    let scale = (WIDTH - 40.0) / f64::from(width.max(1));
    (scale, 40.0 + scale * f64::from(height) + 40.0)
}

fn at(pixel: [f64; 2], scale: f64) -> [f64; 2] {
    [20.0 + scale * pixel[0], 40.0 + scale * pixel[1]]
}

/// Draws the residuals of a device as vectors, enlarged.
#[must_use]
fn vectors_svg(device: DeviceName, pictures: &CalibrationPictures) -> String {
    let arrows = &pictures.arrows[device];
    let size_px = pictures.size_px[device].unwrap_or([1, 1]);
    let (scale, height) = fit(size_px);
    let length = |arrow: &Arrow| arrow.off_px[0].hypot(arrow.off_px[1]);
    let mut lengths: Vec<f64> = arrows.iter().filter(|arrow| arrow.is_used).map(length).collect();
    lengths.sort_by(f64::total_cmp);
    let large = lengths.get(lengths.len() * 99 / 100).copied().unwrap_or(1.0).max(1e-9);
    let title = format!("{}: reprojection errors, {} × enlarged", device.as_str(), number(VECTOR / large / scale, 0));
    let mut svg = Svg::new(WIDTH, height, &title, &format!("{title}; {}", pictures.counted_points(device)));
    frame(&mut svg, size_px, scale);
    for arrow in arrows {
        let from = at(arrow.pixel, scale);
        // Gross errors are cut, so that they do not hide the others.
        let factor = VECTOR / large * (2.0 * large / length(arrow).max(1e-12)).min(1.0);
        let to = [from[0] + factor * arrow.off_px[0], from[1] + factor * arrow.off_px[1]];
        svg.series(if arrow.is_used { 0 } else { LEFT_OUT }, &[from, to]);
    }
    svg.text(
        20.0,
        height - 12.0,
        "",
        &format!("1 % of the errors are longer than {} px; left out: dashed in the second colour", significant(large)),
    );
    svg.finish()
}

fn frame(svg: &mut Svg, [width, height]: [u32; 2], scale: f64) {
    let (w, h) = (f64::from(width), f64::from(height));
    let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]].map(|corner| at(corner, scale));
    for (from, to) in (0..4).map(|i| (corners[i], corners[(i + 1) % 4])) {
        svg.line("grid", from, to);
    }
}

/// Draws the points of a device in its image.
#[must_use]
fn coverage_svg(device: DeviceName, pictures: &CalibrationPictures) -> String {
    let arrows = &pictures.arrows[device];
    let size_px = pictures.size_px[device].unwrap_or([1, 1]);
    let (scale, height) = fit(size_px);
    let title = format!("{}: points of the board in the image", device.as_str());
    let mut svg = Svg::new(WIDTH, height, &title, &format!("{title}; {}", pictures.counted_points(device)));
    frame(&mut svg, size_px, scale);
    for arrow in arrows {
        let [x, y] = at(arrow.pixel, scale);
        svg.bar("#0072b2", [x - 1.2, y - 1.2], [2.4, 2.4]);
    }
    svg.finish()
}

/// Draws the residuals of the views, a device a series.
#[must_use]
fn views_svg(views: &[ViewFigures]) -> String {
    const HEIGHT: f64 = 320.0;
    let (left, right, top, foot) = (64.0, WIDTH - 20.0, 60.0, HEIGHT - 44.0);
    let values = |view: &ViewFigures| [view.left_rms_px, view.right_rms_px, view.projector_rms_px];
    let max = views.iter().flat_map(values).flatten().fold(0.0, f64::max).max(1e-9);
    let mut svg = Svg::new(
        WIDTH,
        HEIGHT,
        "Residual by view, px rms",
        &format!("Residuals of {}, up to {} px", counted(views.len(), "view"), significant(max)),
    );
    for tick in 0..=4 {
        let share = f64::from(tick) / 4.0;
        let y = foot - share * (foot - top);
        svg.line("grid", [left, y], [right, y]);
        svg.text(left - 8.0, y + 4.0, "end", &significant(share * max));
    }
    let x = |index: usize| left + 12.0 + (right - left - 24.0) * (index as f64 + 0.5) / views.len().max(1) as f64;
    for (series, name) in ["left", "right", "projector"].into_iter().enumerate() {
        let place = left + 12.0 + 120.0 * series as f64;
        svg.point(series, [place, top - 16.0], name);
        svg.text(place + 10.0, top - 12.0, "ink", name);
        for (index, view) in views.iter().enumerate() {
            let Some(rms) = values(view)[series] else { continue };
            svg.point(
                series,
                [x(index), foot - rms / max * (foot - top)],
                &format!("{} {name}: {} px", view.id, significant(rms)),
            );
        }
    }
    let every = views.len().div_ceil(20).max(1);
    for (index, view) in views.iter().enumerate().filter(|(index, _)| index % every == 0) {
        svg.text(x(index), foot + 18.0, "middle", &view.id.chars().take(8).collect::<String>());
    }
    svg.finish()
}

fn views_table(views: &[ViewFigures]) -> String {
    let row = |view: &ViewFigures| {
        let advice = if view.leave_out { "leave out" } else { "" };
        vec![
            view.id.clone(),
            optional(view.left_rms_px, 3),
            optional(view.right_rms_px, 3),
            optional(view.projector_rms_px, 3),
            view.left_out.to_string(),
            optional(view.depth_mm, 0),
            optional(view.tilt_deg, 1),
            advice.to_owned(),
        ]
    };
    let rows: Vec<Vec<String>> = views.iter().map(row).collect();
    let head = ["View", "Left, px", "Right, px", "Projector, px", "Left out", "Depth, mm", "Tilt, °", "Advice"];
    table(&head, &rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_says_what_its_uncertainty_is() {
        assert_eq!(with_sigma(209.941, Some(0.012_34), 3), "209.941 (standard deviation 0.0123)");
        assert_eq!(with_sigma(209.941, None, 3), "209.941 (uncertainty not known)");
    }

    #[test]
    fn residuals_left_out_are_drawn_as_the_legend_says() {
        let arrow = |is_used: bool| Arrow { pixel: [10.0, 20.0], off_px: [0.1, 0.0], is_used };
        let drawn = |arrows: Vec<Arrow>| {
            let points = PerDevice { left: arrows.len(), right: 0, projector: 0 };
            let arrows = PerDevice { left: arrows, right: Vec::new(), projector: Vec::new() };
            let size_px = PerDevice { left: Some([100, 80]), right: None, projector: None };
            vectors_svg(DeviceName::Left, &CalibrationPictures { arrows, points, size_px })
        };
        assert!(drawn(vec![arrow(false)]).contains("left out: dashed in the second colour"));
        assert!(drawn(vec![arrow(false)]).contains("; 1 point\"") && drawn(vec![arrow(true); 2]).contains("; 2 points\""));
        let (used, left_out) = ("stroke=\"#0072b2\" stroke-dasharray=\"\"", "stroke=\"#d55e00\" stroke-dasharray=\"7 4\"");
        assert!(drawn(vec![arrow(true)]).contains(used) && !drawn(vec![arrow(true)]).contains(left_out));
        assert!(drawn(vec![arrow(false)]).contains(left_out), "{}", drawn(vec![arrow(false)]));
    }

    /// Labels told the points drawn as if they were all.
    #[test]
    fn a_label_tells_all_points_and_how_many_of_them_are_drawn() {
        let residual = |point: u32| PixelResidual {
            view: 0,
            device: DeviceName::Left,
            point,
            pixel: nalgebra::Vector2::new(10.0, 20.0),
            off_px: nalgebra::Vector2::new(0.1, 0.0),
            // One that is left out is drawn although its turn has not come.
            is_used: point != 1,
        };
        let size_px = PerDevice { left: Some([100, 80]), right: None, projector: None };
        let of = |count: u32| CalibrationPictures::of_residuals(&(0..count).map(residual).collect::<Vec<_>>(), size_px);
        for (count, said) in [(3000, "; 3000 points\""), (6000, "; 6000 points, 3001 of them drawn\"")] {
            let pictures = of(count);
            for svg in [vectors_svg(DeviceName::Left, &pictures), coverage_svg(DeviceName::Left, &pictures)] {
                let label = svg.lines().find(|line| line.contains("aria-label")).expect("a label");
                assert!(label.contains(said), "{label}");
            }
        }
    }

    #[test]
    fn views_and_their_residuals_are_named_as_readers_call_them() {
        let views = [ViewFigures {
            id: "v001".to_owned(),
            left_rms_px: Some(0.05),
            right_rms_px: Some(0.06),
            projector_rms_px: None,
            left_out: 1,
            depth_mm: Some(480.0),
            tilt_deg: Some(12.0),
            leave_out: false,
        }];
        assert!(views_svg(&views).contains(">Residual by view, px rms<"), "{}", views_svg(&views));
        assert!(views_svg(&views).contains("\"Residuals of 1 view, up to 0.0600 px\""), "{}", views_svg(&views));
        assert!(views_table(&views).contains(">View<"), "{}", views_table(&views));
    }
}
