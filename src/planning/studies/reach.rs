//! Layouts of robot, table and scanner: how much of the viewing hemisphere each reaches, limits and
//! collisions included.
//!
//! The grid is one of equal angles, whose directions lie closer together the nearer they are to straight above; the share of the
//! hemisphere therefore weights each direction by the solid angle of its cell of the grid.
//!
//! A cube stands in the middle of the plate; the scanner looks at its centre from half its edge + F, baseline level, from
//! [`ELEVATIONS`] angles between straight above and level and [`AZIMUTHS`] azimuths. The table stands still in this count: a
//! turning one brings every azimuth round, so one azimuth is enough for an elevation, and the directions say how much choice
//! is left. Up is the direction of the table's axis, whichever way the foot is turned: it may stand, hang from a ceiling or lean. The
//! foot moves along the level line to that axis, the table up and down; obstacles and floor stay where they are.
//! One layout costs about a tenth of a second.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{Isometry3, Point3, Rotation3, UnitQuaternion, Vector3};

use crate::cell::collision::MIN_CLEARANCE_MM;
use crate::cell::{Body, Cell, CollisionScene, HousingFace};
use crate::geometry::{Aabb, Flange, Mesh, Part, Pose, ScannerFrame, Table, parallel};
use crate::planning::context::{Cancelled, Context};
use crate::planning::stations::solve_some;

/// Angles from straight above to level, 5° apart.
pub const ELEVATIONS: usize = 19;
/// Azimuths, 15° apart.
pub const AZIMUTHS: usize = 24;
/// Distance from the table's axis within which the foot stands on it, mm.
const ON_AXIS_MM: f64 = 1e-6;
/// Length of the level part of a unit vector below which that has no direction.
const MIN_LEVEL: f64 = 1e-3;
/// Range of the table while it stands still, radians.
const STILL_RAD: f64 = 1e-5;

/// Layouts to compare.
#[derive(Clone, Debug)]
pub struct Layouts {
    /// Edge of the cube on the plate, mm.
    pub part_mm: f64,
    /// Distances of the robot's foot from the table's axis, at right angles to it, mm.
    pub foot_mm: Vec<f64>,
    /// Heights of the plate above the foot along the table's axis, mm; negative where the foot is above the plate.
    pub table_mm: Vec<f64>,
    /// Ways to bolt the scanner to the flange.
    pub mountings: Vec<Mounting>,
    /// Clearance between bodies, mm.
    pub clearance_mm: f64,
}

/// A way to bolt the scanner to the flange.
#[derive(Clone, Debug, PartialEq)]
pub struct Mounting {
    /// Face of the scanner's housing on the flange; `None` as the cell has it.
    pub face: Option<HousingFace>,
    /// The hand-eye pose that it makes.
    pub flange_from_scanner: Pose<Flange, ScannerFrame>,
}

/// Views that are reached without collision.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Reached {
    /// Elevations with at least one azimuth, of [`ELEVATIONS`]: what a turning table sees.
    pub elevations: usize,
    /// Share of the hemisphere's solid angle that is seen while the table stands still, 0 to 1: the solid angles of the grid
    /// cells around the directions reached, over that of the hemisphere.
    pub hemisphere_share: f64,
    /// Number of directions, of [`ELEVATIONS`] · [`AZIMUTHS`], that are seen while the table stands still. It counts points of a
    /// grid of equal angles, dense near straight above, and is no measure of the hemisphere; that is `hemisphere_share`.
    pub directions: usize,
}

/// One layout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    /// Index of the mounting.
    pub mounting: usize,
    /// Distance of the foot from the table's axis, at right angles to it, mm.
    pub foot_mm: f64,
    /// Height of the plate above the foot along the table's axis, mm; negative where the foot is above the plate.
    pub table_mm: f64,
    /// `None` where the arm at home is closer to something than 1 mm.
    pub reached: Option<Reached>,
}

/// Mountings: as the cell has it, then on each face of the scanner's envelope but the front
/// ([`HousingFace::flange_from_scanner`]).
#[must_use]
pub fn mountings(cell: &Cell, adapter_mm: f64) -> Vec<Mounting> {
    let mut all = vec![Mounting { face: None, flange_from_scanner: cell.flange_from_scanner }];
    let envelope = cell.scanner_bodies.iter().flat_map(Body::corners_mm).fold(Aabb::empty(), |all, corner| all.with(&corner));
    if cell.scanner_bodies.is_empty() {
        return all;
    }
    let faces = [HousingFace::Top, HousingFace::Bottom, HousingFace::Left, HousingFace::Right, HousingFace::Back];
    let on =
        |face: HousingFace| Mounting { face: Some(face), flange_from_scanner: face.flange_from_scanner(&envelope, adapter_mm) };
    all.extend(faces.map(on));
    all
}

/// Every layout: mounting by mounting, height by height, foot by foot.
///
/// # Errors
/// [`Cancelled`].
pub fn reach(cell: &Cell, layouts: &Layouts, ctx: &Context<'_>) -> Result<Vec<Layout>, Cancelled> {
    let Layouts { foot_mm, table_mm, mountings, .. } = layouts;
    let all: Vec<(usize, f64, f64)> = (0..mountings.len())
        .flat_map(|mounting| table_mm.iter().flat_map(move |table| foot_mm.iter().map(move |foot| (mounting, *table, *foot))))
        .collect();
    let done = AtomicUsize::new(0);
    parallel::try_map(&all, |(mounting, table_mm, foot_mm)| {
        let laid = laid_out(cell, &mountings[*mounting].flange_from_scanner, *foot_mm, *table_mm);
        let reached = reached(&laid, layouts, ctx)?;
        ctx.progress(done.fetch_add(1, Ordering::Relaxed) + 1, all.len());
        Ok(Layout { mounting: *mounting, foot_mm: *foot_mm, table_mm: *table_mm, reached })
    })
}

/// The layout that reaches most elevations, then the largest share of the hemisphere; the first of equals.
#[must_use]
pub fn best(layouts: &[Layout]) -> Option<&Layout> {
    let reaching = layouts.iter().filter(|layout| layout.reached.is_some());
    reaching.fold(
        None,
        |best: Option<&Layout>, layout| if best.is_none_or(|best| layout.reached > best.reached) { Some(layout) } else { best },
    )
}

/// Distance of the foot from the table's axis, at right angles to it, and height of the plate above the foot along it, mm.
#[must_use]
pub fn own_layout(cell: &Cell) -> [f64; 2] {
    let (up, height_mm) = up_and_height_mm(cell);
    [level_mm(cell, &up, height_mm).norm(), height_mm]
}

/// Direction of the table's axis in the base frame, and the height of the plate's centre above the foot along it.
fn up_and_height_mm(cell: &Cell) -> (Vector3<f64>, f64) {
    let up = cell.base_from_table.direction(&Vector3::z());
    (up, up.dot(&cell.base_from_table.origin_mm().coords))
}

/// Way from the foot to the table's axis at right angles to it, in the base frame.
fn level_mm(cell: &Cell, up: &Vector3<f64>, height_mm: f64) -> Vector3<f64> {
    cell.base_from_table.origin_mm().coords - up * height_mm
}

/// Direction in which the table stands from the foot, level; one of the foot's own where it stands on the axis.
fn towards_table(cell: &Cell) -> Vector3<f64> {
    let (up, height_mm) = up_and_height_mm(cell);
    let level = |axis: Vector3<f64>| (axis - up * up.dot(&axis)).try_normalize(MIN_LEVEL);
    let way = level_mm(cell, &up, height_mm).try_normalize(ON_AXIS_MM);
    way.or_else(|| level(Vector3::x())).or_else(|| level(Vector3::y())).unwrap_or_else(Vector3::x)
}

fn laid_out(cell: &Cell, flange_from_scanner: &Pose<Flange, ScannerFrame>, foot_mm: f64, table_mm: f64) -> Cell {
    let mut laid = cell.clone();
    let (up, _) = up_and_height_mm(cell);
    let place = towards_table(cell) * foot_mm + up * table_mm;
    laid.base_from_table = Pose::from_parts(place, cell.base_from_table.isometry().rotation);
    laid.flange_from_scanner = *flange_from_scanner;
    let still = &mut laid.turntable.axis;
    (still.min_rad, still.max_rad) = (-STILL_RAD, STILL_RAD);
    laid.home_rad.table_rad = 0.0;
    laid
}

fn reached(cell: &Cell, layouts: &Layouts, ctx: &Context<'_>) -> Result<Option<Reached>, Cancelled> {
    ctx.check()?;
    if CollisionScene::without_part(cell, MIN_CLEARANCE_MM).check(&cell.home_rad).is_some() {
        return Ok(None);
    }
    let half = 0.5 * layouts.part_mm;
    let table_from_part: Pose<Table, Part> = Pose::claim(Isometry3::translation(-half, -half, 0.0));
    let scene = CollisionScene::new(cell, &cube(layouts.part_mm), None, &table_from_part, layouts.clearance_mm);
    let views: Vec<_> = (0..ELEVATIONS)
        .flat_map(|i| {
            (0..AZIMUTHS).map(move |j| (FRAC_PI_2 * i as f64 / (ELEVATIONS - 1) as f64, TAU * j as f64 / AZIMUTHS as f64))
        })
        .map(|(polar, azimuth)| view(half, half + cell.scanner.best_mm, polar, azimuth))
        .collect();
    let stations = solve_some(&views, cell, &scene, &table_from_part, 1, &ctx.silent())?;
    let rings: Vec<usize> = stations.chunks(AZIMUTHS).map(|ring| ring.iter().filter(|found| found.is_ok()).count()).collect();
    let elevations = rings.iter().filter(|directions| **directions > 0).count();
    Ok(Some(Reached { elevations, hemisphere_share: hemisphere_share(&rings), directions: rings.iter().sum() }))
}

/// Share of the hemisphere's solid angle for the number of directions reached at each elevation, from straight above down.
fn hemisphere_share(rings: &[usize]) -> f64 {
    let step_rad = FRAC_PI_2 / (ELEVATIONS - 1) as f64;
    // Solid angle of a band between two polar angles, as a share of the hemisphere's 2π: the difference of their cosines.
    let band = |ring: usize| {
        let polar_rad = step_rad * ring as f64;
        (polar_rad - 0.5 * step_rad).max(0.0).cos() - (polar_rad + 0.5 * step_rad).min(FRAC_PI_2).cos()
    };
    let reached: f64 = rings.iter().enumerate().map(|(ring, directions)| band(ring) * *directions as f64).sum();
    // Summed in the same order, so that all directions are the whole exactly.
    let all: f64 = (0..rings.len()).map(|ring| band(ring) * AZIMUTHS as f64).sum();
    reached / all
}

/// Looks at the cube's centre, baseline level.
fn view(half_mm: f64, distance_mm: f64, polar: f64, azimuth: f64) -> Pose<Part, ScannerFrame> {
    let out = Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
    let x = Vector3::new(-azimuth.sin(), azimuth.cos(), 0.0);
    let axes = Rotation3::from_basis_unchecked(&[x, (-out).cross(&x), -out]);
    Pose::from_parts(Vector3::repeat(half_mm) + out * distance_mm, UnitQuaternion::from_rotation_matrix(&axes))
}

fn cube(edge_mm: f64) -> Mesh {
    let corner = |i: usize| Point3::from([0, 1, 2].map(|axis| if i >> axis & 1 == 1 { edge_mm } else { 0.0 }));
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces: Vec<[u32; 3]> = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    Mesh { vertices_mm: (0..8).map(corner).collect(), source_face: (0..12).collect(), faces, groups: Vec::new() }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::cell::{Presets, SpecLibrary};

    /// The default cell, its table turned and moved as its robot sees it.
    fn cell(origin_mm: Vector3<f64>, axis: Vector3<f64>, angle_rad: f64) -> Cell {
        let mut cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
        let rotation = UnitQuaternion::from_scaled_axis(axis * angle_rad);
        cell.base_from_table = Pose::from_parts(rotation * origin_mm, rotation);
        cell
    }

    fn assert_near(found: [f64; 2], wanted: [f64; 2]) {
        assert!(found.iter().zip(wanted).all(|(found, wanted)| (found - wanted).abs() < 1e-9), "{found:?}, not {wanted:?}");
    }

    /// The plate was told 800 mm above the foot of a robot that hangs 800 mm above it.
    #[test]
    fn distance_and_height_are_those_along_the_axis_of_the_table_however_the_foot_is_turned() {
        // Upright, upside down, leaning by 30 degrees, and on a wall; the foot stands 500 mm from the axis each time.
        for (axis, angle_rad) in [(Vector3::x(), 0.0), (Vector3::x(), PI), (Vector3::y(), PI / 6.0), (Vector3::y(), -PI / 2.0)] {
            let cell = cell(Vector3::new(300.0, 400.0, -800.0), axis, angle_rad);
            assert_near(own_layout(&cell), [500.0, -800.0]);
            let same = laid_out(&cell, &cell.flange_from_scanner, 500.0, -800.0);
            assert!((same.base_from_table.origin_mm() - cell.base_from_table.origin_mm()).norm() < 1e-9);
            let other = laid_out(&cell, &cell.flange_from_scanner, 450.0, -700.0);
            assert_near(own_layout(&other), [450.0, -700.0]);
            let moved_mm =
                cell.base_from_table.inverse().direction(&(other.base_from_table.origin_mm() - cell.base_from_table.origin_mm()));
            assert!((moved_mm - Vector3::new(-30.0, -40.0, 100.0)).norm() < 1e-9, "{moved_mm}");
        }
    }

    /// The ten upper of 19 elevations were told as 53 % of the hemisphere.
    #[test]
    fn the_share_of_the_hemisphere_is_one_of_solid_angle() {
        let share = |first: usize, end: usize| {
            let reached = |ring: usize| if (first..end).contains(&ring) { AZIMUTHS } else { 0 };
            hemisphere_share(&(0..ELEVATIONS).map(reached).collect::<Vec<usize>>())
        };
        let cap = |half_deg: f64| 1.0 - half_deg.to_radians().cos();
        for (first, end, wanted) in [
            (0, 0, 0.0),
            (0, 1, cap(2.5)),
            (0, 10, cap(47.5)),
            (ELEVATIONS - 1, ELEVATIONS, 1.0 - cap(87.5)),
            (0, ELEVATIONS, 1.0),
        ] {
            let found = share(first, end);
            assert!((found - wanted).abs() < 1e-12, "{first} to {end}: {found}, not {wanted}");
        }
        let half_of_each = [AZIMUTHS / 2; ELEVATIONS];
        assert!((hemisphere_share(&half_of_each) - 0.5).abs() < 1e-12);
        assert!(share(0, ELEVATIONS) >= 1.0, "all is not rounded down");
    }

    /// More points of the grid are no more of the hemisphere where they crowd near straight above.
    #[test]
    fn of_layouts_with_as_many_elevations_the_best_sees_most_of_the_hemisphere() {
        let layout = |hemisphere_share: f64, directions: usize| Layout {
            mounting: 0,
            foot_mm: 400.0,
            table_mm: -200.0,
            reached: Some(Reached { elevations: ELEVATIONS, hemisphere_share, directions }),
        };
        let layouts = [layout(0.4, 300), layout(0.5, 200), layout(0.5, 200)];
        assert!(best(&layouts).is_some_and(|best| std::ptr::eq(best, &raw const layouts[1])));
    }

    #[test]
    fn a_foot_on_the_axis_of_the_table_moves_off_it_level() {
        for (axis, angle_rad) in [(Vector3::x(), 0.0), (Vector3::x(), PI), (Vector3::y(), PI / 2.0)] {
            let cell = cell(Vector3::new(0.0, 0.0, -800.0), axis, angle_rad);
            assert_near(own_layout(&laid_out(&cell, &cell.flange_from_scanner, 400.0, -700.0)), [400.0, -700.0]);
        }
    }
}
