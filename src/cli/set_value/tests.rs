use serde_json::json;

use super::parse;

#[test]
fn a_value_is_json_or_a_string() {
    assert_eq!(parse("a", "0.99"), Ok(json!(0.99)));
    assert_eq!(parse("a", "[1, 2]"), Ok(json!([1, 2])));
    assert_eq!(parse("a", "min_time"), Ok(json!("min_time")));
    assert_eq!(parse("a", "\"@home\""), Ok(json!("@home")), "a string that begins with @ is quoted");
    let twice = parse("a", r#"{"b": 1, "b": 2}"#).expect_err("refused");
    assert!(twice.starts_with("`b` is given twice: give it once"), "{twice}");
}

#[test]
fn a_file_is_read_by_its_kind() {
    let folder = tempfile::tempdir().expect("a folder");
    let of = |key: &str, name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("a file");
        parse(key, &format!("@{}", path.display()))
    };
    let boxes = "[[exclude]]\nkind = \"box\"\nmin_mm = [0, 0, 0]\nmax_mm = [1, 1, 1]\n";
    let wanted = json!([{"kind": "box", "min_mm": [0, 0, 0], "max_mm": [1, 1, 1]}]);
    assert_eq!(of("regions.exclude", "clamp.toml", boxes), Ok(wanted.clone()));
    assert_eq!(of("regions", "clamp.toml", boxes), Ok(json!({ "exclude": wanted })), "of another name it is a table");
    assert_eq!(of("a", "list.json", "[1,\n 2]\n"), Ok(json!([1, 2])));
    assert_eq!(of("a", "number", "0.5\n"), Ok(json!(0.5)));
    assert_eq!(of("a", "name.txt", "bracket 7\r\n"), Ok(json!("bracket 7")));
    // Some editors begin a file with a byte order mark.
    assert_eq!(of("a", "marked.json", "\u{feff}[1, 2]\n"), Ok(json!([1, 2])));
    assert_eq!(of("a", "marked.txt", "\u{feff}bracket 7\n"), Ok(json!("bracket 7")));
    for (name, text) in [("broken.json", "[1,"), ("broken.toml", "a = \n")] {
        let reason = of("a", name, text).expect_err("broken");
        assert!(reason.contains(name) && reason.contains("line 1"), "{reason}");
    }
    let twice = of("a", "twice.txt", "{\"b\": 1, \"b\": 2}\n").expect_err("refused");
    assert!(twice.contains("twice.txt: `b` is given twice: give it once"), "{twice}");
    let reason = parse("a", "@/nowhere/value.json").expect_err("no file");
    assert!(reason.starts_with("/nowhere/value.json: "), "{reason}");
}
