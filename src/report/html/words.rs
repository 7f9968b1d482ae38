//! Plain words for causes, stop rules and grades, filled with the values of the scanner and the job.

use super::markup::{escape, number};
use crate::cell::{OpticalDevice, Scanner};
use crate::planning::params::{LimitParams, PlanParams};
use crate::planning::plan::{Cause, Remedy, RemedyKind};
use crate::planning::verdict::Rejection;
use crate::wire::words::{partial_percent, remedy_sentence};

/// Names a cause in a few words.
pub(super) fn cause_name(cause: Cause) -> &'static str {
    match cause {
        Cause::ExcludedResting => "The part stands on it",
        Cause::Enclosed => "Enclosed by the part",
        Cause::FacesTable => "Faces the table",
        Cause::Facing => "Faces away",
        Cause::Depth => "Outside the working depth",
        Cause::FrameLeft => "Outside the left image",
        Cause::FrameRight => "Outside the right image",
        Cause::FrameProjector => "Outside the projected field",
        Cause::IncidenceLeft => "Too oblique for the left camera",
        Cause::IncidenceRight => "Too oblique for the right camera",
        Cause::IncidenceProjector => "Too oblique for the projector",
        Cause::ShadowLeft => "Hidden from the left camera",
        Cause::ShadowRight => "Hidden from the right camera",
        Cause::ShadowProjector => "In the projector’s shadow",
        Cause::BelowGrade => "Not measured well enough",
        Cause::Unreachable => "Out of the robot’s reach",
        Cause::Collision => "Collision",
        Cause::HiddenByCell => "Hidden by an obstacle of the cell",
        Cause::NoPath => "No safe path found",
        Cause::NotChosen => "Measurable, but no view chosen",
        Cause::AtRisk => "Measured, but at risk",
    }
}

/// Names a reason for which a viewpoint was dropped, in a few words.
pub(super) fn rejection_name(reason: Rejection) -> &'static str {
    match reason {
        Rejection::BelowTable => "Below the plate",
        Rejection::LowElevation => "Too low over the plate",
        Rejection::InsidePart => "Inside the part",
        Rejection::InsideObstacle => "Inside an obstacle",
        Rejection::BodyMeetsPlate => "The scanner’s body would meet the plate",
        Rejection::BodyMeetsPart => "The scanner’s body would meet the part",
        Rejection::Unreachable => "Out of the robot’s reach",
        Rejection::Collision => "Something collides at every station",
        Rejection::Duplicate => "The same as another one",
        Rejection::MeasuresNothing => "Measures nothing that is asked for",
        Rejection::NotNeeded => "Not needed beside the others",
    }
}

/// Explains a cause.
pub(super) fn cause_meaning(cause: Cause, scanner: &Scanner, params: &PlanParams) -> String {
    match cause {
        Cause::ExcludedResting => {
            "This surface lies on the turntable. It can be measured only with the part placed another way.".into()
        }
        Cause::Enclosed => "No straight line leads from the surface out of the part: no scanner can see it from outside.".into(),
        Cause::FacesTable => {
            "The surface can be seen only from below the turntable. Turn the part over, and plan two setups (setups = 2).".into()
        }
        Cause::Facing => "The surface is turned away from a camera or from the projector.".into(),
        Cause::Depth => format!(
            "The surface is nearer than {} mm or farther than {} mm along the viewing axis, where images are out of focus.",
            number(scanner.near_mm, 0),
            number(scanner.far_mm, 0)
        ),
        Cause::FrameLeft => "The point falls outside the image of the left camera.".into(),
        Cause::FrameRight => "The point falls outside the image of the right camera.".into(),
        Cause::FrameProjector => "The projector’s pattern does not reach the point.".into(),
        Cause::IncidenceLeft => {
            format!("The left camera sees the surface too obliquely: {}.", limit(&params.limits, &scanner.devices.left))
        }
        Cause::IncidenceRight => {
            format!("The right camera sees the surface too obliquely: {}.", limit(&params.limits, &scanner.devices.right))
        }
        Cause::IncidenceProjector => {
            format!("The projector hits the surface too obliquely: {}.", limit(&params.limits, &scanner.devices.projector))
        }
        Cause::ShadowLeft => "The part itself or its fixture hides the point from the left camera.".into(),
        Cause::ShadowRight => "The part itself or its fixture hides the point from the right camera.".into(),
        Cause::ShadowProjector => "The part itself or its fixture hides the point from the projector.".into(),
        Cause::BelowGrade => "The point is seen, but not well enough: its grade, noise or density misses the requirement.".into(),
        Cause::Unreachable => "Viewpoints that would measure it are out of the robot’s reach at every table angle.".into(),
        Cause::Collision => format!(
            "At every viewpoint that would measure it, the robot or the scanner would collide, or come closer than {} mm.",
            number(params.motion.clearance_mm, 1)
        ),
        Cause::HiddenByCell => {
            "Something that stands in the cell comes between the surface and a device at every table angle from which the \
             viewpoints that would measure it can be taken."
                .into()
        }
        Cause::NoPath => "Viewpoints would measure it, but no collision-free path to them was found.".into(),
        Cause::NotChosen => "A viewpoint that was considered measures it, but the selection ended before choosing it.".into(),
        Cause::AtRisk => "A view measures it in the simulation, but a real scan may lack it, and it was asked not to count \
             (realism.count_at_risk = false)."
            .into(),
    }
}

/// Names the limit in force for a device.
fn limit(limits: &LimitParams, device: &OpticalDevice) -> String {
    let deg = limits.incidence_max_rad(device).to_degrees();
    format!("more than {}° from the surface’s normal", number(deg, 1))
}

/// Describes the remedy for a spot: its kind in a word or two, then the plan's own sentence, which begins with the share that
/// it measures where it does not work.
pub(super) fn remedy(remedy: &Remedy) -> String {
    let kind = match remedy.kind {
        RemedyKind::View => "One more view",
        RemedyKind::Roll => "Another roll",
        RemedyKind::Tilt => "Another tilt",
        RemedyKind::Standoff => "Another distance",
        RemedyKind::Setup => "Another setup",
        RemedyKind::Limit => "A larger limit",
        RemedyKind::None => "None found",
    };
    let kind = match partial_percent(remedy.of_spot).filter(|_| remedy.kind != RemedyKind::None) {
        Some(percent) => format!("{percent} of it: {}", kind.to_lowercase()),
        None => kind.to_owned(),
    };
    format!("<b>{kind}</b><br/><span class=\"soft\">{}</span>", escape(&remedy_sentence(remedy)))
}
