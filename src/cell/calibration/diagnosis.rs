//! Faults of the observations themselves: found before the adjustment in what was given, and after it in what was dropped.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::data::{ChainEstimate, HandEyeSetup, Sighting};
use super::findings::{CalibrationFinding, Figures, FindingCode, Severity};
use super::refine::Refined;
use super::se3::{log, mean_pose, rotation_of, translation_of};
use super::start::park_martin;

/// Poses nearer to each other are the same: 0.01 mm and 0.001°.
const SAME_MM: f64 = 0.01;
const SAME_RAD: f64 = 2e-5;
/// Ratio of lengths that no motion of an arm explains: between 1000 and what a board near or far makes of it.
const UNIT_RATIO: f64 = 100.0;
/// Ratio of all lengths to the scanner's best focus from which on they are in another unit: centimetres are the nearest, with 10.
const ALL_UNIT_RATIO: f64 = 8.0;
/// Factor by which another reading of the data has to fit better.
const CLEARLY: f64 = 5.0;
/// Distance from the nominal scanner on the flange beyond which the scanner stands elsewhere, mm: no drawing of a mount is so
/// wrong.
const ELSEWHERE_MM: f64 = 100.0;
/// Residual beyond which another reading is looked for, mm.
const POOR_MM: f64 = 3.0;
/// Turn within which a board counts as turned by half a turn, rad (3°).
const HALF_TURN_RAD: f64 = 0.052;
/// Smallest correlation of residuals with a joint that is worth a remark, and the fewest observations that can tell.
const MIN_CORRELATION: f64 = 0.7;
const MIN_FOR_CORRELATION: usize = 12;

/// Observations that are given twice, and those whose lengths are in another unit.
#[must_use]
pub(super) fn before(sightings: &[Sighting], best_mm: f64) -> Vec<CalibrationFinding> {
    let mut found = duplicates(sightings);
    found.extend(units(sightings, best_mm));
    found
}

fn duplicates(sightings: &[Sighting]) -> Vec<CalibrationFinding> {
    let is_same = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
        let by = log(&(a.inverse() * b));
        translation_of(&by).norm() < SAME_MM && rotation_of(&by).norm() < SAME_RAD
    };
    let mut found = Vec::new();
    for (index, each) in sightings.iter().enumerate() {
        let twin = sightings[..index].iter().find(|other| {
            is_same(&other.base_from_flange, &each.base_from_flange)
                && is_same(&other.cloud_from_board, &each.cloud_from_board)
                && (other.table_rad - each.table_rad).abs() < SAME_RAD
        });
        if let Some(twin) = twin {
            let figures = Figures { length_mm: Some(SAME_MM), ..Figures::default() };
            let about = [each.id.clone(), twin.id.clone()];
            found.push(CalibrationFinding::new(FindingCode::DuplicatePose, Severity::Warning).about(about).with(figures));
        }
    }
    found
}

/// Distances that are a thousandth of the others, or of the scanner's best focus where all are.
fn units(sightings: &[Sighting], best_mm: f64) -> Vec<CalibrationFinding> {
    let mut found = Vec::new();
    for lengths in [
        sightings.iter().map(|each| each.cloud_from_board.translation.vector.norm()).collect::<Vec<_>>(),
        sightings.iter().map(|each| each.base_from_flange.translation.vector.norm()).collect(),
    ] {
        let mut sorted = lengths.clone();
        sorted.sort_by(f64::total_cmp);
        let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        // A scanner sees nothing nearer than an eighth of its best focus, and no arm holds its flange in its own foot.
        let is_all = median < best_mm / ALL_UNIT_RATIO;
        let (reference, ratio) = if is_all { (best_mm, ALL_UNIT_RATIO) } else { (median, UNIT_RATIO) };
        let is_off = |length: f64| length < reference / ratio || length > reference * ratio;
        let off: Vec<usize> = (0..lengths.len()).filter(|index| is_off(lengths[*index])).collect();
        if off.is_empty() {
            continue;
        }
        let ratio = reference / lengths[off[0]].max(f64::MIN_POSITIVE);
        let figures = Figures { ratio: Some(ratio), count: is_all.then_some(off.len()), ..Figures::default() };
        let about: Vec<_> = off.iter().map(|index| sightings[*index].id.clone()).collect();
        let severity = if is_all { Severity::Error } else { Severity::Warning };
        found.push(CalibrationFinding::new(FindingCode::UnitMismatch, severity).about(about).with(figures));
    }
    found
}

/// Another reading of the data: what it is called, and the data so read.
type Reading<'a> = (FindingCode, &'a dyn Fn(&Sighting) -> Sighting);

/// Readings that people mix up, tried on observations that fit badly: one that fits clearly better. Inverted boards and inverted
/// arms fit alike, as G·X·C = Y is G⁻¹·Y·C⁻¹ = X, so no residual tells them apart. The scanner does: it sees boards near its best
/// focus, and boards that lie there as given are not inverted. Of the other readings that fit alike the one is meant whose
/// scanner is nearest to the nominal one.
#[must_use]
pub(super) fn other_reading(
    sightings: &[Sighting],
    setup: HandEyeSetup,
    nominal_hand_eye: &Isometry3<f64>,
    best_in_cloud_mm: &Vector3<f64>,
    base_from_plate: &dyn Fn(f64) -> Isometry3<f64>,
) -> Option<CalibrationFinding> {
    let transposed = |pose: &Isometry3<f64>| Isometry3::from_parts(pose.translation, pose.rotation.inverse());
    let readings: [Reading<'_>; 4] = [
        (FindingCode::Inverted, &|each| Sighting { cloud_from_board: each.cloud_from_board.inverse(), ..each.clone() }),
        (FindingCode::OtherSetup, &|each| Sighting { base_from_flange: each.base_from_flange.inverse(), ..each.clone() }),
        (FindingCode::Transposed, &|each| Sighting { cloud_from_board: transposed(&each.cloud_from_board), ..each.clone() }),
        (FindingCode::Transposed, &|each| Sighting { base_from_flange: transposed(&each.base_from_flange), ..each.clone() }),
    ];
    let (as_given_mm, _) = misfit(sightings, base_from_plate)?;
    if as_given_mm < POOR_MM {
        return None;
    }
    let tried = readings.into_iter().filter_map(|(code, read)| {
        let read: Vec<Sighting> = sightings.iter().map(read).collect();
        let (other_mm, hand_eye) = misfit(&read, base_from_plate)?;
        let away_mm = (hand_eye.translation.vector - nominal_hand_eye.translation.vector).norm();
        (other_mm * CLEARLY < as_given_mm).then_some((away_mm, other_mm, code, hand_eye.translation.vector))
    });
    let tried: Vec<_> = tried.collect();
    let is_other_setup = tried.iter().any(|(_, _, code, _)| *code == FindingCode::OtherSetup);
    let is_inverted = !(is_other_setup && is_seen_as_given(sightings, best_in_cloud_mm));
    let best_mm = tried.iter().map(|(_, other_mm, ..)| *other_mm).fold(f64::INFINITY, f64::min).max(SAME_MM);
    let fit_alike = tried.into_iter().filter(|(_, other_mm, ..)| *other_mm <= CLEARLY * best_mm);
    let meant = fit_alike.filter(|(_, _, code, _)| is_inverted || *code != FindingCode::Inverted);
    let (away_mm, other_mm, code, place_mm) = meant.min_by(|a, b| a.0.total_cmp(&b.0))?;
    // Data of a scanner that is said to stand in the cell put it elsewhere too, where flange_from_base was given.
    let is_elsewhere = code == FindingCode::OtherSetup && setup == HandEyeSetup::EyeInHand && away_mm > ELSEWHERE_MM;
    let vector = is_elsewhere.then_some(place_mm);
    let figures = Figures { length_mm: Some(as_given_mm), other_length_mm: Some(other_mm), vector, ..Figures::default() };
    Some(CalibrationFinding::new(code, Severity::Error).with(figures))
}

/// Returns true if the boards as given lie nearer to the point of best focus than the inverses of their poses do.
fn is_seen_as_given(sightings: &[Sighting], best_in_cloud_mm: &Vector3<f64>) -> bool {
    let median_mm = |place: &dyn Fn(&Sighting) -> Vector3<f64>| {
        let mut off_mm: Vec<f64> = sightings.iter().map(|each| (place(each) - best_in_cloud_mm).norm()).collect();
        off_mm.sort_by(f64::total_cmp);
        off_mm.get(off_mm.len() / 2).copied().unwrap_or(0.0)
    };
    median_mm(&|each| each.cloud_from_board.translation.vector)
        < median_mm(&|each| each.cloud_from_board.inverse().translation.vector)
}

/// Median distance of the boards from their mean, mm, with the closed form of the hand-eye, and that.
fn misfit(sightings: &[Sighting], base_from_plate: &dyn Fn(f64) -> Isometry3<f64>) -> Option<(f64, Isometry3<f64>)> {
    let frames: Vec<_> = sightings.iter().map(|each| base_from_plate(each.table_rad).inverse() * each.base_from_flange).collect();
    let seen: Vec<_> = sightings.iter().map(|each| each.cloud_from_board).collect();
    let hand_eye = park_martin(&frames, &seen)?;
    let boards: Vec<_> = frames.iter().zip(&seen).map(|(frame, seen)| frame * hand_eye * seen).collect();
    let mean = mean_pose(&boards);
    let mut off: Vec<f64> = boards
        .iter()
        .map(|board| {
            let by = log(&(mean.inverse() * board));
            translation_of(&by).norm() + 300.0 * rotation_of(&by).norm()
        })
        .collect();
    off.sort_by(f64::total_cmp);
    Some((off.get(off.len() / 2).copied()?, hand_eye))
}

/// Board turned by half a turn about its normal, in its middle: as one without a mark for its orientation is seen.
#[must_use]
pub(super) fn half_turn(middle_mm: &Vector3<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
    Isometry3::from_parts(Translation3::from(middle_mm - turn * middle_mm), turn)
}

/// Causes for which observations were dropped: flipped, swapped, moved together, or just bad.
#[must_use]
pub(super) fn dropped(refined: &Refined, sightings: &[Sighting], is_used: &[bool]) -> Vec<CalibrationFinding> {
    let mut open: Vec<usize> = (0..sightings.len()).filter(|index| !is_used[*index]).collect();
    let mut found = Vec::new();
    open.retain(|index| match flipped(&refined.estimate, &sightings[*index]) {
        true => {
            found.push(CalibrationFinding::new(FindingCode::Flipped, Severity::Warning).about([sightings[*index].id.clone()]));
            false
        }
        false => true,
    });
    found.extend(swapped(refined, sightings, &mut open));
    found.extend(moved_together(refined, sightings, &mut open));
    for index in open {
        let residual = refined.estimate.residual(&sightings[index]);
        let figures = Figures {
            turn_rad: Some(rotation_of(&residual).norm()),
            length_mm: Some(translation_of(&residual).norm()),
            ..Figures::default()
        };
        found.push(
            CalibrationFinding::new(FindingCode::BadPose, Severity::Warning).about([sightings[index].id.clone()]).with(figures),
        );
    }
    found
}

/// Returns true if the residual is half a turn about the board's normal within the board's plane.
fn flipped(at: &ChainEstimate, sighting: &Sighting) -> bool {
    let off = sighting.cloud_from_board.inverse() * at.predicted(sighting);
    let up = off.rotation * Vector3::z();
    let is_half_turn = (off.rotation.angle() - std::f64::consts::PI).abs() < HALF_TURN_RAD;
    is_half_turn && up.z > HALF_TURN_RAD.cos() && off.translation.vector.z.abs() < POOR_MM
}

/// Pairs whose boards fit when they are exchanged.
fn swapped(refined: &Refined, sightings: &[Sighting], open: &mut Vec<usize>) -> Vec<CalibrationFinding> {
    let fits = |robot: usize, seen: usize| {
        let exchanged = Sighting { cloud_from_board: sightings[seen].cloud_from_board, ..sightings[robot].clone() };
        refined.chi2_of_other(&exchanged) < super::chi_squared::quantile(0.0005, 6)
    };
    let mut found = Vec::new();
    for (place, a) in open.clone().into_iter().enumerate() {
        let partner = open.clone().into_iter().skip(place + 1).find(|b| fits(a, *b) && fits(*b, a));
        if let Some(b) = partner.filter(|_| open.contains(&a)) {
            let about = [sightings[a].id.clone(), sightings[b].id.clone()];
            found.push(CalibrationFinding::new(FindingCode::Swapped, Severity::Warning).about(about));
            open.retain(|index| *index != a && *index != b);
        }
    }
    found
}

/// Three or more that agree with each other on another place of the board.
fn moved_together(refined: &Refined, sightings: &[Sighting], open: &mut Vec<usize>) -> Option<CalibrationFinding> {
    if open.len() < 3 {
        return None;
    }
    let at = &refined.estimate;
    let board = |index: &usize| {
        let each = &sightings[*index];
        at.base_from_plate(each.table_rad).inverse() * each.base_from_flange * at.flange_from_cloud * each.cloud_from_board
    };
    let other = ChainEstimate { plate_from_board: mean_pose(&open.iter().map(board).collect::<Vec<_>>()), ..*at };
    let bound = super::chi_squared::quantile(0.0005, 6);
    let of_other = Refined { estimate: other, ..refined.clone() };
    if !open.iter().all(|index| of_other.chi2_of_other(&sightings[*index]) < bound) {
        return None;
    }
    let by = log(&(at.plate_from_board.inverse() * other.plate_from_board));
    let figures =
        Figures { length_mm: Some(translation_of(&by).norm()), turn_rad: Some(rotation_of(&by).norm()), ..Figures::default() };
    let about: Vec<_> = open.drain(..).map(|index| sightings[index].id.clone()).collect();
    Some(CalibrationFinding::new(FindingCode::Moved, Severity::Error).about(about).with(figures))
}

/// Joint with whose angle the residuals grow: correlation of their lengths with its distance from its mean, or with itself.
#[must_use]
pub(super) fn arm_model(residuals_mm: &[f64], joints_rad: &[[f64; 6]]) -> Option<CalibrationFinding> {
    if residuals_mm.len() < MIN_FOR_CORRELATION || residuals_mm.len() != joints_rad.len() {
        return None;
    }
    let of_joint = |joint: usize| {
        let angles: Vec<f64> = joints_rad.iter().map(|joints| joints[joint]).collect();
        let mean = angles.iter().sum::<f64>() / angles.len() as f64;
        let distance: Vec<f64> = angles.iter().map(|angle| (angle - mean).abs()).collect();
        correlation(residuals_mm, &angles).abs().max(correlation(residuals_mm, &distance))
    };
    let (joint, ratio) = (0..6).map(|joint| (joint, of_joint(joint))).max_by(|a, b| a.1.total_cmp(&b.1))?;
    let figures = Figures { joint: Some(joint + 1), ratio: Some(ratio), ..Figures::default() };
    (ratio > MIN_CORRELATION).then(|| CalibrationFinding::new(FindingCode::ArmModel, Severity::Note).with(figures))
}

/// Pearson's correlation; 0 where one of the two does not change.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let pairs = || a.iter().zip(b).map(|(x, y)| (x - mean_a, y - mean_b));
    let (xy, xx, yy) = pairs().fold((0.0, 0.0, 0.0), |(xy, xx, yy), (x, y)| (xy + x * y, xx + x * x, yy + y * y));
    if xx * yy > 0.0 { xy / (xx * yy).sqrt() } else { 0.0 }
}
