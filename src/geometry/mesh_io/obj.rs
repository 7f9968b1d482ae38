//! Wavefront OBJ: `v`, `f`, `g`, `o`; all other statements concern looks, curves or points and are skipped. Two passes over the
//! text: vertices first, because a face may refer to a vertex that comes later. The second pass finds the pieces of the first,
//! and what went before each of them is then known.

use super::Settings;
use super::error::{MeshError, Position};
use super::obj_groups::Groups;
use super::pieces::{Pieces, next_logical_line, parse_round};
use super::soup::{FacetSink, Soup, SoupPiece};
use super::text::{Lines, Tokens, coordinates, excerpt, parse_token};
use crate::geometry::FaceGroup;
use crate::geometry::poll::Poll;

/// Counts of everything before a piece of the file.
#[derive(Clone, Copy, Default)]
struct Before {
    lines: u64,
    vertices: usize,
}

/// Reads vertices and faces into `soup`; returns the named groups that have faces.
pub(super) fn read(text: &[u8], soup: &mut Soup<'_>) -> Result<Vec<FaceGroup>, MeshError> {
    let before = read_vertices(text, soup)?;
    read_faces(text, &before, soup)
}

fn cut<'a>(text: &'a [u8], settings: &Settings<'_>, poll: &'a Poll<'a>) -> Pieces<'a> {
    Pieces::new(text, settings.piece_bytes, next_logical_line, poll)
}

/// Adds every vertex of the file to `soup`, in order; returns what goes before each piece.
fn read_vertices(text: &[u8], soup: &mut Soup<'_>) -> Result<Vec<Before>, MeshError> {
    let (poll, unit_mm) = (soup.poll, soup.settings.unit_mm());
    let mut pieces = cut(text, &soup.settings, poll);
    let (mut place, mut before) = (Before::default(), Vec::new());
    loop {
        let round = pieces.next_round();
        if round.is_empty() {
            return Ok(before);
        }
        let parse = |piece: &std::ops::Range<usize>, poll: &Poll<'_>| {
            let mut part = SoupPiece::new(unit_mm);
            let lines = parse_vertices(&text[piece.clone()], 0, &mut part, poll);
            (part, lines)
        };
        for (piece, (part, lines)) in round.iter().zip(parse_round(&round, parse, poll)?) {
            before.push(place);
            let lines = match lines {
                Ok(lines) if soup.has_room(&part) => {
                    soup.take(part);
                    lines
                }
                // Again, to tell where in the file the fault is.
                _ => parse_vertices(&text[piece.clone()], place.lines, soup, poll)?,
            };
            place = Before { lines: place.lines + lines, vertices: soup.vertices() };
        }
    }
}

/// Adds every vertex to `sink`; returns the number of lines. A fourth coordinate (weight) or colours after the three are ignored.
fn parse_vertices(text: &[u8], lines_before: u64, sink: &mut dyn FacetSink, poll: &Poll<'_>) -> Result<u64, MeshError> {
    let mut lines = LogicalLines::new(text, lines_before, poll);
    while let Some((at, line)) = lines.next() {
        let mut words = words(line, poll);
        match words.next() {
            Some(b"v") => sink.vertex(coordinates(&mut words, at)?, at)?,
            Some(word) if !word[0].is_ascii_alphabetic() => {
                return Err(MeshError::Syntax { at, expected: "an OBJ keyword", found: excerpt(word) });
            }
            _ => {}
        }
    }
    Ok(lines.lines.number() - lines_before)
}

/// Faces of a piece and changes of the groups among them, up to its end or its first fault.
#[derive(Default)]
struct Faces {
    /// Corners of all faces, one after the other.
    corners: Vec<u32>,
    /// End of each face's corners, with its place.
    ends: Vec<(usize, Position)>,
    changes: Vec<Change>,
}

/// A change of the current groups.
struct Change {
    /// Number of faces of the piece that come before it.
    after_faces: usize,
    at: Position,
    is_object: bool,
    names: Box<[u8]>,
}

/// Reads every face of the file; returns the named groups that have faces.
fn read_faces(text: &[u8], before: &[Before], soup: &mut Soup<'_>) -> Result<Vec<FaceGroup>, MeshError> {
    let (poll, in_file) = (soup.poll, soup.vertices());
    let mut groups = Groups::new(soup.settings.limits, poll);
    let mut pieces = cut(text, &soup.settings, poll);
    let mut before = before.iter();
    loop {
        let round: Vec<_> = pieces.next_round().into_iter().zip(before.by_ref().copied()).collect();
        if round.is_empty() {
            return groups.into_face_groups();
        }
        let parse = |(piece, before): &(std::ops::Range<usize>, Before), poll: &Poll<'_>| {
            let mut faces = Faces::default();
            let end = faces.parse(&text[piece.clone()], before, in_file, poll);
            (faces, end)
        };
        for (faces, end) in parse_round(&round, parse, poll)? {
            faces.add_to(soup, &mut groups)?;
            end?;
        }
    }
}

impl Faces {
    fn parse(&mut self, text: &[u8], before: &Before, in_file: usize, poll: &Poll<'_>) -> Result<(), MeshError> {
        let mut vertices_so_far = before.vertices;
        let mut lines = LogicalLines::new(text, before.lines, poll);
        while let Some((at, line)) = lines.next() {
            let mut words = words(line, poll);
            match words.next() {
                Some(b"v") => vertices_so_far += 1,
                Some(b"f") => self.push_face(words, vertices_so_far, in_file, at)?,
                Some(word @ (b"g" | b"o")) => {
                    let (after_faces, is_object) = (self.ends.len(), word == b"o");
                    self.changes.push(Change { after_faces, at, is_object, names: words.rest().into() });
                }
                _ => {}
            }
        }
        Ok(())
    }

    fn push_face(&mut self, words: Tokens<'_>, so_far: usize, in_file: usize, at: Position) -> Result<(), MeshError> {
        let begin = self.corners.len();
        for word in words {
            self.corners.push(vertex_index(word, so_far, in_file, at)? as u32);
        }
        let count = self.corners.len() - begin;
        if count < 3 {
            let found = count.to_string();
            return Err(MeshError::Syntax { at, expected: "at least three corners of a face", found });
        }
        self.ends.push((self.corners.len(), at));
        Ok(())
    }

    /// Adds the faces, and each to the groups that are current then.
    fn add_to(&self, soup: &mut Soup<'_>, groups: &mut Groups<'_>) -> Result<(), MeshError> {
        let mut changes = self.changes.iter().peekable();
        let mut begin = 0;
        for (face, (end, at)) in self.ends.iter().enumerate() {
            while let Some(change) = changes.next_if(|change| change.after_faces <= face) {
                change.apply_to(groups, soup.poll)?;
            }
            groups.add(soup.next_face(), *at)?;
            soup.face(&self.corners[begin..*end], *at)?;
            begin = *end;
        }
        changes.try_for_each(|change| change.apply_to(groups, soup.poll))
    }
}

impl Change {
    fn apply_to(&self, groups: &mut Groups<'_>, poll: &Poll<'_>) -> Result<(), MeshError> {
        if self.is_object {
            groups.set_object(&self.names, self.at)
        } else {
            groups.set_groups(Tokens::of(&self.names, poll), self.at)
        }
    }
}

/// Index, from 0, of the vertex that the corner `v`, `v/vt`, `v//vn` or `v/vt/vn` refers to.
fn vertex_index(word: &[u8], so_far: usize, in_file: usize, at: Position) -> Result<usize, MeshError> {
    let digits = word.split(|&b| b == b'/').next().unwrap_or_default();
    let index = parse_token::<i64>(digits).ok_or_else(|| MeshError::Syntax {
        at,
        expected: "a corner (vertex number)",
        found: excerpt(word),
    })?;
    let (from_zero, vertices) = if index < 0 { (so_far as i64 + index, so_far) } else { (index - 1, in_file) };
    let hint = if index < 0 { " before it (negative indices count backwards)" } else { " (counted from 1)" };
    usize::try_from(from_zero).ok().filter(|&i| i < vertices).ok_or(MeshError::BadIndex { at, index, vertices, hint })
}

/// Lines with their continuations (`\` at the end) joined, at the position of their first line. One buffer serves every
/// joined line.
struct LogicalLines<'a> {
    lines: Lines<'a>,
    joined: Vec<u8>,
}

impl<'a> LogicalLines<'a> {
    /// Lines of text that so many others go before.
    fn new(text: &'a [u8], lines_before: u64, poll: &'a Poll<'a>) -> Self {
        Self { lines: Lines::new(text, lines_before + 1, poll), joined: Vec::new() }
    }

    fn next(&mut self) -> Option<(Position, &[u8])> {
        let first = self.lines.next()?;
        let Some(mut stem) = continued(first.text) else { return Some((first.at(), first.text)) };
        self.joined.clear();
        loop {
            self.joined.extend_from_slice(stem);
            self.joined.push(b' ');
            let more = self.lines.next().map_or(&[][..], |line| line.text);
            match continued(more) {
                Some(next) => stem = next,
                None => {
                    self.joined.extend_from_slice(more);
                    return Some((first.at(), &self.joined));
                }
            }
        }
    }
}

/// Line without the `\` at its end that continues it; `None` where there is none. A comment, such as a path of a folder, ends with its
/// line.
fn continued(line: &[u8]) -> Option<&[u8]> {
    line.strip_suffix(b"\\").filter(|stem| !stem.contains(&b'#'))
}

/// Words of a line before its comment.
fn words<'l>(line: &'l [u8], poll: &'l Poll<'l>) -> Tokens<'l> {
    let end = poll.position(line, |&b| b == b'#').unwrap_or(line.len());
    Tokens::of(&line[..end], poll)
}
