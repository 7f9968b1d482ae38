//! The views that are tried for a spot: candidates rolled, tilted and moved along their axes, and views from where the
//! spot is open. Frames: poses are `part_from_scanner`. A tilted view looks at the spot's centre from as far as the
//! candidate that it is made from; one for another setup from best focus.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};

use super::spot_samples::FirstFailures;
use crate::cell::Scanner;
use crate::geometry::{Part, Pose, ScannerFrame};
use crate::planning::ids::CandidateIndex;

/// Rolls about the axis: every 30°.
const ROLLS: u32 = 12;
/// Rolls of a view that has no roll of its own: a half turn only exchanges the cameras.
const OPENING_ROLLS: u32 = 6;
/// Tilts of a candidate, degrees.
const TILTS_DEG: [f64; 5] = [10.0, 20.0, 30.0, 45.0, 60.0];
/// Sides to which it is tilted.
const TILT_SIDES: u32 = 6;
/// Candidates that are tilted.
const TILTED: usize = 4;
/// Distances, as shares of the way from nearest to farthest, off both ends.
const DEPTH_SHARES: [f64; 6] = [0.5, 0.05, 0.95, 0.25, 0.75, 0.85];
/// Directions of the whole sphere that are tried for another setup.
const SETUP_DIRECTIONS: usize = 150;

/// A view to try.
#[derive(Clone)]
pub(super) struct Proposal {
    pub(super) pose: Pose<Part, ScannerFrame>,
    /// Candidate that it is made from.
    pub(super) candidate: CandidateIndex,
    pub(super) roll_rad: f64,
    pub(super) tilt_rad: f64,
}

/// A proposal, and how far it gets.
pub(super) struct Tried {
    pub(super) proposal: Proposal,
    pub(super) progress: FirstFailures,
}

/// Makes proposals for one spot.
pub(super) struct ProposalSource<'a> {
    pub(super) scanner: &'a Scanner,
    /// Pose of each candidate.
    pub(super) poses: &'a [Pose<Part, ScannerFrame>],
    /// Candidates to start from, best first.
    pub(super) bases: &'a [CandidateIndex],
    /// Centre of the spot.
    pub(super) centre_mm: Point3<f64>,
}

impl ProposalSource<'_> {
    fn pose(&self, candidate: CandidateIndex) -> &Pose<Part, ScannerFrame> {
        &self.poses[candidate.index()]
    }

    pub(super) fn as_is(&self, candidate: CandidateIndex) -> Proposal {
        Proposal { pose: *self.pose(candidate), candidate, roll_rad: 0.0, tilt_rad: 0.0 }
    }

    pub(super) fn rolls(&self) -> Vec<Proposal> {
        // The right angle first: most different from what was tried, so it wins ties.
        let steps = [3, 9, 6].into_iter().chain((1..ROLLS).filter(|step| step % 3 != 0));
        steps
            .flat_map(|step| {
                let roll_rad = TAU * f64::from(step) / f64::from(ROLLS);
                self.bases.iter().map(move |base| rolled(self.as_is(*base), roll_rad))
            })
            .collect()
    }

    /// Small tilts first.
    pub(super) fn tilts(&self, openings: &[Unit<Vector3<f64>>]) -> Vec<Proposal> {
        let swings = TILTS_DEG
            .iter()
            .flat_map(|tilt_deg| self.bases.iter().take(TILTED).flat_map(move |base| self.swings(*base, tilt_deg.to_radians())));
        let pans = self.bases.iter().map(|base| {
            let towards = self.pose(*base).origin_mm() - self.centre_mm;
            self.aimed(*base, towards, towards.norm())
        });
        let openings = openings.iter().flat_map(|towards| {
            let nearest = self.nearest(towards);
            Self::every_roll(self.aimed(nearest, towards.into_inner(), self.depth_mm(self.pose(nearest))))
        });
        pans.chain(swings).chain(openings).collect()
    }

    fn swings(&self, base: CandidateIndex, tilt_rad: f64) -> impl Iterator<Item = Proposal> {
        let back = -self.pose(base).direction(&Vector3::z());
        (0..TILT_SIDES).map(move |side| {
            let angle = TAU * f64::from(side) / f64::from(TILT_SIDES);
            let across = self.pose(base).direction(&Vector3::new(angle.cos(), angle.sin(), 0.0));
            self.aimed(base, back * tilt_rad.cos() + across * tilt_rad.sin(), self.depth_mm(self.pose(base)))
        })
    }

    /// Looks at the spot's centre from the direction `towards`, turned the least from the candidate.
    fn aimed(&self, candidate: CandidateIndex, towards: Vector3<f64>, distance_mm: f64) -> Proposal {
        let base = self.pose(candidate);
        let (from, axis) = (base.direction(&Vector3::z()), -towards.normalize());
        // Straight back there is no least turn: a half turn about the baseline.
        let turn = UnitQuaternion::rotation_between(&from, &axis)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Unit::new_normalize(base.direction(&Vector3::x())), PI));
        let origin = self.centre_mm.coords - axis * distance_mm;
        let pose = Pose::from_parts(origin, turn * base.isometry().rotation);
        Proposal { pose, candidate, roll_rad: 0.0, tilt_rad: from.angle(&axis) }
    }

    fn every_roll(straight: Proposal) -> impl Iterator<Item = Proposal> {
        (0..OPENING_ROLLS).map(move |step| rolled(straight.clone(), PI * f64::from(step) / f64::from(OPENING_ROLLS)))
    }

    /// The candidate whose axis is closest to looking back along `towards`, the lowest of equals.
    fn nearest(&self, towards: &Unit<Vector3<f64>>) -> CandidateIndex {
        let cos = |candidate: CandidateIndex| -self.pose(candidate).direction(&Vector3::z()).dot(towards);
        let others = CandidateIndex::first(self.poses.len()).skip(1);
        others.fold(CandidateIndex(0), |best, candidate| if cos(candidate) > cos(best) { candidate } else { best })
    }

    /// Candidates, and the proposals that got furthest, at other distances.
    pub(super) fn standoffs(&self, tried: &[Tried]) -> Vec<Proposal> {
        let mut furthest: Vec<&Tried> = tried.iter().collect();
        furthest.sort_by_key(|tried| std::cmp::Reverse(tried.progress.sum()));
        let sources: Vec<Proposal> = self
            .bases
            .iter()
            .map(|base| self.as_is(*base))
            .chain(furthest.iter().take(self.bases.len()).map(|tried| tried.proposal.clone()))
            .collect();
        let [near_mm, far_mm] = self.scanner.working_depth_mm();
        let depths_mm = DEPTH_SHARES.map(|share| near_mm + share * (far_mm - near_mm));
        depths_mm.iter().flat_map(|depth_mm| sources.iter().map(move |source| self.at_depth(source, *depth_mm))).collect()
    }

    fn at_depth(&self, source: &Proposal, depth_mm: f64) -> Proposal {
        let back_mm = depth_mm - self.depth_mm(&source.pose);
        let pose = source.pose * Pose::from_parts(Vector3::new(0.0, 0.0, -back_mm), UnitQuaternion::identity());
        Proposal { pose, ..source.clone() }
    }

    /// Depth of the spot's centre from a view.
    pub(super) fn depth_mm(&self, pose: &Pose<Part, ScannerFrame>) -> f64 {
        (self.centre_mm - pose.origin_mm()).dot(&pose.direction(&Vector3::z()))
    }

    /// Proposes views from where the part alone leaves the spot open, the widest opening first; then from all around, baseline
    /// both ways.
    pub(super) fn setups(&self, openings: &[Unit<Vector3<f64>>]) -> Vec<Proposal> {
        let straight =
            |towards: &Unit<Vector3<f64>>| self.aimed(self.nearest(towards), towards.into_inner(), self.scanner.best_mm);
        let around = directions(SETUP_DIRECTIONS).flat_map(|towards| {
            let level = straight(&towards);
            [level.clone(), rolled(level, FRAC_PI_2)]
        });
        openings.iter().flat_map(|towards| Self::every_roll(straight(towards))).chain(around).collect()
    }
}

fn rolled(proposal: Proposal, roll_rad: f64) -> Proposal {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll_rad);
    let pose = proposal.pose * Pose::from_parts(Vector3::zeros(), turn);
    Proposal { pose, roll_rad: proposal.roll_rad + roll_rad, ..proposal }
}

/// `count` even directions: the Fibonacci lattice (González 2010, *Measurement of areas on a sphere using Fibonacci and
/// latitude–longitude lattices*).
pub(super) fn directions(count: usize) -> impl Iterator<Item = Unit<Vector3<f64>>> {
    let golden_rad = PI * (3.0 - 5.0_f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / count as f64;
        let (radius, angle) = ((1.0 - z * z).sqrt(), golden_rad * i as f64);
        Unit::new_unchecked(Vector3::new(radius * angle.cos(), radius * angle.sin(), z))
    })
}
