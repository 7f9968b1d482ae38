//! Identified figures held against those that synthetic returns and triples were made with (row I7).

use super::*;
use crate::cell::{DeviceName, PerDevice, Presets, Scanner, SpecLibrary};
use crate::inspection::coverage::{IdentifiedLimits, Return, Returns};
use crate::planning::ids::SampleId;
use crate::planning::params::NoiseParams;

fn scanner() -> Scanner {
    Presets.scanner("transcan-c-nominal").expect("a preset").build().expect("sound")
}

/// Numbers of a stream of our own: SplitMix64 and Box and Muller.
struct Draws(u64);

impl Draws {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }

    fn within(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.unit()
    }
}

/// Triples over the working depth and incidences up to 70°, a share of which lies on steps of depth.
fn triples_of(best_mm: f64, gain: f64, count: usize, steps: f64, seed: u64) -> Vec<NoiseTriple> {
    let (scanner, mut draws) = (scanner(), Draws(seed));
    let triple = |_| {
        let depth_mm = draws.within(scanner.near_mm, scanner.far_mm);
        let cos_incidence = draws.within(0.0, 70.0_f64.to_radians()).cos();
        let half_mm = if depth_mm < scanner.best_mm { 70.0 } else { 85.0 };
        let off = (depth_mm - scanner.best_mm) / half_mm;
        let sigma_mm = best_mm * (1.0 + gain * off * off) / cos_incidence;
        let step_mm = if draws.unit() < steps { draws.within(0.3, 0.9) } else { 0.0 };
        NoiseTriple { depth_mm, cos_incidence, across_mm: sigma_mm * draws.normal() + step_mm }
    };
    (0..count).map(triple).collect()
}

#[test]
fn noise_comes_back_within_3_and_10_percent_from_20_000_triples() {
    for (seed, (best_mm, gain)) in (1..).zip([(0.0117, 1.0), (0.0117, 2.5), (0.030, 0.4), (0.005, 6.0)]) {
        let known = noise(&triples_of(best_mm, gain, 20_000, 0.0, seed), &scanner()).expect("enough");
        let (of_best, of_gain) = (known.best_mm.value / best_mm - 1.0, known.depth_gain.value / gain - 1.0);
        println!("sigma {best_mm}: {:+.2} %, g {gain}: {:+.2} %, {:?}", 100.0 * of_best, 100.0 * of_gain, known);
        assert!(of_best.abs() < 0.03 && of_gain.abs() < 0.10, "{known:?}");
        for (estimate, truth) in [(known.best_mm, best_mm), (known.depth_gain, gain)] {
            let [low, high] = estimate.interval;
            assert!(low < estimate.value && estimate.value < high && high / low < 1.5, "{estimate:?} of {truth}");
        }
    }
}

#[test]
fn intervals_hold_the_truth_as_often_as_they_say() {
    let (mut best_held, mut gain_held) = (0, 0);
    for seed in 0..100 {
        let known = noise(&triples_of(0.0117, 1.0, 2_000, 0.0, 1000 + seed), &scanner()).expect("enough");
        let holds = |estimate: &Identified, truth: f64| u32::from((estimate.interval[0]..=estimate.interval[1]).contains(&truth));
        best_held += holds(&known.best_mm, 0.0117);
        gain_held += holds(&known.depth_gain, 1.0);
    }
    // 95 of 100 expected; fewer than 88 or all of them have a chance of 0.4 and 0.6 %.
    println!("of 100 intervals {best_held} hold sigma and {gain_held} g");
    assert!((88..100).contains(&best_held) && (88..100).contains(&gain_held), "{best_held} {gain_held}");
}

#[test]
fn steps_of_depth_are_left_out_and_too_few_triples_tell_nothing() {
    let known = noise(&triples_of(0.0117, 1.0, 20_000, 0.02, 7), &scanner()).expect("enough");
    assert!((known.best_mm.value / 0.0117 - 1.0).abs() < 0.03, "{known:?}");
    assert!((300..450).contains(&known.outliers), "2 % of 20 000: {known:?}");
    assert_eq!(noise(&triples_of(0.0117, 1.0, 99, 0.0, 7), &scanner()), None);
    let at_focus: Vec<_> =
        triples_of(0.0117, 0.0, 5_000, 0.0, 8).into_iter().map(|triple| NoiseTriple { depth_mm: 480.0, ..triple }).collect();
    let known = noise(&at_focus, &scanner()).expect("enough");
    assert!((known.best_mm.value / 0.0117 - 1.0).abs() < 0.05);
    assert_eq!(known.depth_gain.interval, [0.0, 100.0], "one depth tells nothing of g: {known:?}");
}

/// The interval of the noise at best focus was that of the noise at the one depth, and did not hold it.
#[test]
fn triples_at_one_depth_away_from_the_focus_leave_the_noise_at_best_focus_open_by_the_range_of_the_gain() {
    let (best_mm, gain, share) = (0.0117, 2.5, (70.0_f64 / 85.0).powi(2));
    let of_depth_mm = best_mm * (1.0 + gain * share);
    for spread_mm in [0.0, 0.002] {
        let mut draws = Draws(21);
        let at_depth = |triple: NoiseTriple| NoiseTriple { depth_mm: 550.0 + draws.within(-spread_mm, spread_mm), ..triple };
        let triples: Vec<_> = triples_of(of_depth_mm, 0.0, 5_000, 0.0, 9).into_iter().map(at_depth).collect();
        let known = noise(&triples, &scanner()).expect("enough");
        assert!(!known.is_gain_determined && known.depth_gain.interval == [0.0, 100.0], "{known:?}");
        let [low_mm, high_mm] = known.best_mm.interval;
        assert!((low_mm..high_mm).contains(&best_mm), "{known:?}");
        // 1.96 / √(2 · 5000) is 2 % at either end, and the estimate itself is as uncertain.
        let [least_mm, largest_mm] = [of_depth_mm / (1.0 + 100.0 * share), of_depth_mm];
        assert!((low_mm / least_mm - 0.98).abs() < 0.04 && (high_mm / largest_mm - 1.02).abs() < 0.04, "{known:?}");
    }
    let known = noise(&triples_of(0.0117, 1.0, 2_000, 0.0, 3), &scanner()).expect("enough");
    assert!(known.is_gain_determined, "{known:?}");
}

/// Triples about one depth, of a scanner with a noise of 0.035 / 3 mm at best focus and a gain of 2.5.
fn triples_about(depth_mm: f64, spread_mm: f64, count: usize, seed: u64) -> Vec<NoiseTriple> {
    let mut draws = Draws(seed);
    let triple = |_| {
        let depth_mm = depth_mm + spread_mm * draws.normal();
        let half_mm = if depth_mm < 480.0 { 70.0 } else { 85.0 };
        let sigma_mm = 0.035 / 3.0 * (1.0 + 2.5 * ((depth_mm - 480.0) / half_mm).powi(2));
        NoiseTriple { depth_mm, cos_incidence: 1.0, across_mm: sigma_mm * draws.normal() }
    };
    (0..count).map(triple).collect()
}

/// The Fisher information at an estimate of 0, which is a bound, told a gain of 0 to 1.05 and a noise of 0.0157 to 0.0322 mm.
#[test]
fn the_interval_of_a_gain_on_its_bound_holds_the_truth() {
    let known = noise(&triples_about(550.0, 1.0, 5_000, 4), &scanner()).expect("enough");
    assert!(known.depth_gain.value < 0.1, "on its bound: {known:?}");
    let [low, high] = known.depth_gain.interval;
    let [low_mm, high_mm] = known.best_mm.interval;
    assert!((low..=high).contains(&2.5) && (low_mm..=high_mm).contains(&(0.035 / 3.0)), "{known:?}");
    assert!((high - 3.34).abs() < 0.05 && (low_mm - 0.0097).abs() < 0.0002, "{known:?}");
    let open = noise(&triples_about(550.0, 0.2, 500, 0), &scanner()).expect("enough");
    assert!(!open.is_gain_determined && open.depth_gain.interval == [0.0, 100.0], "it was told as determined: {open:?}");
}

/// Counts the intervals that hold the truth: those by the Fisher information held the noise 181 times of 200, and the gain 169 times.
#[test]
fn intervals_hold_the_truth_where_the_depths_are_nearly_the_same() {
    let (mut best_held, mut gain_held) = (0, 0);
    for seed in 0..200 {
        let known = noise(&triples_about(430.0, 2.0, 500, seed), &scanner()).expect("enough");
        let holds = |estimate: &Identified, truth: f64| u32::from((estimate.interval[0]..=estimate.interval[1]).contains(&truth));
        best_held += holds(&known.best_mm, 0.035 / 3.0);
        gain_held += holds(&known.depth_gain, 2.5);
    }
    // 190 of 200 expected; fewer than 184 have a chance of 2 %.
    println!("of 200 intervals {best_held} hold sigma and {gain_held} g");
    assert!(best_held >= 184 && gain_held >= 184, "{best_held} {gain_held}");
}

/// A scanner that returns less and less between two worst incidences, nothing in a cone, and little at some depths.
struct Truth {
    ramp_deg: [f64; 2],
    lobe_deg: f64,
    far_mm: f64,
    /// Share that is lost whatever the angles.
    dark: f64,
}

const THESIS: Truth = Truth { ramp_deg: [65.0, 80.0], lobe_deg: 4.0, far_mm: 600.0, dark: 0.0 };

/// Returns of so many views of 2 000 samples, most of them seen at small angles.
fn returns_of(truth: &Truth, views: usize, seed: u64) -> Returns {
    let (mut returns, mut draws) = (Returns::default(), Draws(seed));
    for view in 0..views {
        let pair = |sample: usize| {
            let worst_deg = 85.0 * (1.0 - draws.unit() * draws.unit());
            let worst_deg = if draws.unit() < 0.5 { worst_deg } else { 85.0 * draws.unit() };
            let mirror_deg = 60.0 * draws.unit();
            let depth_mm = draws.within(410.0, 565.0);
            let [from, to] = truth.ramp_deg;
            let rate = ((to - worst_deg) / (to - from)).clamp(0.0, 1.0);
            let is_seen = mirror_deg >= truth.lobe_deg && depth_mm <= truth.far_mm && draws.unit() >= truth.dark;
            let (other, least) = (0.9 * worst_deg, 0.8 * worst_deg);
            let [left, right] = if draws.unit() < 0.5 { [worst_deg, least] } else { [least, worst_deg] };
            let incidence_rad = PerDevice { left, right, projector: other }.map(f64::to_radians);
            // A tenth is out of a shadow's or a pose's doing, and tells nothing.
            let is_expected = draws.unit() >= 0.1;
            Return {
                view,
                sample: SampleId::at(sample),
                is_returned: is_expected && is_seen && draws.unit() < rate,
                is_expected,
                incidence_rad,
                mirror_rad: mirror_deg.to_radians(),
                depth_mm,
            }
        };
        returns.push_view((0..2_000).map(pair).collect::<Vec<_>>());
    }
    returns
}

#[test]
fn the_incidence_limit_comes_back_within_3_degrees_and_the_cone_within_1() {
    for (seed, ramp_deg, lobe_deg, dark) in
        [(1, [65.0, 80.0], 4.0, 0.0), (2, [50.0, 60.0], 8.0, 0.0), (3, [70.0, 84.0], 2.5, 0.3)]
    {
        let truth = Truth { ramp_deg, lobe_deg, dark, ..THESIS };
        let known = returns(&returns_of(&truth, 20, seed), &scanner()).expect("enough");
        let limit_deg = ramp_deg[1] - 0.75 * (ramp_deg[1] - ramp_deg[0]);
        let (incidence, lobe) = (known.incidence.expect("a limit"), known.lobe.expect("a cone"));
        println!("limit {limit_deg}: {:?}; cone {lobe_deg}: {:?}; easy {:.3}", incidence, lobe.limit, known.easy_rate);
        assert!((incidence.limit.value - limit_deg).abs() < 3.0, "{limit_deg}: {incidence:?}");
        assert!((incidence.plan_with - ramp_deg[0]).abs() < 3.0 && incidence.plan_with <= incidence.limit.value, "{incidence:?}");
        assert!((lobe.limit.value - lobe_deg).abs() < 1.0, "{lobe_deg}: {lobe:?}");
        assert!((known.easy_rate - (1.0 - dark)).abs() < 0.05, "{}", known.easy_rate);
        for device in [DeviceName::Left, DeviceName::Right] {
            let (_, limit) = known.by_device.iter().find(|(name, _)| *name == device).expect("listed");
            assert!((limit.expect("a limit").limit.value - limit_deg).abs() < 3.0, "{device:?} {limit:?}");
        }
        let projector = known.by_device.iter().find(|(name, _)| *name == DeviceName::Projector).expect("listed");
        assert_eq!(projector.1, None, "it never has the worst incidence, so nothing is known of it");
        let rate = known.model.rate(((ramp_deg[0] + ramp_deg[1]) / 2.0).to_radians(), 1.0, 480.0);
        assert!((rate / (1.0 - dark) - 0.5).abs() < 0.12, "half way down the ramp: {rate}");
        assert!(known.model.rate(0.3, 0.2_f64.to_radians(), 480.0) < 0.1, "in the cone");
    }
}

#[test]
fn a_scanner_that_returns_all_shows_no_limits() {
    let truth = Truth { ramp_deg: [89.0, 90.0], lobe_deg: 0.0, far_mm: 1e3, dark: 0.0 };
    let known = returns(&returns_of(&truth, 10, 4), &scanner()).expect("enough");
    assert_eq!((known.incidence, known.lobe, known.depth), (None, None, [None, None]));
    assert!((known.model.rate(1.4, 0.1, 430.0) - 1.0).abs() < 1e-9);
    let learned = Learned { noise: None, returns: Some(known) };
    assert_eq!(offers(&learned, &scanner(), &NoiseParams::default()), Offer::default());
    assert_eq!(returns(&Returns::default(), &scanner()), None);
}

#[test]
fn a_depth_beyond_which_nothing_returns_is_found_and_offered_with_the_other_limits() {
    let truth = Truth { far_mm: 540.0, ..THESIS };
    let known = returns(&returns_of(&truth, 20, 5), &scanner()).expect("enough");
    let far = known.depth[1].expect("a limit");
    assert!((far.limit.value - 540.0).abs() < 5.0 && known.depth[0].is_none(), "{:?}", known.depth);
    let noise = noise(&triples_of(0.02, 1.0, 20_000, 0.0, 9), &scanner());
    let offer = offers(&Learned { noise, returns: Some(known) }, &scanner(), &NoiseParams::default());
    let fields: Vec<_> = offer.changes.iter().map(|change| change.field).collect();
    use OfferedField::{CameraLimit, DepthFar, Lobe, NoiseBest};
    assert_eq!(fields, [CameraLimit, Lobe, NoiseBest, DepthFar], "{offer:?}");
    let camera = offer.changes[0];
    println!("offered {:?}", offer.changes);
    assert_eq!(camera.from, Some(85.0));
    assert!((63.0..=68.0).contains(&camera.to) && camera.to <= camera.identified.value, "{camera:?}");
    assert_eq!(camera.field.parameter(), Some("limits.camera_deg"));
    assert!((offer.changes[2].to - 0.02).abs() < 0.0006 && offer.changes[3].to <= 540.0, "{offer:?}");
    let of_noise = offers(&Learned { noise, returns: None }, &scanner(), &NoiseParams::default());
    assert_eq!(of_noise.changes, [offer.changes[2]], "without rates the noise is offered alone");
}

/// Limits with an interval of −21 to 132 degrees were offered.
#[test]
fn a_limit_that_is_known_poorly_is_not_offered() {
    let truth = Truth { far_mm: 540.0, ..THESIS };
    let known = returns(&returns_of(&truth, 20, 5), &scanner()).expect("enough");
    let with = |half_width: [f64; 2]| {
        let mut known = known.clone();
        let [angle, depth] = half_width;
        let set = |limit: &mut LimitEstimate, half: f64| {
            limit.limit.interval = [limit.limit.value - half, limit.limit.value + half];
        };
        let by_device = known.by_device.iter_mut().map(|(_, limit)| limit);
        let angles = by_device.chain([&mut known.incidence, &mut known.lobe]);
        angles.flatten().for_each(|limit| set(limit, angle));
        known.depth.iter_mut().flatten().for_each(|limit| set(limit, depth));
        let offer = offers(&Learned { noise: None, returns: Some(known) }, &scanner(), &NoiseParams::default());
        offer.changes.iter().map(|change| change.field).collect::<Vec<_>>()
    };
    use OfferedField::{CameraLimit, DepthFar, Lobe};
    assert_eq!(with([2.0, 5.0]), [CameraLimit, Lobe, DepthFar]);
    assert_eq!(with([9.0, 14.0]), [CameraLimit, DepthFar], "about zero there may be no cone");
    assert!(with([11.0, 17.0]).is_empty() && with([76.5, 76.5]).is_empty());
}

/// The place of the limit was judged, and the start of the fall offered, whatever its own interval.
#[test]
fn a_limit_whose_value_to_plan_with_is_known_poorly_is_not_offered() {
    let truth = Truth { far_mm: 540.0, ..THESIS };
    let known = returns(&returns_of(&truth, 20, 5), &scanner()).expect("enough");
    let with = |half_widths: [f64; 2]| {
        let mut known = known.clone();
        let [angle, depth] = half_widths;
        let set = |limit: &mut LimitEstimate, half: f64| limit.plan_interval = [limit.plan_with - half, limit.plan_with + half];
        let by_device = known.by_device.iter_mut().map(|(_, limit)| limit);
        by_device.chain([&mut known.incidence]).flatten().for_each(|limit| set(limit, angle));
        known.depth.iter_mut().flatten().for_each(|limit| set(limit, depth));
        let offer = offers(&Learned { noise: None, returns: Some(known) }, &scanner(), &NoiseParams::default());
        offer.changes.iter().map(|change| change.field).collect::<Vec<_>>()
    };
    use OfferedField::{CameraLimit, DepthFar, Lobe};
    assert_eq!(with([9.0, 14.0]), [CameraLimit, Lobe, DepthFar]);
    assert_eq!(with([11.0, 14.0]), [Lobe, DepthFar]);
    assert_eq!(with([9.0, 17.0]), [CameraLimit, Lobe]);
}

/// Quantiles of Student's distribution at 97.5 % (Abramowitz and Stegun, table 26.10).
#[test]
fn the_quantile_is_student_s() {
    let table = [(1, 12.706), (2, 4.303), (9, 2.262), (10, 2.228), (15, 2.131), (30, 2.042), (120, 1.980)];
    for (freedoms, quantile) in table {
        let found = crate::inspection::student::quantile(f64::from(freedoms));
        assert!((found - quantile).abs() < 0.004, "{freedoms}: {found}");
    }
}

/// The normal quantile offered the limit of two views as known to 1.1 degrees.
#[test]
fn a_limit_of_two_views_is_known_by_student_s_interval() {
    let weak = Truth { lobe_deg: 0.0, ..THESIS };
    let known = returns(&returns_of(&weak, 2, 7), &scanner()).expect("enough");
    let limit = known.incidence.expect("a limit");
    let half_deg = 0.5 * (limit.limit.interval[1] - limit.limit.interval[0]);
    assert!((limit.limit.value - 69.2).abs() < 0.5 && (6.5..8.0).contains(&half_deg), "{limit:?}");
    let offer = offers(&Learned { noise: None, returns: Some(known) }, &scanner(), &NoiseParams::default());
    assert!(offer.changes.is_empty(), "{offer:?}");
}

/// A limit that nothing is left of without one view was offered as if it were known to half a degree.
#[test]
fn a_limit_that_one_view_shows_alone_is_not_offered() {
    let sound = Truth { ramp_deg: [89.0, 90.0], lobe_deg: 0.0, far_mm: 1e3, dark: 0.0 };
    let weak = Truth { lobe_deg: 0.0, ..THESIS };
    let with = |weak_views: usize| {
        let mut all = Returns::default();
        // No other view looks along the surface.
        let is_upright = |pair: &Return| pair.worst_incidence().1 <= 60.0_f64.to_radians();
        let others = returns_of(&sound, 9, 6);
        (0..others.views()).for_each(|view| all.push_view(others.of_view(view).filter(is_upright)));
        let few = returns_of(&weak, weak_views, 7);
        (0..few.views()).for_each(|view| all.push_view(few.of_view(view)));
        let known = returns(&all, &scanner()).expect("enough");
        let limit = known.incidence.expect("a limit").limit;
        let offer = offers(&Learned { noise: None, returns: Some(known) }, &scanner(), &NoiseParams::default());
        (limit, offer.changes.iter().map(|change| change.field).collect::<Vec<_>>())
    };
    let (of_one, offered) = with(1);
    assert!((of_one.value - 68.75).abs() < 3.0, "{of_one:?}");
    assert_eq!(of_one.interval, [0.0, 90.0], "that view alone shows it");
    assert!(offered.is_empty(), "{offered:?}");
    let (of_two, offered) = with(2);
    assert!(of_two.interval[1] - of_two.interval[0] < 20.0, "{of_two:?}");
    assert_eq!(offered, [OfferedField::CameraLimit]);
}

/// Gains of 11 to 23 were offered where a feature is missing, changes of 2 %, and gains with an interval from 0 to 0.97.
#[test]
fn noise_is_offered_where_it_is_plausible_known_and_worth_it() {
    let in_force = NoiseParams::default();
    let offered = |noise: NoiseEstimate| {
        let offer = offers(&Learned { noise: Some(noise), returns: None }, &scanner(), &in_force);
        offer.changes.iter().map(|change| change.field).collect::<Vec<_>>()
    };
    let of = |best_share: f64, gain: f64, half_width: f64| {
        let about = |value: f64, half: f64| Identified { value, interval: [value - half, value + half] };
        let best_mm = best_share * in_force.best_mm;
        offered(NoiseEstimate {
            best_mm: about(best_mm, 0.01 * best_mm),
            depth_gain: about(gain, half_width),
            is_gain_determined: true,
            triples: 5_000,
            outliers: 0,
        })
    };
    use OfferedField::{NoiseBest, NoiseDepthGain};
    assert_eq!(of(1.5, 3.0, 0.5), [NoiseBest, NoiseDepthGain]);
    assert_eq!(of(1.5, 3.0, 1.1), [NoiseBest], "its interval is wider than half of the noise at the ends");
    assert!(of(0.98, 0.85, 0.1).is_empty(), "too little to plan anew for");
    assert!(of(1.5, 11.0, 1.0).is_empty(), "no noise of a scanner");
    let at_one_depth = |least_share: f64| NoiseEstimate {
        best_mm: Identified {
            value: 0.5 * in_force.best_mm,
            interval: [least_share * in_force.best_mm, 0.51 * in_force.best_mm],
        },
        depth_gain: Identified { value: 0.0, interval: [0.0, 100.0] },
        is_gain_determined: false,
        triples: 5_000,
        outliers: 0,
    };
    assert_eq!(offered(at_one_depth(0.49)), [NoiseBest], "at the best focus");
    assert!(offered(at_one_depth(0.007)).is_empty(), "away from it");
    let determined = NoiseEstimate { is_gain_determined: true, ..at_one_depth(0.007) };
    assert!(offered(determined).is_empty(), "its interval spans a factor of 70, and it was offered");
}

/// Returns of which some pairs tell nothing, as those of a part whose flat faces no view sees so.
fn without(returns: &Returns, is_gone: impl Fn(&Return) -> bool) -> Returns {
    let mut left = Returns::default();
    for view in 0..returns.views() {
        let pair = |pair: Return| Return { is_expected: pair.is_expected && !is_gone(&pair), ..pair };
        left.push_view(returns.of_view(view).map(pair));
    }
    left
}

/// Fields that are offered, with the limits by which losses are put down to causes.
fn told_without(is_gone: impl Fn(&Return) -> bool) -> (LearnedReturns, Vec<OfferedField>, IdentifiedLimits) {
    let truth = Truth { ramp_deg: [60.0, 61.0], far_mm: 540.0, ..THESIS };
    let known = returns(&without(&returns_of(&truth, 20, 11), is_gone), &scanner()).expect("enough");
    let learned = Learned { noise: None, returns: Some(known.clone()) };
    let offer = offers(&learned, &scanner(), &NoiseParams::default());
    let limits = known.limits(&scanner());
    (known, offer.changes.iter().map(|change| change.field).collect(), limits)
}

fn is_worst_within(pair: &Return, [from_deg, to_deg]: [f64; 2]) -> bool {
    (from_deg..to_deg).contains(&pair.worst_incidence().1.to_degrees())
}

/// A limit of 44.7 ± 0.5° was learned of a scanner that has 60°, from a part without pairs between 37° and 69°; 38° was offered.
#[test]
fn a_limit_where_no_pair_lies_is_known_no_better_than_where_pairs_begin_again() {
    use OfferedField::{CameraLimit, DepthFar, Lobe};
    let (known, fields, limits) = told_without(|pair| is_worst_within(pair, [37.0, 69.0]));
    let by_device = known.by_device.iter().filter_map(|(_, limit)| *limit);
    let told: Vec<LimitEstimate> = by_device.chain(known.incidence).collect();
    assert_eq!(told.len(), 3, "two cameras, and all devices: {known:?}");
    for limit in told {
        for [low, high] in [limit.limit.interval, limit.plan_interval] {
            assert!((35.5..37.0).contains(&low) && (69.0..70.5).contains(&high), "{limit:?}");
        }
    }
    assert_eq!(fields, [Lobe, DepthFar]);
    // A loss there is not put down to a limit that may lie beyond it.
    let of_cameras = [limits.incidence_deg.left, limits.incidence_deg.right];
    assert!(of_cameras.iter().all(|deg| deg.is_some_and(|deg| deg > 69.0)), "{limits:?}");
    let (_, fields, _) = told_without(|pair| is_worst_within(pair, [55.0, 69.0]));
    assert_eq!(fields, [Lobe, DepthFar], "a plan with 55° may be too strict by 14°");
    let (_, fields, _) = told_without(|pair| is_worst_within(pair, [58.0, 64.0]));
    assert_eq!(fields, [CameraLimit, Lobe, DepthFar], "it is known to a few degrees");
}

/// A camera that has the worst incidence only where nothing returns was told a limit at the least of these: it may be any below.
#[test]
fn a_camera_all_of_whose_pairs_are_lost_may_have_any_limit_up_to_them() {
    let is_gone = |pair: &Return| pair.worst_incidence().0 == DeviceName::Right && is_worst_within(pair, [0.0, 69.0]);
    let (known, fields, limits) = told_without(is_gone);
    let (_, right) = known.by_device.iter().find(|(name, _)| *name == DeviceName::Right).expect("listed");
    let [low, high] = right.expect("a limit").limit.interval;
    assert!(low <= 0.0 && (69.0..70.5).contains(&high), "{right:?}");
    assert!(limits.incidence_deg.right.is_some_and(|deg| deg > 69.0), "{limits:?}");
    assert!(limits.incidence_deg.left.is_some_and(|deg| (deg - 60.0).abs() < 1.0), "{limits:?}");
    assert!(fields.contains(&OfferedField::CameraLimit), "the other camera's: {fields:?}");
}

/// A cone of 4° was told as one of 11.0 ± 0.3°, and a far depth of 540 mm as one of 513.8 ± 2.5 mm.
#[test]
fn a_cone_and_a_depth_where_no_pair_lies_are_not_offered() {
    use OfferedField::{CameraLimit, DepthFar, Lobe};
    let (known, fields, limits) = told_without(|pair| (2.0..20.0).contains(&pair.mirror_rad.to_degrees()));
    let [low, high] = known.lobe.expect("a cone").limit.interval;
    assert!(low < 2.0 && high > 20.0 && limits.lobe_deg.is_some_and(|deg| deg <= 2.0), "{:?} {limits:?}", known.lobe);
    assert_eq!(fields, [CameraLimit, DepthFar]);
    let (known, fields, limits) = told_without(|pair| (500.0..560.0).contains(&pair.depth_mm));
    let [low, high] = known.depth[1].expect("a limit").limit.interval;
    assert!(low < 500.0 && high > 560.0 && limits.depth_mm.is_some_and(|[_, far]| far >= 560.0), "{:?} {limits:?}", known.depth);
    assert_eq!(fields, [CameraLimit, Lobe]);
}
