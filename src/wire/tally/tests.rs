use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};

use super::{Tally, of_groups_of};
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

/// Groups that begin and end within runs of patches, and one that is longer than several runs.
#[test]
fn groups_are_tallied_whole_and_in_order() {
    let verdicts = [A, C, DEPTH, SHADOW, Verdict::NotAsked];
    let group = |patch: u32| match patch {
        0..20_000 => 3 + patch / 7 * 2,
        20_000..33_000 => 9_000,
        // As for patches that a preview does not draw.
        33_000..=37_999 => u32::MAX,
        _ => 20_000 - patch / 3,
    };
    let patch = |number: u32| Patch {
        corners_mm: [Point3::origin(); 3],
        face: number,
        normal: Vector3::z(),
        area_mm2: f64::from(1 + number % 5),
        first_sample: SampleId(number % 4),
        samples: 2,
    };
    let patches: Vec<Patch> = (0..40_000).map(patch).collect();
    let mut expected: BTreeMap<u32, Tally> = BTreeMap::new();
    patches.iter().for_each(|patch| expected.entry(group(patch.face)).or_default().add_patch(patch, &verdicts));
    let runs = of_groups_of(&patches, &verdicts, |patch| group(patch.face), |run| (run.begin, run.groups));
    let mut next = 0;
    for (begin, groups) in &runs {
        assert_eq!(*begin, next, "a run begins after the one before it");
        next = groups.last().expect("a group").0.wrapping_add(1);
    }
    assert!(runs.len() > 4, "{}", runs.len());
    let found: Vec<(u32, Tally)> = runs.into_iter().flat_map(|(_, groups)| groups).collect();
    assert_eq!(found, expected.into_iter().collect::<Vec<_>>());
    let none = of_groups_of(&[], &verdicts, |patch| patch.face, |run| run.begin);
    assert!(none.is_empty(), "no patches, no groups: {none:?}");
}
