//! Figures of samples together, weighted by area, and verdicts of regions.

use nalgebra::Point3;

use super::{DeviationOptions, SampleDeviation};
use crate::cell::closed_list;
use crate::geometry::sort_ascending;
use crate::planning::ids::SampleId;
use crate::planning::surface::Surface;

closed_list! {
    /// Verdict after ISO 14253-1.
    pub enum Conformity {
        /// Conformity is shown.
        Pass = "pass",
        /// Nonconformity is shown.
        Fail = "fail",
        /// Neither is: the measured values lie within their uncertainty of the limits, or too little is measured.
        Undecided = "undecided",
    }
}

closed_list! {
    /// Reason for which a region with samples that fail does not fail.
    pub enum UndecidedBecause {
        /// The registration leaves open, by more than it bridges, where the part lies along this surface.
        NotHeld = "not_held",
        /// Samples fail by points of views that could not be registered, whose poses may be off by more than is stated.
        NotRegistered = "not_registered",
        /// Fewer samples are measured than make a region fail.
        FewSamples = "few_samples",
        /// No more samples fail than noise lets fail.
        WithinNoise = "within_noise",
    }
}

/// Share of samples at a limit that falls beyond it by more than U with no deviation beyond: one side of k = 2.
const TAIL: f64 = 0.025;
/// Probability with which noise lets more samples fail than are excused: that of two standard deviations, one-sided.
const BY_CHANCE: f64 = 0.02275;
/// Most samples whose count is followed by the binomial distribution itself: beyond, its first term is no number any more.
const MAX_COUNTED: usize = 20_000;
/// Fewest measured samples that make a region fail of which not all fail: neighbours share points and poses, so that a few are one
/// observation. Not from a source: most regions have about a hundred samples of their own; with hundreds of features, small ones have fewer.
pub const MIN_TO_FAIL: usize = 10;
/// Max share of a region's area that may lie beyond the limit by an uncommonly large uncertainty alone and count as not measured: rims that
/// one view sees flatly. Our choice: a tenth of what may be missing.
const MAX_UNCLEAR: f64 = 0.01;
/// Multiple of the region's median of what points leave open, beyond which a sample has few of them or turned ones: rims and corners. Our
/// choice.
const UNCOMMON: f64 = 2.0;

/// Figures of the deviation of some samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviationStatistics {
    /// Area measured, mm².
    pub area_mm2: f64,
    /// Mean, mm.
    pub mean_mm: f64,
    /// Root mean square, mm.
    pub rms_mm: f64,
    /// 1st, 5th, 50th, 95th and 99th percentile by area, mm.
    pub percentiles_mm: [f64; 5],
    /// Deviation that is farthest from zero, mm.
    pub max_mm: f64,
    /// Share of the measured area within ± half of the tolerance, where there is one.
    pub in_tolerance: Option<f64>,
}

/// Percentiles of [`DeviationStatistics::percentiles_mm`].
pub const PERCENTILES: [f64; 5] = [0.01, 0.05, 0.5, 0.95, 0.99];

/// Figures of some samples; none where none of them is measured.
#[must_use]
pub fn statistics(
    samples: &[SampleDeviation],
    surface: &Surface,
    of: impl Iterator<Item = SampleId>,
    tolerance_mm: Option<f64>,
) -> Option<DeviationStatistics> {
    let measured = of.filter(|sample| samples[sample.index()].points > 0);
    let mut values: Vec<(f64, f64)> =
        measured.map(|sample| (f64::from(samples[sample.index()].distance_mm), surface.sample_area_mm2(sample))).collect();
    let area_mm2: f64 = values.iter().map(|(_, area)| area).sum();
    if area_mm2 <= 0.0 {
        return None;
    }
    let mean_of = |value: fn(f64) -> f64| values.iter().map(|(distance, area)| value(*distance) * area).sum::<f64>() / area_mm2;
    let (mean_mm, rms_mm) = (mean_of(|distance| distance), mean_of(|distance| distance * distance).sqrt());
    let max_mm = values.iter().fold(0.0_f64, |worst, (distance, _)| if distance.abs() > worst.abs() { *distance } else { worst });
    let within = |limit: f64| values.iter().filter(|(distance, _)| distance.abs() <= limit).map(|(_, area)| area).sum::<f64>();
    let in_tolerance = tolerance_mm.map(|tolerance| within(0.5 * tolerance) / area_mm2);
    sort_ascending(&mut values, |value| value.0);
    let percentiles_mm = PERCENTILES.map(|share| {
        let mut before = 0.0;
        let place = values.iter().position(|(_, area)| {
            before += area;
            before >= share * area_mm2
        });
        values[place.unwrap_or(values.len() - 1)].0
    });
    Some(DeviationStatistics { area_mm2, mean_mm, rms_mm, percentiles_mm, max_mm, in_tolerance })
}

/// Area by deviation.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    /// Deviation at which the first class begins, mm.
    pub begin_mm: f64,
    /// Width of a class, mm.
    pub width_mm: f64,
    /// Area of each class, mm²; the first and the last hold what lies beyond.
    pub area_mm2: Vec<f64>,
}

/// Histogram of all measured samples, in so many classes between ± `limit_mm`.
#[must_use]
pub fn histogram(samples: &[SampleDeviation], surface: &Surface, limit_mm: f64, classes: usize) -> Histogram {
    let classes = classes.max(1);
    let width_mm = 2.0 * limit_mm / classes as f64;
    let mut area_mm2 = vec![0.0; classes];
    for sample in surface.samples().filter(|sample| samples[sample.index()].points > 0) {
        let class = ((f64::from(samples[sample.index()].distance_mm) + limit_mm) / width_mm).floor();
        area_mm2[(class.max(0.0) as usize).min(classes - 1)] += surface.sample_area_mm2(sample);
    }
    Histogram { begin_mm: -limit_mm, width_mm, area_mm2 }
}

/// Shares that figures leave out; what lies beyond the search distance keeps a region from passing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExcludedShares {
    /// Share of the points around the samples that show a surface turned by more than [`DeviationOptions::max_turn_deg`].
    pub turned_of_points: f64,
    /// Share of the area that has such points alone.
    pub turned_of_area: f64,
    /// Share of the area before or behind which most points are farther than is searched.
    pub off_of_area: f64,
}

/// Shares of some samples that are left out.
#[must_use]
pub fn excluded(samples: &[SampleDeviation], surface: &Surface, of: impl Iterator<Item = SampleId>) -> ExcludedShares {
    let (mut points, mut turned_points) = (0.0, 0.0);
    let (mut area_mm2, mut turned_mm2, mut off_mm2) = (0.0, 0.0, 0.0);
    for (id, sample) in of.map(|id| (id, &samples[id.index()])) {
        let own_mm2 = surface.sample_area_mm2(id);
        points += f64::from(sample.points) + f64::from(sample.turned_points);
        turned_points += f64::from(sample.turned_points);
        area_mm2 += own_mm2;
        if sample.is_off {
            off_mm2 += own_mm2;
        } else if sample.points == 0 && sample.turned_points > 0 {
            turned_mm2 += own_mm2;
        }
    }
    let share = |part: f64, whole: f64| if whole > 0.0 { part / whole } else { 0.0 };
    ExcludedShares {
        turned_of_points: share(turned_points, points),
        turned_of_area: share(turned_mm2, area_mm2),
        off_of_area: share(off_mm2, area_mm2),
    }
}

/// A region, or a toleranced feature, with its samples.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionToJudge {
    /// Name of the region.
    pub name: String,
    /// Width of its tolerance zone, mm.
    pub tolerance_mm: Option<f64>,
    /// Samples of the region.
    pub samples: Vec<SampleId>,
}

/// Surface of a region that keeps it from passing: samples that fail, may lie beyond the limit, or are farther off than is searched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OpenPart {
    /// Area of these samples, mm².
    pub area_mm2: f64,
    /// Place of the one that may lie farthest off, part frame, mm.
    pub at_mm: Point3<f64>,
    /// Deviation of that sample and its expanded uncertainty, mm; `None` where its points are farther off than is searched.
    pub deviation_mm: Option<[f64; 2]>,
    /// Part of that uncertainty that poses and the alignment leave open, mm; `None` likewise.
    pub of_poses_mm: Option<f64>,
}

impl OpenPart {
    /// Part of one sample.
    fn of(sample: &SampleDeviation, at_mm: Point3<f64>, area_mm2: f64) -> Self {
        let deviation_mm = [sample.distance_mm, sample.expanded_mm].map(f64::from);
        let is_near = !sample.is_off;
        let of_poses_mm = is_near.then(|| sample.of_poses_mm());
        Self { area_mm2, at_mm, deviation_mm: is_near.then_some(deviation_mm), of_poses_mm }
    }

    /// Both parts together.
    fn with(self, other: Option<Self>) -> Self {
        let Some(other) = other else { return self };
        let reach_mm =
            |part: &Self| part.deviation_mm.map_or(f64::INFINITY, |[distance_mm, expanded_mm]| distance_mm.abs() + expanded_mm);
        let farthest = if reach_mm(&self) > reach_mm(&other) { self } else { other };
        Self { area_mm2: self.area_mm2 + other.area_mm2, ..farthest }
    }
}

/// Deviation of a region.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionDeviation {
    /// Name of the region.
    pub name: String,
    /// Width of its tolerance zone, mm.
    pub tolerance_mm: Option<f64>,
    /// Share of its area that is measured.
    pub measured: f64,
    /// Shares of it that figures leave out.
    pub excluded: ExcludedShares,
    /// Figures; none where nothing is measured.
    pub statistics: Option<DeviationStatistics>,
    /// Verdict of the profile (ISO 1101) against the tolerance; none without one.
    pub verdict: Option<Conformity>,
    /// Median of the samples' expanded uncertainty, mm.
    pub expanded_mm: Option<f64>,
    /// Median of the part of it that poses and the alignment leave open, mm.
    pub of_poses_mm: Option<f64>,
    /// True if that part alone keeps the region from passing.
    pub is_open_by_poses: bool,
    /// Surface that keeps it from passing; `None` where there is none, or no tolerance.
    pub open: Option<OpenPart>,
    /// Number of its samples that are measured.
    pub measured_samples: usize,
    /// Share of its area that is shown to conform; none without a tolerance.
    pub conforming: Option<f64>,
    /// Reason for which it is undecided although samples fail.
    pub undecided_because: Option<UndecidedBecause>,
}

/// Judges a region.
#[must_use]
pub fn judge(
    samples: &[SampleDeviation],
    surface: &Surface,
    region: &RegionToJudge,
    options: &DeviationOptions,
) -> RegionDeviation {
    let own = || region.samples.iter().copied();
    let all: f64 = own().map(|sample| surface.sample_area_mm2(sample)).sum();
    let found = statistics(samples, surface, own(), region.tolerance_mm);
    let measured = found.map_or(0.0, |found| found.area_mm2) / all.max(f64::MIN_POSITIVE);
    let median = |of: &dyn Fn(&SampleDeviation) -> f64| median_of(samples, region, of);
    let of_points = |sample: &SampleDeviation| f64::from(sample.of_points_mm);
    let expanded = |sample: &SampleDeviation| f64::from(sample.expanded_mm);
    let enough = ([all, options.min_measured * all], median(&of_points).unwrap_or_default());
    let verdict_with = |uncertainty: &dyn Fn(&SampleDeviation) -> f64| {
        region.tolerance_mm.map(|tolerance| verdict(samples, surface, region, tolerance, (enough, uncertainty)))
    };
    let judged = verdict_with(&expanded);
    let verdict = judged.map(|judged| judged.verdict);
    let by_points = || verdict_with(&of_points).map(|judged| judged.verdict);
    RegionDeviation {
        name: region.name.clone(),
        tolerance_mm: region.tolerance_mm,
        measured,
        excluded: excluded(samples, surface, own()),
        statistics: found,
        verdict,
        expanded_mm: median(&expanded),
        of_poses_mm: median(&SampleDeviation::of_poses_mm),
        is_open_by_poses: verdict == Some(Conformity::Undecided) && by_points() == Some(Conformity::Pass),
        open: judged.and_then(|judged| judged.open),
        measured_samples: own().filter(|sample| samples[sample.index()].points > 0).count(),
        conforming: judged.map(|judged| judged.passed_mm2 / all.max(f64::MIN_POSITIVE)),
        undecided_because: judged.and_then(|judged| judged.because),
    }
}

/// Median of a figure of a region's measured samples; `None` where nothing is measured.
fn median_of(samples: &[SampleDeviation], region: &RegionToJudge, of: &dyn Fn(&SampleDeviation) -> f64) -> Option<f64> {
    let measured = region.samples.iter().map(|sample| &samples[sample.index()]).filter(|sample| sample.points > 0);
    let mut values: Vec<f64> = measured.map(of).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Verdict of one value with its uncertainty. A sample that most points are off, or turned and beyond the limit, does not pass.
#[must_use]
pub fn verdict_of(sample: &SampleDeviation, tolerance_mm: f64) -> Conformity {
    verdict_by(sample, tolerance_mm, f64::from(sample.expanded_mm))
}

/// Verdict of one value with this uncertainty.
fn verdict_by(sample: &SampleDeviation, tolerance_mm: f64, expanded: f64) -> Conformity {
    let (distance, limit) = (f64::from(sample.distance_mm.abs()), 0.5 * tolerance_mm);
    let is_open = sample.is_off || sample.is_turned_beyond(limit);
    if sample.points > 0 && distance - expanded > limit {
        Conformity::Fail
    } else if sample.points > 0 && distance + expanded <= limit && !is_open {
        Conformity::Pass
    } else {
        Conformity::Undecided
    }
}

/// Expanded uncertainty of a sample, mm, with or without what poses leave open.
type Uncertainty<'a> = &'a dyn Fn(&SampleDeviation) -> f64;

/// Verdict of a region, with what it is from.
#[derive(Clone, Copy)]
struct Judged {
    verdict: Conformity,
    /// Surface that keeps it from passing.
    open: Option<OpenPart>,
    /// Area of the samples that pass, mm².
    passed_mm2: f64,
    because: Option<UndecidedBecause>,
}

/// Verdict of a region: `fail` where more samples fail than noise lets fail ([`by_noise`]), or [`MIN_TO_FAIL`] of them by more
/// than noise takes any of so many beyond the limit ([`farthest_by_noise`]), and either [`MIN_TO_FAIL`] are measured, or all that
/// are fail and have `min_area_mm2`: small features have fewer samples, and a few of a larger one do not decide. `pass` where
/// samples of at least `min_area_mm2` pass and no other fails, lies beyond the limit or could have passed: one whose points leave
/// uncommonly much open, and alone do so, says little either way, and so do those within the limit whose uncertainty is
/// uncommonly large and takes them no farther than twice the limit, if they are at most [`MAX_UNCLEAR`] of the area: they count
/// as not measured. Else undecided. A sample before or behind which most points are off could not have passed. One where most are
/// turned and beyond the limit counts as not measured: edges that are broken have some. What passes so passes with any larger
/// tolerance. With the verdict comes the surface that keeps the region from passing.
fn verdict(
    samples: &[SampleDeviation],
    surface: &Surface,
    region: &RegionToJudge,
    tolerance: f64,
    (([all_mm2, min_area_mm2], median_of_points_mm), uncertainty): (([f64; 2], f64), Uncertainty<'_>),
) -> Judged {
    let (mut failed, mut certain, mut passed_mm2, mut failed_mm2) = (0_usize, 0_usize, 0.0, 0.0);
    let mut unclear: Option<OpenPart> = None;
    let measured = region.samples.iter().filter(|id| samples[id.index()].points > 0).count();
    let farthest = farthest_by_noise(measured);
    let uncommon_mm = UNCOMMON * median_of(samples, region, uncertainty).unwrap_or_default();
    let mut open: Option<OpenPart> = None;
    for (id, sample) in region.samples.iter().map(|id| (id, &samples[id.index()])) {
        let (own_mm2, expanded_mm) = (surface.sample_area_mm2(*id), uncertainty(sample));
        let is_open = match verdict_by(sample, tolerance, expanded_mm) {
            Conformity::Pass => {
                passed_mm2 += own_mm2;
                false
            }
            Conformity::Fail => {
                failed += 1;
                failed_mm2 += own_mm2;
                let beyond_mm = f64::from(sample.distance_mm.abs()) - 0.5 * tolerance;
                certain += usize::from(beyond_mm > farthest * expanded_mm);
                true
            }
            Conformity::Undecided => {
                let (distance_mm, limit_mm) = (f64::from(sample.distance_mm.abs()), 0.5 * tolerance);
                let of_points_mm = f64::from(sample.of_points_mm);
                let of_poses_mm = (expanded_mm.powi(2) - of_points_mm.powi(2)).max(0.0).sqrt();
                // No lack of points excuses what poses alone leave open, such as a wall that nothing ties to the rest; a speck of it says little.
                let is_excused = of_points_mm > UNCOMMON * median_of_points_mm && distance_mm + of_poses_mm <= limit_mm;
                let may_be_beyond = !is_excused && distance_mm + expanded_mm > limit_mm;
                let is_unclear = expanded_mm > uncommon_mm && distance_mm <= limit_mm && distance_mm + expanded_mm <= tolerance;
                if may_be_beyond && is_unclear && sample.points > 0 && !sample.is_off {
                    unclear = Some(OpenPart::of(sample, surface.sample_mm[id.index()], own_mm2).with(unclear));
                }
                sample.is_off || sample.points > 0 && (distance_mm > limit_mm || may_be_beyond && !is_unclear)
            }
        };
        if is_open {
            open = Some(OpenPart::of(sample, surface.sample_mm[id.index()], own_mm2).with(open));
        }
    }
    if let Some(unclear) = unclear.filter(|unclear| unclear.area_mm2 > MAX_UNCLEAR * all_mm2) {
        open = Some(unclear.with(open));
    }
    let are_enough = measured >= MIN_TO_FAIL || failed == measured && failed_mm2 >= min_area_mm2;
    let (verdict, because) = if are_enough && (failed > by_noise(measured) || certain >= MIN_TO_FAIL) {
        (Conformity::Fail, None)
    } else if measured > 0 && open.is_none() && passed_mm2 >= min_area_mm2 {
        (Conformity::Pass, None)
    } else {
        let because = if measured < MIN_TO_FAIL { UndecidedBecause::FewSamples } else { UndecidedBecause::WithinNoise };
        (Conformity::Undecided, (failed > 0).then_some(because))
    };
    Judged { verdict, open, passed_mm2, because }
}

/// Multiple of the expanded uncertainty, k = 2, by which noise takes none of so many samples beyond the limit, but with the probability of
/// [`BY_CHANCE`] in all: √(2 ln(N/p))/2, by the tail e^(−z²/2) of the normal distribution (Chernoff) and the sum over samples (Bonferroni).
fn farthest_by_noise(samples: usize) -> f64 {
    0.5 * (2.0 * (samples.max(1) as f64 / BY_CHANCE).ln()).sqrt()
}

/// Most of so many samples that noise lets fail at the limit: the number that a binomial count with the tail of k = 2 exceeds with no
/// more than the probability of two standard deviations (C. J. Clopper, E. S. Pearson, "The use of confidence or fiducial limits
/// illustrated in the case of the binomial", Biometrika 26(4), 1934). Its normal approximation would let one of a few samples decide.
pub(super) fn by_noise(samples: usize) -> usize {
    let count = samples as f64;
    if samples > MAX_COUNTED {
        return (TAIL * count + 2.0 * (TAIL * (1.0 - TAIL) * count).sqrt()) as usize + 1;
    }
    let mut of_failed = (1.0 - TAIL).powf(count);
    let (mut failed, mut up_to) = (0, of_failed);
    while 1.0 - up_to > BY_CHANCE {
        of_failed *= (count - failed as f64) / (failed as f64 + 1.0) * TAIL / (1.0 - TAIL);
        failed += 1;
        up_to += of_failed;
    }
    failed
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One failing sample of three once made a region fail.
    #[test]
    fn noise_lets_one_of_a_few_samples_fail_and_a_fortieth_of_many() {
        assert_eq!([0, 1, 3, 9, 10, 40, 400].map(by_noise), [0, 1, 1, 1, 2, 3, 17]);
        let [below, above] = [MAX_COUNTED, MAX_COUNTED + 1].map(by_noise);
        assert!(above >= below && above <= below + 1, "{below} {above}");
    }
}
