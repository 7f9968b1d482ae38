//! Rays one by one: arrays of rays with a common origin, as visibility asks for them, cast by everyone. Primary: every
//! pixel of the left camera that can show the part, in squares of 4 × 4, first hit. Shadow: from the right camera to
//! what the left one sees, in that order, any hit. Sample: from the projector to points on the triangles that face it,
//! in the mesh's order, any hit.

use std::cell::RefCell;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use vantage::cell::{PerDevice, Scanner};
use vantage::geometry::{Mesh, RayScene, SimdLevel};

use crate::Bench;
use crate::embree::{EmbreeScene, NO_FACE};
use crate::measure::{Contestant, Cost, Pools, cost, race};
use crate::meshes::{Part, Size};
use crate::python::{Peer, Python};
use crate::report::{Demand, number};
use crate::rig::{Eye, eyes, views};

/// End of an any-hit ray, as a share of its length: 3 µm at 480 mm short of the surface that it is to reach.
pub(crate) const END: f32 = 1.0 - 3e-3 / 480.0;
/// Rays that a thread takes at a time.
const CHUNK: usize = 8192;
/// Samples of a mesh, at least; on every triangle as many.
const SAMPLES: usize = 400_000;

/// Everyone casts the three arrays of a part.
pub(crate) fn section(bench: &mut Bench, part: &Part) {
    bench.report.section(format!("Packets of rays: {}", part.title));
    let [plain, robust] =
        [false, true].map(|robust| bench.embree.as_ref().map(|embree| embree.scene(&part.mesh, robust)).map_err(String::clone));
    let reference = match &robust {
        Ok(reference) => reference,
        Err(reason) => return bench.report.say(reason),
    };
    let arrays = arrays(&bench.scanner, &part.mesh, reference);
    if let Ok(python) = &bench.python {
        arrays.iter().for_each(|rays| python.borrow_mut().keep_rays(rays.name, rays.origin_mm, &rays.directions_mm));
    }
    let scene = RayScene::new([&part.mesh]);
    let mut casters = vec![
        embree("Embree 3.13, 16 wide", plain.as_ref(), &bench.pools),
        embree("Embree 3.13, 16 wide, robust", Ok(reference), &bench.pools),
    ];
    let widest = casters.len();
    casters.extend(SimdLevel::available().into_iter().rev().map(|level| vantage(level, &scene, &bench.pools)));
    casters.extend([Peer::Open3d, Peer::Trimesh].map(|peer| python(peer, &bench.python)));
    let (mut rows, mut ratios) = (Vec::new(), Vec::new());
    for rays in &arrays {
        let (cells, of_first): (Vec<_>, Vec<_>) = compare(bench.rounds, rays, &casters).into_iter().unzip();
        rows.extend(cells);
        ratios.extend(of_first[widest]);
    }
    let header = ["rays", "engine", "Mrays a CPU second, 1 thread", "Mrays/s, 2 threads", "of the first", "other answers, ppm"];
    bench.report.table(&header, &rows);
    for ((rays, least), ratio) in arrays.iter().zip([0.5, 0.6, 0.6]).zip(ratios) {
        if let Some(size @ (Size::Coarse | Size::Dense)) = part.size {
            let what = format!("packets against Embree's, {}, {}", rays.name, size.as_str());
            bench.report.figure(what, Demand::above(least, 0.8, " ×"), ratio);
        }
    }
}

/// Rays with a common origin.
struct Rays {
    /// Name of the rays.
    name: &'static str,
    /// Common origin, part frame, mm.
    origin_mm: [f32; 3],
    /// Directions of the rays; any-hit rays end at [`END`] times this.
    directions_mm: Vec<[f32; 3]>,
    /// Directions in f64 of first hits; for any hits `targets_mm` has the points that they go to, part frame. The other is empty.
    exact_directions_mm: Vec<Vector3<f64>>,
    targets_mm: Vec<Point3<f64>>,
    /// True if the first face is asked for, not only whether there is any.
    first: bool,
}

/// The three arrays of `mesh` from the first viewpoint. `reference` finds what the left camera sees.
fn arrays(scanner: &Scanner, mesh: &Mesh, reference: &EmbreeScene) -> [Rays; 3] {
    let PerDevice { left, right, projector } = eyes(scanner, &views(scanner)[0]);
    let directions_mm: Vec<_> = left.scissor(mesh).pixels().map(|(column, row)| left.ray(column, row)).collect();
    let primary = Rays::new("primary", &left, directions_mm, true);
    let mut faces = vec![NO_FACE; primary.directions_mm.len()];
    reference.first_faces(primary.origin_mm, &primary.directions_mm, &mut faces);
    let met = faces.iter().zip(&primary.directions_mm).filter(|(face, _)| **face != NO_FACE);
    let seen = met.map(|(face, direction)| on_plane(mesh, *face, &left.centre_mm, direction));
    let shadow = any_hit("shadow", &right, seen);
    let sample = any_hit("sample", &projector, samples_facing(mesh, &projector.centre_mm));
    [primary, shadow, sample]
}

impl Rays {
    fn new(name: &'static str, eye: &Eye, directions_mm: Vec<[f32; 3]>, first: bool) -> Self {
        let origin_mm = eye.centre_mm.map(|x| x as f32);
        let exact = directions_mm.iter().map(|direction| Vector3::from(*direction).map(f64::from));
        let (mut exact_directions_mm, mut targets_mm) = (Vec::new(), Vec::new());
        if first {
            exact_directions_mm.extend(exact);
        } else {
            targets_mm.extend(exact.map(|direction| origin_mm.map(f64::from) + direction));
        }
        Self { name, origin_mm: origin_mm.into(), directions_mm, exact_directions_mm, targets_mm, first }
    }
}

fn any_hit(name: &'static str, eye: &Eye, targets: impl Iterator<Item = Point3<f64>>) -> Rays {
    let directions_mm = targets.map(|target| (target - eye.centre_mm).map(|x| x as f32).into()).collect();
    Rays::new(name, eye, directions_mm, false)
}

/// Point where a line meets the plane of a face.
fn on_plane(mesh: &Mesh, face: u32, origin: &Point3<f64>, direction: &[f32; 3]) -> Point3<f64> {
    let (normal, direction) = (mesh.scaled_normal(face as usize), Vector3::from(*direction).map(f64::from));
    let along = normal.dot(&(mesh.corners(face as usize)[0] - origin)) / normal.dot(&direction);
    origin + direction * along
}

fn samples_facing<'a>(mesh: &'a Mesh, eye: &'a Point3<f64>) -> impl Iterator<Item = Point3<f64>> + 'a {
    let each = SAMPLES.div_ceil(mesh.faces.len());
    let facing = move |face: &usize| mesh.scaled_normal(*face).dot(&(eye - mesh.corners(*face)[0])) > 0.0;
    (0..mesh.faces.len()).filter(facing).flat_map(move |face| {
        let [a, b, c] = mesh.corners(face);
        (0..each).map(move |index| {
            // Thirds of the triangle's medians, turned by the golden ratio: never on an edge.
            let turn = index as f64 * 0.618_033_988_749_895;
            let (s, t) = (0.1 + 0.4 * turn.fract(), 0.1 + 0.4 * (turn * 1.7).fract());
            a + (b - a) * s + (c - a) * t
        })
    })
}

/// Answers of a ray caster for an array.
enum Answers {
    /// First faces.
    Faces(Vec<u32>),
    /// Any hits.
    Blocked(Vec<bool>),
}

impl Answers {
    fn for_rays(rays: &Rays) -> Self {
        let count = rays.directions_mm.len();
        if rays.first { Self::Faces(vec![NO_FACE; count]) } else { Self::Blocked(vec![false; count]) }
    }

    /// Rays answered differently, parts per million. Which of two faces is met on their edge counts as different.
    fn differing_ppm(&self, other: &Self) -> f64 {
        let (differing, rays) = match (self, other) {
            (Self::Faces(a), Self::Faces(b)) => (a.iter().zip(b).filter(|(a, b)| a != b).count(), a.len()),
            (Self::Blocked(a), Self::Blocked(b)) => (a.iter().zip(b).filter(|(a, b)| a != b).count(), a.len()),
            _ => unreachable!("both answer the same array"),
        };
        differing as f64 * 1e6 / rays as f64
    }
}

/// One that casts arrays.
struct Caster<'a> {
    /// Name of the caster in the table.
    label: String,
    /// Numbers of threads on which it can run.
    threads: &'static [usize],
    /// Fills in the answers on so many threads; or why it cannot.
    cast: Result<Cast<'a>, String>,
}

/// Casts an array on a number of threads.
type Cast<'a> = Box<dyn Fn(&Rays, usize, &mut Answers) -> Cost + 'a>;

/// This project's packets.
fn vantage<'a>(level: SimdLevel, scene: &'a RayScene, pools: &'a Pools) -> Caster<'a> {
    let cast: Cast<'a> = Box::new(move |rays, threads, answers| {
        let origin = Point3::from(rays.origin_mm).map(f64::from);
        let work = || match answers {
            Answers::Faces(faces) => {
                let chunks = rays.exact_directions_mm.par_chunks(CHUNK).zip(faces.par_chunks_mut(CHUNK));
                chunks.for_each_init(Vec::new, |hits, (directions, faces)| {
                    scene.first_hits_from(level, &origin, directions, hits);
                    let first = hits.iter().map(|hit| hit.map_or(NO_FACE, |hit| hit.triangle));
                    faces.iter_mut().zip(first).for_each(|(face, first)| *face = first);
                });
            }
            Answers::Blocked(blocked) => {
                let chunks = rays.targets_mm.par_chunks(CHUNK).zip(blocked.par_chunks_mut(CHUNK));
                chunks.for_each_init(Vec::new, |found, (targets, blocked)| {
                    scene.blocked_from(level, &origin, targets, f64::from(END), found);
                    blocked.copy_from_slice(found);
                });
            }
        };
        cost(|| pools.of(threads).install(work)).1
    });
    Caster { label: format!("Vantage, {}", level.as_str()), threads: &[1, 2], cast: Ok(cast) }
}

/// Embree with packets.
fn embree<'a>(label: &str, scene: Result<&'a EmbreeScene, &String>, pools: &'a Pools) -> Caster<'a> {
    let cast = |scene: &'a EmbreeScene| -> Cast<'a> {
        Box::new(move |rays, threads, answers| {
            let chunks = rays.directions_mm.par_chunks(CHUNK);
            let work = || match answers {
                Answers::Faces(faces) => chunks
                    .zip(faces.par_chunks_mut(CHUNK))
                    .for_each(|(directions, faces)| scene.first_faces(rays.origin_mm, directions, faces)),
                Answers::Blocked(blocked) => chunks
                    .zip(blocked.par_chunks_mut(CHUNK))
                    .for_each(|(directions, blocked)| scene.blocked(rays.origin_mm, directions, END, blocked)),
            };
            cost(|| pools.of(threads).install(work)).1
        })
    };
    Caster { label: label.into(), threads: &[1, 2], cast: scene.map(cast).map_err(String::clone) }
}

/// A peer written in Python, which keeps the arrays under their names.
fn python<'a>(peer: Peer, python: &'a Result<RefCell<Python>, String>) -> Caster<'a> {
    let cast = |python: &'a RefCell<Python>| -> Cast<'a> {
        Box::new(move |rays, threads, answers| {
            let mut python = python.borrow_mut();
            match answers {
                Answers::Faces(faces) => python.first_faces(peer, rays.name, threads, faces),
                Answers::Blocked(blocked) => python.blocked(peer, rays.name, END, threads, blocked),
            }
        })
    };
    let label = python.as_ref().map_or_else(|_| peer.title().to_owned(), |python| python.borrow_mut().version(peer));
    Caster { label, threads: peer.threads(), cast: python.as_ref().map(cast).map_err(String::clone) }
}

/// Lets everyone cast `rays` in turn. Gives a row a caster: rates, ratio to the first of `casters`, and the share of
/// answers that are not those of the second, which must be robust; and the ratios as numbers. Rates and ratios on one
/// thread are by CPU time, which other work on the machine disturbs least.
fn compare(rounds: usize, rays: &Rays, casters: &[Caster<'_>]) -> Vec<(Vec<String>, Option<f64>)> {
    let answers: Vec<_> = casters.iter().map(|_| RefCell::new(Answers::for_rays(rays))).collect();
    let contestants = casters.iter().zip(&answers).flat_map(|(caster, answers)| {
        caster.threads.iter().map(move |threads| -> Contestant<'_> {
            let cast = caster.cast.as_ref().map_err(String::clone)?;
            Ok(Box::new(|| cast(rays, *threads, &mut answers.borrow_mut())))
        })
    });
    let mut medians = race(rounds, contestants.collect()).into_iter();
    let (expected, mut first_s) = (answers[1].borrow(), None);
    let rate = |seconds: f64| number(rays.directions_mm.len() as f64 / seconds / 1e6);
    casters
        .iter()
        .zip(&answers)
        .map(|(caster, answers)| {
            let costs: Result<Vec<_>, _> = medians.by_ref().take(caster.threads.len()).collect();
            let names = [rays.name.to_owned(), caster.label.clone()];
            let costs = match costs {
                Ok(costs) => costs,
                Err(reason) => return (names.into_iter().chain([reason]).chain([const { String::new() }; 3]).collect(), None),
            };
            let ratio = *first_s.get_or_insert(costs[0].cpu_s) / costs[0].cpu_s;
            let on_two = costs.get(1).map_or_else(|| "one thread only".into(), |cost| rate(cost.wall_s));
            let differing = number(answers.borrow().differing_ppm(&expected));
            (names.into_iter().chain([rate(costs[0].cpu_s), on_two, number(ratio), differing]).collect(), Some(ratio))
        })
        .collect()
}
