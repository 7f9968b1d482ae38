//! Two parts made by code, for demonstrations and reproducible benchmarks: a consumer product with edges, ribs and
//! pockets, and a figurine of blended bodies. Each is a distance field ([`field`]) turned into triangles ([`contour`])
//! at any resolution. Same triangle target, same bytes. In millimetres, standing on z = 0, centred on the z axis;
//! every coordinate is a 32-bit float, so that STL keeps the mesh exactly.
//! Cost: about 20 ms for 20 000 triangles, linear in their number.

mod base;
mod contour;
mod field;
mod figurine;

use std::fmt;
use std::ops::RangeInclusive;
use std::str::FromStr;

use super::{Aabb, Mesh};
use field::DistanceField;

/// Triangles of a demo part unless asked otherwise.
pub const DEFAULT_TRIANGLES: usize = 20_000;

/// Triangle counts that the parts can be made with: fewer lose the ribs, more are not worth their memory.
pub const TRIANGLES: RangeInclusive<usize> = 8_000..=2_000_000;

/// The parts there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DemoPart {
    /// [`base()`]
    Base,
    /// [`figurine()`]
    Figurine,
}

/// Reason why there is no such part.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DemoPartError {
    /// The count is not in [`TRIANGLES`].
    #[error("{0} triangles are asked for; a demo part can have {min} to {max}", min = TRIANGLES.start(), max = TRIANGLES.end())]
    TriangleCount(usize),
    /// No resolution near the one asked for gives a closed surface of one body.
    #[error("no resolution near {0} triangles gives a sound mesh of this part; ask for another count")]
    NoSoundMesh(usize),
    /// The text is not the name of a part.
    #[error("{0:?} is not a demo part; there are base and figurine")]
    UnknownPart(String),
}

impl DemoPart {
    /// Every part.
    pub const ALL: [Self; 2] = [Self::Base, Self::Figurine];

    /// Name of the part on the command line.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Base => "base",
            Self::Figurine => "figurine",
        }
    }

    /// The part with `target_triangles` ± 10 %.
    ///
    /// # Errors
    /// [`DemoPartError::TriangleCount`]; [`DemoPartError::NoSoundMesh`], which no count of [`TRIANGLES`] is known to give.
    pub fn mesh(self, target_triangles: usize) -> Result<Mesh, DemoPartError> {
        match self {
            Self::Base => base(target_triangles),
            Self::Figurine => figurine(target_triangles),
        }
    }
}

impl fmt::Display for DemoPart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl FromStr for DemoPart {
    type Err = DemoPartError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|part| part.as_str() == name).ok_or_else(|| DemoPartError::UnknownPart(name.into()))
    }
}

/// A charging base of 121 × 73 × 37 mm: a rounded plinth with a raised cradle, ribs, bosses, pockets with right-angle
/// inner edges, blind holes and a trough that hides its own floor. Flat underside.
///
/// # Errors
/// The errors of [`DemoPart::mesh`].
pub fn base(target_triangles: usize) -> Result<Mesh, DemoPartError> {
    make(&base::distance_mm, &base::BOUNDS_MM, target_triangles)
}

/// A standing toy animal about 150 mm tall: head, ears, belly, legs, tail and two arms, one raised and one on the hip,
/// that occlude each other. Flat soles.
///
/// # Errors
/// The errors of [`DemoPart::mesh`].
pub fn figurine(target_triangles: usize) -> Result<Mesh, DemoPartError> {
    make(&figurine::distance_mm, &figurine::BOUNDS_MM, target_triangles)
}

fn make(field: &impl DistanceField, [min, max]: &[[f64; 3]; 2], target_triangles: usize) -> Result<Mesh, DemoPartError> {
    if !TRIANGLES.contains(&target_triangles) {
        return Err(DemoPartError::TriangleCount(target_triangles));
    }
    let bounds = Aabb { min: (*min).into(), max: (*max).into() };
    contour::with_triangles(field, &bounds, target_triangles).ok_or(DemoPartError::NoSoundMesh(target_triangles))
}

#[cfg(test)]
mod tests;
