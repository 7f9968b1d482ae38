use super::*;
use crate::geometry::Mesh;
use crate::planning::params::{PartParams, RegionParams};
use crate::planning::surface;
use crate::testing::box_mesh;

/// Meshes as one.
fn merged(meshes: impl IntoIterator<Item = Mesh>) -> Mesh {
    let mut meshes = meshes.into_iter();
    let mut all = meshes.next().unwrap_or_else(|| unreachable!());
    for more in meshes {
        let first = all.vertices_mm.len() as u32;
        all.vertices_mm.extend(more.vertices_mm);
        all.source_face.extend(more.source_face);
        all.faces.extend(more.faces.iter().map(|face| face.map(|vertex| first + vertex)));
    }
    all
}

/// A hollow in a body: a box whose faces look inwards.
fn hollow(min_mm: [f64; 3], max_mm: [f64; 3]) -> Mesh {
    let mut mesh = box_mesh(min_mm, max_mm);
    mesh.faces.iter_mut().for_each(|face| face.swap(0, 1));
    mesh
}

#[test]
fn what_overhangs_the_rim_of_the_plate_does_not_stand_on_it() {
    let mesh = box_mesh([-300.0, -300.0, 0.0], [300.0, 300.0, 20.0]);
    let part = PartParams { patch_edge_mm: Some(20.0), samples_per_mm2: Some(0.001), ..PartParams::default() };
    let surface = surface::sample(&mesh, &part, &RegionParams::default(), 0).unwrap_or_else(|errors| panic!("{errors:?}"));
    let standing_mm2 =
        |plate_radius_mm: f64| surface.area_where(|sample| stands_on(&surface, sample, &Pose::identity(), plate_radius_mm));
    assert!((standing_mm2(500.0) - 360_000.0).abs() < 1.0, "all of the underside: {} mm²", standing_mm2(500.0));
    let disc_mm2 = PI * 250.0 * 250.0;
    assert!((standing_mm2(250.0) / disc_mm2 - 1.0).abs() < 0.02, "{} of {disc_mm2} mm²", standing_mm2(250.0));
}

fn sky_of(mesh: &Mesh, setups: &[Pose<Table, Part>], point_mm: [f64; 3], normal: Vector3<f64>) -> Sky {
    let part = RayScene::new([mesh]);
    let probe = SkyProbe::new(mesh, &part, (setups, 0.0), 480.0, 77.5_f64.to_radians(), SimdLevel::widest());
    probe.sky(&point_mm.into(), &normal)
}

#[test]
fn what_lies_in_a_closed_hollow_is_enclosed() {
    let shell = [box_mesh([-50.0; 3], [50.0; 3]), hollow([-40.0; 3], [40.0; 3])];
    let mesh = merged(shell.into_iter().chain([box_mesh([-10.0; 3], [10.0; 3])]));
    for (axis, side) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
        let along = Vector3::ith(axis, side);
        let at = |distance_mm: f64| <[f64; 3]>::from(along * distance_mm);
        assert_eq!(sky_of(&mesh, &[], at(50.0), along), Sky::Open, "outside");
        assert_eq!(sky_of(&mesh, &[], at(40.0), -along), Sky::Closed, "the wall of the hollow");
        assert_eq!(sky_of(&mesh, &[], at(10.0), along), Sky::Closed, "the cube in it");
    }
}

/// A box of walls around a room, with a hole of 16 mm in its lid, 80 mm above the floor: 5.7° to each side.
fn room_with_a_hole() -> Mesh {
    let wall = [box_mesh([-50.0, -50.0, -50.0], [50.0, 50.0, -40.0]), box_mesh([-50.0, -50.0, -40.0], [-40.0, 50.0, 50.0])];
    let walls = [box_mesh([40.0, -50.0, -40.0], [50.0, 50.0, 50.0]), box_mesh([-40.0, -50.0, -40.0], [40.0, -40.0, 50.0])];
    let rest = [box_mesh([-40.0, 40.0, -40.0], [40.0, 50.0, 50.0]), box_mesh([-40.0, -40.0, 40.0], [-8.0, 40.0, 50.0])];
    let lid = [
        box_mesh([8.0, -40.0, 40.0], [40.0, 40.0, 50.0]),
        box_mesh([-8.0, -40.0, 40.0], [8.0, -8.0, 50.0]),
        box_mesh([-8.0, 8.0, 40.0], [8.0, 40.0, 50.0]),
    ];
    merged(wall.into_iter().chain(walls).chain(rest).chain(lid))
}

#[test]
fn a_way_out_of_a_few_degrees_is_found() {
    let mesh = room_with_a_hole();
    assert_eq!(sky_of(&mesh, &[], [0.0, 0.0, -40.0], Vector3::z()), Sky::Open);
    let plug = merged([mesh, box_mesh([-8.0, -8.0, 40.0], [8.0, 8.0, 50.0])]);
    assert_eq!(sky_of(&plug, &[], [0.0, 0.0, -40.0], Vector3::z()), Sky::Closed);
}

#[test]
fn an_underside_is_seen_from_below_the_plate_alone_unless_it_is_high_enough() {
    let table = |height_mm: f64| {
        let leg = box_mesh([-10.0, -10.0, 0.0], [10.0, 10.0, height_mm]);
        merged([leg, box_mesh([-100.0, -100.0, height_mm], [100.0, 100.0, height_mm + 5.0])])
    };
    let standing = [Pose::identity()];
    let underside =
        |height_mm: f64, setups: &[Pose<Table, Part>]| sky_of(&table(height_mm), setups, [80.0, 0.0, height_mm], -Vector3::z());
    assert_eq!(underside(40.0, &standing), Sky::BelowPlate);
    assert_eq!(underside(40.0, &[]), Sky::Open, "without a plate");
    // At 77.5° a viewpoint 480 mm away stands 104 mm below what it sees.
    assert_eq!(underside(100.0, &standing), Sky::BelowPlate);
    assert_eq!(underside(112.0, &standing), Sky::Open);
    assert_eq!(sky_of(&table(40.0), &standing, [80.0, 0.0, 45.0], Vector3::z()), Sky::Open, "its top");
    // Turned over, the underside looks up.
    let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    let over = Pose::from_parts(Vector3::new(0.0, 0.0, 45.0), half_turn);
    assert_eq!(underside(40.0, &[Pose::identity(), over]), Sky::Open);
}

#[test]
fn a_sky_that_is_lower_than_viewpoints_may_stand_is_below_the_plate() {
    // A wall of a block is seen from 76° over the plate at most: at 77.5° off its normal, 480 mm away.
    let mesh = box_mesh([-10.0, -10.0, 0.0], [10.0, 10.0, 20.0]);
    let (part, standing) = (RayScene::new([&mesh]), [Pose::identity()]);
    let sky = |min_elevation_deg: f64, point_mm: [f64; 3], normal: Vector3<f64>| {
        let plates = (&standing[..], min_elevation_deg);
        SkyProbe::new(&mesh, &part, plates, 480.0, 77.5_f64.to_radians(), SimdLevel::widest()).sky(&point_mm.into(), &normal)
    };
    for (min_elevation_deg, expected) in [(0.0, Sky::Open), (60.0, Sky::Open), (80.0, Sky::BelowPlate)] {
        assert_eq!(sky(min_elevation_deg, [10.0, 0.0, 10.0], Vector3::x()), expected, "{min_elevation_deg}°");
        assert_eq!(sky(min_elevation_deg, [0.0, 0.0, 20.0], Vector3::z()), Sky::Open, "the top, {min_elevation_deg}°");
    }
}

/// Every direction looked into, one by one, as the definition has it.
fn sky_by_definition(probe: &SkyProbe<'_>, point_mm: &Point3<f64>, normal: &Vector3<f64>) -> Sky {
    let half_turn = || UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    let part_from_point = UnitQuaternion::rotation_between(&Vector3::z(), normal).unwrap_or_else(half_turn);
    let from_mm = point_mm + normal * ABOVE_MM;
    let towards: Vec<_> = probe.directions.iter().map(|direction| part_from_point * direction).collect();
    let ends_mm: Vec<_> = towards.iter().map(|direction| from_mm + direction * probe.beyond_mm).collect();
    let mut hidden = Vec::new();
    probe.part.blocked_from(probe.level, &from_mm, &ends_mm, 1.0, &mut hidden);
    let open: Vec<_> = towards.iter().zip(&hidden).filter(|(_, hidden)| !**hidden).map(|(direction, _)| *direction).collect();
    let usable = |direction: &&Vector3<f64>| normal.dot(direction) >= probe.min_cos;
    match open.iter().find(usable) {
        _ if open.is_empty() => Sky::Closed,
        _ if probe.setups.is_empty() => Sky::Open,
        None => Sky::Open,
        Some(_) if open.iter().filter(usable).any(|direction| probe.is_above(point_mm, direction)) => Sky::Open,
        Some(_) => Sky::BelowPlate,
    }
}

/// About so many samples of a part.
fn sampled(mesh: &Mesh, count: f64) -> Surface {
    let samples = crate::planning::params::PartParams {
        samples_per_mm2: Some(count / mesh.area_mm2()),
        patch_edge_mm: Some(40.0),
        ..crate::planning::params::PartParams::default()
    };
    let surface = crate::planning::surface::sample(mesh, &samples, &crate::planning::params::RegionParams::default(), 5);
    surface.unwrap_or_else(|errors| panic!("{errors:?}"))
}

/// Skies of all samples of a part without a plate: those found, and those by definition.
fn skies_of(mesh: &Mesh, count: f64) -> (Vec<Sky>, Vec<Sky>) {
    let (part, surface) = (RayScene::new([mesh]), sampled(mesh, count));
    let probe = SkyProbe::new(mesh, &part, (&[], 0.0), 480.0, 77.5_f64.to_radians(), SimdLevel::widest());
    let all: Vec<SampleId> = surface.samples().collect();
    let (cancel, silent) = (std::sync::atomic::AtomicBool::new(false), crate::planning::context::Silent);
    let skies = probe.skies(&surface, &all, &Context::new(&cancel, &silent)).expect("not cancelled");
    let expected =
        |sample: &SampleId| sky_by_definition(&probe, &surface.sample_mm[sample.index()], &surface.patch_of(*sample).normal);
    (skies, all.iter().map(expected).collect())
}

#[test]
fn neighbours_that_share_out_the_directions_find_the_ways_that_each_would() {
    let mesh = room_with_a_hole();
    let (skies, expected) = skies_of(&mesh, 8000.0);
    let count = |of: &[Sky], sky: Sky| of.iter().filter(|is| **is == sky).count();
    assert!(count(&expected, Sky::Closed) > 1000 && count(&expected, Sky::Open) > 1000);
    let overlooked = skies.iter().zip(&expected).filter(|(sky, expected)| sky != expected).count();
    assert!(overlooked * 500 <= skies.len(), "{overlooked} of {}", skies.len());
    assert!(skies.iter().zip(&expected).all(|(sky, expected)| sky == expected || *sky == Sky::Closed));
}

#[test]
fn fewer_neighbours_than_shares_look_everywhere() {
    let mesh = room_with_a_hole();
    let (part, surface) = (RayScene::new([&mesh]), sampled(&mesh, 3000.0));
    let probe = SkyProbe::new(&mesh, &part, (&[], 0.0), 480.0, 77.5_f64.to_radians(), SimdLevel::widest());
    let (cancel, silent) = (std::sync::atomic::AtomicBool::new(false), crate::planning::context::Silent);
    let ctx = Context::new(&cancel, &silent);
    for sample in surface.samples() {
        let alone = probe.skies(&surface, &[sample], &ctx).expect("not cancelled");
        let expected = sky_by_definition(&probe, &surface.sample_mm[sample.index()], &surface.patch_of(sample).normal);
        assert_eq!(alone, [expected], "{sample:?}");
    }
}

#[test]
fn what_is_left_out_and_what_neighbours_share_change_no_sky_of_a_trough() {
    let mesh = crate::testing::trough();
    let part = RayScene::new([&mesh]);
    let surface = sampled(&mesh, 600.0);
    let all: Vec<SampleId> = surface.samples().collect();
    let (cancel, silent) = (std::sync::atomic::AtomicBool::new(false), crate::planning::context::Silent);
    let ctx = Context::new(&cancel, &silent);
    let lifted = Pose::from_parts(Vector3::new(0.0, 0.0, 90.0), UnitQuaternion::identity());
    for (setups, incidence_max_deg) in
        [(vec![], 90.0), (vec![Pose::identity()], 77.5), (vec![Pose::identity()], 40.0_f64), (vec![lifted], 77.5)]
    {
        let plates = (&setups[..], 0.0);
        let probe = SkyProbe::new(&mesh, &part, plates, 480.0, incidence_max_deg.to_radians(), SimdLevel::widest());
        let skies = probe.skies(&surface, &all, &ctx).expect("not cancelled");
        let expected =
            |sample: &SampleId| sky_by_definition(&probe, &surface.sample_mm[sample.index()], &surface.patch_of(*sample).normal);
        let expected: Vec<Sky> = all.iter().map(expected).collect();
        assert!(expected.contains(&Sky::Open) && (setups.is_empty() || expected.contains(&Sky::BelowPlate)));
        let differ = skies.iter().zip(&expected).filter(|(sky, expected)| sky != expected).count();
        assert_eq!(differ, 0, "{} setups, {incidence_max_deg}°", setups.len());
    }
}
