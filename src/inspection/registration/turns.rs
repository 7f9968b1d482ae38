//! Turns of a part about axes about which it nearly looks the same: a shaft with a key, a flange with a pin. Nearly all points lie on
//! the part in each of them, so that shares of points do not tell them apart; the few that lie on what breaks the symmetry do.
//!
//! Axes are those about which the surface slides best along itself (N. Gelfand, L. J. Guibas, "Shape segmentation using local slippage
//! analysis", SGP 2004, section 3), the principal ones of its area, and those of its box. Turns in steps that bring most points near the
//! part are refined, and compared by all points: squared distances are capped at κσ, so that a point counts as on the surface or off
//! it, and averaged over cells of the part, which count as one observation each since deviations of neighbours are alike. With mᵢ the
//! difference of two poses in cell i, they are told apart where Σmᵢ / √Σmᵢ² exceeds a quantile of the normal distribution (Q. H. Vuong,
//! "Likelihood ratio tests for model selection and non-nested hypotheses", Econometrica 57(2), 1989, section 5), and Σmᵢ some cells.
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
use std::collections::BTreeMap;

use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use rayon::prelude::*;

use super::locate::{Scored, Search, samples};
use super::points::ViewPoints;
use super::ppf::Oriented;
use super::robust_sd_mm;
use crate::cell::calibration::se3::{Twist, twist};
use crate::geometry::{Aabb, Mesh, NearestFace, NearestPoint, parallel};
use crate::inspection::ViewScan;

/// Samples of the mesh that axes are found from.
const AXIS_SAMPLES: usize = 2000;
/// Rounds of the search for the axis about which the surface slides best, and c of its weights: the share of a motion that a sample moves
/// along its normal. Not from a source: a key's walls move by nearly all of it, a wall that is round but for its facets by less.
const SLIP_ROUNDS: usize = 10;
const SLIP: f64 = 0.1;
/// Turns about an axis that are tried, over 2π.
const TURNS: i32 = 72;
/// Steps that a turn near the part is divided into.
const SUBSTEPS: i32 = 3;
/// Points with which turns are screened.
const SCREENED_POINTS: usize = 150;
/// Points off the surface, and as many on it, with which turns that pass are scored.
const SWEPT_POINTS: usize = 200;
/// Points with which refined poses are compared.
const COMPARED_POINTS: usize = 9000;
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
/// Least turn between two of them, and from the pose that is turned, rad.
const APART_RAD: f64 = 0.1;
const AWAY_RAD: f64 = 0.05;
/// Steps of a refinement.
const STEPS: i32 = 8;
/// Size of a cell that counts as one observation, mm and diameters, the smaller of both. Not from a source: features are not much smaller.
const CELL_MM: f64 = 2.5;
const CELL_DIAMETERS: f64 = 0.04;
/// Distance from which on a point counts as off the surface, in standard deviations: κ.
const OFF_SDS: f64 = 4.0;
/// Least standard deviation of points that is believed, mm: facets and poses of views that are off add to their noise.
const MIN_SD_MM: f64 = 0.03;
/// Farthest distance that enters it, mm.
const SD_REACH_MM: f64 = 2.0;
/// Least distance of vertices from the turned mesh by which they are held for different, mm: facets of round surfaces differ by as much.
const SAME_MM: f64 = 0.2;
/// Vertices and faces by which a mesh is held against itself, so many of each at most, and samples beside them.
const MAX_VERTICES: usize = 20_000;
const OUTLINE_SAMPLES: usize = 4000;

/// Evidence that tells two poses apart: cells, and standard deviations of the normal distribution.
#[derive(Clone, Copy)]
struct Level {
    cells: f64,
    deviations: f64,
}

/// Level of a pose that is taken: three cells, more than a speck covers (not from a source), and a probability of 1 % one-sided.
const SURE: Level = Level { cells: 3.0, deviations: 2.326 };
/// Level from which on the stated pose is doubted: two cells, and 10 % one-sided for the best of [`RIVALS`] rivals: an eighth of it for
/// each (Bonferroni's inequality).
const DOUBT: Level = Level { cells: 2.0, deviations: 2.241 };

/// Difference of a cell's costs up to which a turn back to the stated one is not held against it: facets of round surfaces differ by less,
/// in all cells alike. Not from a source.
const SLIGHT: f64 = 0.1;

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
    let mut backs: Vec<(f64, Axis, Isometry3<f64>)> = backs.filter(|(moved_mm, ..)| *moved_mm < closest_mm).collect();
    if backs.is_empty() {
        return None;
    }
    backs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let points = ComparedPoints::of_part(scans, diameter_mm);
    let limit_mm = OFF_SDS * points.sd_mm(taken, search.nearest);
    let costs_of = |pose: &Isometry3<f64>| points.costs(pose, search.nearest, limit_mm);
    let own = costs_of(taken);
    let explains_as_well = |(_, axis, pose): &(f64, Axis, Isometry3<f64>)| {
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
fn around(axis: &Axis, taken: &Isometry3<f64>, costs_of: impl Fn(&Isometry3<f64>) -> Vec<f64>) -> Option<Vec<Vec<f64>>> {
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

/// Costs of a pose where they differ from those of another one by more than a little, elsewhere those.
fn felt(costs: Vec<f64>, own: &[f64]) -> Vec<f64> {
    costs.into_iter().zip(own).map(|(cost, own)| if (cost - own).abs() < SLIGHT { *own } else { cost }).collect()
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

/// Costs of a rival where it counts against the stated pose, elsewhere the stated pose's own if they are higher. It counts in cells that
/// most further turns explain no better than the stated pose: points on the rival's feature. What they explain as the rival does is
/// surface without a feature, which tells no more than that the stated one is missing. Without further turns it counts nowhere.
fn on_feature(stated: &[f64], rival: &[f64], further: &[Vec<f64>]) -> Vec<f64> {
    let cost = |cell: usize| {
        let between = 0.5 * (stated[cell] + rival[cell]);
        let without = further.iter().filter(|costs| costs[cell] > between).count();
        if 2 * without > further.len() { rival[cell] } else { rival[cell].max(stated[cell]) }
    };
    (0..stated.len()).map(cost).collect()
}

/// Returns true if costs of cells tell that a pose is worse than another one.
fn is_told_apart(worse: &[f64], better: &[f64], level: Level) -> bool {
    let differences = || worse.iter().zip(better).map(|(worse, better)| worse - better);
    let (sum, squares) = (differences().sum::<f64>(), differences().map(|one| one * one).sum::<f64>());
    sum >= level.cells && sum >= level.deviations * squares.sqrt()
}

/// Points by which a mesh is held against itself: vertices, of which each feature has some; middles of faces, since all vertices of a hole
/// lie on the faces that it goes through; and samples, since in a sheet those middles do so too.
pub(super) fn outline_mm(mesh: &Mesh) -> Vec<Point3<f64>> {
    let [every_vertex, every_face] = [mesh.vertices_mm.len(), mesh.faces.len()].map(|count| count.div_ceil(MAX_VERTICES).max(1));
    let middle = |face: usize| {
        let [a, b, c] = mesh.corners(face);
        Point3::from((a.coords + b.coords + c.coords) / 3.0)
    };
    let mut outline_mm: Vec<Point3<f64>> = mesh.vertices_mm.iter().step_by(every_vertex).copied().collect();
    outline_mm.extend((0..mesh.faces.len()).step_by(every_face).map(middle));
    outline_mm.extend(samples(mesh, OUTLINE_SAMPLES).iter().map(|sample| sample.point_mm));
    outline_mm
}

/// Returns true if a motion takes the outline of the part onto its surface.
pub(super) fn looks_same(motion: &Isometry3<f64>, nearest: &NearestFace<'_>, outline_mm: &[Point3<f64>], within_mm: f64) -> bool {
    outline_mm.par_iter().all(|point| nearest.nearest(&(motion * point), within_mm).is_some())
}

/// Line about which a part is turned, frame of the mesh.
#[derive(Clone, Copy, Debug)]
struct Axis {
    through_mm: Point3<f64>,
    along: Vector3<f64>,
}

impl Axis {
    fn turn(&self, angle_rad: f64) -> Isometry3<f64> {
        let centre = Translation3::from(self.through_mm.coords);
        let rotation = UnitQuaternion::from_scaled_axis(self.along * angle_rad);
        centre * Isometry3::from_parts(Translation3::identity(), rotation) * centre.inverse()
    }

    /// Motion of a turn, to first order: the rotation, and by how much it shifts a point.
    fn twist(&self, angle_rad: f64, point_mm: &Point3<f64>) -> Twist {
        twist(&self.along, &self.along.cross(&(point_mm - self.through_mm))) * angle_rad
    }

    /// Distance of a point from the line, mm.
    fn distance_mm(&self, point_mm: &Point3<f64>) -> f64 {
        (point_mm - self.through_mm).cross(&self.along).norm()
    }

    /// Angle of a rotation's turn about the line, −π to π: what is left without it turns about lines across.
    fn turn_of(&self, rotation: &UnitQuaternion<f64>) -> f64 {
        let (along, scalar) = (rotation.imag().dot(&self.along), rotation.scalar());
        2.0 * if scalar < 0.0 { (-along).atan2(-scalar) } else { along.atan2(scalar) }
    }

    /// Returns true if another line is the same within a degree and a two hundredth of the diameter.
    fn is_near(&self, other: &Self, diameter_mm: f64) -> bool {
        let between = self.through_mm - other.through_mm;
        let off_mm = (between - self.along * between.dot(&self.along)).norm();
        self.along.dot(&other.along).abs() > 0.9998 && off_mm < 0.005 * diameter_mm
    }
}

/// Axes about which the part may look the same.
fn axes(mesh: &Mesh, diameter_mm: f64) -> Vec<Axis> {
    let samples = samples(mesh, AXIS_SAMPLES);
    let count = samples.len().max(1) as f64;
    let centre = Point3::from(samples.iter().map(|sample| sample.point_mm.coords).sum::<Vector3<f64>>() / count);
    let mut spread = Matrix3::<f64>::zeros();
    for sample in &samples {
        let at = sample.point_mm - centre;
        spread += at * at.transpose() / count;
    }
    let principal = spread.symmetric_eigen().eigenvectors;
    // Those of the box are exact where others, which are found from samples, are not.
    let through_mm = mesh.aabb().centre();
    let mut found: Vec<Axis> = (0..3).map(|axis| Axis { through_mm, along: Vector3::ith(axis, 1.0) }).collect();
    found.extend(slippage(&samples, &centre, spread.trace().sqrt()));
    found.extend((0..3).map(|axis| Axis { through_mm: centre, along: principal.column(axis).into_owned() }));
    let mut axes: Vec<Axis> = Vec::with_capacity(found.len());
    for axis in found {
        if axes.iter().all(|other| !other.is_near(&axis, diameter_mm)) {
            axes.push(axis);
        }
    }
    axes
}

/// Axis of the motion that moves samples least along their normals; `None` where that is a shift. What breaks a symmetry would draw the
/// axis to itself: samples that move are weighted down after Geman and McClure ("Statistical methods for tomographic image reconstruction",
/// Bulletin of the International Statistical Institute 52(4), 1987), w = 1/(1 + (r/c)²)².
fn slippage(samples: &[Oriented], centre: &Point3<f64>, arm_mm: f64) -> Option<Axis> {
    let arm_mm = arm_mm.max(f64::MIN_POSITIVE);
    let row = |sample: &Oriented| {
        let turn = (sample.point_mm - centre).cross(&sample.normal) / arm_mm;
        Vector6::new(turn.x, turn.y, turn.z, sample.normal.x, sample.normal.y, sample.normal.z)
    };
    let rows: Vec<Vector6<f64>> = samples.iter().map(row).collect();
    let mut motion = Vector6::<f64>::zeros();
    for round in 0..SLIP_ROUNDS {
        let mut sum = Matrix6::<f64>::zeros();
        for row in &rows {
            let moved = if round == 0 { 0.0 } else { row.dot(&motion) / SLIP };
            sum += row * row.transpose() * (1.0 + moved * moved).powi(-2);
        }
        let eigen = sum.symmetric_eigen();
        motion = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    }
    let turn: Vector3<f64> = motion.fixed_rows::<3>(0) / arm_mm;
    let shift: Vector3<f64> = motion.fixed_rows::<3>(3).into_owned();
    let offset_mm: Vector3<f64> = turn.cross(&shift) / turn.norm_squared().max(f64::MIN_POSITIVE);
    // A turn about a line far off the part is a shift.
    let is_turn = offset_mm.norm() <= arm_mm;
    let along = turn.try_normalize(0.0).filter(|_| is_turn)?;
    Some(Axis { through_mm: centre + offset_mm, along })
}

/// A turn about an axis.
#[derive(Clone, Copy)]
struct Turn {
    axis: Axis,
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
    let mut order: Vec<usize> = (0..fine.len()).collect();
    order.sort_by(|a, b| costs[*a].total_cmp(&costs[*b]).then(a.cmp(b)));
    let mut apart: Vec<Isometry3<f64>> = Vec::with_capacity(RIVALS);
    for place in order {
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

/// Distances of points from the surface that looks to their scanner, in the order of views and points, each at most `max_mm`.
fn distances_mm(views: &[ViewPoints], pose: &Isometry3<f64>, nearest: &NearestFace<'_>, max_mm: f64) -> Vec<f64> {
    let of_view = |view: &ViewPoints| {
        let mesh_from_scanner = pose * view.part_from_scanner;
        let eye = Point3::from(mesh_from_scanner.translation.vector);
        let distance_mm = |point: &Point3<f64>| {
            let at = mesh_from_scanner * point;
            let looks_back = |found: &NearestPoint| nearest.mesh().scaled_normal(found.face as usize).dot(&(eye - at)) > 0.0;
            nearest.nearest(&at, max_mm).filter(looks_back).map_or(max_mm, |found| (at - found.point_mm).norm())
        };
        parallel::map(&view.points_mm, distance_mm)
    };
    views.iter().flat_map(of_view).collect()
}

/// Points of scans that are compared.
fn compared_views<S: Borrow<ViewScan>>(scans: &[S]) -> Vec<ViewPoints> {
    let of_view = (COMPARED_POINTS / scans.len().max(1)).max(50);
    scans.iter().map(|scan| ViewPoints::of(scan.borrow(), of_view)).collect()
}

/// Size of a cell of a part of this diameter.
fn cell_mm(diameter_mm: f64) -> f64 {
    CELL_MM.min(CELL_DIAMETERS * diameter_mm).max(f64::MIN_POSITIVE)
}

/// Points that tell poses apart, with the cells of the part that they lie in.
struct ComparedPoints {
    views: Vec<ViewPoints>,
    /// Cell of each point, in the order of views and points.
    cells: Vec<usize>,
    /// Points in each cell.
    counts: Vec<f64>,
}

impl ComparedPoints {
    /// Points in cells of the size that suits a part of this diameter.
    fn of_part<S: Borrow<ViewScan>>(scans: &[S], diameter_mm: f64) -> Self {
        Self::new(scans, cell_mm(diameter_mm))
    }

    fn new<S: Borrow<ViewScan>>(scans: &[S], size_mm: f64) -> Self {
        Self::of_views(compared_views(scans), size_mm)
    }

    fn of_views(views: Vec<ViewPoints>, size_mm: f64) -> Self {
        let mut numbers: BTreeMap<[i64; 3], usize> = BTreeMap::new();
        let (mut cells, mut counts) = (Vec::new(), Vec::<f64>::new());
        for view in &views {
            for point in &view.points_mm {
                let at = view.part_from_scanner * point;
                let place: [i64; 3] = at.coords.map(|value| (value / size_mm).floor() as i64).into();
                let cell = *numbers.entry(place).or_insert(counts.len());
                if cell == counts.len() {
                    counts.push(0.0);
                }
                counts[cell] += 1.0;
                cells.push(cell);
            }
        }
        Self { views, cells, counts }
    }

    /// Robust standard deviation of the points' distances from the part.
    fn sd_mm(&self, pose: &Isometry3<f64>, nearest: &NearestFace<'_>) -> f64 {
        robust_sd_mm(distances_mm(&self.views, pose, nearest, SD_REACH_MM)).max(MIN_SD_MM)
    }

    /// Mean square of the distances in each cell, each capped at `limit_mm` and in shares of it: 0 to 1.
    fn costs(&self, pose: &Isometry3<f64>, nearest: &NearestFace<'_>, limit_mm: f64) -> Vec<f64> {
        let mut costs = vec![0.0; self.counts.len()];
        for (cell, distance_mm) in self.cells.iter().zip(distances_mm(&self.views, pose, nearest, limit_mm)) {
            costs[*cell] += (distance_mm / limit_mm).powi(2) / self.counts[*cell];
        }
        costs
    }

    /// Some of the points that lie off the part, and as many on it: what breaks a symmetry is in the former.
    fn off_and_on(&self, pose: &Isometry3<f64>, nearest: &NearestFace<'_>, limit_mm: f64) -> Vec<ViewPoints> {
        let is_off: Vec<bool> =
            distances_mm(&self.views, pose, nearest, limit_mm).into_iter().map(|distance_mm| distance_mm >= limit_mm).collect();
        let off = is_off.iter().filter(|is_off| **is_off).count();
        let [every_off, every_on] = [off, is_off.len() - off].map(|count| count.div_ceil(SWEPT_POINTS).max(1));
        let (mut flags, mut seen) = (is_off.into_iter(), [0_usize; 2]);
        let some_of = |view: &ViewPoints| {
            let mut points_mm = Vec::new();
            for (point, is_off) in view.points_mm.iter().zip(flags.by_ref()) {
                let (number, every) = if is_off { (&mut seen[0], every_off) } else { (&mut seen[1], every_on) };
                if number.is_multiple_of(every) {
                    points_mm.push(*point);
                }
                *number += 1;
            }
            ViewPoints { part_from_scanner: view.part_from_scanner, points_mm, elements: Vec::new(), there: view.there }
        };
        self.views.iter().map(some_of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::locate::{LocateOptions, PartPlace, PartPose, place};
    use super::super::{RegistrationOptions, register};
    use super::*;
    use crate::cell::calibration::se3::log;
    use crate::geometry::Pose;
    use crate::inspection::shots::{Shots, motion_of};

    #[test]
    fn poses_are_told_apart_by_many_cells_and_not_by_a_speck_or_by_chance() {
        let told = |worse: &[f64], better: &[f64]| is_told_apart(worse, better, SURE);
        assert!(told(&[1.0; 9], &[0.1; 9]), "a feature");
        assert!(!told(&[1.0; 2], &[0.0; 2]), "a speck");
        assert!(!told(&[0.11; 20], &[0.1; 20]), "alike in all of them, and next to nothing");
        let (one, other) = ([[1.0, 0.0]; 30].concat(), [[0.0, 0.9]; 30].concat());
        assert!(!told(&one, &other), "some for the one, as many for the other");
        assert!(!told(&[], &[]));
    }

    #[test]
    fn a_rival_counts_where_most_further_turns_do_not_explain_the_points_either() {
        let (stated, rival) = ([1.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0]);
        let further = [vec![1.0, 0.0, 0.0, 1.0], vec![1.0, 0.0, 0.0, 0.0], vec![0.0, 1.0, 0.0, 1.0]];
        let sums =
            |further: &[Vec<f64>]| on_feature(&stated, &rival, further).iter().map(|cost| *cost as i32).collect::<Vec<_>>();
        assert_eq!(sums(&further), [0, 1, 1, 0], "a feature, surface without one, a feature that the rival lacks, a feature");
        assert_eq!(sums(&[]), [1, 1, 1, 1], "nobody can be asked");
    }

    /// A round shaft with a boss on its side that is so high: one surface, so that none lies beneath the boss.
    fn shaft(boss_mm: f64) -> Mesh {
        let (sides, levels) = (96_u32, 21_u32);
        let mut vertices_mm = Vec::new();
        for level in 0..levels {
            for side in 0..sides {
                let angle_rad = std::f64::consts::TAU * f64::from(side) / f64::from(sides);
                let is_boss = (8..=12).contains(&level) && (side <= 3 || side >= sides - 3);
                let radius_mm = if is_boss { 30.0 + boss_mm } else { 30.0 };
                vertices_mm.push(Point3::new(radius_mm * angle_rad.cos(), radius_mm * angle_rad.sin(), 3.0 * f64::from(level)));
            }
        }
        vertices_mm.extend([Point3::origin(), Point3::new(0.0, 0.0, 60.0)]);
        let (top, below, above) = ((levels - 1) * sides, levels * sides, levels * sides + 1);
        let mut faces: Vec<[u32; 3]> = Vec::new();
        for side in 0..sides {
            let next = (side + 1) % sides;
            for from in (0..levels - 1).map(|level| level * sides) {
                let (low, high) = ([from + side, from + next], [from + sides + side, from + sides + next]);
                faces.extend([[low[0], low[1], high[1]], [low[0], high[1], high[0]]]);
            }
            faces.extend([[below, next, side], [above, top + side, top + next]]);
        }
        Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
    }

    /// Scans of a shaft, all around or of its half towards x.
    fn scans_of(scanned: &Mesh, is_half: bool) -> Vec<ViewScan> {
        let shots = Shots::of(scanned, 32);
        let mut scans = shots.scans(&shots.poses(6), 0.01, |_| Isometry3::identity());
        for scan in scans.iter_mut().filter(|_| is_half) {
            let part_from_scanner = scan.part_from_scanner;
            let is_hidden = |point: &[f32; 3]| part_from_scanner.point(&Point3::from(point.map(f64::from))).x < 0.0;
            let hidden = scan.scanner_cloud.points_mm.iter_mut().filter(|point| is_hidden(point));
            hidden.for_each(|point| *point = [f32::NAN; 3]);
        }
        scans
    }

    /// Verdict on a shaft with a boss at turns about its axis, of which the first is the stated one.
    fn verdict_on(scans: &[ViewScan], turns_deg: &[f64]) -> TurnVerdict {
        let (mesh, options) = (shaft(6.0), LocateOptions::default());
        let nearest = NearestFace::new(&mesh);
        let search = Search::new(scans, &nearest, &options);
        let axis = Axis { through_mm: Point3::origin(), along: Vector3::z() };
        let pose = |turn_deg: &f64| Scored { pose: axis.turn(turn_deg.to_radians()), share: 1.0 };
        let poses: Vec<Scored> = turns_deg.iter().map(pose).collect();
        let step_rad = std::f64::consts::TAU / f64::from(TURNS);
        let near: Vec<Turn> = (1..TURNS).map(|step| Turn { axis, angle_rad: f64::from(step) * step_rad }).collect();
        judged(&poses, &near, &ComparedPoints::new(scans, CELL_MM), &search, &outline_mm(&mesh), true)
    }

    /// It was turned, or all scans were dropped: the defect that an inspection should show.
    #[test]
    fn a_part_whose_boss_is_missing_lies_as_stated_though_the_boss_might_be_where_nobody_looked() {
        let found = verdict_on(&scans_of(&shaft(0.0), true), &[0.0, 120.0, 180.0, 240.0]);
        assert!(matches!(found, TurnVerdict::Kept));
    }

    #[test]
    fn a_part_whose_boss_is_seen_elsewhere_is_turned_scanned_as_a_whole_or_in_half() {
        for is_half in [false, true] {
            let found = verdict_on(&scans_of(&shaft(6.0), is_half), &[120.0, 0.0, 210.0]);
            let is_true = |found: &Scored| found.pose.rotation.angle() < 1e-6;
            assert!(matches!(&found, TurnVerdict::Better(found) if is_true(found)), "half: {is_half}");
        }
    }

    /// A refinement slid by as much, and the part was said to lie elsewhere.
    #[test]
    fn a_turn_about_a_round_part_is_taken_back_unless_points_on_its_boss_tell_it() {
        let (mesh, options) = (shaft(6.0), LocateOptions::default());
        let nearest = NearestFace::new(&mesh);
        // A facet, so that all points but those on the boss lie on the part before and after.
        let turn = Axis { through_mm: Point3::origin(), along: Vector3::z() }.turn(3.75_f64.to_radians());
        // Points around the boss to one side of its middle are hidden: +1 or -1 along y, 0 for none.
        let taken_back = |boss_mm: f64, hidden_side: f64| {
            let mut scans = scans_of(&shaft(boss_mm), false);
            for scan in &mut scans {
                let part_from_scanner = scan.part_from_scanner;
                let is_hidden = |point: &[f32; 3]| {
                    let at = part_from_scanner.point(&Point3::from(point.map(f64::from)));
                    at.x > 20.0 && at.y * hidden_side > 0.0
                };
                let hidden = scan.scanner_cloud.points_mm.iter_mut().filter(|point| is_hidden(point));
                hidden.for_each(|point| *point = [f32::NAN; 3]);
                scan.part_from_scanner = Pose::claim(turn.inverse() * part_from_scanner.isometry());
            }
            turned_back(&scans, &Search::new(&scans, &nearest, &options), &turn, 5.0)
        };
        // Where one side is hidden, the turn takes the boss there, and uncovers bare wall on the other: it was taken for told.
        for hidden_side in [0.0, 1.0, -1.0] {
            let found = taken_back(0.0, hidden_side).expect("nothing tells the turn");
            assert!(found.rotation.angle() < 0.01 && found.translation.vector.norm() < 0.1, "{found}");
        }
        assert_eq!(taken_back(6.0, 0.0), None, "the boss does");
    }

    /// Facets of a round wall were taken to hold it.
    #[test]
    fn a_turn_about_a_round_part_is_open_unless_points_on_its_boss_tell_it() {
        let mesh = shaft(6.0);
        let nearest = NearestFace::new(&mesh);
        let open_deg = |boss_mm: f64| {
            let scans = scans_of(&shaft(boss_mm), false);
            let poses: Vec<Isometry3<f64>> = scans.iter().map(|scan| *scan.part_from_scanner.isometry()).collect();
            open_turns(&scans, &poses, &nearest, 5.0).fixed_rows::<3>(0).map(|variance| variance.sqrt().to_degrees())
        };
        let (without, with) = (open_deg(0.0), open_deg(6.0));
        assert!(without.z > 2.0 && without.x < 0.5 && without.y < 0.5, "{without}");
        assert!(with.max() < 0.5, "the boss tells: {with}");
    }

    /// Points on the bare wall pulled at the walls of the boss, and were taken to hold the part by them.
    #[test]
    fn a_part_whose_boss_is_missing_is_placed_by_its_other_surface_and_its_turn_is_stated_as_open() {
        let mesh = shaft(6.0);
        let (nearest, options) = (NearestFace::new(&mesh), RegistrationOptions::default());
        let scans = scans_of(&shaft(0.0), false);
        for seed in 0..2 {
            let off = motion_of(seed, 0.3, 1.0);
            let state = |scan: &ViewScan| {
                let part_from_scanner = Pose::claim(off * scan.part_from_scanner.isometry());
                ViewScan { part_from_scanner, ..scan.clone() }
            };
            let scans: Vec<ViewScan> = scans.iter().map(state).collect();
            let found = register(&scans, &nearest, &[], &options);
            let error = log(&(found.mesh_from_stated.isometry() * off));
            assert!(error.iter().zip(&found.sd).all(|(error, sd)| error.abs() <= 3.0 * sd), "{error} ± {}", found.sd);
            assert!(error.fixed_rows::<3>(3).norm() < 0.15, "{error}");
            assert!(found.sd[2].to_degrees() > 2.0 && found.sd[0].to_degrees() < 0.5, "{}", found.sd);
        }
    }

    /// Four scans of a shaft without its boss, with a point every so many pixels.
    fn bare_scans(step_px: u32) -> Vec<ViewScan> {
        let bare = shaft(0.0);
        let shots = Shots::of(&bare, step_px);
        shots.scans(&shots.poses(4), 0.01, |_| Isometry3::identity())
    }

    /// Points on the bare wall pulled at the walls of the boss, and turned the part by 11° to 15°.
    #[test]
    fn a_search_does_not_turn_a_part_by_the_boss_that_it_lacks() {
        let (mesh, options) = (shaft(6.0), LocateOptions::default());
        let nearest = NearestFace::new(&mesh);
        for step_px in [16, 24, 32] {
            let found = Search::new(&bare_scans(step_px), &nearest, &options).refined(&Isometry3::identity()).pose;
            assert!(found.rotation.angle().to_degrees() < 0.5 && found.translation.vector.norm() < 0.1, "{step_px} px: {found}");
        }
    }

    /// It was searched for, and compared in a wrong turn without a warning.
    #[test]
    fn a_round_part_that_lies_as_stated_without_its_boss_is_said_to_do_so() {
        let (mesh, options) = (shaft(6.0), LocateOptions::default());
        assert_eq!(place(&bare_scans(32), &NearestFace::new(&mesh), &options), PartPlace::AsStated);
    }

    /// Its turn was found in doubt, and all scans were dropped.
    #[test]
    fn a_round_part_without_its_boss_beside_its_place_is_moved_and_not_turned() {
        let (mesh, options, off) = (shaft(6.0), LocateOptions::default(), motion_of(1, 1.0, 3.0));
        let mut scans = bare_scans(24);
        for scan in &mut scans {
            scan.part_from_scanner = Pose::claim(off * scan.part_from_scanner.isometry());
        }
        let found = place(&scans, &NearestFace::new(&mesh), &options);
        let PartPlace::Elsewhere(PartPose { mesh_from_stated, .. }) = found else { panic!("{found:?}") };
        let left = mesh_from_stated.isometry() * off;
        assert!(left.rotation.angle().to_degrees() < 0.5 && left.translation.vector.norm() < 0.1, "{left}");
    }

    /// A square plate with a square hole, whose middle is moved along x.
    fn plate_with_hole(thickness_mm: f64, hole_x_mm: f64) -> Mesh {
        let ring = |x_mm: f64, half_mm: f64, z_mm: f64| {
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
                .map(|[x, y]: [f64; 2]| Point3::new(x_mm + half_mm * x, half_mm * y, z_mm))
        };
        let (outer, hole) = ([0.0, 30.0], [hole_x_mm, 5.0]);
        let vertices_mm: Vec<Point3<f64>> = [outer, hole]
            .iter()
            .flat_map(|[x_mm, half_mm]| [0.0, thickness_mm].map(|z_mm| ring(*x_mm, *half_mm, z_mm)))
            .flatten()
            .collect();
        let side = |i: u32| {
            let n = (i + 1) % 4;
            let above = [[4 + i, 4 + n, 12 + n], [4 + i, 12 + n, 12 + i]];
            let below = [[n, i, 8 + i], [n, 8 + i, 8 + n]];
            let around = [[i, n, 4 + n], [i, 4 + n, 4 + i]];
            let within = [[8 + n, 8 + i, 12 + i], [8 + n, 12 + i, 12 + n]];
            [above, below, around, within].concat()
        };
        let faces: Vec<[u32; 3]> = (0..4).flat_map(side).collect();
        Mesh { vertices_mm, source_face: (0..faces.len() as u32).collect(), faces, groups: Vec::new() }
    }

    /// After half a turn all vertices of such a plate lie on it, wherever the hole is.
    #[test]
    fn a_plate_looks_the_same_after_half_a_turn_only_with_the_hole_in_its_middle() {
        let half_turn = Isometry3::rotation(Vector3::z() * std::f64::consts::PI);
        for (thickness_mm, hole_x_mm, is_same) in [(10.0, 0.0, true), (10.0, 15.0, false), (0.3, 0.0, true), (0.3, 15.0, false)] {
            let mesh = plate_with_hole(thickness_mm, hole_x_mm);
            let nearest = NearestFace::new(&mesh);
            let found = looks_same(&half_turn, &nearest, &outline_mm(&mesh), SAME_MM);
            assert_eq!(found, is_same, "{thickness_mm} mm thick, hole at {hole_x_mm} mm");
        }
    }
}
