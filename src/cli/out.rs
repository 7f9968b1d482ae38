//! The folder that a command writes its results to: made and tried before the work begins, and no file of it half written.

use std::io::ErrorKind;
use std::path::Path;

use super::CliError;
use crate::service::plan_job::Artifact;

/// Written and removed again, to see that the folder can be written to.
const PROBE: &str = ".vantage-probe";

/// Makes the folder and tries to write in it.
///
/// # Errors
/// [`CliError::BadInput`] where the path is, or leads through, something else; [`CliError::Failed`] where the machine
/// refuses.
pub(super) fn prepare(out: &Path) -> Result<(), CliError> {
    std::fs::create_dir_all(out).map_err(|error| match error.kind() {
        ErrorKind::AlreadyExists | ErrorKind::NotADirectory => {
            CliError::BadInput(format!("--out {}: is or lies below a file; name a folder", out.display()))
        }
        _ => refused(out, &error),
    })?;
    let probe = out.join(PROBE);
    std::fs::write(&probe, b"").and_then(|()| std::fs::remove_file(&probe)).map_err(|error| refused(out, &error))
}

/// Writes every file under another name first, so that none is ever seen half written.
///
/// # Errors
/// [`CliError::Failed`].
pub(super) fn write(out: &Path, artifacts: &[Artifact]) -> Result<(), CliError> {
    artifacts.iter().try_for_each(|artifact| write_file(&out.join(artifact.name), &artifact.bytes))
}

/// Writes one file under another name first.
///
/// # Errors
/// [`CliError::Failed`].
pub(super) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let part = path.with_file_name(format!(".{name}.part"));
    std::fs::write(&part, bytes).and_then(|()| std::fs::rename(&part, path)).map_err(|error| {
        // It may not be there at all.
        let _ = std::fs::remove_file(&part);
        refused(path, &error)
    })
}

fn refused(path: &Path, error: &std::io::Error) -> CliError {
    CliError::Failed(format!("--out {}: cannot be written: {error}", path.display()))
}
