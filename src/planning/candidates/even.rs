//! Directions spread evenly (Swinbank and Purser 2006, *Fibonacci grids: a novel approach to global modelling*): points of
//! equal share of the area on a spiral that turns by the golden angle. Used on the same stand-off ellipsoid as the
//! thesis's grid, whose directions crowd near the poles.

use nalgebra::Vector3;

use super::aim::semi_axes_mm;
use super::blocks::{self, PartBlock};
use super::{Aim, EVEN_DIRECTIONS, Scope};
use crate::planning::context::PlanError;
use crate::planning::params::{CandidateParams, Hemisphere};

/// Directions of a block at least: with two rolls as many views as the thesis's 54.
const MIN_DIRECTIONS: f64 = 27.0;

pub(super) fn aims(
    scope: &Scope<'_>,
    params: &CandidateParams,
    bound: impl Fn(usize) -> Result<(), PlanError>,
) -> Result<Vec<Aim>, PlanError> {
    let blocks = blocks::split(scope.surface, &scope.table_from_part, scope.scanner);
    let count = directions_a_block(params.even_directions.unwrap_or(EVEN_DIRECTIONS as u32), blocks.len());
    bound(blocks.len().saturating_mul(count))?;
    let of_block = |block: &PartBlock| {
        let directions = spiral(count, lowest(block, scope, params));
        directions.map(|u| Aim::at_block(block, &u, scope, params.standoff)).collect::<Vec<_>>()
    };
    Ok(blocks.iter().flat_map(of_block).collect())
}

/// Blocks see each other's surface, so that each needs fewer directions the more there are.
pub(super) fn directions_a_block(directions: u32, blocks: usize) -> usize {
    let all = f64::from(directions);
    (all / (blocks as f64).sqrt()).round().max(MIN_DIRECTIONS.min(all)) as usize
}

/// The least z of directions from which a block is seen with the viewpoint above the plate, where that is asked for.
pub(super) fn lowest(block: &PartBlock, scope: &Scope<'_>, params: &CandidateParams) -> f64 {
    if params.hemisphere != Some(Hemisphere::AboveTable) {
        return -1.0;
    }
    (-block.centre.z / semi_axes_mm(block, scope, params.standoff).z).clamp(-1.0, 0.0)
}

/// `count` unit vectors, evenly over the cap of the sphere where z ≥ `lowest`; from the top down.
pub(in crate::planning) fn spiral(count: usize, lowest: f64) -> impl Iterator<Item = Vector3<f64>> {
    let golden_rad = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (1.0 - lowest) * (i as f64 + 0.5) / count as f64;
        let (sin, cos) = (golden_rad * i as f64).sin_cos();
        let across = (1.0 - z * z).max(0.0).sqrt();
        Vector3::new(across * cos, across * sin, z)
    })
}
