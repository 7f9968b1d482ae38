use std::sync::atomic::AtomicBool;

use super::super::order;
use super::super::routes::Routes;
use super::super::tests::{Room, post, room};
use super::*;
use crate::planning::context::Silent;
use crate::planning::params::PlanParams;
use crate::planning::stations::Station;

fn with_ctx<T>(threads: usize, run: impl FnOnce(&Context<'_>) -> T + Send) -> T
where
    T: Send,
{
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
    pool.install(|| run(&Context::new(&AtomicBool::new(false), &Silent)))
}

fn roadmap(cell: &Cell, threads: usize) -> Roadmap {
    let scene = CollisionScene::without_part(cell, MIN_CLEARANCE_MM);
    with_ctx(threads, |ctx| Roadmap::of(cell, &scene, ctx)).expect("not cancelled")
}

/// Posts on all sides of the table.
fn fenced(posts: u32, views: u32) -> Room {
    let all = (0..posts).map(|number| {
        let azimuth = 0.6 + std::f64::consts::TAU / f64::from(posts) * f64::from(number);
        post([400.0 + 470.0 * azimuth.cos(), 470.0 * azimuth.sin()])
    });
    room(views, all.collect())
}

#[test]
fn a_cell_has_one_roadmap_and_its_edges_are_free_at_any_table_angle() {
    let room = fenced(3, 0);
    let made = roadmap(&room.cell, 1);
    assert_eq!(made, roadmap(&room.cell, 2));
    assert!(
        made.vertices.len() > 50 && made.edges.len() > made.vertices.len(),
        "{} and {}",
        made.vertices.len(),
        made.edges.len()
    );
    let scene = CollisionScene::without_part(&room.cell, MIN_CLEARANCE_MM);
    for (number, [a, b]) in made.edges.iter().enumerate() {
        let (mut from, mut to) = (made.vertices[*a], made.vertices[*b]);
        (from.table_rad, to.table_rad) = (0.1 * number as f64, -0.2 * number as f64);
        let middle = from.toward(&to, 0.5);
        assert!([from, middle, to].iter().all(|vertex| scene.check(vertex).is_none()), "edge {number}");
    }
}

#[test]
fn a_fingerprint_tells_cells_apart_by_what_they_are_made_of() {
    let cell = fenced(3, 0).cell;
    let mut other = cell.clone();
    assert_eq!(fingerprint(&cell), fingerprint(&other));
    other.obstacles[1].owner_from_body.translation.x += 1e-9;
    assert_ne!(fingerprint(&cell), fingerprint(&other));
    // By the vertices of meshes too, and by which body has which.
    let with_meshes = |first_mm: f64, second_mm: f64| {
        let mut cell = cell.clone();
        for (body, edge_mm) in cell.obstacles.iter_mut().zip([first_mm, second_mm]) {
            body.shape = Shape::Mesh(Arc::new(crate::testing::box_mesh([0.0; 3], [edge_mm; 3])));
        }
        fingerprint(&cell)
    };
    assert_eq!(with_meshes(5.0, 7.0), with_meshes(5.0, 7.0));
    let all = [fingerprint(&cell), with_meshes(5.0, 7.0), with_meshes(7.0, 5.0), with_meshes(5.0, 7.0 + 1e-12)];
    assert!((0..all.len()).all(|number| !all[..number].contains(&all[number])), "{all:?}");
}

#[test]
fn the_scene_of_a_cell_is_kept_and_finds_what_a_new_one_finds() {
    let room = fenced(3, 12);
    let kept = Roadmaps::default();
    let bare = kept.bare_scene(&room.cell, 5.0);
    assert!(Arc::ptr_eq(&bare, &kept.bare_scene(&room.cell.clone(), 5.0)), "made once");
    assert!(!Arc::ptr_eq(&bare, &kept.bare_scene(&room.cell, 2.0)), "another clearance is another scene");
    let part = crate::testing::box_mesh([-40.0, -40.0, 0.0], [40.0, 40.0, 60.0]);
    let placed = crate::planning::resting(&part);
    let whole = CollisionScene::new(&room.cell, &part, None, &placed, 5.0);
    let put_on = bare.with_part(&part, None, &placed);
    let vertices = roadmap(&room.cell, 2).vertices;
    for vertex in &vertices {
        let mut low = *vertex;
        low.joints_rad[1] += 0.4;
        for at in [vertex, &low] {
            assert_eq!(put_on.check(at), whole.check(at));
        }
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn roadmaps_are_kept_and_change_no_sequence() {
    let (mut room, params) = (fenced(4, 10), PlanParams::default());
    let routes = Routes::new(&room.cell, &room.scene, &params.motion);
    // Stations that the roadmap alone leads to.
    let mut stations = room.stations.clone();
    with_ctx(2, |ctx| {
        let simple = |station: &Station| routes.home_route(&station.configuration(), ctx).expect("not cancelled").is_some();
        stations.iter_mut().for_each(|of_view| of_view.retain(|station| !simple(station)));
    });
    room.stations = stations;
    let roadmaps = Roadmaps::default();
    let ordered = |roadmaps: Option<&Roadmaps>| {
        with_ctx(2, |ctx| order(&room.listed(), &room.cell, &room.scene, &params, roadmaps, false, ctx).expect("not cancelled"))
    };
    let alone = ordered(None);
    assert!(!alone.sequence.visits.is_empty());
    let [first_secs, kept_secs] = [(); 2].map(|()| {
        let began = std::time::Instant::now();
        assert_eq!(ordered(Some(&roadmaps)), alone);
        began.elapsed().as_secs_f64()
    });
    println!("{} views: {first_secs:.3} s with the roadmap made, {kept_secs:.3} s with it kept", alone.sequence.visits.len());
    let kept = Arc::clone(&roadmaps.lock()[0].1);
    assert_eq!(ordered(Some(&roadmaps)), alone);
    assert!(Arc::ptr_eq(&kept, &roadmaps.lock()[0].1), "made once");
    for _ in 0..2 * MAX_KEPT {
        let mut cell = room.cell.clone();
        cell.floor_mm = Some(-400.0 - roadmaps.lock().len() as f64);
        roadmaps.lock().push_back((fingerprint(&cell), Arc::clone(&kept)));
    }
    // A cell that is not among them.
    let other = with_ctx(2, |ctx| roadmaps.of(&fenced(2, 0).cell, ctx)).expect("not cancelled");
    assert!(roadmaps.lock().len() == MAX_KEPT && Arc::ptr_eq(&roadmaps.lock()[0].1, &other), "the oldest are given up");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_roadmap_leads_to_stations_that_no_simple_way_leads_to() {
    let (room, params) = (fenced(4, 24), PlanParams::default());
    let routes = Routes::new(&room.cell, &room.scene, &params.motion);
    let stations: Vec<_> = room.stations.iter().flatten().map(Station::configuration).collect();
    let (simple, by_roadmap) = with_ctx(2, |ctx| {
        let simple = |station| routes.home_route(station, ctx).expect("not cancelled");
        let simple: Vec<_> = stations.iter().map(simple).collect();
        routes.build_roadmap(ctx).expect("not cancelled");
        let by_roadmap = |station| routes.home_route_by_roadmap(station, ctx).expect("not cancelled");
        (simple, stations.iter().map(by_roadmap).collect::<Vec<_>>())
    });
    let lost: Vec<_> = by_roadmap.iter().zip(&simple).filter(|(_, simple)| simple.is_none()).collect();
    let found = lost.iter().filter(|(by_roadmap, _)| by_roadmap.is_some()).count();
    println!("{} stations, {} without a simple way, {found} of them by the roadmap", stations.len(), lost.len());
    assert!(lost.len() > 20 && 10 * found > 9 * lost.len(), "{found} of {}", lost.len());
    for (station, route) in stations.iter().zip(by_roadmap) {
        let Some(route) = route else { continue };
        let way: Vec<_> = std::iter::once(room.cell.home_rad).chain(route.via_rad).chain([*station]).collect();
        assert!((room.cell.axes().path_secs(&way, params.motion.speed_fraction) - route.secs).abs() < 1e-9);
        assert!(way.windows(2).all(|ends| room.scene.check_segment(&ends[0], &ends[1]).is_none()));
    }
}
