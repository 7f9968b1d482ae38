use std::convert::Infallible;
use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, Point3, Vector3};

use super::clusters::Clusters;
use super::pinhole::Pinhole;
use super::tile::{TILE, offset_of};
use super::tiled_depth_buffer::{Grid, RenderPass, TiledDepthBuffer};
use crate::cell::Lens;
use crate::geometry::{Mesh, SimdLevel};
use crate::planning::context::{Context, Silent};
use crate::testing::{box_mesh, nominal_scanner};

/// The inverse depth, 1/mm, at a pixel of the map that the left camera of the nominal rig would have at the origin.
fn map(meshes: &[&Mesh]) -> impl Fn(u32, u32) -> f32 + use<> {
    let lens: Lens = nominal_scanner().devices.left.lens;
    let scene = Clusters::new(meshes, &|| Ok::<(), Infallible>(()));
    let Ok(scene) = scene;
    let pinhole = Pinhole::new(&lens, &Isometry3::identity(), &scene.centre_mm);
    let grid = Grid::of(&lens);
    let pass = RenderPass { scene: &scene, pinhole: &pinhole, grid, level: SimdLevel::widest(), grain: 1 };
    let (mut depth_buffer, flag) = (TiledDepthBuffer::default(), AtomicBool::new(false));
    let ctx = Context::new(&flag, &Silent);
    depth_buffer.prepare(&pass, |_| true, &ctx).unwrap_or_else(|_| unreachable!("nobody cancels"));
    depth_buffer.draw(&pass, &ctx).unwrap_or_else(|_| unreachable!("nobody cancels"));
    move |x, y| {
        let (column, row) = (x as i32 - grid.left_px as i32, y as i32 - grid.top_px as i32);
        let (column, row) = (column as usize, row as usize);
        let (maps, slots) = depth_buffer.maps();
        let map = &maps[slots[row / TILE * grid.columns + column / TILE] as usize];
        map.as_flattened()[offset_of((column % TILE) as u32, (row % TILE) as u32) as usize]
    }
}

/// A number between −1 and 1 that looks like chance.
fn scatter(seed: u64) -> f64 {
    let z = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    ((z >> 11) as f64) / (1u64 << 52) as f64 - 1.0
}

/// A sheet before the camera, of `cells`² cells whose corners are moved about and of which each is cut in two. Points
/// are on the plane z = 480 + 0.5 x.
fn sheet(half_mm: f64, cells: u32) -> Mesh {
    let side = cells + 1;
    let step_mm = 2.0 * half_mm / f64::from(cells);
    let vertex = |i: u32| {
        let (column, row) = (i % side, i / side);
        let inner = |k: u32| k > 0 && k < cells;
        let moved = |seed: u64, k: u32| if inner(column) && inner(row) { 0.3 * scatter(seed) } else { 0.0 } + f64::from(k);
        let x = step_mm * moved(2 * u64::from(i), column) - half_mm;
        let y = step_mm * moved(2 * u64::from(i) + 1, row) - half_mm;
        Point3::new(x, y, 480.0 + 0.5 * x)
    };
    let cell = |i: u32| {
        let first = i / cells * side + i % cells;
        [[first, first + side, first + 1], [first + 1, first + side, first + side + 1]]
    };
    let faces: Vec<[u32; 3]> = (0..cells * cells).flat_map(cell).collect();
    Mesh {
        vertices_mm: (0..side * side).map(vertex).collect(),
        source_face: (0..faces.len() as u32).collect(),
        faces,
        groups: Vec::new(),
    }
}

/// Inverse depth of the sheet's plane at a pixel: with x = X/Z, z = 480 + ½ x z.
fn nearness_of_sheet(lens: &Lens, x: u32) -> f64 {
    (1.0 - 0.5 * (f64::from(x) + 0.5 - lens.cx) / lens.fx) / 480.0
}

#[test]
fn neighbours_leave_no_crack_and_lie_at_their_depth() {
    let lens = nominal_scanner().devices.left.lens;
    // From triangles of half a pixel to such that fill tiles.
    for (half_mm, cells) in [(4.0, 220), (20.0, 130), (60.0, 40), (130.0, 3)] {
        let inverse_depth = map(&[&sheet(half_mm, cells)]);
        let reach = (half_mm / 480.0 * 6668.0 * 0.8) as u32;
        for (x, y) in
            (1518 - reach.min(1400)..1518 + reach.min(1400)).flat_map(|y| (2000 - reach..2000 + reach).map(move |x| (x, y)))
        {
            let (drawn, wanted) = (f64::from(inverse_depth(x, y)), nearness_of_sheet(&lens, x));
            assert!((drawn / wanted - 1.0).abs() < 2e-6, "{cells} cells: {drawn} instead of {wanted} at {x}, {y}");
        }
    }
}

#[test]
fn what_is_nearer_hides_what_is_further_whichever_way_it_faces() {
    let (near, far) =
        (box_mesh([-20.0, -20.0, 400.0], [20.0, 20.0, 410.0]), box_mesh([-60.0, -60.0, 500.0], [60.0, 60.0, 510.0]));
    let mut open = near.clone();
    // Without its lid the near box is open: its floor hides the far box from within.
    open.faces.retain(|face| face.iter().any(|vertex| near.vertices_mm[*vertex as usize].z > 405.0));
    open.source_face.truncate(open.faces.len());
    for (near, depth_mm) in [(near, 400.0), (open, 410.0)] {
        let inverse_depth = map(&[&far, &near]);
        assert!((f64::from(inverse_depth(2000, 1518)) * depth_mm - 1.0).abs() < 1e-5, "{}", inverse_depth(2000, 1518));
        // 40 mm off the axis at 500 mm.
        assert!((f64::from(inverse_depth(2533, 1518)) * 500.0 - 1.0).abs() < 1e-5);
        assert_eq!(inverse_depth(3900, 100), 0.0, "beside both boxes there is nothing");
    }
}

#[test]
fn from_inside_a_closed_body_its_walls_are_seen() {
    let inverse_depth = map(&[&box_mesh([-300.0; 3], [300.0; 3])]);
    for (x, y) in [(10, 10), (2000, 1518), (3990, 3020)] {
        assert!((f64::from(inverse_depth(x, y)) * 300.0 - 1.0).abs() < 1e-5, "{} at {x}, {y}", inverse_depth(x, y));
    }
}

#[test]
fn a_plane_that_passes_the_camera_is_cut_before_it() {
    // From far behind the camera to far before it, 50 mm below: depth 50 · f / (v − cy).
    let floor = box_mesh([-5000.0, 50.0, -3000.0], [5000.0, 60.0, 3000.0]);
    let inverse_depth = map(&[&floor]);
    let lens = nominal_scanner().devices.left.lens;
    for (x, y) in [(5, 1700), (2000, 1800), (3995, 3000)] {
        let wanted = (f64::from(y) + 0.5 - lens.cy) / lens.fy / 50.0;
        assert!((f64::from(inverse_depth(x, y)) / wanted - 1.0).abs() < 1e-4, "{} instead of {wanted}", inverse_depth(x, y));
    }
    assert_eq!(inverse_depth(2000, 1000), 0.0, "nothing above the horizon");
}

#[test]
fn a_point_is_projected_as_the_lens_does() {
    let lens = nominal_scanner().devices.right.lens;
    let device_from_part = Isometry3::new(Vector3::new(11.0, -7.0, 480.0), Vector3::new(0.3, 2.9, -0.2));
    let centre_mm = Point3::new(100.0, -50.0, 20.0);
    let pinhole = Pinhole::new(&lens, &device_from_part, &centre_mm);
    for i in 0..100 {
        let offset = Vector3::new(scatter(3 * i), scatter(3 * i + 1), scatter(3 * i + 2)) * 60.0;
        let in_device = device_from_part * (centre_mm + offset);
        let [x, y, depth] = pinhole.homogeneous(offset.x as f32, offset.y as f32, offset.z as f32);
        let (u, v, _) = lens.image(in_device.x, in_device.y, in_device.z);
        assert!((f64::from(x / depth) + 0.5 - u).abs() < 2e-3 && (f64::from(y / depth) + 0.5 - v).abs() < 2e-3);
        assert!((f64::from(depth) - in_device.z).abs() < 1e-4);
    }
}
