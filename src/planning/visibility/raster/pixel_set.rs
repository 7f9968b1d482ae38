//! The thesis's own answer (§3.2.1): the triangles that a device hits with at least one pixel. It is finer than no pixel
//! allows: triangles smaller than about two pixels are lost, and on coarse meshes a triangle of which one pixel is seen
//! counts whole. Coverage is counted by samples; this is for comparing with what counts by pixels.

use std::sync::atomic::{AtomicBool, Ordering};

use super::Clusters;
use rayon::prelude::*;

use super::pinhole::{LANES, Pinhole};
use super::tile::{NOTHING, TILE, TriangleIds, offset_of};
use super::tiled_depth_buffer::{Grid, RenderPass, TiledDepthBuffer};
use crate::cell::{Lens, Scanner};
use crate::geometry::{Kernel, Part, Pose, ScannerFrame};
use crate::planning::context::{Cancelled, Context};

/// Triangles whose marks one task collects.
const MERGED: usize = 65_536;

/// Computes for each triangle of the scene, counted over its meshes, which devices hit it with at least one pixel: bit 0 for the
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
    let mut depth_buffer = TiledDepthBuffer::default();
    for (bit, device) in scanner.devices.iter().enumerate() {
        let device_from_part = device.scanner_from_device.inverse().isometry() * pose.inverse().isometry();
        let pinhole = Pinhole::new(&device.lens, &device_from_part, &scene.centre_mm);
        let grid = Grid::of(&device.lens);
        let pass = RenderPass { scene, pinhole: &pinhole, grid, level: ctx.simd_level(), grain: 1 };
        depth_buffer.prepare(&pass, |_| true, ctx)?;
        depth_buffer.draw_with_ids(&pass, ctx, |corner_px, numbers| {
            pass.level.run(Mark { hit: &hit, lens: &device.lens, corner_px, numbers });
        })?;
        devices.par_iter_mut().zip(&hit).with_min_len(MERGED).for_each(|(devices, hit)| {
            *devices |= u8::from(hit.load(Ordering::Relaxed)) << bit;
            hit.store(false, Ordering::Relaxed);
        });
    }
    Ok(devices)
}

/// Marks what the frame's pixels of a tile show.
struct Mark<'a> {
    hit: &'a [AtomicBool],
    lens: &'a Lens,
    /// Image coordinates of the tile's first pixel.
    corner_px: [f32; 2],
    numbers: &'a TriangleIds,
}

impl Kernel for Mark<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        if self.is_shown_whole() {
            for block in self.numbers {
                self.mark_block(block);
            }
            return;
        }
        let pixels = self.numbers.as_flattened();
        for y in 0..TILE {
            for x in 0..TILE {
                let number = pixels[offset_of(x as u32, y as u32) as usize];
                if number != NOTHING && self.shown(x, y) {
                    self.mark(number);
                }
            }
        }
    }
}

impl Mark<'_> {
    /// Returns true if the frame shows a pixel's centre: image coordinates here are half a pixel less.
    #[inline(always)]
    fn shown(&self, x: usize, y: usize) -> bool {
        let [left, top] = self.corner_px;
        self.lens.shows_undistorted(f64::from(left) + x as f64 + 0.5, f64::from(top) + y as f64 + 0.5)
    }

    /// The frame has no holes: a tile whose rim it shows it shows whole.
    #[inline(always)]
    fn is_shown_whole(&self) -> bool {
        let last = TILE - 1;
        let mut missing = [0_u64; TILE];
        for i in 0..TILE {
            let rim = self.shown(i, 0) & self.shown(i, last) & self.shown(0, i) & self.shown(last, i);
            missing[i] = u64::from(!rim);
        }
        missing.iter().fold(0, |missing, one| missing | one) == 0
    }

    /// Marks all pixels of a block. Most blocks show one triangle, or nothing.
    #[inline(always)]
    fn mark_block(&self, block: &[u32; LANES]) {
        self.mark(block[0]);
        let mut others = [0; LANES];
        for lane in 0..LANES {
            others[lane] = block[lane] ^ block[0];
        }
        if others.iter().fold(0, |others, other| others | other) != 0 {
            for number in &block[1..] {
                self.mark(*number);
            }
        }
    }

    #[inline(always)]
    fn mark(&self, number: u32) {
        // No triangle has the number that stands for nothing.
        if let Some(hit) = self.hit.get(number as usize) {
            hit.store(true, Ordering::Relaxed);
        }
    }
}
