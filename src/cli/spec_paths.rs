//! Paths in specifications. In a file they count from its folder; what a command has read has them from the working folder.

use std::path::{Path, absolute};

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::{CliError, files};
use crate::cell::{FieldError, Presets, SpecKind, SpecLibrary};

/// Fields of specifications that name a file or a preset.
const NAMED: [SpecKind; 4] = [SpecKind::Mesh, SpecKind::Scanner, SpecKind::Robot, SpecKind::Turntable];

/// Puts the folder of `file` before each path in the document that was read from it: of a mesh anywhere, of a device that is no preset.
///
/// # Errors
/// Paths that lead from the working folder alone, with both places.
pub(super) fn place(document: &mut Value, file: &Path) -> Result<(), CliError> {
    let Some(folder) = folder_of(file) else { return Ok(()) };
    let mut misplaced = Vec::new();
    each_name(document, "", &mut |kind, name, pointer| misplaced.extend(place_one(kind, name, folder, pointer)));
    if misplaced.is_empty() { Ok(()) } else { Err(files::findings(&file.display().to_string(), &misplaced)) }
}

/// The specification that was read from `file` as it stands there, with its paths as [`place`] puts them.
///
/// # Errors
/// Errors of [`place`].
pub(super) fn placed<T: Serialize + DeserializeOwned>(spec: &T, file: &Path) -> Result<T, CliError> {
    changed(spec, file, |document| place(document, file))
}

/// The specification as it has to be written to `file`: with paths from its folder where they lie there, else whole ones.
///
/// # Errors
/// [`CliError::Failed`] if it cannot be written at all.
pub(super) fn named_for<T: Serialize + DeserializeOwned>(spec: &T, file: &Path) -> Result<T, CliError> {
    changed(spec, file, |document| {
        each_name(document, "", &mut |kind, name, _| *name = name_for(file, kind, name));
        Ok(())
    })
}

/// Path as a specification that is written to `file` has to name it; the name of a preset stays.
pub(super) fn name_for(file: &Path, kind: SpecKind, name: &str) -> String {
    let (false, Ok(file), Ok(whole)) = (is_preset(kind, name), absolute(file), absolute(name)) else { return name.to_owned() };
    let inside = file.parent().and_then(|folder| whole.strip_prefix(folder).ok());
    let named = inside.unwrap_or(&whole).to_string_lossy().into_owned();
    // Read back, it would be taken for the preset.
    if is_preset(kind, &named) { format!("./{named}") } else { named }
}

fn is_preset(kind: SpecKind, name: &str) -> bool {
    Presets.names(kind).iter().any(|preset| preset == name)
}

fn changed<T: Serialize + DeserializeOwned>(
    spec: &T,
    file: &Path,
    change: impl FnOnce(&mut Value) -> Result<(), CliError>,
) -> Result<T, CliError> {
    let failed = |error: serde_json::Error| CliError::Failed(format!("{}: {error}", file.display()));
    let mut document = serde_json::to_value(spec).map_err(failed)?;
    change(&mut document)?;
    serde_json::from_value(document).map_err(failed)
}

/// Folder that the paths in a file count from, if it is another than the working folder. A pipe lies in none, and neither does a file
/// that is open under a name among the devices.
fn folder_of(file: &Path) -> Option<&Path> {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty() && *folder != Path::new("."))?;
    (file.is_file() && !file.starts_with("/dev")).then_some(folder)
}

/// Calls `visit` for each path and each name of a preset in a specification, with its JSON pointer.
fn each_name(document: &mut Value, at: &str, visit: &mut dyn FnMut(SpecKind, &mut String, String)) {
    match document {
        Value::Object(fields) => {
            for (key, field) in fields {
                let pointer = format!("{at}/{key}");
                match (NAMED.into_iter().find(|kind| kind.as_str() == key), field) {
                    (Some(kind), Value::String(name)) => visit(kind, name, pointer),
                    (_, field) => each_name(field, &pointer, visit),
                }
            }
        }
        Value::Array(items) => {
            for (index, item) in items.iter_mut().enumerate() {
                each_name(item, &format!("{at}/{index}"), visit);
            }
        }
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => {}
    }
}

/// Puts the folder before a path; the error for one that leads from the working folder alone. A name that could be one of a preset
/// stays, so that it is told as unknown, and so does an empty one.
fn place_one(kind: SpecKind, name: &mut String, folder: &Path, pointer: String) -> Option<FieldError> {
    if name.is_empty() || is_preset(kind, name) {
        return None;
    }
    let placed = folder.join(&*name);
    if !placed.exists() && Path::new(name).exists() {
        let (placed, folder) = (placed.display(), folder.display());
        let detail = format!(
            "is {name:?}, and there is no {placed}: paths in a file count from its folder, not from the working folder, which has \
             {name}; give the path from {folder}, or the whole one"
        );
        return Some(FieldError { pointer, detail });
    }
    if placed.exists() || Path::new(name).extension().is_some() {
        *name = placed.to_string_lossy().into_owned();
    }
    None
}

#[cfg(test)]
mod tests;
