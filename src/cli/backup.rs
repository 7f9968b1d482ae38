//! `vantage backup` and `vantage restore`: copy a server's store, and make a store from the copy.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use super::serve::run_to_completion;
use super::{CliError, failed, output};
use crate::service::{BackupReport, backup, restore};
use crate::wire::words::counted;

/// Back up a server's store; the server may be running.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "A backup has the layout of a store: vantage.db, files and store-id. A later backup to the same folder copies the \
database and only new files. The hash of every file is checked as it is copied.

Example:
  vantage backup --data /var/lib/vantage --to /mnt/backup/vantage"
)]
pub struct BackupArgs {
    /// Data folder of the server.
    #[arg(long, value_name = "DIR", default_value = "vantage-data")]
    data: PathBuf,
    /// Folder of the backup; created if it does not exist.
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
}

/// Restore a store from a backup.
#[derive(Debug, clap::Args)]
#[command(after_help = "The database and every file are checked. The new data folder must be empty or not exist.

Example:
  vantage restore --from /mnt/backup/vantage --data /var/lib/vantage")]
pub struct RestoreArgs {
    /// Folder of the backup.
    #[arg(long, value_name = "DIR")]
    from: PathBuf,
    /// Data folder of the new store; created if it does not exist.
    #[arg(long, value_name = "DIR", default_value = "vantage-data")]
    data: PathBuf,
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
        let report = restore(&args.from, &args.data).await.map_err(|error| failed("the restore", &error))?;
        let (data, from) = (args.data.display(), args.from.display());
        let words =
            format!("{data} restored from {from}: {}\nStart the server with: vantage serve --data {data}\n", summary(&report));
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
    copied_bytes: u64,
}

impl<'a> Copied<'a> {
    fn new(from: &'a Path, to: &'a Path, report: &BackupReport) -> Self {
        let BackupReport { files, copied, copied_bytes } = *report;
        Self { from: from.to_string_lossy(), to: to.to_string_lossy(), files, copied, copied_bytes }
    }
}

fn summary(report: &BackupReport) -> String {
    let megabytes = report.copied_bytes as f64 / 1e6;
    let files = counted(report.files, "file");
    format!("the database and {files}, {} of them copied ({megabytes:.1} MB)", report.copied)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_file_is_no_files() {
        let told = |files: usize| summary(&BackupReport { files, copied: 1, copied_bytes: 1_240_000 });
        assert_eq!(told(1), "the database and 1 file, 1 of them copied (1.2 MB)");
        assert_eq!(told(2), "the database and 2 files, 1 of them copied (1.2 MB)");
    }
}
