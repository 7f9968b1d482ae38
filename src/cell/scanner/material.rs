//! Optical material of a surface, as far as projected light is concerned: the share that it scatters in every direction, and the
//! share that it mirrors into a narrow cone.

use crate::cell::closed_list;

closed_list! {
    /// Surface finish with a usual albedo and gloss. The figures are assumed and have no published source.
    pub enum Finish {
        /// White and dull: white resin, scanning spray.
        MatteWhite = "matte_white",
        /// Grey and dull: primer, grey resin.
        Grey = "grey",
        /// Black and dull: rubber, black resin.
        Black = "black",
        /// Metal as a mill or a lathe leaves it: a broad highlight.
        Machined = "machined",
        /// Polished metal: a narrow and bright highlight, and little light elsewhere.
        Polished = "polished",
    }
}

impl Finish {
    /// Material that the finish stands for. A black of 0.05 and a lobe of 4° are those of the simulated scans; the others are
    /// assumed.
    #[must_use]
    pub fn material(self) -> Material {
        let [albedo, gloss, lobe_deg] = match self {
            Self::MatteWhite => [0.8, 0.0, 0.0],
            Self::Grey => [0.4, 0.0, 0.0],
            Self::Black => [0.05, 0.0, 0.0],
            Self::Machined => [0.3, 2.0, 12.0],
            Self::Polished => [0.2, 20.0, 4.0],
        };
        Material { albedo, gloss, lobe_rad: f64::to_radians(lobe_deg) }
    }
}

/// Material: a Lambertian part and a mirror cone of even brightness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// ρ, share of the light that is scattered in every direction, 0 to 1.
    pub albedo: f64,
    /// Brightness inside the mirror cone, relative to a white surface that faces the projector; 0 for dull surfaces.
    pub gloss: f64,
    /// Half the opening of the mirror cone, rad: largest angle between the mirrored ray of the projector and the direction to a
    /// camera at which the camera sees the highlight.
    pub lobe_rad: f64,
}
