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
    let moved = scanner_errors(&ERROR).map(|error| error.point(&ahead));
    let wanted = [[0.0, -both_mm], [0.0, both_mm], [both_mm, 0.0], [-both_mm, 0.0], [0.0, 0.0], [0.0, 0.0]];
    for (moved, wanted) in moved.iter().zip(wanted) {
        assert!((moved.x - wanted[0]).abs() < 1e-9 && (moved.y - wanted[1]).abs() < 1e-9, "{moved}, wanted {wanted:?}");
    }
    assert_eq!([moved[4].z, moved[5].z], [482.0, 478.0]);
}

#[test]
fn the_stated_errors_of_the_part_turn_it_about_its_centre_and_add_up_on_each_side_once() {
    let centre_mm = Point3::new(40.0, -25.0, 90.0);
    let errors = part_errors(&ERROR, &centre_mm);
    let turns = errors.map(|error| error.isometry().rotation.scaled_axis() / ERROR.angle_deg.to_radians());
    let shifts = errors.map(|error| (error.point(&centre_mm) - centre_mm) / ERROR.translation_mm);
    // By the arc of the turn and by all of the shift.
    let both_mm = 480.0 * ERROR.angle_deg.to_radians() + ERROR.translation_mm;
    for side in (0..3).flat_map(|axis| [1.0, -1.0].map(|sign| Vector3::<f64>::ith(axis, sign))) {
        for directions in [&turns, &shifts] {
            let to_the_side = directions.iter().filter(|&direction| (direction - side).norm() < 1e-9).count();
            assert_eq!(to_the_side, 1, "{side} of {directions:?}");
        }
        let viewpoint = centre_mm + side * 480.0;
        let moved_mm = errors.map(|error| (error.point(&viewpoint) - viewpoint).norm());
        assert_eq!(moved_mm.iter().filter(|mm| (**mm - both_mm).abs() < 0.01).count(), 1, "{moved_mm:?} from {side}");
    }
}

#[test]
fn views_that_shall_tolerate_an_error_are_chosen_by_less_than_they_measure() {
    let mut params = PlanParams { candidates: CandidateParams::ellipsoid(), ..PlanParams::default() };
    (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(0.02), Some(20.0));
    params.visibility.engine = Engine::Rays;
    params.robust.pose_error = Some(PoseErrorParams { angle_deg: 3.0, translation_mm: 10.0 });
    let (mesh, scanner) = (trough(), nominal_scanner());
    let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
    let cancel = AtomicBool::new(false);
    let ctx = Context::new(&cancel, &Silent);
    let table = tabulate(&input, &params, &ctx).expect("a table");
    params.robust.select = true;
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
    // All of it is measured with the part off as well.
    let error = params.robust.pose_error.expect("stated");
    let usable = vec![true; evaluated.candidates.remaining.len()];
    for off in &part_errors(&error, &table.surface.centre_mm)[..2] {
        let poses: Vec<_> = evaluated.candidates.remaining.iter().map(|candidate| *off * candidate.part_from_scanner).collect();
        let cast = visibility::cast(&table.surface, &poses, &usable, &scanner, &occluders, &params, &ctx).expect("not cancelled");
        assert!(robust.iter().zip(&cast.rows).all(|(robust, off)| robust.within(off.measured()).count() == robust.count()));
    }
    let mut as_ever = params.clone();
    as_ever.robust.select = false;
    let scene = VisibilityInput { params: &as_ever, ..scene };
    assert!(rows(&scene, &evaluated, &ctx).expect("not cancelled").is_none());
}
