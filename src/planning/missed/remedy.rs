//! Remedies of a missed spot, and their sentences.

use std::fmt::Write;

use crate::geometry::{Part, Pose, ScannerFrame, Table};
use crate::planning::candidates::CandidateId;
use crate::planning::report::fixed;

/// A kind of remedy, in the order in which they are tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RemedyKind {
    /// Choose candidates that measure it and were left out.
    View,
    /// A candidate turned about its viewing axis.
    Roll,
    /// A candidate with its axis turned, aimed at the spot.
    Tilt,
    /// A candidate at another distance.
    Standoff,
    /// The part turned onto another side.
    Setup,
    /// A larger limit of incidence.
    Limit,
    /// No view that was tried works.
    None,
}

impl RemedyKind {
    /// Every kind, in order.
    pub const ALL: [Self; 7] = [Self::View, Self::Roll, Self::Tilt, Self::Standoff, Self::Setup, Self::Limit, Self::None];

    /// Name in files and answers.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::View => "view",
            Self::Roll => "roll",
            Self::Tilt => "tilt",
            Self::Standoff => "standoff",
            Self::Setup => "setup",
            Self::Limit => "limit",
            Self::None => "none",
        }
    }
}

/// A remedy that was tried and works for a spot, or the finding that none does. It works when its views together measure at
/// least half of the spot's area, by the plan's own definition of visibility; with a cell also from a station free of collision
/// to which a path leads, except in another setup.
#[derive(Clone, Debug, PartialEq)]
pub struct Remedy {
    /// Kind of remedy.
    pub kind: RemedyKind,
    /// The views, best first, at most 8. None where nothing works.
    pub views: Vec<RemedyView>,
    /// Pose of the part for [`RemedyKind::Setup`], to give as `part.table_from_part`.
    pub table_from_part: Option<Pose<Table, Part>>,
    /// Limit of the cameras that is needed, where it has to be raised, degrees.
    pub camera_deg: Option<f64>,
    /// Limit of the projector that is needed, where it has to be raised, degrees.
    pub projector_deg: Option<f64>,
    /// Area of the spot that the views together measure.
    pub area_mm2: f64,
    /// Share of the spot that the views together measure.
    pub of_spot: f64,
    /// Views that were tried for this spot.
    pub tried: usize,
}

/// A view of a remedy.
#[derive(Clone, Debug, PartialEq)]
pub struct RemedyView {
    /// The candidate that it was made from: itself for [`RemedyKind::View`].
    pub candidate: CandidateId,
    /// Turned about the viewing axis against that candidate.
    pub roll_rad: f64,
    /// Angle between the viewing axes of the two.
    pub tilt_rad: f64,
    /// Depth of the spot's centre below the viewpoint, along the viewing axis.
    pub standoff_mm: f64,
    /// The view.
    pub part_from_scanner: Pose<Part, ScannerFrame>,
    /// Area of the spot that it adds to those before it.
    pub area_mm2: f64,
}

impl Remedy {
    /// The finding that no view that was tried works.
    pub(super) fn none(tried: usize) -> Self {
        Self {
            kind: RemedyKind::None,
            views: Vec::new(),
            table_from_part: None,
            camera_deg: None,
            projector_deg: None,
            area_mm2: 0.0,
            of_spot: 0.0,
            tried,
        }
    }

    /// The remedy in a sentence.
    #[must_use]
    pub fn sentence(&self) -> String {
        let Some(first) = self.views.first() else {
            return match self.tried {
                1 => "none: the one view tried does not measure half of it".into(),
                tried => format!("none: no eight of {tried} views tried measure half of it"),
            };
        };
        let candidate = first.candidate.0;
        let mut text = match self.kind {
            RemedyKind::View => format!("choose candidate {candidate} too: raise the target, or the limit of views"),
            RemedyKind::Roll => format!("roll candidate {candidate} by {}°", degrees(first.roll_rad)),
            RemedyKind::Tilt => format!("tilt candidate {candidate} by {}°{}", degrees(first.tilt_rad), rolled(first)),
            RemedyKind::Standoff => {
                format!("take candidate {candidate} from {} mm{}{}", fixed(first.standoff_mm, 0), tilted(first), rolled(first))
            }
            // The pose that it rests in, named by what points up there.
            RemedyKind::Setup => {
                let up = self.table_from_part.unwrap_or(Pose::identity()).inverse().direction(&nalgebra::Vector3::z());
                let up = [up.x, up.y, up.z].map(|x| fixed(x, 2)).join(" ");
                format!("lay the part another way, its direction ({up}) up")
            }
            RemedyKind::Limit => self.limits_text(),
            RemedyKind::None => String::new(),
        };
        // Writing to a String cannot fail.
        let _ = match self.views.len() - 1 {
            0 => Ok(()),
            1 => write!(text, "; with 1 more view"),
            more => write!(text, "; with {more} more views"),
        };
        let _ = write!(text, ": measures {} mm², {} % of it", fixed(self.area_mm2, 1), fixed(100.0 * self.of_spot, 0));
        text
    }

    fn limits_text(&self) -> String {
        let limit = |name: &str, deg: Option<f64>| deg.map(|deg| format!("{name} to {}°", fixed(deg, 1)));
        let limits = [limit("limits.camera_deg", self.camera_deg), limit("limits.projector_deg", self.projector_deg)];
        let limits: Vec<_> = limits.into_iter().flatten().collect();
        let from = self.views.first().map_or_else(String::new, |first| {
            format!(" and look from candidate {}{}{}", first.candidate.0, tilted(first), rolled(first))
        });
        format!("raise {}{from}", limits.join(" and "))
    }
}

fn tilted(view: &RemedyView) -> String {
    if view.tilt_rad == 0.0 { String::new() } else { format!(", tilted by {}°", degrees(view.tilt_rad)) }
}

fn rolled(view: &RemedyView) -> String {
    if view.roll_rad == 0.0 { String::new() } else { format!(", rolled by {}°", degrees(view.roll_rad)) }
}

fn degrees(angle_rad: f64) -> String {
    fixed(angle_rad.to_degrees(), 0)
}
