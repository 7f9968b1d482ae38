//! Tables as CSV (RFC 4180). Text cells are quoted where necessary, and cannot be read as formulas by spreadsheets (OWASP,
//! *CSV Injection*): a cell that begins with `= + - @`, tab or carriage return gets an apostrophe.

use std::fmt::{Display, Write};

#[cfg(test)]
mod tests;

/// A table under construction.
pub(crate) struct Csv {
    text: String,
    row_is_empty: bool,
}

impl Csv {
    /// Starts a table with a header row; the names are constants and need no quoting.
    pub(crate) fn new(header: &[&str]) -> Self {
        let mut csv = Self::rows();
        for name in header {
            csv.number(name);
        }
        csv.end_row();
        csv
    }

    /// Starts rows of a table that are added to it later.
    pub(crate) fn rows() -> Self {
        Self { text: String::new(), row_is_empty: true }
    }

    /// Adds finished rows, one piece after the other.
    pub(crate) fn add_all_rows(&mut self, pieces: Vec<String>) {
        self.text.reserve_exact(pieces.iter().map(String::len).sum());
        pieces.into_iter().for_each(|rows| self.text.push_str(&rows));
    }

    /// Adds a cell of text that may come from a user.
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

    /// Adds a number, or a name from a closed list.
    pub(crate) fn number(&mut self, cell: impl Display) {
        self.separate();
        // Writing to a String cannot fail.
        let _ = write!(self.text, "{cell}");
    }

    /// Adds a number or name, or an empty cell.
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

    /// The finished table.
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
