//! Page of a calibration: its result in figures, residuals over the table's angle, error ellipses of what was used, dropped and held
//! out, and the table of observations.

use crate::report::html::markup::{escape, number, row};
use crate::report::html::page::document;
use crate::report::study::svg::Svg;
use crate::wire::calibration::{CalibrationDocument, ResidualDocument};

/// Plot: width, height and margins, px.
const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 340.0;
const LEFT: f64 = 64.0;
const TOP: f64 = 48.0;
const BOTTOM: f64 = 44.0;
/// Radius in standard deviations of the ellipse that holds 95 % of a plane's points: √χ²₂(0.05).
const ELLIPSE: f64 = 2.4477;
/// Corners of an ellipse as drawn.
const CORNERS: u32 = 72;

/// Renders the page.
#[must_use]
pub fn calibration_html(calibration: &CalibrationDocument) -> String {
    let figure = |name: &str, svg: String| format!("<section>\n<h2>{name}</h2>\n<div class=\"card\">{svg}</div>\n</section>\n");
    let body = [
        header(calibration),
        "<main>\n".to_owned(),
        result(calibration),
        findings(calibration),
        figure("Residuals over the table's angle", over_angle(&calibration.residuals)),
        figure("Where the board was seen, beside where it is predicted", ellipses(&calibration.residuals)),
        observations(&calibration.residuals),
        "</main>\n".to_owned(),
    ];
    document(&format!("Calibration: {}", calibration.cell), &body.concat())
}

fn header(calibration: &CalibrationDocument) -> String {
    let [given, used, held_out, dropped] = calibration.observation_counts();
    let counts = format!("{given}, of which {used} used, {held_out} held out, {dropped} dropped");
    let facts = [
        ("Cell", calibration.cell.clone()),
        ("Solved for", calibration.kind.as_str().replace('_', " ")),
        ("Taken", calibration.taken_at.to_string()),
        ("Observations", counts),
        ("Calibration", calibration.id.chars().take(12).collect()),
    ];
    let facts = facts.map(|(name, value)| format!("<div><dt>{name}</dt><dd>{}</dd></div>", escape(&value)));
    format!(
        "<header>\n<p class=\"kind\">Calibration</p>\n<h1>{}</h1>\n<dl class=\"facts\">{}</dl>\n</header>\n",
        escape(&calibration.cell),
        facts.concat()
    )
}

fn result(calibration: &CalibrationDocument) -> String {
    let place = |name: &str, mm: [f64; 3]| row(&[name.to_owned(), mm.map(|value| number(value, 3)).join(" · ") + " mm"]);
    let spread = |name: &str, mm: f64, deg: f64| row(&[name.to_owned(), format!("{} mm, {}°", number(mm, 3), number(deg, 4))]);
    let summary = &calibration.summary.spread;
    let left_out = &calibration.leave_one_out.spread;
    let seen = &calibration.observability;
    let mut rows = place("Scanner on the flange", calibration.flange_from_scanner.translation_mm);
    if let Some(is_converged) = calibration.converged {
        let told = if is_converged { "converged" } else { "not converged: not to be used, see the findings" };
        rows += &row(&["Adjustment".to_owned(), told.to_owned()]);
    }
    if let Some(table) = &calibration.base_from_table {
        rows += &place("Table in the base", table.translation_mm);
    }
    rows += &spread("Residuals, root mean square", summary.rms_translation_mm, summary.rms_rotation_deg);
    rows += &spread("Residuals, largest", summary.max_translation_mm, summary.max_rotation_deg);
    rows += &spread("Residuals, each predicted from the others", left_out.rms_translation_mm, left_out.rms_rotation_deg);
    if let Some(held_out) = &calibration.held_out {
        rows += &spread("Held out", held_out.rms_translation_mm, held_out.rms_rotation_deg);
    }
    rows += &spread("Standard deviation of the scanner's pose", seen.translation_sd_mm, seen.rotation_sd_deg);
    let point = format!("{} mm", number(calibration.point_at_best_focus_sd_mm, 3));
    rows += &row(&["Standard deviation of a scanned point at best focus".to_owned(), point]);
    if let Some(face) = &calibration.plate_face {
        let (height, tilt) = (with_sd(&format!("{} mm", number(face.height_mm, 3)), face.height_sd_mm), number(face.tilt_deg, 4));
        let name = "Face of the plate above the nominal table".to_owned();
        rows += &row(&[name, format!("{height}, tilted by {tilt}°")]);
    }
    let taken_out: Vec<String> = calibration.turntable_runout.iter().map(|harmonic| harmonic.order.to_string()).collect();
    if !taken_out.is_empty() {
        let name = "Runout above noise, added to the turntable's specification".to_owned();
        rows += &row(&[name, format!("harmonics {} of the angle", taken_out.join(", "))]);
    }
    for harmonic in &calibration.table_runout {
        let [radial, axial] = [harmonic.radial_mm, harmonic.axial_mm].map(|mm| number(mm, 3));
        let name = format!("Runout of the table, {} per turn", harmonic.order);
        rows += &row(&[name, with_sd(&format!("{radial} mm radial, {axial} mm axial"), harmonic.sd_mm)]);
    }
    format!("<section>\n<h2>Result</h2>\n<div class=\"card\"><table>\n{rows}</table></div>\n</section>\n")
}

/// A figure with its standard deviation.
fn with_sd(figure: &str, sd_mm: f64) -> String {
    format!("{figure} (standard deviation {} mm)", number(sd_mm, 3))
}

fn findings(calibration: &CalibrationDocument) -> String {
    let items: String = calibration.findings.iter().map(|found| finding(found.code.as_str(), &found.detail)).collect();
    if items.is_empty() {
        return String::new();
    }
    format!("<section>\n<h2>Findings</h2>\n<ul>\n{items}</ul>\n</section>\n")
}

/// A finding: the name of its code in words, and its sentence.
fn finding(code: &str, detail: &str) -> String {
    format!("<li><strong>{}</strong>: {}</li>\n", escape(&code.replace('_', " ")), escape(detail))
}

/// Number of a series: used, dropped, held out.
fn series(residual: &ResidualDocument) -> usize {
    match (residual.held_out, residual.used) {
        (true, _) => 2,
        (false, true) => 0,
        (false, false) => 1,
    }
}

fn words(residual: &ResidualDocument) -> String {
    let what = ["used", "dropped", "held out"][series(residual)];
    format!("{}, {what}: {:.3} mm, {:.4}°", residual.id, residual.translation_mm, residual.rotation_deg)
}

/// Largest residual that a plot shows: dropped ones far beyond the others are drawn at its edge.
fn limit_mm(residuals: &[ResidualDocument]) -> f64 {
    let shown = residuals.iter().filter(|residual| residual.used || residual.held_out);
    1.25 * shown.map(|residual| residual.translation_mm).fold(1e-6, f64::max)
}

fn legend(svg: &mut Svg) {
    for (number, name) in ["used", "dropped", "held out"].into_iter().enumerate() {
        let x = WIDTH - 250.0 + 82.0 * number as f64;
        svg.point(number, [x, 22.0], name);
        svg.text(x + 9.0, 26.0, "ink", name);
    }
}

fn over_angle(residuals: &[ResidualDocument]) -> String {
    let mut svg = Svg::new(WIDTH, HEIGHT, "Residual, mm", "Length of each residual over the angle of the table");
    let (limit, bottom) = (limit_mm(residuals), HEIGHT - BOTTOM);
    let y = |mm: f64| bottom - (bottom - TOP) * (mm / limit).min(1.0);
    let x = |angle: f64| LEFT + (WIDTH - LEFT - 16.0) * (angle + 360.0) / 720.0;
    for part in 0..=4 {
        let mm = limit * f64::from(part) / 4.0;
        svg.line("grid", [LEFT, y(mm)], [WIDTH - 16.0, y(mm)]);
        svg.text(LEFT - 8.0, y(mm) + 4.0, "end", &number(mm, 3));
    }
    for part in -2..=2 {
        let angle = 180.0 * f64::from(part);
        svg.line("grid", [x(angle), TOP], [x(angle), bottom]);
        svg.text(x(angle), bottom + 20.0, "middle", &format!("{angle}°"));
    }
    for residual in residuals {
        let at = [x(residual.table_angle_deg.clamp(-360.0, 360.0)), y(residual.translation_mm)];
        svg.point(series(residual), at, &words(residual));
    }
    legend(&mut svg);
    svg.finish()
}

/// Shifts in the board's planes xy and xz, each with the ellipse that holds 95 % of those used.
fn ellipses(residuals: &[ResidualDocument]) -> String {
    let title = "Shift, mm; an ellipse contains 95 % of the used observations";
    let mut svg = Svg::new(WIDTH, 380.0, title, "Shift of each residual in two planes of the board, with 95 % ellipses");
    let limit = limit_mm(residuals);
    for (place, (across, up, name)) in [(0, 1, "y over x"), (0, 2, "z over x")].into_iter().enumerate() {
        let centre = [190.0 + 340.0 * place as f64, 210.0];
        let scale = 140.0 / limit;
        let at = |shift: [f64; 2]| {
            let [right, top] = shift.map(|mm| (mm * scale).clamp(-140.0, 140.0));
            [centre[0] + right, centre[1] - top]
        };
        svg.line("grid", at([-limit, 0.0]), at([limit, 0.0]));
        svg.line("grid", at([0.0, -limit]), at([0.0, limit]));
        svg.text(centre[0], 372.0, "middle", &format!("{name}, ± {} mm", number(limit, 3)));
        let used: Vec<[f64; 2]> = residuals.iter().filter(|r| r.used).map(|r| [r.shift_mm[across], r.shift_mm[up]]).collect();
        let ellipse: Vec<[f64; 2]> = ellipse(&used).into_iter().map(at).collect();
        svg.area(0, &ellipse);
        svg.series(0, &ellipse);
        for residual in residuals {
            svg.point(series(residual), at([residual.shift_mm[across], residual.shift_mm[up]]), &words(residual));
        }
    }
    legend(&mut svg);
    svg.finish()
}

/// Ellipse of the points' covariance about their mean: its root by Cholesky's factor takes the circle to it.
fn ellipse(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let count = points.len().max(1) as f64;
    let mean = [0, 1].map(|axis| points.iter().map(|point| point[axis]).sum::<f64>() / count);
    let moment = |a: usize, b: usize| {
        points.iter().map(|point| (point[a] - mean[a]) * (point[b] - mean[b])).sum::<f64>() / (count - 1.0).max(1.0)
    };
    let first = moment(0, 0).max(0.0).sqrt();
    let below = if first > 0.0 { moment(0, 1) / first } else { 0.0 };
    let second = (moment(1, 1) - below * below).max(0.0).sqrt();
    (0..=CORNERS)
        .map(|corner| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(corner) / f64::from(CORNERS)).sin_cos();
            [mean[0] + ELLIPSE * first * cos, mean[1] + ELLIPSE * (below * cos + second * sin)]
        })
        .collect()
}

fn observations(residuals: &[ResidualDocument]) -> String {
    let head = ["observation", "table °", "residual mm", "residual °", "predicted by the others mm", "whitened square", "use"];
    let head: String = head.iter().map(|name| format!("<th>{name}</th>")).collect();
    let line = |residual: &ResidualDocument| {
        let dropped = residual.dropped_because.map(|code| code.as_str().replace('_', " "));
        let part = dropped.unwrap_or_else(|| if residual.held_out { "held out".to_owned() } else { "used".to_owned() });
        row(&[
            escape(&residual.id),
            number(residual.table_angle_deg, 1),
            number(residual.translation_mm, 3),
            number(residual.rotation_deg, 4),
            residual.predicted_translation_mm.map_or_else(|| "–".to_owned(), |mm| number(mm, 3)),
            number(residual.whitened, 1),
            part,
        ])
    };
    let rows: String = residuals.iter().map(line).collect();
    format!("<section>\n<h2>Observations</h2>\n<div class=\"card\"><table>\n<tr>{head}</tr>\n{rows}</table></div>\n</section>\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_says_what_its_uncertainty_is_and_a_finding_is_told_in_words() {
        assert_eq!(with_sd("0.120 mm", 0.004), "0.120 mm (standard deviation 0.004 mm)");
        assert_eq!(finding("too_few", "three are"), "<li><strong>too few</strong>: three are</li>\n");
    }
}
