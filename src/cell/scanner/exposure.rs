//! Exposure: the brightness at which cameras see a surface point under each level of the projector, and the levels at which the point
//! can be measured.
//!
//! **Signal** of a point in a camera, grey values, at level L:
//!
//! S = W · g(L) · (F / d_p)² · (ρ · cos θ_p + s · [inside the mirror cone])
//!
//! with W the signal of a white surface (ρ = 1) that faces the projector at the best focus at level 5, g(L) the gain of the level
//! relative to level 5, d_p the distance to the projector and F that of the best focus, θ_p the incidence of the projector's ray, ρ
//! the albedo and s the gloss. The distance of the camera drops out: a pixel sees more surface as it gets less light from each spot.
//! Ambient light adds A · ρ · full scale whatever the level. Fringes modulate S between 0 and its value, so that their modulation is
//! S / 2. A point is **saturated** where the sum exceeds 95 % of full scale in either camera, **dark** where the modulation is below the
//! least that can be decoded in either. It is Lambert's law with the inverse square of the distance (B. K. P. Horn 1986, *Robot
//! Vision*, chapter 10); the even mirror cone is a simplification of our own.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::material::Material;
use crate::cell::closed_list;
use crate::cell::field_error::Findings;
use crate::cell::field_ranges;

/// Number of brightness levels.
pub const LEVELS: usize = 10;
/// Level to which gains relate, the thesis's (§4.2.1): of 1, 3, 5 and 7 from the zenith it comes closest to the simulation without
/// spray.
pub const REFERENCE_LEVEL: u8 = 5;
/// Share of full scale above which a pixel counts as saturated. It has no published source.
const SATURATED: f64 = 0.95;
/// Step of the assumed gains, √2: two levels double the light. No figures are published for the scanner.
const ASSUMED_STEP: f64 = std::f64::consts::SQRT_2;
/// Assumed full scale, grey values: cameras of 8 bits.
const ASSUMED_FULL_SCALE: f64 = 255.0;
/// Assumed W as a share of full scale: dull white of ρ = 0.8 at the near end of the default scanner's working depth, (480 / 410)²
/// times as bright as at the best focus, just does not saturate at level 5.
const ASSUMED_WHITE: f64 = 0.86;
/// Assumed least modulation as a share of full scale, 16 of 255 grey values: such that dull black of ρ = 0.05 needs level 9 where it
/// faces the projector and is missed elsewhere, as dark surfaces are in the thesis (§4.2.1). No figure is published.
const ASSUMED_MIN_MODULATION: f64 = 16.0 / 255.0;
/// Range of a full scale, grey values: cameras of up to 16 bits.
const FULL_SCALE: [f64; 2] = [1.0, 65_535.0];
/// Ranges of W and of the least modulation, as shares of full scale.
const WHITE: [f64; 2] = [0.01, 100.0];
const MODULATION: [f64; 2] = [1e-4, 0.4];

/// Brightness levels of the projector and what the cameras make of them. Unknown fields are refused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct ExposureSpec {
    /// Light of the levels 0 to 9, relative to each other, each more than the one before, 1e-4 to 1e4. `vantage calibrate brightness`
    /// identifies them.
    #[schema(min_items = 10, max_items = 10)]
    pub levels: [f64; LEVELS],
    /// Grey value of a saturated pixel, 1 to 65535. Default 255.
    #[serde(default = "assumed_full_scale")]
    pub full_scale: f64,
    /// Grey value that the projector gives a white surface (albedo 1) which faces it at the best focus, at level 5; 0.01 to 100 times
    /// `full_scale`. Default: 0.86 times `full_scale`, assumed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub white_signal: Option<f64>,
    /// Minimum modulation of the fringes that can be decoded, grey values, half the difference between bright and dark; 0.0001 to
    /// 0.4 times `full_scale`. Default: 16/255 of `full_scale`, assumed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min_modulation: Option<f64>,
}

fn assumed_full_scale() -> f64 {
    ASSUMED_FULL_SCALE
}

impl Default for ExposureSpec {
    /// Levels that were assumed.
    fn default() -> Self {
        let exponent = |level: usize| level as i32 - i32::from(REFERENCE_LEVEL);
        let levels = std::array::from_fn(|level| ASSUMED_STEP.powi(exponent(level)));
        Self { levels, full_scale: ASSUMED_FULL_SCALE, white_signal: None, min_modulation: None }
    }
}

field_ranges! {
    ExposureSpec {
        LEVELS = "levels", [1e-4, 1e4] "";
        FULL_SCALE = "full_scale", [FULL_SCALE[0], FULL_SCALE[1]] "grey values";
        // The ranges of every full scale; the check is against the scanner's own.
        WHITE_SIGNAL = "white_signal", [WHITE[0] * FULL_SCALE[0], WHITE[1] * FULL_SCALE[1]] "grey values";
        MIN_MODULATION = "min_modulation", [MODULATION[0] * FULL_SCALE[0], MODULATION[1] * FULL_SCALE[1]] "grey values";
    }
}

impl ExposureSpec {
    pub(super) fn check(&self, pointer: &str, findings: &mut Findings) {
        Self::LEVELS.check(pointer, &self.levels, findings);
        for (level, pair) in (1..).zip(self.levels.windows(2)) {
            findings.require(pair[0] < pair[1], format!("{pointer}/levels/{level}"), || {
                format!("is {}, not more than {} of the level before; order them from dark to bright", pair[1], pair[0])
            });
        }
        Self::FULL_SCALE.check(pointer, &self.full_scale, findings);
        let full_scale = self.full_scale.clamp(FULL_SCALE[0], FULL_SCALE[1]);
        let mut range_of_full = |name: &str, value: Option<f64>, [min, max]: [f64; 2]| {
            let Some(value) = value else { return };
            findings.range(format!("{pointer}/{name}"), value, min * full_scale, max * full_scale, "grey values");
        };
        range_of_full("white_signal", self.white_signal, WHITE);
        range_of_full("min_modulation", self.min_modulation, MODULATION);
    }

    /// Builds what was checked; `None` stands for levels that are not known.
    pub(super) fn build(spec: Option<&Self>) -> Exposure {
        let is_assumed = spec.is_none();
        let spec = spec.copied().unwrap_or_default();
        let reference = spec.levels[usize::from(REFERENCE_LEVEL)];
        Exposure {
            gains: spec.levels.map(|gain| gain / reference),
            white: spec.white_signal.map_or(ASSUMED_WHITE, |white| white / spec.full_scale),
            min_modulation: spec.min_modulation.map_or(ASSUMED_MIN_MODULATION, |least| least / spec.full_scale),
            is_assumed,
        }
    }
}

/// Exposure of a scanner, checked; signals are shares of full scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exposure {
    /// Gain of each level relative to level 5, ascending.
    pub gains: [f64; LEVELS],
    /// W: signal of a white surface that faces the projector at the best focus, at level 5.
    pub white: f64,
    /// Minimum modulation that can be decoded.
    pub min_modulation: f64,
    /// True if the specification says nothing of it, and figures were assumed.
    pub is_assumed: bool,
}

/// Light on a surface point and its way to the cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lighting {
    /// Cosine of the incidence of the projector's ray, θ_p.
    pub cos_projector: f64,
    /// F / d_p.
    pub nearness: f64,
    /// Angle between the mirrored ray of the projector and the direction to each camera, rad.
    pub mirror_rad: [f64; 2],
}

closed_list! {
    /// Reason for which a point that is seen cannot be measured at a brightness level.
    pub enum ExposureFault {
        /// Too little light.
        Dark = "dark",
        /// Too much light.
        Saturated = "saturated",
    }
}

/// Levels at which a point can be measured: it is dark below them and saturated above.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LevelRange {
    /// First level at which it is not dark; 10 where it is dark at every level.
    first: u8,
    /// First level at which it is saturated; 10 where it is not at any.
    end: u8,
}

impl LevelRange {
    /// Fault at a level; `None` where the point can be measured.
    #[must_use]
    pub fn fault(self, level: u8) -> Option<ExposureFault> {
        match level {
            level if level >= self.end => Some(ExposureFault::Saturated),
            level if level < self.first => Some(ExposureFault::Dark),
            _ => None,
        }
    }

    /// Fault at all of some levels; `None` where the point can be measured at one of them. A point that is dark at one and saturated
    /// at another counts as saturated.
    #[must_use]
    pub fn fault_at_all(self, levels: &[u8]) -> Option<ExposureFault> {
        let faults: Option<Vec<_>> = levels.iter().map(|level| self.fault(*level)).collect();
        faults.and_then(|faults| faults.into_iter().max())
    }

    /// Returns true if there is a level among some at which the point can be measured.
    #[must_use]
    pub fn is_lit_at_any(self, levels: std::ops::RangeInclusive<u8>) -> bool {
        self.first.max(*levels.start()) < self.end.min(levels.end() + 1)
    }
}

impl Exposure {
    /// Share of full scale that the projector's light gives a point in each camera at level 5.
    #[must_use]
    pub fn signals(&self, material: &Material, lighting: &Lighting) -> [f64; 2] {
        let Lighting { cos_projector, nearness, mirror_rad } = lighting;
        let diffuse = material.albedo * cos_projector.max(0.0);
        let light = self.white * nearness * nearness;
        mirror_rad.map(|angle_rad| light * (diffuse + if angle_rad < material.lobe_rad { material.gloss } else { 0.0 }))
    }

    /// Levels at which a point can be measured; `ambient` is the share of full scale that ambient light alone gives a white surface.
    #[must_use]
    pub fn levels(&self, material: &Material, lighting: &Lighting, ambient: f64) -> LevelRange {
        let [left, right] = self.signals(material, lighting);
        let (least, most, offset) = (left.min(right), left.max(right), ambient * material.albedo);
        let count_while = |holds: &dyn Fn(f64) -> bool| self.gains.iter().take_while(|gain| holds(**gain)).count() as u8;
        LevelRange {
            first: count_while(&|gain| 0.5 * gain * least < self.min_modulation),
            end: count_while(&|gain| gain * most + offset <= SATURATED),
        }
    }
}

/// Brightness of the captures of one view: the level with the largest area that is neither saturated nor dark, and a second one where
/// that adds at least `min_gain` of the area. Among levels that do alike the one nearest to level 5 is taken, then the darker.
///
/// `points` are levels and area of each surface point. Cost: O(points) and 100.
#[must_use]
pub fn best_levels(points: &[(LevelRange, f64)], min_gain: f64) -> Vec<u8> {
    let mut area_mm2 = [[0.0; LEVELS + 1]; LEVELS + 1];
    for (range, mm2) in points {
        area_mm2[usize::from(range.first)][usize::from(range.end)] += mm2;
    }
    let classes = (0..=LEVELS as u8).flat_map(|first| (0..=LEVELS as u8).map(move |end| LevelRange { first, end }));
    let classes: Vec<(LevelRange, f64)> =
        classes.map(|range| (range, area_mm2[usize::from(range.first)][usize::from(range.end)])).collect();
    let lit_mm2 = |levels: &[u8]| -> f64 {
        classes.iter().filter(|(range, _)| range.fault_at_all(levels).is_none()).map(|(_, mm2)| mm2).sum()
    };
    let whole_mm2: f64 = classes.iter().map(|(_, mm2)| mm2).sum();
    let mut in_order: Vec<u8> = (0..LEVELS as u8).collect();
    in_order.sort_by_key(|level| (level.abs_diff(REFERENCE_LEVEL), *level));
    // Sums of the same areas in another order differ in their last digits.
    let slack_mm2 = 1e-9 * whole_mm2;
    let best = |options: Vec<Vec<u8>>| {
        let mut best = (Vec::new(), f64::NEG_INFINITY);
        for option in options {
            let mm2 = lit_mm2(&option);
            if mm2 > best.1 + slack_mm2 {
                best = (option, mm2);
            }
        }
        best
    };
    let (one, of_one_mm2) = best(in_order.iter().map(|level| vec![*level]).collect());
    let pairs = in_order.iter().enumerate().flat_map(|(at, a)| in_order[at + 1..].iter().map(|b| vec![*a.min(b), *a.max(b)]));
    let (two, of_two_mm2) = best(pairs.collect());
    if whole_mm2 > 0.0 && of_two_mm2 - of_one_mm2 >= min_gain * whole_mm2 { two } else { one }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Finish;

    /// A point that faces the projector at the best focus, off any mirror cone.
    const FACING: Lighting = Lighting { cos_projector: 1.0, nearness: 1.0, mirror_rad: [0.5; 2] };

    fn assumed() -> Exposure {
        ExposureSpec::build(None)
    }

    fn range(finish: Finish, lighting: &Lighting) -> LevelRange {
        assumed().levels(&finish.material(), lighting, 0.0)
    }

    #[test]
    fn dull_resin_is_taken_at_level_5_and_black_at_9() {
        let over_a_part = |finish: Finish| -> Vec<(LevelRange, f64)> {
            let places =
                (0..70).flat_map(|tilt_deg| [0.85, 1.0, 1.17].map(|nearness| (f64::from(tilt_deg).to_radians().cos(), nearness)));
            places
                .map(|(cos_projector, nearness)| (range(finish, &Lighting { cos_projector, nearness, ..FACING }), 1.0))
                .collect()
        };
        assert_eq!(best_levels(&over_a_part(Finish::MatteWhite), 0.01), [5], "the thesis's anchor");
        assert_eq!(best_levels(&over_a_part(Finish::Black), 0.01), [9]);
        assert_eq!(range(Finish::MatteWhite, &Lighting { nearness: 480.0 / 410.0, ..FACING }).fault(5), None);
        assert_eq!(range(Finish::MatteWhite, &FACING).fault(6), Some(ExposureFault::Saturated));
        assert_eq!(range(Finish::Black, &FACING).fault(8), Some(ExposureFault::Dark));
    }

    #[test]
    fn glare_saturates_every_level_and_ambient_light_the_high_ones() {
        let glare = range(Finish::Polished, &Lighting { mirror_rad: [0.5, 0.05], ..FACING });
        assert!((0..10).all(|level| glare.fault(level).is_some()) && !glare.is_lit_at_any(0..=9));
        let beside = range(Finish::Polished, &Lighting { mirror_rad: [0.5, 0.08], ..FACING });
        assert!(beside.is_lit_at_any(0..=9), "4 degrees are 0.0698 rad");
        let white = Finish::MatteWhite.material();
        let lit = assumed().levels(&white, &FACING, 0.4);
        assert_eq!([4, 5].map(|level| lit.fault(level)), [None, Some(ExposureFault::Saturated)]);
    }

    #[test]
    fn two_levels_are_taken_where_one_leaves_a_hundredth_and_ties_go_to_level_5() {
        let (dark, bright) = (LevelRange { first: 7, end: 10 }, LevelRange { first: 0, end: 4 });
        assert_eq!(best_levels(&[(dark, 50.0), (bright, 50.0)], 0.01), [3, 7]);
        assert_eq!(best_levels(&[(dark, 99.5), (bright, 0.5)], 0.01), [7], "half a hundredth is not worth a capture");
        assert_eq!(best_levels(&[(LevelRange { first: 2, end: 9 }, 1.0)], 0.01), [5]);
        assert_eq!(best_levels(&[(LevelRange { first: 10, end: 10 }, 1.0)], 0.01), [5], "nothing is lit at any");
        assert_eq!(best_levels(&[], 0.01), [5]);
        assert_eq!(dark.fault_at_all(&[3, 5]), Some(ExposureFault::Dark));
    }

    #[test]
    fn levels_of_a_specification_ascend_and_figures_stay_in_their_range() {
        let pointers = |spec: &ExposureSpec| {
            let mut findings = Findings::default();
            spec.check("/exposure", &mut findings);
            findings.into_result().err().unwrap_or_default().into_iter().map(|error| error.pointer).collect::<Vec<_>>()
        };
        let sound = ExposureSpec { white_signal: Some(180.0), min_modulation: Some(10.0), ..ExposureSpec::default() };
        assert_eq!(pointers(&sound), Vec::<String>::new());
        let mut bad = ExposureSpec { min_modulation: Some(200.0), ..sound };
        bad.levels[3] = bad.levels[2];
        assert_eq!(pointers(&bad), ["/exposure/levels/3", "/exposure/min_modulation"]);
        let built = ExposureSpec::build(Some(&ExposureSpec { levels: sound.levels.map(|gain| 3.0 * gain), ..sound }));
        assert!((built.gains[5] - 1.0).abs() < 1e-12 && (built.white - 180.0 / 255.0).abs() < 1e-12 && !built.is_assumed);
    }
}
