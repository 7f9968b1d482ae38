//! Vertices, faces and the grid of a PLY file. Faces are cut into fans. A cloud is organised where the header's comments give
//! `num_cols` and `num_rows` (or `width` and `height`), as the range grids of the Stanford 3D Scanning Repository do; the points
//! are then a cell each, or the element `range_grid` lists, cell by cell, the one vertex that lies there or none.

use super::ply_body::PlyBody;
use super::stream::CloudStream;
use super::{CloudError, CloudLimits, Collected, StoredCloud};
use crate::geometry::mesh_io::ply::header::{Element, Header, Property, PropertyKind};
use crate::geometry::mesh_io::{MeshError, Position};
use crate::geometry::point_cloud::CloudGrid;

/// Bytes that a header may take.
const MAX_HEADER_BYTES: usize = 1 << 20;

pub(super) fn read(stream: &mut CloudStream<'_>, limits: &CloudLimits) -> Result<StoredCloud, CloudError> {
    let poll = stream.poll;
    let head = stream.fill(MAX_HEADER_BYTES)?;
    let header = Header::parse(&head[..head.len().min(MAX_HEADER_BYTES)], poll)?;
    header.check_counts(usize::try_from(stream.length_bytes).unwrap_or(usize::MAX))?;
    stream.consume(header.body_at);
    let grid = grid_of(&header);
    let has_cells = header.elements.iter().any(|element| element.name == b"range_grid");
    let mut body = PlyBody::new(stream, &header);
    let (mut collected, mut faces, mut cells) = (None, Vec::new(), None);
    for element in &header.elements {
        match element.name.as_slice() {
            b"vertex" if collected.is_none() => {
                let is_organised = grid.is_some_and(|grid| cell_count(grid) == Some(element.count)) && !has_cells;
                // Vertices of a mesh keep their numbers, so that those without a finite point stay.
                let keeps = is_organised || header.elements.len() > 1;
                let mut points = Collected::new(element.count, keeps, limits)?;
                read_vertices(element, &mut body, &mut points)?;
                collected = Some((points, is_organised));
            }
            b"face" => faces = read_faces(element, &mut body, vertices_of(collected.as_ref(), element)?, limits)?,
            b"range_grid" => cells = Some(read_cells(element, &mut body, vertices_of(collected.as_ref(), element)?, limits)?),
            _ => body.skip(element)?,
        }
    }
    let Some((points, is_organised)) = collected else {
        let expected = "the element vertex";
        return Err(MeshError::Syntax { at: Position::Line(header.body_line), expected, found: "none".into() }.into());
    };
    finish(points, is_organised, grid, cells, faces)
}

fn finish(
    points: Collected,
    is_organised: bool,
    grid: Option<CloudGrid>,
    cells: Option<Vec<u32>>,
    faces: Vec<[u32; 3]>,
) -> Result<StoredCloud, CloudError> {
    let mut cloud = points.into_cloud(grid.filter(|_| is_organised));
    if let (Some(cells), Some(grid)) = (cells, grid) {
        if cell_count(grid) != Some(cells.len() as u64) {
            let (columns, rows) = (grid.columns as u64, grid.rows as u64);
            return Err(CloudError::GridMismatch { at: Position::Line(1), columns, rows, points: cells.len() as u64 });
        }
        let point = |vertex: &u32| cloud.points.get(*vertex as usize).copied().unwrap_or([f32::NAN; 3]);
        return Ok(StoredCloud { points: cells.iter().map(point).collect(), grid: Some(grid), ..cloud });
    }
    cloud.faces = faces;
    if cloud.faces.is_empty() && cloud.grid.is_none() {
        cloud.points.retain(|point| !point[0].is_nan());
    }
    Ok(cloud)
}

fn vertices_of(collected: Option<&(Collected, bool)>, element: &Element) -> Result<usize, MeshError> {
    let expected = "the element vertex before this one";
    let missing = || MeshError::Syntax { at: element.at, expected, found: element.property_names() };
    collected.map(|(points, _)| points.points.len()).ok_or_else(missing)
}

fn cell_count(grid: CloudGrid) -> Option<u64> {
    (grid.columns as u64).checked_mul(grid.rows as u64)
}

fn grid_of(header: &Header) -> Option<CloudGrid> {
    let note =
        |names: [&[u8]; 2]| header.notes.iter().find(|(name, _)| names.contains(&name.as_slice())).map(|(_, value)| *value);
    let (columns, rows) = (note([b"num_cols", b"width"])?, note([b"num_rows", b"height"])?);
    let grid = CloudGrid { columns: usize::try_from(columns).ok()?, rows: usize::try_from(rows).ok()? };
    (grid.columns > 0 && grid.rows > 0).then_some(grid)
}

fn read_vertices(element: &Element, body: &mut PlyBody<'_, '_>, into: &mut Collected) -> Result<(), CloudError> {
    let is_axis = |p: &Property, axis: &[u8]| p.name == axis && matches!(p.kind, PropertyKind::Scalar(_));
    let axes = [b"x", b"y", b"z"].map(|axis| element.properties.iter().position(|p| is_axis(p, axis)));
    let [Some(x), Some(y), Some(z)] = axes else {
        let found = element.property_names();
        return Err(MeshError::Syntax { at: element.at, expected: "the properties x, y, z of vertex", found }.into());
    };
    body.points(element, [x, y, z], into)
}

fn list_of<'e>(element: &'e Element, names: &[&[u8]]) -> Option<&'e Property> {
    let is_list = |p: &&Property| names.contains(&p.name.as_slice()) && matches!(p.kind, PropertyKind::List { .. });
    element.properties.iter().find(is_list)
}

fn read_faces(
    element: &Element,
    body: &mut PlyBody<'_, '_>,
    vertices: usize,
    limits: &CloudLimits,
) -> Result<Vec<[u32; 3]>, CloudError> {
    let limit = limits.max_points.saturating_mul(2);
    let Some(list) = list_of(element, &[b"vertex_indices", b"vertex_index"]) else {
        body.skip(element)?;
        return Ok(Vec::new());
    };
    let (mut faces, mut corners) = (Vec::new(), Vec::new());
    for _ in 0..element.count {
        body.list(element, list, vertices, &mut corners)?;
        for pair in corners.windows(2).skip(1) {
            if faces.len() >= limit {
                return Err(MeshError::TooLarge { at: body.at(), what: "triangles", limit }.into());
            }
            faces.push([corners[0], pair[0], pair[1]]);
        }
    }
    Ok(faces)
}

/// Vertex of each cell; the largest number where there is none.
fn read_cells(
    element: &Element,
    body: &mut PlyBody<'_, '_>,
    vertices: usize,
    limits: &CloudLimits,
) -> Result<Vec<u32>, CloudError> {
    if element.count > limits.max_points as u64 {
        return Err(CloudError::TooManyPoints { limit: limits.max_points });
    }
    let Some(list) = list_of(element, &[b"vertex_indices", b"vertex_index"]) else {
        let expected = "the list vertex_indices of range_grid";
        return Err(MeshError::Syntax { at: element.at, expected, found: element.property_names() }.into());
    };
    let mut one = Vec::new();
    let mut cells = Vec::new();
    for _ in 0..element.count {
        body.list(element, list, vertices, &mut one)?;
        cells.push(one.first().copied().unwrap_or(u32::MAX));
    }
    Ok(cells)
}
