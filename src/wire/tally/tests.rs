use nalgebra::{Point3, Vector3};

use super::Tally;
use crate::planning::ids::SampleId;
use crate::planning::plan::{Cause, Grade, Verdict};
use crate::planning::surface::Patch;

fn tally(verdicts: &[Verdict]) -> Tally {
    let patch = Patch {
        corners_mm: [Point3::origin(); 3],
        face: 0,
        normal: Vector3::z(),
        area_mm2: verdicts.len() as f64,
        first_sample: SampleId(0),
        samples: verdicts.len() as u32,
    };
    let mut tally = Tally::default();
    tally.add_patch(&patch, verdicts);
    tally
}

const A: Verdict = Verdict::Measured(Grade::A);
const C: Verdict = Verdict::Measured(Grade::C);
const DEPTH: Verdict = Verdict::Missed(Cause::Depth);
const SHADOW: Verdict = Verdict::Missed(Cause::ShadowLeft);

#[test]
fn areas_go_to_their_verdicts() {
    let tally = tally(&[A, C, C, DEPTH, Verdict::NotAsked]);
    assert_eq!((tally.area_mm2, tally.measured_mm2(), tally.missed_mm2(), tally.not_asked_mm2), (5.0, 3.0, 1.0, 1.0));
    assert_eq!((tally.grade(), tally.cause()), (Some(Grade::C), Some(Cause::Depth)));
}

#[test]
fn equals_go_to_the_better_grade_and_the_earlier_cause() {
    let tally = tally(&[C, A, SHADOW, DEPTH]);
    assert_eq!((tally.grade(), tally.cause()), (Some(Grade::A), Some(Cause::Depth)));
}

#[test]
fn majority_asks_first_whether_it_was_asked_then_whether_measured() {
    assert_eq!(tally(&[A, Verdict::NotAsked, Verdict::NotAsked]).majority(), Verdict::NotAsked);
    assert_eq!(tally(&[A, C, DEPTH, SHADOW, SHADOW]).majority(), SHADOW);
    assert_eq!(tally(&[A, C, DEPTH, SHADOW]).majority(), A);
    assert_eq!(tally(&[DEPTH, Verdict::NotAsked]).majority(), DEPTH);
    assert_eq!(Tally::default().majority(), Verdict::NotAsked);
}
