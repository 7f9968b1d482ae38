//! The thesis's own answer (§3.2.1): the triangles that a device hits with at least one pixel. It is finer than no pixel
//! allows: triangles smaller than about two pixels are lost, and on coarse meshes a triangle of which one pixel is seen
//! counts whole. Coverage is counted by samples; this is for comparing with what counts by pixels.

use std::sync::atomic::{AtomicBool, Ordering};

use super::Clusters;
use rayon::prelude::*;

use super::canvas::{Canvas, Drawing, Grid};
use super::pinhole::Pinhole;
use super::tile::{NOTHING, Numbers, TILE, place};
use crate::cell::{Lens, Scanner};
use crate::geometry::{Part, Pose, Scanner as ScannerFrame};
use crate::planning::context::{Cancelled, Context};

/// Triangles whose marks one task collects.
const MERGED: usize = 65_536;

/// For each triangle of the scene, counted over its meshes, which devices hit it with at least one pixel: bit 0 for the
/// left camera, 1 for the right one, 2 for the projector.
pub(in super::super) fn pixel_set(
    scene: &Clusters,
    scanner: &Scanner,
    pose: &Pose<Part, ScannerFrame>,
    ctx: &Context<'_>,
) -> Result<Vec<u8>, Cancelled> {
    let triangles = scene.triangles;
    let mut devices = vec![0_u8; triangles];
    let hit: Vec<AtomicBool> = std::iter::repeat_with(AtomicBool::default).take(triangles).collect();
    let mut canvas = Canvas::default();
    for (d, device) in scanner.devices.iter().enumerate() {
        let device_from_part = device.scanner_from_device.inverse().isometry() * pose.inverse().isometry();
        let pinhole = Pinhole::new(&device.lens, &device_from_part, &scene.centre_mm);
        let grid = Grid::of(&device.lens);
        let drawing = Drawing { scene, pinhole: &pinhole, grid, level: ctx.simd_level(), grain: 1 };
        canvas.prepare(&drawing, |_| true, ctx)?;
        canvas.draw_numbered(&drawing, ctx, |corner_px, numbers| mark(&hit, &device.lens, corner_px, numbers))?;
        devices.par_iter_mut().zip(&hit).with_min_len(MERGED).for_each(|(devices, hit)| {
            *devices |= u8::from(hit.load(Ordering::Relaxed)) << d;
            hit.store(false, Ordering::Relaxed);
        });
    }
    Ok(devices)
}

/// Marks what the frame's pixels of a tile show.
fn mark(hit: &[AtomicBool], lens: &Lens, [left, top]: [f32; 2], numbers: &Numbers) {
    // The pixel's centre: image coordinates here are half a pixel less.
    let shown = |x: usize, y: usize| lens.shows_undistorted(f64::from(left) + x as f64 + 0.5, f64::from(top) + y as f64 + 0.5);
    let last = TILE - 1;
    // The frame has no holes: a tile whose rim it shows it shows whole.
    let whole = (0..TILE).all(|i| shown(i, 0) && shown(i, last) && shown(0, i) && shown(last, i));
    let pixels = numbers.as_flattened();
    if whole {
        let mut previous = NOTHING;
        for &number in pixels {
            if number != previous && number != NOTHING {
                hit[number as usize].store(true, Ordering::Relaxed);
            }
            previous = number;
        }
        return;
    }
    for (x, y) in (0..TILE).flat_map(|y| (0..TILE).map(move |x| (x, y))) {
        let number = pixels[place(x as u32, y as u32) as usize];
        if number != NOTHING && shown(x, y) {
            hit[number as usize].store(true, Ordering::Relaxed);
        }
    }
}
