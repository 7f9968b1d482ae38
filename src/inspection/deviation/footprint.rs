//! Distances of a view's points from the faces that their rays meet, and those that a sample takes.

use std::array;
use std::ops::RangeInclusive;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::{DeviationOptions, NOISE_MM, Nominal, PlacedScan, SimdLevel};
use crate::geometry::{CloudGrid, Hit, Part, Pose, ScannerFrame, nearest_of_triangle, parallel};
use crate::inspection::PixelGrid;
use crate::planning::ids::SampleId;

/// Rays that are cast together.
const RAYS: usize = 4096;
/// Face of a cell without a distance.
const NO_FACE: u32 = u32::MAX;
/// Largest distance from the surface at which points still count as material of the part, mm.
const MAX_OFF_MM: f64 = 30.0;
/// Every so many cells of a row and a column that are off the surface are kept, to bound memory.
const OFF_STEP: usize = 2;

/// Distance of each cell of a view.
pub(super) struct ViewDistances {
    /// `None` where the cloud has none.
    grid: Option<PixelGrid>,
    found: Vec<Found>,
    /// Cell that images the foot, and own cell, of each point that is placed by its foot; ascending.
    feet: Vec<[usize; 2]>,
    /// Points off the surface: position in the part's frame, and distance.
    pub(super) off_surface: Vec<(Point3<f64>, f64)>,
    pub(super) compared: u64,
    /// Points that are left out, since the surface that they show is turned too far.
    pub(super) turned: u64,
}

/// Points that a sample takes from a view.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MeasuredFootprint {
    /// Points that measure the surface.
    pub(super) compared: PointSum,
    /// Points off the surface, before it or behind it.
    pub(super) off: u32,
    /// Points of a surface that is turned too far.
    pub(super) turned: PointSum,
}

/// Number of some points, and sums of their distances.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PointSum {
    pub(super) points: u32,
    pub(super) sum_mm: f64,
    pub(super) square_mm2: f64,
}

impl PointSum {
    fn take(&mut self, distance_mm: f64) {
        self.add(&Self { points: 1, sum_mm: distance_mm, square_mm2: distance_mm * distance_mm });
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.points += other.points;
        self.sum_mm += other.sum_mm;
        self.square_mm2 += other.square_mm2;
    }

    /// Mean distance; 0 of no points.
    pub(super) fn mean_mm(&self) -> f64 {
        self.sum_mm / f64::from(self.points.max(1))
    }
}

/// Use of a point for the face that its ray meets.
#[derive(Clone, Copy, PartialEq, Eq)]
enum PointUse {
    /// The point measures the face.
    Compared,
    /// The point is off the surface, and measures nothing of the face.
    Off,
    /// The point shows a surface that is turned too far against the face, and measures nothing of it.
    Turned,
    /// The ray of the point meets no face of the part: it passes by, or meets plate or fixture first.
    Beside,
}

/// Face that a point belongs to, and the distance of the point from it.
#[derive(Clone, Copy)]
struct Found {
    /// Face that the ray of the point's cell meets, or on which its material stands.
    face: u32,
    distance_mm: f32,
    usage: PointUse,
    /// True if the face is that on which its material stands.
    is_by_foot: bool,
}

impl Found {
    const NOTHING: Self = Self { face: NO_FACE, distance_mm: 0.0, usage: PointUse::Compared, is_by_foot: false };
    const BESIDE: Self = Self { usage: PointUse::Beside, ..Self::NOTHING };

    /// Face that the point may lie on; none of a surface that is turned, or of one far behind.
    fn own_face(&self) -> u32 {
        let is_other = self.usage == PointUse::Turned || !self.is_of_part();
        if is_other { NO_FACE } else { self.face }
    }

    /// Returns true if the point is so near that it may be of the part.
    fn is_of_part(&self) -> bool {
        f64::from(self.distance_mm.abs()) <= MAX_OFF_MM
    }

    /// Returns true if the point lies before its face by a distance within these bounds, whatever its use.
    fn is_before(&self, from_mm: f64, to_mm: f64) -> bool {
        let distance_mm = f64::from(self.distance_mm);
        self.face != NO_FACE && distance_mm > from_mm && distance_mm <= to_mm
    }
}

/// Points of a view by their use.
#[derive(Default)]
struct SortedPoints {
    /// Some of those off the surface: position in the part's frame, and distance.
    off_surface: Vec<(Point3<f64>, f64)>,
    compared: u64,
    turned: u64,
}

impl ViewDistances {
    /// Distances of a view's points.
    pub(super) fn of(
        placed: &PlacedScan<'_>,
        nominal: &Nominal<'_>,
        normals: &[Vector3<f64>],
        options: &DeviationOptions,
        footprint_mm: f64,
    ) -> Self {
        let cloud = &placed.scan.scanner_cloud;
        // Points without a grid are left out: ingest gives every cloud one.
        let Some(grid) = cloud.grid.and_then(|size| PixelGrid::of_size(nominal.scanner, size)) else {
            return Self { grid: None, found: Vec::new(), feet: Vec::new(), off_surface: Vec::new(), compared: 0, turned: 0 };
        };
        let part_from_scanner = &placed.part_from_scanner;
        let (scanner_from_part, eye_mm) = (part_from_scanner.inverse(), part_from_scanner.point(&grid.centre_mm()));
        let view = View { placed, nominal, normals, options, scanner_from_part, eye_mm, grid };
        let cells = grid.cells();
        let mut found = vec![Found::NOTHING; cells];
        found.par_chunks_mut(RAYS).enumerate().for_each(|(piece, found)| view.meet(piece * RAYS, found));
        let ring = view.ring();
        // None is judged by what another one has been taken for.
        let is_beyond = |cell| view.is_beyond_a_step(cell, &found, &ring) || view.is_beyond_a_rim(cell, &found, &ring);
        let is_beyond: Vec<bool> = parallel::map_range(cells, is_beyond);
        let feet = view.place_by_feet(&mut found, &is_beyond, footprint_mm);
        let pieces: Vec<SortedPoints> =
            found.par_chunks_mut(RAYS).enumerate().map(|(piece, found)| view.sort(piece * RAYS, found, &is_beyond)).collect();
        let compared = pieces.iter().map(|piece| piece.compared).sum();
        let turned = pieces.iter().map(|piece| piece.turned).sum();
        let off_surface = pieces.into_iter().flat_map(|piece| piece.off_surface).collect();
        Self { grid: Some(grid), found, feet, off_surface, compared, turned }
    }

    /// Distances in runs of neighbouring cells along a row, or down a column, each of points that are compared with even surface: at most so
    /// many runs, evenly chosen of all.
    pub(super) fn runs<const RUN: usize>(&self, is_down: bool, normals: &[Vector3<f64>], most: usize) -> Vec<[f64; RUN]> {
        let Some(CloudGrid { columns, rows }) = self.grid.map(|grid| grid.size) else { return Vec::new() };
        let (lines, to_next_line, length, step) = if is_down { (columns, 1, rows, columns) } else { (rows, columns, columns, 1) };
        let of_line = |line: usize| -> Vec<usize> {
            let firsts = (0..length / RUN).map(|run| line * to_next_line + run * RUN * step);
            firsts.filter(|first| self.is_even((0..RUN).map(|place| first + place * step), normals)).collect()
        };
        let firsts = parallel::map_range(lines, of_line).concat();
        let chosen = firsts.iter().step_by(firsts.len().div_ceil(most).max(1));
        chosen.map(|first| array::from_fn(|place| f64::from(self.found[first + place * step].distance_mm))).collect()
    }

    /// Cells of the points whose feet the cells of this range image.
    fn with_feet_in(&self, cells: RangeInclusive<usize>) -> impl Iterator<Item = usize> {
        let first = self.feet.partition_point(|[foot, _]| foot < cells.start());
        self.feet[first..].iter().take_while(move |[foot, _]| foot <= cells.end()).map(|[_, cell]| *cell)
    }

    /// Returns true if the points of all these cells are compared, with faces that are hardly turned against that of the first.
    fn is_even(&self, mut cells: impl Iterator<Item = usize>, normals: &[Vector3<f64>]) -> bool {
        let mut first = NO_FACE;
        cells.all(|cell| {
            let Found { face, usage, .. } = self.found[cell];
            if face == NO_FACE || usage != PointUse::Compared {
                return false;
            }
            if first == NO_FACE {
                first = face;
            }
            face == first || normals[face as usize].dot(&normals[first as usize]) >= EVEN_COS
        })
    }
}

/// A view on its way.
struct View<'a> {
    placed: &'a PlacedScan<'a>,
    nominal: &'a Nominal<'a>,
    /// Unit normals of the mesh's faces.
    normals: &'a [Vector3<f64>],
    options: &'a DeviationOptions,
    scanner_from_part: Pose<ScannerFrame, Part>,
    /// Optical centre of the left camera, part frame.
    eye_mm: Point3<f64>,
    grid: PixelGrid,
}

impl View<'_> {
    /// Point of a cell, scanner frame.
    fn point(&self, cell: usize) -> Option<Point3<f64>> {
        let point = self.placed.scan.scanner_cloud.points_mm.get(cell)?;
        (!point[0].is_nan()).then(|| Point3::from(point.map(f64::from)))
    }

    /// Finds the faces that the rays of the cells from `first` on meet, and the distances of their points.
    fn meet(&self, first: usize, found: &mut [Found]) {
        let mut cells = Vec::with_capacity(found.len());
        let mut directions = Vec::with_capacity(found.len());
        for cell in 0..found.len() {
            if let Some(point) = self.point(first + cell) {
                cells.push(cell);
                directions.push(self.placed.part_from_scanner.point(&point) - self.eye_mm);
            }
        }
        let mut hits: Vec<Option<Hit>> = Vec::new();
        self.nominal.scene.first_hits_from(SimdLevel::widest(), &self.eye_mm, &directions, &mut hits);
        for ((cell, direction), hit) in cells.iter().zip(&directions).zip(&hits) {
            // What is no face of the part, plate or fixture, hides what lies behind it.
            let hit = hit.as_ref().filter(|hit| (hit.triangle as usize) < self.nominal.mesh.faces.len());
            found[*cell] = hit.map_or(Found::BESIDE, |hit| self.judge(first + cell, direction, hit.triangle));
        }
    }

    /// Counts the points of the cells from `first` on by their use, and marks those off the surface. What belongs to the other side of a
    /// step, or lies behind a rim, is forgotten.
    fn sort(&self, first: usize, found: &mut [Found], is_beyond: &[bool]) -> SortedPoints {
        let mut sorted = SortedPoints::default();
        for (place, found) in found.iter_mut().enumerate().filter(|(_, found)| found.face != NO_FACE) {
            let (cell, distance_mm) = (first + place, f64::from(found.distance_mm));
            if is_beyond[cell] {
                *found = Found::NOTHING;
            } else if found.usage == PointUse::Turned {
                sorted.turned += 1;
            } else if distance_mm.abs() <= self.options.search_mm {
                sorted.compared += 1;
            } else {
                found.usage = PointUse::Off;
                let [column, row] = [cell % self.grid.size.columns, cell / self.grid.size.columns];
                let is_kept = column.is_multiple_of(OFF_STEP) && row.is_multiple_of(OFF_STEP);
                if let Some(point) = self.point(cell).filter(|_| is_kept && found.is_of_part()) {
                    sorted.off_surface.push((self.placed.part_from_scanner.point(&point), distance_mm));
                }
            }
        }
        sorted
    }

    /// Gives points that lie before their faces by more than a footprint to the faces on which the material stands: under an oblique view
    /// their rays meet the surface elsewhere. Returns the cells of their feet, and their own, ascending.
    fn place_by_feet(&self, found: &mut [Found], is_beyond: &[bool], footprint_mm: f64) -> Vec<[usize; 2]> {
        let is_before = |cell: &usize| !is_beyond[*cell] && found[*cell].is_before(footprint_mm, MAX_OFF_MM);
        let cells: Vec<usize> = (0..found.len()).filter(is_before).collect();
        let below = parallel::map_range(cells.len(), |place| self.below(cells[place], &found[cells[place]], footprint_mm));
        let mut feet = Vec::new();
        for (cell, (below, foot)) in cells.iter().zip(below).filter_map(|(cell, below)| Some((*cell, below?))) {
            found[cell] = below;
            feet.push([foot, cell]);
        }
        feet.sort_unstable();
        feet
    }

    /// Face on which the material at the point of a cell stands, and the cell that images the foot on it: the one behind the surface that
    /// the point shows if that is turned alike, else that below the point along the normal of the face that its ray meets. `None` where
    /// neither is within the distance that is searched, or the foot lies outside of the grid.
    fn below(&self, cell: usize, found: &Found, footprint_mm: f64) -> Option<(Found, usize)> {
        let point = self.placed.part_from_scanner.point(&self.point(cell)?);
        let shown = self.normal(cell).map(|normal| self.placed.part_from_scanner.direction(&normal));
        let by_shown = shown.and_then(|shown| {
            // The surface may also lie a little before the point.
            let min_cos = self.options.max_turn_deg.to_radians().cos();
            let (face, distance_mm) = self.foot(&point, shown, (footprint_mm, min_cos))?;
            let is_near = (-footprint_mm..=self.options.search_mm).contains(&distance_mm);
            is_near.then_some((face, distance_mm, PointUse::Compared))
        });
        let by_ray = || {
            let (face, distance_mm) = self.foot(&point, self.normals[found.face as usize], (0.0, 0.0))?;
            let is_near = |distance_mm: f64| distance_mm > 0.0 && distance_mm <= self.options.search_mm;
            (is_near(f64::from(found.distance_mm)) && is_near(distance_mm)).then_some((face, distance_mm, found.usage))
        };
        let (face, distance_mm, usage) = by_shown.or_else(by_ray)?;
        let foot = point - self.normals[face as usize] * distance_mm;
        let (place, _) = self.grid.image_of(&self.scanner_from_part.point(&foot))?;
        let below = Found { face, distance_mm: distance_mm as f32, usage, is_by_foot: true };
        Some((below, self.grid.number(self.grid.cell_at(place)?)))
    }

    /// Face that is met from `start_mm` before a point against a normal, then against that of the face itself, and the distance of the point
    /// from its plane; `None` where nothing of the part is met, or a face that is turned by more than is allowed.
    fn foot(&self, point: &Point3<f64>, mut normal: Vector3<f64>, (start_mm, min_cos): (f64, f64)) -> Option<(u32, f64)> {
        let mut hits: Vec<Option<Hit>> = Vec::new();
        let mut found = None;
        for _ in 0..FOOT_STEPS {
            self.nominal.scene.first_hits_from(SimdLevel::widest(), &(point + normal * start_mm), &[-normal], &mut hits);
            let face = hits[0].as_ref()?.triangle;
            let own = self.normals.get(face as usize).filter(|own| own.dot(&normal) > min_cos)?;
            found = Some((face, own.dot(&(point - self.nominal.mesh.corners(face as usize)[0]))));
            normal = *own;
        }
        found
    }

    fn judge(&self, cell: usize, direction: &Vector3<f64>, face: u32) -> Found {
        let mesh = self.nominal.mesh;
        let normal = self.normals[face as usize];
        // The back of a face is met where the registered pose and the scan disagree at a rim.
        if normal.dot(direction) >= 0.0 {
            return Found::NOTHING;
        }
        let distance_mm = normal.dot(&(self.eye_mm + direction - mesh.vertices_mm[mesh.faces[face as usize][0] as usize])) as f32;
        let is_within = f64::from(distance_mm.abs()) <= self.options.search_mm;
        let usage = if is_within && self.is_turned(cell, &normal) { PointUse::Turned } else { PointUse::Compared };
        let found = Found { face, distance_mm, usage, is_by_foot: false };
        // Far before the face lies another body. Far behind it, this view's ray went through where the face should be; a point of a merged
        // cloud may have been seen by another ray, even of a body that is not the part.
        let counts_behind = distance_mm < 0.0 && !self.options.is_merged;
        if found.is_of_part() || counts_behind { found } else { Found::NOTHING }
    }

    /// Length by which another face has to lie nearer to a point than its own: more than ten times the noise, and twice as near.
    fn min_gain_mm(&self, distance_mm: f64) -> f64 {
        (STEP_NOISES * self.options.noise_mm.max(NOISE_MM)).max(0.5 * distance_mm.abs())
    }

    /// Returns true if the surface around a cell is turned too far against a face of this normal.
    fn is_turned(&self, cell: usize, normal: &Vector3<f64>) -> bool {
        let nominal = self.scanner_from_part.direction(normal);
        self.normal(cell).is_some_and(|measured| measured.dot(&nominal) < self.options.max_turn_deg.to_radians().cos())
    }

    /// Offsets, in columns and rows, to the cells that are asked for another face: eight directions, at half and at whole distance.
    fn ring(&self) -> Vec<[isize; 2]> {
        let cell_mm = self.grid.cell_mm(self.nominal.scanner.best_mm);
        let whole = ((self.options.rim_mm / cell_mm).ceil() as isize).clamp(1, MAX_RING);
        let mut distances = vec![(whole + 1) / 2, whole];
        distances.dedup();
        let around = (-1..=1).flat_map(|column| (-1..=1).map(move |row| [column, row])).filter(|offset| *offset != [0, 0]);
        around.flat_map(|offset| distances.iter().map(move |distance| offset.map(|one| one * distance))).collect()
    }

    /// Returns true if a face that a pixel nearby met explains the point of a cell better than its own: by more than ten times the noise,
    /// and twice as well. One of the same side, the other level of a step, is taken for its plane, and one of another side, a wall, for
    /// itself.
    fn is_beyond_a_step(&self, cell: usize, found: &[Found], ring: &[[isize; 2]]) -> bool {
        let Found { face, distance_mm, .. } = found[cell];
        let distance_mm = f64::from(distance_mm);
        let min_gain_mm = self.min_gain_mm(distance_mm);
        if face == NO_FACE || distance_mm.abs() <= min_gain_mm {
            return false;
        }
        let mesh = self.nominal.mesh;
        let normal = self.normals[face as usize];
        let Some(point) = self.point(cell).map(|point| self.placed.part_from_scanner.point(&point)) else { return false };
        ring.iter().any(|offset| {
            let other = self.beside(cell, offset).map_or(NO_FACE, |beside| found[beside].own_face());
            other != NO_FACE && other != face && {
                let corners = mesh.corners(other as usize);
                let other_normal = self.normals[other as usize];
                let other_mm = if other_normal.dot(&normal) >= SAME_SIDE_COS {
                    other_normal.dot(&(point - corners[0])).abs()
                } else {
                    (nearest_of_triangle(&corners, &point).0 - point).norm()
                };
                distance_mm.abs() - other_mm > min_gain_mm
            }
        })
    }

    /// Returns true if the point of a cell, behind its face by more than is searched, shows what lies behind a rim of the part: a pixel
    /// nearby whose ray passes the part by shows the same surface, and another one shows the face. The rim is broken there, or lies off
    /// sideways; where nothing is behind it, no point would return. Where the face is shown nowhere near, it is missing.
    fn is_beyond_a_rim(&self, cell: usize, found: &[Found], ring: &[[isize; 2]]) -> bool {
        let (face, search_mm) = (found[cell].face, self.options.search_mm);
        let behind_mm = f64::from(found[cell].distance_mm);
        if face == NO_FACE || behind_mm >= -search_mm {
            return false;
        }
        let normal = self.normals[face as usize];
        let corner = self.nominal.mesh.corners(face as usize)[0];
        let (mut is_background, mut is_shown) = (false, false);
        for beside in ring.iter().filter_map(|offset| self.beside(cell, offset)) {
            let Some(point) = self.point(beside) else { continue };
            // Above the plane of the face.
            let height_mm = normal.dot(&(self.placed.part_from_scanner.point(&point) - corner));
            let Found { face, distance_mm, usage, .. } = found[beside];
            match usage {
                PointUse::Beside => is_background |= (height_mm - behind_mm).abs() <= search_mm,
                // Beside the drop the surface seems turned.
                PointUse::Compared | PointUse::Turned if face != NO_FACE => {
                    let is_of_side = self.normals[face as usize].dot(&normal) >= SAME_SIDE_COS;
                    is_shown |= is_of_side && height_mm.abs().max(f64::from(distance_mm.abs())) <= search_mm;
                }
                PointUse::Compared | PointUse::Turned | PointUse::Off => {}
            }
        }
        is_background && is_shown
    }

    /// Cell so many columns and rows off; `None` outside of the grid.
    fn beside(&self, cell: usize, [right, down]: &[isize; 2]) -> Option<usize> {
        let size = self.grid.size;
        let column = (cell % size.columns).checked_add_signed(*right).filter(|column| *column < size.columns)?;
        let row = (cell / size.columns).checked_add_signed(*down).filter(|row| *row < size.rows)?;
        Some(self.grid.number([column, row]))
    }

    /// Normal of the surface around a cell, towards the scanner, scanner frame: cross product of the differences of neighbours on both
    /// sides, or with the point itself at a rim.
    fn normal(&self, cell: usize) -> Option<Vector3<f64>> {
        let own = self.point(cell)?;
        let (column, row) = (cell % self.grid.size.columns, cell / self.grid.size.columns);
        let left = (column > 0).then(|| self.point(cell - 1)).flatten();
        let right = (column + 1 < self.grid.size.columns).then(|| self.point(cell + 1)).flatten();
        let above = (row > 0).then(|| self.point(cell - self.grid.size.columns)).flatten();
        let below = (row + 1 < self.grid.size.rows).then(|| self.point(cell + self.grid.size.columns)).flatten();
        let along = right.unwrap_or(own) - left.unwrap_or(own);
        let down = below.unwrap_or(own) - above.unwrap_or(own);
        let normal = along.cross(&down).try_normalize(1e-12)?;
        Some(if normal.dot(&own.coords) > 0.0 { -normal } else { normal })
    }
}

/// Footprints of samples in a view.
pub(super) struct Footprints<'a> {
    pub(super) placed: &'a PlacedScan<'a>,
    pub(super) nominal: &'a Nominal<'a>,
    /// Unit normals of the mesh's faces.
    pub(super) normals: &'a [Vector3<f64>],
    pub(super) scanner_from_part: Pose<ScannerFrame, Part>,
    pub(super) distances: &'a ViewDistances,
    pub(super) footprint_mm: f64,
}

/// Largest distance at which another face is looked for, cells.
const MAX_RING: isize = 8;
/// Multiple of a point's noise by which another face has to explain it better. The noise counts for [`NOISE_MM`] at least: by less the
/// facets of a curved surface would be taken for steps.
const STEP_NOISES: f64 = 10.0;
/// Steps along normals to the face below a point: on a curved surface the face that the first one meets is turned a little.
const FOOT_STEPS: usize = 2;
/// Largest half width of a footprint, cells.
const MAX_HALF_WIDTH: usize = 12;
/// More than the rounding of a point's coordinates in either frame, mm.
const ROUNDING_MM: f64 = 1e-6;
/// Faces turned by less than this against a sample's own may be averaged with it: cos 30°, as for the measured normals.
const SAME_SIDE_COS: f64 = 0.866;
/// Faces turned by less than this against each other are even: cos 1°. By more, the facets of a curved surface would seem noise.
const EVEN_COS: f64 = 0.999_848;

impl Footprints<'_> {
    /// Points of a sample; `None` where it has none, of whatever use.
    pub(super) fn of(&self, sample: SampleId) -> Option<MeasuredFootprint> {
        let surface = self.nominal.surface;
        let (at, patch) = (surface.sample_mm[sample.index()], surface.patch_of(sample));
        let in_scanner = self.scanner_from_part.point(&at);
        let grid = self.distances.grid.as_ref()?;
        let eye_mm = self.placed.part_from_scanner.point(&grid.centre_mm());
        let towards = eye_mm - at;
        if towards.dot(&patch.normal) <= 0.0 {
            return None;
        }
        let (place, depth_mm) = grid.image_of(&in_scanner)?;
        let [column, row] = grid.cell_at(place)?;
        let half = ((self.footprint_mm / grid.cell_mm(depth_mm)).ceil() as usize).clamp(1, MAX_HALF_WIDTH);
        let (first, last) = (column.saturating_sub(half), (column + half).min(grid.size.columns - 1));
        let mut footprint = MeasuredFootprint::default();
        for row in row.saturating_sub(half)..=(row + half).min(grid.size.rows - 1) {
            for column in first..=last {
                let cell = grid.number([column, row]);
                if !self.distances.found[cell].is_by_foot {
                    self.take(cell, [&at, &in_scanner, &eye_mm], (patch.face, &patch.normal), &mut footprint);
                }
            }
            for cell in self.distances.with_feet_in(grid.number([first, row])..=grid.number([last, row])) {
                self.take(cell, [&at, &in_scanner, &eye_mm], (patch.face, &patch.normal), &mut footprint);
            }
        }
        let MeasuredFootprint { compared, off, turned } = footprint;
        (compared.points + off + turned.points > 0).then_some(footprint)
    }

    /// Takes the point of a cell, if its place on its face is within the footprint of the sample at `at` in the part's frame and
    /// `in_scanner` in the scanner's; `eye_mm` is the left camera's optical centre.
    fn take(
        &self,
        cell: usize,
        [at, in_scanner, eye_mm]: [&Point3<f64>; 3],
        (own_face, normal): (u32, &Vector3<f64>),
        into: &mut MeasuredFootprint,
    ) {
        let Found { face, distance_mm, usage, is_by_foot } = self.distances.found[cell];
        if face == NO_FACE {
            return;
        }
        let distance = f64::from(distance_mm);
        let Some(point) = self.placed.scan.scanner_cloud.points_mm.get(cell) else { return };
        let point = Point3::from(point.map(f64::from));
        let face_normal = if face == own_face { *normal } else { self.normals[face as usize] };
        let is_of_side = face_normal.dot(normal) >= SAME_SIDE_COS;
        let is_far = distance.abs() > self.footprint_mm && !is_by_foot;
        // The foot is no farther from the point than the distance: most cells of the square around the disc end here.
        if !is_far && (point - in_scanner).norm_squared() > (self.footprint_mm + distance.abs() + ROUNDING_MM).powi(2) {
            return;
        }
        let point = self.placed.part_from_scanner.point(&point);
        // The foot of the point on the face stands for where its ray meets it: both are the same but for the deviation itself. Far from
        // the face, the foot lies elsewhere.
        let met = if is_far {
            let along = point - eye_mm;
            point - along * (distance / face_normal.dot(&along))
        } else {
            point - face_normal * distance
        };
        if (met - at).norm() <= self.footprint_mm && is_of_side {
            match usage {
                PointUse::Compared => into.compared.take(distance),
                PointUse::Turned => into.turned.take(distance),
                PointUse::Off => into.off += 1,
                PointUse::Beside => {}
            }
        }
    }
}
