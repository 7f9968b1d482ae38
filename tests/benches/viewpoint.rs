//! A whole viewpoint at full resolution, as the thesis casts it: which triangles does each of three devices of
//! 4000 × 3036 pixels meet with the ray of at least one pixel? The rasteriser answers without rays; Open3D makes, casts
//! and reduces all 36.4 million, as its users do; Embree's packets get only the pixels that can show the part, which
//! answers the same.

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;
use vantage::cell::PerDevice;
use vantage::geometry::{Mesh, Part as PartFrame, Pose, ScannerFrame, SimdLevel};

use crate::Bench;
use crate::embree::{EmbreeScene, NO_FACE};
use crate::engine::Ready;
use crate::measure::{Contestant, Cost, cost, race};
use crate::meshes::{Part, Size};
use crate::report::{Demand, Good, Report, ms, number};
use crate::rig::{self, Eye, PixelBox};

/// Rows of pixels that a thread takes at a time.
const BAND: u32 = 16;

/// Triangles that each device meets.
type Seen = PerDevice<Vec<bool>>;

/// Bits of the devices in a pixel set.
const BITS: PerDevice<u32> = PerDevice { left: 0, right: 1, projector: 2 };

/// The devices of one viewpoint.
type Eyes = PerDevice<Eye>;

/// Everyone takes all viewpoints in turn. Gives Open3D's wall seconds a viewpoint.
pub(crate) fn section(bench: &mut Bench, part: &Part) -> Option<f64> {
    let poses = rig::views(&bench.scanner);
    let views: Vec<_> = poses.iter().map(|view| rig::eyes(&bench.scanner, view)).collect();
    let ready = Ready::new(&part.mesh, None);
    let robust = bench.embree.as_ref().map(|embree| embree.scene(&part.mesh, true)).map_err(String::clone);
    let steps = RefCell::new([0.0; 3]);
    let mut field: Vec<(String, usize, Contestant<'_>)> = Vec::new();
    let widest = SimdLevel::widest();
    let levels = SimdLevel::available().into_iter().rev().map(|level| (level, 2));
    for (level, threads) in levels.chain([(widest, 1)]) {
        let contestant = with_raster(bench, &ready, &poses, level, threads);
        field.push((format!("Vantage, {}", level.as_str()), threads, contestant));
    }
    for threads in [2, 1] {
        let contestant = with_packets(bench, robust.as_ref(), &views, &part.mesh, threads);
        field.push(("Embree 3.13, 16 wide, robust, scissored".into(), threads, contestant));
    }
    field.push(("Open3D, all pixels".into(), 2, with_open3d(bench, &views, &part.mesh, &steps)));
    let (labels, contestants): (Vec<_>, Vec<_>) = field.into_iter().map(|(label, threads, run)| ((label, threads), run)).unzip();
    let medians = race(bench.rounds, contestants);

    bench.report.section(format!("Full-resolution viewpoint: {}", part.title));
    let open3d = medians.last().and_then(|median| median.as_ref().ok()).map(|cost| cost.wall_s);
    let rows = labels.into_iter().zip(&medians).map(|((label, threads), median)| {
        let cells = match median {
            Ok(cost) => [ms(cost.wall_s), ms(cost.cpu_s), open3d.map_or_else(String::new, |o| number(o / cost.wall_s))],
            Err(reason) => [reason.clone(), String::new(), String::new()],
        };
        [label, threads.to_string()].into_iter().chain(cells).collect()
    });
    let rows: Vec<_> = rows.collect();
    bench.report.table(&["engine", "threads", "wall, ms", "CPU, ms", "times as fast as Open3D"], &rows);
    if open3d.is_some() {
        let [generate, cast, reduce] = steps.into_inner().map(ms);
        let text =
            format!("Of Open3D's wall time {generate} ms make the rays, {cast} ms cast them, {reduce} ms reduce the hits.");
        bench.report.say(text);
    }
    if let (Ok(two), Some(size)) = (&medians[0], part.size) {
        figures(&mut bench.report, size, two.wall_s, open3d);
    }
    if let Ok(scene) = &robust {
        agreement(bench, scene, &ready, part);
    }
    open3d
}

fn figures(report: &mut Report, size: Size, wall_s: f64, open3d_s: Option<f64>) {
    let ((times, times_aim), (most_ms, ms_aim)) = match size {
        Size::Coarse => ((100.0, 300.0), (10.0, 4.0)),
        Size::Dense => ((25.0, 60.0), (55.0, 25.0)),
        Size::Middle => return,
    };
    let (what, size) = ("full-resolution viewpoint, raster alone", size.as_str());
    if let Some(open3d_s) = open3d_s {
        report.figure(format!("{what}, against Open3D, {size}"), Demand::above(times, times_aim, " ×"), open3d_s / wall_s);
    }
    report.figure(format!("{what}, {size}"), Demand::below(most_ms, ms_aim, " ms"), wall_s * 1e3);
}

fn with_raster<'a>(
    bench: &'a Bench,
    ready: &'a Ready,
    poses: &'a [Pose<PartFrame, ScannerFrame>],
    level: SimdLevel,
    threads: usize,
) -> Contestant<'a> {
    let (scanner, pool) = (&bench.scanner, bench.pools.of(threads));
    Ok(Box::new(move || {
        let all = || poses.iter().for_each(|pose| drop(ready.pixel_set(scanner, pose, level)));
        cost(|| pool.install(all)).1.over(poses.len())
    }))
}

fn with_packets<'a>(
    bench: &'a Bench,
    scene: Result<&'a EmbreeScene, &String>,
    views: &'a [Eyes],
    mesh: &'a Mesh,
    threads: usize,
) -> Contestant<'a> {
    let (scene, pool) = (scene.map_err(String::clone)?, bench.pools.of(threads));
    Ok(Box::new(move || {
        let all = || views.iter().for_each(|eyes| drop(packets_see(scene, eyes, mesh)));
        cost(|| pool.install(all)).1.over(views.len())
    }))
}

/// `steps` are the wall seconds a viewpoint of making, casting and reducing in the last round.
fn with_open3d<'a>(bench: &'a Bench, views: &'a [Eyes], mesh: &'a Mesh, steps: &'a RefCell<[f64; 3]>) -> Contestant<'a> {
    let python = bench.python.as_ref().map_err(String::clone)?;
    Ok(Box::new(move || {
        let (mut whole, mut sums) = (Cost::default(), [0.0; 3]);
        for eyes in views {
            let (cost, _) = python.borrow_mut().viewpoint(eyes, mesh.faces.len(), 2);
            whole = whole + cost.whole;
            sums = [0, 1, 2].map(|step| sums[step] + cost.steps_wall_s[step] / views.len() as f64);
        }
        *steps.borrow_mut() = sums;
        whole.over(views.len())
    }))
}

/// Triangles that Embree's packets meet, computed on the pool that this runs in.
fn packets_see(scene: &EmbreeScene, eyes: &Eyes, mesh: &Mesh) -> Seen {
    eyes.as_ref().map(|eye| {
        let seen: Vec<_> = mesh.faces.iter().map(|_| AtomicBool::new(false)).collect();
        let PixelBox { columns, rows: [top, bottom] } = eye.scissor(mesh);
        let origin = eye.centre_mm.map(|x| x as f32).into();
        (top..bottom).into_par_iter().step_by(BAND as usize).for_each(|row| {
            let band = PixelBox { columns, rows: [row, (row + BAND).min(bottom)] };
            let directions: Vec<_> = band.pixels().map(|(column, row)| eye.ray(column, row)).collect();
            let mut faces = vec![NO_FACE; directions.len()];
            scene.first_faces(origin, &directions, &mut faces);
            for face in faces.iter().filter(|face| **face != NO_FACE) {
                seen[*face as usize].store(true, Ordering::Relaxed);
            }
        });
        seen.into_iter().map(AtomicBool::into_inner).collect()
    })
}

/// Distance of the others' answers from those of Embree's robust packets, over all viewpoints.
fn agreement(bench: &mut Bench, scene: &EmbreeScene, ready: &Ready, part: &Part) {
    let [mut ours, mut open3d] = [(); 2].map(|()| Difference::default());
    for pose in rig::views(&bench.scanner) {
        let eyes = rig::eyes(&bench.scanner, &pose);
        let expected = bench.pools.of(2).install(|| packets_see(scene, &eyes, &part.mesh));
        let bits = bench.pools.of(2).install(|| ready.pixel_set(&bench.scanner, &pose, SimdLevel::widest()));
        ours.add(&expected, &BITS.map(|bit| bits.iter().map(|bits| bits >> bit & 1 == 1).collect()));
        if let Ok(python) = &bench.python {
            open3d.add(&expected, &python.borrow_mut().viewpoint(&eyes, part.mesh.faces.len(), 2).1);
        }
    }
    bench.report.say("Triangles seen by one and not by Embree's robust packets, or the other way round:");
    let mut rows = vec![ours.row("Vantage")];
    rows.extend(bench.python.is_ok().then(|| open3d.row("Open3D")));
    bench.report.table(&["", "by a device, of the mesh, %", "by all three, of those so seen, %"], &rows);
    if let Some(size) = part.size {
        let demand = Demand { good: Good::Below, least: 0.05, aim: None, unit: " %" };
        bench.report.figure(format!("pixel set against Embree robust, {}", size.as_str()), demand, percent(ours.by_device));
    }
}

/// Triangles that two answers differ on, over devices and viewpoints.
#[derive(Default)]
struct Difference {
    by_device: [usize; 2],
    by_all: [usize; 2],
}

impl Difference {
    fn add(&mut self, expected: &Seen, found: &Seen) {
        for (expected, found) in expected.iter().zip(found) {
            self.by_device[0] += expected.iter().zip(found).filter(|(a, b)| a != b).count();
            self.by_device[1] += expected.len();
        }
        let by_all = |seen: &Seen, face: usize| seen.iter().all(|seen| seen[face]);
        for face in 0..expected.left.len() {
            let (a, b) = (by_all(expected, face), by_all(found, face));
            self.by_all[0] += usize::from(a != b);
            self.by_all[1] += usize::from(a || b);
        }
    }

    fn row(&self, label: &str) -> Vec<String> {
        vec![label.into(), number(percent(self.by_device)), number(percent(self.by_all))]
    }
}

fn percent([part, whole]: [usize; 2]) -> f64 {
    part as f64 * 100.0 / whole.max(1) as f64
}
