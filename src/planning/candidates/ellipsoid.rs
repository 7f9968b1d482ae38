//! Directions of the thesis's Algorithm 1 ([`crate::planning::method::candidates`]): zenith and nadir once each, first; then
//! the polar angle in `small` steps, the azimuth in `large` steps near the poles (θ ≤ 45° or > 135°) and in `small` steps
//! between. With 30° and 45° that is 54 directions a block.

use nalgebra::Vector3;

use super::{Aim, Scope, blocks};
use crate::planning::context::PlanError;
use crate::planning::params::CandidateParams;

pub(super) fn aims(
    scope: &Scope<'_>,
    params: &CandidateParams,
    bound: impl Fn(usize) -> Result<(), PlanError>,
) -> Result<Vec<Aim>, PlanError> {
    let (blocks, directions) = (
        blocks::split(scope.surface, &scope.table_from_part, scope.scanner),
        directions(params.step_small_deg, params.step_large_deg),
    );
    bound(blocks.len().saturating_mul(directions.len()))?;
    let aim = |block, u| Aim::at_block(block, u, scope, params.standoff);
    Ok(blocks.iter().flat_map(|block| directions.iter().map(move |u| aim(block, u))).collect())
}

/// Points of the unit sphere.
pub(super) fn directions(small_deg: f64, large_deg: f64) -> Vec<Vector3<f64>> {
    // Slack against rounding of the grid: 180° and 360° themselves are never a step.
    const SLACK_DEG: f64 = 1e-9;
    let steps =
        |step_deg: f64, end_deg: f64| (0..).map(move |i| f64::from(i) * step_deg).take_while(move |a| *a < end_deg - SLACK_DEG);
    let mut directions = vec![Vector3::z(), -Vector3::z()];
    for theta_deg in steps(small_deg, 180.0).skip(1) {
        let near_pole = theta_deg <= 45.0 + SLACK_DEG || theta_deg > 135.0 + SLACK_DEG;
        for phi_deg in steps(if near_pole { large_deg } else { small_deg }, 360.0) {
            let ((sin_theta, cos_theta), (sin_phi, cos_phi)) = (theta_deg.to_radians().sin_cos(), phi_deg.to_radians().sin_cos());
            directions.push(Vector3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta));
        }
    }
    directions
}
