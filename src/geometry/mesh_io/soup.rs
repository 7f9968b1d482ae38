//! Triangle soup of a file: coordinates converted to millimetres, equal vertices welded, polygons cut into triangles, all within
//! limits.

use std::hash::{BuildHasher, Hash};
use std::sync::atomic::{AtomicU32, Ordering};

use nalgebra::Point3;

use super::Settings;
use super::error::{MeshError, Position};
use super::polygons;
use crate::geometry::poll::{Interrupted, Poll};
use crate::geometry::random_hash::RandomHash;
use crate::geometry::side_by_side::{self, PIECE};
use crate::geometry::sorted_lists::SortedLists;
use crate::geometry::{FaceGroup, Mesh};

/// Largest coordinate, 1000 km: no part is larger, and no sum or product of such coordinates overflows.
const MAX_COORDINATE_MM: f64 = 1e9;
/// Vertices whose keys fall into one list on average while equal ones are looked for: they stay in the cache.
const VERTICES_OF_A_LIST: usize = 1024;

/// Takes vertices and faces, in the order of the file.
pub(super) trait FacetSink {
    /// Adds a vertex at `xyz`, in units of the file.
    fn vertex(&mut self, xyz: [f64; 3], at: Position) -> Result<(), MeshError>;

    /// Adds the next face of the file, as a fan of triangles around its first corner.
    fn face(&mut self, corners: &[u32], at: Position) -> Result<(), MeshError>;
}

/// Vertices and faces of a piece of the file, which no limit holds for until a [`Soup`] takes them over.
pub(super) struct SoupPiece {
    unit_mm: f64,
    pub(super) vertices_mm: Vec<Point3<f64>>,
    pub(super) faces: Vec<[u32; 3]>,
    /// Face of the piece that each triangle comes from.
    source_face: Vec<u32>,
    faces_in_file: u32,
}

impl SoupPiece {
    pub(super) fn new(unit_mm: f64) -> Self {
        Self { unit_mm, vertices_mm: Vec::new(), faces: Vec::new(), source_face: Vec::new(), faces_in_file: 0 }
    }

    fn triangle(&mut self, corners: [u32; 3]) {
        self.faces.push(corners);
        self.source_face.push(self.faces_in_file);
    }
}

impl FacetSink for SoupPiece {
    fn vertex(&mut self, xyz: [f64; 3], at: Position) -> Result<(), MeshError> {
        self.vertices_mm.push(millimetres(xyz, self.unit_mm, at)?);
        Ok(())
    }

    fn face(&mut self, corners: &[u32], _: Position) -> Result<(), MeshError> {
        for pair in corners.windows(2).skip(1) {
            self.triangle([corners[0], pair[0], pair[1]]);
        }
        self.faces_in_file += 1;
        Ok(())
    }
}

/// The point at `xyz`, in units of the file.
pub(super) fn millimetres(xyz: [f64; 3], unit_mm: f64, at: Position) -> Result<Point3<f64>, MeshError> {
    // Adding zero turns -0 into 0, so that both are one vertex.
    let xyz_mm = xyz.map(|value| value * unit_mm + 0.0);
    for value_mm in xyz_mm {
        if !value_mm.is_finite() {
            return Err(MeshError::NotFinite { at, found: value_mm.to_string() });
        }
        if value_mm.abs() > MAX_COORDINATE_MM {
            return Err(MeshError::OutOfRange { at, value_mm, limit_mm: MAX_COORDINATE_MM });
        }
    }
    Ok(Point3::from(xyz_mm))
}

/// Triangle soup that a reader fills. Equal vertices stay apart until they are welded.
pub(super) struct Soup<'a> {
    pub(super) settings: Settings<'a>,
    pub(super) poll: &'a Poll<'a>,
    whole: SoupPiece,
}

impl FacetSink for Soup<'_> {
    fn vertex(&mut self, xyz: [f64; 3], at: Position) -> Result<(), MeshError> {
        let vertex_mm = millimetres(xyz, self.settings.unit_mm(), at)?;
        let limit = self.max_vertices();
        if self.vertices() >= limit {
            return Err(MeshError::TooLarge { at, what: "vertices", limit });
        }
        self.poll.spend(10)?;
        self.whole.vertices_mm.push(vertex_mm);
        Ok(())
    }

    fn face(&mut self, corners: &[u32], at: Position) -> Result<(), MeshError> {
        for pair in corners.windows(2).skip(1) {
            self.triangle([corners[0], pair[0], pair[1]], at)?;
        }
        self.whole.faces_in_file += 1;
        Ok(())
    }
}

impl<'a> Soup<'a> {
    pub(super) fn new(settings: Settings<'a>, poll: &'a Poll<'a>) -> Self {
        Self { settings, poll, whole: SoupPiece::new(settings.unit_mm()) }
    }

    /// Makes room for so many triangles, as far as the limits allow them.
    pub(super) fn expect_triangles(&mut self, count: usize) {
        let count = count.min(self.settings.limits.max_triangles);
        self.whole.faces.reserve_exact(count);
        self.whole.source_face.reserve_exact(count);
    }

    fn max_vertices(&self) -> usize {
        self.settings.limits.max_triangles.saturating_mul(3).min(u32::MAX as usize)
    }

    fn triangle(&mut self, corners: [u32; 3], at: Position) -> Result<(), MeshError> {
        let limit = self.settings.limits.max_triangles;
        if self.whole.faces.len() >= limit {
            return Err(MeshError::TooLarge { at, what: "triangles", limit });
        }
        self.poll.spend(10)?;
        self.whole.triangle(corners);
        Ok(())
    }

    /// Returns true if all of the part is within the limits.
    pub(super) fn has_room(&self, part: &SoupPiece) -> bool {
        self.has_room_for(part.faces.len()) && self.vertices() + part.vertices_mm.len() <= self.max_vertices()
    }

    /// Returns true if so many triangles more are within the limits.
    pub(super) fn has_room_for(&self, triangles: usize) -> bool {
        self.whole.faces.len() + triangles <= self.settings.limits.max_triangles
    }

    /// Takes over a part for which there is room, and whose faces refer to the vertices of the whole file.
    pub(super) fn take(&mut self, part: SoupPiece) {
        self.whole.vertices_mm.extend(part.vertices_mm);
        self.whole.faces.extend(part.faces);
        self.whole.source_face.extend(part.source_face.into_iter().map(|face| self.whole.faces_in_file + face));
        self.whole.faces_in_file += part.faces_in_file;
    }

    /// Takes over triangles that refer to vertices of their own, and have a place in the file each. Vertices need no limit where
    /// no triangle brings more than its corners.
    pub(super) fn take_triangles(
        &mut self,
        vertices_mm: Vec<Point3<f64>>,
        triangles: Vec<([u32; 3], Position)>,
    ) -> Result<(), MeshError> {
        let first = self.vertices();
        let Some((_, at)) = triangles.first() else { return Ok(()) };
        if first + vertices_mm.len() > u32::MAX as usize {
            return Err(MeshError::TooLarge { at: *at, what: "vertices", limit: u32::MAX as usize });
        }
        self.whole.vertices_mm.extend(vertices_mm);
        for (corners, at) in triangles {
            self.triangle(corners.map(|corner| first as u32 + corner), at)?;
            self.whole.faces_in_file += 1;
        }
        Ok(())
    }

    /// Index that the next face of the file gets.
    pub(super) fn next_face(&self) -> u32 {
        self.whole.faces_in_file
    }

    /// Number of vertices.
    pub(super) fn vertices(&self) -> usize {
        self.whole.vertices_mm.len()
    }

    /// Cuts anew the polygons that their fans do not fill; returns the number of those that cannot be cut.
    pub(super) fn cut_concave(&mut self) -> Result<usize, Interrupted> {
        let SoupPiece { vertices_mm, faces, source_face, faces_in_file, .. } = &mut self.whole;
        // Most files have triangles alone.
        let has_polygons = faces.len() > *faces_in_file as usize;
        if has_polygons { polygons::cut_concave(vertices_mm, faces, source_face, self.poll) } else { Ok(0) }
    }

    /// Welds vertices of exactly equal coordinates, each to the first of them.
    pub(super) fn weld_equal(&mut self) -> Result<(), Interrupted> {
        self.weld(bits)
    }

    /// Welds vertices that differ by less than the resolution of a 32-bit float at the size of the part. This is for STL, which
    /// has no vertex indices: CAD systems write the same point as 0 in one facet and as 1e-17 in the next, and the part would
    /// fall to pieces. A vertex moves only onto the first one in its grid cell.
    pub(super) fn weld_float_noise(&mut self) -> Result<(), Interrupted> {
        let pieces: Vec<_> = self.whole.vertices_mm.chunks(PIECE).collect();
        let largest = |vertices: &&[Point3<f64>]| vertices.iter().fold(0.0, |max: f64, vertex| max.max(vertex.coords.amax()));
        let largest_mm = side_by_side::map(&pieces, largest, self.poll)?.into_iter().fold(0.0, f64::max);
        let cell_mm = largest_mm * f64::from(f32::EPSILON) / 2.0;
        if cell_mm == 0.0 {
            return Ok(());
        }
        self.weld(|v| [v.x, v.y, v.z].map(|value| (value / cell_mm).round() as i64))
    }

    /// Replaces each vertex by the first one with the same key.
    fn weld<K: Hash + Eq>(&mut self, key: impl Fn(&Point3<f64>) -> K + Sync) -> Result<(), Interrupted> {
        let Some(first) = first_of_equals(&self.whole.vertices_mm, &key, self.poll)? else { return Ok(()) };
        let weld = |face: &mut [u32; 3]| *face = face.map(|vertex| first[vertex as usize].load(Ordering::Relaxed));
        side_by_side::change(&mut self.whole.faces, weld, self.poll)
    }

    /// The collected mesh, still with degenerate triangles and unused vertices.
    pub(super) fn into_mesh(self, groups: Vec<FaceGroup>) -> Mesh {
        let SoupPiece { vertices_mm, faces, source_face, .. } = self.whole;
        Mesh { vertices_mm, faces, source_face, groups }
    }
}

/// The first vertex that has the same key as each; `None` where no two have the same. Vertices come together by hash, and only
/// those of one hash are compared; whatever the hash is, the answer is the same.
fn first_of_equals<K: Hash + Eq>(
    vertices_mm: &[Point3<f64>],
    key: &(impl Fn(&Point3<f64>) -> K + Sync),
    poll: &Poll<'_>,
) -> Result<Option<Vec<AtomicU32>>, Interrupted> {
    let hash = RandomHash::new();
    let pieces: Vec<_> = vertices_mm.chunks(PIECE).collect();
    let hashes_of = |vertices: &&[Point3<f64>]| vertices.iter().map(|v| hash.hash_one(key(v)) as u32).collect::<Vec<_>>();
    let hashes = side_by_side::map(&pieces, hashes_of, poll)?.concat();
    let lists_bits = (vertices_mm.len() / VERTICES_OF_A_LIST).max(1).ilog2();
    let entry =
        |id: usize| [((u64::from(hashes[id]) << lists_bits >> u32::BITS) as u32, u64::from(hashes[id]) << 32 | id as u64)];
    let lists = SortedLists::new(vertices_mm.len(), 1 << lists_bits, entry, poll)?;
    drop(hashes);
    let first: Vec<AtomicU32> = (0..vertices_mm.len() as u32).map(AtomicU32::new).collect();
    // Vertices of one hash, ascending; mostly they are all equal.
    let weld_run = |run: &[u64]| {
        let mut known: Vec<(K, u32)> = Vec::new();
        let (head, others) = (run[0] as u32, &run[1..]);
        let head_key = key(&vertices_mm[head as usize]);
        for id in others.iter().map(|number| *number as u32) {
            let own_key = key(&vertices_mm[id as usize]);
            let equal =
                if own_key == head_key { Some(head) } else { known.iter().find(|known| known.0 == own_key).map(|known| known.1) };
            match equal {
                Some(equal) => first[id as usize].store(equal, Ordering::Relaxed),
                None => known.push((own_key, id)),
            }
        }
        known.len() < others.len()
    };
    let weld_lists = |keys: &std::ops::Range<usize>| {
        let runs = lists.of(keys.clone()).flat_map(|(_, list)| list.chunk_by(|a, b| a >> 32 == b >> 32));
        runs.filter(|run| run.len() > 1 && weld_run(run)).count()
    };
    let welded: usize = side_by_side::map(&lists.pieces(), weld_lists, poll)?.into_iter().sum();
    Ok((welded > 0).then_some(first))
}

/// Bits of the coordinates: the same for equal coordinates, since none is -0.
pub(super) fn bits(vertex_mm: &Point3<f64>) -> [u64; 3] {
    [vertex_mm.x, vertex_mm.y, vertex_mm.z].map(f64::to_bits)
}
