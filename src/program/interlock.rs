//! A program for controllers that cannot turn the table while the arm moves: every segment that moves both becomes one of
//! the table and one of the arm, in an order that is free of collisions; where neither order is, the segment is halved
//! first, so that the way stays closer to the one that was planned. Costs two to 64 checks of segments for each that
//! moves both.

use super::{Move, Program, Step};
use crate::cell::{Axes, Cell, CollisionScene, Configuration, Contact};

/// Largest number of times that a segment is halved before it is given up.
const HALVINGS: u32 = 4;

/// Arm and table have to move together.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "step {step} moves arm and table together, which this controller cannot, and moving one after the other collides: {contact}"
)]
pub struct Together {
    /// Step of the program, from 0.
    pub step: usize,
    /// The bodies that come too close.
    pub contact: Contact,
}

/// The program with arm and table moving one after the other; the same where they do so already.
///
/// # Errors
/// A segment on which neither order is free.
pub fn interlock(program: &Program, cell: &Cell, scene: &CollisionScene) -> Result<Program, Together> {
    let axes = cell.axes();
    let mut here = program.home_rad;
    let mut steps = Vec::with_capacity(program.steps.len());
    for (index, step) in program.steps.iter().enumerate() {
        steps.push(match step {
            Step::Move(step) => {
                let separate = separate(step, &here, scene, &axes).map_err(|contact| Together { step: index, contact })?;
                here = step.target_rad;
                Step::Move(separate)
            }
            standing @ (Step::Settle { .. } | Step::Scan { .. }) => standing.clone(),
        });
    }
    let cycle_secs = steps.iter().map(Step::secs).sum();
    Ok(Program { steps, cycle_secs, ..program.clone() })
}

fn separate(step: &Move, from: &Configuration, scene: &CollisionScene, axes: &Axes) -> Result<Move, Contact> {
    let mut points = vec![*from];
    for to in step.via_rad.iter().chain([&step.target_rad]) {
        let from = points[points.len() - 1];
        points.extend(corners(&from, to, scene, HALVINGS)?);
    }
    let unchanged = points.len() == step.via_rad.len() + 2;
    let duration_secs = if unchanged { step.duration_secs } else { axes.path_secs(&points, step.speed_fraction) };
    let via_rad = points[1..points.len() - 1].to_vec();
    // One after the other, every corner is a stop.
    let passed_within_rad = step.passed_within_rad.filter(|_| unchanged);
    Ok(Move { via_rad, duration_secs, passed_within_rad, ..step.clone() })
}

/// Points that follow `from`, up to and with `to`.
fn corners(
    from: &Configuration,
    to: &Configuration,
    scene: &CollisionScene,
    halvings: u32,
) -> Result<Vec<Configuration>, Contact> {
    let contact = match scene.corner_between(from, to) {
        Ok(corner) => return Ok(corner.into_iter().chain([*to]).collect()),
        Err(contact) => contact,
    };
    if halvings == 0 {
        return Err(contact);
    }
    let (a, b) = (from.axes_rad(), to.axes_rad());
    let middle = Configuration::from_axes_rad(std::array::from_fn(|axis| 0.5 * (a[axis] + b[axis])));
    let mut points = corners(from, &middle, scene, halvings - 1)?;
    points.extend(corners(&middle, to, scene, halvings - 1)?);
    Ok(points)
}

#[cfg(test)]
mod tests;
