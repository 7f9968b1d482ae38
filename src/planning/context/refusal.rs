//! Parameters that are each within their range, and do not fit the part, the cell or each other.

use crate::cell::{Contact, PoseSpec};

/// Reason for which parameters do not fit the part, the cell or each other, with its figures. It follows the name of a field.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(in crate::planning) enum Refusal {
    /// The poses of the plan could not be written and read again.
    #[error(
        "reaches {farthest_mm:.0} mm from the origin of its frame; allowed is {max_mm:.0} mm, so that the poses of its plan \
         stay within {} mm: export the mesh with the part near the origin, or give its right unit",
        PoseSpec::REACH_MM
    )]
    FarFromOrigin { farthest_mm: f64, max_mm: f64 },
    /// A part that reaches into the plate.
    #[error("sinks the part {depth_mm:.3} mm into the plate; allowed is {max_mm} mm")]
    Sunk { depth_mm: f64, max_mm: f64 },
    /// A part above the plate that no fixture holds.
    #[error("leaves the part {height_mm:.3} mm above the plate; allowed is {max_mm} mm without a fixture (part.fixture_mesh)")]
    Floating { height_mm: f64, max_mm: f64 },
    /// A part that does not stand on the plate.
    #[error("stands the part {distance_mm:.1} mm from the table's axis, beside the plate (radius {radius_mm} mm)")]
    BesidePlate { distance_mm: f64, radius_mm: f64 },
    /// Part or fixture meets what stands around or below the table.
    #[error("makes {0} collide; move the part, or the body that it collides with")]
    Collides(Contact),
    /// Several setups of a fixture, which holds one.
    #[error("is more than 1 with a fixture, which holds one setup; plan each setup by itself")]
    SetupsOfFixture,
    /// Candidates within a robot's reach are asked for, without a robot.
    #[error("names reach, whose directions are those that a robot reaches; plan with a cell, or take even")]
    ReachWithoutCell,
    /// More candidates than a job may have that has so many samples.
    #[error(
        "and its steps, counts and rolls give {candidates} candidates for {samples} samples; allowed are {max_candidates} \
         candidates and {max_pairs} pairs: take larger steps, fewer samples (part.samples_per_mm2), or look at the part's unit"
    )]
    TooManyCandidates { candidates: usize, samples: usize, max_candidates: usize, max_pairs: usize },
    /// Patches or samples, more than a job may have, from one parameter.
    #[error("is {value}, which gives about {samples:.0} samples on this part; allowed are {max_samples:.0}")]
    TooManySamples { value: f64, samples: f64, max_samples: f64 },
    /// A set of samples that are not those of the parameters.
    #[error("and /seed give {samples} samples, which are not those that were measured; take the plan's")]
    OtherSamples { samples: usize },
    /// Excluded regions hold the whole part.
    #[error("leaves nothing of the part to measure; exclude less")]
    NothingAsked,
    /// A face beyond the last one that has an area: the file does not have it, or it is degenerate and was dropped.
    #[error("names face {face}; the file's last face with an area is {last_face}, counted from 0: leave out what lies beyond")]
    NoSuchFace { face: u32, last_face: u32 },
    /// A group of a file that names none.
    #[error("is {name:?}; the file has no named groups")]
    NoGroups { name: String },
    /// A group that the file does not have; `known` are the first that it has.
    #[error("is {name:?}; the file's groups are {}", .known.join(", "))]
    NoSuchGroup { name: String, known: Vec<String> },
    /// Regions of interest and features overlap in more ways than are numbered.
    #[error("and /regions/features overlap in more than 65 535 ways; use fewer or disjoint regions")]
    TooManyOverlaps,
    /// A parameter that a study sets by itself.
    #[error("is set by the study; leave it out")]
    SetByStudy,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_tells_its_figures_what_is_allowed_and_what_to_do() {
        let contact = Contact { a: "part".into(), b: "frame".into() };
        for (refusal, wanted) in [
            (
                Refusal::FarFromOrigin { farthest_mm: 123_456.7, max_mm: 98_000.0 },
                "reaches 123457 mm from the origin of its frame; allowed is 98000 mm, so that the poses of its plan stay within \
                 100000 mm: export the mesh with the part near the origin, or give its right unit",
            ),
            (Refusal::Sunk { depth_mm: 15.0, max_mm: 0.1 }, "sinks the part 15.000 mm into the plate; allowed is 0.1 mm"),
            (
                Refusal::Floating { height_mm: 30.0, max_mm: 1.0 },
                "leaves the part 30.000 mm above the plate; allowed is 1 mm without a fixture (part.fixture_mesh)",
            ),
            (
                Refusal::BesidePlate { distance_mm: 412.34, radius_mm: 300.0 },
                "stands the part 412.3 mm from the table's axis, beside the plate (radius 300 mm)",
            ),
            (Refusal::Collides(contact), "makes part and frame collide; move the part, or the body that it collides with"),
            (
                Refusal::TooManyCandidates { candidates: 60_000, samples: 12, max_candidates: 50_000, max_pairs: 1_000_000_000 },
                "and its steps, counts and rolls give 60000 candidates for 12 samples; allowed are 50000 candidates and \
                 1000000000 pairs: take larger steps, fewer samples (part.samples_per_mm2), or look at the part's unit",
            ),
            (
                Refusal::TooManySamples { value: 300.0, samples: 5e7, max_samples: 4e7 },
                "is 300, which gives about 50000000 samples on this part; allowed are 40000000",
            ),
            (
                Refusal::OtherSamples { samples: 7 },
                "and /seed give 7 samples, which are not those that were measured; take the plan's",
            ),
            (
                Refusal::NoSuchGroup { name: "bore".to_owned(), known: vec!["rim".to_owned(), "wall".to_owned()] },
                "is \"bore\"; the file's groups are rim, wall",
            ),
        ] {
            assert_eq!(refusal.to_string(), wanted);
        }
    }
}
