//! Output folder of a command: created and tested before the work begins; its files are written atomically.

use std::io::ErrorKind;
use std::path::Path;

use super::CliError;
use crate::service::plan_job::Artifact;

/// File that is written and removed to test that the folder is writable.
const PROBE: &str = ".vantage-probe";

/// Creates the folder and tests that it is writable.
///
/// # Errors
/// [`CliError::BadInput`] if the path is, or leads through, a file; [`CliError::Failed`] if the system refuses.
pub(super) fn prepare(out: &Path) -> Result<(), CliError> {
    std::fs::create_dir_all(out).map_err(|error| {
        if matches!(error.kind(), ErrorKind::AlreadyExists | ErrorKind::NotADirectory) {
            CliError::BadInput(format!("--out {}: is a file, or below a file; name a folder", out.display()))
        } else {
            refused(out, &error)
        }
    })?;
    let probe = out.join(PROBE);
    std::fs::write(&probe, b"").and_then(|()| std::fs::remove_file(&probe)).map_err(|error| refused(out, &error))
}

/// Writes every file under a temporary name first, so that none is ever seen half written.
///
/// # Errors
/// [`CliError::Failed`].
pub(super) fn write(out: &Path, artifacts: &[Artifact]) -> Result<(), CliError> {
    artifacts.iter().try_for_each(|artifact| write_file(&out.join(&*artifact.name), &artifact.bytes))
}

/// Writes a file under a temporary name first, then renames it.
///
/// # Errors
/// [`CliError::Failed`].
pub(super) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let part = path.with_file_name(format!(".{name}.part"));
    std::fs::write(&part, bytes).and_then(|()| std::fs::rename(&part, path)).map_err(|error| {
        // It may not exist.
        let _ = std::fs::remove_file(&part);
        refused(path, &error)
    })
}

fn refused(path: &Path, error: &std::io::Error) -> CliError {
    CliError::Failed(format!("--out {}: cannot be written: {error}", path.display()))
}
