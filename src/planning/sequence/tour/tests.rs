use std::ops::Range;
use std::sync::atomic::AtomicBool;

use proptest::prelude::*;

use super::{Costs, Effort, NeighbourhoodSearch, bound, exact, lower_bound_secs, shortest};
use crate::geometry::SimdLevel;
use crate::planning::context::{Context, Silent};
use crate::planning::random::Stream;

/// Groups of the sizes given, and times from the numbers given.
fn instance(sizes: &[usize], secs: &[f64]) -> (Vec<Range<usize>>, Costs) {
    let mut first = 0;
    let groups = sizes
        .iter()
        .map(|size| {
            first += size;
            first - size..first
        })
        .collect();
    let mut numbers = secs.iter().cycle();
    let table: Vec<f64> = (0..(first + 1) * (first + 1)).map(|_| *numbers.next().expect("cycle")).collect();
    (groups, Costs::new(first, |a, b| table[a * (first + 1) + b]))
}

fn length(tour: &[usize], costs: &Costs) -> f64 {
    let steps: f64 = tour.windows(2).map(|step| costs.get(step[0], step[1])).sum();
    costs.home(tour[0]) + steps + costs.home(tour[tour.len() - 1])
}

/// Every order and every choice.
fn brute_force(groups: &[Range<usize>], costs: &Costs, tour: &mut Vec<usize>, used: &mut Vec<bool>) -> f64 {
    if tour.len() == groups.len() {
        return length(tour, costs);
    }
    let mut best = f64::INFINITY;
    for group in 0..groups.len() {
        if !used[group] {
            used[group] = true;
            for node in groups[group].clone() {
                tour.push(node);
                best = best.min(brute_force(groups, costs, tour, used));
                tour.pop();
            }
            used[group] = false;
        }
    }
    best
}

fn assert_visits_each_group_once(tour: &[usize], groups: &[Range<usize>]) {
    let mut visited: Vec<_> =
        tour.iter().map(|node| groups.iter().position(|group| group.contains(node)).expect("a node")).collect();
    visited.sort_unstable();
    assert_eq!(visited, (0..groups.len()).collect::<Vec<_>>());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn exact_tours_are_as_short_as_brute_force_finds(
        sizes in prop::collection::vec(1usize..4, 1..6),
        secs in prop::collection::vec(0.1..10.0f64, 400),
    ) {
        let (groups, costs) = instance(&sizes, &secs);
        let flag = AtomicBool::new(false);
        let tours = shortest(&groups, &costs, &[], Effort::Thorough, &Context::new(&flag, &Silent)).expect("not cancelled");
        let tour = &tours[0];
        assert_visits_each_group_once(tour, &groups);
        let best = brute_force(&groups, &costs, &mut Vec::new(), &mut vec![false; groups.len()]);
        prop_assert!((length(tour, &costs) - best).abs() < 1e-9);
    }

    #[test]
    fn no_tour_is_shorter_than_the_bound(
        sizes in prop::collection::vec(1usize..4, 2..6),
        secs in prop::collection::vec(0.1..10.0f64, 400),
        said in 1.0..3.0f64,
    ) {
        let (groups, costs) = instance(&sizes, &secs);
        let flag = AtomicBool::new(false);
        let best = brute_force(&groups, &costs, &mut Vec::new(), &mut vec![false; groups.len()]);
        // Whatever tour is known, the bound holds for the shortest.
        let bound = bound::lower_bound_secs(&groups, &costs, said * best, Effort::Thorough, &Context::new(&flag, &Silent)).expect("not cancelled");
        prop_assert!(bound <= best + 1e-9, "{bound} above {best}");
    }

    #[test]
    #[ignore = "long: tests/all runs it"]
    fn no_tour_is_shorter_than_a_bound_by_landmarks_and_targets(
        sizes in prop::collection::vec(1usize..4, 9..11),
        secs in prop::collection::vec(0.1..10.0f64, 1000),
        said in 1.0..2.0f64,
    ) {
        let (groups, costs) = instance(&sizes, &secs);
        let flag = AtomicBool::new(false);
        let ctx = Context::new(&flag, &Silent);
        let best = length(&exact(&groups, &costs, &ctx).expect("not cancelled"), &costs);
        let bound = bound::lower_bound_secs(&groups, &costs, said * best, Effort::Thorough, &ctx).expect("not cancelled");
        prop_assert!(bound <= best + 1e-9, "{bound} above {best}");
    }

    #[test]
    #[ignore = "long: tests/all runs it"]
    fn a_search_reports_the_length_it_has(
        sizes in prop::collection::vec(1usize..4, 13..16),
        secs in prop::collection::vec(0.1..10.0f64, 2300),
    ) {
        let (groups, costs) = instance(&sizes, &secs);
        let flag = AtomicBool::new(false);
        let ctx = Context::new(&flag, &Silent);
        let (found, tour) = NeighbourhoodSearch::new(&groups, &costs, Stream::new(1, &[])).run(&[], Effort::Thorough, &ctx).expect("not cancelled");
        assert_visits_each_group_once(&tour, &groups);
        prop_assert!((length(&tour, &costs) - found).abs() < 1e-9);
        // From its own result it comes to nothing longer.
        for effort in [Effort::Again, Effort::Brief] {
            let again = shortest(&groups, &costs, &tour, effort, &ctx).expect("not cancelled");
            again.iter().for_each(|again| assert_visits_each_group_once(again, &groups));
            prop_assert!(length(&again[0], &costs) <= found + 1e-9);
            prop_assert!(again.windows(2).all(|pair| length(&pair[0], &costs) <= length(&pair[1], &costs) + 1e-9));
        }
    }
}

/// Groups of nodes near each other in the plane.
fn in_the_plane(seed: u32, groups: usize, nodes: usize) -> (Vec<Range<usize>>, Costs) {
    let at = |i: usize, step: f64| (f64::from(seed) * 0.37 + (i as f64 + 1.0) * step).fract();
    let position = |node: usize| {
        let group = node / nodes;
        [at(group, 0.618_034) + 0.1 * at(node, 0.414_214), at(group, 0.732_051) + 0.1 * at(node, 0.236_068)]
    };
    let secs = |a: usize, b: usize| {
        let ([ax, ay], [bx, by]) = (position(a), position(b));
        (ax - bx).hypot(ay - by)
    };
    ((0..groups).map(|group| nodes * group..nodes * (group + 1)).collect(), Costs::new(nodes * groups, secs))
}

#[test]
fn the_local_search_comes_close_to_the_optimum_on_points_in_the_plane() {
    let (mut worst, mut exact_hits) = (1.0_f64, 0);
    for seed in 0..10_u32 {
        let (groups, costs) = in_the_plane(seed, 11, 3);
        let flag = AtomicBool::new(false);
        let ctx = Context::new(&flag, &Silent);
        let best = length(&exact(&groups, &costs, &ctx).expect("not cancelled"), &costs);
        let (found, _) = NeighbourhoodSearch::new(&groups, &costs, Stream::new(0, &[]))
            .run(&[], Effort::Thorough, &ctx)
            .expect("not cancelled");
        assert!(found >= best - 1e-9);
        worst = worst.max(found / best);
        exact_hits += u32::from(found < best + 1e-9);
    }
    assert!(worst < 1.02 && exact_hits >= 8, "worst {worst}, optimal in {exact_hits} of 10");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn long_tours_are_proved_shortest_or_nearly() {
    for seed in 0..3 {
        let (groups, costs) = in_the_plane(seed, 30, 4);
        let flag = AtomicBool::new(false);
        let ctx = Context::new(&flag, &Silent);
        let tour = &shortest(&groups, &costs, &[], Effort::Thorough, &ctx).expect("not cancelled")[0];
        let (secs, bound) =
            (length(tour, &costs), lower_bound_secs(&groups, &costs, tour, Effort::Thorough, &ctx).expect("not cancelled"));
        println!("30 groups of 4, seed {seed}: {secs:.4}, at least {bound:.4}, gap {:.2} %", 100.0 * (secs / bound - 1.0));
        assert!(bound <= secs && secs < 1.001 * bound, "{secs} and {bound}");
    }
}

#[test]
fn the_bound_is_the_same_on_any_threads_and_vector_instructions() {
    let (groups, costs) = in_the_plane(1, 14, 5);
    let flag = AtomicBool::new(false);
    let bound = |threads: usize, level: SimdLevel| {
        let ctx = Context::new(&flag, &Silent).with_simd_level(level);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        pool.install(|| bound::lower_bound_secs(&groups, &costs, 100.0, Effort::Thorough, &ctx)).expect("not cancelled").to_bits()
    };
    let one = bound(1, SimdLevel::PORTABLE);
    assert!(SimdLevel::available().into_iter().all(|level| bound(2, level) == one));
}

#[test]
fn the_bound_of_tours_that_can_be_solved_is_their_optimum_or_close_to_it() {
    let mut proved = 0;
    for seed in 0..6 {
        let (groups, costs) = in_the_plane(seed, 11, 3);
        let flag = AtomicBool::new(false);
        let ctx = Context::new(&flag, &Silent);
        let best = length(&exact(&groups, &costs, &ctx).expect("not cancelled"), &costs);
        let bound = bound::lower_bound_secs(&groups, &costs, 1.05 * best, Effort::Thorough, &ctx).expect("not cancelled");
        assert!(bound <= best && bound > 0.99 * best, "{bound} of {best}");
        proved += u32::from(bound > (1.0 - 1e-4) * best);
        let entered = bound::entered_secs(&groups, &costs);
        assert!(entered > 0.0 && entered <= best, "{entered} of {best}");
    }
    assert!(proved >= 3, "{proved} of 6");
}
