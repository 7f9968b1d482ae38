//! PLY 1.0 (Turk, "The PLY Polygon File Format", 1994): a header that declares elements and their properties, then the
//! records, as text or binary in either byte order. The parser is our own: the crates that read PLY refuse numbers such as
//! `.5` and do not locate errors in binary files.

pub(in crate::geometry) mod header;
mod record_runs;
pub(in crate::geometry) mod values;

use std::ops::Range;

use self::header::{Element, Header, Property, PropertyKind, Scalar};
use self::record_runs::{Parsed, RecordRun};
use self::values::Values;
use super::error::{MeshError, Position};
use super::pieces::parse_round;
use super::soup::{FacetSink, Soup, SoupPiece};
use crate::geometry::poll::Poll;

/// Reads the elements `vertex` and `face`; skips all others, save for strips of triangles, without which the surface would have holes.
pub(super) fn read(bytes: &[u8], soup: &mut Soup<'_>) -> Result<(), MeshError> {
    let poll = soup.poll;
    let header = Header::parse(bytes, poll)?;
    header.check_counts(bytes.len())?;
    let mut values = Values::new(bytes, &header, poll);
    let mut vertices = None;
    for element in &header.elements {
        match element.name.as_slice() {
            b"vertex" => vertices = Some(read_vertices(element, &mut values, soup)?),
            b"face" => {
                let vertices = vertices.clone().ok_or_else(|| MeshError::Syntax {
                    at: element.at,
                    expected: "the element vertex before the element face",
                    found: "none".into(),
                })?;
                read_faces(element, &mut values, &vertices, soup)?;
            }
            b"tristrips" if element.count > 0 => {
                let expected = "triangles as the element face (strips of them are not read; export the mesh as faces)";
                return Err(MeshError::Syntax { at: element.at, expected, found: "the element tristrips".into() });
            }
            _ => skip_records(element, &mut values)?,
        }
    }
    values.finish(poll)
}

/// Reads the vertices of an element; returns their indices in the soup.
fn read_vertices(element: &Element, values: &mut Values<'_>, soup: &mut Soup<'_>) -> Result<Range<u32>, MeshError> {
    let is_axis = |p: &Property, axis: &[u8]| p.name == axis && matches!(p.kind, PropertyKind::Scalar(_));
    let axes = [b"x", b"y", b"z"].map(|axis| element.properties.iter().position(|p| is_axis(p, axis)));
    let [Some(_), Some(_), Some(_)] = axes else {
        let found = element.property_names();
        return Err(MeshError::Syntax { at: element.at, expected: "the properties x, y, z of vertex", found });
    };
    let read_vertex = |values: &mut Values<'_>, sink: &mut dyn FacetSink| {
        values.begin_record("a vertex")?;
        let at = values.at();
        let mut xyz = [0.0; 3];
        for (k, property) in element.properties.iter().enumerate() {
            match (axes.iter().position(|&axis| axis == Some(k)), property.kind) {
                (Some(axis), PropertyKind::Scalar(scalar)) => xyz[axis] = values.next(scalar)?,
                (_, kind) => values.skip_property(kind)?,
            }
        }
        sink.vertex(xyz, at)
    };
    let first = soup.vertices() as u32;
    read_records(element, values, soup, &read_vertex)?;
    Ok(first..soup.vertices() as u32)
}

fn read_faces(element: &Element, values: &mut Values<'_>, vertices: &Range<u32>, soup: &mut Soup<'_>) -> Result<(), MeshError> {
    let is_corners = |name: &[u8]| name == b"vertex_indices" || name == b"vertex_index";
    let is_list = |p: &Property| is_corners(&p.name) && matches!(p.kind, PropertyKind::List { .. });
    if element.count > 0 && !element.properties.iter().any(is_list) {
        let found = element.property_names();
        return Err(MeshError::Syntax { at: element.at, expected: "the list vertex_indices (or vertex_index) of face", found });
    }
    let read_face = |values: &mut Values<'_>, sink: &mut dyn FacetSink| {
        let mut corners = Vec::new();
        values.begin_record("a face")?;
        let at = values.at();
        for property in &element.properties {
            match property.kind {
                PropertyKind::List { count, item } if is_corners(&property.name) => {
                    read_corners(count, item, values, vertices, &mut corners)?;
                }
                kind @ (PropertyKind::Scalar(_) | PropertyKind::List { .. }) => values.skip_property(kind)?,
            }
        }
        sink.face(&corners, at)
    };
    read_records(element, values, soup, &read_face)
}

/// Reads one record into a sink.
type ReadRecord<'a> = dyn Fn(&mut Values<'_>, &mut dyn FacetSink) -> Result<(), MeshError> + Sync + 'a;

/// Reads all records of an element: stretches of them side by side, as long as nothing is wrong and all are of the element, then
/// one after the other.
fn read_records(element: &Element, values: &mut Values<'_>, soup: &mut Soup<'_>, read: &ReadRecord<'_>) -> Result<(), MeshError> {
    let (poll, unit_mm) = (soup.poll, soup.settings.unit_mm());
    let mut left = element.count;
    'stretches: while left > 0 {
        let round = values.next_stretches(element, left, soup.settings.piece_bytes, poll);
        let parse = |stretch: &RecordRun<'_>, poll: &Poll<'_>| {
            let mut part = SoupPiece::new(unit_mm);
            let end = stretch.parse(read, &mut part, poll);
            (part, end)
        };
        let parsed = parse_round(&round, parse, poll)?;
        if parsed.is_empty() {
            break;
        }
        for (stretch, (part, end)) in round.iter().zip(parsed) {
            match end {
                // The last record of lines is left, since blank lines behind it are nobody's.
                Some(Parsed { records, lines }) if records + lines.min(1) <= left && soup.has_room(&part) => {
                    soup.take(part);
                    values.pass(stretch, lines);
                    left -= records;
                }
                Some(_) | None => break 'stretches,
            }
        }
    }
    (0..left).try_for_each(|_| read(values, soup))
}

fn read_corners(
    count: Scalar,
    item: Scalar,
    values: &mut Values<'_>,
    vertices: &Range<u32>,
    corners: &mut Vec<u32>,
) -> Result<(), MeshError> {
    let at = values.at();
    let length = values.next_count(count)?;
    if length < 3 {
        return Err(MeshError::Syntax { at, expected: "at least three corners of a face", found: length.to_string() });
    }
    corners.clear();
    for _ in 0..length {
        let at = values.at();
        let index = values.next(item)?;
        corners.push(vertex(index, vertices).ok_or_else(|| bad_index(index, vertices.len(), at))?);
    }
    Ok(())
}

fn vertex(index: f64, vertices: &Range<u32>) -> Option<u32> {
    (index >= 0.0 && index.fract() == 0.0 && index < vertices.len() as f64).then(|| vertices.start + index as u32)
}

fn bad_index(index: f64, vertices: usize, at: Position) -> MeshError {
    if index.fract() == 0.0 {
        MeshError::BadIndex { at, index: index as i64, vertices, hint: " (counted from 0)" }
    } else {
        MeshError::Syntax { at, expected: "a vertex number", found: index.to_string() }
    }
}

fn skip_records(element: &Element, values: &mut Values<'_>) -> Result<(), MeshError> {
    if element.properties.is_empty() {
        return Ok(());
    }
    for _ in 0..element.count {
        values.begin_record("a record")?;
        for property in &element.properties {
            values.skip_property(property.kind)?;
        }
    }
    Ok(())
}
