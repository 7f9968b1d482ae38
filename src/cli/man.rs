//! `vantage man`: writes the manual pages, one for each command.

use std::path::PathBuf;

use clap::{Command, CommandFactory};
use clap_mangen::Man;
use serde::Serialize;

use super::{Cli, CliError, out, output};

/// Write a manual page for each command.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Example:
  vantage man --out /usr/local/share/man/man1")]
pub(super) struct ManArgs {
    /// Folder for the pages; created if it does not exist.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Files that were written.
#[derive(Serialize)]
struct Pages {
    files: Vec<String>,
}

/// Writes the pages and prints their files.
///
/// # Errors
/// [`CliError`] if the folder cannot be written.
pub(super) fn run(args: &ManArgs) -> Result<(), CliError> {
    let mut command = Cli::command().disable_help_subcommand(true);
    command.build();
    std::fs::create_dir_all(&args.out).map_err(|error| out::not_made(&args.out, &error))?;
    let mut files = Vec::new();
    for (name, page) in pages(&command)? {
        let path = args.out.join(name);
        out::write_file(&path, &page)?;
        files.push(path.display().to_string());
    }
    let lines: String = files.iter().map(|file| format!("{file}\n")).collect();
    output::result(&Pages { files }, lines)
}

/// Pages of a command and of those below it, with their file names.
fn pages(command: &Command) -> Result<Vec<(String, Vec<u8>)>, CliError> {
    let page = Man::new(command.clone()).manual("Vantage");
    let mut text = Vec::new();
    page.render(&mut text).map_err(|error| CliError::Failed(format!("the manual page: {error}")))?;
    let mut all = vec![(page.get_filename(), text)];
    for below in command.get_subcommands().filter(|below| !below.is_hide_set()) {
        all.extend(pages(below)?);
    }
    Ok(all)
}
