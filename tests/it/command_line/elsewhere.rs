//! A part that does not lie where it was planned: scanned there, found, and compared; and scans that are filed under other views.

use std::path::Path;

use nalgebra::{Isometry3, Vector3};
use serde_json::Value;
use vantage::cell::PoseSpec;
use vantage::geometry::demo_parts::DemoPart;
use vantage::geometry::{Mesh, Part, Table, mesh_io};

use super::run;

/// Writes a mesh as it lies after a motion.
fn written(file: &Path, mesh: &Mesh, motion: &Isometry3<f64>) -> String {
    let vertices_mm = mesh.vertices_mm.iter().map(|vertex| motion * vertex).collect();
    std::fs::write(file, mesh_io::write_stl(&Mesh { vertices_mm, ..mesh.clone() })).expect("written");
    file.display().to_string()
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_part_that_was_put_elsewhere_is_found_and_compared() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let mesh = DemoPart::Base.mesh(8_000).expect("a part");
    let turned = Isometry3::new(Vector3::new(14.0, -9.0, 0.0), Vector3::z() * 12_f64.to_radians());
    let part = written(&at("part.stl"), &mesh, &Isometry3::identity());
    let moved = written(&at("moved.stl"), &mesh, &turned);
    let [plan, scans, inspection] = ["plan", "scans", "inspection"].map(|name| at(name).display().to_string());
    let quick = ["--set", "selection.max_views=4", "--set", "missed.remedies=0", "--report", "none"];
    let ended = run(&[&["plan", &part, "--unit", "mm", "--out", &plan][..], &quick].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let of_part = ["--mesh", &part, "--unit", "mm"];
    let as_built = ["--part-as-built", &moved, "--set", "step_px=8", "--out", &scans];
    let ended = run(&[&["sim", "scanner", &plan][..], &of_part, &as_built].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let ended = run(&[&["compare", &plan, &scans, "--out", &inspection][..], &of_part].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);

    let text = std::fs::read_to_string(at("inspection/inspection.json")).expect("a result");
    let result: Value = serde_json::from_str(&text).expect("JSON");
    let codes: Vec<&str> =
        result["findings"].as_array().expect("findings").iter().filter_map(|found| found["code"].as_str()).collect();
    assert!(codes.contains(&"part_elsewhere"), "{codes:?}");
    let alignment = &result["alignment"];
    let number = |of: &Value, key: &str| of[key].as_f64().unwrap_or_else(|| panic!("{key} in {of}"));
    assert!((number(alignment, "part_turned_deg") - 12.0).abs() < 0.02, "{alignment}");
    assert!(number(alignment, "inlier_share") > 0.95, "{alignment}");
    assert!(number(&result["deviation"]["statistics"], "rms_mm") < 0.03, "{}", result["deviation"]["statistics"]);
    // Where it lies on the table is the planned place after the motion.
    let planned: Value = serde_json::from_str(&std::fs::read_to_string(at("plan/plan.json")).expect("a plan")).expect("JSON");
    let pose = |of: &Value| -> Isometry3<f64> {
        let spec: PoseSpec = serde_json::from_value(of.clone()).expect("a pose");
        *spec.pose::<Table, Part>().isometry()
    };
    let wanted = pose(&planned["cell"]["table_from_part"]) * turned;
    let apart_mm = (pose(&alignment["table_from_part"]).translation.vector - wanted.translation.vector).norm();
    assert!(apart_mm < 0.05, "{apart_mm} mm");

    // Further views are planned for the plan that was compared, and added up with rounds of the same part.
    let [other_plan, out] = ["other plan", "out"].map(|name| at(name).display().to_string());
    let ended = run(&[&["plan", &part, "--unit", "mm", "--out", &other_plan, "--set", "seed=2"][..], &quick].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let ended = run(&[&["rescan", &inspection, &other_plan, "--out", &out][..], &of_part].concat());
    assert_eq!(ended.code, Some(2), "{}", ended.err);
    assert!(ended.err.contains("another plan") && ended.err.contains("was given"), "{}", ended.err);
    let finer = written(&at("finer.stl"), &DemoPart::Base.mesh(20_000).expect("a part"), &Isometry3::identity());
    let of_finer = ["--mesh", &finer, "--unit", "mm"];
    let ended = run(&[&["plan", &finer, "--unit", "mm", "--out", &other_plan][..], &quick].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let ended = run(&[&["compare", &other_plan, &scans, "--out", &out][..], &of_finer].concat());
    assert_eq!(ended.code, Some(2), "{}", ended.err);
    assert!(ended.err.contains("is a scan of another plan") && !at("out").exists(), "{}", ended.err);
    let other_scans = at("other scans").display().to_string();
    let ended = run(&[&["sim", "scanner", &other_plan, "--set", "step_px=8", "--out", &other_scans][..], &of_finer].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let ended = run(&[&["compare", &other_plan, &other_scans, "--after", &inspection, "--out", &out][..], &of_finer].concat());
    assert_eq!(ended.code, Some(2), "{}", ended.err);
    assert!(ended.err.contains("is from another part"), "{}", ended.err);
}

/// A copy of the first scan under the number of the last view counted as that view's.
#[test]
#[ignore = "long: tests/all runs it"]
fn a_scan_under_another_view_is_named_and_scans_of_which_most_are_so_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let part = written(&at("part.stl"), &DemoPart::Base.mesh(8_000).expect("a part"), &Isometry3::identity());
    let [plan, scans, inspection] = ["plan", "scans", "inspection"].map(|name| at(name).display().to_string());
    let quick = ["--set", "selection.max_views=4", "--set", "missed.remedies=0", "--report", "none"];
    let ended = run(&[&["plan", &part, "--unit", "mm", "--out", &plan][..], &quick].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let of_part = ["--mesh", &part, "--unit", "mm"];
    let ended = run(&[&["sim", "scanner", &plan, "--set", "step_px=8", "--out", &scans][..], &of_part].concat());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let file = |view: usize| at("scans").join(format!("view_{view:03}.ply"));
    let taken: Vec<Vec<u8>> = (0..4).map(|view| std::fs::read(file(view)).expect("a scan")).collect();

    std::fs::write(file(3), &taken[0]).expect("written");
    let compare = [&["compare", &plan, &scans, "--frame", "scanner", "--out", &inspection][..], &of_part].concat();
    let ended = run(&compare);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let text = std::fs::read_to_string(at("inspection/inspection.json")).expect("a result");
    let result: Value = serde_json::from_str(&text).expect("JSON");
    let findings = result["findings"].as_array().expect("findings");
    let wrong: Vec<&Value> = findings.iter().filter(|found| found["code"] == "wrong_view").collect();
    assert!(wrong.len() == 1 && wrong[0]["file"] == "view_003.ply", "{findings:?}");
    assert!(wrong[0]["detail"].as_str().is_some_and(|told| told.contains("It fits viewpoint 0")), "{findings:?}");
    let of_view = result["coverage"]["by_view"].as_array().expect("views").iter().find(|view| view["viewpoint"] == 3);
    assert_eq!(of_view.expect("the view")["scans"], 0, "{}", result["coverage"]);

    for (view, taken) in [(0, &taken[1]), (1, &taken[2]), (2, &taken[0]), (3, &taken[3])] {
        std::fs::write(file(view), taken).expect("written");
    }
    let ended = run(&compare);
    assert_eq!(ended.code, Some(2), "{}", ended.err);
    for told in
        ["view_000.ply", "view_001.ply", "view_002.ply", "view_003.ply fits viewpoint 3, but most files of its setup do not"]
    {
        assert!(ended.err.contains(told), "{told}: {}", ended.err);
    }
}
