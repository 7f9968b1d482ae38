//! The cause of each lost sample.

use nalgebra::{Point3, Vector3};

use super::cut::FileBounds;
use super::evidence::Zone;
use super::foreign::InFront;
use super::scattered::is_scattered;
use super::shown::ShownSurface;
use super::steps::near_steps;
use super::{LossCause, Losses};
use crate::geometry::{NearestFace, parallel};
use crate::inspection::coverage::{
    ComparedViews, Footprint, IdentifiedLimits, MeasuredCoverage, ModelPoint, NominalModel, Return, Returns, ViewLookup,
};
use crate::inspection::ingest::{CleanOptions, Removed, THINNED_CELL_MM};
use crate::inspection::mirror::Reflection;
use crate::planning::ConcaveZone;
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::visibility::{Optics, Row, SampleSet};

/// Samples that a thread looks into at a time.
const BLOCK: usize = 512;
/// Width of the fall of the rate of return before a limit of incidence, at which three of four points return, degrees: what is lost
/// there is named after the limit where nothing else explains it. The width is our choice.
const FALL_DEG: f64 = 4.0;
/// Pairs of a scan by which the evidence of a weakness is judged.
const EVIDENCE_PAIRS: usize = 2000;
/// Cells by which the points of neighbouring cells may be apart in a cloud that was put into cells, and in one that has the camera's grid.
const PROJECTED_APART: f64 = 2.0;
const ORGANISED_APART: f64 = 1.0;
/// Size of such a cell from which on a few that hang together may be a feature of the part: 20 of them cover 20 mm².
const COARSE_CELL_MM: f64 = THINNED_CELL_MM;

/// Light that a sample returns to the cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Light {
    /// Too little.
    Dark,
    /// Enough.
    Fair,
    /// Too much.
    Saturated,
}

/// Plan, scans, measured coverage, and what is known of the scanner.
#[derive(Clone, Copy)]
pub struct LossInput<'a> {
    /// Plan and scans.
    pub compared: &'a ComparedViews<'a>,
    /// Measured coverage of the scans.
    pub coverage: &'a MeasuredCoverage,
    /// Facts of the planned pairs.
    pub returns: &'a Returns,
    /// The model as planned.
    pub model: &'a NominalModel<'a>,
    /// Nearest faces of the part.
    pub nearest: &'a NearestFace<'a>,
    /// Samples that each scan would measure from its registered pose, by the definition of the plan
    /// ([`crate::planning::certificate::recheck::recheck`]), in the order of the scans.
    pub registered_rows: &'a [Row],
    /// Limits that were identified.
    pub limits: &'a IdentifiedLimits,
    /// Light at a sample in a scan, by the scan's place; `None` where nothing is known of it.
    pub light: Option<&'a (dyn Fn(usize, SampleId) -> Light + Sync)>,
    /// Level of brightness of the scans, where it is known.
    pub level: Option<u8>,
    /// Points that were taken out as each scan was cleaned, in the order of the scans; none of a scan that is not there.
    pub removed: &'a [&'a Removed],
}

/// Puts every planned sample that is not measured down to a cause.
///
/// # Errors
/// [`Cancelled`].
pub fn attribute(input: &LossInput<'_>, ctx: &Context<'_>) -> Result<Losses, Cancelled> {
    let lost = input.coverage.lost();
    let mut causes: Vec<Option<ScanCause>> = vec![None; input.compared.surface.sample_mm.len()];
    let scanned = |viewpoint: u32| input.compared.scanned.iter().any(|view| view.scan.viewpoint == viewpoint);
    for view in input.compared.planned.iter().filter(|view| !scanned(view.viewpoint)) {
        for sample in view.row.samples().filter(|sample| lost.holds(*sample)) {
            causes[sample.index()] = Some(ScanCause { cause: LossCause::ViewMissing, is_expected: true });
        }
    }
    let optics = Optics::new(input.compared.scanner, input.compared.params, &input.compared.surface.requirements);
    let realism = &input.compared.params.realism;
    let corner = ConcaveZone::new(input.model.mesh(), realism.concave_dihedral_deg.to_radians(), realism.concave_zone_mm, ctx)?;
    let scans: Vec<ScanLosses<'_>> = parallel::try_map_range(input.compared.scanned.len(), |place| {
        ctx.check()?;
        Ok::<_, Cancelled>(ScanLosses::new(input, &optics, &corner, place, ctx))
    })?;
    let evidence = Evidence::of(&scans, ctx)?;
    for scan in &scans {
        for (sample, found) in scan.causes(&lost, &evidence, ctx)? {
            let furthest = &mut causes[sample.index()];
            *furthest = Some(furthest.map_or(found, |other| if found.rank() > other.rank() { found } else { other }));
        }
    }
    let of_samples =
        lost.iter().map(|sample| (sample, causes[sample.index()].map_or(LossCause::Unexplained, |found| found.cause)));
    Ok(Losses::of(input.model.mesh(), input.compared, of_samples.collect(), input.level))
}

/// Cause in one scan.
#[derive(Clone, Copy)]
struct ScanCause {
    cause: LossCause,
    is_expected: bool,
}

impl ScanCause {
    /// Progress of the scan: the place of its cause in the list. A scan of which no ray meets the sample's surface could not
    /// measure it from where it was taken. Equal ones are told apart by the cause, so that the order of the scans does not count.
    fn rank(self) -> [usize; 2] {
        let is_between_rays = self.cause == LossCause::Sparse && !self.is_expected;
        let place = if is_between_rays { LossCause::Pose as usize } else { self.cause as usize };
        [place, self.cause as usize]
    }
}

/// Zones in which the scans lack points.
struct Evidence {
    edges: Zone,
    corners: Zone,
}

impl Evidence {
    fn of(scans: &[ScanLosses<'_>], ctx: &Context<'_>) -> Result<Self, Cancelled> {
        let mut evidence = Self { edges: Zone::default(), corners: Zone::default() };
        for scan in scans.iter().filter(|scan| !scan.is_scattered) {
            ctx.check()?;
            // What is lost beyond the limits, or for the light, is no evidence of anything else.
            let is_fair =
                |pair: &Return| pair.is_expected && !scan.is_beyond_limits(pair, None) && scan.light_cause(pair.sample).is_none();
            let fair = scan.pairs.iter().filter(|(pair, _)| is_fair(pair));
            let fair: Vec<&Return> = fair.map(|(pair, _)| pair).collect();
            let some: Vec<&Return> = fair.iter().step_by(fair.len().div_ceil(EVIDENCE_PAIRS).max(1)).copied().collect();
            let points: Vec<_> = some.iter().map(|pair| scan.sample(pair.sample)).collect();
            for ((pair, point), is_near) in some.iter().zip(&points).zip(scan.near_steps(&points, ctx)) {
                let in_corner = scan.corner.holds(&point.0, &point.1);
                if !in_corner && !scan.is_wide {
                    evidence.edges.count(is_near, pair.is_returned);
                }
                if !is_near {
                    evidence.corners.count(in_corner, pair.is_returned);
                }
            }
        }
        Ok(evidence)
    }
}

/// One scan, ready for its lost samples.
struct ScanLosses<'a> {
    input: &'a LossInput<'a>,
    place: usize,
    lookup: ViewLookup<'a>,
    reflection: Reflection,
    in_front: InFront,
    bounds: FileBounds,
    /// True if empty cells lie between its points everywhere.
    is_scattered: bool,
    /// True if its points were put into cells wider than the zone beside a step in which scanners may lack points: what a cell there
    /// holds tells of the cell.
    is_wide: bool,
    corner: &'a ConcaveZone,
    /// Planned pairs, with the place of the sample's image in cells.
    pairs: Vec<(Return, [f64; 2])>,
}

/// A lost sample in one scan, with what is known of it.
struct LostPair {
    pair: Return,
    place: [f64; 2],
    point: (Point3<f64>, Vector3<f64>),
    model: Option<ModelPoint>,
    is_near_step: bool,
}

impl<'a> ScanLosses<'a> {
    fn new(input: &'a LossInput<'a>, optics: &'a Optics, corner: &'a ConcaveZone, place: usize, ctx: &Context<'_>) -> Self {
        let compared = input.compared;
        let scanned = &compared.scanned[place];
        let pose = &scanned.registered.part_from_scanner;
        let lookup = ViewLookup::new(compared, optics, scanned);
        let outside = [f64::NEG_INFINITY; 2];
        let place_of = |sample: SampleId| {
            let scanner_mm = lookup.scanner_from_part * compared.surface.sample_mm[sample.index()];
            lookup.cloud.grid().image_of(&scanner_mm).map_or(outside, |(place, _)| place)
        };
        let pairs: Vec<(Return, [f64; 2])> = input.returns.of_view(place).map(|pair| (pair, place_of(pair.sample))).collect();
        Self {
            input,
            place,
            in_front: InFront::find(&lookup.cloud, (input.model, input.nearest), pose, compared.compare.search_mm, ctx),
            bounds: FileBounds::find(&pairs, &lookup.cloud, input.removed.get(place).map_or(&[], |removed| &removed.cells)),
            is_scattered: is_scattered(&lookup.cloud),
            is_wide: input.removed.get(place).is_some_and(|removed| removed.is_projected)
                && lookup.cloud.grid().step_px > compared.compare.edge_px,
            reflection: Reflection::new(compared.scanner).at(pose),
            lookup,
            corner,
            pairs,
        }
    }

    fn compared(&self) -> &'a ComparedViews<'a> {
        self.input.compared
    }

    fn sample(&self, sample: SampleId) -> (Point3<f64>, Vector3<f64>) {
        let surface = self.compared().surface;
        (surface.sample_mm[sample.index()], surface.patch_of(sample).normal)
    }

    fn near_steps(&self, points: &[(Point3<f64>, Vector3<f64>)], ctx: &Context<'_>) -> Vec<bool> {
        let pose = &self.compared().scanned[self.place].registered.part_from_scanner;
        let margin = (self.compared().compare, self.lookup.cloud.grid().step_px);
        near_steps(self.input.model, self.compared().scanner, pose, points, margin, ctx)
    }

    fn causes(&self, lost: &SampleSet, evidence: &Evidence, ctx: &Context<'_>) -> Result<Vec<(SampleId, ScanCause)>, Cancelled> {
        let own: Vec<&(Return, [f64; 2])> = self.pairs.iter().filter(|(pair, _)| lost.holds(pair.sample)).collect();
        let blocks = parallel::try_map_chunks(&own, BLOCK, |block| {
            ctx.check()?;
            let pairs = self.lost_pairs(block, ctx);
            let found =
                |lost: &LostPair| ScanCause { cause: self.cause(lost, evidence, ctx), is_expected: lost.pair.is_expected };
            Ok::<_, Cancelled>(pairs.iter().map(|lost| (lost.pair.sample, found(lost))).collect::<Vec<_>>())
        })?;
        Ok(blocks.concat())
    }

    fn lost_pairs(&self, block: &[&(Return, [f64; 2])], ctx: &Context<'_>) -> Vec<LostPair> {
        let grid = self.lookup.cloud.grid();
        let pose = &self.compared().scanned[self.place].registered.part_from_scanner;
        let points: Vec<_> = block.iter().map(|(pair, _)| self.sample(pair.sample)).collect();
        let cells: Vec<Option<usize>> = block.iter().map(|(_, place)| Some(grid.number(grid.cell_at(*place)?))).collect();
        let known: Vec<usize> = cells.iter().flatten().copied().collect();
        let mut on_model = self.input.model.at_cells(pose, grid, &known, ctx).into_iter();
        let near = self.near_steps(&points, ctx);
        let mut pairs = Vec::with_capacity(block.len());
        for (((entry, cell), point), is_near_step) in block.iter().zip(cells).zip(points).zip(near) {
            let model = cell.and_then(|_| on_model.next().flatten());
            pairs.push(LostPair { pair: entry.0, place: entry.1, point, model, is_near_step });
        }
        pairs
    }

    /// The first cause that holds.
    fn cause(&self, lost: &LostPair, evidence: &Evidence, ctx: &Context<'_>) -> LossCause {
        let sample = lost.pair.sample;
        let grid = self.lookup.cloud.grid();
        let is_imaged = lost.place[0].is_finite();
        if is_imaged && (grid.cell_at(lost.place).is_none() || self.bounds.leaves_out(lost.place)) {
            return LossCause::OutsideFile;
        }
        let Some(seen) = self.lookup.sample(sample) else { return LossCause::Pose };
        if !is_imaged || !self.input.registered_rows[self.place].holds(sample) {
            return LossCause::Pose;
        }
        if let Some(cause) = self.in_front.hides(&lost.point.0, self.lookup.view.centres_mm()) {
            return cause;
        }
        let footprint = self.lookup.footprint(sample, &seen);
        let shown = match footprint {
            Footprint::Off(_) | Footprint::Turned => {
                let pose = &self.compared().scanned[self.place].registered.part_from_scanner;
                ShownSurface::of(&self.lookup, &seen, pose, self.input.model, ctx)
            }
            Footprint::Measured | Footprint::OutsideGrid | Footprint::Empty | Footprint::Sparse => None,
        };
        if shown.is_some_and(|shown| shown.deviates()) {
            return LossCause::PartDeviates;
        }
        self.limit_cause(lost)
            .or_else(|| self.zone_cause(lost, evidence))
            .or_else(|| self.light_cause(sample))
            .unwrap_or_else(|| self.remaining_cause(lost, footprint, shown))
    }

    /// Returns true if a pair lies beyond the identified limits of incidence or within the lobe of glare: at the sample, or where
    /// the ray of its cell meets the model.
    fn is_beyond_limits(&self, pair: &Return, model: Option<&ModelPoint>) -> bool {
        self.is_grazing(pair, model, 0.0) || self.is_glare(pair, model)
    }

    /// Returns true if a pair lies beyond the identified limits of incidence, or no farther than so many degrees before them.
    fn is_grazing(&self, pair: &Return, model: Option<&ModelPoint>, before_deg: f64) -> bool {
        let limits_rad = self.input.limits.incidence_deg.map(|deg| deg.map(|deg| (deg - before_deg).to_radians()));
        let exceeds = |angles: crate::cell::PerDevice<f64>| {
            limits_rad.zip(angles).into_iter().any(|(limit, angle)| limit.is_some_and(|limit| angle > limit))
        };
        let view = &self.lookup.view;
        let on_model = |model: &ModelPoint| exceeds(view.incidence_rad(&model.point_mm, &model.normal));
        exceeds(pair.incidence_rad) || model.is_some_and(|model| model.is_seen && on_model(model))
    }

    fn is_glare(&self, pair: &Return, model: Option<&ModelPoint>) -> bool {
        let Some(lobe_deg) = self.input.limits.lobe_deg else { return false };
        let on_model = |model: &ModelPoint| self.reflection.mirror_rad(&model.point_mm, &model.normal) < lobe_deg.to_radians();
        pair.mirror_rad < lobe_deg.to_radians() || model.is_some_and(|model| model.is_seen && on_model(model))
    }

    fn limit_cause(&self, lost: &LostPair) -> Option<LossCause> {
        if self.is_grazing(&lost.pair, lost.model.as_ref(), 0.0) {
            return Some(LossCause::Grazing);
        }
        self.is_glare(&lost.pair, lost.model.as_ref()).then_some(LossCause::Specular)
    }

    fn zone_cause(&self, lost: &LostPair, evidence: &Evidence) -> Option<LossCause> {
        if self.is_scattered || self.is_between_points(lost) || self.is_in_wide_cell(lost) {
            return None;
        }
        if lost.is_near_step && evidence.edges.is_weak() {
            return Some(LossCause::Edge);
        }
        let (point_mm, normal) = &lost.point;
        let on_model = |model: &ModelPoint| self.corner.holds(&model.point_mm, &model.normal);
        let in_corner = self.corner.holds(point_mm, normal) || lost.model.as_ref().is_some_and(on_model);
        (in_corner && evidence.corners.is_weak()).then_some(LossCause::Concave)
    }

    fn light_cause(&self, sample: SampleId) -> Option<LossCause> {
        match self.input.light.map_or(Light::Fair, |light| light(self.place, sample)) {
            Light::Dark => Some(LossCause::Dark),
            Light::Saturated => Some(LossCause::Saturated),
            Light::Fair => None,
        }
    }

    fn remaining_cause(&self, lost: &LostPair, footprint: Footprint, shown: Option<ShownSurface>) -> LossCause {
        let is_blurred = |[near_mm, far_mm]: [f64; 2]| !(near_mm..=far_mm).contains(&lost.pair.depth_mm);
        if self.input.limits.depth_mm.is_some_and(is_blurred) {
            return LossCause::DepthBlur;
        }
        if footprint == Footprint::Sparse || !lost.pair.is_expected {
            return LossCause::Sparse;
        }
        // What an exact scan would show as well is no noise: the grid is too coarse for the surface.
        if let Some(shown) = shown {
            return if shown.is_noisy() { LossCause::Noisy } else { LossCause::Sparse };
        }
        if self.is_filtered(lost) {
            return if self.is_too_sparse_to_clean(lost) { LossCause::Sparse } else { LossCause::Filtered };
        }
        if self.is_grazing(&lost.pair, lost.model.as_ref(), FALL_DEG) {
            LossCause::Grazing
        } else if footprint == Footprint::Empty
            && (self.is_scattered || self.is_between_points(lost) || self.is_in_wide_cell(lost))
        {
            LossCause::Sparse
        } else {
            LossCause::Unexplained
        }
    }

    fn removed(&self) -> Option<&'a Removed> {
        self.input.removed.get(self.place).copied()
    }

    /// Returns true if the point of a sample's cell was taken out.
    fn is_filtered(&self, lost: &LostPair) -> bool {
        let grid = self.lookup.cloud.grid();
        let cell = grid.cell_at(lost.place).map(|cell| grid.number(cell) as u32);
        self.removed().zip(cell).is_some_and(|(removed, cell)| removed.cells.binary_search(&cell).is_ok())
    }

    /// Returns true if the points lie too far apart for the cleaning to tell those of the sample's own surface from specks and from mixed
    /// ones: a few cells hold a feature, or neighbours differ in depth by what is taken for an edge. What was taken for the plate's is told
    /// by its height.
    fn is_too_sparse_to_clean(&self, lost: &LostPair) -> bool {
        let Some(removed) = self.removed() else { return false };
        let cell_mm = self.lookup.cloud.grid().cell_mm(lost.pair.depth_mm);
        let scanner_mm = self.lookup.scanner_from_part * lost.point.0;
        if removed.plate.is_some_and(|zone| zone.holds(&scanner_mm, cell_mm)) {
            return false;
        }
        let apart = if removed.is_projected { PROJECTED_APART } else { ORGANISED_APART };
        let rise_mm = apart * cell_mm * lost.pair.incidence_rad.left.tan();
        let is_coarse = removed.is_projected && cell_mm >= COARSE_CELL_MM;
        self.is_scattered || is_coarse || rise_mm > CleanOptions::default().step_mm
    }

    /// Returns true if the sample lies beside a step, in a cell that reaches across it.
    fn is_in_wide_cell(&self, lost: &LostPair) -> bool {
        self.is_wide && lost.is_near_step
    }

    /// Returns true if the sample's cell is an empty one between two others with points, above and below or to the left and right, of a
    /// cloud that was put into cells: its points lie anywhere in them, and leave some out.
    fn is_between_points(&self, lost: &LostPair) -> bool {
        let cloud = &self.lookup.cloud;
        let Some(cell) = cloud.grid().cell_at(lost.place) else { return false };
        let has = |right, down| cloud.neighbour(cell, right, down).is_some();
        let is_gap = || cloud.point(cell).is_none() && ((has(-1, 0) && has(1, 0)) || (has(0, -1) && has(0, 1)));
        self.removed().is_some_and(|removed| removed.is_projected) && is_gap()
    }
}
