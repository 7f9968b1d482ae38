//! One driven axis: a joint of the arm or the table. Also the seven of a cell together, with the time that a straight
//! move in joint space takes.
//!
//! Time law: all axes start and stop together at rest. With s from 0 to 1 along the segment, every axis allows
//! ds/dt ≤ v/|Δ| and d²s/dt² ≤ a/|Δ|; the least of each gives one trapezoid for all.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::field_error::Findings;
use super::field_ranges;

/// Converts to degrees, rounded to 10⁻⁹: this moves a scanner at 1 m by 2·10⁻⁸ mm, and 30° is written as 30.
#[must_use]
pub fn rounded_deg(angle_rad: f64) -> f64 {
    const PER_DEGREE: f64 = 1e9;
    // Adding 0 turns −0 into 0.
    (angle_rad.to_degrees() * PER_DEGREE).round() / PER_DEGREE + 0.0
}

/// Angles of the seven axes of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Configuration {
    /// Joints 1 to 6, vendor's convention, windings included.
    pub joints_rad: [f64; 6],
    /// Angle of the table.
    pub table_rad: f64,
}

impl Configuration {
    /// Configuration of these angles: joints 1 to 6, then the table.
    #[must_use]
    pub fn from_axes_rad([j1, j2, j3, j4, j5, j6, table_rad]: [f64; 7]) -> Self {
        Self { joints_rad: [j1, j2, j3, j4, j5, j6], table_rad }
    }

    /// Configuration with the table's angle as [`rounded_deg`] rounds it: sums of different steps that mean one angle are equal
    /// then, to the bit, and the table that keeps it stands still.
    #[must_use]
    pub fn with_rounded_table(self) -> Self {
        Self { table_rad: rounded_deg(self.table_rad).to_radians(), ..self }
    }

    /// Angles of all axes alike: joints 1 to 6, then the table.
    #[must_use]
    pub fn axes_rad(&self) -> [f64; 7] {
        let [j1, j2, j3, j4, j5, j6] = self.joints_rad;
        [j1, j2, j3, j4, j5, j6, self.table_rad]
    }

    /// Angles of all axes for people to read, degrees rounded to a tenth: joints 1 to 6, then the table.
    #[must_use]
    pub fn axes_tenths_deg(&self) -> [f64; 7] {
        self.axes_rad().map(|angle| (angle.to_degrees() * 10.0).round() / 10.0)
    }

    /// Turn of each axis from here to another configuration.
    #[must_use]
    pub fn travel_rad(&self, to: &Self) -> [f64; 7] {
        let (from, to) = (self.axes_rad(), to.axes_rad());
        std::array::from_fn(|axis| to[axis] - from[axis])
    }

    /// Returns true if the table turns from here to another configuration, by however little.
    #[must_use]
    #[expect(clippy::float_cmp, reason = "a table that stands still keeps its angle to the bit")]
    pub fn turns_table(&self, to: &Self) -> bool {
        self.table_rad != to.table_rad
    }

    /// Returns true if the arm moves from here to another configuration, by however little.
    #[must_use]
    #[expect(clippy::float_cmp, reason = "an arm that stands still keeps its joints to the bit")]
    pub fn moves_arm(&self, to: &Self) -> bool {
        self.joints_rad != to.joints_rad
    }

    /// Turn of the axis that turns furthest from here to another configuration.
    #[must_use]
    pub fn max_turn_rad(&self, to: &Self) -> f64 {
        self.travel_rad(to).into_iter().map(f64::abs).fold(0.0, f64::max)
    }

    /// Length of the straight way from here to another configuration: the root of the sum over all axes.
    #[must_use]
    pub fn distance_rad(&self, to: &Self) -> f64 {
        self.travel_rad(to).into_iter().map(|turn| turn.powi(2)).sum::<f64>().sqrt()
    }

    /// Configuration with each axis further by `share` of its `travel`.
    #[must_use]
    pub fn along(&self, travel: &[f64; 7], share: f64) -> Self {
        let from = self.axes_rad();
        Self::from_axes_rad(std::array::from_fn(|axis| from[axis] + share * travel[axis]))
    }

    /// Configuration at `share` of the straight way to another one.
    #[must_use]
    pub fn toward(&self, to: &Self, share: f64) -> Self {
        self.along(&self.travel_rad(to), share)
    }
}

/// Largest angle that an axis may be given, degrees.
const ANGLE_DEG: f64 = 3600.0;

/// Limits of one joint: -3600 ≤ min < max ≤ 3600.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct AxisSpec {
    /// Lowest angle, degrees.
    pub min_deg: f64,
    /// Highest angle, degrees.
    pub max_deg: f64,
    /// Rated speed, degrees per second, 0.1 to 3600.
    pub max_speed_deg_per_s: f64,
    /// Rated acceleration, degrees per second squared, 0.1 to 100000.
    pub max_acceleration_deg_per_s2: f64,
}

field_ranges! {
    AxisSpec {
        MIN_DEG = "min_deg", [-ANGLE_DEG, ANGLE_DEG] "°";
        MAX_DEG = "max_deg", [-ANGLE_DEG, ANGLE_DEG] "°";
        MAX_SPEED = "max_speed_deg_per_s", [0.1, 3600.0] "°/s";
        MAX_ACCELERATION = "max_acceleration_deg_per_s2", [0.1, 1e5] "°/s²";
    }
}

impl AxisSpec {
    /// Records what is wrong with this axis, below `pointer`.
    pub fn check(&self, pointer: &str, findings: &mut Findings) {
        Self::MIN_DEG.check(pointer, &self.min_deg, findings);
        Self::MAX_DEG.check(pointer, &self.max_deg, findings);
        findings.require(self.min_deg < self.max_deg, format!("{pointer}/min_deg"), || {
            format!("is {}°, not below max_deg {}°", self.min_deg, self.max_deg)
        });
        Self::MAX_SPEED.check(pointer, &self.max_speed_deg_per_s, findings);
        Self::MAX_ACCELERATION.check(pointer, &self.max_acceleration_deg_per_s2, findings);
    }

    /// The axis in radians.
    #[must_use]
    pub fn build(&self) -> Axis {
        Axis {
            min_rad: self.min_deg.to_radians(),
            max_rad: self.max_deg.to_radians(),
            max_speed_rad_per_s: self.max_speed_deg_per_s.to_radians(),
            max_acceleration_rad_per_s2: self.max_acceleration_deg_per_s2.to_radians(),
        }
    }
}

/// Limits of one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    /// Lowest angle.
    pub min_rad: f64,
    /// Highest angle.
    pub max_rad: f64,
    /// Rated speed.
    pub max_speed_rad_per_s: f64,
    /// Rated acceleration.
    pub max_acceleration_rad_per_s2: f64,
}

impl Axis {
    /// Returns true if `angle_rad` is within the limits.
    #[must_use]
    pub fn allows(&self, angle_rad: f64) -> bool {
        self.min_rad <= angle_rad && angle_rad <= self.max_rad
    }

    /// Every angle within the limits that equals `angle_rad` up to whole turns, ascending.
    pub fn windings(&self, angle_rad: f64) -> impl Iterator<Item = f64> + Clone + use<> {
        // The last digit of the division may put an angle on a limit one turn off: start one early, and filter.
        let first = ((self.min_rad - angle_rad) / TAU).ceil() - 1.0;
        let axis = *self;
        let turns = ((self.max_rad - self.min_rad) / TAU) as usize + 3;
        (0..turns).map(move |turn| angle_rad + TAU * (first + turn as f64)).filter(move |angle| axis.allows(*angle))
    }
}

/// The seven axes of a cell: joints 1 to 6 and the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axes(pub [Axis; 7]);

impl Axes {
    /// Returns true if every axis is within its limits.
    #[must_use]
    pub fn allow(&self, configuration: &Configuration) -> bool {
        self.0.iter().zip(configuration.axes_rad()).all(|(axis, angle)| axis.allows(angle))
    }

    /// Every configuration within the limits that differs from `configuration` by whole turns only.
    #[must_use]
    pub fn windings(&self, configuration: &Configuration) -> Vec<Configuration> {
        let mut wound = vec![configuration.axes_rad()];
        // From the last axis to the first: configurations ascend by their first axis, then by the next.
        for (index, axis) in self.0.iter().enumerate().rev() {
            let mut angles = axis.windings(wound[0][index]);
            let Some(lowest) = angles.next() else { return Vec::new() };
            let known = wound.len();
            wound.iter_mut().for_each(|axes_rad| axes_rad[index] = lowest);
            for angle in angles {
                wound.extend_from_within(..known);
                let from = wound.len() - known;
                wound[from..].iter_mut().for_each(|axes_rad| axes_rad[index] = angle);
            }
        }
        wound.into_iter().map(Configuration::from_axes_rad).collect()
    }

    /// Seconds of the straight, synchronised move from rest to rest; `speed_fraction` scales rated speeds and rated
    /// accelerations alike.
    #[must_use]
    pub fn move_secs(&self, from: &Configuration, to: &Configuration, speed_fraction: f64) -> f64 {
        let (mut speed, mut acceleration) = (f64::INFINITY, f64::INFINITY);
        for (axis, travel_rad) in self.0.iter().zip(from.travel_rad(to).map(f64::abs)) {
            if travel_rad > 0.0 {
                speed = speed.min(axis.max_speed_rad_per_s * speed_fraction / travel_rad);
                acceleration = acceleration.min(axis.max_acceleration_rad_per_s2 * speed_fraction / travel_rad);
            }
        }
        match () {
            () if speed.is_infinite() => 0.0,
            () if speed * speed >= acceleration => 2.0 / acceleration.sqrt(),
            () => 1.0 / speed + speed / acceleration,
        }
    }

    /// Seconds of a polyline: every corner is a stop.
    #[must_use]
    pub fn path_secs<'a>(&self, points: impl IntoIterator<Item = &'a Configuration>, speed_fraction: f64) -> f64 {
        let mut points = points.into_iter();
        let Some(mut from) = points.next() else { return 0.0 };
        let mut secs = 0.0;
        for to in points {
            secs += self.move_secs(from, to, speed_fraction);
            from = to;
        }
        secs
    }
}
