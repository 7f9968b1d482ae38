//! Files and surfaces crafted to take long or much memory: the cost stays linear, and a request to stop is soon heard.

use std::cell::Cell;
use std::fmt::Write as _;
use std::io::{self, Read};
use std::time::Duration;

use super::*;
use crate::geometry::{Poll, preview};

/// CPU time that this thread has used.
fn cpu_time() -> Duration {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
}

/// Runs work, with all that it would do side by side, on one thread, whose CPU time then is that of the work.
fn on_one_thread<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    match rayon::current_thread_index() {
        Some(_) => work(),
        None => rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread").install(work),
    }
}

/// CPU time of one call.
fn cost<T: Send>(work: impl FnOnce() -> T + Send) -> (Duration, T) {
    on_one_thread(|| {
        let before = cpu_time();
        let result = work();
        (cpu_time() - before, result)
    })
}

fn read_polled(bytes: &[u8], poll: &Poll<'_>) -> Result<ReadMesh, ReadError> {
    read_from(&mut &bytes[..], bytes.len() as u64, Some(LengthUnit::Millimetre), &Limits::default(), poll)
}

/// The longest CPU time between two polls, from begin to end. A round of work that is done side by side has as many pieces as its
/// threads take in the same time.
fn longest_wait<T>(work: impl FnOnce(&Poll<'_>) -> T + Send) -> Duration {
    on_one_thread(|| {
        let (last, longest) = (Cell::new(cpu_time()), Cell::new(Duration::ZERO));
        let look = || {
            let now = cpu_time();
            longest.set(longest.get().max(now - last.replace(now)));
            false
        };
        let poll = Poll::new(&look);
        let _ = work(&poll);
        look();
        longest.get()
    })
}

fn binary_stl(triangles: impl ExactSizeIterator<Item = [[f32; 3]; 3]>) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for corners in triangles {
        bytes.extend([0; 12]);
        bytes.extend(corners.iter().flatten().flat_map(|value| value.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

/// Triangles none of which shares a vertex with another.
fn soup(triangles: u32) -> Vec<u8> {
    binary_stl((0..triangles as usize).map(|i| {
        let [x, y] = [i % 1000, i / 1000].map(|i| i as f32);
        [[x, y, 0.0], [x + 0.7, y, 0.0], [x, y + 0.7, 0.0]]
    }))
}

/// A fan of thin triangles around one vertex.
fn fan(triangles: u32) -> Vec<u8> {
    let rim = move |i: usize| {
        let (sin, cos) = (std::f32::consts::TAU * i as f32 / triangles as f32).sin_cos();
        [100.0 * cos, 100.0 * sin, 0.0]
    };
    binary_stl((0..triangles as usize).map(|i| [[0.0; 3], rim(i), rim(i + 1)]))
}

/// Triangles that all have one edge in common.
fn book(triangles: u32) -> Vec<u8> {
    binary_stl((0..triangles as usize).map(|i| {
        let (sin, cos) = (std::f32::consts::TAU * i as f32 / triangles as f32).sin_cos();
        [[0.0; 3], [0.0, 0.0, 10.0], [cos, sin, 5.0]]
    }))
}

/// One triangle many times, and one far away: all but that one lie in one cell of every grid.
fn copies(triangles: u32) -> Vec<u8> {
    let at = |i: usize| if i == 0 { 1e5 } else { 0.0 };
    binary_stl((0..triangles as usize).map(|i| [[at(i), 0.0, 0.0], [at(i) + 1.0, 0.0, 0.0], [at(i), 1.0, 0.0]]))
}

#[test]
fn a_line_continued_a_million_times_is_read_in_linear_time() {
    let corners = "1 \\\n2 \\\n3 \\\n".repeat(350_000);
    let text = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nf \\\n{corners}1\n");
    let (cost, read) = cost(|| read_mm(text.as_bytes()));
    assert_eq!(read.expect("a polygon").health.triangles_in_file, 1_049_999);
    assert!(cost < Duration::from_secs(20), "{cost:?} for {} bytes", text.len());
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_polygon_of_a_million_corners_is_read_in_linear_time() {
    let corners: Vec<u32> = (1..=1_000_000).collect();
    let vertex = |i: &u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(*i) / 1e6).sin_cos();
        [cos, sin, 0.0]
    };
    let vertices: Vec<[f64; 3]> = corners.iter().map(vertex).collect();
    let mut text = String::new();
    vertices.iter().for_each(|[x, y, z]| writeln!(text, "v {x} {y} {z}").expect("text"));
    let numbers: Vec<String> = corners.iter().map(u32::to_string).collect();
    writeln!(text, "f {}", numbers.join(" ")).expect("text");
    let (cost, read) = cost(|| read_mm(text.as_bytes()));
    assert_eq!(read.expect("a polygon").health.triangles_in_file, 999_998);
    assert!(cost < Duration::from_secs(20), "{cost:?}");
}

#[test]
#[ignore = "long: tests/all runs it"]
fn names_headers_and_numbers_without_end_are_refused() {
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let mut names = String::from(triangle);
    (0..1_000_001).for_each(|name| writeln!(names, "g {name}\nf 1 2 3").expect("text"));
    assert_eq!(code(names.as_bytes()), "mesh_too_large");
    let long = format!("{triangle}o {}\nf 1 2 3\n", "n".repeat(1001));
    assert_eq!(code(long.as_bytes()), "mesh_too_large");
    let properties = "property uchar more\n".repeat(10_001);
    let header = format!("ply\nformat ascii 1.0\nelement vertex 1\n{properties}end_header\n");
    assert_eq!(code(header.as_bytes()), "mesh_too_large");
    for number in ["9".repeat(30_000_000), format!("0.{}1", "0".repeat(2000))] {
        let (cost, code) = cost(|| code(format!("v {number} 0 0\n").as_bytes()));
        assert!(code == "mesh_syntax" && cost < Duration::from_secs(2), "{code} after {cost:?}");
    }
}

#[test]
fn groups_named_again_and_again_take_no_more_memory_than_their_faces() {
    let text = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\ng {}\nf 1 2 3\n", "a b ".repeat(1_000_000));
    let read = read_mm(text.as_bytes()).expect("legal");
    let groups: Vec<_> = read.mesh.groups.iter().map(|g| (g.name.as_str(), g.source_faces.as_slice())).collect();
    assert_eq!(groups, [("a", &[0][..]), ("b", &[0])]);
}

/// Files that take more than a moment, each for a different reason.
fn long_files() -> Vec<(&'static str, Vec<u8>)> {
    let ascii = stl_text(&read_mm(&soup(60_000)).expect("a mesh").mesh);
    let mesh = read_mm(&soup(60_000)).expect("a mesh").mesh;
    let vertices: Vec<[f64; 3]> = mesh.vertices_mm.iter().map(|v| [v.x, v.y, v.z]).collect();
    let faces: Vec<Vec<u32>> = mesh.faces.iter().map(|face| face.to_vec()).collect();
    let mut files = vec![
        ("soup", soup(300_000)),
        ("fan", fan(300_000)),
        ("book", book(300_000)),
        ("copies", copies(300_000)),
        ("ascii STL", ascii.into_bytes()),
        ("OBJ", obj(&vertices, &faces).into_bytes()),
        ("continued", format!("v 0 0 0\nf \\\n{}1\n", "1 \\\n".repeat(3_000_000)).into_bytes()),
        ("one long line", [b"v 0 0 0\n".to_vec(), vec![b' '; 60_000_000]].concat()),
        ("a long word", [b"v 0 0 0\nusemtl ".to_vec(), vec![b'x'; 60_000_000]].concat()),
        ("empty lines", vec![b'\n'; 20_000_000]),
        ("zeros", vec![0; 60_000_000]),
        ("UTF-16", [b"\xff\xfe".to_vec(), b"v\0 \0".repeat(10_000_000)].concat()),
    ];
    files.extend(PLY_ENCODINGS.map(|encoding| (encoding, ply(&vertices, &faces, encoding))));
    files
}

#[test]
#[ignore = "long: tests/all runs it"]
fn a_request_to_stop_reading_is_heard_within_milliseconds() {
    for (name, bytes) in long_files() {
        let longest = longest_wait(|poll| read_polled(&bytes, poll));
        // Ten milliseconds in a release build; this one runs some five times slower.
        assert!(longest < Duration::from_millis(50), "{name}: {longest:?} between two polls");
        let looks = Cell::new(0);
        let third = || {
            looks.set(looks.get() + 1);
            looks.get() == 3
        };
        let error = read_polled(&bytes, &Poll::new(&third)).expect_err("stopped");
        assert!(matches!(error, ReadError::Mesh(MeshError::Interrupted)), "{name}: {error}");
    }
}

#[test]
#[ignore = "long: tests/all runs it"]
fn surfaces_that_meet_in_one_place_are_assessed_and_simplified_in_linear_time() {
    for (name, bytes, survives) in [
        ("soup", soup(400_000), true),
        ("fan", fan(400_000), true),
        ("book", book(400_000), false),
        ("copies", copies(400_000), false),
    ] {
        let (reading, read) = cost(|| read_mm(&bytes).expect("a mesh"));
        assert!(reading < Duration::from_secs(20), "{name}: {reading:?}");
        let mut thinned = None;
        let (thinning, longest) =
            cost(|| longest_wait(|poll| thinned = Some(preview(&read.mesh, 30_000, poll).expect("not interrupted"))));
        assert!(thinning < Duration::from_secs(20), "{name}: {thinning:?}");
        assert!(longest < Duration::from_millis(50), "{name}: {longest:?} between two polls");
        let faces = thinned.expect("a preview").faces.len();
        assert!(faces <= 30_000 && (faces > 0) == survives, "{name}: {faces}");
        assert!(preview(&read.mesh, 30_000, &Poll::new(&|| true)).is_err());
    }
}

#[test]
fn many_closed_bodies_are_told_apart_in_linear_time() {
    // Each triangle with its reverse: as many closed bodies as there can be.
    let bodies = binary_stl((0..300_000_usize).map(|i| {
        let [x, y] = [i / 2 % 1000, i / 2000].map(|i| i as f32);
        let mut corners = [[x, y, 0.0], [x + 0.7, y, 0.0], [x, y + 0.7, 0.0]];
        if i % 2 == 1 {
            corners.swap(1, 2);
        }
        corners
    }));
    let (cost, read) = cost(|| read_mm(&bodies).expect("a mesh"));
    assert_eq!((read.health.bodies, read.health.watertight, read.health.volume_mm3), (150_000, true, Some(0.0)));
    assert!(cost < Duration::from_secs(20), "{cost:?}");
}

#[test]
fn a_source_is_read_as_its_bytes_are_and_says_when_it_fails() {
    for bytes in cubes() {
        let whole = read_mm(&bytes).expect("the cube");
        let from_source = read_polled(&bytes, &Poll::never()).expect("the cube");
        assert_eq!((corners(&from_source.mesh), from_source.health), (corners(&whole.mesh), whole.health));
    }
    let stl = write_stl(&read_mm(&cubes()[0]).expect("the cube").mesh);
    let mut cut = &stl[..stl.len() - 60];
    let error = read_from(&mut cut, stl.len() as u64, Some(LengthUnit::Millimetre), &Limits::default(), &Poll::never());
    assert!(matches!(error, Err(ReadError::Mesh(MeshError::Truncated { .. }))));
    struct Broken;
    impl Read for Broken {
        fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
            Err(io::Error::other("gone"))
        }
    }
    let mut broken = stl[..200].chain(Broken);
    let error = read_from(&mut broken, stl.len() as u64, Some(LengthUnit::Millimetre), &Limits::default(), &Poll::never());
    assert!(matches!(error, Err(ReadError::Io(_))));
}
