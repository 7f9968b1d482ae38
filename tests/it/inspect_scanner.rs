//! `vantage inspect SCANNER.toml` on the presets: the figures of method §2 beside the stated boxes.

use vantage::cli::CliError;
use vantage::cli::inspect_scanner::render;

const CALIBRATED: &str = include_str!("../../config/scanners/transcan-c.toml");
const NOMINAL: &str = include_str!("../../config/scanners/transcan-c-nominal.toml");

#[test]
fn calibrated_rig_is_described_with_its_figures() {
    let text = render(CALIBRATED, false).expect("the preset is valid");
    println!("{text}");
    for figure in ["baseline 209.94 mm", "21.3", "275 × 175 × 80", "260 × 165 × 140", "140 × 140 × 140", "largest cuboid"] {
        assert!(text.contains(figure), "{figure} is missing in\n{text}");
    }
}

#[test]
fn json_holds_the_same_facts() {
    let document: serde_json::Value = serde_json::from_str(&render(NOMINAL, true).expect("the preset is valid")).expect("JSON");
    assert_eq!(document["schema"], "vantage.scanner_facts/1");
    assert!((document["baseline_mm"].as_f64().expect("a number") - 202.0).abs() < 1e-9);
    assert!((document["axes_angle_deg"].as_f64().expect("a number") - 23.0).abs() < 1e-9);
    let volume = &document["volume"];
    let cuboid: Vec<f64> = serde_json::from_value(volume["largest_cuboid_mm"].clone()).expect("three numbers");
    assert!((cuboid[2] - 140.0).abs() < 1e-6, "the near depth is 70 mm before best focus: {cuboid:?}");
    for stated in volume["stated"].as_array().expect("boxes") {
        let (inside, leaves) = (stated["inside"].as_f64().expect("a share"), stated["excess"].as_array().expect("a list"));
        assert!(inside > 0.5 && inside <= 1.0 + 1e-9, "{stated}");
        assert_eq!(inside > 1.0 - 1e-9, leaves.is_empty(), "{stated}");
    }
    // The practical box is 260 wide; the projector's field at 410 mm is 256.25.
    let practical = volume["stated"].as_array().expect("boxes").iter().find(|b| b["name"] == "practical").expect("listed");
    assert!(practical["excess"].as_array().expect("a list").iter().any(|e| e["of"] == "projector"));
}

#[test]
fn what_is_wrong_is_named() {
    let wrong = NOMINAL.replace("mass_kg = 2.7", "mass_kg = -2.7").replace("near = 410.0", "near = 490.0");
    let Err(CliError::BadInput(message)) = render(&wrong, false) else { panic!("must be refused") };
    assert!(message.contains("/mass_kg") && message.contains("0.01 to 100 kg") && message.contains("/depth_mm"), "{message}");
    assert!(matches!(render("name = 3", false), Err(CliError::BadInput(_))));
}
