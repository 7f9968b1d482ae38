//! One rig in every format: the same lens, whatever each program means by its numbers.

use super::*;
use crate::geometry::LengthUnit;

const OPENCV_YAML: &str = "%YAML:1.0
M1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 6668.08312, -1.02021671736, 1939.03554, 0., 6667.42465, 1471.13556, 0., 0., 1. ]
D1: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -4.359e-02, 3.46e-01, -2.09e-03, -1.12e-03, -2.456e-01 ]
M2: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 6667.54259, 0., 1971.97889, 0., 6668.18595, 1587.37192, 0., 0., 1. ]
D2: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.0211, 0.06457, -0.00094, 0.00093, 1.13432 ]
R: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 0.93, 0., -0.367559518989781, 0., 1., 0., 0.367559518989781, 0., 0.93 ]
T: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ -205., 1.5, 40. ]
image_width: 4000
image_height: 3036
";

const OPENCV_XML: &str = "<?xml version=\"1.0\"?>
<opencv_storage>
<M1 type_id=\"opencv-matrix\"><rows>3</rows><cols>3</cols><dt>d</dt><data>6668.08312 -1.02021671736 1939.03554 0. 6667.42465 1471.13556 0. 0. 1.</data></M1>
<D1 type_id=\"opencv-matrix\"><rows>1</rows><cols>5</cols><dt>d</dt><data>-4.359e-02 3.46e-01 -2.09e-03 -1.12e-03 -2.456e-01</data></D1>
<M2 type_id=\"opencv-matrix\"><rows>3</rows><cols>3</cols><dt>d</dt><data>6667.54259 0. 1971.97889 0. 6668.18595 1587.37192 0. 0. 1.</data></M2>
<D2 type_id=\"opencv-matrix\"><rows>1</rows><cols>5</cols><dt>d</dt><data>-0.0211 0.06457 -0.00094 0.00093 1.13432</data></D2>
<R type_id=\"opencv-matrix\"><rows>3</rows><cols>3</cols><dt>d</dt><data>0.93 0. -0.367559518989781 0. 1. 0. 0.367559518989781 0. 0.93</data></R>
<T type_id=\"opencv-matrix\"><rows>3</rows><cols>1</cols><dt>d</dt><data>-205. 1.5 40.</data></T>
<image_size>4000 3036</image_size>
</opencv_storage>
";

const OPENCV_JSON: &str = r#"{
 "cameraMatrix1": {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "dt": "d", "data": [6668.08312, -1.02021671736, 1939.03554, 0.0, 6667.42465, 1471.13556, 0.0, 0.0, 1.0]},
 "distCoeffs1": {"type_id": "opencv-matrix", "rows": 1, "cols": 8, "dt": "d", "data": [-0.04359, 0.346, -0.00209, -0.00112, -0.2456, 0.0, 0.0, 0.0]},
 "cameraMatrix2": [[6667.54259, 0, 1971.97889], [0, 6668.18595, 1587.37192], [0, 0, 1]],
 "distCoeffs2": [-0.0211, 0.06457, -0.00094, 0.00093, 1.13432],
 "R": [[0.93, 0, -0.367559518989781], [0, 1, 0], [0.367559518989781, 0, 0.93]],
 "T": [-205, 1.5, 40],
 "imageSize": [4000, 3036]}"#;

const BOUGUET: &str = "% Intrinsic and extrinsic parameters of both cameras
fc_left = [ 6668.08312 ; 6667.42465 ];
cc_left = [ 1939.03554 ; 1471.13556 ];
alpha_c_left = -0.000153;
kc_left = [ -0.04359 ; 0.34600 ; -0.00209 ; -0.00112 ; -0.24560 ]; % with five
fc_left_error = [ 3 ; 3 ];
fc_error_left = [ 3.0 ; 3.3 ];
cc_error_left = [ 6.0 ; 6.6 ];
alpha_c_error_left = 0.00003;
kc_error_left = [ 0.009 ; 0.3 ; 0.0003 ; 0.0003 ; ...
   3.0 ];
fc_right = [ 6667.54259, 6668.18595 ];
cc_right = [ 1971.97889
 1587.37192 ];
alpha_c_right = 0;
kc_right = [ -0.02110 ; 0.06457 ; -0.00094 ; 0.00093 ; 1.13432 ];
nx = 4000;
ny = 3036;
R = [ 0.93 0 -0.367559518989781 ; 0 1 0 ; 0.367559518989781 0 0.93 ];
T = [ -205 ; 1.5 ; 40 ];
";

const MATLAB: &str = r#"{"CameraParameters1": {"ImageSize": [3036, 4000],
  "IntrinsicMatrix": [[6668.08312, 0, 0], [-1.02021671736, 6667.42465, 0], [1940.03554, 1472.13556, 1]],
  "RadialDistortion": [-0.04359, 0.346, -0.2456], "TangentialDistortion": [-0.00209, -0.00112]},
 "CameraParameters2": {"ImageSize": [3036, 4000],
  "K": [[6667.54259, 0, 1972.97889], [0, 6668.18595, 1588.37192], [0, 0, 1]],
  "RadialDistortion": [-0.0211, 0.06457, 1.13432], "TangentialDistortion": [-0.00094, 0.00093]},
 "RotationOfCamera2": [[0.93, 0, 0.367559518989781], [0, 1, 0], [-0.367559518989781, 0, 0.93]],
 "TranslationOfCamera2": [-205, 1.5, 40], "WorldUnits": "millimeters"}"#;

/// Kalibr has neither skew nor a fifth coefficient.
const KALIBR: &str = "cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.04359, 0.346, -0.00209, -0.00112]
  distortion_model: radtan
  intrinsics: [6668.08312, 6667.42465, 1939.03554, 1471.13556]
  resolution: [4000, 3036]
  rostopic: /left
cam1:
  T_cn_cnm1:
  - [0.93, 0.0, -0.367559518989781, -0.205]
  - [0.0, 1.0, 0.0, 0.0015]
  - [0.367559518989781, 0.0, 0.93, 0.040]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.0211, 0.06457, -0.00094, 0.00093]
  distortion_model: radtan
  intrinsics: [6667.54259, 6668.18595, 1971.97889, 1587.37192]
  resolution: [4000, 3036]
";

fn rig(text: &str) -> Rig {
    let format = detect(text).expect("a known format");
    let file = read(text, format, &ImportOptions::default()).unwrap_or_else(|error| panic!("{format:?}: {error}"));
    assemble(&[file]).unwrap_or_else(|error| panic!("{format:?}: {error}"))
}

fn refused(text: &str, options: &ImportOptions) -> LensError {
    let format = detect(text).expect("a known format");
    read(text, format, options).and_then(|file| assemble(&[file])).expect_err("refused")
}

#[test]
fn matlab_s_world_units_count() {
    let read = |units: &str, unit: Option<LengthUnit>| {
        let text = MATLAB.replace("\"millimeters\"", &format!("{units:?}"));
        super::super::import::read(&text, CalibrationFormat::Matlab, &ImportOptions { unit, ..ImportOptions::default() })
    };
    let shift_mm = |file: ImportedFile| file.right_from_left.expect("a pose").translation.vector.x;
    for (units, given, wanted_mm) in [
        ("millimeters", None, -205.0),
        ("centimeters", None, -2050.0),
        ("inches", Some(LengthUnit::Inch), -205.0 * 25.4),
        ("", Some(LengthUnit::Centimetre), -2050.0),
        ("", None, -205.0),
    ] {
        let found_mm = shift_mm(read(units, given).unwrap_or_else(|error| panic!("{units}: {error}")));
        assert!((found_mm - wanted_mm).abs() < 1e-9, "{units} {given:?}: {found_mm}");
    }
    for (units, given) in [("centimeters", Some(LengthUnit::Millimetre)), ("squares", None)] {
        assert_eq!(read(units, given).expect_err(units).pointer, "WorldUnits");
    }
}

#[test]
fn opencv_s_own_sample_names_a_fisheye_model_that_is_off() {
    let with = |line: &str| format!("{}{line}\n", OPENCV_YAML.trim_end_matches("...\n"));
    let read = |line: &str| super::super::import::read(&with(line), CalibrationFormat::Opencv, &ImportOptions::default());
    assert!(read("fisheye_model: 0").is_ok() && read("model: DS-2CD").is_ok());
    assert!(read("fisheye_model: 1").is_err() && read("model: ds").is_err());
}

#[test]
fn one_rig_has_one_lens_in_every_format() {
    let wanted_left = [6668.08312, 6667.42465, 1939.53554, 1471.63556, -0.000153, -0.04359, 0.346, -0.00209, -0.00112, -0.2456];
    let wanted_right = [6667.54259, 6668.18595, 1972.47889, 1587.87192, 0.0, -0.0211, 0.06457, -0.00094, 0.00093, 1.13432];
    let formats = [
        (OPENCV_YAML, "opencv"),
        (OPENCV_XML, "opencv"),
        (OPENCV_JSON, "opencv"),
        (BOUGUET, "bouguet"),
        (MATLAB, "matlab"),
        (KALIBR, "kalibr"),
    ];
    for (text, format) in formats {
        assert_eq!(detect(text).map(CalibrationFormat::as_str), Some(format));
        let rig = rig(text);
        for (device, wanted) in [(rig.devices.left, wanted_left), (rig.devices.right, wanted_right)] {
            let lens = device.expect("a lens").lens;
            assert_eq!(lens.size_px, [4000, 3036], "{format}");
            for (index, (found, wanted)) in lens.values().into_iter().zip(wanted).enumerate() {
                // Kalibr's model has neither skew nor k3.
                let wanted = if format == "kalibr" && matches!(index, 4 | 9) { 0.0 } else { wanted };
                assert!((found - wanted).abs() < 1e-9, "{format} {}: {found}, {wanted}", PARAMETER_NAMES[index]);
            }
        }
        let pose = rig.right_from_left;
        assert!((pose.translation.vector - Vector3::new(-205.0, 1.5, 40.0)).norm() < 1e-9, "{format}: {pose}");
        // A point on the left axis is seen to the left in the right camera: the axes converge.
        let turned = pose.rotation * Vector3::z();
        assert!((turned - Vector3::new(-0.367_559_518_989_781, 0.0, 0.93)).norm() < 1e-9, "{format}: {turned}");
    }
}

#[test]
fn a_specification_written_here_reads_back_as_it_was() {
    let rig = rig(THESIS);
    let scanner = thesis();
    assert_eq!(rig.devices.left.expect("left").lens, parameters(&scanner, DeviceName::Left));
    assert!((rig.right_from_left.translation.vector.norm() - scanner.baseline_mm()).abs() < 1e-9);
    assert!(rig.projector_from_left.is_some());
}

#[test]
fn uncertainty_is_that_of_the_file_or_none() {
    let rig = rig(BOUGUET);
    let sigma = rig.devices.left.expect("left").sigma.expect("given");
    // Three standard deviations are printed.
    assert!((sigma[0].expect("fx") - 1.0).abs() < 1e-12 && (sigma[9].expect("k3") - 1.0).abs() < 1e-12);
    assert_eq!(rig.devices.right.expect("right").sigma, None, "none is given");
    let zeros = BOUGUET.replace("[ 3.0 ; 3.3 ]", "[0;0]").replace("[ 6.0 ; 6.6 ]", "[0;0]").replace("0.00003", "0.00000");
    let zeros = zeros.replace("[ 0.009 ; 0.3 ; 0.0003 ; 0.0003 ; ...\n   3.0 ]", "[0;0;0;0;0]");
    assert_eq!(super::formats::rig(&zeros).devices.left.expect("left").sigma, None, "zeros are not uncertainties");
}

/// Tables 4.4 and 4.5 as the toolbox would have written them: their principal points count from the centre of a pixel.
fn thesis_tables() -> [&'static str; 2] {
    [
        "fc = [ 6668.08312 ; 6667.42465 ];\ncc = [ 1939.53554 ; 1471.63556 ];\nalpha_c = -0.000153;\n\
         kc = [ -0.04359 ; 0.34600 ; -0.00209 ; -0.00112 ; -0.24560 ];\nfc_error = [ 0.00000 ; 0.00000 ];\ncc_error = [ 0 ; 0 ];\n\
         kc_error = [ 0;0;0;0;0 ];\nnx = 4000;\nny = 3036;\n\
         Rc_1 = [ 0.98495 -0.01265 0.17236\n -0.00608 -0.99923 -0.03854\n 0.17272 0.03691 -0.98427 ];\n\
         Tc_1 = [ 0.42910 ; 1.40557 ; 558.72951 ];\n",
        "fc = [ 6667.54259 ; 6668.18595 ];\ncc = [ 1972.47889 ; 1587.87192 ];\nalpha_c = 0.000093;\n\
         kc = [ -0.02110 ; 0.06457 ; -0.00094 ; 0.00093 ; 1.13432 ];\nnx = 4000;\nny = 3036;\n\
         Rc_1 = [ 0.98034 -0.00948 -0.19708 ; -0.01441 -0.99961 -0.02360 ; -0.19678 0.02598 -0.98010 ];\n\
         Tc_1 = [ -1.69264 ; -7.15918 ; 566.12879 ];\n",
    ]
}

#[test]
fn the_tables_of_the_thesis_give_its_rig() {
    let files = thesis_tables().map(|text| read(text, CalibrationFormat::Bouguet, &ImportOptions::default()).expect("a table"));
    let rig = assemble(&files).expect("a rig");
    assert_eq!(rig.scatter.map(|scatter| (scatter.boards, scatter.max_turn_deg)), Some((1, None)), "one board has no scatter");
    assert_eq!(rig.devices.left.expect("left").sigma, None, "± 0.00000 is not an uncertainty");
    let figures =
        DraftFigures { field_mm: Some([300.0, 190.0, 480.0]), depth_mm: Some([410.0, 565.0]), ..DraftFigures::default() };
    let draft = ScannerDraft::new(&rig, &figures, provenance()).expect("a specification");
    let DraftChecks { baseline_mm, axes_angle_deg, common_field, .. } = draft.checks;
    let [width, height] = common_field.size_mm();
    println!("{baseline_mm:.2} mm, {axes_angle_deg:.2}°, {width:.1} × {height:.1} mm beside 300 × 190");
    assert!((baseline_mm - 209.94).abs() < 0.005 && (axes_angle_deg - 21.30).abs() < 0.01, "{baseline_mm} {axes_angle_deg}");
    assert!((width - 278.0).abs() < 0.6 && (height - 190.0).abs() < 0.6, "{width} × {height}");
    assert!(draft.assumptions.contains(&Assumption::Projector) && draft.lit.is_none());
    // Text of the specification reads back to the same rig.
    let text = toml::to_string_pretty(&draft.spec).expect("TOML");
    let again = super::formats::rig(&text);
    assert_eq!(again.devices.left.expect("left").lens, rig.devices.left.expect("left").lens);
    assert!((again.right_from_left.translation.vector - rig.right_from_left.translation.vector).norm() < 1e-9);
}

#[test]
fn several_boards_are_averaged_and_their_scatter_is_told() {
    let second = |text: &str, shift: f64| {
        let own = text.replace("Rc_1", "Rc_2").replace("558.72951", &format!("{}", 558.72951 + shift));
        let poses: String =
            own.lines().skip_while(|line| !line.starts_with("Rc_2")).map(|line| line.replace("Tc_1", "Tc_2") + "\n").collect();
        format!("{text}{poses}")
    };
    let [left, right] = thesis_tables();
    let files = [second(left, 2.0), second(right, 0.0)];
    let files = files.map(|text| read(&text, CalibrationFormat::Bouguet, &ImportOptions::default()).expect("a table"));
    let scatter = assemble(&files).expect("a rig").scatter.expect("boards");
    let [low, high] = scatter.baseline_mm;
    assert!(scatter.boards == 2 && high - low > 0.2 && low > 205.0, "{scatter:?}");
}

#[test]
fn distortion_of_more_coefficients_is_met_by_five_or_refused() {
    let with =
        |coefficients: &str| OPENCV_JSON.replace("-0.04359, 0.346, -0.00209, -0.00112, -0.2456, 0.0, 0.0, 0.0", coefficients);
    // A mild rational model over a view of 33°.
    let mild = rig(&with("0.05, 0.12, -0.0003, 0.0002, 0.01, 0.09, 0.08, 0.002"));
    let fit = mild.devices.left.expect("left").fit.expect("more than five");
    println!("8 coefficients by 5: {} px", fit.worst_px);
    assert!(fit.given == 8 && fit.worst_px < 0.1, "{fit:?}");
    let thin = OPENCV_JSON.replace(
        "\"rows\": 1, \"cols\": 8, \"dt\": \"d\", \"data\": [-0.04359, 0.346, -0.00209, -0.00112, -0.2456, 0.0, 0.0, 0.0]",
        "\"rows\": 1, \"cols\": 14, \"dt\": \"d\", \"data\": [-0.05, 0.1, 0, 0, 0, 0, 0, 0, 0.05, 0.5, -0.04, 0.4, 0.01, 0.0]",
    );
    assert_eq!(refused(&thin, &ImportOptions::default()).code, LensFault::TooManyCoefficients);
    let six = OPENCV_YAML.replace("cols: 5\n   dt: d\n   data: [ -4.359e-02,", "cols: 6\n   dt: d\n   data: [ 0.0, -4.359e-02,");
    assert_eq!(refused(&six, &ImportOptions::default()).code, LensFault::WrongShape);
}

#[test]
fn every_trap_of_a_format_has_its_code() {
    let no_size = OPENCV_YAML.replace("image_width: 4000\nimage_height: 3036\n", "");
    assert_eq!(refused(&no_size, &ImportOptions::default()).code, LensFault::MissingImageSize);
    let given = ImportOptions { image_size_px: Some([4000, 3036]), ..ImportOptions::default() };
    let file = read(&no_size, CalibrationFormat::Opencv, &given).expect("the option gives it");
    assert_eq!(file.lenses[0].lens.size_px, [4000, 3036]);
    for model in ["equidistant", "fov", "equi"] {
        assert_eq!(refused(&KALIBR.replace("radtan", model), &ImportOptions::default()).code, LensFault::Fisheye);
    }
    for model in ["omni", "ds", "eucm"] {
        let text = KALIBR.replace("camera_model: pinhole", &format!("camera_model: {model}"));
        assert_eq!(refused(&text, &ImportOptions::default()).code, LensFault::Fisheye);
    }
    let fisheye = format!("{OPENCV_YAML}fisheye_model: 1\n");
    assert_eq!(refused(&fisheye, &ImportOptions::default()).code, LensFault::Fisheye);
    let metres = OPENCV_YAML.replace("[ -205., 1.5, 40. ]", "[ -0.205, 0.0015, 0.040 ]");
    let error = refused(&metres, &ImportOptions::default());
    assert!(error.code == LensFault::UnitMismatch && error.detail.contains("--unit m"), "{error}");
    let unit = ImportOptions { unit: Some(crate::geometry::LengthUnit::Metre), ..ImportOptions::default() };
    let file = read(&metres, CalibrationFormat::Opencv, &unit).expect("in metres");
    assert!((file.right_from_left.expect("a pose").translation.vector.x + 205.0).abs() < 1e-9);
    let transposed = OPENCV_YAML.replace(
        "6668.08312, -1.02021671736, 1939.03554, 0., 6667.42465, 1471.13556, 0., 0., 1.",
        "6668.08312, 0., 0., 0., 6667.42465, 0., 1939.03554, 1471.13556, 1.",
    );
    let error = refused(&transposed, &ImportOptions::default());
    assert!(error.code == LensFault::WrongShape && error.detail.contains("transposed"), "{error}");
    let mirrored = OPENCV_YAML.replace("[ 0.93, 0., -0.36", "[ -0.93, 0., -0.36");
    assert_eq!(refused(&mirrored, &ImportOptions::default()).code, LensFault::NotARotation);
    let alias = KALIBR.replace("resolution: [4000, 3036]\n  rostopic", "resolution: &r [4000, 3036]\n  other: *r\n  rostopic");
    assert_eq!(refused(&alias, &ImportOptions::default()).code, LensFault::Unreadable);
}

#[test]
fn a_shifted_projector_is_read_and_a_shifted_camera_is_not() {
    let projector = "M3: [[1800, 0, 960], [0, 1800, -400], [0, 0, 1]]\nD3: [0, 0, 0, 0]\n\
                     R3: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\nT3: [-100, 0, 0]\n";
    let rig = rig(&format!("{OPENCV_YAML}{projector}"));
    let lens = rig.devices.projector.expect("a projector").lens;
    assert!((lens.cy + 399.5).abs() < 1e-9);
    let far = projector.replace("-400", "-7000");
    assert_eq!(refused(&format!("{OPENCV_YAML}{far}"), &ImportOptions::default()).code, LensFault::OutOfRange);
    let camera = OPENCV_YAML.replace("1471.13556", "-400");
    assert_eq!(refused(&camera, &ImportOptions::default()).code, LensFault::OutOfRange);
}

#[test]
fn a_lens_that_folds_inside_its_image_is_refused_with_the_radius() {
    // The published intrinsics.yml of OpenCV's stereo set, whose image is 640 × 480.
    let published = "%YAML:1.0\nM1: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 534.80326845051309, 0., \
                     335.68643204394891, 0.,\n       534.80326845051309, 240.66183054066337, 0., 0., 1. ]\nD1: !!opencv-matrix\n   \
                     rows: 1\n   cols: 5\n   dt: d\n   data: [ 0.29589439552724328, -1.0354662043042675, 0., 0., 0. ]\n\
                     M2: [[534.8, 0, 334.5], [0, 534.8, 242.0], [0, 0, 1]]\nD2: [0, 0, 0, 0]\n\
                     R: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\nT: [-83.19, 0, 0]\n";
    let options = ImportOptions { image_size_px: Some([640, 480]), ..ImportOptions::default() };
    let error = refused(published, &options);
    println!("{error}");
    assert_eq!((error.code, error.pointer.as_str()), (LensFault::Folds, "/left/distortion"));
    assert!(error.detail.contains("at 337 px") && error.detail.contains("corner is at"), "{error}");
}

#[test]
fn observations_are_the_same_as_json_and_as_csv() {
    let document = r#"{"schema": "vantage.scanner_observations/1", "board": {"columns": 2, "rows": 2, "square_mm": 10},
        "left": {"width_px": 100, "height_px": 80}, "right": {"width_px": 100, "height_px": 80},
        "views": [{"id": "a", "left": [[1, 2], null, [3, 4], [5, 6]], "right": [[1, 2], [2, 3], [3, 4], [4, 5]]}]}"#;
    let spec: ScannerObservationsSpec = serde_json::from_str(document).expect("a document");
    let json = spec.build().expect("valid");
    let csv = "view,device,x_mm,y_mm,z_mm,u_px,v_px\na,right,0,0,0,1,2\na,right,10,0,0,2,3\na,right,0,10,0,3,4\na,right,10,10,0,4,5\n\
               a,left,0,0,0,1,2\na,left,0,10,0,3,4\na,left,10,10,0,5,6\n";
    let size = Some([100, 80]);
    let read = read_csv(csv, PerDevice { left: size, right: size, projector: None }).expect("valid");
    assert_eq!((&read.views, &read.size_px), (&json.views, &json.size_px));
    let tabbed = csv.replace(',', "\t");
    assert_eq!(detect(&tabbed), Some(CalibrationFormat::Observations));
    assert_eq!(read_csv(&tabbed, PerDevice { left: size, right: size, projector: None }).expect("valid").views, read.views);
    assert_eq!(read.pitch.len(), 4, "the sides of a square, not its diagonals");
    assert!((json.views[0].seen.left[0].pixel - Vector2::new(1.5, 2.5)).norm() < 1e-12, "pixels count from their outer corner");
    let corner = ScannerObservationsSpec { pixel_origin: PixelOrigin::Corner, ..spec };
    assert!((corner.build().expect("valid").views[0].seen.left[0].pixel - Vector2::new(1.0, 2.0)).norm() < 1e-12);
}

/// One text of each format.
pub(super) fn samples() -> Vec<String> {
    [OPENCV_YAML, OPENCV_XML, OPENCV_JSON, BOUGUET, MATLAB, KALIBR, THESIS].map(str::to_owned).to_vec()
}

/// A text with a byte, a number or a stretch of it changed, cut or doubled.
pub(super) fn damage(text: &str, round: u32, random: &mut Random) -> String {
    let at = |random: &mut Random| {
        let mut place = (random.unit() * text.len() as f64) as usize;
        while !text.is_char_boundary(place) {
            place -= 1;
        }
        place
    };
    let (a, b) = (at(random), at(random));
    let (from, to) = (a.min(b), a.max(b));
    match round % 8 {
        0 => text[..from].to_owned(),
        1 => format!("{}{}", &text[..from], &text[to..]),
        2 => format!("{}{}{}", &text[..to], &text[from..to], &text[to..]),
        3 => text.replace("0.", "-"),
        4 => text.replace(['[', '('], "{"),
        5 => text.replace(['0', '1'], "9e99"),
        6 => format!("{}\u{0}é\n\t[[[[{}", &text[..from], &text[from..]),
        _ => text.replace(['6', '3'], "nan"),
    }
}
