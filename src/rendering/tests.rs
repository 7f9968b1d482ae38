use std::sync::atomic::AtomicBool;

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::quantise::quantise;
use super::shading::Lamp;
use super::{BodyRole, Camera, GLOW, Image, Ink, MissGroup, SampledModel, Seen, Shading, mixed, scaled};
use crate::geometry::{Mesh, Pose, SimdLevel};
use crate::planning::context::{Context, Silent};
use crate::planning::params::{PartParams, RegionParams};
use crate::planning::plan::Grade;
use crate::planning::surface::{self, Surface};

const INK_A: Ink = Ink::Measured(Grade::A);
const INK_SHADOW: Ink = Ink::Missed(MissGroup::Shadow);

fn mesh_of(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Mesh {
    Mesh {
        vertices_mm: vertices.iter().map(|p| Point3::from(*p)).collect(),
        faces: faces.to_vec(),
        source_face: (0..).take(faces.len()).collect(),
        groups: Vec::new(),
    }
}

fn surface_of(mesh: &Mesh, patch_edge_mm: f64) -> Surface {
    let params = PartParams { patch_edge_mm: Some(patch_edge_mm), samples_per_mm2: Some(0.0001), ..PartParams::default() };
    surface::sample(mesh, &params, &RegionParams::default(), 0).expect("a surface")
}

/// A part to be drawn.
struct Scene {
    sampled: SampledModel,
    shading: Shading,
}

impl Scene {
    fn picture(&self, camera: &Camera, inks: &[Ink], through: bool, level: SimdLevel) -> Image {
        let codes: Vec<u8> = inks.iter().map(|ink| ink.code()).collect();
        Seen::new(&self.sampled.model, camera, level).picture(&self.shading, &self.sampled.inks(&codes), through)
    }

    /// The part, each surface sample in its ink.
    fn render(&self, camera: &Camera, inks: &[Ink]) -> Image {
        self.picture(camera, inks, false, SimdLevel::widest())
    }

    fn render_through(&self, camera: &Camera, inks: &[Ink]) -> Image {
        self.picture(camera, inks, true, SimdLevel::widest())
    }
}

fn sampled(mesh: &Mesh, surface: &Surface) -> SampledModel {
    let cancel = AtomicBool::new(false);
    SampledModel::new(mesh, surface, None, &Context::new(&cancel, &Silent)).expect("not cancelled")
}

fn scene_of(mesh: &Mesh, surface: &Surface) -> Scene {
    let sampled = sampled(mesh, surface);
    let shading = Shading::new(&sampled.model);
    Scene { sampled, shading }
}

/// Looks along +z of the part from its origin, 100 pixels focal length, 80 × 80 pixels.
fn camera() -> Camera {
    Camera { camera_from_part: Pose::identity(), size_px: [80, 80], focal_px: 100.0, centre_px: [40.0, 40.0] }
}

fn pixel(image: &Image, x: usize, y: usize) -> [u8; 4] {
    image.rgba[y * image.size_px[0] + x]
}

/// The ink whose colour, dimmed to any brightness, is nearest to a pixel's.
fn ink_of(pixel: [u8; 4], among: &[Ink]) -> Ink {
    let unit = |rgb: [u8; 3]| Vector3::from(rgb.map(f64::from)).normalize();
    let hue = unit([pixel[0], pixel[1], pixel[2]]);
    *among.iter().max_by(|a, b| unit(a.rgb()).dot(&hue).total_cmp(&unit(b.rgb()).dot(&hue))).expect("inks")
}

/// A square of ±`half` at depth z that faces the origin, as two triangles.
fn square(half: f64, z: f64) -> ([[f64; 3]; 4], [[u32; 3]; 2]) {
    ([[-half, -half, z], [-half, half, z], [half, half, z], [half, -half, z]], [[0, 1, 2], [0, 2, 3]])
}

#[test]
fn a_square_covers_exactly_its_pixels() {
    let (vertices, faces) = square(20.0, 100.0);
    let mesh = mesh_of(&vertices, &faces);
    let surface = surface_of(&mesh, 1000.0);
    let image = scene_of(&mesh, &surface).render(&camera(), &[INK_A; 2]);
    for (x, y) in (0..80).flat_map(|x| (0..80).map(move |y| (x, y))) {
        let inside = (20..60).contains(&x) && (20..60).contains(&y);
        let border = x == 19 || y == 19 || x == 60 || y == 60;
        let opacity = pixel(&image, x, y)[3];
        assert!(border || opacity == if inside { 255 } else { 0 }, "opacity {opacity} at {x}, {y}");
    }
    assert_eq!(ink_of(pixel(&image, 40, 40), &[INK_A, INK_SHADOW]), INK_A);
}

#[test]
fn the_nearer_surface_is_seen_in_either_order() {
    let ((far, faces), (near, _)) = (square(30.0, 150.0), square(10.0, 100.0));
    for order in [[far, near], [near, far]] {
        let vertices: Vec<[f64; 3]> = order.concat();
        let mesh = mesh_of(&vertices, &[faces[0], faces[1], faces[0].map(|v| v + 4), faces[1].map(|v| v + 4)]);
        let surface = surface_of(&mesh, 1000.0);
        let near_first = order[0][0][2] < 120.0;
        let inks = if near_first { [INK_A, INK_A, INK_SHADOW, INK_SHADOW] } else { [INK_SHADOW, INK_SHADOW, INK_A, INK_A] };
        let image = scene_of(&mesh, &surface).render(&camera(), &inks);
        assert_eq!(ink_of(pixel(&image, 40, 40), &[INK_A, INK_SHADOW]), INK_A);
        assert_eq!(ink_of(pixel(&image, 25, 40), &[INK_A, INK_SHADOW]), INK_SHADOW);
    }
}

#[test]
fn inner_sides_are_told_apart_and_coincident_sheets_show_the_facing_one() {
    let (vertices, faces) = square(20.0, 100.0);
    let away = faces.map(|[a, b, c]| [a, c, b]);
    let open = mesh_of(&vertices, &away);
    let surface = surface_of(&open, 1000.0);
    let image = scene_of(&open, &surface).render(&camera(), &[INK_A; 2]);
    assert_eq!(pixel(&image, 40, 40)[..3], Ink::Back.rgb());
    let sheet = mesh_of(&vertices, &[away[0], away[1], faces[0], faces[1]]);
    let surface = surface_of(&sheet, 1000.0);
    let image = scene_of(&sheet, &surface).render(&camera(), &[INK_A; 4]);
    assert!((22..58).all(|x| ink_of(pixel(&image, x, 33), &[INK_A, Ink::Back]) == INK_A));
}

#[test]
fn what_reaches_behind_the_camera_is_cut_and_not_folded_over() {
    // A floor 10 mm below the camera (+y is down), from behind it to far ahead.
    let floor = mesh_of(
        &[[-500.0, 10.0, -300.0], [500.0, 10.0, -300.0], [500.0, 10.0, 900.0], [-500.0, 10.0, 900.0]],
        &[[0, 1, 2], [0, 2, 3]],
    );
    let surface = surface_of(&floor, 5000.0);
    let image = scene_of(&floor, &surface).render(&camera(), &vec![INK_A; surface.sample_mm.len()]);
    assert!((0..38).all(|y| pixel(&image, 40, y)[3] == 0), "nothing above the horizon");
    assert!((44..80).all(|y| pixel(&image, 40, y)[3] == 255), "the floor below it");
}

#[test]
fn misses_show_through_what_hides_them_and_nothing_else_does() {
    let ((hidden, faces), (front, _)) = (square(10.0, 150.0), square(30.0, 100.0));
    let mesh = mesh_of(&[front, hidden].concat(), &[faces[0], faces[1], faces[0].map(|v| v + 4), faces[1].map(|v| v + 4)]);
    let surface = surface_of(&mesh, 1000.0);
    let scene = scene_of(&mesh, &surface);
    let plain = scene.render(&camera(), &[Ink::ByOthers; 4]);
    let through = scene.render_through(&camera(), &[Ink::ByOthers, Ink::ByOthers, INK_SHADOW, INK_SHADOW]);
    assert_eq!(pixel(&through, 20, 40), pixel(&plain, 20, 40), "beside the hidden square");
    let (seen, covered) = (pixel(&through, 40, 40), pixel(&plain, 40, 40));
    assert!(seen[2] > seen[0] + 60, "the hidden miss turns {covered:?} blue: {seen:?}");
    let resting = Ink::Missed(MissGroup::Resting);
    let stands = scene.render_through(&camera(), &[Ink::ByOthers, Ink::ByOthers, resting, resting]);
    assert_eq!(pixel(&stands, 40, 40), covered, "what the part stands on does not darken it");
    let measured = scene.render_through(&camera(), &[INK_SHADOW, INK_SHADOW, INK_A, INK_A]);
    assert_eq!(ink_of(pixel(&measured, 40, 40), &[INK_A, INK_SHADOW]), INK_SHADOW);
}

#[test]
fn corners_on_edges_leave_no_pinholes() {
    // A square whose diagonal is one long edge below and many short ones above, as some files have it.
    let (vertices, _) = square(37.0, 100.0);
    let mut with_corners = vertices.to_vec();
    with_corners.extend((1..40).map(|i| [f64::from(i) * 1.85 - 37.0, f64::from(i) * 1.85 - 37.0, 100.0]));
    let along: Vec<u32> = std::iter::once(0).chain(4..43).chain([2]).collect();
    let mut faces = vec![[0, 1, 2]];
    faces.extend(along.windows(2).map(|pair| [pair[0], pair[1], 3]));
    let mesh = mesh_of(&with_corners, &faces);
    let surface = surface_of(&mesh, 1000.0);
    let scene = scene_of(&mesh, &surface);
    let inks = vec![INK_A; surface.sample_mm.len()];
    for turn in 0..12 {
        let rotation = UnitQuaternion::from_euler_angles(0.31, -0.22, 0.47 * f64::from(turn));
        let camera_from_part = Pose::claim(Isometry3::from_parts(nalgebra::Translation3::new(0.7, -0.4, 12.3), rotation));
        let image = scene.render(&Camera::fitted(camera_from_part, [640, 480], &mesh.vertices_mm), &inks);
        // Within a row, opaque pixels must be one run.
        for row in image.rgba.chunks(640) {
            let first = row.iter().position(|pixel| pixel[3] == 255);
            let last = row.iter().rposition(|pixel| pixel[3] == 255);
            if let (Some(first), Some(last)) = (first, last) {
                assert!(row[first..=last].iter().all(|pixel| pixel[3] == 255), "a pinhole at turn {turn}");
            }
        }
    }
}

#[test]
fn each_sample_colours_its_own_part_of_a_patch() {
    let (vertices, faces) = square(20.0, 100.0);
    let mesh = mesh_of(&vertices, &faces);
    let params = PartParams { patch_edge_mm: Some(1000.0), samples_per_mm2: Some(0.5), ..PartParams::default() };
    let surface = surface::sample(&mesh, &params, &RegionParams::default(), 0).expect("a surface");
    let inks: Vec<Ink> = surface.sample_mm.iter().map(|p| if p.x < 0.0 { INK_A } else { INK_SHADOW }).collect();
    let image = scene_of(&mesh, &surface).render(&camera(), &inks);
    assert_eq!(ink_of(pixel(&image, 30, 35), &[INK_A, INK_SHADOW]), INK_A);
    assert_eq!(ink_of(pixel(&image, 50, 35), &[INK_A, INK_SHADOW]), INK_SHADOW);
}

#[test]
fn a_fitted_camera_shows_the_whole_part_and_little_else() {
    let vertices: Vec<Point3<f64>> = [[-30.0, -5.0, 400.0], [70.0, 45.0, 500.0], [10.0, 20.0, 450.0]].map(Point3::from).to_vec();
    let camera = Camera::fitted(Pose::identity(), [640, 480], &vertices);
    let pixels: Vec<[f64; 2]> = vertices.iter().filter_map(|p| camera.pixel(p)).collect();
    let span = |axis: usize| {
        let values = pixels.iter().map(|p| p[axis]);
        (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
    };
    let ((left, right), (top, bottom)) = (span(0), span(1));
    assert!(left > 0.0 && top > 0.0 && right < 640.0 && bottom < 480.0);
    assert!((right - left - 0.9 * 640.0).abs() < 1e-6 || (bottom - top - 0.9 * 480.0).abs() < 1e-6);
    assert!((left + right - 640.0).abs() < 1e-6 && (top + bottom - 480.0).abs() < 1e-6);
    let direction = camera.direction(pixels[0]);
    assert!((direction * 400.0 - vertices[0].coords).norm() < 1e-6);
}

#[test]
fn few_colours_survive_and_many_become_a_palette() {
    let few: Vec<[u8; 4]> = [[0; 4], [27, 95, 168, 255], [240, 110, 17, 255], [27, 95, 168, 127]].repeat(50);
    let indexed = quantise(&few);
    assert!(few.iter().zip(&indexed.indices).all(|(pixel, index)| indexed.palette[*index as usize] == *pixel));
    let many: Vec<[u8; 4]> = (0..=255u8).flat_map(|r| (0..=255u8).map(move |g| [r, g, r / 2 + g / 2, 255])).collect();
    let indexed = quantise(&many);
    assert_eq!(indexed.palette.len(), 256);
    let off = |(pixel, index): (&[u8; 4], &u8)| (0..4).map(|c| pixel[c].abs_diff(indexed.palette[*index as usize][c])).max();
    let worst = many.iter().zip(&indexed.indices).filter_map(off).max();
    assert!(worst < Some(24), "{worst:?}");
}

#[test]
fn a_picture_tells_what_it_shows() {
    let ((hidden, faces), (front, _)) = (square(10.0, 150.0), square(30.0, 100.0));
    let mesh = mesh_of(&[front, hidden].concat(), &[faces[0], faces[1], faces[0].map(|v| v + 4), faces[1].map(|v| v + 4)]);
    let surface = surface_of(&mesh, 1000.0);
    let scene = scene_of(&mesh, &surface);
    let rendered = Seen::new(&scene.sampled.model, &camera(), SimdLevel::widest());
    let towards = -Vector3::z();
    assert!(rendered.shows(&Point3::new(3.0, 4.0, 100.0), &towards));
    assert!(!rendered.shows(&Point3::new(3.0, 4.0, 150.0), &towards), "behind the front");
    assert!(!rendered.shows(&Point3::new(3.0, 4.0, 100.0), &Vector3::z()), "the other side of it");
    assert!(!rendered.shows(&Point3::new(60.0, 4.0, 100.0), &towards), "beside the picture");
    assert!(!rendered.shows(&Point3::new(3.0, 4.0, -10.0), &towards), "behind the camera");
}

#[test]
fn a_camera_afar_draws_to_scale() {
    let (at_mm, radius_mm) = (Point3::new(100.0, -40.0, 7.0), 50.0);
    let camera = Camera::from_afar(&at_mm, [Vector3::z(), Vector3::y()], radius_mm, 2.0, [200, 100]);
    let pixel = |x: f64, y: f64, z: f64| {
        let p = camera.camera_from_part.point(&(at_mm + Vector3::new(x, y, z)));
        camera.pixel(&p).expect("before the camera")
    };
    for (p, expected) in [([0.0, 0.0, 0.0], [100.0, 50.0]), ([40.0, 0.0, 0.0], [180.0, 50.0]), ([0.0, 20.0, 0.0], [100.0, 10.0])]
    {
        let [x, y] = pixel(p[0], p[1], p[2]);
        assert!((x - expected[0]).abs() < 1e-6 && (y - expected[1]).abs() < 1e-6, "{p:?}: {x} {y}");
    }
    let [x, _] = pixel(40.0, 0.0, radius_mm);
    assert!((x - 180.0).abs() < 0.5, "nearer by a radius: {x}");
}

/// Colour vision that a picture is simulated for.
#[derive(Clone, Copy, Debug)]
enum Vision {
    Normal,
    Protan,
    Deutan,
}

/// CIELAB (D65) of sRGB as someone sees it: linear RGB times the matrix of Machado et al. 2009, severity 1.
fn lab(rgb: [u8; 3], vision: Vision) -> Vector3<f64> {
    let linear = Vector3::from(rgb).map(|channel| match f64::from(channel) / 255.0 {
        c if c <= 0.04045 => c / 12.92,
        c => ((c + 0.055) / 1.055).powf(2.4),
    });
    let rows = match vision {
        Vision::Normal => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        Vision::Protan => {
            [[0.152_286, 1.052_583, -0.204_868], [0.114_503, 0.786_281, 0.099_216], [-0.003_882, -0.048_116, 1.051_998]]
        }
        Vision::Deutan => {
            [[0.367_322, 0.860_646, -0.227_968], [0.280_085, 0.672_501, 0.047_413], [-0.011_820, 0.042_940, 0.968_881]]
        }
    };
    let times = |rows: [[f64; 3]; 3], v: Vector3<f64>| Vector3::from(rows.map(|row| Vector3::from(row).dot(&v)));
    let seen = times(rows, linear).map(|c| c.clamp(0.0, 1.0));
    // sRGB to CIE XYZ (IEC 61966-2-1), relative to the white D65.
    let xyz = times(
        [
            [0.412_456_4, 0.357_576_1, 0.180_437_5],
            [0.212_672_9, 0.715_152_2, 0.072_175_0],
            [0.019_333_9, 0.119_192_0, 0.950_304_1],
        ],
        seen,
    );
    let [x, y, z] = [xyz.x / 0.950_47, xyz.y, xyz.z / 1.088_83].map(|t| match t {
        t if t > 216.0 / 24_389.0 => t.cbrt(),
        t => (24_389.0 / 27.0 * t + 16.0) / 116.0,
    });
    Vector3::new(116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z))
}

/// Colours in which an ink is drawn: shaded from the darkest to the brightest, and shining through measured surface.
fn drawn(ink: Ink, measured: Ink) -> Vec<[u8; 3]> {
    let dark = Lamp::MIN_LIGHT as f32;
    let shades = [0.0, 0.33, 0.67, 1.0].map(|share| dark + share * (1.0 - dark));
    let through = [dark, 1.0].map(|light| mixed(scaled(measured.rgb(), light), ink.rgb(), GLOW));
    let through = through.into_iter().filter(|_| ink.glows());
    shades.map(|light| scaled(ink.rgb(), light)).into_iter().chain(through).collect()
}

#[test]
fn colours_of_a_picture_are_apart_for_every_reader_however_they_are_shaded() {
    use MissGroup::{Depth, Facing, Frame, Incidence, NotChosen, Reach, Resting, Shadow};
    let grades = [Grade::A, Grade::B, Grade::C, Grade::D].map(Ink::Measured);
    let of_grades = [&grades[..], &[Ink::Unmeasured, Ink::ByOthers, Ink::NotAsked, Ink::Back]].concat();
    let causes = [Shadow, Incidence, Facing, Frame, Depth, Reach, Resting, NotChosen].map(Ink::Missed);
    let of_causes = [&causes[..], &[Ink::ByOthers, Ink::NotAsked, Ink::Back]].concat();
    let roles = [BodyRole::First, BodyRole::Second, BodyRole::Part, BodyRole::Other].map(Ink::Body);
    let of_bodies = [&roles[..], &[Ink::Back]].concat();
    for inks in [of_grades, of_causes, of_bodies] {
        for vision in [Vision::Normal, Vision::Protan, Vision::Deutan] {
            for (place, a) in inks.iter().enumerate() {
                for b in &inks[..place] {
                    let pairs = drawn(*a, Ink::ByOthers)
                        .into_iter()
                        .flat_map(|x| drawn(*b, Ink::ByOthers).into_iter().map(move |y| (x, y)));
                    let nearest = pairs.map(|(x, y)| (lab(x, vision) - lab(y, vision)).norm()).fold(f64::INFINITY, f64::min);
                    assert!(nearest >= 20.0, "{a:?} and {b:?}, {vision:?}: ΔE {nearest:.1}");
                }
            }
        }
    }
}

#[test]
fn grades_and_misses_are_apart_in_grey() {
    let inks =
        [Ink::Measured(Grade::A), Ink::Measured(Grade::B), Ink::Measured(Grade::C), Ink::Measured(Grade::D), Ink::Unmeasured];
    let lightness = inks.map(|ink| lab(ink.rgb(), Vision::Normal).x);
    for (place, a) in lightness.iter().enumerate() {
        assert!(lightness[..place].iter().all(|b| (a - b).abs() >= 14.0), "{lightness:?}");
    }
}

#[test]
fn shading_stays_within_its_range() {
    let lamp = Lamp::beside(&Pose::identity());
    for (polar, azimuth) in (0..=18).flat_map(|polar| (0..36).map(move |azimuth| (polar, azimuth))) {
        let (polar, azimuth) = (f64::from(polar) * 10f64.to_radians(), f64::from(azimuth) * 10f64.to_radians());
        let normal = Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos());
        let light = f64::from(lamp.light(&normal.map(|c| c as f32)));
        assert!((Lamp::MIN_LIGHT - 1e-6..=1.0).contains(&light), "{light} for {normal:?}");
    }
}

/// A ball of so many rings, with ink in stripes; pictures of it in three sizes of triangles are small, large, and both.
fn ball(rings: u32) -> Mesh {
    let at = |ring: u32, place: u32| {
        let (polar, azimuth) = (f64::from(ring) / f64::from(rings), f64::from(place) / f64::from(2 * rings));
        let (polar, azimuth) = (std::f64::consts::PI * polar, std::f64::consts::TAU * azimuth);
        [20.0 * polar.sin() * azimuth.cos(), 20.0 * polar.sin() * azimuth.sin(), 100.0 + 20.0 * polar.cos()]
    };
    let number = |ring: u32, place: u32| match ring {
        0 => 0,
        ring if ring == rings => 1,
        ring => 2 + (ring - 1) * 2 * rings + place % (2 * rings),
    };
    let inner = (1..rings).flat_map(|ring| (0..2 * rings).map(move |place| (ring, place)));
    let vertices: Vec<[f64; 3]> =
        [at(0, 0), at(rings, 0)].into_iter().chain(inner.map(|(ring, place)| at(ring, place))).collect();
    let quads = (0..rings).flat_map(|ring| (0..2 * rings).map(move |place| (ring, place)));
    let halves = quads.flat_map(|(ring, place)| {
        let [a, b] = [number(ring, place), number(ring, place + 1)];
        let [c, d] = [number(ring + 1, place), number(ring + 1, place + 1)];
        [[a, c, d], [a, d, b]]
    });
    let faces: Vec<[u32; 3]> = halves.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    mesh_of(&vertices, &faces)
}

fn stripes(surface: &Surface) -> Vec<Ink> {
    let inks = [INK_A, INK_SHADOW, Ink::ByOthers, Ink::Missed(MissGroup::Reach)];
    surface.sample_mm.iter().map(|p| inks[(p.x.abs() * 0.4) as usize % 4]).collect()
}

#[test]
fn every_level_of_vector_instructions_draws_the_same() {
    for rings in [4, 40, 200] {
        let mesh = ball(rings);
        let surface = surface_of(&mesh, 1000.0);
        let (scene, inks) = (scene_of(&mesh, &surface), stripes(&surface));
        let camera = Camera::fitted(Pose::identity(), [320, 240], &mesh.vertices_mm);
        for through in [false, true] {
            let pictures: Vec<Image> =
                SimdLevel::available().into_iter().map(|level| scene.picture(&camera, &inks, through, level)).collect();
            assert!(pictures.iter().all(|picture| *picture == pictures[0]), "{rings} rings");
            assert!(pictures[0].rgba.iter().filter(|pixel| pixel[3] == 255).count() > 30_000);
        }
    }
}

#[test]
fn a_ball_of_small_triangles_looks_like_one_of_large_ones() {
    // 64 and 400 rings: of several pixels each, and of less than one.
    let image = |rings: u32| {
        let mesh = ball(rings);
        let surface = surface_of(&mesh, 1000.0);
        let inks = vec![Ink::ByOthers; surface.sample_mm.len()];
        let camera = Camera::fitted(Pose::identity(), [320, 240], &ball(64).vertices_mm);
        scene_of(&mesh, &surface).render(&camera, &inks)
    };
    let (coarse, fine) = (image(64), image(400));
    let inside = |pixel: &[u8; 4]| pixel[3] == 255 && pixel[0] > 150;
    let both = coarse.rgba.iter().zip(&fine.rgba).filter(|(a, b)| inside(a) && inside(b));
    // On the rim a pixel may show another facet.
    let off: Vec<u8> = both.flat_map(|(a, b)| (0..3).map(|channel| a[channel].abs_diff(b[channel]))).collect();
    let mean = off.iter().map(|off| f64::from(*off)).sum::<f64>() / off.len() as f64;
    let far_off = off.iter().filter(|off| **off >= 16).count();
    assert!(off.len() > 90_000 && mean < 0.5 && far_off * 1000 < off.len(), "{mean}, {far_off} of {} far off", off.len());
}

#[test]
fn the_code_of_an_ink_is_its_place() {
    for (place, ink) in Ink::ALL.into_iter().enumerate() {
        assert_eq!(usize::from(ink.code()), place);
    }
}
