//! Finds a part that lies elsewhere than stated: poses from votes of point pairs ([`super::ppf`]) and from the part's own symmetries,
//! each refined, and the best one taken only where no other explains nearly as many points. Two poses that do are both given. Turns of
//! a part that nearly looks the same in them are told apart by the points that do not ([`super::turns`]).

use std::borrow::Borrow;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::compared::{looks_same, outline_mm};
use super::matching::match_view;
use super::points::ViewPoints;
use super::ppf::{Oriented, oriented, poses, thinned};
use super::turns::{TurnVerdict, turned, turned_back};
use super::{MAX_POINTS, RegistrationOptions, State};
use crate::cell::calibration::se3::Twist;
use crate::cell::closed_list;
use crate::geometry::{Aabb, Mesh, NearestFace, Part, Pose, sort_descending};
use crate::inspection::ViewScan;

/// Points with which poses are refined and compared.
const COMPARED_POINTS: usize = 1500;
/// Poses by votes that are refined.
const VOTED: usize = 10;
/// Steps of a refinement.
const STEPS: i32 = 16;
/// Cells of thinned points along the diameter; the votes' paper has 20.
const CELLS: f64 = 22.0;
/// Share of the points from which on the stated place of the part is not doubted.
const SURE_SHARE: f64 = 0.9;
/// Distance of a corner from its stated place up to which registration finds the part by itself, mm.
pub(in crate::inspection) const STATED_REACH_MM: f64 = 2.5;
/// Distance of a corner from its stated place up to which a turn that no point tells is held for the stated one, mm. Not from a source:
/// twice what registration bridges, and less than a part is off that was put down without care.
pub(super) const STATED_TURN_REACH_MM: f64 = 5.0;
/// Smallest share of the points on the part that a pose of it is taken for. Not from a source: well below what scans of a part have, and
/// above what was measured with scans of others' views.
pub(super) const MIN_PART_SHARE: f64 = 0.5;
/// Smallest such share of a pose that was searched for over all turns. It is the best of many, so that chance alone brings more points onto the part:
/// 0.52 were measured of views that were turned each about its own axis. The share is that from which on a view tells its own pose.
pub(super) const MIN_SEARCHED_SHARE: f64 = 0.6;

closed_list! {
    /// Reason for which no pose of the part is taken.
    pub enum NotLocated {
        /// No pose brings enough points onto the part.
        NoPart = "no_part",
        /// Another pose explains nearly as many points.
        AmbiguousPose = "ambiguous_pose",
    }
}

/// Knobs of the search.
#[derive(Clone, Debug, PartialEq)]
pub struct LocateOptions {
    /// Distance within which a point lies on the part, mm.
    pub inlier_mm: f64,
    /// Smallest share of the points on the part that a pose is taken for.
    pub min_inlier_share: f64,
    /// A second pose with at least this share of the best one's points makes the pose ambiguous.
    pub second_share: f64,
}

impl Default for LocateOptions {
    /// Half of the points within 0.5 mm; 0.9, with which no wrong pose of eight parts was taken (measured on gearbox and figurine).
    fn default() -> Self {
        Self { inlier_mm: 0.5, min_inlier_share: MIN_PART_SHARE, second_share: 0.9 }
    }
}

/// A pose of the part that explains points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartPose {
    /// Takes the part's coordinates by the stated poses to those of the mesh.
    pub mesh_from_stated: Pose<Part, Part>,
    /// Share of the points that lie on the part.
    pub inlier_share: f64,
    /// True if it is the best of a search over all turns; false if it was refined from the stated place.
    pub is_searched: bool,
}

/// Result of the search.
#[derive(Clone, Debug, PartialEq)]
pub struct Location {
    /// The best pose.
    pub best: PartPose,
    /// The best of the others, where there is one.
    pub second: Option<PartPose>,
    /// True if the part looks the same in both poses: no measurement of its surface tells them apart.
    pub is_symmetric: bool,
    /// Reason for which the best pose is not to be taken.
    pub refused: Option<NotLocated>,
}

/// Finds the part in scans whose stated poses are right among each other.
#[must_use]
pub fn locate<S: Borrow<ViewScan>>(scans: &[S], nearest: &NearestFace<'_>, options: &LocateOptions) -> Location {
    let search = Search::new(scans, nearest, options);
    let mut starts = vec![Isometry3::identity()];
    starts.extend(voted(scans, nearest.mesh(), &search.around));
    let mut found: Vec<Scored> = starts.iter().map(|start| search.refined(start)).collect();
    sort_descending(&mut found, |found| found.share);
    let best = found[0].pose;
    found.extend(flips(&search.around).iter().map(|flip| search.refined(&(flip * best))));
    sort_descending(&mut found, |found| found.share);
    let best = found[0];
    let second = found.iter().find(|other| search.differ(&best.pose, &other.pose)).copied();
    let rival = second.filter(|second| second.share >= options.second_share * best.share);
    let refused =
        if best.share < options.min_inlier_share { Some(NotLocated::NoPart) } else { rival.map(|_| NotLocated::AmbiguousPose) };
    // A shaft with a small key is not symmetric, though nearly all of it is.
    let is_symmetric = rival.is_some_and(|rival| {
        looks_same(&(rival.pose * best.pose.inverse()), nearest, &outline_mm(nearest.mesh()), options.inlier_mm)
    });
    Location { best: best.as_part(true), second: second.map(|second| second.as_part(true)), is_symmetric, refused }
}

/// Place of the part in scans, beside where their poses say.
#[derive(Clone, Debug, PartialEq)]
pub enum PartPlace {
    /// Near the stated one, from where registration finds it.
    AsStated,
    /// Another one, which alone explains the points.
    Elsewhere(PartPose),
    /// A place that is not known: no pose explains enough points, or several do.
    Unknown(Location),
}

/// Checks that the part lies where the poses of scans say, and searches for it where it does not.
///
/// The stated place is kept where a refinement from it explains nine tenths of the points, or nearly as many as the best pose that
/// the search finds: a part that deviates from its mesh lies where it was put. A place that the search finds, or that a refinement finds
/// more than 5 mm from the stated one, has to explain six tenths, and a nearer one half. Of a part that nearly looks the same in several turns, the one is taken that
/// explains the points best; where points do not tell which, its place is not known, unless it lies within 5 mm of the stated one: then it
/// is turned only by points on what breaks the symmetry, and one of which that is missing or not in view stays as it was put. A turn that a
/// refinement slid into, and that points do not tell from the stated one, is not held against it.
#[must_use]
pub fn place<S: Borrow<ViewScan>>(scans: &[S], nearest: &NearestFace<'_>, options: &LocateOptions) -> PartPlace {
    let search = Search::new(scans, nearest, options);
    let mut taken = search.refined(&Isometry3::identity());
    let is_within = |pose: &Isometry3<f64>, reach_mm: f64| search.apart_mm(pose, &Isometry3::identity()) <= reach_mm;
    let mut is_searched = false;
    if taken.share < SURE_SHARE {
        let found = locate(scans, nearest, options);
        if taken.share < options.min_inlier_share || taken.share < options.second_share * found.best.inlier_share {
            if found.refused.is_some() || found.best.inlier_share < MIN_SEARCHED_SHARE {
                let refused = found.refused.or(Some(NotLocated::NoPart));
                return PartPlace::Unknown(Location { refused, ..found });
            }
            let pose = *found.best.mesh_from_stated.isometry();
            (taken, is_searched) = (Scored { pose, share: found.best.inlier_share }, true);
        }
    }
    if !is_within(&taken.pose, STATED_REACH_MM)
        && let Some(pose) = turned_back(scans, &search, &taken.pose, STATED_TURN_REACH_MM)
    {
        taken = Scored { pose, share: search.share(&pose) };
    }
    is_searched |= !is_within(&taken.pose, STATED_TURN_REACH_MM);
    let is_stated = !is_searched && is_within(&taken.pose, STATED_REACH_MM);
    match turned(scans, &search, &taken, is_within(&taken.pose, STATED_TURN_REACH_MM)) {
        TurnVerdict::Kept if is_stated => PartPlace::AsStated,
        TurnVerdict::Kept => PartPlace::Elsewhere(taken.as_part(is_searched)),
        TurnVerdict::Better(other) if is_within(&other.pose, STATED_REACH_MM) => PartPlace::AsStated,
        TurnVerdict::Better(other) => PartPlace::Elsewhere(other.as_part(is_searched)),
        TurnVerdict::Open(other) => PartPlace::Unknown(Location {
            best: taken.as_part(is_searched),
            second: Some(other.as_part(is_searched)),
            is_symmetric: false,
            refused: Some(NotLocated::AmbiguousPose),
        }),
    }
}

/// A scan by itself, refined from a place of the part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RefinedAlone {
    /// Share of its points that then lies on the part.
    pub inlier_share: f64,
    /// Largest distance by which the refinement moved a corner of the part, mm.
    pub moved_mm: f64,
}

impl RefinedAlone {
    /// Returns true if it lies on the part there: where registration finds it by itself.
    #[must_use]
    pub fn is_sure(&self) -> bool {
        self.inlier_share >= SURE_SHARE && self.moved_mm <= STATED_REACH_MM
    }

    /// Returns true if it does not lie on the part there: registration would keep its pose, or would have to move it far.
    #[must_use]
    pub fn is_off(&self) -> bool {
        self.inlier_share < RegistrationOptions::default().min_inlier_share || self.moved_mm > STATED_TURN_REACH_MM
    }
}

/// Refines the pose of one scan by its own points, as far as a part is off that was put down without care. `start` takes the part's
/// coordinates by the stated pose to those of the mesh.
#[must_use]
pub fn refined_alone(scan: &ViewScan, nearest: &NearestFace<'_>, start: &Pose<Part, Part>) -> RefinedAlone {
    let options = LocateOptions::default();
    let search = Search::new(&[scan], nearest, &options);
    let refined = search.refined_from(start.isometry(), STATED_TURN_REACH_MM, STEPS);
    RefinedAlone { inlier_share: refined.share, moved_mm: search.apart_mm(&refined.pose, start.isometry()) }
}

/// A pose with the share of the points that it explains.
#[derive(Clone, Copy)]
pub(super) struct Scored {
    pub(super) pose: Isometry3<f64>,
    pub(super) share: f64,
}

impl Scored {
    fn as_part(self, is_searched: bool) -> PartPose {
        PartPose { mesh_from_stated: Pose::claim(self.pose), inlier_share: self.share, is_searched }
    }
}

/// Points of scans and the part that they are of. Points weigh as in the registration, by the surface around them: those on a bare wall
/// would turn a round part by the walls of a boss that is missing.
pub(super) struct Search<'a> {
    views: Vec<ViewPoints>,
    pub(super) nearest: &'a NearestFace<'a>,
    /// Box around the mesh.
    pub(super) around: Aabb,
    pub(super) options: &'a LocateOptions,
}

impl<'a> Search<'a> {
    pub(super) fn new<S: Borrow<ViewScan>>(scans: &[S], nearest: &'a NearestFace<'a>, options: &'a LocateOptions) -> Self {
        let of_view = (COMPARED_POINTS / scans.len().max(1)).max(50);
        let views = scans.iter().map(|scan| ViewPoints::with_elements(scan.borrow(), of_view)).collect();
        Self { views, nearest, around: nearest.mesh().aabb(), options }
    }

    /// Refines a pose with radii that shrink from a twelfth of the diameter to half of what counts as an inlier.
    pub(super) fn refined(&self, start: &Isometry3<f64>) -> Scored {
        self.refined_from(start, self.around.extent_mm().norm() / 12.0, STEPS)
    }

    /// Refines a pose in so many steps, with radii that shrink from this one.
    pub(super) fn refined_from(&self, start: &Isometry3<f64>, first_mm: f64, steps: i32) -> Scored {
        let mut state = State { part: *start, corrections: vec![Twist::zeros(); self.views.len()] };
        let (first, last) = (first_mm.max(self.options.inlier_mm), 0.5 * self.options.inlier_mm);
        for step in 0..steps {
            let radius_mm = first * (last / first).powf(f64::from(step) / f64::from(steps - 1));
            state.move_part(&self.views, self.nearest, radius_mm);
        }
        for _ in 0..3 {
            state.move_part(&self.views, self.nearest, self.options.inlier_mm);
        }
        Scored { pose: state.part, share: self.share(&state.part) }
    }

    fn share(&self, pose: &Isometry3<f64>) -> f64 {
        let matched = self
            .views
            .iter()
            .map(|view| match_view(view, &(pose * view.part_from_scanner), self.nearest, self.options.inlier_mm));
        let (pairs, points) = matched.fold((0, 0), |sum, view| (sum.0 + view.pairs.len(), sum.1 + view.points));
        pairs as f64 / points.max(1) as f64
    }

    /// Returns true if two poses move a corner of the part apart by more than a hundredth of its size, and 1 mm.
    pub(super) fn differ(&self, a: &Isometry3<f64>, b: &Isometry3<f64>) -> bool {
        self.apart_mm(a, b) > (0.01 * self.around.extent_mm().norm()).max(1.0)
    }

    /// Largest distance between the corners of the part at two poses, mm.
    pub(super) fn apart_mm(&self, a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
        let (low, high) = (self.around.min, self.around.max);
        let corner =
            |index: usize| Point3::from([0, 1, 2].map(|axis| if index >> axis & 1 == 1 { high[axis] } else { low[axis] }));
        // Corners of the mesh, taken back to where the scans say they are.
        let apart = |index: usize| (a.inverse() * corner(index) - b.inverse() * corner(index)).norm();
        (0..8).map(apart).fold(0.0, f64::max)
    }
}

/// Half and quarter turns about the axes through the middle of the part.
fn flips(around: &Aabb) -> Vec<Isometry3<f64>> {
    let centre = Translation3::from(around.centre().coords);
    let turn = |axis: usize, quarters: f64| {
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::ith(axis, quarters * std::f64::consts::FRAC_PI_2));
        centre * Isometry3::from_parts(Translation3::identity(), rotation) * centre.inverse()
    };
    (0..3).flat_map(|axis| [2.0, 1.0, -1.0].map(|quarters| turn(axis, quarters))).collect()
}

/// Poses by votes.
fn voted<S: Borrow<ViewScan>>(scans: &[S], mesh: &Mesh, around: &Aabb) -> Vec<Isometry3<f64>> {
    let size_mm = around.extent_mm().norm() / CELLS;
    let model = thinned(&samples(mesh, 20_000), size_mm);
    let of_view = MAX_POINTS / 2 / scans.len().max(1);
    let seen = scans.iter().flat_map(|scan| {
        let view = ViewPoints::of(scan.borrow(), of_view);
        let from = Point3::from(view.part_from_scanner.translation.vector);
        view.points_mm.into_iter().map(move |point| (view.part_from_scanner * point, from))
    });
    let scene = thinned(&oriented(&seen.collect::<Vec<_>>(), 0.6 * size_mm), size_mm);
    // Votes give the scene's pose of the model; what is sought is the way back.
    poses(&model, &scene, VOTED).iter().map(Isometry3::inverse).collect()
}

/// Points spread over the mesh by area, with the normals of their faces: the middle of equal shares of each face.
pub(super) fn samples(mesh: &Mesh, count: usize) -> Vec<Oriented> {
    let density = count as f64 / mesh.area_mm2().max(f64::MIN_POSITIVE);
    let mut samples = Vec::with_capacity(2 * count);
    let mut carried = 0.5;
    for face in 0..mesh.faces.len() {
        let ([a, b, c], scaled) = (mesh.corners(face), mesh.scaled_normal(face));
        carried += density * 0.5 * scaled.norm();
        let here = carried.floor();
        carried -= here;
        for index in 0..here as usize {
            // The R2 sequence over the triangle, as samples of surfaces are placed.
            let [s, t] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3]
                .map(|step: f64| (0.5 + step * (index as f64 + face as f64)).fract());
            let root = s.sqrt();
            let point = a.coords * (1.0 - root) + b.coords * (root * (1.0 - t)) + c.coords * (root * t);
            samples.push(Oriented { point_mm: Point3::from(point), normal: scaled.normalize() });
        }
    }
    samples
}
