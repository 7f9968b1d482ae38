//! The mesh that is read of a file does not depend on where it is cut into pieces, nor on the number of threads.

use std::io::Read;
use std::path::PathBuf;

use super::*;

/// Everything that comes of a file, to the bit.
type Found = Result<(Vec<[u64; 3]>, Vec<[u32; 3]>, Vec<u32>, Vec<FaceGroup>, String), MeshError>;

/// Bytes of a piece that holds any file of these tests.
const ONE_PIECE: usize = 1 << 30;
const PIECES: [usize; 6] = [1, 2, 13, 64, 333, 4096];

fn read_in_pieces(bytes: &[u8], piece_bytes: usize, limits: &Limits) -> Found {
    let settings = Settings { piece_bytes, ..Settings::new(LengthUnit::Millimetre, limits) };
    let ReadMesh { mesh, health, .. } = parsed(bytes, Some(settings), &Poll::never())?.finished()?;
    let vertices = mesh.vertices_mm.iter().map(|v| [v.x, v.y, v.z].map(f64::to_bits)).collect();
    Ok((vertices, mesh.faces, mesh.source_face, mesh.groups, format!("{health:?}")))
}

/// Reads a file in pieces of each size.
fn assert_pieces_do_not_matter(name: &str, bytes: &[u8], limits: &Limits) {
    let whole = read_in_pieces(bytes, ONE_PIECE, limits);
    for piece_bytes in PIECES {
        let found = read_in_pieces(bytes, piece_bytes, limits);
        assert!(
            found == whole,
            "{name} in pieces of {piece_bytes}: {:?}, not {:?}",
            found.map(|mesh| mesh.4),
            whole.map(|mesh| mesh.4)
        );
    }
}

/// A sheet of squares, some cut into triangles, with groups, in every format; of some hundred faces, so that pieces of every size
/// end in every place of a record.
fn sheets() -> Vec<(&'static str, Vec<u8>)> {
    const SIDE: u32 = 12;
    let vertices: Vec<[f64; 3]> = (0..(SIDE + 1).pow(2))
        .map(|i| [f64::from(i % (SIDE + 1)) / 3.0, f64::from(i / (SIDE + 1)), f64::from(i * i % 7) / 16.0])
        .collect();
    let squares = (0..SIDE.pow(2)).map(|i| {
        let corner = i / SIDE * (SIDE + 1) + i % SIDE;
        vec![corner, corner + 1, corner + SIDE + 2, corner + SIDE + 1]
    });
    let faces: Vec<Vec<u32>> = squares.map(|square| if square[0] % 5 == 0 { square[..3].to_vec() } else { square }).collect();
    let mut text = String::from("# a sheet\n");
    for (number, vertex) in vertices.iter().enumerate() {
        writeln!(text, "v {} {} {}{}", vertex[0], vertex[1], vertex[2], if number % 9 == 0 { " \\\n 1.0" } else { "" })
            .expect("text");
        // Faces among the vertices, by numbers that count backwards.
        if number % 40 == 39 {
            writeln!(text, "g late_{number}\nf -1 -2 -14").expect("text");
        }
    }
    for (number, face) in faces.iter().enumerate() {
        if number % 17 == 0 {
            writeln!(text, "g group_{} all\no object_{}", number % 4, number / 34).expect("text");
        }
        let corners: Vec<_> = face.iter().map(|v| format!("{}//1", v + 1)).collect();
        writeln!(text, "f {}", corners.join(if number % 6 == 0 { " \\\r\n " } else { "\t" })).expect("text");
    }
    let mesh = read_mm(text.as_bytes()).expect("the sheet").mesh;
    let ascii = stl_text(&mesh);
    let two_solids = ascii.replacen("endfacet", "endfacet\nendsolid a\n\nsolid facet\n", 40).replace("  outer", "\r\n\n  outer");
    let mut files = vec![
        ("OBJ", text.into_bytes()),
        ("STL", ascii.into_bytes()),
        ("solids", two_solids.into_bytes()),
        ("binary STL", write_stl(&mesh)),
    ];
    files.extend(PLY_ENCODINGS.map(|encoding| (encoding, ply(&vertices, &faces, encoding))));
    let spaced = String::from_utf8(ply(&vertices, &faces, "ascii")).expect("text").replace("\n7 4 ", "\n\n \r7 4 ");
    files.push(("spaced PLY", spaced.clone().into_bytes()));
    files.push(("PLY with an end", format!("{spaced}\n\n\n \n").into_bytes()));
    files.push(("PLY with too much", format!("{spaced}\n\n\n7 8 9\n").into_bytes()));
    files
}

#[test]
fn every_format_is_read_the_same_in_pieces_of_any_size() {
    for (name, bytes) in sheets() {
        assert_eq!(read_in_pieces(&bytes, 64, &Limits::default()).is_ok(), name != "PLY with too much", "{name}");
        assert_pieces_do_not_matter(name, &bytes, &Limits::default());
        for max_triangles in [1, 40, 100, 200, 250] {
            assert_pieces_do_not_matter(name, &bytes, &Limits { max_triangles });
        }
    }
}

#[test]
fn every_cut_file_gives_the_same_error_in_pieces_of_any_size() {
    for (name, bytes) in sheets() {
        for length in (1..bytes.len()).step_by(997) {
            assert_pieces_do_not_matter(&format!("{length} bytes of {name}"), &bytes[..length], &Limits::default());
        }
    }
}

#[test]
fn a_file_is_read_the_same_on_any_number_of_threads() {
    for (name, bytes) in sheets() {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| read_in_pieces(&bytes, 64, &Limits::default()))
        };
        let one = on(1);
        assert!([2, 3, 7].into_iter().all(|threads| on(threads) == one), "{name}");
    }
}

#[test]
fn malformed_files_of_third_parties_give_the_same_in_pieces_of_any_size() {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/bad"));
    let mut waiting = vec![folder];
    let mut files = Vec::new();
    while let Some(folder) = waiting.pop() {
        let Ok(entries) = std::fs::read_dir(&folder) else { return };
        for path in entries.map(|entry| entry.expect("readable").path()) {
            if path.is_dir() { waiting.push(path) } else { files.push(path) }
        }
    }
    for path in files {
        let mut bytes = Vec::new();
        // A large file in pieces of a byte takes a minute, and shows no more than a small one.
        std::fs::File::open(&path).expect("readable").take(100_000).read_to_end(&mut bytes).expect("readable");
        assert_pieces_do_not_matter(&path.display().to_string(), &bytes, &Limits::default());
    }
}

proptest! {
    #[test]
    fn a_damaged_file_gives_the_same_in_pieces_of_any_size(
        file in 0_usize..10,
        damage in proptest::collection::vec((0.0_f64..1.0, prop_oneof![any::<u8>(), Just(b'\n'), Just(b'\r'), Just(b'\\'), Just(b' '), Just(b'-')]), 1..4),
        piece_bytes in 1_usize..700,
    ) {
        let (name, mut bytes) = sheets().swap_remove(file);
        let length = bytes.len() as f64;
        damage.into_iter().for_each(|(place, byte)| bytes[(place * length) as usize] = byte);
        let (whole, found) = [ONE_PIECE, piece_bytes].map(|size| read_in_pieces(&bytes, size, &Limits::default())).into();
        prop_assert!(found == whole, "{}: {:?}, not {:?}", name, found.map(|mesh| mesh.4), whole.map(|mesh| mesh.4));
    }

    #[test]
    fn points_that_repeat_are_welded_the_same_in_pieces_of_any_size(
        corners in proptest::collection::vec([-3_i8..3, -3..3, -3..3], 3..300),
        piece_bytes in 1_usize..700,
    ) {
        let triangles = corners.as_chunks::<3>().0;
        let mut text = String::from("solid x\n");
        for triangle in triangles {
            text.push_str("facet normal 0 0 1\nouter loop\n");
            // Noise below the resolution of a 32-bit float.
            triangle.iter().for_each(|[x, y, z]| writeln!(text, "vertex {x}.000000001 {y} {z}e0").expect("text"));
            text.push_str("endloop\nendfacet\n");
        }
        text.push_str("endsolid\n");
        let whole = read_in_pieces(text.as_bytes(), ONE_PIECE, &Limits::default());
        prop_assert!(read_in_pieces(text.as_bytes(), piece_bytes, &Limits::default()) == whole);
        // One vertex for each point of the grid, as a table of them has it.
        if let Ok((vertices, ..)) = whole {
            let mut points = vertices.clone();
            points.sort_unstable();
            points.dedup();
            prop_assert_eq!(points.len(), vertices.len());
        }
    }
}
