use nalgebra::{Point3, Vector3};

use super::{FaceCounts, byte, byte_meanings, face_row};
use crate::planning::ids::SampleId;
use crate::planning::plan::{Cause, Grade, Verdict};
use crate::planning::surface::Patch;
use crate::wire::csv::Csv;
use crate::wire::tally::Tally;

fn tally(verdicts: &[Verdict]) -> Tally {
    let mut tally = Tally::default();
    let corners_mm = [Point3::origin(); 3];
    let (first_sample, samples) = (SampleId(0), verdicts.len() as u32);
    let patch = Patch { corners_mm, face: 0, normal: Vector3::z(), area_mm2: 3.0, first_sample, samples };
    tally.add_patch(&patch, verdicts);
    tally
}

const A: Verdict = Verdict::Measured(Grade::A);
const SHADOW: Verdict = Verdict::Missed(Cause::ShadowRight);
const OUT: Verdict = Verdict::NotAsked;

#[test]
fn faces_are_counted_once_each() {
    let mut counts = FaceCounts::default();
    for verdicts in [&[A, A, A][..], &[A, OUT, A], &[A, SHADOW, SHADOW], &[SHADOW, SHADOW, OUT], &[OUT, OUT, OUT]] {
        counts.count(&tally(verdicts));
    }
    assert_eq!(counts, FaceCounts { total: 5, measured: 2, partly_measured: 1, missed: 1, not_asked: 1 });
}

#[test]
fn rows_say_share_grade_and_cause() {
    let mut csv = Csv::new(&["face"]);
    for (face, verdicts) in [&[A, A, SHADOW][..], &[OUT, OUT, OUT], &[SHADOW, OUT, OUT]].into_iter().enumerate() {
        face_row(&mut csv, face as u32, &tally(verdicts), None, "5a");
    }
    face_row(&mut csv, 3, &Tally::default(), None, "5a");
    assert_eq!(
        csv.finish(),
        "face\r\n0,3,0.666667,A,shadow_right,5a\r\n1,3,0.000000,,not_asked,\r\n2,3,0.000000,,shadow_right,\r\n3,0,,,,\r\n"
    );
}

#[test]
fn the_grade_of_a_face_is_that_of_most_of_its_measured_area_and_the_better_one_on_ties() {
    const B: Verdict = Verdict::Measured(Grade::B);
    let grade = |verdicts: &[Verdict]| {
        let mut csv = Csv::rows();
        face_row(&mut csv, 0, &tally(verdicts), None, "");
        csv.finish().split(',').nth(3).expect("a grade").to_owned()
    };
    assert_eq!((grade(&[A, B, B]), grade(&[A, B, SHADOW]), grade(&[SHADOW, SHADOW, B])), ("B".into(), "A".into(), "B".into()));
}

#[test]
fn every_byte_has_one_meaning() {
    let meanings = byte_meanings();
    assert_eq!(meanings.len(), 4 + Cause::ALL.len() + 1);
    assert!(meanings.windows(2).all(|pair| pair[0].byte < pair[1].byte));
    assert_eq!((byte(Verdict::Measured(Grade::D)), byte(Verdict::Missed(Cause::ExcludedResting)), byte(OUT)), (3, 16, 255));
    assert_eq!(meanings[5].meaning, "enclosed");
    // Files of earlier releases have these numbers.
    let byte_of = |cause: Cause| byte(Verdict::Missed(cause));
    let kept = [Cause::ShadowProjector, Cause::BelowGrade, Cause::AtRisk, Cause::Exposure].map(byte_of);
    assert_eq!(kept, [29, 30, 36, 37]);
}
