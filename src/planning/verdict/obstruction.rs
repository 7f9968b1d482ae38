//! Pairs of bodies that keep the cell from viewpoints.

use crate::cell::{Configuration, Contact, Separation};

/// Two bodies that are in each other's way.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstruction {
    /// The two bodies.
    pub bodies: Contact,
    /// Candidates that have no station for it.
    pub without_station: usize,
    /// Candidates to whose stations no path was found for it.
    pub without_path: usize,
    /// Configuration at which they meet, for one of the candidates, radians.
    pub configuration: Configuration,
    /// Separation of the two there; of overlapping meshes it is not known.
    pub separation: Option<Separation>,
    /// Change of the cell, or of the job, that would help.
    pub advice: Advice,
}

/// Change that would keep two bodies apart.
#[derive(Clone, Debug, PartialEq)]
pub enum Advice {
    /// Give the cell a home farther from the part: part or fixture meets another body at the home itself, from which no path leads.
    MoveHome,
    /// Give the cell another home: two bodies, neither of them part or fixture, meet at the home itself.
    FreeHome {
        /// The two bodies at home.
        bodies: Contact,
        /// Clearance that the plan asks for, mm.
        clearance_mm: f64,
    },
    /// Ask for a smaller clearance: at most this, mm.
    ReduceClearance(f64),
    /// Move the obstacle of this name, or the table away from it.
    MoveObstacle(String),
    /// Hold the part elsewhere, or plan it in several setups.
    MoveFixture,
    /// Set the table farther from the robot, or the part nearer to its axis: the part meets the robot's foot as the table turns.
    MoveTable,
    /// Lay the part another way, or look at it from farther off.
    TurnPart,
    /// Raise the part above the plate, or the robot's foot.
    RaisePart,
    /// Set the robot's foot nearer to the table or farther off: the arm folds onto itself.
    MoveFoot,
    /// Mount the scanner otherwise.
    MountScanner,
}
