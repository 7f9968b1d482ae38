//! The page at `/` in a real browser: it must list a job and link its results, without scripts failing.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::prefix_proxy;
use super::process::Server;
use crate::support::chromium;

#[test]
fn the_page_lists_a_job_and_links_its_results() {
    page_lists_and_links("");
}

#[test]
fn the_page_works_below_a_path_that_a_proxy_strips() {
    page_lists_and_links(prefix_proxy::PREFIX);
}

/// Opens the page, below `prefix` by a proxy if there is one, and looks at what it lists.
fn page_lists_and_links(prefix: &str) {
    let Some(browser) = chromium() else { return };
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let mesh = server.upload().expect("a mesh");
    // One view cannot measure all sides of a cube.
    let regions = r#""regions": {"interest": [{"name": "every side", "region": {"kind": "sphere", "centre_mm": [0, 0, 0], "radius_mm": 999}, "target": 1}]}"#;
    let params = format!(r#"{{"selection": {{"max_views": 1}}, "part": {{"samples_per_mm2": 0.05}}, {regions}}}"#);
    let job = server.submit(&mesh, &params).expect("a job");
    let id = job["id"].as_str().expect("an id");
    let ended = server.ended(id);
    assert_eq!(ended["state"], "succeeded");
    let text = |field: &str| ended["summary"][field].as_str().expect("a sentence");
    let summary = [text("verdict_text"), text("views_text"), text("coverage_text")];
    // Quotes stay as they are between tags.
    assert!(summary.iter().all(|text| !text.contains(['<', '>', '&'])), "{summary:?}");

    let address = if prefix.is_empty() { server.address } else { prefix_proxy::start(server.address) };
    let page = format!("http://{address}{prefix}/");
    let profile = tempfile::tempdir().expect("a folder");
    let started = Command::new("timeout")
        .arg("60")
        .arg(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"])
        .args(["--disable-background-networking", "--disable-component-update", "--virtual-time-budget=4000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(page)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("the browser starts");
    // The page keeps its stream of events open, and the browser's virtual time stands still with it: once the page has
    // asked for everything, the server's end lets the browser come to its own.
    wait_for_route(&server, "/api/v1/events");
    std::thread::sleep(Duration::from_secs(2));
    drop(server);
    let output = started.wait_with_output().expect("the browser ends");
    let page = String::from_utf8_lossy(&output.stdout);
    let list = page.split("<template").next().expect("what stands before the template");
    let links = ["plan", "report", "files/regions.csv"].map(|path| format!("\"{prefix}/api/v1/jobs/{id}/{path}\""));
    for wanted in ["succeeded", &links[0], &links[1], &links[2], "every side", "not met"].into_iter().chain(summary) {
        assert!(list.contains(wanted), "{wanted} is not in\n{list}");
    }
}

/// Waits until the server has been asked for `route`.
fn wait_for_route(server: &Server, route: &str) {
    let asked = || {
        let mut answer = ureq::get(server.url("/metrics")).call().expect("an answer");
        answer.body_mut().read_to_string().expect("text").contains(&format!("route=\"{route}\""))
    };
    let until = Instant::now() + Duration::from_secs(60);
    while !asked() {
        assert!(Instant::now() < until, "the page does not ask for {route}");
        std::thread::sleep(Duration::from_millis(100));
    }
}
