use std::collections::BTreeMap;

use proptest::prelude::*;

use super::*;
use crate::planning::params::{PartParams, RegionParams};
use crate::planning::surface::sample;
use crate::testing::box_mesh;

/// Samples of a surface of `samples`, with their quality.
fn graded(samples: u32) -> impl Strategy<Value = BTreeMap<SampleId, f32>> {
    proptest::collection::btree_map((0..samples).prop_map(SampleId), -1.0_f32..=1.0, 0..samples as usize)
}

proptest! {
    #[test]
    fn a_row_gives_back_what_it_was_made_of((total, graded) in (1_u32..400).prop_flat_map(|total| (Just(total), graded(total)))) {
        let row = Row::from_samples(total as usize, graded.clone());
        prop_assert_eq!(row.words().len(), total.div_ceil(64) as usize);
        prop_assert_eq!(row.count(), graded.len());
        prop_assert!(row.samples().eq(graded.keys().copied()), "ascending, each once");
        prop_assert!(SampleId::first(total as usize + 100).all(|sample| row.holds(sample) == graded.contains_key(&sample)));
        for ((sample, stored), (expected, quality)) in row.graded().zip(&graded) {
            prop_assert_eq!(sample, *expected);
            prop_assert!((stored - quality).abs() <= 1.53e-5, "{} stored as {}", quality, stored);
        }
    }

    #[test]
    fn sets_join_and_part_like_sets(a in graded(300), b in graded(300)) {
        let set = |samples: &BTreeMap<SampleId, f32>| Row::from_samples(300, samples.clone()).measured().clone();
        let (mut joined, mut parted) = (set(&a), set(&a));
        joined.insert_all(&set(&b));
        parted.remove_all(&set(&b));
        prop_assert!(SampleId::first(300).all(|s| joined.holds(s) == (a.contains_key(&s) || b.contains_key(&s))));
        prop_assert!(SampleId::first(300).all(|s| parted.holds(s) == (a.contains_key(&s) && !b.contains_key(&s))));
    }

    #[test]
    fn patches_sum_up_their_samples(seed in any::<u64>(), from in 0_usize..200, step in 1_usize..7) {
        let surface = box_of_patches();
        let count = surface.sample_mm.len();
        let quality = |sample: SampleId| (f64::from(sample.0) + seed as f64 / 1e18).sin() as f32;
        let row = Row::from_samples(count, surface.samples().skip(from).step_by(step).map(|s| (s, quality(s))));
        let (fraction, best) = (row.measured_fraction(&surface), row.best_quality(&surface));
        for (number, patch) in surface.patches.iter().enumerate() {
            let own = surface.samples().skip(patch.first_sample.index()).take(patch.samples as usize);
            let measured: Vec<SampleId> = own.filter(|sample| row.holds(*sample)).collect();
            prop_assert!((fraction[number] - measured.len() as f32 / patch.samples as f32).abs() < 1e-6);
            let expected = measured.into_iter().map(quality).reduce(f32::max);
            prop_assert_eq!(best[number].is_some(), expected.is_some());
            prop_assert!((best[number].unwrap_or(0.0) - expected.unwrap_or(0.0)).abs() < 2e-5);
        }
        let area_mm2: f64 = surface.patches.iter().zip(fraction).map(|(patch, share)| patch.area_mm2 * f64::from(share)).sum();
        prop_assert!((area_mm2 - surface.area_where(|sample| row.holds(sample))).abs() < 1e-2);
    }
}

fn box_of_patches() -> Surface {
    let part = PartParams { patch_edge_mm: Some(9.0), samples_per_mm2: Some(0.2), ..PartParams::default() };
    sample(&box_mesh([0.0; 3], [30.0, 20.0, 10.0]), &part, &RegionParams::default(), 0).unwrap_or_else(|e| panic!("{e:?}"))
}

#[test]
fn the_ends_and_the_middle_of_the_scale_are_exact() {
    for (c, d) in [(0.6, 0.4), (1.0, 1.0), (10.0, 10.0), (0.3, 0.0)] {
        let scale = QualityScale::of(&ScoreParams { c, d, ..ScoreParams::default() });
        let greatest = (c + d) as f32;
        for quality in [-greatest, 0.0, greatest] {
            assert_eq!(scale.quality(scale.quantise(quality)), quality, "{c}, {d}");
        }
        let between = 0.123_456 * greatest;
        assert!((scale.quality(scale.quantise(between)) - between).abs() <= 1.53e-5 * greatest);
    }
    let without_weight = QualityScale::of(&ScoreParams { c: 0.0, d: 0.0, ..ScoreParams::default() });
    assert_eq!(without_weight.quality(without_weight.quantise(0.0)), 0.0);
}

#[test]
fn a_quality_goes_to_the_nearest_step_and_halves_away_from_zero() {
    let scale = QualityScale::default();
    for number in (-40_000..=40_000).flat_map(|step| [-0.5_f32, -0.25, 0.0, 0.25, 0.5].map(|off| step as f32 + off)) {
        let quality = number / i16::MAX as f32;
        let steps = quality * i16::MAX as f32;
        let nearest = ((steps + 0.5_f32.copysign(steps)) as i32).clamp(-i32::from(i16::MAX), i32::from(i16::MAX));
        assert_eq!(i32::from(scale.quantise(quality)), nearest, "{number}");
    }
    assert_eq!([f32::INFINITY, f32::NEG_INFINITY, f32::NAN].map(|quality| scale.quantise(quality)), [i16::MAX, -i16::MAX, 0]);
}

#[test]
fn five_hundred_views_of_a_million_samples_fit() {
    const VIEWS: usize = 500;
    const GIB: usize = 1 << 30;
    let samples = 1_000_000;
    let every_sample = vec![u64::MAX; samples / 64];
    let bare = Row::new(every_sample);
    assert!(VIEWS * bare.size_bytes() <= 100_000_000, "{} bytes a row", bare.size_bytes());
    let graded = bare.with_quality(vec![0; samples], QualityScale::default());
    assert!(VIEWS * graded.size_bytes() <= GIB, "{} bytes a row", graded.size_bytes());
}

#[test]
#[should_panic(expected = "one step a measured sample")]
fn quality_of_other_samples_is_refused() {
    let _ = Row::new(vec![0b1011]).with_quality(vec![1, 2], QualityScale::default());
}
