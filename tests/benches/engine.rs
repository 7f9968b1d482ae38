//! The default engine as plans use it: which of four samples a triangle, on average, does each of a hundred viewpoints
//! measure? Everything is counted that is done for the viewpoints, nothing that is done once a part.

use std::sync::atomic::AtomicBool;

use vantage::cell::Scanner;
use vantage::geometry::{Mesh, Part as PartFrame, Pose, ScannerFrame, SimdLevel};
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::PlanParams;
use vantage::planning::surface::{self, Surface};
use vantage::planning::visibility::{self, Occluders, VisibilityMatrix};

use crate::Bench;
use crate::measure::{Contestant, Cost, cost, race};
use crate::meshes::{Part, Size};
use crate::report::{Demand, Good, ms, number};
use crate::rig;

/// Viewpoints, all around the part.
const VIEWS: usize = 100;
/// Samples a triangle, on average.
const SAMPLES: f64 = 4.0;

/// A part made ready for the engine.
pub(crate) struct Ready {
    /// Samples of the part.
    pub(crate) surface: Surface,
    occluders: Occluders,
    params: PlanParams,
}

impl Ready {
    /// A part with so many samples a triangle on average, at least one on each; or with what a plan takes by default.
    pub(crate) fn new(mesh: &Mesh, samples_a_triangle: Option<f64>) -> Self {
        let mut params = PlanParams::default();
        if let Some(samples) = samples_a_triangle {
            params.part.samples_per_mm2 = Some(samples * mesh.faces.len() as f64 / mesh.area_mm2());
            params.part.patch_edge_mm = Some(f64::INFINITY);
        }
        let surface = surface::sample(mesh, &params.part, &params.regions, params.seed).expect("not too many samples");
        Self { surface, occluders: Occluders::new([mesh]), params }
    }

    /// Samples that each of `views` measures, computed on the pool that this runs in.
    pub(crate) fn cast(&self, scanner: &Scanner, views: &[Pose<PartFrame, ScannerFrame>], level: SimdLevel) -> VisibilityMatrix {
        let cancel = AtomicBool::new(false);
        let ctx = Context::new(&cancel, &Silent).with_simd_level(level);
        let usable = vec![true; views.len()];
        visibility::cast(&self.surface, views, &usable, scanner, &self.occluders, &self.params, &ctx).expect("not cancelled")
    }

    /// Triangles that the devices meet with a pixel from `view`: a bit a device, left camera first.
    pub(crate) fn pixel_set(&self, scanner: &Scanner, view: &Pose<PartFrame, ScannerFrame>, level: SimdLevel) -> Vec<u8> {
        let cancel = AtomicBool::new(false);
        let ctx = Context::new(&cancel, &Silent).with_simd_level(level);
        visibility::pixel_set(&self.occluders, scanner, view, &ctx).expect("not cancelled")
    }
}

/// The engine on two threads and on one, and with the narrower vector instructions where that does not take minutes.
pub(crate) fn section(bench: &mut Bench, part: &Part) {
    let (ready, views) = (Ready::new(&part.mesh, Some(SAMPLES)), rig::views_around(&bench.scanner, VIEWS));
    let mut field = vec![(SimdLevel::widest(), 2), (SimdLevel::widest(), 1)];
    if part.size != Some(Size::Dense) {
        field.extend(SimdLevel::available().into_iter().rev().skip(1).map(|level| (level, 2)));
    }
    let contestants = field.iter().map(|(level, threads)| -> Contestant<'_> {
        let (pool, scanner, ready, views) = (bench.pools.of(*threads), &bench.scanner, &ready, &views);
        Ok(Box::new(move || cost(|| pool.install(|| ready.cast(scanner, views, *level))).1))
    });
    let costs: Vec<_> = race(bench.rounds, contestants.collect()).into_iter().filter_map(Result::ok).collect();
    bench.report.section(format!("Samples, maps and doubtful rays: {}", part.title));
    bench.report.say(format!("{VIEWS} viewpoints, {} samples.", ready.surface.sample_mm.len()));
    let rows: Vec<_> = field
        .iter()
        .zip(&costs)
        .map(|((level, threads), cost)| {
            let [wall, cpu] = [cost.wall_s / costs[0].wall_s, cost.cpu_s / costs[0].cpu_s].map(number);
            let level = level.as_str().to_owned();
            vec![level, threads.to_string(), number(cost.wall_s), ms(cost.cpu_s / VIEWS as f64), wall, cpu]
        })
        .collect();
    let header = ["level", "threads", "all viewpoints, s", "CPU a viewpoint, ms", "wall, of the first", "CPU, of the first"];
    bench.report.table(&header, &rows);
    figures(bench, part, &field, &costs);
}

fn figures(bench: &mut Bench, part: &Part, field: &[(SimdLevel, usize)], costs: &[Cost]) {
    let Some(size) = part.size else { return };
    let mut figure = |what: &str, demand, measured| bench.report.figure(format!("{what}, {}", size.as_str()), demand, measured);
    let (two, one) = (costs[0], costs[1]);
    let [view, hundred] = match size {
        Size::Coarse => [Some((30.0, 15.0)), None],
        Size::Middle => [None, Some((1.4, 0.7))],
        Size::Dense => [Some((220.0, 100.0)), Some((11.0, 4.5))],
    };
    if let Some((least, aim)) = view {
        let cpu_ms = two.cpu_s / VIEWS as f64 * 1e3;
        figure("samples, maps and doubtful rays, CPU a view", Demand::below(least, aim, " ms"), cpu_ms);
        figure("two cores against one", Demand { good: Good::Above, least: 1.8, aim: None, unit: " ×" }, one.wall_s / two.wall_s);
        if let Some(avx2) = field.iter().position(|(level, _)| level.as_str() == "avx2").filter(|place| *place > 1) {
            let demand = Demand { good: Good::Below, least: 1.5, aim: None, unit: " ×" };
            figure("time with AVX2 of that with AVX-512", demand, costs[avx2].cpu_s / two.cpu_s);
        }
    }
    if let Some((least, aim)) = hundred {
        figure("100 candidates", Demand::below(least, aim, " s"), two.wall_s);
    }
}
