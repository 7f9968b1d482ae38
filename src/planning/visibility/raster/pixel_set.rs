//! The thesis's own answer (§3.2.1): the triangles that a device hits with at least one pixel. It is finer than no pixel
//! allows: triangles smaller than about two pixels are lost, and on coarse meshes a triangle of which one pixel is seen
//! counts whole. Coverage is counted by samples; this is for comparing with what counts by pixels.

use std::sync::atomic::{AtomicU8, Ordering};

use super::Clusters;
use super::canvas::{Canvas, Drawing, Grid};
use super::pinhole::Pinhole;
use super::tile::{NOTHING, Numbers, TILE, place};
use crate::cell::{Lens, Scanner};
use crate::geometry::{Part, Pose, Scanner as ScannerFrame};
use crate::planning::context::{Cancelled, Context};

/// For each triangle of the scene, counted over its meshes, which devices hit it with at least one pixel: bit 0 for the
/// left camera, 1 for the right one, 2 for the projector.
pub(in super::super) fn pixel_set(
    scene: &Clusters,
    scanner: &Scanner,
    pose: &Pose<Part, ScannerFrame>,
    ctx: &Context<'_>,
) -> Result<Vec<u8>, Cancelled> {
    let hit: Vec<AtomicU8> = std::iter::repeat_with(AtomicU8::default).take(scene.triangles()).collect();
    let mut canvas = Canvas::default();
    for (d, device) in scanner.devices.iter().enumerate() {
        let device_from_part = device.scanner_from_device.inverse().isometry() * pose.inverse().isometry();
        let pinhole = Pinhole::new(&device.lens, &device_from_part, &scene.centre_mm);
        let grid = Grid::of(&device.lens);
        let drawing = Drawing { scene, pinhole: &pinhole, grid, level: ctx.simd_level(), grain: 1 };
        canvas.prepare(&drawing, |_| true, ctx)?;
        canvas.draw_numbered(&drawing, ctx, |corner_px, numbers| mark(&hit, 1 << d, &device.lens, corner_px, numbers))?;
    }
    Ok(hit.into_iter().map(AtomicU8::into_inner).collect())
}

/// Marks what the frame's pixels of a tile show.
fn mark(hit: &[AtomicU8], device: u8, lens: &Lens, [left, top]: [f32; 2], numbers: &Numbers) {
    // The pixel's centre: image coordinates here are half a pixel less.
    let shown = |x: usize, y: usize| lens.shows_undistorted(f64::from(left) + x as f64 + 0.5, f64::from(top) + y as f64 + 0.5);
    let last = TILE - 1;
    // The frame has no holes: a tile whose rim it shows it shows whole.
    let whole = (0..TILE).all(|i| shown(i, 0) && shown(i, last) && shown(0, i) && shown(last, i));
    let mut previous = NOTHING;
    for y in 0..TILE {
        for x in 0..TILE {
            let number = numbers.as_flattened()[place(x as u32, y as u32) as usize];
            if number != NOTHING && number != previous && (whole || shown(x, y)) {
                previous = number;
                let hit = &hit[number as usize];
                if hit.load(Ordering::Relaxed) & device == 0 {
                    hit.fetch_or(device, Ordering::Relaxed);
                }
            }
        }
    }
}
