//! Every candidate with its row of the matrices H and G of the thesis (§3.2.2): `candidates.json`, schema
//! `vantage.candidates/1`, which a job asks for by `output.candidates`.
//!
//! H has a row for each candidate and a column for each sample; an entry is 1 where the candidate measures the sample. G has
//! the quality c·Q_δ + d·Q_dis in the same places ([`crate::planning::method::quality`]). Both are written sparsely, as runs of
//! measured samples and the qualities of these. With S_i the area of sample i where it is asked for, else 0, and w_i its
//! weight, Σ H_vi S_i is the measured area of candidate v, and Σ H_vi S_i w_i (a + b G_vi) its score G_v.
//!
//! The text is made candidate by candidate, one a line, and given up beyond [`MAX_LISTING_BYTES`]: the rows are held once, as
//! planning has them.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::schema_name::schema_name;
use super::total::total;
use crate::cell::PoseSpec;
use crate::geometry::Mesh;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::params::ScoreParams;
use crate::planning::plan::{CandidateTable, MAX_LISTING_BYTES, Outcome, TableEntry};
use crate::planning::surface::{Patch, Surface};
use crate::planning::visibility::Row;

#[cfg(test)]
mod tests;

/// Name of the file.
pub const CANDIDATES_FILE: &str = "candidates.json";
/// Schema name in the document.
pub const CANDIDATES_SCHEMA: &str = "vantage.candidates/1";
/// Steps of a quality in the file: four decimals.
const QUALITY_STEPS: f32 = 1e4;
/// Bytes of a patch in the file, at least about.
const PATCH_BYTES: usize = 20;

schema_name!(CandidatesSchema, CANDIDATES_SCHEMA);

/// Every candidate, with the matrices of visibility and of quality (`candidates.json`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CandidateListing {
    /// Schema name, `vantage.candidates/1`.
    #[schema(value_type = CandidatesSchema)]
    pub schema: String,
    /// SHA-256 of the bytes of `plan.json`; empty in files of earlier releases.
    #[serde(default)]
    pub plan_sha256: String,
    /// Weights of the score and of the quality.
    pub score: ScoreParams,
    /// Pose of the part on the table, `table_from_part`, in each setup that was planned in; includes setups in which no view is
    /// taken, which `plan.json` leaves out.
    pub setups: Vec<PoseSpec>,
    /// Samples: the columns of both matrices.
    pub samples: SampleColumns,
    /// Every candidate as generated, ascending by id: the rows of both matrices.
    pub candidates: Vec<CandidateDocument>,
}

/// Samples, numbered from 0 patch by patch. A patch is a facet of the uploaded file, or a piece of one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SampleColumns {
    /// Number of samples.
    pub count: usize,
    /// Number of the first sample of each patch, ascending; its samples end where those of the next patch begin.
    pub patch_first_sample: Vec<u32>,
    /// Face of the uploaded file that each patch lies in.
    pub patch_face: Vec<u32>,
    /// Area that each sample of a patch stands for, for each patch.
    pub patch_sample_area_mm2: Vec<f64>,
    /// Samples that are not asked for: first sample and number of samples of each run, one run after another.
    pub not_asked_runs: Vec<u32>,
    /// Runs of samples whose area has another weight than 1 in the score.
    pub weighted_runs: Vec<WeightedRun>,
}

/// Consecutive samples of one weight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WeightedRun {
    /// Number of the first sample.
    pub first_sample: u32,
    /// Number of samples.
    pub samples: u32,
    /// Weight of their area in the score.
    pub weight: f64,
}

/// A candidate with its row of each matrix.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CandidateDocument {
    /// Number in the order generated: `candidate` of a viewpoint in `plan.json`.
    pub id: u32,
    /// Setup that it was generated for: an index into `setups` of this document.
    pub setup: u32,
    /// Side of the part that it looks at.
    #[schema(value_type = crate::planning::candidates::Label)]
    pub label: String,
    /// Pose of the scanner in the part frame.
    pub part_from_scanner: PoseSpec,
    /// Fate of the candidate.
    #[schema(value_type = crate::planning::verdict::Fate)]
    pub fate: String,
    /// Reason for which it was dropped; `null` if it was not.
    #[schema(value_type = Option<crate::planning::candidates::Rejection>)]
    pub dropped_because: Option<String>,
    /// Id of its viewpoint in `plan.json`; `null` if it has none.
    pub viewpoint: Option<u32>,
    /// Asked area that it measures; `null` if it was dropped before that was evaluated.
    pub measured_area_mm2: Option<f64>,
    /// Score G_v = a·G_c + b·G_q of the candidate by itself, mm²: over all asked samples that it measures, before any other
    /// view is chosen. `null` with `measured_area_mm2`.
    pub score_mm2: Option<f64>,
    /// Row of H in runs: the first sample and the number of samples of each run of measured samples, one run after another,
    /// ascending.
    pub measured_runs: Vec<u32>,
    /// Row of G: quality of each measured sample, ascending by sample, to four decimals.
    pub quality: Vec<f32>,
}

/// Reason for which a listing was given up.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ListingError {
    /// The job was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The file would be too large.
    #[error("it would be larger than {max_mib} MiB; reduce part.samples_per_mm2 or the number of candidates")]
    TooLarge {
        /// Size that is allowed, MiB.
        max_mib: usize,
    },
}

/// Bytes of the file; `None` where the job does not ask for it. `plan_sha256` is the hash of the plan's file.
///
/// # Errors
/// [`ListingError`]; files may have [`MAX_LISTING_BYTES`].
#[must_use]
pub fn file_bytes(outcome: &Outcome, mesh: &Mesh, plan_sha256: &str, ctx: &Context<'_>) -> Option<Result<Vec<u8>, ListingError>> {
    outcome.candidates.as_ref().map(|table| write(outcome, table, mesh, plan_sha256, MAX_LISTING_BYTES, ctx))
}

fn write(
    outcome: &Outcome,
    table: &CandidateTable,
    mesh: &Mesh,
    plan_sha256: &str,
    max_bytes: usize,
    ctx: &Context<'_>,
) -> Result<Vec<u8>, ListingError> {
    let (surface, score) = (&outcome.surface, &outcome.plan.params.score);
    let too_large = || ListingError::TooLarge { max_mib: max_bytes >> 20 };
    if surface.patches.len().saturating_mul(PATCH_BYTES) > max_bytes {
        return Err(too_large());
    }
    let head = CandidateListing {
        schema: CANDIDATES_SCHEMA.to_owned(),
        plan_sha256: plan_sha256.to_owned(),
        score: score.clone(),
        setups: table.setups.iter().map(PoseSpec::from).collect(),
        samples: columns(surface, mesh),
        candidates: Vec::new(),
    };
    let mut bytes = compact(&head);
    // The empty list of candidates is the end of it: what follows stands in that list.
    bytes.truncate(bytes.len() - b"]}".len());
    let areas_mm2 = surface.asked_area_mm2();
    for (number, entry) in table.entries.iter().enumerate() {
        ctx.check()?;
        bytes.extend_from_slice(if number == 0 { b"\n" } else { b",\n" });
        bytes.extend_from_slice(&compact(&document(entry, surface, &areas_mm2, score)));
        if bytes.len() > max_bytes {
            return Err(too_large());
        }
    }
    bytes.extend_from_slice(b"\n]}\n");
    Ok(bytes)
}

/// JSON without white space.
///
/// # Panics
/// Never for the documents of this file: structs with field names always serialise.
fn compact(document: &impl Serialize) -> Vec<u8> {
    serde_json::to_vec(document).expect("plain structs serialise")
}

fn columns(surface: &Surface, mesh: &Mesh) -> SampleColumns {
    let patches = &surface.patches;
    let not_asked = surface.samples().filter(|sample| !surface.asked[sample.index()]);
    SampleColumns {
        count: surface.sample_mm.len(),
        patch_first_sample: patches.iter().map(|patch| patch.first_sample.0).collect(),
        patch_face: patches.iter().map(|patch| mesh.source_face[patch.face as usize]).collect(),
        patch_sample_area_mm2: patches.iter().map(Patch::sample_area_mm2).collect(),
        not_asked_runs: runs(not_asked).into_iter().flatten().collect(),
        weighted_runs: weighted_runs(surface),
    }
}

/// First sample and number of samples of each run of consecutive samples.
fn runs(samples: impl Iterator<Item = SampleId>) -> Vec<[u32; 2]> {
    let mut runs: Vec<[u32; 2]> = Vec::new();
    for SampleId(sample) in samples {
        match runs.last_mut() {
            Some([first, count]) if *first + *count == sample => *count += 1,
            _ => runs.push([sample, 1]),
        }
    }
    runs
}

fn weighted_runs(surface: &Surface) -> Vec<WeightedRun> {
    let requirements = &surface.requirements;
    let mut found: Vec<WeightedRun> = Vec::new();
    if requirements.kinds.iter().all(|kind| kind.weight.to_bits() == 1.0_f64.to_bits()) {
        return found;
    }
    for sample in surface.samples() {
        let weight = requirements.of(sample).weight;
        match found.last_mut() {
            Some(run) if run.first_sample + run.samples == sample.0 && run.weight.to_bits() == weight.to_bits() => {
                run.samples += 1
            }
            _ => found.push(WeightedRun { first_sample: sample.0, samples: 1, weight }),
        }
    }
    found.retain(|run| run.weight.to_bits() != 1.0_f64.to_bits());
    found
}

fn document(entry: &TableEntry, surface: &Surface, areas_mm2: &[f64], score: &ScoreParams) -> CandidateDocument {
    let TableEntry { candidate, fate, row } = entry;
    CandidateDocument {
        id: candidate.id.0,
        setup: candidate.setup.0,
        label: candidate.label.as_str().to_owned(),
        part_from_scanner: PoseSpec::from(&candidate.part_from_scanner),
        fate: fate.fate.as_str().to_owned(),
        dropped_because: fate.rejection.map(|reason| reason.as_str().to_owned()),
        viewpoint: fate.view.map(|view| view.0),
        measured_area_mm2: row.as_ref().map(|row| total(row.samples().map(|sample| areas_mm2[sample.index()]))),
        score_mm2: row.as_ref().map(|row| score_mm2(row, surface, areas_mm2, score)),
        measured_runs: row.iter().flat_map(|row| runs(row.samples())).flatten().collect(),
        quality: row.iter().flat_map(Row::graded).map(|(_, quality)| rounded(quality)).collect(),
    }
}

/// G_v over everything asked that a row measures.
fn score_mm2(row: &Row, surface: &Surface, areas_mm2: &[f64], score: &ScoreParams) -> f64 {
    let of_sample = |(sample, quality): (SampleId, f32)| {
        areas_mm2[sample.index()] * surface.requirements.of(sample).weight * score.value(f64::from(quality))
    };
    total(row.graded().map(of_sample))
}

/// Quality to four decimals; never −0.
fn rounded(quality: f32) -> f32 {
    (quality * QUALITY_STEPS).round() / QUALITY_STEPS + 0.0
}
