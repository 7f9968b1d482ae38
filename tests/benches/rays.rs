//! Rays a second through a [`RayScene`]: pixels of a 12-megapixel device, the points they meet joined with a second
//! device, one sample a triangle joined with its device; at every level of vector instructions, on one thread and on all;
//! single segments in f64 beside them. `cargo bench --bench rays`; the rate is criterion's `thrpt`.

use std::fs;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use vantage::geometry::demo_parts::{base, figurine};
use vantage::geometry::mesh_io::{Limits, read};
use vantage::geometry::{Hit, LengthUnit, Mesh, RayScene, SimdLevel};

const BUNNY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/meshes/bunny_69k_binary.stl");
const DISTANCE_MM: f64 = 480.0;
const FOCAL_LENGTH_PX: f64 = 6667.0;
/// Every row would be nine megapixels of the same.
const ROW_STEP: f64 = 3.0;
const SHARE: f64 = 1.0 - 3e-3 / DISTANCE_MM;
/// Rays a task on more than one thread.
const CHUNK: usize = 4096;

fn parts() -> Vec<(&'static str, Mesh)> {
    let mut parts = vec![
        ("base_100k", base(100_000).expect("a demo part")),
        ("figurine_100k", figurine(100_000).expect("a demo part")),
        ("figurine_1M", figurine(1_000_000).expect("a demo part")),
    ];
    if let Ok(bytes) = fs::read(BUNNY) {
        let mut bunny = read(&bytes, Some(LengthUnit::Millimetre), &Limits::default()).expect("a sound file").mesh;
        let scale = 120.0 / bunny.aabb().extent_mm().max();
        bunny.vertices_mm.iter_mut().for_each(|p| *p *= scale);
        parts.push(("bunny_70k", bunny));
    }
    parts
}

/// Two devices beside each other that look at the middle of a part.
struct Rig {
    projector: Point3<f64>,
    camera: Point3<f64>,
    forward: Vector3<f64>,
    right: Vector3<f64>,
    up: Vector3<f64>,
}

impl Rig {
    fn before(mesh: &Mesh) -> Self {
        let forward = Vector3::new(-0.45, -0.6, -0.66).normalize();
        let right = forward.cross(&Vector3::z()).normalize();
        let projector = mesh.aabb().centre() - forward * DISTANCE_MM;
        Self { projector, camera: projector + right * 100.0, forward, right, up: right.cross(&forward) }
    }

    /// Through the pixels that the part's outline may fill, row by row.
    fn pixels(&self, mesh: &Mesh) -> Vec<Vector3<f64>> {
        let pixel = |p: &Point3<f64>| {
            let d = p - self.projector;
            [d.dot(&self.right), d.dot(&self.up)].map(|x| FOCAL_LENGTH_PX * x / d.dot(&self.forward))
        };
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for [x, y] in mesh.vertices_mm.iter().map(pixel) {
            low = [low[0].min(x), low[1].min(y)];
            high = [high[0].max(x), high[1].max(y)];
        }
        let (columns, rows) = ((high[0] - low[0]) as usize, ((high[1] - low[1]) / ROW_STEP) as usize);
        let ray = |row: usize, column: usize| {
            let (x, y) = (low[0] + column as f64 + 0.5, low[1] + ROW_STEP * row as f64 + 0.5);
            (self.forward + (self.right * x + self.up * y) / FOCAL_LENGTH_PX) * DISTANCE_MM
        };
        (0..rows).flat_map(|row| (0..columns).map(move |column| ray(row, column))).collect()
    }

    /// A point of each triangle that the projector sees at less than 85°.
    fn samples(&self, mesh: &Mesh) -> Vec<Point3<f64>> {
        let least_cosine = 85.0_f64.to_radians().cos();
        let faces = (0..mesh.faces.len()).map(|face| (mesh.corners(face), mesh.scaled_normal(face).normalize()));
        let samples = faces.map(|([a, b, c], normal)| (a + (b - a) * 0.35 + (c - a) * 0.25, normal));
        samples.filter(|(p, n)| n.dot(&(self.projector - p).normalize()) > least_cosine).map(|(p, _)| p).collect()
    }
}

fn first_hits(scene: &RayScene, level: SimdLevel, origin: &Point3<f64>, directions: &[Vector3<f64>]) -> Vec<Option<Hit>> {
    let mut hits = Vec::new();
    scene.first_hits_from(level, origin, directions, &mut hits);
    hits
}

fn blocked(scene: &RayScene, level: SimdLevel, origin: &Point3<f64>, targets: &[Point3<f64>]) -> Vec<bool> {
    let mut blocked = Vec::new();
    scene.blocked_from(level, origin, targets, SHARE, &mut blocked);
    blocked
}

fn packets(criterion: &mut Criterion) {
    for (name, mesh) in parts() {
        let (scene, rig) = (RayScene::new([&mesh]), Rig::before(&mesh));
        let pixels = rig.pixels(&mesh);
        let hits = first_hits(&scene, SimdLevel::widest(), &rig.projector, &pixels);
        let met = pixels.iter().zip(hits).filter_map(|(ray, hit)| Some(rig.projector + ray * hit?.share));
        let (met, samples): (Vec<_>, _) = (met.collect(), rig.samples(&mesh));
        let mut group = criterion.benchmark_group(name);
        group.sample_size(10);
        for level in SimdLevel::available() {
            group.throughput(Throughput::Elements(pixels.len() as u64));
            let primary = |rays: &[Vector3<f64>]| first_hits(&scene, level, &rig.projector, rays);
            group.bench_function(format!("primary/{}", level.as_str()), |b| b.iter(|| primary(&pixels)));
            for (kind, origin, targets) in [("shadow", &rig.camera, &met), ("sample", &rig.projector, &samples)] {
                group.throughput(Throughput::Elements(targets.len() as u64));
                let any = |targets: &[Point3<f64>]| blocked(&scene, level, origin, targets);
                group.bench_function(format!("{kind}/{}", level.as_str()), |b| b.iter(|| any(targets)));
            }
        }
        let level = SimdLevel::widest();
        group.throughput(Throughput::Elements(pixels.len() as u64));
        let primary = |rays: &[Vector3<f64>]| first_hits(&scene, level, &rig.projector, rays).len();
        group.bench_function("primary/all_threads", |b| b.iter(|| pixels.par_chunks(CHUNK).map(primary).sum::<usize>()));
        group.throughput(Throughput::Elements(met.len() as u64));
        let any = |targets: &[Point3<f64>]| blocked(&scene, level, &rig.camera, targets).len();
        group.bench_function("shadow/all_threads", |b| b.iter(|| met.par_chunks(CHUNK).map(any).sum::<usize>()));
        let one_by_one = &samples[..samples.len().min(20_000)];
        group.throughput(Throughput::Elements(one_by_one.len() as u64));
        let single = |target: &&Point3<f64>| scene.blocked(&rig.projector, target, SHARE);
        group.bench_function("sample/single_f64", |b| b.iter(|| one_by_one.iter().filter(single).count()));
    }
}

fn build(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("build");
    group.sample_size(10);
    for (name, mesh) in parts() {
        group.throughput(Throughput::Elements(mesh.faces.len() as u64));
        group.bench_function(name, |b| b.iter(|| RayScene::new([&mesh]).size_bytes()));
    }
}

criterion_group!(benches, build, packets);
criterion_main!(benches);
