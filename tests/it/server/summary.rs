//! One summary: the same words and numbers in the standard output of `vantage plan`, in both reports, in the job, in the list
//! of jobs and on the page.

use std::path::Path;

use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use vantage::cell::{BodySpec, PoseSpec, Presets, ShapeSpec, SpecLibrary};
use vantage::wire::summary::{PlanLevel, PlanVerdict, Summary};

use super::process::{Server, vantage};
use crate::http::api::cube;

/// Results for one part: the summary, the plan, and the standard output of the command.
struct Planned {
    summary: Summary,
    plan: Value,
    said: String,
}

/// Plans a cube on the command line and over HTTP, and holds every output against `summary.json`.
fn planned(cell: &Value, params: &Value) -> Planned {
    let (folder, data) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let path = |name: &str| folder.path().join(name);
    for (name, text) in [("cube.stl", cube(60.0)), ("params.json", params.to_string()), ("cell.json", cell.to_string())] {
        std::fs::write(path(name), text).expect("a file");
    }
    let server = Server::start(data.path(), &[]);
    let mesh = server.upload().expect("a mesh");
    let request = json!({"mesh_id": mesh["id"], "cell": cell, "params": params});
    let job = server.post("/api/v1/jobs", &request.to_string()).expect("a job");
    // Both plan at the same time.
    let mut command = vantage();
    command.arg("plan").arg(path("cube.stl")).args(["--unit", "mm", "--threads", "1", "--params"]).arg(path("params.json"));
    match cell.as_str() {
        Some(name) => command.args(["--cell", name]),
        None => command.arg("--cell").arg(path("cell.json")),
    };
    let output = command.arg("--out").arg(path("out")).output().expect("the program");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8(output.stdout).expect("text");
    let read = |name: &str| std::fs::read(path("out").join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    let summary: Summary = serde_json::from_slice(&read("summary.json")).expect("a summary");
    let files = |name: &str| String::from_utf8(read(name)).expect("text");
    hold_texts(&summary, &said, &files);
    hold_job(&server, job["id"].as_str().expect("an id"), &summary, &path("out"));
    Planned { summary, plan: serde_json::from_slice(&read("plan.json")).expect("a plan"), said }
}

/// Standard output and the text report begin with the lines of the summary, and the page of the report has each.
fn hold_texts(summary: &Summary, said: &str, files: &dyn Fn(&str) -> String) {
    // The report tells another place of the groups that have no line.
    let lines: Vec<String> = summary.lines().into_iter().filter(|line| !line.ends_with(": in the report")).collect();
    let head = lines.join("\n") + "\n";
    assert!(said.starts_with(&head), "standard output does not begin with\n{head}\nbut is\n{said}");
    let report = files("report.txt");
    assert!(report.starts_with(&head), "report.txt does not begin with\n{head}\nbut is\n{report}");
    // Options stand in code of their own.
    let escapes =
        [("<code>", ""), ("</code>", ""), ("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&#39;", "'"), ("&amp;", "&")];
    let page = escapes.iter().fold(files("report.html"), |page, (escape, character)| page.replace(escape, character));
    for line in &lines {
        assert!(page.contains(line.trim_start()), "report.html lacks {line:?}");
    }
    assert_eq!(summary.plan_sha256.as_deref(), Some(sha256(files("plan.json").as_bytes()).as_str()));
}

/// The job, and its entry in the list, have the summary; its files are those of the command.
fn hold_job(server: &Server, id: &str, summary: &Summary, out: &Path) {
    let wanted = serde_json::to_value(summary).expect("JSON");
    let job = server.ended(id);
    assert_eq!(job["summary"], wanted, "{job}");
    assert_eq!(job["plan_sha256"], wanted["plan_sha256"]);
    let list = server.get("/api/v1/jobs").expect("a list");
    assert_eq!((&list["items"][0]["id"], &list["items"][0]["summary"]), (&job["id"], &wanted));
    for name in ["plan.json", "summary.json", "report.txt"] {
        let result = job["results"].as_array().expect("a list").iter().find(|file| file["name"] == name).expect("a file");
        assert_eq!(result["sha256"], sha256(&std::fs::read(out.join(name)).expect("the command's")), "{name}");
    }
}

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn every_output_has_the_same_summary() {
    let params = json!({
        "candidates": {"strategies": ["ellipsoid"], "rolls_deg": [0], "step_small_deg": 90, "step_large_deg": 90},
        "part": {"patch_edge_mm": 20, "samples_per_mm2": 0.02}, "missed": {"remedies": 6}, "selection": {"max_views": 1}
    });
    let Planned { summary, plan, said } = planned(&json!("none"), &params);
    assert_eq!((summary.verdict, summary.views, summary.views_chosen), (PlanVerdict::TargetMissed, 1, 1), "{said}");
    assert_eq!(summary.level, PlanLevel::Limited);
    let head = "Can be scanned, with gaps: 16.67 % of the visible and 16.67 % of the asked area measured\n\
                Target missed: 16.67 % of coverable, target 98.50 %: the limit of 1 view is reached\n";
    assert!(said.starts_with(head), "{said}");
    assert_eq!((summary.cycle_secs, &plan["motion"]), (None, &Value::Null));
    // The action takes the options that were tried, and says what they gave.
    let (action, advice) = (summary.action.expect("advice"), &plan["advice"][0]);
    assert_eq!((&json!(action.set), &json!(action.to_of_asked)), (&advice["set"], &advice["of_asked"]));
    let next = "\nNext: choose 5 more views: --set selection.target=1.0 --set selection.max_views=6; estimated effect: \
                16.7 → 100.0 % of asked\n";
    assert!(said.contains(next), "{said}");
    // All spots are in some group, each once.
    let spots: u64 = plan["missed"].as_array().expect("a list").iter().filter_map(|missed| missed["spots"].as_u64()).sum();
    assert_eq!(summary.missed.iter().map(|group| group.spots as u64).sum::<u64>(), spots);
    assert_eq!(summary.missed_spots as u64, spots);
    let missed_mm2: f64 = summary.missed.iter().map(|group| group.area_mm2).sum();
    let asked_mm2 = plan["coverage"]["asked_area_mm2"].as_f64().expect("an area");
    assert!((missed_mm2 / asked_mm2 - summary.missed_of_asked).abs() < 1e-9, "{:?}", summary.missed);
}

/// The default cell with two bodies in the way: the arm reaches stations on the far side of them to which no path leads.
fn cell_with_bodies_in_the_way() -> Value {
    let mut spec = Presets.cell("e05-transcan").expect("a preset");
    let body = |name: &str, translation_mm: [f64; 3], shape: ShapeSpec| BodySpec {
        name: name.to_owned(),
        owner_from_body: PoseSpec { translation_mm, ..PoseSpec::default() },
        shape,
    };
    spec.obstacles.push(body("cabinet", [287.0, -132.0, 200.0], ShapeSpec::Box { size_mm: [230.0, 297.0, 157.0] }));
    spec.obstacles.push(body("post", [-128.0, -109.0, 343.0], ShapeSpec::Cylinder { radius_mm: 29.0, height_mm: 498.0 }));
    serde_json::to_value(spec).expect("JSON")
}

#[test]
#[ignore = "long: tests/all runs it"]
fn views_without_a_path_are_counted_as_chosen_and_not_as_executed_everywhere() {
    let params = json!({
        "candidates": {"strategies": ["even"], "even_directions": 60, "rolls_deg": [0]},
        "limits": {"camera_deg": 40, "projector_deg": 40}, "selection": {"max_views": 2},
        "part": {"samples_per_mm2": 0.02, "patch_edge_mm": 20}, "robust": {"pose_error": null},
        "missed": {"remedies": 0, "advice": false}
    });
    let Planned { summary, plan, said } = planned(&cell_with_bodies_in_the_way(), &params);
    let count = |list: &str| plan[list].as_array().expect("a list").len();
    assert_eq!((summary.views, summary.views_chosen), (count("sequence"), count("viewpoints")), "{said}");
    assert!(0 < summary.views && summary.views < summary.views_chosen, "{said}");
    let rejected = plan["viewpoints"].as_array().expect("a list").iter().filter(|view| view["rejected"] == "no_path").count();
    assert_eq!(rejected, summary.views_chosen - summary.views);
    let told = format!("no collision-free path leads to {rejected} of {} chosen views", summary.views_chosen);
    assert!(summary.views_text.ends_with(&told), "{}", summary.views_text);
    // The cycle is that of the views that are executed.
    let (motion, parts) = (&plan["motion"], summary.cycle_parts.expect("a cell"));
    assert_eq!(motion["cycle_secs"].as_f64(), summary.cycle_secs);
    assert_eq!(motion["scanning_secs"].as_f64(), Some(parts.scanning_secs));
    assert!((parts.scanning_secs - summary.views as f64).abs() < 1e-9, "a second a capture: {parts:?}");
    assert!(summary.cycle_text.is_some_and(|text| text.contains(&format!(" + {} × 1.3 s scanning", summary.views))), "{said}");
}

/// The page writes no sentence of its own about a result: it shows those of the answers.
#[test]
fn the_page_shows_the_sentences_that_answers_have() {
    let page = [include_str!("../../../static/src/job.tsx"), include_str!("../../../static/src/joblist.tsx")].concat();
    let api: Value = serde_json::from_str(include_str!("../../../api/openapi.json")).expect("the API document");
    for field in ["title", "verdict_text", "views_text", "coverage_text", "cycle_text", "action"] {
        assert!(page.contains(&format!("summary.{field}")) || page.contains(&format!("summary?.{field}")), "{field}");
        assert!(!api["components"]["schemas"]["Summary"]["properties"][field].is_null(), "{field} is in no answer");
    }
    // The table of shares, with their meanings.
    assert!(include_str!("../../../static/src/planpanels.tsx").contains("summary?.headline"));
    for (schema, field) in [("Summary", "headline"), ("Summary", "setup_links"), ("HeadlineDocument", "meaning")] {
        assert!(!api["components"]["schemas"][schema]["properties"][field].is_null(), "{schema}.{field} is in no answer");
    }
    // The share of a fix that does not work for each of its spots comes before the fix.
    let panels = include_str!("../../../static/src/planpanels.tsx");
    assert!(panels.contains("group.partial_text ? `${group.partial_text}: ${group.fix_text}`"));
    assert!(!api["components"]["schemas"]["MissedGroup"]["properties"]["partial_text"].is_null(), "it is in no answer");
    for item in ["Job", "JobListItem", "JobEvent"] {
        assert!(!api["components"]["schemas"][item]["properties"]["summary"].is_null(), "{item} has none");
    }
}
