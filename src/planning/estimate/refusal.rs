//! Refusals, and what their authors are told: the figure, what is allowed, and the parameter that changes most of it.

use super::{Counts, Estimate, Shares};
use crate::planning::candidates;
use crate::planning::context::{Allowance, PlanError};

/// Longest part, in block cubes of the scanner: 21 m where the cube has 140 mm.
const MAX_BLOCKS_ALONG: f64 = 150.0;
/// Times that a plan may be quicker than the estimate: it is refused only where even that would not do.
const ROUGHLY: f64 = 3.0;
/// Settings of the server and options of the command that allow more.
const MORE_BYTES: &str = "limits.job_memory_bytes, --max-memory";
const MORE_SECS: &str = "limits.job_secs, --max-secs";

pub(super) fn check(estimate: &Estimate, allowed: &Allowance) -> Result<(), PlanError> {
    let Estimate { counts, bytes, core_secs } = estimate;
    check_size(counts)?;
    let [samples, candidates] = counts.least;
    candidates::check_count(candidates, samples)?;
    if bytes.sum() > allowed.bytes {
        let [takes, most] = [bytes.sum(), allowed.bytes].map(gib);
        return Err(refuse(counts, bytes, &format!("{takes} of memory"), &format!("{most} ({MORE_BYTES})")));
    }
    let least_secs = core_secs.sum() / ROUGHLY;
    if least_secs > allowed.core_secs {
        let most = format!("{:.0} s of one core, which is the time limit times the threads ({MORE_SECS})", allowed.core_secs);
        return Err(refuse(counts, core_secs, &format!("{least_secs:.0} s of one core"), &most));
    }
    Ok(())
}

fn check_size(counts: &Counts) -> Result<(), PlanError> {
    let longest = counts.blocks_along.iter().fold(0.0, |longest: f64, count| longest.max(*count));
    if longest <= MAX_BLOCKS_ALONG {
        return Ok(());
    }
    let [x, y, z] = counts.extent_mm;
    let detail = format!(
        "is {x:.0} × {y:.0} × {z:.0} mm, {longest:.0} times the scanner's block cube; allowed is {MAX_BLOCKS_ALONG} times: is \
         this the right unit?"
    );
    Err(PlanError::param("/part", detail))
}

fn refuse(counts: &Counts, shares: &Shares, takes: &str, allowed: &str) -> PlanError {
    let Counts { triangles, patches, samples, candidates, views, .. } = counts;
    let (pointer, advice) = remedy(counts, shares);
    let detail = format!(
        "makes the plan take at least {takes}, for {triangles:.0} triangles, {patches:.0} patches, {samples:.0} samples, \
         {candidates:.0} candidates and {views:.0} views; allowed are {allowed}: {advice}"
    );
    PlanError::param(pointer, detail)
}

/// Names the parameter to change where most grows with the largest of `shares`.
#[expect(clippy::float_cmp, reason = "the largest is one of those that it is compared with")]
fn remedy(counts: &Counts, shares: &Shares) -> (&'static str, &'static str) {
    let most = shares.triangles.max(shares.samples).max(shares.candidates).max(shares.views).max(shares.regions);
    if most == shares.regions {
        return (
            "/regions",
            "give fewer regions of interest and features a target, plan them in several jobs, or take fewer selection.samples",
        );
    }
    if most == shares.candidates {
        return ("/candidates", "take larger steps, fewer even_directions, rolls_deg or standoffs_mm, or fewer samples");
    }
    if most == shares.views {
        return ("/part", "is this the right unit? Else plan pieces of the part, or set selection.max_views");
    }
    if most == shares.samples && counts.samples > 2.0 * counts.patches {
        return ("/part/samples_per_mm2", "take fewer samples");
    }
    if most == shares.samples && counts.patches > 2.0 * counts.triangles {
        return ("/part/patch_edge_mm", "take a longer edge");
    }
    ("/part", "simplify the mesh")
}

/// Bytes for people.
fn gib(bytes: f64) -> String {
    format!("{:.1} GiB", bytes / 1_073_741_824.0)
}
