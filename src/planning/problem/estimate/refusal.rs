//! Refusals of plans that would take too much: the figure, what is allowed, and the parameter that changes most of it.

use std::fmt;

use super::{Counts, Estimate, Shares};
use crate::planning::candidates;
use crate::planning::context::{Allowance, PlanError};

/// Longest part, in block cubes of the scanner: 21 m where the cube has 140 mm.
const MAX_BLOCKS_ALONG: f64 = 150.0;
/// Times that a plan may be quicker than the estimate: it is refused only where even that would not do.
const ROUGHLY: f64 = 3.0;

/// A part of many times the scanner's block cube.
#[derive(Debug, thiserror::Error)]
#[error(
    "is {x:.0} × {y:.0} × {z:.0} mm, {blocks_along:.0} times the scanner's block cube; allowed is {MAX_BLOCKS_ALONG} times: is \
     this the right unit?",
    x = .extent_mm[0],
    y = .extent_mm[1],
    z = .extent_mm[2]
)]
struct TooLong {
    extent_mm: [f64; 3],
    blocks_along: f64,
}

/// A plan that would take more memory or time than it may.
#[derive(Debug)]
struct TooMuch<'a> {
    takes: Takes,
    counts: &'a Counts,
    /// Largest of what the sum is of.
    largest: f64,
    change: Change,
}

/// Part of the resources that a plan takes at least, and that it may take.
#[derive(Debug)]
enum Takes {
    Memory { bytes: f64, allowed_bytes: f64 },
    Time { core_secs: f64, allowed_core_secs: f64 },
}

/// Parameter to change where a plan would take too much.
#[derive(Clone, Copy, Debug)]
enum Change {
    Regions,
    Candidates,
    MaxViews,
    SampleDensity,
    PatchEdge,
    Triangles,
}

pub(super) fn check(estimate: &Estimate, allowed: &Allowance) -> Result<(), PlanError> {
    let Estimate { counts, bytes, core_secs } = estimate;
    check_size(counts)?;
    let [samples, candidates] = counts.min_counts;
    candidates::check_count(candidates, samples)?;
    if bytes.sum() > allowed.bytes {
        return Err(refuse(counts, bytes, Takes::Memory { bytes: bytes.sum(), allowed_bytes: allowed.bytes }));
    }
    let min_secs = core_secs.sum() / ROUGHLY;
    if min_secs > allowed.core_secs {
        return Err(refuse(counts, core_secs, Takes::Time { core_secs: min_secs, allowed_core_secs: allowed.core_secs }));
    }
    Ok(())
}

fn check_size(counts: &Counts) -> Result<(), PlanError> {
    let longest = counts.blocks_along.iter().fold(0.0, |longest: f64, count| longest.max(*count));
    if longest <= MAX_BLOCKS_ALONG {
        return Ok(());
    }
    Err(PlanError::param("/part", &TooLong { extent_mm: counts.extent_mm, blocks_along: longest }))
}

fn refuse(counts: &Counts, shares: &Shares, takes: Takes) -> PlanError {
    let (largest, change) = most_effective(counts, shares);
    PlanError::param(change.pointer(), &TooMuch { takes, counts, largest, change })
}

/// The largest of `shares`, and the parameter to change where most grows with it.
#[expect(clippy::float_cmp, reason = "the largest is one of those that it is compared with")]
fn most_effective(counts: &Counts, shares: &Shares) -> (f64, Change) {
    let most = shares.triangles.max(shares.samples).max(shares.candidates).max(shares.views).max(shares.regions);
    let change = match () {
        () if most == shares.regions => Change::Regions,
        () if most == shares.candidates => Change::Candidates,
        () if most == shares.views => Change::MaxViews,
        () if most == shares.samples && counts.samples > 2.0 * counts.patches => Change::SampleDensity,
        () if most == shares.samples && counts.patches > 2.0 * counts.triangles => Change::PatchEdge,
        () => Change::Triangles,
    };
    (most, change)
}

impl Change {
    fn pointer(self) -> &'static str {
        match self {
            Self::Regions => "/regions",
            Self::Candidates => "/candidates",
            Self::MaxViews => "/selection/max_views",
            Self::Triangles => "/part",
            Self::SampleDensity => "/part/samples_per_mm2",
            Self::PatchEdge => "/part/patch_edge_mm",
        }
    }
}

/// Largest share of what a plan takes.
struct LargestShare(Change);

impl fmt::Display for LargestShare {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.0 {
            Change::Regions => "regions of interest and features that have a target",
            Change::Candidates => "candidates",
            Change::MaxViews => "views and the tour through them",
            Change::SampleDensity => "samples",
            Change::PatchEdge => "patches",
            Change::Triangles => "triangles, and patches and samples, of which each triangle has at least one",
        })
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Regions => {
                "give fewer regions of interest and features a target, plan them in several jobs, or take fewer selection.samples"
            }
            Self::Candidates => "take larger steps, fewer even_directions, rolls_deg or standoffs_mm, or fewer samples",
            Self::MaxViews => "set selection.max_views to fewer, or plan pieces of the part; is its unit the right one?",
            Self::SampleDensity => "take fewer samples",
            Self::PatchEdge => "take a longer edge",
            Self::Triangles => "simplify the mesh",
        })
    }
}

impl fmt::Display for TooMuch<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Counts { triangles, patches, samples, candidates, views, .. } = self.counts;
        f.write_str("makes the plan take at least ")?;
        match self.takes {
            Takes::Memory { bytes, .. } => write!(f, "{} of memory", gib(bytes))?,
            Takes::Time { core_secs, .. } => write!(f, "{core_secs:.0} s of one core")?,
        }
        write!(
            f,
            ", for {triangles:.0} triangles, {patches:.0} patches, {samples:.0} samples, {candidates:.0} candidates and \
             {views:.0} views; allowed are "
        )?;
        // Settings of the server and options of the command allow more.
        let largest = match self.takes {
            Takes::Memory { allowed_bytes, .. } => {
                write!(f, "{} (limits.job_memory_bytes, --max-memory)", gib(allowed_bytes))?;
                gib(self.largest)
            }
            Takes::Time { allowed_core_secs, .. } => {
                write!(
                    f,
                    "{allowed_core_secs:.0} s of one core, which is the time limit times the threads (limits.job_secs, \
                     --max-secs)"
                )?;
                format!("{:.0} s", self.largest / ROUGHLY)
            }
        };
        write!(f, "; the largest share, {largest}, is for {}: {}", LargestShare(self.change), self.change)
    }
}

impl std::error::Error for TooMuch<'_> {}

/// Bytes for people.
fn gib(bytes: f64) -> String {
    format!("{:.1} GiB", bytes / 1_073_741_824.0)
}
