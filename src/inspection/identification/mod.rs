//! Lessons of scans about the scanner: the noise of its points, the incidence beyond which it returns little, the cone in which
//! glare blinds it, the depths at which it works, each with an interval and counts; and how often it returns a point at all, by
//! these. From figures that differ from the specification follows what to change there or in the parameters of the next plan; it is
//! offered, and never applied by itself.

mod isotonic;
mod model;
mod noise;
mod offer;
mod rates;
#[cfg(test)]
mod scanned;
#[cfg(test)]
mod sound;
mod telling;
#[cfg(test)]
mod tests;
mod triples;

pub use model::ReturnModel;
pub use noise::{MIN_TRIPLES, NoiseEstimate, NoiseTriple, noise};
pub use offer::{Offer, OfferedChange, OfferedField, incidence_gap, offers};
pub use rates::{LearnedReturns, LimitEstimate, RateBin, RateCurve, returns};
pub use telling::{Telling, TellingInput, Withheld, telling};
pub use triples::{TripleInput, triples};

/// A figure with its interval of 95 % confidence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Identified {
    /// The figure.
    pub value: f64,
    /// Ends of the interval.
    pub interval: [f64; 2],
}

/// Everything that scans of one scanner teach.
#[derive(Clone, Debug, PartialEq)]
pub struct Learned {
    /// Noise of its points; `None` where too few lie on planes, and of a merged cloud, whose points are no scanner's own.
    pub noise: Option<NoiseEstimate>,
    /// Limits and rates of return; `None` where too few pairs tell.
    pub returns: Option<LearnedReturns>,
}
