//! Plain words for causes, stop rules and grades, filled with the values of the scanner and the job.

use super::markup::{escape, number};
use crate::cell::{OpticalDevice, Scanner};
use crate::planning::params::{Brightness, LimitParams, PlanParams};
use crate::planning::plan::{Cause, Remedy, RemedyKind, RiskReason};
use crate::planning::verdict::Rejection;
use crate::wire::words::{
    ChoiceRules, cause_phrase, fix_sentence, partial_percent, rejection_phrase, risk_phrase, tried_in_vain,
};

/// Names a cause in a few words, with a capital.
pub(super) fn cause_name(cause: Cause) -> String {
    capitalised(cause_phrase(cause)).replace('\'', "’")
}

/// The text with its first letter as a capital.
pub(super) fn capitalised(text: &str) -> String {
    let mut characters = text.chars();
    characters.next().map_or_else(String::new, |first| first.to_uppercase().chain(characters).collect())
}

/// The text with its first letter in lower case, to stand within a sentence.
pub(super) fn uncapitalised(text: &str) -> String {
    let mut characters = text.chars();
    characters.next().map_or_else(String::new, |first| first.to_lowercase().chain(characters).collect())
}

/// Names a reason for which a viewpoint was dropped, in a few words, with a capital.
pub(super) fn rejection_name(reason: Rejection) -> String {
    capitalised(&rejection_remark(reason))
}

/// Names a reason for which a viewpoint was dropped, within a sentence.
pub(super) fn rejection_remark(reason: Rejection) -> String {
    rejection_phrase(reason).replace('\'', "’")
}

/// Names a reason for which area is at risk, with a capital.
pub(super) fn risk_name(reason: RiskReason) -> String {
    capitalised(&risk_phrase(reason.as_str()))
}

/// Explains a cause.
pub(super) fn cause_meaning(cause: Cause, scanner: &Scanner, params: &PlanParams) -> String {
    match cause {
        Cause::ExcludedResting => {
            "This surface lies on the turntable. It can be measured only if the part is placed differently.".into()
        }
        Cause::Enclosed => "No straight line leads out of the part from this surface, so no scanner can see it from outside.".into(),
        Cause::FacesTable => {
            "The surface can be seen only from below the turntable. Turn the part over in one more setup (raise setups).".into()
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
        Cause::Exposure => match params.scan.brightness {
            Brightness::Level(level) => format!("The point is too dark or saturated at brightness {level}, the one of every view."),
            Brightness::Auto => "The point is too dark or saturated at every brightness.".into(),
        },
        Cause::BelowGrade => "The point is seen, but not well enough: its grade, noise or density misses the requirement.".into(),
        Cause::Unreachable => "Viewpoints that would measure it are out of the robot’s reach at every table angle.".into(),
        Cause::Collision => format!(
            "At every viewpoint that would measure it, the robot or the scanner would collide, or come closer than {} mm.",
            number(params.motion.clearance_mm, 1)
        ),
        Cause::HiddenByCell => {
            "At every table angle at which the viewpoints that would measure it can be reached, an obstacle in the cell hides the \
             surface from a camera or from the projector."
                .into()
        }
        Cause::NoPath => "Some viewpoints would measure it, but no collision-free path to them was found.".into(),
        Cause::NotChosen => "A viewpoint that was considered measures it, but the selection ended before choosing it.".into(),
        Cause::AtRisk => "A view measures it in the simulation, but a real scan may miss it, so it does not count as measured \
             (realism.count_at_risk = false)."
            .into(),
    }
}

/// Names the limit in force for a device.
fn limit(limits: &LimitParams, device: &OpticalDevice) -> String {
    let deg = limits.incidence_max_rad(device).to_degrees();
    format!("more than {}° from the surface’s normal", number(deg, 1))
}

/// Describes the remedy for a spot: its kind in a word or two, then its sentence, which begins with the share that
/// it measures where it does not work. `rules` are those by which the views of the plan were chosen.
pub(super) fn remedy(remedy: &Remedy, rules: ChoiceRules) -> String {
    let kind = match remedy.kind {
        RemedyKind::View if rules.left_out_views() => {
            return format!("<b>Views left out</b><br/><span class=\"soft\">{}</span>", escape(&fix_sentence(remedy, rules)));
        }
        RemedyKind::View if remedy.views.len() > 1 => {
            return told(&format!("{} more views", remedy.views.len()), remedy, rules);
        }
        RemedyKind::View => "One more view",
        RemedyKind::Roll => "Another roll",
        RemedyKind::Tilt => "Another tilt",
        RemedyKind::Standoff => "Another distance",
        RemedyKind::Setup => "Another setup",
        RemedyKind::Limit => "A larger limit",
        RemedyKind::None => "None found",
    };
    told(kind, remedy, rules)
}

fn told(kind: &str, remedy: &Remedy, rules: ChoiceRules) -> String {
    let kind = match partial_percent(remedy.of_spot).filter(|_| remedy.kind != RemedyKind::None) {
        Some(percent) => format!("{percent} of it: {}", kind.to_lowercase()),
        None => kind.to_owned(),
    };
    // The heading says that none was found.
    let sentence = if remedy.views.is_empty() { tried_in_vain(remedy.tried) } else { fix_sentence(remedy, rules) };
    format!("<b>{kind}</b><br/><span class=\"soft\">{}</span>", escape(&sentence))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use crate::planning::params::SelectionGoal;
    use crate::planning::plan::{CandidateId, RemedyView, StopReason};
    use crate::wire::words::PlanRules;

    fn view() -> RemedyView {
        let (part_from_scanner, candidate) = (Pose::identity(), CandidateId(4));
        RemedyView { candidate, roll_rad: 0.0, tilt_rad: 0.0, standoff_mm: 480.0, part_from_scanner, area_mm2: 10.0 }
    }

    #[test]
    fn a_fix_of_several_views_says_so_in_its_heading() {
        let of_goal = |views: usize, goal: SelectionGoal| {
            let views = vec![view(); views];
            let (table_from_part, turn, camera_deg, projector_deg) = (None, None, None, None);
            let (kind, area_mm2, of_spot, tried) = (RemedyKind::View, 9.5, 0.95, 30);
            let (ended_by, views_left) = (StopReason::MaxViews, Some(0));
            let rules = ChoiceRules::Plan(PlanRules {
                goal,
                ended_by,
                views_left,
                min_gain_mm2: 0.0,
                is_priced: true,
                must_overlap: true,
            });
            remedy(&Remedy { kind, views, table_from_part, turn, camera_deg, projector_deg, area_mm2, of_spot, tried }, rules)
        };
        let fix = |views: usize| of_goal(views, SelectionGoal::FewestViews);
        assert!(fix(1).starts_with("<b>One more view</b>"), "{}", fix(1));
        assert!(fix(3).starts_with("<b>3 more views</b>") && fix(3).contains("with 2 more views"), "{}", fix(3));
        for views in [1, 3] {
            let best = of_goal(views, SelectionGoal::BestCoverage);
            assert!(best.contains("selection.max_views") && !best.contains("selection.target"), "the goal heeds none: {best}");
        }
    }

    /// "73 % of it: 5 more views" headed a spot of a plan that views without a path were left out of.
    #[test]
    fn more_views_are_not_promised_where_views_without_a_path_were_left_out() {
        let (table_from_part, turn, camera_deg, projector_deg) = (None, None, None, None);
        let (kind, views, area_mm2, of_spot, tried) = (RemedyKind::View, vec![view(); 5], 7.3, 0.73, 30);
        let views = Remedy { kind, views, table_from_part, turn, camera_deg, projector_deg, area_mm2, of_spot, tried };
        let (goal, ended_by) = (SelectionGoal::FewestViews, StopReason::NoPath);
        let rules = ChoiceRules::Plan(PlanRules {
            goal,
            ended_by,
            views_left: None,
            min_gain_mm2: 0.0,
            is_priced: true,
            must_overlap: true,
        });
        let told = remedy(&views, rules);
        assert!(told.starts_with("<b>Views left out</b>") && told.contains("motion.clearance_mm"), "{told}");
        assert!(!told.contains("73") && !told.contains("so that candidate"), "no figure is promised: {told}");
    }

    /// "None found" and "no fix found" were told of one spot.
    #[test]
    fn a_spot_without_a_fix_is_told_so_once() {
        let (table_from_part, turn, camera_deg, projector_deg) = (None, None, None, None);
        let (kind, views, area_mm2, of_spot, tried) = (RemedyKind::None, Vec::new(), 0.0, 0.0, 30);
        let none = Remedy { kind, views, table_from_part, turn, camera_deg, projector_deg, area_mm2, of_spot, tried };
        let told = remedy(&none, ChoiceRules::Rescan(StopReason::Target));
        let expected =
            "<b>None found</b><br/><span class=\"soft\">30 views tried; up to 8 of them together see less than half of it</span>";
        assert_eq!(told, expected);
    }

    #[test]
    fn a_cause_has_one_name_with_and_without_a_capital() {
        for cause in Cause::ALL {
            let (phrase, name) = (cause_phrase(cause).replace('\'', "’"), cause_name(cause));
            assert!(name.to_lowercase() == phrase.to_lowercase() && name.starts_with(char::is_uppercase), "{name} of {phrase}");
        }
        assert_eq!(cause_name(Cause::ShadowProjector), "In the projector’s shadow");
        let risks = [RiskReason::ConcaveZone, RiskReason::InterReflection].map(risk_name);
        assert_eq!(risks, ["Concave zone", "Inter-reflection"], "not a reflection that is inter");
        assert_eq!((capitalised("turn it upside down"), capitalised("")), ("Turn it upside down".to_owned(), String::new()));
    }
}
