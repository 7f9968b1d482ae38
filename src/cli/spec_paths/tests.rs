use serde_json::json;

use super::*;

#[test]
fn a_path_is_named_from_the_folder_of_the_file_that_has_it() {
    let here = std::env::current_dir().expect("a folder");
    let [whole, beside] = ["arm.toml", "cells/arm.toml"].map(|name| here.join(name).display().to_string());
    for (file, name, wanted) in [
        ("cells/c.toml", "cells/arm.toml", "arm.toml"),
        ("./cells/c.toml", "cells/arms/arm.toml", "arms/arm.toml"),
        ("cells/c.toml", beside.as_str(), "arm.toml"),
        ("/nowhere/c.toml", "/nowhere/arm.toml", "arm.toml"),
        ("c.toml", "../arm.toml", "../arm.toml"),
        ("c.toml", whole.as_str(), "arm.toml"),
        ("cells/c.toml", "arm.toml", whole.as_str()),
        ("cells/c.toml", "ur10e", "ur10e"),
        ("cells/c.toml", "", ""),
    ] {
        assert_eq!(name_for(Path::new(file), SpecKind::Robot, name), wanted, "{name} in {file}");
    }
}

/// The file was read back as the preset.
#[test]
fn a_file_that_has_the_name_of_a_preset_stays_a_file() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |name: &str| folder.path().join(name);
    for name in ["c.toml", "ur10e"] {
        std::fs::write(path(name), "").expect("a file");
    }
    let robot = name_for(&path("c.toml"), SpecKind::Robot, &path("ur10e").display().to_string());
    assert_eq!(robot, "./ur10e");
    let mut document = json!({"robot": robot, "scanner": "transcan-c"});
    place(&mut document, &path("c.toml")).expect("there");
    assert_eq!(document["robot"].as_str().map(Path::new), Some(path("ur10e").as_path()));
    assert_eq!(document["scanner"], "transcan-c");
}
