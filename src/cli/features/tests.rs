use super::*;

fn read(text: &str) -> Vec<FeatureParams> {
    parse(text, "features").unwrap_or_else(|error| panic!("{error}"))
}

fn refused(text: &str) -> String {
    parse(text, "features").err().unwrap_or_else(|| panic!("{text:?} is refused")).to_string()
}

#[test]
fn a_table_and_a_document_say_the_same() {
    let table = "name,region,tolerance_mm,point_spacing_mm,target\n\
                 bore, sphere 10 20 30 5, 0.05, 0.2, 0.9\n\
                 ,faces 3 7-9,0.2,,\n\
                 face,plane 0 0 10 0 0 1 0.1,0.1,,\n";
    let document = r#"{"features": [
        {"name": "bore", "region": {"kind": "sphere", "centre_mm": [10, 20, 30], "radius_mm": 5}, "tolerance_mm": 0.05,
         "point_spacing_mm": 0.2, "target": 0.9},
        {"region": {"kind": "faces", "faces": [3, 7, 8, 9]}, "tolerance_mm": 0.2},
        {"name": "face", "region": {"kind": "plane", "point_mm": [0, 0, 10], "normal": [0, 0, 1], "within_mm": 0.1},
         "tolerance_mm": 0.1}]}"#;
    assert_eq!(read(table), read(document));
    assert_eq!(read(table).len(), 3);
    assert_eq!(read(&format!("\u{feff}{table}")), read(table), "as a spreadsheet writes it");
}

#[test]
fn what_is_wrong_is_named_with_its_line() {
    for (text, wanted) in [
        ("", "is empty"),
        ("region,tolerance\n", "\"tolerance\""),
        ("region,tolerance_mm\n\n", "no feature"),
        ("region,tolerance_mm,tolerance_mm\nsphere 1 2 3 4,0.1,0.2\n", "\"tolerance_mm\" twice"),
        ("name;region;tolerance_mm\nbore;sphere 1 2 3 4;0,05\n", "separated by semicolons; use commas"),
        ("region,tolerance_mm\nsphere 1 2 3 4,x\n", "line 2: tolerance_mm is \"x\""),
        (
            "region,tolerance_mm\nsphere 1 2 3 4,\"0,05\"\n",
            "line 2: tolerance_mm is \"0,05\"; allowed is a number; use a point as decimal separator",
        ),
        ("region,tolerance_mm\n\nsphere 1 2 3,0.1\n", "line 3: region sphere has 3 numbers; it takes 4"),
        ("region,tolerance_mm\ncone 1,0.1\n", "\"cone\""),
        ("region,tolerance_mm\nfaces 9-7,0.1\n", "\"9-7\""),
        ("region,tolerance_mm\nfaces 0-4294967295,0.1\n", "0-4294967295"),
        ("region,tolerance_mm\nname bore\n", "has 1 cell; the header has 2"),
        ("[{\"region\": {\"kind\": \"name\", \"name\": \"bore\"}}]", "tolerance_mm"),
    ] {
        let error = refused(text);
        assert!(error.contains(wanted), "{text:?}: {error}");
    }
}

/// "stream did not contain valid UTF-8" was all that was told.
#[test]
fn a_file_in_another_encoding_is_told_what_to_save_it_as() {
    let folder = tempfile::tempdir().expect("a folder");
    let told = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("a file");
        super::read(&path).map(drop).expect_err(name).to_string()
    };
    let latin = told("features.csv", b"name,region,tolerance_mm\nL\xf6cher,sphere 1 2 3 4,0.1\n");
    assert!(latin.ends_with("features.csv: line 2: is not in UTF-8; save the file as text in UTF-8"), "{latin}");
    let wide = told("wide.csv", b"\xff\xfen\0a\0m\0e\0");
    assert!(wide.ends_with("wide.csv: is a text in UTF-16; save it in UTF-8"), "{wide}");
    let of_shell = folder.path().join("cell.toml");
    std::fs::write(&of_shell, b"\xff\xfen\0a\0m\0e\0").expect("a file");
    let of_shell = crate::cli::files::value(&of_shell).map(drop).expect_err("UTF-16").to_string();
    assert!(of_shell.ends_with("cell.toml: is a text in UTF-16; save it in UTF-8"), "{of_shell}");
    let workbook = told("features.xlsx", b"PK\x03\x04\x14\0\x06\0\x08\0\0\0!\0\xff");
    assert!(workbook.contains("is a workbook or another ZIP archive; save its table as CSV in UTF-8"), "{workbook}");
}

#[test]
fn cells_in_quotes_hold_commas_and_quotes() {
    let text = "name,region,tolerance_mm\n\"seat, \"\"A\"\"\",\"plane 0 0 15 0 0 1 0.5\",0.2\n plain , sphere 0 0 0 5 ,\"0.3\"\n";
    let features = csv(text).expect("two features");
    assert_eq!(features[0].name.as_deref(), Some("seat, \"A\""));
    assert!(matches!(features[0].region, Region::Plane { within_mm, .. } if within_mm == 0.5));
    assert_eq!((features[1].name.as_deref(), features[1].tolerance_mm), (Some("plain"), 0.3));
    for (line, said) in [("\"a,sphere 0 0 0 5,0.2", "unclosed quote"), ("\"a\"b,sphere 0 0 0 5,0.2", "a comma")] {
        let error = csv(&format!("name,region,tolerance_mm\n{line}\n")).expect_err(line);
        assert!(error.contains("line 2") && error.contains(said), "{error}");
    }
}

#[test]
fn a_file_that_is_not_there_is_told_with_the_one_that_was_meant() {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("features.csv"), "").expect("a file");
    let told = super::read(&folder.path().join("feature.csv")).map(drop).expect_err("no such file").to_string();
    assert!(told.ends_with("feature.csv: there is no such file; did you mean features.csv?"), "{told}");
}
