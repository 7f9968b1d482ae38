//! `cargo bench --bench visibility`: the kernels of visibility on a generated part, for whoever changes them. Fixed part,
//! fixed viewpoints, no peers; criterion keeps the last run and says what changed.

#[expect(dead_code, reason = "shared with the comparison, which uses all of it")]
mod meshes;
#[expect(dead_code, reason = "shared with the comparison, which uses all of it")]
mod rig;

use std::hint::black_box;
use std::sync::atomic::AtomicBool;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::Point3;
use vantage::geometry::RayScene;
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::PlanParams;
use vantage::planning::surface;
use vantage::planning::visibility::{self, Occluders};

/// Triangles of the parts.
const TRIANGLES: [usize; 2] = [20_000, 70_000];

fn rays(c: &mut Criterion) {
    let scanner = rig::scanner();
    let [_, _, projector] = rig::eyes(&scanner, &rig::views(&scanner)[0]);
    let mut group = c.benchmark_group("any-hit rays, one at a time");
    for triangles in TRIANGLES {
        let mesh = meshes::lobed(triangles);
        let scene = RayScene::new([&mesh]);
        let middle = |face: usize| {
            Point3::from(mesh.corners(face).map(|corner| corner.coords).iter().sum::<nalgebra::Vector3<f64>>() / 3.0)
        };
        let targets: Vec<_> = (0..mesh.faces.len()).map(middle).collect();
        group.throughput(Throughput::Elements(targets.len() as u64));
        group.bench_function(BenchmarkId::from_parameter(mesh.faces.len()), |b| {
            b.iter(|| targets.iter().filter(|p| scene.blocked(&projector.centre_mm, black_box(p), 1.0 - 1e-5)).count());
        });
    }
    group.finish();
}

fn engine(c: &mut Criterion) {
    let (scanner, params, cancel) = (rig::scanner(), PlanParams::default(), AtomicBool::new(false));
    let views = rig::views(&scanner);
    let mut group = c.benchmark_group("default engine, four viewpoints");
    for triangles in TRIANGLES {
        let mesh = meshes::lobed(triangles);
        let surface = surface::sample(&mesh, &params.part, &params.regions, params.seed).expect("not too many samples");
        let occluders = Occluders::new([&mesh]);
        group.bench_function(BenchmarkId::from_parameter(mesh.faces.len()), |b| {
            let ctx = Context::new(&cancel, &Silent);
            b.iter(|| visibility::cast(&surface, &views, &scanner, &occluders, &params, &ctx).expect("not cancelled"));
        });
    }
    group.finish();
}

criterion_group!(benches, rays, engine);
criterion_main!(benches);
