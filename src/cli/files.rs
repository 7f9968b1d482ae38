//! Files that commands read: specifications and parameters in TOML or JSON, meshes, and messages that say what is wrong
//! in them and where.

use std::path::Path;

use serde::de::DeserializeOwned;
use serde_json::Value;
use sha2::{Digest, Sha256};

use super::CliError;
use crate::cell::{CellSpec, FieldError, Presets, RobotSpec, ScannerSpec, SpecKind, SpecLibrary, TurntableSpec};
use crate::geometry::mesh_io::{self, Limits, ReadMesh};
use crate::geometry::{LengthUnit, Mesh};
use crate::service::hex;

/// Finds specifications among the presets, else as files; meshes as files in millimetres.
#[derive(Clone, Copy, Debug, Default)]
pub struct FileLibrary;

impl FileLibrary {
    fn file<T: DeserializeOwned>(kind: SpecKind, path: &str) -> Option<T> {
        let read = value(Path::new(path)).and_then(|value| from_value(value, path));
        // A library answers with or without; what is wrong with a file is said where it is found.
        read.inspect_err(|error| eprintln!("{} {path}: {error}", kind.as_str())).ok()
    }
}

impl SpecLibrary for FileLibrary {
    fn scanner(&self, name: &str) -> Option<ScannerSpec> {
        Presets.scanner(name).or_else(|| Self::file(SpecKind::Scanner, name))
    }

    fn robot(&self, name: &str) -> Option<RobotSpec> {
        Presets.robot(name).or_else(|| Self::file(SpecKind::Robot, name))
    }

    fn turntable(&self, name: &str) -> Option<TurntableSpec> {
        Presets.turntable(name).or_else(|| Self::file(SpecKind::Turntable, name))
    }

    fn cell(&self, name: &str) -> Option<CellSpec> {
        Presets.cell(name).or_else(|| Self::file(SpecKind::Cell, name))
    }

    fn mesh(&self, name: &str) -> Option<Mesh> {
        let read = mesh(Path::new(name), Some(LengthUnit::Millimetre));
        read.inspect_err(|error| eprintln!("mesh {name}: {error}")).ok().map(|(read, _)| read.mesh)
    }

    fn names(&self, kind: SpecKind) -> Vec<String> {
        Presets.names(kind)
    }
}

/// A specification by a preset's name or a file's path.
///
/// # Errors
/// Neither a preset nor a readable file of this shape.
pub fn spec<T: DeserializeOwned>(kind: SpecKind, name: &str, preset: Option<T>) -> Result<T, CliError> {
    if let Some(preset) = preset {
        return Ok(preset);
    }
    if !Path::new(name).exists() {
        let known = Presets.names(kind).join(", ");
        return Err(CliError::BadInput(format!(
            "--{kind} {name}: is no file and no preset; presets are {known}",
            kind = kind.as_str()
        )));
    }
    from_value(value(Path::new(name))?, name)
}

/// A TOML or JSON file as a value: JSON when it begins with a brace.
///
/// # Errors
/// Unreadable, or neither.
pub fn value(path: &Path) -> Result<Value, CliError> {
    let shown = path.display();
    let text = std::fs::read_to_string(path).map_err(|error| CliError::BadInput(format!("{shown}: {error}")))?;
    let read = if text.trim_start().starts_with('{') {
        serde_json::from_str(&text).map_err(|error| error.to_string())
    } else {
        toml::from_str(&text).map_err(|error| error.to_string())
    };
    read.map_err(|error| CliError::BadInput(format!("{shown}: {error}")))
}

/// A value as `T`; errors carry the JSON pointer.
///
/// # Errors
/// Another shape.
pub fn from_value<T: DeserializeOwned>(value: Value, what: &str) -> Result<T, CliError> {
    serde_path_to_error::deserialize(value).map_err(|error| {
        let pointer: String =
            error.path().to_string().split('.').filter(|part| *part != ".").map(|part| format!("/{part}")).collect();
        CliError::BadInput(format!("{what}: {}: {}", pointer, error.inner()))
    })
}

/// Every finding on a line of its own.
#[must_use]
pub fn findings(what: &str, errors: &[FieldError]) -> CliError {
    let lines: Vec<_> = errors.iter().map(|error| format!("{what}: {error}")).collect();
    CliError::BadInput(lines.join("\n"))
}

/// A mesh file, with the SHA-256 of its bytes in lower-case hexadecimal.
///
/// # Errors
/// Unreadable, or no usable mesh.
pub fn mesh(path: &Path, unit: Option<LengthUnit>) -> Result<(ReadMesh, String), CliError> {
    let refuse = |error: String| CliError::BadInput(format!("{}: {error}", path.display()));
    let bytes = std::fs::read(path).map_err(|error| refuse(error.to_string()))?;
    let read = mesh_io::read(&bytes, unit, &Limits::default()).map_err(|error| refuse(error.to_string()))?;
    Ok((read, hex(&Sha256::digest(&bytes))))
}
