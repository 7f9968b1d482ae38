//! Prediction of each observation from all others, by one step on the normal equations without it (D. M. Allen, *The relationship
//! between variable selection and data augmentation*, Technometrics 16(1), 1974): exact for linear problems, and the steps are small. Costs O(n).

use super::data::Sighting;
use super::refine::{Refined, moved, scaled_inverse};
use super::se3::{Twist, rotation_of, translation_of};

/// Outcome for one observation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// Residual of the observation at what the others tell.
    pub residual: Twist,
    /// Body increment by which the scanner's pose moves without it.
    pub hand_eye_shift: Twist,
}

/// Root mean squares and largest values of a list of twists.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// Root mean square of the turns.
    pub rms_rad: f64,
    /// Root mean square of the shifts.
    pub rms_mm: f64,
    /// Largest turn.
    pub max_rad: f64,
    /// Largest shift.
    pub max_mm: f64,
    /// Median of the turns.
    pub median_rad: f64,
    /// Median of the shifts.
    pub median_mm: f64,
}

impl Spread {
    /// Spread of these; zero for none.
    #[must_use]
    pub fn of(twists: impl IntoIterator<Item = Twist>) -> Self {
        let (mut turns, mut shifts): (Vec<f64>, Vec<f64>) =
            twists.into_iter().map(|each| (rotation_of(&each).norm(), translation_of(&each).norm())).unzip();
        let rms = |values: &[f64]| (values.iter().fold(0.0, |sum, v| sum + v * v) / values.len().max(1) as f64).sqrt();
        turns.sort_by(f64::total_cmp);
        shifts.sort_by(f64::total_cmp);
        let (middle, last) = (turns.len() / 2, turns.len().saturating_sub(1));
        let at = |values: &[f64], index: usize| values.get(index).copied().unwrap_or(0.0);
        Self {
            rms_rad: rms(&turns),
            rms_mm: rms(&shifts),
            max_rad: at(&turns, last),
            max_mm: at(&shifts, last),
            median_rad: at(&turns, middle),
            median_mm: at(&shifts, middle),
        }
    }
}

/// Predicts each of the observations that `refined` was made from by the others. None for one that alone holds an unknown.
#[must_use]
pub fn leave_one_out(refined: &Refined, used: &[Sighting]) -> Vec<Option<LeftOut>> {
    let information = scaled_inverse(&held(refined));
    used.iter()
        .map(|sighting| {
            let each = refined.linear(sighting)?;
            let weighted = each.weight * each.rows;
            let mut normal = information? - masked(refined, &(each.rows.transpose() * weighted));
            normal.fill_upper_triangle_with_lower_triangle();
            // At the minimum the gradients add up to nothing: without this one, its negative is left.
            let mut gradient = -(weighted.transpose() * each.residual);
            mask_rows(refined, &mut gradient);
            let step = -(scaled_inverse(&normal)? * gradient);
            let at = moved(&refined.estimate, &step);
            let hand_eye_shift = step.fixed_rows::<6>(0).into_owned();
            Some(LeftOut { residual: at.residual(sighting), hand_eye_shift })
        })
        .collect()
}

/// Covariance with ones for what was held, so that it can be inverted.
fn held(refined: &Refined) -> super::refine::Square {
    let mut covariance = refined.covariance;
    for column in 0..super::refine::COLUMNS {
        if covariance[(column, column)] <= 0.0 {
            covariance[(column, column)] = 1.0;
        }
    }
    covariance
}

/// Matrix without the rows and columns of what was held.
fn masked(refined: &Refined, matrix: &super::refine::Square) -> super::refine::Square {
    let is_held = |index: usize| refined.covariance[(index, index)] <= 0.0;
    super::refine::Square::from_fn(|row, column| if is_held(row) || is_held(column) { 0.0 } else { matrix[(row, column)] })
}

fn mask_rows(refined: &Refined, gradient: &mut super::refine::Increment) {
    for row in 0..super::refine::COLUMNS {
        if refined.covariance[(row, row)] <= 0.0 {
            gradient[row] = 0.0;
        }
    }
}
