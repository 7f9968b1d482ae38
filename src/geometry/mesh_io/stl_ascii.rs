//! ASCII STL: `solid … facet normal … outer loop … vertex …`, several solids per file, keywords in any case. Names may be in
//! any encoding and are skipped; so are normals, since exporters write nonsense for thin triangles.
//!
//! Pieces begin where a line does with `facet`. A word there is either the begin of a facet or wrong, and which it is only what
//! went before can tell: whether a solid is open, and whether the facet before is whole.

use super::error::{MeshError, Position};
use super::facets::Facets;
use super::pieces::{Pieces, next_line_with, parse_round};
use super::soup::Soup;
use super::text::{Lines, Tokens, coordinates, excerpt};
use crate::geometry::poll::Poll;

/// Bytes of a facet in common files.
const FACET_BYTES: usize = 200;

/// A piece that was parsed, up to its end or its first fault.
struct Parsed {
    facets: Facets,
    end: Result<Place, MeshError>,
}

/// A place between two facets.
#[derive(Clone, Copy)]
struct Place {
    /// Lines before it.
    lines: u64,
    in_solid: bool,
}

/// Reads every facet of every solid.
pub(super) fn read(text: &[u8], soup: &mut Soup<'_>) -> Result<(), MeshError> {
    let (poll, unit_mm) = (soup.poll, soup.settings.unit_mm());
    let mut pieces =
        Pieces::new(text, soup.settings.piece_bytes, |text, from, poll| next_line_with(b"facet", text, from, poll), poll);
    let mut place = Place { lines: 0, in_solid: false };
    loop {
        let round = pieces.next_round();
        if round.is_empty() {
            break;
        }
        let supposed = |begin: usize| Place { lines: 0, in_solid: begin > 0 };
        let parsed = parse_round(&round, |piece, poll| parse(&text[piece.clone()], supposed(piece.start), unit_mm, poll), poll)?;
        for (piece, parsed) in round.into_iter().zip(parsed) {
            let fits = supposed(piece.start).in_solid == place.in_solid;
            match parsed.end {
                Ok(end) if fits && soup.has_room_for(parsed.facets.count()) => {
                    parsed.facets.into_soup(soup)?;
                    place = Place { lines: place.lines + end.lines, in_solid: end.in_solid };
                }
                // From here on the piece tells what is wrong, or its end the text behind it.
                end => {
                    let text = if end.is_ok() && fits { &text[piece] } else { &text[piece.start..] };
                    let parsed = parse(text, place, unit_mm, poll);
                    parsed.facets.into_soup(soup)?;
                    return parsed.end.and_then(finish);
                }
            }
        }
    }
    finish(place)
}

/// Refuses a solid without an end.
fn finish(place: Place) -> Result<(), MeshError> {
    let at = Position::Line(place.lines.max(1));
    if place.in_solid { Err(MeshError::Truncated { at, expected: "\"endsolid\"" }) } else { Ok(()) }
}

/// Parses text that begins at `place`.
fn parse(text: &[u8], place: Place, unit_mm: f64, poll: &Poll<'_>) -> Parsed {
    let mut facets = Facets::new(unit_mm, (text.len() / FACET_BYTES).min(10_000));
    let lines = Lines::new(text, place.lines + 1, poll);
    let mut words = Words { at: lines.at(), lines, tokens: Tokens::of(&[], poll) };
    let in_solid = parse_facets(&mut words, place.in_solid, &mut facets, poll);
    let lines = words.lines.number() - place.lines;
    Parsed { facets, end: in_solid.map(|in_solid| Place { lines, in_solid }) }
}

/// Parses facets and the lines between them; whether a solid is open at the end.
fn parse_facets(words: &mut Words<'_>, mut in_solid: bool, facets: &mut Facets, poll: &Poll<'_>) -> Result<bool, MeshError> {
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
            w if w.eq_ignore_ascii_case(b"facet") && in_solid => facet(words, facets, poll)?,
            other => return Err(words.unexpected("\"facet\", \"endsolid\" or \"solid\"", other)),
        }
    }
    Ok(in_solid)
}

/// Reads the rest of a facet, after its keyword.
fn facet(words: &mut Words<'_>, facets: &mut Facets, poll: &Poll<'_>) -> Result<(), MeshError> {
    let at = words.at;
    words.skip_line();
    words.expect(b"outer", "\"outer loop\"")?;
    words.expect(b"loop", "\"outer loop\"")?;
    let mut corners = [0; 3];
    for corner in &mut corners {
        words.expect(b"vertex", "\"vertex\" (a facet has three)")?;
        let at = words.at;
        let xyz = coordinates(&mut words.tokens, at)?;
        *corner = facets.corner(xyz, at, poll)?;
    }
    words.expect(b"endloop", "\"endloop\" (a facet has three vertices)")?;
    words.expect(b"endfacet", "\"endfacet\"")?;
    facets.triangle(corners, at);
    Ok(())
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
        self.tokens.skip_all();
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
