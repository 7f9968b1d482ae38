//! The two plots: coverage against the number of views, one line per series; and the shares by grade at one number of views,
//! one bar per series.

use super::StudyInput;
use super::svg::Svg;
use crate::planning::plan::Grade;
use crate::planning::studies::{Series, Study, StudyStep};
use crate::rendering::Ink;
use crate::report::html::markup::{number, percent};
use crate::wire::words::counted;

/// Max labels along the axis of views.
const MAX_TICKS: usize = 15;
/// Min share of a bar for its figure to be written into it.
const MIN_LABELLED_SHARE: f64 = 0.055;
/// Grades with their names, and the class of text on their colours.
const GRADES: [(Grade, &str, &str); 4] =
    [(Grade::A, "A", "light"), (Grade::B, "B", "dark"), (Grade::C, "C", "dark"), (Grade::D, "D", "dark")];

/// Plots coverage of the asked area against the number of views.
#[must_use]
pub fn coverage_svg(input: &StudyInput<'_>) -> String {
    let series = &input.findings.series;
    let max_views = series.iter().map(|series| series.steps.len()).max().unwrap_or_default().max(1);
    let firsts = series.iter().filter_map(|series| series.steps.first());
    let min = firsts.map(|step| step.of_asked).fold(1.0, f64::min);
    let plot = Plot { max_views, low: (min * 10.0).floor() / 10.0, height: 430.0_f64.max(96.0 + 38.0 * series.len() as f64) };
    let spoken: Vec<String> =
        series.iter().map(|series| format!("{}: {}", series.label, percent(series.after(input.at).of_asked))).collect();
    let title = format!("{}: coverage against the number of views", heading(input));
    let description = format!("{title}. After {} {}", counted(input.at, "view"), spoken.join("; "));
    let mut svg = Svg::new(WIDTH, plot.height, &title, &description);
    plot.axes(&mut svg, input.at);
    for (number, series) in series.iter().enumerate() {
        plot.curve(&mut svg, number, series);
    }
    svg.text(LEGEND, TOP - 6.0, "", &format!("after {}, % of the asked area", counted(input.at, "view")));
    for (number, series) in series.iter().enumerate() {
        legend_entry(&mut svg, number, series, input.at);
    }
    svg.finish()
}

const WIDTH: f64 = 980.0;
const LEFT: f64 = 66.0;
const RIGHT: f64 = 640.0;
const LEGEND: f64 = 672.0;
const TOP: f64 = 64.0;
const BOTTOM: f64 = 56.0;

struct Plot {
    max_views: usize,
    /// Share at the foot of the vertical axis.
    low: f64,
    height: f64,
}

impl Plot {
    fn x(&self, views: usize) -> f64 {
        let span = (self.max_views - 1).max(1) as f64;
        LEFT + 12.0 + (RIGHT - LEFT - 24.0) * (views as f64 - 1.0) / span
    }

    fn y(&self, share: f64) -> f64 {
        TOP + (self.height - TOP - BOTTOM) * (1.0 - share) / (1.0 - self.low).max(0.1)
    }

    fn axes(&self, svg: &mut Svg, at: usize) {
        let foot = self.y(self.low);
        let step_percent = if self.low >= 0.6 { 5 } else { 10 };
        for share_percent in ((100.0 * self.low).round() as i32..=100).filter(|share| share % step_percent == 0) {
            let y = self.y(f64::from(share_percent) / 100.0);
            svg.line("grid", [LEFT, y], [RIGHT, y]);
            svg.text(LEFT - 8.0, y + 4.0, "end", &share_percent.to_string());
        }
        let every = self.max_views.div_ceil(MAX_TICKS);
        for views in (1..=self.max_views).filter(|views| every == 1 || views % every == 0) {
            let x = self.x(views);
            svg.line("grid", [x, foot], [x, foot + 5.0]);
            svg.text(x, foot + 20.0, "middle", &views.to_string());
        }
        if at <= self.max_views {
            svg.line("mark", [self.x(at), TOP], [self.x(at), foot]);
        }
        svg.text((LEFT + RIGHT) / 2.0, self.height - 12.0, "middle", "number of views");
        svg.upwards(20.0, (TOP + foot) / 2.0, "measured, % of the asked area");
    }

    fn curve(&self, svg: &mut Svg, number: usize, series: &Series) {
        let at = |(step, views): (&StudyStep, usize)| [self.x(views), self.y(step.of_asked)];
        let points: Vec<[f64; 2]> = series.steps.iter().zip(1..).map(at).collect();
        svg.series(number, &points);
        for ((point, step), views) in points.iter().zip(&series.steps).zip(1..) {
            svg.point(number, *point, &format!("{}: {}, {}", series.label, counted(views, "view"), percent(step.of_asked)));
        }
    }
}

fn legend_entry(svg: &mut Svg, number: usize, series: &Series, at: usize) {
    let y = TOP + 16.0 + 38.0 * number as f64;
    svg.series(number, &[[LEGEND, y], [LEGEND + 34.0, y]]);
    svg.point(number, [LEGEND + 17.0, y], &series.label);
    svg.text(LEGEND + 44.0, y + 4.0, "ink", &series.label);
    let said = match series.steps.len() {
        0 => "measures nothing".to_owned(),
        taken if taken < at => format!("{} with {taken}, its last", percent(series.after(at).of_asked)),
        _ => percent(series.after(at).of_asked),
    };
    svg.text(LEGEND + 44.0, y + 20.0, "", &said);
}

/// Plots the shares of the asked area by grade at `input.at` views.
#[must_use]
pub fn grades_svg(input: &StudyInput<'_>) -> String {
    const BAR: f64 = 24.0;
    const PITCH: f64 = 36.0;
    const LABELS: f64 = 232.0;
    let series = &input.findings.series;
    let (width, foot) = (WIDTH - LABELS - 40.0, 84.0 + PITCH * series.len() as f64);
    let title = format!("{}: grades after {}", heading(input), counted(input.at, "view"));
    let spoken: Vec<String> = series.iter().map(|series| spoken_grades(series, input.at)).collect();
    let mut svg = Svg::new(WIDTH, foot + 58.0, &title, &format!("{title}. {}", spoken.join("; ")));
    grade_legend(&mut svg, LABELS);
    for tenth in 0..=5 {
        let share = f64::from(tenth) / 5.0;
        let x = LABELS + width * share;
        svg.line("grid", [x, 76.0], [x, foot]);
        svg.text(x, foot + 20.0, "middle", &number(100.0 * share, 0));
    }
    for (number, series) in series.iter().enumerate() {
        let (y, step) = (84.0 + PITCH * number as f64, series.after(input.at));
        svg.text(LABELS - 12.0, y + 17.0, "ink end", &series.label);
        svg.rest([LABELS, y], [width, BAR]);
        grade_bars(&mut svg, &step, [LABELS, y], [width, BAR]);
    }
    svg.text(LABELS + width / 2.0, foot + 44.0, "middle", "share of the asked area, %");
    svg.finish()
}

fn grade_bars(svg: &mut Svg, step: &StudyStep, [left, y]: [f64; 2], [width, height]: [f64; 2]) {
    let mut x = left;
    for ((grade, _, class), share) in GRADES.into_iter().zip(step.grades) {
        svg.bar(&Ink::Measured(grade).hex(), [x, y], [width * share, height]);
        if share >= MIN_LABELLED_SHARE {
            svg.text(x + width * share / 2.0, y + 17.0, &format!("{class} middle"), &number(100.0 * share, 1));
        }
        x += width * share;
    }
}

fn grade_legend(svg: &mut Svg, left: f64) {
    let mut x = left;
    for (grade, name, _) in GRADES {
        svg.bar(&Ink::Measured(grade).hex(), [x, 46.0], [14.0, 14.0]);
        svg.text(x + 20.0, 58.0, "", &format!("grade {name}"));
        x += 96.0;
    }
    svg.rest([x, 46.0], [14.0, 14.0]);
    svg.text(x + 20.0, 58.0, "", "not measured");
}

fn spoken_grades(series: &Series, at: usize) -> String {
    let grades = GRADES.iter().zip(series.after(at).grades).map(|((_, name, _), share)| format!("{name} {}", percent(share)));
    format!("{}: {}", series.label, grades.collect::<Vec<_>>().join(", "))
}

fn heading(input: &StudyInput<'_>) -> String {
    let varied = match input.findings.study {
        Study::Weights => "weights of coverage (a) and quality (b)",
        Study::Limits => "limits of incidence, cameras / projector",
        Study::Candidates => "candidate strategies",
    };
    format!("{}, {varied}", input.part_name)
}
