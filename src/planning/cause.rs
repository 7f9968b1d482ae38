//! The closed list of causes for which a sample is not measured, in the order in which a candidate can fail. Visibility
//! names those that a view's optics decide, the cell's stages the others.

/// The cause for which a sample is not measured, in the order in which a candidate can fail
/// ([`crate::planning::method::causes`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Cause {
    /// The part stands on it.
    ExcludedResting,
    /// Faces away from a device.
    Facing,
    /// Outside the working depth.
    Depth,
    /// Outside the left camera's image.
    FrameLeft,
    /// Outside the right camera's image.
    FrameRight,
    /// Outside the projector's field.
    FrameProjector,
    /// Too oblique for the left camera.
    IncidenceLeft,
    /// Too oblique for the right camera.
    IncidenceRight,
    /// Too oblique for the projector.
    IncidenceProjector,
    /// Hidden from the left camera.
    ShadowLeft,
    /// Hidden from the right camera.
    ShadowRight,
    /// Hidden from the projector.
    ShadowProjector,
    /// Measured, but not as well as is asked: worse than the grade, noisier or sparser.
    BelowGrade,
    /// Measured only by views out of the robot's reach.
    Unreachable,
    /// Measured only by views at which something collides.
    Collision,
    /// Measured only by views to which no path was found.
    NoPath,
    /// Measured by a candidate that was not chosen.
    NotChosen,
}

impl Cause {
    /// Every cause, in order.
    pub const ALL: [Self; 17] = [
        Self::ExcludedResting,
        Self::Facing,
        Self::Depth,
        Self::FrameLeft,
        Self::FrameRight,
        Self::FrameProjector,
        Self::IncidenceLeft,
        Self::IncidenceRight,
        Self::IncidenceProjector,
        Self::ShadowLeft,
        Self::ShadowRight,
        Self::ShadowProjector,
        Self::BelowGrade,
        Self::Unreachable,
        Self::Collision,
        Self::NoPath,
        Self::NotChosen,
    ];

    /// Name in files and answers.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self {
            Self::ExcludedResting => "excluded_resting",
            Self::Facing => "facing",
            Self::Depth => "depth",
            Self::FrameLeft => "frame_left",
            Self::FrameRight => "frame_right",
            Self::FrameProjector => "frame_projector",
            Self::IncidenceLeft => "incidence_left",
            Self::IncidenceRight => "incidence_right",
            Self::IncidenceProjector => "incidence_projector",
            Self::ShadowLeft => "shadow_left",
            Self::ShadowRight => "shadow_right",
            Self::ShadowProjector => "shadow_projector",
            Self::BelowGrade => "below_grade",
            Self::Unreachable => "unreachable",
            Self::Collision => "collision",
            Self::NoPath => "no_path",
            Self::NotChosen => "not_chosen",
        }
    }
}
