use nalgebra::Isometry3;

use super::{Together, corners, interlock};
use crate::cell::{Cell, CollisionScene, Configuration, Presets, SpecLibrary};
use crate::geometry::Pose;
use crate::program::{Move, Program, Step};
use crate::testing::box_mesh;

/// Half the distance between two walls.
const HALF_SLOT_MM: f64 = 220.0;

/// Two walls on the plate with the arm's hand between them: they have to turn with it.
fn scene() -> (Cell, CollisionScene) {
    let cell = Presets.cell("e05-transcan").expect("preset").build(&Presets).expect("builds");
    let wall = |y_mm: f64| box_mesh([-240.0, y_mm - 10.0, 0.0], [240.0, y_mm + 10.0, 450.0]);
    let [part, fixture] = [wall(-HALF_SLOT_MM), wall(HALF_SLOT_MM)];
    let scene = CollisionScene::new(&cell, &part, Some(&fixture), &Pose::claim(Isometry3::identity()), 5.0);
    (cell, scene)
}

/// Pairs of configurations about home within the limits, the same every time.
fn pairs(cell: &Cell) -> Vec<[Configuration; 2]> {
    let mut state = 1_u64;
    let mut uniform = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1_u64 << 31) as f64
    };
    let half_deg: [f64; 7] = [25.0, 20.0, 20.0, 30.0, 30.0, 30.0, 60.0];
    let mut draw = || cell.home_rad.along(&half_deg.map(|half| ((2.0 * uniform() - 1.0) * half).to_radians()), 1.0);
    let pairs = (0..3000).map(|_| [draw(), draw()]);
    pairs.filter(|pair| pair.iter().all(|end| cell.axes().allow(end))).collect()
}

/// Configurations with a free straight move.
fn free_pairs(cell: &Cell, scene: &CollisionScene) -> Vec<[Configuration; 2]> {
    pairs(cell).into_iter().filter(|[from, to]| scene.check_segment(from, to).is_none()).collect()
}

#[test]
fn every_corner_is_free_and_each_way_of_separating_occurs() {
    let (cell, scene) = scene();
    let (mut table_first, mut arm_first, mut halved, mut refused) = (0, 0, 0, 0);
    for [from, to] in free_pairs(&cell, &scene) {
        let Ok(points) = corners(&from, &to, &scene, super::HALVINGS) else {
            refused += 1;
            continue;
        };
        let way: Vec<_> = std::iter::once(from).chain(points.iter().copied()).collect();
        assert_eq!(way.last(), Some(&to));
        for pair in way.windows(2) {
            assert!(!(pair[0].turns_table(&pair[1]) && pair[0].moves_arm(&pair[1])), "one at a time");
            assert_eq!(scene.check_segment(&pair[0], &pair[1]), None);
        }
        match points.len() {
            2 if !points[0].turns_table(&to) => table_first += 1,
            2 => arm_first += 1,
            _ => halved += 1,
        }
    }
    assert!(table_first > 0 && arm_first > 0 && halved > 0, "{table_first} {arm_first} {halved} {refused}");
}

#[test]
fn what_cannot_be_separated_is_told_with_step_and_bodies() {
    let (cell, scene) = scene();
    let [home_rad, target_rad] =
        pairs(&cell).into_iter().find(|[from, to]| scene.check(from).is_none() && scene.check(to).is_some()).expect("a bad end");
    let step =
        Step::Move(Move { via_rad: Vec::new(), target_rad, speed_fraction: 1.0, duration_secs: 0.0, passed_within_rad: None });
    let program = Program {
        plan_sha256: String::new(),
        setup: 0,
        calibration: None,
        robot: String::new(),
        turntable: String::new(),
        home_rad,
        steps: vec![Step::Settle { secs: 0.0 }, step],
        cycle_secs: 0.0,
    };
    let Together { step, contact } = interlock(&program, &cell, &scene).expect_err("its end collides");
    assert!(step == 1 && ["part", "fixture"].iter().any(|body| contact.to_string().contains(body)), "{contact}");
}
