//! Faults of the observations themselves: found before the adjustment in what was given, and after it in what was dropped.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

use super::data::{ChainEstimate, HandEyeSetup, Sighting, Solve};
use super::findings::{CalibrationFinding, Figures, FindingCode, Severity, Subject};
use super::refine::{Free, Refined};
use super::se3::{log, mean_pose, rotation_of, translation_of};
use super::start::{park_martin, start_joint};

/// Poses nearer to each other are the same: 0.01 mm and 0.001°.
const SAME_MM: f64 = 0.01;
const SAME_RAD: f64 = 2e-5;
/// Ratio of lengths that no motion of an arm explains: between 1000 and what a board near or far makes of it.
const UNIT_RATIO: f64 = 100.0;
/// Ratio of all lengths to the scanner's best focus from which on they are in another unit: centimetres are the nearest, with 10.
const ALL_UNIT_RATIO: f64 = 8.0;
/// Factor by which another reading of the data has to fit better.
pub(super) const CLEARLY: f64 = 5.0;
/// Distance from the nominal scanner on the flange beyond which the scanner stands elsewhere, mm: no drawing of a mount is so
/// wrong.
const ELSEWHERE_MM: f64 = 100.0;
/// Residual beyond which another reading is looked for, mm, and beyond which observations that tell nothing contradict each other.
pub(super) const POOR_MM: f64 = 3.0;
/// Observations that a reading is tried on: all pairs are used.
const MAX_TRIED: usize = 100;
/// Numbers that the observations tell beyond the unknowns, those of two observations, from which on a reading that fits clearly better is
/// hardly one by chance. Of sets of four joint observations whose boards were exchanged at random, a cause was named for 19 of 100 without
/// this bound, and of sets of three with a table of their own for 1 (simulated).
const MIN_FREEDOM: usize = 12;
/// Units of length that are mixed up with millimetres, mm.
const UNITS_MM: [f64; 3] = [10.0, 25.4, 1000.0];
/// Turn within which a board counts as turned by half a turn, rad (3°).
const HALF_TURN_RAD: f64 = 0.052;
/// Smallest correlation of residuals with a joint that is worth a remark, and the fewest observations that can tell.
const MIN_CORRELATION: f64 = 0.7;
const MIN_FOR_CORRELATION: usize = 12;
/// Standard deviations of the normal distribution that a correlation by chance exceeds in 1 of 10 000 cases, either way: twelve are looked
/// at. With the smallest correlation alone a joint was named in 10 of 100 sets of twelve observations that depend on none (simulated).
const DEVIATIONS_OF_CORRELATION: f64 = 3.89;

/// Observations that are given twice, and those whose lengths are in another unit.
#[must_use]
pub(super) fn before(sightings: &[Sighting], trial: &ReadingTrial<'_>) -> Vec<CalibrationFinding> {
    let mut found = duplicates(sightings);
    found.extend(units(sightings, trial));
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
fn units(sightings: &[Sighting], trial: &ReadingTrial<'_>) -> Vec<CalibrationFinding> {
    let (mut found, best_mm) = (Vec::new(), trial.best_in_cloud_mm.norm());
    for subject in [Subject::Board, Subject::Flange] {
        let lengths: Vec<f64> = sightings.iter().map(|each| place(each, subject).norm()).collect();
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
        let length_mm = if is_all { trial.unit(sightings, subject) } else { None };
        let subject = Some(subject);
        let figures =
            Figures { ratio: Some(ratio), count: is_all.then_some(off.len()), length_mm, subject, ..Figures::default() };
        let about: Vec<_> = off.iter().map(|index| sightings[*index].id.clone()).collect();
        let severity = if is_all { Severity::Error } else { Severity::Warning };
        found.push(CalibrationFinding::new(FindingCode::UnitMismatch, severity).about(about).with(figures));
    }
    found
}

/// Place of the board in the cloud, or of the flange in the base.
fn place(sighting: &Sighting, subject: Subject) -> Vector3<f64> {
    match subject {
        Subject::Board => sighting.cloud_from_board.translation.vector,
        Subject::Flange | Subject::Table => sighting.base_from_flange.translation.vector,
    }
}

/// The observation with the lengths of one of its poses times a factor.
fn rescaled(sighting: &Sighting, subject: Subject, factor: f64) -> Sighting {
    let mut read = sighting.clone();
    match subject {
        Subject::Board => read.cloud_from_board.translation.vector *= factor,
        Subject::Flange | Subject::Table => read.base_from_flange.translation.vector *= factor,
    }
    read
}

/// Fewest observations that tell a cause beside so many unknowns.
pub(super) fn least_observations(unknowns: usize) -> usize {
    (unknowns + MIN_FREEDOM).div_ceil(6)
}

/// Fewest observations from which on every reading can be told: one out of step leaves an observation out, and the table may be unknown.
pub(super) fn least_of_readings(solve: Solve) -> usize {
    let free = if solve == Solve::HandEye { Free::HAND_EYE } else { Free::JOINT };
    least_observations(free.count()) + 1
}

/// Observations read in another way.
type Read<'a> = Box<dyn Fn(&[Sighting]) -> Vec<Sighting> + 'a>;

/// Another reading of the data: what it is called, and the data so read.
struct Reading<'a> {
    code: FindingCode,
    subject: Option<Subject>,
    unit_mm: Option<f64>,
    /// Unknowns that it is a reading for.
    solve: Solve,
    read: Read<'a>,
}

impl<'a> Reading<'a> {
    /// Reading of each observation by itself.
    fn of_each(code: FindingCode, subject: Subject, solve: Solve, read: impl Fn(&Sighting) -> Sighting + 'a) -> Self {
        let read = Box::new(move |sightings: &[Sighting]| sightings.iter().map(&read).collect());
        Self { code, subject: Some(subject), unit_mm: None, solve, read }
    }

    /// Reading of observations one part of which belongs to the observation before or after.
    fn out_of_step(subject: Subject, solve: Solve, is_late: bool) -> Self {
        let read = Box::new(move |sightings: &[Sighting]| {
            let pairs = sightings.windows(2).map(|pair| if is_late { (&pair[0], &pair[1]) } else { (&pair[1], &pair[0]) });
            pairs.map(|(each, other)| exchanged(each, other, subject)).collect()
        });
        Self { code: FindingCode::OutOfStep, subject: Some(subject), unit_mm: None, solve, read }
    }
}

/// The observation with one part of another.
fn exchanged(each: &Sighting, other: &Sighting, subject: Subject) -> Sighting {
    match subject {
        Subject::Board => Sighting { cloud_from_board: other.cloud_from_board, ..each.clone() },
        Subject::Flange => Sighting { base_from_flange: other.base_from_flange, ..each.clone() },
        Subject::Table => Sighting { table_rad: other.table_rad, ..each.clone() },
    }
}

/// Pose whose rotation was written the other way round.
fn transposed(pose: &Isometry3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(pose.translation, pose.rotation.inverse())
}

/// Pose whose quaternion was written with the scalar part first, and read with it last.
fn scalar_first(pose: &Isometry3<f64>) -> Isometry3<f64> {
    let read = pose.rotation.quaternion();
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(read.i, read.j, read.k, read.w));
    Isometry3::from_parts(pose.translation, rotation)
}

/// Chain that readings of the observations are tried on.
pub(super) struct ReadingTrial<'a> {
    /// Place of the scanner.
    pub(super) setup: HandEyeSetup,
    /// Unknowns.
    pub(super) solve: Solve,
    /// The cell as it was specified.
    pub(super) nominal: &'a ChainEstimate,
    /// Point of best focus in the cloud, mm.
    pub(super) best_in_cloud_mm: &'a Vector3<f64>,
    /// Angles of the table that were given with a board that is said to stand still.
    pub(super) turned_rad: &'a [f64],
}

impl ReadingTrial<'_> {
    /// Readings that people mix up, tried on observations that fit badly: one that fits clearly better. Inverted boards and inverted
    /// arms fit alike, as G·X·C = Y is G⁻¹·Y·C⁻¹ = X, so no residual tells them apart. The scanner does: it sees boards near its best
    /// focus, and boards that lie there as given are not inverted. Of the other readings that fit alike the one is meant whose
    /// scanner is nearest to the nominal one. A nominal table that is far off hides which one fits: then each reading finds its own.
    /// Readings that leave too few observations beside their unknowns are not tried: some fit whatever was read.
    #[must_use]
    pub(super) fn other_reading(&self, sightings: &[Sighting]) -> Option<CalibrationFinding> {
        [false, true].into_iter().find_map(|finds_table| self.reading_that_fits(sightings, finds_table))
    }

    fn reading_that_fits(&self, sightings: &[Sighting], finds_table: bool) -> Option<CalibrationFinding> {
        let (as_given_mm, _) = self.misfit(sightings, self.solve, finds_table)?;
        if as_given_mm < POOR_MM {
            return None;
        }
        let without_an_end_mm = self.misfit_without_an_end(sightings, finds_table).min(as_given_mm);
        let tried = self.readings().into_iter().filter_map(|reading| {
            // A reading out of step drops a part at either end: it tells nothing where that observation alone was bad.
            let as_given_mm = if reading.code == FindingCode::OutOfStep { without_an_end_mm } else { as_given_mm };
            let has_own_table = finds_table && reading.solve != Solve::HandEye;
            let free = if has_own_table { Free::JOINT } else { Free::HAND_EYE };
            let least = least_observations(free.count());
            let read = Some((reading.read)(sightings)).filter(|read| read.len() >= least)?;
            let (other_mm, hand_eye) = self.misfit(&read, reading.solve, finds_table)?;
            let away_mm = (hand_eye.translation.vector - self.nominal.flange_from_cloud.translation.vector).norm();
            (other_mm * CLEARLY < as_given_mm).then_some((away_mm, other_mm, reading, hand_eye.translation.vector))
        });
        let tried: Vec<_> = tried.collect();
        let is_other_setup = tried.iter().any(|(_, _, reading, _)| reading.code == FindingCode::OtherSetup);
        let is_inverted = !(is_other_setup && is_seen_as_given(sightings, self.best_in_cloud_mm));
        let best_mm = tried.iter().map(|(_, other_mm, ..)| *other_mm).fold(f64::INFINITY, f64::min).max(SAME_MM);
        let fit_alike = tried.into_iter().filter(|(_, other_mm, ..)| *other_mm <= CLEARLY * best_mm);
        let meant = fit_alike.filter(|(_, _, reading, _)| is_inverted || reading.code != FindingCode::Inverted);
        let (away_mm, other_mm, reading, place_mm) = meant.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let Reading { code, subject, unit_mm, .. } = reading;
        // Data of a scanner that is said to stand in the cell put it elsewhere too, where flange_from_base was given.
        let is_elsewhere = code == FindingCode::OtherSetup && self.setup == HandEyeSetup::EyeInHand && away_mm > ELSEWHERE_MM;
        let vector = is_elsewhere.then_some(place_mm);
        let figures = Figures { vector, subject, ..Figures::default() };
        let figures = match unit_mm {
            Some(unit_mm) => Figures { length_mm: Some(unit_mm), count: Some(sightings.len()), ..figures },
            None => Figures { length_mm: Some(as_given_mm), other_length_mm: Some(other_mm), ..figures },
        };
        Some(CalibrationFinding::new(code, Severity::Error).with(figures))
    }

    /// Misfit of the observations as given without the first or the last of them, whichever is less, mm; infinite where too few are left.
    fn misfit_without_an_end(&self, sightings: &[Sighting], finds_table: bool) -> f64 {
        let free = if finds_table && self.solve != Solve::HandEye { Free::JOINT } else { Free::HAND_EYE };
        let fewer = sightings.len().saturating_sub(1);
        if fewer < least_observations(free.count()) {
            return f64::INFINITY;
        }
        let misfits = [&sightings[1..], &sightings[..fewer]].map(|some| self.misfit(some, self.solve, finds_table));
        misfits.into_iter().flatten().map(|(mm, _)| mm).fold(f64::INFINITY, f64::min)
    }

    /// Every reading but the one as given.
    fn readings(&self) -> Vec<Reading<'_>> {
        let solve = self.solve;
        let board = move |code: FindingCode, read: fn(&Isometry3<f64>) -> Isometry3<f64>| {
            Reading::of_each(code, Subject::Board, solve, move |each| Sighting {
                cloud_from_board: read(&each.cloud_from_board),
                ..each.clone()
            })
        };
        let is_inverted = self.setup == HandEyeSetup::EyeToHand;
        let flange = move |code: FindingCode, read: fn(&Isometry3<f64>) -> Isometry3<f64>| {
            Reading::of_each(code, Subject::Flange, solve, move |each| {
                // As it was given: with the scanner standing still the arm's pose is inverted.
                let given = &each.base_from_flange;
                let base_from_flange = if is_inverted { read(&given.inverse()).inverse() } else { read(given) };
                Sighting { base_from_flange, ..each.clone() }
            })
        };
        let mut readings = vec![
            board(FindingCode::Inverted, |pose| pose.inverse()),
            flange(FindingCode::OtherSetup, |pose| pose.inverse()),
            board(FindingCode::Transposed, transposed),
            flange(FindingCode::Transposed, transposed),
            board(FindingCode::QuaternionOrder, scalar_first),
            flange(FindingCode::QuaternionOrder, scalar_first),
        ];
        for (subject, unit_mm) in [Subject::Board, Subject::Flange].into_iter().flat_map(|of| UNITS_MM.map(|unit| (of, unit))) {
            let read = Reading::of_each(FindingCode::UnitMismatch, subject, solve, move |each| rescaled(each, subject, unit_mm));
            readings.push(Reading { unit_mm: Some(unit_mm), ..read });
        }
        // With a board that stands still, boards a row early are arms a row late.
        let parts =
            if solve == Solve::HandEye { &[Subject::Board][..] } else { &[Subject::Board, Subject::Table, Subject::Flange] };
        readings.extend(parts.iter().flat_map(|part| [false, true].map(|is_late| Reading::out_of_step(*part, solve, is_late))));
        if solve == Solve::HandEye && !self.turned_rad.is_empty() {
            let read = Box::new(|sightings: &[Sighting]| {
                let turned = sightings.iter().zip(self.turned_rad);
                turned.map(|(each, table_rad)| Sighting { table_rad: *table_rad, ..each.clone() }).collect()
            });
            readings.push(Reading { code: FindingCode::BoardTurned, subject: None, unit_mm: None, solve: Solve::Joint, read });
        }
        readings
    }

    /// Unit of lengths that agrees clearly better with the other lengths of the observations, mm. The distance of the scanner alone
    /// does not tell the unit of the arm, whose flange may be twice as far away. None where none does.
    fn unit(&self, sightings: &[Sighting], subject: Subject) -> Option<f64> {
        let fits = |finds_table: bool| {
            let (as_given_mm, _) = self.misfit(sightings, self.solve, finds_table)?;
            let tried = UNITS_MM.into_iter().filter_map(|unit_mm| {
                let read: Vec<Sighting> = sightings.iter().map(|each| rescaled(each, subject, unit_mm)).collect();
                Some((self.misfit(&read, self.solve, finds_table)?.0, unit_mm))
            });
            let (_, unit_mm) = tried.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(off_mm, _)| off_mm * CLEARLY < as_given_mm)?;
            Some(unit_mm)
        };
        [false, true].into_iter().find_map(fits)
    }

    /// Median distance of the boards from their mean, mm, with the closed form of the hand-eye, and that: with the nominal table, or
    /// with the one that the observations tell.
    fn misfit(&self, sightings: &[Sighting], solve: Solve, finds_table: bool) -> Option<(f64, Isometry3<f64>)> {
        let every = sightings.len().div_ceil(MAX_TRIED).max(1);
        let some: Vec<Sighting> = sightings.iter().step_by(every).cloned().collect();
        let is_known = solve == Solve::HandEye || !finds_table;
        let table = if is_known { *self.nominal } else { start_joint(&some, &self.nominal.base_from_table)? };
        let plate = |table_rad: f64| match solve {
            Solve::HandEye => Isometry3::identity(),
            Solve::Table | Solve::Joint => table.base_from_plate(table_rad),
        };
        misfit(&some, &plate)
    }
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

/// Causes for which observations were dropped: flipped, swapped, moved together, or just bad. `bound` is the whitened square up to which
/// one that was not used agrees, the same by which they were dropped.
#[must_use]
pub(super) fn dropped(refined: &Refined, sightings: &[Sighting], is_used: &[bool], bound: f64) -> Vec<CalibrationFinding> {
    let mut open: Vec<usize> = (0..sightings.len()).filter(|index| !is_used[*index]).collect();
    let mut found = Vec::new();
    open.retain(|index| match flipped(&refined.estimate, &sightings[*index]) {
        true => {
            found.push(CalibrationFinding::new(FindingCode::Flipped, Severity::Warning).about([sightings[*index].id.clone()]));
            false
        }
        false => true,
    });
    found.extend(swapped(refined, sightings, &mut open, bound));
    found.extend(moved_together(refined, sightings, &mut open, bound));
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
fn swapped(refined: &Refined, sightings: &[Sighting], open: &mut Vec<usize>, bound: f64) -> Vec<CalibrationFinding> {
    let fits = |robot: usize, seen: usize| {
        let exchanged = Sighting { cloud_from_board: sightings[seen].cloud_from_board, ..sightings[robot].clone() };
        refined.chi2_of_other(&exchanged) < bound
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
fn moved_together(refined: &Refined, sightings: &[Sighting], open: &mut Vec<usize>, bound: f64) -> Option<CalibrationFinding> {
    if open.len() < 3 {
        return None;
    }
    let at = &refined.estimate;
    let board = |index: &usize| {
        let each = &sightings[*index];
        at.base_from_plate(each.table_rad).inverse() * each.base_from_flange * at.flange_from_cloud * each.cloud_from_board
    };
    let other = ChainEstimate { plate_from_board: mean_pose(&open.iter().map(board).collect::<Vec<_>>()), ..*at };
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
    // The inverse hyperbolic tangent of a correlation by chance is normal, with the deviation 1/√(n − 3) (R. A. Fisher, *On the probable
    // error of a coefficient of correlation*, Metron 1, 1921).
    let by_chance = (DEVIATIONS_OF_CORRELATION / (residuals_mm.len() as f64 - 3.0).sqrt()).tanh();
    (ratio > MIN_CORRELATION.max(by_chance)).then(|| CalibrationFinding::new(FindingCode::ArmModel, Severity::Note).with(figures))
}

/// Pearson's correlation; 0 where one of the two does not change.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let pairs = || a.iter().zip(b).map(|(x, y)| (x - mean_a, y - mean_b));
    let (xy, xx, yy) = pairs().fold((0.0, 0.0, 0.0), |(xy, xx, yy), (x, y)| (xy + x * y, xx + x * x, yy + y * y));
    if xx * yy > 0.0 { xy / (xx * yy).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A joint was named by a correlation that one in ten sets of twelve observations has by chance.
    #[test]
    fn residuals_of_few_observations_grow_with_a_joint_only_where_chance_does_not_explain_it() {
        let told = |count: usize, off: f64| {
            let angles = (0..count).map(|index| index as f64 / (count - 1) as f64);
            let residuals_mm: Vec<f64> =
                angles.clone().enumerate().map(|(index, rad)| 1.0 + rad + if index % 4 < 2 { off } else { -off }).collect();
            let joints_rad: Vec<[f64; 6]> = angles.map(|rad| [0.0, rad, 0.0, 0.0, 0.0, 0.0]).collect();
            arm_model(&residuals_mm, &joints_rad).map(|finding| finding.figures.joint)
        };
        // Correlations of 0.71, 0.95 and 0.74; by chance those of twelve stay below 0.86, and those of forty below 0.57.
        let [few, clear, many] = [(12, 0.25), (12, 0.1), (40, 0.25)].map(|(count, off)| told(count, off));
        assert_eq!([few, clear, many], [None, Some(Some(2)), Some(Some(2))]);
    }
}
