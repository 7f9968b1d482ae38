//! Lenses beside OpenCV: projections, the files that it writes, and a calibration from its published stereo pictures
//! (`tests/oracles/lens_oracle.py`).

use nalgebra::{Point3, Vector2};
use serde::Deserialize;
use serde_json::json;
use vantage::cell::DeviceName;
use vantage::cell::calibration::lens::{
    AdjustOptions, BoardSpec, CalibrationFormat, DeviceImageSpec, ImportOptions, LensFault, LensParameters, OBSERVATIONS_SCHEMA,
    PARAMETER_NAMES, PixelOrigin, ScannerObservationsSpec, ViewSpec, adjust, assemble, quality, read,
};

use crate::support::{lines_of, oracle_python, shared};

fn lens() -> LensParameters {
    LensParameters {
        size_px: [4000, 3036],
        fx: 6668.083,
        fy: 6667.425,
        cx: 1940.035,
        cy: 1472.136,
        skew: 0.0,
        distortion: [-0.04359, 0.346, -0.00209, -0.00112, -0.2456],
    }
}

/// OpenCV's matrix of a lens: its pixels count from the centre of the first one.
fn matrix(lens: &LensParameters) -> [[f64; 3]; 3] {
    [[lens.fx, 0.0, lens.cx - 0.5], [0.0, lens.fy, lens.cy - 0.5], [0.0, 0.0, 1.0]]
}

#[test]
fn projections_are_those_of_opencv() {
    let Some(python) = oracle_python() else { return };
    let lens = lens();
    let points: Vec<[f64; 3]> = (0..400)
        .map(|index| {
            let (x, y) = (f64::from(index % 20) / 19.0 - 0.5, f64::from(index / 20) / 19.0 - 0.5);
            [290.0 * x, 215.0 * y, 480.0 + 70.0 * x - 40.0 * y]
        })
        .collect();
    let question = json!({"matrix": matrix(&lens), "distortion": lens.distortion, "points": points});
    let lines = lines_of(&python, "lens_oracle.py", &["project"], question.to_string());
    assert_eq!(lines.len(), points.len());
    let mut worst_px = 0.0_f64;
    for (line, point) in lines.iter().zip(points) {
        let numbers: Vec<f64> = line.split(' ').map(|number| number.parse().expect("a number")).collect();
        let pixel = Vector2::new(numbers[0] + 0.5, numbers[1] + 0.5);
        worst_px = worst_px.max((pixel - lens.project(&Point3::from(point))).norm());
    }
    println!("400 points: {worst_px:e} px from cv2.projectPoints");
    assert!(worst_px < 1e-6, "{worst_px}");
}

#[test]
fn files_of_opencv_are_read_to_the_lens_that_it_wrote() {
    let Some(python) = oracle_python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let (sine, cosine) = 0.371_755_f64.sin_cos();
    let lens = lens();
    let question = json!({"M1": matrix(&lens), "D1": [lens.distortion], "M2": matrix(&lens), "D2": [[0.01], [0.02], [0.0], [0.0], [0.0]],
        "R": [[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]], "T": [[-205.0], [1.5], [40.0]], "size": [4000, 3036]});
    lines_of(&python, "lens_oracle.py", &["files", &folder.path().display().to_string()], question.to_string());
    for ending in ["yml", "xml", "json"] {
        let text = std::fs::read_to_string(folder.path().join(format!("rig.{ending}"))).expect("written");
        let file =
            read(&text, CalibrationFormat::Opencv, &ImportOptions::default()).unwrap_or_else(|error| panic!("{ending}: {error}"));
        let rig = assemble(&[file]).unwrap_or_else(|error| panic!("{ending}: {error}"));
        let found = rig.devices.left.expect("a lens").lens;
        for (index, (found, wanted)) in found.values().into_iter().zip(lens.values()).enumerate() {
            assert!((found - wanted).abs() < 1e-9, "{ending} {}: {found}, {wanted}", PARAMETER_NAMES[index]);
        }
        assert!((rig.right_from_left.rotation.angle() - 0.371_755).abs() < 1e-9, "{ending}");
    }
}

#[derive(Deserialize)]
struct Stereo {
    size: [u32; 2],
    names: Vec<String>,
    left: Vec<Vec<[f64; 2]>>,
    right: Vec<Vec<[f64; 2]>>,
    rms_px: f64,
    left_rms_px: f64,
    right_rms_px: f64,
    baseline_mm: f64,
}

#[test]
fn the_published_stereo_pictures_are_explained_as_well_as_by_opencv() {
    let (Some(python), Some(picture)) = (oracle_python(), shared("calibration/opencv_stereo/left01.jpg")) else { return };
    let folder = picture.parent().expect("a folder").display().to_string();
    let lines = lines_of(&python, "lens_oracle.py", &["stereo", &folder], String::new());
    let stereo: Stereo = serde_json::from_str(&lines[0]).expect("its answer");
    let image = DeviceImageSpec { width_px: stereo.size[0], height_px: stereo.size[1] };
    let some = |pixels: &Vec<[f64; 2]>| pixels.iter().map(|pixel| Some(*pixel)).collect::<Vec<_>>();
    let views = stereo.names.iter().zip(stereo.left.iter().zip(&stereo.right));
    let spec = ScannerObservationsSpec {
        schema: OBSERVATIONS_SCHEMA.to_owned(),
        board: BoardSpec { columns: Some(9), rows: Some(6), square_mm: Some(25.0), points_mm: None },
        pixel_origin: PixelOrigin::Centre,
        left: image,
        right: image,
        projector: None,
        views: views
            .map(|(name, (left, right))| ViewSpec {
                id: name.clone(),
                left: some(left),
                right: some(right),
                ..ViewSpec::default()
            })
            .collect(),
        lit_rectangle: None,
        taken_at: None,
    };
    let observations = spec.build().expect("valid");
    // OpenCV's lens has no skew.
    let mut options = AdjustOptions::default();
    options.is_held[4] = true;
    let adjusted = adjust(&observations, &options).expect("a rig");
    let squares: Vec<f64> = adjusted.residuals.iter().map(|residual| residual.off_px.norm_squared()).collect();
    let rms_px = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    let of = |device: DeviceName| {
        let own: Vec<f64> = adjusted.residuals.iter().filter(|r| r.device == device).map(|r| r.off_px.norm_squared()).collect();
        (own.iter().sum::<f64>() / own.len() as f64).sqrt()
    };
    let (left_px, right_px) = (of(DeviceName::Left), of(DeviceName::Right));
    let baseline_mm = adjusted.device_from_left.right.translation.vector.norm();
    println!(
        "{} pairs: {rms_px:.4} px (left {left_px:.4}, right {right_px:.4}), OpenCV {:.4} ({:.4}, {:.4}); baseline {baseline_mm:.3}, \
         OpenCV {:.3} mm; {:?} px from epipolar lines",
        stereo.names.len(),
        stereo.rms_px,
        stereo.left_rms_px,
        stereo.right_rms_px,
        stereo.baseline_mm,
        quality(&observations, &adjusted).epipolar_rms_px
    );
    assert!((rms_px - stereo.rms_px).abs() < 0.01, "{rms_px}, {}", stereo.rms_px);
    assert!((left_px - stereo.left_rms_px).abs() < 0.01 && (right_px - stereo.right_rms_px).abs() < 0.01);
    assert!((baseline_mm - stereo.baseline_mm).abs() < 0.2, "{baseline_mm}");
}

#[test]
fn the_published_intrinsics_that_fold_are_refused_with_the_radius() {
    let Some(path) = shared("calibration/opencv_stereo/intrinsics.yml") else { return };
    let text = std::fs::read_to_string(path).expect("readable");
    let options = ImportOptions { image_size_px: Some([640, 480]), ..ImportOptions::default() };
    let mut file = read(&text, CalibrationFormat::Opencv, &options).expect("the file itself is sound");
    // It has no pose between the cameras; another of the set has.
    file.right_from_left = Some(nalgebra::Isometry3::translation(-83.19, 0.0, 0.0));
    let error = assemble(&[file]).expect_err("the left lens folds at 337 px");
    println!("{error}");
    assert_eq!((error.code, error.pointer.as_str()), (LensFault::Folds, "/left/distortion"));
    assert!(error.detail.contains("337 px"), "{error}");
}
