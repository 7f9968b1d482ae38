//! Whole plans, made by the program as its users start it, in a process of its own: what visibility took, and how much
//! memory the process needed at most.

use std::fs;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use serde_json::Value;
use vantage::geometry::Mesh;

use crate::Bench;
use crate::meshes::{Part, Size, lobed};
use crate::report::{Demand, ms, number};

/// Triangles of the largest part that must be planned on this machine.
const LARGEST: usize = 5_000_000;
/// The thesis's candidates, 54 around one block: what all figures so far were measured with.
const THESIS: [&str; 2] = ["candidates.strategies=[\"ellipsoid\"]", "candidates.rolls_deg=[0]"];
/// Steps that give about a hundred of them.
const HUNDRED: [&str; 4] = [THESIS[0], THESIS[1], "candidates.step_small_deg=22.5", "candidates.step_large_deg=30"];

/// Interval at which the process is asked what it has needed so far; the high-water mark of its last moments may be missed.
const ASK_EVERY: Duration = Duration::from_millis(20);

/// Result of a plan.
struct Planned {
    /// Viewpoints whose visibility was computed.
    candidates: u64,
    /// Wall seconds of the visibility stage, on all cores.
    visibility_s: f64,
    /// Wall seconds of all stages.
    all_s: f64,
    /// Most memory that the process held, bytes.
    peak_bytes: u64,
}

/// The visibility of a plan as it comes, a candidate, beside Open3D's pixel rays of one viewpoint.
pub(crate) fn section(bench: &mut Bench, part: &Part, open3d_s: Option<f64>) {
    bench.report.section(format!("Visibility of a whole plan: {}", part.title));
    let mut runs = Vec::new();
    for _ in 0..bench.rounds {
        match plan(&part.mesh, &THESIS) {
            Ok(planned) => runs.push(planned),
            Err(reason) => return bench.report.say(reason),
        }
    }
    runs.sort_by(|a, b| a.visibility_s.total_cmp(&b.visibility_s));
    let median = &runs[runs.len() / 2];
    let view_s = median.visibility_s / median.candidates as f64;
    let cells = vec![
        median.candidates.to_string(),
        number(median.visibility_s),
        ms(view_s),
        open3d_s.map_or_else(|| "not measured in this run".into(), |open3d_s| number(open3d_s / view_s)),
        number(median.all_s),
    ];
    let header = ["candidates", "visibility, s", "a candidate, ms", "times as fast as Open3D's viewpoint", "all stages, s"];
    bench.report.table(&header, &[cells]);
    let demand = match part.size {
        Some(Size::Coarse) => Demand::above(100.0, 200.0, " ×"),
        Some(Size::Dense) => Demand::above(12.0, 30.0, " ×"),
        Some(Size::Middle) | None => return,
    };
    let (Some(open3d_s), Some(size)) = (open3d_s, part.size) else { return };
    bench.report.figure(format!("a view of a plan against Open3D's, {}", size.as_str()), demand, open3d_s / view_s);
}

/// The largest part.
pub(crate) fn memory_section(bench: &mut Bench, quick: bool) {
    let mesh = lobed(if quick { LARGEST / 50 } else { LARGEST });
    bench.report.section(format!("Memory: lobed sphere, {} triangles", mesh.faces.len()));
    match plan(&mesh, &HUNDRED) {
        Ok(planned) => {
            let gib = planned.peak_bytes as f64 / f64::from(1 << 30);
            let cells = [planned.candidates.to_string(), number(gib), number(planned.visibility_s), number(planned.all_s)];
            bench.report.table(&["candidates", "peak, GiB", "visibility, s", "all stages, s"], &[cells.into()]);
            bench.report.figure("peak memory, 5 M triangles, 100 candidates", Demand::below(8.0, 3.0, " GiB"), gib);
        }
        Err(reason) => bench.report.say(reason),
    }
}

/// Plans viewpoints for `mesh`, without a cell, with the nominal scanner.
///
/// # Errors
/// Output of the program, if it fails.
fn plan(mesh: &Mesh, sets: &[&str]) -> Result<Planned, String> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/target/bench-peers"));
    let (part, out) = (folder.join("part.ply"), folder.join("plan"));
    fs::create_dir_all(&folder).map_err(|error| error.to_string())?;
    write_ply(&part, mesh).map_err(|error| error.to_string())?;
    let mut command = Command::new(env!("CARGO_BIN_EXE_vantage"));
    command.arg("plan").arg(&part).args(["--unit", "mm", "--cell", "none", "--scanner", "transcan-c-nominal"]);
    command.args(sets.iter().flat_map(|set| ["--set", set])).arg("--out").arg(&out);
    let mut process = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().map_err(|error| error.to_string())?;
    let mut peak_bytes = 0;
    let status = loop {
        peak_bytes = peak_bytes.max(high_water_bytes(process.id()).unwrap_or(0));
        match process.try_wait().map_err(|error| error.to_string())? {
            Some(status) => break status,
            None => std::thread::sleep(ASK_EVERY),
        }
    };
    if !status.success() {
        return Err(format!("vantage plan ended with {status}"));
    }
    let json = |name: &str| -> Value { serde_json::from_slice(&fs::read(out.join(name)).expect("written")).expect("JSON") };
    let seconds = json("timings.json");
    let stages = seconds.as_object().expect("stages").iter().filter(|(stage, _)| *stage != "total");
    Ok(Planned {
        candidates: json("plan.json")["candidates"]["kept"].as_u64().expect("a count"),
        visibility_s: seconds["visibility"].as_f64().expect("seconds"),
        all_s: stages.filter_map(|(_, secs)| secs.as_f64()).sum(),
        peak_bytes,
    })
}

/// `VmHWM` of a process; none once it has ended.
fn high_water_bytes(process: u32) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let kib = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.trim().strip_suffix(" kB")?;
    kib.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

fn write_ply(file: &Path, mesh: &Mesh) -> std::io::Result<()> {
    let mut out = BufWriter::new(fs::File::create(file)?);
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
        mesh.vertices_mm.len(),
        mesh.faces.len()
    )?;
    for x in mesh.vertices_mm.iter().flat_map(|p| p.iter().copied().collect::<Vec<_>>()) {
        out.write_all(&(x as f32).to_le_bytes())?;
    }
    for face in &mesh.faces {
        out.write_all(&[3])?;
        face.iter().try_for_each(|vertex| out.write_all(&vertex.to_le_bytes()))?;
    }
    out.flush()
}
