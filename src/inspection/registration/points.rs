//! Points of a view that are matched: every so many of those that are there.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::inspection::ViewScan;

/// Neighbours along row and column between which elements of the surface lie: right, below, left, above.
const AROUND: [[isize; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

/// Normals of the elements of the surface around a point, scanner frame, either way: triangles with two of its neighbours in the camera's
/// grid. None where one of them is missing.
pub(super) type Elements = [Option<Vector3<f64>>; AROUND.len()];

/// Some points of a view, scanner frame.
pub(super) struct ViewPoints {
    pub(super) part_from_scanner: Isometry3<f64>,
    pub(super) points_mm: Vec<Point3<f64>>,
    /// Surface around each point; empty where it was not asked for, or the cloud has no grid.
    pub(super) elements: Vec<Elements>,
    /// Points that the view has, of which these are some.
    pub(super) there: usize,
}

impl ViewPoints {
    /// Some of the points, spread evenly over the view, no more than so many: of an organised cloud the cells of a coarser grid.
    pub(super) fn of(scan: &ViewScan, max_points: usize) -> Self {
        let (chosen, there, _) = chosen(scan, max_points);
        let points_mm = chosen.into_iter().map(|(_, point)| point).collect();
        Self { part_from_scanner: *scan.part_from_scanner.isometry(), points_mm, elements: Vec::new(), there }
    }

    /// Chooses points as [`Self::of`] does, with the surface around them, to neighbours as far away as those that are chosen.
    pub(super) fn with_elements(scan: &ViewScan, max_points: usize) -> Self {
        let (chosen, there, reach) = chosen(scan, max_points);
        let is_organised = scan.scanner_cloud.grid.is_some();
        let elements =
            chosen.iter().filter(|_| is_organised).map(|(number, point)| around(scan, *number, point, reach)).collect();
        let points_mm = chosen.into_iter().map(|(_, point)| point).collect();
        Self { part_from_scanner: *scan.part_from_scanner.isometry(), points_mm, elements, there }
    }
}

/// Points that are chosen, with their numbers; points that are there; and the step of the coarser grid.
fn chosen(scan: &ViewScan, max_points: usize) -> (Vec<(usize, Point3<f64>)>, usize, usize) {
    let cloud = &scan.scanner_cloud;
    let there = cloud.finite().count();
    let every = there.div_ceil(max_points.max(1)).max(1);
    match cloud.grid {
        Some(grid) if every > 1 => {
            let step = (1..).find(|step: &usize| step * step >= every).unwrap_or(1);
            let on_grid =
                |number: usize| (number % grid.columns).is_multiple_of(step) && (number / grid.columns).is_multiple_of(step);
            (cloud.finite().filter(|(number, _)| on_grid(*number)).collect(), there, step)
        }
        _ => (cloud.finite().step_by(every).collect(), there, 1),
    }
}

/// Elements around a point of an organised cloud, between neighbours so many cells away.
fn around(scan: &ViewScan, number: usize, point_mm: &Point3<f64>, reach: usize) -> Elements {
    let cloud = &scan.scanner_cloud;
    let Some(grid) = cloud.grid else { return Elements::default() };
    let offsets = AROUND.map(|[right, down]| {
        let column =
            (number % grid.columns).checked_add_signed(right * reach as isize).filter(|column| *column < grid.columns)?;
        let row = (number / grid.columns).checked_add_signed(down * reach as isize)?;
        let neighbour = Point3::from(cloud.points_mm.get(row * grid.columns + column)?.map(f64::from));
        Some(neighbour - point_mm).filter(|offset| offset.norm().is_finite())
    });
    std::array::from_fn(|place| {
        let (one, next) = (offsets[place]?, offsets[(place + 1) % AROUND.len()]?);
        one.cross(&next).try_normalize(0.0)
    })
}
