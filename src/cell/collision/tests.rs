use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Rotation3, UnitQuaternion, Vector3};
use parry3d::math::Vector;
use parry3d::query::gjk::GJKResult;
use proptest::prelude::*;

use super::solid::{Solid, is_apart, near, parry_pose};
use super::{CollisionScene, Contact, MetOnTable, PRIMES, halton};
use crate::cell::body::{Body, LinkBody, Shape};
use crate::cell::{Axes, Cell, Configuration, LinkCapsule, Presets, RunoutHarmonic, SpecLibrary};
use crate::geometry::{Mesh, Pose};
use crate::testing::box_mesh;

fn cell() -> Cell {
    Presets.cell("e05-transcan").expect("preset").build(&Presets).expect("builds")
}

fn at(x: f64, y: f64, z: f64) -> Isometry3<f64> {
    Isometry3::translation(x, y, z)
}

/// Distance at which the test turns, found by bisection on the margin.
fn measured(a: (&Solid, Isometry3<f64>), b: (&Solid, Isometry3<f64>)) -> f64 {
    let (pose_a, pose_b) = (parry_pose(&a.1), parry_pose(&b.1));
    let is_near = |margin: f64| near((a.0, &pose_a), (b.0, &pose_b), margin as f32);
    let (mut low, mut high) = (0.0, 3000.0);
    if is_near(low) {
        return 0.0;
    }
    assert!(is_near(high));
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if is_near(middle) { high = middle } else { low = middle }
    }
    high
}

fn capsule(radius_mm: f64, length_mm: f64) -> Solid {
    Solid::from_shape(&Shape::Capsule { radius_mm, length_mm })
}

fn cuboid(size_mm: [f64; 3]) -> Solid {
    Solid::from_shape(&Shape::Box { size_mm })
}

#[test]
fn distances_between_solids_are_the_analytic_ones() {
    let ball = capsule(50.0, 0.0);
    let rod = capsule(30.0, 400.0);
    let block = cuboid([200.0, 100.0, 60.0]);
    let disc = Solid::from_shape(&Shape::Cylinder { radius_mm: 250.0, height_mm: 20.0 });
    let post = Solid::from_shape(&Shape::Cylinder { radius_mm: 20.0, height_mm: 300.0 });
    let mesh = Solid::from_mesh(&box_mesh([-100.0, -50.0, -30.0], [100.0, 50.0, 30.0]), &Isometry3::identity());
    let quarter =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2));
    let turned = |x, y, z| Isometry3::from_parts(nalgebra::Translation3::new(x, y, z), quarter);
    let diagonal = (100.0_f64 * 100.0 + 150.0 * 150.0 + 170.0 * 170.0).sqrt() - 50.0;
    let cases = [
        ("two balls", &ball, at(0.0, 0.0, 0.0), &ball, at(300.0, 400.0, 0.0), 400.0),
        ("ball over rod's end", &rod, at(0.0, 0.0, 0.0), &ball, at(0.0, 0.0, 500.0), 220.0),
        ("crossed rods", &rod, at(0.0, 0.0, 0.0), &rod, turned(200.0, 50.0, -100.0), 140.0),
        ("ball beside box", &block, at(0.0, 0.0, 0.0), &ball, at(10.0, 20.0, 180.0), 100.0),
        ("ball off box corner", &block, at(0.0, 0.0, 0.0), &ball, at(200.0, 200.0, 200.0), diagonal),
        ("ball above disc", &disc, at(0.0, 0.0, -10.0), &ball, at(120.0, 0.0, 90.0), 40.0),
        ("ball beside disc", &disc, at(0.0, 0.0, -10.0), &ball, at(0.0, 400.0, -10.0), 100.0),
        ("ball off mesh corner", &mesh, at(0.0, 0.0, 0.0), &ball, at(200.0, 200.0, 200.0), diagonal),
        ("box beside mesh", &mesh, at(700.0, 100.0, 0.0), &block, at(700.0, 100.0, 160.0), 100.0),
        ("disc beside mesh", &mesh, at(0.0, 0.0, 0.0), &disc, at(0.0, 0.0, 50.0), 10.0),
        ("post beside mesh, its middle far above", &mesh, at(0.0, 0.0, 0.0), &post, at(10.0, 80.0, 140.0), 10.0),
        ("two meshes", &mesh, at(0.0, 0.0, 0.0), &mesh, at(230.0, 140.0, 0.0), 50.0),
        ("overlapping", &mesh, at(0.0, 0.0, 0.0), &rod, at(0.0, 60.0, 0.0), 0.0),
        ("ball inside mesh", &mesh, at(0.0, 0.0, 0.0), &capsule(5.0, 10.0), at(1.0, 2.0, 3.0), 0.0),
        ("mesh inside box", &mesh, at(0.0, 0.0, 0.0), &cuboid([900.0; 3]), at(0.0, 0.0, 0.0), 0.0),
    ];
    for (name, a, pose_a, b, pose_b, expected) in cases {
        for found in [measured((a, pose_a), (b, pose_b)), measured((b, pose_b), (a, pose_a))] {
            assert!((found - expected).abs() <= 0.02 + 1e-3 * expected, "{name}: {found}, expected {expected}");
        }
    }
}

/// Exact point-to-box distance, for the property below.
fn point_to_box(point: &Point3<f64>, half: &Vector3<f64>) -> f64 {
    Vector3::from_fn(|i, _| (point[i].abs() - half[i]).max(0.0)).norm()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn a_ball_and_a_turned_box_agree_with_the_closed_form(
        offset in prop::array::uniform3(-600.0..600.0f64),
        axis in prop::array::uniform3(-1.0..1.0f64),
        as_mesh in any::<bool>(),
    ) {
        let half = Vector3::new(150.0, 65.0, 55.0);
        let turned = UnitQuaternion::from_scaled_axis(Vector3::from(axis) * 3.0);
        let pose = Isometry3::from_parts(nalgebra::Translation3::new(200.0, -300.0, 500.0), turned);
        let centre = pose.translation.vector + Vector3::from(offset);
        let expected = point_to_box(&pose.inverse_transform_point(&Point3::from(centre)), &half) - 40.0;
        prop_assume!(expected > 0.5);
        let (low, high) = ([-half.x, -half.y, -half.z], half.into());
        let block = if as_mesh { Solid::from_mesh(&box_mesh(low, high), &Isometry3::identity()) } else { cuboid([300.0, 130.0, 110.0]) };
        let found = measured((&block, pose), (&capsule(40.0, 0.0), Isometry3::from(centre)));
        prop_assert!((found - expected).abs() <= 0.02 + 1.5e-3 * (expected + 40.0), "{} against {}", found, expected);
    }
}

fn names(contact: &Contact) -> [&str; 2] {
    [&contact.a, &contact.b]
}

/// Configuration with these joints, in degrees, and the table at angle zero.
fn at_zero_table(joints_deg: [f64; 6]) -> Configuration {
    Configuration { joints_rad: joints_deg.map(f64::to_radians), table_rad: 0.0 }
}

/// The configuration of a number, spread over all that the axes allow.
fn spread(axes: &Axes, number: u32) -> Configuration {
    Configuration::from_axes_rad(std::array::from_fn(|i| {
        let axis = axes.0[i];
        axis.min_rad + (axis.max_rad - axis.min_rad) * super::halton(number, super::PRIMES[i])
    }))
}

#[test]
fn the_home_of_the_default_cell_is_clear_and_names_come_with_a_contact() {
    let cell = cell();
    let scene = CollisionScene::without_part(&cell, 5.0);
    assert_eq!(scene.check(&cell.home_rad), None);
    // Flat forward over the plate and down: something of the arm or scanner meets the table.
    let down = at_zero_table([0.0, -110.0, 60.0, 0.0, 0.0, 0.0]);
    let contact = scene.check(&down).expect("must collide");
    assert!(names(&contact).iter().any(|name| name.starts_with("turntable") || *name == "floor"), "{contact}");
}

#[test]
fn a_part_collides_where_it_is_and_turns_with_the_table() {
    let cell = cell();
    let on_plate = Pose::identity();
    // A thin post near the rim that reaches up to where the flange is when the arm leans over it.
    let flange_mm = |configuration: &Configuration| {
        let base_from_flange = cell.robot.base_from_flange(&configuration.joints_rad);
        cell.base_from_table.inverse().point(&base_from_flange.origin_mm())
    };
    let pose = at_zero_table([0.0, -30.0, 80.0, 0.0, 60.0, 0.0]);
    let tip = flange_mm(&pose);
    let post = box_mesh([tip.x - 5.0, tip.y - 5.0, tip.z - 5.0], [tip.x + 5.0, tip.y + 5.0, tip.z + 5.0]);
    let scene = CollisionScene::new(&cell, &post, None, &on_plate, 1.0);
    let free = CollisionScene::without_part(&cell, 1.0);
    assert_eq!(free.check(&pose), None);
    assert!(names(&scene.check(&pose).expect("must collide")).contains(&"part"));
    assert_eq!(scene.check_view(&pose).map(|contact| contact.to_string()).as_deref(), Some("flange and part"));
    let turned = Configuration { table_rad: std::f64::consts::PI, ..pose };
    assert_eq!((scene.check(&turned), scene.check_view(&turned)), (None, None));
    let fixture = CollisionScene::new(&cell, &box_mesh([0.0; 3], [1.0; 3]), Some(&post), &on_plate, 1.0);
    assert!(names(&fixture.check(&pose).expect("must collide")).contains(&"fixture"));
}

#[test]
fn what_is_free_at_every_table_angle_is_free_at_each() {
    let cell = cell();
    let (part, fixture) =
        (box_mesh([60.0, -40.0, 0.0], [220.0, 60.0, 260.0]), box_mesh([-200.0, 150.0, 0.0], [-150.0, 180.0, 40.0]));
    let scene = CollisionScene::new(&cell, &part, Some(&fixture), &Pose::identity(), 5.0);
    let (every, alone) = (scene.at_every_table_angle(), CollisionScene::without_part(&cell, 5.0));
    let axes = cell.axes();
    let (mut free, mut only_at_some) = (0, 0);
    for seed in 1..4000 {
        let mut configuration = spread(&axes, seed);
        let is_free = every.check(&configuration).is_none();
        let at_each = (0..72).all(|step| {
            configuration.table_rad = f64::from(step) * std::f64::consts::TAU / 72.0;
            scene.check(&configuration).is_none()
        });
        assert!(at_each || !is_free, "seed {seed}");
        free += u32::from(is_free);
        only_at_some += u32::from(!at_each && alone.check(&configuration).is_none());
    }
    assert!(free > 100 && only_at_some > 20, "{free} free at every angle, {only_at_some} not");
}

#[test]
fn a_segment_is_refused_exactly_when_a_fine_sampling_finds_a_contact() {
    let cell = cell();
    let part = box_mesh([-100.0, -100.0, 0.0], [100.0, 100.0, 200.0]);
    let scene = CollisionScene::new(&cell, &part, None, &Pose::identity(), 5.0);
    let axes = cell.axes();
    let (mut free, mut blocked) = (0, 0);
    for seed in 0..40 {
        let (from, to) = (spread(&axes, 3 * seed + 1), spread(&axes, 3 * seed + 2));
        let fine = (0..=2000).any(|step| {
            let t = f64::from(step) / 2000.0;
            scene.check(&from.toward(&to, t)).is_some()
        });
        let found = scene.check_segment(&from, &to).is_some();
        // The proof may pass a graze that stays above zero distance, never a real contact; here both agree.
        assert_eq!(found, fine, "seed {seed}");
        if found { blocked += 1 } else { free += 1 }
    }
    assert!(free >= 3 && blocked >= 3, "{free} free, {blocked} blocked: the case says little");
}

#[test]
fn reach_bounds_every_motion() {
    let cell = cell();
    let part = box_mesh([-60.0, -60.0, 0.0], [60.0, 60.0, 120.0]);
    let scene = CollisionScene::new(&cell, &part, None, &Pose::identity(), 5.0);
    for seed in 1..200 {
        let axes = cell.axes();
        let from = Configuration::from_axes_rad(std::array::from_fn(|i| {
            axes.0[i].min_rad * (1.0 - 2.0 * super::halton(seed, super::PRIMES[i]))
        }));
        let step = std::array::from_fn(|i| 0.05 * super::halton(seed, super::PRIMES[6 - i]));
        let to = from.along(&step, 1.0);
        let (before, after) = (scene.place(&from), scene.place(&to));
        for pair in &scene.pairs {
            let mut moved = 0.0;
            // The plate is round: its bounding box turns, it does not move.
            for body in [pair.a, pair.b].into_iter().filter(|body| &*scene.bodies[*body].name != "turntable plate") {
                // Two bodies of the arm are watched from the inner one, all others from the foot.
                let inner = if scene.bodies[pair.a].parent.link() < scene.bodies[pair.b].parent.link() { pair.a } else { pair.b };
                let seen = |placement: &super::Placement, point| {
                    let both_on_arm = [pair.a, pair.b].iter().all(|b| scene.bodies[*b].parent.link() > 0);
                    let eye = if both_on_arm { placement.poses[inner] } else { parry3d::math::Pose::IDENTITY };
                    eye.inverse() * placement.poses[body] * point
                };
                let corners = scene.bodies[body].solid.aabb(&parry3d::math::Pose::IDENTITY).vertices();
                // Within the corners of the bounding box: those of a round body are not its own.
                let points = corners.iter().map(|corner| *corner * 0.57);
                moved += points.map(|p| f64::from((seen(&before, p) - seen(&after, p)).length())).fold(0.0, f64::max);
            }
            assert!(moved <= pair.motion_mm(&step) + 0.01, "{moved} over {}", pair.motion_mm(&step));
        }
    }
}

fn on_arm(scene: &CollisionScene) -> Vec<(usize, usize)> {
    let is_link = |body: usize| matches!(scene.bodies[body].parent, super::ParentLink::Link(_));
    scene.pairs.iter().map(|pair| (pair.a, pair.b)).filter(|(a, b)| is_link(*a) && is_link(*b)).collect()
}

#[test]
fn a_larger_clearance_excuses_no_pair_of_the_arm_and_leaves_it_room_to_be() {
    let cell = Cell { obstacles: Vec::new(), ..cell() };
    let least = on_arm(&CollisionScene::without_part(&cell, 1.0));
    assert!(least.len() > 30);
    for clearance_mm in [5.0, 20.0, 50.0, 100.0] {
        let scene = CollisionScene::without_part(&cell, clearance_mm);
        assert_eq!(on_arm(&scene), least, "{clearance_mm} mm");
        assert_eq!(scene.check(&cell.home_rad), None, "{clearance_mm} mm");
    }
}

/// A worktop 3 mm beside the plate, which turns in place, left no plan.
#[test]
fn the_plate_must_not_touch_what_stands_still_and_need_not_keep_the_clearance_from_it() {
    let contact = |gap_mm: f64| {
        let mut cell = cell();
        let middle_mm = cell.turntable.plate_radius_mm + gap_mm + 50.0;
        let owner_from_body = cell.base_from_table.isometry() * Isometry3::translation(middle_mm, 0.0, -5.0);
        let shape = Shape::Box { size_mm: [100.0, 100.0, 10.0] };
        cell.obstacles = vec![Body { name: "worktop".to_owned(), owner_from_body, shape }];
        CollisionScene::without_part(&cell, 5.0).check(&cell.home_rad)
    };
    assert_eq!(contact(3.0), None);
    assert_eq!(contact(0.5).expect("too near").b.as_ref(), "worktop");
}

#[test]
fn a_mesh_inside_another_is_near_it_and_beside_it_is_not() {
    let mesh = |half_mm: f64| Solid::from_mesh(&box_mesh([-half_mm; 3], [half_mm; 3]), &Isometry3::identity());
    let (small, large) = (mesh(10.0), mesh(200.0));
    let inside = at(30.0, -40.0, 50.0);
    assert_eq!(measured((&small, inside), (&large, at(0.0, 0.0, 0.0))), 0.0);
    assert_eq!(measured((&large, at(0.0, 0.0, 0.0)), (&small, inside)), 0.0);
    let beside = measured((&small, at(300.0, 0.0, 0.0)), (&large, at(0.0, 0.0, 0.0)));
    assert!((beside - 90.0).abs() < 0.2, "{beside}");
}

#[test]
fn a_placement_is_refused_where_the_part_stands_in_what_it_should_stand_on() {
    let cell = cell();
    let on_plate = box_mesh([-100.0, -100.0, 0.0], [100.0, 100.0, 200.0]);
    let contact = |cell: &Cell, part: &Mesh, fixture: Option<&Mesh>| {
        let scene = CollisionScene::new(cell, part, fixture, &Pose::identity(), 5.0);
        scene.placement_contact().map(|contact| [contact.a.to_string(), contact.b.to_string()].join(" and "))
    };
    assert_eq!(contact(&cell, &on_plate, None), None);
    let sunk = box_mesh([-100.0, -100.0, -60.0], [100.0, 100.0, 140.0]);
    assert_eq!(contact(&cell, &sunk, None).as_deref(), Some("turntable housing and part"));
    assert_eq!(contact(&cell, &on_plate, Some(&sunk)).as_deref(), Some("turntable housing and fixture"));
    let bolt = box_mesh([-20.0, -20.0, 0.0], [20.0, 20.0, 60.0]);
    assert_eq!(contact(&cell, &on_plate, Some(&bolt)), None, "a fixture holds the part, from within too");
    // Floor at the height of the plate: what overhangs it lies on the floor, and may; what hangs over its rim may not.
    let sunken_table = Cell { floor_mm: Some(-200.0), ..cell.clone() };
    let wide = box_mesh([-280.0, -30.0, 0.0], [280.0, 30.0, 50.0]);
    assert_eq!(contact(&sunken_table, &wide, None), None);
    let hanging = box_mesh([-280.0, -30.0, -3.0], [280.0, 30.0, 50.0]);
    assert_eq!(contact(&sunken_table, &hanging, None).as_deref(), Some("floor and part"));
}

#[test]
fn a_placement_is_tested_over_the_whole_turn_below_and_as_placed_beside() {
    let wall = |owner_from_body: Isometry3<f64>| Body {
        name: "wall".into(),
        owner_from_body,
        shape: Shape::Box { size_mm: [40.0, 40.0, 40.0] },
    };
    let cell = cell();
    let arm = box_mesh([200.0, -10.0, -50.0], [240.0, 10.0, 50.0]);
    let contact = |cell: &Cell| CollisionScene::new(cell, &arm, None, &Pose::identity(), 5.0).placement_contact();
    assert_eq!(contact(&cell), None);
    // Below the plate, a quarter turn away from where the part hangs down over the rim.
    let below = Cell { table_bodies: vec![wall(at(0.0, -220.0, -40.0))], ..cell.clone() };
    assert_eq!(contact(&below).map(|contact| contact.to_string()).as_deref(), Some("wall and part"));
    let around = |x, y| Cell { obstacles: vec![wall(at(400.0 + x, y, -200.0))], ..cell.clone() };
    assert_eq!(contact(&around(220.0, 0.0)).map(|contact| contact.to_string()).as_deref(), Some("wall and part"));
    assert_eq!(contact(&around(0.0, 220.0)), None, "the table need not turn there");
}

#[test]
fn what_the_flange_carries_may_reach_back_to_the_link_before_it() {
    let mut cell = cell();
    let bar = Shape::Box { size_mm: [20.0, 20.0, 160.0] };
    // Beside the wrist, whose housing is not round about the last axis.
    cell.mount.push(Body { name: "bar".into(), owner_from_body: at(0.0, 80.0, -60.0), shape: bar });
    let scene = CollisionScene::without_part(&cell, 1.0);
    let turned = |turn_deg: f64| {
        let mut configuration = cell.home_rad;
        configuration.joints_rad[5] = turn_deg.to_radians();
        scene.check(&configuration).map(|contact| contact.to_string())
    };
    let found: Vec<_> = (-17..18).map(|step| turned(10.0 * f64::from(step))).collect();
    assert!(found.iter().any(Option::is_none) && found.contains(&Some("wrist and bar".into())), "{found:?}");
}

/// The forearm ends 94 mm beside the middle of the wrist, with a radius of 48 mm; the flange is 155 mm from it.
#[test]
fn what_the_flange_carries_within_a_link_before_the_wrist_is_told_as_untested() {
    let untested = |radius_mm: f64| {
        let mut cell = cell();
        let ball = Shape::Capsule { radius_mm, length_mm: 0.01 };
        cell.mount.push(Body { name: "ball".into(), owner_from_body: at(0.0, 0.0, -155.0), shape: ball });
        let scene = CollisionScene::without_part(&cell, 5.0);
        let with_part = scene.with_part(&box_mesh([-20.0, -20.0, 0.0], [20.0, 20.0, 40.0]), None, &Pose::identity());
        assert_eq!(with_part.untested_load(), scene.untested_load());
        scene.untested_load().iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    assert_eq!(untested(50.0), ["forearm and ball"], "not of the wrist, which it overlaps too");
    assert_eq!(untested(42.0), [""; 0], "4 mm apart");
    assert!(CollisionScene::without_part(&cell(), 5.0).untested_load().is_empty());
}

/// A ball beside the axis of the upper arm at home, so far from it.
fn ball_beside_upper_arm(cell: &Cell, off_axis_mm: f64) -> Body {
    let upper_arm = cell.robot.link_frames(&cell.home_rad.joints_rad)[2];
    let place = upper_arm * Point3::new(off_axis_mm, -127.0, 190.0);
    Body {
        name: "ball".into(),
        owner_from_body: at(place.x, place.y, place.z),
        shape: Shape::Capsule { radius_mm: 5.0, length_mm: 0.01 },
    }
}

/// A surface along the axis of the upper arm's capsule, 20 mm thick.
fn bar() -> LinkBody {
    LinkBody {
        link: 2,
        body: Body {
            name: "bar".into(),
            owner_from_body: Isometry3::identity(),
            shape: Shape::Mesh(Arc::new(box_mesh([-10.0, -137.0, 0.0], [10.0, -117.0, 380.0]))),
        },
    }
}

#[test]
fn the_surface_of_a_link_decides_where_its_capsule_is_too_close() {
    let (capsules, mut cell) = (cell(), cell());
    cell.link_surfaces = vec![bar()];
    let mut swung = cell.home_rad;
    swung.joints_rad[0] += 0.01;
    let swung_back = swung.toward(&cell.home_rad, 2.0);
    let pair = Contact { a: "upper arm".into(), b: "ball".into() };
    // The bar's side is 10 mm from its axis, the ball is 5 mm wide.
    for (off_axis_mm, in_capsule, at_bar) in [(60.0, true, false), (22.0, true, false), (18.0, true, true), (90.0, false, false)]
    {
        let found = |cell: &Cell| {
            let cell = Cell { obstacles: vec![ball_beside_upper_arm(cell, off_axis_mm)], ..cell.clone() };
            let scene = CollisionScene::without_part(&cell, 5.0);
            let along = scene.check_segment(&swung_back, &swung).map(|contact| contact.to_string());
            (
                scene.check(&cell.home_rad).map(|contact| contact.to_string()),
                along,
                scene.nearest_on(&pair, &[cell.home_rad; 2], 100.0),
            )
        };
        let contact = |is_near: bool| is_near.then(|| "upper arm and ball".to_owned());
        assert_eq!(found(&capsules).0, contact(in_capsule), "{off_axis_mm}");
        let (here, along, separation) = found(&cell);
        assert_eq!((here, along), (contact(at_bar), contact(at_bar)), "{off_axis_mm}");
        let (_, separation) = separation.expect("near");
        assert!((separation.distance_mm - (off_axis_mm - 15.0)).abs() < 0.1, "{separation:?}");
    }
}

/// Check and distance are two queries in single precision: of bodies at the limit, one told them too close and the other as far
/// apart as they have to be.
#[test]
fn bodies_that_are_found_too_close_are_never_told_as_far_apart_as_they_have_to_be() {
    let cell = cell();
    let cell = Cell { obstacles: vec![ball_beside_upper_arm(&cell, 60.0)], ..cell };
    let scene = CollisionScene::without_part(&cell, 5.0);
    let bodies = Contact { a: "upper arm".into(), b: "ball".into() };
    let pair = scene.pairs.iter().find(|pair| scene.contact_of(pair) == bodies).expect("the two are tested");
    let swung = |turn_rad: f64| {
        let mut configuration = cell.home_rad;
        configuration.joints_rad[1] += turn_rad;
        configuration
    };
    let is_near = |turn_rad: f64| scene.is_near(pair, &scene.place(&swung(turn_rad)), &[0.0; 7]);
    let mut away = [-0.6, 0.6].into_iter().filter(|turn_rad| !is_near(*turn_rad));
    let (mut near, mut far) = (0.0, away.next().expect("the arm swings away from the ball"));
    for _ in 0..40 {
        let middle: f64 = 0.5 * (near + far);
        if is_near(middle) { near = middle } else { far = middle }
    }
    let mut looked_at = 0;
    for step in 0..400 {
        let turn_rad = near - f64::from(step) * 1e-7 * far.signum();
        if is_near(turn_rad) {
            let (_, separation) = scene.nearest_on(&bodies, &[swung(turn_rad); 2], 100.0).expect("near");
            assert!(separation.distance_mm < pair.clearance_mm, "{separation:?} at {turn_rad}");
            looked_at += 1;
        }
    }
    assert!(looked_at > 200, "{looked_at}");
}

#[test]
fn a_capsule_without_a_surface_decides_beside_one_of_its_link_that_has_some() {
    let mut cell = cell();
    let (from_mm, to_mm) = (Point3::new(100.0, -127.0, 150.0), Point3::new(100.0, -127.0, 230.0));
    cell.robot.links.push(LinkCapsule { link: 2, name: "cover".into(), from_mm, to_mm, radius_mm: 10.0 });
    cell.link_surfaces = vec![bar()];
    // The first lies within the upper arm's capsule, beside its surface.
    for (off_axis_mm, met) in [(60.0, None), (117.0, Some("cover and ball")), (125.0, None)] {
        let cell = Cell { obstacles: vec![ball_beside_upper_arm(&cell, off_axis_mm)], ..cell.clone() };
        let contact = CollisionScene::without_part(&cell, 5.0).check(&cell.home_rad).map(|contact| contact.to_string());
        assert_eq!(contact.as_deref(), met, "{off_axis_mm}");
    }
}

/// The column of the first link is round about its axis, a box in it is not: beside a ball, the box had to keep 1 mm alone.
#[test]
fn a_surface_that_is_not_round_about_the_first_axis_keeps_the_whole_clearance() {
    let cell = cell();
    let contact = |shape: &Shape, owner_from_body: Isometry3<f64>, off_axis_mm: f64, turn_rad: f64| {
        let place = cell.robot.link_frames(&cell.home_rad.joints_rad)[1] * Point3::new(off_axis_mm, 0.0, -100.0);
        let ball = Body {
            name: "ball".into(),
            owner_from_body: at(place.x, place.y, place.z),
            shape: Shape::Capsule { radius_mm: 5.0, length_mm: 0.01 },
        };
        let body = Body { name: "surface".into(), owner_from_body, shape: shape.clone() };
        let link_surfaces = vec![LinkBody { link: 1, body }];
        let with_ball = Cell { obstacles: vec![ball], link_surfaces, ..cell.clone() };
        let mut here = cell.home_rad;
        here.joints_rad[0] += turn_rad;
        CollisionScene::without_part(&with_ball, 5.0).check(&here).map(|contact| contact.to_string())
    };
    let (met, half_turn) = (Some("shoulder column and ball".to_owned()), std::f64::consts::PI);
    let edged = Shape::Mesh(Arc::new(box_mesh([-10.0, -10.0, -120.0], [40.0, 10.0, -80.0])));
    let found = [0.0, half_turn].map(|turn_rad| contact(&edged, Isometry3::identity(), 48.0, turn_rad));
    assert_eq!(found, [met.clone(), None]);
    // As far from the ball at every angle: it must not touch, no more.
    let round = Shape::Cylinder { radius_mm: 40.0, height_mm: 40.0 };
    let found = [48.0, 45.5].map(|off_axis_mm| contact(&round, at(0.0, 0.0, -100.0), off_axis_mm, 0.0));
    assert_eq!(found, [None, met.clone()]);
    // Beside the axis it is not round about that.
    assert_eq!(contact(&round, at(2.0, 0.0, -100.0), 50.0, 0.0), met);
}

/// Parry tells the x axis where it gives up after 100 steps, and that counted as apart.
#[test]
fn cores_count_as_near_where_the_search_gives_up() {
    // An axis along which the cores are found to be 10 mm apart, or 1 mm, or deep in each other.
    for (gap_mm, is_told) in [(10.0, true), (1.0, false), (-50.0, false)] {
        assert_eq!(is_apart(&GJKResult::NoIntersection(Vector::X), |_| gap_mm, 5.0), is_told, "{gap_mm}");
        assert!(is_apart(&GJKResult::NoIntersection(Vector::Y), |_| gap_mm, 5.0), "the search itself has found that");
    }
    for found in [GJKResult::Intersection, GJKResult::Proximity(Vector::X)] {
        assert!(!is_apart(&found, |_| 10.0, 5.0));
    }
    // What lies apart along the x axis is still told as apart.
    let block = cuboid([100.0; 3]);
    for x_mm in [130.0, -130.0] {
        let beside_mm = measured((&block, at(0.0, 0.0, 0.0)), (&block, at(x_mm, 0.0, 0.0)));
        assert!((beside_mm - 30.0).abs() < 0.05, "{beside_mm}");
    }
}

#[test]
fn what_the_plate_runs_out_by_is_kept_free_beside_the_clearance() {
    let part = box_mesh([-50.0, -50.0, 0.0], [50.0, 50.0, 100.0]);
    let met = |gap_mm: f64, runout_mm: f64| {
        let mut cell = cell();
        cell.turntable.runout = vec![RunoutHarmonic { order: 1, cos: [0.0; 5], sin: [0.0, 0.0, runout_mm, 0.0, 0.0] }];
        let beside_part = cell.base_from_table.isometry() * at(55.0 + gap_mm, 0.0, 60.0);
        let shape = Shape::Capsule { radius_mm: 5.0, length_mm: 0.01 };
        cell.obstacles = vec![Body { name: "ball".into(), owner_from_body: beside_part, shape }];
        let whole = CollisionScene::new(&cell, &part, None, &Pose::identity(), 5.0);
        let half = whole.with_half_clearance();
        [whole, half].map(|scene| scene.check(&cell.home_rad).is_some())
    };
    assert_eq!(met(5.5, 0.0), [false, false]);
    assert_eq!(met(5.5, 1.0), [true, false]);
    assert_eq!(met(3.2, 0.0), [true, false]);
    assert_eq!(met(3.2, 1.0), [true, true], "half of the clearance, and all of the runout");
}

#[test]
fn a_surface_beside_a_surface_is_told_by_both() {
    let (mut cell, wall) = (cell(), box_mesh([-5.0, -300.0, -300.0], [5.0, 300.0, 300.0]));
    cell.link_surfaces = vec![bar()];
    let upper_arm = cell.robot.link_frames(&cell.home_rad.joints_rad)[2];
    for (off_axis_mm, is_near) in [(40.0, false), (17.0, true), (0.0, true)] {
        let wall = Body {
            name: "wall".into(),
            owner_from_body: upper_arm * at(off_axis_mm, -127.0, -150.0),
            shape: Shape::Mesh(Arc::new(wall.clone())),
        };
        let walled = Cell { obstacles: vec![wall], ..cell.clone() };
        let scene = CollisionScene::without_part(&walled, 5.0);
        let near: Vec<String> = scene
            .pairs
            .iter()
            .filter(|pair| scene.is_near(pair, &scene.place(&walled.home_rad), &[0.0; 7]))
            .map(|pair| scene.contact_of(pair).to_string())
            .collect();
        assert_eq!(near.contains(&"upper arm and wall".to_owned()), is_near, "{off_axis_mm}: {near:?}");
    }
}

#[test]
fn bodies_of_one_mesh_share_its_tree() {
    let shared = Arc::new(box_mesh([-10.0; 3], [10.0; 3]));
    let body = |x: f64, mesh: &Arc<Mesh>| Body {
        name: "box".into(),
        owner_from_body: at(x, 0.0, -3000.0),
        shape: Shape::Mesh(Arc::clone(mesh)),
    };
    let other = Arc::new(box_mesh([-10.0; 3], [10.0; 3]));
    let cell = Cell { obstacles: vec![body(0.0, &shared), body(50.0, &shared), body(90.0, &other)], ..cell() };
    let scene = CollisionScene::without_part(&cell, 5.0);
    let trees: Vec<_> =
        scene.bodies.iter().filter_map(|body| if let Solid::Mesh(tree) = &body.solid { Some(tree) } else { None }).collect();
    assert_eq!(trees.len(), 3);
    assert!(Arc::ptr_eq(trees[0], trees[1]) && !Arc::ptr_eq(trees[0], trees[2]));
}

#[test]
fn a_cable_is_kept_clear_of_what_is_around() {
    let mut cell = cell();
    let free = CollisionScene::without_part(&cell, 5.0);
    // A loop of hose that stands out behind the elbow.
    let hose = Shape::Capsule { radius_mm: 15.0, length_mm: 120.0 };
    cell.cable =
        vec![LinkBody { link: 3, body: Body { name: "hose".into(), owner_from_body: at(0.0, 62.0, 90.0), shape: hose } }];
    let elbow = cell.robot.link_frames(&cell.home_rad.joints_rad)[3];
    let place = elbow * Point3::new(0.0, 92.0, 140.0);
    let shelf = Body {
        name: "shelf".into(),
        owner_from_body: at(place.x, place.y, place.z),
        shape: Shape::Capsule { radius_mm: 12.0, length_mm: 0.01 },
    };
    let scene = CollisionScene::without_part(&cell, 5.0);
    assert_eq!((free.check(&cell.home_rad), scene.check(&cell.home_rad)), (None, None));
    let shelved = Cell { obstacles: vec![shelf], ..cell.clone() };
    let contact = CollisionScene::without_part(&shelved, 5.0).check(&cell.home_rad).map(|contact| contact.to_string());
    assert_eq!(contact.as_deref(), Some("hose and shelf"));
    let bare = Cell { cable: Vec::new(), ..shelved };
    assert_eq!(CollisionScene::without_part(&bare, 5.0).check(&cell.home_rad), None);
}

/// The adapter is round about the last axis, on which the tip of the wrist lies.
#[test]
fn of_two_bodies_that_keep_their_distance_nothing_is_said() {
    let cell = cell();
    let (scene, axes) = (CollisionScene::without_part(&cell, 5.0), cell.axes());
    let farthest = scene.farthest(&cell, 200.0, || Ok::<(), std::convert::Infallible>(())).expect("not interrupted");
    let constant = Contact { a: "wrist tip".into(), b: "adapter".into() };
    let mut found_mm = Vec::new();
    for sample in 1..=40 {
        let configuration = super::spread_configuration(&axes, sample);
        let (_, kept) = scene.nearest_on(&constant, &[configuration; 2], 200.0).expect("near each other");
        assert!((kept.distance_mm - 11.0).abs() < 0.01, "{kept:?}");
        if let Some(nearest) = scene.nearest(&configuration, &farthest, 200.0) {
            assert_ne!(nearest.bodies, constant);
            found_mm.push(nearest.distance_mm);
        }
    }
    let most = found_mm.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let least = found_mm.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(found_mm.len() > 10 && most - least > 20.0, "{found_mm:?}");
}

#[test]
fn what_the_flange_carries_is_found_to_meet_the_same_with_and_without_a_configuration() {
    let (cell, part) = (cell(), box_mesh([-100.0, -100.0, 0.0], [100.0, 100.0, 200.0]));
    let scene = CollisionScene::new(&cell, &part, None, &Pose::identity(), 5.0);
    let (axes, mut met) = (cell.axes(), [0_u32; 2]);
    for sample in 1..5000 {
        let axis = |axis: usize| {
            let limits = &axes.0[axis];
            limits.min_rad + (limits.max_rad - limits.min_rad) * halton(sample, PRIMES[axis])
        };
        let configuration = Configuration::from_axes_rad(std::array::from_fn(axis));
        let base_from_plate = cell.base_from_plate(configuration.table_rad);
        let plate_from_flange = base_from_plate.inverse() * cell.robot.base_from_flange(&configuration.joints_rad);
        let carried = scene.check_carried(&plate_from_flange);
        let contact = scene.check_view(&configuration);
        let of_contact = contact.map(|contact| {
            let is_plate = [&contact.a, &contact.b].into_iter().any(|name| **name == *"turntable plate");
            if is_plate { MetOnTable::Plate } else { MetOnTable::Attached }
        });
        assert_eq!(carried, of_contact, "{configuration:?}");
        met[0] += u32::from(carried == Some(MetOnTable::Plate));
        met[1] += u32::from(carried == Some(MetOnTable::Attached));
    }
    assert!(met.iter().all(|count| *count > 10), "too little to tell: {met:?}");
}
