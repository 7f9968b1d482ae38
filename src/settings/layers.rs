//! The layers of the settings, and the layer that each key comes from.

use std::ffi::OsString;
use std::path::Path;

use config::{Config, ConfigError, Environment, File, FileFormat, Value, ValueKind};
use serde::de::DeserializeOwned;

use super::{Flags, SettingsError};
use crate::cell::{expected_value, found_value, with_suggestion};

const PREFIX: &str = "VANTAGE_";
/// Built-in defaults: a file of settings with every key, its meaning and range.
pub const DEFAULTS: &str = include_str!("../../config/default.toml");

/// The merged layers.
pub(super) struct Layers<'a> {
    config: Config,
    flags: &'a Flags,
}

impl<'a> Layers<'a> {
    /// Reads and merges all layers.
    ///
    /// # Errors
    /// A layer that cannot be read or parsed.
    pub(super) fn read(
        file: Option<&Path>,
        environment: impl Iterator<Item = (OsString, OsString)>,
        flags: &'a Flags,
    ) -> Result<Self, SettingsError> {
        let mut builder = Config::builder().add_source(File::from_str(DEFAULTS, FileFormat::Toml));
        if let Some(file) = file {
            check_file(file)?;
            builder = builder.add_source(File::from(file).format(FileFormat::Toml));
        }
        let ours = of_environment(environment)?;
        let environment = Environment::with_prefix("VANTAGE").prefix_separator("_").separator("__");
        builder = builder.add_source(environment.source(Some(ours.into_iter().collect())));
        for (key, value) in flags {
            builder = builder.set_override(key, value.as_str()).map_err(|error| refuse(&error))?;
        }
        Ok(Self { config: builder.build().map_err(|error| refuse(&error))?, flags })
    }

    /// Deserialises the merged settings.
    pub(super) fn settings<T: DeserializeOwned>(&self) -> Result<T, SettingsError> {
        serde_path_to_error::deserialize(self.config.clone()).map_err(|error| {
            let key = error.path().to_string();
            #[expect(clippy::wildcard_enum_match_arm, reason = "config may add kinds of errors, each of which has its own words")]
            let what = match error.inner() {
                ConfigError::At { error, .. } => error.to_string(),
                ConfigError::Type { unexpected, expected, .. } => {
                    format!("is {}, but must be {}", found_value(&unexpected.to_string()), expected_value(expected))
                }
                other => other.to_string(),
            };
            SettingsError(vec![format!("{key} ({}): {}", self.origin(&key), with_suggestion(&what))])
        })
    }

    /// Name of the layer that a key comes from.
    pub(super) fn origin(&self, key: &str) -> String {
        if self.flags.iter().any(|(flag, _)| *flag == key) {
            return "a flag".to_owned();
        }
        let value = key.split('.').try_fold(&self.config.cache, |value, name| {
            if let ValueKind::Table(table) = &value.kind { table.get(name) } else { None }
        });
        value.and_then(origin_of).unwrap_or("config/default.toml, built in").to_owned()
    }
}

/// Layer of a value; a table has none of its own, but that of its first value.
fn origin_of(value: &Value) -> Option<&str> {
    let first = || if let ValueKind::Table(table) = &value.kind { table.values().find_map(origin_of) } else { None };
    value.origin().or_else(first)
}

fn refuse(error: &ConfigError) -> SettingsError {
    SettingsError(vec![error.to_string()])
}

/// Refuses a file that cannot be read or parsed. A fault is told by its place, not with its line: that may hold a key.
fn check_file(file: &Path) -> Result<(), SettingsError> {
    let refused = |reason: String| SettingsError(vec![format!("--config {}: {reason}", file.display())]);
    let text = std::fs::read_to_string(file).map_err(|error| refused(error.to_string()))?;
    let parsed = toml::from_str::<toml::Table>(&text);
    parsed.map(drop).map_err(|error| {
        let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or_default();
        let (line, start) = (before.matches('\n').count() + 1, before.rfind('\n').map_or(0, |at| at + 1));
        let column = before[start..].chars().count() + 1;
        refused(format!("line {line}, column {column}: {}", error.message()))
    })
}

/// Variables that are settings: of the form VANTAGE_A__B. Others that begin with VANTAGE_ serve other purposes, unless they are
/// settings but for an underscore.
fn of_environment(environment: impl Iterator<Item = (OsString, OsString)>) -> Result<Vec<(String, String)>, SettingsError> {
    let (mut found, mut faults) = (Vec::new(), Vec::new());
    for (name, value) in environment {
        let Some((name, rest)) = name.to_str().and_then(|name| Some((name, name.strip_prefix(PREFIX)?))) else { continue };
        if !rest.contains("__") {
            faults.extend(meant(rest).map(|meant| format!("{name} (the environment): is no setting; did you mean {meant}?")));
            continue;
        }
        match value.into_string() {
            Ok(value) => found.push((name.to_owned(), value)),
            Err(_) => faults.push(format!("{name} (the environment): is not UTF-8")),
        }
    }
    if faults.is_empty() { Ok(found) } else { Err(SettingsError(faults)) }
}

/// Variable that was meant by a name with too few underscores, or without its section.
fn meant(rest: &str) -> Option<String> {
    let rest = rest.to_lowercase();
    let (section, key) = keys().find(|(section, key)| rest == *key || rest == format!("{section}_{key}"))?;
    Some(format!("{PREFIX}{section}__{key}").to_uppercase())
}

/// Section and name of every setting, also of those that have no default and stand in a comment.
fn keys() -> impl Iterator<Item = (&'static str, &'static str)> {
    let mut section = "";
    DEFAULTS.lines().filter_map(move |line| {
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')) {
            section = name;
        }
        let (key, _) = line.strip_prefix("# ").unwrap_or(line).split_once(" = ")?;
        let is_key = key.bytes().all(|byte| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'_'));
        is_key.then_some((section, key))
    })
}
