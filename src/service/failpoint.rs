//! Failpoints: named places at which a test can make the process die, as if killed or after a power cut, or hang.
//!
//! `VANTAGE_FAILPOINT=name` aborts the process when it reaches that failpoint, `VANTAGE_FAILPOINT=name:hang` blocks the
//! thread there forever. Only builds with debug assertions or the feature `failpoints` have them; others ignore the
//! variable. Failpoints: `upload.before_rename`, `upload.after_rename`, `upload.committed`, `job.before_insert`,
//! `job.inserted`, `job.claimed`, `stage.<name>` for each planning stage as it begins, `artifact.before_rename`,
//! `artifact.written`, `result.before_commit`, `result.committed`, `cancel.before_commit`, `cancel.committed`.

/// Names of all failpoints, for tests that go through them.
pub const NAMES: [&str; 25] = [
    "upload.before_rename",
    "upload.after_rename",
    "upload.committed",
    "job.before_insert",
    "job.inserted",
    "job.claimed",
    "stage.reading",
    "stage.surface",
    "stage.collision_scene",
    "stage.candidates",
    "stage.stations",
    "stage.visibility",
    "stage.selection",
    "stage.roadmap",
    "stage.sequence",
    "stage.missed",
    "stage.certificate",
    "stage.bound",
    "stage.report",
    "artifact.before_rename",
    "artifact.written",
    "result.before_commit",
    "result.committed",
    "cancel.before_commit",
    "cancel.committed",
];

/// Aborts or hangs here if the environment names this failpoint. No destructor runs and no buffer is flushed.
#[cfg(any(debug_assertions, feature = "failpoints"))]
pub(crate) fn hit(group: &str, name: &str) {
    static ARMED: std::sync::OnceLock<Option<String>> = std::sync::OnceLock::new();
    let armed = ARMED.get_or_init(|| std::env::var("VANTAGE_FAILPOINT").ok());
    let Some(armed) = armed.as_deref() else { return };
    let (point, hangs) = armed.strip_suffix(":hang").map_or((armed, false), |point| (point, true));
    if point.split_once('.') != Some((group, name)) {
        return;
    }
    if hangs {
        eprintln!("failpoint {group}.{name}: the thread hangs here");
        loop {
            std::thread::park();
        }
    }
    eprintln!("failpoint {group}.{name}: the process dies here");
    std::process::abort();
}

/// Does nothing in a build without failpoints.
#[cfg(not(any(debug_assertions, feature = "failpoints")))]
pub(crate) fn hit(_group: &str, _name: &str) {}
