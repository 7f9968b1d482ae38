//! Plain words for causes, stop rules and grades, with the values of the scanner and the job in them.

use super::markup::{escape, number, percent};
use crate::cell::Scanner;
use crate::planning::params::{PlanParams, TargetOf};
use crate::planning::plan::{Cause, Remedy, RemedyKind, StopReason};

/// A cause in two or three words.
pub(super) fn cause_name(cause: Cause) -> &'static str {
    match cause {
        Cause::ExcludedResting => "The part stands on it",
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
        Cause::Collision => "Something would collide",
        Cause::NoPath => "No safe path found",
        Cause::NotChosen => "Measurable, but no view chosen",
    }
}

/// Explains a cause.
pub(super) fn cause_meaning(cause: Cause, scanner: &Scanner, params: &PlanParams) -> String {
    match cause {
        Cause::ExcludedResting => {
            "This surface lies on the turntable. It can be measured only while the part lies another way.".into()
        }
        Cause::Facing => "The surface is turned away from a camera or from the projector.".into(),
        Cause::Depth => format!(
            "The surface is nearer than {} mm or farther than {} mm along the viewing axis, where images are not sharp.",
            number(scanner.near_mm, 0),
            number(scanner.far_mm, 0)
        ),
        Cause::FrameLeft => "The point falls outside the image of the left camera.".into(),
        Cause::FrameRight => "The point falls outside the image of the right camera.".into(),
        Cause::FrameProjector => "The projector’s pattern does not reach the point.".into(),
        Cause::IncidenceLeft => {
            format!("The left camera looks along the surface: {}.", limit(params.limits.camera_deg, scanner, 0))
        }
        Cause::IncidenceRight => {
            format!("The right camera looks along the surface: {}.", limit(params.limits.camera_deg, scanner, 1))
        }
        Cause::IncidenceProjector => {
            format!("The pattern grazes the surface: {}.", limit(params.limits.projector_deg, scanner, 2))
        }
        Cause::ShadowLeft => "Something stands between the point and the left camera: the part itself, or its fixture.".into(),
        Cause::ShadowRight => "Something stands between the point and the right camera: the part itself, or its fixture.".into(),
        Cause::ShadowProjector => "Something stands between the point and the projector: the part itself, or its fixture.".into(),
        Cause::BelowGrade => "It is seen, but not as well as is asked: below the grade, too noisy or too sparse.".into(),
        Cause::Unreachable => "Viewpoints that would measure it are out of the robot’s reach at every table angle.".into(),
        Cause::Collision => format!(
            "At every viewpoint that would measure it, robot or scanner would touch something or come closer than {} mm.",
            number(params.motion.clearance_mm, 1)
        ),
        Cause::NoPath => "Viewpoints that would measure it exist, but no collision-free way to them was found.".into(),
        Cause::NotChosen => {
            "Some viewpoint that was considered measures it; the stop rule ended the selection before it was chosen.".into()
        }
    }
}

fn limit(limit_deg: Option<f64>, scanner: &Scanner, device: usize) -> String {
    let deg = limit_deg.unwrap_or_else(|| scanner.devices[device].incidence_max_rad.to_degrees());
    format!("more than {}° from the surface’s normal", number(deg, 1))
}

/// Describes the remedy of a spot: the kind in a word or two, then the plan's own sentence.
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
    format!("<b>{kind}</b><br/><span class=\"soft\">{}</span>", escape(&remedy.sentence()))
}

/// Explains the rule that ended the selection of views.
pub(super) fn stop(reason: StopReason, params: &PlanParams) -> String {
    let rules = &params.selection;
    match reason {
        StopReason::Target => {
            let whole = match rules.target_of {
                TargetOf::Coverable => "coverable area",
                TargetOf::Asked => "asked area",
                TargetOf::Total => "whole surface",
            };
            format!("The target was reached: {} of the {whole}.", percent(rules.target))
        }
        StopReason::Growth => {
            format!("The best further view would have added less than {} of the asked area.", percent(rules.min_growth))
        }
        StopReason::MaxViews => match rules.max_views {
            Some(limit) => format!("The limit of {limit} views was reached."),
            None => "The limit of views was reached.".into(),
        },
        StopReason::NoGain => "No further view would have added anything worth its cost.".into(),
        StopReason::NoPath => {
            "The target was reached only of what the views with a collision-free path measure; to others no path was found."
                .into()
        }
    }
}
