//! Failpoints: each stage has one, each is documented and in the code.

use super::*;
use crate::planning::context::Stage;

#[test]
fn every_stage_has_its_failpoint() {
    for stage in Stage::ALL {
        assert!(FAILPOINTS.contains(&format!("stage.{}", stage.as_str()).as_str()), "{}", stage.as_str());
    }
}

#[test]
fn every_failpoint_is_documented_and_in_the_code() {
    let sources = [
        include_str!("store/files.rs"),
        include_str!("store/artifacts.rs"),
        include_str!("store/meshes.rs"),
        include_str!("store/jobs.rs"),
        include_str!("store/attempts.rs"),
        include_str!("jobs.rs"),
    ]
    .concat();
    let documentation = include_str!("failpoint.rs").split("pub const").next().unwrap_or_default();
    for name in FAILPOINTS {
        let (group, point) = name.split_once('.').expect("a group");
        if group != "stage" {
            assert!(sources.contains(&format!("hit(\"{group}\", \"{point}\")")), "{name} is nowhere");
            assert!(documentation.contains(&format!("`{name}`")), "{name} is not documented");
        }
    }
}
