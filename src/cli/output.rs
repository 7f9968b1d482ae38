//! Output of commands. Results and summaries go to standard output, everything else to standard error.
//!
//! A reader that closes the pipe has had enough: the rest is dropped, the work goes on, and the exit code is that of the work.
//! Standard output that cannot be written for another reason, such as a full disk, is an error. With `--quiet` only errors are
//! printed, and the JSON that `--json` asks for; with `--json` standard error has one object a line.

use std::fmt::Display;
use std::io::{ErrorKind, Write};
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use serde::Serialize;

use super::{CliError, FileFinding};

/// Flags for the output of every command.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
#[command(next_help_heading = "Output")]
pub(super) struct OutputArgs {
    /// Print only errors, and the JSON that --json asks for; result files are still written.
    #[arg(short, long, global = true)]
    pub(super) quiet: bool,
    /// Log to standard error, with times: -v stages, -vv details, -vvv everything.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub(super) verbose: u8,
    /// Print one JSON document to standard output instead of text; standard error has one JSON object per line for each warning
    /// and error.
    #[arg(long, global = true)]
    pub(super) json: bool,
}

static IS_QUIET: AtomicBool = AtomicBool::new(false);
static IS_JSON: AtomicBool = AtomicBool::new(false);
static VERBOSITY: AtomicU8 = AtomicU8::new(0);

impl OutputArgs {
    /// Applies the flags to everything that the process prints from now on.
    pub(super) fn apply(self) {
        IS_QUIET.store(self.quiet, Ordering::Relaxed);
        IS_JSON.store(self.json, Ordering::Relaxed);
        VERBOSITY.store(if self.quiet { 0 } else { self.verbose }, Ordering::Relaxed);
    }
}

/// Returns true if only errors are printed.
pub(super) fn is_quiet() -> bool {
    IS_QUIET.load(Ordering::Relaxed)
}

/// Returns true if output is for programs.
pub(super) fn is_json() -> bool {
    IS_JSON.load(Ordering::Relaxed)
}

/// Number of times that `--verbose` is given.
pub(super) fn verbosity() -> u8 {
    VERBOSITY.load(Ordering::Relaxed)
}

/// Prints text for people, as it is; nothing with `--quiet` or `--json`.
///
/// # Errors
/// [`CliError::Failed`] if standard output cannot be written.
pub(super) fn text(text: impl Display) -> Result<(), CliError> {
    if is_quiet() || is_json() { Ok(()) } else { bytes(text.to_string().as_bytes()) }
}

/// Prints a line for people; nothing with `--quiet` or `--json`.
///
/// # Errors
/// [`CliError::Failed`] if standard output cannot be written.
pub(super) fn line(line: impl Display) -> Result<(), CliError> {
    text(format_args!("{line}\n"))
}

/// Prints text for people, or with `--json` the document with the same content.
///
/// # Errors
/// [`CliError::Failed`] if standard output cannot be written.
pub(super) fn result(document: &impl Serialize, words: impl Display) -> Result<(), CliError> {
    if is_json() { json(document) } else { text(words) }
}

/// Prints a document as JSON, whatever the flags.
///
/// # Errors
/// [`CliError::Failed`] if standard output cannot be written.
pub(super) fn json(document: &impl Serialize) -> Result<(), CliError> {
    let text = serde_json::to_string_pretty(document).map_err(|error| CliError::Failed(format!("JSON: {error}")))?;
    bytes((text + "\n").as_bytes())
}

/// A specification in TOML, its fields in their order. It goes through a table: the serialiser of documents is made of six, and
/// each would be compiled for every type.
///
/// # Errors
/// [`CliError::Failed`] for what TOML cannot say.
pub(super) fn toml(document: &impl Serialize) -> Result<String, CliError> {
    let table = toml::Value::try_from(document);
    table.and_then(|table| toml::to_string_pretty(&table)).map_err(|error| CliError::Failed(format!("TOML: {error}")))
}

/// Prints bytes as they are, whatever the flags.
///
/// # Errors
/// [`CliError::Failed`] if standard output cannot be written.
pub(super) fn bytes(bytes: &[u8]) -> Result<(), CliError> {
    let mut stdout = std::io::stdout().lock();
    written(stdout.write_all(bytes).and_then(|()| stdout.flush()))
}

/// Judges what became of a write to standard output.
pub(super) fn written(result: std::io::Result<()>) -> Result<(), CliError> {
    match result {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(CliError::Failed(format!("standard output cannot be written: {error}")))
        }
        Ok(()) | Err(_) => Ok(()),
    }
}

/// Prints a line of progress to standard error; nothing with `--quiet` or `--json`.
pub(super) fn note(line: impl Display) {
    if !is_quiet() && !is_json() {
        to_stderr(&line.to_string());
    }
}

/// Prints a question to standard error, whatever the flags, without ending the line.
pub(super) fn prompt(question: impl Display) {
    // Nobody can be asked if standard error is gone: no answer is then the right one either.
    let _ = std::io::stderr().lock().write_all(question.to_string().as_bytes());
}

/// Warning as standard error has it with `--json`.
#[derive(Serialize)]
struct WarningLine<'a> {
    level: &'static str,
    file: &'a str,
    pointer: &'a str,
    detail: &'a str,
    remedy: &'a str,
}

/// Prints a warning to standard error; nothing with `--quiet`. `pointer` is empty for the whole of `file`.
pub(super) fn warning(file: &str, pointer: &str, detail: &str, remedy: &str) {
    if is_quiet() {
        return;
    }
    if is_json() {
        json_to_stderr(&WarningLine { level: "warning", file, pointer, detail, remedy });
        return;
    }
    let field = if pointer.is_empty() { String::new() } else { format!("{pointer}: ") };
    to_stderr(&format!("{file}: {field}{detail}\n  → {remedy}"));
}

/// Error as standard error has it with `--json`; its names are those of problems over HTTP.
#[derive(Serialize)]
struct ErrorLine<'a> {
    level: &'static str,
    code: &'static str,
    title: &'static str,
    detail: String,
    exit_code: u8,
    errors: &'a [FileFinding],
}

/// Prints the error of one part of several to standard error, with `--quiet` too; nothing with `--json`, where its line has it.
pub(super) fn error_of_part(line: impl Display) {
    if !is_json() {
        to_stderr(&line.to_string());
    }
}

/// Prints the error that ends the command to standard error.
pub(super) fn error(error: &CliError) {
    if !is_json() {
        return to_stderr(&format!("error: {}", without_numbers(&error.to_string())));
    }
    let errors = if let CliError::Findings(findings) = error { findings.as_slice() } else { &[] };
    let (code, title) = error.code();
    let detail = without_numbers(&error.to_string());
    json_to_stderr(&ErrorLine { level: "error", code, title, detail, exit_code: error.exit_code(), errors });
}

/// The message without the numbers that the standard library adds to the system's own words, ` (os error 2)`.
fn without_numbers(message: &str) -> String {
    let mut parts = message.split(" (os error ");
    let first = parts.next().unwrap_or_default().to_owned();
    parts.fold(first, |told, part| told + part.split_once(')').map_or("", |(_, rest)| rest))
}

fn json_to_stderr(document: &impl Serialize) {
    // Structs of strings and numbers can be written.
    to_stderr(&serde_json::to_string(document).unwrap_or_default());
}

/// Writes a line to standard error. Nobody can be told if that fails.
fn to_stderr(line: &str) {
    let _ = std::io::stderr().lock().write_all(format!("{line}\n").as_bytes());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_of_the_system_is_told_in_its_words_alone() {
        let missing = std::io::Error::from_raw_os_error(2);
        let told = without_numbers(&format!("a: {missing}\nb: {missing}; and more"));
        assert!(!told.contains("os error") && told.starts_with("a: ") && told.ends_with("; and more"), "{told}");
        assert_eq!(without_numbers("is 3 (at most 2)"), "is 3 (at most 2)");
    }

    #[test]
    fn a_reader_that_is_gone_is_no_error_and_a_full_disk_is_one() {
        assert_eq!(written(Ok(())), Ok(()));
        assert_eq!(written(Err(ErrorKind::BrokenPipe.into())), Ok(()));
        let error = written(Err(ErrorKind::StorageFull.into())).expect_err("full");
        assert!(error.exit_code() == 1 && error.to_string().starts_with("standard output cannot be written"), "{error}");
    }
}
