//! Scale of the lengths to the board against those of the arm's motions. A camera sees a board whose size was given k times too
//! large k times too far away: C = (R, k · t). Along the view X takes that up, as a shift of the scanner; what is left to see is
//! how the distance, and the place in the image, change with the motions of the arm, whose lengths are known. k is one more
//! unknown of a trial solution: the step of Gauss & Newton with the other unknowns eliminated (Schur complement), from
//! observations that are divided by the k of the step before. Where the camera lies away from the origin of the clouds, at p in
//! their frame, that adds (1 - k) · p to every place, which X takes up: k is the same, and so is the shift of the scanner. Costs a
//! refinement a round.

use nalgebra::{Isometry3, Vector3};

use super::data::{Sighting, Weighting};
use super::refine::{Adjustment, Increment, Refined};
use super::se3::twist;

/// Fewest rounds: the first step is linear in k, the second is exact to the noise, the third shows its deviation.
const MIN_ROUNDS: usize = 3;
/// Rounds after which it ends, converged or not.
const MAX_ROUNDS: usize = 10;
/// Size of the last step, in standard deviations, up to which k has converged: it adds half a percent to the deviation (√1.01).
const SETTLED: f64 = 0.1;
/// Share of the information on k that the other unknowns have to leave: below it k is theirs altogether.
const MIN_INFORMATION: f64 = 1e-12;
/// Standard deviations from 1 beyond which the scale is off, where they are known: normal errors exceed them in 1 of 1000
/// calibrations, the rate of false alarms of observations that were held out.
const MIN_DEVIATIONS: f64 = 3.29;
/// Deviations that share the degrees of freedom where they are estimated: turn and place of arm and of board. With a bound for
/// all of the freedom the scale of one sound board in 44 was told as off at 6 observations, and in 110 at 8 (simulated).
const ESTIMATED: f64 = 4.0;
/// Deviation from 1 that is worth a finding: 0.24 mm at 480 mm. A printed board is hardly made to less; no source.
const MIN_OFF: f64 = 5e-4;

/// Scale of the lengths to the board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardScale {
    /// Lengths to the board, as they were given, over those that the arm's motions tell: size of the board as given over its true
    /// one.
    pub ratio: f64,
    /// Standard deviation of that.
    pub sd: f64,
    /// Distance from the scanner, not from the origin of its clouds, to the point of best focus, mm: a ratio that is off moves
    /// the scanner by its share of it.
    pub distance_mm: f64,
    /// Rounds that it took.
    pub rounds: usize,
    /// True if the last round left it where it was, and the other unknowns with it; false if it ended at the limit of rounds.
    pub is_converged: bool,
    /// Standard deviations from 1 beyond which it is off.
    min_deviations: f64,
}

impl BoardScale {
    /// Scale that observations tell; `None` where they leave it open. With `estimate_sigma` the deviations are estimated anew,
    /// since those that were estimated with the scale held have its error in them.
    #[must_use]
    pub(super) fn of(
        refined: &Refined,
        used: &[Sighting],
        weighting: &Weighting,
        estimate_sigma: bool,
        distance_mm: f64,
    ) -> Option<Self> {
        let (mut at, mut weighting, mut ratio, mut sd) = (refined.estimate, *weighting, 1.0, 0.0);
        let (mut min_deviations, mut rounds, mut is_converged) = (MIN_DEVIATIONS, 0, false);
        while rounds < MIN_ROUNDS || (!is_converged && rounds < MAX_ROUNDS) {
            let divided: Vec<Sighting> = used.iter().map(|each| divided(each, ratio)).collect();
            let problem = Adjustment { sightings: &divided, free: refined.free, prior: None };
            let found =
                if estimate_sigma { problem.refine_with_sigma(&at, &weighting)? } else { problem.refine(&at, &weighting)? };
            let (step, step_sd) = step(&found, &divided)?;
            let widened = if estimate_sigma { 1.0 } else { found.variance_factor().max(1.0).sqrt() };
            (ratio, sd) = (ratio * (1.0 + step), step_sd * widened);
            if estimate_sigma {
                min_deviations = as_rare(found.freedom() as f64 / ESTIMATED);
            }
            (at, weighting) = (found.estimate, found.weighting);
            is_converged = found.is_converged && step.abs() <= SETTLED * step_sd;
            rounds += 1;
        }
        let is_told = ratio.is_finite() && ratio > 0.0 && sd.is_finite();
        is_told.then_some(Self { ratio, sd, distance_mm, rounds, is_converged, min_deviations })
    }

    /// Returns true if the scale has converged, and is off by more than its uncertainty and by enough to matter.
    #[must_use]
    pub fn is_off(&self) -> bool {
        let off = (self.ratio - 1.0).abs();
        self.is_converged && off > MIN_OFF && off > self.min_deviations * self.sd
    }

    /// Distance by which the scanner is put off along its view, mm.
    #[must_use]
    pub fn shift_mm(&self) -> f64 {
        (self.ratio - 1.0).abs() * self.distance_mm
    }

    /// Standard deviation that a board of unknown size leaves the scanner along its view, mm.
    #[must_use]
    pub fn shift_sd_mm(&self) -> f64 {
        self.sd * self.distance_mm
    }
}

/// Estimated standard deviations that are exceeded as seldom as [`MIN_DEVIATIONS`] known ones: the quantile of Student's t by its
/// expansion (Abramowitz & Stegun 26.7.5), 5 % below the exact one with 6 degrees of freedom.
fn as_rare(freedom: f64) -> f64 {
    let (z, freedom) = (MIN_DEVIATIONS, freedom.max(1.0));
    let [cube, fifth] = [3, 5].map(|power| z.powi(power));
    z + (cube + z) / (4.0 * freedom) + (5.0 * fifth + 16.0 * cube + 3.0 * z) / (96.0 * freedom.powi(2))
}

/// The observation with lengths to the board divided by a ratio.
pub(super) fn divided(sighting: &Sighting, ratio: f64) -> Sighting {
    let mut place = sighting.cloud_from_board.translation;
    place.vector /= ratio;
    Sighting { cloud_from_board: Isometry3::from_parts(place, sighting.cloud_from_board.rotation), ..sighting.clone() }
}

/// Relative change of the scale that fits best, and its standard deviation, the other unknowns fitted with it.
fn step(at: &Refined, sightings: &[Sighting]) -> Option<(f64, f64)> {
    let (mut own, mut side) = (0.0, 0.0);
    let (mut coupling, mut others) = (Increment::zeros(), Increment::zeros());
    for sighting in sightings {
        let linear = at.linear(sighting)?;
        // A larger scale moves the observation, divided by it, towards the camera, and the residual leads back.
        let back = sighting.cloud_from_board.rotation.inverse() * sighting.cloud_from_board.translation.vector;
        let by_scale = twist(&Vector3::zeros(), &back);
        let weighted = linear.weight * by_scale;
        own += by_scale.dot(&weighted);
        side += weighted.dot(&linear.residual);
        coupling += linear.rows.transpose() * weighted;
        others += linear.rows.transpose() * (linear.weight * linear.residual);
    }
    let through = at.covariance * coupling;
    let information = own - coupling.dot(&through);
    (information > MIN_INFORMATION * own).then(|| ((through.dot(&others) - side) / information, information.sqrt().recip()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tables of Student's t, two-sided, 0.1 %.
    #[test]
    fn estimated_deviations_have_to_be_exceeded_by_more_the_fewer_observations_they_are_of() {
        for (freedom, quantile, within) in [(9.0, 4.781, 0.1), (15.0, 4.073, 0.03), (30.0, 3.646, 0.01), (1e6, 3.291, 0.002)] {
            let found = as_rare(freedom);
            assert!((found - quantile).abs() < within, "{found} for {freedom}");
        }
        let scale = BoardScale {
            ratio: 1.004,
            sd: 0.001,
            distance_mm: 480.0,
            rounds: 3,
            is_converged: true,
            min_deviations: MIN_DEVIATIONS,
        };
        assert!(scale.is_off() && !BoardScale { min_deviations: as_rare(6.0), ..scale }.is_off());
        assert!(!BoardScale { is_converged: false, ..scale }.is_off(), "a ratio on its way tells no size");
    }
}
