//! Grades of measured area ([`crate::planning::method::quality`]).

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Grade of a sample from its best chosen view's quality: A > 0.5, B > 0, C > −0.5, D the rest
/// ([`crate::planning::method::quality`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema)]
pub enum Grade {
    /// Above 0.5.
    A,
    /// Above 0.
    B,
    /// Above −0.5.
    C,
    /// The rest.
    D,
}

impl Grade {
    /// The grade of a quality c·Q_δ + d·Q_dis.
    #[must_use]
    pub fn of(quality: f64) -> Self {
        match quality {
            q if q > 0.5 => Self::A,
            q if q > 0.0 => Self::B,
            q if q > -0.5 => Self::C,
            _ => Self::D,
        }
    }

    /// The quality that is just not enough for it; nothing is worse than D.
    #[must_use]
    pub fn above(self) -> f64 {
        match self {
            Self::A => 0.5,
            Self::B => 0.0,
            Self::C => -0.5,
            Self::D => f64::NEG_INFINITY,
        }
    }
}
