//! `vantage plan` as a process: what it says before it plans, and how it ends on a signal.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use crate::server::process::vantage;

#[test]
fn a_doubtful_mesh_is_told_before_planning_and_sigterm_cancels_with_4() {
    let folder = tempfile::tempdir().expect("a folder");
    let part = folder.path().join("part.obj");
    std::fs::write(&part, "v 0 0 0\nv 100 0 0\nv 0 100 0\nf 1 2 3\n").expect("a file");
    let out = folder.path().join("out");
    // So many samples and directions that planning lasts.
    let fine = [
        "candidates.strategies=[\"ellipsoid\"]",
        "part.samples_per_mm2=5",
        "candidates.step_small_deg=2",
        "candidates.step_large_deg=2",
    ];
    let mut child = vantage()
        .args(["plan", &part.display().to_string(), "--unit", "mm", "--cell", "none", "--out", &out.display().to_string()])
        .args(fine.iter().flat_map(|set| ["--set", set]))
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program");
    let mut said = Vec::new();
    let mut lines = BufReader::new(child.stderr.take().expect("its messages")).lines().map_while(Result::ok);
    // The first stage is named once planning has begun.
    said.extend(lines.by_ref().take_while(|line| line != "surface"));
    let sent = Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill");
    assert!(sent.success());
    said.extend(lines);
    let status = child.wait().expect("its end");
    assert_eq!(status.code(), Some(4), "{said:#?}");
    let told = said.join("\n");
    assert!(told.contains("part.obj: ") && told.contains("→ "), "{told}");
    assert!(told.contains("nothing was written"), "{told}");
    assert_eq!(std::fs::read_dir(out).expect("made before").count(), 0);
}

#[test]
fn a_limit_beyond_the_scanner_s_is_refused_with_2_and_the_range() {
    let folder = tempfile::tempdir().expect("a folder");
    let part = folder.path().join("part.obj");
    std::fs::write(&part, "v 0 0 0\nv 100 0 0\nv 0 100 0\nf 1 2 3\n").expect("a file");
    let out = folder.path().join("out");
    let output = vantage()
        .args(["plan", &part.display().to_string(), "--unit", "mm", "--cell", "none", "--out", &out.display().to_string()])
        .args(["--set", "limits.camera_deg=89"])
        .output()
        .expect("the program");
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert!(told.contains("/limits/camera_deg: is 89 °; allowed is 1 to 85 °, the own limit of the left camera"), "{told}");
}
