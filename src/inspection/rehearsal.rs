//! Rehearsals for tests: a part is planned without a cell, scanned by the simulated scanner, and judged.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use nalgebra::Matrix6;

use super::coverage::{
    self, CompareParams, ComparedViews, IdentifiedLimits, MeasuredCoverage, NominalModel, PlannedRow, Returns, ScannedView,
};
use super::ingest::{Ingested, Removed, TakenScan};
use super::losses::{Light, LossCause, LossInput, Losses, attribute};
use super::simulated_scanner::{CellFate, ScannedScene, SimulatedScanner, SimulatedView, SimulationParams};
use super::{InspectedView, Inspection, InspectionInput, InspectionParams, RegisteredView, ViewScan, inspect};
use crate::cell::Scanner;
use crate::geometry::mesh_io::{Limits, read};
use crate::geometry::{LengthUnit, Mesh, NearestFace, Part, Pose, ScannerFrame, Table};
use crate::planning::certificate::recheck::{TakenView, recheck};
use crate::planning::context::{Context, Silent};
use crate::planning::ids::SampleId;
use crate::planning::params::{CandidateParams, PlanParams};
use crate::planning::plan::Outcome;
use crate::planning::{PlanInput, plan};
use crate::testing::nominal_scanner;

/// Samples of a part.
const SAMPLES: f64 = 20_000.0;

/// Runs `work` in a context that nobody cancels.
pub(super) fn in_context<T>(work: impl FnOnce(&Context<'_>) -> T) -> T {
    work(&Context::new(&AtomicBool::new(false), &Silent))
}

/// Inspects scans of a part without a cell or fixture, in one setup, with the default knobs.
pub(super) fn inspect_alone(
    part: &Mesh,
    scanner: &Scanner,
    plan_params: &PlanParams,
    views: &[(u32, Pose<Part, ScannerFrame>)],
    scans: Vec<TakenScan>,
) -> Inspection {
    let view = |(viewpoint, pose): &(u32, Pose<Part, ScannerFrame>)| InspectedView {
        viewpoint: *viewpoint,
        setup: 0,
        part_from_scanner: *pose,
        table_rad: None,
    };
    let views: Vec<InspectedView> = views.iter().map(view).collect();
    let (taken, nearest) = (Ingested { scans, ..Ingested::default() }, NearestFace::new(part));
    let input = InspectionInput {
        part,
        fixture: None,
        scanner,
        cell: None,
        plan_params,
        setups: &[Pose::identity()],
        views: &views,
        coverable_mm2: None,
        taken: &taken,
        nearest: &nearest,
        params: &InspectionParams::default(),
    };
    in_context(|ctx| inspect(&input, &|_| (), ctx)).unwrap_or_else(|error| panic!("{error}"))
}

/// A planned part.
pub(super) struct Rehearsal {
    pub(super) mesh: Mesh,
    pub(super) scanner: Scanner,
    pub(super) outcome: Outcome,
    pub(super) compare: CompareParams,
}

/// Knowledge that the losses are judged with.
#[derive(Default)]
pub(super) struct Knowledge<'a> {
    pub(super) limits: IdentifiedLimits,
    pub(super) light: Option<&'a (dyn Fn(usize, SampleId) -> Light + Sync)>,
    pub(super) removed: Vec<Removed>,
    /// True if the scans are images of one cloud that was merged of all views.
    pub(super) is_merged: bool,
    /// Fixture and plate.
    pub(super) surroundings: Vec<&'a Mesh>,
}

/// Scans and their judgement.
pub(super) struct Judged {
    pub(super) coverage: MeasuredCoverage,
    pub(super) returns: Returns,
    pub(super) losses: Losses,
}

impl Judged {
    /// Measured less planned coverage, points of the asked area.
    pub(super) fn difference(&self) -> f64 {
        100.0 * (self.coverage.of_asked() - self.coverage.planned_of_asked())
    }
}

/// Parameters with which parts are planned in seconds: few candidates, no search for remedies.
pub(super) fn quick_params() -> PlanParams {
    let mut params = PlanParams::default();
    (params.missed.remedies, params.candidates) = (0, CandidateParams::ellipsoid());
    params.selection.max_views = Some(8);
    params
}

impl Rehearsal {
    /// Plans a part without a cell, on so many samples that coverage is known to 0.1 point.
    pub(super) fn new(mesh: Mesh, params: &PlanParams) -> Self {
        let scanner = nominal_scanner();
        let mut params = params.clone();
        params.part.samples_per_mm2 = Some(SAMPLES / mesh.area_mm2());
        let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
        let outcome = in_context(|ctx| plan(&input, &params, ctx)).unwrap_or_else(|error| panic!("{error}"));
        Self { mesh, scanner, outcome, compare: CompareParams::default() }
    }

    /// The part alone, as the model has it.
    pub(super) fn as_planned(&self) -> ScannedScene<'_> {
        ScannedScene { as_built: &self.mesh, fixture: None, plate: None, unknown: None, face_albedo: None }
    }

    /// Viewpoints of the plan.
    pub(super) fn views(&self) -> Vec<(u32, Pose<Part, ScannerFrame>)> {
        self.outcome.plan.views.iter().map(|view| (view.id.0, view.part_from_scanner)).collect()
    }

    /// Scans every view.
    pub(super) fn scan(&self, sim: &SimulationParams, scene: ScannedScene<'_>) -> Vec<SimulatedView> {
        let params = &self.outcome.plan.params;
        in_context(|ctx| SimulatedScanner::new(&self.scanner, params, sim, scene, ctx)?.scan(&self.views(), ctx))
            .unwrap_or_else(|error| panic!("{error}"))
    }

    /// Area of each sample, 0 where it is not asked for.
    pub(super) fn asked_area_mm2(&self) -> Vec<f64> {
        self.outcome.surface.asked_area_mm2()
    }

    /// Views of the plan and what they were to measure.
    pub(super) fn planned(&self) -> Vec<PlannedRow> {
        let rows = self.outcome.plan.views.iter().zip(&self.outcome.measured_by_view);
        rows.map(|(view, row)| PlannedRow { viewpoint: view.id.0, row: row.clone() }).collect()
    }

    /// Judges scans with exact registrations.
    pub(super) fn judge(&self, views: &[SimulatedView], knowledge: &Knowledge<'_>) -> Judged {
        let scans: Vec<(&ViewScan, Pose<Part, ScannerFrame>)> =
            views.iter().map(|view| (&view.scan, view.true_part_from_scanner)).collect();
        self.judge_at(&scans, knowledge)
    }

    /// Judges scans at given poses.
    pub(super) fn judge_at(&self, scans: &[(&ViewScan, Pose<Part, ScannerFrame>)], knowledge: &Knowledge<'_>) -> Judged {
        let registered: Vec<RegisteredView> = scans
            .iter()
            .map(|(scan, pose)| RegisteredView {
                viewpoint: scan.viewpoint,
                part_from_scanner: *pose,
                covariance: Matrix6::zeros(),
                is_in_prior: true,
            })
            .collect();
        let scanned: Vec<ScannedView<'_>> =
            scans.iter().zip(&registered).map(|((scan, _), registered)| ScannedView { scan, registered }).collect();
        let (asked_area_mm2, planned) = (self.asked_area_mm2(), self.planned());
        let compared = ComparedViews {
            surface: &self.outcome.surface,
            asked_area_mm2: &asked_area_mm2,
            scanner: &self.scanner,
            params: &self.outcome.plan.params,
            planned: &planned,
            scanned: &scanned,
            coverable_mm2: Some(self.outcome.plan.coverage.coverable_area_mm2),
            compare: &self.compare,
        };
        let taken: Vec<TakenView> =
            scans.iter().map(|(_, pose)| TakenView { part_from_scanner: *pose, table_rad: None }).collect();
        let input =
            PlanInput { mesh: &self.mesh, fixture: None, part_sha256: "", scanner: &self.scanner, cell: None, roadmaps: None };
        let table_from_part = Pose::<Table, Part>::identity();
        in_context(|ctx| {
            let mut coverage = coverage::measure(&compared, ctx).unwrap_or_else(|error| panic!("{error}"));
            coverage.is_approximate |= knowledge.is_merged;
            let model = NominalModel::new(&self.mesh, &knowledge.surroundings, &self.scanner, ctx)
                .unwrap_or_else(|error| panic!("{error}"));
            let returns = coverage::returns(&compared, &coverage, &model, ctx).unwrap_or_else(|error| panic!("{error}"));
            let rechecked = recheck(&input, &self.outcome.plan.params, &table_from_part, &taken, ctx);
            let rows = rechecked.unwrap_or_else(|error| panic!("{error}")).rows;
            let removed: Vec<&Removed> = knowledge.removed.iter().collect();
            let nearest = NearestFace::new(&self.mesh);
            let losses = LossInput {
                compared: &compared,
                coverage: &coverage,
                returns: &returns,
                model: &model,
                nearest: &nearest,
                registered_rows: &rows,
                limits: &knowledge.limits,
                light: knowledge.light,
                level: Some(5),
                removed: &removed,
            };
            let losses = attribute(&losses, ctx).unwrap_or_else(|error| panic!("{error}"));
            Judged { coverage, returns, losses }
        })
    }

    /// The fate that the truth has for a lost sample: of the views that were to measure it the first injected one.
    pub(super) fn truth(&self, views: &[SimulatedView], sample: SampleId) -> CellFate {
        let point_mm = &self.outcome.surface.sample_mm[sample.index()];
        let planned = views.iter().zip(&self.outcome.measured_by_view).filter(|(_, row)| row.holds(sample));
        let mut fates = planned.filter_map(|(view, _)| view.fate_at(point_mm));
        let is_injected =
            |fate: &CellFate| !matches!(fate, CellFate::Returned | CellFate::Empty | CellFate::Surroundings | CellFate::Unseen);
        fates.find(is_injected).unwrap_or(CellFate::Unseen)
    }

    /// Share of the area lost where the truth has `fate` that is put down to `cause`; and that area as a share of
    /// what is asked for.
    pub(super) fn named(&self, judged: &Judged, views: &[SimulatedView], fate: CellFate, cause: LossCause) -> [f64; 2] {
        let (mut all_mm2, mut named_mm2) = (0.0, 0.0);
        for (sample, given) in judged.losses.of_samples.iter().filter(|(sample, _)| self.truth(views, *sample) == fate) {
            let area_mm2 = self.outcome.surface.sample_area_mm2(*sample);
            all_mm2 += area_mm2;
            named_mm2 += if *given == cause { area_mm2 } else { 0.0 };
        }
        [named_mm2 / all_mm2, all_mm2 / judged.coverage.asked_mm2]
    }
}

/// A part of the public data set, as long along its longest axis as asked for; `None`, with a printed reason, where the data set is
/// absent.
pub(super) fn shared_part(name: &str, longest_mm: Option<f64>) -> Option<Mesh> {
    let file = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/meshes")).join(name);
    let Ok(bytes) = std::fs::read(&file) else {
        println!("skipped: needs {name} of the public data set, whose folder ../shared/data is absent");
        return None;
    };
    let mesh = read(&bytes, Some(LengthUnit::Millimetre), &Limits::default()).unwrap_or_else(|error| panic!("{error}")).mesh;
    let factor = longest_mm.map_or(1.0, |mm| mm / mesh.aabb().extent_mm().amax());
    let vertices_mm = mesh.vertices_mm.iter().map(|vertex| vertex * factor).collect();
    Some(Mesh { vertices_mm, ..mesh })
}
