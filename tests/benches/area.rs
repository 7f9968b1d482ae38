//! Measured area of the surface, against dense sampling that shares nothing with the engine but the definition in
//! `vantage::planning::method::visibility`: other points (independent uniform ones, 128 a triangle below 200 000 triangles, else
//! 16, and four million more by area), the definition written out again, and Embree's robust rays for what hides. On every public
//! mesh below a million triangles, scaled to 120 mm, from the four viewpoints of the rig.

use std::fs;
use std::io::Read as _;
use std::path::Path;

use nalgebra::Point3;
use rayon::prelude::*;
use vantage::cell::{PerDevice, Scanner};
use vantage::geometry::mesh_io::{self, Limits};
use vantage::geometry::{LengthUnit, Mesh, Part as PartFrame, Pose, ScannerFrame, SimdLevel};

use crate::Bench;
use crate::embree::EmbreeScene;
use crate::engine::Ready;
use crate::meshes::{centred_and_scaled, lobed};
use crate::packets::END;
use crate::report::{Demand, Report, number};
use crate::rig::{Eye, eyes, views};

/// Meshes of this size and above are left out.
const LARGEST: usize = 1_000_000;
/// Below this many triangles the dense sampling takes [`DENSE`] points a triangle, else [`SPARSE`].
const SMALL: usize = 200_000;
const DENSE: usize = 128;
const SPARSE: usize = 16;
/// Further points, shared out by area, so that large triangles are known as well as the others.
const POINTS: f64 = 4e6;
/// Samples of the engine beside what it takes by default: a triangle on average, and on a mesh at least.
const SAMPLES: f64 = 4.0;
const LEAST_SAMPLES: f64 = 400_000.0;
/// Triangles that a thread takes at a time.
const TASK: usize = 1024;

/// Compares on every mesh.
pub(crate) fn section(bench: &mut Bench, quick: bool) {
    bench.report.section("Measured area against dense independent samples");
    let embree = match &bench.embree {
        Ok(embree) => embree,
        Err(reason) => return bench.report.say(reason),
    };
    let (views, mut rows, mut worst) = (views(&bench.scanner), Vec::new(), [0.0_f64; 2]);
    for (name, mesh) in if quick { vec![("lobed sphere".into(), lobed(20_000))] } else { public(&mut bench.report) } {
        let scene = embree.scene(&mesh, true);
        let more = SAMPLES.max(LEAST_SAMPLES / mesh.faces.len() as f64);
        let ready = [None, Some(more)].map(|samples| Ready::new(&mesh, samples));
        let [mut dense_mm2, mut by_default_mm2, mut by_more_mm2] = [0.0; 3];
        bench.pools.of(2).install(|| {
            dense_mm2 = views.iter().map(|view| dense_area_mm2(&mesh, &scene, &bench.scanner, view)).sum();
            [by_default_mm2, by_more_mm2] = ready.each_ref().map(|ready| measured_mm2(ready, &bench.scanner, &views));
        });
        let errors = [by_default_mm2, by_more_mm2].map(|area_mm2| (area_mm2 / dense_mm2 - 1.0) * 100.0);
        worst = [0, 1].map(|i| worst[i].max(errors[i].abs()));
        rows.push(vec![name, mesh.faces.len().to_string(), number(errors[0]), number(errors[1])]);
    }
    let header = ["mesh", "triangles", "samples by default, error %", "at least 4 a triangle and 400 000, error %"];
    bench.report.table(&header, &rows);
    for (samples, worst) in ["samples by default", "at least 4 samples a triangle"].iter().zip(worst) {
        let what = format!("area against dense samples, worst mesh, {samples}");
        bench.report.figure(what, Demand::below(0.2, 0.05, " %"), worst);
    }
}

/// The public meshes that this program reads; those it does not are named.
fn public(report: &mut Report) -> Vec<(String, Mesh)> {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/data/meshes"));
    let Ok(entries) = fs::read_dir(folder) else {
        report.say("The folder ../shared/data is absent: a generated part alone.");
        return vec![("lobed sphere".into(), lobed(100_000))];
    };
    let mut files: Vec<_> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    files.sort();
    let (mut meshes, mut others) = (Vec::new(), Vec::new());
    for file in files {
        let name = file.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        match mesh_io::read(&unpacked(&file), Some(LengthUnit::Millimetre), &Limits::default()) {
            Ok(read) if read.mesh.faces.len() < LARGEST => meshes.push((name, centred_and_scaled(read.mesh))),
            Ok(_) | Err(_) => others.push(name),
        }
    }
    report.say(format!("Not read, of another format: {}.", others.join(", ")));
    meshes
}

fn unpacked(file: &Path) -> Vec<u8> {
    let bytes = fs::read(file).expect("readable");
    if file.extension().is_none_or(|extension| extension != "gz") {
        return bytes;
    }
    let mut unpacked = Vec::new();
    flate2::read::GzDecoder::new(&bytes[..]).read_to_end(&mut unpacked).expect("gzip");
    unpacked
}

/// Summed over the views.
fn measured_mm2(ready: &Ready, scanner: &Scanner, views: &[Pose<PartFrame, ScannerFrame>]) -> f64 {
    let table = ready.cast(scanner, views, SimdLevel::widest());
    table.rows.iter().flat_map(|row| row.samples()).map(|sample| ready.surface.sample_area_mm2(sample)).sum()
}

fn dense_area_mm2(mesh: &Mesh, scene: &EmbreeScene, scanner: &Scanner, view: &Pose<PartFrame, ScannerFrame>) -> f64 {
    let (least, per_mm2) = (if mesh.faces.len() < SMALL { DENSE } else { SPARSE }, POINTS / mesh.area_mm2());
    let judge = Judge { scanner, eyes: eyes(scanner, view), scanner_from_part: view.inverse() };
    let tasks: Vec<f64> = (0..mesh.faces.len())
        .into_par_iter()
        .step_by(TASK)
        .map(|first| {
            let (mut points, mut areas_mm2) = (Vec::new(), Vec::new());
            for face in first..(first + TASK).min(mesh.faces.len()) {
                let area_mm2 = mesh.face_area_mm2(face);
                let each = least + (area_mm2 * per_mm2) as usize;
                judge.push_candidates(mesh, face, each, &mut points);
                areas_mm2.resize(points.len(), area_mm2 / each as f64);
            }
            judge.visible(scene, points).zip(areas_mm2).filter(|(seen, _)| *seen).map(|(_, area_mm2)| area_mm2).sum()
        })
        .collect();
    tasks.iter().sum()
}

/// The definition in `vantage::planning::method::visibility` for one viewpoint.
struct Judge<'a> {
    scanner: &'a Scanner,
    eyes: PerDevice<Eye>,
    scanner_from_part: Pose<ScannerFrame, PartFrame>,
}

impl Judge<'_> {
    /// Appends those of `each` random points of a face that only a shadow can keep from being measured.
    fn push_candidates(&self, mesh: &Mesh, face: usize, each: usize, points: &mut Vec<Point3<f64>>) {
        let ([a, b, c], normal) = (mesh.corners(face), mesh.scaled_normal(face).normalize());
        if self.eyes.iter().any(|eye| normal.dot(&(eye.centre_mm - a)) <= 0.0) {
            return;
        }
        let mut random = Random::of(face);
        points.extend((0..each).filter_map(|_| {
            let [mut s, mut t] = [random.next(), random.next()];
            if s + t > 1.0 {
                (s, t) = (1.0 - s, 1.0 - t);
            }
            let p = a + (b - a) * s + (c - a) * t;
            let depth_mm = self.scanner_from_part.point(&p).z;
            let in_depth = self.scanner.near_mm <= depth_mm && depth_mm <= self.scanner.far_mm;
            let by_all = self.eyes.iter().zip(&self.scanner.devices).all(|(eye, device)| {
                let incidence_rad = (eye.centre_mm - p).angle(&normal);
                incidence_rad <= device.incidence_max_rad && eye.lens.project(&(eye.device_from_part * p)).is_some()
            });
            (in_depth && by_all).then_some(p)
        }));
    }

    /// Tells for each point whether it is hidden from no device.
    fn visible(&self, scene: &EmbreeScene, points: Vec<Point3<f64>>) -> impl Iterator<Item = bool> {
        let mut seen = vec![true; points.len()];
        let mut blocked = vec![false; points.len()];
        for eye in &self.eyes {
            let directions: Vec<_> = points.iter().map(|p| (p - eye.centre_mm).map(|x| x as f32).into()).collect();
            scene.blocked(eye.centre_mm.map(|x| x as f32).into(), &directions, END, &mut blocked);
            seen.iter_mut().zip(&blocked).for_each(|(seen, blocked)| *seen &= !blocked);
        }
        seen.into_iter()
    }
}

/// Numbers from 0 to 1: xorshift64* (Vigna 2016).
struct Random(u64);

impl Random {
    fn of(face: usize) -> Self {
        Self((face as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    fn next(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64
    }
}
