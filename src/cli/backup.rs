//! `vantage backup` and `vantage restore`: copy a server's store, and make a store from the copy.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use super::serve::run_to_completion;
use super::{CliError, failed, output};
use crate::service::{BackupError, BackupReport, backup, restore};
use crate::wire::words::counted;

/// Back up the data of a server, which may be running.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "A backup has the layout of a store: vantage.db, files, audit and store-id. A later backup to the same folder \
copies the database and only new files. The hash of every file is checked as it is copied. If a file is missing or damaged, the \
command names it, backs up the rest, and exits with code 1. Audit logs in a separate folder (execution.audit_dir) are not backed \
up.

Example:
  vantage backup --data /var/lib/vantage --to /mnt/backup/vantage"
)]
pub struct BackupArgs {
    /// Data folder of the server.
    #[arg(long, value_name = "DIR", default_value = "vantage-data")]
    data: PathBuf,
    /// Folder for the backup; created if it does not exist.
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
}

/// Restore the data of a server from a backup.
#[derive(Debug, clap::Args)]
#[command(after_help = "The database and every file are checked; if one is missing or damaged, nothing is restored unless you \
give --keep-damaged. The new data folder must be empty, or must not exist.

Example:
  vantage restore --from /mnt/backup/vantage --data /var/lib/vantage")]
pub struct RestoreArgs {
    /// Folder that has the backup.
    #[arg(long, value_name = "DIR")]
    from: PathBuf,
    /// New data folder of the server; created if it does not exist.
    #[arg(long, value_name = "DIR", default_value = "vantage-data")]
    data: PathBuf,
    /// Restore the rest even if files of the backup are missing or damaged; meshes and jobs that need those files are kept
    /// without them.
    #[arg(long)]
    keep_damaged: bool,
}

/// Runs `vantage backup`.
///
/// # Errors
/// [`CliError`].
pub fn run_backup(args: &BackupArgs) -> Result<(), CliError> {
    check_names([("--data", args.data.as_path()), ("--to", args.to.as_path())])?;
    run_to_completion(async {
        let report = backup(&args.data, &args.to).await.map_err(|error| refused("the backup", &error))?;
        let words = format!("{} backed up to {}: {}\n", args.data.display(), args.to.display(), summary(&report));
        output::result(&Copied::new(&args.data, &args.to, &report), words)
    })
}

/// Runs `vantage restore`.
///
/// # Errors
/// [`CliError`].
pub fn run_restore(args: &RestoreArgs) -> Result<(), CliError> {
    check_names([("--from", args.from.as_path()), ("--data", args.data.as_path())])?;
    run_to_completion(async {
        let restored = restore(&args.from, &args.data, args.keep_damaged).await;
        let report = restored.map_err(|error| refused("the restore", &error))?;
        let (data, from) = (args.data.display(), args.from.display());
        let left_out: String = report.damaged.iter().map(|file| format!("left out, missing or damaged: {file}\n")).collect();
        let summary = summary(&report);
        let words =
            format!("{data} restored from {from}: {summary}\n{left_out}Start the server with: vantage serve --data {data}\n");
        output::result(&Copied::new(&args.from, &args.data, &report), words)
    })
}

/// Refuses folders whose names are not UTF-8: SQLite takes no other names; with their bytes replaced they would be other folders.
fn check_names(folders: [(&str, &Path); 2]) -> Result<(), CliError> {
    match folders.into_iter().find(|(_, folder)| folder.to_str().is_none()) {
        Some((option, folder)) => Err(CliError::BadInput(format!("{option} {}: is not UTF-8", folder.display()))),
        None => Ok(()),
    }
}

/// Error of a copy: folders that cannot be the ones meant are bad input.
fn refused(what: &str, error: &BackupError) -> CliError {
    use BackupError::{BelowSource, NoStore, NotEmpty, OntoItself, OtherStore};
    match error {
        NoStore(_) | BelowSource { .. } | OntoItself(_) | NotEmpty(_) | OtherStore(_) => {
            CliError::BadInput(format!("{what}: {error}"))
        }
        BackupError::Incomplete(_)
        | BackupError::Damaged(_)
        | BackupError::Busy
        | BackupError::Open(_)
        | BackupError::Database(_)
        | BackupError::File { .. } => failed(what, error),
    }
}

/// Counts as `--json` prints them.
#[derive(serde::Serialize)]
struct Copied<'a> {
    from: Cow<'a, str>,
    to: Cow<'a, str>,
    files: usize,
    copied: usize,
    audit_logs: usize,
    copied_bytes: u64,
    /// Names of the files that were left out.
    damaged: Vec<&'a str>,
}

impl<'a> Copied<'a> {
    fn new(from: &'a Path, to: &'a Path, report: &'a BackupReport) -> Self {
        let &BackupReport { files, copied, audit_logs, copied_bytes, ref damaged } = report;
        let damaged = damaged.iter().map(|file| file.name.as_str()).collect();
        Self { from: from.to_string_lossy(), to: to.to_string_lossy(), files, copied, audit_logs, copied_bytes, damaged }
    }
}

fn summary(report: &BackupReport) -> String {
    let megabytes = report.copied_bytes as f64 / 1e6;
    let files = counted(report.files, "file");
    let logs = match report.audit_logs {
        0 => String::new(),
        logs => format!(", and {} of audit logs", counted(logs, "file")),
    };
    format!("the database and {files}, {} of them copied{logs} ({megabytes:.1} MB)", report.copied)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The commands ended with 1, the code of a system error.
    #[test]
    fn folders_that_cannot_be_the_ones_meant_are_bad_input() {
        let folder = tempfile::tempdir().expect("a folder");
        let [data, to] = ["data", "to"].map(|name| folder.path().join(name));
        let backed_up = run_backup(&BackupArgs { data: data.clone(), to: to.clone() });
        let restored = run_restore(&RestoreArgs { from: to.clone(), data, keep_damaged: false });
        for error in [backed_up.expect_err("no store"), restored.expect_err("no backup")] {
            assert!(error.exit_code() == 2 && error.to_string().ends_with("it has no vantage.db"), "{error}");
        }
        for (error, code) in [
            (BackupError::NotEmpty(to.clone()), 2),
            (BackupError::OtherStore(to.clone()), 2),
            (BackupError::BelowSource { to: to.clone(), from: to.clone() }, 2),
            (BackupError::OntoItself(to), 2),
            (BackupError::Busy, 1),
            (BackupError::Damaged(Vec::new()), 1),
        ] {
            assert_eq!(refused("the backup", &error).exit_code(), code, "{error}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn folders_whose_names_are_not_utf_8_are_refused() {
        use std::os::unix::ffi::OsStrExt as _;
        let named = |name: &'static [u8]| PathBuf::from(std::ffi::OsStr::from_bytes(name));
        let backed_up = run_backup(&BackupArgs { data: named(b"data"), to: named(b"to-\xff") });
        let restored = run_restore(&RestoreArgs { from: named(b"from-\xff"), data: named(b"data"), keep_damaged: false });
        for (refused, told) in [(backed_up, "--to to-\u{fffd}: is not UTF-8"), (restored, "--from from-\u{fffd}: is not UTF-8")] {
            assert_eq!(refused, Err(CliError::BadInput(told.to_owned())));
        }
    }

    #[test]
    fn one_file_is_no_files() {
        let told = |files, audit_logs| {
            summary(&BackupReport { files, copied: 1, audit_logs, copied_bytes: 1_240_000, damaged: Vec::new() })
        };
        assert_eq!(told(1, 0), "the database and 1 file, 1 of them copied (1.2 MB)");
        assert_eq!(told(2, 0), "the database and 2 files, 1 of them copied (1.2 MB)");
        assert_eq!(told(2, 1), "the database and 2 files, 1 of them copied, and 1 file of audit logs (1.2 MB)");
    }
}
