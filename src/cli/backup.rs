//! `vantage backup` and `vantage restore`: copy a server's store, and make a store from the copy.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use super::serve::run_to_completion;
use super::{CliError, failed, output};
use crate::service::{BackupReport, backup, restore};
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
    run_to_completion(async {
        let report = backup(&args.data, &args.to).await.map_err(|error| failed("the backup", &error))?;
        let words = format!("{} backed up to {}: {}\n", args.data.display(), args.to.display(), summary(&report));
        output::result(&Copied::new(&args.data, &args.to, &report), words)
    })
}

/// Runs `vantage restore`.
///
/// # Errors
/// [`CliError`].
pub fn run_restore(args: &RestoreArgs) -> Result<(), CliError> {
    run_to_completion(async {
        let report = restore(&args.from, &args.data, args.keep_damaged).await.map_err(|error| failed("the restore", &error))?;
        let (data, from) = (args.data.display(), args.from.display());
        let left_out: String = report.damaged.iter().map(|file| format!("left out, missing or damaged: {file}\n")).collect();
        let summary = summary(&report);
        let words =
            format!("{data} restored from {from}: {summary}\n{left_out}Start the server with: vantage serve --data {data}\n");
        output::result(&Copied::new(&args.from, &args.data, &report), words)
    })
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
