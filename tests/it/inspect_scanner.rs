//! `vantage inspect SCANNER.toml` on the presets: the figures of `vantage::planning::method::scanner` beside
//! the stated boxes.

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

/// The thesis's own formulas for a rig that is symmetric, as they are printed, with L, θ, α and D₁ of the nominal rig.
#[test]
fn the_planar_construction_of_the_nominal_rig_is_that_of_the_printed_formulas() {
    let document: serde_json::Value = serde_json::from_str(&render(NOMINAL, true).expect("the preset is valid")).expect("JSON");
    let planar = &document["planar_construction"];
    let figure = |name: &str| planar[name].as_f64().unwrap_or_else(|| panic!("{name} in {planar}"));
    let (half_base, theta, inwards) = (101.0, 2.0 * (2000.0_f64 / 6668.0).atan(), 11.5_f64.to_radians());
    let alpha = (90.0_f64 - 11.5).to_radians() - 0.5 * theta;
    // The near plane is across the camera's axis and meets the scanner's axis at 410 mm.
    let d1 = 410.0 * inwards.cos() + half_base * inwards.sin();
    let (e1, e2) = (90.0_f64.to_radians() - alpha - 0.5 * theta, alpha + 0.5 * theta);
    // Lines y = m x + n, and where two of them meet.
    let l1 = (alpha.tan(), alpha.tan() * half_base);
    let l4 = (-(alpha + theta).tan(), (alpha + theta).tan() * half_base);
    let l6 = (e1.tan(), e1.tan() * (d1 * e2.cos() - half_base) + d1 * e2.sin());
    let meet = |(m1, n1): (f64, f64), (m2, n2): (f64, f64)| {
        let x = (n2 - n1) / (m1 - m2);
        (x, m1 * x + n1)
    };
    let ((x1, y1), (x2, y2)) = (meet(l1, l6), meet(l1, l4));
    let (w_opt, l_opt) = (y2 - y1, x1 + x2);
    // By hand: A₁ (133.35, 437.13), A₂ (142.26, 453.76).
    for (found, computed, by_hand) in [
        (figure("width_mm"), l_opt, 275.6129),
        (figure("depth_mm"), w_opt, 16.6300),
        (figure("best_mm"), y1 + 0.5 * w_opt, 445.4451),
        (figure("printed_best_mm"), y1 + w_opt, 453.7601),
        // The projector's field is 190 mm high at 480 mm; the cameras' is higher.
        (figure("height_mm"), 190.0 / 480.0 * (y1 + 0.5 * w_opt), 176.3220),
        (planar["near_mm"][0].as_f64().expect("left"), d1, 421.9053),
        (planar["near_mm"][1].as_f64().expect("right"), d1, 421.9053),
    ] {
        assert!((found - computed).abs() < 1e-6 && (found - by_hand).abs() < 1e-3, "{found}: {computed}, {by_hand} by hand");
    }
    let corners: [[f64; 2]; 4] = serde_json::from_value(planar["corners_mm"].clone()).expect("four points");
    for (found, expected) in corners.iter().zip([[x1, y1], [x2, y2], [-x1, y1], [-x2, y2]]) {
        assert!((found[0] - expected[0]).abs() < 1e-6 && (found[1] - expected[1]).abs() < 1e-6, "{found:?}, {expected:?}");
    }
    assert_eq!(planar["stated_mm"], serde_json::json!([275.0, 175.0, 80.0]));
}

#[test]
fn the_planar_construction_stands_beside_the_stated_box() {
    let text = render(NOMINAL, false).expect("the preset is valid");
    let beside = "L_opt × height × W_opt   275.6 × 176.3 × 16.6; stated by optics 275 × 175 × 80";
    assert!(text.contains(beside) && text.contains("445.4 (H_opt as printed: 453.8,"), "{text}");
    // A rig that is not symmetric has it as well: between the near and the far end of its working depth.
    let document: serde_json::Value =
        serde_json::from_str(&render(CALIBRATED, true).expect("the preset is valid")).expect("JSON");
    let best_mm = document["planar_construction"]["best_mm"].as_f64().expect("a number");
    assert!((410.0..=565.0).contains(&best_mm), "{best_mm}");
}

#[test]
fn the_limit_that_binds_the_working_depth_is_named() {
    let plain: serde_json::Value = serde_json::from_str(&render(NOMINAL, true).expect("the preset is valid")).expect("JSON");
    assert_eq!((&plain["near_bound"], &plain["far_bound"]), (&"practical".into(), &"practical".into()));
    assert!(!render(NOMINAL, false).expect("the preset is valid").contains("limited    near by"));
    // The thesis's projector: 480 ± 100, and a shorter one, beyond which the practical depth reaches.
    for (range, far_bound) in [("[380.0, 580.0]", "practical"), ("[380.0, 540.0]", "projector")] {
        let text = NOMINAL.replace("[projector]\n", &format!("[projector]\nin_focus_mm = {range}\n"));
        let document: serde_json::Value = serde_json::from_str(&render(&text, true).expect("valid")).expect("JSON");
        assert_eq!((&document["near_bound"], &document["far_bound"]), (&"practical".into(), &far_bound.into()), "{document}");
        let words = render(&text, false).expect("valid");
        let said = if far_bound == "practical" { "far by the practical depth" } else { "far by the projector's depth of field" };
        assert!(words.contains(said), "{words}");
    }
}

#[test]
fn what_is_wrong_is_named() {
    let wrong = NOMINAL.replace("mass_kg = 2.7", "mass_kg = -2.7").replace("near = 410.0", "near = 490.0");
    let Err(CliError::BadInput(message)) = render(&wrong, false) else { panic!("must be refused") };
    assert!(message.contains("/mass_kg") && message.contains("0.01 to 100 kg") && message.contains("/depth_mm"), "{message}");
    assert!(matches!(render("name = 3", false), Err(CliError::BadInput(_))));
}
