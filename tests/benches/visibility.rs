//! `cargo bench --bench visibility`: the default engine on generated parts, for whoever changes it. Fixed parts, fixed
//! viewpoints, no peers; criterion keeps the last run and says what changed. Rays have `cargo bench --bench rays`.

#[expect(dead_code, reason = "shared with the comparison, which uses all of it")]
mod meshes;
#[expect(dead_code, reason = "shared with the comparison, which uses all of it")]
mod rig;

use std::sync::atomic::AtomicBool;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::PlanParams;
use vantage::planning::surface;
use vantage::planning::visibility::{self, Occluders};

/// Triangles of the parts.
const TRIANGLES: [usize; 2] = [20_000, 70_000];

fn engine(c: &mut Criterion) {
    let (scanner, params, cancel) = (rig::scanner(), PlanParams::default(), AtomicBool::new(false));
    let views = rig::views(&scanner);
    let usable = vec![true; views.len()];
    let mut group = c.benchmark_group("default engine, four viewpoints");
    for triangles in TRIANGLES {
        let mesh = meshes::lobed(triangles);
        let surface = surface::sample(&mesh, &params.part, &params.regions, params.seed).expect("not too many samples");
        let occluders = Occluders::new([&mesh]);
        group.bench_function(BenchmarkId::from_parameter(mesh.faces.len()), |b| {
            let ctx = Context::new(&cancel, &Silent);
            b.iter(|| visibility::cast(&surface, &views, &usable, &scanner, &occluders, &params, &ctx).expect("not cancelled"));
        });
    }
    group.finish();
}

criterion_group!(benches, engine);
criterion_main!(benches);
