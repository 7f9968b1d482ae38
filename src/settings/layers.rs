//! The layers of the settings, and the layer that each key comes from.

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
        environment: impl Iterator<Item = (String, String)>,
        flags: &'a Flags,
    ) -> Result<Self, SettingsError> {
        let mut builder = Config::builder().add_source(File::from_str(DEFAULTS, FileFormat::Toml));
        if let Some(file) = file {
            builder = builder.add_source(File::from(file).format(FileFormat::Toml));
        }
        // Only names of the form VANTAGE_A__B are settings; other VANTAGE_ variables serve other purposes.
        let ours = environment.filter(|(name, _)| name.strip_prefix(PREFIX).is_some_and(|name| name.contains("__")));
        let environment = Environment::with_prefix("VANTAGE").prefix_separator("_").separator("__");
        builder = builder.add_source(environment.source(Some(ours.collect())));
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
