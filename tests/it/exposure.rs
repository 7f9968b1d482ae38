//! Brightness of views on a step wedge with a polished patch, held against phase-shifted images that are simulated here, with a model
//! of light of their own (row B1): the levels, the area lost, and that `auto` is never worse than level 5.

use nalgebra::Point3;
use vantage::cell::Scanner;
use vantage::geometry::Mesh;
use vantage::geometry::demo_parts::DemoPart;
use vantage::planning::ids::SampleId;
use vantage::planning::params::{Brightness, PlanParams, Region, RegionMaterialParams};
use vantage::planning::plan::{Cause, Outcome, PlannedView};
use vantage::planning::surface::Surface;
use vantage::planning::surface::requirements::Requirements;
use vantage::planning::visibility::{self, Occluders};
use vantage::wire::summary::Summary;

use crate::support::{box_mesh, context, nominal_scanner, plan_viewpoints};

/// Albedo of the steps along x, each 20 mm wide; then a polished patch.
const WEDGE: [f64; 6] = [0.05, 0.1, 0.2, 0.4, 0.65, 0.9];
const STEP_MM: f64 = 20.0;
/// Albedo, gloss and half the mirror cone in degrees of polished metal.
const POLISHED: (f64, Option<(f64, f64)>) = (0.2, Some((20.0, 4.0)));
/// Half the mirror cone of brushed metal, degrees.
const WIDE_LOBE_DEG: f64 = 12.0;
/// Grey values of the simulated cameras, the share at which a pixel is masked as saturated, and the least modulation.
const FULL_SCALE: f64 = 255.0;
const MASKED: f64 = 0.95;
const MIN_MODULATION: f64 = 16.0;
/// White that faces the projector at the best focus at level 5; two levels double the light.
const WHITE: f64 = 0.86;
const PHASE_STEPS: usize = 8;
/// Grey value of a camera in the dark.
const BLACK_LEVEL: f64 = 3.0;

fn wedge() -> Mesh {
    box_mesh([0.0; 3], [STEP_MM * 7.0, 60.0, 12.0])
}

/// Regions of the wedge's materials.
fn materials() -> Vec<RegionMaterialParams> {
    let step = |place: usize| Region::Box {
        min_mm: [STEP_MM * place as f64, -1.0, -1.0],
        max_mm: [STEP_MM * (place + 1) as f64, 61.0, 13.0],
    };
    let matte = |(place, albedo): (usize, &f64)| RegionMaterialParams {
        region: step(place),
        finish: None,
        albedo: Some(*albedo),
        gloss: Some(0.0),
        lobe_deg: None,
    };
    let polished = RegionMaterialParams {
        region: step(WEDGE.len()),
        finish: Some(vantage::cell::Finish::Polished),
        albedo: Some(POLISHED.0),
        gloss: None,
        lobe_deg: None,
    };
    WEDGE.iter().enumerate().map(matte).chain([polished]).collect()
}

fn params(brightness: Brightness) -> PlanParams {
    let mut params = PlanParams::default();
    (params.robust.pose_error, params.missed.remedies, params.missed.advice) = (None, 0, false);
    params.part.samples_per_mm2 = Some(0.3);
    params.scan.brightness = brightness;
    params
}

/// Albedo and, for the polished patch, gloss and cone in degrees, by place.
fn optical(point: &Point3<f64>) -> (f64, Option<(f64, f64)>) {
    let place = (point.x / STEP_MM).floor() as usize;
    WEDGE.get(place).map_or(POLISHED, |albedo| (*albedo, None))
}

/// Noise of a pixel between −1 and 1, fixed by its numbers.
fn noise(numbers: [u64; 4]) -> f64 {
    let mut z = numbers
        .iter()
        .fold(0x9e37_79b9_u64, |state, number| (state ^ number).wrapping_mul(0xbf58_476d_1ce4_e5b9).rotate_left(29));
    z ^= z >> 31;
    (z >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// Returns true if the images of both cameras decode at a sample: no image is saturated, and the fringes are told apart.
fn decodes(
    scanner: &Scanner,
    view: &PlannedView,
    (sample, surface): (SampleId, &Surface),
    optical: (f64, Option<(f64, f64)>),
    level: u8,
) -> bool {
    let p = surface.sample_mm[sample.index()];
    let normal = surface.patch_of(sample).normal;
    let part_from_scanner = &view.part_from_scanner;
    let centre = |device: &vantage::cell::OpticalDevice| part_from_scanner.point(&device.scanner_from_device.origin_mm());
    let light = centre(&scanner.devices.projector) - p;
    let falloff = (scanner.best_mm / light.norm()).powi(2);
    let gain = 2.0_f64.powf((f64::from(level) - 5.0) / 2.0);
    let (albedo, gloss) = optical;
    let into_light = light.normalize();
    let reflected = 2.0 * normal.dot(&into_light) * normal - into_light;
    scanner.devices.cameras().into_iter().enumerate().all(|(number, camera)| {
        let off_deg = reflected.dot(&(centre(camera) - p).normalize()).clamp(-1.0, 1.0).acos().to_degrees();
        let glare = gloss.map_or(0.0, |(gloss, lobe_deg)| if off_deg < lobe_deg { gloss } else { 0.0 });
        let peak = FULL_SCALE * WHITE * gain * falloff * (albedo * normal.dot(&into_light).max(0.0) + glare);
        let image = |step: usize| {
            let phase = std::f64::consts::TAU * step as f64 / PHASE_STEPS as f64;
            let jitter = noise([u64::from(sample.0), u64::from(level), number as u64, step as u64]);
            (BLACK_LEVEL + 0.5 * peak * (1.0 + phase.cos()) + jitter).clamp(0.0, FULL_SCALE).round()
        };
        let images: Vec<f64> = (0..PHASE_STEPS).map(image).collect();
        let sums = images.iter().enumerate().fold([0.0, 0.0], |[a, b], (step, grey)| {
            let phase = std::f64::consts::TAU * step as f64 / PHASE_STEPS as f64;
            [a + grey * phase.cos(), b + grey * phase.sin()]
        });
        let modulation = 2.0 / PHASE_STEPS as f64 * sums[0].hypot(sums[1]);
        images.iter().all(|grey| *grey <= MASKED * FULL_SCALE) && modulation >= MIN_MODULATION
    })
}

/// Area that a view sees whether it is lit or not, and the levels at which each sample decodes.
struct Simulated {
    seen_mm2: f64,
    samples: Vec<(SampleId, f64, [bool; 10])>,
}

impl Simulated {
    fn lost(&self, levels: &[u8]) -> f64 {
        let is_lost = |decodes: &[bool; 10]| !levels.iter().any(|level| decodes[usize::from(*level)]);
        self.samples.iter().filter(|(_, _, decodes)| is_lost(decodes)).map(|(_, mm2, _)| mm2).sum::<f64>() / self.seen_mm2
    }
}

fn simulate(
    mesh: &Mesh,
    scanner: &Scanner,
    outcome: &Outcome,
    optical: impl Fn(&Point3<f64>) -> (f64, Option<(f64, f64)>),
) -> Vec<Simulated> {
    let mut surface = (*outcome.surface).clone();
    surface.requirements = Requirements::default();
    let poses: Vec<_> = outcome.plan.views.iter().map(|view| view.part_from_scanner).collect();
    let occluders = Occluders::new([mesh]);
    let usable = vec![true; poses.len()];
    let matrix =
        context(|ctx| visibility::cast(&surface, &poses, &usable, scanner, &occluders, &params(Brightness::Level(5)), ctx))
            .expect("cast");
    let view = |(view, row): (&PlannedView, &visibility::Row)| {
        let at = |sample: SampleId| {
            let level = |level: usize| {
                decodes(scanner, view, (sample, &surface), optical(&surface.sample_mm[sample.index()]), level as u8)
            };
            (sample, surface.sample_area_mm2(sample), std::array::from_fn(level))
        };
        let samples: Vec<(SampleId, f64, [bool; 10])> = row.samples().map(at).collect();
        Simulated { seen_mm2: samples.iter().map(|(_, mm2, _)| mm2).sum(), samples }
    };
    outcome.plan.views.iter().zip(&matrix.rows).map(view).collect()
}

#[test]
#[ignore = "long: tests/all runs it"]
fn one_material_gets_the_level_of_brute_force() {
    let (mesh, scanner) = (wedge(), nominal_scanner());
    for albedo in [0.05, 0.1, 0.2, 0.4, 0.8, 1.0] {
        let mut params = params(Brightness::Auto);
        params.materials.albedo = Some(albedo);
        let outcome = plan_viewpoints(&mesh, &scanner, &params);
        let simulated = simulate(&mesh, &scanner, &outcome, |_| (albedo, None));
        let (mut farthest, mut off) = (0, 0.0_f64);
        for (view, simulated) in outcome.plan.views.iter().zip(&simulated) {
            let exposure = view.exposure.as_ref().expect("a known material");
            let losses: Vec<f64> = (0..10).map(|level| simulated.lost(&[level])).collect();
            let least = losses.iter().copied().fold(1.0, f64::min);
            let distance = |level: u8| {
                (0..10).filter(|best| losses[usize::from(*best)] <= least + 1e-3).map(|best| level.abs_diff(best)).min()
            };
            farthest = farthest.max(exposure.levels.iter().filter_map(|level| distance(*level)).min().expect("a level"));
            off = off.max((exposure.lost() - simulated.lost(&exposure.levels)).abs());
            assert!(simulated.lost(&exposure.levels) <= simulated.lost(&[5]) + 1e-3, "worse than level 5 at {albedo}");
        }
        let levels: Vec<_> = outcome.plan.views.iter().map(|view| view.exposure.clone().expect("known").levels).collect();
        println!("albedo {albedo}: {levels:?}, at most {farthest} from brute force, lost area off by {:.2} points", 100.0 * off);
        assert!(farthest <= 1 && off <= 0.01, "{albedo}: {farthest} levels, {off}");
        if (0.7..0.9).contains(&albedo) {
            assert!(levels.iter().all(|levels| *levels == [5]), "the thesis's anchor, dull resin: {levels:?}");
        }
        if albedo <= 0.05 {
            assert!(levels.iter().all(|levels| levels.contains(&9)), "black takes all light there is: {levels:?}");
        }
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_step_wedge_with_a_polished_patch_is_lost_as_simulated_and_auto_is_never_below_level_5() {
    let (mesh, scanner) = (wedge(), nominal_scanner());
    let planned = |brightness: Brightness| {
        let mut params = params(brightness);
        params.materials.regions = materials();
        let outcome = plan_viewpoints(&mesh, &scanner, &params);
        let simulated = simulate(&mesh, &scanner, &outcome, optical);
        (outcome, simulated)
    };
    let (auto, of_auto) = planned(Brightness::Auto);
    let mut off = 0.0_f64;
    for (view, simulated) in auto.plan.views.iter().zip(&of_auto) {
        let exposure = view.exposure.as_ref().expect("known materials");
        let (expected, found) = (exposure.lost(), simulated.lost(&exposure.levels));
        println!(
            "levels {:?}: expected {:.2} % lost, simulated {:.2} %, at 5 {:.2} %",
            exposure.levels,
            100.0 * expected,
            100.0 * found,
            100.0 * simulated.lost(&[5])
        );
        off = off.max((expected - found).abs());
        assert!(found <= simulated.lost(&[5]) + 1e-3, "worse than level 5");
        let pairs = (0..10).flat_map(|a| (a..10).map(move |b| [a, b]));
        let best = pairs.map(|pair| simulated.lost(&pair)).fold(1.0, f64::min);
        assert!(found <= best + 0.01 + 1e-3, "{found} against {best} of the best two");
    }
    assert!(off <= 0.01, "{off}");
    let (fixed, of_fixed) = planned(Brightness::Level(5));
    let worst = fixed.plan.views.iter().zip(&of_fixed).map(|(view, simulated)| {
        let exposure = view.exposure.as_ref().expect("known materials");
        assert_eq!(exposure.levels, [5]);
        println!("fixed: expected {:.2} % lost, simulated {:.2} %", 100.0 * exposure.lost(), 100.0 * simulated.lost(&[5]));
        (exposure.lost() - simulated.lost(&[5])).abs()
    });
    assert!(worst.fold(0.0, f64::max) <= 0.01);
    let captured = |outcome: &Outcome| {
        let lost = outcome.plan.coverage.exposure.expect("known materials");
        (outcome.plan.coverage.measured.area_mm2 - lost.of_measured_area_mm2) / outcome.plan.coverage.asked_area_mm2
    };
    println!("captured: auto {:.4}, level 5 {:.4}", captured(&auto), captured(&fixed));
    assert!(captured(&auto) >= captured(&fixed), "{} {}", captured(&auto), captured(&fixed));
    assert!(auto.plan.coverage.exposure.expect("known").is_assumed, "the preset says nothing of its levels");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_polished_part_is_looked_at_off_the_mirror_cone() {
    // A round part: some of it is in the cone of every view.
    let (mesh, scanner) = (DemoPart::Figurine.mesh(8_000).expect("a part"), nominal_scanner());
    let mut glossy = params(Brightness::Auto);
    (glossy.materials.finish, glossy.materials.albedo) = (Some(vantage::cell::Finish::Polished), Some(POLISHED.0));
    glossy.materials.lobe_deg = Some(WIDE_LOBE_DEG);
    // Share of the asked area that some view captures at its best level.
    let captured = |params: &PlanParams| {
        let outcome = plan_viewpoints(&mesh, &scanner, params);
        let asked = outcome.surface.asked_area_mm2();
        let mut open = asked.clone();
        for view in simulate(&mesh, &scanner, &outcome, |_| (POLISHED.0, Some((20.0, WIDE_LOBE_DEG)))) {
            let best = (0..10).min_by(|a, b| view.lost(&[*a]).total_cmp(&view.lost(&[*b]))).expect("levels");
            let decoded = view.samples.iter().filter(|(_, _, decodes)| decodes[usize::from(best)]);
            decoded.for_each(|(sample, ..)| open[sample.index()] = 0.0);
        }
        (1.0 - open.iter().sum::<f64>() / asked.iter().sum::<f64>(), outcome.plan.views.len())
    };
    let [(aware, aware_views), (unaware, unaware_views)] = [&glossy, &params(Brightness::Level(5))].map(captured);
    println!(
        "captured {:.2} % with {aware_views} views, {:.2} % with {unaware_views} where the plan does not know of the gloss",
        100.0 * aware,
        100.0 * unaware
    );
    assert!(aware > unaware + 0.005, "{aware} {unaware}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_plan_that_knows_nothing_of_materials_says_nothing_of_brightness() {
    let outcome = plan_viewpoints(&box_mesh([0.0; 3], [60.0, 40.0, 20.0]), &nominal_scanner(), &params(Brightness::Level(5)));
    assert!(outcome.plan.coverage.exposure.is_none() && outcome.plan.views.iter().all(|view| view.exposure.is_none()));
    let json = serde_json::to_value(&outcome.plan.params).expect("JSON");
    assert!(json.get("materials").is_none() && json["scan"].get("ambient").is_none(), "{json}");
    assert_eq!(json["scan"]["brightness"], 5);
}

/// Surface that no capture is bright enough for was told as "not measured well enough", for which finer scanners are looked for.
#[test]
fn what_is_too_dark_at_the_brightness_of_a_plan_is_missed_for_that_and_the_fix_is_another_brightness() {
    let (mesh, scanner) = (box_mesh([0.0; 3], [60.0, 40.0, 20.0]), nominal_scanner());
    let planned = |brightness: Brightness| {
        let mut params = params(brightness);
        params.materials.albedo = Some(0.9);
        let top = Region::Box { min_mm: [-1.0, -1.0, 19.9], max_mm: [61.0, 41.0, 21.0] };
        params.materials.regions =
            vec![RegionMaterialParams { region: top, finish: None, albedo: Some(0.05), gloss: None, lobe_deg: None }];
        plan_viewpoints(&mesh, &scanner, &params).plan
    };
    let dark = planned(Brightness::Level(1));
    let top = dark.missed.iter().find(|missed| missed.cause == Cause::Exposure).expect("the dark top");
    assert!((top.area_mm2 / 2400.0 - 1.0).abs() < 0.02, "{} mm²", top.area_mm2);
    let summary = Summary::of(&dark);
    let group = summary.missed.iter().find(|group| group.reason == Cause::Exposure).expect("its group");
    assert!(group.text.contains("too dark or saturated: let each view have its own brightness in place of 1"), "{}", group.text);
    assert!(planned(Brightness::Auto).missed.iter().all(|missed| missed.cause != Cause::Exposure));
}
