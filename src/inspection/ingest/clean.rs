//! Removes points that are no measurement of the part: beyond the depth, mixed pixels at edges, islands of a few pixels, plate and
//! fixtures. Each is counted by its reason. Statistical removal of outliers is not used: it deletes true thin edges.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::IngestWorld;
use super::frames::{DEPTH_MARGIN_MM, PlannedCapture};
use crate::cell::closed_list;
use crate::geometry::{Aabb, CloudGrid, NearestFace, Part, Plate, PointCloud, Pose, ScannerFrame};

/// Cells of a run by which a wall is told from mixed pixels. Between two surfaces a run of evenly mixed pixels, one or two wide, has two or
/// three steps in depth, and next to none beside them; this one has four.
const RUN: usize = 5;
/// Share by which steps within a run may differ from their mean, and least share of it that the first and the last one have, whose cells may
/// lie beyond the wall's end. Not from a source: noise is some hundredths of a step of 3 mm, and the rest is left to walls that bend.
const ALIKE: f64 = 0.25;
const MIN_OUTER: f64 = 0.25;

/// Fewest points of which most may be islands without being removed: fewer are specks. Not from a source: five islands' worth.
const MIN_SPARSE_POINTS: usize = 100;
/// Share of all points that are no islands, and share of the neighbours of these that are occupied, from which on they are a surface and
/// the islands its specks. Not from a source: pieces of a cloud with random gaps, where most are islands, have two thirds of theirs.
const MIN_SURFACE: f64 = 0.25;
const MIN_SURFACE_FILL: f64 = 0.75;

closed_list! {
    /// Reason for which points are removed.
    pub enum RemovedBecause {
        /// Beyond the working depth by more than 20 mm.
        Depth = "depth",
        /// Every triangle with its neighbours is seen more flatly than 85°, or it hangs between a nearer and a farther neighbour and is
        /// not on a wall that continues over five pixels.
        MixedPixel = "mixed_pixel",
        /// One of fewer than 20 points that hang together. Where most of a view's points are such ones, and the others no surface, the
        /// view is sparse and keeps them.
        Isolated = "isolated",
        /// The point lies on the plate or below it.
        Plate = "plate",
        /// The point lies on a fixture.
        Fixture = "fixture",
        /// Held by triangles alone that close a hole.
        FilledHole = "filled_hole",
        /// Outside the left camera's image.
        OutsideImage = "outside_image",
    }
}

/// Numbers of points that were removed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Removed {
    /// Points by reason; reasons that removed none are left out.
    pub by_reason: BTreeMap<RemovedBecause, usize>,
    /// Cells of an organised cloud, ascending, whose points were taken for mixed or isolated, or for the plate's where the part lies.
    pub cells: Vec<u32>,
    /// Cells of an organised cloud, ascending, whose points were taken for a fixture's.
    pub fixture_cells: Vec<u32>,
    /// Space over the plate in which points were taken for the plate's; `None` where the plate's place is not known.
    pub plate: Option<PlateZone>,
    /// True if most points have none beside them in the grid, and the others are no surface: islands were kept then.
    pub is_sparse: bool,
    /// True if the cloud came without the camera's grid, and its points were put into cells: an empty cell may lie between points.
    pub is_projected: bool,
}

/// Half space of a view's scanner frame whose points were taken for the plate's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateZone {
    /// Unit normal of the plate, which points away from it, scanner frame.
    pub normal: Vector3<f64>,
    /// Upper end along the normal, from the origin of the scanner frame, mm.
    pub height_mm: f64,
}

impl PlateZone {
    fn new(plate_from_scanner: &Pose<Plate, ScannerFrame>, cut_mm: f64) -> Self {
        let scanner_from_plate = plate_from_scanner.inverse();
        let normal = scanner_from_plate.direction(&Vector3::z());
        Self { normal, height_mm: normal.dot(&scanner_from_plate.origin_mm().coords) + cut_mm }
    }

    /// Returns true if a point of the scanner's frame lies in the zone, or above it by less than a margin.
    #[must_use]
    pub fn holds(&self, scanner_mm: &Point3<f64>, margin_mm: f64) -> bool {
        self.normal.dot(&scanner_mm.coords) < self.height_mm + margin_mm
    }
}

impl Removed {
    pub(super) fn count(&mut self, reason: RemovedBecause, points: usize) {
        if points > 0 {
            *self.by_reason.entry(reason).or_default() += points;
        }
    }

    /// Points that were removed for any reason.
    #[must_use]
    pub fn total(&self) -> usize {
        self.by_reason.values().sum()
    }
}

/// Knobs of the cleaning.
#[derive(Clone, Debug, PartialEq)]
pub struct CleanOptions {
    /// Points higher above the plate are kept, mm; of a part lower than twice that, those above half its height.
    pub plate_mm: f64,
    /// Points farther from a fixture are kept, mm.
    pub fixture_mm: f64,
    /// Incidence, degrees, above which a triangle between neighbours is an edge's.
    pub mixed_deg: f64,
    /// Step in depth between neighbours that is an edge, mm.
    pub step_mm: f64,
    /// Fewer points that hang together are removed, unless most of a view's are such ones.
    pub min_island: usize,
}

impl Default for CleanOptions {
    /// 0.5 mm above the plate: twice the usual error of a pose. 85°, 3 mm and 20 pixels are those that held on simulated scans.
    fn default() -> Self {
        Self { plate_mm: 0.5, fixture_mm: 1.0, mixed_deg: 85.0, step_mm: 3.0, min_island: 20 }
    }
}

/// Cleans an organised cloud.
pub(super) fn clean(
    mut cloud: PointCloud,
    capture: &PlannedCapture,
    world: &IngestWorld<'_>,
    options: &CleanOptions,
    removed: &mut Removed,
) -> PointCloud {
    let Some(grid) = cloud.grid else { return cloud };
    let depth = (world.scanner.near_mm - DEPTH_MARGIN_MM) as f32..=(world.scanner.far_mm + DEPTH_MARGIN_MM) as f32;
    remove(&mut cloud, removed, RemovedBecause::Depth, |_, point| !depth.contains(&point[2]));
    cut_surroundings(&mut cloud, capture, world, options, removed);
    let mixed = mixed_pixels(&cloud, grid, options);
    remove(&mut cloud, removed, RemovedBecause::MixedPixel, |cell, _| mixed[cell]);
    let island = islands(&cloud, grid, options);
    let (points, of_islands) = (cloud.finite().count(), island.iter().filter(|is_small| **is_small).count());
    removed.is_sparse = points >= MIN_SPARSE_POINTS && 2 * of_islands > points && !has_surface(&cloud, grid, &island);
    if !removed.is_sparse {
        remove(&mut cloud, removed, RemovedBecause::Isolated, |cell, _| island[cell]);
    }
    cloud
}

/// Returns true if points that are of no island are many, and lie close in the grid.
fn has_surface(cloud: &PointCloud, grid: CloudGrid, island: &[bool]) -> bool {
    let is_there = |cell: usize| !cloud.points_mm[cell][0].is_nan();
    let (mut points, mut others, mut neighbours, mut occupied) = (0_usize, 0_usize, 0_usize, 0_usize);
    for cell in (0..cloud.points_mm.len()).filter(|cell| is_there(*cell)) {
        points += 1;
        if island[cell] {
            continue;
        }
        others += 1;
        let right = (cell % grid.columns + 1 < grid.columns).then_some(cell + 1);
        let below = (cell / grid.columns + 1 < grid.rows).then_some(cell + grid.columns);
        for beside in right.into_iter().chain(below) {
            neighbours += 1;
            occupied += usize::from(is_there(beside));
        }
    }
    others as f64 >= MIN_SURFACE * points as f64 && occupied as f64 >= MIN_SURFACE_FILL * neighbours as f64
}

fn remove(cloud: &mut PointCloud, removed: &mut Removed, reason: RemovedBecause, wanted: impl Fn(usize, &[f32; 3]) -> bool) {
    let is_judgement = matches!(reason, RemovedBecause::MixedPixel | RemovedBecause::Isolated);
    let is_fixture = reason == RemovedBecause::Fixture;
    let mut count = 0;
    for (cell, point) in cloud.points_mm.iter_mut().enumerate() {
        if !point[0].is_nan() && wanted(cell, point) {
            *point = [f32::NAN; 3];
            count += 1;
            removed.cells.extend(is_judgement.then_some(cell as u32));
            removed.fixture_cells.extend(is_fixture.then_some(cell as u32));
        }
    }
    removed.count(reason, count);
    removed.cells.sort_unstable();
    removed.fixture_cells.sort_unstable();
}

/// Removes what lies on the plate or on a fixture.
fn cut_surroundings(
    cloud: &mut PointCloud,
    capture: &PlannedCapture,
    world: &IngestWorld<'_>,
    options: &CleanOptions,
    removed: &mut Removed,
) {
    let Some(part_from_plate) = capture.part_from_plate else { return };
    let plate_from_scanner = part_from_plate.inverse() * capture.part_from_scanner;
    let in_plate = |point: &[f32; 3]| plate_from_scanner.point(&Point3::from(point.map(f64::from)));
    let cut = PlateCut::new(world.nearest, part_from_plate, options.plate_mm);
    removed.plate = Some(PlateZone::new(&plate_from_scanner, cut.cut_mm));
    let mut count = 0;
    for (cell, point) in cloud.points_mm.iter_mut().enumerate().filter(|(_, point)| !point[0].is_nan()) {
        let own = in_plate(point);
        if cut.takes(&own) {
            *point = [f32::NAN; 3];
            count += 1;
            removed.cells.extend(cut.is_at_part(&own).then_some(cell as u32));
        }
    }
    removed.count(RemovedBecause::Plate, count);
    for fixture in world.fixtures {
        let nearest = NearestFace::new(fixture);
        let around = fixture.aabb();
        let margin = nalgebra::Vector3::repeat(options.fixture_mm);
        let around = Aabb { min: around.min - margin, max: around.max + margin };
        let on_fixture = |point: &[f32; 3]| {
            let point = in_plate(point);
            around.holds(&point) && nearest.nearest(&point, options.fixture_mm).is_some()
        };
        remove(cloud, removed, RemovedBecause::Fixture, |_, point| on_fixture(point));
    }
}

/// Height up to which points are the plate's, by the part at its planned place.
pub(super) struct PlateCut<'a> {
    nearest: &'a NearestFace<'a>,
    part_from_plate: Pose<Part, Plate>,
    /// Frame of the part, with a margin.
    around: Aabb,
    cut_mm: f64,
    /// True if the part faces up so low that its own points lie within the cut.
    is_low: bool,
}

impl<'a> PlateCut<'a> {
    /// Half of the part's height at most: the part's top and the plate are then equally far from the cut.
    pub(super) fn new(nearest: &'a NearestFace<'a>, part_from_plate: Pose<Part, Plate>, plate_mm: f64) -> Self {
        let (mesh, plate_from_part) = (nearest.mesh(), part_from_plate.inverse());
        let height_mm = |corner: &Point3<f64>| plate_from_part.point(corner).z;
        let top_mm = mesh.vertices_mm.iter().map(height_mm).fold(f64::NEG_INFINITY, f64::max);
        let cut_mm = if top_mm > 0.0 { plate_mm.min(0.5 * top_mm) } else { plate_mm };
        let (around, margin) = (mesh.aabb(), nalgebra::Vector3::repeat(plate_mm));
        let around = Aabb { min: around.min - margin, max: around.max + margin };
        let mut cut = Self { nearest, part_from_plate, around, cut_mm, is_low: false };
        let reaches = |face: usize| mesh.corners(face).iter().any(|corner| height_mm(corner) < 2.0 * cut_mm);
        cut.is_low = (0..mesh.faces.len()).any(|face| reaches(face) && cut.faces_up(face));
        cut
    }

    /// Returns true if a triangle faces up by more than 45°.
    fn faces_up(&self, face: usize) -> bool {
        let normal = self.nearest.mesh().scaled_normal(face);
        self.part_from_plate.inverse().direction(&normal).z > std::f64::consts::FRAC_1_SQRT_2 * normal.norm()
    }

    /// Returns true if a point is the plate's: within the cut, and not above a triangle of the part that faces up, no farther from it than
    /// the cut.
    pub(super) fn takes(&self, in_plate: &Point3<f64>) -> bool {
        let is_part = || {
            let found = self.nearest.nearest(&self.part_from_plate.point(in_plate), self.cut_mm);
            found.is_some_and(|found| found.is_inside && self.faces_up(found.face as usize))
        };
        in_plate.z < self.cut_mm && !(self.is_low && is_part())
    }

    fn is_at_part(&self, in_plate: &Point3<f64>) -> bool {
        self.around.holds(&self.part_from_plate.point(in_plate))
    }
}

/// Directions in the grid: cells to the right and down.
const ALONG_ROW: [isize; 2] = [1, 0];
const ALONG_COLUMN: [isize; 2] = [0, 1];

/// Inverse depths of cells in a line, of which the first is so many away from a cell; `None` where no point is.
fn inverse_depths<const COUNT: usize>(
    cloud: &PointCloud,
    grid: CloudGrid,
    cell: usize,
    [right, down]: [isize; 2],
    first: isize,
) -> [Option<f64>; COUNT] {
    std::array::from_fn(|place| {
        let away = first + place as isize;
        let column = (cell % grid.columns).checked_add_signed(away * right).filter(|column| *column < grid.columns)?;
        let row = (cell / grid.columns).checked_add_signed(away * down).filter(|row| *row < grid.rows)?;
        let point = cloud.points_mm[row * grid.columns + column];
        (!point[0].is_nan()).then(|| 1.0 / f64::from(point[2]))
    })
}

/// Returns true if five inverse depths are those of one wall: on a plane they change by equal steps from pixel to pixel, whatever its
/// incidence and however coarse the grid.
fn is_run(inverse_depths: &[Option<f64>], min_outer: f64) -> bool {
    let [Some(a), Some(b), Some(c), Some(d), Some(e)] = inverse_depths else { return false };
    let mean = 0.5 * (d - b);
    let is_like = |step: f64, min: f64| (min..=1.0 + ALIKE).contains(&(step / mean));
    is_like(b - a, min_outer) && is_like(c - b, 1.0 - ALIKE) && is_like(d - c, 1.0 - ALIKE) && is_like(e - d, min_outer)
}

/// Returns true if a cell's point lies on a wall that continues over a run of cells; at the end of one, only if all its steps are alike.
fn continues(cloud: &PointCloud, grid: CloudGrid, cell: usize, along: [isize; 2]) -> bool {
    let line: [Option<f64>; 2 * RUN - 1] = inverse_depths(cloud, grid, cell, along, 1 - RUN as isize);
    line.windows(RUN).enumerate().any(|(start, run)| {
        let is_end = start == 0 || start == RUN - 1;
        is_run(run, if is_end { 1.0 - ALIKE } else { MIN_OUTER })
    })
}

/// Returns true if a cell and the next one lie on one wall.
fn is_one_wall(cloud: &PointCloud, grid: CloudGrid, cell: usize, along: [isize; 2]) -> bool {
    let line: [Option<f64>; 2 * RUN - 2] = inverse_depths(cloud, grid, cell, along, 2 - RUN as isize);
    line.windows(RUN).any(|run| is_run(run, MIN_OUTER))
}

/// Cells whose point lies on no surface: it is a mixture of two. They are found by incidence (for such tests see P. Tang, D. Huber,
/// B. Akinci, "A comparative analysis of depth-discontinuity and mixed-pixel detection algorithms", 3DIM 2007), and by depths between those
/// of both neighbours. Points of a coarse grid on a steep wall have such depths too, but continue in the direction in which depths change
/// most; that rule is not from a source.
pub(super) fn mixed_pixels(cloud: &PointCloud, grid: CloudGrid, options: &CleanOptions) -> Vec<bool> {
    let max_cos = options.mixed_deg.to_radians().cos();
    let at = |column: Option<usize>, row: Option<usize>| {
        let (column, row) = (column.filter(|column| *column < grid.columns)?, row.filter(|row| *row < grid.rows)?);
        let point = cloud.points_mm[row * grid.columns + column];
        (!point[0].is_nan()).then(|| Point3::from(point.map(f64::from)))
    };
    let is_mixed = |cell: usize| {
        let (column, row) = (cell % grid.columns, cell / grid.columns);
        let Some(own) = at(Some(column), Some(row)) else { return false };
        let [left, right] = [at(column.checked_sub(1), Some(row)), at(Some(column + 1), Some(row))];
        let [above, below] = [at(Some(column), row.checked_sub(1)), at(Some(column), Some(row + 1))];
        let hangs = |a: Option<Point3<f64>>, b: Option<Point3<f64>>| {
            a.zip(b).is_some_and(|(a, b)| {
                let (near, far) = (a.z.min(b.z), a.z.max(b.z));
                own.z - near > options.step_mm && far - own.z > options.step_mm
            })
        };
        if hangs(left, right) || hangs(above, below) {
            let rise_mm = |a: Option<Point3<f64>>, b: Option<Point3<f64>>| a.zip(b).map_or(0.0, |(a, b)| (a.z - b.z).abs());
            let along = if rise_mm(left, right) >= rise_mm(above, below) { ALONG_ROW } else { ALONG_COLUMN };
            if !continues(cloud, grid, cell, along) {
                return true;
            }
        }
        let (mut triangles, mut flat) = (0, 0);
        for (a, b) in [(left, above), (above, right), (right, below), (below, left)] {
            if let Some((a, b)) = a.zip(b) {
                let normal = (a - own).cross(&(b - own));
                let cos = normal.dot(&own.coords).abs() / (normal.norm() * own.coords.norm()).max(f64::MIN_POSITIVE);
                triangles += 1;
                flat += usize::from(cos < max_cos);
            }
        }
        triangles > 0 && flat == triangles
    };
    (0..cloud.points_mm.len()).map(is_mixed).collect()
}

/// Cells of islands that are too small. Neighbours hang together where their depths differ by less than a step, or on one wall.
pub(super) fn islands(cloud: &PointCloud, grid: CloudGrid, options: &CleanOptions) -> Vec<bool> {
    let mut is_small = vec![false; cloud.points_mm.len()];
    let mut is_seen = vec![false; cloud.points_mm.len()];
    let (mut island, mut waiting) = (Vec::new(), Vec::new());
    for first in 0..cloud.points_mm.len() {
        if is_seen[first] || cloud.points_mm[first][0].is_nan() {
            continue;
        }
        is_seen[first] = true;
        island.clear();
        waiting.push(first);
        while let Some(cell) = waiting.pop() {
            if island.len() < options.min_island {
                island.push(cell);
            }
            let (column, row) = (cell % grid.columns, cell / grid.columns);
            let neighbours = [
                (column > 0).then(|| (cell - 1, ALONG_ROW)),
                (column + 1 < grid.columns).then_some((cell + 1, ALONG_ROW)),
                (row > 0).then(|| (cell - grid.columns, ALONG_COLUMN)),
                (row + 1 < grid.rows).then_some((cell + grid.columns, ALONG_COLUMN)),
            ];
            for (next, along) in neighbours.into_iter().flatten() {
                let step = f64::from((cloud.points_mm[next][2] - cloud.points_mm[cell][2]).abs());
                let hangs_together = || step <= options.step_mm || is_one_wall(cloud, grid, cell.min(next), along);
                if !is_seen[next] && hangs_together() {
                    is_seen[next] = true;
                    waiting.push(next);
                }
            }
        }
        if island.len() < options.min_island {
            island.iter().for_each(|cell| is_small[*cell] = true);
        }
    }
    is_small
}
