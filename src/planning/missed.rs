//! What is not measured, and why: for each such sample the first failing cause for the candidate that gets furthest
//! (contract: the closed list), and the connected spots that samples of one cause form.

use nalgebra::Vector3;

use super::plan::{Cause, MissedCause, MissedSpot, Verdict};
use super::surface::Surface;
use crate::geometry::{Mesh, Part, Pose, Table, connected_components};

/// How near the plate a sample lies that the part rests on, mm.
const RESTING_WITHIN_MM: f64 = 0.1;
/// How steeply it must face down: within 8° of the vertical.
const RESTING_NORMAL_COS: f64 = -0.99;

/// Whether a sample belongs to the faces that the part stands on.
#[must_use]
pub(super) fn rests(surface: &Surface, sample: usize, table_from_part: &Pose<Table, Part>) -> bool {
    let height_mm = table_from_part.point(&surface.sample_mm[sample]).z;
    let down = table_from_part.direction(&surface.patch_of(sample).normal).z;
    height_mm.abs() <= RESTING_WITHIN_MM && down <= RESTING_NORMAL_COS
}

/// Missed area by cause, in the order of [`Cause`], each in spots, largest first.
#[must_use]
pub(super) fn spots(mesh: &Mesh, surface: &Surface, verdicts: &[Verdict]) -> Vec<MissedCause> {
    Cause::ALL
        .into_iter()
        .filter_map(|cause| {
            let missed = |sample: usize| verdicts[sample] == Verdict::Missed(cause);
            let mut faces: Vec<u32> =
                (0..verdicts.len()).filter(|sample| missed(*sample)).map(|sample| surface.patch_of(sample).face).collect();
            faces.dedup();
            if faces.is_empty() {
                return None;
            }
            let spots = spots_of(mesh, surface, &faces, missed);
            Some(MissedCause { cause, area_mm2: spots.iter().map(|spot| spot.area_mm2).sum(), spots })
        })
        .collect()
}

fn spots_of(mesh: &Mesh, surface: &Surface, faces: &[u32], missed: impl Fn(usize) -> bool) -> Vec<MissedSpot> {
    let components = connected_components(mesh, faces);
    let mut component_of_face = std::collections::HashMap::new();
    for (component, members) in components.iter().enumerate() {
        component_of_face.extend(members.iter().map(|face| (*face, component)));
    }
    let mut sums = vec![(0.0, Vector3::zeros()); components.len()];
    for sample in (0..surface.sample_mm.len()).filter(|sample| missed(*sample)) {
        let (area_mm2, moment) = &mut sums[component_of_face[&surface.patch_of(sample).face]];
        let sample_area_mm2 = surface.sample_area_mm2(sample);
        *area_mm2 += sample_area_mm2;
        *moment += surface.sample_mm[sample].coords * sample_area_mm2;
    }
    let mut spots: Vec<MissedSpot> = components
        .iter()
        .zip(sums)
        .map(|(members, (area_mm2, moment))| {
            let mut source_faces: Vec<u32> = members.iter().map(|face| mesh.source_face[*face as usize]).collect();
            source_faces.sort_unstable();
            source_faces.dedup();
            MissedSpot { area_mm2, centre_mm: (moment / area_mm2).into(), source_faces }
        })
        .collect();
    // A stable sort: spots of equal area stay ordered by their first face.
    spots.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
    spots
}
