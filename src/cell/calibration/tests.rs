//! Observations made up from a known cell with known noise, and what is found in them. Levels and expected figures are those measured
//! for the method: standard deviations for each axis, errors as norms.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::check::{Check, CheckLimits, CheckVerdict};
use super::data::{ChainEstimate, HandEyeSetup, Sighting, Sigma, SigmaSource, Solve, Weighting};
use super::findings::{CalibrationFinding, FindingCode, Severity, Subject};
use super::leave_one_out::leave_one_out;
use super::observability::UncertaintyLimits;
use super::refine::{Adjustment, Free};
use super::screening::{Screened, Screening};
use super::se3::{self, Twist, exp, rotation_of, translation_of, twist};
use super::solve::{Role, Task};
use super::start::{daniilidis, park_martin, start_fixed, start_joint, start_table};
use super::table::FacePoint;
use crate::cell::runout::{RunoutHarmonic, error_motion};

/// Numbers for tests: SplitMix64, and normal ones by Box and Muller.
pub(super) struct Noise(pub(super) u64);

impl Noise {
    pub(super) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    pub(super) fn normal(&mut self) -> f64 {
        let (u, v) = (1.0 - self.uniform(), self.uniform());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }

    pub(super) fn twist(&mut self, sigma_rad: f64, sigma_mm: f64) -> Twist {
        let mut next = || Vector3::new(self.normal(), self.normal(), self.normal());
        twist(&(next() * sigma_rad), &(next() * sigma_mm))
    }
}

pub(super) fn sigma(robot_deg: f64, robot_mm: f64, board_deg: f64, board_mm: f64) -> Sigma {
    Sigma { robot_rad: robot_deg.to_radians(), robot_mm, board_rad: board_deg.to_radians(), board_mm }
}

/// The three levels: repeatability, calibrated arm, cobot as delivered.
pub(super) fn levels() -> [Sigma; 3] {
    [sigma(0.003, 0.012, 0.003, 0.012), sigma(0.01, 0.1, 0.005, 0.02), sigma(0.05, 0.5, 0.01, 0.03)]
}

fn pose(x: f64, y: f64, z: f64, [roll, pitch, yaw]: [f64; 3]) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_euler_angles(roll.to_radians(), pitch.to_radians(), yaw.to_radians());
    Isometry3::from_parts(Translation3::new(x, y, z), rotation)
}

/// The cell as it is: hand-eye like the default cell's, table 500 mm in front of the arm.
pub(super) fn truth() -> ChainEstimate {
    ChainEstimate {
        flange_from_cloud: pose(12.0, -3.0, 95.0, [1.0, -2.0, 91.0]),
        base_from_table: pose(560.0, 15.0, 120.0, [0.4, -0.3, 2.0]),
        plate_from_board: pose(20.0, -10.0, 25.0, [2.0, -1.0, 30.0]),
        scale: 1.0,
    }
}

/// Observations without noise: the board 450 to 510 mm in front, tilted up to `tilt_deg`, every direction of its
/// normal in that cone alike, rolled up to 60°.
pub(super) fn exact(at: &ChainEstimate, count: usize, tilt_deg: f64, turns: bool, noise: &mut Noise) -> Vec<Sighting> {
    (0..count)
        .map(|index| {
            let table_rad = if turns { (index as f64 * 360.0 / count as f64 - 180.0).to_radians() } else { 0.0 };
            let (tilt, azimuth) = (tilt_deg.to_radians() * noise.uniform().sqrt(), noise.between(0.0, std::f64::consts::TAU));
            let roll = noise.between(-60.0, 60.0).to_radians() * (tilt_deg / 40.0).min(1.0);
            let tilted = UnitQuaternion::from_scaled_axis(Vector3::new(azimuth.cos(), azimuth.sin(), 0.0) * tilt);
            let facing = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
            let rolled = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll);
            let place = Vector3::new(noise.between(-30.0, 30.0), noise.between(-30.0, 30.0), noise.between(450.0, 510.0));
            let cloud_from_board = Isometry3::from_parts(Translation3::from(place), tilted * facing * rolled);
            let base_from_cloud = at.base_from_plate(table_rad) * at.plate_from_board * cloud_from_board.inverse();
            let base_from_flange = base_from_cloud * at.flange_from_cloud.inverse();
            let (seen_covariance, points_mm) = (None, Vec::new());
            let id = format!("p{:02}", index + 1);
            Sighting { id, base_from_flange, table_rad, cloud_from_board, seen_covariance, points_mm }
        })
        .collect()
}

/// Observations without noise with table angles and tilts up to 30° as they come.
pub(super) fn scattered(at: &ChainEstimate, count: usize, noise: &mut Noise) -> Vec<Sighting> {
    let mut sightings = exact(at, count, 30.0, false, noise);
    for each in &mut sightings {
        each.table_rad = noise.between(-180.0, 180.0).to_radians();
        let rest = at.base_from_plate(0.0);
        each.base_from_flange = at.base_from_plate(each.table_rad) * rest.inverse() * each.base_from_flange;
    }
    sightings
}

/// The arm reports a pose that is off the true one, the scanner a board that is off.
pub(super) fn disturb(sightings: &mut [Sighting], sigma: &Sigma, noise: &mut Noise) {
    for each in sightings {
        each.base_from_flange *= exp(&-noise.twist(sigma.robot_rad, sigma.robot_mm));
        each.cloud_from_board *= exp(&noise.twist(sigma.board_rad, sigma.board_mm));
    }
}

pub(super) fn off(found: &Isometry3<f64>, truth: &Isometry3<f64>) -> (f64, f64) {
    let by = se3::log(&(truth.inverse() * found));
    (rotation_of(&by).norm().to_degrees(), (found.translation.vector - truth.translation.vector).norm())
}

pub(super) fn quantile_of(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
}

pub(super) fn in_hand(sigma: Sigma) -> Weighting {
    Weighting::new(HandEyeSetup::EyeInHand, sigma)
}

/// Row C1.
#[test]
fn without_noise_the_truth_is_found() {
    let (truth, mut noise) = (truth(), Noise(1));
    let fixed = ChainEstimate { base_from_table: Isometry3::identity(), ..truth };
    let still = exact(&fixed, 12, 40.0, false, &mut noise);
    let (frames, seen): (Vec<_>, Vec<_>) = still.iter().map(|each| (each.base_from_flange, each.cloud_from_board)).unzip();
    let nominal = pose(562.0, 13.0, 119.0, [0.0, 0.0, 2.0]);
    let turned = exact(&truth, 12, 40.0, true, &mut noise);
    let weighting = in_hand(levels()[1]);
    let problem = Adjustment { sightings: &turned, free: Free::JOINT, prior: None };
    let joint = problem.refine(&start_joint(&turned, &nominal).expect("a start"), &weighting).expect("refines");
    let table = Adjustment { free: Free::TABLE, ..problem };
    let table =
        table.refine(&start_table(&turned, &truth.flange_from_cloud, &nominal).expect("a start"), &weighting).expect("refines");
    let fixed = start_fixed(&still).expect("a start");
    let park = park_martin(&frames, &seen).expect("found");
    let dual = daniilidis(&frames, &seen).expect("found");
    for (name, found) in
        [("Park", park), ("Daniilidis", dual), ("start", fixed.flange_from_cloud), ("joint", joint.estimate.flange_from_cloud)]
    {
        let (deg, mm) = off(&found, &truth.flange_from_cloud);
        println!("C1 {name}: {deg:.1e}° {mm:.1e} mm");
        assert!(deg.to_radians() < 1e-9 && mm < 1e-9, "{name}");
    }
    for (name, found) in [("joint", joint.estimate.base_from_table), ("table", table.estimate.base_from_table)] {
        // Height and angle about the axis are not observed: compare axis and point.
        let (deg, mm) = axis_off(&found, &truth.base_from_table);
        println!("C1 axis {name}: {deg:.1e}° {mm:.1e} mm");
        assert!(deg.to_radians() < 1e-9 && mm < 1e-9, "{name}");
    }
}

/// Angle between two axes, degrees, and distance of the first from the second at the height of the second's origin, mm.
pub(super) fn axis_off(found: &Isometry3<f64>, truth: &Isometry3<f64>) -> (f64, f64) {
    let seen = truth.inverse() * found;
    let (up, origin) = (seen.rotation * Vector3::z(), seen.translation.vector);
    let at_plate = origin - up * (origin.z / up.z);
    (up.xy().norm().atan2(up.z).to_degrees(), at_plate.xy().norm())
}

/// Rows C5 and C6 for the hand-eye: median errors of 20 poses, and the mean of the normalised estimation error squared.
#[test]
fn errors_at_three_levels_are_as_small_as_stated_and_their_covariance_is_true() {
    let truth = ChainEstimate { base_from_table: Isometry3::identity(), ..truth() };
    let goals = [(0.020, 0.003), (0.070, 0.007), (0.36, 0.035)];
    for (level, (goal_mm, goal_deg)) in levels().into_iter().zip(goals) {
        let (mut degrees, mut lengths, mut park, mut nees) = (Vec::new(), Vec::new(), Vec::new(), 0.0);
        for run in 0..200 {
            let mut noise = Noise(1000 + run);
            let mut sightings = exact(&truth, 20, 40.0, false, &mut noise);
            disturb(&mut sightings, &level, &mut noise);
            let start = start_fixed(&sightings).expect("a start");
            let problem = Adjustment { sightings: &sightings, free: Free::HAND_EYE, prior: None };
            let refined = problem.refine(&start, &in_hand(level)).expect("refines");
            let (deg, mm) = off(&refined.estimate.flange_from_cloud, &truth.flange_from_cloud);
            degrees.push(deg);
            lengths.push(mm);
            park.push(off(&start.flange_from_cloud, &truth.flange_from_cloud).1);
            let by = se3::log(&(refined.estimate.flange_from_cloud.inverse() * truth.flange_from_cloud));
            nees += by.dot(&refined.hand_eye_covariance().cholesky().expect("positive").solve(&by)) / 200.0;
        }
        let (mm, deg) = (quantile_of(lengths.clone(), 0.5), quantile_of(degrees, 0.5));
        println!(
            "C5 {:.3} mm: {mm:.4} mm (p95 {:.4}; Park {:.4}, p95 {:.4}), {deg:.5}°; C6 NEES {nees:.2}",
            level.robot_mm,
            quantile_of(lengths, 0.95),
            quantile_of(park.clone(), 0.5),
            quantile_of(park, 0.95)
        );
        assert!(mm <= goal_mm && deg <= goal_deg, "{mm} {deg}");
        assert!((5.39..=6.65).contains(&nees), "{nees}");
    }
}

/// Rows C6 and C7 for the table: 15 poses with the table turned at each.
#[test]
fn the_axis_is_found_from_fifteen_poses() {
    let (truth, level) = (truth(), levels()[1]);
    let nominal = pose(562.0, 13.0, 119.0, [0.0, 0.0, 2.0]);
    let (mut degrees, mut lengths, mut nees) = (Vec::new(), Vec::new(), [0.0; 3]);
    for run in 0..200 {
        let mut noise = Noise(5000 + run);
        let mut sightings = exact(&truth, 15, 40.0, true, &mut noise);
        disturb(&mut sightings, &level, &mut noise);
        let problem = Adjustment { sightings: &sightings, free: Free::JOINT, prior: None };
        let start = start_joint(&sightings, &nominal).expect("a start");
        let refined = problem.refine(&start, &in_hand(level)).expect("refines");
        let (deg, mm) = axis_off(&refined.estimate.base_from_table, &truth.base_from_table);
        degrees.push(deg);
        lengths.push(mm);
        let by = truth_increment(&refined.estimate, &truth);
        for (block, (first, count)) in [(0, 6), (6, 4), (10, 6)].into_iter().enumerate() {
            let covariance = refined.covariance.view((first, first), (count, count)).into_owned();
            let by = by.rows(first, count).into_owned();
            nees[block] += by.dot(&covariance.cholesky().expect("positive").solve(&by)) / 200.0;
        }
    }
    let (mm, deg) = (quantile_of(lengths, 0.5), quantile_of(degrees, 0.5));
    println!("C7 axis: {mm:.4} mm, {deg:.5}°; C6 NEES X {:.2}, B {:.2}, P {:.2}", nees[0], nees[1], nees[2]);
    assert!(mm <= 0.05 && deg <= 0.005, "{mm} {deg}");
    // Bands of 99 % for the mean of 200 values of χ² with 6 and 4 degrees: k ± 2.576·√(2k/200).
    assert!((5.37..=6.63).contains(&nees[0]) && (3.48..=4.52).contains(&nees[1]) && (5.37..=6.63).contains(&nees[2]), "{nees:?}");
}

/// Increment to the truth in the gauge of the estimate: height and zero of the table as the estimate has them.
fn truth_increment(at: &ChainEstimate, truth: &ChainEstimate) -> super::refine::Increment {
    let seen = at.base_from_table.inverse() * truth.base_from_table;
    let gauge = twist(&Vector3::new(0.0, 0.0, -se3::log(&seen).z), &Vector3::new(0.0, 0.0, -seen.translation.z));
    let same = ChainEstimate {
        base_from_table: truth.base_from_table * exp(&gauge),
        plate_from_board: exp(&-gauge) * truth.plate_from_board,
        ..*truth
    };
    super::refine::increment(at, &same)
}

/// Row C8: bad poses are named, good ones kept, and the result is as good as without them.
#[test]
#[ignore = "long: tests/all runs it"]
fn bad_poses_are_named() {
    let truth = ChainEstimate { base_from_table: Isometry3::identity(), ..truth() };
    let level = levels()[1];
    type Spoil = fn(&mut [Sighting], usize);
    let spoils: [(&str, usize, Spoil); 3] = [
        ("swap", 2, |s, _| {
            let kept = s[2].cloud_from_board;
            s[2].cloud_from_board = s[9].cloud_from_board;
            s[9].cloud_from_board = kept;
        }),
        ("bump", 1, |s, index| {
            s[index].cloud_from_board *= exp(&twist(&Vector3::new(0.003, 0.003, 0.003), &Vector3::new(1.2, 1.2, 1.1)))
        }),
        ("unit", 1, |s, index| s[index].cloud_from_board.translation.vector /= 1000.0),
    ];
    for (name, per_spoil, spoil) in spoils {
        for count in if per_spoil == 2 { vec![1] } else { vec![1, 2] } {
            let (mut named, mut dropped, mut ratio) = (0, 0, Vec::new());
            let runs = 50;
            for run in 0..runs {
                let mut noise = Noise(9000 + run);
                let mut sightings = exact(&truth, 15, 40.0, false, &mut noise);
                disturb(&mut sightings, &level, &mut noise);
                let mut bad = vec![2, 9];
                bad.truncate(if per_spoil == 2 { 2 } else { count });
                let good: Vec<_> = (0..15).filter(|index| !bad.contains(index)).map(|index| sightings[index].clone()).collect();
                bad.iter().take(count).for_each(|index| spoil(&mut sightings, *index));
                let screening = |sightings: &[Sighting]| {
                    let weighting = in_hand(level);
                    let start = |some: &[Sighting]| start_fixed(some);
                    Screening { sightings, free: Free::HAND_EYE, start: &start, weighting, estimate_sigma: false }.screen()
                };
                let screened = screening(&sightings).expect("screens");
                named += bad.iter().filter(|index| !screened.is_used[**index]).count();
                dropped += (0..15).filter(|index| !bad.contains(index) && !screened.is_used[*index]).count();
                let clean = start_fixed(&good).expect("a start");
                let problem = Adjustment { sightings: &good, free: Free::HAND_EYE, prior: None };
                let clean = problem.refine(&clean, &in_hand(level)).expect("refines");
                let found = off(&screened.refined.estimate.flange_from_cloud, &truth.flange_from_cloud).1;
                ratio.push(found / off(&clean.estimate.flange_from_cloud, &truth.flange_from_cloud).1);
            }
            let bad = if per_spoil == 2 { 2 } else { count };
            let (good, ratio) = ((15 - bad) * runs as usize, quantile_of(ratio, 0.5));
            println!(
                "C8 {name} × {count}: {named} of {} named, {dropped} of {good} good dropped, error × {ratio:.3}",
                bad * runs as usize
            );
            assert!(named == bad * runs as usize && dropped * 100 <= good && ratio <= 1.2, "{name}");
        }
    }
}

/// Deviations that are estimated: hardly a good observation is dropped, and a bad one is.
#[test]
#[ignore = "long: tests/all runs it"]
fn estimated_deviations_drop_no_good_observations() {
    let truth = ChainEstimate { base_from_table: Isometry3::identity(), ..truth() };
    for (level, count) in levels().into_iter().zip([30, 15, 20]) {
        let (runs, mut dropped, mut named) = (40, 0, 0);
        for run in 0..runs {
            let mut noise = Noise(13_000 + run);
            let mut sightings = exact(&truth, count, 40.0, false, &mut noise);
            disturb(&mut sightings, &level, &mut noise);
            let start = |some: &[Sighting]| start_fixed(some);
            let screened = |sightings: &[Sighting]| {
                let weighting = in_hand(levels()[1]);
                Screening { sightings, free: Free::HAND_EYE, start: &start, weighting, estimate_sigma: true }
                    .screen()
                    .expect("screens")
            };
            dropped += screened(&sightings).is_used.iter().filter(|used| !**used).count();
            // Ten deviations of arm and board together.
            let (turn, shift) = (10.0 * level.robot_rad.hypot(level.board_rad), 10.0 * level.robot_mm.hypot(level.board_mm));
            sightings[4].cloud_from_board *= exp(&twist(&(Vector3::x() * turn), &(Vector3::y() * shift)));
            named += usize::from(!screened(&sightings).is_used[4]);
        }
        let all = runs as usize * count;
        println!("estimated deviations, {count} poses: {dropped} of {all} good dropped, {named} of {runs} bad named");
        assert!(dropped * 100 <= all && named as u64 * 100 >= 95 * runs, "{dropped} {named}");
    }
}

/// Boards fitted to points of clouds that each are off as a whole: the covariance of the scanner's pose counts poses, not points.
#[test]
#[ignore = "long: tests/all runs it"]
fn points_are_clustered_by_pose() {
    let truth = ChainEstimate { base_from_table: Isometry3::identity(), ..truth() };
    let (arm, runs) = (levels()[1], 150);
    let mut nees = [0.0; 2];
    for run in 0..runs {
        let mut noise = Noise(31_000 + run);
        let mut sightings = exact(&truth, 20, 40.0, false, &mut noise);
        for each in &mut sightings {
            each.base_from_flange *= exp(&-noise.twist(arm.robot_rad, arm.robot_mm));
            // The whole cloud is off by 0.1 mm and 0.01°, and each point by 0.02 mm.
            let seen = each.cloud_from_board * exp(&noise.twist(0.01_f64.to_radians(), 0.1));
            let pair = |index: usize| {
                let board = nalgebra::Point3::new((index % 8) as f64 * 15.0, (index / 8) as f64 * 15.0, 0.0);
                [board, seen * board]
            };
            let mut pairs: Vec<_> = (0..40).map(pair).collect();
            pairs.iter_mut().for_each(|[_, cloud]| *cloud += noise.twist(0.0, 0.02).fixed_rows::<3>(3).into_owned());
            let fitted = super::placement::from_points(&pairs, Some(0.02)).expect("a pose");
            (each.cloud_from_board, each.seen_covariance, each.points_mm) = (fitted.pose, fitted.covariance, pairs);
        }
        for (sigma, nees) in [Some(Sigma { board_mm: 0.02, ..arm }), None].into_iter().zip(&mut nees) {
            let found = task(sightings.clone(), Solve::HandEye, sigma).calibrate().expect("a calibration");
            let by = se3::log(&(found.refined.estimate.flange_from_cloud.inverse() * truth.flange_from_cloud));
            let covariance = found.refined.hand_eye_covariance();
            *nees += by.dot(&covariance.cholesky().expect("positive").solve(&by)) / f64::from(runs as u32);
        }
    }
    println!("points: NEES of 6 {:.2} with the points' deviation alone given, {:.2} estimated", nees[0], nees[1]);
    // Estimated variances give the tails of an F distribution: a mean of 6 · ν / (ν − 2) for ν near 30 effective degrees, and 99 %.
    // One factor for all deviations has not quite their shape.
    assert!((5.3..=8.6).contains(&nees[0]) && (5.3..=7.8).contains(&nees[1]), "{nees:?}");
}

/// Row C14, and that one step predicts as a refinement without the observation does.
#[test]
fn leaving_one_out_is_quick_and_right() {
    let truth = truth();
    let mut noise = Noise(77);
    let mut sightings = exact(&truth, 50, 40.0, true, &mut noise);
    disturb(&mut sightings, &levels()[1], &mut noise);
    let began = std::time::Instant::now();
    let start = |some: &[Sighting]| start_joint(some, &truth.base_from_table);
    let screening = Screening {
        sightings: &sightings,
        free: Free::JOINT,
        start: &start,
        weighting: in_hand(levels()[1]),
        estimate_sigma: true,
    };
    let screened = screening.screen().expect("screens");
    let left_out = leave_one_out(&screened.refined, &sightings);
    println!("C14 50 poses, screened, deviations estimated, each left out: {:?}", began.elapsed());
    let others: Vec<_> = sightings[1..].to_vec();
    let problem = Adjustment { sightings: &others, free: Free::JOINT, prior: None };
    let without = problem.refine(&screened.refined.estimate, &screened.refined.weighting).expect("refines");
    let (slow, quick) = (without.estimate.residual(&sightings[0]), left_out[0].expect("predicted").residual);
    println!("left out: {} by refinement, {} by one step", translation_of(&slow).norm(), translation_of(&quick).norm());
    assert!(translation_of(&(slow - quick)).norm() < 1e-3 && rotation_of(&(slow - quick)).norm() < 1e-5);
}

/// Row C9: motions that leave a freedom open are refused and the freedom named; predicted and actual spread agree elsewhere.
#[test]
fn degenerate_motion_is_refused_with_the_freedom_that_is_missing() {
    let truth = ChainEstimate { base_from_table: Isometry3::identity(), ..truth() };
    let level = levels()[1];
    let refused = |sightings: Vec<Sighting>| {
        let findings = task(sightings, Solve::HandEye, Some(level)).calibrate().expect_err("refused");
        findings.last().expect("a finding").clone()
    };
    let mut noise = Noise(3);
    let mut tilted = |tilt_deg: f64, count: usize| {
        let mut sightings = exact(&truth, count, tilt_deg, false, &mut noise);
        disturb(&mut sightings, &level, &mut noise);
        sightings
    };
    assert_eq!(refused(tilted(40.0, 2)).code, FindingCode::TooFew);
    assert_eq!(refused(tilted(0.5, 12)).code, FindingCode::DegenerateMotion);
    // Turns about the scanner's own axis alone: z of the cloud, which the flange sees along its z.
    let about_z: Vec<Sighting> = tilted(40.0, 12)
        .into_iter()
        .enumerate()
        .map(|(index, mut each)| {
            let turn = twist(&(Vector3::z() * (0.2 * index as f64)), &Vector3::zeros());
            each.cloud_from_board = exp(&turn) * pose(5.0, -8.0, 480.0, [180.0, 0.0, 0.0]);
            each.base_from_flange = truth.plate_from_board * each.cloud_from_board.inverse() * truth.flange_from_cloud.inverse();
            each
        })
        .collect();
    let finding = refused(about_z);
    let axis = finding.figures.vector.expect("an axis");
    println!("C9 one axis: {:?} about {axis:.2?}", finding.code.as_str());
    let along = truth.flange_from_cloud.rotation * Vector3::z();
    assert!(finding.code == FindingCode::DegenerateMotion && axis.dot(&along).abs() > 0.999);
    let same = vec![tilted(40.0, 1)[0].clone(); 12];
    let same = same.into_iter().enumerate().map(|(index, each)| Sighting { id: format!("s{index}"), ..each }).collect();
    assert_eq!(refused(same).code, FindingCode::TooFew, "all but one are duplicates");
    let mut few = tilted(40.0, 5);
    few[1] = Sighting { id: "twin".to_owned(), ..few[0].clone() };
    let held = Task { hold_out: 2, ..task(few, Solve::HandEye, Some(level)) };
    let figures = held.calibrate().expect_err("refused").last().expect("a finding").figures;
    assert_eq!([figures.count, figures.held_out, figures.given], [2, 2, 5].map(Some), "the twin was not counted");
    for tilt_deg in [5.0, 10.0, 20.0, 40.0] {
        let (mut squares, mut predicted) = (0.0, 0.0);
        for run in 0..60 {
            let mut noise = Noise(700 + run);
            let mut sightings = exact(&truth, 12, tilt_deg, false, &mut noise);
            disturb(&mut sightings, &level, &mut noise);
            let problem = Adjustment { sightings: &sightings, free: Free::HAND_EYE, prior: None };
            let refined = problem.refine(&start_fixed(&sightings).expect("a start"), &in_hand(level)).expect("refines");
            squares += off(&refined.estimate.flange_from_cloud, &truth.flange_from_cloud).1.powi(2) / 60.0;
            predicted += refined.hand_eye_covariance().fixed_view::<3, 3>(3, 3).trace() / 60.0;
        }
        let ratio = (squares / predicted).sqrt();
        println!("C9 tilt {tilt_deg}°: {:.3} mm predicted, {:.3} mm met", predicted.sqrt(), squares.sqrt());
        assert!((0.5..=2.0).contains(&ratio), "{ratio}");
    }
}

pub(super) fn task(sightings: Vec<Sighting>, solve: Solve, sigma: Option<Sigma>) -> Task {
    Task {
        runout: Vec::new(),
        face: Vec::new(),
        sightings,
        joints_rad: Vec::new(),
        solve,
        setup: HandEyeSetup::EyeInHand,
        sigma,
        nominal: ChainEstimate { base_from_table: pose(562.0, 13.0, 119.0, [0.0, 0.0, 2.0]), ..truth() },
        hold_out: 0,
        best_in_cloud_mm: Vector3::new(0.0, 0.0, 480.0),
        best_mm: 480.0,
        board_middle_mm: Some(Vector3::new(75.0, 52.5, 0.0)),
        board_pitch_mm: Some(10.0),
        limits: UncertaintyLimits::default(),
        turned_rad: Vec::new(),
    }
}

/// Row C10: four poses of the board where it stood, with the scanner as calibrated and with one that drifted.
#[test]
#[ignore = "long: tests/all runs it"]
fn a_drift_is_found_and_compensated_and_none_is_seldom_claimed() {
    let (truth, level) = (truth(), levels()[1]);
    let nominal = pose(562.0, 13.0, 119.0, [0.0, 0.0, 2.0]);
    let runs = 300;
    for (drift_deg, drift_mm) in [(0.0, 0.0), (0.02, 0.2), (0.05, 0.5), (0.2, 2.0)] {
        let (mut claimed, mut recalibrate, mut left) = (0, 0, Vec::new());
        for run in 0..runs {
            let mut noise = Noise(40_000 + run);
            let mut sightings = exact(&truth, 20, 40.0, true, &mut noise);
            disturb(&mut sightings, &level, &mut noise);
            let problem = Adjustment { sightings: &sightings, free: Free::JOINT, prior: None };
            let refined = problem.refine(&start_joint(&sightings, &nominal).expect("a start"), &in_hand(level)).expect("refines");
            let mut direction = || Vector3::new(noise.normal(), noise.normal(), noise.normal()).normalize();
            let drift = twist(&(direction() * f64::to_radians(drift_deg)), &(direction() * drift_mm));
            let drifted = ChainEstimate { flange_from_cloud: truth.flange_from_cloud * exp(&drift), ..truth };
            let mut seen = exact(&drifted, 4, 30.0, true, &mut noise);
            disturb(&mut seen, &level, &mut noise);
            let check = Check {
                sightings: &seen,
                calibrated: refined.estimate,
                covariance: &refined.covariance,
                weighting: in_hand(level),
                sigma_freedom: None,
                limits: CheckLimits::default(),
            };
            let checked = check.check().expect("four poses");
            claimed += usize::from(checked.verdict != CheckVerdict::Ok);
            recalibrate += usize::from(checked.verdict == CheckVerdict::Recalibrate);
            left.push(off(&checked.compensated.flange_from_cloud, &drifted.flange_from_cloud).1);
        }
        let left = quantile_of(left, 0.5);
        println!(
            "C10 drift {drift_deg}° {drift_mm} mm: {claimed} of {runs} found, {recalibrate} to recalibrate, {left:.3} mm left"
        );
        match drift_mm {
            none if none < 0.1 => assert!(claimed * 100 <= 2 * runs as usize, "{claimed}"),
            small if small < 0.4 => {}
            _ => assert!(claimed * 100 >= 99 * runs as usize && left <= 0.12, "{claimed} {left}"),
        }
    }
}

/// The scanner's pose is held when the table alone is calibrated, and may drift all the same.
#[test]
fn a_calibration_of_the_table_alone_finds_a_scanner_that_drifted() {
    let (truth, level) = (truth(), levels()[1]);
    let nominal = pose(562.0, 13.0, 119.0, [0.0, 0.0, 2.0]);
    let mut noise = Noise(7);
    let mut sightings = exact(&truth, 20, 40.0, true, &mut noise);
    disturb(&mut sightings, &level, &mut noise);
    let problem = Adjustment { sightings: &sightings, free: Free::TABLE, prior: None };
    let start = start_table(&sightings, &truth.flange_from_cloud, &nominal).expect("a start");
    let refined = problem.refine(&start, &in_hand(level)).expect("refines");
    let mut verdict = |drift_mm: f64| {
        let drift = twist(&Vector3::zeros(), &Vector3::new(drift_mm, 0.0, 0.0));
        let drifted = ChainEstimate { flange_from_cloud: truth.flange_from_cloud * exp(&drift), ..truth };
        let mut seen = exact(&drifted, 4, 30.0, true, &mut noise);
        disturb(&mut seen, &level, &mut noise);
        let (covariance, limits) = (&refined.covariance, CheckLimits::default());
        let (calibrated, weighting) = (refined.estimate, in_hand(level));
        let check = Check { sightings: &seen, calibrated, covariance, weighting, sigma_freedom: None, limits };
        check.check().expect("four poses").verdict
    };
    assert_eq!((verdict(0.0), verdict(5.0)), (CheckVerdict::Ok, CheckVerdict::Compensate));
}

/// Deviations that were estimated from a few observations were taken for known: of checks without a drift that were to raise a
/// false alarm in 1 of 100, 9 did after 6 observations.
#[test]
fn a_check_with_estimated_deviations_keeps_its_rate_of_false_alarms() {
    let (truth, level) = (ChainEstimate { base_from_table: Isometry3::identity(), ..truth() }, levels()[1]);
    let (runs, freedom) = (60, 8.0);
    let (mut claimed, mut as_known, mut thresholds) = (0, 0, Vec::new());
    for run in 0..runs {
        let mut noise = Noise(61_000 + run);
        let mut sightings = exact(&truth, 6, 40.0, false, &mut noise);
        disturb(&mut sightings, &level, &mut noise);
        let problem = Adjustment { sightings: &sightings, free: Free::HAND_EYE, prior: None };
        let start = start_fixed(&sightings).expect("a start");
        let refined = problem.refine_with_sigma(&start, &in_hand(level)).expect("refines");
        let mut seen = exact(&truth, 4, 30.0, false, &mut noise);
        disturb(&mut seen, &level, &mut noise);
        let check = Check {
            sightings: &seen,
            calibrated: refined.estimate,
            covariance: &refined.covariance,
            weighting: refined.weighting,
            sigma_freedom: Some(freedom),
            limits: CheckLimits { false_alarm: 0.05, ..CheckLimits::default() },
        };
        let is_claimed = |check: Check<'_>| check.check().expect("four poses").verdict != CheckVerdict::Ok;
        claimed += usize::from(is_claimed(check));
        as_known += usize::from(is_claimed(Check { sigma_freedom: None, ..check }));
        thresholds.push(check.check().expect("four poses").threshold);
    }
    println!("false alarms at 5 %: {claimed} of {runs}, {as_known} with deviations taken for known");
    // Three in sixty are expected; nine or more are met by chance in 1 of 250 such tests.
    assert!(claimed <= 8 && claimed < as_known, "{claimed} {as_known}");
    assert!(thresholds.iter().all(|threshold| (threshold / 21.484 - 1.0).abs() < 1e-3), "{thresholds:?}");
}

/// Three good poses of seven were dropped in 3 of 60 clean sets, by deviations of four that agreed by chance: the result was 0.5 mm
/// off and said to be known to 0.1 mm.
#[test]
fn seven_good_observations_are_kept_and_their_uncertainty_is_true() {
    let (truth, level, runs) = (truth(), levels()[1], 60);
    let (mut sets, mut nees) = (0, 0.0);
    for run in 0..runs {
        let mut noise = Noise(1_000_003 * (run + 1));
        let mut sightings = scattered(&truth, 7, &mut noise);
        disturb(&mut sightings, &level, &mut noise);
        let limits = UncertaintyLimits { max_mm: 5.0, max_rad: 0.1, warn_mm: 5.0 };
        let found = Task { limits, ..task(sightings, Solve::Joint, None) }.calibrate().expect("a calibration");
        sets += usize::from(found.roles.contains(&Role::Dropped));
        let by = se3::log(&(found.refined.estimate.flange_from_cloud.inverse() * truth.flange_from_cloud));
        nees += by.dot(&found.refined.hand_eye_covariance().cholesky().expect("positive").solve(&by)) / (6 * runs) as f64;
    }
    println!("seven poses: some dropped in {sets} of {runs} sets; NEES / 6 {nees:.2}");
    assert!(sets == 0 && nees < 2.0, "{sets} {nees}");
}

/// Good observations that were held out were told to disagree 77 times as often as stated, by deviations that were estimated from
/// few and taken for known.
#[test]
fn observations_that_were_held_out_are_seldom_told_to_disagree() {
    let (truth, level) = (truth(), levels()[1]);
    for (used, held_out) in [(6, 4), (15, 2)] {
        let (runs, mut alarms, mut missed) = (100, 0, 0);
        for run in 0..runs {
            let mut noise = Noise(7_000_003 * (run + 1));
            let mut sightings = scattered(&truth, used + held_out, &mut noise);
            disturb(&mut sightings, &level, &mut noise);
            let limits = UncertaintyLimits { max_mm: 5.0, max_rad: 0.1, warn_mm: 5.0 };
            let clean = Task { limits, hold_out: held_out, ..task(sightings, Solve::Joint, None) };
            let told = |task: &Task| {
                let findings = task.calibrate().expect("a calibration").findings;
                findings.iter().filter(|finding| finding.code == FindingCode::HeldOutDisagrees).count()
            };
            alarms += told(&clean);
            if run < 10 {
                let mut off = clean;
                off.sightings[used].cloud_from_board.translation.x += 5.0;
                missed += usize::from(told(&off) == 0);
            }
        }
        println!("held out: {alarms} of {} told to disagree, {missed} of 10 that are 5 mm off are not", runs as usize * held_out);
        // A rate of 0.1 %: three or more of 400 are met by chance in 1 of 125 such tests.
        assert!(alarms <= 2 && missed == 0, "{used} + {held_out}: {alarms} {missed}");
    }
}

/// Causes were told by χ² where deviations are estimated, though observations are dropped by F: boards of few observations that were
/// exchanged, or had moved together, were told as bad ones.
#[test]
fn causes_of_dropped_observations_are_judged_by_how_well_the_deviations_are_known() {
    let (truth, mut noise) = (ChainEstimate { base_from_table: Isometry3::identity(), ..truth() }, Noise(3));
    let clean = exact(&truth, 9, 40.0, false, &mut noise);
    let problem = Adjustment { sightings: &clean[..6], free: Free::HAND_EYE, prior: None };
    let refined = problem.refine(&truth, &in_hand(levels()[1])).expect("refines");
    let moved = |index: usize, x_mm: f64, y_mm: f64| {
        let mut each = clean[index].clone();
        each.cloud_from_board *= Translation3::new(x_mm, y_mm, 0.0);
        each
    };
    // A whitened square of 35: the bounds are 24.1 for known deviations, and 93.9 for those of 8 degrees of freedom.
    let off_mm = |index: usize| (35.0 / refined.chi2_of_other(&moved(index, 0.0, 1.0))).sqrt();
    let mut exchanged = [&clean[..6], &[moved(6, 0.0, off_mm(6)), moved(7, 0.0, off_mm(7))]].concat();
    let kept = exchanged[6].cloud_from_board;
    exchanged[6].cloud_from_board = exchanged[7].cloud_from_board;
    exchanged[7].cloud_from_board = kept;
    let together = [moved(6, 5.0, off_mm(6)), moved(7, 5.0, -off_mm(6)), moved(8, 5.0, 0.0)];
    let together = [&clean[..6], &together].concat();
    let codes = |sightings: &[Sighting], sigma: Option<Sigma>| -> Vec<FindingCode> {
        let is_used = (0..sightings.len()).map(|index| index < 6).collect();
        let screened = Screened { refined: refined.clone(), is_used, sigma_scale: 1.0, is_sigma_estimated: sigma.is_none() };
        let mut findings = Vec::new();
        task(sightings.to_vec(), Solve::HandEye, sigma).flipped_back(screened, &mut findings).expect("no error of its own");
        findings.iter().map(|finding| finding.code).collect()
    };
    assert_eq!(codes(&exchanged, None), [FindingCode::Swapped]);
    assert_eq!(codes(&exchanged, Some(levels()[1])), [FindingCode::BadPose; 2]);
    assert_eq!(codes(&together, None), [FindingCode::Moved]);
    assert_eq!(codes(&together, Some(levels()[1])), [FindingCode::BadPose; 3]);
}

/// A fault planted in observations.
type Planted<'a> = &'a dyn Fn(&mut Vec<Sighting>);

/// Pose whose quaternion is read with its scalar part last, where it was written first.
fn scalar_last(pose: &Isometry3<f64>) -> Isometry3<f64> {
    let written = pose.rotation.quaternion();
    let read = nalgebra::Quaternion::new(written.k, written.w, written.i, written.j);
    Isometry3::from_parts(pose.translation, UnitQuaternion::from_quaternion(read))
}

/// One part of every observation is that of the observation after it, and of the last one that of the first.
fn one_row_late(sightings: &mut [Sighting], part: impl Fn(&mut Sighting, &Sighting)) {
    let given = sightings.to_vec();
    for (index, late) in sightings.iter_mut().enumerate() {
        part(late, &given[(index + 1) % given.len()]);
    }
}

/// Findings of a calibration, whatever became of it.
fn findings_of(task: &Task) -> Vec<CalibrationFinding> {
    task.calibrate().map_or_else(|findings| findings, |found| found.findings)
}

/// A shift by one is the zero of a table that turns in equal steps, and the reading out of step left the bad observation out: good
/// records were told to be in the wrong order.
#[test]
fn one_bad_observation_at_either_end_is_not_told_as_records_out_of_step() {
    let truth = truth();
    for bad in 0..6 {
        let mut sightings = exact(&truth, 6, 30.0, true, &mut Noise(11));
        sightings[bad].cloud_from_board.translation.vector.x += 20.0;
        let codes: Vec<FindingCode> =
            findings_of(&task(sightings, Solve::Joint, None)).iter().map(|finding| finding.code).collect();
        assert!(!codes.contains(&FindingCode::OutOfStep), "observation {bad} is bad: {codes:?}");
    }
}

/// Such data were told to move the arm too little, to be of a table that turns the other way or by half its angle, and of a board
/// 37 times as large, each beside the others.
#[test]
fn data_that_contradict_each_other_name_their_cause_and_nothing_else() {
    let (truth, level) = (truth(), levels()[1]);
    let told = |nominal_off_mm: f64, spoil: Planted<'_>| -> Vec<(FindingCode, Option<Subject>)> {
        let mut noise = Noise(5);
        let mut sightings = scattered(&truth, 15, &mut noise);
        disturb(&mut sightings, &level, &mut noise);
        spoil(&mut sightings);
        let mut task = task(sightings, Solve::Joint, None);
        task.nominal.base_from_table.translation.vector.x += nominal_off_mm;
        findings_of(&task).iter().map(|finding| (finding.code, finding.figures.subject)).collect()
    };
    let cases: [(FindingCode, Option<Subject>, Planted<'_>); 9] = [
        (FindingCode::QuaternionOrder, Some(Subject::Board), &|s| {
            s.iter_mut().for_each(|each| each.cloud_from_board = scalar_last(&each.cloud_from_board));
        }),
        (FindingCode::QuaternionOrder, Some(Subject::Flange), &|s| {
            s.iter_mut().for_each(|each| each.base_from_flange = scalar_last(&each.base_from_flange));
        }),
        (FindingCode::OutOfStep, Some(Subject::Board), &|s| {
            one_row_late(s, |late, each| late.cloud_from_board = each.cloud_from_board);
        }),
        (FindingCode::OutOfStep, Some(Subject::Table), &|s| one_row_late(s, |late, each| late.table_rad = each.table_rad)),
        (FindingCode::UnitMismatch, Some(Subject::Flange), &|s| {
            s.iter_mut().for_each(|each| each.base_from_flange.translation.vector /= 25.4);
        }),
        (FindingCode::UnitMismatch, Some(Subject::Flange), &|s| {
            s.iter_mut().for_each(|each| each.base_from_flange.translation.vector /= 10.0);
        }),
        (FindingCode::Transposed, Some(Subject::Board), &|s| {
            s.iter_mut().for_each(|each| each.cloud_from_board.rotation = each.cloud_from_board.rotation.inverse());
        }),
        (FindingCode::Inverted, Some(Subject::Board), &|s| {
            s.iter_mut().for_each(|each| each.cloud_from_board = each.cloud_from_board.inverse());
        }),
        (FindingCode::NoConsensus, None, &|s| {
            let given = s.to_vec();
            s.iter_mut()
                .enumerate()
                .for_each(|(index, each)| each.cloud_from_board = given[(index * 4 + 7) % 15].cloud_from_board);
        }),
    ];
    for off_mm in [0.0, 302.0] {
        assert_eq!(told(off_mm, &|_| ()), []);
        for (code, subject, spoil) in cases {
            assert_eq!(told(off_mm, spoil), [(code, subject)], "{off_mm}");
        }
    }
}

/// A cause was named for three rows, which some three poses fit whatever was read: records out of step, where two or three boards were
/// exchanged.
#[test]
fn few_observations_that_contradict_each_other_name_no_cause_by_chance() {
    let truth = truth();
    let exchanged = |seed: u64, order: &[usize]| {
        let mut noise = Noise(seed);
        let mut sightings = scattered(&truth, order.len(), &mut noise);
        disturb(&mut sightings, &levels()[1], &mut noise);
        let given = sightings.clone();
        sightings.iter_mut().zip(order).for_each(|(each, from)| each.cloud_from_board = given[*from].cloud_from_board);
        task(sightings, Solve::Joint, None)
    };
    let read = |task: &Task| task.trial().other_reading(&task.sightings).map(|finding| finding.code);
    for (seed, order) in [(8, [1, 2, 0, 3]), (10, [1, 0, 3, 2]), (15, [3, 1, 2, 0])] {
        let task = exchanged(seed, &order);
        assert_eq!((read(&task), task.needed()), (None, Some(6)), "{seed}");
        let findings = task.calibrate().expect_err("they contradict each other");
        let is_open = |finding: &CalibrationFinding| {
            let codes = [FindingCode::NoConsensus, FindingCode::DegenerateMotion];
            codes.contains(&finding.code) && finding.figures.needed == Some(6)
        };
        let mut errors = findings.iter().filter(|finding| finding.severity == Severity::Error);
        assert!(errors.all(is_open), "{findings:?}");
    }
    let late = exchanged(5, &[1, 2, 3, 4, 5, 0]);
    assert_eq!((read(&late), late.needed()), (Some(FindingCode::OutOfStep), None));
    let still = Task { solve: Solve::HandEye, ..exchanged(5, &[0, 1, 2, 3]) };
    assert_eq!((still.needed(), Task { solve: Solve::Table, ..still }.needed()), (Some(5), None));
}

/// A board a fifth larger than stated leaves residuals of centimetres, as data that contradict each other do.
#[test]
fn a_board_of_quite_another_size_is_no_contradiction() {
    let (truth, mut noise) = (truth(), Noise(5));
    let mut sightings = scattered(&truth, 15, &mut noise);
    disturb(&mut sightings, &levels()[1], &mut noise);
    sightings.iter_mut().for_each(|each| each.cloud_from_board.translation.vector *= 1.2);
    let codes: Vec<_> = findings_of(&task(sightings, Solve::Joint, None)).iter().map(|finding| finding.code).collect();
    assert!(codes.contains(&FindingCode::BoardScale) && !codes.contains(&FindingCode::NoConsensus), "{codes:?}");
}

/// The unit was told by the scanner's distance, of which the arm's reach is a multiple: inches were called centimetres.
#[test]
fn the_unit_of_the_arm_is_told_by_what_agrees_with_the_boards() {
    let truth = ChainEstimate { base_from_table: Isometry3::identity(), ..truth() };
    for unit_mm in [25.4, 1000.0] {
        let mut noise = Noise(11);
        let mut sightings = exact(&truth, 16, 40.0, false, &mut noise);
        disturb(&mut sightings, &levels()[1], &mut noise);
        sightings.iter_mut().for_each(|each| each.base_from_flange.translation.vector /= unit_mm);
        let findings = findings_of(&task(sightings, Solve::HandEye, None));
        assert_eq!(findings.len(), 1, "{findings:?}");
        assert_eq!((findings[0].code, findings[0].figures.length_mm), (FindingCode::UnitMismatch, Some(unit_mm)));
    }
}

/// A board that turned with the table was told to be seen by an arm that moves too little.
#[test]
fn a_board_that_turned_with_the_table_is_told_where_it_is_said_to_stand_still() {
    let (truth, mut noise) = (truth(), Noise(5));
    let mut sightings = scattered(&truth, 15, &mut noise);
    disturb(&mut sightings, &levels()[1], &mut noise);
    let turned_rad: Vec<f64> = sightings.iter().map(|each| each.table_rad).collect();
    sightings.iter_mut().for_each(|each| each.table_rad = 0.0);
    let codes = |task: &Task| findings_of(task).iter().map(|finding| finding.code).collect::<Vec<_>>();
    let still = task(sightings, Solve::HandEye, None);
    assert_eq!(codes(&still), [FindingCode::NoConsensus], "without angles");
    assert_eq!(codes(&Task { turned_rad, ..still }), [FindingCode::BoardTurned]);
}

/// A scanner that was a few millimetres off had the arm's motions blamed, or the board that had moved.
#[test]
fn a_table_solved_for_beside_a_scanner_that_is_off_tells_of_the_scanner() {
    let (truth, level) = (truth(), levels()[1]);
    let codes = |off: &Isometry3<f64>| -> Vec<FindingCode> {
        let mut noise = Noise(5);
        let mut sightings = scattered(&truth, 15, &mut noise);
        disturb(&mut sightings, &level, &mut noise);
        let mut task = task(sightings, Solve::Table, None);
        task.nominal.flange_from_cloud = truth.flange_from_cloud * off;
        findings_of(&task).iter().map(|finding| finding.code).collect()
    };
    assert_eq!(codes(&Isometry3::identity()), []);
    assert_eq!(codes(&pose(4.0, -3.0, 5.0, [1.0, -1.5, 0.5])), [FindingCode::ScannerHeld]);
    assert_eq!(codes(&pose(40.0, -30.0, 50.0, [5.0, -5.0, 90.0])), [FindingCode::ScannerHeld]);
}

/// Faults that people bring, each with its code.
#[test]
fn faults_of_the_data_are_named() {
    let truth = ChainEstimate { base_from_table: Isometry3::identity(), ..truth() };
    let level = levels()[1];
    let codes = |spoil: &dyn Fn(&mut Vec<Sighting>)| -> Vec<FindingCode> {
        let mut noise = Noise(11);
        let mut sightings = exact(&truth, 16, 40.0, false, &mut noise);
        disturb(&mut sightings, &level, &mut noise);
        spoil(&mut sightings);
        let found = task(sightings, Solve::HandEye, Some(level)).calibrate();
        let findings = found.map_or_else(|findings| findings, |found| found.findings);
        findings.into_iter().map(|finding| finding.code).collect()
    };
    assert_eq!(codes(&|_| ()), []);
    let cases: [(FindingCode, Planted<'_>); 13] = [
        (FindingCode::UnitMismatch, &|s| s[3].cloud_from_board.translation.vector /= 1000.0),
        (FindingCode::UnitMismatch, &|s| s.iter_mut().for_each(|each| each.cloud_from_board.translation.vector /= 1000.0)),
        (FindingCode::Inverted, &|s| s.iter_mut().for_each(|each| each.cloud_from_board = each.cloud_from_board.inverse())),
        (FindingCode::OtherSetup, &|s| s.iter_mut().for_each(|each| each.base_from_flange = each.base_from_flange.inverse())),
        (FindingCode::QuaternionOrder, &|s| {
            s.iter_mut().for_each(|each| each.cloud_from_board = scalar_last(&each.cloud_from_board))
        }),
        (FindingCode::QuaternionOrder, &|s| {
            s.iter_mut().for_each(|each| each.base_from_flange = scalar_last(&each.base_from_flange))
        }),
        (FindingCode::UnitMismatch, &|s| s.iter_mut().for_each(|each| each.base_from_flange.translation.vector /= 10.0)),
        (FindingCode::OutOfStep, &|s| one_row_late(s, |late, each| late.cloud_from_board = each.cloud_from_board)),
        (FindingCode::DuplicatePose, &|s| s[7] = Sighting { id: "twin".into(), ..s[2].clone() }),
        (FindingCode::Swapped, &|s| {
            let kept = s[4].cloud_from_board;
            s[4].cloud_from_board = s[9].cloud_from_board;
            s[9].cloud_from_board = kept;
        }),
        (FindingCode::Moved, &|s| {
            s[11..]
                .iter_mut()
                .for_each(|each| each.cloud_from_board *= exp(&twist(&Vector3::zeros(), &Vector3::new(2.0, 0.6, 0.0))));
        }),
        (FindingCode::Flipped, &|s| s[5].cloud_from_board *= super::diagnosis::half_turn(&Vector3::new(75.0, 52.5, 0.0))),
        (FindingCode::BadPose, &|s| {
            s[6].cloud_from_board *= exp(&twist(&Vector3::new(0.01, 0.0, 0.0), &Vector3::new(3.0, 0.0, 0.0)))
        }),
    ];
    for (code, spoil) in cases {
        let found = codes(spoil);
        println!("C13 {}: {found:?}", code.as_str());
        assert!(found.contains(&code), "{} not in {found:?}", code.as_str());
    }
}

/// Data of a scanner that stands in the cell, with the board on the flange, given as those of a scanner on the flange: they fit
/// as well with the boards inverted, and inverting them would put the scanner where the board is.
#[test]
fn a_scanner_that_stands_in_the_cell_is_not_taken_for_inverted_boards() {
    let level = levels()[1];
    let stands = ChainEstimate {
        flange_from_cloud: pose(900.0, -300.0, 700.0, [175.0, 10.0, 40.0]),
        base_from_table: Isometry3::identity(),
        plate_from_board: pose(10.0, 5.0, 120.0, [2.0, -1.0, 30.0]),
        scale: 1.0,
    };
    let mut noise = Noise(17);
    // Of this chain the arm's poses are flange_from_base.
    let mut sightings = exact(&stands, 16, 40.0, false, &mut noise);
    disturb(&mut sightings, &level, &mut noise);
    let own = Task { setup: HandEyeSetup::EyeToHand, ..task(sightings.clone(), Solve::HandEye, Some(level)) };
    assert!(own.calibrate().is_ok(), "as they are");
    sightings.iter_mut().for_each(|each| each.base_from_flange = each.base_from_flange.inverse());
    let said_to_stand = Task { setup: HandEyeSetup::EyeToHand, ..task(sightings.clone(), Solve::HandEye, Some(level)) };
    let findings = said_to_stand.calibrate().expect_err("the arm's poses are inverted");
    assert_eq!(findings[0].code, FindingCode::OtherSetup);
    assert!(findings[0].figures.vector.is_none(), "it is no advice to give the setup that was given");
    let findings = task(sightings, Solve::HandEye, Some(level)).calibrate().expect_err("another setup");
    let codes: Vec<_> = findings.iter().map(|finding| finding.code).collect();
    assert_eq!(codes, [FindingCode::OtherSetup]);
    let place_mm = findings[0].figures.vector.expect("the scanner's place");
    assert!((place_mm - stands.flange_from_cloud.translation.vector).norm() < 5.0, "{place_mm}");
}

/// Squares that are smaller than was given put the scanner off along its view by many of its standard deviations, and leave
/// residuals that are small: nothing was told.
#[test]
fn a_board_of_another_size_than_was_given_is_told_with_its_size() {
    let level = levels()[0];
    for (solve, sigma) in [(Solve::HandEye, Some(level)), (Solve::HandEye, None), (Solve::Joint, Some(level))] {
        let is_still = solve == Solve::HandEye;
        let at = if is_still { ChainEstimate { base_from_table: Isometry3::identity(), ..truth() } } else { truth() };
        for (ratio, is_told) in [(1.0, false), (1.002, true)] {
            let mut noise = Noise(41);
            let mut sightings = exact(&at, 24, 40.0, !is_still, &mut noise);
            disturb(&mut sightings, &level, &mut noise);
            sightings.iter_mut().for_each(|each| each.cloud_from_board.translation.vector *= ratio);
            let found = task(sightings, solve, sigma).calibrate().unwrap_or_else(|findings| panic!("{findings:?}"));
            let scale = found.board_scale.expect("a scale");
            println!("board × {ratio}, {}: {:.5} ± {:.5}", solve.as_str(), scale.ratio, scale.sd);
            assert!((scale.ratio - ratio).abs() < 1e-3 && scale.sd < 6e-4, "{scale:?}");
            let finding = found.findings.iter().find(|finding| finding.code == FindingCode::BoardScale);
            assert_eq!(finding.is_some(), is_told, "{:?}", found.findings);
            let likely_mm = finding.map(|finding| finding.figures.other_length_mm.expect("a size"));
            assert!(likely_mm.is_none_or(|likely_mm| (likely_mm - 10.0 / ratio).abs() < 0.01), "{likely_mm:?}");
        }
    }
}

/// A scale on its way to the right one was told as the board's.
#[test]
fn a_scale_of_the_board_that_has_not_converged_tells_no_size() {
    let (level, mut noise) = (levels()[0], Noise(41));
    let at = ChainEstimate { base_from_table: Isometry3::identity(), ..truth() };
    let mut sightings = exact(&at, 24, 40.0, false, &mut noise);
    disturb(&mut sightings, &level, &mut noise);
    sightings.iter_mut().for_each(|each| each.cloud_from_board.translation.vector *= 1.002);
    let task = task(sightings, Solve::HandEye, Some(level));
    let mut scale = task.calibrate().unwrap_or_else(|findings| panic!("{findings:?}")).board_scale.expect("a scale");
    assert!(scale.is_converged && scale.rounds < 10, "{scale:?}");
    let told = |scale: &super::board_scale::BoardScale| {
        let finding = task.judge_board(scale).expect("a finding");
        (finding.code, finding.figures.count)
    };
    assert_eq!(told(&scale), (FindingCode::BoardScale, None));
    (scale.is_converged, scale.rounds) = (false, 10);
    assert_eq!(told(&scale), (FindingCode::BoardScaleNotConverged, Some(10)));
}

/// The shift was told for 180 mm, the distance from the origin of clouds 300 mm before the scanner to the best focus.
#[test]
fn the_shift_by_a_board_of_another_size_is_told_by_the_distance_from_the_scanner() {
    let (level, ratio) = (levels()[0], 1.002);
    let at = ChainEstimate { base_from_table: Isometry3::identity(), ..truth() };
    let cloud_from_scanner = pose(0.0, 0.0, -300.0, [0.0; 3]);
    let mut noise = Noise(41);
    let mut sightings = exact(&at, 24, 40.0, false, &mut noise);
    disturb(&mut sightings, &level, &mut noise);
    for each in &mut sightings {
        each.cloud_from_board.translation.vector *= ratio;
        each.cloud_from_board = cloud_from_scanner * each.cloud_from_board;
    }
    let best_in_cloud_mm = Vector3::new(0.0, 0.0, 180.0);
    let of_clouds = Task { best_in_cloud_mm, ..task(sightings, Solve::HandEye, Some(level)) };
    let found = of_clouds.calibrate().unwrap_or_else(|findings| panic!("{findings:?}"));
    let scale = found.board_scale.expect("a scale");
    assert!((scale.ratio - ratio).abs() < 1e-3, "{scale:?}");
    let (_, shifted_mm) = off(&found.refined.estimate.flange_from_cloud, &(at.flange_from_cloud * cloud_from_scanner.inverse()));
    assert!((shifted_mm - 0.96).abs() < 0.25, "0.002 of 480 mm: {shifted_mm}");
    assert!((scale.shift_mm() - (scale.ratio - 1.0).abs() * 480.0).abs() < 1e-9, "{scale:?}");
    assert!((scale.shift_sd_mm() - scale.sd * 480.0).abs() < 1e-9, "{scale:?}");
}

/// Deviations that nobody gave were told to be estimated, where too few observations left those that an estimate begins with.
#[test]
fn deviations_of_few_observations_are_assumed_and_not_estimated() {
    let (truth, level) = (ChainEstimate { base_from_table: Isometry3::identity(), ..truth() }, levels()[1]);
    let sources = |count: usize, sigma: Option<Sigma>| {
        let mut noise = Noise(11);
        let mut sightings = exact(&truth, count, 40.0, false, &mut noise);
        disturb(&mut sightings, &level, &mut noise);
        let limits = UncertaintyLimits { max_mm: 5.0, max_rad: 0.1, warn_mm: 5.0 };
        let task = Task { limits, ..task(sightings, Solve::HandEye, sigma) };
        task.calibrate().unwrap_or_else(|findings| panic!("{findings:?}")).sigma_sources
    };
    assert_eq!(sources(5, None), [SigmaSource::Assumed; 2]);
    assert_eq!(sources(16, None), [SigmaSource::Estimated; 2]);
    assert_eq!(sources(16, Some(level)), [SigmaSource::Given; 2]);
    assert_eq!(sources(16, Some(level.scaled(0.01))), [SigmaSource::Enlarged; 2]);
}

/// A table that turns the other way, or by another ratio.
#[test]
fn sense_and_ratio_of_the_table_are_told() {
    let (truth, level) = (truth(), levels()[1]);
    for (scale, code) in [(-1.0, FindingCode::TableSign), (1.01, FindingCode::TableScale)] {
        let mut noise = Noise(21);
        let mut sightings = exact(&ChainEstimate { scale, ..truth }, 16, 40.0, true, &mut noise);
        disturb(&mut sightings, &level, &mut noise);
        let found = task(sightings, Solve::Joint, None).calibrate();
        let codes: Vec<_> =
            found.map_or_else(|findings| findings, |found| found.findings).iter().map(|finding| finding.code).collect();
        println!("C13 {}: {codes:?}", code.as_str());
        assert_eq!(codes, [code], "and nothing beside it");
    }
}

/// A table that went the other way over negative angles alone was told to have reported 0°.
#[test]
fn the_sense_of_a_table_is_told_by_an_angle_near_a_quarter_turn() {
    let (truth, mut noise) = (truth(), Noise(21));
    let mut sightings = exact(&ChainEstimate { scale: -1.0, ..truth }, 24, 40.0, true, &mut noise);
    disturb(&mut sightings, &levels()[1], &mut noise);
    sightings.retain(|each| each.table_rad < 0.0);
    let findings = task(sightings, Solve::Joint, None).calibrate().expect_err("the other way");
    let told = findings.iter().find(|finding| finding.code == FindingCode::TableSign).expect("the sense").figures;
    let (asked, found) = (told.turn_rad.expect("an angle"), told.other_turn_rad.expect("an angle"));
    assert!((asked + std::f64::consts::FRAC_PI_2).abs() < 1e-9 && (found + asked).abs() < 1e-12, "{asked} {found}");
}

/// Error motion planted in a table: 0.06 mm across and 0.05 mm along the axis, 0.01° of tilt, and a second harmonic.
fn planted_runout() -> Vec<RunoutHarmonic> {
    let tilt = 0.01_f64.to_radians();
    vec![
        RunoutHarmonic { order: 1, cos: [tilt, 0.0, 0.06, 0.0, 0.05], sin: [0.0, -tilt, 0.0, -0.06, 0.0] },
        RunoutHarmonic { order: 2, cos: [0.0, 0.0, 0.0, 0.04, 0.0], sin: [0.0, 0.0, 0.03, 0.0, -0.02] },
    ]
}

/// Observations of a table with this runout.
fn with_runout(
    truth: &ChainEstimate,
    count: usize,
    runout: &[RunoutHarmonic],
    level: &Sigma,
    noise: &mut Noise,
) -> Vec<Sighting> {
    let mut sightings = exact(truth, count, 40.0, true, noise);
    for each in &mut sightings {
        each.base_from_flange = truth.base_from_table
            * error_motion(runout, each.table_rad)
            * truth.base_from_table.inverse()
            * each.base_from_flange;
    }
    disturb(&mut sightings, level, noise);
    sightings
}

/// Largest distance of a point on the plate from where it is, in the gauge of the estimate, mm.
fn plate_off(found: &ChainEstimate, runout: &[RunoutHarmonic], truth: &ChainEstimate, planted: &[RunoutHarmonic]) -> f64 {
    let place = |at: &ChainEstimate, runout: &[RunoutHarmonic], angle: f64| {
        at.base_from_table
            * error_motion(runout, angle)
            * Isometry3::rotation(Vector3::z() * angle)
            * at.plate_from_board
            * nalgebra::Point3::origin()
    };
    let steps = (0..36).map(|step| f64::from(step) * 10.0_f64.to_radians());
    steps.map(|angle| (place(found, runout, angle) - place(truth, planted, angle)).norm()).fold(0.0, f64::max)
}

/// Runout is found where there is some, is not claimed where there is none, and takes its part of the error away.
#[test]
#[ignore = "long: tests/all runs it"]
fn runout_is_identified_as_harmonics() {
    let (truth, level, planted) = (truth(), levels()[0], planted_runout());
    let (mut with, mut without, mut claimed) = (Vec::new(), Vec::new(), 0);
    let runs = 40;
    for run in 0..runs {
        let mut noise = Noise(70_000 + run);
        let sightings = with_runout(&truth, 30, &planted, &level, &mut noise);
        let found = task(sightings.clone(), Solve::Joint, None).calibrate().expect("a calibration");
        with.push(plate_off(&found.refined.estimate, &found.runout, &truth, &planted));
        let start = start_joint(&sightings, &truth.base_from_table).expect("a start");
        let problem = Adjustment { sightings: &sightings, free: Free::JOINT, prior: None };
        let plain = problem.refine_with_sigma(&start, &in_hand(level)).expect("refines");
        without.push(plate_off(&plain.estimate, &[], &truth, &planted));
        let clean = with_runout(&truth, 30, &[], &level, &mut noise);
        let clean = task(clean, Solve::Joint, None).calibrate().expect("a calibration");
        claimed += usize::from(!clean.runout.is_empty());
    }
    let (with, without) = (quantile_of(with, 0.5), quantile_of(without, 0.5));
    println!("runout: {with:.4} mm off with it, {without:.4} mm without; claimed in {claimed} of {runs} without any");
    assert!(with < 0.04 && without > 0.1 && claimed <= 1, "{with} {without} {claimed}");
}

/// The plate's face puts the table's origin into it, and its deviation is that of the errors.
#[test]
fn the_height_of_the_plate_is_found() {
    let (truth, level) = (truth(), levels()[1]);
    let (runs, mut squares, mut errors) = (100, 0.0, Vec::new());
    for run in 0..runs {
        let mut noise = Noise(90_000 + run);
        let mut sightings = exact(&truth, 15, 40.0, true, &mut noise);
        disturb(&mut sightings, &level, &mut noise);
        // The nominal height is 1 mm off; the face is scanned from one pose at which the arm is exact.
        let mut task = task(sightings, Solve::Joint, Some(level));
        task.nominal.base_from_table =
            truth.base_from_table * exp(&twist(&Vector3::new(0.004, -0.003, 0.0), &Vector3::new(1.0, -0.5, -1.0)));
        let seen =
            Isometry3::from_parts(Translation3::new(0.0, 0.0, 480.0), UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 3.0));
        let base_from_flange = truth.base_from_plate(0.0) * seen.inverse() * truth.flange_from_cloud.inverse();
        task.face = (0..200)
            .map(|_| {
                let on_plate = nalgebra::Point3::new(noise.between(-80.0, 80.0), noise.between(-80.0, 80.0), 0.0);
                let cloud_mm =
                    truth.flange_from_cloud.inverse() * base_from_flange.inverse() * truth.base_from_plate(0.0) * on_plate;
                let cloud_mm = cloud_mm + Vector3::new(0.0, 0.0, 0.02 * noise.normal());
                FacePoint { base_from_flange, table_rad: 0.0, cloud_mm }
            })
            .collect();
        let found = task.calibrate().expect("a calibration");
        let located = found.face.expect("a face");
        // Height of the true face's middle above the found table.
        let off = (found.refined.estimate.base_from_table.inverse()
            * nalgebra::Point3::from(truth.base_from_table.translation.vector))
        .z;
        errors.push(off.abs());
        squares += (off / located.height_sd_mm).powi(2) / f64::from(runs as u32);
        // Nothing that was observed changes by the lift.
        let residual = found.residuals.iter().map(|each| translation_of(each).norm()).fold(0.0, f64::max);
        assert!(residual < 1.5, "{residual}");
    }
    println!("plate height: median {:.4} mm off, normalised square {squares:.2}", quantile_of(errors.clone(), 0.5));
    assert!(quantile_of(errors, 0.95) < 0.3 && (0.6..=1.5).contains(&squares), "{squares}");
}

/// A minimisation that is cut short says so, and the finding is a warning; one that may end says that it did.
#[test]
fn a_refinement_that_ends_at_its_limit_of_iterations_says_so() {
    let (truth, weighting, mut noise) = (truth(), in_hand(levels()[1]), Noise(5));
    let mut sightings = exact(&truth, 12, 40.0, true, &mut noise);
    disturb(&mut sightings, &levels()[1], &mut noise);
    let off = twist(&Vector3::new(0.3, -0.2, 0.1), &Vector3::zeros());
    let start = ChainEstimate { flange_from_cloud: truth.flange_from_cloud * exp(&off), ..truth };
    let problem = Adjustment { sightings: &sightings, free: Free::JOINT, prior: None };
    let weights = problem.weights(&start, &weighting).expect("weights");
    let ended = |iterations| problem.minimise(&start, &weights, iterations).expect("a place").is_converged;
    assert!(!ended(1) && ended(60), "one iteration does not do");
    let refined = problem.refine(&start, &weighting).expect("refines");
    assert!(refined.not_converged().is_none());
    let cut = super::refine::Refined { is_converged: false, ..refined };
    let finding = cut.not_converged().expect("a finding");
    assert_eq!((finding.code, finding.severity), (FindingCode::NotConverged, Severity::Warning));
}
