//! Coverage of the chosen views on samples that they were not chosen on.

use super::{IndependentRegion, MeasuredArea, VisibleShares, share};
use crate::planning::params::PoseErrorParams;

/// Coverage of the chosen views on a second set of samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Certificate {
    /// Coverage with the poses as planned.
    pub independent: Independent,
    /// Coverage of each region of interest and feature with the poses as planned, in the order of their numbers.
    pub regions: Vec<IndependentRegion>,
    /// Coverage with poses that are off; with `robust.pose_error`.
    pub robust: Option<Robust>,
}

/// Coverage on a second set of samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Independent {
    /// Samples of the second set.
    pub samples: usize,
    /// Area of those that are asked for.
    pub asked_area_mm2: f64,
    /// Whole surface.
    pub total_area_mm2: f64,
    /// Asked area that neither rests on the plate in every setup nor is enclosed by the part.
    pub visible_area_mm2: f64,
    /// Asked area that the chosen views measure.
    pub measured: MeasuredArea,
}

impl Independent {
    /// Measured share of the asked area.
    #[must_use]
    pub fn of_asked(&self) -> f64 {
        share(self.measured.area_mm2, self.asked_area_mm2)
    }

    /// Measured share of the whole surface.
    #[must_use]
    pub fn of_total(&self) -> f64 {
        share(self.measured.area_mm2, self.total_area_mm2)
    }

    /// Shares of the visible area.
    #[must_use]
    pub fn of_visible(&self) -> VisibleShares {
        self.measured.of_visible(self.visible_area_mm2)
    }
}

/// Coverage with poses that are off, on the second set of samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Robust {
    /// The error.
    pub pose_error: PoseErrorParams,
    /// Every view off by an error of its own.
    pub views: Drawn,
    /// The part and its support off as one: fixture and plate move along, as with a wrong pose of the table.
    pub part: Drawn,
    /// Every view off by the same error in the scanner frame, as a wrong hand-eye calibration puts it.
    pub hand_eye: Drawn,
}

impl Robust {
    /// Largest loss of a plan that tolerates the error, as a share of the asked area: one point. No published source; most parts
    /// of one block lose less ([`crate::planning::method::robustness`]).
    pub const MAX_LOSS: f64 = 0.01;

    /// Largest loss in a draw of any kind, as a share of the asked area.
    #[must_use]
    pub fn worst_loss(&self) -> f64 {
        [&self.views, &self.part, &self.hand_eye].map(|drawn| drawn.nominal - drawn.worst()).into_iter().fold(0.0, f64::max)
    }

    /// Returns true if the plan loses more than [`Robust::MAX_LOSS`].
    #[must_use]
    pub fn is_fragile(&self) -> bool {
        self.worst_loss() > Self::MAX_LOSS
    }
}

/// Measured share of the asked area in a number of draws.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawn {
    /// Share with no error.
    pub nominal: f64,
    /// Share in each draw, ascending; at least one.
    of_asked: Vec<f64>,
}

impl Drawn {
    /// Fewest draws of which the 5th percentile is told: of fewer, it lies between the two worst.
    pub const MIN_DRAWS_OF_P5: usize = 20;

    /// The draws with these shares, of which there is at least one.
    pub fn new(nominal: f64, mut of_asked: Vec<f64>) -> Self {
        of_asked.sort_by(f64::total_cmp);
        Self { nominal, of_asked }
    }

    /// Number of draws.
    #[must_use]
    pub fn draws(&self) -> usize {
        self.of_asked.len()
    }

    /// The least.
    #[must_use]
    pub fn worst(&self) -> f64 {
        self.of_asked[0]
    }

    /// The mean.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.of_asked.iter().sum::<f64>() / self.of_asked.len() as f64
    }

    /// The 5th percentile: linear between the draws on both sides of it. Of fewer than [`Drawn::MIN_DRAWS_OF_P5`] draws it is a value
    /// between the two worst and no percentile; see [`Drawn::told_p5`].
    #[must_use]
    pub fn p5(&self) -> f64 {
        let place = 0.05 * (self.of_asked.len() - 1) as f64;
        let (below, above) = (self.of_asked[place.floor() as usize], self.of_asked[place.ceil() as usize]);
        below + (above - below) * place.fract()
    }

    /// The 5th percentile where there are draws enough for one.
    #[must_use]
    pub fn told_p5(&self) -> Option<f64> {
        (self.draws() >= Self::MIN_DRAWS_OF_P5).then(|| self.p5())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A plan that measures 0.97 and loses so much in the worst draw of each kind.
    fn losing(losses: [f64; 3]) -> Robust {
        let [views, part, hand_eye] = losses.map(|loss| Drawn::new(0.97, vec![0.97, 0.97 - loss, 0.975]));
        let pose_error = PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 };
        Robust { pose_error, views, part, hand_eye }
    }

    #[test]
    fn a_plan_is_fragile_by_the_worst_draw_of_any_kind() {
        assert!(!losing([0.0, 0.009, 0.002]).is_fragile());
        for losses in [[0.011, 0.0, 0.0], [0.0, 0.011, 0.0], [0.0, 0.0, 0.011]] {
            let robust = losing(losses);
            assert!(robust.is_fragile() && (robust.worst_loss() - 0.011).abs() < 1e-12, "{robust:?}");
        }
        // Coverage that a wrong pose happens to gain is no loss.
        assert_eq!(losing([-0.02, -0.02, -0.02]).worst_loss(), 0.0);
    }

    #[test]
    fn a_5th_percentile_is_told_of_20_draws_and_not_of_fewer() {
        let told = |draws: usize| Drawn::new(0.97, vec![0.96; draws]).told_p5();
        assert_eq!([told(1), told(19), told(20)], [None, None, Some(0.96)]);
    }
}
