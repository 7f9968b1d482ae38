//! Every broken or odd mesh of the public data set plans, or is refused with a reason, in bounded time and memory.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::measured::run;
use crate::server::process::vantage;
use crate::support::{all_asked, long_asked, shared};

const MOST_BYTES: u64 = 2 << 30;

/// Half a minute with optimisation; tests run several times slower.
fn limit() -> Duration {
    Duration::from_secs(if cfg!(debug_assertions) { 180 } else { 30 })
}

fn meshes_below(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            found.extend(meshes_below(&path));
        } else if ["stl", "obj", "ply"].iter().any(|end| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(end))) {
            found.push(path);
        }
    }
    found.sort();
    found
}

#[test]
fn every_bad_mesh_plans_or_is_refused_in_bounded_time_and_memory() {
    let Some(folder) = shared("bad") else { return };
    if !all_asked() {
        return;
    }
    let out = tempfile::tempdir().expect("a folder");
    let mut rows: Vec<(f64, u64, String)> = Vec::new();
    let mut faults = Vec::new();
    for path in meshes_below(&folder) {
        let name = path.strip_prefix(&folder).expect("below").display().to_string();
        let mut command = vantage();
        command.arg("plan").arg(&path).args(["--unit", "mm", "--cell", "none", "--out"]).arg(out.path());
        // The default candidates take most of the time, and see the meshes that these see.
        command.args(if long_asked() { &[][..] } else { &["--set", "preset=thesis"] });
        let measured = run(&mut command, limit());
        let ended_well = matches!(measured.code, Some(0 | 2 | 3));
        if !ended_well || measured.peak_bytes > MOST_BYTES {
            faults.push(format!("{name}: {:?} after {:?}, {} bytes", measured.code, measured.wall, measured.peak_bytes));
        }
        rows.push((measured.wall.as_secs_f64(), measured.peak_bytes, name));
    }
    assert!(rows.len() >= 80, "only {} files", rows.len());
    rows.sort_by(|a, b| b.0.total_cmp(&a.0));
    let worst: Vec<String> =
        rows.iter().take(10).map(|(secs, bytes, name)| format!("{secs:7.1} s {:6} MiB  {name}", bytes >> 20)).collect();
    println!("the slowest ten of {}:\n{}", rows.len(), worst.join("\n"));
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}
