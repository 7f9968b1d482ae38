//! Values of `--set`: JSON, else a string; `@FILE` stands for the content of a file.

use std::path::Path;

use serde_json::Value;

use super::files;
use crate::wire::Distinct;

/// The value of a parameter `key`.
///
/// # Errors
/// The reason why the file that it names cannot be used, or the field that an object has twice.
pub(super) fn parse(key: &str, text: &str) -> Result<Value, String> {
    match text.strip_prefix('@') {
        Some(path) => of_file(key, Path::new(path)),
        None => json_or_text(text),
    }
}

/// The content of a file: by its extension JSON or TOML, else JSON if it is that, else a text without its last line end. A TOML
/// file is always a table; if all that it has is a field named like the parameter, its value is meant.
fn of_file(key: &str, path: &Path) -> Result<Value, String> {
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    if extension.as_deref() == Some("toml") {
        return files::value(path).map(|table| unwrapped(key, table)).map_err(|error| error.to_string());
    }
    let refuse = |error: String| format!("{}: {error}", path.display());
    let text = files::text(path).map_err(|error| error.to_string())?;
    let text = files::without_byte_order_mark(&text);
    match extension.as_deref() {
        Some("json") => {
            let read = serde_json::from_str(text).map_err(|error| refuse(files::json_fault(text, &error)));
            read.map(|Distinct(value)| value)
        }
        _ => json_or_text(text.strip_suffix('\n').map_or(text, |line| line.strip_suffix('\r').unwrap_or(line))).map_err(refuse),
    }
}

fn json_or_text(text: &str) -> Result<Value, String> {
    match serde_json::from_str(text) {
        Ok(Distinct(value)) => Ok(value),
        // What is JSON but for a field that an object has twice is meant as JSON.
        Err(error) if serde_json::from_str::<Value>(text).is_ok() => Err(files::json_fault(text, &error)),
        Err(_) => Ok(Value::String(text.to_owned())),
    }
}

/// The value in a table that has nothing but a field named like the last word of `key`.
fn unwrapped(key: &str, mut table: Value) -> Value {
    let name = key.rsplit('.').next().unwrap_or(key);
    let only = table.as_object_mut().filter(|fields| fields.len() == 1).and_then(|fields| fields.remove(name));
    only.unwrap_or(table)
}

#[cfg(test)]
mod tests;
