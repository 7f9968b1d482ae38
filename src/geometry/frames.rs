//! Typed frames and the poses between them. `Pose<To, From>` maps coordinates given in `From` to coordinates in `To`,
//! so a chain reads by adjacent words: `base_from_flange * flange_from_scanner` is a `Pose<Base, ScannerFrame>`.
//!
//! Lengths are millimetres. The frames are those of [`crate::planning::method::frames`].

use std::fmt;
use std::marker::PhantomData;
use std::ops::Mul;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// The mesh as uploaded.
#[derive(Clone, Copy, Debug)]
pub enum Part {}
/// The turntable: plate's centre at zero angle, +z = axis, up. The frame itself does not turn.
#[derive(Clone, Copy, Debug)]
pub enum Table {}
/// The plate that turns with the table: equal to [`Table`] at angle zero.
#[derive(Clone, Copy, Debug)]
pub enum Plate {}
/// The robot's foot.
#[derive(Clone, Copy, Debug)]
pub enum Base {}
/// The robot's mounting flange.
#[derive(Clone, Copy, Debug)]
pub enum Flange {}
/// The scanner: origin = the viewpoint, +z = viewing axis, +x along the baseline from the left to the right camera.
#[derive(Clone, Copy, Debug)]
pub enum ScannerFrame {}
/// The clouds of the scanner as its vendor delivers them; named by the scanner's specification, seldom the scanner's own frame.
#[derive(Clone, Copy, Debug)]
pub enum Cloud {}
/// A calibration board, in the coordinates that its maker prints.
#[derive(Clone, Copy, Debug)]
pub enum Board {}
/// One optical device of the scanner: origin = optical centre, +z = its optical axis, +x right and +y down in the image.
#[derive(Clone, Copy, Debug)]
pub enum Device {}

/// Rigid transform that takes coordinates in `From` to coordinates in `To`.
pub struct Pose<To, From> {
    isometry: Isometry3<f64>,
    frames: PhantomData<fn(From) -> To>,
}

impl<To, From> Pose<To, From> {
    /// States that `isometry` maps `From` to `To`. This is the only place where such a claim is made.
    #[must_use]
    pub fn claim(isometry: Isometry3<f64>) -> Self {
        Self { isometry, frames: PhantomData }
    }

    /// A claim from a translation in millimetres and a rotation.
    #[must_use]
    pub fn from_parts(translation_mm: Vector3<f64>, rotation: UnitQuaternion<f64>) -> Self {
        Self::claim(Isometry3::from_parts(Translation3::from(translation_mm), rotation))
    }

    /// Both frames coincide.
    #[must_use]
    pub fn identity() -> Self {
        Self::claim(Isometry3::identity())
    }

    /// The inverse: the same relation read the other way.
    #[must_use]
    pub fn inverse(&self) -> Pose<From, To> {
        Pose::claim(self.isometry.inverse())
    }

    /// The plain isometry, for arithmetic inside one function.
    #[must_use]
    pub fn isometry(&self) -> &Isometry3<f64> {
        &self.isometry
    }

    /// Origin of `From`, in `To`.
    #[must_use]
    pub fn origin_mm(&self) -> Point3<f64> {
        Point3::from(self.isometry.translation.vector)
    }

    /// A point given in `From`, expressed in `To`.
    #[must_use]
    pub fn point(&self, point_mm: &Point3<f64>) -> Point3<f64> {
        self.isometry * point_mm
    }

    /// A direction given in `From`, expressed in `To`.
    #[must_use]
    pub fn direction(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        self.isometry.rotation * direction
    }
}

impl<To, From> Clone for Pose<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<To, From> Copy for Pose<To, From> {}
impl<To, From> Default for Pose<To, From> {
    fn default() -> Self {
        Self::identity()
    }
}
impl<To, From> PartialEq for Pose<To, From> {
    fn eq(&self, other: &Self) -> bool {
        self.isometry == other.isometry
    }
}
impl<To, From> fmt::Debug for Pose<To, From> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.isometry.fmt(f)
    }
}

impl<A, B, C> Mul<Pose<B, C>> for Pose<A, B> {
    type Output = Pose<A, C>;
    fn mul(self, rhs: Pose<B, C>) -> Pose<A, C> {
        Pose::claim(self.isometry * rhs.isometry)
    }
}

/// Plate and table coincide at angle zero, and there is where a pose on the table is given: the same pose, on the plate.
#[must_use]
pub fn plate_from_placed<Placed>(table_from_placed: &Pose<Table, Placed>) -> Pose<Plate, Placed> {
    Pose::claim(*table_from_placed.isometry())
}

/// The turning table: where the plate is after it has turned by `angle_rad` about the table's +z.
#[must_use]
pub fn table_from_plate(angle_rad: f64) -> Pose<Table, Plate> {
    Pose::from_parts(Vector3::zeros(), UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle_rad))
}
