//! Brightness levels of a projector identified from captures of one scene, one at each level, such as a white plate from the zenith.
//!
//! Two witnesses of the gain of a level, each relative to level 5 ([`crate::cell::Exposure`]):
//!
//! - mean grey value I of the lit scene, less that of the ambient light A: g ∝ I − A, sd(ln g) = s / ((I − A) √n) with s the standard
//!   deviation of a pixel and n their number;
//! - noise σ of the measured points: phase noise goes with the inverse of the modulation (σ_φ = √(2/N) · σ_I / B for N steps), so g ∝
//!   1 / σ, sd(ln g) = 1 / √(2n).
//!
//! They are joined by the inverse of their variances. Levels whose mean exceeds 95 % of full scale tell nothing. The logarithms are then
//! made monotone by pooling adjacent violators (Barlow, Bartholomew, Bremner and Brunk 1972, *Statistical Inference under Order
//! Restrictions*), and levels without a witness lie on the straight line through their neighbours.

use crate::cell::field_error::{FieldError, Findings};
use crate::cell::{LEVELS, REFERENCE_LEVEL};
use crate::geometry::counted;

/// Share of full scale above which a mean grey value tells nothing of the light.
const SATURATED: f64 = 0.95;
/// Minimum step between the logarithms of neighbouring gains: a level is not darker than the one before it.
const MIN_STEP: f64 = 1e-3;
/// Fewest levels with a witness: two make a line.
const MIN_LEVELS: usize = 2;
/// Standard deviations within which a fall of the gain from one level to the next is noise.
const NOISE_SIGMAS: f64 = 3.0;

/// One capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelCapture {
    /// Brightness level.
    pub level: u8,
    /// Mean grey value of the fully lit scene and standard deviation of a pixel.
    pub signal: Option<[f64; 2]>,
    /// Noise of the measured points, mm.
    pub noise_mm: Option<f64>,
    /// Number of pixels or points that the figures are of.
    pub points: u32,
    /// Share of the scene that was measured.
    pub returned: Option<f64>,
}

/// Captures of one scene.
#[derive(Clone, Debug, PartialEq)]
pub struct BrightnessSweep {
    /// Grey value of a saturated pixel.
    pub full_scale: f64,
    /// Mean grey value with the projector off.
    pub ambient_signal: f64,
    /// Light that the scene scatters, relative to a white surface that faces the projector at the best focus: ρ · cos θ_p · (F / d_p)²;
    /// `None` where it is not known.
    pub relative_light: Option<f64>,
    /// The captures.
    pub captures: Vec<LevelCapture>,
}

/// Gain of a level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelGain {
    /// Gain relative to level 5.
    pub gain: f64,
    /// Standard deviation of its logarithm; `None` where no capture tells it and it lies between or beyond its neighbours.
    pub relative_sd: Option<f64>,
}

/// Identified levels.
#[derive(Clone, Debug, PartialEq)]
pub struct BrightnessLevels {
    /// Gain of each level.
    pub gains: [LevelGain; LEVELS],
    /// Grey value that a white surface has at level 5, where the scene and its grey values are known.
    pub white_signal: Option<f64>,
    /// Level at which the largest share of the scene was measured, the lowest noise among equals.
    pub best_level: Option<u8>,
    /// Levels that were darker than the one before by more than their noise: mixed up, or the scene changed.
    pub falling: Vec<u8>,
    /// Levels whose grey values were saturated.
    pub saturated: Vec<u8>,
}

/// A logarithm with its weight.
#[derive(Clone, Copy)]
struct Witness {
    log: f64,
    weight: f64,
}

impl BrightnessSweep {
    /// Identifies the levels.
    ///
    /// # Errors
    /// Figures out of range, each with its place; fewer than two levels of which anything is known.
    pub fn identify(&self) -> Result<BrightnessLevels, Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check(&mut findings);
        findings.into_result()?;
        let by_signal = self.by_signal();
        let by_noise = self.by_noise();
        let joined = join(&by_signal, &by_noise);
        let known = joined.iter().flatten().count();
        if known < MIN_LEVELS {
            let detail = format!(
                "tell the light of {}; give at least {MIN_LEVELS} that are neither saturated nor dark",
                counted(known, "level")
            );
            return Err(vec![FieldError { pointer: "/captures".into(), detail }]);
        }
        let logs = through(&monotone(&joined));
        let reference = logs[usize::from(REFERENCE_LEVEL)];
        let gain = |level: usize| LevelGain {
            gain: (logs[level] - reference).exp(),
            relative_sd: joined[level].map(|witness| witness.weight.recip().sqrt()),
        };
        Ok(BrightnessLevels {
            gains: std::array::from_fn(gain),
            white_signal: self.white_signal(&by_signal, &logs),
            best_level: self.best_level(),
            falling: falling(&joined),
            saturated: self.captures.iter().filter(|capture| self.is_saturated(capture)).map(|capture| capture.level).collect(),
        })
    }

    fn check(&self, findings: &mut Findings) {
        findings.range("/full_scale", self.full_scale, 1.0, 65_535.0, "grey values");
        findings.range("/ambient_signal", self.ambient_signal, 0.0, 0.9 * self.full_scale.max(1.0), "grey values");
        if let Some(light) = self.relative_light {
            findings.range("/relative_light", light, 1e-3, 10.0, "");
        }
        let mut seen = [false; LEVELS];
        for (index, capture) in self.captures.iter().enumerate() {
            let at = |name: &str| format!("/captures/{index}/{name}");
            findings.range(at("level"), f64::from(capture.level), 0.0, (LEVELS - 1) as f64, "");
            findings.range(at("points"), f64::from(capture.points), 10.0, f64::from(u32::MAX), "points");
            if let Some([mean, sd]) = capture.signal {
                findings.range(at("mean_signal"), mean, 0.0, self.full_scale, "grey values");
                findings.range(at("sd_signal"), sd, 1e-6, self.full_scale, "grey values");
            }
            if let Some(noise_mm) = capture.noise_mm {
                findings.range(at("noise_mm"), noise_mm, 1e-6, 10.0, "mm");
            }
            if let Some(returned) = capture.returned {
                findings.range(at("returned"), returned, 0.0, 1.0, "");
            }
            if let Some(seen) = seen.get_mut(usize::from(capture.level)) {
                findings.require(!*seen, at("level"), || format!("is {} a second time; give one capture a level", capture.level));
                *seen = true;
            }
        }
    }

    fn is_saturated(&self, capture: &LevelCapture) -> bool {
        capture.signal.is_some_and(|[mean, _]| mean > SATURATED * self.full_scale)
    }

    fn by_signal(&self) -> [Option<Witness>; LEVELS] {
        let mut witnesses = [None; LEVELS];
        for capture in self.captures.iter().filter(|capture| !self.is_saturated(capture)) {
            let Some([mean, sd]) = capture.signal else { continue };
            let light = mean - self.ambient_signal;
            let of_mean = sd / f64::from(capture.points).sqrt();
            // Light that its own noise hides tells nothing.
            if light > NOISE_SIGMAS * of_mean {
                witnesses[usize::from(capture.level)] = Some(Witness { log: light.ln(), weight: (light / of_mean).powi(2) });
            }
        }
        witnesses
    }

    fn by_noise(&self) -> [Option<Witness>; LEVELS] {
        let mut witnesses = [None; LEVELS];
        for capture in self.captures.iter().filter(|capture| !self.is_saturated(capture)) {
            let noise = capture.noise_mm.map(|mm| Witness { log: -mm.ln(), weight: 2.0 * f64::from(capture.points) });
            witnesses[usize::from(capture.level)] = noise;
        }
        witnesses
    }

    fn white_signal(&self, by_signal: &[Option<Witness>; LEVELS], logs: &[f64; LEVELS]) -> Option<f64> {
        let light = self.relative_light?;
        let of = |(witness, log): (&Option<Witness>, &f64)| witness.map(|known| (known.weight, known.log - log));
        let known: Vec<(f64, f64)> = by_signal.iter().zip(logs).filter_map(of).collect();
        let weight: f64 = known.iter().map(|(weight, _)| weight).sum();
        let offset = known.iter().map(|(weight, offset)| weight * offset).sum::<f64>() / weight;
        (weight > 0.0).then(|| (offset + logs[usize::from(REFERENCE_LEVEL)]).exp() / light)
    }

    fn best_level(&self) -> Option<u8> {
        let noise = |capture: &LevelCapture| capture.noise_mm.unwrap_or(f64::INFINITY);
        let measured = self.captures.iter().filter_map(|capture| Some((capture, capture.returned?)));
        let best = measured.max_by(|(a, of_a), (b, of_b)| of_a.total_cmp(of_b).then(noise(b).total_cmp(&noise(a))));
        best.map(|(capture, _)| capture.level)
    }
}

/// Two sets of witnesses that know their logarithms up to a constant each, as one: the second is moved to where it agrees with the
/// first on the levels that both know.
fn join(first: &[Option<Witness>; LEVELS], second: &[Option<Witness>; LEVELS]) -> [Option<Witness>; LEVELS] {
    let both: Vec<_> = first.iter().zip(second).filter_map(|(a, b)| a.as_ref().zip(b.as_ref())).collect();
    if both.is_empty() {
        return if first.iter().flatten().count() >= second.iter().flatten().count() { *first } else { *second };
    }
    let weight = |(a, b): &(&Witness, &Witness)| (a.weight.recip() + b.weight.recip()).recip();
    let whole: f64 = both.iter().map(weight).sum();
    let offset = both.iter().map(|pair| weight(pair) * (pair.0.log - pair.1.log)).sum::<f64>() / whole;
    std::array::from_fn(|level| match (first[level], second[level]) {
        (Some(a), Some(b)) => {
            let sum = a.weight + b.weight;
            Some(Witness { log: (a.weight * a.log + b.weight * (b.log + offset)) / sum, weight: sum })
        }
        (Some(a), None) => Some(a),
        (None, Some(b)) => Some(Witness { log: b.log + offset, ..b }),
        (None, None) => None,
    })
}

/// Levels whose light falls below that of the known level before by more than the noise of both.
fn falling(levels: &[Option<Witness>; LEVELS]) -> Vec<u8> {
    let known: Vec<(u8, Witness)> = (0..).zip(levels).filter_map(|(level, witness)| Some((level, (*witness)?))).collect();
    let falls = |pair: &&[(u8, Witness)]| {
        let [(_, a), (_, b)] = [pair[0], pair[1]];
        a.log - b.log > NOISE_SIGMAS * (a.weight.recip() + b.weight.recip()).sqrt()
    };
    known.windows(2).filter(falls).map(|pair| pair[1].0).collect()
}

/// Pools adjacent violators: the nearest logarithms, by weight, that never fall.
fn monotone(levels: &[Option<Witness>; LEVELS]) -> Vec<(usize, f64)> {
    let mut pools: Vec<(Witness, Vec<usize>)> = Vec::new();
    for (level, witness) in levels.iter().enumerate() {
        let Some(mut pool) = *witness else { continue };
        let mut members = vec![level];
        while let Some((last, earlier)) = pools.pop_if(|(last, _)| last.log >= pool.log) {
            let weight = last.weight + pool.weight;
            pool = Witness { log: (last.weight * last.log + pool.weight * pool.log) / weight, weight };
            members.splice(0..0, earlier);
        }
        pools.push((pool, members));
    }
    pools.into_iter().flat_map(|(pool, members)| members.into_iter().map(move |level| (level, pool.log))).collect()
}

/// Logarithms of all levels from those of some: straight lines between neighbours, and the mean step beyond the ends.
fn through(known: &[(usize, f64)]) -> [f64; LEVELS] {
    let (first, last) = (known[0], known[known.len() - 1]);
    let mean_step = ((last.1 - first.1) / (last.0 - first.0).max(1) as f64).max(MIN_STEP);
    let at = |level: usize| {
        if level < first.0 {
            return first.1 - mean_step * (first.0 - level) as f64;
        }
        if level >= last.0 {
            return last.1 + mean_step * (level - last.0) as f64;
        }
        let after = known.partition_point(|(of, _)| *of <= level);
        let ((a, from), (b, to)) = (known[after - 1], known[after]);
        from + (to - from) * (level - a) as f64 / (b - a) as f64
    };
    let mut logs: [f64; LEVELS] = std::array::from_fn(at);
    // Pooled levels are equal, and levels of a specification differ.
    for level in 1..LEVELS {
        logs[level] = logs[level].max(logs[level - 1] + MIN_STEP);
    }
    logs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::halton::halton;

    /// A normal deviate for each place, fixed.
    fn normal(place: u32) -> f64 {
        let [u, v] = [2, 3].map(|base| halton(place + 1, base));
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }

    const TRUE_GAINS: [f64; LEVELS] = [0.12, 0.2, 0.33, 0.5, 0.72, 1.0, 1.4, 2.1, 2.9, 4.2];

    /// A plate of ρ = 0.8 that faces the projector, of which white has 150 grey values at level 5; noise of 2 grey values a pixel.
    fn sweep(with_signal: bool, with_noise: bool) -> BrightnessSweep {
        let capture = |level: u8| {
            let light = 0.8 * 150.0 * TRUE_GAINS[usize::from(level)];
            let mean = (light + 6.0 + 0.02 * normal(u32::from(level))).min(255.0);
            let noise_mm = 0.012 / TRUE_GAINS[usize::from(level)] * (1.0 + normal(20 + u32::from(level)) / 200.0);
            LevelCapture {
                level,
                signal: with_signal.then_some([mean, 2.0]),
                noise_mm: with_noise.then_some(noise_mm),
                points: 20_000,
                returned: Some(if mean > 242.0 { 0.1 } else { 0.9 }),
            }
        };
        let captures = (0..LEVELS as u8).map(capture).collect();
        BrightnessSweep { full_scale: 255.0, ambient_signal: 6.0, relative_light: Some(0.8), captures }
    }

    fn worst(levels: &BrightnessLevels, of: std::ops::Range<usize>) -> f64 {
        of.map(|level| (levels.gains[level].gain / TRUE_GAINS[level]).ln().abs()).fold(0.0, f64::max)
    }

    #[test]
    fn gains_come_back_from_grey_values_and_from_noise() {
        let by_signal = sweep(true, false).identify().expect("levels");
        assert!(worst(&by_signal, 0..7) < 0.005, "{by_signal:?}");
        assert_eq!(by_signal.saturated, [7, 8, 9], "of 258, 354 and 510 grey values");
        assert!(by_signal.gains[8].relative_sd.is_none() && by_signal.gains[6].relative_sd.is_some());
        let white = by_signal.white_signal.expect("a known plate");
        assert!((white - 150.0).abs() < 0.5, "{white}");
        let by_noise = sweep(false, true).identify().expect("levels");
        assert!(worst(&by_noise, 0..10) < 0.02, "{by_noise:?}");
        assert_eq!((by_noise.white_signal, by_noise.falling.len()), (None, 0));
        assert!(by_signal.gains.windows(2).all(|pair| pair[0].gain < pair[1].gain));
    }

    #[test]
    fn the_best_level_is_the_one_that_measures_most_with_the_least_noise() {
        assert_eq!(sweep(true, true).identify().expect("levels").best_level, Some(6));
    }

    #[test]
    fn swapped_levels_and_bad_figures_are_named() {
        let mut swapped = sweep(true, false);
        (swapped.captures[2].level, swapped.captures[3].level) = (3, 2);
        assert_eq!(swapped.identify().expect("levels").falling, [3]);
        let mut bad = sweep(true, false);
        bad.captures[1].level = 0;
        bad.captures[2].points = 1;
        let pointers: Vec<String> = bad.identify().expect_err("bad").into_iter().map(|error| error.pointer).collect();
        assert_eq!(pointers, ["/captures/1/level", "/captures/2/points"]);
        let dark = BrightnessSweep { captures: sweep(true, false).captures[..1].to_vec(), ..sweep(true, false) };
        assert_eq!(dark.identify().expect_err("one level")[0].pointer, "/captures");
    }
}
