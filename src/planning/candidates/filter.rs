//! Rejection of viewpoints that no cell could use, and of duplicates. Visibility plays no part here, nor do bodies: what the
//! scanner's body meets on the plate is for the planning scene to find, before stations are sought.

use std::collections::HashSet;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::aim::Placed;
use super::{Candidate, CandidateSet, Rejection, Scope};
use crate::geometry::{Aabb, Part, Pose, RayScene, ScannerFrame, Table};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::{CandidateId, SetupIndex};
use crate::planning::params::{CandidateParams, Hemisphere};

/// Numbers the poses in their order and drops those that cannot be used.
pub(super) fn judge(
    scope: &Scope<'_>,
    params: &CandidateParams,
    placed: Vec<Placed>,
    ctx: &Context<'_>,
) -> Result<CandidateSet, Cancelled> {
    let above_only = params.hemisphere == Some(Hemisphere::AboveTable);
    let part_from_table = scope.table_from_part.inverse();
    let aabb = scope.part.aabb();
    let in_box = placed.iter().any(|(table_from_scanner, _)| aabb.holds(&(part_from_table * *table_from_scanner).origin_mm()));
    let scene = in_box.then(|| RayScene::interruptible([scope.part], || ctx.check())).transpose()?;
    let filter = Filter { scope, above_only, min_elevation_deg: params.min_elevation_deg, aabb, scene };
    let judged: Vec<_> = placed
        .into_par_iter()
        .enumerate()
        .map(|(number, (table_from_scanner, label))| {
            ctx.check()?;
            let part_from_scanner = part_from_table * table_from_scanner;
            let candidate = Candidate {
                id: CandidateId::at(number),
                part_from_scanner,
                label,
                setup: SetupIndex(0),
                is_given: false,
                slid_from: None,
            };
            Ok((filter.unusable(&candidate, &table_from_scanner), candidate))
        })
        .collect::<Result<_, Cancelled>>()?;
    let mut generated = CandidateSet { generated: judged.len(), ..CandidateSet::default() };
    let mut seen = HashSet::new();
    for (reason, candidate) in judged {
        let twice = || (!seen.insert(key(&candidate.part_from_scanner))).then_some(Rejection::Duplicate);
        match reason.or_else(twice) {
            Some(reason) => generated.rejected.push((candidate, reason)),
            None => generated.remaining.push(candidate),
        }
    }
    Ok(generated)
}

/// Poses with one key differ by less than 10⁻⁶ mm and 10⁻⁸ of a direction: no figure shows it. Of equal poses a few may
/// have different keys, where rounding falls on either side.
fn key(pose: &Pose<Part, ScannerFrame>) -> [i64; 9] {
    let origin = pose.origin_mm().coords.map(|mm| (mm * 1e6).round() as i64);
    let [x, z] = [Vector3::x(), Vector3::z()].map(|axis| pose.direction(&axis).map(|part| (part * 1e8).round() as i64));
    [origin.x, origin.y, origin.z, x.x, x.y, x.z, z.x, z.y, z.z]
}

/// Returns true if a viewpoint, table frame, stands above the plate's plane at this elevation or more, seen from the plate's
/// centre.
pub(in crate::planning) fn stands_above(viewpoint_mm: &Point3<f64>, min_elevation_deg: f64) -> bool {
    let min_slope = min_elevation_deg.to_radians().tan();
    viewpoint_mm.z > 0.0 && viewpoint_mm.z >= min_slope * viewpoint_mm.xy().coords.norm()
}

/// Inputs of the checks of every candidate.
struct Filter<'a> {
    scope: &'a Scope<'a>,
    above_only: bool,
    min_elevation_deg: f64,
    aabb: Aabb,
    /// The part alone, if a viewpoint lies in its box: rare for parts smaller than the stand-off.
    scene: Option<RayScene>,
}

impl Filter<'_> {
    fn unusable(&self, candidate: &Candidate, table_from_scanner: &Pose<Table, ScannerFrame>) -> Option<Rejection> {
        let optical_centres = self.scope.scanner.devices.iter().map(|device| device.scanner_from_device.origin_mm());
        let below = |centre: Point3<f64>| table_from_scanner.point(&centre).z <= 0.0;
        if self.above_only && optical_centres.chain([Point3::origin()]).any(below) {
            return Some(Rejection::BelowTable);
        }
        if self.above_only && !stands_above(&table_from_scanner.origin_mm(), self.min_elevation_deg) {
            return Some(Rejection::LowElevation);
        }
        let viewpoint = candidate.part_from_scanner.origin_mm();
        let encloses = |scene: &RayScene| self.aabb.holds(&viewpoint) && scene.encloses(&viewpoint);
        self.scene.as_ref().is_some_and(encloses).then_some(Rejection::InsidePart)
    }
}
