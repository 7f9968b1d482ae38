//! Mounting of the scanner: which face of its housing is bolted to the flange, and what pose that makes.

use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::closed_list::closed_list;
use crate::geometry::{Aabb, Flange, Pose, ScannerFrame};

closed_list! {
    /// Face of the scanner's housing that the flange is bolted to.
    pub enum HousingFace {
        /// Rear, −z of the scanner.
        Back = "back",
        /// Upper face, −y.
        Top = "top",
        /// Lower face, +y.
        Bottom = "bottom",
        /// Left end, −x.
        Left = "left",
        /// Right end, +x.
        Right = "right",
    }
}

impl HousingFace {
    /// Direction from outside into the face, scanner frame.
    fn inward(self) -> Vector3<f64> {
        match self {
            Self::Back => Vector3::z(),
            Self::Top => Vector3::y(),
            Self::Bottom => -Vector3::y(),
            Self::Left => Vector3::x(),
            Self::Right => -Vector3::x(),
        }
    }

    /// Hand-eye pose with the flange on this face: the flange's axis points into the middle of the face of the box around the
    /// housing, its x axis along the scanner's z (along x for the back), `adapter_mm` away from it.
    #[must_use]
    pub fn flange_from_scanner(self, housing: &Aabb, adapter_mm: f64) -> Pose<Flange, ScannerFrame> {
        let (into, half) = (self.inward(), 0.5 * housing.extent_mm());
        let x = if self == Self::Back { Vector3::x() } else { Vector3::z() };
        let axes = Rotation3::from_basis_unchecked(&[x, into.cross(&x), into]);
        let origin = housing.centre().coords - into * (half.dot(&into.abs()) + adapter_mm);
        let scanner_from_flange = Isometry3::from_parts(Translation3::from(origin), UnitQuaternion::from_rotation_matrix(&axes));
        Pose::<ScannerFrame, Flange>::claim(scanner_from_flange).inverse()
    }
}
