//! Own hardware and doubtful sizes, as a user meets them on the command line.

use std::path::Path;

use crate::server::process::vantage;
use crate::support::box_mesh;

/// Parameters with which a small part is planned within a second or two.
const QUICK: [&str; 5] = [
    "candidates.strategies=[\"ellipsoid\"]",
    "candidates.rolls_deg=[0]",
    "selection.max_views=2",
    "missed.remedies=0",
    "missed.advice=false",
];

/// Writes a box as OBJ, its edges in the file's unit.
fn block(path: &Path, edges: [f64; 3]) {
    let mesh = box_mesh([0.0; 3], edges);
    let vertices = mesh.vertices_mm.iter().map(|p| format!("v {} {} {}\n", p.x, p.y, p.z));
    let faces = mesh.faces.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
    std::fs::write(path, vertices.chain(faces).collect::<String>()).expect("a file");
}

/// Exit code, standard output and standard error of a command.
fn told(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = vantage().args(arguments).output().expect("the program");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code(), text(&output.stdout), text(&output.stderr))
}

#[test]
fn a_scanner_from_a_data_sheet_is_checked_and_planned_with() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (scanner, part, out) = (path("mine.toml"), path("block.obj"), path("out"));
    let sheet = ["scanner", "--field", "300x200", "--at", "500", "--depth", "440..560", "--baseline", "200"];
    let (code, _, said) = told(&[&sheet[..], &["--out", &scanner, "--sketch", &path("mine.svg")]].concat());
    assert_eq!(code, Some(0), "{said}");
    let (code, sound, said) = told(&["check", &scanner]);
    assert_eq!((code, sound.contains("scanner my-scanner"), said.as_str()), (Some(0), true, ""));
    let (code, facts, said) = told(&["inspect", &scanner]);
    assert!(code == Some(0) && facts.contains("baseline 200.00 mm"), "{facts}{said}");
    block(Path::new(&part), [60.0, 40.0, 30.0]);
    let sets = QUICK.iter().flat_map(|set| ["--set", set]);
    let plan = ["plan", &part, "--unit", "MM", "--cell", "none", "--scanner", &scanner, "--out", &out];
    let (code, _, said) = told(&plan.into_iter().chain(sets).collect::<Vec<_>>());
    assert_eq!(code, Some(0), "{said}");
    assert!(folder.path().join("out/plan.json").is_file() && folder.path().join("mine.svg").is_file());
}

#[test]
fn a_scanner_is_printed_where_no_file_is_named() {
    let (code, printed, said) =
        told(&["scanner", "--field", "300x200", "--at", "500", "--depth", "440..560", "--baseline", "200"]);
    assert!(code == Some(0) && printed.contains("[depth_mm]") && printed.contains("best = 500.0"), "{printed}{said}");
    let (code, _, said) = told(&["scanner", "--field", "300x200", "--at", "600", "--depth", "440..560", "--baseline", "0"]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("--depth: is 440..560 mm") && said.contains("--baseline: is 0 mm; allowed is 1 to 1800 mm"), "{said}");
}

#[test]
fn an_inch_part_taken_for_millimetres_is_told_in_every_output() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (part, out) = (path("inch.obj"), path("out"));
    block(Path::new(&part), [4.0, 3.0, 2.0]);
    let sets = QUICK.iter().flat_map(|set| ["--set", set]);
    let plan = ["plan", &part, "--unit", "mm", "--cell", "none", "--scanner", "transcan-c-nominal", "--out", &out];
    let (code, _, said) = told(&plan.into_iter().chain(sets).collect::<Vec<_>>());
    assert_eq!(code, Some(0), "{said}");
    let fits = "inches (101.6 × 76.2 × 50.8 mm)";
    assert!(said.contains("inch.obj: --unit: is 4.00 × 3.00 × 2.00 mm as read in mm") && said.contains(fits), "{said}");
    let read = |name: &str| std::fs::read_to_string(folder.path().join("out").join(name)).expect("a result");
    let document: serde_json::Value = serde_json::from_str(&read("plan.json")).expect("JSON");
    let warning = document["warnings"].as_array().expect("a list").iter().find(|warning| warning["code"] == "part_small");
    let warning = warning.unwrap_or_else(|| panic!("{}", document["warnings"]));
    assert_eq!(warning["pointer"], "/part/bbox_mm");
    assert!(
        read("report.txt").starts_with("Check the unit of the part (part_small): it is 4.00 × 3.00 × 2.00 mm")
            && read("report.html").contains(fits)
    );
    let (code, _, said) = told(&["check", &path("out/plan.json")]);
    assert!(code == Some(0) && said.contains("/part/bbox_mm") && said.contains(fits), "{said}");
}

#[test]
fn a_part_in_metres_is_blamed_on_the_file_and_its_unit() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (part, out) = (path("metres.obj"), path("out"));
    for (edges, words) in [
        (
            [1.2, 0.8, 0.6],
            &["as read in m", "part.table_from_part is not given", "it would fit if the file is in cm (12.0 ×"][..],
        ),
        ([60.0, 40.0, 30.0], &["is 60000 × 40000 × 30000 mm", "read in m", "it would fit if the file is in mm (60.0 ×"]),
    ] {
        block(Path::new(&part), edges);
        let (code, _, said) = told(&["plan", &part, "--unit", "m", "--out", &out]);
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains("metres.obj (--unit m): ") && !said.contains("parameters: /part"), "{said}");
        assert!(words.iter().all(|word| said.contains(word)), "{words:?} are not in {said}");
        // The reason stands in a report, with the picture and what to do.
        let read = |name: &str| std::fs::read_to_string(folder.path().join("out").join(name)).expect("a report");
        let (page, report) = (read("report.html"), read("report.txt"));
        assert!(report.contains("the part cannot be planned: it ") && report.contains("\ntry first: "), "{report}");
        for shown in [
            "The part cannot be planned as it is",
            "Try first: ",
            "The part in the cell",
            "How the part lies on the plate",
            "<img ",
        ] {
            assert!(page.contains(shown), "the page lacks {shown:?}");
        }
        assert!(!folder.path().join("out/plan.json").exists() && said.contains("report.html"), "{said}");
    }
    std::fs::remove_dir_all(&out).expect("reports");
    // A pose that was given is to blame itself.
    block(Path::new(&part), [60.0, 40.0, 30.0]);
    let pose = r#"part.table_from_part={"translation_mm": [0, 0, -15], "rpy_deg": [0, 0, 0]}"#;
    let (code, _, said) = told(&["plan", &part, "--unit", "mm", "--out", &out, "--set", pose]);
    assert!(code == Some(2) && said.contains(&format!("--set {pose}: sinks the part 15.000 mm")), "{said}");
    assert!(!Path::new(&out).exists(), "no report, and no empty folder, where a parameter is wrong");
}

#[test]
fn inspect_shows_a_mesh_in_all_units() {
    let folder = tempfile::tempdir().expect("a folder");
    let part = folder.path().join("part.obj");
    block(&part, [4.0, 3.0, 2.0]);
    let (code, shown, said) = told(&["inspect", &part.display().to_string(), "--cell", "e05-transcan"]);
    assert_eq!(code, Some(0), "{said}");
    for line in ["in mm       4.00 × 3.00 × 2.00 mm, does not fit", "in inches   101.6 × 76.2 × 50.8 mm, fits"] {
        assert!(shown.contains(line), "{line:?} is not in\n{shown}");
    }
}

#[test]
fn the_page_has_no_unit_chosen() {
    let page = include_str!("../../static/src/create.tsx");
    assert!(page.contains("unit: signal(\"\")") && page.contains("[\"\", text.create.unitChoose]"), "the first choice is none");
    let without_unit = "(first && !unit.value ? text.create.readFirst : \"\")";
    assert!(
        page.contains(without_unit) && page.contains("const canStart = Boolean(base ?? first) && Boolean(cell) && !fault "),
        "nothing begins without a unit"
    );
    let uses = page.matches("unit.value = ").count();
    assert_eq!(uses, 1, "only the reader chooses it");
    assert!(include_str!("../../static/src/job.tsx").contains("job.warnings"), "warnings of a job are shown");
}
