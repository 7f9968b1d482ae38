//! Named points at which a test may have the process die, as if it had been killed or had lost its power.
//!
//! `VANTAGE_FAILPOINT=name` aborts the process when it comes to that point; without the variable a point costs one
//! comparison. Points: `upload.before_rename`, `upload.after_rename`, `upload.committed`, `job.before_insert`,
//! `job.inserted`, `job.claimed`, `stage.<name>` for each planning stage as it begins, `artifact.before_rename`,
//! `artifact.written`, `result.before_commit`, `result.committed`, `cancel.before_commit`, `cancel.committed`.

use std::sync::OnceLock;

/// Every point, for tests that walk through all of them.
pub const NAMES: [&str; 21] = [
    "upload.before_rename",
    "upload.after_rename",
    "upload.committed",
    "job.before_insert",
    "job.inserted",
    "job.claimed",
    "stage.surface",
    "stage.candidates",
    "stage.stations",
    "stage.visibility",
    "stage.selection",
    "stage.sequence",
    "stage.missed",
    "stage.certificate",
    "stage.report",
    "artifact.before_rename",
    "artifact.written",
    "result.before_commit",
    "result.committed",
    "cancel.before_commit",
    "cancel.committed",
];

/// Dies here, if this is the point that the environment names. No destructor runs and no buffer is flushed.
pub(crate) fn hit(group: &str, name: &str) {
    static ARMED: OnceLock<Option<String>> = OnceLock::new();
    let armed = ARMED.get_or_init(|| std::env::var("VANTAGE_FAILPOINT").ok());
    if armed.as_deref().and_then(|armed| armed.split_once('.')) == Some((group, name)) {
        eprintln!("failpoint {group}.{name}: the process dies here");
        std::process::abort();
    }
}
