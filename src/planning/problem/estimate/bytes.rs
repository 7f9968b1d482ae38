//! Bytes that a plan and its result files hold at once at most. What each term is stands in `src/ARCHITECTURE.md`, "What a
//! plan holds in memory".

use super::{Counts, Shares, exchanges, goals_of_regions, keeps_quality};
use crate::geometry::Mesh;
use crate::planning::params::{PlanParams, Solver};
use crate::planning::plan::MAX_LISTING_BYTES;
use crate::planning::scene::PlanInput;
use crate::planning::sequence;

/// Bytes that the process holds beside the plan.
const PROGRAM: f64 = 32e6;
/// A patch; with the keys of its corners where it is missed.
const PATCH: f64 = 120.0;
const PATCH_OF_SPOT: f64 = 110.0;
/// A sample: in the surface, in the engine, in the sums of choosing, and in the buffers of a thread.
const SAMPLE: f64 = 38.0;
const SAMPLE_OF_ENGINE: f64 = 32.0;
const SAMPLE_OF_SUMS: f64 = 40.0;
const SAMPLE_OF_THREAD: f64 = 6.0;
/// Depth maps that a thread draws, for each sample that is measured.
const MAP_OF_SAMPLE: f64 = 100.0;
/// A candidate beside its row.
const CANDIDATE: f64 = 2000.0;
/// An exchange of a view for a candidate: its deficit twice, what it adds, and the units that are kept of three goals.
const EXCHANGE: f64 = 48.0;
/// Samples that have twins at most, and a sample in the goals over twins.
const TWINNED: f64 = 50e3;
const SAMPLE_OF_FLOOR: f64 = 300.0;
/// A sample that views are chosen on in the goal of a region of interest or a feature: its area, again with twins and in units, and copies
/// of these. Of a small part with 300 and with 1500 such features 42 and 57 were measured.
const SAMPLE_OF_GOAL: f64 = 57.0;
/// Nodes of branch and bound that are open at once, and a pair of row and class in one.
const NODES: f64 = 40.0;
const PAIR_OF_NODE: f64 = 4.0;
/// Pairs with which branch and bound is not begun.
const MAX_PAIRS_OF_NODE: f64 = 30e6;
/// A measured sample of a candidate, and a patch, in the listing of all candidates.
const PAIR_OF_LISTING: f64 = 9.0;
const PATCH_OF_LISTING: f64 = 40.0;
/// A picture in the report, as often as it is copied, and how many there are at most.
const PICTURE: f64 = 400e3;
const MAX_PICTURES: f64 = 54.0;
/// A triangle: with its source face; in the tree of rays; in the clusters of the raster engine; while these are made; in the
/// box trees of collision tests; in the files that list faces.
const TRIANGLE: f64 = 16.0;
const TRIANGLE_OF_RAYS: f64 = 76.0;
const TRIANGLE_OF_CLUSTERS: f64 = 9.0;
const TRIANGLE_GROWING: f64 = 140.0;
const TRIANGLE_OF_COLLISION: f64 = 130.0;
const FACE_OF_FILES: f64 = 150.0;
/// A vertex: of the mesh, and again of the tree of rays; in a cluster, where neighbours share most.
const VERTEX: f64 = 24.0;
const VERTEX_OF_CLUSTERS: f64 = 12.0;
const CLUSTERS_A_VERTEX: f64 = 1.5;

pub(super) fn held(counts: &Counts, input: &PlanInput<'_>, params: &PlanParams, threads: f64) -> Shares {
    let Counts { patches, samples, chosen_on, candidates, views, measured, .. } = *counts;
    let with_quality = keeps_quality(params) || params.output.candidates;
    let row = chosen_on * if with_quality { 0.125 + 2.0 * measured } else { 0.125 };
    // On every sample, twice while rolls are held against it.
    let row_of_all = samples * 0.25;
    // What candidates measure under an error is held beside what they measure.
    let rows = if params.robust.select { 3.0 } else { 1.0 };
    let nodes = match params.selection.solver {
        Solver::Certified => NODES * PAIR_OF_NODE * (measured * counts.pairs()).min(MAX_PAIRS_OF_NODE),
        Solver::Greedy | Solver::Lazy | Solver::Local => 0.0,
    };
    // Twins, where fewer views must not give worse grades (`selection/grade_floor.rs`).
    let selection = &params.selection;
    let is_floor_asked = selection.max_grade_loss.is_some() || selection.min_grade_a.is_some();
    let floor = keeps_quality(params) && exchanges(params) && is_floor_asked;
    let twins = if floor { row + 0.25 * chosen_on + 4.0 * chosen_on.min(TWINNED) * measured } else { 0.0 };
    let of_floor = if floor { SAMPLE_OF_FLOOR } else { 0.0 };
    let exchange = if exchanges(params) { EXCHANGE * candidates } else { 0.0 };
    // The surface that is planned on, the one that the outcome gets, and the one of the second samples.
    let surfaces = 3.0 * (PATCH * patches + SAMPLE * samples);
    // Of the surfaces that are chosen on, one is with the part and one with the problem.
    let thin = 2.0 * (PATCH + SAMPLE) * chosen_on;
    let of_threads = threads * samples * (SAMPLE_OF_THREAD + MAP_OF_SAMPLE * measured);
    // All views may be of one setup.
    let tour = input.cell.map_or(0.0, |_| sequence::expected_bytes(views, params.motion.table));
    Shares {
        // One more setup is tried for advice.
        triangles: PROGRAM + triangles(input, counts.setups + f64::from(u8::from(tries_setup(input, params)))),
        samples: surfaces
            + thin
            + PATCH_OF_SPOT * patches
            + (SAMPLE_OF_ENGINE + SAMPLE_OF_SUMS) * samples
            + of_floor * chosen_on
            + of_threads,
        candidates: candidates * (CANDIDATE + rows * row + row_of_all + twins) + nodes + listing(counts, params),
        views: views * (row + 2.0 * measured * samples + exchange) + views.min(MAX_PICTURES) * PICTURE + tour,
        regions: SAMPLE_OF_GOAL * chosen_on * goals_of_regions(params),
    }
}

/// Returns true if one more setup may be tried: what the part stands on is missed then.
fn tries_setup(input: &PlanInput<'_>, params: &PlanParams) -> bool {
    params.missed.advice && input.cell.is_some() && input.fixture.is_none()
}

/// Bytes of the listing of all candidates, and of it compressed.
fn listing(counts: &Counts, params: &PlanParams) -> f64 {
    let bytes = PAIR_OF_LISTING * counts.measured * counts.candidates * counts.samples + PATCH_OF_LISTING * counts.patches;
    if params.output.candidates { 1.5 * bytes.min(MAX_LISTING_BYTES as f64) } else { 0.0 }
}

/// Bytes that grow with triangles and vertices of the meshes.
fn triangles(input: &PlanInput<'_>, setups: f64) -> f64 {
    let (part, fixture) = (size(input.mesh), input.fixture.map_or([0.0; 2], size));
    let [triangles, vertices] = [0, 1].map(|of| part[of] + fixture[of]);
    let rays = |[triangles, vertices]: [f64; 2]| TRIANGLE_OF_RAYS * triangles + VERTEX * vertices;
    let vertices_of_clusters = (CLUSTERS_A_VERTEX * vertices).min(3.0 * triangles);
    let clusters = TRIANGLE_OF_CLUSTERS * triangles + VERTEX_OF_CLUSTERS * vertices_of_clusters;
    let collision = input.cell.map_or(0.0, |cell| {
        let bodies: f64 = cell.surfaces().iter().map(|mesh| mesh.faces.len() as f64).sum();
        TRIANGLE_OF_COLLISION * (setups * triangles + bodies)
    });
    let meshes = TRIANGLE * triangles + VERTEX * vertices;
    // The part alone, for remedies; with several setups also for what is seen in any of them.
    let alone = if setups > 1.0 { 2.0 } else { 1.0 } * rays(part);
    let for_a_while = (TRIANGLE_GROWING * triangles).max(FACE_OF_FILES * part[0]);
    meshes + setups * (rays([triangles, vertices]) + clusters) + alone + collision + for_a_while
}

/// Triangles and vertices.
fn size(mesh: &Mesh) -> [f64; 2] {
    [mesh.faces.len() as f64, mesh.vertices_mm.len() as f64]
}
