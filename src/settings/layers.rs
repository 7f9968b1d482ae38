//! The layers of the settings, and the layer that each key comes from.

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::Path;

use config::{Config, ConfigError, Map, Source, Value, ValueKind};
use serde::de::DeserializeOwned;
use toml::de::{DeInteger, DeTable, DeValue};

use super::values::{self, entry};
use super::{Flags, Settings, SettingsError};
use crate::cell::{FieldError, Findings};
use crate::wire::decode;

const PREFIX: &str = "VANTAGE_";
/// Built-in defaults: a file of settings with every key, its meaning and range.
pub const DEFAULTS: &str = include_str!("../../config/default.toml");

/// The merged layers.
pub(super) struct Layers {
    config: Config,
    /// Name of the file of settings.
    file: Option<String>,
    /// Keys whose values come from the environment or a flag: strings, whatever their kind.
    texts: BTreeSet<String>,
}

impl Layers {
    /// Reads and merges all layers.
    ///
    /// # Errors
    /// A layer that cannot be read or parsed.
    pub(super) fn read(
        file: Option<&Path>,
        environment: impl Iterator<Item = (OsString, OsString)>,
        flags: &Flags,
    ) -> Result<Self, SettingsError> {
        let built_in = Tables::parse(None, DEFAULTS).map_err(|error| refused(&error))?;
        let mut builder = Config::builder().add_source(built_in);
        let tables = file.map(of_file).transpose()?;
        // It would replace a section of the file that is no table, such as [[server]] with its key: that is to be refused.
        let would_hide = |key: &str| {
            let section = key.split_once('.').and_then(|(section, _)| tables.as_ref()?.0.get(section));
            section.is_some_and(|section| !matches!(section.kind, ValueKind::Table(_)))
        };
        if let Some(tables) = &tables {
            builder = builder.add_source(tables.clone());
        }
        let mut texts = of_environment(environment)?;
        for (key, value) in flags {
            texts.insert((*key).to_owned(), Text { origin: "a flag".to_owned(), value: value.clone() });
        }
        for (key, text) in texts.iter().filter(|(key, _)| !would_hide(key)) {
            let value = Value::new(Some(&text.origin), text.value.as_str());
            builder = builder.set_override(key, value).map_err(|error| refused(&error))?;
        }
        let config = builder.build().map_err(|error| refused(&error))?;
        let file = file.map(|file| file.display().to_string());
        Ok(Self { config, file, texts: texts.into_keys().collect() })
    }

    /// Deserialises the merged settings; the findings are the numbers out of range.
    ///
    /// # Errors
    /// Values of other kinds than their settings take, unknown keys, and with them the numbers out of range.
    pub(super) fn settings<T: DeserializeOwned>(&self) -> Result<(T, Findings), SettingsError> {
        let built_in = toml::from_str(DEFAULTS).map_err(|error| refused(&error))?;
        let read = values::read(&self.config.cache, &self.texts, built_in);
        let mismatches = read.mismatches.into_result().err().unwrap_or_default();
        match decode(&read.settings) {
            Ok(settings) if mismatches.is_empty() => Ok((settings, read.out_of_range)),
            deserialized => {
                let out_of_range = read.out_of_range.into_result().err().unwrap_or_default();
                let mut lines = self.lines(&mismatches);
                lines.extend(self.lines(&out_of_range));
                lines.extend(self.lines(deserialized.err().as_slice()));
                Err(SettingsError(lines))
            }
        }
    }

    /// Lines for findings in the settings: key, layer and what is wrong.
    pub(super) fn lines(&self, errors: &[FieldError]) -> Vec<String> {
        let key = |error: &FieldError| error.pointer.trim_start_matches('/').replace('/', ".");
        errors.iter().map(|error| self.line(&key(error), &error.detail)).collect()
    }

    fn line(&self, key: &str, what: &str) -> String {
        format!("{key} ({}): {what}", self.origin(key))
    }

    /// Name of the layer that a key comes from.
    fn origin(&self, key: &str) -> &str {
        // A name in quotes may hold a dot of its own.
        let value = key.splitn(2, '.').try_fold(&self.config.cache, entry);
        // A table has no origin, and one that is no section may have no values either: such tables stand in files alone.
        let is_section = !key.contains('.') && Settings::has_section(key);
        let is_table = value.is_some_and(|value| matches!(value.kind, ValueKind::Table(_)));
        let file = self.file.as_deref().filter(|_| is_table && !is_section);
        value.and_then(origin_of).or(file).unwrap_or("config/default.toml, built in")
    }
}

/// Layer of a value; a table has none of its own, but that of one of its values.
fn origin_of(value: &Value) -> Option<&str> {
    let of_table = || if let ValueKind::Table(table) = &value.kind { table.values().filter_map(origin_of).min() } else { None };
    value.origin().or_else(of_table)
}

fn refused(error: &impl std::error::Error) -> SettingsError {
    SettingsError(vec![error.to_string()])
}

/// Tables of a file of settings, with all values as they are written.
#[derive(Clone, Debug)]
struct Tables(Map<String, Value>);

impl Tables {
    fn parse(origin: Option<&String>, text: &str) -> Result<Self, toml::de::Error> {
        Ok(Self(table_of(origin, DeTable::parse(text)?.into_inner())))
    }
}

impl Source for Tables {
    fn clone_into_box(&self) -> Box<dyn Source + Send + Sync> {
        Box::new(self.clone())
    }

    fn collect(&self) -> Result<Map<String, Value>, ConfigError> {
        Ok(self.0.clone())
    }
}

fn table_of(origin: Option<&String>, table: DeTable<'_>) -> Map<String, Value> {
    table.into_iter().map(|(key, value)| (key.into_inner().into_owned(), value_of(origin, value.into_inner()))).collect()
}

/// The value as it is written. The reader of `config` would tell a date as a string, and a large number without its key.
fn value_of(origin: Option<&String>, value: DeValue<'_>) -> Value {
    let kind = match value {
        DeValue::String(text) => ValueKind::String(text.into_owned()),
        DeValue::Integer(number) => integer_of(&number),
        DeValue::Float(number) => ValueKind::Float(number.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(value) => ValueKind::Boolean(value),
        // No setting takes one, and TOML has no other value that is nil.
        DeValue::Datetime(_) => ValueKind::Nil,
        DeValue::Array(values) => {
            ValueKind::Array(values.into_iter().map(|value| value_of(origin, value.into_inner())).collect())
        }
        DeValue::Table(table) => ValueKind::Table(table_of(origin, table)),
    };
    Value::new(origin, kind)
}

/// A whole number; one of more than 128 bits, which no setting takes, as the nearest number.
fn integer_of(number: &DeInteger<'_>) -> ValueKind {
    let (digits, radix) = (number.as_str(), number.radix());
    let small = i64::from_str_radix(digits, radix).map(ValueKind::I64);
    let large = small.or_else(|_| i128::from_str_radix(digits, radix).map(ValueKind::I128));
    large.unwrap_or_else(|_| ValueKind::Float(digits.parse().unwrap_or(f64::INFINITY)))
}

/// Reads a file. A fault is told by its place, not with its line: that may hold a key.
fn of_file(file: &Path) -> Result<Tables, SettingsError> {
    let name = file.display().to_string();
    let refused = |reason: String| SettingsError(vec![format!("--config {name}: {reason}")]);
    let text = std::fs::read_to_string(file).map_err(|error| refused(unread(&error)))?;
    let tables = Tables::parse(Some(&name), &text).map_err(|error| {
        let before = error.span().and_then(|span| text.get(..span.start)).unwrap_or_default();
        let (line, start) = (before.matches('\n').count() + 1, before.rfind('\n').map_or(0, |at| at + 1));
        let column = before[start..].chars().count() + 1;
        refused(format!("line {line}, column {column}: {}", error.message()))
    })?;
    let quoted = quoted_keys(&tables, &name);
    if quoted.is_empty() { Ok(tables) } else { Err(SettingsError(quoted)) }
}

/// Tells why a file of settings cannot be read, and what to give.
fn unread(error: &std::io::Error) -> String {
    let kind = error.kind();
    if kind == ErrorKind::NotFound {
        "there is no such file; `vantage serve --print-defaults > vantage.toml` writes one to start from".to_owned()
    } else if kind == ErrorKind::IsADirectory {
        "is a folder; give a file in it".to_owned()
    } else if kind == ErrorKind::InvalidData {
        "is not a text in UTF-8; give a TOML file".to_owned()
    } else {
        format!("cannot be read: {error}")
    }
}

/// Faults of the keys in quotes that `config` would take for paths: in TOML, `"server.insecure"` is one name and no section, and
/// `"server[0]"` would replace the section, in some runs with what is set in it.
fn quoted_keys(tables: &Tables, name: &str) -> Vec<String> {
    let keys: BTreeSet<&String> = tables.0.keys().filter(|key| key.contains(['.', '['])).collect();
    let fault = |key: &String| {
        let instead = match key.split_once('.').filter(|(section, _)| Settings::has_section(section)) {
            Some((section, setting)) => format!("write {setting} without quotes below [{section}]"),
            None => "remove it; `vantage serve --print-defaults` lists all settings".to_owned(),
        };
        format!("{key:?} ({name}): is a single name because of its quotes, and not a setting; {instead}")
    };
    keys.into_iter().map(fault).collect()
}

/// String of an environment variable or a flag.
struct Text {
    origin: String,
    value: String,
}

/// Variables that are settings, by their keys: of the form `VANTAGE_A__B`. Others with the prefix serve other purposes, unless they
/// are settings but for an underscore.
fn of_environment(environment: impl Iterator<Item = (OsString, OsString)>) -> Result<BTreeMap<String, Text>, SettingsError> {
    let (mut found, mut faults) = (BTreeMap::new(), Vec::new());
    for (name, value) in environment {
        let Some((name, rest)) = name.to_str().and_then(|name| Some((name, name.strip_prefix(PREFIX)?))) else { continue };
        if !rest.contains("__") {
            faults.extend(meant(rest).map(|meant| format!("{name} (the environment): is not a setting; did you mean {meant}?")));
            continue;
        }
        let Some(key) = key_of(rest) else {
            let form = "settings have the form VANTAGE_SECTION__KEY, such as VANTAGE_SERVER__LISTEN";
            faults.push(format!("{name} (the environment): is not a setting; {form}"));
            continue;
        };
        let Ok(value) = value.into_string() else {
            faults.push(format!("{name} (the environment): is not UTF-8; set it to a text in UTF-8"));
            continue;
        };
        let text = Text { origin: format!("{name} in the environment"), value };
        // Which of the two is meant is not known.
        if let Some(other) = found.insert(key, text) {
            faults.push(format!("{name} (the environment): sets the same as {}; unset one of them", other.origin));
        }
    }
    if faults.is_empty() { Ok(found) } else { Err(SettingsError(faults)) }
}

/// Key of a setting, from the name of its variable without the prefix.
fn key_of(rest: &str) -> Option<String> {
    let rest = rest.to_ascii_lowercase();
    let (section, key) = rest.split_once("__")?;
    let is_name = |name: &str| {
        let is_plain = name.bytes().all(|byte| matches!(byte, b'a'..=b'z' | b'0'..=b'9' | b'_'));
        is_plain && !name.is_empty() && !name.contains("__")
    };
    (is_name(section) && is_name(key)).then(|| format!("{section}.{key}"))
}

/// Variable that was meant by a name with too few underscores, or without its section.
fn meant(rest: &str) -> Option<String> {
    let rest = rest.to_lowercase();
    let (section, key) = keys().find(|(section, key)| rest == *key || rest == format!("{section}_{key}"))?;
    Some(format!("{PREFIX}{section}__{key}").to_uppercase())
}

/// Section and name of every setting, also of those that have no default and stand in a comment.
pub(super) fn keys() -> impl Iterator<Item = (&'static str, &'static str)> {
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
