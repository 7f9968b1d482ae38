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
    assert_eq!(pointer, "");
    assert!(detail.starts_with("duplicate field `priority` at line 1"), "{detail}");
    let labels = format!(r#"{{"mesh_id": "{MESH}", "labels": {{"lot": "1", "lot": "2"}}}}"#);
    assert_eq!(shape(&labels).0, "/labels");
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

/// Lists find jobs by `?label=key=value`, and take what follows the first `=` for the value.
#[test]
fn a_label_that_no_list_would_find_is_refused() {
    let checked = |key: &str| LabelsRequest { labels: [(key.to_owned(), "a=b".to_owned())].into() }.check();
    let errors = checked("line=3").expect_err("it could never be found");
    assert_eq!(errors.len(), 1, "{errors:?}");
    assert_eq!(errors[0].pointer, "/labels/line=3");
    assert!(errors[0].detail.starts_with("has \"=\" in its key"), "{}", errors[0].detail);
    assert_eq!(checked("line"), Ok(()));
}
