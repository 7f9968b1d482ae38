//! Tables of public parts for the solvers: the nominal rig, the ellipsoid's candidates, about as many samples of equal area
//! as asked for.

use std::sync::atomic::AtomicBool;

use vantage::planning::context::{Context, Silent};
use vantage::planning::ids::SampleId;
use vantage::planning::params::{CandidateParams, Hemisphere, Objective, PlanParams, ScoreParams, SelectionParams, Strategy};
use vantage::planning::selection::{CoverProblem, Selection, select};
use vantage::planning::visibility::Row;
use vantage::planning::{PlanInput, tabulate};

use super::{nominal_scanner, shared_mesh_scaled};

/// Samples that each candidate measures, and the area of each sample.
pub(crate) struct SelectionTable {
    pub(crate) rows: Vec<Row>,
    pub(crate) area_mm2: Vec<f64>,
}

impl SelectionTable {
    /// Table of a part so long, with the ellipsoid's 54 candidates; none where the data set is absent.
    pub(crate) fn new(path: &str, extent_mm: f64, camera_deg: f64, projector_deg: f64, samples: usize) -> Option<Self> {
        Self::of(path, extent_mm, CandidateParams::ellipsoid(), [camera_deg, projector_deg], samples)
    }

    /// Table of a part so long, with so many candidates, even in direction.
    pub(crate) fn with_views(
        path: &str,
        extent_mm: f64,
        views: u32,
        camera_deg: f64,
        projector_deg: f64,
        samples: usize,
    ) -> Option<Self> {
        let even =
            CandidateParams { strategies: vec![Strategy::Even], even_directions: Some(views), ..CandidateParams::ellipsoid() };
        Self::of(path, extent_mm, even, [camera_deg, projector_deg], samples)
    }

    fn of(
        path: &str,
        extent_mm: f64,
        candidates: CandidateParams,
        [camera_deg, projector_deg]: [f64; 2],
        samples: usize,
    ) -> Option<Self> {
        let mesh = shared_mesh_scaled(path, extent_mm)?;
        let scanner = nominal_scanner();
        let mut params = PlanParams { candidates, ..PlanParams::default() };
        params.limits.camera_deg = Some(camera_deg);
        params.limits.projector_deg = Some(projector_deg);
        params.candidates.hemisphere = Some(Hemisphere::Full);
        params.part.patch_edge_mm = Some(1000.0);
        params.part.samples_per_mm2 = Some(2.0 * samples as f64 / mesh.area_mm2());
        let cancel = AtomicBool::new(false);
        let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
        let table = tabulate(&input, &params, &Context::new(&cancel, &Silent)).expect("a table");
        Some(Self::drawn(&table.rows, &table.asked_area_mm2, samples))
    }

    /// Systematic sampling by area: every `1 / samples` of the area one sample, those drawn more than once merged.
    fn drawn(rows: &[Row], areas_mm2: &[f64], samples: usize) -> Self {
        let step_mm2 = areas_mm2.iter().sum::<f64>() / samples as f64;
        let (mut reached_mm2, mut next_mm2) = (0.0, step_mm2 / 2.0);
        let (mut drawn, mut area_mm2) = (Vec::new(), Vec::new());
        for (sample, own_mm2) in SampleId::number(areas_mm2) {
            reached_mm2 += own_mm2;
            let times = ((reached_mm2 - next_mm2) / step_mm2 + 1.0).floor().max(0.0);
            if times > 0.0 {
                next_mm2 += times * step_mm2;
                drawn.push(sample);
                area_mm2.push(times * step_mm2);
            }
        }
        let row = |row: &Row| {
            let graded: std::collections::BTreeMap<SampleId, f32> = row.graded().collect();
            let own = SampleId::number(&drawn).filter_map(|(place, sample)| graded.get(sample).map(|quality| (place, *quality)));
            Row::from_samples(drawn.len(), own)
        };
        Self { rows: rows.iter().map(row).collect(), area_mm2 }
    }

    /// Solves for 98.5 % of the coverable area.
    pub(crate) fn solve(&self, params: &SelectionParams) -> Selection {
        let cancel = AtomicBool::new(false);
        let total_mm2 = self.area_mm2.iter().sum();
        let params = SelectionParams { objective: Objective::Coverage, ..params.clone() };
        let problem = CoverProblem::new(self.rows.iter().collect(), &self.area_mm2, total_mm2, &params);
        select(&problem, &params, &ScoreParams::default(), &Context::new(&cancel, &Silent)).expect("not cancelled")
    }
}
