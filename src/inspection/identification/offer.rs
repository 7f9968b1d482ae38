//! Changes that identified figures ask for in the scanner's specification and in the parameters of the next plan. Data alone: the
//! sentences are those of the interfaces, and nothing is applied by itself.

use super::{Identified, Learned, LearnedReturns, LimitEstimate, NoiseEstimate, Withheld};
use crate::cell::{DeviceName, Scanner, closed_list};
use crate::planning::params::{Knob, NoiseParams};

/// Change of a limit that is worth an offer: degrees, and mm of depth.
const MIN_CHANGE_DEG: f64 = 1.0;
const MIN_CHANGE_MM: f64 = 5.0;
/// Max half width, to either side, of the intervals of an offered limit of incidence or lobe, and of the value to plan with,
/// degrees. A plan with a limit that is too strict by 10° needs many more views: a limit that is known no better is no ground for
/// one. There is no source; it is our choice.
const MAX_HALF_WIDTH_DEG: f64 = 10.0;
/// Max half width, to either side, of the interval of an offered end of the depth, as a share of the scanner's depth range: at
/// 10 % the range that is left is known to within a tenth. There is no source; it is our choice.
const MAX_HALF_WIDTH_OF_DEPTH: f64 = 0.1;
/// Change of the noise that is worth an offer, as a share of the noise that is planned with: of 1 + g at the ends of the depth. There is no
/// source; it is our choice.
const MIN_CHANGE_OF_NOISE: f64 = 0.1;
/// Max half width of the interval of an offered gain g, as a share of 1 + g: of a part near the best focus, the noise at the ends of the
/// depth is only extrapolated. And of an offered noise at best focus, as a share of it: of a part away from the best focus, it is
/// what is extrapolated. There is no source; it is our choice.
const MAX_HALF_WIDTH_OF_GAIN: f64 = 0.25;
/// Largest gain that the noise of a scanner is believed to have: ten times the noise at the ends of its depth, and it would not be stated
/// to work there. A larger one fits points that are not scattered by noise alone, such as those beside a missing feature, and the noise at
/// best focus that comes with it is as wrong. There is no source; it is our choice.
const MAX_GAIN: f64 = 9.0;
/// Angles that incidence and lobe can have, degrees. An interval that reaches beyond them does not rule out that there is no limit.
const PHYSICAL_DEG: [f64; 2] = [0.0, 90.0];

closed_list! {
    /// Field that is offered another value.
    pub enum OfferedField {
        /// Parameter `limits.camera_deg`.
        CameraLimit = "camera_limit",
        /// Parameter `limits.projector_deg`.
        ProjectorLimit = "projector_limit",
        /// Parameter `materials.lobe_deg`.
        Lobe = "lobe",
        /// Parameter `regions.noise.best_mm`.
        NoiseBest = "noise_best",
        /// Parameter `regions.noise.depth_gain`.
        NoiseDepthGain = "noise_depth_gain",
        /// Field `depth_mm.near` of the scanner.
        DepthNear = "depth_near",
        /// Field `depth_mm.far` of the scanner.
        DepthFar = "depth_far",
    }
}

impl OfferedField {
    /// Key of the parameter; `None` where the field is the scanner's.
    #[must_use]
    pub fn parameter(self) -> Option<&'static str> {
        match self {
            Self::CameraLimit => Some("limits.camera_deg"),
            Self::ProjectorLimit => Some("limits.projector_deg"),
            Self::Lobe => Some("materials.lobe_deg"),
            Self::NoiseBest => Some("regions.noise.best_mm"),
            Self::NoiseDepthGain => Some("regions.noise.depth_gain"),
            Self::DepthNear | Self::DepthFar => None,
        }
    }

    /// Pointers of the field in the scanner's specification; none where it has none.
    #[must_use]
    pub fn in_scanner(self) -> &'static [&'static str] {
        match self {
            Self::CameraLimit => &["/left/incidence_max_deg", "/right/incidence_max_deg"],
            Self::ProjectorLimit => &["/projector/incidence_max_deg"],
            Self::DepthNear => &["/depth_mm/near"],
            Self::DepthFar => &["/depth_mm/far"],
            Self::Lobe | Self::NoiseBest | Self::NoiseDepthGain => &[],
        }
    }
}

/// A change that is offered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OfferedChange {
    /// The field.
    pub field: OfferedField,
    /// Value in force; `None` where there is none.
    pub from: Option<f64>,
    /// Value offered: rounded to the safe side.
    pub to: f64,
    /// Identified figure, from which the value follows.
    pub identified: Identified,
    /// Pairs or triples that it is from.
    pub count: u64,
}

/// Changes that are offered, in the order of [`OfferedField`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Offer {
    /// The changes.
    pub changes: Vec<OfferedChange>,
    /// Reasons for which scans teach little or nothing of the scanner's limits, in the order of [`Withheld`].
    pub withheld: Vec<Withheld>,
    /// Views that kept their stated poses, and all views; zeros where the limits were not judged.
    pub kept_views: [usize; 2],
}

/// Returns true if the interval of a limit and that of the value to plan with are narrow enough and lie within the physical range.
fn is_known(limit: &LimitEstimate, [min, max]: [f64; 2], max_half_width: f64) -> bool {
    let is_narrow = |value: f64, [low, high]: [f64; 2]| {
        low >= min && high <= max && value - low <= max_half_width && high - value <= max_half_width
    };
    is_narrow(limit.limit.value, limit.limit.interval) && is_narrow(limit.plan_with, limit.plan_interval)
}

/// Incidences between which nothing was seen and a camera's limit lies, which is for that not known well enough to be offered, degrees:
/// that of all devices together, or of the first camera of which this holds; `None` where the limits of both cameras are known.
#[must_use]
pub fn incidence_gap(returns: &LearnedReturns) -> Option<[f64; 2]> {
    let of_cameras = returns.by_device.iter().filter(|(device, _)| *device != DeviceName::Projector);
    let of_cameras: Vec<LimitEstimate> = of_cameras.filter_map(|(_, limit)| *limit).collect();
    let is_known = |limit: &LimitEstimate| is_known(limit, PHYSICAL_DEG, MAX_HALF_WIDTH_DEG);
    if of_cameras.len() == 2 && of_cameras.iter().all(is_known) {
        return None;
    }
    let is_open = |limit: &LimitEstimate| limit.between[0] < limit.between[1] && !is_known(limit);
    returns.incidence.into_iter().chain(of_cameras).find(is_open).map(|limit| limit.between)
}

/// The value of the parameter's range that is nearest to a value of the noise.
fn in_range_of(field: OfferedField, value: f64) -> f64 {
    let is_of_field = |knob: &&Knob| field.parameter().is_some_and(|key| key.strip_prefix("regions.noise.") == Some(knob.field));
    let range = NoiseParams::KNOBS.knobs.iter().find(is_of_field).and_then(|knob| knob.range);
    range.map_or(value, |[min, max]| value.clamp(min, max))
}

/// Changes of the noise in force that identified noise asks for: none where it is no noise that a scanner has.
fn noise_offers(known: &NoiseEstimate, noise: &NoiseParams) -> Vec<OfferedChange> {
    let gain = &known.depth_gain;
    if gain.value > MAX_GAIN {
        return Vec::new();
    }
    let count = known.triples as u64;
    // A change counts as a share of the offset and the value in force: the noise at the ends of the depth is 1 + g.
    let change = |field: OfferedField, offset: f64, from: f64, identified: Identified| {
        let [low, high] = identified.interval;
        let to = in_range_of(field, (identified.value * 1e5).round() / 1e5);
        let is_worth_it = (to - from).abs() > MIN_CHANGE_OF_NOISE * (offset + from) && !(low..=high).contains(&from);
        is_worth_it.then_some(OfferedChange { field, from: Some(from), to, identified, count })
    };
    let is_gain_known = 0.5 * (gain.interval[1] - gain.interval[0]) <= MAX_HALF_WIDTH_OF_GAIN * (1.0 + gain.value);
    let of_gain = change(OfferedField::NoiseDepthGain, 1.0, noise.depth_gain, *gain).filter(|_| is_gain_known);
    // Of triples at about one depth away from the best focus, the noise there is as open as the gain, determined or not.
    let [low, high] = known.best_mm.interval;
    let is_best_known = 0.5 * (high - low) <= MAX_HALF_WIDTH_OF_GAIN * known.best_mm.value;
    let of_best = change(OfferedField::NoiseBest, 0.0, noise.best_mm, known.best_mm).filter(|_| is_best_known);
    of_best.into_iter().chain(of_gain).collect()
}

/// Holds what was learned against the specification and the noise in force.
#[must_use]
pub fn offers(learned: &Learned, scanner: &Scanner, noise: &NoiseParams) -> Offer {
    let mut changes = Vec::new();
    let returns = learned.returns.as_ref();
    let known_angle = |limit: Option<LimitEstimate>| limit.filter(|limit| is_known(limit, PHYSICAL_DEG, MAX_HALF_WIDTH_DEG));
    let of_device = |device: DeviceName| {
        let mut by_device = returns.into_iter().flat_map(|returns| &returns.by_device);
        known_angle(by_device.find(|(name, _)| *name == device).and_then(|(_, limit)| *limit))
    };
    let [left, right] = [DeviceName::Left, DeviceName::Right].map(of_device);
    let cameras = match (left, right) {
        (Some(left), Some(right)) => Some(if left.plan_with <= right.plan_with { left } else { right }),
        (one, other) => one.or(other).or(known_angle(returns.and_then(|returns| returns.incidence))),
    };
    let own_deg = |devices: &[DeviceName]| {
        let limits = devices.iter().map(|device| scanner.devices[*device].incidence_max_rad.to_degrees());
        limits.fold(f64::INFINITY, f64::min)
    };
    let mut tighten = |field: OfferedField, limit: Option<LimitEstimate>, own_deg: f64| {
        let Some(limit) = limit.filter(|limit| limit.plan_with < own_deg - MIN_CHANGE_DEG) else { return };
        let to = limit.plan_with.floor().max(1.0);
        changes.push(OfferedChange { field, from: Some(own_deg), to, identified: limit.limit, count: limit.pairs });
    };
    tighten(OfferedField::CameraLimit, cameras, own_deg(&[DeviceName::Left, DeviceName::Right]));
    tighten(OfferedField::ProjectorLimit, of_device(DeviceName::Projector), own_deg(&[DeviceName::Projector]));
    if let Some(lobe) = known_angle(returns.and_then(|returns| returns.lobe)) {
        let to = lobe.plan_with.ceil();
        changes.push(OfferedChange { field: OfferedField::Lobe, from: None, to, identified: lobe.limit, count: lobe.pairs });
    }
    changes.extend(learned.noise.iter().flat_map(|known| noise_offers(known, noise)));
    let range_mm = [scanner.near_mm, scanner.far_mm];
    let max_half_width_mm = MAX_HALF_WIDTH_OF_DEPTH * (scanner.far_mm - scanner.near_mm);
    let known_depth = |limit: Option<LimitEstimate>| limit.filter(|limit| is_known(limit, range_mm, max_half_width_mm));
    let [near, far] = returns.map_or([None; 2], |returns| returns.depth).map(known_depth);
    let mut depth = |field: OfferedField, limit: Option<LimitEstimate>, from: f64, is_tighter: bool, to: f64| {
        let Some(limit) = limit.filter(|_| is_tighter) else { return };
        changes.push(OfferedChange { field, from: Some(from), to, identified: limit.limit, count: limit.pairs });
    };
    let [near_mm, far_mm] = [near.map_or(0.0, |near| near.plan_with.ceil()), far.map_or(0.0, |far| far.plan_with.floor())];
    depth(OfferedField::DepthNear, near, scanner.near_mm, near_mm > scanner.near_mm + MIN_CHANGE_MM, near_mm);
    depth(OfferedField::DepthFar, far, scanner.far_mm, far_mm < scanner.far_mm - MIN_CHANGE_MM, far_mm);
    Offer { changes, ..Offer::default() }
}
