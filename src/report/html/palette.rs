//! Colours of pictures and legends. Measured surface is blue, the darker the better; missed surface is warm, one hue per group
//! of causes; everything else is grey. The fourteen colours maximise the smallest difference between any two: CIEDE2000 of at
//! least 12 for normal vision and for protan and deutan vision (Machado, Oliveira and Fernandes 2009, severity 1).

use crate::planning::plan::{Cause, Grade, Verdict};

/// Causes that an operator treats alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::report) enum MissGroup {
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
    pub(super) fn of(cause: Cause) -> Self {
        match cause {
            Cause::ExcludedResting | Cause::Enclosed | Cause::FacesTable => Self::Resting,
            Cause::Facing => Self::Facing,
            Cause::Depth => Self::Depth,
            Cause::FrameLeft | Cause::FrameRight | Cause::FrameProjector => Self::Frame,
            Cause::IncidenceLeft | Cause::IncidenceRight | Cause::IncidenceProjector | Cause::BelowGrade => Self::Incidence,
            Cause::ShadowLeft | Cause::ShadowRight | Cause::ShadowProjector => Self::Shadow,
            Cause::Unreachable | Cause::Collision | Cause::HiddenByCell | Cause::NoPath => Self::Reach,
            Cause::NotChosen | Cause::AtRisk => Self::NotChosen,
        }
    }
}

/// Meaning of the colour of a point in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::report) enum Ink {
    /// Measured, with this grade.
    Measured(Grade),
    /// Measured, but not by the view that the picture shows.
    ByOthers,
    /// Missed.
    Missed(MissGroup),
    /// Not asked for.
    NotAsked,
    /// The inner side of an open surface.
    Back,
}

impl Ink {
    /// The ink of a sample in a picture of the whole plan.
    pub(super) fn of(verdict: Verdict) -> Self {
        match verdict {
            Verdict::Measured(grade) => Self::Measured(grade),
            Verdict::Missed(cause) => Self::Missed(MissGroup::of(cause)),
            Verdict::NotAsked => Self::NotAsked,
        }
    }

    /// sRGB, eight bits a channel.
    pub(super) fn rgb(self) -> [u8; 3] {
        match self {
            Self::Measured(Grade::A) => [0x1b, 0x5f, 0xa8],
            Self::Measured(Grade::B) => [0x3f, 0x95, 0xd1],
            Self::Measured(Grade::C) => [0x86, 0xc5, 0xe6],
            Self::Measured(Grade::D) => [0xd3, 0xee, 0xf5],
            Self::ByOthers => [0xb4, 0xb6, 0xba],
            Self::NotAsked => [0x74, 0x77, 0x7d],
            Self::Back => [0x50, 0x4a, 0x58],
            Self::Missed(MissGroup::Shadow) => [0x6c, 0x17, 0x19],
            Self::Missed(MissGroup::Incidence) => [0xf1, 0x6e, 0x11],
            Self::Missed(MissGroup::Facing) => [0xf1, 0xa0, 0x89],
            Self::Missed(MissGroup::Frame) => [0xfd, 0xe5, 0x43],
            Self::Missed(MissGroup::Depth) => [0x86, 0x55, 0x05],
            Self::Missed(MissGroup::Reach) => [0xc7, 0x03, 0x5e],
            Self::Missed(MissGroup::Resting) => [0x1d, 0x1c, 0x22],
            Self::Missed(MissGroup::NotChosen) => [0xfe, 0xfd, 0xd8],
        }
    }

    /// `#rrggbb`.
    pub(in crate::report) fn hex(self) -> String {
        let [r, g, b] = self.rgb();
        format!("#{r:02x}{g:02x}{b:02x}")
    }

    /// Label in the legend.
    pub(super) fn label(self) -> &'static str {
        match self {
            Self::Measured(Grade::A) => "Grade A",
            Self::Measured(Grade::B) => "Grade B",
            Self::Measured(Grade::C) => "Grade C",
            Self::Measured(Grade::D) => "Grade D",
            Self::ByOthers => "Measured by other views",
            Self::NotAsked => "Not asked for",
            Self::Back => "Inner side of an open surface",
            Self::Missed(MissGroup::Shadow) => "Missed: in shadow",
            Self::Missed(MissGroup::Incidence) => "Missed: too oblique",
            Self::Missed(MissGroup::Facing) => "Missed: faces away",
            Self::Missed(MissGroup::Frame) => "Missed: outside the image",
            Self::Missed(MissGroup::Depth) => "Missed: outside the working depth",
            Self::Missed(MissGroup::Reach) => "Missed: out of the cell’s reach",
            Self::Missed(MissGroup::Resting) => "Missed: rests on or faces the table, or enclosed",
            Self::Missed(MissGroup::NotChosen) => "Missed: measurable, no view chosen for it",
        }
    }
}
