//! Turns of a part about axes about which it nearly looks the same: a shaft with a key, a flange with a pin. Nearly all points lie on
//! the part in each of them, so that shares of points do not tell them apart; the few that lie on what breaks the symmetry do.
//!
//! Turns about its axes ([`super::axes`]) in steps that bring most points near the part are refined, and compared by all points
//! ([`super::compared`]).
//!
//! A part as stated whose key is broken off is explained as well by each turn that has the key where nobody looked. Against the stated pose
//! count only cells that the turn explains and most further turns do not, as points on a key: surface without a key lies alike in all of
//! them. A hole is told by its walls, and where no further turn can be asked, the stated pose is kept. A refinement slides about an axis
//! that points leave open: it is turned back first ([`turned_back`]), so that a part beside its place counts as stated too.
//! Turns that points leave open of a part that is registered count towards its uncertainty ([`open_turns`]).
//!
//! Cost: some 100 000 nearest-face queries for a part without such axes, four times as many for one with, and twice that again for one that
//! a turn of the stated pose explains better.

use std::borrow::Borrow;

use nalgebra::{Isometry3, Point3};

use super::axes::{TurnAxis, axes};
use super::compared::{
    ComparedPoints, DOUBT, OFF_SDS, SAME_MM, SURE, cell_mm, compared_views, distances_mm, felt, is_told_apart, looks_same,
    on_feature, outline_mm,
};
use super::locate::{Scored, Search};
use super::points::ViewPoints;
use crate::cell::calibration::se3::Twist;
use crate::geometry::{Aabb, NearestFace, ascending, parallel, sort_ascending};
use crate::inspection::ViewScan;

#[cfg(test)]
mod tests;

/// Turns about an axis that are tried, over 2π.
const TURNS: i32 = 72;
/// Steps that a turn near the part is divided into.
const SUBSTEPS: i32 = 3;
/// Points with which turns are screened.
const SCREENED_POINTS: usize = 150;
/// Share of the points near the part from which on a turn is followed, of the share at the pose that is turned. Below that of poses which
/// are rivals by their points.
const NEAR_SHARE: f64 = 0.8;
/// Distance that counts as near, in diameters: by so much half a step moves points at half a diameter from the axis.
const NEAR_DIAMETERS: f64 = 0.022;
/// Turns that are refined at most.
const RIVALS: usize = 8;
/// Further turns that are asked at most which of a rival's points lie on surface without a feature: a twelfth of a turn apart, or nearer.
const FURTHER_TURNS: usize = 12;
/// Larger part of a length that is cut by the golden section: (√5 − 1) / 2.
const GOLDEN_SECTION: f64 = 0.618_034;
/// Minimum turn between two of them, and from the pose that is turned, rad.
const APART_RAD: f64 = 0.1;
const AWAY_RAD: f64 = 0.05;
/// Steps of a refinement.
const STEPS: i32 = 8;

/// Distance by which the first turn moves a corner of those that are tried for whether points tell them, mm; each further one is twice as
/// large. Not from a source: about the distance from which on a point counts as off the surface.
const FIRST_TURN_MM: f64 = 0.15;

/// Finding on the turns of a pose.
pub(super) enum TurnVerdict {
    /// The pose is kept: no turn explains the points as well, or all that do look the same.
    Kept,
    /// A turn explains the points better than it and than all others.
    Better(Scored),
    /// A turn that cannot be told apart from the best pose.
    Open(Scored),
}

/// Turns a pose back about an axis of the part, by as much as it is turned about it from the stated one: a refinement slides about an axis
/// that points leave open. `None` where no such pose lies within the reach, or points tell those that do from it.
pub(super) fn turned_back<S: Borrow<ViewScan>>(
    scans: &[S],
    search: &Search<'_>,
    taken: &Isometry3<f64>,
    reach_mm: f64,
) -> Option<Isometry3<f64>> {
    let diameter_mm = search.around.extent_mm().norm();
    let moved_mm = |pose: &Isometry3<f64>| search.apart_mm(pose, &Isometry3::identity());
    let closest_mm = moved_mm(taken).min(reach_mm);
    let backs = axes(search.nearest.mesh(), diameter_mm)
        .into_iter()
        .map(|axis| (axis, axis.turn(-axis.turn_of(&taken.rotation)) * taken))
        .map(|(axis, pose)| (moved_mm(&pose), axis, pose));
    let mut backs: Vec<(f64, TurnAxis, Isometry3<f64>)> = backs.filter(|(moved_mm, ..)| *moved_mm < closest_mm).collect();
    if backs.is_empty() {
        return None;
    }
    sort_ascending(&mut backs, |back| back.0);
    let points = ComparedPoints::of_part(scans, diameter_mm);
    let limit_mm = OFF_SDS * points.sd_mm(taken, search.nearest);
    let costs_of = |pose: &Isometry3<f64>| points.costs(pose, search.nearest, limit_mm);
    let own = costs_of(taken);
    let explains_as_well = |(_, axis, pose): &(f64, TurnAxis, Isometry3<f64>)| {
        let costs = felt(costs_of(pose), &own);
        // A turn that takes a feature to where nobody looked explains bare surface better: only points on a feature tell it.
        !is_told_apart(&costs, &own, DOUBT)
            || around(axis, taken, costs_of)
                .is_some_and(|further| !is_told_apart(&costs, &on_feature(&costs, &own, &further), DOUBT))
    };
    backs.into_iter().find(explains_as_well).map(|(_, _, pose)| pose)
}

/// Costs of turns of a pose all around an axis, those that explain most cells; `None` where less than half of the turns do: the part is
/// not round about it.
fn around(axis: &TurnAxis, taken: &Isometry3<f64>, costs_of: impl Fn(&Isometry3<f64>) -> Vec<f64>) -> Option<Vec<Vec<f64>>> {
    // By the golden section, so that a prism looks the same in few of them.
    let angle_rad = |number: usize| (GOLDEN_SECTION * number as f64).fract() * std::f64::consts::TAU;
    let costs = (1..=FURTHER_TURNS).map(|number| costs_of(&(axis.turn(angle_rad(number)) * taken)));
    let further: Vec<Vec<f64>> = costs.filter(|costs| explains_most(costs)).collect();
    (2 * further.len() >= FURTHER_TURNS).then_some(further)
}

/// Returns true if a pose with these costs explains most cells.
fn explains_most(costs: &[f64]) -> bool {
    costs.iter().sum::<f64>() <= (1.0 - NEAR_SHARE) * costs.len() as f64
}

/// Corners of a box.
fn corners_mm(around: &Aabb) -> [Point3<f64>; 8] {
    let ends = [around.min, around.max];
    std::array::from_fn(|index| Point3::new(ends[index & 1].x, ends[index >> 1 & 1].y, ends[index >> 2].z))
}

/// Variances of the turns of a part about its axes that scans with these registered poses leave open, rad² and, of its middle, mm²: the
/// largest turn that points do not tell, of those that move no corner by more than the reach, counts as a standard deviation. Normal
/// equations know nothing of it where facets of a round wall, or points that lie off the part, seem to hold it.
pub(super) fn open_turns<S: Borrow<ViewScan>>(
    scans: &[S],
    part_from_scanner: &[Isometry3<f64>],
    nearest: &NearestFace<'_>,
    reach_mm: f64,
) -> Twist {
    let (mesh, placed) = (nearest.mesh(), Isometry3::identity());
    let diameter_mm = mesh.aabb().extent_mm().norm();
    let views = compared_views(scans).into_iter().zip(part_from_scanner);
    let views = views.map(|(view, pose)| ViewPoints { part_from_scanner: *pose, ..view }).collect();
    let points = ComparedPoints::of_views(views, cell_mm(diameter_mm));
    let limit_mm = OFF_SDS * points.sd_mm(&placed, nearest);
    let own = points.costs(&placed, nearest, limit_mm);
    let is_told = |turn: Isometry3<f64>| is_told_apart(&felt(points.costs(&turn, nearest, limit_mm), &own), &own, DOUBT);
    let mut variances = Twist::zeros();
    for axis in axes(mesh, diameter_mm) {
        let arm_mm = corners_mm(&mesh.aabb()).map(|corner| axis.distance_mm(&corner)).into_iter().fold(0.0, f64::max);
        let turns = std::iter::successors(Some(FIRST_TURN_MM), |moved_mm| Some(2.0 * moved_mm));
        let turns = turns.take_while(|moved_mm| *moved_mm <= reach_mm).map(|moved_mm| moved_mm / arm_mm.max(f64::MIN_POSITIVE));
        let open = turns.take_while(|angle_rad| [1.0, -1.0].iter().any(|sense| !is_told(axis.turn(sense * angle_rad)))).last();
        if let Some(angle_rad) = open {
            variances += axis.twist(angle_rad, &mesh.aabb().centre()).map(|component| component * component);
        }
    }
    variances
}

/// Looks for turns of a pose that explain the points as well. A pose that is as stated is kept unless points speak against it.
pub(super) fn turned<S: Borrow<ViewScan>>(scans: &[S], search: &Search<'_>, taken: &Scored, is_stated: bool) -> TurnVerdict {
    let diameter_mm = search.around.extent_mm().norm();
    let near = turns_near(scans, search, taken, diameter_mm);
    if near.is_empty() {
        return TurnVerdict::Kept;
    }
    let points = ComparedPoints::of_part(scans, diameter_mm);
    let outline_mm = outline_mm(search.nearest.mesh());
    let [same, starts] = starts(&near, &points, search, &outline_mm, taken, diameter_mm);
    let mut poses = vec![*taken];
    for start in &starts {
        let rival = refined(start, search);
        // From beside a turn in which the part looks the same a refinement comes to that one.
        let mut known = poses.iter().map(|other| &other.pose).chain(&same);
        if known.all(|other| search.differ(other, &rival.pose)) {
            poses.push(rival);
        }
    }
    if poses.len() == 1 { TurnVerdict::Kept } else { judged(&poses, &near, &points, search, &outline_mm, is_stated) }
}

/// Refines a turn that is near the part.
fn refined(turned: &Isometry3<f64>, search: &Search<'_>) -> Scored {
    search.refined_from(turned, search.around.extent_mm().norm() / 48.0, STEPS)
}

/// Compares poses, of which the first is the one that is turned; `near` has its turns that bring most points near the part.
fn judged(
    poses: &[Scored],
    near: &[Turn],
    points: &ComparedPoints,
    search: &Search<'_>,
    outline_mm: &[Point3<f64>],
    is_stated: bool,
) -> TurnVerdict {
    let nearest = search.nearest;
    let sd_mm = poses.iter().map(|one| points.sd_mm(&one.pose, nearest)).fold(f64::INFINITY, f64::min);
    let costs: Vec<Vec<f64>> = poses.iter().map(|one| points.costs(&one.pose, nearest, OFF_SDS * sd_mm)).collect();
    let totals: Vec<f64> = costs.iter().map(|cells| cells.iter().sum()).collect();
    // The first of equal ones.
    let best = (1..poses.len()).fold(0, |best, other| if totals[other] < totals[best] { other } else { best });
    let same_mm = SAME_MM.max(OFF_SDS * sd_mm);
    let is_same = |other: usize| {
        other == best || looks_same(&(poses[other].pose * poses[best].pose.inverse()), nearest, outline_mm, same_mm)
    };
    let is_open = |other: &usize| !is_same(*other) && !is_told_apart(&costs[*other], &costs[best], SURE);
    if is_same(0) {
        let rival = (1..poses.len()).find(is_open).filter(|_| !is_stated);
        return rival.map_or(TurnVerdict::Kept, |rival| TurnVerdict::Open(poses[rival]));
    }
    if is_stated {
        let is_like = |pose: &Isometry3<f64>| {
            let of = |other: usize| pose * poses[other].pose.inverse();
            [0, best].iter().any(|other| looks_same(&of(*other), nearest, outline_mm, same_mm))
        };
        let further = further_costs([&poses[0].pose, &poses[best].pose], near, points, search, OFF_SDS * sd_mm, &is_like);
        if !is_told_apart(&costs[0], &on_feature(&costs[0], &costs[best], &further), DOUBT) {
            return TurnVerdict::Kept;
        }
    }
    if (0..poses.len()).any(|other| is_open(&other)) {
        return TurnVerdict::Open(poses[best]);
    }
    // Of those that look the same the one that moves the part least.
    let moved_mm = |place: usize| search.apart_mm(&poses[place].pose, &Isometry3::identity());
    let same = (0..poses.len()).filter(|other| is_same(*other));
    TurnVerdict::Better(poses[same.fold(best, |least, other| if moved_mm(other) < moved_mm(least) { other } else { least })])
}

/// Costs of turns spread over those near the part: of poses that explain most cells, and in which the part lies and looks otherwise than in
/// the stated one and its rival.
fn further_costs(
    [stated, rival]: [&Isometry3<f64>; 2],
    near: &[Turn],
    points: &ComparedPoints,
    search: &Search<'_>,
    limit_mm: f64,
    is_like: &dyn Fn(&Isometry3<f64>) -> bool,
) -> Vec<Vec<f64>> {
    let mut further = Vec::with_capacity(FURTHER_TURNS);
    for turn in near.iter().step_by(near.len().div_ceil(FURTHER_TURNS).max(1)) {
        let pose = refined(&(turn.axis.turn(turn.angle_rad) * stated), search).pose;
        let costs = points.costs(&pose, search.nearest, limit_mm);
        if explains_most(&costs) && search.differ(&pose, stated) && search.differ(&pose, rival) && !is_like(&pose) {
            further.push(costs);
        }
    }
    further
}

/// A turn about an axis.
#[derive(Clone, Copy)]
struct Turn {
    axis: TurnAxis,
    angle_rad: f64,
}

/// Turns that bring most points near the part.
fn turns_near<S: Borrow<ViewScan>>(scans: &[S], search: &Search<'_>, taken: &Scored, diameter_mm: f64) -> Vec<Turn> {
    let of_view = (SCREENED_POINTS / scans.len().max(1)).max(8);
    let views: Vec<ViewPoints> = scans.iter().map(|scan| ViewPoints::of(scan.borrow(), of_view)).collect();
    let near_mm = (NEAR_DIAMETERS * diameter_mm).max(search.options.inlier_mm);
    let near = |pose: &Isometry3<f64>| {
        let distances_mm = distances_mm(&views, pose, search.nearest, near_mm);
        distances_mm.iter().filter(|distance_mm| **distance_mm < near_mm).count() as f64
    };
    let needed = NEAR_SHARE * near(&taken.pose).max(1.0);
    let step_rad = std::f64::consts::TAU / f64::from(TURNS);
    let turns: Vec<Turn> = axes(search.nearest.mesh(), diameter_mm)
        .into_iter()
        .flat_map(|axis| (1..TURNS).map(move |step| Turn { axis, angle_rad: f64::from(step) * step_rad }))
        .collect();
    let passes: Vec<bool> = parallel::map(&turns, |turn| near(&(turn.axis.turn(turn.angle_rad) * taken.pose)) >= needed);
    turns.into_iter().zip(passes).filter(|(_, passes)| *passes).map(|(turn, _)| turn).collect()
}

/// Turns that explain most, apart from each other: poses in which the mesh looks the same, and those to refine.
fn starts(
    near: &[Turn],
    points: &ComparedPoints,
    search: &Search<'_>,
    outline_mm: &[Point3<f64>],
    taken: &Scored,
    diameter_mm: f64,
) -> [Vec<Isometry3<f64>>; 2] {
    let nearest = search.nearest;
    let sd_mm = points.sd_mm(&taken.pose, nearest);
    let views = points.off_and_on(&taken.pose, nearest, OFF_SDS * sd_mm);
    let step_rad = std::f64::consts::TAU / f64::from(TURNS * SUBSTEPS);
    let fine: Vec<Isometry3<f64>> = near
        .iter()
        .flat_map(|turn| (0..SUBSTEPS).map(move |place| (turn, place - SUBSTEPS / 2)))
        .map(|(turn, place)| turn.axis.turn(turn.angle_rad + f64::from(place) * step_rad))
        .collect();
    // Half a step moves points by less than that.
    let limit_mm = (diameter_mm / 128.0).max(search.options.inlier_mm);
    let cost = |turn: &Isometry3<f64>| {
        let squares = distances_mm(&views, &(turn * taken.pose), nearest, limit_mm).into_iter().map(|one| one * one);
        squares.sum::<f64>()
    };
    let costs: Vec<f64> = parallel::map(&fine, cost);
    let mut apart: Vec<Isometry3<f64>> = Vec::with_capacity(RIVALS);
    for place in ascending(&costs) {
        let turn = fine[place];
        let is_apart = |other: &Isometry3<f64>| turn.rotation.angle_to(&other.rotation) > APART_RAD;
        if apart.len() < RIVALS && turn.rotation.angle() > AWAY_RAD && apart.iter().all(is_apart) {
            apart.push(turn);
        }
    }
    let same_mm = SAME_MM.max(OFF_SDS * sd_mm);
    let (same, others): (Vec<_>, Vec<_>) = apart.into_iter().partition(|turn| looks_same(turn, nearest, outline_mm, same_mm));
    [same, others].map(|turns| turns.into_iter().map(|turn| turn * taken.pose).collect())
}
