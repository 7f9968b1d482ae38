use std::fmt::Write as _;
use std::io::Cursor;

use super::*;
use crate::geometry::demo_parts::figurine;
use crate::geometry::mesh_io::{Position, write_stl};

/// A number of a stream that depends on its place alone.
fn random(place: usize) -> f64 {
    let mut bits = (place as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// An organised cloud in which every fifth cell is empty.
fn organised(columns: usize, rows: usize) -> PointCloud {
    let point = |cell: usize| {
        let xyz = [0, 1, 2].map(|axis| (300.0 * random(3 * cell + axis) - 150.0) as f32);
        if cell.is_multiple_of(5) { [f32::NAN; 3] } else { xyz }
    };
    PointCloud { points_mm: (0..columns * rows).map(point).collect(), grid: Some(CloudGrid { columns, rows }) }
}

fn same(cloud: &StoredCloud, wanted: &PointCloud) {
    assert_eq!(cloud.grid, wanted.grid);
    assert_eq!(cloud.points.len(), wanted.points_mm.len());
    for (found, wanted) in cloud.points.iter().zip(&wanted.points_mm) {
        assert_eq!(found.map(f32::to_bits), wanted.map(|value| if value.is_nan() { f32::NAN } else { value }.to_bits()));
    }
}

fn one(bytes: &[u8]) -> StoredCloud {
    let mut file = read(bytes, &CloudLimits::default()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(file.clouds.len(), 1);
    file.clouds.remove(0)
}

fn written(cloud: &PointCloud, write: fn(&PointCloud, &mut dyn std::io::Write) -> std::io::Result<()>) -> Vec<u8> {
    let mut bytes = Vec::new();
    write(cloud, &mut bytes).expect("memory takes all");
    bytes
}

#[test]
fn what_is_written_is_read_back_with_its_grid() {
    // More than a chunk of the stream.
    let cloud = organised(401, 503);
    for write in [write_ply, write_pcd] {
        same(&one(&written(&cloud, write)), &cloud);
        let plain = PointCloud { points_mm: cloud.points_mm[1..5].to_vec(), grid: None };
        same(&one(&written(&plain, write)), &plain);
    }
}

#[test]
fn ply_of_every_encoding_holds_the_same_points_and_faces() {
    let points = [[0.5_f64, -1.25, 3.0], [10.0, 0.0, 1.0], [0.0, 10.0, 2.0], [1.0, 1.0, 9.5]];
    let header = |encoding: &str| {
        format!(
            "ply\nformat {encoding} 1.0\nelement vertex 4\nproperty uchar red\nproperty double x\nproperty float y\n\
             property list uchar short tags\nproperty float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let mut text = header("ascii").into_bytes();
    text.extend_from_slice(b"7 0.5 -1.25 2 4 5 3\r\n7 10 0 0 1\n\n7 0 1e1 0 2\n7 1 1 0 9.5\n4 0 1 2 3\n3 0 2 3");
    let mut files = vec![text];
    for big in [false, true] {
        let mut bytes = header(if big { "binary_big_endian" } else { "binary_little_endian" }).into_bytes();
        macro_rules! put {
            ($value:expr) => {
                bytes.extend_from_slice(&if big { $value.to_be_bytes() } else { $value.to_le_bytes() })
            };
        }
        for (place, [x, y, z]) in points.into_iter().enumerate() {
            bytes.push(7);
            put!(x);
            put!((y as f32));
            bytes.push(place as u8);
            (0..place).for_each(|_| put!(4_i16));
            put!((z as f32));
        }
        for face in [&[0_i32, 1, 2, 3][..], &[0, 2, 3]] {
            bytes.push(face.len() as u8);
            face.iter().for_each(|corner| put!(*corner));
        }
        files.push(bytes);
    }
    for file in files {
        let cloud = one(&file);
        assert_eq!(cloud.points, points.map(|point| point.map(|value| value as f32)));
        assert_eq!(cloud.faces, [[0, 1, 2], [0, 2, 3], [0, 2, 3]]);
    }
}

#[test]
fn a_range_grid_of_ply_gives_the_cells() {
    let text = "ply\nformat ascii 1.0\nobj_info num_cols 3\nobj_info num_rows 2\nelement vertex 2\nproperty float x\nproperty float y\n\
                property float z\nelement range_grid 6\nproperty list uchar int vertex_indices\nend_header\n1 2 3\n4 5 6\n0\n1 1\n0\n1 0\n0\n0\n";
    let cloud = one(text.as_bytes());
    assert_eq!(cloud.grid, Some(CloudGrid { columns: 3, rows: 2 }));
    assert_eq!((cloud.points[1], cloud.points[3], cloud.points[0][0].is_nan()), ([4.0, 5.0, 6.0], [1.0, 2.0, 3.0], true));
}

/// Packs bytes as LZF without repetitions but for runs of equal bytes.
fn packed(bytes: &[u8]) -> Vec<u8> {
    let mut packed = Vec::new();
    let mut place = 0;
    while place < bytes.len() {
        let run = bytes[place..].iter().take(264).take_while(|byte| place > 0 && **byte == bytes[place - 1]).count();
        if run >= 9 {
            packed.extend([0xe0, (run - 9) as u8, 0]);
            place += run;
        } else if run >= 3 {
            packed.extend([((run - 2) << 5) as u8, 0]);
            place += run;
        } else {
            let length = (bytes.len() - place).min(8);
            packed.push(length as u8 - 1);
            packed.extend_from_slice(&bytes[place..place + length]);
            place += length;
        }
    }
    packed
}

#[test]
fn pcd_of_every_encoding_holds_the_same_cloud() {
    let cloud = organised(83, 61);
    let header = |data: &str| {
        format!(
            "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS rgb x y normal z\nSIZE 4 4 8 4 4\nTYPE U F F F F\nCOUNT 1 1 1 3 1\n\
             WIDTH 83\nHEIGHT 61\nVIEWPOINT 1 2 3 0 1 0 0\nPOINTS 5063\nDATA {data}\n"
        )
    };
    let mut text = header("ascii");
    let (mut plain, mut columns) = (header("binary").into_bytes(), Vec::new());
    for [x, y, z] in &cloud.points_mm {
        writeln!(text, "255 {x} {y} 0 0 1 {z}").expect("a string");
        plain.extend(255_u32.to_le_bytes().into_iter().chain(x.to_le_bytes()).chain(f64::from(*y).to_le_bytes()));
        plain.extend([0.0_f32, 0.0, 1.0, *z].into_iter().flat_map(f32::to_le_bytes));
    }
    columns.extend(cloud.points_mm.iter().flat_map(|_| 255_u32.to_le_bytes()));
    columns.extend(cloud.points_mm.iter().flat_map(|point| point[0].to_le_bytes()));
    columns.extend(cloud.points_mm.iter().flat_map(|point| f64::from(point[1]).to_le_bytes()));
    columns.extend(cloud.points_mm.iter().flat_map(|_| [0.0_f32, 0.0, 1.0]).flat_map(f32::to_le_bytes));
    columns.extend(cloud.points_mm.iter().flat_map(|point| point[2].to_le_bytes()));
    let squeezed = packed(&columns);
    let mut compressed = header("binary_compressed").into_bytes();
    compressed.extend((squeezed.len() as u32).to_le_bytes().into_iter().chain((columns.len() as u32).to_le_bytes()));
    compressed.extend(&squeezed);
    for file in [text.into_bytes(), plain, compressed.clone()] {
        let found = one(&file);
        same(&found, &cloud);
        let Some(StatedPose::CloudFromSensor(pose)) = found.stated_pose else { panic!("{:?}", found.stated_pose) };
        assert_eq!(pose.translation.vector.z, 3.0);
    }
    // The first instruction becomes a copy of what is not there yet.
    let at = compressed.len() - squeezed.len();
    compressed[at] = 0xff;
    let error = read(&compressed, &CloudLimits::default()).expect_err("broken");
    assert!(matches!(error, CloudError::Compression { at: Position::Byte(byte) } if byte as usize + 300 > at), "{error}");
}

#[test]
fn compressed_columns_stand_in_any_order() {
    let points = organised(83, 61).points_mm;
    for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
        let names = order.map(|axis| ["x", "y", "z"][axis]).join(" ");
        let header = format!(
            "VERSION 0.7\nFIELDS {names}\nSIZE 4 8 4\nTYPE F F F\nWIDTH {0}\nPOINTS {0}\nDATA binary_compressed\n",
            points.len()
        );
        let column = |axis: usize| points.iter().map(move |point| point[axis]);
        let [first, second, third] = order;
        let mut columns: Vec<u8> = column(first).flat_map(f32::to_le_bytes).collect();
        columns.extend(column(second).flat_map(|value| f64::from(value).to_le_bytes()));
        columns.extend(column(third).flat_map(f32::to_le_bytes));
        let body = packed(&columns);
        let lengths = [body.len() as u32, columns.len() as u32].map(u32::to_le_bytes).concat();
        let found = one(&[header.as_bytes(), &lengths, &body].concat());
        let wanted: Vec<[f32; 3]> = points.iter().copied().filter(|point| !point[0].is_nan()).collect();
        assert_eq!(found.points, wanted, "{names}");
    }
}

#[test]
fn text_is_read_in_every_style() {
    let wanted = [[1.0_f32, 2.5, -3.0], [4.0, 5.0, 6.0]];
    for text in [
        "1 2.5 -3\n4 5 6\n",
        "# a comment\r\n1\t2.5\t-3\t0.7 255\r\n\r\n4\t5\t6\t0.1 3",
        "2\n1 2.5 -3\n4 5 6\n",
        "x,y,z\n1,2.5,-3\n4,5,6\n",
        "//X,Y,Z,R,G,B\n1,2.5,-3,1,2,3\n4,5,6,1,2,3\n",
        "\u{feff}intensity;z [mm];x [mm];y [mm]\n0,5;-3;1;2,5\n1;6,0;4;5\n",
        "X_mm Y_mm Z_mm\n1 2.5 -3\n4 5 6",
    ] {
        let file = read(text.as_bytes(), &CloudLimits::default()).unwrap_or_else(|error| panic!("{text:?}: {error}"));
        assert_eq!((file.format, &file.clouds[0].points[..]), (CloudFormat::Text, &wanted[..]), "{text:?}");
        assert_eq!(file.unit.is_some(), text.contains("mm]") || text.contains("_mm"), "{text:?}");
    }
    let long: String = (0..60_000).map(|place| format!("{} {place} 0.5\n", place % 7)).collect();
    let points = one(long.as_bytes()).points;
    assert!(points.len() == 60_000 && points.iter().enumerate().all(|(place, point)| point[1] == place as f32));
    let broken = long.replacen("2 59999 0.5", "2 what 0.5", 1);
    let error = read(broken.as_bytes(), &CloudLimits::default()).expect_err("a word");
    assert_eq!((error.position(), error.code()), (Some(Position::Line(60_000)), "cloud_syntax"), "{error}");
}

/// A comment such as `# columns: x y z r g b` once moved every coordinate by a column, and the points were read from the wrong ones.
#[test]
fn a_comment_that_says_more_than_names_moves_no_column() {
    let wanted = [[1.0_f32, 2.5, -3.0], [4.0, 5.0, 6.0]];
    for text in [
        "# columns: x y z r g b\n1 2.5 -3 7 8 9\n4 5 6 7 8 9\n",
        "# columns: x y z\n1 2.5 -3 7\n4 5 6 7\n",
        "// Columns x y z r g b\n1 2.5 -3 7 8 9\n4 5 6 7 8 9\n",
        "# The x y z coordinates of one scan\n1 2.5 -3\n4 5 6\n",
        "# The x y z coordinates of one scan\nz,x,y\n-3,1,2.5\n6,4,5\n",
        "# x y z of one scan\n# x y z\n1 2.5 -3\n4 5 6\n",
        "# id x y z\n7 1 2.5 -3\n8 4 5 6\n",
        "# x y z\n1 2.5 -3 7\n4 5 6 7\n",
        // numpy.savetxt writes a header whatever the separator of the numbers is.
        "# x, y, z\n1 2.5 -3\n4 5 6\n",
        "# x y z\n1,2.5,-3\n4,5,6\n",
    ] {
        assert_eq!(one(text.as_bytes()).points, wanted, "{text:?}");
    }
    let error = read(b"# the x y z coordinates\n1 2.5 -3 0 0 1\n", &CloudLimits::default()).expect_err("which columns?");
    assert_eq!((error.position(), error.code()), (Some(Position::Line(1)), "cloud_syntax"), "{error}");
    assert!(error.to_string().contains("names every column"), "{error}");
}

#[test]
fn a_text_may_have_a_long_preface_and_names_in_any_encoding() {
    let preface = "# a line of what the scanner tells\n".repeat(300);
    assert_eq!(one(format!("{preface}1 2.5 -3\n").as_bytes()).points, [[1.0, 2.5, -3.0]]);
    assert_eq!(one(b"T [\xb0C];x;y;z\n20,5;1;2,5;-3\n").points, [[1.0, 2.5, -3.0]]);
}

/// `X [mm] Y [mm] Z [mm]` once named six columns, of which the first, third and fifth were read.
#[test]
fn a_unit_may_stand_apart_from_its_name_between_spaces() {
    let wanted = [[1.0_f32, 2.5, -3.0], [4.0, 5.0, 6.0]];
    for text in
        ["X [mm] Y [mm] Z [mm] NX NY NZ\n1 2.5 -3 0 0 1\n4 5 6 0 0 1\n", "# Z (mm)\tX (mm)\tY (mm)\n-3\t1\t2.5\n6\t4\t5\n"]
    {
        let file = read(text.as_bytes(), &CloudLimits::default()).unwrap_or_else(|error| panic!("{text:?}: {error}"));
        assert_eq!((file.unit, &file.clouds[0].points[..]), (Some(LengthUnit::Millimetre), &wanted[..]), "{text:?}");
    }
}

#[test]
fn scans_of_e57_come_with_name_pose_and_grid() {
    use e57::{E57Writer, Quaternion, Record, RecordName, RecordValue, Transform, Translation};
    let mut bytes = Cursor::new(Vec::new());
    {
        let mut file = E57Writer::new(&mut bytes, "file").expect("memory");
        for (scan, name) in ["view_03", "view 4"].into_iter().enumerate() {
            let mut prototype = vec![Record::CARTESIAN_X_F32, Record::CARTESIAN_Y_F32, Record::CARTESIAN_Z_F32];
            let integer = e57::RecordDataType::Integer { min: 0, max: 100 };
            prototype.push(Record {
                name: RecordName::CartesianInvalidState,
                data_type: e57::RecordDataType::Integer { min: 0, max: 2 },
            });
            if scan == 0 {
                prototype.push(Record { name: RecordName::RowIndex, data_type: integer.clone() });
                prototype.push(Record { name: RecordName::ColumnIndex, data_type: integer });
            }
            let mut points = file.add_pointcloud(name, prototype).expect("a scan");
            points.set_name(Some(name.into()));
            points.set_transform(Some(Transform {
                rotation: Quaternion { w: 0.0, x: 1.0, y: 0.0, z: 0.0 },
                translation: Translation { x: 0.5, y: 0.0, z: scan as f64 },
            }));
            for place in 0..50_i64 {
                let mut values: Vec<RecordValue> =
                    [0.001, 0.002, 0.48].map(|v: f32| RecordValue::Single(v * place as f32)).into();
                values.push(RecordValue::Integer(if place == 7 { 2 } else { 0 }));
                if scan == 0 {
                    values.extend([RecordValue::Integer(place / 10), RecordValue::Integer(place % 10)]);
                }
                points.add_point(values).expect("a point");
            }
            points.finalize().expect("memory");
        }
        file.finalize().expect("memory");
    }
    let file = read(bytes.get_ref(), &CloudLimits::default()).expect("an E57 file");
    assert_eq!((file.format, file.unit, file.clouds.len()), (CloudFormat::E57, Some(LengthUnit::Metre), 2));
    let [first, second] = &file.clouds[..] else { panic!("two scans") };
    assert_eq!((first.name.as_deref(), first.grid), (Some("view_03"), Some(CloudGrid { columns: 10, rows: 5 })));
    assert!(first.points[7][0].is_nan() && first.points[12] == [0.001_f32 * 12.0, 0.002 * 12.0, 0.48 * 12.0]);
    assert_eq!((second.grid, second.points.len(), second.not_finite), (None, 49, 1));
    let Some(StatedPose::FileFromCloud(pose)) = second.stated_pose else { panic!("a pose") };
    assert_eq!((pose.translation.vector.x, pose.translation.vector.z), (0.5, 1.0));
    for length in [10, 60, 1500, bytes.get_ref().len() - 1] {
        let error = read(&bytes.get_ref()[..length], &CloudLimits::default()).expect_err("cut off");
        assert_eq!(error.code(), "cloud_e57", "{error}");
    }
}

/// An E57 file of one scan.
fn e57_of(points: u16) -> Vec<u8> {
    use e57::{E57Writer, Record, RecordValue};
    let mut bytes = Cursor::new(Vec::new());
    let mut file = E57Writer::new(&mut bytes, "file").expect("memory");
    let prototype = vec![Record::CARTESIAN_X_F32, Record::CARTESIAN_Y_F32, Record::CARTESIAN_Z_F32];
    let mut scan = file.add_pointcloud("1", prototype).expect("a scan");
    for place in 0..points {
        scan.add_point([f32::from(place); 3].map(RecordValue::Single).into()).expect("a point");
    }
    scan.finalize().expect("memory");
    file.finalize().expect("memory");
    drop(file);
    bytes.into_inner()
}

/// Faults of an E57 file were once told in the words of its reader alone.
#[test]
fn an_e57_file_is_told_to_be_cut_off_or_damaged_and_what_to_do() {
    let whole = e57_of(500);
    assert_eq!(one(&whole).points.len(), 500);
    let told = |bytes: &[u8], wanted: &[&str]| {
        let error = read(bytes, &CloudLimits::default()).expect_err("broken");
        let text = error.to_string();
        assert_eq!(error.code(), "cloud_e57", "{text}");
        for words in wanted.iter().chain(&["copy it from the scanner again"]) {
            assert!(text.contains(*words), "{words:?} is not in {text}");
        }
    };
    for length in [10, 47] {
        told(&whole[..length], &["cut off", &format!("after {length} bytes")]);
    }
    for length in [60, 2048, whole.len() - 1] {
        told(&whole[..length], &["cut off", &format!("states {} bytes, and {length} are there", whole.len())]);
    }
    for (place, wanted) in [(3000, ["scan 1", "damaged: the checksum of page 2, from byte 2048"]), (8, ["header", "damaged, or"])]
    {
        let mut damaged = whole.clone();
        damaged[place] ^= 0x40;
        told(&damaged, &wanted);
    }
}

#[test]
fn a_mesh_gives_vertices_and_faces() {
    let mesh = figurine(8_000).expect("a figurine");
    let cloud = one(&write_stl(&mesh));
    assert_eq!((cloud.points.len(), cloud.faces.len()), (mesh.vertices_mm.len(), mesh.faces.len()));
}

#[test]
fn metres_become_millimetres() {
    let cloud = StoredCloud { points: vec![[0.001, 0.48, f32::NAN]], ..StoredCloud::default() };
    let [x, y, z] = cloud.into_millimetres(LengthUnit::Metre).points_mm[0];
    assert!((x - 1.0).abs() < 1e-6 && (y - 480.0).abs() < 1e-4 && z.is_nan());
}

/// Files that are wrong, and the code that says so.
fn hostile() -> Vec<(Vec<u8>, &'static str)> {
    let ply = |count: &str, body: &[u8]| {
        let header = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
        );
        [header.as_bytes(), body].concat()
    };
    let pcd = |width: &str, height: &str, points: &str, data: &str, body: &[u8]| {
        let header = format!(
            "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {width}\nHEIGHT {height}\nPOINTS {points}\nDATA {data}\n"
        );
        [header.as_bytes(), body].concat()
    };
    let nan = f32::NAN.to_le_bytes().repeat(6);
    let huge = [&u32::MAX.to_le_bytes()[..], &u32::MAX.to_le_bytes()].concat();
    vec![
        (Vec::new(), "cloud_empty_file"),
        (b"hello, this is a letter\nand no cloud".to_vec(), "cloud_format_unknown"),
        // By its length a binary STL file, with a count that is not borne out.
        (vec![1; 4096], "cloud_count_mismatch"),
        (vec![0; 4096], "cloud_trailing_data"),
        (ply("9223372036854775808", &[0; 24]), "cloud_count_mismatch"),
        (ply("99999999999999999999999", &[0; 24]), "cloud_syntax"),
        (ply("3", &[0; 24]), "cloud_count_mismatch"),
        (ply("2", &nan), "cloud_no_points"),
        (ply("0", b""), "cloud_no_points"),
        (ply("-1", &[0; 24]), "cloud_syntax"),
        (b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n1.5 2.5 3.5\n4 5\n".to_vec(), "cloud_syntax"),
        (b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3\n\x00\x01\n    ".to_vec(), "cloud_syntax"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n".to_vec(), "cloud_syntax"),
        (pcd("9223372036854775808", "1", "9223372036854775808", "binary", &[0; 24]), "cloud_count_mismatch"),
        (pcd("9223372036854775808", "4", "0", "binary", &[0; 24]), "cloud_grid_mismatch"),
        (pcd("2", "2", "2", "binary", &[0; 24]), "cloud_grid_mismatch"),
        (pcd("2", "1", "2", "binary", &[0; 20]), "cloud_count_mismatch"),
        (pcd("2", "1", "2", "binary", &nan), "cloud_no_points"),
        (pcd("2", "1", "2", "ascii", b"1 2 3\n1 x 3\n"), "cloud_syntax"),
        (pcd("2", "1", "2", "ascii", b"1 2 3                    \n"), "cloud_truncated"),
        (pcd("2", "1", "2", "zip", &[0; 24]), "cloud_syntax"),
        (pcd("2", "1", "2", "binary_compressed", &huge), "cloud_compression"),
        (b"VERSION 0.7\nFIELDS x y z\nSIZE 4 4\n".repeat(2000), "cloud_truncated"),
        (b"1 2 3\n4 five 6\n".to_vec(), "cloud_syntax"),
        (b"1 2 3\n4 5\n".to_vec(), "cloud_syntax"),
        (b"x,y,z\n".to_vec(), "cloud_no_points"),
        (b"nan nan nan\n".to_vec(), "cloud_no_points"),
        (b"ASTM-E57garbage".to_vec(), "cloud_e57"),
    ]
}

#[test]
fn hostile_files_are_refused_with_their_code() {
    for (index, (bytes, code)) in hostile().into_iter().enumerate() {
        match read(&bytes, &CloudLimits::default()) {
            Ok(file) => panic!("{index}: {code} expected, read {} points", file.clouds[0].points.len()),
            Err(error) => assert_eq!(error.code(), code, "{index}: {error}"),
        }
    }
    let cloud = organised(40, 30);
    let limits = CloudLimits { max_points: 1000 };
    let text: String = (0..1001).map(|place| format!("{place} 0 0\n")).collect();
    for bytes in [written(&cloud, write_ply), written(&cloud, write_pcd), text.into_bytes()] {
        assert_eq!(read(&bytes, &limits).expect_err("too many").code(), "cloud_too_large");
    }
}

#[test]
fn no_cut_and_no_flipped_byte_brings_a_reader_down() {
    let cloud = organised(20, 10);
    let text: String = (0..100).map(|place| format!("{place} 0.25 {place}e-3\n")).collect();
    let squeezed = {
        let header = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 100\nPOINTS 100\nDATA binary_compressed\n";
        let body = packed(&[7; 1200]);
        [header.as_bytes(), &(body.len() as u32).to_le_bytes(), &1200_u32.to_le_bytes(), &body].concat()
    };
    assert_eq!(one(&squeezed).points.len(), 100);
    for bytes in [written(&cloud, write_ply), written(&cloud, write_pcd), text.into_bytes(), squeezed] {
        for length in 0..bytes.len() {
            let _ = read(&bytes[..length], &CloudLimits::default());
        }
        for place in 0..3000 {
            let mut broken = bytes.clone();
            let at = (random(place) * broken.len() as f64) as usize;
            broken[at] = (256.0 * random(place + 100_000)) as u8;
            let _ = read(&broken, &CloudLimits::default());
        }
    }
}

/// Read rates of row I11, printed: run with `--ignored --nocapture` and optimisation.
#[test]
#[ignore = "a measurement, run by hand"]
fn rates_measured_by_hand() {
    let cloud = organised(4000, 1000);
    let count = cloud.points_mm.len() as f64 * 1e-6;
    let plain: Vec<_> = cloud.points_mm.iter().filter(|point| !point[0].is_nan()).collect();
    let text: String = plain.iter().fold(String::new(), |mut text, [x, y, z]| {
        writeln!(text, "{x:.4} {y:.4} {z:.4}").expect("a string");
        text
    });
    let e57 = {
        use e57::{E57Writer, Record, RecordValue};
        let mut bytes = Cursor::new(Vec::new());
        let mut file = E57Writer::new(&mut bytes, "file").expect("memory");
        let prototype = vec![Record::CARTESIAN_X_F32, Record::CARTESIAN_Y_F32, Record::CARTESIAN_Z_F32];
        let mut points = file.add_pointcloud("1", prototype).expect("a scan");
        plain.iter().for_each(|point| points.add_point(point.map(RecordValue::Single).into()).expect("a point"));
        points.finalize().expect("memory");
        file.finalize().expect("memory");
        drop(file);
        bytes.into_inner()
    };
    let plain = plain.len() as f64 * 1e-6;
    for (name, bytes, count) in [
        ("ply", written(&cloud, write_ply), count),
        ("pcd", written(&cloud, write_pcd), count),
        ("xyz", text.into_bytes(), plain),
        ("e57", e57, plain),
    ] {
        let best = (0..3).map(|_| {
            let start = std::time::Instant::now();
            assert!(!one(&bytes).points.is_empty());
            start.elapsed().as_secs_f64()
        });
        let best = best.fold(f64::INFINITY, f64::min);
        println!("{name}: {:.1} Mpts/s", count / best);
    }
}
