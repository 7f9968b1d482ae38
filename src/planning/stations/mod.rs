//! Viewpoints to stations: table angle and joint vector, within limits and free of collision.

/// Where the cell takes a view from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Station {
    /// Angle of the table.
    pub table_angle_rad: f64,
    /// Joints of the arm, vendor's convention, windings included.
    pub joints_rad: [f64; 6],
}

/// Why a view has no station.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blocked {
    /// No joint vector within limits at any table angle.
    Unreachable,
    /// Something collides at every one.
    Collision,
}
