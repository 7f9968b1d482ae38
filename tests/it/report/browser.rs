//! Pages of the report in a real browser: nothing runs over, many views stay short, and numbers stand where they are seen.

use std::process::{Command, Stdio};

use serde_json::Value;

use super::markup::well_formed;
use super::{page, sphere, sphere_outcome, turned_over, with_views};
use crate::support::chromium;
use vantage::wire::echo::Echo;

/// Measures the page once it is laid out, and leaves what it found in the document.
const SCRIPT: &str = r##"<script>
addEventListener("load", () => {
  const root = document.documentElement;
  const boxes = [...document.querySelectorAll("main .card, main figure, .figure, .stop, .panels, .verdict, td, dd, section, header")];
  const name = (box) => `${box.tagName} ${box.className} ${box.textContent.slice(0, 60)}`;
  const over = boxes.filter((box) => box.scrollWidth > box.clientWidth + 1 && getComputedStyle(box).display !== "inline").map(name);
  const spots = [...document.querySelectorAll("g.spot")].filter((spot) => {
    const [disc, picture] = [spot.getBoundingClientRect(), spot.closest(".picture").getBoundingClientRect()];
    const inside = disc.left >= picture.left - 1 && disc.right <= picture.right + 1 && disc.top >= picture.top - 1 && disc.bottom <= picture.bottom + 1;
    return inside && disc.width > 0;
  }).map((spot) => spot.dataset.spot);
  const drawings = [...document.querySelectorAll("figure.lay svg")].map((svg) => Math.round(svg.getBoundingClientRect().width));
  const found = { width: root.scrollWidth, client: root.clientWidth, height: root.scrollHeight, over, spots, drawings };
  document.body.append(Object.assign(document.createElement("pre"), { id: "measured", textContent: JSON.stringify(found) }));
});
</script></body>"##;

/// Sizes of a page at a width of the window, in pixels.
fn measured(browser: &std::path::Path, page: &str, width_px: u32) -> Value {
    well_formed(page).expect("well-formed");
    let folder = tempfile::tempdir().expect("a folder");
    let policy = page.find("<meta http-equiv=").expect("a policy");
    let end = policy + page[policy..].find("/>").expect("its end") + 2;
    let page = [&page[..policy], &page[end..]].concat().replace("</body>", SCRIPT);
    let file = folder.path().join("report.html");
    std::fs::write(&file, page).expect("a file");
    let output = Command::new("timeout")
        .arg("120")
        .arg(browser)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--no-first-run",
            "--hide-scrollbars",
            "--disable-background-networking",
        ])
        .args(["--virtual-time-budget=4000", "--dump-dom"])
        .arg(format!("--window-size={width_px},900"))
        .arg(format!("--user-data-dir={}", folder.path().join("profile").display()))
        .arg(format!("file://{}", file.display()))
        .stderr(Stdio::null())
        .output()
        .expect("the browser runs");
    let dom = String::from_utf8_lossy(&output.stdout);
    let found =
        dom.split("<pre id=\"measured\">").nth(1).and_then(|rest| rest.split("</pre>").next()).expect("what was measured");
    let found = found.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    serde_json::from_str(&found).expect("JSON")
}

#[test]
fn nothing_runs_over_at_two_widths_and_every_drawing_is_there() {
    let Some(browser) = chromium() else { return };
    let mesh = sphere();
    let long = "a part with a long name_that_has_no_place_to_break_0123456789_0123456789_0123456789_0123456789.stl";
    let echo = Echo {
        labels: [("order".to_owned(), "0123456789".repeat(12))].into(),
        part_number: Some("4711".repeat(20)),
        ..Echo::default()
    };
    let page = page(&mesh, &turned_over(sphere_outcome(&mesh)), long, &echo);
    for width_px in [1280, 800] {
        let found = measured(&browser, &page, width_px);
        assert!(found["width"].as_u64() <= found["client"].as_u64(), "{width_px} px: {found}");
        assert_eq!(found["over"], serde_json::json!([]), "{width_px} px");
        let drawings = found["drawings"].as_array().expect("drawings");
        assert_eq!(drawings.len(), 6, "from above, from the front, and enlarged, a setup");
        assert!(drawings.iter().all(|width| width.as_u64() >= Some(200)), "{width_px} px: {found}");
    }
}

#[test]
fn ninety_eight_views_stay_short() {
    let Some(browser) = chromium() else { return };
    let mesh = sphere();
    let page = page(&mesh, &with_views(sphere_outcome(&mesh), 98), "sphere", &Echo::default());
    let found = measured(&browser, &page, 1280);
    let height_px = found["height"].as_u64().expect("a height");
    assert!((2_000..12_000).contains(&height_px), "{height_px} px");
    assert_eq!(found["over"], serde_json::json!([]));
}

#[test]
fn numbers_of_spots_are_seen_in_the_pictures() {
    let Some(browser) = chromium() else { return };
    let mesh = sphere();
    let found = measured(&browser, &page(&mesh, &sphere_outcome(&mesh), "sphere", &Echo::default()), 1280);
    let spots: std::collections::BTreeSet<&str> =
        found["spots"].as_array().expect("spots").iter().filter_map(Value::as_str).collect();
    assert_eq!(spots, ["1", "2"].into());
}
