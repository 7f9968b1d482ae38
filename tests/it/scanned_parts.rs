//! Real scans: a toy dinosaur found in the scan of a scene, and readers on the files of the public data set.

use std::io::Read;

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};
use vantage::geometry::cloud_io::{self, CloudFormat, CloudLimits};
use vantage::geometry::mesh_io::{self, Limits};
use vantage::geometry::{LengthUnit, Mesh, NearestFace, Pose};
use vantage::inspection::ViewScan;
use vantage::inspection::registration::locate::{LocateOptions, locate};

use crate::support::shared;

fn bytes_of(name: &str) -> Option<Vec<u8>> {
    let mut bytes = std::fs::read(shared(name)?).expect("readable");
    if name.ends_with(".gz") {
        let packed = std::mem::take(&mut bytes);
        flate2::read::GzDecoder::new(&packed[..]).read_to_end(&mut bytes).expect("gzip");
    }
    Some(bytes)
}

/// Mesh of the toy dinosaur.
pub(crate) fn model() -> Option<Mesh> {
    let bytes = bytes_of("scans/parasaurolophus_model.ply")?;
    Some(mesh_io::read(&bytes, Some(LengthUnit::Millimetre), &Limits::default()).expect("a mesh").mesh)
}

/// Pose of the toy in the scan of the scene, as it is found.
pub(crate) fn scene_from_model() -> Option<Isometry3<f64>> {
    let (model, scene) = (model()?, bytes_of("scans/parasaurolophus_scan_scene1.ply.gz")?);
    let mut file = cloud_io::read(&scene, &CloudLimits::default()).expect("a cloud");
    assert_eq!((file.format, file.clouds[0].points.len(), file.clouds[0].faces.len()), (CloudFormat::Ply, 114_373, 221_803));
    let scanner_cloud = file.clouds.remove(0).into_millimetres(LengthUnit::Millimetre);
    // The scene is in the sensor's frame, so that the stated pose of the part is that of the sensor.
    let scan = ViewScan { viewpoint: 1, part_from_scanner: Pose::identity(), scanner_cloud };
    // Most of the scene is other things; model and toy are two scans, millimetres apart.
    let options = LocateOptions { inlier_mm: 4.0, min_inlier_share: 0.1, second_share: 0.9 };
    let found = locate(&[scan], &NearestFace::new(&model), &options);
    assert_eq!(found.refused, None, "{found:?}");
    Some(found.best.mesh_from_stated.isometry().inverse())
}

/// Row I3. The pose that Open3D 0.20 finds (FPFH, RANSAC, point to plane) is given by the research note; `oracle_scans` asks it anew.
#[test]
fn the_dinosaur_is_found_in_the_scan_of_a_scene() {
    let (Some(model), Some(scene_from_model)) = (model(), scene_from_model()) else { return };
    let rows = Matrix3::new(0.9944, -0.0866, 0.0610, 0.0993, 0.5628, -0.8206, 0.0367, 0.8221, 0.5682);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&rows));
    let wanted = Isometry3::from_parts(Vector3::new(-74.22, -601.48, -292.80).into(), rotation);
    let centre = model.aabb().centre();
    let apart_mm = (scene_from_model * centre - wanted * centre).norm();
    let apart_deg = scene_from_model.rotation.angle_to(&wanted.rotation).to_degrees();
    println!("{apart_mm:.3} mm, {apart_deg:.3}° from Open3D");
    assert!(apart_mm < 0.5 && apart_deg < 0.3, "{apart_mm} mm, {apart_deg}°");
}

#[test]
fn clouds_of_meshes_in_the_data_set_are_read_whole() {
    for (name, format, points, faces) in [
        ("meshes/bunny_69k_ascii.ply", CloudFormat::Ply, 35_947, 69_451),
        ("meshes/turbineblade_199k_binary.ply", CloudFormat::Ply, 99_519, 199_034),
        ("meshes/armadillo_52k_binary.stl", CloudFormat::Stl, 26_002, 52_000),
        ("scans/hippo1.ply", CloudFormat::Ply, 0, 0),
    ] {
        let Some(bytes) = bytes_of(name) else { return };
        let file = cloud_io::read(&bytes, &CloudLimits::default()).unwrap_or_else(|error| panic!("{name}: {error}"));
        let cloud = &file.clouds[0];
        println!("{name}: {} points, {} faces", cloud.points.len(), cloud.faces.len());
        assert_eq!(file.format, format, "{name}");
        assert!(
            cloud.points.len() >= points && cloud.faces.len() >= faces,
            "{name}: {} {}",
            cloud.points.len(),
            cloud.faces.len()
        );
    }
}
