//! Output folder of a command. It is made, tested and kept from other runs before the work begins. Nothing in it changes until
//! every file is there: then what Vantage wrote before goes, and the new files take its place.
//!
//! A record, [`RECORD_FILE`], names what Vantage wrote, with the hash of each file. Everything else is the user's, a file that
//! was changed since among it: a run that would have to replace or remove that is refused. At no moment do files of two runs
//! stand side by side: the record is marked as incomplete, the old files are removed, the new ones are renamed into the folder,
//! and the record is completed. A run that is killed in between leaves some files of one run, which the next command replaces
//! and `vantage program` refuses.

use std::collections::BTreeSet;
use std::fs::{self, File, TryLockError};
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::CliError;
use crate::program::dialects::Dialect;
use crate::service::plan_job::{Artifact, PLAN_FILE, REFUSED_FILE, program_stem};
use crate::wire::candidates::CANDIDATES_FILE;
use crate::wire::hex;
use crate::wire::output_record::{OutputRecord, RECORD_FILE, RecordedFile};
use crate::wire::plan::PLAN_SCHEMA;
use crate::wire::regions::REGIONS_FILE;
use crate::wire::summary::SUMMARY_FILE;

/// File that is written and removed to test that the folder is writable.
const PROBE: &str = ".vantage-probe";
/// Folder in the output folder that holds the new files until all are written: on the same file system, so that they can be
/// renamed.
const STAGING: &str = ".vantage-new";
/// Seconds of the stages of a command.
pub(super) const TIMINGS_FILE: &str = "timings.json";
/// Files of every plan, beside its programs; the reports as long as they are not left out.
pub(super) const FILES_OF_EVERY_PLAN: [&str; 12] = [
    PLAN_FILE,
    SUMMARY_FILE,
    "viewpoints.json",
    "viewpoints.csv",
    "coverage.json",
    "coverage.csv",
    "coverage.bin",
    "missed.json",
    "report.txt",
    "report.html",
    TIMINGS_FILE,
    "ovp.json",
];
/// Files that some plans have.
const FILES_OF_SOME_PLANS: [&str; 3] = [REGIONS_FILE, CANDIDATES_FILE, REFUSED_FILE];
/// Name, without extension, of a program that no parameter names.
const DEFAULT_PROGRAM: &str = "vantage";
/// Largest number of setups of a plan.
const MAX_SETUPS: usize = 4;
/// Bytes at the beginning of a program in which its header says whose it is.
const HEADER_BYTES: usize = 4096;

/// Command that writes to a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum OutputWriter {
    /// `vantage plan`: replaces an earlier plan, and programs that were made from it.
    Plan,
    /// `vantage program`: replaces programs made from the same place and another plan.
    Program,
    /// `vantage study`, with the name of the study: replaces the files of the same study.
    Study(&'static str),
    /// `vantage compare`: replaces an earlier inspection.
    Inspection,
    /// `vantage sim scanner`: replaces earlier scans.
    Scans,
}

impl OutputWriter {
    fn name(self) -> String {
        match self {
            Self::Plan => "plan".to_owned(),
            Self::Program => "program".to_owned(),
            Self::Study(name) => format!("study {name}"),
            Self::Inspection => "compare".to_owned(),
            Self::Scans => "sim scanner".to_owned(),
        }
    }

    /// Returns true if a file of an earlier run goes when these are written.
    fn replaces(self, old: &RecordedFile, origin: &FileOrigin) -> bool {
        match self {
            Self::Plan => [Self::Plan.name(), Self::Program.name()].contains(&old.written_by),
            Self::Program => {
                let is_stale = old.made_from == origin.made_from && old.plan_sha256 != origin.plan_sha256;
                old.written_by == self.name() && is_stale
            }
            Self::Study(_) | Self::Inspection | Self::Scans => old.written_by == self.name(),
        }
    }
}

/// Origin of the files that are written.
#[derive(Clone, Debug, Default)]
pub(super) struct FileOrigin {
    /// SHA-256 of the plan's file.
    pub(super) plan_sha256: Option<String>,
    /// Folder or file that they were made from.
    pub(super) made_from: Option<String>,
}

/// An output folder, kept from other runs while this lives.
#[derive(Debug)]
pub(super) struct OutputFolder {
    path: PathBuf,
    writer: OutputWriter,
    /// The folder itself, locked; `None` where the system cannot lock a folder.
    _lock: Option<File>,
    // After the lock, so that the folder is closed when it goes.
    _made: MadeFolders,
}

/// Folders that this run made. Those in which nothing is when this goes are removed: a run that fails leaves none behind.
#[derive(Debug)]
pub(super) struct MadeFolders(Vec<PathBuf>);

impl MadeFolders {
    /// Makes a folder, with those that it lies in.
    pub(super) fn make(path: &Path) -> std::io::Result<Self> {
        let missing = path.ancestors().take_while(|folder| !folder.as_os_str().is_empty() && !folder.exists());
        let made = Self(missing.map(Path::to_path_buf).collect());
        fs::create_dir_all(path)?;
        Ok(made)
    }
}

impl Drop for MadeFolders {
    fn drop(&mut self) {
        // The innermost first; one that is not empty stays.
        for folder in &self.0 {
            let _ = fs::remove_dir(folder);
        }
    }
}

impl OutputFolder {
    /// Creates the folder, tests that it is writable, and that files with `names`, which will be written, and those that will
    /// be replaced are Vantage's.
    ///
    /// # Errors
    /// [`CliError::BadInput`] if the path is, or leads through, a file, if another run writes to it, or if a file is in the
    /// way; [`CliError::Failed`] if the system refuses.
    pub(super) fn prepare(path: &Path, writer: OutputWriter, names: &[&str]) -> Result<Self, CliError> {
        let made = MadeFolders::make(path).map_err(|error| not_made(path, &error))?;
        let lock = lock(path)?;
        let probe = path.join(PROBE);
        fs::write(&probe, b"").and_then(|()| fs::remove_file(&probe)).map_err(|error| refused(path, &error))?;
        let folder = Self { path: path.to_owned(), writer, _lock: lock, _made: made };
        let old = folder.old_files()?;
        let replaced =
            old.files.iter().filter(|file| writer != OutputWriter::Program && writer.replaces(file, &FileOrigin::default()));
        let touched: BTreeSet<&str> = names.iter().copied().chain(replaced.map(|file| file.name.as_str())).collect();
        folder.refuse_files_of_the_user(&old, &touched)?;
        Ok(folder)
    }

    /// Path of the folder.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Writes every file and removes what earlier runs wrote and these files replace.
    ///
    /// # Errors
    /// [`CliError::BadInput`] if a file of the user is in the way, [`CliError::Failed`] if the system refuses; then the folder
    /// is as it was, unless the system fails between two renames.
    pub(super) fn replace(&self, artifacts: &[Artifact], origin: &FileOrigin) -> Result<(), CliError> {
        self.replace_all(artifacts, None, origin)
    }

    /// Does what [`OutputFolder::replace`] does, and writes `timings`, the file [`TIMINGS_FILE`], which is made when the others are on
    /// the disk.
    ///
    /// # Errors
    /// Errors of [`OutputFolder::replace`].
    pub(super) fn replace_timed(
        &self,
        artifacts: &[Artifact],
        timings: &dyn Fn() -> Artifact,
        origin: &FileOrigin,
    ) -> Result<(), CliError> {
        self.replace_all(artifacts, Some(timings), origin)
    }

    fn replace_all(
        &self,
        artifacts: &[Artifact],
        timings: Option<&dyn Fn() -> Artifact>,
        origin: &FileOrigin,
    ) -> Result<(), CliError> {
        self.refuse_one_name_twice(artifacts)?;
        let old = self.old_files()?;
        self.refuse_another_plan(&old, origin)?;
        let written: BTreeSet<&str> =
            artifacts.iter().map(|artifact| &*artifact.name).chain(timings.map(|_| TIMINGS_FILE)).collect();
        let goes = |file: &&RecordedFile| written.contains(file.name.as_str()) || self.writer.replaces(file, origin);
        let (gone, kept): (Vec<&RecordedFile>, Vec<&RecordedFile>) = old.files.iter().partition(|file| goes(file));
        self.refuse_program_of_another_plan(&gone, origin)?;
        let touched = written.iter().copied().chain(gone.iter().map(|file| file.name.as_str())).collect();
        self.refuse_files_of_the_user(&old, &touched)?;
        let staging = self.path.join(STAGING);
        let new = self.stage(&staging, artifacts, timings, origin).map_err(|error| self.abandon(&staging, &error))?;
        // A plan that was not completed stays so until none of its files is left.
        let is_of_plan = |file: &&RecordedFile| OutputWriter::Plan.replaces(file, origin);
        let complete = old.complete || !kept.iter().any(is_of_plan);
        let kept = kept.into_iter().cloned().collect::<Vec<_>>();
        let left = OutputRecord::new([kept, new.clone()].concat(), complete);
        self.swap(&staging, &old.files, &touched, &new, &left).map_err(|error| {
            let what = format!("cannot be written: {error}; the new files that it lacks are in {}", staging.display());
            CliError::Failed(format!("--out {}: {what}", self.path.display()))
        })
    }

    /// Files of earlier runs. Without a record, those that a release without records wrote.
    fn old_files(&self) -> Result<OldFiles, CliError> {
        let path = self.path.join(RECORD_FILE);
        match fs::read(&path) {
            Ok(bytes) => {
                let record = OutputRecord::parse(&bytes).ok_or_else(|| {
                    let what = "is not a record that this version of Vantage can read; move it away or name another folder";
                    CliError::BadInput(format!("--out {}: {RECORD_FILE} {what}", self.path.display()))
                })?;
                Ok(OldFiles { files: record.files, has_record: true, complete: record.complete })
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {
                Ok(OldFiles { files: unrecorded(&self.path), has_record: false, complete: true })
            }
            Err(error) => Err(refused(&path, &error)),
        }
    }

    /// Refuses two new files of one name, capital letters apart: the second would replace the first, or be missing at the end.
    fn refuse_one_name_twice(&self, artifacts: &[Artifact]) -> Result<(), CliError> {
        let mut names = BTreeSet::new();
        let Some(twice) = artifacts.iter().find(|artifact| !names.insert(artifact.name.to_ascii_lowercase())) else {
            return Ok(());
        };
        let what = "would be written twice; this is a fault of Vantage: please report it";
        Err(CliError::Failed(format!("--out {}: {} {what}", self.path.display(), twice.name)))
    }

    /// Refuses to put a program beside the results of another plan.
    fn refuse_another_plan(&self, old: &OldFiles, origin: &FileOrigin) -> Result<(), CliError> {
        let is_other = |file: &RecordedFile| {
            file.written_by == OutputWriter::Plan.name() && file.plan_sha256.is_some() && file.plan_sha256 != origin.plan_sha256
        };
        if self.writer != OutputWriter::Program || !old.files.iter().any(is_other) {
            return Ok(());
        }
        let what = "holds the results of another plan, not of the program's; name another folder";
        Err(CliError::BadInput(format!("--out {}: {what}", self.path.display())))
    }

    /// Refuses to replace a program that was made from another plan in another place: both are wanted, and have one name.
    fn refuse_program_of_another_plan(&self, gone: &[&RecordedFile], origin: &FileOrigin) -> Result<(), CliError> {
        let is_other = |file: &&&RecordedFile| {
            let is_elsewhere = file.made_from.is_some() && file.made_from != origin.made_from;
            let is_of_another = file.plan_sha256.is_some() && file.plan_sha256 != origin.plan_sha256;
            file.written_by == OutputWriter::Program.name() && is_elsewhere && is_of_another
        };
        let Some(other) = gone.iter().find(is_other).filter(|_| self.writer == OutputWriter::Program) else { return Ok(()) };
        let (name, made_from) = (&other.name, other.made_from.as_deref().unwrap_or_default());
        let what = "name this program otherwise with --set dialects.program_name=NAME, or name another folder";
        Err(CliError::BadInput(format!(
            "--out {}: {name} is a program made from another plan, {made_from}; {what}",
            self.path.display()
        )))
    }

    /// Refuses names under which a file of the user stands: one that Vantage did not write, or that was changed since.
    fn refuse_files_of_the_user(&self, old: &OldFiles, names: &BTreeSet<&str>) -> Result<(), CliError> {
        let of_user: Vec<String> = names
            .iter()
            .filter_map(|name| {
                let path = self.path.join(name);
                let bytes = match fs::read(&path) {
                    Ok(bytes) => bytes,
                    Err(error) if error.kind() == ErrorKind::NotFound => return None,
                    Err(error) => return Some(format!("{name} ({error})")),
                };
                let recorded: Vec<_> = old.files.iter().filter(|file| file.name == *name).collect();
                match recorded.is_empty() {
                    true if !old.has_record && is_program_text(&bytes) => None,
                    true => Some(format!("{name} (not written by Vantage)")),
                    false if self.writer == OutputWriter::Program && is_of_plan_alone(name) => {
                        Some(format!("{name} (a result of `vantage plan`)"))
                    }
                    false if recorded.iter().any(|file| file.sha256 == sha256(&bytes)) => None,
                    false => Some(format!("{name} (changed since Vantage wrote it)")),
                }
            })
            .collect();
        if of_user.is_empty() {
            return Ok(());
        }
        let what = "in the way; move it away or name another folder";
        Err(CliError::BadInput(format!("--out {}: {} {what}", self.path.display(), of_user.join(", "))))
    }

    /// Writes the new files beside the old ones, side by side: each waits for the disk.
    fn stage(
        &self,
        staging: &Path,
        artifacts: &[Artifact],
        timings: Option<&dyn Fn() -> Artifact>,
        origin: &FileOrigin,
    ) -> std::io::Result<Vec<RecordedFile>> {
        // A run that was killed may have left it.
        match fs::remove_dir_all(staging) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
            _ => fs::create_dir(staging)?,
        }
        let stage = |artifact: &Artifact| {
            let written = || write_durably(&staging.join(&*artifact.name), &artifact.bytes);
            let (written, sha256) = rayon::join(written, || sha256(&artifact.bytes));
            written?;
            Ok(RecordedFile {
                name: artifact.name.clone().into_owned(),
                sha256,
                written_by: self.writer.name(),
                plan_sha256: origin.plan_sha256.clone(),
                made_from: origin.made_from.clone(),
            })
        };
        let mut staged = artifacts.par_iter().map(stage).collect::<std::io::Result<Vec<_>>>()?;
        staged.extend(timings.map(|timings| stage(&timings())).transpose()?);
        Ok(staged)
    }

    /// Removes the old files that go and moves the new ones to their places.
    fn swap(
        &self,
        staging: &Path,
        old: &[RecordedFile],
        touched: &BTreeSet<&str>,
        new: &[RecordedFile],
        left: &OutputRecord,
    ) -> std::io::Result<()> {
        // Until the end it names old and new files: whichever of them are there, they are Vantage's.
        self.write_record(&OutputRecord::new([old, new].concat(), false))?;
        for name in touched {
            match fs::remove_file(self.path.join(name)) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
                _ => {}
            }
        }
        for file in new {
            fs::rename(staging.join(&file.name), self.path.join(&file.name))?;
        }
        fs::remove_dir(staging)?;
        if left.files.is_empty() {
            return fs::remove_file(self.path.join(RECORD_FILE));
        }
        self.write_record(left)
    }

    fn write_record(&self, record: &OutputRecord) -> std::io::Result<()> {
        let part = self.path.join(format!(".{RECORD_FILE}.part"));
        write_durably(&part, &record.to_bytes())?;
        fs::rename(&part, self.path.join(RECORD_FILE))
    }

    /// Removes what was staged; the error of the command.
    fn abandon(&self, staging: &Path, error: &std::io::Error) -> CliError {
        // It may not exist.
        let _ = fs::remove_dir_all(staging);
        refused(&self.path, error)
    }
}

/// Files of earlier runs.
struct OldFiles {
    files: Vec<RecordedFile>,
    /// False for a folder of a release without records.
    has_record: bool,
    /// False after a command that was stopped between two renames.
    complete: bool,
}

/// Locks the folder, where the system can.
fn lock(path: &Path) -> Result<Option<File>, CliError> {
    let Ok(folder) = File::open(path) else { return Ok(None) };
    match folder.try_lock() {
        Ok(()) => Ok(Some(folder)),
        Err(TryLockError::WouldBlock) => {
            Err(CliError::BadInput(format!("--out {}: another vantage command is writing to this folder", path.display())))
        }
        Err(TryLockError::Error(_)) => Ok(None),
    }
}

/// Files of a plan or a study in a folder without a record. A plan is known by `plan.json`, a study by having all of its files;
/// programs that were made from the plan by their default name.
fn unrecorded(folder: &Path) -> Vec<RecordedFile> {
    let plan = fs::read(folder.join(PLAN_FILE)).ok().filter(|bytes| is_plan(bytes));
    let plan_sha256 = plan.as_deref().map(sha256);
    let recorded = |name: &str, writer: OutputWriter| {
        let bytes = fs::read(folder.join(name)).ok()?;
        let is_taken = writer != OutputWriter::Program || is_program_text(&bytes);
        let (name, written_by, plan_sha256) = (name.to_owned(), writer.name(), plan_sha256.clone());
        is_taken.then(|| RecordedFile { name, sha256: sha256(&bytes), written_by, plan_sha256, made_from: None })
    };
    let mut found = Vec::new();
    if plan.is_some() {
        let programs = programs(MAX_SETUPS, |_| true);
        let names = FILES_OF_EVERY_PLAN.into_iter().chain(FILES_OF_SOME_PLANS).map(str::to_owned).chain(programs);
        found.extend(names.filter_map(|name| recorded(&name, OutputWriter::Plan)));
        let extensions = Dialect::ALL.into_iter().flat_map(Dialect::outputs).map(|output| output.extension);
        let names = extensions.map(|extension| format!("{DEFAULT_PROGRAM}.{extension}"));
        found.extend(names.filter_map(|name| recorded(&name, OutputWriter::Program)));
    }
    for (study, names) in STUDIES {
        if names.iter().all(|name| folder.join(name).is_file()) {
            found.extend(names.iter().filter_map(|name| recorded(name, OutputWriter::Study(study))));
        }
    }
    found
}

/// Files of each study.
const STUDIES: [(&str, &[&str]); 4] = [
    ("weights", &["weights.csv", "weights-coverage.svg", "weights-grades.svg", "weights.html"]),
    ("limits", &["limits.csv", "limits-coverage.svg", "limits-grades.svg", "limits.html"]),
    ("candidates", &["candidates.csv", "candidates-coverage.svg", "candidates-grades.svg", "candidates.html"]),
    ("reach", &["reach.csv", "reach.svg"]),
];

/// Names of the programs that a plan of so many setups may have, in the languages that its robot takes.
pub(super) fn programs(setups: usize, takes: impl Fn(Dialect) -> bool) -> Vec<String> {
    let dialects = Dialect::ALL.into_iter().filter(|dialect| takes(*dialect));
    let extensions: Vec<&str> = dialects.flat_map(Dialect::outputs).map(|output| output.extension).chain(["json"]).collect();
    let of_setup = |setup: usize| {
        let stem = program_stem(setup);
        extensions.iter().map(move |extension| format!("{stem}.{extension}"))
    };
    (0..setups).flat_map(of_setup).collect()
}

/// Returns true for the name of a plan's file that is not a program for a controller.
fn is_of_plan_alone(name: &str) -> bool {
    let has_name = |known: &[&str]| known.contains(&name);
    has_name(&FILES_OF_EVERY_PLAN)
        || has_name(&FILES_OF_SOME_PLANS)
        || programs(MAX_SETUPS, |_| false).iter().any(|program| program == name)
}

fn is_plan(bytes: &[u8]) -> bool {
    #[derive(Deserialize)]
    struct Head {
        schema: String,
    }
    serde_json::from_slice::<Head>(bytes).is_ok_and(|head| head.schema == PLAN_SCHEMA)
}

/// Returns true for a program that a dialect wrote, by its header, its columns or the first lines of its list of points.
pub(super) fn is_program_text(bytes: &[u8]) -> bool {
    let head = String::from_utf8_lossy(&bytes[..bytes.len().min(HEADER_BYTES)]);
    let is_table = head.starts_with("step,op,j1_deg,");
    let is_list_of_points = head.starts_with("&ACCESS RVP") && head.contains("DEFDAT ");
    is_table || is_list_of_points || head.contains("Vantage scan program")
}

/// Refuses a folder that the last command did not complete, or whose plan is gone.
///
/// # Errors
/// [`CliError::BadInput`].
pub(super) fn check_complete(folder: &Path) -> Result<(), CliError> {
    let Some(record) = fs::read(folder.join(RECORD_FILE)).ok().and_then(|bytes| OutputRecord::parse(&bytes)) else {
        return Ok(());
    };
    let lacks_plan = record.files.iter().any(|file| file.name == PLAN_FILE) && !folder.join(PLAN_FILE).is_file();
    match () {
        () if !record.complete => {
            let what = "holds only some of its files, because the last command that wrote to it was stopped; plan again";
            Err(CliError::BadInput(format!("{}: {what}", folder.display())))
        }
        () if lacks_plan => Err(CliError::BadInput(format!("{}: {PLAN_FILE} is gone; plan again", folder.display()))),
        () => Ok(()),
    }
}

/// Writes a file under a temporary name first, then renames it.
///
/// # Errors
/// [`CliError::Failed`].
pub(super) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let part = path.with_file_name(format!(".{name}.part"));
    write_durably(&part, bytes).and_then(|()| fs::rename(&part, path)).map_err(|error| {
        // It may not exist.
        let _ = fs::remove_file(&part);
        refused(path, &error)
    })
}

/// Writes a file to the disk, so that a rename cannot come before its bytes.
fn write_durably(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(bytes)?;
    file.sync_all()
}

fn sha256(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// Error for a folder that cannot be made.
pub(super) fn not_made(path: &Path, error: &std::io::Error) -> CliError {
    if matches!(error.kind(), ErrorKind::AlreadyExists | ErrorKind::NotADirectory) {
        return CliError::BadInput(format!("--out {}: is a file, or below a file; name a folder", path.display()));
    }
    refused(path, error)
}

/// Error for a place in which nothing can be written.
pub(super) fn refused(path: &Path, error: &std::io::Error) -> CliError {
    let next = if matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded) {
        "free space on its disk, or name a place on another disk"
    } else {
        "name a place where you may write, such as one in your home folder"
    };
    CliError::Failed(format!("--out {}: cannot be written: {error}\n  → {next}", path.display()))
}

#[cfg(test)]
mod tests;
