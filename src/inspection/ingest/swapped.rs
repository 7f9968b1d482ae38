//! Scans that were filed under the number of another view, and copies of one scan under two numbers.
//!
//! A cloud in the scanner's frame says by its shape which view it is of: at the pose of its own view it lies on the part after a
//! small correction, at that of another one only where the part looks the same from there. A cloud in a frame of the part lies on
//! it under every number, and is not doubted.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use rayon::prelude::*;

use super::{IngestWorld, MIN_SHARE, PlannedCapture, ScanFrame, TakenScan, frames};
use crate::geometry::cloud_io::StoredCloud;
use crate::geometry::{Part, Pose};
use crate::inspection::registration::locate::{RefinedAlone, refined_alone};
use crate::planning::context::{Cancelled, Context};

/// Points below which a cloud tells nothing of its view.
const MIN_POINTS: usize = 100;
/// Points of a cloud that enter its fingerprint.
const PRINTED_POINTS: usize = 100_000;

/// Frames in which the points lie on the part whatever view they are said to be of.
pub(super) const FRAMES_OF_PART: [ScanFrame; 4] = [ScanFrame::Base, ScanFrame::Table, ScanFrame::Plate, ScanFrame::Part];

/// Fingerprint of the points of a cloud; none of a few points. Noise makes those of two captures differ.
pub(super) fn fingerprint(cloud: &StoredCloud) -> Option<u64> {
    let there = || cloud.points.iter().filter(|point| !point[0].is_nan());
    let count = there().count();
    let mut hasher = DefaultHasher::new();
    count.hash(&mut hasher);
    for point in there().step_by(count.div_ceil(PRINTED_POINTS).max(1)) {
        point.map(f32::to_bits).hash(&mut hasher);
    }
    (count >= MIN_POINTS).then(|| hasher.finish())
}

/// Fit of a scan in the scanner's frame to its own view, by itself; none where the scan does not tell its view so.
pub(super) fn alone(taken: &TakenScan, mesh_from_stated: &Pose<Part, Part>, world: &IngestWorld<'_>) -> Option<RefinedAlone> {
    let tells = !taken.is_approximate && !FRAMES_OF_PART.contains(&taken.frame);
    let is_enough = || taken.scan.scanner_cloud.finite().count() >= MIN_POINTS;
    (tells && is_enough()).then(|| refined_alone(&taken.scan, world.nearest, mesh_from_stated))
}

/// The other view at whose pose a scan in the scanner's frame lies on the part.
pub(super) fn other_view(
    taken: &TakenScan,
    mesh_from_stated: &Pose<Part, Part>,
    world: &IngestWorld<'_>,
    ctx: &Context<'_>,
) -> Result<Option<u32>, Cancelled> {
    let scan = &taken.scan;
    let fit = |other: &PlannedCapture| {
        let mesh_from_scanner = *mesh_from_stated * other.part_from_scanner;
        if frames::share_on_part(&scan.scanner_cloud, &mesh_from_scanner, world) < MIN_SHARE {
            return None;
        }
        let found = refined_alone(scan, world.nearest, &(mesh_from_scanner * scan.part_from_scanner.inverse()));
        found.is_sure().then_some((found.inlier_share, other.viewpoint))
    };
    let others: Vec<&PlannedCapture> = world.captures.iter().filter(|other| other.viewpoint != scan.viewpoint).collect();
    let found = others.par_iter().map(|other| {
        ctx.check()?;
        Ok(fit(other))
    });
    let found: Vec<Option<(f64, u32)>> = found.collect::<Result<_, Cancelled>>()?;
    Ok(best(found.into_iter().flatten()))
}

/// The view of the largest share; of equal ones the first.
fn best(found: impl Iterator<Item = (f64, u32)>) -> Option<u32> {
    let better = |best: Option<(f64, u32)>, next: (f64, u32)| best.filter(|best| best.0 >= next.0).or(Some(next));
    found.fold(None, better).map(|(_, viewpoint)| viewpoint)
}
