//! `vantage backup` and `vantage restore`: copies of a store, and stores from copies.

use std::path::PathBuf;

use super::serve::run_to_the_end;
use super::{CliError, failed};
use crate::service::{BackupReport, backup, restore};

/// Copy a server's store; the server may be working on it.
#[derive(Debug, clap::Args)]
#[command(after_help = "The backup is itself the folder of a store: vantage.db, files and store-id. Into the same folder
again, only what is new is copied. Every file is compared with its hash on the way.

Example:
  vantage backup --data /var/lib/vantage --to /mnt/backup/vantage")]
pub struct BackupArgs {
    /// Folder of the store.
    #[arg(long, value_name = "DIR", default_value = "vantage-data")]
    data: PathBuf,
    /// Folder of the backup; made if need be.
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
}

/// Make a store from a backup.
#[derive(Debug, clap::Args)]
#[command(after_help = "The database and every file are checked. The folder of the store has to be new or empty.

Example:
  vantage restore --from /mnt/backup/vantage --data /var/lib/vantage")]
pub struct RestoreArgs {
    /// Folder of the backup.
    #[arg(long, value_name = "DIR")]
    from: PathBuf,
    /// Folder of the store; made if need be.
    #[arg(long, value_name = "DIR", default_value = "vantage-data")]
    data: PathBuf,
}

/// Runs `vantage backup`.
///
/// # Errors
/// [`CliError`].
pub fn run_backup(args: &BackupArgs) -> Result<(), CliError> {
    run_to_the_end(async {
        let report = backup(&args.data, &args.to).await.map_err(|error| failed("the backup", &error))?;
        println!("{} backed up to {}: {}", args.data.display(), args.to.display(), summary(&report));
        Ok(())
    })
}

/// Runs `vantage restore`.
///
/// # Errors
/// [`CliError`].
pub fn run_restore(args: &RestoreArgs) -> Result<(), CliError> {
    run_to_the_end(async {
        let report = restore(&args.from, &args.data).await.map_err(|error| failed("the restore", &error))?;
        println!("{} restored from {}: {}", args.data.display(), args.from.display(), summary(&report));
        println!("Start the server with: vantage serve --data {}", args.data.display());
        Ok(())
    })
}

fn summary(report: &BackupReport) -> String {
    let megabytes = report.copied_bytes as f64 / 1e6;
    format!("the database and {} files, {} of them copied ({megabytes:.1} MB)", report.files, report.copied)
}
