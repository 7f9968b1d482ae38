//! The closed list of causes for which a sample is not measured, in the order in which a candidate can fail. Visibility
//! names those that a view's optics decide, the cell's stages the others.

use crate::cell::closed_list;

closed_list! {
    /// The cause for which a sample is not measured, in the order in which a candidate can fail
    /// ([`crate::planning::method::causes`]).
    pub enum Cause {
        /// The part stands on it.
        ExcludedResting = "excluded_resting",
        /// No line leaves the part from it: it cannot be seen from outside.
        Enclosed = "enclosed",
        /// Lines leave the part from it, but only to viewpoints below the plate: it can be seen when the part is turned over.
        FacesTable = "faces_table",
        /// Faces away from a device.
        Facing = "facing",
        /// Outside the working depth.
        Depth = "depth",
        /// Outside the left camera's image.
        FrameLeft = "frame_left",
        /// Outside the right camera's image.
        FrameRight = "frame_right",
        /// Outside the projector's field.
        FrameProjector = "frame_projector",
        /// Too oblique for the left camera.
        IncidenceLeft = "incidence_left",
        /// Too oblique for the right camera.
        IncidenceRight = "incidence_right",
        /// Too oblique for the projector.
        IncidenceProjector = "incidence_projector",
        /// Hidden from the left camera.
        ShadowLeft = "shadow_left",
        /// Hidden from the right camera.
        ShadowRight = "shadow_right",
        /// Hidden from the projector.
        ShadowProjector = "shadow_projector",
        /// Too dark or saturated at every brightness level that is allowed.
        Exposure = "exposure",
        /// Measured, but not as well as is asked: worse than the grade, noisier or sparser.
        BelowGrade = "below_grade",
        /// Measured only by views out of the robot's reach.
        Unreachable = "unreachable",
        /// Measured only by views at which something collides.
        Collision = "collision",
        /// Measured only by views at whose stations something that stands in the cell hides it.
        HiddenByCell = "hidden_by_cell",
        /// Measured by views to which no path was found: by them alone, or in a plan that ended for want of a path.
        NoPath = "no_path",
        /// Measured by a candidate that was not chosen.
        NotChosen = "not_chosen",
        /// Measured by a chosen view, but at risk and not counted.
        AtRisk = "at_risk",
    }
}
