//! A part that a locating scan found elsewhere than planned: the program for it, with every view at its place on the part, or in
//! words how to put the part right.

use crate::cell::CollisionScene;
use crate::geometry::{Part, Pose, Table};
use crate::program::Program;

/// A program for the part where it lies.
#[derive(Clone, Debug)]
pub struct Relocated {
    /// Program with re-derived targets; step by step that of before.
    pub program: Program,
    /// The cell with the part where it lies.
    pub scene: CollisionScene,
}

/// Reason why a program does not fit the part where it lies.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Misplaced {
    /// Further off than is corrected.
    #[error("the part lies {mm:.1} mm and {deg:.1}° off; {how}")]
    TooFar {
        /// Distance.
        mm: f64,
        /// Angle, degrees.
        deg: f64,
        /// Words for how to put it right.
        how: String,
    },
}

/// Derives the program for a part from the pose that it was found in.
pub trait Relocate: Send + Sync {
    /// The program for the part at `table_from_part`.
    ///
    /// # Errors
    /// [`Misplaced`].
    fn relocate(&self, program: &Program, table_from_part: &Pose<Table, Part>) -> Result<Relocated, Misplaced>;
}
