//! The commands of README, as they stand there, and its figures.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::AtomicBool;

use vantage::cell::{Presets, SpecLibrary};
use vantage::geometry::Mesh;
use vantage::geometry::demo_parts::{self, DEFAULT_TRIANGLES};
use vantage::planning::context::{Context, Silent};
use vantage::planning::params::{CandidateParams, PlanParams};
use vantage::planning::{PlanInput, plan};
use vantage::program::dialects::Dialect;

use crate::server::process::{Server, vantage};
use crate::support::{chromium, program};

const README: &str = include_str!("../../README.md");

/// The first `sh` block after `marker`.
fn block_after(marker: &str) -> &'static str {
    let from = README.find(marker).unwrap_or_else(|| panic!("README has no {marker:?}"));
    let rest = &README[from..];
    let start = rest.find("```sh\n").expect("a block") + "```sh\n".len();
    let end = rest[start..].find("```").expect("its end");
    &rest[start..start + end]
}

/// Runs a script in `folder` with the program of this build on the path; what it printed.
fn bash(script: &str, folder: &std::path::Path) -> String {
    let program = vantage();
    let bin = std::path::Path::new(program.get_program()).parent().expect("a folder").to_owned();
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap_or_default());
    let output = Command::new("bash")
        .args(["-euo", "pipefail", "-c", script])
        .env("PATH", path)
        .current_dir(folder)
        .output()
        .expect("bash runs");
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{}\n{script}\n{out}\n{err}", output.status);
    out.into_owned()
}

#[test]
#[ignore = "long: tests/all runs it"]
fn the_walk_through_runs_as_written() {
    if !(program("curl") && program("jq")) {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let planned = bash(block_after("## Plan from the command line"), folder.path());
    assert!(planned.contains("no problems found") && planned.contains("plan/report.html"), "{planned}");
    for file in ["plan.json", "program.json", "timings.json", "report.txt", "coverage.csv", "report.html"] {
        assert!(folder.path().join("plan").join(file).is_file(), "{file}");
    }

    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let script = block_after("<!-- walk-through").replace("127.0.0.1:8080", &server.address.to_string());
    let printed = bash(&script, folder.path());
    assert!(printed.contains("\"state\": \"succeeded\"") && printed.contains("excluded_resting"), "{printed}");
    let program = std::fs::read_to_string(folder.path().join("program.json")).expect("the program");
    assert!(program.contains("vantage.program/1"));
    let report = std::fs::read_to_string(folder.path().join("report.html")).expect("the report");
    assert!(report.contains("<html") && report.contains("PN-1"));
    let csv = std::fs::read_to_string(folder.path().join("viewpoints.csv")).expect("the table");
    assert!(csv.lines().count() > 2, "{csv}");
}

/// Draws a page with a browser into a picture of README, where pictures are renewed; what is there has the size that is asked for.
fn picture(name: &str, page: &Path, [width, height]: [u32; 2]) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name);
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        let Some(browser) = chromium() else { return };
        let profile = tempfile::tempdir().expect("a folder");
        let drawn = Command::new(browser)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-background-networking"])
            .arg(format!("--window-size={width},{height}"))
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .arg(format!("--screenshot={}", file.display()))
            .arg(format!("file://{}", page.display()))
            .output()
            .expect("the browser runs");
        assert!(drawn.status.success(), "{}", String::from_utf8_lossy(&drawn.stderr));
    }
    assert!(README.contains(&format!("](tests/golden/{name})")));
    let bytes = std::fs::read(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    let image = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().expect("a PNG file");
    assert_eq!([image.info().width, image.info().height], [width, height]);
}

/// The picture of README is the head of the report that its first commands make, drawn by a browser.
#[test]
fn the_picture_is_the_head_of_a_report() {
    let folder = tempfile::tempdir().expect("a folder");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        bash(block_after("## Plan from the command line"), folder.path());
    }
    picture("report.png", &folder.path().join("plan/report.html"), [1280, 1400]);
}

/// The thesis's story, told again with the figures that README has.
#[test]
#[ignore = "long: tests/all runs it"]
fn the_loop_runs_as_written_and_reaches_what_readme_says() {
    let folder = tempfile::tempdir().expect("a folder");
    bash("vantage part base --out base.stl && vantage plan base.stl --unit mm --out plan --report none", folder.path());
    bash(block_after("## Compare what was scanned"), folder.path());
    let read = |name: &str| -> serde_json::Value {
        let text = std::fs::read_to_string(folder.path().join(name)).expect("a result");
        serde_json::from_str(&text).expect("JSON")
    };
    let percent = |value: &serde_json::Value| format!("{:.2} %", 100.0 * value.as_f64().expect("a share"));
    let lost = |document: &serde_json::Value, cause: &str| {
        let losses = document["losses"].as_array().expect("losses");
        percent(&losses.iter().find(|loss| loss["cause"] == cause).expect("the cause")["of_asked"])
    };
    let views = |name: &str| read(name)["viewpoints"].as_array().map_or(0, Vec::len);
    let (first, second) = (read("inspection/inspection.json"), read("inspection2/inspection.json"));
    let rows = [
        (format!("1 | {}", views("plan/plan.json")), &first, percent(&first["coverage"]["measured_of_asked"])),
        (
            format!("2 | {} more", views("plan2/plan.json")),
            &second,
            format!("{} in all", percent(&second["coverage"]["measured_in_all_of_asked"])),
        ),
    ];
    for (head, document, scanned) in rows {
        let planned = percent(&document["coverage"]["planned_of_asked"]);
        let row = format!("| {head} | {planned} | {scanned} | {} | {} |", lost(document, "grazing"), lost(document, "concave"));
        assert!(README.contains(&row), "README lacks: {row}");
    }
    picture("inspection.png", &pictured(&folder.path().join("inspection2/inspection.html")), [1280, 1060]);
}

/// The part of an inspection's page that README shows: pictures of losses, and of what came before.
fn pictured(page: &Path) -> PathBuf {
    let text = std::fs::read_to_string(page).expect("the page");
    let (head, main) = text.split_once("<main>").expect("a page");
    let section = |name: &str| {
        let begin = main.find(&format!("<section>\n<h2>{name}</h2>")).expect("a section");
        let end = begin + main[begin..].find("<div class=\"card\"><table>").expect("its table");
        format!("{}</section>\n", &main[begin..end])
    };
    let tail = &main[main.find("</main>").expect("its end")..];
    let file = page.with_file_name("pictured.html");
    std::fs::write(&file, format!("{head}<main>\n{}{}{tail}", section("Losses"), section("Before and after"))).expect("written");
    file
}

#[test]
#[ignore = "long: tests/all runs it"]
fn the_run_on_the_twin_runs_as_written() {
    let folder = tempfile::tempdir().expect("a folder");
    bash("vantage part base --triangles 8000 --out base.stl && vantage plan base.stl --unit mm --out plan", folder.path());
    let told = bash(block_after("<!-- run:"), folder.path());
    assert!(told.starts_with("done: ") && told.contains("coverage from the measured poses"), "{told}");
    let table = std::fs::read_to_string(folder.path().join("run.csv")).expect("the record");
    assert!(table.starts_with("step,op,viewpoint,") && table.lines().count() > 3, "{table}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn own_hardware_and_two_setups_run_as_written() {
    let folder = tempfile::tempdir().expect("a folder");
    bash("vantage part base --triangles 8000 --out base.stl", folder.path());
    bash(block_after("## Your own scanner, cell and setups"), folder.path());
    for file in ["my-scanner.svg", "my-cell.svg", "plan-of-two/program-2.json"] {
        assert!(folder.path().join(file).is_file(), "{file}");
    }
}

#[test]
fn the_study_runs_as_written() {
    let folder = tempfile::tempdir().expect("a folder");
    bash("vantage part base --triangles 8000 --out base.stl", folder.path());
    let told = bash(block_after("## Vary one parameter"), folder.path());
    assert!(told.contains("a = 0.25, b = 0.75") && folder.path().join("study/weights.html").is_file(), "{told}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn every_parameter_that_readme_sets_is_one() {
    let folder = tempfile::tempdir().expect("a folder");
    bash("vantage part base --triangles 8000 --out base.stl", folder.path());
    let rows = README.lines().filter(|line| line.starts_with("| ") && line.contains("--set"));
    let mut found = 0;
    for row in rows {
        let options: Vec<&str> = row.split('`').skip(1).step_by(2).collect();
        let script = format!(
            "vantage plan base.stl --unit mm --cell none --set part.samples_per_mm2=0.02 --set candidates.even_directions=12 --set selection.max_views=1 {} --report none --out plan",
            options.join(" ")
        );
        bash(&script, folder.path());
        found += 1;
    }
    assert!(found >= 3, "README shows --set {found} times");
}

/// Sentences that list languages would go stale where a dialect is added.
#[test]
fn every_dialect_stands_where_languages_are_listed() {
    let quoted = |dialects: &[Dialect]| dialects.iter().map(|dialect| format!("`{}`", dialect.as_str())).collect::<Vec<_>>();
    let joined = |names: &[String], word: &str| {
        let (last, others) = names.split_last().expect("two or more");
        format!("{} {word} {last}", others.join(", "))
    };
    let (neutral, of_makers): (Vec<Dialect>, Vec<Dialect>) = Dialect::ALL.into_iter().partition(|dialect| dialect.is_neutral());
    let sentence = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let wanted = format!(
        "{} suit every robot. Of {}, Vantage refuses any",
        joined(&quoted(&neutral), "and"),
        joined(&quoted(&of_makers), "and")
    );
    assert!(sentence(README).contains(&wanted), "README lacks: {wanted}");

    let (_, table) = README.split_once("| language | files | turntable |").expect("the table of languages");
    let rows = table.lines().skip(2).take_while(|line| line.starts_with('|'));
    let cells: Vec<[&str; 2]> = rows.map(|row| [1, 2].map(|column| row.split('|').nth(column).expect("a cell").trim())).collect();
    let languages: Vec<&str> = cells.iter().flat_map(|[languages, _]| languages.split(", ")).collect();
    assert_eq!(languages, quoted(&Dialect::ALL));
    for dialect in Dialect::ALL {
        let name = format!("`{}`", dialect.as_str());
        let [_, files] = cells.iter().find(|[languages, _]| languages.contains(&name)).expect("its row");
        let lacks = dialect.outputs().iter().find(|output| !files.contains(&format!("`.{}`", output.extension)));
        assert_eq!(lacks, None, "{name}: {files}");
    }

    let mut neutral = quoted(&neutral);
    neutral.sort();
    let neutral = joined(&neutral, "or");
    assert!(include_str!("../../api/problems.md").contains(&format!("request that one, {neutral}, or")), "{neutral}");
    assert!(include_str!("../../api/openapi.json").contains(&format!("nor {neutral}, the response")), "{neutral}");
}

/// A row of README's table for a demo part under the thesis's settings: standing on the table of the default cell, target
/// 99 % of the coverable area or growth below 0.01 %.
fn thesis_row(name: &str, mesh: &Mesh, weight: f64) -> String {
    let cell = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset");
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    (params.score.a, params.score.b, params.selection.target) = (weight, weight, 0.99);
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &cell.scanner, cell: Some(&cell), roadmaps: None };
    let cancel = AtomicBool::new(false);
    let plan = plan(&input, &params, &Context::new(&cancel, &Silent)).expect("a plan").plan;
    let coverage = &plan.coverage;
    let percent = |share: f64| format!("{:.2} %", 100.0 * share);
    format!(
        "| {name} | {weight} / {weight} | {} | {} | {} | {} |",
        plan.views.len(),
        percent(coverage.of_coverable()),
        percent(coverage.of_asked()),
        percent(coverage.measured.grade_area_mm2[0] / coverage.asked_area_mm2)
    )
}

#[test]
#[ignore = "long: tests/all runs it"]
fn the_figures_of_the_demo_parts_are_what_a_plan_gives() {
    let parts = [
        ("base, 121 × 73 × 37 mm", demo_parts::base(DEFAULT_TRIANGLES)),
        ("figurine, 150 mm", demo_parts::figurine(DEFAULT_TRIANGLES)),
    ];
    let rows = parts.into_iter().flat_map(|(name, mesh)| {
        let mesh = mesh.expect("a demo part");
        [1.0, 0.5].map(|weight| thesis_row(name, &mesh, weight))
    });
    let table = rows.collect::<Vec<_>>().join("\n");
    println!("{table}");
    assert!(README.contains(&table), "README lacks\n{table}");
}
