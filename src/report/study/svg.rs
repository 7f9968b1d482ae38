//! Elements that plots share: a standalone drawing, its colours, and lines and text in it. Inside a page colours follow the
//! page's theme; standalone they are those of a light page.

use std::fmt::Write;

use crate::report::html::markup::escape;

/// Colours of series (Okabe and Ito 2008, *Color Universal Design*; without black and yellow, which fade on dark and light
/// pages). Further series repeat the colours with another dash.
const HUES: [&str; 6] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const DASHES: [&str; 3] = ["", "7 4", "2 3"];
const STYLE: &str = ".plot{font:13px system-ui,-apple-system,'Segoe UI',Roboto,'Liberation Sans',sans-serif}\
.plot .ground{fill:var(--card,#fff)}.plot text{fill:var(--soft,#565c66)}.plot .strong{fill:var(--ink,#16191d);font-weight:600}\
.plot .ink{fill:var(--ink,#16191d)}.plot .title{fill:var(--ink,#16191d);font-size:15px;font-weight:600}\
.plot .grid{stroke:var(--line,#d9dde3)}.plot .mark{stroke:var(--soft,#565c66);stroke-dasharray:3 4}\
.plot .rest{fill:var(--well,#eceff3);stroke:var(--line,#d9dde3)}.plot .end{text-anchor:end}.plot .middle{text-anchor:middle}\
.plot .light{fill:#fff}.plot .dark{fill:#10202e}.plot .series{fill:none;stroke-width:2.2;stroke-linejoin:round}";

/// A drawing.
pub(in crate::report) struct Svg(String);

// Writing to a String cannot fail; `let _ =` below says so.
impl Svg {
    /// Starts a drawing with a title; `description` says in words what it shows.
    pub(in crate::report) fn new(width: f64, height: f64, title: &str, description: &str) -> Self {
        let mut svg = Self(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"plot chart\" viewBox=\"0 0 {width} {height}\" role=\"img\" \
             aria-label=\"{}\">\n<style>{STYLE}</style>\n<rect class=\"ground\" width=\"{width}\" height=\"{height}\"/>\n",
            escape(description)
        ));
        svg.text(16.0, 26.0, "title", title);
        svg
    }

    /// Adds text; `class` sets its look.
    pub(in crate::report) fn text(&mut self, x: f64, y: f64, class: &str, text: &str) {
        let _ = writeln!(self.0, "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\">{}</text>", escape(text));
    }

    /// Adds text that reads upwards.
    pub(in crate::report) fn upwards(&mut self, x: f64, y: f64, text: &str) {
        let text = escape(text);
        let _ = writeln!(self.0, "<text class=\"middle\" transform=\"translate({x:.1} {y:.1}) rotate(-90)\">{text}</text>");
    }

    /// Adds a straight line.
    pub(in crate::report) fn line(&mut self, class: &str, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2]) {
        let _ = writeln!(self.0, "<line class=\"{class}\" x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\"/>");
    }

    /// Adds the line of series `number` through points.
    pub(in crate::report) fn series(&mut self, number: usize, points: &[[f64; 2]]) {
        let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let dash = DASHES[number / HUES.len() % DASHES.len()];
        let _ = writeln!(
            self.0,
            "<polyline class=\"series\" stroke=\"{}\" stroke-dasharray=\"{dash}\" points=\"{}\"/>",
            hue(number),
            points.join(" ")
        );
    }

    /// Adds an area in the colour of series `number`, through which the ground shows.
    pub(in crate::report) fn area(&mut self, number: usize, points: &[[f64; 2]]) {
        let points: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
        let _ = writeln!(self.0, "<polygon fill=\"{}\" fill-opacity=\"0.16\" points=\"{}\"/>", hue(number), points.join(" "));
    }

    /// Adds a circle in the colour of series `number`, not filled; dashed where `is_dashed`.
    pub(in crate::report) fn circle(&mut self, number: usize, [x, y]: [f64; 2], radius: f64, is_dashed: bool) {
        let dash = if is_dashed { DASHES[1] } else { DASHES[0] };
        let _ = writeln!(
            self.0,
            "<circle class=\"series\" stroke=\"{}\" stroke-dasharray=\"{dash}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.1}\"/>",
            hue(number)
        );
    }

    /// Adds a point of series `number`, with text that shows when the pointer is over it. Shapes differ from series to series,
    /// so that they can be told apart without colours.
    pub(in crate::report) fn point(&mut self, number: usize, [x, y]: [f64; 2], words: &str) {
        let (fill, words) = (hue(number), escape(words));
        let _ = match number % 4 {
            0 => write!(self.0, "<circle fill=\"{fill}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.6\">"),
            1 => write!(self.0, "<rect fill=\"{fill}\" x=\"{:.1}\" y=\"{:.1}\" width=\"6.6\" height=\"6.6\">", x - 3.3, y - 3.3),
            2 => write!(self.0, "<path fill=\"{fill}\" d=\"M{x:.1} {:.1}l4.4 7.6h-8.8z\">", y - 4.8),
            _ => write!(self.0, "<path fill=\"{fill}\" d=\"M{x:.1} {:.1}l4.8 4.8-4.8 4.8-4.8-4.8z\">", y - 4.8),
        };
        let end = ["circle", "rect", "path", "path"][number % 4];
        let _ = writeln!(self.0, "<title>{words}</title></{end}>");
    }

    /// Adds a bar of a fixed colour.
    pub(in crate::report) fn bar(&mut self, fill: &str, [x, y]: [f64; 2], [width, height]: [f64; 2]) {
        let _ = writeln!(self.0, "<rect fill=\"{fill}\" x=\"{x:.2}\" y=\"{y:.1}\" width=\"{width:.2}\" height=\"{height:.1}\"/>");
    }

    /// Adds a bar for the remainder.
    pub(in crate::report) fn rest(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2]) {
        let _ = writeln!(self.0, "<rect class=\"rest\" x=\"{x:.2}\" y=\"{y:.1}\" width=\"{width:.2}\" height=\"{height:.1}\"/>");
    }

    /// The finished drawing.
    pub(in crate::report) fn finish(mut self) -> String {
        self.0.push_str("</svg>\n");
        self.0
    }
}

fn hue(number: usize) -> &'static str {
    HUES[number % HUES.len()]
}
