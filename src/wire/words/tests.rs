use super::{changed_params, fixed};
use crate::planning::params::{PlanParams, Region};

#[test]
fn zero_has_no_sign() {
    assert_eq!(
        (fixed(-0.04, 1), fixed(-0.06, 1), fixed(0.0, 0), fixed(-0.4, 0)),
        ("0.0".into(), "-0.1".into(), "0".into(), "0".into())
    );
}

#[test]
fn only_changed_parameters_are_named() {
    assert_eq!(changed_params(&PlanParams::default()), Vec::<(String, String)>::new());
    let mut params = PlanParams::default();
    params.selection.max_views = Some(7);
    params.part.patch_edge_mm = Some(2.906_123_802_5);
    params.candidates.rolls_deg = vec![0.0, 45.0];
    let changed = [("candidates.rolls_deg", "[0.0,45.0]"), ("part.patch_edge_mm", "2.90612"), ("selection.max_views", "7")];
    assert_eq!(changed_params(&params), changed.map(|(key, value)| (key.to_owned(), value.to_owned())));
}

#[test]
fn long_values_are_cut() {
    let mut params = PlanParams::default();
    params.regions.exclude = vec![Region::Faces { faces: (0..10_000).collect() }];
    let changed = changed_params(&params);
    assert_eq!(changed.len(), 1);
    assert!(changed[0].1.chars().count() == 161 && changed[0].1.ends_with('…'));
}
