//! Rates of return, and the limits that they show. A pair of view and sample counts where a scanner without weakness would return
//! it ([`Return::is_expected`]), so that rates are free of what geometry takes: frames, shadows, poses; of the scans of an inspection
//! only pairs whose loss tells something of the scanner ([`super::telling()`]). Rates are held against the
//! rate of easy pairs (small incidence, off the mirror cone, around the best focus), so that what takes points everywhere, such as
//! darkness, does not move a limit.
//!
//! - **Incidence**: rate by the worst incidence, never rising; the limit is where it passes 0.75 of the easy rate.
//! - **Mirror cone**: rate by the mirror angle of pairs well inside that limit, never falling; the cone ends where it passes one half.
//! - **Depth**: rate by depth, never falling up to the best focus and never rising from there; each limit where it passes 0.75.
//!
//! Intervals are by the jackknife over views (Efron 1982, *The Jackknife, the Bootstrap and Other Resampling Plans*), since the pairs
//! of one view share pose, material and light, with Student's t of one freedom less than there are views (J. W. Tukey, "Bias and
//! confidence in not quite large samples", 1958); at least half a bin to either side. A figure that only one view shows is as open as its
//! axis is long, since nothing tells that view's light or material from the scanner. A part of flat faces may show no pair over a
//! stretch of the axis in which a limit lies: each place there explains the pairs equally well (C. F. Manski, *Partial
//! Identification of Probability Distributions*, 2003), so that the interval begins before the stretch and ends beyond it.
//! Cost: O(pairs), and O(views · bins).

use super::Identified;
use super::isotonic::{CountedRate, Crossing, bracketed, crossing, falling, rising};
use super::model::ReturnModel;
use crate::cell::{DeviceName, Scanner};
use crate::inspection::coverage::{IdentifiedLimits, Return, Returns};
use crate::inspection::student;

/// Rate, of the easy one, at which a limit is reached.
const LIMIT_RATE: f64 = 0.75;
/// Rate, of the easy one, up to which a plan loses nothing that is worth a view.
const PLAN_RATE: f64 = 0.95;
/// Rate, of the easy one, at which the mirror cone ends.
const LOBE_RATE: f64 = 0.5;
/// Incidence up to which pairs are easy, degrees: Prieto's limit of accurate data (thesis §3.2.1.3).
pub(super) const EASY_INCIDENCE_DEG: f64 = 35.0;
/// Mirror angle from which pairs are off any cone at first, degrees.
pub(super) const EASY_MIRROR_DEG: f64 = 20.0;
/// Share of the half ranges of depth around the best focus in which pairs are easy.
const EASY_DEPTH_SHARE: f64 = 0.5;
/// Distance from the incidence limit within which pairs say nothing of other causes, degrees.
const CLEAR_OF_LIMIT_DEG: f64 = 8.0;
/// Width of a bin: incidence and mirror angle in degrees, depth in mm.
const INCIDENCE_BIN_DEG: f64 = 1.0;
const MIRROR_BIN_DEG: f64 = 0.5;
const DEPTH_BIN_MM: f64 = 5.0;
/// Bins of each axis.
const INCIDENCE_BINS: usize = 90;
const MIRROR_BINS: usize = 60;
const DEPTH_BINS: usize = 64;
/// Fewest pairs from which a rate is known.
const MIN_PAIRS: f64 = 200.0;
/// Fewest pairs beyond a limit: a few that happen to be lost at the end of an axis are not a limit.
const MIN_PAIRS_BEYOND: f64 = 50.0;

/// Counts between two places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RateBin {
    /// Lower and upper end: degrees, or mm of depth.
    pub range: [f64; 2],
    /// Pairs that a scanner without weakness would return.
    pub expected: u64,
    /// Pairs that returned.
    pub returned: u64,
}

/// Rate of return along an axis, relative to that of easy pairs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RateCurve {
    /// Counts, ascending; empty bins are left out.
    pub bins: Vec<RateBin>,
    /// Places and rates of the monotone regression, ascending: degrees or mm, and 0 to 1.
    pub points: Vec<[f64; 2]>,
}

impl RateCurve {
    /// Rate at a place: on straight lines through the points, level beyond their ends; 1 where nothing is known. Over a stretch
    /// without pairs it is the expected rate, if the true one drops at a single place there, all places being equally probable.
    #[must_use]
    pub fn rate(&self, place: f64) -> f64 {
        let after = self.points.partition_point(|[at, _]| *at <= place);
        match (after.checked_sub(1).map(|before| self.points[before]), self.points.get(after).copied()) {
            (Some([from, a]), Some([to, b])) => a + (b - a) * (place - from) / (to - from),
            (Some([_, rate]), None) | (None, Some([_, rate])) => rate,
            (None, None) => 1.0,
        }
    }
}

impl RateCurve {
    /// Last place at which a curve that never rises is at or above a rate; `None` where it stays above or begins below.
    #[must_use]
    pub fn falls_to(&self, rate: f64) -> Option<f64> {
        crossing(&self.points, rate)
    }
}

/// A limit of the scanner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LimitEstimate {
    /// Limit, degrees or mm.
    pub limit: Identified,
    /// Ends of the stretch without pairs in which the limit lies; the limit twice where there is none.
    pub between: [f64; 2],
    /// Start of the fall of the rate: a plan had better stay within it.
    pub plan_with: f64,
    /// Ends of its interval of 95 % confidence.
    pub plan_interval: [f64; 2],
    /// Pairs that it is from.
    pub pairs: u64,
}

/// Rates of return and the limits that they show. A limit is `None` where rates do not fall to it, or too few pairs tell.
#[derive(Clone, Debug, PartialEq)]
pub struct LearnedReturns {
    /// Pairs that a scanner without weakness would return.
    pub pairs: u64,
    /// Views that they are from.
    pub views: usize,
    /// Rate of easy pairs.
    pub easy_rate: f64,
    /// Incidence limit of all devices together, by the worst of the three, degrees.
    pub incidence: Option<LimitEstimate>,
    /// Incidence limit of each device, from pairs of which it has the worst incidence.
    pub by_device: Vec<(DeviceName, Option<LimitEstimate>)>,
    /// Half the opening of the mirror cone, degrees.
    pub lobe: Option<LimitEstimate>,
    /// Nearest and farthest depth, mm.
    pub depth: [Option<LimitEstimate>; 2],
    /// Rates by each.
    pub model: ReturnModel,
}

impl LearnedReturns {
    /// Limits by which losses are put down to causes: those of a device that never has the worst incidence are not known. Nothing
    /// within a stretch without pairs is put down to the limit that lies somewhere in it.
    #[must_use]
    pub fn limits(&self, scanner: &Scanner) -> IdentifiedLimits {
        let of = |device: DeviceName| self.by_device.iter().find(|(name, _)| *name == device).and_then(|(_, limit)| *limit);
        let incidence_deg = scanner.devices.as_ref().map(|device| of(device.name).map(|limit| limit.between[1]));
        let [near, far] = self.depth;
        IdentifiedLimits {
            incidence_deg,
            lobe_deg: self.lobe.map(|lobe| lobe.between[0]),
            depth_mm: near.or(far).map(|_| {
                [near.map_or(scanner.near_mm, |near| near.between[0]), far.map_or(scanner.far_mm, |far| far.between[1])]
            }),
        }
    }
}

/// A pair as it counts.
#[derive(Clone, Copy)]
struct Pair {
    device: DeviceName,
    incidence_deg: f64,
    mirror_deg: f64,
    depth_mm: f64,
    is_returned: bool,
}

/// Counts along one axis, by view and of all.
struct Binned {
    width: f64,
    start: f64,
    by_view: Vec<Vec<CountedRate>>,
    all: Vec<CountedRate>,
}

impl Binned {
    fn new(
        pairs: &[Vec<Pair>],
        [start, width]: [f64; 2],
        bins: usize,
        place: impl Fn(&Pair) -> f64,
        counts: impl Fn(&Pair) -> bool,
    ) -> Self {
        let mut all = vec![CountedRate::default(); bins];
        let of_view = |pairs: &Vec<Pair>| {
            let mut binned = vec![CountedRate::default(); bins];
            for pair in pairs.iter().filter(|pair| counts(pair)) {
                let at = place(pair);
                let bin = ((at - start) / width).clamp(0.0, (bins - 1) as f64) as usize;
                let returned = f64::from(u8::from(pair.is_returned));
                binned[bin].add(&CountedRate { place_sum: at, pairs: 1.0, returned });
            }
            all.iter_mut().zip(&binned).for_each(|(all, of_view)| all.add(of_view));
            binned
        };
        let by_view = pairs.iter().map(of_view).collect();
        Self { width, start, by_view, all }
    }

    fn pairs(&self) -> f64 {
        self.all.iter().map(|bin| bin.pairs).sum()
    }

    /// The estimate, if enough pairs lie at the places that it leaves outside.
    fn told_by(&self, estimate: Identified, is_outside: impl Fn(f64, f64) -> bool) -> Option<Identified> {
        let outside = self.all.iter().filter(|bin| bin.pairs > 0.0 && is_outside(bin.place(), estimate.value));
        (outside.map(|bin| bin.pairs).sum::<f64>() >= MIN_PAIRS_BEYOND).then_some(estimate)
    }

    /// Ends of the stretch without pairs in which a crossing lies: the points on either side, or the end of the axis, if farther
    /// apart than those of two neighbouring bins can be. The place of the crossing twice where there is none.
    fn between(&self, Crossing { place, bracket: [from, to] }: Crossing) -> [f64; 2] {
        let between = [from.max(self.start), to.min(self.end())];
        if between[1] - between[0] > 2.0 * self.width { between } else { [place; 2] }
    }

    fn end(&self) -> f64 {
        self.start + self.width * self.all.len() as f64
    }

    /// The figure of all pairs with its interval by the jackknife, about the stretch without pairs in which it lies, and the ends
    /// of this stretch. The interval is the whole axis where the views but one do not show the figure.
    fn estimate(&self, figure: impl Fn(&[CountedRate]) -> Option<Crossing>) -> Option<(Identified, [f64; 2])> {
        let found = figure(&self.all)?;
        let (value, between) = (found.place, self.between(found));
        let without = |bins: &Vec<CountedRate>| {
            let mut others = self.all.clone();
            others.iter_mut().zip(bins).for_each(|(bin, of_view)| bin.remove(of_view));
            figure(&others).map(|found| found.place)
        };
        let told = self.by_view.iter().filter(|bins| bins.iter().any(|bin| bin.pairs > 0.0));
        let Some(left_out) = told.map(without).collect::<Option<Vec<f64>>>() else {
            return Some((Identified { value, interval: [self.start, self.end()] }, between));
        };
        let count = left_out.len() as f64;
        let mean = left_out.iter().sum::<f64>() / count;
        let squares: f64 = left_out.iter().map(|without| (without - mean).powi(2)).sum();
        let deviation = ((count - 1.0) / count * squares).sqrt();
        let reach = (student::quantile(left_out.len().saturating_sub(1) as f64) * deviation).max(0.5 * self.width);
        Some((Identified { value, interval: [between[0] - reach, between[1] + reach] }, between))
    }

    fn curve(&self, points: Vec<[f64; 2]>, easy_rate: f64) -> RateCurve {
        let bin = |(number, bin): (usize, &CountedRate)| RateBin {
            range: [self.start + self.width * number as f64, self.start + self.width * (number + 1) as f64],
            expected: bin.pairs as u64,
            returned: bin.returned as u64,
        };
        let bins = self.all.iter().enumerate().filter(|(_, bin)| bin.pairs > 0.0).map(bin).collect();
        RateCurve { bins, points: points.into_iter().map(|[place, rate]| [place, (rate / easy_rate).min(1.0)]).collect() }
    }
}

/// Identifies limits and rates; `None` where fewer than 200 easy pairs tell what a scanner returns at its best.
#[must_use]
pub fn returns(returns: &Returns, scanner: &Scanner) -> Option<LearnedReturns> {
    let pair = |of: Return| {
        let (device, incidence_rad) = of.worst_incidence();
        Pair {
            device,
            incidence_deg: incidence_rad.to_degrees(),
            mirror_deg: of.mirror_rad.to_degrees(),
            depth_mm: of.depth_mm,
            is_returned: of.is_returned,
        }
    };
    let expected = |view: usize| returns.of_view(view).filter(|of| of.is_expected).map(pair).collect();
    let pairs: Vec<Vec<Pair>> = (0..returns.views()).map(expected).collect();
    let halves_mm = [scanner.best_mm - scanner.near_mm, scanner.far_mm - scanner.best_mm];
    let is_focused = |pair: &Pair| {
        let half_mm = if pair.depth_mm < scanner.best_mm { halves_mm[0] } else { halves_mm[1] };
        (pair.depth_mm - scanner.best_mm).abs() <= EASY_DEPTH_SHARE * half_mm
    };
    let is_easy =
        |pair: &&Pair| pair.incidence_deg <= EASY_INCIDENCE_DEG && pair.mirror_deg >= EASY_MIRROR_DEG && is_focused(pair);
    let easy: Vec<&Pair> = pairs.iter().flatten().filter(is_easy).collect();
    let returned = easy.iter().filter(|pair| pair.is_returned).count() as f64;
    let easy_rate = returned / easy.len() as f64;
    // A scanner that returns next to nothing at its best has no limits that could be told.
    if (easy.len() as f64) < MIN_PAIRS || easy_rate < 0.05 {
        return None;
    }
    Some(learned(&pairs, scanner, easy_rate, &is_focused))
}

fn learned(pairs: &[Vec<Pair>], scanner: &Scanner, easy_rate: f64, is_focused: &dyn Fn(&Pair) -> bool) -> LearnedReturns {
    let is_off_cone = |pair: &Pair| pair.mirror_deg >= EASY_MIRROR_DEG;
    let by_incidence = |counts: &dyn Fn(&Pair) -> bool| {
        Binned::new(
            pairs,
            [0.0, INCIDENCE_BIN_DEG],
            INCIDENCE_BINS,
            |pair| pair.incidence_deg,
            |pair| counts(pair) && is_off_cone(pair) && is_focused(pair),
        )
    };
    let all = by_incidence(&|_| true);
    let incidence = falling_limit(&all, easy_rate);
    let by_device =
        DeviceName::ALL.map(|device| (device, falling_limit(&by_incidence(&|pair| pair.device == device), easy_rate)));
    let clear_deg = incidence.map_or(90.0, |known| known.between[0].min(known.limit.value - CLEAR_OF_LIMIT_DEG));
    let is_clear = |pair: &Pair| pair.incidence_deg <= clear_deg;
    let mirror = Binned::new(
        pairs,
        [0.0, MIRROR_BIN_DEG],
        MIRROR_BINS,
        |pair| pair.mirror_deg,
        |pair| is_clear(pair) && is_focused(pair) && pair.mirror_deg < MIRROR_BIN_DEG * MIRROR_BINS as f64,
    );
    let lobe = lobe_of(&mirror, easy_rate);
    let lobe_deg = lobe.map_or(0.0, |known| known.limit.value + 1.0);
    let is_undisturbed = |pair: &Pair| is_clear(pair) && pair.mirror_deg >= lobe_deg;
    let width_mm = DEPTH_BIN_MM.max((scanner.far_mm - scanner.near_mm) / DEPTH_BINS as f64);
    let depths = |is_near: bool| {
        Binned::new(
            pairs,
            [scanner.near_mm, width_mm],
            DEPTH_BINS,
            |pair| pair.depth_mm,
            |pair| is_undisturbed(pair) && (pair.depth_mm < scanner.best_mm) == is_near,
        )
    };
    let [near, far] = [depths(true), depths(false)];
    let mut depth = near.curve(rising(&near.all), easy_rate);
    let beyond = far.curve(falling(&far.all), easy_rate);
    depth.bins.extend(beyond.bins);
    depth.points.extend(beyond.points);
    LearnedReturns {
        pairs: pairs.iter().map(|pairs| pairs.len() as u64).sum(),
        views: pairs.len(),
        easy_rate,
        incidence,
        by_device: by_device.into(),
        lobe,
        depth: [rising_limit(&near, easy_rate), falling_limit(&far, easy_rate)],
        model: ReturnModel {
            easy_rate,
            incidence: all.curve(falling(&all.all), easy_rate),
            mirror: mirror.curve(rising(&mirror.all), easy_rate),
            depth,
        },
    }
}

/// Limit where a rate that never rises passes [`LIMIT_RATE`].
fn falling_limit(binned: &Binned, easy_rate: f64) -> Option<LimitEstimate> {
    let at = |bins: &[CountedRate], rate: f64| bracketed(&falling(bins), rate * easy_rate);
    limit_of(binned, LIMIT_RATE, at, |place, limit| place > limit)
}

/// Limit where a rate that never falls passes [`LIMIT_RATE`].
fn rising_limit(binned: &Binned, easy_rate: f64) -> Option<LimitEstimate> {
    let at = |bins: &[CountedRate], rate: f64| last_below(&rising(bins), rate * easy_rate);
    limit_of(binned, LIMIT_RATE, at, |place, limit| place < limit)
}

/// End of the mirror cone.
fn lobe_of(binned: &Binned, easy_rate: f64) -> Option<LimitEstimate> {
    let at = |bins: &[CountedRate], rate: f64| last_below(&rising(bins), rate * easy_rate);
    limit_of(binned, LOBE_RATE, at, |place, limit| place < limit)
}

/// Limit where a rate passes `limit_rate`, with the place where it passes [`PLAN_RATE`]. `at` finds the place at which counts pass a rate;
/// `is_outside` tells of a place and the limit, in this order, that the limit leaves the place outside.
fn limit_of(
    binned: &Binned,
    limit_rate: f64,
    at: impl Fn(&[CountedRate], f64) -> Option<Crossing>,
    is_outside: impl Fn(f64, f64) -> bool,
) -> Option<LimitEstimate> {
    let pairs = binned.pairs();
    if pairs < MIN_PAIRS {
        return None;
    }
    let (limit, between) = binned.estimate(|bins| at(bins, limit_rate))?;
    let limit = binned.told_by(limit, is_outside)?;
    let (plan, _) = binned.estimate(|bins| at(bins, limit_rate).map(|limit| at(bins, PLAN_RATE).unwrap_or(limit)))?;
    Some(LimitEstimate { limit, between, plan_with: plan.value, plan_interval: plan.interval, pairs: pairs as u64 })
}

/// Crossing at which a rising regression passes a rate; `None` where it begins above it.
fn last_below(points: &[[f64; 2]], rate: f64) -> Option<Crossing> {
    let mirrored: Vec<[f64; 2]> = points.iter().rev().map(|[place, rate]| [-place, *rate]).collect();
    let found = bracketed(&mirrored, rate);
    found.map(|Crossing { place, bracket: [from, to] }| Crossing { place: -place, bracket: [-to, -from] })
}
