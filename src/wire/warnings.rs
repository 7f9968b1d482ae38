//! Warnings on parameters, cells and parts that are accepted, although what they ask for cannot be reached or was not, or is hardly
//! what was meant.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::plan::{CoverageDocument, RegionCoverageDocument, RobustDocument};
use super::words::{
    area_mm2, asked_name, counted, fixed, home_remedy, independent_share, limits_mm, percent_below, pose_error_sizes, rounded_to,
    rounded_up_mm,
};
use crate::cell::{Cell, CollisionScene, Contact, DeviceName, FieldHider, HiddenShare, HiderPlace, Scanner, closed_list};
use crate::geometry::{Aabb, Part, Pose, StablePose, Table};
use crate::planning::params::{MotionParams, NoiseParams, PlanParams, SelectionGoal};
use crate::planning::plan::{Robust, StopReason};
use crate::planning::{UpAxis, tips_over};

#[cfg(test)]
mod tests;

/// Share of a device's field beyond which most of it is hidden.
const MAJORITY: f64 = 0.5;
/// Difference of two shares of area that is rounding.
const SHARE_ROUNDING: f64 = 1e-8;
/// Difference of two shares of a field that is told as none.
const HIDDEN_ROUNDING: f64 = 5e-4;

closed_list! {
    /// Kind of a warning.
    pub enum WarningCode {
        /// The tolerance of a feature is finer than the scanner's noise can serve anywhere.
        ToleranceBeyondNoise = "tolerance_beyond_noise",
        /// The point spacing of a feature is finer than this scanner's points can be.
        SpacingBeyondScanner = "spacing_beyond_scanner",
        /// A smaller share of the region or feature is measured than its target.
        RegionUnmet = "region_unmet",
        /// The region or feature reaches its target on the samples that views were chosen on, and misses it on others by more than the
        /// standard error of their share.
        RegionUnconfirmed = "region_unconfirmed",
        /// The views measure less of the asked area at grade A than `selection.min_grade_a` asks for.
        GradeAUnmet = "grade_a_unmet",
        /// The plan loses more than one point of the asked area if poses are off by the error that it was evaluated with.
        FragileUnderPoseError = "fragile_under_pose_error",
        /// The part's longest edge is less than 5 % of the scanner's field: its unit may be wrong.
        PartSmall = "part_small",
        /// The part, as it lies, is wider than the plate: its unit may be wrong.
        PartLargerThanPlate = "part_larger_than_plate",
        /// The part would tip over as it is to lie: nothing holds it, and its centre of mass is not above what it stands on.
        PartUnstable = "part_unstable",
        /// The home of a cell looks like radians; it is in degrees.
        HomeInRadians = "home_in_radians",
        /// At the home of a cell two bodies are closer than plans keep them apart by default: no path may lead from there.
        HomeTooClose = "home_too_close",
        /// At the home of the cell, with the part on its plate, two bodies collide or are closer than the plan keeps them apart: no path
        /// leads from there.
        HomeBlocked = "home_blocked",
        /// A body that the flange carries overlaps a link of the arm in every posture that was tried, so that collisions between the two
        /// are not checked.
        LoadOverlapsArm = "load_overlaps_arm",
        /// A body that the flange carries, or the end of the arm, stands between a device of the scanner and its field, in every view or at
        /// some angles of joint 6. Plans take what it hides for measured.
        MountHidesField = "mount_hides_field",
        /// The plate's centre is farther away than the stretched arm and the scanner measure.
        PlateBeyondReach = "plate_beyond_reach",
        /// An excluded region holds none of the part's surface: it may lie elsewhere, or be in another unit.
        ExclusionEmpty = "exclusion_empty",
        /// A region of interest or a feature holds none of the part's surface: it may lie elsewhere, or be in another unit.
        RegionEmpty = "region_empty",
        /// Fixture and part run into each other, or are the same file: one of the two may lie elsewhere, or be in another unit.
        FixtureOverlapsPart = "fixture_overlaps_part",
        /// The goal is the shortest time, and no cell is given whose time could be shortened.
        GoalNeedsCell = "goal_needs_cell",
        /// The list of every candidate was asked for and is left out: it would be too large.
        CandidatesLeftOut = "candidates_left_out",
        /// Planning has ended, and the results or the end of the job cannot be stored yet: the disk is full, or the store is
        /// temporarily unavailable.
        ResultsWait = "results_wait",
        /// The value is accepted, and hardly what was meant: it looks like metres or radians, or turns something upside down.
        DoubtfulValue = "doubtful_value",
    }
}

impl WarningCode {
    /// Returns true for warnings on what a plan came to, which no job has before there is one.
    #[must_use]
    pub fn is_of_plan(self) -> bool {
        match self {
            Self::RegionUnmet
            | Self::RegionUnconfirmed
            | Self::GradeAUnmet
            | Self::FragileUnderPoseError
            | Self::PartUnstable
            | Self::HomeBlocked
            | Self::ExclusionEmpty
            | Self::RegionEmpty
            | Self::FixtureOverlapsPart
            | Self::CandidatesLeftOut => true,
            Self::ToleranceBeyondNoise
            | Self::SpacingBeyondScanner
            | Self::GoalNeedsCell
            | Self::ResultsWait
            | Self::PartSmall
            | Self::PartLargerThanPlate
            | Self::HomeInRadians
            | Self::HomeTooClose
            | Self::LoadOverlapsArm
            | Self::MountHidesField
            | Self::PlateBeyondReach
            | Self::DoubtfulValue => false,
        }
    }
}

/// A warning on a field that was accepted.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct FieldWarning {
    /// Stable code, for programs.
    pub code: WarningCode,
    /// JSON pointer of the field.
    pub pointer: String,
    /// Value found, and what is wrong with it or could not be reached.
    pub detail: String,
    /// Advice on what to do about it.
    pub remedy: String,
}

/// Warnings on a cell that can be built; `at` is the pointer to it.
#[must_use]
pub fn of_cell(cell: &Cell, at: &str) -> Vec<FieldWarning> {
    let home = cell.home_in_radians().map(|home| FieldWarning {
        code: WarningCode::HomeInRadians,
        pointer: format!("{at}/home_deg"),
        detail: format!(
            "is {:?}; all values are within ±2π, which suggests radians",
            cell.home_rad.axes_rad().map(|angle| rounded_to(angle.to_degrees(), 6))
        ),
        remedy: format!("if it is in radians, give {:?} (degrees)", home.axes_tenths_deg()),
    });
    let (centre_mm, reach_mm) = cell.plate_centre_distance_mm();
    let plate = (centre_mm > reach_mm).then(|| FieldWarning {
        code: WarningCode::PlateBeyondReach,
        pointer: format!("{at}/base_from_table"),
        detail: format!(
            "puts the plate's centre {centre_mm:.0} mm from the robot's shoulder; with the arm fully extended, the scanner measures up \
             to {reach_mm:.0} mm from it"
        ),
        remedy: "move the table nearer: `vantage study reach` compares distances and heights".to_owned(),
    });
    let clearance_mm = MotionParams::default().clearance_mm;
    let scene = CollisionScene::without_part(cell, clearance_mm);
    let close = home_too_close(cell, &scene, clearance_mm, at);
    let untested = scene.untested_load().iter().map(|pair| load_overlaps_arm(cell, pair, at));
    home.into_iter().chain(close).chain(untested).chain(of_sight(cell, at)).chain(plate).collect()
}

/// Warnings of bodies that move with the scanner and hide its field: plans, which do not take them into account, state more than is
/// measured. `at` is the pointer to the cell.
#[must_use]
pub fn of_sight(cell: &Cell, at: &str) -> Vec<FieldWarning> {
    cell.field_hiders().iter().map(|hider| mount_hides_field(hider, at)).collect()
}

/// Warning of bodies of one place that hide the field.
fn mount_hides_field(hider: &FieldHider, at: &str) -> FieldWarning {
    let names = hider.names.iter().map(|name| format!("{name:?}")).collect::<Vec<_>>().join(", ");
    let pronoun = if hider.names.len() == 1 { "it hides" } else { "they hide" };
    let (pointer, puts) = match hider.place {
        HiderPlace::Mount(index) => (format!("{at}/mount/{index}"), format!("puts {names} between the scanner and its field")),
        HiderPlace::Scanner(index) => {
            (format!("{at}/scanner/body/{index}"), format!("puts {names} between the scanner's own devices and their field"))
        }
        HiderPlace::Arm => (format!("{at}/flange_from_scanner"), format!("lets the scanner look through {names} of the arm")),
    };
    let shares = hider.shares.iter().map(hidden_share).collect::<Vec<_>>().join(", ");
    let depends = hider.shares.iter().any(|share| share.max - share.min > HIDDEN_ROUNDING);
    let when = if depends { ", depending on the angle of joint 6" } else { " in every view" };
    let is_most = hider.shares.iter().any(|share| share.max > MAJORITY);
    FieldWarning {
        code: WarningCode::MountHidesField,
        pointer,
        detail: format!(
            "{puts}: {pronoun} {shares}{when}; plans do NOT take this into account: they count what is hidden as measured"
        ),
        remedy: sight_remedy(hider.place, is_most).to_owned(),
    }
}

/// Remedy for bodies that hide the field; `is_most` if they hide most of what a device sees.
fn sight_remedy(place: HiderPlace, is_most: bool) -> &'static str {
    match (place, is_most) {
        (HiderPlace::Mount(_), true) => {
            "check the body's shape and owner_from_body, leave out what is transparent, and check flange_from_scanner: it is often \
             inverted (scanner_from_flange) or has a wrong sign; if the cell is built like this, turn the scanner on its mount, or take \
             the body off"
        }
        (HiderPlace::Mount(_), false) => {
            "move the body out of the field: check its shape and owner_from_body; if both are right, its shape may be coarser than the \
             real body: give a hollow one as its walls or as a mesh, and leave out what is transparent"
        }
        (HiderPlace::Scanner(_), _) => {
            "check the body's shape and owner_from_body: the devices look along +z of the scanner; if both are right, its shape may be \
             coarser than the real body: give a hollow housing as its walls or as a mesh, and leave out what is transparent"
        }
        (HiderPlace::Arm, true) => {
            "check flange_from_scanner: it is often inverted (scanner_from_flange) or has a wrong sign; if the cell is built like this, \
             turn the scanner so that it looks away from the flange"
        }
        (HiderPlace::Arm, false) => {
            "check flange_from_scanner; if it is right, a body of the robot may be coarser than the real link, as a short capsule with its \
             round ends is, or a hollow housing that is given as solid: give the robot the exact surfaces of its links (`vantage robot \
             --surfaces`), or mount the scanner on a longer adapter"
        }
    }
}

/// Share of a device's field that is hidden: `38 to 85 % of the left camera's field at 480 mm`.
fn hidden_share(share: &HiddenShare) -> String {
    let device = match share.device {
        DeviceName::Left => "left camera",
        DeviceName::Right => "right camera",
        DeviceName::Projector => "projector",
    };
    let percent = |share: f64| rounded_to(100.0 * share, 1);
    let range = match (share.min, share.max) {
        (min, max) if max - min <= HIDDEN_ROUNDING => format!("{}", percent(max)),
        (min, max) if min <= HIDDEN_ROUNDING => format!("up to {}", percent(max)),
        (min, max) => format!("{} to {}", percent(min), percent(max)),
    };
    format!("{range} % of the {device}'s field at {} mm", rounded_to(share.depth_mm, 6))
}

/// Warning of a body of the arm and one that the flange carries that overlap always, and are therefore not tested against each other.
fn load_overlaps_arm(cell: &Cell, pair: &Contact, at: &str) -> FieldWarning {
    let Contact { a: arm, b: load } = pair;
    let on_mount = cell.mount.iter().position(|body| body.name.as_str() == &**load);
    let (pointer, place) = match on_mount {
        Some(index) => (format!("{at}/mount/{index}"), "check its shape and owner_from_body"),
        None => (
            format!("{at}/flange_from_scanner"),
            "check the signs of flange_from_scanner, or mount the scanner on a longer adapter",
        ),
    };
    FieldWarning {
        code: WarningCode::LoadOverlapsArm,
        pointer,
        detail: format!(
            "puts {load:?}, which the flange carries, where it overlaps {arm:?} of the arm in every posture that was tried: collisions \
             between the two are NOT checked, and a plan may drive one into the other"
        ),
        remedy: format!(
            "{place}; if the pose is right, the robot's capsules are too wide there: give it the exact surfaces of its links, from its \
             URDF (`vantage robot --surfaces`; `vantage presets NAME` prints the file of a preset, which names its URDF); without one, \
             narrow the limits of joint 5 in a copy of the robot's file until {arm:?} and {load:?} cannot meet"
        ),
    }
}

/// Warning of a part without a fixture that would not stand with an axis up; `None` where that cannot be told. `stable` are the
/// ways in which it stands ([`crate::geometry::stable_poses()`]).
#[must_use]
pub fn of_standing(stable: &[StablePose], up: UpAxis, at: &str) -> Option<FieldWarning> {
    if stable.is_empty() || up.is_among(stable) {
        return None;
    }
    Some(FieldWarning {
        code: WarningCode::PartUnstable,
        pointer: at.to_owned(),
        detail: format!("is {up}, and the part would tip over that way{}", ways_to_stand(stable)),
        remedy: "choose another axis, or plan with the fixture that holds the part (part.fixture_mesh)".to_owned(),
    })
}

/// Warnings of poses in which a part without a fixture would tip over, each with the pointer to it; none where that cannot be told.
/// `stable` are the ways in which it stands ([`crate::geometry::stable_poses()`]).
#[must_use]
pub fn of_poses(stable: &[StablePose], poses: &[(String, Pose<Table, Part>)]) -> Vec<FieldWarning> {
    let remedy = "by default the part lies as in its file: turn it onto a side on which it stands (part.table_from_part, --up), or plan \
                  with the fixture that holds it (part.fixture_mesh)";
    let warning = |pointer: &String| FieldWarning {
        code: WarningCode::PartUnstable,
        pointer: pointer.clone(),
        detail: format!(
            "the part would tip over as it is placed: it does not stand stably within 3° of that pose, and nothing holds it{}",
            ways_to_stand(stable)
        ),
        remedy: remedy.to_owned(),
    };
    poses.iter().filter(|(_, pose)| tips_over(stable, pose)).map(|(pointer, _)| warning(pointer)).collect()
}

/// Axes of a part that point up where it stands, at the end of a sentence; empty if there are none.
fn ways_to_stand(stable: &[StablePose]) -> String {
    let stands: Vec<String> = UpAxis::all().filter(|axis| axis.is_among(stable)).map(|axis| axis.to_string()).collect();
    if stands.is_empty() { String::new() } else { format!("; it stands with {} up", stands.join(", ")) }
}

/// Warnings without those on the target of a region that misses it since it holds nothing of the part: another one says so.
#[must_use]
pub fn by_cause(mut warnings: Vec<FieldWarning>) -> Vec<FieldWarning> {
    let is_empty = |warning: &&FieldWarning| warning.code == WarningCode::RegionEmpty;
    let empty: Vec<String> = warnings.iter().filter(is_empty).map(|warning| format!("{}/target", warning.pointer)).collect();
    warnings.retain(|warning| warning.code != WarningCode::RegionUnmet || !empty.contains(&warning.pointer));
    warnings
}

/// Warnings of a plan that its reports list at their head: all but [`WarningCode::FragileUnderPoseError`], which stands beside the figures
/// that it is on, and the one on the target of a region of which the list says that it is empty.
#[must_use]
pub fn at_head_of_reports(warnings: &[FieldWarning]) -> Vec<FieldWarning> {
    let mut warnings = by_cause(warnings.to_vec());
    warnings.retain(|warning| warning.code != WarningCode::FragileUnderPoseError);
    warnings
}

/// Name of the parameter that a warning on a plan is on, as options of the command line have it.
pub(crate) fn parameter_of(warning: &FieldWarning) -> String {
    let pointer = warning.pointer.strip_prefix("/params").unwrap_or(&warning.pointer);
    pointer.trim_start_matches('/').replace('/', ".")
}

/// Warning of a home that is free, but not with the clearance of a plan, which `scene` keeps.
fn home_too_close(cell: &Cell, scene: &CollisionScene, clearance_mm: f64, at: &str) -> Option<FieldWarning> {
    let contact = scene.check(&cell.home_rad)?;
    Some(FieldWarning {
        code: WarningCode::HomeTooClose,
        pointer: format!("{at}/home_deg"),
        detail: format!(
            "brings {contact} closer together than {clearance_mm} mm, the clearance of a plan: there may be no path from home"
        ),
        remedy: "move the home, mount the scanner by another face, or plan with a smaller motion.clearance_mm".to_owned(),
    })
}

/// Warnings on a home that is not free in the scenes that the setups of a plan were planned in; `at` is the pointer to the cell.
#[must_use]
pub fn of_home(cell: &Cell, scenes: &[CollisionScene], clearance_mm: f64, at: &str) -> Vec<FieldWarning> {
    let mut contacts = Vec::new();
    for contact in scenes.iter().filter_map(|scene| scene.check(&cell.home_rad)) {
        if !contacts.contains(&contact) {
            contacts.push(contact);
        }
    }
    let warning = |contact: Contact| {
        let with_part = if contact.is_with_part() { ", with the part on its plate" } else { "" };
        FieldWarning {
            code: WarningCode::HomeBlocked,
            pointer: format!("{at}/home_deg"),
            detail: format!(
                "makes {contact} collide, or come closer than {clearance_mm} mm, the clearance of the plan{with_part}: no path leads from \
                 home to any view"
            ),
            remedy: home_remedy(&contact, clearance_mm),
        }
    };
    contacts.into_iter().map(warning).collect()
}

/// Warnings on parameters before they are planned with; `at` is the pointer to them.
#[must_use]
pub fn of_params(params: &PlanParams, at: &str) -> Vec<FieldWarning> {
    let noise = &params.regions.noise;
    let warning = |(index, tolerance_mm): (usize, f64)| FieldWarning {
        code: WarningCode::ToleranceBeyondNoise,
        pointer: format!("{at}/regions/features/{index}/tolerance_mm"),
        detail: format!(
            "is {tolerance_mm} mm, in a drawing {} mm; the finest that this noise allows is {} mm, in a drawing ±{} mm, at best focus \
             and perpendicular to the surface, so none of the feature will count as measured. It has to be at least 4 · \
             regions.noise.best_mm ({} mm) / regions.noise.budget ({}){}",
            limits_mm(tolerance_mm),
            rounded_up_mm(noise.min_tolerance_mm()),
            rounded_up_mm(0.5 * noise.min_tolerance_mm()),
            fixed(noise.best_mm, 4),
            noise.budget,
            sources(noise)
        ),
        remedy: remedy_for_noise(),
    };
    params.regions.beyond_noise().map(|(index, feature)| (index, feature.tolerance_mm)).map(warning).collect()
}

/// Warnings on features whose points are to lie closer than those of the scanner ever do; `at` is the pointer to the parameters.
#[must_use]
pub fn of_spacing(params: &PlanParams, scanner: &Scanner, at: &str) -> Vec<FieldWarning> {
    let min_mm = scanner.min_point_spacing_mm();
    let spacings =
        params.regions.features.iter().enumerate().filter_map(|(index, feature)| Some((index, feature.point_spacing_mm?)));
    let warning = |(index, spacing_mm): (usize, f64)| FieldWarning {
        code: WarningCode::SpacingBeyondScanner,
        pointer: format!("{at}/regions/features/{index}/point_spacing_mm"),
        detail: format!(
            "is {spacing_mm} mm; points of this scanner are never closer than {} mm, at its nearest distance and perpendicular to the \
             surface, so none of the feature will count as measured",
            rounded_up_mm(min_mm)
        ),
        remedy: "give a coarser point_spacing_mm, or plan with a scanner of more pixels or a smaller field".to_owned(),
    };
    spacings.filter(|(_, spacing_mm)| *spacing_mm < min_mm).map(warning).collect()
}

/// Warning on a goal that has no meaning without a cell; `at` is the pointer to the parameters.
#[must_use]
pub fn of_goal(params: &PlanParams, has_cell: bool, at: &str) -> Option<FieldWarning> {
    (params.selection.goal == SelectionGoal::MinTime && !has_cell).then(|| FieldWarning {
        code: WarningCode::GoalNeedsCell,
        pointer: format!("{at}/selection/goal"),
        detail: "is min_time, and there is no cell whose time could be shortened: the fewest views are chosen".to_owned(),
        remedy: "give a cell, or leave the goal out".to_owned(),
    })
}

/// Warning on a fixture that runs deeper than this into the part, or that is the part's own file; `at` is the pointer to the parameters.
#[must_use]
pub fn of_fixture(is_part: bool, max_depth_mm: f64, at: &str) -> FieldWarning {
    let detail = if is_part {
        "is the file of the part itself, which hides nothing that the part does not hide".to_owned()
    } else {
        format!(
            "runs more than {max_depth_mm} mm deep into the part, or holds it in its material: what lies in it counts as hidden"
        )
    };
    FieldWarning {
        code: WarningCode::FixtureOverlapsPart,
        pointer: format!("{at}/part/fixture_mesh"),
        detail,
        remedy: "see whether it is the right file, in the coordinates and the unit of the part's".to_owned(),
    }
}

/// Sources of the values that are the defaults.
fn sources(noise: &NoiseParams) -> String {
    let default = NoiseParams::default();
    let is_default = |value: f64, default: f64| value.total_cmp(&default).is_eq();
    let mut sources = Vec::new();
    if is_default(noise.best_mm, default.best_mm) {
        sources
            .push("best_mm is the default, a third of the TransCAN C's single-shot accuracy of 0.035 mm, taken as three sigma");
    }
    if is_default(noise.budget, default.budget) {
        sources.push(
            "budget is the default, the 30 % of the tolerance that VDA Volume 5 recommends for a measurement process, with the \
             noise alone as its uncertainty, which is our choice",
        );
    }
    if sources.is_empty() { String::new() } else { format!("; {}", sources.join("; ")) }
}

fn remedy_for_noise() -> String {
    "give a coarser tolerance_mm, a smaller regions.noise.best_mm if you measured your scanner's noise, or a larger \
     regions.noise.budget if your rule for uncertainty allows it"
        .to_owned()
}

/// Warnings on the targets that the regions of a plan do not reach; `at` is the pointer to its parameters.
#[must_use]
pub fn of_regions(params: &PlanParams, regions: &[RegionCoverageDocument], at: &str) -> Vec<FieldWarning> {
    let unmet = regions.iter().enumerate().filter(|(_, region)| region.met == Some(false));
    let too_fine = too_fine_features(params, regions);
    unmet.map(|(number, region)| unmet_region(&pointer_of_region(params, number, at), region, &too_fine)).collect()
}

/// Warnings on the targets that the regions of a plan reach on the samples that views were chosen on alone; `at` is the pointer to its
/// parameters.
#[must_use]
pub fn of_refuted_regions(params: &PlanParams, regions: &[RegionCoverageDocument], at: &str) -> Vec<FieldWarning> {
    let refuted = regions.iter().enumerate().filter(|(_, region)| region.is_refuted());
    refuted.map(|(number, region)| refuted_region(&pointer_of_region(params, number, at), region)).collect()
}

closed_list! {
    /// Lists of regions among the parameters.
    pub enum RegionUse {
        /// Excluded regions.
        Exclude = "exclude",
        /// Regions of interest.
        Interest = "interest",
        /// Toleranced features.
        Features = "features",
    }
}

/// Warning on a region, by its list and its place there, that holds nothing of a part within this box; `at` is the pointer to the
/// parameters.
#[must_use]
pub fn of_empty_region(list: RegionUse, place: usize, part: &Aabb, at: &str) -> FieldWarning {
    let spans: Vec<String> = (0..3)
        .zip(["x", "y", "z"])
        .map(|(axis, name)| format!("{name} {} to {}", fixed(part.min[axis], 1), fixed(part.max[axis], 1)))
        .collect();
    FieldWarning {
        code: if list == RegionUse::Exclude { WarningCode::ExclusionEmpty } else { WarningCode::RegionEmpty },
        pointer: format!("{at}/regions/{}/{place}", list.as_str()),
        detail: format!("contains nothing of the part, which spans {} mm", spans.join(", ")),
        remedy: "regions are given in mm, in the coordinates of the part's file".to_owned(),
    }
}

/// Warnings on what the coverage of a plan does not reach or tolerate; `at` is the pointer to its parameters.
#[must_use]
pub fn of_coverage(params: &PlanParams, coverage: &CoverageDocument, stopped_because: StopReason, at: &str) -> Vec<FieldWarning> {
    let mut warnings = of_regions(params, &coverage.regions, at);
    warnings.extend(of_refuted_regions(params, &coverage.regions, at));
    warnings.extend(of_grade_a(params, coverage, at));
    let fragile = |robust: &RobustDocument| of_robust(params, robust, (coverage.of_open, stopped_because), at);
    warnings.extend(coverage.robust.as_ref().and_then(fragile));
    warnings
}

/// Warning on a plan whose views measure less at grade A than is asked for; `at` is the pointer to its parameters. Further views of the
/// open area are not chosen by it.
#[must_use]
pub fn of_grade_a(params: &PlanParams, coverage: &CoverageDocument, at: &str) -> Option<FieldWarning> {
    let is_less = |asked: &f64| !coverage.of_open && coverage.grades.a < asked - SHARE_ROUNDING;
    let asked = params.selection.min_grade_a.filter(is_less)?;
    let remedy = if params.selection.max_views.is_some_and(|views| coverage.curve.len() >= views as usize) {
        "raise selection.max_views, or ask for less"
    } else {
        "give views more places to choose from (candidates.even_directions, candidates.standoffs_mm), or ask for less; where little is \
         missing, ask for slightly more, since views are chosen on some of the samples"
    };
    Some(FieldWarning {
        code: WarningCode::GradeAUnmet,
        pointer: format!("{at}/selection/min_grade_a"),
        detail: format!(
            "is {asked}; the views measure {} % of the asked area at grade A",
            percent_below(coverage.grades.a, 1.0, 2)
        ),
        remedy: remedy.to_owned(),
    })
}

/// Warning on a plan that loses more than [`Robust::MAX_LOSS`] of the asked area, of further views of the open area, in some draw
/// of its pose errors; `at` is the pointer to its parameters.
#[must_use]
pub fn of_robust(
    params: &PlanParams,
    robust: &RobustDocument,
    (is_of_open, stopped_because): (bool, StopReason),
    at: &str,
) -> Option<FieldWarning> {
    let costliest = Some(robust.costliest()).filter(|costliest| costliest.loss() > Robust::MAX_LOSS)?;
    let [angle_deg, shift_mm] = pose_error_sizes(&robust.pose_error);
    // What ended the choice; a plan for the best coverage has no target, and further views have limits of their own.
    let more = match (is_of_open, params.selection.goal, stopped_because) {
        (true, _, StopReason::MaxViews) => "raise max_views of the rescan",
        (true, _, StopReason::Growth) => "lower min_gain of the rescan",
        (false, _, StopReason::Growth) => "lower selection.min_growth",
        (false, _, StopReason::MaxViews) | (_, SelectionGoal::BestCoverage, _) => "raise selection.max_views",
        (_, _, StopReason::Target | StopReason::NoGain | StopReason::NoPath | StopReason::RegionsUnmet) => {
            "raise selection.target"
        }
    };
    let (state, remedy) = if params.robust.select {
        ("true, and yet", format!("{more}, so that more of the surface is measured twice"))
    } else {
        ("false, and", format!("choose views that tolerate it (--set robust.select=true), or {more}"))
    };
    Some(FieldWarning {
        code: WarningCode::FragileUnderPoseError,
        pointer: format!("{at}/robust/select"),
        detail: format!(
            "is {state} an error of {} by {angle_deg}° and {shift_mm} mm costs {:.2} percentage points of coverage in the worst of {}: {} % of the \
             {} area instead of {} %; a plan that tolerates it loses no more than {:.1} points",
            costliest.kind,
            100.0 * costliest.loss(),
            counted(costliest.draws, "draw"),
            percent_below(costliest.of_asked.worst, 1.0, 2),
            asked_name(is_of_open),
            percent_below(costliest.of_asked.nominal, 1.0, 2),
            100.0 * Robust::MAX_LOSS,
        ),
        remedy,
    })
}

/// Pointer to a region by its number: regions of interest come first, then features.
fn pointer_of_region(params: &PlanParams, number: usize, at: &str) -> String {
    match number.checked_sub(params.regions.interest.len()) {
        None => format!("{at}/regions/interest/{number}"),
        Some(feature) => format!("{at}/regions/features/{feature}"),
    }
}

fn refuted_region(pointer: &str, region: &RegionCoverageDocument) -> FieldWarning {
    FieldWarning {
        code: WarningCode::RegionUnconfirmed,
        pointer: format!("{pointer}/target"),
        detail: format!(
            "is {}; {:?} reaches it on the samples that views were chosen on, but not on {} others: {}",
            region.target.unwrap_or_default(),
            region.name,
            region.independent_samples.unwrap_or_default(),
            independent_share(region).unwrap_or_default()
        ),
        remedy: "raise the target a little, so that views are chosen for more of the region, or raise part.samples_per_mm2"
            .to_owned(),
    }
}

/// Features of a finer tolerance than the noise allows, by their names and the parameters of their tolerances: `the feature "bore"
/// (regions.features.0.tolerance_mm)`, of several those that overlap a region. Empty if there are none.
fn too_fine_features(params: &PlanParams, regions: &[RegionCoverageDocument]) -> String {
    let named = |index: usize| {
        let region = regions.get(params.regions.interest.len() + index);
        let name = region.map_or_else(String::new, |region| format!("{:?} ", region.name));
        format!("{name}(regions.features.{index}.tolerance_mm)")
    };
    let named: Vec<String> = params.regions.beyond_noise().map(|(index, _)| named(index)).collect();
    match &named[..] {
        [] => String::new(),
        [feature] => format!("the feature {feature}"),
        features => format!("each of the features {} that overlaps it", features.join(", ")),
    }
}

/// Warning on a region that misses its target; `too_fine` are the features that have too fine a tolerance where the region has
/// none.
fn unmet_region(pointer: &str, region: &RegionCoverageDocument, too_fine: &str) -> FieldWarning {
    let missed_mm2 = region.asked_area_mm2 - region.measured_area_mm2;
    let is_own = region.tolerance_mm.zip(region.min_tolerance_mm).is_some_and(|(own_mm, min_mm)| own_mm < min_mm);
    let remedy = if region.beyond_noise_area_mm2 > 0.5 * missed_mm2 {
        // The strictest of all regions that hold a point applies there.
        let whose = if is_own || too_fine.is_empty() { String::new() } else { format!("for {too_fine}, ") };
        whose + &remedy_for_noise()
    } else {
        "see the fixes for the largest missed spots, in the report and under missed in the plan; exclude what cannot be measured \
         (regions.exclude), or lower the target"
            .to_owned()
    };
    FieldWarning {
        code: WarningCode::RegionUnmet,
        pointer: format!("{pointer}/target"),
        detail: format!(
            "is {}, but {} % of the {} mm² of {:?} is measured; missed: {}",
            region.target.unwrap_or_default(),
            percent_below(region.of_asked, region.target.unwrap_or_default(), 2),
            area_mm2(region.asked_area_mm2),
            region.name,
            region.why_unmet.as_deref().unwrap_or("not known")
        ),
        remedy,
    }
}
