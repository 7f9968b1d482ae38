//! A whole viewpoint at full resolution, as the thesis casts it: which triangles does each of three devices of
//! 4000 × 3036 pixels meet with the ray of at least one pixel? Open3D makes, casts and reduces all 36.4 million rays, as
//! its users do; Embree's packets get only the pixels that can show the part, which answers the same.

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;
use vantage::geometry::Mesh;

use crate::embree::{EmbreeScene, NO_FACE};
use crate::rig::{Eye, PixelBox};

/// Rows of pixels that a thread takes at a time.
const BAND: u32 = 16;

/// Which triangles each device meets.
pub(crate) type Seen = [Vec<bool>; 3];

/// By casting with Embree's packets, on the pool that this runs in.
pub(crate) fn with_embree(scene: &EmbreeScene, eyes: &[Eye; 3], mesh: &Mesh) -> Seen {
    eyes.each_ref().map(|eye| {
        let seen: Vec<_> = mesh.faces.iter().map(|_| AtomicBool::new(false)).collect();
        let PixelBox { columns, rows: [top, bottom] } = eye.scissor(mesh);
        let origin = eye.centre_mm.map(|x| x as f32).into();
        (top..bottom).into_par_iter().step_by(BAND as usize).for_each(|row| {
            let band = PixelBox { columns, rows: [row, (row + BAND).min(bottom)] };
            let directions: Vec<_> = band.pixels().map(|(column, row)| eye.ray(column, row)).collect();
            let mut faces = vec![NO_FACE; directions.len()];
            scene.first_faces(origin, &directions, &mut faces);
            for face in faces.iter().filter(|face| **face != NO_FACE) {
                seen[*face as usize].store(true, Ordering::Relaxed);
            }
        });
        seen.into_iter().map(AtomicBool::into_inner).collect()
    })
}

/// How much two answers differ: triangles a device sees in one and not in the other, of all triangles of the mesh, the
/// worst device; and triangles seen by all three devices in one and not in the other, of those seen so in either.
pub(crate) fn differing(a: &Seen, b: &Seen) -> [f64; 2] {
    let worst = a.iter().zip(b).map(|(a, b)| a.iter().zip(b).filter(|(a, b)| a != b).count()).max().unwrap_or(0);
    let by_all = |seen: &Seen, face: usize| seen.iter().all(|seen| seen[face]);
    let either = (0..a[0].len()).filter(|face| by_all(a, *face) || by_all(b, *face)).count();
    let one = (0..a[0].len()).filter(|face| by_all(a, *face) != by_all(b, *face)).count();
    [worst as f64 / a[0].len() as f64, one as f64 / either.max(1) as f64]
}
