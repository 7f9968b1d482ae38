//! The connected spots that missed samples of one cause form. Patches hang together where they share a corner: longest
//! edges are bisected at their middles alone, so that both sides of an edge are cut alike and corners have equal bits.

use nalgebra::{Point3, Vector3};

use crate::geometry::{Aabb, Mesh, components_sharing, sort_descending};
use crate::planning::ids::{PatchId, SampleId};
use crate::planning::plan::{Cause, Verdict};
use crate::planning::surface::Surface;

/// Samples of one cause that hang together.
pub struct Spot<C = Cause> {
    /// Cause of the samples.
    pub cause: C,
    /// The samples, ascending.
    pub samples: Vec<SampleId>,
    /// Area that they stand for.
    pub area_mm2: f64,
    /// Area-weighted centre.
    pub centre_mm: Point3<f64>,
    /// Extent of the box around their patches, along the part's axes.
    pub extent_mm: Vector3<f64>,
    /// Faces of the uploaded file that they touch, ascending.
    pub source_faces: Vec<u32>,
}

/// Every spot, in the order of [`Cause`], those of a cause largest first.
pub(super) fn find(mesh: &Mesh, surface: &Surface, verdicts: &[Verdict]) -> Vec<Spot> {
    let spots_of_cause = |cause: Cause| {
        let missed = |sample: &SampleId| verdicts[sample.index()] == Verdict::Missed(cause);
        spots_of(cause, SampleId::first(verdicts.len()).filter(missed).collect(), mesh, surface)
    };
    Cause::ALL.into_iter().flat_map(spots_of_cause).collect()
}

/// The spots that samples of one cause, ascending, form: largest first.
#[must_use]
pub fn spots_of<C: Copy>(cause: C, samples: Vec<SampleId>, mesh: &Mesh, surface: &Surface) -> Vec<Spot<C>> {
    let mut patches: Vec<PatchId> = samples.iter().map(|sample| surface.sample_patch[sample.index()]).collect();
    patches.dedup();
    let component = components_sharing(patches.iter().map(|patch| corner_keys(surface, *patch)));
    let mut members: Vec<Vec<SampleId>> = vec![Vec::new(); component.iter().max().map_or(0, |last| last + 1)];
    let mut position = 0;
    for sample in samples {
        // Samples are ordered by patch.
        while patches[position] != surface.sample_patch[sample.index()] {
            position += 1;
        }
        members[component[position]].push(sample);
    }
    let mut spots: Vec<Spot<C>> = members.into_iter().map(|samples| Spot::new(cause, samples, mesh, surface)).collect();
    // A stable sort: spots of equal area stay ordered by their first patch.
    sort_descending(&mut spots, |spot| spot.area_mm2);
    spots
}

/// Keys of a patch's corners, equal for equal corners: adding 0 turns −0 into 0.
fn corner_keys(surface: &Surface, patch: PatchId) -> [[u64; 3]; 3] {
    surface.patches[patch.index()].corners_mm.map(|corner| [corner.x, corner.y, corner.z].map(|x| (x + 0.0).to_bits()))
}

impl<C> Spot<C> {
    fn new(cause: C, samples: Vec<SampleId>, mesh: &Mesh, surface: &Surface) -> Self {
        let (mut area_mm2, mut moment) = (0.0, Vector3::zeros());
        for sample in samples.iter().copied() {
            area_mm2 += surface.sample_area_mm2(sample);
            moment += surface.sample_mm[sample.index()].coords * surface.sample_area_mm2(sample);
        }
        let patches = || samples.iter().map(|sample| surface.patch_of(*sample));
        let extent_mm = Aabb::around(patches().flat_map(|patch| &patch.corners_mm)).extent_mm();
        let mut source_faces: Vec<u32> = patches().map(|patch| mesh.source_face[patch.face as usize]).collect();
        source_faces.sort_unstable();
        source_faces.dedup();
        Self { cause, area_mm2, centre_mm: (moment / area_mm2).into(), extent_mm, source_faces, samples }
    }
}
