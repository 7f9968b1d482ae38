//! One calibration, from observations to a result that says how far it can be trusted: faults of the data, start, screening,
//! refinement, prediction of what was left out, judgement.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, Matrix6, Vector3};

use super::board_scale::{BoardScale, divided};
use super::chi_squared::{exceedance, quantile_of};
use super::data::{ChainEstimate, HandEyeSetup, Sighting, Sigma, SigmaSource, Solve, Weighting};
use super::diagnosis;
use super::findings::{CalibrationFinding, Figures, FindingCode, Severity};
use super::leave_one_out::{LeftOut, Spread, leave_one_out};
use super::observability::{MIN_OBSERVATIONS, Observability, UncertaintyLimits, point_sd_mm};
use super::refine::{Adjustment, Free, Refined};
use super::screening::{Screened, Screening, sigma_or_default};
use super::se3::Twist;
use super::start::{start_fixed, start_joint, start_table};
use super::table::{FacePoint, Harmonic, LocatedFace, identify_runout, lifted, locate_face, merged, runout, without_runout};
use super::watch::{CalibrationStage, CalibrationWatch, Unwatched};
use crate::cell::runout::RunoutHarmonic;

/// Observations below which none can be told to be bad.
const MIN_FOR_SCREENING: usize = 6;
/// Share of the observations that must agree.
const MIN_AGREEING: f64 = 0.5;
/// Share of the observations that agree where a table's ratio is no cause for others to disagree.
const MANY_AGREEING: f64 = 0.8;
/// Deviation of the table's ratio from 1 that is worth a finding.
const SCALE_TOLERANCE: f64 = 1e-3;
/// Probability with which a good observation that was held out is said to disagree.
const HELD_OUT_FALSE_ALARM: f64 = 0.001;
/// Rounds in which the runout is found: the second corrects what the first mixed with the chain.
const RUNOUT_ROUNDS: usize = 2;
/// Turn of the table over all observations below which its axis cannot be told, rad (10°).
const MIN_TABLE_TURN_RAD: f64 = 0.174;

/// Calibration that is to be computed.
#[derive(Clone, Debug)]
pub struct Task {
    /// Observations; the last `hold_out` are kept out.
    pub sightings: Vec<Sighting>,
    /// Joints of the observations, where they are known.
    pub joints_rad: Vec<[f64; 6]>,
    /// Unknowns.
    pub solve: Solve,
    /// Place of the scanner.
    pub setup: HandEyeSetup,
    /// Deviations; none: they are estimated, or assumed where the observations are too few.
    pub sigma: Option<Sigma>,
    /// The cell as it was specified: flange_from_cloud and base_from_table count.
    pub nominal: ChainEstimate,
    /// Observations to hold out.
    pub hold_out: usize,
    /// Point of best focus in the cloud, mm.
    pub best_in_cloud_mm: Vector3<f64>,
    /// Distance of that point from the scanner, mm; the cloud's frame may lie elsewhere.
    pub best_mm: f64,
    /// Middle of the board, where its size is known, mm.
    pub board_middle_mm: Option<Vector3<f64>>,
    /// Edge of a square of the board, or distance between its points, where it is known, mm.
    pub board_pitch_mm: Option<f64>,
    /// Largest uncertainty.
    pub limits: UncertaintyLimits,
    /// Runout of the table that is known already.
    pub runout: Vec<RunoutHarmonic>,
    /// Points of the plate's face; with some the table's origin is put into it.
    pub face: Vec<FacePoint>,
    /// Angles of the table that were given with a board that is said to stand still, rad: one for each observation, or none.
    pub turned_rad: Vec<f64>,
}

/// Part that an observation had.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The observation was used.
    Used,
    /// The observation was dropped; the findings say why.
    Dropped,
    /// The observation was held out.
    HeldOut,
}

/// Outcome.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// Refined unknowns with covariance and deviations.
    pub refined: Refined,
    /// Sources of the deviations of arm and board.
    pub sigma_sources: [SigmaSource; 2],
    /// Scale of the lengths to the board, where the scanner was solved for and enough observations tell it.
    pub board_scale: Option<BoardScale>,
    /// Observations as used: with boards turned back.
    pub sightings: Vec<Sighting>,
    /// Part of each observation.
    pub roles: Vec<Role>,
    /// Residual of each observation, used or not.
    pub residuals: Vec<Twist>,
    /// Whitened square of each: of those not used with the uncertainty of the unknowns.
    pub whitened: Vec<f64>,
    /// Prediction of each used observation from the others, in the order of the observations.
    pub left_out: Vec<Option<LeftOut>>,
    /// Probability of residuals as large or larger.
    pub chi2_p: f64,
    /// Judgement of the motions.
    pub observability: Observability,
    /// Standard deviation of a scanned point at best focus, mm.
    pub point_sd_mm: f64,
    /// Runout of the table: the one that was known with what was found beyond it. The residuals are those beside it.
    pub runout: Vec<RunoutHarmonic>,
    /// Harmonics of the board's place over the angle, before the runout was taken out.
    pub harmonics: Vec<Harmonic>,
    /// Face of the plate, where points of it were given.
    pub face: Option<LocatedFace>,
    /// Remarks; none of them an error.
    pub findings: Vec<CalibrationFinding>,
}

impl Task {
    fn free(&self) -> Free {
        match self.solve {
            Solve::HandEye => Free::HAND_EYE,
            Solve::Table => Free::TABLE,
            Solve::Joint => Free::JOINT,
        }
    }

    fn start(&self, sightings: &[Sighting]) -> Option<ChainEstimate> {
        match self.solve {
            Solve::HandEye => start_fixed(sightings),
            Solve::Table => start_table(sightings, &self.nominal.flange_from_cloud, &self.nominal.base_from_table),
            Solve::Joint => start_joint(sightings, &self.nominal.base_from_table),
        }
    }

    fn weighting(&self) -> Weighting {
        Weighting::new(self.setup, sigma_or_default(self.sigma))
    }

    /// The plate in the base by the nominal table; the identity where the board stands still.
    fn nominal_plate(&self, table_rad: f64) -> Isometry3<f64> {
        let is_still = self.solve == Solve::HandEye;
        if is_still { Isometry3::identity() } else { self.nominal.base_from_plate(table_rad) }
    }

    /// Chain that readings of the observations are tried on.
    pub(super) fn trial(&self) -> diagnosis::ReadingTrial<'_> {
        diagnosis::ReadingTrial {
            setup: self.setup,
            solve: self.solve,
            nominal: &self.nominal,
            best_in_cloud_mm: &self.best_in_cloud_mm,
            turned_rad: &self.turned_rad,
        }
    }

    /// Fewest observations that tell why they disagree, where there are fewer; none with a scanner that is held, for which no other reading
    /// is tried.
    pub(super) fn needed(&self) -> Option<usize> {
        let least = diagnosis::least_of_readings(self.solve);
        (self.solve != Solve::Table && self.sightings.len() < least).then_some(least)
    }

    /// Flange seen from where the board rests.
    fn frames(&self) -> Vec<Isometry3<f64>> {
        self.sightings.iter().map(|each| self.nominal_plate(each.table_rad).inverse() * each.base_from_flange).collect()
    }

    /// Calibrates.
    ///
    /// # Errors
    /// Every finding, if one of them is an error.
    pub fn calibrate(&self) -> Result<Calibration, Vec<CalibrationFinding>> {
        self.calibrate_watched(&Unwatched)
    }

    /// Calibrates, and ends early with the findings so far, perhaps none, where `watch` says so.
    ///
    /// # Errors
    /// Every finding, if one of them is an error, or the calibration was cancelled.
    pub fn calibrate_watched(&self, watch: &dyn CalibrationWatch) -> Result<Calibration, Vec<CalibrationFinding>> {
        watch.begins(CalibrationStage::Diagnosis);
        let mut findings = diagnosis::before(&self.sightings, &self.trial());
        let task = self.prepared(&mut findings)?;
        check(watch, &findings)?;
        watch.begins(CalibrationStage::Screening);
        let screened = task.screened(&mut findings);
        check(watch, &findings)?;
        if let Some(finding) = task.other_ratio(screened.as_ref().ok()) {
            return Err(vec![finding]);
        }
        check(watch, &findings)?;
        watch.begins(CalibrationStage::Table);
        let screened = screened?;
        let harmonics = if task.solve == Solve::HandEye {
            Vec::new()
        } else {
            runout(&screened.refined.estimate, &task.chosen(&screened.is_used))
        };
        let (task, screened) = task.beside_runout(screened);
        check(watch, &findings)?;
        if let Some(finding) = task.contradiction(&screened) {
            findings.insert(0, finding);
            return Err(findings);
        }
        let (task, screened) = task.flipped_back(screened, &mut findings)?;
        check(watch, &findings)?;
        let face = task.located(&screened.refined, &mut findings);
        refuse(&findings)?;
        let lifted = face.map_or(screened.refined.clone(), |located| lifted(&screened.refined, located.face.height_mm));
        watch.begins(CalibrationStage::Judgement);
        let found = task.assemble(&Screened { refined: lifted, ..screened }, findings)?;
        Ok(Calibration { harmonics, face, ..found })
    }

    /// Observations without the runout that they show, and what they tell.
    fn beside_runout(mut self, mut screened: Screened) -> (Self, Screened) {
        for _ in 0..RUNOUT_ROUNDS {
            if self.solve == Solve::HandEye {
                break;
            }
            let sigma_freedom = screened.sigma_freedom(self.sigma.is_some());
            let found = identify_runout(&screened.refined, &self.chosen(&screened.is_used), sigma_freedom);
            let at = screened.refined.estimate;
            let free = |each: &Sighting| without_runout(&at.base_from_table, &found, at.scale, each);
            let task = Self { sightings: self.sightings.iter().map(free).collect(), ..self.clone() };
            let again = if found.is_empty() { None } else { task.screened(&mut Vec::new()).ok() };
            // What makes the observations fit no better is no runout.
            let Some(again) = again.filter(|again| !is_worse(again, &screened)) else { break };
            self = Self { runout: merged(&self.runout, &found), ..task };
            screened = again;
        }
        (self, screened)
    }

    /// Face of the plate. Points that tell none are a finding.
    fn located(&self, refined: &Refined, findings: &mut Vec<CalibrationFinding>) -> Option<LocatedFace> {
        if self.face.is_empty() || self.solve == Solve::HandEye {
            return None;
        }
        let located = locate_face(refined, &self.face);
        if located.is_none() {
            let figures = Figures { count: Some(self.face.len()), ..Figures::default() };
            findings.push(CalibrationFinding::new(FindingCode::NoPlateFace, Severity::Error).with(figures));
        }
        located
    }

    /// The task without duplicates, if its motions and readings allow one.
    fn prepared(&self, findings: &mut Vec<CalibrationFinding>) -> Result<Self, Vec<CalibrationFinding>> {
        refuse(findings)?;
        let is_duplicate = |index: usize| {
            let of = |finding: &&CalibrationFinding| finding.code == FindingCode::DuplicatePose;
            findings.iter().filter(of).any(|finding| finding.observations.first() == Some(&self.sightings[index].id))
        };
        let kept: Vec<usize> = (0..self.sightings.len()).filter(|index| !is_duplicate(*index)).collect();
        let sightings: Vec<_> = kept.iter().map(|index| self.sightings[*index].clone()).collect();
        let joints_rad = kept.iter().filter_map(|index| self.joints_rad.get(*index).copied()).collect();
        let turned_rad = kept.iter().filter_map(|index| self.turned_rad.get(*index).copied()).collect();
        let task = Self { sightings, joints_rad, turned_rad, ..self.clone() }.beside_known_runout();
        let count = task.fitted().len();
        if count < MIN_OBSERVATIONS {
            let held_out = Some(task.sightings.len() - count).filter(|held_out| *held_out > 0);
            let figures = Figures { count: Some(count), held_out, given: Some(self.sightings.len()), ..Figures::default() };
            findings.push(CalibrationFinding::new(FindingCode::TooFew, Severity::Error).with(figures));
        } else {
            task.check_motion(findings);
        }
        refuse(findings)?;
        if task.solve != Solve::Table {
            findings.extend(task.trial().other_reading(&task.sightings));
        }
        refuse(findings)?;
        Ok(task)
    }

    /// Observations without the runout that is known already.
    fn beside_known_runout(self) -> Self {
        let sightings = if self.solve == Solve::HandEye {
            self.sightings.clone()
        } else {
            let free = |each: &Sighting| without_runout(&self.nominal.base_from_table, &self.runout, 1.0, each);
            self.sightings.iter().map(free).collect()
        };
        Self { sightings, ..self }
    }

    /// Motions that cannot tell the unknowns, whatever the noise.
    fn check_motion(&self, findings: &mut Vec<CalibrationFinding>) {
        let turned = |sign: f64| self.sightings.iter().map(|each| sign * each.table_rad).fold(f64::NEG_INFINITY, f64::max);
        if self.solve != Solve::HandEye && turned(1.0) + turned(-1.0) < MIN_TABLE_TURN_RAD {
            let figures = Figures { turn_rad: Some(turned(1.0) + turned(-1.0)), ..Figures::default() };
            findings.push(CalibrationFinding::new(FindingCode::TableStill, Severity::Error).with(figures));
        }
        let frames = self.frames();
        let motion = Observability::new(&frames, Some(&Matrix6::zeros()), 1.0);
        if self.solve != Solve::Table && motion.is_degenerate(&self.limits) {
            let open = Observability::new(&frames, None, 1.0);
            findings.push(self.degenerate(&open, FindingCode::DegenerateMotion, Severity::Error));
        }
    }

    fn degenerate(&self, motion: &Observability, code: FindingCode, severity: Severity) -> CalibrationFinding {
        let finite = |value: f64| value.is_finite().then_some(value);
        let figures = Figures {
            turn_rad: Some(motion.spread_rad[1]),
            other_turn_rad: finite(motion.turn_sd_rad),
            length_mm: finite(motion.shift_sd_mm),
            needed: self.needed(),
            vector: motion.single_axis().or(motion.weakest.map(|weakest| weakest.axis)),
            ..Figures::default()
        };
        CalibrationFinding::new(code, severity).with(figures)
    }

    /// Observations to use: all but those held out.
    fn fitted(&self) -> &[Sighting] {
        &self.sightings[..self.sightings.len().saturating_sub(self.hold_out)]
    }

    fn screened(&self, findings: &mut Vec<CalibrationFinding>) -> Result<Screened, Vec<CalibrationFinding>> {
        let Some(screened) = self.screened_with(self.free()) else {
            let open = Observability::new(&self.frames(), None, 1.0);
            findings.push(self.degenerate(&open, FindingCode::DegenerateMotion, Severity::Error));
            return Err(std::mem::take(findings));
        };
        Ok(screened)
    }

    fn screened_with(&self, free: Free) -> Option<Screened> {
        let (sightings, start) = (self.fitted(), |some: &[Sighting]| self.start(some));
        let estimate_sigma = self.sigma.is_none();
        if sightings.len() < MIN_FOR_SCREENING {
            let problem = Adjustment { sightings, free, prior: None };
            let refined = self.start(sightings).and_then(|at| problem.refine(&at, &self.weighting()));
            let screened = refined.map(|refined| Screened {
                refined,
                is_used: vec![true; sightings.len()],
                sigma_scale: 1.0,
                is_sigma_estimated: false,
            });
            return screened.map(|screened| if estimate_sigma { screened.widened() } else { screened.inflated() });
        }
        Screening { sightings, free, start: &start, weighting: self.weighting(), estimate_sigma }.screen()
    }

    /// Boards that were seen half a turn round are turned back where the board's middle is known, and all is screened again.
    pub(super) fn flipped_back(
        &self,
        screened: Screened,
        findings: &mut Vec<CalibrationFinding>,
    ) -> Result<(Self, Screened), Vec<CalibrationFinding>> {
        let found = self.dropped(&screened);
        let flipped: Vec<String> = found
            .iter()
            .filter(|finding| finding.code == FindingCode::Flipped)
            .flat_map(|finding| finding.observations.clone())
            .collect();
        let Some(middle_mm) = self.board_middle_mm.filter(|_| !flipped.is_empty()) else {
            findings.extend(found);
            return Ok((self.clone(), screened));
        };
        let mut task = self.clone();
        for each in task.sightings.iter_mut().filter(|each| flipped.contains(&each.id)) {
            each.cloud_from_board *= diagnosis::half_turn(&middle_mm);
        }
        findings.push(CalibrationFinding::new(FindingCode::Flipped, Severity::Note).about(flipped));
        let screened = task.screened(findings)?;
        findings.extend(task.dropped(&screened));
        Ok((task, screened))
    }

    /// Causes for which observations were dropped.
    fn dropped(&self, screened: &Screened) -> Vec<CalibrationFinding> {
        let bound = screened.bound_of_others(self.sigma.is_some());
        diagnosis::dropped(&screened.refined, self.fitted(), &screened.is_used, bound)
    }

    fn assemble(
        &self,
        screened: &Screened,
        mut findings: Vec<CalibrationFinding>,
    ) -> Result<Calibration, Vec<CalibrationFinding>> {
        let refined = &screened.refined;
        let used: Vec<Sighting> = self.chosen(&screened.is_used);
        let residuals: Vec<Twist> = self.sightings.iter().map(|each| refined.estimate.residual(each)).collect();
        let roles = self.roles(&screened.is_used);
        let mut of_used = (refined.chi2.iter().copied(), leave_one_out(refined, &used).into_iter());
        let (mut whitened, mut left_out) = (Vec::new(), Vec::new());
        for (sighting, role) in self.sightings.iter().zip(&roles) {
            let own = if *role == Role::Used { of_used.0.next() } else { None };
            whitened.push(own.unwrap_or_else(|| refined.chi2_of_other(sighting)));
            left_out.push(if *role == Role::Used { of_used.1.next().flatten() } else { None });
        }
        let covariance = self.judged_covariance(refined);
        let lever_mm = self.best_in_cloud_mm.norm();
        let observability = Observability::new(&self.frames(), Some(&covariance), lever_mm);
        self.judge(screened, &observability, &residuals, &whitened, &roles, &mut findings);
        refuse_no_consensus(&findings)?;
        let board_scale = self.board_scale(screened, &used);
        // Where the refinement itself has not converged, its own warning says enough.
        let judged = board_scale.filter(|scale| scale.is_converged || refined.is_converged);
        findings.extend(judged.and_then(|scale| self.judge_board(&scale)));
        refuse(&findings)?;
        Ok(Calibration {
            refined: refined.clone(),
            sigma_sources: self.sigma_sources(screened, &used),
            board_scale,
            sightings: self.sightings.clone(),
            chi2_p: exceedance(refined.chi2.iter().sum(), refined.freedom()),
            point_sd_mm: point_sd_mm(&covariance, &self.best_in_cloud_mm),
            roles,
            residuals,
            whitened,
            left_out,
            observability,
            runout: self.runout.clone(),
            harmonics: Vec::new(),
            face: None,
            findings,
        })
    }

    /// Covariance of the scanner's pose; where it was held, of the table's.
    fn judged_covariance(&self, refined: &Refined) -> Matrix6<f64> {
        if self.solve != Solve::Table {
            return refined.hand_eye_covariance();
        }
        let table = refined.table_covariance();
        let mut covariance = Matrix6::zeros();
        for (row, to_row) in [0, 1, 3, 4].into_iter().enumerate() {
            for (column, to_column) in [0, 1, 3, 4].into_iter().enumerate() {
                covariance[(to_row, to_column)] = table[(row, column)];
            }
        }
        covariance
    }

    fn chosen(&self, is_used: &[bool]) -> Vec<Sighting> {
        self.fitted().iter().zip(is_used).filter(|(_, used)| **used).map(|(each, _)| each.clone()).collect()
    }

    fn roles(&self, is_used: &[bool]) -> Vec<Role> {
        let role = |index: usize| match is_used.get(index) {
            Some(true) => Role::Used,
            Some(false) => Role::Dropped,
            None => Role::HeldOut,
        };
        (0..self.sightings.len()).map(role).collect()
    }

    /// Error of observations that contradict each other, where they would be refused: then neither their motions nor table nor board
    /// are the cause. With a scanner that is held as the cell has it, that is the likely one.
    fn contradiction(&self, screened: &Screened) -> Option<CalibrationFinding> {
        let refined = &screened.refined;
        let used = self.chosen(&screened.is_used);
        let agreeing = screened.is_used.iter().filter(|used| **used).count();
        let rms_mm = Spread::of(used.iter().map(|each| refined.estimate.residual(each))).rms_mm;
        let observability =
            Observability::new(&self.frames(), Some(&self.judged_covariance(refined)), self.best_in_cloud_mm.norm());
        let is_open = has_no_consensus(screened) || self.is_poor(&observability);
        let is_far = rms_mm > diagnosis::POOR_MM;
        let (code, is_told) = match self.solve {
            Solve::Table => (FindingCode::ScannerHeld, is_far || is_open),
            Solve::HandEye | Solve::Joint => {
                let is_refused = is_far && (is_open || refined.estimate.scale < 0.0);
                (FindingCode::NoConsensus, is_refused && !self.is_explained_by_board(screened, &used, rms_mm))
            }
        };
        let finite = |value: f64| value.is_finite().then_some(value);
        let figures = Figures {
            count: Some(agreeing),
            given: Some(screened.is_used.len()),
            needed: self.needed(),
            length_mm: Some(rms_mm),
            other_length_mm: finite(observability.shift_sd_mm),
            other_turn_rad: finite(observability.turn_sd_rad),
            ..Figures::default()
        };
        is_told.then(|| CalibrationFinding::new(code, Severity::Error).with(figures))
    }

    /// Returns true if a board of another size makes the observations agree clearly better: then its own finding tells it.
    fn is_explained_by_board(&self, screened: &Screened, used: &[Sighting], rms_mm: f64) -> bool {
        let Some(scale) = self.board_scale(screened, used).filter(|scale| scale.is_converged) else { return false };
        let sightings: Vec<Sighting> = used.iter().map(|each| divided(each, scale.ratio)).collect();
        let problem = Adjustment { sightings: &sightings, free: screened.refined.free, prior: None };
        let refined = problem.refine(&screened.refined.estimate, &screened.refined.weighting);
        let left_mm = |refined: Refined| Spread::of(sightings.iter().map(|each| refined.estimate.residual(each))).rms_mm;
        refined.is_some_and(|refined| left_mm(refined) * diagnosis::CLEARLY < rms_mm)
    }

    /// Returns true if the unknowns are not known well enough to be used.
    fn is_poor(&self, observability: &Observability) -> bool {
        match self.solve {
            Solve::Table => observability.shift_sd_mm > self.limits.max_mm || observability.turn_sd_rad > self.limits.max_rad,
            Solve::HandEye | Solve::Joint => observability.is_degenerate(&self.limits),
        }
    }

    fn judge(
        &self,
        screened: &Screened,
        observability: &Observability,
        residuals: &[Twist],
        whitened: &[f64],
        roles: &[Role],
        findings: &mut Vec<CalibrationFinding>,
    ) {
        if has_no_consensus(screened) {
            let agreeing = screened.is_used.iter().filter(|used| **used).count();
            let figures = Figures { count: Some(agreeing), given: Some(screened.is_used.len()), ..Figures::default() };
            findings.insert(0, CalibrationFinding::new(FindingCode::NoConsensus, Severity::Error).with(figures));
            return;
        }
        if self.is_poor(observability) {
            findings.push(self.degenerate(observability, FindingCode::DegenerateMotion, Severity::Error));
        } else if observability.is_weak(&self.limits) {
            findings.push(self.degenerate(observability, FindingCode::WeakMotion, Severity::Warning));
        }
        if screened.sigma_scale > 1.0 {
            let figures = Figures { ratio: Some(screened.sigma_scale), ..Figures::default() };
            findings.push(CalibrationFinding::new(FindingCode::SigmaTooSmall, Severity::Warning).with(figures));
        }
        findings.extend(screened.refined.not_converged());
        // Few observations that tell nothing else tell no sense of the table either.
        if !(self.is_poor(observability) && self.needed().is_some()) {
            self.judge_table(screened, findings);
        }
        let bound = quantile_of(HELD_OUT_FALSE_ALARM, 6, screened.sigma_freedom(self.sigma.is_some()));
        for index in (0..roles.len()).filter(|index| roles[*index] == Role::HeldOut && whitened[*index] > bound) {
            let residual = &residuals[index];
            let figures = Figures {
                turn_rad: Some(super::se3::rotation_of(residual).norm()),
                length_mm: Some(super::se3::translation_of(residual).norm()),
                ..Figures::default()
            };
            let about = [self.sightings[index].id.clone()];
            findings.push(CalibrationFinding::new(FindingCode::HeldOutDisagrees, Severity::Warning).about(about).with(figures));
        }
        let of_used = |index: &usize| roles[*index] == Role::Used;
        let used: Vec<usize> = (0..roles.len()).filter(of_used).collect();
        let lengths: Vec<f64> = used.iter().map(|index| super::se3::translation_of(&residuals[*index]).norm()).collect();
        let joints: Vec<[f64; 6]> = used.iter().filter_map(|index| self.joints_rad.get(*index).copied()).collect();
        findings.extend(diagnosis::arm_model(&lengths, &joints));
    }

    /// Scale of the lengths to the board. None where the scanner is held: its own error along the view would be taken for one.
    fn board_scale(&self, screened: &Screened, used: &[Sighting]) -> Option<BoardScale> {
        if self.solve == Solve::Table || used.len() < MIN_FOR_SCREENING {
            return None;
        }
        let estimate_sigma = screened.is_sigma_estimated;
        let weighting = if estimate_sigma { screened.refined.weighting } else { self.weighting() };
        BoardScale::of(&screened.refined, used, &weighting, estimate_sigma, self.best_mm)
    }

    /// Warning of a board of another size than was given, or of a scale that tells none.
    pub(super) fn judge_board(&self, scale: &BoardScale) -> Option<CalibrationFinding> {
        if !scale.is_converged {
            let figures = Figures { count: Some(scale.rounds), ..Figures::default() };
            return Some(CalibrationFinding::new(FindingCode::BoardScaleNotConverged, Severity::Warning).with(figures));
        }
        let figures = Figures {
            ratio: Some(scale.ratio),
            length_mm: Some(scale.shift_mm()),
            other_length_mm: self.board_pitch_mm.map(|pitch_mm| pitch_mm / scale.ratio),
            ..Figures::default()
        };
        scale.is_off().then(|| CalibrationFinding::new(FindingCode::BoardScale, Severity::Warning).with(figures))
    }

    /// Sources of the deviations of arm and board.
    fn sigma_sources(&self, screened: &Screened, used: &[Sighting]) -> [SigmaSource; 2] {
        let arm = screened.source(self.sigma.is_some());
        let is_told_by_points = used.iter().all(|each| each.seen_covariance.is_some());
        [arm, if is_told_by_points { SigmaSource::Unused } else { arm }]
    }

    /// Sign of the table's turn: a cell cannot say that its table turns the other way.
    fn judge_table(&self, screened: &Screened, findings: &mut Vec<CalibrationFinding>) {
        if self.solve == Solve::HandEye {
            return;
        }
        let refined = &screened.refined;
        if refined.estimate.scale < 0.0 {
            // Half a turn looks the same both ways: an angle near a quarter tells the sense best.
            let off_quarter = |angle_rad: &f64| (angle_rad.abs() - FRAC_PI_2).abs();
            let angles = self.sightings.iter().map(|each| each.table_rad);
            let asked = angles.min_by(|a, b| off_quarter(a).total_cmp(&off_quarter(b))).unwrap_or(0.0);
            let figures = Figures { turn_rad: Some(asked), other_turn_rad: Some(-asked), ..Figures::default() };
            findings.push(CalibrationFinding::new(FindingCode::TableSign, Severity::Error).with(figures));
        }
    }

    /// Error of a table that turns by another ratio than it reports: told before anything else, since it makes good observations
    /// look bad and good motions look degenerate.
    fn other_ratio(&self, screened: Option<&Screened>) -> Option<CalibrationFinding> {
        if self.solve == Solve::HandEye {
            return None;
        }
        let free = Free { scale: true, ..self.free() };
        // Few joint observations agree by some ratio, whatever is wrong with them.
        if self.solve == Solve::Joint && self.fitted().len() < diagnosis::least_observations(free.count()) {
            return None;
        }
        let count = |screened: &Screened| screened.is_used.iter().filter(|used| **used).count();
        let agreeing = screened.map_or(0, count);
        let is_many = |agreeing: usize| agreeing as f64 >= MANY_AGREEING * self.fitted().len() as f64;
        let (with_ratio, is_used) = match screened {
            Some(screened) if is_many(agreeing) => {
                let used = self.chosen(&screened.is_used);
                let problem = Adjustment { sightings: &used, free, prior: None };
                let refined = problem.refine(&screened.refined.estimate, &screened.refined.weighting)?;
                (refined, screened.is_used.clone())
            }
            _ => {
                let others = |free: &Screened| count(free) > agreeing && is_many(count(free));
                let screened = self.screened_with(free).filter(others)?;
                (screened.refined, screened.is_used)
            }
        };
        // Observations that contradict each other tell some ratio too.
        let residuals = self.chosen(&is_used).into_iter().map(|each| with_ratio.estimate.residual(&each));
        if Spread::of(residuals).rms_mm > diagnosis::POOR_MM {
            return None;
        }
        let off = with_ratio.estimate.scale.abs() - 1.0;
        let is_off = off.abs() > SCALE_TOLERANCE && off.abs() > 4.0 * with_ratio.scale_sd();
        let figures = Figures { ratio: Some(with_ratio.estimate.scale), ..Figures::default() };
        is_off.then(|| CalibrationFinding::new(FindingCode::TableScale, Severity::Error).with(figures))
    }
}

/// Ends with the findings so far if the calibration was cancelled.
fn check(watch: &dyn CalibrationWatch, findings: &[CalibrationFinding]) -> Result<(), Vec<CalibrationFinding>> {
    if watch.is_cancelled() { Err(findings.to_vec()) } else { Ok(()) }
}

/// Returns true if fewer observations agree than a calibration needs.
fn has_no_consensus(screened: &Screened) -> bool {
    let agreeing = screened.is_used.iter().filter(|used| **used).count();
    (agreeing as f64) < MIN_AGREEING * screened.is_used.len() as f64
}

/// Returns true if fewer observations agree, or the same ones less well.
fn is_worse(after: &Screened, before: &Screened) -> bool {
    let used = |screened: &Screened| screened.is_used.iter().filter(|used| **used).count();
    let size = |screened: &Screened| screened.refined.weighting.sigma.robot_mm * screened.refined.variance_factor().sqrt();
    used(after) < used(before) || (used(after) == used(before) && size(after) > size(before))
}

/// Ends with the findings if no observations agree: what they tell of the board is nothing.
fn refuse_no_consensus(findings: &[CalibrationFinding]) -> Result<(), Vec<CalibrationFinding>> {
    let is_open = findings.iter().any(|finding| finding.code == FindingCode::NoConsensus);
    if is_open { Err(findings.to_vec()) } else { Ok(()) }
}

/// Ends with the findings if one is an error.
fn refuse(findings: &[CalibrationFinding]) -> Result<(), Vec<CalibrationFinding>> {
    let is_error = findings.iter().any(|finding| finding.severity == Severity::Error);
    if is_error { Err(findings.to_vec()) } else { Ok(()) }
}
