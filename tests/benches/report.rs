//! What a run found, printed as it comes and kept as Markdown.

use std::fmt::{Display, Write as _};

/// Digits that mean something in a time measured on a shared machine.
const SIGNIFICANT: i32 = 3;

/// The text so far.
#[derive(Default)]
pub(crate) struct Report {
    figures: Vec<Figure>,
    sections: String,
}

/// A demand on the engine, and how it is met.
pub(crate) struct Figure {
    /// What is measured.
    pub(crate) what: String,
    /// What is demanded at least, and what is aimed at.
    pub(crate) least: f64,
    /// What is aimed at, if more.
    pub(crate) aim: Option<f64>,
    /// What came out.
    pub(crate) measured: f64,
    /// Which side of `least` is good.
    pub(crate) good: Good,
    /// What stands behind the numbers.
    pub(crate) unit: &'static str,
}

/// Which side of a bound is good.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Good {
    /// A speed.
    Above,
    /// A time, an error.
    Below,
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

    /// Adds a demand to the table that stands first.
    pub(crate) fn figure(&mut self, figure: Figure) {
        self.figures.push(figure);
    }

    /// The whole, the demands first.
    pub(crate) fn markdown(self, heading: &str) -> String {
        let mut text = heading.to_owned();
        if !self.figures.is_empty() {
            text += "\n| figure | at least | aim | measured | |\n| --- | --: | --: | --: | --- |\n";
        }
        for figure in &self.figures {
            let amount = |value: f64| format!("{}{}", number(value), figure.unit);
            let aim = figure.aim.map_or_else(String::new, amount);
            let (least, measured) = (amount(figure.least), amount(figure.measured));
            // Writing to a string cannot fail.
            let _ = writeln!(text, "| {} | {least} | {aim} | {measured} | {} |", figure.what, figure.verdict());
        }
        text + &self.sections
    }

    fn push(&mut self, text: &str) {
        print!("{text}");
        self.sections += text;
    }
}

impl Figure {
    fn verdict(&self) -> &'static str {
        let reaches = |bound: f64| match self.good {
            Good::Above => self.measured >= bound,
            Good::Below => self.measured <= bound,
        };
        match (reaches(self.least), self.aim.is_some_and(reaches)) {
            (_, true) => "aim reached",
            (true, false) => "met",
            (false, false) => "missed",
        }
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
