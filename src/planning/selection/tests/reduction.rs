//! The problem of classes beside that of samples, and sums by blocks beside sums sample by sample.

use super::*;
use crate::planning::selection::classes::Classes;
use crate::planning::selection::local::{Exchange, KeptUnits, SwapPricer, Swaps};
use crate::planning::selection::overlap::Overlap;
use crate::planning::selection::units::Units;

/// Rows of runs of samples: neighbours are often measured by the same rows.
fn rows_of_runs() -> impl Strategy<Value = Vec<Vec<(u32, u32)>>> {
    let run = (0_u32..190, 1_u32..60);
    proptest::collection::vec(proptest::collection::vec(run, 1..4), 2..14)
}

fn built(runs: &[Vec<(u32, u32)>], samples: usize) -> Vec<Row> {
    let row = |runs: &Vec<(u32, u32)>| {
        let measures = |sample: &u32| runs.iter().any(|(first, length)| (*first..first + length).contains(sample));
        Row::from_samples(samples, (0..samples as u32).filter(measures).map(|sample| (SampleId(sample), 0.0)))
    };
    runs.iter().map(row).collect()
}

fn silent<T>(solve: impl FnOnce(&Context<'_>) -> Result<T, Cancelled>) -> T {
    solve(&Context::new(&AtomicBool::new(false), &Silent)).unwrap_or_else(|_| unreachable!())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(120))]

    #[test]
    fn classes_give_the_choices_and_the_optimum_of_their_samples(
        runs in rows_of_runs(),
        areas in proptest::collection::vec(0_u8..20, 200),
        target in proptest::sample::select(vec![0.7, 0.95, 1.0]),
    ) {
        let rows = built(&runs, 200);
        let area_mm2: Vec<f64> = areas.iter().map(|area| f64::from(*area)).collect();
        let params = |solver| SelectionParams { solver, target, min_growth: 0.0, ..coverage() };
        let problem = CoverProblem::new(rows.iter().collect(), &area_mm2, 1e9, &params(Solver::Greedy));
        let all: Vec<SampleId> = SampleId::first(200).collect();
        let numbers: Vec<RowIndex> = problem.all_rows().collect();
        let classes = Classes::new(&problem, &Units::of_goals(&problem), &all, &numbers);
        // Whole areas: their sums are exact in any order.
        let mut class_mm2 = vec![0.0; classes.len()];
        let of_class = |sample: SampleId| Some(classes.of_sample[sample.index()]).filter(|class| *class != Classes::NONE);
        all.iter().for_each(|sample| of_class(*sample).into_iter().for_each(|class| class_mm2[class as usize] += area_mm2[sample.index()]));
        let merged = |row: &Row| {
            let held: std::collections::BTreeSet<u32> = row.samples().filter_map(of_class).collect();
            Row::from_samples(classes.len(), held.into_iter().map(|class| (SampleId(class), 0.0)))
        };
        let merged: Vec<Row> = rows.iter().map(merged).collect();
        for class in 0..classes.len() as u32 {
            let members: Vec<SampleId> = all.iter().copied().filter(|sample| of_class(*sample) == Some(class)).collect();
            let same = rows.iter().zip(&merged).all(|(row, merged)| members.iter().all(|s| row.holds(*s) == merged.holds(SampleId(class))));
            prop_assert!(same, "class {} has samples of different columns", class);
        }
        for solver in [Solver::Greedy, Solver::Certified] {
            let of_classes = CoverProblem::new(merged.iter().collect(), &class_mm2, 1e9, &params(solver));
            let [by_class, by_sample] = [&of_classes, &problem].map(|problem| solved(problem, &params(solver), &ScoreParams::default()));
            prop_assert_eq!(by_class.choices.len(), by_sample.choices.len(), "{:?}", solver);
            if solver == Solver::Greedy {
                prop_assert_eq!(by_class.choices, by_sample.choices);
            }
        }
        for (place, row) in classes.rows.iter().enumerate() {
            let held: Vec<u32> = merged[row.index()].samples().map(|class| class.0).collect();
            prop_assert_eq!(&classes.of_row[place], &held);
        }
    }

    #[test]
    fn the_deficit_of_every_exchange_is_that_of_the_views_after_it(
        runs in rows_of_runs(),
        areas in proptest::collection::vec(0_u8..20, 200),
        region in any::<[bool; 20]>(),
        views in 1_usize..5,
    ) {
        let rows = built(&runs, 200);
        let area_mm2: Vec<f64> = areas.iter().map(|area| f64::from(*area) * 0.73).collect();
        let mut problem = CoverProblem::new(rows.iter().collect(), &area_mm2, 1e9, &coverage());
        let inside: Vec<f64> = area_mm2.iter().enumerate().map(|(at, mm2)| if region[at / 10] { *mm2 } else { 0.0 }).collect();
        problem.goals.push(Goal { needed_mm2: 0.8 * inside.iter().sum::<f64>(), area_mm2: Cow::Owned(inside) });
        let (goals, params) = (Units::of_goals(&problem), coverage());
        let overlap = Overlap::new(&problem, &params.overlap);
        let exchange = Exchange { problem: &problem, goals: &goals, overlap: &overlap };
        let chosen: Vec<RowIndex> = RowIndex::first(views.min(rows.len())).collect();
        let swaps = silent(|ctx| Swaps::new(&exchange, &chosen, ctx));
        let mut count = 0;
        for (view, row, deficit) in swaps.all() {
            let mut exchanged = chosen.clone();
            exchanged[view.index()] = row;
            let measured = problem.measured(&exchanged);
            let after: i64 = goals.iter().map(|goal| (goal.needed - goal.covered_by(&measured)).max(0)).sum();
            prop_assert_eq!(deficit, after, "{:?} for {:?}", view, row);
            count += 1;
        }
        prop_assert_eq!(count, chosen.len() * (rows.len() - chosen.len()));
    }

    #[test]
    fn deficits_that_are_kept_up_are_those_computed_anew(
        runs in rows_of_runs(),
        areas in proptest::collection::vec(0_u8..20, 200),
        views in 1_usize..5,
        exchanges in proptest::collection::vec((any::<u8>(), any::<u8>()), 1..6),
    ) {
        let rows = built(&runs, 200);
        let area_mm2: Vec<f64> = areas.iter().map(|area| f64::from(*area) * 0.73).collect();
        let problem = CoverProblem::new(rows.iter().collect(), &area_mm2, 1e9, &coverage());
        let (goals, params) = (Units::of_goals(&problem), coverage());
        let overlap = Overlap::new(&problem, &params.overlap);
        let exchange = Exchange { problem: &problem, goals: &goals, overlap: &overlap };
        let mut chosen: Vec<RowIndex> = RowIndex::first(views.min(rows.len())).collect();
        let mut kept = silent(|ctx| KeptUnits::new(SwapPricer::new(&exchange, &chosen), &problem, ctx));
        for (at, row) in exchanges {
            let row = RowIndex::at(usize::from(row) % rows.len());
            if chosen.contains(&row) {
                continue;
            }
            let at = usize::from(at) % chosen.len();
            chosen[at] = row;
            kept = silent(|ctx| kept.exchanged(SwapPricer::new(&exchange, &chosen), &problem, ctx));
            let anew = silent(|ctx| Swaps::new(&exchange, &chosen, ctx));
            prop_assert!(kept.swaps(&chosen).all().eq(anew.all()));
        }
    }
}

/// More rows than are priced: a ring of which each row measures an arc, so that the fewest views are known.
#[test]
#[ignore = "long: tests/all runs it"]
fn the_bound_of_priced_rows_is_that_of_all() {
    const SAMPLES: u32 = 4_000;
    for (candidates, arc) in [(400_u32, 390_u32), (300, 1_010), (150, 700)] {
        let row = |row: u32| {
            let first = row * SAMPLES / candidates;
            let mut samples: Vec<u32> = (first..first + arc).map(|sample| sample % SAMPLES).collect();
            samples.sort_unstable();
            Row::from_samples(SAMPLES as usize, samples.into_iter().map(|sample| (SampleId(sample), 0.0)))
        };
        let rows: Vec<Row> = (0..candidates).map(row).collect();
        let area_mm2 = vec![0.5; SAMPLES as usize];
        let params = SelectionParams { solver: Solver::Local, ..coverage() };
        let problem = CoverProblem::new(rows.iter().collect(), &area_mm2, 1e9, &params);
        let selection = solved(&problem, &params, &ScoreParams::default());
        assert_eq!(selection.bound.views_lower, SAMPLES.div_ceil(arc), "{candidates} arcs of {arc}");
        assert!(selection.bound.gap <= 1, "{selection:?}");
    }
}
