use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use super::*;
use crate::cell::{Presets, SpecLibrary};
use crate::geometry::demo_parts;
use crate::planning::context::{Context, Observer, Stage};
use crate::planning::params::{CandidateParams, PlanParams, Strategy};
use crate::planning::studies::Study;
use crate::planning::{PlanInput, plan};

/// Drives [`Overall`] with a clock of one second a call, and keeps every share.
struct Recorder(Mutex<(Overall, Vec<f64>, Vec<Stage>)>);

impl Recorder {
    fn new(course: &Course) -> Self {
        Self(Mutex::new((Overall::new(course), vec![0.0], Vec::new())))
    }

    fn step(&self, tell: impl FnOnce(&mut Overall, f64)) {
        let mut guard = self.0.lock().expect("no panic");
        let (overall, shares, _) = &mut *guard;
        let secs = shares.len() as f64;
        tell(overall, secs);
        let share = overall.fraction(secs + 0.5);
        shares.push(share);
    }

    /// Every share, after the check that none is below the one before.
    fn shares(self) -> (Vec<f64>, Vec<Stage>) {
        let (_, shares, stages) = self.0.into_inner().expect("no panic");
        assert!(shares.windows(2).all(|two| two[0] <= two[1]), "{shares:?}");
        assert!(shares.iter().all(|share| (0.0..=1.0).contains(share)), "{shares:?}");
        (shares, stages)
    }
}

impl Observer for Recorder {
    fn begin(&self, stage: Stage) {
        self.0.lock().expect("no panic").2.push(stage);
        self.step(|overall, secs| overall.begin(stage, secs));
    }

    fn progress(&self, done: usize, total: usize) {
        self.step(|overall, _| overall.progress(done, total));
    }
}

fn quick() -> PlanParams {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    params.candidates.strategies = vec![Strategy::Ellipsoid, Strategy::Iterative, Strategy::Targeted];
    (params.candidates.iterative_rounds, params.candidates.targeted_max) = (2, 5);
    (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.02), Some(20.0));
    (params.missed.remedies, params.robust.pose_error) = (1, None);
    params.selection.max_views = Some(3);
    params
}

#[test]
#[ignore = "long: tests/all runs it"]
fn the_share_of_a_real_plan_with_rounds_never_decreases() {
    let mesh = demo_parts::base(8000).expect("a demo part");
    let scanner = Presets.scanner("transcan-c-nominal").expect("a preset").build().expect("valid");
    let (params, cancel) = (quick(), AtomicBool::new(false));
    let recorder = Recorder::new(&Course::of_plan(&params, false));
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    plan(&input, &params, &Context::new(&cancel, &recorder)).expect("a plan");
    recorder.begin(Stage::Report);
    let (shares, stages) = recorder.shares();
    assert_eq!(stages.iter().filter(|stage| **stage == Stage::Visibility).count(), 4, "the rounds: {stages:?}");
    let expected: Vec<Stage> = Course::of_plan(&params, false).legs.iter().map(|(stage, _)| *stage).collect();
    assert_eq!(stages, expected, "the course is the one that a plan takes");
    assert!(shares.last().is_some_and(|last| (0.9..1.0).contains(last)), "{shares:?}");
}

#[test]
fn setups_reselections_and_passes_within_a_stage_never_bring_it_back() {
    use Stage as S;
    let params = PlanParams { setups: 2, ..PlanParams::default() };
    let recorder = Recorder::new(&Course::of_plan(&params, true));
    let round = [S::Candidates, S::Stations, S::Visibility];
    // More rounds than expected, then views without a path chosen anew.
    let stages =
        [&[S::Surface][..], &round.repeat(6), &[S::Selection, S::Sequence].repeat(5), &[S::Missed, S::Certificate, S::Report]];
    for stage in stages.concat() {
        recorder.begin(stage);
        for (done, total) in [(1, 4), (3, 4), (2, 4), (4, 4), (1, 4), (4, 4), (10, 100), (100, 100), (0, 0), (7, 5)] {
            recorder.progress(done, total);
        }
    }
    let (shares, _) = recorder.shares();
    assert!(shares.last().is_some_and(|last| *last > 0.95), "{shares:?}");
    // A plan with fewer setups and no rounds arrives too.
    let recorder = Recorder::new(&Course::of_plan(&params, true));
    [S::Surface, S::Candidates, S::Stations, S::Visibility, S::Selection, S::Report]
        .into_iter()
        .for_each(|stage| recorder.begin(stage));
    assert!(recorder.shares().0.last().is_some_and(|last| *last > 0.9));
}

#[test]
fn studies_have_a_course_and_a_command_without_stages_has_one_pass() {
    for study in Study::ALL {
        let course = Course::of_study(study, &PlanParams::default());
        let recorder = Recorder::new(&course);
        course.legs.iter().for_each(|(stage, _)| recorder.begin(*stage));
        assert!(recorder.shares().0.last().is_some_and(|last| *last > 0.9), "{study:?}");
    }
    let recorder = Recorder::new(&Course::default());
    (0..=25).for_each(|done| recorder.progress(done, 25));
    assert!(recorder.shares().0.last().is_some_and(|last| (0.89..=1.0).contains(last)));
}

#[test]
fn a_long_stage_without_progress_of_its_own_moves_on() {
    let mut overall = Overall::new(&Course::of_plan(&PlanParams::default(), true));
    [Stage::Surface, Stage::Candidates, Stage::Stations, Stage::Visibility]
        .into_iter()
        .zip([0.0, 0.1, 0.2, 0.3])
        .for_each(|(stage, secs)| overall.begin(stage, secs));
    overall.progress(10, 10);
    overall.begin(Stage::Selection, 3.0);
    let (early, late) = (overall.fraction(3.5), overall.fraction(11.5));
    assert!(early < late && late < 0.95, "{early} {late}");
    assert_eq!(secs_left(30.0, 0.75), Some(10.0));
}
