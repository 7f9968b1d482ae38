//! Damaged files: each is read or refused with a code, none ends the process.

use super::formats::*;
use super::*;

#[test]
fn damaged_files_are_refused_without_a_panic() {
    let mut random = Random(2026);
    let (mut refused, mut tried) = (0, 0);
    let sources = samples();
    for round in 0..40 {
        for text in &sources {
            let damaged = damage(text, round, &mut random);
            for format in CalibrationFormat::ALL {
                tried += 1;
                let result =
                    read(&damaged, format, &ImportOptions { image_size_px: Some([4000, 3036]), ..ImportOptions::default() });
                refused += usize::from(result.and_then(|file| assemble(&[file])).is_err());
            }
        }
    }
    println!("{tried} reads, {refused} refused");
    assert!(refused > tried / 2);
}

#[test]
fn a_matrix_that_is_given_twice_is_refused_in_every_notation() {
    for (notation, text) in [
        ("JSON", r#"{"K": [[900, 0, 320], [0, 900, 240], [0, 0, 1]], "image_width": 640, "K": 1}"#),
        ("JSON, nested", r#"{"K": {"rows": 3, "rows": 2}, "image_width": 640}"#),
        ("YAML", "K: [900, 0, 320, 0, 900, 240, 0, 0, 1]\nimage_width: 640\nK: 1\n"),
        ("XML", "<opencv_storage><K>1</K><K>2</K></opencv_storage>"),
    ] {
        let error = read(text, CalibrationFormat::Opencv, &ImportOptions::default()).expect_err(notation);
        assert_eq!(error.code, LensFault::Inconsistent, "{notation}");
        assert!(error.to_string().contains("is given twice"), "{notation}: {error}");
    }
}

#[test]
fn a_view_or_a_line_of_a_csv_that_is_given_twice_is_refused() {
    let pixels = serde_json::json!([[1, 2], null, [3, 4], [5, 6]]);
    let document = serde_json::json!({"schema": "vantage.scanner_observations/1",
        "board": {"columns": 2, "rows": 2, "square_mm": 10},
        "left": {"width_px": 100, "height_px": 80}, "right": {"width_px": 100, "height_px": 80},
        "views": [{"id": "a", "left": pixels}, {"id": "b", "left": [[2, 2], null, [3, 4], [5, 6]]}, {"id": "c", "left": pixels}]});
    let spec: ScannerObservationsSpec = serde_json::from_value(document).expect("the structure is right");
    let error = spec.build().expect_err("two views are one");
    assert_eq!((error.code, error.pointer.as_str()), (LensFault::Inconsistent, "/views/2"));
    assert!(error.detail.contains("view \"a\" (/views/0)"), "{error}");

    let (size, header) = (Some([100, 80]), "view,device,x_mm,y_mm,z_mm,u_px,v_px");
    let read = |lines: &str| read_csv(&format!("{header}\n{lines}"), PerDevice { left: size, right: size, projector: None });
    let error = read("a,left,0,0,0,1,2\na,left,10,0,0,2,3\na,left,0,0,0,1,2\n").expect_err("a line twice");
    assert_eq!((error.code, error.pointer.as_str()), (LensFault::Inconsistent, "view \"a\""));
    let error = read("a,left,0,0,0,1,2\nb,left,0,0,0,1,2\n").expect_err("a view twice");
    assert_eq!((error.code, error.pointer.as_str()), (LensFault::Inconsistent, "/views/1"));
    read("a,left,0,0,0,1,2\na,left,0,0,0,1.1,2\nb,left,0,0,0,1,3\n").expect("measured again, by other pixels");
}

#[test]
fn observations_that_are_wrong_are_refused_with_their_place() {
    let valid = serde_json::json!({"schema": "vantage.scanner_observations/1", "board": {"columns": 2, "rows": 2, "square_mm": 10},
        "left": {"width_px": 100, "height_px": 80}, "right": {"width_px": 100, "height_px": 80},
        "views": [{"id": "a", "left": [[1, 2], null, [3, 4], [5, 6]]}]});
    type Change = fn(&mut serde_json::Value);
    let cases: [(LensFault, &str, Change); 8] = [
        (LensFault::UnknownFormat, "/schema", |v| v["schema"] = "x/2".into()),
        (LensFault::MissingField, "/board", |v| v["board"] = serde_json::json!({"columns": 3})),
        (LensFault::OutOfRange, "/board/square_mm", |v| v["board"]["square_mm"] = (-1.0).into()),
        (LensFault::OutOfRange, "/board/columns", |v| v["board"]["columns"] = 1_000_000.into()),
        (LensFault::OutOfRange, "/left/width_px", |v| v["left"]["width_px"] = 3.into()),
        (LensFault::OutOfRange, "/views", |v| v["views"] = serde_json::json!([])),
        (LensFault::WrongShape, "/views/0/left", |v| v["views"][0]["left"] = serde_json::json!([[1, 2]])),
        (LensFault::OutOfRange, "/views/0/left/0/1", |v| v["views"][0]["left"][0][1] = 1e9.into()),
    ];
    for (code, pointer, change) in cases {
        let mut changed = valid.clone();
        change(&mut changed);
        let spec: ScannerObservationsSpec = serde_json::from_value(changed).expect("the structure is right");
        let error = spec.build().expect_err(pointer);
        assert_eq!((error.code, error.pointer.as_str()), (code, pointer));
    }
    for csv in [
        "",
        "view,device",
        "view,device,x_mm,y_mm,z_mm,u_px,v_px\na,left,1",
        "view,device,x_mm,y_mm,z_mm,u_px,v_px\na,middle,1,2,3,4,5",
        "view,device,x_mm,y_mm,z_mm,u_px,v_px\na,left,nan,2,3,4,5",
        "view,device,x_mm,y_mm,z_mm,u_px,v_px\na,left,1,2,3,4,inf",
    ] {
        read_csv(csv, PerDevice { left: Some([100, 80]), right: Some([100, 80]), projector: None }).expect_err(csv);
    }
}
