//! The default engine as plans use it: which of four samples a triangle, on average, does each of a hundred viewpoints
//! measure? Everything is counted that is done for the viewpoints, nothing that is done once a part.

use std::sync::atomic::AtomicBool;

use vantage::cell::Scanner;
use vantage::geometry::{Mesh, Part as PartFrame, Pose, RayScene, Scanner as ScannerFrame};
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::PlanParams;
use vantage::planning::surface::{self, Surface};
use vantage::planning::visibility::{self, Table};

use crate::Bench;
use crate::measure::{Contestant, cost, race};
use crate::meshes::{Part, Size};
use crate::report::{Demand, Good, ms, number};
use crate::rig;

/// Viewpoints, all around the part.
const VIEWS: usize = 100;
/// Samples a triangle, on average.
const SAMPLES: f64 = 4.0;

/// A part made ready for the engine.
pub(crate) struct Ready {
    /// Its samples.
    pub(crate) surface: Surface,
    scene: RayScene,
    params: PlanParams,
}

impl Ready {
    /// With so many samples a triangle on average, at least one on each; or with what a plan takes by default.
    pub(crate) fn new(mesh: &Mesh, samples_a_triangle: Option<f64>) -> Self {
        let mut params = PlanParams::default();
        if let Some(samples) = samples_a_triangle {
            params.part.samples_per_mm2 = Some(samples * mesh.faces.len() as f64 / mesh.area_mm2());
            params.part.patch_edge_mm = Some(f64::INFINITY);
        }
        let surface = surface::sample(mesh, &params.part, &params.regions, params.seed).expect("not too many samples");
        Self { surface, scene: RayScene::new([mesh]), params }
    }

    /// What each of `views` measures, on the pool that this runs in.
    pub(crate) fn cast(&self, scanner: &Scanner, views: &[Pose<PartFrame, ScannerFrame>]) -> Table {
        let cancel = AtomicBool::new(false);
        let ctx = Context::new(&cancel, &Silent);
        visibility::cast(&self.surface, views, scanner, &self.scene, &self.params, &ctx).expect("not cancelled")
    }
}

/// The engine on one and on two cores.
pub(crate) fn section(bench: &mut Bench, part: &Part) {
    let (ready, views) = (Ready::new(&part.mesh, Some(SAMPLES)), rig::views_around(&bench.scanner, VIEWS));
    let contestants = [1, 2].map(|threads| -> Contestant<'_> {
        let (pool, scanner, ready, views) = (bench.pools.of(threads), &bench.scanner, &ready, &views);
        Ok(Box::new(move || cost(|| pool.install(|| ready.cast(scanner, views))).1))
    });
    let medians: Vec<_> = race(bench.rounds, contestants.into()).into_iter().filter_map(Result::ok).collect();
    bench.report.section(format!("Samples, maps and doubtful rays: {}", part.title));
    bench.report.say(format!("{VIEWS} viewpoints, {} samples.", ready.surface.sample_mm.len()));
    let rows: Vec<_> = ["1", "2"]
        .iter()
        .zip(&medians)
        .map(|(threads, cost)| {
            let of_one = number(medians[0].wall_s / cost.wall_s);
            vec![(*threads).into(), number(cost.wall_s), ms(cost.cpu_s / VIEWS as f64), of_one]
        })
        .collect();
    bench.report.table(&["threads", "all viewpoints, s", "CPU a viewpoint, ms", "times as fast as one"], &rows);
    let [one, two] = &medians[..] else { return };
    let (cpu_ms, wall_s, speed_up) = (two.cpu_s / VIEWS as f64 * 1e3, two.wall_s, one.wall_s / two.wall_s);
    let view = |least, aim| ("samples, maps and doubtful rays, CPU a view", Demand::below(least, aim, " ms"), cpu_ms);
    let hundred = |least, aim| ("100 candidates", Demand::below(least, aim, " s"), wall_s);
    let cores = ("two cores against one", Demand { good: Good::Above, least: 1.8, aim: None, unit: " ×" }, speed_up);
    let (size, figures) = match part.size {
        Some(size @ Size::Coarse) => (size, vec![view(30.0, 15.0), cores]),
        Some(size @ Size::Middle) => (size, vec![hundred(1.4, 0.7)]),
        Some(size @ Size::Dense) => (size, vec![view(220.0, 100.0), hundred(11.0, 4.5), cores]),
        None => return,
    };
    for (what, demand, measured) in figures {
        bench.report.figure(format!("{what}, {}", size.as_str()), demand, measured);
    }
}
