//! Files that end before the view does: beyond one side of the box around a scan's points lie many samples that face all devices
//! well, and next to none has a point. Points of a surface that deviates count as any others. In a thinned cloud few cells have a point
//! anywhere: beyond a side so few have to be expected by their share within the box that chance does not leave them out.

use crate::inspection::coverage::{GriddedCloud, Return};

/// Incidence up to which a sample has no reason of its own not to return, radians (50°): thesis §3.2.1.3 has noise begin at 35°.
const FAIR_RAD: f64 = 50.0 * std::f64::consts::PI / 180.0;
/// Fewest fair samples beyond a side that make a cut, and their share of all fair ones.
const MIN_SAMPLES: usize = 20;
const MIN_SHARE: f64 = 0.01;
/// Cells by which a sample lies outside.
const SLACK_CELLS: f64 = 2.0;
/// Fewest points in a column or a row that the file has it for: stray ones far out would hide a cut.
const MIN_LINE_POINTS: usize = 3;
/// Min number of cells beyond a side that would have a point if as many had as within the box, and the share of them that may have one:
/// our choice. By chance no more than 3 of 12 are met in one of 400 cases.
const MIN_EXPECTED: f64 = 12.0;
const MAX_FOUND: f64 = 0.25;

/// Sides at which a file ends: columns from and to, rows from and to, in cells. Sides that are not cut lie at infinity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FileBounds([[f64; 2]; 2]);

impl FileBounds {
    /// Finds the cut sides of a scan from its planned samples, each with its place in cells, from the cells that have a point, and from those,
    /// ascending, of which it was taken out: the file had one there.
    pub(super) fn find(returns: &[(Return, [f64; 2])], cloud: &GriddedCloud<'_>, removed: &[u32]) -> Self {
        let mut bounds = [[f64::NEG_INFINITY, f64::INFINITY]; 2];
        let fair = |pair: &&(Return, [f64; 2])| pair.0.is_expected && pair.0.worst_incidence().1 <= FAIR_RAD;
        let fair: Vec<&(Return, [f64; 2])> = returns.iter().filter(fair).collect();
        let needed = MIN_SAMPLES.max((MIN_SHARE * fair.len() as f64) as usize);
        let around = box_of(cloud);
        let cells = FairCells::of(&fair, cloud, removed);
        let rate = cells.rate_within(&around);
        for (axis, (bounds, [first, last])) in bounds.iter_mut().zip(around).enumerate() {
            if first > last {
                continue;
            }
            let is_cut = |is_beyond: &dyn Fn(f64) -> bool| {
                let samples = fair.iter().filter(|(_, place)| is_beyond(place[axis])).count();
                samples >= needed && cells.lack_points(rate, |middle| is_beyond(middle[axis]))
            };
            if is_cut(&|place| place < first - SLACK_CELLS) {
                bounds[0] = first;
            }
            if is_cut(&|place| place > last + SLACK_CELLS) {
                bounds[1] = last;
            }
        }
        Self(bounds)
    }

    /// Returns true if a place, in cells, lies outside.
    pub(super) fn leaves_out(&self, place: [f64; 2]) -> bool {
        self.0.iter().zip(place).any(|([first, last], place)| place < *first || place > *last)
    }
}

/// Cells that hold a fair sample: the place of the middle of each, in cells, and whether the file has a point there.
struct FairCells(Vec<([f64; 2], bool)>);

impl FairCells {
    fn of(fair: &[&(Return, [f64; 2])], cloud: &GriddedCloud<'_>, removed: &[u32]) -> Self {
        let is_imaged = |place: &[f64; 2]| place.iter().all(|place| place.is_finite());
        let places = fair.iter().map(|(_, place)| *place).filter(is_imaged);
        let mut cells: Vec<[i64; 2]> = places.map(|place| place.map(|place| place.floor() as i64)).collect();
        cells.sort_unstable();
        cells.dedup();
        let with_point = |cell: [i64; 2]| {
            let middle = cell.map(|place| place as f64 + 0.5);
            let was_there = |cell: [usize; 2]| removed.binary_search(&(cloud.grid().number(cell) as u32)).is_ok();
            (middle, cloud.grid().cell_at(middle).is_some_and(|cell| cloud.point(cell).is_some() || was_there(cell)))
        };
        Self(cells.into_iter().map(with_point).collect())
    }

    /// Number of the cells that a rule holds of, and of those of them that have a point.
    fn count(&self, holds: impl Fn(&[f64; 2]) -> bool) -> [f64; 2] {
        let chosen = || self.0.iter().filter(|(middle, _)| holds(middle));
        [chosen().count() as f64, chosen().filter(|(_, has_point)| *has_point).count() as f64]
    }

    /// Share of the cells within a box that have a point.
    fn rate_within(&self, around: &[[f64; 2]; 2]) -> f64 {
        let [cells, found] =
            self.count(|middle| around.iter().zip(middle).all(|([first, last], at)| (first..=last).contains(&at)));
        found / cells.max(1.0)
    }

    /// Returns true if far fewer of the cells that a rule holds of have a point than by a rate, and more than by chance.
    fn lack_points(&self, rate: f64, holds: impl Fn(&[f64; 2]) -> bool) -> bool {
        let [cells, found] = self.count(holds);
        rate * cells >= MIN_EXPECTED && found <= MAX_FOUND * rate * cells
    }
}

/// Box around the columns and rows of a scan that have points, but for stray ones, in cells: columns from and to, rows from and to.
/// Without such columns or rows each begins behind its end.
fn box_of(cloud: &GriddedCloud<'_>) -> [[f64; 2]; 2] {
    let (columns, rows) = (cloud.grid().size.columns, cloud.grid().size.rows);
    let mut points = [vec![0_usize; columns], vec![0_usize; rows]];
    for cell in (0..cloud.grid().cells()).map(|number| [number % columns, number / columns]) {
        if cloud.point(cell).is_some() {
            points.iter_mut().zip(cell).for_each(|(points, place)| points[place] += 1);
        }
    }
    points.map(|points| {
        let has = |points: &usize| *points >= MIN_LINE_POINTS;
        let (first, last) = (points.iter().position(has), points.iter().rposition(has));
        [first.map_or(f64::INFINITY, |first| first as f64), last.map_or(f64::NEG_INFINITY, |last| last as f64 + 1.0)]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::PerDevice;
    use crate::geometry::PointCloud;
    use crate::inspection::PixelGrid;
    use crate::inspection::shots::unit;
    use crate::planning::ids::SampleId;
    use crate::testing::nominal_scanner;

    /// Cells of so many pixels.
    const STEP_PX: u32 = 16;

    /// Bounds of a scan of which samples face all devices, and points lie, in the cells that these rules hold of, by column and row.
    fn bounds_of(has_sample: &dyn Fn([usize; 2]) -> bool, has_point: &dyn Fn([usize; 2]) -> bool) -> FileBounds {
        let scanner = nominal_scanner();
        let grid = PixelGrid::new(&scanner, STEP_PX);
        let at = |number: usize| [number % grid.size.columns, number / grid.size.columns];
        let pair = |number: usize| Return {
            view: 0,
            sample: SampleId::at(number),
            is_returned: has_point(at(number)),
            is_expected: true,
            incidence_rad: PerDevice { left: 0.1, right: 0.1, projector: 0.1 },
            mirror_rad: 1.0,
            depth_mm: 400.0,
        };
        let seen = (0..grid.cells()).filter(|number| has_sample(at(*number)));
        let pairs: Vec<(Return, [f64; 2])> = seen.map(|number| (pair(number), middle(at(number)))).collect();
        let point = |number: usize| {
            let point = grid.centre_mm() + grid.ray(number) * 400.0;
            if has_point(at(number)) { [point.x as f32, point.y as f32, point.z as f32] } else { [f32::NAN; 3] }
        };
        let cloud = PointCloud { points_mm: (0..grid.cells()).map(point).collect(), grid: Some(grid.size) };
        FileBounds::find(&pairs, &GriddedCloud::new(&scanner, &cloud), &[])
    }

    fn middle(cell: [usize; 2]) -> [f64; 2] {
        cell.map(|place| place as f64 + 0.5)
    }

    fn size() -> [usize; 2] {
        let size = PixelGrid::new(&nominal_scanner(), STEP_PX).size;
        [size.columns, size.rows]
    }

    /// A wall that deviates by more than the tolerance was told as cut off, though the file has all of its points.
    #[test]
    fn a_file_ends_where_its_points_do_and_not_where_the_surface_begins_to_deviate() {
        let [columns, _] = size();
        let half = columns / 2;
        let bounds = |has_point: &dyn Fn([usize; 2]) -> bool| bounds_of(&|_| true, has_point);
        let beyond = middle([columns - 1, 0]);
        assert!(!bounds(&|_| true).leaves_out(beyond), "the surface deviates");
        let cut = bounds(&|[column, _]| column < half);
        assert!(cut.leaves_out(beyond) && !cut.leaves_out(middle([half - 1, 0])), "{cut:?}");
        assert!(!bounds(&|_| false).leaves_out(beyond), "no points at all");
        // One point far out hid the cut.
        let with_stray = bounds(&|cell| cell[0] < half || cell == [columns - 1, 5]);
        assert_eq!(with_stray, cut);
    }

    /// The tips of a surface were told as cut off, since few of their cells have a point in a thinned cloud.
    #[test]
    fn a_thinned_cloud_ends_where_far_fewer_cells_have_a_point_than_elsewhere_and_not_where_its_lines_are_short() {
        let [columns, rows] = size();
        // A square on its corner.
        let is_seen = |cell: [usize; 2]| {
            let off_middle = [(cell[0], columns), (cell[1], rows)].map(|(at, all)| 2.0 * (at as f64 + 0.5) / all as f64 - 1.0);
            off_middle.iter().map(|off| off.abs()).sum::<f64>() < 0.8
        };
        let (seed, half) = (7_000_000, columns / 2);
        for share in [0.05, 0.1, 0.25] {
            let is_kept = |cell: [usize; 2]| is_seen(cell) && unit(seed + (cell[1] * columns + cell[0]) as u64) < share;
            let whole = bounds_of(&is_seen, &is_kept);
            assert_eq!(whole, FileBounds([[f64::NEG_INFINITY, f64::INFINITY]; 2]), "{share} of the points");
            let cut = bounds_of(&is_seen, &|cell| is_kept(cell) && cell[0] < half);
            assert!(cut.leaves_out(middle([half + 4, rows / 2])), "{share} of the points: {cut:?}");
            assert!(!cut.leaves_out(middle([half - 8, rows / 2])), "{share} of the points: {cut:?}");
        }
    }
}
