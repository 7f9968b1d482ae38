//! Names of the sides of a part ([`crate::planning::method::candidates`]): by polar angle at top and bottom, by azimuth in 90°
//! sectors between.

use nalgebra::Vector3;

use crate::cell::closed_list;

closed_list! {
    /// Side of the part that a viewpoint looks at ([`crate::planning::method::candidates`]).
    pub enum Label {
        /// Polar angle up to 60°.
        Top = "top",
        /// Polar angle from 150°.
        Bottom = "bottom",
        /// Azimuth sector around +x.
        Right = "right",
        /// Azimuth sector around +y.
        Back = "back",
        /// Azimuth sector around −x.
        Left = "left",
        /// Azimuth sector around −y.
        Front = "front",
    }
}

impl Label {
    /// The side that a viewpoint in direction `u` from its block looks at; `u` in the table frame. Sector borders
    /// belong to the sector that starts there, counter-clockwise.
    #[must_use]
    pub fn of_direction(u: &Vector3<f64>) -> Self {
        const TOP_FROM_COS: f64 = 0.5;
        const BOTTOM_TO_COS: f64 = -0.866_025_403_784_438_6;
        // One part in 10⁹ of slack keeps grid directions at exactly 60° and 150° on their side of the border.
        const SLACK: f64 = 1e-9;
        let cos = u.z / u.norm();
        if cos >= TOP_FROM_COS - SLACK {
            return Self::Top;
        }
        if cos <= BOTTOM_TO_COS + SLACK {
            return Self::Bottom;
        }
        let quarter_turns = (u.y.atan2(u.x) / std::f64::consts::FRAC_PI_2 + 0.5 + SLACK).floor().rem_euclid(4.0);
        match quarter_turns as u8 {
            0 => Self::Right,
            1 => Self::Back,
            2 => Self::Left,
            _ => Self::Front,
        }
    }
}
