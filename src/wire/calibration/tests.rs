//! Sentences, readers of other programs' files, and sixty damaged or mistaken files, each with what it is told.

use std::collections::BTreeSet;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde_json::{Value, json};

use super::*;
use crate::cell::calibration::check::{Check, CheckLimits, CheckVerdict, Checked};
use crate::cell::calibration::data::{HandEyeSetup, SigmaSource, Solve};
use crate::cell::calibration::findings::{CalibrationFinding, Figures, FindingCode, Severity, Subject};
use crate::cell::calibration::lens::LensParameters;
use crate::cell::calibration::se3::{exp, twist};
use crate::cell::{CalibrationObjection, Cell, Presets, SpecLibrary, UseConditions};

fn cell() -> Cell {
    Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset")
}

/// Numbers between −1 and 1, the same each time: the fractional parts of multiples of √2 and of the golden ratio.
fn number(index: usize, of: f64) -> f64 {
    2.0 * (of * (index + 1) as f64).fract() - 1.0
}

/// Observations of a board on the table of the preset cell, without noise but for some hundredths: 14 of them, the arm by joints and by
/// what its controller reports.
fn valid(cell: &Cell) -> Value {
    let board = Isometry3::from_parts(Translation3::new(-40.0, -30.0, 30.0), UnitQuaternion::identity());
    let hand_eye = *cell.flange_from_scanner.isometry();
    let mut observations = Vec::new();
    for index in 0..400 {
        let table_deg = (observations.len() as f64 * 25.0) - 170.0;
        let tilt = Vector3::new(
            number(index, std::f64::consts::SQRT_2),
            number(index, 0.618_033_988),
            1.5 * number(index, 0.732_050_807),
        ) * 0.55;
        let turned =
            UnitQuaternion::from_scaled_axis(tilt) * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let depth = 480.0 + 25.0 * number(index, 0.302_775_637);
        let place = Vector3::new(0.0, 0.0, depth) - turned * Vector3::new(40.0, 30.0, 0.0);
        let seen = Isometry3::from_parts(Translation3::from(place), turned);
        let plate = *cell.base_from_plate(f64::to_radians(table_deg)).isometry();
        let flange = plate * board * seen.inverse() * hand_eye.inverse();
        let solutions = cell.robot.kinematics.ik_solutions(&crate::geometry::Pose::claim(flange));
        let Some(joints) = solutions.into_iter().next() else { continue };
        let noise = Vector3::new(number(index, 2.236_067_977), number(index, 2.645_751_311), number(index, 3.316_624_790)) * 0.03;
        let seen = Isometry3::from_parts(Translation3::from(seen.translation.vector + noise), seen.rotation);
        observations.push(json!({"id": format!("p{:02}", observations.len() + 1), "joints_deg": joints.map(f64::to_degrees),
            "table_angle_deg": table_deg, "base_from_flange": ObservedPose::of(&flange), "cloud_from_board": ObservedPose::of(&seen)}));
        if observations.len() == 14 {
            break;
        }
    }
    assert_eq!(observations.len(), 14);
    json!({"schema": "vantage.calibration_data/1", "cloud_frame": "scanner", "temperature_c": 22.0,
        "board": {"kind": "charuco", "columns": 9, "rows": 7, "square_mm": 10.0},
        "sigma": {"robot_deg": 0.01, "robot_mm": 0.1, "board_deg": 0.01, "board_mm": 0.05}, "observations": observations})
}

/// Findings on a document: pointers and sentences of fields, codes and sentences of findings, worst first.
fn told(cell: &Cell, document: Value, solve: Solve) -> Vec<(String, String)> {
    let data: CalibrationData = match serde_path_to_error::deserialize(document) {
        Ok(data) => data,
        Err(error) => return vec![(format!("/{}", error.path()), error.inner().to_string())],
    };
    match CalibrationDocument::solved(&data, cell, (solve, 0), ["00", "2026-11-23T00:00:00Z"]) {
        Ok(document) => {
            document.findings.iter().map(|finding| (finding.code.as_str().to_owned(), finding.detail.clone())).collect()
        }
        Err(CalibrationError::Fields(errors)) => errors.into_iter().map(|error| (error.pointer, error.detail)).collect(),
        Err(CalibrationError::Findings(findings)) => {
            findings.iter().map(|finding| (finding.code.as_str().to_owned(), sentence(finding))).collect()
        }
        Err(CalibrationError::Cancelled) => unreachable!("nobody cancels"),
    }
}

/// Observations with every number that has a range: one document with poses, camera and plate, and one with the other forms.
fn with_every_number(cell: &Cell) -> [Value; 2] {
    let (mut poses, mut forms) = (valid(cell), valid(cell));
    poses["camera"] = json!({"width_px": 4000, "height_px": 3000, "fx": 6000.0, "fy": 6000.0, "cx": 2000.0, "cy": 1500.0,
        "skew": 0.0, "distortion": [0.0, 0.0, 0.0, 0.0, 0.0], "sigma_px": 0.1});
    poses["observations"][0]["base_from_flange"] = json!({"translation_mm": [500.0, 0.0, 300.0], "rpy_deg": [0.0, 0.0, 0.0]});
    forms["camera"] = poses["camera"].clone();
    forms["board"] = json!({"kind": "circles", "columns": 9, "rows": 7, "spacing_mm": 10.0});
    let places = [[0.0, 0.0, 480.0], [10.0, 0.0, 480.0], [0.0, 10.0, 480.0], [10.0, 10.0, 480.0]];
    poses["plate"] = json!([{"joints_deg": [0.0, -30.0, 60.0, 0.0, 30.0, 0.0], "table_angle_deg": 0.0, "points_mm": places}]);
    let points: Vec<Value> = places.iter().map(|[x, y, z]| json!({"board_mm": [x, y, 0.0], "cloud_mm": [x, y, z]})).collect();
    let spheres: Vec<Value> =
        places.iter().map(|[x, y, z]| json!({"name": format!("{x} {y}"), "centre_mm": [x, y, z]})).collect();
    let pixels: Vec<Value> =
        places.iter().map(|[x, y, _]| json!({"board_mm": [x, y, 0.0], "px": [2000.0 + 12.5 * x, 1500.0 + 12.5 * y]})).collect();
    for (index, (form, list)) in [("points", points), ("spheres", spheres), ("pixels", pixels)].into_iter().enumerate() {
        let observation = forms["observations"][index].as_object_mut().expect("an object");
        observation.remove("cloud_from_board");
        observation.insert(form.to_owned(), json!(list));
    }
    [poses, forms]
}

/// Ranges stood in descriptions alone, beside the checks.
#[test]
fn the_ranges_of_observations_are_those_of_their_checks() {
    let cell = cell();
    let [poses, forms] = &with_every_number(&cell);
    let places = [
        ("BoardDocument", poses, "/board"),
        ("BoardDocument", forms, "/board"),
        ("CalibrationData", poses, ""),
        ("CameraDocument", poses, "/camera"),
        ("PlateScanDocument", poses, "/plate/0"),
        ("ObservationDocument", poses, "/observations/0"),
        ("ObservedPose", poses, "/observations/0/base_from_flange"),
        ("PointPairDocument", forms, "/observations/0/points/0"),
        ("SphereDocument", forms, "/observations/1/spheres/0"),
        ("PixelPairDocument", forms, "/observations/2/pixels/0"),
    ];
    let mut held = BTreeSet::new();
    for (name, document, at) in places {
        let of_name = OBSERVATION_RANGES.into_iter().filter(|group| group.name == name);
        for range in of_name.flat_map(|group| group.ranges) {
            let mut pointer = format!("{at}/{}", range.field);
            if document.pointer(&pointer).is_none() {
                continue;
            }
            held.insert((name, range.field));
            while document.pointer(&pointer).is_some_and(Value::is_array) {
                pointer += "/0";
            }
            let is_whole = document.pointer(&pointer).expect("a number").is_u64();
            let [min, max] = range.range;
            let ends = if is_whole {
                [json!(min as i64 - 1), json!(max as i64 + 1)]
            } else {
                [json!(min.next_down()), json!(max.next_up())]
            };
            for outside in ends {
                let mut changed = document.clone();
                *changed.pointer_mut(&pointer).expect("a number") = outside;
                let told = told(&cell, changed, Solve::Joint);
                // The range of a principal point is that of its image, the largest included.
                let allowed = match range.field {
                    "cx" | "cy" => "; allowed is ".to_owned(),
                    _ => format!("; allowed is {min} to {max}"),
                };
                let is_told = |detail: &str| detail.contains(&allowed) || detail.contains("not a number within ±100000");
                assert!(told.iter().any(|(at, detail)| pointer.starts_with(at) && is_told(detail)), "{pointer}: {told:#?}");
            }
        }
    }
    assert_eq!(held.len(), OBSERVATION_RANGES.iter().map(|group| group.ranges.len()).sum::<usize>());
}

type Change = fn(&mut Value);

fn each(document: &mut Value, change: impl Fn(usize, &mut Value)) {
    let observations = document["observations"].as_array_mut().expect("a list");
    observations.iter_mut().enumerate().for_each(|(index, observation)| change(index, observation));
}

fn scale(pose: &mut Value, factor: f64) {
    pose["translation_mm"]
        .as_array_mut()
        .expect("three")
        .iter_mut()
        .for_each(|v| *v = json!(v.as_f64().expect("a number") * factor));
}

fn isometry(pose: &Value) -> Isometry3<f64> {
    let pose: ObservedPose = serde_json::from_value(pose.clone()).expect("a pose");
    let mut findings = crate::cell::Findings::default();
    pose.pose("", &mut findings).expect("in range")
}

fn moved(pose: &mut Value, change: impl Fn(Isometry3<f64>) -> Isometry3<f64>) {
    *pose = json!(ObservedPose::of(&change(isometry(pose))));
}

fn shifted(mm: [f64; 3]) -> Isometry3<f64> {
    Isometry3::translation(mm[0], mm[1], mm[2])
}

/// Mistakes that people make with good data: code or pointer that comes first, and words of its sentence.
const MISTAKES: [(&str, &str, Change); 27] = [
    ("too_few", "2 observations; at least 3", |d| d["observations"].as_array_mut().expect("a list").truncate(2)),
    ("unit_mismatch", "× smaller than the others", |d| scale(&mut d["observations"][4]["cloud_from_board"], 1e-3)),
    ("unit_mismatch", "× smaller than the scanner's distance", |d| each(d, |_, o| scale(&mut o["cloud_from_board"], 1e-3))),
    ("unit_mismatch", "inches rather than millimetres", |d| each(d, |_, o| scale(&mut o["cloud_from_board"], 1.0 / 25.4))),
    ("wrong_robot_model", "differ by up to", |d| each(d, |_, o| scale(&mut o["base_from_flange"], 1e-3))),
    ("tool_active", "a constant 0.0, 0.0, 182.3 mm", |d| {
        each(d, |_, o| moved(&mut o["base_from_flange"], |pose| pose * shifted([0.0, 0.0, 182.3])));
    }),
    ("wrong_robot_model", "which is not constant", |d| {
        each(d, |i, o| moved(&mut o["base_from_flange"], |pose| shifted([15.0 * i as f64, 0.0, 0.0]) * pose));
    }),
    ("joint_order", "joints in another order or direction", |d| {
        each(d, |_, o| o["joints_deg"].as_array_mut().expect("six").reverse());
    }),
    ("joint_order", "joints in another order or direction", |d| {
        each(d, |_, o| o["joints_deg"][2] = json!(-o["joints_deg"][2].as_f64().expect("a number")));
    }),
    ("angle_unit", "degrees and radians exchanged", |d| {
        each(d, |_, o| {
            let joints = o["joints_deg"].as_array_mut().expect("six").iter_mut();
            joints.for_each(|v| *v = json!(v.as_f64().expect("a number").to_radians()));
        });
    }),
    ("out_of_step", "if shifted by one observation", |d| {
        let poses: Vec<Value> =
            d["observations"].as_array().expect("a list").iter().map(|o| o["base_from_flange"].clone()).collect();
        each(d, |index, o| o["base_from_flange"] = poses[(index + 1).min(poses.len() - 1)].clone());
    }),
    ("inverted", "board_from_cloud was given", |d| each(d, |_, o| moved(&mut o["cloud_from_board"], |pose| pose.inverse()))),
    ("other_setup", "arm's poses inverted", |d| {
        each(d, |_, o| {
            o.as_object_mut().expect("an object").remove("joints_deg");
            moved(&mut o["base_from_flange"], |pose| pose.inverse());
        });
    }),
    ("transposed", "columns were written as rows", |d| {
        each(d, |_, o| {
            moved(&mut o["cloud_from_board"], |pose| Isometry3::from_parts(pose.translation, pose.rotation.inverse()))
        });
    }),
    ("quaternion_order", "quaternions of cloud_from_board read as w, x, y, z: give them as x, y, z, w", |d| {
        each(d, |_, o| {
            let pose = ObservedPose::of(&isometry(&o["cloud_from_board"]));
            let [x, y, z, w] = pose.quaternion_xyzw.expect("a quaternion");
            o["cloud_from_board"] = json!({"translation_mm": pose.translation_mm, "quaternion_xyzw": [w, x, y, z]});
        });
    }),
    ("out_of_step", "shifted by one observation: the records are out of step", |d| {
        let boards: Vec<Value> =
            d["observations"].as_array().expect("a list").iter().map(|o| o["cloud_from_board"].clone()).collect();
        each(d, |index, o| o["cloud_from_board"] = boards[(index + 1) % boards.len()].clone());
    }),
    ("duplicate_pose", "are the same to within", |d| {
        d["observations"][7] = d["observations"][2].clone();
        d["observations"][7]["id"] = json!("twin");
    }),
    ("swapped", "exchanged", |d| {
        let kept = d["observations"][3]["cloud_from_board"].take();
        d["observations"][3]["cloud_from_board"] = d["observations"][9]["cloud_from_board"].take();
        d["observations"][9]["cloud_from_board"] = kept;
    }),
    ("moved", "the board or the scanner moved in between", |d| {
        each(d, |index, o| {
            if index >= 10 {
                moved(&mut o["cloud_from_board"], |pose| pose * shifted([3.0, 1.0, 0.0]));
            }
        });
    }),
    ("flipped", "fits if turned by 180°", |d| {
        d["board"] = json!({"kind": "chessboard", "columns": 9, "rows": 7, "square_mm": 10.0});
        let turn = Isometry3::from_parts(
            Translation3::new(80.0, 60.0, 0.0),
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI),
        );
        moved(&mut d["observations"][5]["cloud_from_board"], |pose| pose * turn);
    }),
    ("bad_pose", "does not agree with the others", |d| {
        moved(&mut d["observations"][6]["cloud_from_board"], |pose| pose * shifted([4.0, 0.0, 3.0]));
    }),
    ("table_sign", "invert the table's axis", |d| {
        each(d, |_, o| o["table_angle_deg"] = json!(-o["table_angle_deg"].as_f64().expect("a number")));
    }),
    ("table_scale", "check its gear ratio", |d| {
        each(d, |_, o| o["table_angle_deg"] = json!(1.01 * o["table_angle_deg"].as_f64().expect("a number")));
    }),
    ("board_scale", "given as 10.000 mm are probably 9.", |d| each(d, |_, o| scale(&mut o["cloud_from_board"], 1.03))),
    ("table_still", "its axis needs 10°", |d| each(d, |_, o| o["table_angle_deg"] = json!(0.0))),
    ("sigma_too_small", "leave sigma out", |d| {
        d["sigma"] = json!({"robot_deg": 0.0001, "robot_mm": 0.001, "board_deg": 0.0001, "board_mm": 0.001});
    }),
    ("no_plate_face", "lie in no plane", |d| {
        let points: Vec<[f64; 3]> = (0..5).map(|i| [f64::from(i), 0.0, 480.0]).collect();
        d["plate"] = json!([{"joints_deg": d["observations"][0]["joints_deg"], "points_mm": points}]);
    }),
];

/// Fields that cannot be read: pointer and words.
const FIELDS: [(&str, &str, Change); 24] = [
    ("/schema", "this version reads", |d| d["schema"] = json!("vantage.calibration_data/2")),
    ("/setup", "unknown variant", |d| d["setup"] = json!("in_hand")),
    ("/temperature_c", "-50 to 100 °C", |d| d["temperature_c"] = json!(295.15)),
    ("/taken_at", "is not a time", |d| d["taken_at"] = json!("yesterday")),
    ("/board.kind", "unknown variant", |d| d["board"] = json!({"kind": "dots"})),
    ("/board/rows", "2 to 1000", |d| d["board"]["rows"] = json!(1)),
    ("/board/square_mm", "0.01 to 1000 mm", |d| d["board"]["square_mm"] = json!(-10.0)),
    ("/sigma/robot_deg", "0.00001 to 5 °", |d| d["sigma"]["robot_deg"] = json!(0.0)),
    ("/sigma/board_mm", "0.0001 to 50 mm", |d| d["sigma"]["board_mm"] = json!(1e9)),
    ("/observations", "1 to 5000", |d| d["observations"] = json!([])),
    ("/observations", "invalid type", |d| d["observations"] = json!({"p01": {}})),
    ("/observations/1/id", "is the name of another", |d| d["observations"][1]["id"] = d["observations"][0]["id"].clone()),
    ("/observations/1/id", "name the observation", |d| d["observations"][1]["id"] = json!("")),
    ("/observations[2].joints", "unknown field", |d| d["observations"][2]["joints"] = json!([])),
    ("/observations/2/joints_deg/3", "-3600 to 3600 °", |d| d["observations"][2]["joints_deg"][3] = json!(1e5)),
    ("/observations[2].joints_deg", "invalid length 5", |d| {
        let _ = d["observations"][2]["joints_deg"].as_array_mut().expect("six").pop();
    }),
    ("/observations/2/table_angle_deg", "-3600 to 3600 °", |d| d["observations"][2]["table_angle_deg"] = json!(-1e7)),
    ("/observations/3/cloud_from_board/quaternion_xyzw", "has norm", |d| {
        d["observations"][3]["cloud_from_board"]["quaternion_xyzw"] = json!([0.0, 0.0, 0.0, 0.0]);
    }),
    ("/observations/3/cloud_from_board", "has no rotation", |d| {
        d["observations"][3]["cloud_from_board"] = json!({"translation_mm": [0, 0, 480]});
    }),
    ("/observations/3/cloud_from_board/rotation_rows", "left-handed", |d| {
        d["observations"][3]["cloud_from_board"] =
            json!({"translation_mm": [0, 0, 480], "rotation_rows": [[0, 1, 0], [1, 0, 0], [0, 0, 1]]});
    }),
    ("/observations/3/cloud_from_board/rotation_rows", "is not a rotation", |d| {
        d["observations"][3]["cloud_from_board"] =
            json!({"translation_mm": [0, 0, 480], "rotation_rows": [[1, 0, 0], [0, 1, 1], [0, 0, 1]]});
    }),
    ("/observations/3/cloud_from_board/translation_mm/2", "-100000 to 100000", |d| {
        d["observations"][3]["cloud_from_board"]["translation_mm"][2] = json!(4.8e8);
    }),
    ("/observations/4", "in one form", |d| {
        d["observations"][4]["points"] = json!([{"board_mm": [0, 0, 0], "cloud_mm": [0, 0, 480]}])
    }),
    ("/plate/0", "needs one of joints_deg", |d| d["plate"] = json!([{"points_mm": [[0, 0, 480], [1, 0, 480], [0, 1, 480]]}])),
];

/// Row C13: fifty-one files of ours, each told what it looks like first, and the good one told nothing.
#[test]
fn mistaken_observations_are_told_what_they_look_like() {
    let cell = cell();
    let good = valid(&cell);
    assert_eq!(told(&cell, good.clone(), Solve::Joint), [], "the data are good");
    let mut unlike = Vec::new();
    for (first, words, change) in MISTAKES.iter().chain(&FIELDS) {
        let mut document = good.clone();
        change(&mut document);
        let told = told(&cell, document, Solve::Joint);
        let found = told.iter().find(|(place, _)| place == first);
        println!("C13 {first}: {}", found.map_or("", |(_, detail)| detail));
        if !found.is_some_and(|(_, detail)| detail.contains(words)) {
            unlike.push(format!("{first}, {words:?}: {told:?}"));
        }
    }
    assert!(unlike.is_empty(), "{}", unlike.join("\n"));
    let mut plate = good;
    plate["plate"] = json!([{"joints_deg": [0, 0, 0, 0, 0, 0], "points_mm": [[0, 0, 480], [1, 0, 480], [0, 1, 480]]}]);
    let told = told(&cell, plate, Solve::HandEye);
    assert!(told[0].0 == "/plate" && told[0].1.contains("solves for no table"), "{told:?}");
}

fn ros(pose: &Isometry3<f64>) -> String {
    let ([x, y, z], q) = (<[f64; 3]>::from(pose.translation.vector / 1000.0), pose.rotation.quaternion());
    format!(
        "    translation:\n      x: {x}\n      y: {y}\n      z: {z}\n    rotation:\n      x: {}\n      y: {}\n      z: {}\n      w: {}\n",
        q.i, q.j, q.k, q.w
    )
}

fn opencv(pose: &Isometry3<f64>) -> String {
    let matrix = pose.to_homogeneous();
    let numbers: Vec<String> = (0..16).map(|index| matrix[(index / 4, index % 4)].to_string()).collect();
    format!("%YAML:1.0\n---\nPoseState: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: [ {} ]\n", numbers.join(", "))
}

/// Poses as easy_handeye2 and Zivid write them come back, for either place of the camera.
#[test]
fn files_of_easy_handeye_and_zivid_are_read() {
    let flange = Isometry3::from_parts(Translation3::new(400.0, -20.0, 610.0), UnitQuaternion::from_euler_angles(0.3, -0.4, 2.0));
    let board = Isometry3::from_parts(Translation3::new(12.0, 8.0, 480.0), UnitQuaternion::from_euler_angles(3.0, 0.2, -0.7));
    let same = |data: &CalibrationData, setup: HandEyeSetup| {
        let read = data.read(&cell(), Solve::HandEye).expect("observations");
        let robot = if setup == HandEyeSetup::EyeToHand { flange.inverse() } else { flange };
        assert_eq!((data.setup, read.sightings.len()), (setup, 1));
        let off = (read.sightings[0].base_from_flange.inverse() * robot).translation.vector.norm()
            + (read.sightings[0].cloud_from_board.inverse() * board).translation.vector.norm();
        assert!(off < 1e-9, "{off}");
    };
    let sample = |kind: &str, robot: &Isometry3<f64>| {
        let head = if kind.is_empty() { String::new() } else { format!("parameters:\n  calibration_type: {kind}\n") };
        format!("{head}samples:\n- robot:\n{}  tracking:\n{}", ros(robot), ros(&board))
    };
    same(&from_easy_handeye(&sample("eye_in_hand", &flange), HandEyeSetup::EyeToHand).expect("samples"), HandEyeSetup::EyeInHand);
    same(&from_easy_handeye(&sample("", &flange), HandEyeSetup::EyeInHand).expect("samples"), HandEyeSetup::EyeInHand);
    let inverted = sample("eye_on_base", &flange.inverse());
    same(&from_easy_handeye(&inverted, HandEyeSetup::EyeInHand).expect("samples"), HandEyeSetup::EyeToHand);
    let rows = |pose: &Isometry3<f64>| {
        let matrix = pose.to_homogeneous();
        let row = |row: usize| {
            format!("      [{}, {}, {}, {}]", matrix[(row, 0)], matrix[(row, 1)], matrix[(row, 2)], matrix[(row, 3)])
        };
        format!(
            "__version__:\n  serializer: 1\n  data: 1\nFloatMatrix:\n  Data:\n    [\n{}\n    ]\n",
            (0..4).map(row).collect::<Vec<_>>().join(",\n")
        )
    };
    for text in [opencv, rows as fn(&Isometry3<f64>) -> String] {
        let files = [("01".to_owned(), [text(&flange), text(&board)])];
        same(&from_zivid(&files, HandEyeSetup::EyeInHand).expect("poses"), HandEyeSetup::EyeInHand);
    }
}

/// Twelve files of other programs, each refused with its place.
#[test]
fn damaged_files_of_other_programs_are_refused_by_place() {
    let flange = Isometry3::translation(400.0, -20.0, 610.0);
    let text = format!("samples:\n- robot:\n{}  tracking:\n{}", ros(&flange), ros(&flange));
    let easy: [(String, &str, &str); 6] = [
        (String::new(), "", "holds nothing"),
        ("samples: []".into(), "/samples", "has no samples"),
        (text.replace("tracking:", "camera:"), "/samples/0/optical", "has no translation"),
        (text.replacen("w: 1", "w: 0.5", 1), "/samples/0/robot/rotation", "has norm 0.5"),
        (text.replacen("x: 0.4", "x: 400", 1), "/samples/0/robot/translation", "the unit is the metre"),
        (
            format!("parameters:\n  calibration_type: in_hand\n{text}"),
            "/parameters/calibration_type",
            "eye_in_hand and eye_on_base",
        ),
    ];
    for (text, pointer, words) in easy {
        let errors = from_easy_handeye(&text, HandEyeSetup::EyeInHand).expect_err(pointer);
        assert!(errors.iter().any(|error| error.pointer == pointer && error.detail.contains(words)), "{pointer}: {errors:?}");
    }
    let pose = opencv(&flange);
    let zivid: [(String, &str); 6] = [
        ("%YAML:1.0\n---\nPoseState: 3\n".into(), "contains no 4 × 4 matrix"),
        (pose.replace("data: [ 1,", "data: [ 2,"), "is not a rotation"),
        (pose.replace("data: [ 1,", "data: [ .nan,"), "has 15 numbers"),
        (pose.replace(", 0, 0, 0, 1 ]", ", 0, 0, 0 ]"), "has 15 numbers"),
        (pose.replace(", 0, 0, 0, 1 ]", ", 400, -20, 610, 1 ]"), "transposed"),
        (pose.replace("data: [", "data: [ ["), "not YAML"),
    ];
    for (text, words) in zivid {
        let files = [("07".to_owned(), [text, pose.clone()])];
        let errors = from_zivid(&files, HandEyeSetup::EyeInHand).expect_err(words);
        assert!(errors.iter().any(|error| error.pointer == "/pos07" && error.detail.contains(words)), "{words}: {errors:?}");
    }
    assert!(from_zivid(&[], HandEyeSetup::EyeInHand).is_err());
}

/// Every code has a sentence of its own that says more than the code, without a placeholder left in it.
#[test]
fn every_finding_has_a_sentence() {
    let figures = Figures {
        count: Some(5),
        held_out: Some(2),
        given: Some(7),
        needed: Some(6),
        ratio: Some(1.01),
        turn_rad: Some(0.01),
        other_turn_rad: Some(-0.01),
        length_mm: Some(2.1),
        other_length_mm: Some(0.4),
        vector: Some(Vector3::z()),
        subject: Some(Subject::Board),
        joint: Some(2),
        temperatures_c: Some([31.0, 22.4]),
    };
    let mut said = Vec::new();
    for code in FindingCode::ALL {
        let finding = CalibrationFinding::new(code, Severity::Warning).about(["p01".to_owned()]);
        let (with, without) = (sentence(&finding.clone().with(figures)), sentence(&finding));
        assert!(with.len() > 25 && !with.contains("NaN") && !without.is_empty(), "{}: {with}", code.as_str());
        assert!(!said.contains(&with), "{}: {with}", code.as_str());
        said.push(with);
    }
    let of = |code: FindingCode| said[FindingCode::ALL.iter().position(|known| *known == code).expect("known")].clone();
    assert_eq!(
        of(FindingCode::Stale),
        "taken at 31.0 °C, but calibrated at 22.4 °C: the difference of 8.6 K exceeds 5 K; calibrate again"
    );
    assert!(of(FindingCode::ArmModel).contains("joint 2"));
    assert!(of(FindingCode::TooFew).starts_with("5 observations remain of 7, since 2 are held out; at least 3 are needed"));
    assert!(of(FindingCode::BoardScaleNotConverged).contains("did not converge in 5 rounds"));
    assert!(of(FindingCode::DegenerateMotion).contains("along z"));
    let judged = "the 5 of 7 observations that agree best";
    let contradict = format!("{judged} contradict each other by 2.1 mm, root mean square: check");
    assert!(of(FindingCode::NoConsensus).starts_with(&contradict), "{}", of(FindingCode::NoConsensus));
    let held =
        format!("{judged} differ by 2.10 mm, root mean square, and the table's axis has a standard deviation of 0.40 mm and ");
    assert!(
        of(FindingCode::ScannerHeld).starts_with(&held) && of(FindingCode::ScannerHeld).contains("may be off: solve for joint")
    );
    assert!(of(FindingCode::BoardTurned).ends_with("by 0.40 mm if the board turned with the table: solve for joint"));
    let figures = Figures { length_mm: Some(25.4), subject: Some(Subject::Flange), count: Some(5), ..Figures::default() };
    let told = sentence(&CalibrationFinding::new(FindingCode::UnitMismatch, Severity::Error).with(figures));
    assert_eq!(
        told,
        "translations of base_from_flange agree with all other lengths if they are in inches rather than millimetres"
    );
}

/// A residual of the observations that agree was told as that of all of them.
#[test]
fn a_contradiction_tells_how_many_of_the_observations_it_is_of() {
    let told = |code: FindingCode, count: usize, length_mm: Option<f64>| {
        let figures = Figures { count: Some(count), given: Some(15), length_mm, ..Figures::default() };
        sentence(&CalibrationFinding::new(code, Severity::Error).with(figures))
    };
    for code in [FindingCode::NoConsensus, FindingCode::ScannerHeld] {
        let (some, all) = (told(code, 9, Some(4.1)), told(code, 15, Some(4.1)));
        assert!(some.starts_with("the 9 of 15 observations that agree best "), "{some}");
        assert!(all.starts_with("the observations "), "{all}");
    }
    assert!(told(FindingCode::NoConsensus, 3, None).starts_with("only 3 of 15 observations agree with each other: check"));
}

/// A cause was named by chance of so few, and how many tell one was told nowhere.
#[test]
fn too_few_observations_to_name_a_cause_are_told_with_how_many_do() {
    let told = |code: FindingCode, needed: Option<usize>| {
        let figures = Figures {
            count: Some(4),
            given: Some(4),
            needed,
            length_mm: Some(61.0),
            other_turn_rad: Some(0.1),
            turn_rad: Some(1.0),
            ..Figures::default()
        };
        sentence(&CalibrationFinding::new(code, Severity::Error).with(figures))
    };
    let [few, enough] = [Some(6), None].map(|needed| told(FindingCode::NoConsensus, needed));
    assert!(few.ends_with(" and robot model; give at least 6 to have the cause named"), "{few}");
    assert!(enough.ends_with(" and robot model"), "{enough}");
    let motion = told(FindingCode::DegenerateMotion, Some(6));
    assert!(motion.ends_with("; take more poses (at least 6), and find out why they disagree"), "{motion}");
}

/// The limits that a motion was refused by were not told.
#[test]
fn a_degenerate_motion_is_told_with_its_limits() {
    let told = |spread_deg: f64, sds: Option<(f64, f64)>| {
        let figures = Figures {
            turn_rad: Some(spread_deg.to_radians()),
            length_mm: sds.map(|(mm, _)| mm),
            other_turn_rad: sds.map(|(_, deg)| deg.to_radians()),
            vector: Some(Vector3::z()),
            ..Figures::default()
        };
        sentence(&CalibrationFinding::new(FindingCode::DegenerateMotion, Severity::Error).with(figures))
    };
    let scattered = told(25.0, Some((2.1, 0.1)));
    assert!(
        scattered.contains("standard deviation of 2.10 mm, rotations one of 0.100°; allowed are 0.5 mm and 0.05°; take more"),
        "{scattered}"
    );
    let narrow = told(0.4, None);
    assert!(narrow.starts_with("rotations spread only 0.4° across their main axis (at least 1° is needed): all"), "{narrow}");
    let single = CalibrationFinding::new(FindingCode::TooFew, Severity::Error);
    let single = sentence(&single.with(Figures { count: Some(1), held_out: Some(1), ..Figures::default() }));
    assert!(single.starts_with("1 observation remains of 2, since 1 is held out; at least 3"), "{single}");
    let with = |count: usize, held_out: Option<usize>, given: usize| {
        let figures = Figures { count: Some(count), held_out, given: Some(given), ..Figures::default() };
        sentence(&CalibrationFinding::new(FindingCode::TooFew, Severity::Error).with(figures))
    };
    let twin = with(2, Some(2), 5);
    assert!(twin.starts_with("2 observations remain of 5, since 2 are held out and 1 is a duplicate; at least 3"), "{twin}");
    let same = with(1, None, 12);
    assert!(same.starts_with("1 observation remains of 12, since 11 are duplicates; at least 3"), "{same}");
    assert!(with(2, None, 2).starts_with("2 observations; at least 3 are needed"), "none is left out");
}

/// Data of a scanner that stands in the cell were told to be inverted.
#[test]
fn a_scanner_that_stands_in_the_cell_is_told_by_its_place() {
    let vector = Some(Vector3::new(900.2, -300.0, 700.0));
    let figures = Figures { length_mm: Some(310.0), other_length_mm: Some(0.2), vector, ..Figures::default() };
    let told = sentence(&CalibrationFinding::new(FindingCode::OtherSetup, Severity::Error).with(figures));
    assert!(told.contains("the scanner at 900, -300, 700 mm of the base"), "{told}");
    assert!(told.ends_with("give the setup eye_to_hand, and leave the poses as they are"), "{told}");
}

/// ± was told of one standard deviation, and −0.00 of an axis.
#[test]
fn a_weak_motion_is_told_by_standard_deviations() {
    let vector = Some(Vector3::new(-0.001, 0.6, 0.8));
    let figures = Figures { length_mm: Some(2.1), other_turn_rad: Some(0.1_f64.to_radians()), vector, ..Figures::default() };
    let told = sentence(&CalibrationFinding::new(FindingCode::WeakMotion, Severity::Warning).with(figures));
    let known = "the translation along (0.00 0.60 0.80) has a standard deviation of 2.10 mm, rotations one of 0.100°;";
    assert!(told.contains(known), "{told}");
}

/// The observations with the pixels of a camera at the cloud's origin, of a board of 9 × 7 points, in place of poses.
fn imaged(cell: &Cell) -> Value {
    let camera = json!({"width_px": 2000, "height_px": 2000, "fx": 1500.0, "fy": 1500.0, "cx": 1000.0, "cy": 1000.0,
        "distortion": [-0.05, 0.01, 1e-3, 0.0, 0.0], "sigma_px": 0.2});
    let lens = LensParameters {
        size_px: [2000; 2],
        fx: 1500.0,
        fy: 1500.0,
        cx: 1000.0,
        cy: 1000.0,
        skew: 0.0,
        distortion: [-0.05, 0.01, 1e-3, 0.0, 0.0],
    };
    let mut document = valid(cell);
    document["camera"] = camera;
    each(&mut document, |_, observation| {
        let seen = isometry(&observation["cloud_from_board"]);
        let pair = |index: usize| {
            let point = [(index % 9) as f64 * 10.0, (index / 9) as f64 * 10.0, 0.0];
            let pixel = lens.project(&(seen * nalgebra::Point3::from(point)));
            json!({"board_mm": point, "px": [pixel.x, pixel.y]})
        };
        observation["pixels"] = (0..63).map(pair).collect();
        observation.as_object_mut().expect("fields").remove("cloud_from_board");
    });
    document
}

#[test]
fn pixels_of_a_camera_are_observations_of_the_board() {
    let cell = cell();
    let solved = |document: Value| {
        let data: CalibrationData = serde_json::from_value(document).expect("the shape");
        let calibration = CalibrationDocument::solved(&data, &cell, (Solve::Joint, 0), ["00", "2026-11-23T00:00:00Z"]);
        calibration.unwrap_or_else(|error| panic!("{error:?}")).estimate().0
    };
    let (by_poses, by_pixels) = (solved(valid(&cell)), solved(imaged(&cell)));
    let off = crate::cell::calibration::se3::log(&(by_poses.flange_from_cloud.inverse() * by_pixels.flange_from_cloud));
    assert!(off.norm() < 0.05, "{off:?}");

    let refused = |change: Change| {
        let mut document = imaged(&cell);
        change(&mut document);
        told(&cell, document, Solve::Joint).into_iter().next().expect("refused")
    };
    let cases: [(&str, &str, Change); 7] = [
        ("/cloud_frame", "`left` or `right`", |d| drop(d.as_object_mut().expect("fields").remove("cloud_frame"))),
        ("/camera", "need the camera in whose image they are", |d| drop(d.as_object_mut().expect("fields").remove("camera"))),
        ("/camera/fx", "is 0; allowed is 1", |d| d["camera"]["fx"] = json!(0.0)),
        ("/camera/sigma_px", "allowed is 0.001 to 10", |d| d["camera"]["sigma_px"] = json!(0.0)),
        ("/observations/3", "in one form", |d| d["observations"][3]["spheres"] = json!([{"name": "a", "centre_mm": [0, 0, 0]}])),
        ("/observations/3/pixels", "give no pose", |d| {
            d["observations"][3]["pixels"].as_array_mut().expect("a list").truncate(3)
        }),
        ("/observations/5/pixels", "the order of its points", |d| {
            let pixels = d["observations"][5]["pixels"].as_array_mut().expect("a list");
            let first = pixels[0]["px"].clone();
            pixels[0]["px"] = pixels[40]["px"].take();
            pixels[40]["px"] = first;
        }),
    ];
    for (pointer, words, change) in cases {
        let (found, detail) = refused(change);
        assert!(found == pointer && detail.contains(words), "{pointer}: {found}: {detail}");
    }
    let mut document = imaged(&cell);
    document["camera"]["fx"] = json!(0.0);
    assert_eq!(told(&cell, document, Solve::Joint).len(), 1, "the camera alone is at fault");
}

/// A calibration that turned a cell round by the base of another convention was written over it without a word.
#[test]
fn calibrated_poses_far_from_those_of_the_cell_are_doubted() {
    let data: CalibrationData = serde_json::from_value(valid(&cell())).expect("the shape");
    let calibration =
        CalibrationDocument::solved(&data, &cell(), (Solve::Joint, 0), ["00", "2026-11-23T00:00:00Z"]).expect("a calibration");
    let spec = Presets.cell("e05-transcan").expect("a preset");
    assert_eq!(calibration.far_from(&spec), []);
    let mut rough = spec.clone();
    rough.flange_from_scanner.translation_mm[0] += 49.0;
    assert_eq!(calibration.far_from(&rough), [], "measured by hand");
    rough.flange_from_scanner.translation_mm[0] += 5.0;
    let half_turn_rad = 3f64.to_radians();
    rough.base_from_table.quaternion_xyzw = [0.0, 0.0, half_turn_rad.sin(), half_turn_rad.cos()];
    let doubts = calibration.far_from(&rough);
    let told: Vec<&str> = doubts.iter().map(|doubt| doubt.pointer.as_str()).collect();
    assert_eq!(told, ["/flange_from_scanner", "/base_from_table"]);
    assert!(doubts[0].detail.contains("54 mm"), "{doubts:?}");
    let beside = CalibrationDocument { setup: HandEyeSetup::EyeToHand, ..calibration };
    assert_eq!(beside.far_from(&rough), [], "such a scanner is not on the flange");
}

/// The way from observations to a compensated cell: what is written builds, holds for a day in its own cell, and for no other.
#[test]
fn a_compensation_goes_into_force_with_its_bounds() {
    let nominal = cell();
    let data: CalibrationData = serde_json::from_value(valid(&nominal)).expect("the shape");
    let from = ["cd", "2026-11-20T09:00:00Z"].map(|text| if text == "cd" { "cd".repeat(32) } else { text.to_owned() });
    let calibration =
        CalibrationDocument::solved(&data, &nominal, (Solve::Joint, 0), [&from[0], &from[1]]).expect("a calibration");
    let spec = calibration.calibrated(Presets.cell("e05-transcan").expect("a preset")).expect("on the flange");
    let calibrated = spec.build(&Presets).expect("valid");
    let conditions =
        |cell: &Cell, now: &str, celsius: f64| use_conditions(cell, Some(&now.parse().expect("a time")), Some(celsius));
    assert_eq!(calibrated.calibration_objections(&conditions(&calibrated, "2029-01-01T00:00:00Z", 35.0)), []);
    // The scanner is knocked by 0.5 mm and 0.05°.
    let knock = exp(&twist(&Vector3::new(0.05_f64.to_radians(), 0.0, 0.0), &Vector3::new(0.3, -0.4, 0.0)));
    let (estimate, covariance, weighting) = calibration.estimate();
    let mut sightings = data.read(&nominal, Solve::Joint).expect("observations").sightings;
    sightings.truncate(4);
    sightings.iter_mut().for_each(|each| each.cloud_from_board = knock.inverse() * each.cloud_from_board);
    let (limits, sigma_freedom) = (CheckLimits::default(), calibration.sigma_freedom());
    assert_eq!(sigma_freedom, None, "the deviations were given");
    let check = Check { sightings: &sightings, calibrated: estimate, covariance: &covariance, weighting, sigma_freedom, limits };
    let checked = check.check().expect("four poses");
    let times = ["cd", "2026-11-23T06:00:00Z"];
    let frame = calibration.scanner_from_cloud.scanner_from_cloud(&nominal.scanner.devices);
    let mut document = CalibrationCheckDocument::new(&checked, &limits, &calibration, &frame, times, Some(22.0));
    document.id = "ef".repeat(32);
    assert_eq!(document.verdict, CheckVerdict::Compensate, "{document:?}");
    // A search that ended before the cost was least told its drift without a word.
    assert!(checked.is_converged && document.findings.is_empty(), "{document:?}");
    let unfinished = Checked { verdict: CheckVerdict::Recalibrate, is_converged: false, ..checked };
    let unfinished = CalibrationCheckDocument::new(&unfinished, &limits, &calibration, &frame, times, Some(22.0));
    let codes: Vec<FindingCode> = unfinished.findings.iter().map(|finding| finding.code).collect();
    assert!(codes == [FindingCode::NotConverged] && unfinished.compensation.is_none(), "{unfinished:?}");
    let mut compensated = spec.clone();
    compensated.flange_from_scanner = document.compensation.as_ref().expect("a compensation").flange_from_scanner;
    compensated.calibrated = document.in_force(spec.calibrated.clone().expect("calibrated"));
    let text = toml::to_string_pretty(&compensated).expect("TOML");
    let cell = toml::from_str::<crate::cell::CellSpec>(&text).expect("it reads back").build(&Presets).expect("valid");
    let found = |now: &str, celsius: f64| cell.calibration_objections(&conditions(&cell, now, celsius)).len();
    assert_eq!((found("2026-11-24T05:59:00Z", 26.0), found("2026-11-24T06:01:00Z", 26.0)), (0, 1), "a day");
    assert_eq!((found("2026-11-23T07:00:00Z", 28.0), found("2026-11-23T05:00:00Z", 22.0)), (1, 1), "6 K; before it was taken");
    let other = Cell { name: "line-4".into(), ..cell.clone() };
    assert_eq!(other.calibration_objections(&UseConditions::default()).len(), 1);
    // Written into a cell whose hand-eye is another.
    let moved = Cell { flange_from_scanner: calibrated.flange_from_scanner, ..cell };
    assert!(matches!(moved.calibration_objections(&UseConditions::default())[..], [CalibrationObjection::OtherPose]));
}

/// A check took deviations that a calibration had estimated for known ones.
#[test]
fn a_calibration_tells_how_well_it_knows_its_deviations() {
    let cell = cell();
    let data: CalibrationData = serde_json::from_value(valid(&cell)).expect("the shape");
    let from = ["cd", "2026-11-20T09:00:00Z"];
    let found = CalibrationDocument::solved(&data, &cell, (Solve::Joint, 0), from).expect("a calibration");
    let left = (6 * found.summary.used - 16) as f64;
    let of = |source: Option<SigmaSource>| {
        let document = CalibrationDocument { arm_sigma_source: source, sigma_estimated: true, ..found.clone() };
        document.sigma_freedom()
    };
    assert_eq!(of(Some(SigmaSource::Estimated)), Some(left / 3.0));
    assert_eq!(of(None), Some(left / 3.0), "of a document of an earlier version");
    assert_eq!(of(Some(SigmaSource::Enlarged)), Some(left));
    assert_eq!(of(Some(SigmaSource::Given)), None);
}

/// The observations that were used were told beside all that had a residual: not how many of the others were held out, and
/// nothing of those that are given twice.
#[test]
fn observations_are_counted_as_given_used_held_out_and_dropped() {
    let cell = cell();
    let solved = |document: Value, hold_out: usize| {
        let data: CalibrationData = serde_json::from_value(document).expect("the shape");
        CalibrationDocument::solved(&data, &cell, (Solve::Joint, hold_out), ["cd", "2026-11-20T09:00:00Z"])
    };
    let counts = |document: Value, hold_out: usize| {
        let found = solved(document, hold_out).expect("a calibration");
        assert_eq!((found.converged, found.board_scale.and_then(|scale| scale.converged)), (Some(true), Some(true)));
        found.observation_counts()
    };
    assert_eq!(counts(valid(&cell), 0), [14, 14, 0, 0]);
    assert_eq!(counts(valid(&cell), 2), [14, 12, 2, 0]);
    let mut twice = valid(&cell);
    twice["observations"][7] = twice["observations"][2].clone();
    twice["observations"][7]["id"] = json!("twin");
    assert_eq!(counts(twice, 2), [14, 11, 2, 1]);
    let Err(CalibrationError::Findings(findings)) = solved(valid(&cell), 12) else { panic!("too few remain") };
    let told: Vec<String> = findings.iter().map(sentence).collect();
    assert!(told.iter().any(|told| told.starts_with("2 observations remain of 14, since 12 are held out")), "{told:?}");
}

/// Rows in which no board was found were left out without a word.
#[test]
fn rows_of_a_table_without_a_board_are_counted() {
    let options = CsvOptions { robot_pose: RobotPoseKind::Quaternion, unit_mm: 1.0, setup: HandEyeSetup::EyeInHand };
    let header = "j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg,board_x,board_y,board_z,board_qx,board_qy,board_qz,board_qw";
    let (seen, unseen) = ("0,0,0,0,0,0,4,5,6,0,0,0,1", "0,0,0,0,0,0,,,,,,,");
    let counted = |rows: &[&str]| {
        let text = format!("# taken by hand\n{header}\n\n{}\n", rows.join("\n"));
        from_csv(&text, &options).map(|data| (data.observations.len(), rows_without_board(&text, &data)))
    };
    assert_eq!(counted(&[seen, unseen, seen, unseen]), Ok((2, 2)));
    assert_eq!(counted(&[seen]), Ok((1, 0)));
}

/// A line was trimmed before it was split, so that tabs at its ends no longer separated the empty cells: the table was refused.
#[test]
fn empty_cells_at_the_ends_of_a_row_are_read_with_any_separator() {
    let options = CsvOptions { robot_pose: RobotPoseKind::Quaternion, unit_mm: 1.0, setup: HandEyeSetup::EyeInHand };
    let header = "id,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg,board_x,board_y,board_z,board_qx,board_qy,board_qz,board_qw";
    let rows = [header, ",0,0,0,0,0,0,4,5,6,0,0,0,1", "b,0,0,0,0,0,0,,,,,,,"];
    for separator in [",", ";", "\t"] {
        for end in ["\n", "\r\n"] {
            let text = rows.join(end).replace(',', separator);
            let data = from_csv(&text, &options).unwrap_or_else(|errors| panic!("{separator:?}: {errors:?}"));
            let ids: Vec<&str> = data.observations.iter().map(|observation| observation.id.as_str()).collect();
            assert_eq!((ids, rows_without_board(&text, &data)), (vec!["p01"], 1), "{separator:?}");
            // Columns that once were filled.
            let wider = rows.map(|row| format!("{row},,").replace(',', separator)).join(end);
            assert_eq!(from_csv(&wider, &options), Ok(data), "{separator:?}");
        }
    }
    let errors = from_csv(&format!("{header}\nc,0,0,0,0,0,0,4,5,6,0,0,0,1,7\n"), &options).expect_err("a cell too many");
    assert!(errors.len() == 1 && errors[0].detail == "has 15 cells; the header has 14", "{errors:?}");
}

/// Rows beyond the limit were counted as rows without a board, where one of those before them was.
#[test]
fn a_table_of_too_many_rows_is_refused_by_their_number() {
    let options = CsvOptions { robot_pose: RobotPoseKind::Quaternion, unit_mm: 1.0, setup: HandEyeSetup::EyeInHand };
    let read = |unseen: usize, seen: usize| {
        let rows = ["a,,,\n".repeat(unseen), "b,4,5,6\n".repeat(seen)].concat();
        from_csv(&format!("id,board_x,board_y,board_z\n{rows}"), &options).map(|data| data.observations.len())
    };
    assert_eq!(read(10, 4_990), Ok(4_990));
    let errors = read(10, 4_991).expect_err("one row too many");
    assert_eq!(errors[0].detail, "has 5001 rows; allowed are 5000: delete the rows beyond");
}

/// A row whose board had no place was left out without a word, a flange without one as well, and a second column was not read.
#[test]
fn a_row_of_a_table_that_gives_half_a_pose_is_told() {
    let options = CsvOptions { robot_pose: RobotPoseKind::Quaternion, unit_mm: 1.0, setup: HandEyeSetup::EyeInHand };
    let joints = "j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg";
    let board = "board_x,board_y,board_z,board_qx,board_qy,board_qz,board_qw";
    let flange = "flange_x,flange_y,flange_z,flange_r1,flange_r2,flange_r3,flange_r4";
    let told = |row: &str| {
        let text = format!("{joints},{flange},{board}\n0,0,0,0,0,0,{row}\n");
        from_csv(&text, &options).map(|data| data.observations.len())
    };
    assert_eq!(told("1,2,3,0,0,0,1,4,5,6,0,0,0,1"), Ok(1));
    assert_eq!(told(",,,,,,,4,5,6,0,0,0,1"), Ok(1), "joints alone");
    for (row, pointer) in [("1,2,3,0,0,0,1,,,,0,0,0,1", "/0/board_x"), (",,,0,0,0,1,4,5,6,0,0,0,1", "/0/flange_x")] {
        let errors = told(row).expect_err(row);
        assert!(errors.len() == 1 && errors[0].pointer == pointer && errors[0].detail.starts_with("is empty"), "{errors:?}");
    }
    let errors = from_csv("id,board_x,board_x\na,1,2\n", &options).expect_err("a column comes twice");
    assert!(errors.len() == 1 && errors[0].detail.starts_with("column 3 is \"board_x\" a second time"), "{errors:?}");
}
