//! Coverage with poses that are off, draw by draw.
//!
//! Directions are spread over the draws, since independent ones miss the axis that a plan is sensitive to. Six draws are a block:
//! they turn both ways about three axes at right angles and shift both ways along three others; both frames are random. Each
//! direction is uniform on the sphere for itself, so that the mean is unbiased; what is linear in the turn or in the shift cancels in
//! it (antithetic sampling: Owen 2013, *Monte Carlo theory, methods and examples*, chapter 8). For any direction u some draw of a
//! block has at least 1/√3 of the turn, since max |uᵢ| ≥ 1/√3 in every frame (orthogonal directions: Yu et al. 2016, *Orthogonal
//! Random Features*).
//!
//! The share that is told of a draw is the nominal share of all samples and the difference between the draw and the planned poses, both on
//! the same thinned samples: few samples change sides, so that the difference is known far better than either share
//! ([`crate::planning::method::robustness`] has its standard error). Draws run side by side; in each a sample that one view
//! measures is not looked at for the others.

use std::sync::atomic::{AtomicUsize, Ordering};

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::{SecondSampling, TakenView};
use crate::geometry::{Part, Pose, ScannerFrame, parallel};
use crate::planning::context::{Cancelled, Context};
use crate::planning::ids::SampleId;
use crate::planning::params::PoseErrorParams;
use crate::planning::plan::{Drawn, Robust, share};
use crate::planning::random::Stream;
use crate::planning::setups::registration::union_of;
use crate::planning::surface::{Surface, systematic};
use crate::planning::visibility::{Optics, SampleSet, UnitedViews};

/// Samples on which draws are evaluated at most.
const MAX_SAMPLES: usize = 16_000;
/// Names of the streams of random numbers.
const EACH_VIEW: u64 = 0x76_6965_7773;
const WHOLE_PART: u64 = 0x7061_7274;
const HAND_EYE: u64 = 0x68_616e_6465_7965;

/// Turn and shift of each draw of a block: number of the axis in its frame, and sign. Either sign of every axis is drawn once. The
/// two turns about an axis come with shifts along different axes, at one relative sign or the other: were the one error the other
/// reversed, a shift that takes back what the turn costs would do so both times.
const BLOCK: [[(usize, f64); 2]; 6] = [
    [(0, 1.0), (0, 1.0)],
    [(1, 1.0), (1, -1.0)],
    [(2, 1.0), (2, 1.0)],
    [(0, -1.0), (1, 1.0)],
    [(1, -1.0), (2, -1.0)],
    [(2, -1.0), (0, -1.0)],
];

/// Poses of all views, in the order of [`SecondSampling::views`].
type Poses = Vec<Pose<Part, ScannerFrame>>;

/// Views with poses that are off.
#[derive(Clone, Debug, PartialEq)]
struct Draw {
    /// Poses in the frame of the part as it lies.
    poses: Poses,
    /// Pose of the part as it lies in the frame of the planned one, for each setup; empty where it lies as planned. Obstacles of the cell
    /// stay where they are.
    displaced: Vec<Pose<Part, Part>>,
}

impl Draw {
    /// Views that are off from a part that lies as planned.
    fn of_views(poses: Poses) -> Self {
        Self { poses, displaced: Vec::new() }
    }
}

/// Evaluates the views with poses that are off. `nominal` is the share of the asked area that they measure as planned, of all
/// samples.
///
/// # Errors
/// [`Cancelled`].
pub(super) fn robust(
    second: &SecondSampling<'_>,
    error: PoseErrorParams,
    nominal: f64,
    ctx: &Context<'_>,
) -> Result<Robust, Cancelled> {
    robust_on(second, error, (nominal, MAX_SAMPLES), ctx)
}

fn robust_on(
    second: &SecondSampling<'_>,
    error: PoseErrorParams,
    (nominal, max_samples): (f64, usize),
    ctx: &Context<'_>,
) -> Result<Robust, Cancelled> {
    let of_kinds = [drawn_views(second, &error), drawn_parts(second, &error), drawn_hand_eyes(second, &error)];
    let [views, part, hand_eye] = evaluated(second, of_kinds, (nominal, max_samples), ctx)?;
    Ok(Robust { pose_error: error, views, part, hand_eye })
}

/// Evaluates the draws of each kind, all of them on the same samples.
fn evaluated<const KINDS: usize>(
    second: &SecondSampling<'_>,
    of_kinds: [Vec<Draw>; KINDS],
    (nominal, max_samples): (f64, usize),
    ctx: &Context<'_>,
) -> Result<[Drawn; KINDS], Cancelled> {
    let thinned = ThinnedSamples::of(second, max_samples);
    let optics = Optics::new(second.input.scanner, &second.params, &thinned.surface.requirements);
    let silent = ctx.silent();
    let occluders = second.setups.iter().map(|setup| setup.occluders);
    let by_setup: Vec<UnitedViews<'_>> =
        occluders.map(|occluders| UnitedViews::new(&thinned.surface, &optics, occluders, &second.params, &silent)).collect();
    let planned = Draw::of_views(second.views().map(|(_, view)| *view).collect());
    let all: Vec<&Draw> = std::iter::once(&planned).chain(of_kinds.iter().flatten()).collect();
    let done = AtomicUsize::new(0);
    let measured_mm2 = |draw: &&Draw| {
        let measured_mm2 = thinned.measured_mm2(second, &by_setup, draw, &silent)?;
        ctx.progress(done.fetch_add(1, Ordering::Relaxed) + 1, all.len());
        Ok(measured_mm2)
    };
    let measured_mm2 = parallel::try_map::<_, _, Cancelled>(&all, measured_mm2)?;
    let (planned_mm2, mut drawn_mm2) = (measured_mm2[0], measured_mm2[1..].iter());
    let of_asked = |mm2: &f64| (nominal + share(mm2 - planned_mm2, second.asked_mm2)).clamp(0.0, 1.0);
    Ok(of_kinds.map(|draws| Drawn::new(nominal, drawn_mm2.by_ref().take(draws.len()).map(of_asked).collect())))
}

/// Samples that stand for all of the second set.
struct ThinnedSamples {
    surface: Surface,
    /// Asked area that each stands for.
    area_mm2: Vec<f64>,
}

impl ThinnedSamples {
    fn of(second: &SecondSampling<'_>, max_samples: usize) -> Self {
        let some = systematic(&second.asked_area_mm2, max_samples);
        Self { surface: second.surface.of_samples(&some), area_mm2: some.iter().map(|(_, area_mm2)| *area_mm2).collect() }
    }

    /// Asked area that the views of a draw measure.
    fn measured_mm2(
        &self,
        second: &SecondSampling<'_>,
        by_setup: &[UnitedViews<'_>],
        Draw { poses, displaced }: &Draw,
        ctx: &Context<'_>,
    ) -> Result<f64, Cancelled> {
        // Whether a sample is at risk depends on every view that measures it.
        let needs_rows = !second.params.realism.count_at_risk;
        let (mut measured, nothing) = (self.nothing(), self.nothing());
        let (mut rows, mut rest) = (Vec::new(), &poses[..]);
        for (number, (setup, together)) in second.setups.iter().zip(by_setup).enumerate() {
            let (own, others) = rest.split_at(setup.views.len());
            rest = others;
            for (pose, table_rad) in own.iter().zip(&setup.table_rad) {
                ctx.check()?;
                let mut row = together.row(pose, if needs_rows { &nothing } else { &measured })?;
                let view = TakenView { part_from_scanner: pose, displaced: displaced.get(number), table_rad: *table_rad };
                setup.keep_in_sight(&self.surface, &view, &mut row, ctx)?;
                measured.insert_all(row.measured());
                rows.extend(needs_rows.then_some(row));
            }
        }
        if needs_rows {
            measured = union_of(&second.counted(&self.surface, rows, poses, ctx)?, self.area_mm2.len());
        }
        Ok(measured.iter().map(|sample: SampleId| self.area_mm2[sample.index()]).sum())
    }

    fn nothing(&self) -> SampleSet {
        SampleSet::none_of(self.area_mm2.len())
    }
}

/// Stream of the block, and place in it, of each draw of a kind.
fn places(second: &SecondSampling<'_>, kind: u64, draws: u32) -> impl Iterator<Item = (Stream, usize)> {
    let seed = second.params.seed;
    (0..draws as usize).map(move |draw| (Stream::new(seed, &[kind, (draw / BLOCK.len()) as u64]), draw % BLOCK.len()))
}

/// Every view off by an error of its own, from frames of its own in each block.
fn drawn_views(second: &SecondSampling<'_>, error: &PoseErrorParams) -> Vec<Draw> {
    let poses = |(mut stream, place): (Stream, usize)| {
        let off = |view: &Pose<Part, ScannerFrame>| *view * spread_error(error, place, &Point3::origin(), &mut stream);
        Draw::of_views(second.views().map(|(_, view)| view).map(off).collect())
    };
    places(second, EACH_VIEW, second.params.robust.draws).map(poses).collect()
}

/// The part and its support off as one, in each setup by an error of its own: what hides a sample is given in the part's frame,
/// so that fixture and plate move along.
fn drawn_parts(second: &SecondSampling<'_>, error: &PoseErrorParams) -> Vec<Draw> {
    let centre_mm = &second.surface.centre_mm;
    let poses = |(mut stream, place): (Stream, usize)| {
        let mut draw = Draw::of_views(Vec::new());
        for setup in second.setups {
            let error: Pose<Part, Part> = spread_error(error, place, centre_mm, &mut stream);
            draw.poses.extend(setup.views.iter().map(|view| error * *view));
            draw.displaced.push(error.inverse());
        }
        draw
    };
    places(second, WHOLE_PART, second.params.robust.part_draws).map(poses).collect()
}

/// Every view off by the same error in the scanner frame.
fn drawn_hand_eyes(second: &SecondSampling<'_>, error: &PoseErrorParams) -> Vec<Draw> {
    let poses = |(mut stream, place): (Stream, usize)| {
        let error = spread_error(error, place, &Point3::origin(), &mut stream);
        Draw::of_views(second.views().map(|(_, view)| *view * error).collect())
    };
    places(second, HAND_EYE, second.params.robust.hand_eye_draws).map(poses).collect()
}

/// Draws the pose of a frame that should be at the identity: the error at a place of a block, whose frames come next in `stream`.
pub(super) fn spread_error<Frame>(
    error: &PoseErrorParams,
    place: usize,
    centre_mm: &Point3<f64>,
    stream: &mut Stream,
) -> Pose<Frame, Frame> {
    let (turns, shifts) = (stream.axes(), stream.axes());
    let [(turn, turn_sign), (shift, shift_sign)] = BLOCK[place];
    let turn = UnitQuaternion::from_axis_angle(&turns[turn], turn_sign * error.angle_deg.to_radians());
    displaced(centre_mm, turn, shifts[shift].into_inner() * (shift_sign * error.translation_mm))
}

/// Pose of a frame that was turned about `centre_mm`, then moved.
fn displaced<Frame>(centre_mm: &Point3<f64>, turn: UnitQuaternion<f64>, shift_mm: Vector3<f64>) -> Pose<Frame, Frame> {
    Pose::from_parts(centre_mm.coords + shift_mm - turn * centre_mm.coords, turn)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicBool;

    use super::super::SetupViews;
    use super::*;
    use crate::geometry::{Mesh, demo_parts};
    use crate::planning::candidates::{looking_along, spiral};
    use crate::planning::context::Silent;
    use crate::planning::params::{Engine, PlanParams};
    use crate::planning::scene::PlanInput;
    use crate::planning::visibility::Occluders;
    use crate::testing::{box_mesh, nominal_scanner};

    const ERROR: PoseErrorParams = PoseErrorParams { angle_deg: 1.0, translation_mm: 1.0 };

    /// Draws of six views of a part on samples so dense, one figure for each list of `max_samples`.
    fn drawn(mesh: &Mesh, samples: f64, change: fn(&mut PlanParams), max_samples: &[usize], threads: usize) -> Vec<Robust> {
        let (scanner, cancel, mut params) = (nominal_scanner(), AtomicBool::new(false), PlanParams::default());
        params.part.samples_per_mm2 = Some(samples / mesh.area_mm2());
        (params.robust.draws, params.robust.part_draws, params.robust.hand_eye_draws) = (4, 3, 3);
        change(&mut params);
        let (ctx, occluders) = (Context::new(&cancel, &Silent), Occluders::new([mesh]));
        let middle = mesh.aabb().centre().coords;
        let pose = |out: Vector3<f64>| Pose::from_parts(middle + out * scanner.best_mm, looking_along(&-out, 0.3));
        let views: Vec<_> = spiral(6, -0.6).map(pose).collect();
        let table_rad = vec![None; views.len()];
        let setups = [SetupViews { occluders: &occluders, sight: None, views, table_rad }];
        let input = PlanInput { mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let second = SecondSampling::new(&input, &params, &setups, None, &ctx).unwrap_or_else(|error| panic!("{error}"));
            let part = crate::geometry::RayScene::new([mesh]);
            let nominal = second.independent(&part, &[], &ctx).expect("not cancelled").0.of_asked();
            let robust = |max: &usize| robust_on(&second, ERROR, (nominal, *max), &ctx).expect("not cancelled");
            max_samples.iter().map(robust).collect()
        })
    }

    fn figures(robust: &Robust) -> Vec<f64> {
        let of = |drawn: &Drawn| [drawn.nominal, drawn.worst(), drawn.p5(), drawn.mean()];
        [&robust.views, &robust.part, &robust.hand_eye].into_iter().flat_map(of).collect()
    }

    #[test]
    fn draws_on_some_samples_tell_what_all_samples_do_within_a_twentieth_of_a_point() {
        let mesh = demo_parts::figurine(8_000).unwrap_or_else(|error| panic!("{error}"));
        let [all, some] = &drawn(&mesh, 90_000.0, |_| (), &[usize::MAX, MAX_SAMPLES], 2)[..] else { unreachable!("two") };
        let (all, some) = (figures(all), figures(some));
        assert!(all.iter().any(|share| (share - all[0]).abs() > 1e-4), "errors change what is measured: {all:?}");
        for (share, of_some) in all.iter().zip(&some) {
            assert!((share - of_some).abs() < 5e-4, "{all:?}\n{some:?}");
        }
        assert_eq!(all[0], some[0], "the nominal share is that of all samples");
    }

    #[test]
    #[ignore = "long: tests/all runs it"]
    fn draws_are_the_same_on_any_number_of_threads_with_risks_counted_and_not() {
        let mesh = demo_parts::base(8_000).unwrap_or_else(|error| panic!("{error}"));
        for change in [|_: &mut PlanParams| (), |params: &mut PlanParams| params.realism.count_at_risk = false] {
            let [one, two] = [1, 2].map(|threads| drawn(&mesh, 4_000.0, change, &[3_000], threads));
            assert_eq!(one, two);
        }
    }

    /// Evaluates a plate of 2 mm in one view from the side `azimuth_rad`, 0.4° within the limit of incidence on its upper face: an
    /// error that tilts it further away by more than that loses the face.
    fn near_the_limit<T>(azimuth_rad: f64, evaluate: impl FnOnce(SecondSampling<'_>, &Context<'_>) -> T) -> T {
        let (scanner, cancel, mut params) = (nominal_scanner(), AtomicBool::new(false), PlanParams::default());
        (params.part.samples_per_mm2, params.part.patch_edge_mm) = (Some(12.0), Some(1.0));
        (params.visibility.engine, params.limits.projector_deg, params.seed) = (Engine::Rays, Some(60.0), 0);
        let mesh = box_mesh([-1.0, -1.0, -0.2], [1.0, 1.0, 0.0]);
        let (ctx, occluders) = (Context::new(&cancel, &Silent), Occluders::new([&mesh]));
        let (across, up) = 59.6_f64.to_radians().sin_cos();
        let out = Vector3::new(across * azimuth_rad.cos(), across * azimuth_rad.sin(), up);
        let views = vec![Pose::from_parts(out * scanner.best_mm, looking_along(&-out, 0.0))];
        let setups = [SetupViews { occluders: &occluders, sight: None, views, table_rad: vec![None] }];
        let input = PlanInput { mesh: &mesh, fixture: None, part_sha256: "", scanner: &scanner, cell: None, roadmaps: None };
        let second = SecondSampling::new(&input, &params, &setups, None, &ctx).unwrap_or_else(|error| panic!("{error}"));
        evaluate(second, &ctx)
    }

    /// The part and its support off by errors that are drawn one by one.
    fn independent_parts(second: &SecondSampling<'_>, draws: usize) -> Vec<Draw> {
        let poses = |draw: usize| {
            let mut stream = Stream::new(second.params.seed, &[WHOLE_PART, draw as u64]);
            let turn = UnitQuaternion::from_axis_angle(&stream.direction(), ERROR.angle_deg.to_radians());
            let shift_mm = stream.direction().into_inner() * ERROR.translation_mm;
            let error: Pose<Part, Part> = displaced(&second.surface.centre_mm, turn, shift_mm);
            Draw::of_views(second.views().map(|(_, view)| error * *view).collect())
        };
        (0..draws).map(poses).collect()
    }

    #[test]
    fn the_worst_loss_is_found_on_whichever_axis_it_lies() {
        let mut missed_by_independent = 0;
        for side in 0..8 {
            let azimuth_rad = f64::from(side) * std::f64::consts::FRAC_PI_4;
            let [told, as_many, many] = near_the_limit(azimuth_rad, |second, ctx| {
                let told = robust_on(&second, ERROR, (1.0, MAX_SAMPLES), ctx).expect("not cancelled").part;
                let independent = [told.draws(), 400].map(|draws| independent_parts(&second, draws));
                let [as_many, many] = evaluated(&second, independent, (1.0, MAX_SAMPLES), ctx).expect("not cancelled");
                [told, as_many, many].map(|drawn| drawn.nominal - drawn.worst())
            });
            // The upper face is 4 of 9.6 mm².
            assert!((many - 4.0 / 9.6).abs() < 0.01, "{many} lost from side {side}");
            assert!(told >= 0.5 * many, "{told} told of {many} from side {side}");
            missed_by_independent += u32::from(as_many < 0.5 * many);
        }
        assert!(missed_by_independent > 0, "as many independent draws find it from every side");
    }

    #[test]
    fn further_draws_leave_those_before_them_as_they_are() {
        near_the_limit(0.0, |mut second, _| {
            let kinds: [fn(&SecondSampling<'_>, &PoseErrorParams) -> Vec<Draw>; 3] = [drawn_views, drawn_parts, drawn_hand_eyes];
            for kind in kinds {
                let [some, more] = [8, 20].map(|draws| {
                    let robust = &mut second.params.robust;
                    (robust.draws, robust.part_draws, robust.hand_eye_draws) = (draws, draws, draws);
                    kind(&second, &ERROR)
                });
                assert_eq!((some.len(), more.len()), (8, 20));
                assert_eq!(some[..], more[..8]);
                assert!(more.iter().skip(1).all(|poses| *poses != more[0]), "no draw is repeated");
            }
        });
    }
}
