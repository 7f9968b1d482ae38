use clap::Parser;

use super::*;
use crate::cell::calibration::lens::DepthDatum;
use crate::cell::{ShapeSpec, preset_text};
use crate::wire::scanner_calibration::{DepthOriginFigures, FieldCheck, PitchFigures, RigFigures};

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    args: CalibrateScannerArgs,
}

fn args(options: &[&str]) -> Result<CalibrateScannerArgs, String> {
    Line::try_parse_from([&["scanner"], options].concat()).map(|line| line.args).map_err(|error| error.to_string())
}

const LEFT: &str = "fc = [ 6668.08312 ; 6667.42465 ];\ncc = [ 1939.53554 ; 1471.63556 ];\nalpha_c = -0.000153;\n\
    kc = [ -0.04359 ; 0.34600 ; -0.00209 ; -0.00112 ; -0.24560 ];\nfc_error = [ 0.00000 ; 0.00000 ];\n\
    Rc_1 = [ 0.98495 -0.01265 0.17236\n -0.00608 -0.99923 -0.03854\n 0.17272 0.03691 -0.98427 ];\n\
    Tc_1 = [ 0.42910 ; 1.40557 ; 558.72951 ];\n";
const RIGHT: &str = "fc = [ 6667.54259 ; 6668.18595 ];\ncc = [ 1972.47889 ; 1587.87192 ];\nalpha_c = 0.000093;\n\
    kc = [ -0.02110 ; 0.06457 ; -0.00094 ; 0.00093 ; 1.13432 ];\n\
    Rc_1 = [ 0.98034 -0.00948 -0.19708 ; -0.01441 -0.99961 -0.02360 ; -0.19678 0.02598 -0.98010 ];\n\
    Tc_1 = [ -1.69264 ; -7.15918 ; 566.12879 ];\n";

fn file(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("written");
    path.display().to_string()
}

#[test]
fn the_tables_of_the_thesis_become_a_specification_with_its_provenance_and_a_report() {
    let folder = tempfile::tempdir().expect("a folder");
    let (left, right) = (file(folder.path(), "left.m", LEFT), file(folder.path(), "right.m", RIGHT));
    let (out, report) = (folder.path().join("mine.toml"), folder.path().join("mine.html"));
    let (out_name, report_name) = (out.display().to_string(), report.display().to_string());
    let options = [
        left.as_str(),
        &right,
        "--image-size",
        "4000x3036",
        "--field",
        "300x190@480",
        "--depth",
        "410..565",
        "--name",
        "mine",
        "--out",
        &out_name,
        "--report",
        &report_name,
        "--plane",
        "410=434.5",
        "--plane",
        "480=504.5",
        "--plane",
        "565=589.5",
    ];
    run(&args(&options).expect("options")).expect("files");
    let spec: ScannerSpec = files::from_value(files::value(&out).expect("TOML"), "mine").expect("a scanner");
    let scanner = spec.build().expect("valid");
    assert!((scanner.baseline_mm() - 209.94).abs() < 0.005 && (scanner.axes_angle_rad().to_degrees() - 21.30).abs() < 0.01);
    let calibrated = spec.calibrated.as_ref().expect("provenance");
    assert_eq!((calibrated.by.as_str(), &calibrated.at, calibrated.residuals), ("import from bouguet", &None, None));
    assert_eq!(calibrated.data_sha256.len(), 64);
    assert!((spec.depth_origin_mm.expect("planes were given") - 24.5).abs() < 1e-9 && (scanner.best_mm - 504.5).abs() < 1e-9);
    let page = std::fs::read_to_string(report).expect("the report");
    assert!(page.contains("209.941") && page.contains("single board") && page.contains("uncertainty not known"), "{page}");
}

#[test]
fn what_cannot_be_used_is_told_with_file_and_code() {
    let folder = tempfile::tempdir().expect("a folder");
    let (left, right) = (file(folder.path(), "left.m", LEFT), file(folder.path(), "right.m", RIGHT));
    let error = run(&args(&[&left, &right]).expect("options")).expect_err("no size");
    assert!(error.exit_code() == 2 && error.to_string().contains("(missing_image_size)"), "{error}");
    let error = run(&args(&[&left, "--image-size", "4000x3036"]).expect("options")).expect_err("one camera");
    assert!(error.to_string().contains("(missing_device)"), "{error}");
    let strange = file(folder.path(), "strange.txt", "hello");
    let error = run(&args(&[&strange]).expect("options")).expect_err("strange");
    assert!(error.to_string().contains("unknown_format"), "{error}");
    // It was told to be in no known format.
    let empty = file(folder.path(), "empty.yml", "\n");
    let error = run(&args(&[&empty]).expect("options")).expect_err("empty");
    assert!(error.to_string().ends_with("empty.yml: is empty (unreadable); export the calibration again"), "{error}");
    let error = run(&args(&[&left, "--hold", "fx"]).expect("options")).expect_err("not held");
    assert!(error.to_string().contains("skew, k1, k2, p1, p2, k3"), "{error}");
    assert!(args(&[&left, "--field", "300x190"]).expect_err("no distance").contains("as in 300x190@480"));
    assert!(args(&[&left, "--from", "word"]).expect_err("no format").contains("opencv, bouguet"));
}

/// ± was told of one standard deviation.
#[test]
fn figures_are_told_with_standard_deviations_as_far_as_they_are_known() {
    let mut document = ScannerCalibration {
        schema: "vantage.scanner_calibration/1",
        scanner: "mine".to_owned(),
        from: Vec::new(),
        files: Vec::new(),
        data_sha256: String::new(),
        taken_at: None,
        converged: None,
        iterations: None,
        rig: RigFigures {
            baseline_mm: 209.94,
            baseline_sigma_mm: Some(0.012),
            axes_angle_deg: 21.3,
            axes_angle_sigma_deg: Some(0.001_2),
            boards: None,
            board_baseline_mm: None,
            board_turn_deg: None,
        },
        devices: Vec::new(),
        epipolar_rms_px: Some(0.05),
        board_pitch: Some(PitchFigures { rms_mm: 0.01, mean_mm: -0.000_04, count: 100 }),
        views: Vec::new(),
        board_depth_mm: None,
        field: FieldCheck { depth_mm: 480.0, cameras_mm: [289.0, 190.0], common_mm: [278.0, 190.0], stated_mm: None },
        depth_origin: Some(DepthOriginFigures {
            origin_mm: -0.001,
            sigma_mm: 0.03,
            scale: 1.0,
            datum: DepthDatum::ALL[0],
            residuals_mm: Vec::new(),
        }),
        assumed: Vec::new(),
        warnings: Vec::new(),
    };
    let told = summary(&document);
    for line in [
        "baseline 209.94 mm (standard deviation 0.012 mm), optical axes 21.30° apart (standard deviation 0.0012°)\n",
        "0.0100 mm rms (+0.0000 mean)\n",
        "counts from z = 0.00 mm (standard deviation 0.03 mm) (",
    ] {
        assert!(told.contains(line), "{line:?} is not in\n{told}");
    }
    assert!(!told.contains("converged"), "nothing was adjusted: {told}");
    for (is_converged, line) in
        [(true, "\nadjusted  converged in 31 iterations\n"), (false, "not converged after 31 iterations\n")]
    {
        (document.converged, document.iterations) = (Some(is_converged), Some(31));
        assert!(summary(&document).contains(line), "{}", summary(&document));
    }
    (document.rig.baseline_sigma_mm, document.rig.axes_angle_sigma_deg) = (None, None);
    assert!(
        summary(&document).starts_with("scanner mine: baseline 209.94 mm, optical axes 21.30° apart\n"),
        "{}",
        summary(&document)
    );
}

/// A mesh was named from the folder of the specification that was read, or from the working folder.
#[test]
fn a_mesh_is_named_from_the_folder_of_the_specification_that_is_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    ["a", "b"].iter().for_each(|name| std::fs::create_dir(path(name)).expect("a folder"));
    let preset = preset_text(SpecKind::Scanner, "transcan-c").expect("a preset");
    let (plain, housing) = (file(folder.path(), "plain.toml", preset), file(folder.path(), "a/housing.stl", ""));
    let meshed = preset.replace("kind = \"box\", size_mm = [300.0, 130.0, 110.0]", "kind = \"mesh\", mesh = \"housing.stl\"");
    let meshed = file(folder.path(), "a/s.toml", &meshed);
    for (options, out, named) in [
        (&[meshed.as_str()][..], "b/s.toml", housing.as_str()),
        (&[plain.as_str(), "--like", &meshed][..], "b/like.toml", housing.as_str()),
        (&[plain.as_str(), "--like", &meshed][..], "a/like.toml", "housing.stl"),
    ] {
        let out = path(out);
        run(&args(&[options, &["--out", &out][..]].concat()).expect("options")).expect("a file");
        let written = std::fs::read_to_string(&out).expect("the file");
        assert!(written.contains(&format!("mesh = {named:?}")), "{written}");
        let spec = files::FileLibrary.scanner(&out).expect("a scanner");
        assert_eq!(spec.body[0].shape, ShapeSpec::Mesh { mesh: housing.clone() });
    }
}
