//! Wavefront OBJ: `v`, `f`, `g`, `o`; all other statements concern looks, curves or points and are skipped. Two passes over the
//! text: vertices first, because a face may refer to a vertex that comes later.

use super::Limits;
use super::error::{MeshError, Position};
use super::obj_groups::Groups;
use super::soup::Soup;
use super::text::{Lines, Tokens, coordinates, excerpt, parse_token};
use crate::geometry::FaceGroup;
use crate::geometry::poll::Poll;

/// Reads vertices and faces into `soup`; returns the named groups that have faces.
pub(super) fn read(text: &[u8], soup: &mut Soup<'_>, limits: &Limits) -> Result<Vec<FaceGroup>, MeshError> {
    let poll = soup.poll;
    read_vertices(text, soup)?;
    let vertices = soup.vertices();
    let mut groups = Groups::new(limits, poll);
    let mut corners = Vec::new();
    let mut vertices_so_far = 0;
    let mut lines = LogicalLines::new(text, poll);
    while let Some((at, line)) = lines.next() {
        let mut words = words(line, poll);
        match words.next() {
            Some(b"v") => vertices_so_far += 1,
            Some(b"f") => {
                corners.clear();
                for word in words {
                    corners.push(vertex_index(word, vertices_so_far, vertices, at)? as u32);
                }
                if corners.len() < 3 {
                    let found = corners.len().to_string();
                    return Err(MeshError::Syntax { at, expected: "at least three corners of a face", found });
                }
                groups.add(soup.next_face(), at)?;
                soup.face(&corners, at)?;
            }
            Some(b"g") => groups.set_groups(words, at)?,
            Some(b"o") => groups.set_object(words.rest(), at)?,
            _ => {}
        }
    }
    groups.into_face_groups()
}

/// Adds every vertex of the file to `soup`, in order. A fourth coordinate (weight) or colours after the three are ignored.
fn read_vertices(text: &[u8], soup: &mut Soup<'_>) -> Result<(), MeshError> {
    let poll = soup.poll;
    let mut lines = LogicalLines::new(text, poll);
    while let Some((at, line)) = lines.next() {
        let mut words = words(line, poll);
        match words.next() {
            Some(b"v") => drop(soup.vertex(coordinates(&mut words, at)?, at)?),
            Some(word) if !word[0].is_ascii_alphabetic() => {
                return Err(MeshError::Syntax { at, expected: "an OBJ keyword", found: excerpt(word) });
            }
            _ => {}
        }
    }
    Ok(())
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
    fn new(text: &'a [u8], poll: &'a Poll<'a>) -> Self {
        Self { lines: Lines::new(text, 1, poll), joined: Vec::new() }
    }

    fn next(&mut self) -> Option<(Position, &[u8])> {
        let first = self.lines.next()?;
        let Some(mut stem) = first.text.strip_suffix(b"\\") else { return Some((first.at(), first.text)) };
        self.joined.clear();
        loop {
            self.joined.extend_from_slice(stem);
            self.joined.push(b' ');
            let more = self.lines.next().map_or(&[][..], |line| line.text);
            match more.strip_suffix(b"\\") {
                Some(continued) => stem = continued,
                None => {
                    self.joined.extend_from_slice(more);
                    return Some((first.at(), &self.joined));
                }
            }
        }
    }
}

/// Words of a line before its comment.
fn words<'l>(line: &'l [u8], poll: &'l Poll<'l>) -> Tokens<'l> {
    let end = poll.position(line, |&b| b == b'#').unwrap_or(line.len());
    Tokens::of(&line[..end], poll)
}
