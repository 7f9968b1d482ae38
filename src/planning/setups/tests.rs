use std::sync::atomic::AtomicBool;

use super::*;
use crate::cell::PoseSpec;
use crate::geometry::{Poll, stable_poses};
use crate::planning::context::Silent;
use crate::planning::params::Region;
use crate::testing::{box_mesh, nominal_scanner};

fn poses_of(mesh: &Mesh, change: impl Fn(&mut PlanParams)) -> Vec<Pose<Table, Part>> {
    let (scanner, cancel) = (nominal_scanner(), AtomicBool::new(false));
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    let mut params = PlanParams::default();
    params.part.table_from_part = Some(PoseSpec::from(&super::super::resting(mesh)));
    change(&mut params);
    let pool = pool_of(mesh, &params);
    poses(&input, &params, || Ok(pool.as_slice()), &Context::new(&cancel, &Silent)).unwrap_or_else(|error| panic!("{error}"))
}

fn pool_of(mesh: &Mesh, params: &PlanParams) -> Vec<Pose<Table, Part>> {
    let stable = stable_poses(mesh, &Poll::never()).expect("not interrupted");
    pool(mesh, params, || Ok(stable.as_slice())).expect("not cancelled")
}

/// A part of a metre was refused in several setups, for more candidates than the job asked for.
#[test]
fn a_part_of_many_blocks_is_compared_from_as_many_viewpoints_as_a_job_may_have() {
    const SAMPLES: usize = 8_000;
    let views = |blocks: usize, has_many: bool| candidates::expected(&grid(blocks, SAMPLES, has_many), blocks, SAMPLES);
    let of_a_block = |blocks: usize, has_many: bool| views(blocks, has_many) / blocks;
    let blocks = [1, 121, 122, 462, 463, 1136, 1137, 4166];
    assert_eq!(blocks.map(|blocks| of_a_block(blocks, false)), [412, 412, 108, 108, 44, 44, 12, 12]);
    assert_eq!([1, 462, 463].map(|blocks| of_a_block(blocks, true)), [108, 108, 44]);
    // A box of 1400 × 1000 × 1000 mm has 352.
    for blocks in blocks.into_iter().chain([352]) {
        assert!(candidates::check_count(views(blocks, false), SAMPLES).is_ok(), "{blocks} blocks");
    }
}

/// Samples that earlier views measure are not asked about again; what is measured in each pose is what the views alone measure.
#[test]
fn views_together_measure_what_they_measure_alone() {
    let (mesh, scanner, cancel) = (box_mesh([0.0; 3], [60.0, 40.0, 30.0]), nominal_scanner(), AtomicBool::new(false));
    let (ctx, params) = (Context::new(&cancel, &Silent), PlanParams::default());
    let surface = surface::sample_for(&mesh, &params.part, &params.regions, 1, &ctx).expect("a surface");
    let (optics, occluders) =
        (Optics::new(&scanner, &params, &surface.requirements), Occluders::interruptible([&mesh], &ctx).expect("not cancelled"));
    let together = UnitedViews::new(&surface, &optics, &occluders, &params, &ctx);
    let scope = Scope {
        part: &mesh,
        surface: &surface,
        scanner: &scanner,
        cell: None,
        table_from_part: Pose::default(),
        occluders: &occluders,
        optics: &optics,
        score: &params.score,
        seed: 0,
    };
    let generated = candidates::generate(&scope, &CandidateParams::ellipsoid(), &ctx).expect("candidates");
    let views: Vec<_> = generated.remaining.iter().map(|candidate| candidate.part_from_scanner).collect();
    assert!(views.len() > 3 * BATCH, "{}", views.len());
    let above = |view: usize| PoseIndex::first(3).filter(move |pose| !view.is_multiple_of(pose.index() + 2));
    let served: Vec<Vec<PoseIndex>> = (0..views.len()).map(|view| above(view).collect()).collect();
    let found = measured_in_poses(&together, &views, &served, 3).expect("not cancelled");
    for (pose, found) in PoseIndex::number(&found) {
        let mut alone = together.nothing();
        for (view, _) in views.iter().zip(&served).filter(|(_, served)| served.contains(&pose)) {
            alone.insert_all(together.row(view, &together.nothing()).expect("not cancelled").measured());
        }
        assert!(alone.count() > 100 && alone.words() == found.words(), "{pose:?}: {} of {}", found.count(), alone.count());
    }
}

/// However a box is turned, it stands on the plate with its centre on the axis, and the axis asked for points up.
#[test]
fn the_axis_that_is_asked_for_points_up() {
    let mesh = box_mesh([10.0, -5.0, 3.0], [70.0, 35.0, 33.0]);
    for (name, up, height_mm) in [
        ("x", Vector3::x(), 60.0),
        ("-x", -Vector3::x(), 60.0),
        ("y", Vector3::y(), 40.0),
        ("-y", -Vector3::y(), 40.0),
        ("z", Vector3::z(), 30.0),
        ("-Z", -Vector3::z(), 30.0),
    ] {
        let pose = super::super::standing(&mesh, name.parse().expect("an axis"));
        assert!((pose.direction(&up) - Vector3::z()).norm() < 1e-12, "{name}");
        let placed = mesh.vertices_mm.iter().map(|p| pose.point(p));
        let aabb = placed.fold(crate::geometry::Aabb::empty(), |aabb, p| aabb.with(&p));
        assert!(aabb.min.z.abs() < 1e-9 && (aabb.max.z - height_mm).abs() < 1e-9, "{name}: {aabb:?}");
        assert!(aabb.centre().xy().coords.norm() < 1e-9, "{name}: {aabb:?}");
    }
    assert_eq!(super::super::standing(&mesh, "+z".parse().expect("an axis")), super::super::resting(&mesh));
    let refused = "down".parse::<super::super::UpAxis>().expect_err("no axis");
    assert_eq!(refused.to_string(), "is \"down\"; allowed is one of x, -x, y, -y, z, -z");
}

fn down(pose: &Pose<Table, Part>) -> Vector3<f64> {
    pose.inverse().direction(&-Vector3::z())
}

/// All of a box but its bottom is seen from above: it takes one more pose for that, and no third one.
#[test]
fn a_box_is_turned_once_however_often_it_may_be() {
    let mesh = box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
    assert_eq!(poses_of(&mesh, |_| ()).len(), 1);
    for setups in 2..=4 {
        let poses = poses_of(&mesh, |params| params.setups = setups);
        assert_eq!(poses.len(), 2, "with {setups} allowed");
        assert!(down(&poses[0]).angle(&down(&poses[1])) > 1.5, "the bottom is up, or at least upright, once");
        for pose in &poses {
            let lowest_mm = mesh.vertices_mm.iter().map(|p| pose.point(p).z).fold(f64::INFINITY, f64::min);
            assert!(lowest_mm.abs() < 1e-4, "stands on the plate: {lowest_mm}");
        }
    }
}

#[test]
fn given_poses_alone_are_chosen_from() {
    let mesh = box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
    let upright = standing_on(&mesh, &-Vector3::z());
    let over = standing_on(&mesh, &Vector3::z());
    let given = [upright, over].map(|pose| PoseSpec::from(&pose));
    let poses = poses_of(&mesh, |params| {
        params.setups = 2;
        params.part.resting_poses = given.to_vec();
        // Upright and upside down a box shares its walls alone, along which its two halves slide.
        params.registration = Registration::None;
    });
    assert_eq!(poses.len(), 2);
    assert!(down(&poses[0]).z < -0.999 && down(&poses[1]).z > 0.999);
}

#[test]
fn a_fixture_holds_one_setup() {
    let mesh = box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
    let (scanner, cancel) = (nominal_scanner(), AtomicBool::new(false));
    let input = PlanInput { mesh: &mesh, fixture: Some(&mesh), part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    let params = PlanParams { setups: 2, ..PlanParams::default() };
    let refused = poses(&input, &params, || Ok(&[] as &[Pose<Table, Part>]), &Context::new(&cancel, &Silent))
        .err()
        .unwrap_or_else(|| panic!("refused"));
    assert!(refused.to_string().contains("/setups"), "{refused}");
}

/// The poses beside the one that a part is given in.
fn further_poses(mesh: &Mesh, change: impl Fn(&mut PlanParams)) -> Option<FurtherPoses> {
    let (scanner, cancel) = (nominal_scanner(), AtomicBool::new(false));
    let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    let mut params = PlanParams::default();
    params.part.table_from_part = Some(PoseSpec::from(&super::super::resting(mesh)));
    change(&mut params);
    let standing = params.part.table_from_part.unwrap_or_default().pose();
    let part = Occluders::new([mesh]);
    let (pool, ctx) = (pool_of(mesh, &params), Context::new(&cancel, &Silent));
    FurtherPoses::of(&input, &params, (&pool, &[standing]), &part, &ctx).unwrap_or_else(|error| panic!("{error}"))
}

/// The further pose beside the one that a part is given in, and those at the places that were tried.
fn further_of(mesh: &Mesh, change: impl Fn(&mut PlanParams), tried: &[PoseIndex]) -> Option<FurtherPose> {
    further_poses(mesh, change).and_then(|poses| poses.best(tried))
}

#[test]
fn the_further_pose_of_a_box_is_the_one_that_a_plan_in_two_setups_chooses() {
    let mesh = box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
    for registration in [Registration::None, Registration::Surface] {
        let further = further_of(&mesh, |params| params.registration = registration, &[]).unwrap_or_else(|| panic!("a pose"));
        assert!(further.is_default && further.registration == registration, "{registration:?}");
        let chosen = poses_of(&mesh, |params| (params.setups, params.registration) = (2, registration));
        assert_eq!(chosen[1], further.table_from_part, "{registration:?}");
        // Upside down it shares its walls alone with how it lies, which joins nothing.
        let is_over = down(&further.table_from_part).z > 0.999;
        assert_eq!(is_over, registration == Registration::None, "{registration:?}");
    }
}

#[test]
fn poses_are_offered_one_after_the_other_until_none_is_left() {
    let mesh = box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
    let mut tried = Vec::new();
    let without_registration = |params: &mut PlanParams| params.registration = Registration::None;
    while let Some(further) = further_of(&mesh, without_registration, &tried) {
        assert!(!tried.contains(&further.place), "{tried:?}");
        assert_eq!(further.is_default, tried.is_empty(), "the first alone is chosen by itself");
        tried.push(further.place);
    }
    assert_eq!(tried.len(), 5, "all but the side that it stands on: {tried:?}");
}

#[test]
fn no_further_pose_is_offered_where_none_may_be_chosen() {
    let mesh = box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
    let alone = |params: &mut PlanParams| params.part.resting_poses = params.part.table_from_part.into_iter().collect();
    assert!(further_of(&mesh, alone, &[]).is_none());
    // The underside is not asked for: no other pose is worth it.
    let without_underside = |params: &mut PlanParams| params.regions.exclude = vec![Region::Faces { faces: vec![0, 1] }];
    assert!(further_of(&mesh, without_underside, &[]).is_none());
}

/// A lid of 90 × 70 × 30 mm, open at the bottom.
fn lid() -> Mesh {
    let mut lid = box_mesh([-45.0, -35.0, 0.0], [45.0, 35.0, 30.0]);
    let inside = box_mesh([-40.0, -30.0, 0.0], [40.0, 30.0, 22.5]);
    let first = lid.vertices_mm.len() as u32;
    // The first two faces of a box are its bottom.
    let inwards = inside.faces[2..].iter().map(|[a, b, c]| [first + a, first + c, first + b]);
    let edges: [[u32; 2]; 4] = [[0, 1], [1, 3], [3, 2], [2, 0]];
    let rim = edges.iter().flat_map(|[a, b]| [[*a, first + a, *b], [*b, first + a, first + b]]);
    lid.faces = lid.faces[2..].iter().copied().chain(inwards).chain(rim).collect();
    lid.source_face = (0..lid.faces.len() as u32).collect();
    lid.vertices_mm.extend(inside.vertices_mm);
    lid
}

/// A lid hides its inside the way it is filed, and no second pose that shares enough surface shows all: the advice stopped there.
#[test]
fn a_part_that_hides_its_inside_is_laid_anew_as_a_plan_in_two_setups_lays_it() {
    let mesh = lid();
    let poses = further_poses(&mesh, |_| ()).unwrap_or_else(|| panic!("poses"));
    let beside = poses.best(&[]).unwrap_or_else(|| panic!("a pose beside"));
    let anew = poses.anew().unwrap_or_else(|| panic!("poses without the first"));
    assert!(
        anew.reachable_of_asked > beside.reachable_of_asked + 0.02,
        "{} {}",
        anew.reachable_of_asked,
        beside.reachable_of_asked
    );
    assert!(!beside.is_default && anew.registration == Registration::Surface);
    assert_eq!(anew.table_from_part, poses_of(&mesh, |params| params.setups = 2));
    assert!(anew.table_from_part.iter().all(|pose| down(pose).z > -0.5), "it never lies on its rim");
}

#[test]
fn a_part_whose_further_pose_shows_all_stays_in_its_own_as_well() {
    let mesh = box_mesh([0.0; 3], [60.0, 40.0, 30.0]);
    for registration in [Registration::None, Registration::Surface] {
        let poses = further_poses(&mesh, |params| params.registration = registration).unwrap_or_else(|| panic!("poses"));
        assert!(poses.anew().is_none(), "{registration:?}");
        assert!(poses.best(&[]).is_some_and(|further| further.reachable_of_asked > 0.99), "{registration:?}");
    }
}
