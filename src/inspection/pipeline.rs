//! One inspection from beginning to end: where the scans lie, what they measured, why the rest is missing, how the surface deviates,
//! and what the scanner is like.

use nalgebra::{Matrix6, Vector6};

use super::coverage::{self, ComparedViews, IdentifiedLimits, MeasuredCoverage, NominalModel, PlannedRow, Returns, ScannedView};
use super::deviation::align::{Aligned, as_placed, best_fit};
use super::deviation::statistics::{excluded, histogram, statistics};
use super::deviation::{
    Alignment, Deviation, DeviationOptions, DeviationSpot, DeviationStatistics, ExcludedShares, Extent, Histogram, Nominal,
    PlacedScan, RegionDeviation, RegionToJudge, SampleDeviation, compare,
};
use super::identification::{self, Learned, Offer, Telling, TellingInput, TripleInput, noise, offers, telling, triples};
use super::ingest::{Ingested, Removed};
use super::losses::{LossInput, Losses, attribute};
use super::registration::{KeptPose, RegistrationOptions, ScanRegistration, ViewRegistration, register};
use super::{InspectionParams, RegisteredView, ViewScan};
use crate::cell::{Cell, Scanner};
use crate::geometry::{Mesh, NearestFace, Part, Pose, ScannerFrame, Table};
use crate::planning::certificate::recheck::{Rechecked, TakenView, recheck};
use crate::planning::context::{Context, PlanError};
use crate::planning::ids::SampleId;
use crate::planning::params::PlanParams;
use crate::planning::surface::{Surface, requirements};
use crate::planning::visibility::Row;
use crate::planning::{PlanInput, plate};

/// Maximum number of spots that are listed, those that deviate most.
pub const MAX_SPOTS: usize = 20;
/// Minimum standard deviations of a view's pose that a calibration is believed, the repeatability of an arm: degrees and mm.
const MIN_PRIOR_DEG: f64 = 0.002;
const MIN_PRIOR_MM: f64 = 0.02;
/// Classes of the histogram.
const CLASSES: usize = 41;

/// A view of a plan, as it was to be taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InspectedView {
    /// Number of its viewpoint.
    pub viewpoint: u32,
    /// Setup of the view, from 0.
    pub setup: usize,
    /// Pose of the scanner in the part frame.
    pub part_from_scanner: Pose<Part, ScannerFrame>,
    /// Angle of the table, by which obstacles of the cell may hide what it looks at.
    pub table_rad: Option<f64>,
}

/// A plan and its scans.
#[derive(Clone, Copy)]
pub struct InspectionInput<'a> {
    /// The part as it was to be.
    pub part: &'a Mesh,
    /// Fixture that holds it, in part coordinates.
    pub fixture: Option<&'a Mesh>,
    /// The scanner of the plan.
    pub scanner: &'a Scanner,
    /// The cell of the plan.
    pub cell: Option<&'a Cell>,
    /// Parameters as the plan states them.
    pub plan_params: &'a PlanParams,
    /// Pose of the part in each setup; one at least.
    pub setups: &'a [Pose<Table, Part>],
    /// Views of the plan that were to be taken.
    pub views: &'a [InspectedView],
    /// Asked area that some candidate of the plan measures, where it is known.
    pub coverable_mm2: Option<f64>,
    /// Scans as they were taken in.
    pub taken: &'a Ingested,
    /// The nearest face of the part.
    pub nearest: &'a NearestFace<'a>,
    /// Knobs.
    pub params: &'a InspectionParams,
}

/// Result of an inspection.
#[derive(Debug)]
pub struct Inspection {
    /// Samples of the plan.
    pub surface: Surface,
    /// Registered poses of the scans.
    pub registration: ScanRegistration,
    /// Pose of the part on the table by its scans; `None` without a cell, where the alignment was not found, and with several setups, which
    /// have a place of it each.
    pub table_from_part: Option<Pose<Table, Part>>,
    /// Measured coverage.
    pub coverage: MeasuredCoverage,
    /// Causes of what is missing.
    pub losses: Losses,
    /// Deviation of the surface, at the alignment that was asked for; of scans that do not fit the part nothing is compared.
    pub deviation: Aligned,
    /// Figures of the deviation.
    pub figures: DeviationFigures,
    /// Figures of the scanner; `None` where nothing tells any, or the scans do not fit the part.
    pub learned: Option<Learned>,
    /// Changes of specification and parameters that are offered.
    pub offer: Offer,
}

/// Figures of a deviation.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviationFigures {
    /// Statistics of the whole part; `None` where nothing was measured.
    pub whole: Option<DeviationStatistics>,
    /// Shares of the whole part that they leave out.
    pub excluded: ExcludedShares,
    /// Histogram of the whole part.
    pub histogram: Histogram,
    /// Extents along the part's axes.
    pub extents: [Extent; 3],
    /// Regions of interest and features.
    pub regions: Vec<RegionDeviation>,
    /// Spots that deviate most.
    pub worst: Vec<DeviationSpot>,
}

impl InspectionInput<'_> {
    /// Options of the registration: the priors of `params`, else those of the cell's calibration, else the default's.
    fn registration_options(&self) -> RegistrationOptions {
        let default = RegistrationOptions::default();
        // A view is off by what its calibration leaves open and by what each of its poses was off.
        let calibrated = self.cell.and_then(|cell| cell.calibrated.as_ref());
        let of_rotation = calibrated.map(|known| known.rotation_sd_deg.hypot(known.rms_rotation_deg).max(MIN_PRIOR_DEG));
        let of_translation = calibrated.map(|known| known.translation_sd_mm.hypot(known.rms_translation_mm).max(MIN_PRIOR_MM));
        let align = &self.params.align;
        RegistrationOptions {
            prior_deg: align.prior_deg.or(of_rotation).unwrap_or(default.prior_deg),
            prior_mm: align.prior_mm.or(of_translation).unwrap_or(default.prior_mm),
            // What a calibration leaves open is off alike in every view; where it is not known which part that is, all of it is taken to
            // be.
            own_deg: calibrated.filter(|_| align.prior_deg.is_none()).map_or(0.0, |known| known.rms_rotation_deg),
            own_mm: calibrated.filter(|_| align.prior_mm.is_none()).map_or(0.0, |known| known.rms_translation_mm),
            moves_views: !self.is_merged(),
            start: self.taken.mesh_from_stated,
            is_searched: self.taken.is_searched,
            stray_points: self.taken.stray_points,
            ..default
        }
    }

    /// Options of the comparison: the noise is that of the plan.
    fn deviation_options(&self) -> DeviationOptions {
        DeviationOptions {
            search_mm: self.params.compare.search_mm,
            noise_mm: self.plan_params.regions.noise.best_mm,
            is_merged: self.is_merged(),
            ..DeviationOptions::default()
        }
    }

    /// Returns true if the scans are images of one cloud, which another program has merged.
    fn is_merged(&self) -> bool {
        self.taken.scans.iter().any(|taken| taken.is_approximate)
    }

    /// Covariance of what the views of a merged cloud are off against each other, as far as it is stated.
    fn merged_covariance(&self) -> Matrix6<f64> {
        let align = &self.params.align;
        let is_stated = self.is_merged();
        let [deg, mm] = [align.prior_deg, align.prior_mm].map(|stated| stated.filter(|_| is_stated).unwrap_or_default());
        diagonal(deg, mm)
    }

    fn plan_input(&self) -> PlanInput<'_> {
        PlanInput {
            mesh: self.part,
            fixture: self.fixture,
            part_sha256: "",
            scanner: self.scanner,
            cell: self.cell,
            roadmaps: None,
        }
    }

    /// Motion from where the part was planned to where it was found: none where it lies as planned but for what poses are off.
    fn moved_part(&self, registration: &ScanRegistration) -> Pose<Part, Part> {
        let is_elsewhere = self.taken.mesh_from_stated != Pose::identity();
        if is_elsewhere { registration.mesh_from_stated } else { Pose::identity() }
    }

    /// Samples that views from `poses` measure of the part where it was found: `poses` belong to the views at the same places.
    fn measured_from(
        &self,
        views: &[&InspectedView],
        poses: &[Pose<Part, ScannerFrame>],
        mesh_from_stated: &Pose<Part, Part>,
        ctx: &Context<'_>,
    ) -> Result<Rechecked, PlanError> {
        let mut rows: Vec<Option<Row>> = vec![None; views.len()];
        let mut whole: Option<Rechecked> = None;
        for (setup, table_from_part) in self.setups.iter().enumerate() {
            let of_setup = |place: &usize| views[*place].setup == setup;
            let places: Vec<usize> = (0..views.len()).filter(of_setup).collect();
            if places.is_empty() && (setup > 0 || !views.is_empty()) {
                continue;
            }
            let taken = |place: &usize| TakenView { part_from_scanner: poses[*place], table_rad: views[*place].table_rad };
            let taken: Vec<TakenView> = places.iter().map(taken).collect();
            let table_from_part = *table_from_part * mesh_from_stated.inverse();
            let mut checked = recheck(&self.plan_input(), self.plan_params, &table_from_part, &taken, ctx)?;
            places.iter().zip(std::mem::take(&mut checked.rows)).for_each(|(place, row)| rows[*place] = Some(row));
            whole.get_or_insert(checked);
        }
        let whole = match whole {
            Some(whole) => whole,
            None => recheck(&self.plan_input(), self.plan_params, &Pose::identity(), &[], ctx)?,
        };
        let none = || Row::from_samples(whole.surface.sample_mm.len(), []);
        let rows = rows.into_iter().map(|row| row.unwrap_or_else(none)).collect();
        Ok(Rechecked { rows, ..whole })
    }
}

/// Inspects scans; `progress` is told the share done, 0 to 1.
///
/// # Errors
/// Parameters out of range, a region that the plan does not have, more than the context allows, [`PlanError::Cancelled`].
pub fn inspect(input: &InspectionInput<'_>, progress: &dyn Fn(f64), ctx: &Context<'_>) -> Result<Inspection, PlanError> {
    let scans: Vec<&ViewScan> = input.taken.scans.iter().map(|taken| &taken.scan).collect();
    let registration = register(&scans, input.nearest, &[], &input.registration_options());
    progress(0.25);
    let poses: Vec<_> = input.views.iter().map(|view| view.part_from_scanner).collect();
    let views: Vec<&InspectedView> = input.views.iter().collect();
    let planned = input.measured_from(&views, &poses, &Pose::identity(), ctx)?;
    let to_row = |(view, row): (&InspectedView, &Row)| PlannedRow { viewpoint: view.viewpoint, row: row.clone() };
    let rows: Vec<PlannedRow> = input.views.iter().zip(&planned.rows).map(to_row).collect();
    progress(0.4);
    let scanned: Vec<ScannedView<'_>> =
        scans.iter().zip(&registration.views).map(|(scan, registered)| ScannedView { scan, registered }).collect();
    let compared = ComparedViews {
        surface: &planned.surface,
        asked_area_mm2: &planned.asked_area_mm2,
        scanner: input.scanner,
        params: input.plan_params,
        planned: &rows,
        scanned: &scanned,
        coverable_mm2: input.coverable_mm2,
        compare: &input.params.compare,
    };
    let mut coverage = coverage::measure(&compared, ctx)?;
    coverage.is_approximate |= input.is_merged();
    progress(0.55);
    let part_from_found = input.moved_part(&registration).inverse();
    let plate = |cell: &Cell, table_from_part: &Pose<Table, Part>| plate(cell, &(*table_from_part * part_from_found));
    let plates: Vec<Mesh> = input.cell.iter().flat_map(|cell| input.setups.iter().map(|pose| plate(cell, pose))).collect();
    // Of several setups each has its own plate, and only one is there at a time: then none of them hides.
    let one_plate = plates.iter().filter(|_| plates.len() == 1);
    let surroundings: Vec<&Mesh> = input.fixture.into_iter().chain(one_plate).collect();
    let model = NominalModel::new(input.part, &surroundings, input.scanner, ctx)?;
    let judged = Judged { input, compared: &compared, coverage: &coverage, model: &model, registration: &registration };
    let returns = coverage::returns(&compared, &coverage, &model, ctx)?;
    let told = judged.told(&returns, ctx)?;
    let learned = judged.learned(&told.returns, ctx)?;
    progress(0.7);
    let losses = judged.losses(&returns, learned.as_ref(), ctx)?;
    progress(0.85);
    let (deviation, figures) = judged.deviation(ctx)?;
    progress(0.97);
    let offer = learned.as_ref().map(|learned| offers(learned, input.scanner, &input.plan_params.regions.noise));
    let table_from_part = match input.setups {
        [planned] if input.cell.is_some() && registration.not_found().is_none() => {
            Some(*planned * registration.mesh_from_stated.inverse())
        }
        _ => None,
    };
    Ok(Inspection {
        registration,
        table_from_part,
        losses,
        deviation,
        figures,
        learned,
        offer: Offer { withheld: told.withheld, kept_views: told.kept_views, ..offer.unwrap_or_default() },
        coverage: coverage.clone(),
        surface: planned.surface.clone(),
    })
}

/// Scans whose coverage is known.
struct Judged<'a> {
    input: &'a InspectionInput<'a>,
    compared: &'a ComparedViews<'a>,
    registration: &'a ScanRegistration,
    coverage: &'a MeasuredCoverage,
    model: &'a NominalModel<'a>,
}

impl Judged<'_> {
    /// Finds the scans whose registered pose was taken: one that kept its stated pose is not known to lie there.
    fn is_registered(&self) -> Vec<bool> {
        self.registration.found.iter().map(|view| view.kept_pose.is_none()).collect()
    }

    /// Pairs whose loss tells something of the scanner: none where the scans do not fit the part.
    fn told(&self, returns: &Returns, ctx: &Context<'_>) -> Result<Telling, PlanError> {
        if !self.registration.fits() {
            return Ok(Telling::default());
        }
        let removed: Vec<&Removed> = self.input.taken.scans.iter().map(|taken| &taken.removed).collect();
        let is_merged = self.input.is_merged();
        let is_registered = self.is_registered();
        let input = TellingInput {
            compared: self.compared,
            model: self.model,
            removed: &removed,
            is_registered: &is_registered,
            is_merged,
        };
        Ok(telling(returns, &input, ctx)?)
    }

    /// Figures of the scanner; `None` where nothing tells any, or the scans do not fit the part: what is not where it was looked for
    /// is no weakness of the scanner. The noise needs no pairs: a coarse cloud and one without a grid tell it too, a merged one does not.
    fn learned(&self, returns: &Returns, ctx: &Context<'_>) -> Result<Option<Learned>, PlanError> {
        if !self.registration.fits() {
            return Ok(None);
        }
        let scanned = self.compared.scanned.iter().zip(self.is_registered()).filter(|(_, is_registered)| *is_registered);
        let scans: Vec<(&ViewScan, &RegisteredView)> = scanned.map(|(scanned, _)| (scanned.scan, scanned.registered)).collect();
        let part = TripleInput { mesh: self.input.part, surfaces: self.model.surfaces(), scanner: self.input.scanner };
        let triples = if self.input.is_merged() { Vec::new() } else { triples(&part, &scans, ctx)? };
        let noise = noise(&triples, self.input.scanner);
        let returns = identification::returns(returns, self.input.scanner);
        Ok((noise.is_some() || returns.is_some()).then_some(Learned { noise, returns }))
    }

    fn losses(&self, returns: &Returns, learned: Option<&Learned>, ctx: &Context<'_>) -> Result<Losses, PlanError> {
        let limits = learned.and_then(|learned| learned.returns.as_ref());
        let limits = limits.map_or_else(IdentifiedLimits::default, |returns| returns.limits(self.input.scanner));
        let of = |scanned: &ScannedView<'_>| {
            let view = self.input.views.iter().find(|view| view.viewpoint == scanned.scan.viewpoint)?;
            Some((view, scanned.registered.part_from_scanner))
        };
        let (views, poses): (Vec<&InspectedView>, Vec<_>) = self.compared.scanned.iter().filter_map(of).unzip();
        let moved_part = self.input.moved_part(self.registration);
        let registered_rows = self.input.measured_from(&views, &poses, &moved_part, ctx)?.rows;
        let removed: Vec<&Removed> = self.input.taken.scans.iter().map(|taken| &taken.removed).collect();
        let losses = LossInput {
            compared: self.compared,
            coverage: self.coverage,
            returns,
            model: self.model,
            nearest: self.input.nearest,
            registered_rows: &registered_rows,
            limits: &limits,
            light: None,
            level: None,
            removed: &removed,
        };
        Ok(attribute(&losses, ctx)?)
    }

    /// The surface's deviation at the alignment that was asked for, and its figures.
    fn deviation(&self, ctx: &Context<'_>) -> Result<(Aligned, DeviationFigures), PlanError> {
        let surface = self.compared.surface;
        let nominal = Nominal { mesh: self.input.part, scene: self.model.surfaces(), surface, scanner: self.input.scanner };
        let regions = regions_to_judge(surface, self.input.plan_params);
        let options = self.input.deviation_options();
        let align = &self.input.params.align;
        // Scans that do not fit the part say nothing of how it deviates.
        let scanned: &[ScannedView<'_>] = if self.registration.fits() { self.compared.scanned } else { &[] };
        let placed: Vec<PlacedScan<'_>> = match align.method {
            Alignment::AsPlaced => scanned.iter().map(|scanned| self.as_stated(scanned)).collect(),
            Alignment::BestFit | Alignment::BestFitOn => scanned.iter().map(|scanned| self.as_registered(scanned)).collect(),
        };
        let open = Some(&self.registration.open);
        let aligned = match (align.method, align.region.as_deref()) {
            (Alignment::AsPlaced, _) => as_placed(&placed, &nominal, &options),
            (Alignment::BestFit, _) => best_fit(&placed, &nominal, None, open, &options),
            (Alignment::BestFitOn, name) => {
                let region = regions.iter().find(|region| Some(region.name.as_str()) == name);
                let region = region.ok_or_else(|| no_region(name.unwrap_or_default(), &regions))?;
                best_fit(&placed, &nominal, Some(&region.samples), open, &options)
            }
        };
        ctx.check()?;
        let registered = self.without_doubtful(&placed, &aligned, &nominal, &options);
        let held = (&self.registration.part_covariance, registered.as_deref());
        let samples = &aligned.deviation.samples;
        let whole = statistics(samples, surface, surface.samples(), None);
        let limit_mm = whole.map_or(1.0, |whole| whole.percentiles_mm[0].abs().max(whole.percentiles_mm[4].abs()).max(1e-3));
        let figures = DeviationFigures {
            whole,
            excluded: excluded(samples, surface, surface.samples()),
            histogram: histogram(samples, surface, limit_mm, CLASSES),
            extents: aligned.deviation.extents(&nominal),
            regions: regions.iter().map(|region| aligned.judge_held(&nominal, region, &options, held)).collect(),
            worst: aligned.deviation.worst_spots(&nominal, &options, MAX_SPOTS),
        };
        Ok((aligned, figures))
    }

    /// Deviation by the scans alone whose poses are not doubtful, at the same alignment and with what poses leave open there; `None` where
    /// all are such. A correction beyond its prior refutes it, and with it the stated poses of views that are known by their priors alone.
    fn without_doubtful(
        &self,
        placed: &[PlacedScan<'_>],
        aligned: &Aligned,
        nominal: &Nominal<'_>,
        options: &DeviationOptions,
    ) -> Option<Vec<SampleDeviation>> {
        let found = &self.registration.found;
        let is_beyond = |view: &ViewRegistration| view.kept_pose == Some(KeptPose::PoseOutOfPrior);
        // Poses that are taken as they are stated are judged as they are.
        let is_stated = aligned.alignment == Alignment::AsPlaced;
        if is_stated || self.input.is_merged() || !found.iter().any(is_beyond) {
            return None;
        }
        let is_known = |view: &ViewRegistration| view.kept_pose.is_none_or(|kept| kept == KeptPose::FewPoints);
        let known = placed.iter().zip(found).filter(|(_, view)| is_known(view));
        let known: Vec<PlacedScan<'_>> = known.map(|(scan, _)| scan.moved(&aligned.mesh_from_placed)).collect();
        let alone = compare(&known, nominal, options).samples.into_iter().zip(&aligned.deviation.samples);
        let with_poses = |(own, of_all): (SampleDeviation, &SampleDeviation)| {
            let expanded_mm = f64::from(own.of_points_mm).hypot(of_all.of_poses_mm()) as f32;
            SampleDeviation { expanded_mm, ..own }
        };
        Some(alone.map(with_poses).collect())
    }

    /// A scan at its registered pose. One of a merged cloud is moved with the others, and off against them by what is stated of it.
    fn as_registered<'s>(&self, scanned: &ScannedView<'s>) -> PlacedScan<'s> {
        PlacedScan { covariance: self.input.merged_covariance(), ..PlacedScan::registered(scanned.scan, scanned.registered) }
    }

    /// A scan as its pose is stated, with the prior as its uncertainty.
    fn as_stated<'s>(&self, scanned: &ScannedView<'s>) -> PlacedScan<'s> {
        let options = self.input.registration_options();
        let own = diagonal(options.own_deg, options.own_mm);
        PlacedScan {
            scan: scanned.scan,
            part_from_scanner: scanned.scan.part_from_scanner,
            covariance: if scanned.registered.is_in_prior { own } else { scanned.registered.covariance },
            shared_sd: options.shared_sd(),
        }
    }
}

/// Covariance of a pose of these standard deviations about and along each axis.
fn diagonal(rotation_deg: f64, translation_mm: f64) -> Matrix6<f64> {
    let (turn, shift) = (rotation_deg.to_radians().powi(2), translation_mm.powi(2));
    Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, shift, shift, shift))
}

/// Regions of interest and features of a plan, each with its samples that are asked for: what is excluded counts in no figure of them.
fn regions_to_judge(surface: &Surface, params: &PlanParams) -> Vec<RegionToJudge> {
    let to_judge = |(number, region): (usize, requirements::NamedRegion)| {
        let holds =
            |sample: &SampleId| surface.asked[sample.index()] && surface.requirements.of(*sample).regions.contains(&number);
        let samples = surface.samples().filter(holds).collect();
        RegionToJudge { name: region.name, tolerance_mm: region.tolerance_mm, samples }
    };
    requirements::regions(params).into_iter().enumerate().map(to_judge).collect()
}

fn no_region(name: &str, regions: &[RegionToJudge]) -> PlanError {
    let known: Vec<&str> = regions.iter().map(|region| region.name.as_str()).collect();
    let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
    let detail = format!("is {name:?}; the plan's regions are {known}");
    PlanError::BadParams(vec![crate::cell::FieldError { pointer: "/align/region".to_owned(), detail }])
}

impl Inspection {
    /// Deviation of each sample.
    #[must_use]
    pub fn deviations(&self) -> &Deviation {
        &self.deviation.deviation
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::demo_parts::base;
    use crate::inspection::ingest::{FrameAttempt, Removed, ScanFrame, TakenScan};
    use crate::inspection::rehearsal::{in_context, inspect_alone};
    use crate::inspection::shots::Shots;
    use crate::planning::params::{FeatureParams, Region};
    use crate::testing::{box_mesh, nominal_scanner};

    /// Few points of a scanner noisier than the default once counted as if it were not; and what was stated of a merged cloud did not count.
    #[test]
    fn deviations_are_judged_by_the_noise_that_was_planned_with_and_by_what_is_stated_of_a_merged_cloud() {
        let (mesh, scanner, mut plan_params) = (box_mesh([0.0; 3], [30.0; 3]), nominal_scanner(), PlanParams::default());
        plan_params.regions.noise.best_mm = 0.05;
        let (taken, nearest, params) = (Ingested::default(), NearestFace::new(&mesh), InspectionParams::default());
        let input = InspectionInput {
            part: &mesh,
            fixture: None,
            scanner: &scanner,
            cell: None,
            plan_params: &plan_params,
            setups: &[Pose::identity()],
            views: &[],
            coverable_mm2: None,
            taken: &taken,
            nearest: &nearest,
            params: &params,
        };
        let found = input.deviation_options();
        assert_eq!([found.noise_mm, found.search_mm].map(f64::to_bits), [0.05, params.compare.search_mm].map(f64::to_bits));
        assert!(!found.is_merged);
        let scan =
            ViewScan { viewpoint: 1, part_from_scanner: Pose::identity(), scanner_cloud: crate::geometry::PointCloud::default() };
        let (unit, frame) = (crate::geometry::LengthUnit::Millimetre, ScanFrame::Part);
        let fit = FrameAttempt { unit, frame, in_frusta: 1.0, on_part: 1.0 };
        let image = TakenScan {
            scan,
            file: "all.ply".into(),
            unit,
            frame,
            fit,
            points: 0,
            removed: Removed::default(),
            is_approximate: true,
        };
        let (merged, mut stated) = (Ingested { scans: vec![image], ..Ingested::default() }, InspectionParams::default());
        stated.align.prior_mm = Some(0.1);
        let of = |input: InspectionInput<'_>| input.merged_covariance();
        let input = InspectionInput { params: &stated, ..input };
        assert_eq!(of(input), Matrix6::zeros(), "of single shots the poses hold it");
        assert_eq!(of(InspectionInput { taken: &merged, ..input }), diagonal(0.0, 0.1));
        assert_eq!(of(InspectionInput { taken: &merged, params: &params, ..input }), Matrix6::zeros(), "nothing is stated");
    }

    /// Figures of another part's scans were told as deviations of this one, and its regions judged by them.
    #[test]
    fn scans_that_do_not_fit_the_part_tell_no_deviation() {
        let (scanned, mesh) = (base(20_000).expect("a base"), box_mesh([0.0; 3], [30.0, 20.0, 10.0]));
        let (shots, mut plan_params) = (Shots::of(&scanned, 16), PlanParams::default());
        plan_params.part.samples_per_mm2 = Some(0.2);
        let poses = shots.poses(3);
        let (unit, frame) = (crate::geometry::LengthUnit::Millimetre, ScanFrame::Scanner);
        let taken = |scan: ViewScan| TakenScan {
            file: format!("view_{}.ply", scan.viewpoint),
            points: scan.scanner_cloud.points_mm.len(),
            scan,
            unit,
            frame,
            fit: FrameAttempt { unit, frame, in_frusta: 1.0, on_part: 1.0 },
            removed: Removed::default(),
            is_approximate: false,
        };
        let scans = shots.scans(&poses, 0.0, |_| nalgebra::Isometry3::identity()).into_iter().map(taken).collect();
        let views: Vec<_> = (1..).zip(poses).collect();
        let found = inspect_alone(&mesh, &shots.scanner, &plan_params, &views, scans);
        assert!(!found.registration.fits(), "{:?}", found.registration.found);
        assert_eq!((found.figures.whole, found.deviations().compared_points), (None, 0));
        assert!(found.learned.is_none() && found.offer == Offer::default(), "{:?}", found.offer);
    }

    #[test]
    fn excluded_surface_of_a_region_is_not_judged() {
        let mesh = box_mesh([0.0; 3], [30.0; 3]);
        let half_space = |z_mm: f64| Region::HalfSpace { point_mm: [0.0, 0.0, z_mm], normal: [0.0, 0.0, 1.0] };
        let region = half_space(20.0);
        let mut params = PlanParams::default();
        params.regions.features =
            vec![FeatureParams { name: None, region, tolerance_mm: 0.4, point_spacing_mm: None, target: None }];
        params.part.samples_per_mm2 = Some(0.2);
        let judged = |params: &PlanParams| {
            let surface = in_context(|ctx| requirements::sampled(&mesh, params, 0, ctx)).expect("samples");
            let regions = regions_to_judge(&surface, params);
            let heights_mm = regions[0].samples.iter().map(|sample| surface.sample_mm[sample.index()].z);
            (regions[0].samples.len(), heights_mm.fold(f64::INFINITY, f64::min))
        };
        let (all, lowest_mm) = judged(&params);
        params.regions.exclude = vec![half_space(10.0)];
        let (asked, lowest_asked_mm) = judged(&params);
        assert!(
            lowest_mm < 1.0 && lowest_asked_mm > 10.0 && asked < all && asked > 0,
            "{asked} of {all} from {lowest_asked_mm} mm"
        );
    }
}
