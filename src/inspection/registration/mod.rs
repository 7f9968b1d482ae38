//! Finds where the captures really lie: one transform of the part for all of them, and of each a correction as far as its points say more
//! than its prior (maximum a posteriori), by points against planes of the nearest faces.
//!
//! Symbols: T_i = `part_from_scanner` as stated, Δ the part's transform, ξ_i the correction in the scanner's frame; registered is
//! Δ · T_i · exp(ξ_i). Residual of a point q with the nearest point h on a face of normal n: r = n·(q − h) (Y. Chen, G. Medioni,
//! "Object modelling by registration of multiple range images", Image and Vision Computing 10(3), 1992, section 3), weighted after
//! Tukey, w = (1 − (r/c)²)² within the radius c (P. W. Holland, R. E. Welsch, "Robust regression using iteratively reweighted
//! least-squares", Communications in Statistics A6, 1977). The prior is N(0, Σ_i) on ξ_i (right perturbation, as
//! [`crate::cell::calibration::se3`] has it).
//!
//! A point of an organised cloud weighs only where the surface around it looks as the face does, to within 45° (`matching.rs`): points
//! on a bare wall are nearest to the walls of a key that is missing, and would hold the part by them at every place.
//!
//! A part deviates from its mesh, and views that see the same place see the same deviation. The part's surface is cut into cells of
//! [`RegistrationOptions::correlation_mm`], each with an unknown deviation d ~ N(0, σ²), σ larger in cells that are far off
//! ([`own_deviation_sd_mm`]); the mean residual of view i in a cell is
//! aᵢ·(ξᵢ + Mᵢη) + d + noise, η the part's step and Mᵢ its adjoint in the view's frame. With each d eliminated, views that share
//! cells hold each other to their noise, and the mesh holds all of them to σ. Both deviations are estimated from the residuals, robustly.
//!
//! A wall that deviates as a whole, in views that nothing ties to those of the opposite wall, cannot be told from a view that is off: the
//! mesh pulls them onto itself. How far it did, and how far the poses are open without it, is told beside the covariances ([`OpenPoses`]):
//! with A the normal equations of cells that say nothing of the mesh, and the priors, they are A⁻¹ and steps −A⁻¹g. What all poses are off
//! alike, with the covariance Σ, averages out in no number of views: to A⁻¹ comes B Σ Bᵀ, B = A⁻¹ Λ (1 ⊗ I).
//!
//! The part's own place is told with the larger of two standard deviations: that of cells, and the one by which blocks of the surface, up to
//! 48, disagree about it. A part that is bent or too large deviates smoothly over many cells, which count as one there. The last radius
//! leaves its ends out, which pulls its place to one side: the step to the place by a radius of 1 mm is added.
//!
//! The result does not depend on the number of threads: sums run in the order of views, cells and points.
//! Cost: some 20 rounds of a nearest-face query a point, 50 000 points at most or 500 a view, and one dense factorisation of six rows a
//! view a round.

mod axes;
mod compared;
mod equations;
pub mod locate;
mod matching;
mod points;
mod ppf;
#[cfg(test)]
mod tests;
mod turns;

use std::borrow::Borrow;
use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Point3, Vector6};

use super::{OpenPoses, RegisteredView, ViewScan};
use crate::cell::calibration::chi_squared::quantile;
use crate::cell::calibration::se3::{Twist, adjoint, exp, log};
use crate::cell::closed_list;
use crate::geometry::{NearestFace, Part, Pose};
use equations::{Arrow, CellMean, Covariances, NormalEquations, Observations, add_gradient};
use locate::STATED_TURN_REACH_MM;
use matching::{CellSum, Matched, SurfaceCell, match_view};
use points::ViewPoints;
use turns::open_turns;

/// Freedoms of a rigid motion.
const FREEDOMS: usize = 6;
/// Probability with which a correction within its prior is taken for one beyond.
const OUT_OF_PRIOR: f64 = 1e-3;
/// Radii of correspondence while only the part is moved, mm.
const PART_RADII_MM: [f64; 12] = [5.0, 5.0, 3.5, 2.5, 1.8, 1.3, 0.9, 0.65, 0.45, 0.35, 0.25, 0.25];
/// Radii while part and views are moved together, mm.
const JOINT_RADII_MM: [f64; 8] = [2.0, 1.0, 0.5, 0.35, 0.25, 0.25, 0.25, 0.25];
/// Radius by which the place of the part is told once more, mm: what it is from other than the last one's place is open. Not from a source:
/// four times the last one, and less than clamps and plates lie off the part.
const WIDE_RADIUS_MM: f64 = 1.0;
/// Max views that are tied to each other; more are held to the mesh alone, and what it does not hold of them is as open as their priors.
const MAX_TIED_VIEWS: usize = 256;
/// Variance of a place that normal cells tell with the weights of Student's distribution, in that which they could tell.
const STUDENT_LOSS: f64 = 0.623 / (0.689 * 0.689);
/// Standard deviations of a pose that is not off, rad and mm: far below what points tell.
const FIXED_RAD: f64 = 1e-9;
const FIXED_MM: f64 = 1e-6;
/// Minimum noise of a point that is believed, mm: what single precision and facets leave over.
const MIN_NOISE_MM: f64 = 0.002;

closed_list! {
    /// Reason for which a view keeps the pose that it was taken at.
    pub enum KeptPose {
        /// Too few of its points lie on the part.
        FewPoints = "few_points",
        /// Too small a share of its points lies on the part.
        FewInliers = "few_inliers",
        /// The correction is beyond what its prior allows: a bumped part or robot, another view, a stale calibration.
        PoseOutOfPrior = "pose_out_of_prior",
    }
}

closed_list! {
    /// Reason for which the alignment of the part counts as not found.
    pub enum PartNotFound {
        /// Points lie on the part, but in no view enough of them to hold it in place; or no view has a point.
        FewPoints = "few_points",
        /// Too small a share of the points lies on the part: these scans do not fit it.
        FewInliers = "few_inliers",
    }
}

/// Reason for which an alignment with this share of all points on the part, and these reasons of its views to keep their poses, counts
/// as not found; `None` where it was found.
#[must_use]
pub fn why_not_found(inlier_share: f64, kept: impl IntoIterator<Item = Option<KeptPose>>) -> Option<PartNotFound> {
    if inlier_share < locate::MIN_PART_SHARE {
        // One view that fits by chance holds nothing, where most of the points lie elsewhere.
        return Some(PartNotFound::FewInliers);
    }
    let kept: Vec<Option<KeptPose>> = kept.into_iter().collect();
    if kept.iter().any(|kept| !matches!(kept, Some(KeptPose::FewPoints | KeptPose::FewInliers))) {
        None
    } else if kept.contains(&Some(KeptPose::FewPoints)) {
        Some(PartNotFound::FewPoints)
    } else {
        Some(PartNotFound::FewInliers)
    }
}

/// Share of the points on the part from which on a place that was searched for is taken though every view that agrees with it has a pose
/// beyond its prior. Our choice: an arm whose calibration is stale may see a clamp or two, and chance brought no more than 0.52 of the
/// points onto a part.
const MIN_OFF_PRIOR_SHARE: f64 = 0.75;

/// Reason for which an alignment from a place that was searched for counts as not found; `None` where it was found. The best of many
/// places has to hold more of the points than a stated one, and one view at least that agrees with it in full, or three quarters of the
/// points and one view at least that agrees but for its pose.
#[must_use]
pub fn why_searched_not_found(inlier_share: f64, kept: impl IntoIterator<Item = Option<KeptPose>>) -> Option<PartNotFound> {
    let kept: Vec<Option<KeptPose>> = kept.into_iter().collect();
    let is_agreed = kept.contains(&None) || inlier_share >= MIN_OFF_PRIOR_SHARE;
    let is_by_chance = inlier_share < locate::MIN_SEARCHED_SHARE || !is_agreed;
    why_not_found(inlier_share, kept).or(is_by_chance.then_some(PartNotFound::FewInliers))
}

/// Knobs of the registration.
#[derive(Clone, Debug, PartialEq)]
pub struct RegistrationOptions {
    /// Standard deviation of a pose's rotation about each axis where a view has no covariance of its own, degrees.
    pub prior_deg: f64,
    /// Standard deviation of its translation along each axis, mm.
    pub prior_mm: f64,
    /// Part of [`RegistrationOptions::prior_deg`] that each pose is off by itself, degrees: all of them are off alike by the rest.
    pub own_deg: f64,
    /// Part of [`RegistrationOptions::prior_mm`] likewise, mm.
    pub own_mm: f64,
    /// Max points of a view that are matched; the max of all views together is 50 000, or [`RegistrationOptions::min_points`] a view where
    /// that is more.
    pub points_of_view: usize,
    /// A view with fewer points on the part keeps its pose; of one that is thinned, those that are matched stand for all.
    pub min_points: usize,
    /// A view with a smaller share of its points within [`RegistrationOptions::inlier_mm`] keeps its pose.
    pub min_inlier_share: f64,
    /// Distance within which a point lies on the part, mm.
    pub inlier_mm: f64,
    /// Size of a cell of the surface that deviates as one, mm.
    pub correlation_mm: f64,
    /// True if the part may lie elsewhere than planned; else only the views are corrected.
    pub moves_part: bool,
    /// True if each view may be off by itself; else only the part is moved, as where all are images of one cloud.
    pub moves_views: bool,
    /// Pose that is taken first: the part's coordinates by the stated poses to those of the mesh, as [`locate::place`] finds it.
    pub start: Pose<Part, Part>,
    /// True if [`Self::start`] is the best of a search over all turns: it then has to explain more of the points.
    pub is_searched: bool,
    /// Points of further scans, which lie on the part nowhere and were left out. They count against a [`Self::start`] other than the stated
    /// place: it was found with the scans that fit it.
    pub stray_points: usize,
}

impl Default for RegistrationOptions {
    /// Priors of a calibrated arm, 0.05° and 0.2 mm, all of which may be off alike in every view; 500 points and 60 % of inliers as
    /// measured on views that slide.
    fn default() -> Self {
        Self {
            prior_deg: 0.05,
            prior_mm: 0.2,
            own_deg: 0.0,
            own_mm: 0.0,
            points_of_view: 3000,
            min_points: 500,
            min_inlier_share: 0.6,
            inlier_mm: 0.5,
            correlation_mm: 5.0,
            moves_part: true,
            moves_views: true,
            start: Pose::identity(),
            is_searched: false,
            stray_points: 0,
        }
    }
}

impl RegistrationOptions {
    /// Standard deviations of what all poses are off alike, scanner frame, rad and mm.
    #[must_use]
    pub fn shared_sd(&self) -> Twist {
        let rest = |prior: f64, own: f64| (prior.powi(2) - own.powi(2)).max(0.0).sqrt();
        let (turn, shift) = (rest(self.prior_deg, self.own_deg).to_radians(), rest(self.prior_mm, self.own_mm));
        Twist::new(turn, turn, turn, shift, shift, shift)
    }

    /// Share of all points that these are, of which so many are of the scans: strays count where the place is not the stated one.
    fn share_with_strays(&self, inlier_share: f64, points: usize) -> f64 {
        if self.stray_points == 0 || self.start == Pose::identity() {
            return inlier_share;
        }
        inlier_share * points as f64 / (points + self.stray_points) as f64
    }

    /// Max points that are matched of each of so many views.
    fn matched_of_view(&self, views: usize) -> usize {
        self.points_of_view.min((MAX_POINTS / views.max(1)).max(self.min_points)).max(FREEDOMS)
    }
}

/// Max points that are matched, of all views together, unless they are so many that each has few.
const MAX_POINTS: usize = 50_000;

/// Registration of one view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewRegistration {
    /// Number of its viewpoint.
    pub viewpoint: u32,
    /// Points that were matched.
    pub points: usize,
    /// Share of them that lies on the part.
    pub inlier_share: f64,
    /// Root mean square of the inliers' distances, mm.
    pub rms_mm: f64,
    /// Correction in the scanner's frame beyond the part's transform, as fitted: also where the pose was kept.
    pub correction: Twist,
    /// Squared length of the correction in standard deviations of the prior.
    pub chi_squared: f64,
    /// Reason for which the pose was kept, if it was.
    pub kept_pose: Option<KeptPose>,
}

/// Registered poses of the captures.
#[derive(Clone, Debug)]
pub struct ScanRegistration {
    /// Takes the part's coordinates by the stated poses to those of the mesh: Δ.
    pub mesh_from_stated: Pose<Part, Part>,
    /// Standard deviations of Δ, rad and mm, in the mesh's frame, with what deviations of the surface leave open of it. A freedom that no
    /// point fixes counts 5 mm; a turn about an axis of the part as far as no point tells it, up to 5 mm at the part's corners, with the
    /// shift of the part's middle.
    pub sd: Twist,
    /// Views, in the order in which they were given.
    pub views: Vec<RegisteredView>,
    /// Motions of these views, in the same order, that the mesh alone rules out.
    pub open: Arc<OpenPoses>,
    /// Findings on each, in the same order.
    pub found: Vec<ViewRegistration>,
    /// Standard deviation of an inlier's distance, robust, mm.
    pub noise_mm: f64,
    /// Share of all points that lies on the part, those of [`RegistrationOptions::stray_points`] among them where they count.
    pub inlier_share: f64,
    /// Covariance of Δ in the mesh's frame, with 5 mm for a freedom that no point fixes.
    pub part_covariance: Matrix6<f64>,
    /// True if the place of the part was searched for over all turns.
    pub is_searched: bool,
}

impl ScanRegistration {
    /// Reason for which the alignment counts as not found; `None` where it was found.
    #[must_use]
    pub fn not_found(&self) -> Option<PartNotFound> {
        if !self.found.is_empty() && !self.has_points() {
            return Some(PartNotFound::FewPoints);
        }
        let kept = self.found.iter().map(|view| view.kept_pose);
        if self.is_searched { why_searched_not_found(self.inlier_share, kept) } else { why_not_found(self.inlier_share, kept) }
    }

    /// Adds to the standard deviation the turns that points of the views that were placed do not tell.
    fn with_open_turns<S: Borrow<ViewScan>>(self, scans: &[S], nearest: &NearestFace<'_>) -> Self {
        let views = scans.iter().zip(&self.views).zip(&self.found).filter(|(_, found)| found.kept_pose.is_none());
        let (placed, poses): (Vec<&ViewScan>, Vec<Isometry3<f64>>) =
            views.map(|((scan, view), _)| (scan.borrow(), *view.part_from_scanner.isometry())).unzip();
        if placed.is_empty() {
            return self;
        }
        let open = open_turns(&placed, &poses, nearest, STATED_TURN_REACH_MM);
        Self { sd: self.sd.zip_map(&open, |sd, variance| sd.hypot(variance.sqrt())), ..self }
    }

    fn has_points(&self) -> bool {
        self.found.iter().any(|view| view.points > 0)
    }

    /// Returns true if the points lie on the part, be they too few to hold it in place: else nothing is learned from them.
    #[must_use]
    pub fn fits(&self) -> bool {
        self.has_points() && self.not_found() != Some(PartNotFound::FewInliers)
    }
}

/// Registers views against a mesh from their stated poses. `priors` has the covariance of each pose, from the calibration, or nothing
/// for the default.
#[must_use]
pub fn register<S: Borrow<ViewScan>>(
    scans: &[S],
    nearest: &NearestFace<'_>,
    priors: &[Option<Matrix6<f64>>],
    options: &RegistrationOptions,
) -> ScanRegistration {
    let of_view = options.matched_of_view(scans.len());
    let views: Vec<ViewPoints> = scans.iter().map(|scan| ViewPoints::with_elements(scan.borrow(), of_view)).collect();
    let priors: Vec<Matrix6<f64>> =
        (0..views.len()).map(|view| prior_weight(priors.get(view).copied().flatten(), options)).collect();
    let mut state = State { part: *options.start.isometry(), corrections: vec![Twist::zeros(); views.len()] };
    if options.moves_part {
        for radius_mm in PART_RADII_MM {
            state.move_part(&views, nearest, radius_mm);
        }
    }
    let mut usable = vec![true; views.len()];
    for radius_mm in JOINT_RADII_MM {
        let matched = state.matched(&views, nearest, radius_mm);
        usable = matched.iter().map(|view| view.kept_pose(options).is_none()).collect();
        if options.moves_views {
            state.move_all(&views, &matched, &Weighing { priors: &priors, usable: &usable, options });
        }
    }
    let found = state.finish(scans, &views, nearest, &Weighing { priors: &priors, usable: &usable, options });
    if options.moves_part { found.with_open_turns(scans, nearest) } else { found }
}

/// Inverse of a covariance; the default's where there is none, or none that can be inverted; that of a pose that is not off at all where
/// views are not moved.
fn prior_weight(covariance: Option<Matrix6<f64>>, options: &RegistrationOptions) -> Matrix6<f64> {
    if !options.moves_views {
        let (turn, shift) = (FIXED_RAD.powi(-2), FIXED_MM.powi(-2));
        return Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, shift, shift, shift));
    }
    let inverse = covariance.and_then(|covariance| covariance.cholesky()).map(|root| root.inverse());
    inverse.unwrap_or_else(|| {
        let (turn, shift) = (options.prior_deg.to_radians().powi(-2), options.prior_mm.powi(-2));
        Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, shift, shift, shift))
    })
}

/// Robust standard deviation of numbers about zero: 1.4826 times their median absolute value (F. R. Hampel, "The influence curve and
/// its role in robust estimation", J. Am. Stat. Assoc. 69, 1974, section 4); at least [`MIN_NOISE_MM`].
fn robust_sd_mm(mut distances_mm: Vec<f64>) -> f64 {
    if distances_mm.is_empty() {
        return MIN_NOISE_MM;
    }
    distances_mm.iter_mut().for_each(|distance| *distance = distance.abs());
    let middle = distances_mm.len() / 2;
    let (_, median, _) = distances_mm.select_nth_unstable_by(middle, f64::total_cmp);
    (1.4826 * *median).max(MIN_NOISE_MM)
}

/// Covariance of a part of which no point fixes a freedom: 5 mm for each, of a turn at half the part's diameter.
fn open_part(nearest: &NearestFace<'_>) -> Matrix6<f64> {
    let arm_mm = (0.5 * nearest.mesh().aabb().extent_mm().norm()).max(f64::MIN_POSITIVE);
    let (turn, shift) = ((STATED_TURN_REACH_MM / arm_mm).powi(2), STATED_TURN_REACH_MM.powi(2));
    Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, shift, shift, shift))
}

/// Sums of the views that see one cell, each with the index of its view.
type SeenCell = Vec<(usize, CellSum)>;

/// Cells that the views whose points say something see, with their places.
fn seen_places(matched: &[Matched], weighing: &Weighing<'_>) -> (Vec<SurfaceCell>, Vec<SeenCell>) {
    let mut seen: BTreeMap<(SurfaceCell, usize), SeenCell> = BTreeMap::new();
    for (view, pairs) in matched.iter().enumerate().filter(|(view, _)| weighing.usable[*view]) {
        // A cell of its own for each view where they are too many.
        let owner = if matched.len() > MAX_TIED_VIEWS { view } else { 0 };
        for (cell, sum) in pairs.cells(weighing.options.correlation_mm) {
            seen.entry((cell, owner)).or_default().push((view, sum));
        }
    }
    seen.into_iter().map(|((place, _), cell)| (place, cell)).unzip()
}

/// Cells that the views whose points say something see.
fn seen_cells(matched: &[Matched], weighing: &Weighing<'_>) -> Vec<SeenCell> {
    seen_places(matched, weighing).1
}

/// Means of the views in a cell.
fn means_of(cell: &SeenCell, point_weight: f64) -> Vec<CellMean> {
    let mean = |(view, sum): &(usize, CellSum)| CellMean {
        view: *view,
        row: sum.row / sum.weight,
        distance_mm: sum.distance_mm / sum.weight,
        weight: sum.weight * point_weight,
    };
    cell.iter().map(mean).collect()
}

/// Standard deviation by which cells deviate from the mesh, robust, mm.
fn deviation_sd_mm(cells: &[SeenCell]) -> f64 {
    robust_sd_mm(cells.iter().map(|cell| mean_of(cell).1).collect())
}

/// Standard deviation of cells by which covariances are told, mm: weighted after Student, normal cells tell a place with 0.623/0.689² of
/// the variance that they could, by (E ψ²)/(E ψ′)² with ψ(r) = 2r/(1 + r²) of their residuals (P. J. Huber, "Robust estimation of a location
/// parameter", Ann. Math. Stat. 35(1), 1964, section 4).
fn told_deviation_sd_mm(cells: &[SeenCell]) -> f64 {
    deviation_sd_mm(cells) * STUDENT_LOSS.sqrt()
}

/// Standard deviation by which one cell deviates from the mesh, mm, by what its views see of it: deviations are taken to have Student's
/// distribution of one degree of freedom, whose scale s is that of all cells. Of a cell with the mean m of total weight W, the variance
/// v = s² + 1/W counts as v/w, w = 2/(1 + m²/v), as one step of expectation and maximisation has it (K. L. Lange, R. J. A. Little,
/// J. M. G. Taylor, "Robust statistical modeling using the t distribution", J. Am. Stat. Assoc. 84, 1989, section 3). Few cells that are
/// off by many s would outvote the priors of the poses otherwise: a wall of 1 mm pulled a view by as much.
fn own_deviation_sd_mm(means: &[CellMean], deviation_sd_mm: f64) -> f64 {
    let weight: f64 = means.iter().map(|mean| mean.weight).sum();
    let mean_mm = means.iter().map(|mean| mean.weight * mean.distance_mm).sum::<f64>() / weight;
    let variance_mm2 = deviation_sd_mm.powi(2) + weight.recip();
    (0.5 * (variance_mm2 + mean_mm.powi(2)) - weight.recip()).max(FIXED_MM.powi(2)).sqrt()
}

/// Weight of all views in a cell, and their mean distance, mm.
fn mean_of(cell: &SeenCell) -> (f64, f64) {
    let weight: f64 = cell.iter().map(|(_, sum)| sum.weight).sum();
    (weight, cell.iter().map(|(_, sum)| sum.distance_mm).sum::<f64>() / weight)
}

/// Standard deviation of a point's distance about the mean of the views that share its cell, mm: the mean of n points of N parts from
/// the cell's by √(1/n − 1/N) of it.
fn point_sd_mm(cells: &[SeenCell]) -> f64 {
    let of_cell = |cell: &SeenCell| {
        let (all, mean_mm) = mean_of(cell);
        let own =
            move |(_, sum): &(usize, CellSum)| (sum.distance_mm / sum.weight - mean_mm) / (1.0 / sum.weight - 1.0 / all).sqrt();
        cell.iter().map(own).collect::<Vec<_>>()
    };
    robust_sd_mm(cells.iter().filter(|cell| cell.len() > 1).flat_map(of_cell).collect())
}

/// Gradients of the blocks of a part's surface: in each eighth of its box, parted at `centre_mm`, the cells that look to one side.
fn block_gradients(matched: &[Matched], centre_mm: &Point3<f64>, weighing: &Weighing<'_>) -> Vec<DVector<f64>> {
    let (places, cells) = seen_places(matched, weighing);
    let (deviation_sd_mm, point_weight) = (told_deviation_sd_mm(&cells), point_sd_mm(&cells).powi(-2));
    let mut blocks: BTreeMap<([bool; 3], u8), DVector<f64>> = BTreeMap::new();
    for ((place, side), cell) in places.iter().zip(&cells) {
        let middle_mm = place.map(|number| (number as f64 + 0.5) * weighing.options.correlation_mm);
        let eighth = [0, 1, 2].map(|axis| middle_mm[axis] > centre_mm[axis]);
        let gradient = blocks.entry((eighth, *side)).or_insert_with(|| DVector::zeros(FREEDOMS * matched.len()));
        add_gradient(gradient, &means_of(cell, point_weight), deviation_sd_mm);
    }
    blocks.into_values().collect()
}

/// Priors and options that observations are weighed with.
struct Weighing<'a> {
    /// Inverse covariances of the stated poses.
    priors: &'a [Matrix6<f64>],
    /// True for each view whose points say something.
    usable: &'a [bool],
    options: &'a RegistrationOptions,
}

/// Poses on the way.
struct State {
    part: Isometry3<f64>,
    corrections: Vec<Twist>,
}

impl State {
    fn pose(&self, views: &[ViewPoints], view: usize) -> Isometry3<f64> {
        self.part * views[view].part_from_scanner * exp(&self.corrections[view])
    }

    fn matched(&self, views: &[ViewPoints], nearest: &NearestFace<'_>, radius_mm: f64) -> Vec<Matched> {
        (0..views.len()).map(|view| match_view(&views[view], &self.pose(views, view), nearest, radius_mm)).collect()
    }

    /// One step of the part alone.
    fn move_part(&mut self, views: &[ViewPoints], nearest: &NearestFace<'_>, radius_mm: f64) {
        if let Some(step) = self.part_step(views, nearest, radius_mm, &|_| true) {
            self.part = exp(&step) * self.part;
        }
    }

    /// Step of the part alone to the place that the points of some views tell within a radius.
    fn part_step(
        &self,
        views: &[ViewPoints],
        nearest: &NearestFace<'_>,
        radius_mm: f64,
        counts: &dyn Fn(usize) -> bool,
    ) -> Option<Twist> {
        let matched = self.matched(views, nearest, radius_mm);
        let mut sum = NormalEquations::default();
        for (view, pairs) in matched.iter().enumerate().filter(|(view, _)| counts(*view)) {
            let own = NormalEquations::of(&pairs.pairs, radius_mm);
            sum.add(&own.seen_from(&adjoint(&self.pose(views, view).inverse())));
        }
        sum.step()
    }

    /// Squares of the step of the part to the place that its points tell within a wider radius than the last one.
    fn open_by_radius(&self, views: &[ViewPoints], nearest: &NearestFace<'_>, weighing: &Weighing<'_>) -> Vector6<f64> {
        if !weighing.options.moves_part {
            return Vector6::zeros();
        }
        let step = self.part_step(views, nearest, WIDE_RADIUS_MM, &|view| weighing.usable[view]);
        step.unwrap_or_else(Twist::zeros).map(|step| step * step)
    }

    /// One step of part and views.
    fn move_all(&mut self, views: &[ViewPoints], matched: &[Matched], weighing: &Weighing<'_>) {
        let arrow = self.arrow(views, matched, weighing);
        let Some(solved) = arrow.and_then(|arrow| arrow.solve(weighing.options.moves_part)) else { return };
        for (correction, step) in self.corrections.iter_mut().zip(&solved.steps) {
            // Both are small: log(exp(ξ)·exp(δ)) is their composition.
            *correction = log(&(exp(correction) * exp(step)));
        }
        self.part = exp(&solved.part_step) * self.part;
    }

    /// Arrow by which poses are found.
    fn arrow(&self, views: &[ViewPoints], matched: &[Matched], weighing: &Weighing<'_>) -> Option<Arrow> {
        let cells = seen_cells(matched, weighing);
        let deviation_sd_mm = deviation_sd_mm(&cells);
        self.arrow_of(views, &cells, &|means| own_deviation_sd_mm(means, deviation_sd_mm), weighing)
    }

    /// Arrow of cells that deviate by these standard deviations: at infinity they say nothing of the mesh.
    fn arrow_of(
        &self,
        views: &[ViewPoints],
        cells: &[SeenCell],
        deviation_sd_mm: &dyn Fn(&[CellMean]) -> f64,
        weighing: &Weighing<'_>,
    ) -> Option<Arrow> {
        let point_weight = point_sd_mm(cells).powi(-2);
        let mut observations = Observations::of(views.len());
        for cell in cells {
            let means = means_of(cell, point_weight);
            observations.add(&means, deviation_sd_mm(&means));
        }
        let from_part: Vec<Matrix6<f64>> = (0..views.len()).map(|view| adjoint(&self.pose(views, view).inverse())).collect();
        observations.with(weighing.priors, &self.corrections, &from_part)
    }

    /// Covariances at these poses.
    fn covariances(
        &self,
        (views, matched): (&[ViewPoints], &[Matched]),
        nearest: &NearestFace<'_>,
        weighing: &Weighing<'_>,
    ) -> Option<Covariances> {
        let cells = seen_cells(matched, weighing);
        let deviation_sd_mm = told_deviation_sd_mm(&cells);
        let arrow = self.arrow_of(views, &cells, &|_| deviation_sd_mm, weighing)?;
        let solved = arrow.solve(weighing.options.moves_part)?;
        Some(arrow.covariances(&solved, &block_gradients(matched, &nearest.mesh().aabb().centre(), weighing)))
    }

    /// Poses that priors and surface of several views leave open; `kept` has the covariances of those that were kept.
    fn open_poses(
        &self,
        (views, matched): (&[ViewPoints], &[Matched]),
        kept: &[Option<Matrix6<f64>>],
        part: Matrix6<f64>,
        weighing: &Weighing<'_>,
    ) -> OpenPoses {
        let size = FREEDOMS * views.len();
        let arrow = self.arrow_of(views, &seen_cells(matched, weighing), &|_| f64::INFINITY, weighing);
        let is_solved = arrow.is_some();
        let (mut covariance, mut pulled) =
            arrow.map_or_else(|| (DMatrix::zeros(size, size), DVector::zeros(size)), |arrow| arrow.of_views());
        let mut priors = DMatrix::zeros(size, FREEDOMS);
        for (view, prior) in weighing.priors.iter().enumerate() {
            priors.fixed_view_mut::<FREEDOMS, FREEDOMS>(FREEDOMS * view, 0).copy_from(prior);
        }
        let mut alike = &covariance * priors;
        for (view, kept) in kept.iter().enumerate() {
            let kept = kept.or_else(|| if is_solved { None } else { weighing.priors[view].try_inverse() });
            // A pose that was kept was not pulled, and its own covariance is all that is known of it.
            let (Some(own), at) = (kept, FREEDOMS * view) else { continue };
            covariance.rows_mut(at, FREEDOMS).fill(0.0);
            covariance.columns_mut(at, FREEDOMS).fill(0.0);
            covariance.fixed_view_mut::<FREEDOMS, FREEDOMS>(at, at).copy_from(&own);
            alike.fixed_view_mut::<FREEDOMS, FREEDOMS>(at, 0).copy_from(&Matrix6::identity());
            pulled.fixed_rows_mut::<FREEDOMS>(at).fill(0.0);
        }
        if weighing.options.moves_views {
            let alike = alike * Matrix6::from_diagonal(&weighing.options.shared_sd());
            covariance += &alike * alike.transpose();
        }
        OpenPoses { covariance, pulled, part }
    }

    fn finish<S: Borrow<ViewScan>>(
        self,
        scans: &[S],
        views: &[ViewPoints],
        nearest: &NearestFace<'_>,
        weighing: &Weighing<'_>,
    ) -> ScanRegistration {
        let (options, priors) = (weighing.options, weighing.priors);
        let last_mm = JOINT_RADII_MM[JOINT_RADII_MM.len() - 1];
        let last = self.matched(views, nearest, last_mm);
        let noise_mm = robust_sd_mm(last.iter().flat_map(|view| &view.pairs).map(|pair| pair.distance_mm).collect());
        let covariances = self.covariances((views, &last), nearest, weighing);
        let limit = quantile(OUT_OF_PRIOR, FREEDOMS);
        let judged = self.matched(views, nearest, options.inlier_mm);
        let mut registered = Vec::with_capacity(scans.len());
        let mut found = Vec::with_capacity(scans.len());
        let mut kept = Vec::with_capacity(scans.len());
        for (view, scan) in scans.iter().map(Borrow::borrow).enumerate() {
            let correction = self.corrections[view];
            let chi_squared = (correction.transpose() * priors[view] * correction)[0];
            let beyond = (chi_squared > limit).then_some(KeptPose::PoseOutOfPrior);
            let kept_pose = judged[view].kept_pose(options).or(beyond);
            let pose = if kept_pose.is_some() { self.part * views[view].part_from_scanner } else { self.pose(views, view) };
            let prior = priors[view].try_inverse().unwrap_or_else(Matrix6::identity);
            let covariance = match kept_pose {
                // The stated pose stays, and is shown to be off by as much.
                Some(KeptPose::PoseOutOfPrior) => prior + correction * correction.transpose(),
                Some(_) => prior,
                None => covariances.as_ref().map_or(prior, |found| found.views[view]),
            };
            kept.push(kept_pose.map(|_| covariance));
            registered.push(RegisteredView {
                viewpoint: scan.viewpoint,
                part_from_scanner: Pose::claim(pose),
                covariance,
                is_in_prior: beyond.is_none(),
            });
            let (inlier_share, rms_mm) = (judged[view].inlier_share(), judged[view].rms_mm());
            let (viewpoint, points) = (scan.viewpoint, judged[view].points);
            found.push(ViewRegistration { viewpoint, points, inlier_share, rms_mm, correction, chi_squared, kept_pose });
        }
        let all: usize = judged.iter().map(|view| view.points).sum();
        let inliers: usize = judged.iter().map(|view| view.pairs.len()).sum();
        let there: usize = views.iter().map(|view| view.there).sum();
        // Where no observation holds the part, nothing is known of its place.
        let open_part = open_part(nearest);
        let unknown = || if options.moves_part { open_part } else { Matrix6::zeros() };
        let [part_covariance, part_stated, by_blocks] = covariances.map_or_else(
            || [Matrix6::zeros(), unknown(), Matrix6::zeros()],
            |found| [found.part, found.part_stated, found.part_by_blocks],
        );
        // Blocks and steps that hardly hold a freedom say no more of it than that it is open.
        let [by_blocks, by_radius] = [by_blocks.diagonal(), self.open_by_radius(views, nearest, weighing)]
            .map(|variance| variance.inf(&open_part.diagonal()));
        let open = Arc::new(self.open_poses((views, &last), &kept, part_covariance, weighing));
        ScanRegistration {
            mesh_from_stated: Pose::claim(self.part),
            sd: (part_stated.diagonal().sup(&by_blocks) + by_radius).map(|variance| variance.max(0.0).sqrt()),
            views: registered,
            open,
            found,
            noise_mm,
            inlier_share: options.share_with_strays(inliers as f64 / all.max(1) as f64, there),
            part_covariance: part_stated,
            is_searched: options.is_searched,
        }
    }
}
