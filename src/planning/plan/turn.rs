//! Turns of a part from one way of lying to another, as an operator makes them.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::Vector3;

use crate::cell::closed_list;
use crate::geometry::{Part, Pose, Table};

/// Directions within this angle are one to an operator, who lays a part on a face of it: 20°, our choice.
const ALIKE_RAD: f64 = 20.0 * PI / 180.0;

closed_list! {
    /// PartSide of a part as it lies, named as the sides that viewpoints look at ([`crate::planning::method::candidates`]).
    pub enum PartSide {
        /// Towards +x of the table.
        Right = "right",
        /// Towards +y.
        Back = "back",
        /// Towards −x.
        Left = "left",
        /// Towards −y.
        Front = "front",
    }
}

closed_list! {
    /// Kind of a turn.
    pub enum TurnKind {
        /// The underside stays down.
        None = "none",
        /// The upper side comes down.
        UpsideDown = "upside_down",
        /// A side comes down.
        OnSide = "on_side",
        /// Something between two sides comes down.
        Tilt = "tilt",
    }
}

/// Turn of a part from one way of lying to another: which direction of it comes down. A turn about the vertical is not told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// Kind of turn.
    pub kind: TurnKind,
    /// Side that comes down, or is the nearest to it; as the part lies before.
    pub side: PartSide,
    /// Angle between the direction that points down before and the one that does afterwards, radians.
    pub angle_rad: f64,
}

impl PartSide {
    /// The side in a horizontal direction of the table. A border between two belongs to the one that starts there,
    /// counter-clockwise.
    fn towards(direction: &Vector3<f64>) -> Self {
        let quarter_turns = (direction.y.atan2(direction.x) / FRAC_PI_2 + 0.5).floor().rem_euclid(4.0);
        match quarter_turns as u8 {
            0 => Self::Right,
            1 => Self::Back,
            2 => Self::Left,
            _ => Self::Front,
        }
    }

    fn direction(self) -> Vector3<f64> {
        match self {
            Self::Right => Vector3::x(),
            Self::Back => Vector3::y(),
            Self::Left => -Vector3::x(),
            Self::Front => -Vector3::y(),
        }
    }
}

impl Turn {
    /// The turn of a part that lies as in `before` until it lies as in `after`.
    #[must_use]
    pub fn between(before: &Pose<Table, Part>, after: &Pose<Table, Part>) -> Self {
        let down = before.direction(&after.inverse().direction(&-Vector3::z()));
        let (angle_rad, side) = (down.angle(&-Vector3::z()), PartSide::towards(&down));
        let kind = if angle_rad <= ALIKE_RAD {
            TurnKind::None
        } else if angle_rad >= PI - ALIKE_RAD {
            TurnKind::UpsideDown
        } else if down.angle(&side.direction()) <= ALIKE_RAD {
            TurnKind::OnSide
        } else {
            TurnKind::Tilt
        };
        Self { kind, side, angle_rad }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Unit, UnitQuaternion};

    use super::*;

    /// Pose as filed, turned by so many degrees about an axis of the table.
    fn turned(axis: Vector3<f64>, deg: f64) -> Pose<Table, Part> {
        let turn = UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis), deg.to_radians());
        Pose::from_parts(Vector3::new(3.0, -7.0, 20.0), turn)
    }

    #[test]
    fn six_ways_of_lying_have_names() {
        let as_filed = turned(Vector3::z(), 0.0);
        // A positive turn about y brings +x down, one about x brings −y down.
        for (axis, deg, kind, side) in [
            (Vector3::z(), 0.0, TurnKind::None, None),
            (Vector3::z(), 130.0, TurnKind::None, None),
            (Vector3::x(), 180.0, TurnKind::UpsideDown, None),
            (Vector3::y(), 180.0, TurnKind::UpsideDown, None),
            (Vector3::y(), 90.0, TurnKind::OnSide, Some(PartSide::Right)),
            (Vector3::y(), -90.0, TurnKind::OnSide, Some(PartSide::Left)),
            (Vector3::x(), 90.0, TurnKind::OnSide, Some(PartSide::Front)),
            (Vector3::x(), -90.0, TurnKind::OnSide, Some(PartSide::Back)),
        ] {
            let turn = Turn::between(&as_filed, &turned(axis, deg));
            assert_eq!(turn.kind, kind, "{deg}° about {axis:?}: {turn:?}");
            assert!(side.is_none_or(|side| turn.side == side), "{deg}° about {axis:?}: {turn:?}");
        }
    }

    #[test]
    fn sides_are_those_of_the_part_as_it_lies_before() {
        // Turned by 90° about the vertical, the part's own +x is at the back.
        let before = turned(Vector3::z(), 90.0);
        let after = turned(Vector3::x(), -90.0)
            * Pose::<Part, Part>::from_parts(Vector3::zeros(), UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2));
        let turn = Turn::between(&before, &after);
        assert_eq!((turn.kind, turn.side), (TurnKind::OnSide, PartSide::Back), "{turn:?}");
        assert!((turn.angle_rad - FRAC_PI_2).abs() < 1e-9, "{turn:?}");
    }

    #[test]
    fn anything_else_is_a_tilt_towards_the_nearest_side() {
        let as_filed = turned(Vector3::z(), 0.0);
        let turn = Turn::between(&as_filed, &turned(Vector3::y(), -35.0));
        assert_eq!((turn.kind, turn.side), (TurnKind::Tilt, PartSide::Left), "{turn:?}");
        assert!((turn.angle_rad.to_degrees() - 35.0).abs() < 1e-9, "{turn:?}");
        // Onto the edge between two sides.
        let turn = Turn::between(&as_filed, &turned(Vector3::new(1.0, 0.6, 0.0), 90.0));
        assert_eq!(turn.kind, TurnKind::Tilt, "{turn:?}");
        // What stands on a slanted face 16° off is upside down to an operator.
        assert_eq!(Turn::between(&as_filed, &turned(Vector3::x(), 164.0)).kind, TurnKind::UpsideDown);
    }
}
