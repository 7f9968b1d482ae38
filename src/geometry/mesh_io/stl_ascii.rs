//! ASCII STL: `solid … facet normal … outer loop … vertex …`, several solids per file, keywords in any case. Names may be in
//! any encoding and are skipped; so are normals, since exporters write nonsense for thin triangles.

use super::error::{MeshError, Position};
use super::soup::Soup;
use super::text::{Lines, Tokens, coordinates, excerpt};

/// Reads every facet of every solid.
pub(super) fn read(text: &[u8], soup: &mut Soup<'_>) -> Result<(), MeshError> {
    let poll = soup.poll;
    let mut words = Words { lines: Lines::new(text, 1, poll), tokens: Tokens::of(&[], poll), at: Position::Line(1) };
    let mut in_solid = false;
    while let Some(word) = words.next() {
        match word {
            w if w.eq_ignore_ascii_case(b"solid") => {
                in_solid = true;
                words.skip_line();
            }
            w if w.eq_ignore_ascii_case(b"endsolid") => {
                in_solid = false;
                words.skip_line();
            }
            w if w.eq_ignore_ascii_case(b"facet") && in_solid => facet(&mut words, soup)?,
            other => return Err(words.unexpected("\"facet\", \"endsolid\" or \"solid\"", other)),
        }
    }
    if in_solid { Err(MeshError::Truncated { at: words.at, expected: "\"endsolid\"" }) } else { Ok(()) }
}

/// Reads the rest of a facet, after its keyword.
fn facet(words: &mut Words<'_>, soup: &mut Soup<'_>) -> Result<(), MeshError> {
    let at = words.at;
    words.skip_line();
    words.expect(b"outer", "\"outer loop\"")?;
    words.expect(b"loop", "\"outer loop\"")?;
    let mut corners = [0; 3];
    for corner in &mut corners {
        words.expect(b"vertex", "\"vertex\" (a facet has three)")?;
        let at = words.at;
        let xyz = coordinates(&mut words.tokens, at)?;
        *corner = soup.welded_vertex(xyz, at)?;
    }
    words.expect(b"endloop", "\"endloop\" (a facet has three vertices)")?;
    words.expect(b"endfacet", "\"endfacet\"")?;
    soup.face(&corners, at)
}

/// Words of the file, regardless of line breaks.
struct Words<'a> {
    lines: Lines<'a>,
    tokens: Tokens<'a>,
    at: Position,
}

impl<'a> Words<'a> {
    fn next(&mut self) -> Option<&'a [u8]> {
        loop {
            if let Some(token) = self.tokens.next() {
                return Some(token);
            }
            let line = self.lines.next()?;
            self.at = line.at();
            self.tokens = line.tokens();
        }
    }

    fn skip_line(&mut self) {
        self.tokens.by_ref().for_each(drop);
    }

    fn expect(&mut self, keyword: &[u8], expected: &'static str) -> Result<(), MeshError> {
        match self.next() {
            Some(word) if word.eq_ignore_ascii_case(keyword) => Ok(()),
            Some(other) => Err(self.unexpected(expected, other)),
            None => Err(MeshError::Truncated { at: self.at, expected }),
        }
    }

    fn unexpected(&self, expected: &'static str, found: &[u8]) -> MeshError {
        MeshError::Syntax { at: self.at, expected, found: excerpt(found) }
    }
}
