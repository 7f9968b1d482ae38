use std::fmt::Write as _;

use proptest::prelude::*;

use super::*;
use crate::geometry::Mesh;

mod hostile;
mod pieces;

const CUBE_CORNERS: [[f64; 3]; 8] =
    [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [0., 0., 1.], [1., 0., 1.], [1., 1., 1.], [0., 1., 1.]];
const CUBE_QUADS: [[u32; 4]; 6] = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];

fn read_mm(bytes: &[u8]) -> Result<ReadMesh, MeshError> {
    read(bytes, Some(LengthUnit::Millimetre), &Limits::default())
}

fn obj(vertices: &[[f64; 3]], faces: &[Vec<u32>]) -> String {
    let mut text = String::new();
    vertices.iter().for_each(|[x, y, z]| writeln!(text, "v {x} {y} {z}").expect("text"));
    for face in faces {
        let corners: Vec<_> = face.iter().map(|v| (v + 1).to_string()).collect();
        writeln!(text, "f {}", corners.join(" ")).expect("text");
    }
    text
}

fn stl_text(mesh: &Mesh) -> String {
    let mut text = String::from("solid test\n");
    for face in 0..mesh.faces.len() {
        text.push_str(" facet normal 0 0 0\n  outer loop\n");
        mesh.corners(face).iter().for_each(|p| writeln!(text, "   vertex {} {} {}", p.x, p.y, p.z).expect("text"));
        text.push_str("  endloop\n endfacet\n");
    }
    text + "endsolid test\n"
}

/// A PLY file; `encoding` as in the header.
fn ply(vertices: &[[f64; 3]], faces: &[Vec<u32>], encoding: &str) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat {encoding} 1.0\ncomment test\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         element face {}\nproperty uchar flags\nproperty list uchar int vertex_indices\nend_header\n",
        vertices.len(),
        faces.len()
    )
    .into_bytes();
    let text = encoding == "ascii";
    let float = |v: f64| if encoding == "binary_big_endian" { v.to_be_bytes() } else { v.to_le_bytes() };
    let int = |v: u32| if encoding == "binary_big_endian" { v.to_be_bytes() } else { v.to_le_bytes() };
    for v in vertices {
        match text {
            true => bytes.extend(format!("{} {} {}\n", v[0], v[1], v[2]).bytes()),
            false => bytes.extend(v.iter().flat_map(|&value| float(value))),
        }
    }
    for face in faces {
        if text {
            let corners: Vec<_> = face.iter().map(u32::to_string).collect();
            bytes.extend(format!("7 {} {}\n", face.len(), corners.join(" ")).bytes());
        } else {
            bytes.extend([7, face.len() as u8]);
            bytes.extend(face.iter().flat_map(|&v| int(v)));
        }
    }
    bytes
}

const PLY_ENCODINGS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];

fn quads() -> Vec<Vec<u32>> {
    CUBE_QUADS.iter().map(|quad| quad.to_vec()).collect()
}

/// The unit cube in every format.
fn cubes() -> Vec<Vec<u8>> {
    let obj = obj(&CUBE_CORNERS, &quads());
    let mesh = read_mm(obj.as_bytes()).expect("the cube").mesh;
    let plys = PLY_ENCODINGS.map(|encoding| ply(&CUBE_CORNERS, &quads(), encoding));
    [obj.into_bytes(), stl_text(&mesh).into_bytes(), write_stl(&mesh)].into_iter().chain(plys).collect()
}

fn code(bytes: &[u8]) -> &'static str {
    read_mm(bytes).expect_err("must be refused").code()
}

#[test]
fn the_cube_is_the_same_in_every_format() {
    for bytes in cubes() {
        let ReadMesh { mesh, health, .. } = read_mm(&bytes).expect("the cube");
        assert_eq!((health.triangles, health.vertices, health.bodies, health.watertight), (12, 8, 1, true));
        assert!((health.area_mm2 - 6.0).abs() < 1e-12 && (health.volume_mm3.expect("closed") - 1.0).abs() < 1e-12);
        assert!(health.warnings().is_empty(), "{:?}", health.warnings());
        assert_eq!(mesh.faces.len(), mesh.source_face.len());
    }
}

#[test]
fn polygons_know_their_face_in_the_file() {
    let read = read_mm(obj(&CUBE_CORNERS, &quads()).as_bytes()).expect("the cube");
    assert_eq!(read.mesh.source_face, [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]);
    assert_eq!(read.mesh.faces[..2], [[0, 3, 2], [0, 2, 1]]);
}

#[test]
fn units_scale_to_millimetres() {
    for unit in LengthUnit::ALL {
        let read = read(obj(&CUBE_CORNERS, &quads()).as_bytes(), Some(unit), &Limits::default()).expect("the cube");
        assert_eq!(read.health.aabb.extent_mm().x, unit.mm());
        assert_eq!(unit.as_str().parse(), Ok(unit));
    }
    for bytes in cubes() {
        let error = read(&bytes, None, &Limits::default()).expect_err("no unit");
        assert_eq!(error, MeshError::UnitMissing);
        assert!(error.to_string().contains("mm, cm, m, inch"));
    }
    assert!("feet".parse::<LengthUnit>().is_err());
}

#[test]
fn a_cut_file_is_refused_or_smaller_but_never_a_panic() {
    for bytes in cubes() {
        let whole = read_mm(&bytes).expect("the cube");
        for length in 0..bytes.len() {
            match read_mm(&bytes[..length]) {
                Ok(part) => {
                    // Only OBJ has neither counts nor an end; in the others nothing but the last line's end may miss.
                    let all = part.health.triangles == whole.health.triangles;
                    assert!(all || whole.format == MeshFormat::Obj, "{} of {}", length, whole.format);
                }
                Err(error) => assert!(!error.to_string().is_empty()),
            }
        }
    }
}

#[test]
fn every_single_byte_may_be_wrong_without_a_panic() {
    for bytes in cubes() {
        for at in 0..bytes.len() {
            for wrong in [0, b'-', b'9', b'\n', 0xff] {
                let mut bytes = bytes.clone();
                bytes[at] = wrong;
                let _ = read_mm(&bytes);
            }
        }
    }
}

#[test]
fn counts_that_lie_are_refused_before_anything_is_allocated() {
    let mut stl = write_stl(&read_mm(&cubes()[0]).expect("the cube").mesh);
    stl[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    assert_eq!(code(&stl), "mesh_count_mismatch");
    stl[80..84].copy_from_slice(&3_u32.to_le_bytes());
    assert_eq!(code(&stl), "mesh_trailing_data");
    for encoding in PLY_ENCODINGS {
        // A count that no allocation and no loop would survive.
        let huge = (u64::MAX / 2).to_string();
        let bytes = ply(&CUBE_CORNERS, &quads(), encoding);
        let end = bytes.windows(11).position(|w| w == b"end_header\n").expect("header");
        let lie = |from: &str, to: &str| {
            let header = String::from_utf8_lossy(&bytes[..end]).replace(from, to);
            [header.as_bytes(), &bytes[end..]].concat()
        };
        assert_eq!(code(&lie("vertex 8", &format!("vertex {huge}"))), "mesh_count_mismatch");
        assert_eq!(code(&lie("face 6", &format!("face {huge}"))), "mesh_count_mismatch");
        assert_eq!(code(&lie("face 6", "face 5")), "mesh_trailing_data");
        assert!(read_mm(&lie("element vertex", &format!("element nothing {huge}\nelement vertex"))).is_ok());
    }
    let list = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
        property list uint double more\nend_header\n\0\0\0\0\0\0\0\0\0\0\0\0\xff\xff\xff\xff";
    assert_eq!(code(list), "mesh_truncated");
}

#[test]
fn limits_hold() {
    let limits = Limits { max_triangles: 11 };
    for bytes in cubes() {
        let error = read(&bytes, Some(LengthUnit::Millimetre), &limits).expect_err("12 triangles");
        assert_eq!((error.code(), error.position().is_some()), ("mesh_too_large", true));
    }
    let names = "g a b c d e f\n".to_owned() + &obj(&CUBE_CORNERS, &quads());
    let many = obj(&CUBE_CORNERS, &[]) + "g a b c d e f\n" + &"f 1 2 3\n".repeat(11);
    assert!(read_mm(names.as_bytes()).is_ok());
    let error = read(many.as_bytes(), Some(LengthUnit::Millimetre), &limits).expect_err("66 memberships");
    assert_eq!(error.to_string().split_once(": ").map(|(at, _)| at), Some("line 13"));
}

#[test]
fn errors_name_their_position() {
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for (text, expected) in [
        ("v 0 0 0\nv 1 nan 0\nf 1 2 1\n", ("mesh_not_finite", Some(Position::Line(2)))),
        ("v 0 0 0\nv 1 -inf 0\n", ("mesh_not_finite", Some(Position::Line(2)))),
        ("v 0 0 0\nv 1e400 0 0\n", ("mesh_not_finite", Some(Position::Line(2)))),
        ("v 0 0 0\nv 1e12 0 0\n", ("mesh_out_of_range", Some(Position::Line(2)))),
        ("v 0 0 0\nv 1 0\n", ("mesh_syntax", Some(Position::Line(2)))),
        ("v 0 0 0\n\0\n", ("mesh_truncated", Some(Position::Byte(10)))),
        (&format!("{triangle}f 1 2 4\n"), ("mesh_bad_index", Some(Position::Line(4)))),
        (&format!("{triangle}f 0 1 2\n"), ("mesh_bad_index", Some(Position::Line(4)))),
        (&format!("{triangle}f -4 1 2\n"), ("mesh_bad_index", Some(Position::Line(4)))),
        (&format!("{triangle}f 1 2 99999999999999999999\n"), ("mesh_syntax", Some(Position::Line(4)))),
        (&format!("{triangle}f 1 2\n"), ("mesh_syntax", Some(Position::Line(4)))),
        (&format!("{triangle}f 1 1 2\n"), ("mesh_no_triangles", None)),
        (triangle, ("mesh_no_triangles", None)),
        ("# nothing but a comment\n", ("mesh_no_triangles", None)),
        ("solid a\n facet normal 0 0 1\n outer loop\n vertex 0 0 x\n", ("mesh_syntax", Some(Position::Line(4)))),
        ("solid a\n facet normal 0 0 1\n outer loop\n vertex 0 0 0\n", ("mesh_truncated", Some(Position::Line(4)))),
        ("solid a\nendsolid a\n", ("mesh_no_triangles", None)),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\n", ("mesh_syntax", Some(Position::Line(4)))),
        ("ply\nformat ascii 2.0\n", ("mesh_syntax", Some(Position::Line(2)))),
        ("name = \"transcan-c\"\n", ("mesh_format_unknown", None)),
        ("", ("mesh_empty_file", None)),
        ("\u{1f}", ("mesh_truncated", Some(Position::Byte(1)))),
    ] {
        let error = read_mm(text.as_bytes()).expect_err(text);
        assert_eq!((error.code(), error.position()), expected, "{text:?}: {error}");
        if let Some(position) = error.position() {
            assert!(error.to_string().starts_with(&position.to_string()), "{error}");
        }
    }
}

#[test]
fn binary_places_are_bytes() {
    let mut stl = write_stl(&read_mm(&cubes()[0]).expect("the cube").mesh);
    let at = 84 + 50 * 3 + 12 + 12 * 2;
    stl[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    assert_eq!(read_mm(&stl).expect_err("NaN").position(), Some(Position::Byte(at as u64)));
    let mut ply = ply(&CUBE_CORNERS, &quads(), "binary_big_endian");
    let length = ply.len();
    ply[length - 4..].copy_from_slice(&8_u32.to_be_bytes());
    let error = read_mm(&ply).expect_err("vertex 8 of 8");
    assert_eq!((error.code(), error.position()), ("mesh_bad_index", Some(Position::Byte(length as u64 - 4))));
}

#[test]
fn formats_that_are_not_read_are_named() {
    for (bytes, name) in [
        (&b"\x1f\x8b\x08\0"[..], "gzip"),
        (b"PK\x03\x04", "3MF"),
        (b"glTF\x02\0\0\0", "glTF"),
        (b"{\"asset\": {}}", "glTF"),
        (b"ISO-10303-21;", "STEP"),
        (b"OFF\n3 1 0\n", "OFF"),
        (b"\xef\xbb\xbf<?xml version=\"1.0\"?><amf/>", "AMF"),
    ] {
        let error = read_mm(bytes).expect_err(name);
        assert_eq!(error.code(), "mesh_format_not_read");
        assert!(error.to_string().contains(name), "{error}");
    }
}

#[test]
fn text_may_have_any_line_end_and_byte_order_mark() {
    for bytes in cubes().into_iter().filter(|bytes| bytes.is_ascii() && !bytes.contains(&0)) {
        let text = String::from_utf8(bytes).expect("ascii");
        let utf16 =
            |mark: [u8; 2], unit: fn(u16) -> [u8; 2]| [mark.to_vec(), text.encode_utf16().flat_map(unit).collect()].concat();
        for variant in [
            text.replace('\n', "\r\n").into_bytes(),
            text.replace('\n', "\r").into_bytes(),
            format!("\u{feff}{text}").into_bytes(),
            utf16([0xff, 0xfe], u16::to_le_bytes),
            utf16([0xfe, 0xff], u16::to_be_bytes),
        ] {
            assert_eq!(read_mm(&variant).expect("the cube").health.triangles, 12);
        }
    }
    assert_eq!(code(b"\xff\xfev\0 \0\0"), "mesh_text_encoding");
}

/// A file with strips of triangles was once told to have only points, or read without them.
#[test]
fn strips_of_triangles_in_ply_are_refused_by_name() {
    let strips = |faces: &str, records: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n{faces}\
             element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n{records}4 0 1 2 3\n"
        )
    };
    let face = "element face 1\nproperty list uchar int vertex_indices\n";
    for (text, line) in [(strips("", ""), 7), (strips(face, "3 0 1 2\n"), 9)] {
        let error = read_mm(text.as_bytes()).expect_err("strips");
        assert_eq!((error.code(), error.position()), ("mesh_syntax", Some(Position::Line(line))));
        assert!(error.to_string().contains("the element tristrips") && error.to_string().contains("as faces"), "{error}");
    }
}

#[test]
fn a_binary_ply_header_with_bare_carriage_returns_ends_at_one_byte() {
    let bytes = ply(&CUBE_CORNERS, &quads(), "binary_little_endian");
    let end = bytes.windows(11).position(|w| w == b"end_header\n").expect("header") + 11;
    let header = String::from_utf8_lossy(&bytes[..end]).replace('\n', "\r");
    // The body begins with the byte of a line feed: x of the first vertex.
    let mut body = bytes[end..].to_vec();
    body[0] = b'\n';
    assert_eq!(read_mm(&[header.as_bytes(), &body].concat()).expect("the cube").health.triangles, 12);
}

#[test]
fn binary_stl_may_begin_like_text() {
    let mut stl = write_stl(&read_mm(&cubes()[0]).expect("the cube").mesh);
    for header in [&b"solid cube\nfacet"[..], b"\xff\xfe", b"ply\n", b"v 1 2 3\n"] {
        stl[..header.len()].copy_from_slice(header);
        assert_eq!(read_mm(&stl).expect("the cube").format, MeshFormat::StlBinary);
    }
}

#[test]
fn obj_oddities() {
    let text = "\u{feff}# by hand\nmtllib none.mtl\nusemtl x\no two words\ng left  right # comment\nv 0 0 0 1.0\nv 1 0 0 .5 .5 nan\n\
        v 0 1. 0\nvt 0 0\nvn 0 0 1\nl 1 2\nf 1/1/1 2//1 \\\n -1/1\ng right\ng\nf -3 -2 -1\no\nf 1 2 3\nvc 1 2 3\nf 1 4 2\nv .5 -1e-1 0";
    let read = read_mm(text.as_bytes()).expect("legal");
    let groups: Vec<_> = read.mesh.groups.iter().map(|g| (g.name.as_str(), g.source_faces.as_slice())).collect();
    assert_eq!(groups, [("two words", &[0, 1][..]), ("left", &[0]), ("right", &[0])]);
    assert_eq!((read.health.triangles, read.health.duplicate_triangles, read.health.vertices), (4, 2, 4));
}

/// The line behind such a comment was once lost: the vertices after it had the wrong numbers, and nothing said so.
#[test]
fn a_comment_in_obj_that_ends_in_a_backslash_ends_with_its_line() {
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 5 5 5\n";
    let faces = "f 1 3 \\\n2 # of C:\\base\\\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
    let read = read_mm(format!("# C:\\models\\\n{corners}{faces}").as_bytes()).expect("legal");
    assert_eq!((read.health.triangles, read.health.watertight), (4, true));
    assert_eq!(read.health.aabb.max, nalgebra::Point3::new(1.0, 1.0, 1.0));
}

#[test]
fn stl_float_noise_does_not_tear_the_surface() {
    let mut mesh = read_mm(&cubes()[0]).expect("the cube").mesh;
    let sharp: Vec<_> = (0..mesh.faces.len()).flat_map(|face| mesh.corners(face)).collect();
    mesh.faces = (0..12).map(|face| [3 * face, 3 * face + 1, 3 * face + 2]).collect();
    mesh.vertices_mm = sharp;
    mesh.vertices_mm.iter_mut().step_by(2).flat_map(|v| v.iter_mut()).filter(|x| **x == 0.0).for_each(|x| *x = 1e-17);
    let health = read_mm(&write_stl(&mesh)).expect("the cube").health;
    assert!(health.watertight && health.vertices == 8, "{health:?}");
}

/// An independent reader: what the crate ply-rs-bw reads from our PLY files is what we read.
#[test]
fn ply_agrees_with_another_reader() {
    use ply_rs_bw::{parser::Parser, ply::DefaultElement};
    for encoding in PLY_ENCODINGS {
        let bytes = ply(&CUBE_CORNERS, &quads(), encoding);
        let other = Parser::<DefaultElement>::new().read_ply(&mut &bytes[..]).expect("the cube");
        assert_eq!((other.payload["vertex"].len(), other.payload["face"].len()), (8, 6));
        for (v, ours) in other.payload["vertex"].iter().zip(&read_mm(&bytes).expect("the cube").mesh.vertices_mm) {
            let theirs = ["x", "y", "z"].map(|axis| {
                let ply_rs_bw::ply::Property::Double(value) = v[axis] else { panic!("{:?}", v[axis]) };
                value
            });
            assert_eq!(theirs, [ours.x, ours.y, ours.z]);
        }
    }
}

fn corners(mesh: &Mesh) -> Vec<[nalgebra::Point3<f64>; 3]> {
    (0..mesh.faces.len()).map(|face| mesh.corners(face)).collect()
}

proptest! {
    /// parse(write(m)) = m, up to the order of vertices, in every format and encoding.
    #[test]
    fn what_is_written_is_read_back(
        points in proptest::collection::vec([-500_i16..500, -500..500, -500..500], 4..40),
        picks in proptest::collection::vec([0_usize..1000, 0..1000, 0..1000], 1..60),
    ) {
        let vertices: Vec<[f64; 3]> = points.iter().map(|p| p.map(|x| f64::from(x) / 8.0)).collect();
        let faces: Vec<Vec<u32>> = picks.iter().map(|f| f.map(|v| (v % vertices.len()) as u32).to_vec()).collect();
        let Ok(ReadMesh { mesh, .. }) = read_mm(obj(&vertices, &faces).as_bytes()) else { return Ok(()) };
        let vertices: Vec<[f64; 3]> = mesh.vertices_mm.iter().map(|v| [v.x, v.y, v.z]).collect();
        let faces: Vec<Vec<u32>> = mesh.faces.iter().map(|face| face.to_vec()).collect();
        let mut files = vec![write_stl(&mesh), stl_text(&mesh).into_bytes(), obj(&vertices, &faces).into_bytes()];
        files.extend(PLY_ENCODINGS.map(|encoding| ply(&vertices, &faces, encoding)));
        for file in files {
            let again = read_mm(&file).expect("what was written");
            prop_assert_eq!(corners(&again.mesh), corners(&mesh));
        }
    }

    #[test]
    fn noise_is_refused_without_a_panic(noise in proptest::collection::vec(any::<u8>(), 0..300), kind in 0_usize..4) {
        let head = [&b""[..], b"solid x\n", b"ply\nformat binary_little_endian 1.0\n", b"v 0 0 0\n"][kind];
        let _ = read_mm(&[head, &noise].concat());
    }
}
