use super::*;
use crate::cell::FieldError;

#[track_caller]
fn shape(body: &str) -> (String, String) {
    match parse::<JobRequest>(body.as_bytes()) {
        Err(ParseError::Shape(FieldError { pointer, detail })) => (pointer, detail),
        other => panic!("{other:?}"),
    }
}

const MESH: &str = "0192d3a0-0000-7000-8000-000000000001";

#[test]
fn the_pointer_names_the_field_at_fault() {
    assert_eq!(shape(&format!(r#"{{"mesh_id": "{MESH}", "colour": 1}}"#)).0, "/colour");
    assert_eq!(
        shape(&format!(r#"{{"mesh_id": "{MESH}", "params": {{"selection": {{"tarket": 1}}}}}}"#)).0,
        "/params/selection/tarket"
    );
    assert_eq!(
        shape(&format!(r#"{{"mesh_id": "{MESH}", "params": {{"selection": {{"target": "x"}}}}}}"#)).0,
        "/params/selection/target"
    );
    let region = r#"{"kind": "sphere", "centre_mm": [0, 0, 0], "radius_mm": 1, "colour": {"colour": 1}}"#;
    let params = format!(r#"{{"regions": {{"exclude": [{region}]}}}}"#);
    assert_eq!(shape(&format!(r#"{{"mesh_id": "{MESH}", "params": {params}}}"#)).0, "/params/regions/exclude/0/colour");
    assert_eq!(shape(&format!(r#"{{"mesh_id": "{MESH}", "colour": {{"colour": 1}}}}"#)).0, "/colour");
    assert_eq!(shape(r#"{"mesh_id": "x"}"#).0, "/mesh_id");
    assert_eq!(shape(&format!(r#"{{"mesh_id": "{MESH}", "scanner": {{"name": "a", "mass": 1}}}}"#)).0, "/scanner/mass");
    let (pointer, detail) = shape("{}");
    assert_eq!(pointer, "");
    assert!(detail.contains("mesh_id"), "{detail}");
}

#[test]
fn json_of_another_shape_is_not_a_syntax_error() {
    let cell = |field: &str| format!(r#"{{"mesh_id": "{MESH}", "cell": {{"name": "a", {field}}}}}"#);
    let (pointer, detail) = shape(&cell(r#""base_from_table": {"translation_mm": [1, 2, 3, 4]}"#));
    assert!(pointer.starts_with("/cell/base_from_table/translation_mm"), "{pointer}");
    assert_eq!(detail, "has 4 elements; expected fewer");
    assert_eq!(shape(&format!(r#"{{"mesh_id": "{MESH}", "priority": 1e400}}"#)).0, "/priority");
}

/// Some programs write every number with a point.
#[test]
fn a_number_without_a_fraction_is_a_whole_number() {
    let written = |priority: &str, params: &str| {
        parse::<JobRequest>(format!(r#"{{"mesh_id": "{MESH}", "priority": {priority}, "params": {params}}}"#).as_bytes())
    };
    let params = r#"{"setups": 2.0, "seed": 1e15, "scan": {"brightness": 5.0}, "selection": {"max_views": 3e1},
        "regions": {"exclude": [{"kind": "faces", "faces": [1.0, 2]}]}}"#;
    let plain = r#"{"setups": 2, "seed": 1000000000000000, "scan": {"brightness": 5}, "selection": {"max_views": 30},
        "regions": {"exclude": [{"kind": "faces", "faces": [1, 2]}]}}"#;
    assert_eq!(written("-5.0", params), written("-5", plain));
    assert!(written("-5.0", params).is_ok_and(|request| request.priority == -5));
    assert!(parse::<f64>(b"-0.0").is_ok_and(f64::is_sign_negative));
    for (text, number) in [
        ("-0", Some(0)),
        ("9007199254740992.0", Some(1 << 53)),
        ("9007199254740993.0", Some(1 << 53)),
        ("9007199254740994.0", None),
        ("-1.0", None),
    ] {
        assert_eq!(parse::<u64>(text.as_bytes()).ok(), number, "{text}");
    }
    let (pointer, detail) = shape(&format!(r#"{{"mesh_id": "{MESH}", "priority": 5.5}}"#));
    assert_eq!((&pointer[..], &detail[..]), ("/priority", "is 5.5; expected a whole number from -2147483648 to 2147483647"));
}

#[test]
fn text_that_is_not_json_is_a_syntax_error() {
    let twice = format!(r#"{{"mesh_id": "{MESH}"}} {{}}"#);
    for body in ["", "{", "\u{feff}{}", &twice, "{\"labels\": {\"a\""] {
        assert!(matches!(parse::<JobRequest>(body.as_bytes()), Err(ParseError::Syntax(_))), "{body:.20}");
    }
}

#[test]
fn a_field_that_an_object_has_twice_is_refused() {
    let priority = format!(r#"{{"mesh_id": "{MESH}", "priority": 1, "priority": 2}}"#);
    let (pointer, detail) = shape(&priority);
    assert_eq!(pointer, "/priority");
    assert!(detail.starts_with("`priority` is given twice: give it once (line 1, column "), "{detail}");
    let labels = format!(r#"{{"mesh_id": "{MESH}", "labels": {{"lot": "1", "lot": "2"}}}}"#);
    assert_eq!(shape(&labels).0, "/labels/lot");
}

#[test]
fn keys_are_escaped_in_pointers() {
    let error = parse::<std::collections::BTreeMap<String, u8>>(br#"{"a/b~c": -1}"#).expect_err("negative");
    assert!(matches!(error, ParseError::Shape(error) if error.pointer == "/a~1b~0c"));
}

#[test]
fn a_request_gets_its_defaults_and_its_ranges() {
    let request: JobRequest = parse(format!(r#"{{"mesh_id": "{MESH}"}}"#).as_bytes()).expect("defaults");
    assert_eq!(request, JobRequest::new(MESH.parse().expect("an id")));
    assert_eq!(request.check(), Ok(()));

    let mut bad = request;
    bad.priority = 101;
    bad.labels.insert(String::new(), "line\nbreak".into());
    bad.params.selection.target = 2.0;
    let pointers: Vec<_> = bad.check().expect_err("four faults").into_iter().map(|e| e.pointer).collect();
    assert_eq!(pointers, ["/labels/", "/labels/", "/priority", "/params/selection/target"]);
}

#[test]
fn an_id_has_one_spelling() {
    assert!(MESH.parse::<MeshId>().is_ok());
    for other in [MESH.replace('-', ""), format!("{{{MESH}}}"), format!("urn:uuid:{MESH}"), String::new(), "../x".into()] {
        assert!(other.parse::<MeshId>().is_err(), "{other}");
    }
    assert!(JobId::generate() < JobId::generate());
}

#[test]
fn names_of_specifications_are_plain() {
    for good in ["a", "transcan-c", "e05.v2", "0_x", &"a".repeat(64)] {
        assert!(is_spec_name(good), "{good}");
    }
    for bad in ["", "-a", ".", "..", "A", "a/b", "a b", "ä", "none\n", &"a".repeat(65)] {
        assert!(!is_spec_name(bad), "{bad}");
    }
}

#[test]
fn jobs_are_not_selected_by_a_label_without_a_key() {
    let checked = |label: &str| JobSelection { label: Some(label.to_owned()), ..JobSelection::default() }.check();
    for keyless in ["", "=", "=3"] {
        let errors = checked(keyless).expect_err("no label has an empty key");
        assert_eq!(errors.len(), 1, "{errors:?}");
        assert_eq!(errors[0].pointer, "/label");
        assert!(errors[0].detail.contains("names no key; allowed is key or key=value"), "{}", errors[0].detail);
    }
    for label in ["line", "line=", "line=a=b"] {
        assert_eq!(checked(label), Ok(()));
    }
}

/// Lists find jobs by `?label=key=value`, and take what follows the first `=` for the value.
/// They named a part of their own, and a file without a name.
#[test]
fn blank_numbers_of_a_part_are_none() {
    let body = format!(r#"{{"mesh_id": "{MESH}", "part_number": "", "serial": " "}}"#);
    let request: JobRequest = parse(body.as_bytes()).expect("a request");
    assert_eq!((request.part_number, request.serial), (None, None));
    let echo = echo::Echo::given(std::collections::BTreeMap::new(), Some(" ".to_owned()), Some(" S".to_owned()));
    assert_eq!((echo.part_number, echo.serial.as_deref()), (None, Some(" S")));
}

#[test]
fn a_label_that_no_list_would_find_is_refused() {
    let checked = |key: &str| LabelsRequest { labels: [(key.to_owned(), "a=b".to_owned())].into() }.check();
    let errors = checked("line=3").expect_err("it could never be found");
    assert_eq!(errors.len(), 1, "{errors:?}");
    assert_eq!(errors[0].pointer, "/labels/line=3");
    assert!(errors[0].detail.starts_with("has \"=\" in its key"), "{}", errors[0].detail);
    assert_eq!(checked("line"), Ok(()));
}
