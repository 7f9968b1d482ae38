//! Colours of pictures and legends. Grades differ by hue, not by lightness, since shading changes the lightness of a surface; a
//! picture of grades has one colour for all missed surface, and a picture of misses one for each group of causes.
//!
//! The colours of each kind of picture maximise the smallest difference between any two as they are drawn, shaded and shining
//! through measured surface: CIE76 ΔE of at least 20 in CIELAB for normal vision, protanopia and deuteranopia (G. M. Machado,
//! M. M. Oliveira and L. A. F. Fernandes, "A Physiologically-based Model for Simulation of Color Vision Deficiency", IEEE
//! TVCG 15(6), 2009, severity 1). In grey, the five colours of a picture of grades are at least 14 apart in lightness. The tests
//! hold all of that.

use crate::planning::plan::{Cause, Grade, Verdict};

/// Causes that an operator treats alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum MissGroup {
    /// Hidden from a device.
    Shadow,
    /// Too oblique for a device.
    Incidence,
    /// Faces away from a device.
    Facing,
    /// Outside an image.
    Frame,
    /// Outside the working depth.
    Depth,
    /// Out of the cell's reach, or of its sight.
    Reach,
    /// The part stands on it, or it faces the table or is enclosed.
    Resting,
    /// Measurable, but by no chosen view, or not counted.
    NotChosen,
}

impl MissGroup {
    /// The group of a cause.
    pub fn of(cause: Cause) -> Self {
        match cause {
            Cause::ExcludedResting | Cause::Enclosed | Cause::FacesTable => Self::Resting,
            Cause::Facing => Self::Facing,
            Cause::Depth => Self::Depth,
            Cause::FrameLeft | Cause::FrameRight | Cause::FrameProjector => Self::Frame,
            Cause::IncidenceLeft | Cause::IncidenceRight | Cause::IncidenceProjector | Cause::Exposure | Cause::BelowGrade => {
                Self::Incidence
            }
            Cause::ShadowLeft | Cause::ShadowRight | Cause::ShadowProjector => Self::Shadow,
            Cause::Unreachable | Cause::Collision | Cause::HiddenByCell | Cause::NoPath => Self::Reach,
            Cause::NotChosen | Cause::AtRisk => Self::NotChosen,
        }
    }
}

/// Role of a body in a picture of what is in the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum BodyRole {
    /// One of the two that are too near to each other.
    First,
    /// The other of them.
    Second,
    /// The part, where it is neither.
    Part,
    /// Anything else.
    Other,
}

/// Meaning of the colour of a point in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Ink {
    /// Measured, with this grade.
    Measured(Grade),
    /// Measured, but not by the view that the picture shows.
    ByOthers,
    /// Missed for any cause, in a picture of grades.
    Unmeasured,
    /// Missed, in a picture of causes.
    Missed(MissGroup),
    /// Surface that was not asked for.
    NotAsked,
    /// The inner side of an open surface.
    Back,
    /// A body of the cell.
    Body(BodyRole),
    /// Deviation of the surface, from 0 for missing material to 6 for extra; 3 is none.
    Deviation(u8),
}

/// Colours of deviations: the diverging scheme RdBu of seven classes, which colour-blind people tell apart (C. A. Brewer,
/// "ColorBrewer", colorbrewer2.org).
const DEVIATIONS: [[u8; 3]; 7] = [
    [0x21, 0x66, 0xac],
    [0x67, 0xa9, 0xcf],
    [0xd1, 0xe5, 0xf0],
    [0xf7, 0xf7, 0xf7],
    [0xfd, 0xdb, 0xc7],
    [0xef, 0x8a, 0x62],
    [0xb2, 0x18, 0x2b],
];

impl Ink {
    /// Every ink; its place is its code.
    pub const ALL: [Self; 27] = [
        Self::Measured(Grade::A),
        Self::Measured(Grade::B),
        Self::Measured(Grade::C),
        Self::Measured(Grade::D),
        Self::ByOthers,
        Self::Unmeasured,
        Self::NotAsked,
        Self::Back,
        Self::Missed(MissGroup::Shadow),
        Self::Missed(MissGroup::Incidence),
        Self::Missed(MissGroup::Facing),
        Self::Missed(MissGroup::Frame),
        Self::Missed(MissGroup::Depth),
        Self::Missed(MissGroup::Reach),
        Self::Missed(MissGroup::Resting),
        Self::Missed(MissGroup::NotChosen),
        Self::Body(BodyRole::First),
        Self::Body(BodyRole::Second),
        Self::Body(BodyRole::Part),
        Self::Body(BodyRole::Other),
        Self::Deviation(0),
        Self::Deviation(1),
        Self::Deviation(2),
        Self::Deviation(3),
        Self::Deviation(4),
        Self::Deviation(5),
        Self::Deviation(6),
    ];

    /// Number of the ink in drafts of reports, which are kept: it never changes.
    pub fn code(self) -> u8 {
        match self {
            Self::Measured(Grade::A) => 0,
            Self::Measured(Grade::B) => 1,
            Self::Measured(Grade::C) => 2,
            Self::Measured(Grade::D) => 3,
            Self::ByOthers => 4,
            Self::Unmeasured => 5,
            Self::NotAsked => 6,
            Self::Back => 7,
            Self::Missed(MissGroup::Shadow) => 8,
            Self::Missed(MissGroup::Incidence) => 9,
            Self::Missed(MissGroup::Facing) => 10,
            Self::Missed(MissGroup::Frame) => 11,
            Self::Missed(MissGroup::Depth) => 12,
            Self::Missed(MissGroup::Reach) => 13,
            Self::Missed(MissGroup::Resting) => 14,
            Self::Missed(MissGroup::NotChosen) => 15,
            Self::Body(BodyRole::First) => 16,
            Self::Body(BodyRole::Second) => 17,
            Self::Body(BodyRole::Part) => 18,
            Self::Body(BodyRole::Other) => 19,
            Self::Deviation(step) => 20 + step.min(6),
        }
    }

    /// The ink of a sample in a picture of grades.
    pub fn of_grade(verdict: Verdict) -> Self {
        match verdict {
            Verdict::Measured(grade) => Self::Measured(grade),
            Verdict::Missed(_) => Self::Unmeasured,
            Verdict::NotAsked => Self::NotAsked,
        }
    }

    /// The ink of a sample in a picture of causes.
    pub fn of_cause(verdict: Verdict) -> Self {
        match verdict {
            Verdict::Measured(_) => Self::ByOthers,
            Verdict::Missed(cause) => Self::Missed(MissGroup::of(cause)),
            Verdict::NotAsked => Self::NotAsked,
        }
    }

    /// Returns true if surface of this ink shines through what hides it. Surface that the part stands on does not: it would
    /// colour the whole picture, and is plainly visible from below.
    pub fn glows(self) -> bool {
        match self {
            Self::Missed(group) => group != MissGroup::Resting,
            Self::Body(role) => matches!(role, BodyRole::First | BodyRole::Second),
            Self::Measured(_) | Self::ByOthers | Self::Unmeasured | Self::NotAsked | Self::Back | Self::Deviation(_) => false,
        }
    }

    /// sRGB, eight bits a channel.
    pub fn rgb(self) -> [u8; 3] {
        match self {
            Self::Measured(Grade::A) | Self::Body(BodyRole::Second) => [0x00, 0x18, 0xb1],
            Self::Measured(Grade::B) => [0x19, 0xdd, 0x7c],
            Self::Measured(Grade::C) | Self::Body(BodyRole::Part) => [0xff, 0xef, 0x14],
            Self::Measured(Grade::D) | Self::Body(BodyRole::First) => [0xb3, 0x31, 0x07],
            Self::Unmeasured => [0xe5, 0x64, 0xe4],
            Self::ByOthers | Self::Body(BodyRole::Other) => [0xdc, 0xda, 0xe5],
            Self::NotAsked => [0x5a, 0x5c, 0x5a],
            Self::Back => [0x14, 0x0c, 0x0c],
            Self::Missed(MissGroup::Shadow) => [0x1d, 0x62, 0xe8],
            Self::Missed(MissGroup::Incidence) => [0xae, 0x73, 0x00],
            Self::Missed(MissGroup::Facing) => [0x12, 0xe5, 0x8b],
            Self::Missed(MissGroup::Frame) => [0x54, 0x2c, 0x00],
            Self::Missed(MissGroup::Depth) => [0xf7, 0xf7, 0x04],
            Self::Missed(MissGroup::Reach) => [0x45, 0x00, 0x4d],
            Self::Missed(MissGroup::Resting) => [0x00, 0x00, 0xee],
            Self::Missed(MissGroup::NotChosen) => [0x00, 0xb2, 0xef],
            Self::Deviation(step) => DEVIATIONS[usize::from(step.min(6))],
        }
    }

    /// `#rrggbb`.
    pub fn hex(self) -> String {
        let [r, g, b] = self.rgb();
        format!("#{r:02x}{g:02x}{b:02x}")
    }

    /// Label in the legend.
    pub fn label(self) -> &'static str {
        match self {
            Self::Measured(Grade::A) => "Grade A",
            Self::Measured(Grade::B) => "Grade B",
            Self::Measured(Grade::C) => "Grade C",
            Self::Measured(Grade::D) => "Grade D",
            Self::ByOthers => "Measured",
            Self::Unmeasured => "Missed",
            Self::NotAsked => "Not asked for",
            Self::Back => "Inner side of an open surface",
            Self::Missed(MissGroup::Shadow) => "Missed: in shadow",
            Self::Missed(MissGroup::Incidence) => "Missed: too oblique, or not measured well enough",
            Self::Missed(MissGroup::Facing) => "Missed: faces away",
            Self::Missed(MissGroup::Frame) => "Missed: outside the image",
            Self::Missed(MissGroup::Depth) => "Missed: outside the working depth",
            Self::Missed(MissGroup::Reach) => "Missed: out of reach, in collision or hidden by the cell",
            Self::Missed(MissGroup::Resting) => "Missed: rests on or faces the table, or enclosed",
            Self::Missed(MissGroup::NotChosen) => "Missed: measurable, no view chosen for it",
            Self::Body(BodyRole::First | BodyRole::Second) => "In the way",
            Self::Body(BodyRole::Part) => "The part",
            Self::Body(BodyRole::Other) => "Robot, table and surroundings",
            Self::Deviation(_) => "Deviation",
        }
    }
}
