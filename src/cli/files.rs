//! Input files of commands: specifications and parameters in TOML or JSON, and meshes; errors say what is wrong and where.

use std::fs::File;
use std::io::ErrorKind;
use std::path::Path;
use std::string::FromUtf8Error;
use std::sync::Arc;

use serde::de::DeserializeOwned;
use serde_json::Value;
use utoipa::ToSchema;

use super::{CliError, FileFinding, out, spec_paths};
use crate::cell::{
    CellSpec, ControllersSpec, Dialect, FieldError, NotFound, Presets, RobotSpec, ScannerSpec, SpecKind, SpecLibrary,
    TurntableSpec, did_you_mean,
};
use crate::check::kind_of;
use crate::geometry::mesh_io::{self, Limits, MeshError, ReadError, ReadMesh};
use crate::geometry::{LengthUnit, Mesh, Poll};
use crate::service::plan_job::PLAN_FILE;
use crate::service::runs::cell_sha256;
use crate::service::{HashingReader, OperatorCell};
use crate::settings::Settings;
use crate::wire::{self, Distinct, DocumentKind, given_twice, json_error};

/// Library of presets, then of files; meshes are files in millimetres.
#[derive(Clone, Copy, Debug, Default)]
pub struct FileLibrary;

impl FileLibrary {
    fn file<T: DeserializeOwned + ToSchema + 'static>(kind: SpecKind, path: &str) -> Result<T, NotFound> {
        let read = existing(path)?;
        spec_value(read).and_then(|value| of_kind(value, kind_of_spec(kind), path)).map_err(unusable)
    }
}

impl SpecLibrary for FileLibrary {
    fn scanner(&self, name: &str) -> Result<ScannerSpec, NotFound> {
        Presets.scanner(name).or_else(|_| Self::file(SpecKind::Scanner, name))
    }

    fn robot(&self, name: &str) -> Result<RobotSpec, NotFound> {
        Presets.robot(name).or_else(|_| Self::file(SpecKind::Robot, name))
    }

    fn turntable(&self, name: &str) -> Result<TurntableSpec, NotFound> {
        Presets.turntable(name).or_else(|_| Self::file(SpecKind::Turntable, name))
    }

    fn cell(&self, name: &str) -> Result<CellSpec, NotFound> {
        Presets.cell(name).or_else(|_| cell(existing(name)?.to_string_lossy().as_ref()).map(|(spec, _)| spec).map_err(unusable))
    }

    fn mesh(&self, name: &str) -> Result<Arc<Mesh>, NotFound> {
        let read = mesh(existing(name)?, Some(LengthUnit::Millimetre), &Poll::never());
        read.map(|(read, _)| Arc::new(read.mesh)).map_err(unusable)
    }

    fn names(&self, kind: SpecKind) -> Vec<String> {
        Presets.names(kind)
    }
}

/// Path of an existing file or folder.
fn existing(path: &str) -> Result<&Path, NotFound> {
    let path = Path::new(path);
    // A name with an extension is no preset.
    let missing = || match path.extension() {
        Some(_) => NotFound::Unusable("there is no such file".to_owned()),
        None => NotFound::Unknown,
    };
    if path.exists() { Ok(path) } else { Err(missing()) }
}

fn unusable(error: CliError) -> NotFound {
    NotFound::Unusable(error.to_string().replace('\n', "; "))
}

/// Loads a specification by the name of a preset or the path of a file.
///
/// # Errors
/// Neither a preset nor a readable file of the right structure.
pub fn spec<T: DeserializeOwned + ToSchema + 'static>(
    kind: SpecKind,
    name: &str,
    preset: Result<T, NotFound>,
) -> Result<T, CliError> {
    if let Ok(preset) = preset {
        return Ok(preset);
    }
    if name.is_empty() {
        let (kind, known) = (kind.as_str(), Presets.names(kind).join(", "));
        return Err(CliError::BadInput(format!("--{kind}: is empty; give a file or a preset; the presets are {known}")));
    }
    if !Path::new(name).exists() {
        if let Some(instead) = preset_of_another_kind(name, kind) {
            return Err(CliError::BadInput(format!("--{} {name}: {instead}", kind.as_str())));
        }
        let names = Presets.names(kind);
        let (known, question) = (names.join(", "), did_you_mean(name, names.iter().map(String::as_str)));
        return Err(CliError::BadInput(format!(
            "--{kind} {name}: no such file or preset; the presets are {known}{question}",
            kind = kind.as_str()
        )));
    }
    of_kind(spec_value(Path::new(name))?, kind_of_spec(kind), name)
}

/// Loads a cell by the name of a preset or the path of a file, with its controllers if the file has some.
///
/// # Errors
/// Neither a preset nor a readable file of the right structure; controllers out of range.
pub fn cell(name: &str) -> Result<(CellSpec, Option<ControllersSpec>), CliError> {
    if Presets.cell(name).is_ok() || !Path::new(name).exists() {
        return spec(SpecKind::Cell, name, Presets.cell(name)).map(|spec| (spec, None));
    }
    let mut value = spec_value(Path::new(name))?;
    let controllers = take_controllers(&mut value, name);
    Ok((of_kind(value, kind_of_spec(SpecKind::Cell), name)?, controllers?))
}

/// Takes the section `[controllers]` out of a cell file, and checks it.
///
/// # Errors
/// Every finding in it.
pub fn take_controllers(file: &mut Value, what: &str) -> Result<Option<ControllersSpec>, CliError> {
    let Some(section) = ControllersSpec::take_section(file) else { return Ok(None) };
    let below = |errors: Vec<FieldError>| {
        let errors: Vec<_> = errors.into_iter().map(|error| error.below(&format!("/{}", ControllersSpec::SECTION))).collect();
        findings(what, &errors)
    };
    let spec: ControllersSpec = wire::from_value(&section).map_err(below)?;
    spec.check().map_err(below)?;
    Ok(Some(spec))
}

/// Loads the cell of an operator's file with its controllers, and checks both.
///
/// # Errors
/// A file that cannot be used, or that names no controllers.
pub fn operator_cell(path: &str) -> Result<OperatorCell, CliError> {
    let (mut spec, controllers) = cell(path)?;
    let controllers = controllers.ok_or_else(|| {
        CliError::BadInput(format!("{path}: has no section [controllers]; add one, or take the file out of execution.cells"))
    })?;
    spec.inline_devices(&FileLibrary);
    spec.build(&FileLibrary).map_err(|errors| findings(path, &errors))?;
    Ok(OperatorCell { name: spec.name.clone(), cell_sha256: cell_sha256_of(&spec)?, controllers })
}

/// Digest of a cell with its devices inlined, whose meshes are files in millimetres.
///
/// # Errors
/// [`CliError::Failed`] if it cannot be written as JSON.
pub fn cell_sha256_of(spec: &CellSpec) -> Result<String, CliError> {
    let content_of = |path: &str| {
        let (_, sha256) = mesh(Path::new(path), Some(LengthUnit::Millimetre), &Poll::never()).ok()?;
        Some(format!("{sha256} {}", LengthUnit::Millimetre))
    };
    cell_sha256(spec, &content_of).map_err(|error| CliError::Failed(format!("the cell: {error}")))
}

/// Reads a TOML or JSON file as a value; a file that begins with a brace is JSON.
///
/// # Errors
/// A file that cannot be read, or is neither.
pub fn value(path: &Path) -> Result<Value, CliError> {
    let refuse = |error: String| CliError::BadInput(format!("{}: {error}", path.display()));
    if path.is_dir() {
        let example = if path.join(PLAN_FILE).is_file() { format!(", such as {PLAN_FILE}") } else { String::new() };
        return Err(refuse(format!("is a folder; give a file in it{example}")));
    }
    let bytes = std::fs::read(path).map_err(|error| unreadable(path, &error))?;
    refuse_mesh(path, "a TOML or JSON file")?;
    let text = String::from_utf8(bytes).map_err(|error| {
        let bytes = error.as_bytes();
        let is_utf_16 = matches!(bytes, [0xff, 0xfe, 1..=255, 0, ..] | [0xfe, 0xff, 0, 1..=255, ..]);
        let is_binary = bytes.contains(&0) && !is_utf_16;
        refuse(if is_binary { "not a TOML or JSON file".to_owned() } else { other_encoding(bytes) })
    })?;
    if text.contains('\0') {
        return Err(refuse("not a TOML or JSON file".to_owned()));
    }
    let text = without_byte_order_mark(&text);
    let read = if text.trim_start().starts_with('{') {
        serde_json::from_str(text).map_err(|error| json_fault(text, &error))
    } else {
        toml::from_str(text).map_err(|error| match foreign_text(path, text) {
            Some(found) => format!("{}, not a TOML or JSON file", found.as_str()),
            None => toml_fault(text, &error),
        })
    };
    read.map(|Distinct(value)| value).map_err(refuse)
}

/// Kind of a text that is neither TOML nor JSON.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ForeignText {
    HtmlPage,
    Xml,
    Table,
    PlainText,
    ControllerProgram,
}

impl ForeignText {
    /// Description that follows the name of the file.
    fn as_str(self) -> &'static str {
        match self {
            Self::HtmlPage => "is an HTML page, such as a report",
            Self::Xml => "is an XML file",
            Self::Table => "is a table",
            Self::PlainText => "is a plain text, such as a report",
            Self::ControllerProgram => "is a program in the language of a controller",
        }
    }
}

/// Recognises a text that is neither TOML nor JSON; `None` if it may be meant for one of them.
pub(super) fn foreign_text(path: &Path, text: &str) -> Option<ForeignText> {
    let text = without_byte_order_mark(text).trim_start();
    let begins = |tag: &str| text.get(..tag.len()).is_some_and(|head| head.eq_ignore_ascii_case(tag));
    if begins("<!doctype html") || begins("<html") {
        return Some(ForeignText::HtmlPage);
    }
    if begins("<") {
        return Some(ForeignText::Xml);
    }
    let is_named = |ending: &str| path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending));
    if is_named("csv") || is_named("tsv") {
        return Some(ForeignText::Table);
    }
    // Further files of a program are known by their content: many programs write tables named .dat, as KRL's is.
    let mut of_controllers = Dialect::ALL.into_iter().filter_map(|dialect| dialect.outputs().first());
    if out::is_program_text(text.as_bytes()) || of_controllers.any(|output| is_named(output.extension)) {
        return Some(ForeignText::ControllerProgram);
    }
    // The first line of TOML is a comment, a table or a value.
    let is_prose = !text.starts_with(['#', '[']) && text.lines().next().is_some_and(|line| !line.contains('='));
    (is_named("txt") && is_prose).then_some(ForeignText::PlainText)
}

/// Tells what a file is that is not `wanted`, such as "a mesh or a scanner", of the kind `kind` if it is recognised by one, and
/// the command that takes it; `None` if that is not known. XML may be many things, and is left to the reader.
pub(super) fn instead_of_file(path: &Path, (wanted, kind): (&str, Option<DocumentKind>)) -> Option<String> {
    if is_mesh_name(path) {
        return None;
    }
    let Ok(document) = value(path) else {
        let found = foreign_text(path, &std::fs::read_to_string(path).ok()?)?;
        return (found != ForeignText::Xml).then(|| format!("{}, not {wanted}", found.as_str()));
    };
    if is_server_configuration(&document) {
        return Some(SERVER_CONFIGURATION.to_owned());
    }
    // A mesh in glTF has materials, as parameters have.
    if document.get("asset").is_some() {
        return None;
    }
    let Some(found) = kind_of(&document) else {
        let schema = document["schema"].as_str().filter(|schema| schema.starts_with("vantage."))?;
        return Some(format!("is a document of schema {schema:?}, not {wanted}"));
    };
    let (description, place) = told_of(found);
    let is_checked = found != DocumentKind::Params;
    let check = if is_checked { format!("`vantage check {}` checks it, and ", path.display()) } else { String::new() };
    (kind != Some(found)).then(|| format!("{description}, not {wanted}; {check}{place}"))
}

/// Reads a text in UTF-8.
///
/// # Errors
/// A file that cannot be read, or is in another encoding.
pub(super) fn text(path: &Path) -> Result<String, CliError> {
    let bytes = std::fs::read(path).map_err(|error| unreadable(path, &error))?;
    let refuse = |error: FromUtf8Error| CliError::BadInput(format!("{}: {}", path.display(), other_encoding(error.as_bytes())));
    String::from_utf8(bytes).map_err(refuse)
}

/// Tells what bytes are that are not a text in UTF-8, and what to do.
pub(super) fn other_encoding(bytes: &[u8]) -> String {
    if bytes.starts_with(b"PK\x03\x04") {
        return "is a workbook or another ZIP archive; save its table as CSV in UTF-8".to_owned();
    }
    if bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff") {
        return "is a text in UTF-16; save it in UTF-8".to_owned();
    }
    let read = bytes.utf8_chunks().next().map_or("", |chunk| chunk.valid());
    format!("line {}: is not in UTF-8; save the file as text in UTF-8", read.matches('\n').count() + 1)
}

/// The text without the byte order mark that some editors begin UTF-8 with: JSON knows none, and a value would keep it.
pub(super) fn without_byte_order_mark(text: &str) -> &str {
    text.strip_prefix('\u{feff}').unwrap_or(text)
}

/// Reads a document as [`value`] does; the paths in a specification, which count from the folder of its file, then lead from the working
/// folder.
///
/// # Errors
/// Errors of [`value`] and [`spec_paths::place`].
pub(super) fn spec_value(path: &Path) -> Result<Value, CliError> {
    let mut document = value(path)?;
    let is_hardware = kind_of(&document).is_some_and(|kind| match kind {
        DocumentKind::Cell | DocumentKind::Robot | DocumentKind::Scanner | DocumentKind::Turntable => true,
        DocumentKind::Params | DocumentKind::Plan | DocumentKind::Program => false,
    });
    if is_hardware {
        spec_paths::place(&mut document, path)?;
    }
    Ok(document)
}

/// Error for a file that cannot be read; of one that does not exist it tells a file beside it with nearly the same name.
pub(super) fn unreadable(path: &Path, error: &std::io::Error) -> CliError {
    if path.is_dir() {
        return CliError::BadInput(format!("{}: is a folder; give a file in it", path.display()));
    }
    if error.kind() == ErrorKind::PermissionDenied {
        let instead = "cannot be read: permission denied; give yourself permission to read it";
        return CliError::BadInput(format!("{}: {instead}", path.display()));
    }
    if error.kind() != ErrorKind::NotFound {
        return CliError::BadInput(format!("{}: {error}", path.display()));
    }
    if path == Path::new("-") {
        // Some programs take a dash for standard input.
        let instead = "standard input is not read; write it to a file and give that file's name";
        return CliError::BadInput(format!("-: {instead}"));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Ok(entries) = std::fs::read_dir(folder) else {
        return CliError::BadInput(format!("{}: there is no folder {}", path.display(), folder.display()));
    };
    // Not folders: one that this command has just made for its results has nearly the same name.
    let files = entries.flatten().filter(|entry| entry.path().is_file());
    let mut names: Vec<String> = files.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort_unstable();
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let question = did_you_mean(&name, names.iter().map(String::as_str));
    CliError::BadInput(format!("{}: there is no such file{question}", path.display()))
}

/// Refuses the name of a file or folder that is not there.
///
/// # Errors
/// The error of [`unreadable`].
pub(super) fn require_existing(path: &Path) -> Result<(), CliError> {
    std::fs::metadata(path).map(drop).map_err(|error| unreadable(path, &error))
}

/// Refuses a mesh where a text is to be read: `wanted`, such as "a URDF file".
///
/// # Errors
/// [`CliError::BadInput`] for the name of a mesh file.
pub(super) fn refuse_mesh(path: &Path, wanted: &str) -> Result<(), CliError> {
    if !is_mesh_name(path) {
        return Ok(());
    }
    let what = format!("is a mesh, not {wanted}; `vantage inspect` examines it");
    Err(CliError::BadInput(format!("{}: {what}", path.display())))
}

/// Describes the error in a JSON file; one that ends too early is cut off.
pub(super) fn json_fault(text: &str, error: &serde_json::Error) -> String {
    let told = json_error(text.as_bytes(), error);
    if error.is_eof() && !text.trim().is_empty() { format!("the file is cut off: {told}") } else { told }
}

/// Returns true for the name of a mesh file.
fn is_mesh_name(path: &Path) -> bool {
    let extension = path.extension().map(|extension| extension.to_ascii_lowercase());
    ["stl", "obj", "ply"].iter().any(|mesh| extension.as_deref().is_some_and(|found| found == *mesh))
}

/// Tells what a document is that holds no parameters, and where it belongs; `None` if it may be meant for parameters.
pub(super) fn instead_of_parameters(document: &Value) -> Option<String> {
    let kind = kind_of(document);
    match kind {
        None if is_server_configuration(document) => Some(SERVER_CONFIGURATION.to_owned()),
        None | Some(DocumentKind::Params) => None,
        Some(DocumentKind::Plan) => Some("is a plan, not parameters; its field `params` has the parameters".to_owned()),
        Some(kind) => Some(instead_of("parameters", kind)),
    }
}

/// Tells the kind of a document that is not what is wanted, and where it belongs.
fn instead_of(wanted: &str, found: DocumentKind) -> String {
    let (description, place) = told_of(found);
    format!("{description}, not {wanted}; {place}")
}

/// Description of a kind of document, and where it belongs.
fn told_of(kind: DocumentKind) -> (&'static str, &'static str) {
    match kind {
        DocumentKind::Scanner => ("is a scanner", "--scanner takes it, with --cell none"),
        DocumentKind::Cell => ("is a cell", "--cell takes it"),
        DocumentKind::Robot => ("is a robot", "a cell names it"),
        DocumentKind::Turntable => ("is a turntable", "a cell names it"),
        DocumentKind::Params => ("holds parameters of a plan", "--params takes it"),
        DocumentKind::Plan => ("is a plan", "`vantage program` takes it with its program"),
        DocumentKind::Program => ("is a program", "`vantage run` takes it"),
    }
}

/// Converts a document to `T`, which is `wanted`, such as "a cell", of the kind `kind` if it is recognised by one.
///
/// # Errors
/// A document of another kind as such; else every field that is missing or unknown.
pub(super) fn of_kind<T: DeserializeOwned + ToSchema + 'static>(
    value: Value,
    (wanted, kind): (&str, Option<DocumentKind>),
    what: &str,
) -> Result<T, CliError> {
    let found = kind_of(&value).filter(|found| Some(*found) != kind);
    from_value(value, what).map_err(|error| match found {
        Some(found) => CliError::BadInput(format!("{what}: {}", instead_of(wanted, found))),
        None => error,
    })
}

/// Kind of a document that specifies hardware, as [`of_kind`] takes it.
fn kind_of_spec(kind: SpecKind) -> (&'static str, Option<DocumentKind>) {
    match kind {
        SpecKind::Scanner => ("a scanner", Some(DocumentKind::Scanner)),
        SpecKind::Robot => ("a robot", Some(DocumentKind::Robot)),
        SpecKind::Turntable => ("a turntable", Some(DocumentKind::Turntable)),
        SpecKind::Cell => ("a cell", Some(DocumentKind::Cell)),
        SpecKind::Mesh => ("a mesh", None),
    }
}

/// Tells the kind of a preset of this name, where it is of another kind than `wanted`.
fn preset_of_another_kind(name: &str, wanted: SpecKind) -> Option<String> {
    let kinds = [SpecKind::Scanner, SpecKind::Robot, SpecKind::Turntable, SpecKind::Cell];
    let found = kinds.into_iter().find(|kind| *kind != wanted && Presets.names(*kind).iter().any(|preset| preset == name))?;
    kind_of_spec(found).1.map(|found| instead_of(kind_of_spec(wanted).0, found))
}

/// Description of a file of the server's settings, for a command that does not take it.
pub(super) const SERVER_CONFIGURATION: &str = "is a configuration file of the server; `vantage serve --config` takes it";

/// Returns true for a document that has sections of the server's settings and nothing else.
pub(super) fn is_server_configuration(document: &Value) -> bool {
    let sections = document.as_object().filter(|sections| !sections.is_empty());
    sections.is_some_and(|sections| sections.keys().all(|section| Settings::has_section(section)))
}

/// Describes the error in a TOML file, on one line.
pub(super) fn toml_fault(text: &str, error: &toml::de::Error) -> String {
    let before = error.span().and_then(|span| text.get(..span.start));
    let place = before.map(|before| {
        let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
        (before.matches('\n').count() + 1, column)
    });
    let message = error.message().trim_end().replace('\n', ", ");
    let found = error.span().and_then(|span| text.get(span.start..)).and_then(|rest| rest.split(['=', ']', '\n']).next());
    if let Some(key) = found.filter(|_| message == "duplicate key") {
        let place = place.map(|(line, column)| format!(" (line {line}, column {column})"));
        return format!("{}{}", given_twice(key.trim().trim_matches('"')), place.unwrap_or_default());
    }
    let place = place.map(|(line, column)| format!(" at line {line} column {column}"));
    let advice = if has_decimal_comma(text, error) { "; use a point as decimal separator" } else { "" };
    format!("{message}{}{advice}", place.unwrap_or_default())
}

/// Returns true if an error in a TOML file lies at a comma between the digits of a number.
fn has_decimal_comma(text: &str, error: &toml::de::Error) -> bool {
    let place = error.span().map_or(0, |span| span.start);
    let (Some(before), Some(after)) = (text.get(..place), text.get(place..)) else { return false };
    let line = before.rsplit('\n').next().unwrap_or_default();
    let value = line.rsplit('=').next().unwrap_or_default().trim();
    let is_number = |text: &str| !text.is_empty() && text.chars().all(|c| c.is_ascii_digit());
    let fraction: String = after.chars().skip(1).take_while(char::is_ascii_digit).collect();
    after.starts_with(',') && is_number(value.trim_start_matches(['-', '+'])) && !fraction.is_empty()
}

/// Converts a value to `T`; errors carry the JSON pointer.
///
/// # Errors
/// A value of another structure: every field that is missing or unknown, a line each.
pub fn from_value<T: DeserializeOwned + ToSchema + 'static>(value: Value, what: &str) -> Result<T, CliError> {
    wire::from_value(&value).map_err(|errors| findings(what, &errors))
}

/// Error that lists every finding on a line of its own.
#[must_use]
pub fn findings(what: &str, errors: &[FieldError]) -> CliError {
    let finding =
        |error: &FieldError| FileFinding { file: what.to_owned(), pointer: error.pointer.clone(), detail: error.detail.clone() };
    CliError::Findings(errors.iter().map(finding).collect())
}

/// Writes a file that a command was asked for, whole or not at all; what is not a file, such as a pipe, is written as it is.
///
/// # Errors
/// [`CliError::BadInput`] for a path that can be no file, [`CliError::Failed`] if the system refuses, as a full disk does.
pub(super) fn write(path: &Path, bytes: &[u8]) -> Result<(), CliError> {
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty());
    if path.is_dir() || parent.is_some_and(|parent| !parent.is_dir()) {
        let reason = if path.is_dir() { "is a folder; name a file" } else { "its folder does not exist" };
        return Err(CliError::BadInput(format!("{}: {reason}", path.display())));
    }
    if !path.exists() || path.is_file() {
        return out::write_file(path, bytes);
    }
    match std::fs::write(path, bytes) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(CliError::Failed(format!("{}: cannot be written: {error}", path.display())))
        }
        Ok(()) | Err(_) => Ok(()),
    }
}

/// Reads a mesh file, and the SHA-256 of its bytes in lower-case hexadecimal.
///
/// # Errors
/// A file that cannot be read or is not a usable mesh; [`CliError::Cancelled`] once `poll` says to stop.
pub fn mesh(path: &Path, unit: Option<LengthUnit>, poll: &Poll<'_>) -> Result<(ReadMesh, String), CliError> {
    mesh_in_steps(path, unit, poll, || ())
}

/// Reads a mesh file as [`mesh`] does; calls `is_read` when its bytes are read and its mesh is to be welded and assessed.
///
/// # Errors
/// Errors of [`mesh`].
pub(super) fn mesh_in_steps(
    path: &Path,
    unit: Option<LengthUnit>,
    poll: &Poll<'_>,
    is_read: impl FnOnce(),
) -> Result<(ReadMesh, String), CliError> {
    let refuse = |error: std::io::Error| unreadable(path, &error);
    if path.is_dir() {
        let detail = "is a folder; give the mesh files in it by their names";
        return Err(CliError::BadInput(format!("{}: {detail}", path.display())));
    }
    let mut file = HashingReader::new(File::open(path).map_err(refuse)?);
    let length_bytes = path.metadata().map_err(refuse)?.len();
    let limits = Limits::default();
    let parsed =
        mesh_io::parse_from(&mut file, length_bytes, unit, &limits, poll).map_err(|error| unusable_mesh(path, &error))?;
    let sha256 = file.finish(poll).map_err(refuse)?.ok_or_else(|| unusable_mesh(path, &MeshError::Interrupted.into()))?;
    is_read();
    let read = parsed.finished().map_err(|error| unusable_mesh(path, &error.into()))?;
    Ok((read, sha256))
}

/// Error for a file that is not a usable mesh; if its unit is missing, the error names the option that gives it, and if it is another
/// document, what it is and the command that takes it.
#[must_use]
pub fn unusable_mesh(path: &Path, error: &ReadError) -> CliError {
    match error {
        ReadError::Mesh(MeshError::Interrupted) => CliError::Cancelled("interrupted; nothing was written".into()),
        ReadError::Mesh(MeshError::UnitMissing) => CliError::BadInput(format!("{}: {error} with --unit", path.display())),
        ReadError::Mesh(MeshError::UnknownFormat | MeshError::FormatNotRead { .. }) => {
            let what = instead_of_file(path, ("a mesh", None)).unwrap_or_else(|| error.to_string());
            CliError::BadInput(format!("{}: {what}", path.display()))
        }
        ReadError::Mesh(_) | ReadError::Io(_) => CliError::BadInput(format!("{}: {error}", path.display())),
    }
}
