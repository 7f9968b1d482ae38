//! The page at `/` in a real browser: it must list a job and link its results, without scripts failing.

use std::process::Command;

use super::process::Server;
use crate::support::chromium;

#[test]
fn the_page_lists_a_job_and_links_its_results() {
    let Some(browser) = chromium() else { return };
    let data = tempfile::tempdir().expect("a folder");
    let server = Server::start(data.path(), &[]);
    let mesh = server.upload().expect("a mesh");
    let job = server.submit(&mesh, r#"{"selection": {"max_views": 1}, "part": {"samples_per_mm2": 0.05}}"#).expect("a job");
    let id = job["id"].as_str().expect("an id");
    assert_eq!(server.ended(id)["state"], "succeeded");

    let profile = tempfile::tempdir().expect("a folder");
    let output = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"])
        .args(["--disable-background-networking", "--disable-component-update", "--virtual-time-budget=4000", "--dump-dom"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(server.url("/"))
        .output()
        .expect("the browser starts");
    let page = String::from_utf8_lossy(&output.stdout);
    let list = page.split("<template").next().expect("what stands before the template");
    for wanted in ["succeeded", &format!("/api/v1/jobs/{id}/plan"), &format!("/api/v1/jobs/{id}/report")] {
        assert!(list.contains(wanted), "{wanted} is not in\n{list}");
    }
}
