//! Results of a run, printed as they come and kept as Markdown.

use std::fmt::Display;

/// Digits that mean something in a time measured on a shared machine.
const SIGNIFICANT: i32 = 3;

/// The text so far.
#[derive(Default)]
pub(crate) struct Report {
    figures: Vec<Figure>,
    sections: String,
}

/// A demand on the engine, and how it is met.
struct Figure {
    what: String,
    demand: Demand,
    measured: f64,
}

/// Demand on a figure.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Demand {
    /// Side of the bounds that is good.
    pub(crate) good: Good,
    /// Bound that has to be met.
    pub(crate) least: f64,
    /// Bound that is aimed at, where that is more.
    pub(crate) aim: Option<f64>,
    /// Text after the numbers.
    pub(crate) unit: &'static str,
}

/// Side of a bound that is good.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Good {
    /// A speed.
    Above,
    /// A time, an error.
    Below,
}

impl Demand {
    /// Demands `least` or more, and `aim` if it can be.
    pub(crate) fn above(least: f64, aim: f64, unit: &'static str) -> Self {
        Self { good: Good::Above, least, aim: Some(aim), unit }
    }

    /// Demands `least` or less, and `aim` if it can be.
    pub(crate) fn below(least: f64, aim: f64, unit: &'static str) -> Self {
        Self { good: Good::Below, least, aim: Some(aim), unit }
    }

    fn verdict(&self, measured: f64) -> &'static str {
        let reaches = |bound: f64| match self.good {
            Good::Above => measured >= bound,
            Good::Below => measured <= bound,
        };
        match (reaches(self.least), self.aim.is_some_and(reaches)) {
            (_, true) => "aim reached",
            (true, false) => "met",
            (false, false) => "missed",
        }
    }
}

impl Report {
    /// Begins a section.
    pub(crate) fn section(&mut self, title: impl Display) {
        self.push(&format!("\n## {title}\n"));
    }

    /// Says something.
    pub(crate) fn say(&mut self, text: impl Display) {
        self.push(&format!("\n{text}\n"));
    }

    /// A table; every row has as many cells as `header`.
    pub(crate) fn table(&mut self, header: &[&str], rows: &[Vec<String>]) {
        let mut text = String::from("\n");
        let line = |cells: &[&str]| format!("| {} |\n", cells.join(" | "));
        text += &line(header);
        text += &line(&header.iter().enumerate().map(|(i, _)| if i == 0 { "---" } else { "--:" }).collect::<Vec<_>>());
        for row in rows {
            text += &line(&row.iter().map(String::as_str).collect::<Vec<_>>());
        }
        self.push(&text);
    }

    /// Adds to the table of demands, which stands first.
    pub(crate) fn figure(&mut self, what: impl Into<String>, demand: Demand, measured: f64) {
        self.figures.push(Figure { what: what.into(), demand, measured });
    }

    /// The table of demands.
    pub(crate) fn figures(&self) -> String {
        if self.figures.is_empty() {
            return String::new();
        }
        let mut text = String::from("\n| figure | required | aim | measured | |\n| --- | --: | --: | --: | --- |\n");
        for Figure { what, demand, measured } in &self.figures {
            let amount = |value: f64| format!("{}{}", number(value), demand.unit);
            let (least, aim) = (amount(demand.least), demand.aim.map_or_else(String::new, amount));
            text += &format!("| {what} | {least} | {aim} | {} | {} |\n", amount(*measured), demand.verdict(*measured));
        }
        text
    }

    /// The whole, the demands first.
    pub(crate) fn markdown(&self, heading: &str) -> String {
        format!("{heading}{}{}", self.figures(), self.sections)
    }

    fn push(&mut self, text: &str) {
        print!("{text}");
        self.sections += text;
    }
}

/// A value to three significant digits, whole from a thousand up.
pub(crate) fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let decimals = (SIGNIFICANT - 1 - value.abs().log10().floor() as i32).clamp(0, 6);
    format!("{value:.*}", decimals as usize)
}

/// Seconds as milliseconds.
pub(crate) fn ms(seconds: f64) -> String {
    number(seconds * 1e3)
}
