//! Every solver beside exhaustive search on small random tables: bound ≤ optimum ≤ choice, both formulations, one goal and
//! several.

use super::*;
use crate::planning::params::{OverlapParams, SelectionGoal};

const SAMPLES: usize = 24;
const ROWS: usize = 10;
const SOLVERS: [Solver; 4] = [Solver::Greedy, Solver::Lazy, Solver::Local, Solver::Certified];

/// A table of up to [`ROWS`] rows over [`SAMPLES`] samples, their areas, and for up to two regions members and shares.
#[derive(Clone, Debug)]
struct Case {
    rows: Vec<(u32, i8)>,
    areas: Vec<u8>,
    target: f64,
    regions: Vec<(u32, f64)>,
}

fn case() -> impl Strategy<Value = Case> {
    let sparse = (any::<u32>(), any::<u32>(), -4_i8..=4).prop_map(|(a, b, quality)| (a & b, quality));
    let region = (any::<u32>(), proptest::sample::select(vec![0.5, 0.8, 1.0]));
    (
        proptest::collection::vec(sparse, 1..=ROWS),
        proptest::collection::vec(0_u8..20, SAMPLES),
        proptest::sample::select(vec![0.5, 0.8, 0.95, 1.0]),
        proptest::collection::vec(region, 0..3),
    )
        .prop_map(|(rows, areas, target, regions)| Case { rows, areas, target, regions })
}

fn bits(mask: u32) -> impl Iterator<Item = u32> {
    (0..SAMPLES as u32).filter(move |bit| mask >> bit & 1 == 1)
}

/// A case as the solvers see it.
struct Table {
    rows: Vec<Row>,
    area_mm2: Vec<f64>,
    regions: Vec<(Vec<f64>, f64)>,
}

impl Table {
    fn new(case: &Case) -> Self {
        let row = |(mask, quality): &(u32, i8)| {
            Row::from_samples(SAMPLES, bits(*mask).map(|sample| (SampleId(sample), f32::from(*quality) / 4.0)))
        };
        let area_mm2: Vec<f64> = case.areas.iter().map(|area| f64::from(*area) * 0.37).collect();
        let region = |(mask, share): &(u32, f64)| {
            let inside: Vec<f64> = (0..SAMPLES).map(|s| if mask >> s & 1 == 1 { area_mm2[s] } else { 0.0 }).collect();
            (inside, *share)
        };
        let regions = case.regions.iter().map(region).collect();
        Self { rows: case.rows.iter().map(row).collect(), area_mm2, regions }
    }

    fn problem(&self, params: &SelectionParams) -> CoverProblem<'_> {
        let rows: Vec<&Row> = self.rows.iter().collect();
        let total_mm2 = self.area_mm2.iter().sum();
        let region = |(inside, share): &'_ (Vec<f64>, f64)| Goal {
            needed_mm2: share * coverable_mm2(&rows, inside),
            area_mm2: Cow::Owned(inside.clone()),
        };
        let regions: Vec<Goal<'_>> = self.regions.iter().map(region).collect();
        let mut problem = CoverProblem::new(rows, &self.area_mm2, total_mm2, params);
        problem.goals.extend(regions);
        problem
    }

    /// Area of a goal that a set of rows, a bit each, measures.
    fn measured_mm2(&self, goal: &Goal<'_>, set: u32) -> f64 {
        let chosen = self.rows.iter().enumerate().filter(|(row, _)| set >> row & 1 == 1);
        let covered = chosen.fold(0, |covered, (_, row)| covered | row.words()[0]);
        bits(covered as u32).map(|sample| goal.area_mm2[sample as usize]).sum()
    }

    fn set_of(&self, selection: &Selection) -> u32 {
        selection.choices.iter().fold(0, |set, choice| set | 1 << choice.row.0)
    }

    fn fewest(&self, goals: &[Goal<'_>]) -> Option<u32> {
        let meets = |set: &u32| goals.iter().all(|goal| self.measured_mm2(goal, *set) >= goal.needed_mm2 - 1e-9);
        (0..1_u32 << self.rows.len()).filter(meets).map(u32::count_ones).min()
    }
}

fn params(case: &Case, solver: Solver) -> SelectionParams {
    SelectionParams { solver, target: case.target, min_growth: 0.0, objective: Objective::Coverage, ..SelectionParams::default() }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(250))]

    #[test]
    fn no_bound_is_above_the_optimum_and_no_choice_below(case in case()) {
        let table = Table::new(&case);
        for solver in SOLVERS {
            let params = params(&case, solver);
            let problem = table.problem(&params);
            let selection = solved(&problem, &params, &ScoreParams::default());
            let set = table.set_of(&selection);
            let views = selection.choices.len() as u32;
            prop_assert_eq!(set.count_ones(), views, "a view twice");
            prop_assert_eq!(selection.bound.views_lower + selection.bound.gap, views);
            // What the bound is for: the goals, or what of them was reached.
            let mut goals = problem.goals.clone();
            for goal in &mut goals {
                goal.needed_mm2 = goal.needed_mm2.min(table.measured_mm2(goal, set));
            }
            let optimum = table.fewest(&goals).expect("the choice itself");
            prop_assert!(selection.bound.views_lower <= optimum, "{solver:?}: {:?}, optimum {optimum}", selection.bound);
            prop_assert!(optimum <= views);
            if selection.stopped_because == StopReason::Target {
                let all = table.fewest(&problem.goals).expect("the choice itself");
                prop_assert!(all <= views);
            }
            if solver == Solver::Certified {
                prop_assert_eq!(selection.bound.gap, 0, "small enough to be proved");
                prop_assert_eq!(optimum.max(u32::from(views > 0 && optimum == 0)), views);
            }
        }
    }

    #[test]
    fn best_coverage_lies_between_choice_and_bound(case in case(), views in 1_u32..5) {
        let table = Table::new(&case);
        for solver in SOLVERS {
            let params = SelectionParams { goal: SelectionGoal::BestCoverage, max_views: Some(views), ..params(&case, solver) };
            let problem = table.problem(&params);
            let asked_mm2 = problem.asked_mm2();
            let selection = solved(&problem, &params, &ScoreParams::default());
            let target = &problem.goals[0];
            let measured_mm2 = table.measured_mm2(target, table.set_of(&selection));
            let sets = (0..1_u32 << table.rows.len()).filter(|set| set.count_ones() <= views);
            let best_mm2 = sets.map(|set| table.measured_mm2(target, set)).fold(0.0, f64::max);
            let upper_mm2 = selection.bound.of_asked_upper.expect("given for the best coverage") * asked_mm2;
            prop_assert!(selection.choices.len() <= views as usize);
            prop_assert!(measured_mm2 <= best_mm2 + 1e-9);
            prop_assert!(best_mm2 <= upper_mm2 + 1e-9, "{solver:?}: {best_mm2} mm², bound {upper_mm2} mm²");
            if solver == Solver::Certified {
                prop_assert!((best_mm2 - measured_mm2).abs() < 1e-6 * asked_mm2.max(1.0), "{best_mm2} mm², chosen {measured_mm2}");
                prop_assert_eq!(selection.bound.gap_of_asked, Some(0.0));
            }
        }
    }

    #[test]
    fn every_solver_chooses_the_same_on_one_thread_and_on_two(case in case(), overlap in proptest::sample::select(vec![None, Some(1.0)])) {
        let table = Table::new(&case);
        let on = |threads: usize, params: &SelectionParams| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| solved(&table.problem(params), params, &ScoreParams::default()))
        };
        for solver in SOLVERS {
            let overlap = OverlapParams { min_area_mm2: overlap, min_share: None };
            let params = SelectionParams { overlap, objective: Objective::Score, ..params(&case, solver) };
            prop_assert_eq!(on(1, &params), on(2, &params));
        }
    }

    #[test]
    fn views_that_shall_overlap_form_one_graph(case in case(), area_mm2 in 0.5_f64..8.0) {
        let table = Table::new(&case);
        for solver in SOLVERS {
            let overlap = OverlapParams { min_area_mm2: Some(area_mm2), min_share: None };
            let params = SelectionParams { overlap, ..params(&case, solver) };
            let selection = solved(&table.problem(&params), &params, &ScoreParams::default());
            let shared = |a: usize, b: usize| -> f64 {
                let both = SampleId::first(SAMPLES).filter(|s| table.rows[a].holds(*s) && table.rows[b].holds(*s));
                both.map(|s| table.area_mm2[s.index()]).sum()
            };
            let mut rest = rows_of(&selection);
            let mut reached: Vec<usize> = rest.pop().into_iter().collect();
            while let Some(next) = rest.iter().position(|row| reached.iter().any(|other| shared(*row, *other) >= area_mm2 - 1e-9)) {
                reached.push(rest.swap_remove(next));
            }
            prop_assert!(rest.is_empty(), "{solver:?}: {rest:?} stand apart");
        }
    }
}
