use std::sync::atomic::AtomicBool;

use nalgebra::Point3;

use super::*;
use crate::planning::context::Silent;
use crate::planning::params::{CandidateParams, Engine};
use crate::planning::visibility::{SampleSet, VisibilityMatrix};
use crate::planning::{PlanInput, tabulate};
use crate::testing::{nominal_scanner, trough};

const ERROR: PoseErrorParams = PoseErrorParams { angle_deg: 1.0, translation_mm: 2.0 };

#[test]
fn the_stated_errors_move_the_field_by_turn_and_shift_together() {
    let ahead = Point3::new(0.0, 0.0, 480.0);
    let both_mm = 480.0 * 1.0_f64.to_radians().sin() + 2.0;
    let moved = stated_errors(&ERROR).map(|error| error.point(&ahead));
    let wanted = [[0.0, -both_mm], [0.0, both_mm], [both_mm, 0.0], [-both_mm, 0.0], [0.0, 0.0], [0.0, 0.0]];
    for (moved, wanted) in moved.iter().zip(wanted) {
        assert!((moved.x - wanted[0]).abs() < 1e-9 && (moved.y - wanted[1]).abs() < 1e-9, "{moved}, wanted {wanted:?}");
    }
    assert_eq!([moved[4].z, moved[5].z], [482.0, 478.0]);
}

#[test]
fn views_that_shall_tolerate_an_error_are_chosen_by_less_than_they_measure() {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.02), Some(20.0));
    params.visibility.engine = Engine::Rays;
    params.robust.pose_error = Some(PoseErrorParams { angle_deg: 3.0, translation_mm: 10.0 });
    params.robust.select = true;
    let (mesh, scanner) = (trough(), nominal_scanner());
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    let cancel = AtomicBool::new(false);
    let ctx = Context::new(&cancel, &Silent);
    let table = tabulate(&input, &params, &ctx).expect("a table");
    let occluders = Occluders::new([&mesh]);
    let scene = VisibilityInput { surface: &table.surface, scanner: &scanner, occluders: &occluders, params: &params };
    let visible = VisibilityMatrix { rows: table.rows, furthest_cause: Vec::new() };
    let hidden_by_cell = SampleSet::none_of(table.surface.sample_mm.len());
    let evaluated = EvaluatedCandidates { candidates: table.candidates, matrix: visible, reach: None, hidden_by_cell };
    let robust = rows(&scene, &evaluated, &ctx).expect("not cancelled").expect("asked for");
    let mut lost = 0;
    for (robust, nominal) in robust.iter().zip(&evaluated.matrix.rows) {
        let still: Vec<_> = nominal.graded().filter(|(sample, _)| robust.holds(*sample)).collect();
        assert_eq!(robust.graded().collect::<Vec<_>>(), still, "the quality of the view as planned");
        lost += nominal.count() - robust.count();
    }
    assert!(lost > 0, "no error takes anything");
    let mut as_ever = params.clone();
    as_ever.robust.select = false;
    let scene = VisibilityInput { params: &as_ever, ..scene };
    assert!(rows(&scene, &evaluated, &ctx).expect("not cancelled").is_none());
}
