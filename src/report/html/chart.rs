//! Coverage after each view, as an inline SVG: measured share of the asked area over the number of views that are executed, with the
//! coverable share as a ceiling. Colours come from the page, so that the chart follows light and dark themes.

use std::fmt::Write;

use super::markup::{number, percent};
use crate::planning::plan::{Coverage, PlannedView, share};
use crate::wire::words::asked_name;

const WIDTH: f64 = 680.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 24.0;
const TOP: f64 = 20.0;
const BOTTOM: f64 = 52.0;
/// Max labels along the axis of views.
const MAX_TICKS: usize = 12;

/// The chart; empty if no view is executed. A view without a path measures nothing, and counts as none.
pub(super) fn curve(coverage: &Coverage, views: &[PlannedView]) -> String {
    let executed = views.iter().zip(&coverage.curve_area_mm2).filter(|(view, _)| view.rejected.is_none());
    let shares: Vec<f64> = executed.map(|(_, area_mm2)| share(*area_mm2, coverage.asked_area_mm2)).collect();
    let Some(last) = shares.last() else { return String::new() };
    let chart = Chart { views: shares.len() };
    let after = if shares.len() == 1 { "1 view".to_owned() } else { format!("each of {} views", shares.len()) };
    let asked = asked_name(coverage.is_of_open);
    let mut svg = format!(
        "<svg class=\"chart\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"Measured share of the {asked} area after {after}, \
         ending at {}\">\n",
        percent(*last)
    );
    chart.axes(&mut svg);
    chart.ceiling(&mut svg, share(coverage.coverable_area_mm2, coverage.asked_area_mm2));
    chart.line(&mut svg, &shares);
    svg.push_str("</svg>\n");
    svg
}

struct Chart {
    views: usize,
}

// Writing to a String cannot fail; `let _ =` below says so.
impl Chart {
    fn x(&self, view: usize) -> f64 {
        LEFT + (WIDTH - LEFT - RIGHT) * view as f64 / self.views as f64
    }

    fn y(share: f64) -> f64 {
        TOP + (HEIGHT - TOP - BOTTOM) * (1.0 - share)
    }

    fn axes(&self, svg: &mut String) {
        let right = WIDTH - RIGHT;
        for fifth in 0..=5 {
            let share = f64::from(fifth) / 5.0;
            let y = Self::y(share);
            let _ = writeln!(svg, "<line class=\"grid\" x1=\"{LEFT}\" y1=\"{y:.1}\" x2=\"{right}\" y2=\"{y:.1}\"/>");
            let (x, y) = (LEFT - 8.0, y + 4.0);
            let _ = writeln!(svg, "<text x=\"{x}\" y=\"{y:.1}\" text-anchor=\"end\">{}</text>", number(share * 100.0, 0));
        }
        let step = self.views.div_ceil(MAX_TICKS);
        for view in (0..=self.views).step_by(step) {
            let (x, y) = (self.x(view), Self::y(0.0) + 18.0);
            let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">{view}</text>");
        }
        let (x, y) = ((LEFT + right) / 2.0, HEIGHT - 12.0);
        let _ = writeln!(svg, "<text class=\"axis\" x=\"{x}\" y=\"{y}\" text-anchor=\"middle\">number of views</text>");
        let y = Self::y(0.5);
        let _ = writeln!(
            svg,
            "<text class=\"axis\" transform=\"translate(18 {y:.1}) rotate(-90)\" text-anchor=\"middle\">measured, % of the asked \
             area</text>"
        );
    }

    fn ceiling(&self, svg: &mut String, coverable: f64) {
        let (y, right) = (Self::y(coverable), WIDTH - RIGHT);
        let _ = writeln!(svg, "<line class=\"ceiling\" x1=\"{LEFT}\" y1=\"{y:.1}\" x2=\"{right}\" y2=\"{y:.1}\"/>");
        let y = y + 16.0;
        let _ = writeln!(svg, "<text x=\"{}\" y=\"{y:.1}\">coverable {}</text>", LEFT + 6.0, percent(coverable));
    }

    fn line(&self, svg: &mut String, shares: &[f64]) {
        let points: Vec<(f64, f64)> =
            std::iter::once(&0.0).chain(shares).enumerate().map(|(view, share)| (self.x(view), Self::y(*share))).collect();
        let path: Vec<String> = points.iter().map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let _ = writeln!(svg, "<polyline class=\"curve\" points=\"{}\"/>", path.join(" "));
        for ((x, y), (share, views)) in points[1..].iter().zip(shares.iter().zip(1usize..)) {
            let _ = writeln!(
                svg,
                "<circle class=\"curve\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.5\"><title>{views}: {}</title></circle>",
                percent(*share)
            );
        }
        if let (Some((x, y)), Some(share)) = (points.last(), shares.last()) {
            let (x, y) = (x - 2.0, y + 20.0);
            let _ =
                writeln!(svg, "<text class=\"value\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"end\">{}</text>", percent(*share));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use crate::planning::candidates::Label;
    use crate::planning::plan::{CandidateId, Cause, SetupId, ViewId};

    fn view(id: u32, rejected: Option<Cause>) -> PlannedView {
        PlannedView {
            id: ViewId(id),
            candidate: CandidateId(id),
            setup: SetupId(0),
            label: Label::Top,
            part_from_scanner: Pose::identity(),
            gain_of_asked: 0.1,
            score: 1.0,
            station: None,
            stance: None,
            rejected,
            exposure: None,
        }
    }

    fn chart(curve_area_mm2: &[f64], rejected: &[Option<Cause>]) -> String {
        let coverage = Coverage { asked_area_mm2: 100.0, curve_area_mm2: curve_area_mm2.to_vec(), ..Coverage::default() };
        let views: Vec<PlannedView> = (0..).zip(rejected).map(|(id, rejected)| view(id, *rejected)).collect();
        curve(&coverage, &views)
    }

    fn label(chart: &str) -> &str {
        chart.split_once("area after ").and_then(|(_, rest)| rest.split_once(',')).expect("a label").0
    }

    #[test]
    fn one_view_is_no_views() {
        let charts = [chart(&[50.0], &[None]), chart(&[50.0, 75.0], &[None; 2])];
        assert_eq!(charts.each_ref().map(|chart| label(chart)), ["1 view", "each of 2 views"]);
    }

    /// The report says of a plan how many views are executed, and the chart beside it once had more.
    #[test]
    fn views_without_a_path_are_no_views_of_the_chart() {
        let no_path = Some(Cause::NoPath);
        let all = chart(&[50.0, 50.0, 75.0, 75.0], &[None, no_path, None, no_path]);
        assert_eq!(label(&all), "each of 2 views");
        assert_eq!(all, chart(&[50.0, 75.0], &[None; 2]));
        assert_eq!(chart(&[0.0], &[no_path]), "");
    }
}
