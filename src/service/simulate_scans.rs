//! Scans of a plan's views by the simulated scanner: files as a real one would export them, and the truth beside them.

use serde::{Deserialize, Serialize};

use super::inspect_job::{InspectedPart, PlannedViews};
use super::plan_job::Artifact;
use crate::cell::PoseSpec;
use crate::geometry::Mesh;
use crate::geometry::cloud_io::write_ply;
use crate::inspection::simulated_scanner::{CellFate, ScannedScene, SimulatedScanner, SimulatedView, SimulationParams};
use crate::planning::context::{Cancelled, Context};
use crate::planning::params::PlanParams;
use crate::planning::plate;
use crate::wire::json_file_bytes;

/// The truth about simulated scans.
pub const TRUTH_FILE: &str = "truth.json";
/// Schema name in it.
pub const TRUTH_SCHEMA: &str = "vantage.simulated_scans/1";

/// Name of the file of a view's scan.
#[must_use]
pub fn scan_file(viewpoint: u32) -> String {
    format!("view_{viewpoint:03}.ply")
}

/// The truth about simulated scans: what nobody knows of real ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TruthDocument {
    /// Schema name, `vantage.simulated_scans/1`.
    pub schema: String,
    /// SHA-256 of the bytes of `plan.json`.
    pub plan_sha256: String,
    /// Parameters of the simulation.
    pub params: SimulationParams,
    /// Views.
    pub views: Vec<TrueViewDocument>,
}

/// The truth about one simulated scan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueViewDocument {
    /// Viewpoint of the plan.
    pub viewpoint: u32,
    /// File of its scan.
    pub file: String,
    /// Pose from which it was really taken.
    pub part_from_scanner: PoseSpec,
    /// Cells of the grid by what became of them.
    pub cells: Vec<(String, usize)>,
}

/// A part as it was built, in front of the simulated scanner.
#[derive(Clone, Copy)]
pub struct SimulatedScans<'a> {
    /// Part and hardware of the plan.
    pub part: InspectedPart<'a>,
    /// The part as it was built.
    pub as_built: &'a Mesh,
    /// Views of the plan.
    pub planned: &'a PlannedViews,
    /// Parameters of the plan.
    pub plan_params: &'a PlanParams,
    /// SHA-256 of the bytes of `plan.json`.
    pub plan_sha256: &'a str,
    /// Parameters of the simulation.
    pub sim: &'a SimulationParams,
}

impl SimulatedScans<'_> {
    /// Scans every view and renders the files; `progress` is told the views done, and all.
    ///
    /// # Errors
    /// [`Cancelled`].
    pub fn files(&self, progress: &dyn Fn(usize, usize), ctx: &Context<'_>) -> Result<Vec<Artifact>, Cancelled> {
        let (mut files, mut views) = (Vec::new(), Vec::new());
        let all = self.planned.views.len();
        for (setup, table_from_part) in self.planned.setups.iter().enumerate() {
            let plate = self.part.cell.map(|cell| plate(cell, table_from_part));
            let scene = ScannedScene {
                as_built: self.as_built,
                fixture: self.part.fixture,
                plate: plate.as_ref(),
                unknown: None,
                face_albedo: None,
            };
            let scanner = SimulatedScanner::new(self.part.scanner, self.plan_params, self.sim, scene, ctx)?;
            for view in self.planned.views.iter().filter(|view| view.setup == setup) {
                // One at a time: a view at full pitch takes some 300 MB.
                for taken in scanner.scan(&[(view.viewpoint, view.part_from_scanner)], ctx)? {
                    views.push(truth(&taken));
                    files.push(file(&taken));
                }
                progress(views.len(), all);
            }
        }
        let truth = TruthDocument {
            schema: TRUTH_SCHEMA.to_owned(),
            plan_sha256: self.plan_sha256.to_owned(),
            params: self.sim.clone(),
            views,
        };
        files.push(Artifact { name: TRUTH_FILE.into(), bytes: json_file_bytes(&truth) });
        Ok(files)
    }
}

fn file(view: &SimulatedView) -> Artifact {
    let mut bytes = Vec::new();
    // Writing to a vector cannot fail.
    let _ = write_ply(&view.scan.scanner_cloud, &mut bytes);
    Artifact { name: scan_file(view.scan.viewpoint).into(), bytes }
}

fn truth(view: &SimulatedView) -> TrueViewDocument {
    let count = |fate: CellFate| (fate.as_str().to_owned(), view.fates.iter().filter(|other| **other == fate).count());
    TrueViewDocument {
        viewpoint: view.scan.viewpoint,
        file: scan_file(view.scan.viewpoint),
        part_from_scanner: PoseSpec::from(&view.true_part_from_scanner),
        cells: CellFate::ALL.map(count).into_iter().filter(|(_, cells)| *cells > 0).collect(),
    }
}
