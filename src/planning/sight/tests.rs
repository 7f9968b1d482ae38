use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, UnitQuaternion};

use super::*;
use crate::cell::{Body, Presets, Shape, SpecLibrary};
use crate::geometry::Mesh;
use crate::planning::context::Silent;
use crate::planning::ids::SampleId;
use crate::planning::params::{PartParams, RegionParams};
use crate::planning::surface::sample;
use crate::testing::box_mesh;

/// Height of the part's top above the plate, and of the scanner above that, mm.
const TOP_MM: f64 = 20.0;
const ABOVE_MM: f64 = 480.0;

fn part() -> (Mesh, Surface) {
    let mesh = box_mesh([-60.0, -40.0, 0.0], [60.0, 40.0, TOP_MM]);
    let params = PartParams { patch_edge_mm: Some(10.0), samples_per_mm2: Some(0.5), ..PartParams::default() };
    let surface = sample(&mesh, &params, &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"));
    (mesh, surface)
}

/// Straight down on the part's top.
fn view() -> Pose<Part, ScannerFrame> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    Pose::from_parts(Vector3::new(0.0, 0.0, TOP_MM + ABOVE_MM), turn)
}

/// The default cell with these bodies around the plate's centre, each a middle and the edges of a box along the base's axes.
fn cell(boxes: &[([f64; 3], [f64; 3])]) -> Cell {
    let mut cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let centre = cell.base_from_table.origin_mm().coords;
    let body = |([x, y, z], size_mm): &([f64; 3], [f64; 3])| Body {
        name: "plate".into(),
        owner_from_body: Isometry3::translation(centre.x + x, centre.y + y, centre.z + z),
        shape: Shape::Box { size_mm: *size_mm },
    };
    cell.obstacles = boxes.iter().map(body).collect();
    cell
}

fn top(surface: &Surface) -> SampleSet {
    let mut top = SampleSet::none_of(surface.sample_mm.len());
    let up = surface.samples().filter(|sample| surface.patch_of(*sample).normal.z > 0.9);
    up.for_each(|sample| top.insert(sample));
    top
}

fn hidden(
    sight: &Sight,
    surface: &Surface,
    view: &Pose<Part, ScannerFrame>,
    measured: &SampleSet,
    table_rad: f64,
) -> Option<SampleSet> {
    let flag = AtomicBool::new(false);
    sight.hidden(surface, view, measured, table_rad, &Context::new(&flag, &Silent)).expect("not cancelled")
}

fn sight(cell: &Cell, mesh: &Mesh) -> Sight {
    let flag = AtomicBool::new(false);
    Sight::new(cell, &mesh.aabb(), &Pose::identity(), &Context::new(&flag, &Silent)).expect("not cancelled")
}

fn hides(sight: &Sight, surface: &Surface, view: &Pose<Part, ScannerFrame>, measured: &SampleSet, table_rad: f64) -> bool {
    let flag = AtomicBool::new(false);
    sight.hides(surface, view, measured, table_rad, &Context::new(&flag, &Silent))
}

/// Obstacles once moved along with a part that lay displaced: a plan that loses nothing by that was told to lose 7.5 points.
#[test]
fn obstacles_stay_where_they_are_beside_a_part_that_lies_displaced() {
    let (mesh, surface) = part();
    let cell = cell(&[([-10.0, 5.0, TOP_MM + 200.0], [30.0, 24.0, 1e-3])]);
    let (flag, measured) = (AtomicBool::new(false), top(&surface));
    let ctx = Context::new(&flag, &Silent);
    let planned = sight(&cell, &mesh);
    let as_planned = hidden(&planned, &surface, &view(), &measured, 0.0);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.03);
    let displaced = Isometry3::from_parts(Vector3::new(9.0, -6.0, 2.0).into(), turn);
    let found = planned.hidden_of_displaced(&surface, (&view(), &Pose::claim(displaced)), &measured, 0.0, &ctx);
    let found = found.expect("not cancelled");
    let placed_so = Sight::new(&cell, &mesh.aabb(), &Pose::claim(displaced), &ctx).expect("not cancelled");
    assert_eq!(found, hidden(&placed_so, &surface, &view(), &measured, 0.0));
    assert!(found.is_some() && found != as_planned, "the shadow lies elsewhere on the part");
}

#[test]
fn a_plate_in_between_hides_its_shadows_from_the_three_devices_at_every_table_angle() {
    let ((mesh, surface), height_mm) = (part(), 200.0);
    // So thin that its height does not matter.
    let (middle_mm, size_mm) = ([-10.0, 5.0, TOP_MM + height_mm], [30.0, 24.0, 1e-3]);
    let cell = cell(&[(middle_mm, size_mm)]);
    let sight = sight(&cell, &mesh);
    let centres_mm = sight.centres_mm.map(|centre| view().point(&centre));
    let measured = top(&surface);
    for table_rad in [0.0, FRAC_PI_2, 2.5, -1.0] {
        let hidden = hidden(&sight, &surface, &view(), &measured, table_rad).expect("a shadow falls on the part");
        let turned = |p: &Point3<f64>| {
            let (sin, cos) = table_rad.sin_cos();
            Point3::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y, p.z)
        };
        let mut checked = 0;
        for sample in measured.iter() {
            let p = turned(&surface.sample_mm[sample.index()]);
            // How far inside the plate a line passes its height, mm; negative beside it.
            let inside_mm = |centre: &Point3<f64>| {
                let c = turned(centre);
                let at = p + (c - p) * (height_mm / (c.z - p.z));
                let [x, y] = [0, 1].map(|axis| 0.5 * size_mm[axis] - (at[axis] - middle_mm[axis]).abs());
                x.min(y)
            };
            let deepest_mm = centres_mm.iter().map(inside_mm).fold(f64::NEG_INFINITY, f64::max);
            if deepest_mm.abs() > 0.01 {
                assert_eq!(hidden.holds(sample), deepest_mm > 0.0, "{p} at {table_rad} rad: {deepest_mm} mm");
                checked += 1;
            }
        }
        assert!(checked > 4000 && hidden.count() > 100 && hidden.count() < checked, "{} of {checked}", hidden.count());
        assert!(hides(&sight, &surface, &view(), &measured, table_rad) && !sight.is_clear(&view(), table_rad));
    }
}

#[test]
fn what_stands_beside_behind_or_nowhere_hides_nothing() {
    let (mesh, surface) = part();
    let beside = ([0.0, 300.0, 200.0], [400.0, 20.0, 800.0]);
    let behind = ([0.0, 0.0, TOP_MM + ABOVE_MM + 200.0], [400.0, 400.0, 20.0]);
    let below = ([0.0, 0.0, -100.0], [400.0, 400.0, 20.0]);
    for (boxes, has_none) in [(&[beside, behind, below][..], false), (&[], true)] {
        let cell = cell(boxes);
        let sight = sight(&cell, &mesh);
        assert_eq!(sight.has_no_obstacles(), has_none);
        for table_rad in [0.0, 0.7, PI] {
            assert!(sight.is_clear(&view(), table_rad));
            assert_eq!(hidden(&sight, &surface, &view(), &top(&surface), table_rad), None);
            assert!(!hides(&sight, &surface, &view(), &top(&surface), table_rad));
        }
    }
}

#[test]
fn a_body_near_the_lines_that_meets_none_hides_nothing() {
    let (mesh, surface) = part();
    // Within the hull of devices and part, between the lines from the two ends of what is measured: only the far end is.
    let cell = cell(&[([40.0, 0.0, TOP_MM + 20.0], [10.0, 10.0, 2.0])]);
    let sight = sight(&cell, &mesh);
    let mut far_end = SampleSet::none_of(surface.sample_mm.len());
    let is_far = |sample: &SampleId| surface.sample_mm[sample.index()].x < -20.0;
    top(&surface).iter().filter(is_far).for_each(|sample| far_end.insert(sample));
    assert!(far_end.count() > 100 && !sight.is_clear(&view(), 0.0));
    assert_eq!(hidden(&sight, &surface, &view(), &far_end, 0.0), None);
    assert!(hidden(&sight, &surface, &view(), &top(&surface), 0.0).is_some());
}

#[test]
fn hulls_are_separate_where_a_plane_fits_between_them() {
    let hull = |min: [f64; 3], size: f64| corners(&Aabb { min: min.into(), max: min.map(|x| x + size).into() });
    let unit = hull([0.0; 3], 1.0);
    for (min, size, expected) in [
        ([1.01, 0.0, 0.0], 1.0, true),
        ([0.99, 0.0, 0.0], 1.0, false),
        ([1.01, 1.01, 1.01], 5.0, true),
        ([-9.0, -9.0, -9.0], 20.0, false),
        ([0.4, 0.4, 0.4], 0.1, false),
        ([300.0, -200.0, 5.0], 1.0, true),
    ] {
        assert_eq!(are_separate(&unit, &hull(min, size)), expected, "{min:?} {size}");
        assert_eq!(are_separate(&hull(min, size), &unit), expected, "{min:?} {size}");
    }
    // A long edge beside a corner: separate along a diagonal alone.
    let edge = [Point3::new(-10.0, 13.0, 0.5), Point3::new(13.0, -10.0, 0.5)];
    assert!(are_separate(&unit, &edge));
    assert!(!are_separate(&unit, &[Point3::new(-10.0, 11.9, 0.5), Point3::new(11.9, -10.0, 0.5)]));
}

#[test]
fn a_cancel_is_heard() {
    let (mesh, surface) = part();
    let cell = cell(&[([0.0, 0.0, TOP_MM + 200.0], [30.0, 24.0, 2.0])]);
    let sight = sight(&cell, &mesh);
    let cancelled = AtomicBool::new(true);
    let found = sight.hidden(&surface, &view(), &top(&surface), 0.0, &Context::new(&cancelled, &Silent));
    assert_eq!(found, Err(Cancelled));
}
