//! Seconds of one core that a plan and its result files take, roughly: what was measured on usual parts, by what it grows with.

use super::{Counts, Shares, exchanges, goals_of_regions};
use crate::planning::params::{Engine, PlanParams};
use crate::planning::scene::PlanInput;

/// A pair of candidate and sample, by depth maps and by rays.
const PAIR: f64 = 15e-9;
const PAIR_BY_RAYS: f64 = 500e-9;
/// A candidate: to find its distance, and its stations.
const SLIDE: f64 = 1.5e-3;
const STATIONS: f64 = 0.5e-3;
/// A triangle in each tree and file; a patch or a sample.
const TRIANGLE: f64 = 3e-6;
const SAMPLE: f64 = 2e-6;
/// A picture of the report, and how many there are at most.
const PICTURE: f64 = 0.15;
const MAX_PICTURES: f64 = 54.0;
/// Share of the samples that views miss.
const OPEN: f64 = 0.1;
/// A way between two views.
const WAY: f64 = 2e-3;
/// A million pairs that exchanges look at.
const MILLION_PAIRS: f64 = 1e-3;
/// A sample that views are chosen on in the goal of a region of interest or a feature, over all times that views are chosen.
const SAMPLE_OF_GOAL: f64 = 300e-9;

pub(super) fn taken(counts: &Counts, input: &PlanInput<'_>, params: &PlanParams) -> Shares {
    let Counts { triangles, patches, samples, chosen_on, candidates, views, measured, setups, .. } = *counts;
    let pair = match params.visibility.engine {
        Engine::Raster => PAIR,
        Engine::Rays => PAIR_BY_RAYS,
    };
    let (stations, ways) = if input.cell.is_some() { (STATIONS, WAY * views * views) } else { (0.0, 0.0) };
    // As planned, and under each of twelve errors.
    let castings = if params.robust.select { 13.0 } else { 1.0 };
    let robust = &params.robust;
    let draws = robust.pose_error.map_or(0, |_| robust.draws + robust.part_draws + robust.hand_eye_draws);
    let looked_at = (measured * counts.pairs() * views / 1e6).min(f64::from(params.selection.work_limit));
    let exchanged = if exchanges(params) { MILLION_PAIRS * looked_at } else { 0.0 };
    Shares {
        triangles: TRIANGLE * triangles * (2.0 + setups),
        samples: SAMPLE * (patches + samples),
        candidates: candidates * (SLIDE + stations + castings * pair * chosen_on + OPEN * pair * samples) + exchanged,
        views: views * pair * samples * f64::from(1 + draws) + views.min(MAX_PICTURES) * PICTURE + ways,
        regions: SAMPLE_OF_GOAL * chosen_on * goals_of_regions(params),
    }
}
