//! Wavefront OBJ: `v`, `f`, `g`, `o`; everything else of the format is about looks, curves or points and is passed over.
//! Two passes over the text: vertices first, because a face may refer to a vertex that comes later.

use std::borrow::Cow;
use std::collections::HashMap;

use super::Limits;
use super::error::{MeshError, Position};
use super::soup::Soup;
use super::text::{Lines, Tokens, coordinates, excerpt};
use crate::geometry::FaceGroup;

/// Reads vertices and faces into `soup`; returns the named groups that have faces.
pub(super) fn read(text: &[u8], soup: &mut Soup<'_>, limits: &Limits) -> Result<Vec<FaceGroup>, MeshError> {
    let vertices = vertices(text, soup)?;
    let mut groups = Groups::new(limits);
    let mut corners = Vec::new();
    let mut vertices_so_far = 0;
    for (at, line) in logical_lines(text) {
        let mut words = words(&line);
        match words.next() {
            Some(b"v") => vertices_so_far += 1,
            Some(b"f") => {
                corners.clear();
                for word in words {
                    corners.push(vertices[vertex_index(word, vertices_so_far, vertices.len(), at)?]);
                }
                if corners.len() < 3 {
                    let found = format!("{} of them", corners.len());
                    return Err(MeshError::Syntax { at, expected: "at least three corners of a face", found });
                }
                groups.add(soup.next_face(), at)?;
                soup.face(&corners, at)?;
            }
            Some(b"g") => groups.set_groups(words),
            Some(b"o") => groups.set_object(words.rest()),
            _ => {}
        }
    }
    Ok(groups.into_face_groups())
}

/// Number in the soup of each vertex of the file. A fourth coordinate (weight) or colours may follow the three.
fn vertices(text: &[u8], soup: &mut Soup<'_>) -> Result<Vec<u32>, MeshError> {
    let mut vertices = Vec::new();
    for (at, line) in logical_lines(text) {
        let mut words = words(&line);
        match words.next() {
            Some(b"v") => vertices.push(soup.vertex(coordinates(&mut words, at)?, at)?),
            Some(word) if !word[0].is_ascii_alphabetic() => {
                return Err(MeshError::Syntax { at, expected: "a keyword of OBJ", found: excerpt(word) });
            }
            _ => {}
        }
    }
    Ok(vertices)
}

/// Position in the file's list of vertices that the corner `v`, `v/vt`, `v//vn` or `v/vt/vn` refers to.
fn vertex_index(word: &[u8], so_far: usize, in_file: usize, at: Position) -> Result<usize, MeshError> {
    let digits = word.split(|&b| b == b'/').next().unwrap_or_default();
    let parsed = std::str::from_utf8(digits).ok().and_then(|text| text.parse::<i64>().ok());
    let index = parsed.ok_or_else(|| MeshError::Syntax { at, expected: "a corner (vertex number)", found: excerpt(word) })?;
    let (from_zero, vertices) = if index < 0 { (so_far as i64 + index, so_far) } else { (index - 1, in_file) };
    let hint = if index < 0 { " before it (negative numbers count back)" } else { " (counted from 1)" };
    usize::try_from(from_zero).ok().filter(|&i| i < vertices).ok_or(MeshError::BadIndex { at, index, vertices, hint })
}

/// Lines with their continuations (`\` at the end) joined, at the place of their first line.
fn logical_lines(text: &[u8]) -> impl Iterator<Item = (Position, Cow<'_, [u8]>)> {
    let mut lines = Lines::new(text, 1);
    std::iter::from_fn(move || {
        let first = lines.next()?;
        let mut whole = Cow::Borrowed(first.text);
        while let Some(stem) = whole.strip_suffix(b"\\") {
            let mut joined = stem.to_vec();
            joined.push(b' ');
            joined.extend_from_slice(lines.next().map_or(&[], |line| line.text));
            whole = Cow::Owned(joined);
        }
        Some((first.at(), whole))
    })
}

/// The words of a line before its comment.
fn words(line: &[u8]) -> Tokens<'_> {
    Tokens::of(line.split(|&b| b == b'#').next().unwrap_or_default())
}

/// Which named groups are current, and which faces each has got.
struct Groups<'a> {
    limits: &'a Limits,
    numbers: HashMap<Vec<u8>, usize>,
    found: Vec<FaceGroup>,
    object: Option<usize>,
    groups: Vec<usize>,
    memberships: usize,
}

impl<'a> Groups<'a> {
    fn new(limits: &'a Limits) -> Self {
        Self { limits, numbers: HashMap::new(), found: Vec::new(), object: None, groups: Vec::new(), memberships: 0 }
    }

    fn number(&mut self, name: &[u8]) -> usize {
        let next = self.found.len();
        let number = *self.numbers.entry(name.to_vec()).or_insert(next);
        if number == next {
            self.found.push(FaceGroup { name: String::from_utf8_lossy(name).into_owned(), source_faces: Vec::new() });
        }
        number
    }

    fn set_object(&mut self, name: &[u8]) {
        self.object = (!name.is_empty()).then(|| self.number(name));
    }

    fn set_groups(&mut self, names: Tokens<'_>) {
        self.groups = names.map(|name| self.number(name)).collect();
        self.groups.sort_unstable();
        self.groups.dedup();
    }

    /// Faces may be in many groups at once; the sum of all is limited, else a small file could ask for much memory.
    fn add(&mut self, face: u32, at: Position) -> Result<(), MeshError> {
        let object = self.object.filter(|number| !self.groups.contains(number));
        self.memberships += self.groups.len() + usize::from(object.is_some());
        let limit = self.limits.max_triangles.saturating_mul(2);
        if self.memberships > limit {
            return Err(MeshError::TooLarge { at, what: "memberships of faces in groups", limit });
        }
        for &number in self.groups.iter().chain(&object) {
            self.found[number].source_faces.push(face);
        }
        Ok(())
    }

    fn into_face_groups(self) -> Vec<FaceGroup> {
        self.found.into_iter().filter(|group| !group.source_faces.is_empty()).collect()
    }
}
