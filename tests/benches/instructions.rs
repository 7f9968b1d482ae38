//! Instructions of the hot kernels, counted by valgrind's callgrind: the same on every run to about one in a million, so
//! that a change of a few per cent shows where times do not. valgrind knows no AVX-512, so AVX2 is the widest level.
//!
//! Each kernel runs in a process of its own, once and twice; the difference is one run without what prepares it.

use std::hint::black_box;
use std::process::Command;

use nalgebra::Vector3;
use rayon::ThreadPoolBuilder;
use vantage::cell::{PerDevice, Scanner};
use vantage::geometry::{Mesh, RayScene, SimdLevel};

use crate::engine::Ready;
use crate::meshes::lobed;
use crate::packets::END;
use crate::report::{Report, number};
use crate::rig::{eyes, scanner, views};

/// Argument that makes this program run a kernel and nothing else.
pub(crate) const WORD: &str = "kernel";

/// Triangles of the part.
const TRIANGLES: usize = 20_000;
/// Levels that valgrind knows.
const LEVELS: [&str; 2] = ["portable", "avx2"];
const KERNELS: [(&str, Kernel); 4] = [
    ("any-hit rays", any_hit_rays),
    ("first-hit rays", first_hit_rays),
    ("default engine, one viewpoint", one_view),
    ("raster alone, one full-resolution viewpoint", one_pixel_set),
];

type Kernel = fn(&Scene, SimdLevel);

/// Data that kernels run on.
struct Scene {
    scanner: Scanner,
    mesh: Mesh,
    rays: RayScene,
    ready: Ready,
}

/// Counts all kernels.
pub(crate) fn section(report: &mut Report) {
    report.section(format!("Instructions, lobed sphere of about {TRIANGLES} triangles"));
    report.say("Counted by `valgrind --tool=callgrind`; again with `cargo bench-peers instructions`.");
    let rows: Vec<_> = KERNELS
        .iter()
        .flat_map(|(name, _)| LEVELS.map(|level| (*name, level)))
        .map(|(name, level)| {
            let count = count(name, level).map_or_else(|reason| reason, |count| number(count as f64 / 1e6));
            vec![name.into(), level.into(), count]
        })
        .collect();
    report.table(&["kernel", "level", "million instructions"], &rows);
}

/// Runs a kernel a number of times: what [`section`] has counted in a process of its own.
pub(crate) fn run(kernel: &str, level: &str, times: &str) {
    let (_, kernel) = KERNELS.iter().find(|(name, _)| *name == kernel).expect("a kernel");
    let level = SimdLevel::available().into_iter().find(|known| known.as_str() == level).expect("a level of this CPU");
    // A pool of this thread alone: what other threads do while they wait differs from run to run.
    let pool = ThreadPoolBuilder::new().num_threads(1).use_current_thread().build().expect("no thread is started");
    let mesh = lobed(TRIANGLES);
    let scene = Scene { scanner: scanner(), rays: RayScene::new([&mesh]), ready: Ready::new(&mesh, None), mesh };
    pool.install(|| (0..times.parse().expect("a number")).for_each(|_: u32| kernel(&scene, level)));
}

/// Instructions of one run; or why there is no count.
fn count(kernel: &str, level: &str) -> Result<u64, String> {
    let program = std::env::current_exe().map_err(|error| error.to_string())?;
    let counted = |times: &str| -> Result<u64, String> {
        let output = Command::new("valgrind")
            .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
            .arg(&program)
            .args([WORD, kernel, level, times])
            .output()
            .map_err(|_| "valgrind is not installed".to_owned())?;
        let said = String::from_utf8_lossy(&output.stderr);
        if said.contains("unhandled instruction") {
            return Err("this valgrind does not know one of its instructions".into());
        }
        let collected = said.lines().find_map(|line| line.split_once("Collected : ")).map(|(_, count)| count.trim().parse());
        collected.and_then(Result::ok).filter(|_| output.status.success()).ok_or_else(|| "valgrind cannot run it".to_owned())
    };
    Ok(counted("2")? - counted("1")?)
}

/// Casts any-hit rays from the projector to the middle of every triangle.
fn any_hit_rays(scene: &Scene, level: SimdLevel) {
    let PerDevice { projector, .. } = eyes(&scene.scanner, &views(&scene.scanner)[0]);
    let middle = |face: usize| scene.mesh.corners(face).iter().map(|corner| corner.coords / 3.0).sum::<Vector3<f64>>().into();
    let middles: Vec<_> = (0..scene.mesh.faces.len()).map(middle).collect();
    let mut blocked = Vec::new();
    scene.rays.blocked_from(level, &projector.centre_mm, &middles, f64::from(END), &mut blocked);
    black_box(blocked);
}

/// Through every sixteenth pixel of the left camera that can show the part, each way.
fn first_hit_rays(scene: &Scene, level: SimdLevel) {
    let PerDevice { left, .. } = eyes(&scene.scanner, &views(&scene.scanner)[0]);
    let pixels = left.scissor(&scene.mesh).pixels().step_by(256);
    let directions: Vec<_> = pixels.map(|(u, v)| Vector3::from(left.ray(u, v)).map(f64::from)).collect();
    let mut hits = Vec::new();
    scene.rays.first_hits_from(level, &left.centre_mm, &directions, &mut hits);
    black_box(hits);
}

/// The default engine from one viewpoint.
fn one_view(scene: &Scene, level: SimdLevel) {
    black_box(scene.ready.cast(&scene.scanner, &views(&scene.scanner)[..1], level));
}

/// All pixels from one viewpoint, drawn.
fn one_pixel_set(scene: &Scene, level: SimdLevel) {
    black_box(scene.ready.pixel_set(&scene.scanner, &views(&scene.scanner)[0], level));
}
