//! Tables as RFC 4180 text. Text cells are quoted where they must be, and kept from being read as a formula by
//! spreadsheets (OWASP, *CSV Injection*): one that begins with `= + - @`, tab or carriage return gets an apostrophe.

use std::fmt::{Display, Write};

#[cfg(test)]
mod tests;

/// A table under construction.
pub(crate) struct Csv {
    text: String,
    row_is_empty: bool,
}

impl Csv {
    /// A table with a header row; the names are ours and need no quoting.
    pub(crate) fn new(header: &[&str]) -> Self {
        let mut csv = Self { text: String::new(), row_is_empty: true };
        for name in header {
            csv.number(name);
        }
        csv.end_row();
        csv
    }

    /// A cell of text that somebody else may have written.
    pub(crate) fn text(&mut self, cell: &str) {
        self.separate();
        let guard = if cell.starts_with(['=', '+', '-', '@', '\t', '\r']) { "'" } else { "" };
        if cell.contains(['"', ',', '\r', '\n']) {
            self.text.push('"');
            self.text.push_str(guard);
            self.text.push_str(&cell.replace('"', "\"\""));
            self.text.push('"');
        } else {
            self.text.push_str(guard);
            self.text.push_str(cell);
        }
    }

    /// A number, or a name from a closed list of ours.
    pub(crate) fn number(&mut self, cell: impl Display) {
        self.separate();
        // Writing to a String cannot fail.
        let _ = write!(self.text, "{cell}");
    }

    /// A number or name of ours, or an empty cell.
    pub(crate) fn optional(&mut self, cell: Option<impl Display>) {
        match cell {
            Some(cell) => self.number(cell),
            None => self.separate(),
        }
    }

    /// Ends the row.
    pub(crate) fn end_row(&mut self) {
        self.text.push_str("\r\n");
        self.row_is_empty = true;
    }

    /// The table.
    pub(crate) fn finish(self) -> String {
        self.text
    }

    fn separate(&mut self) {
        if !self.row_is_empty {
            self.text.push(',');
        }
        self.row_is_empty = false;
    }
}
