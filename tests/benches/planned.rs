//! Whole plans, made by the program as its users start it, in a process of its own: what visibility took, and how much
//! memory the process needed at most.

use std::fs;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use serde_json::Value;
use vantage::geometry::Mesh;

/// How often the process is asked what it has needed so far; the high-water mark of its last moments may be missed.
const ASK_EVERY: Duration = Duration::from_millis(20);

/// What came of a plan.
pub(crate) struct Planned {
    /// Viewpoints whose visibility was computed.
    pub(crate) candidates: u64,
    /// Wall seconds of the visibility stage, on all cores.
    pub(crate) visibility_s: f64,
    /// Wall seconds of all stages.
    pub(crate) all_s: f64,
    /// Most memory that the process held, bytes.
    pub(crate) peak_bytes: u64,
}

/// Plans viewpoints for `mesh`, without a cell, with the nominal scanner.
///
/// # Errors
/// What the program said.
pub(crate) fn plan(mesh: &Mesh, sets: &[&str]) -> Result<Planned, String> {
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
    let stages = seconds.as_object().expect("stages").values().filter_map(Value::as_f64);
    Ok(Planned {
        candidates: json("plan.json")["candidates"]["kept"].as_u64().expect("a count"),
        visibility_s: seconds["visibility"].as_f64().expect("seconds"),
        all_s: stages.sum(),
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
