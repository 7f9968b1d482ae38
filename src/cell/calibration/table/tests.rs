use nalgebra::UnitQuaternion;

use super::super::data::Solve;
use super::super::refine::{Adjustment, Free};
use super::super::start::start_joint;
use super::super::tests::{Noise, disturb, exact, in_hand, levels, truth};
use super::*;

#[test]
fn harmonics_of_the_boards_place_are_those_that_were_planted() {
    let (truth, mut noise) = (truth(), Noise(3));
    let mut sightings = exact(&truth, 24, 40.0, true, &mut noise);
    // 0.05 mm along the axis once a turn, and 0.03 mm across it twice a turn: seen by moving the arm with the board.
    for each in &mut sightings {
        let angle = each.table_rad;
        let shift = Vector3::new(0.03 * (2.0 * angle).cos(), 0.0, 0.05 * angle.sin());
        each.base_from_flange =
            truth.base_from_table * nalgebra::Translation3::from(shift) * truth.base_from_table.inverse() * each.base_from_flange;
    }
    let found = runout(&truth, &sightings);
    assert_eq!(found.iter().map(|harmonic| harmonic.order).collect::<Vec<_>>(), [1, 2]);
    assert!((found[0].axial_mm - 0.05).abs() < 1e-9 && found[0].radial_mm < 1e-9, "{found:?}");
    assert!((found[1].radial_mm - 0.03).abs() < 1e-9 && found[1].axial_mm < 1e-9, "{found:?}");
    assert_eq!(runout(&truth, &sightings[..14]), [], "fewer than fifteen tell none");
    let refined = |count: usize| {
        let problem = Adjustment { sightings: &sightings[..count], free: Free::JOINT, prior: None };
        problem
            .refine(&start_joint(&sightings[..count], &truth.base_from_table).expect("a start"), &in_hand(levels()[0]))
            .expect("refines")
    };
    assert!(identify_runout(&refined(14), &sightings[..14], None).is_empty());
    let orders: Vec<u8> = identify_runout(&refined(24), &sightings, None).iter().map(|harmonic| harmonic.order).collect();
    // The second stands out once the first is gone.
    assert!(orders.contains(&1), "{orders:?}");
}

/// A harmonic was tested as if the deviations were known, where they are estimated from a few observations.
#[test]
fn a_runout_has_to_stand_out_the_more_the_less_is_known_of_the_deviations() {
    let (truth, mut noise) = (truth(), Noise(3));
    let clean = exact(&truth, 24, 40.0, true, &mut noise);
    let least_um = |sigma_freedom: Option<f64>| -> Option<u32> {
        let is_found = |um: &u32| {
            let mut sightings = clean.clone();
            for each in &mut sightings {
                let shift = Vector3::new(0.0, 0.0, f64::from(*um) * 1e-3 * each.table_rad.sin());
                each.base_from_flange = truth.base_from_table
                    * nalgebra::Translation3::from(shift)
                    * truth.base_from_table.inverse()
                    * each.base_from_flange;
            }
            let problem = Adjustment { sightings: &sightings, free: Free::JOINT, prior: None };
            let refined = problem.refine(&truth, &in_hand(levels()[1])).expect("refines");
            !identify_runout(&refined, &sightings, sigma_freedom).is_empty()
        };
        (1..60).map(|step| 20 * step).find(is_found)
    };
    let (known, estimated) = (least_um(None).expect("found"), least_um(Some(8.0)).expect("found"));
    // The bounds are 22.5, and 77.1 for six numbers and eight degrees of freedom: amplitudes go with their roots.
    assert!(f64::from(estimated) > 1.4 * f64::from(known), "{known} µm where deviations are known, else {estimated} µm");
}

#[test]
fn two_runouts_add_up_order_by_order() {
    let one = RunoutHarmonic { order: 1, cos: [0.0, 0.0, 0.1, 0.0, 0.0], sin: [0.0; 5] };
    let two = RunoutHarmonic { order: 2, ..one };
    let sum = merged(&[one], &[one, two]);
    assert_eq!((sum.len(), sum[0].cos[2], sum[1]), (2, 0.2, two));
}

#[test]
fn the_plates_face_is_a_plane_across_the_axis() {
    let tilted = UnitQuaternion::from_euler_angles(0.002, -0.001, 0.0);
    let on_face = |x: f64, y: f64| Point3::from(tilted * Vector3::new(x, y, 0.0) + Vector3::new(0.0, 0.0, 1.25));
    let points: Vec<_> = (0..10)
        .flat_map(|i| (0..10).map(move |j| (i, j)))
        .map(|(i, j)| on_face(f64::from(i) * 8.0, f64::from(j) * 8.0))
        .collect();
    let face = plate_face(&points).expect("a face");
    assert!((face.height_mm - 1.25).abs() < 1e-9 && face.rms_mm < 1e-9, "{face:?}");
    assert!((face.tilt_rad - 0.002_f64.hypot(0.001)).abs() < 1e-6);
    assert_eq!(plate_face(&points[..2]), None);
    let line: Vec<_> = (0..10).map(|i| Point3::new(f64::from(i), 0.0, 1.0)).collect();
    assert_eq!(plate_face(&line), None);
    let wall: Vec<_> = points.iter().map(|p| Point3::new(p.z, p.x, p.y)).collect();
    assert_eq!(plate_face(&wall), None, "what stands upright is no plate");
}

/// Putting the origin into the face leaves every prediction as it was, and the axis as well known.
#[test]
fn lifting_the_table_changes_nothing_that_was_observed() {
    let (truth, mut noise) = (truth(), Noise(6));
    let mut sightings = exact(&truth, 15, 40.0, true, &mut noise);
    disturb(&mut sightings, &levels()[1], &mut noise);
    let problem = Adjustment { sightings: &sightings, free: Free::JOINT, prior: None };
    let refined = problem
        .refine(&start_joint(&sightings, &truth.base_from_table).expect("a start"), &in_hand(levels()[1]))
        .expect("refines");
    let moved = lifted(&refined, 30.0);
    for each in &sightings {
        assert!((refined.estimate.residual(each) - moved.estimate.residual(each)).norm() < 1e-9);
    }
    // The same axis as its own adjustment about the lifted origin has it.
    let own = problem.refine(&moved.estimate, &in_hand(levels()[1])).expect("refines");
    let off = (moved.covariance - own.covariance).component_div(&own.covariance.map(|value| value.abs().max(1e-12))).amax();
    assert!((0..4).all(|i| (moved.covariance[(6 + i, 6 + i)] / own.covariance[(6 + i, 6 + i)] - 1.0).abs() < 1e-3), "{off}");
    let none = super::super::tests::task(sightings, Solve::HandEye, None);
    assert!(none.face.is_empty());
}

#[test]
fn a_runout_comes_back_from_how_a_calibration_writes_it() {
    let planted = RunoutHarmonic { order: 2, cos: [1e-4, 0.0, 0.06, 0.0, 0.05], sin: [0.0, -2e-4, 0.0, -0.06, 0.01] };
    let back = harmonics_of(&[RunoutSpec::from(&planted)]);
    let off = |of: fn(&RunoutHarmonic) -> &[f64; 5]| {
        of(&back[0]).iter().zip(of(&planted)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    assert!(back.len() == 1 && back[0].order == 2 && off(|each| &each.cos) < 1e-15 && off(|each| &each.sin) < 1e-15, "{back:?}");
}
