//! Parameters of a plan as the command line gives them: a file, and `--set` options on top.

use std::path::Path;

use serde_json::Value;

use super::check::warn;
use super::{CliError, doubts, files, set_value};
use crate::planning::params::PlanParams;
use crate::wire::parameters;
use crate::wire::preset::check_beside_preset;

/// Loads the parameter file and applies every `--set` to it.
pub(super) fn load_params(file: Option<&Path>, sets: &[String]) -> Result<PlanParams, CliError> {
    let value = match file {
        Some(path) => parameter_file(path)?,
        None => Value::Object(serde_json::Map::new()),
    };
    set_params(value, sets)
}

/// Reads a file of parameters, and refuses a document of another kind by its kind.
fn parameter_file(path: &Path) -> Result<Value, CliError> {
    let is_preset = |name: &&str| {
        let known = parameters::list().into_iter().find(|parameter| parameter.key == "preset");
        known.is_some_and(|parameter| parameter.values.iter().any(|value| value == name))
    };
    if let Some(name) = path.to_str().filter(|_| !path.exists()).filter(is_preset) {
        return Err(CliError::BadInput(format!("--params {name}: is a preset; give --set preset={name}")));
    }
    let value = files::value(path)?;
    match files::instead_of_parameters(&value) {
        Some(instead) => Err(CliError::BadInput(format!("--params {}: {instead}", path.display()))),
        None => Ok(value),
    }
}

/// Applies every `--set` to `value`.
pub(super) fn set_params(mut value: Value, sets: &[String]) -> Result<PlanParams, CliError> {
    for set in sets {
        let (key, text) = set.split_once('=').ok_or_else(|| {
            CliError::BadInput(format!("--set {set}: not of the form KEY=VALUE, such as selection.target=0.99"))
        })?;
        if key.trim().is_empty() {
            let what = "names no parameter; give KEY=VALUE, such as selection.target=0.99";
            return Err(CliError::BadInput(format!("--set {set}: {what}")));
        }
        if let Some(fault) = parameters::unknown(key) {
            return Err(CliError::BadInput(format!("--set {set}: {fault} (`vantage params` lists all)")));
        }
        let inserted = set_value::parse(key, text).and_then(|new| insert(&mut value, key, new));
        inserted.map_err(|reason| CliError::BadInput(format!("--set {set}: {reason}")))?;
    }
    let doubts = doubts::of_params(&value);
    let read: Result<PlanParams, CliError> = files::from_value(value.clone(), "parameters");
    let checked = read.and_then(|params| match params.check().and_then(|()| check_beside_preset(&value, &params)) {
        Ok(()) => {
            warn("parameters", &doubts);
            Ok(params)
        }
        Err(errors) => Err(files::findings("parameters", &errors)),
    });
    checked.map_err(|error| named_by_sets(error, sets))
}

/// The error with each finding in a parameter that a `--set` gives at that option, which its user typed; the pointer is then the
/// place within the option's value.
pub(super) fn named_by_sets(error: CliError, sets: &[String]) -> CliError {
    let CliError::Findings(mut findings) = error else { return error };
    for finding in findings.iter_mut().filter(|finding| finding.file == "parameters") {
        // A later option overrides an earlier one.
        let place = sets.iter().rev().find_map(|set| {
            let (key, _) = set.split_once('=')?;
            let rest = finding.pointer.strip_prefix(&format!("/{}", key.replace('.', "/")))?;
            (rest.is_empty() || rest.starts_with('/')).then(|| (key, format!("--set {set}"), rest.to_owned()))
        });
        let key = match place {
            Some((key, option, rest)) => {
                (finding.file, finding.pointer) = (option, rest);
                Some(key.to_owned()).filter(|_| finding.pointer.is_empty())
            }
            None => finding.pointer.strip_prefix('/').map(|pointer| pointer.replace('/', ".")),
        };
        if let Some(key) = key.filter(|_| finding.detail.contains("; expected a")) {
            let range = allowed(&key);
            // The range says more than the kind of number.
            if let (false, Some(found)) = (range.is_empty(), finding.detail.strip_suffix(NOT_NEGATIVE))
                && found.starts_with("is -")
            {
                finding.detail = found.to_owned();
            }
            finding.detail += &range;
        }
    }
    CliError::Findings(findings)
}

/// End of the message on a number below 0 in the place of a whole number.
const NOT_NEGATIVE: &str = "; expected a whole number, 0 or more";

/// Range of a parameter, for the end of a message on a value of another kind; empty if it has none.
fn allowed(key: &str) -> String {
    let known = parameters::list().into_iter().find(|parameter| parameter.key == key);
    known
        .map(|parameter| parameter.range_text())
        .filter(|range| !range.is_empty())
        .map_or_else(String::new, |range| format!("; allowed is {range}"))
}

/// Sets the field of `value` that the words of `key` lead to, with the objects on the way.
///
/// # Errors
/// The word of the key that is inside something else than an object.
pub(super) fn insert(value: &mut Value, key: &str, new: Value) -> Result<(), String> {
    let (path, last) = key.rsplit_once('.').map_or((None, key), |(path, last)| (Some(path), last));
    let mut table = value;
    for name in path.into_iter().flat_map(|path| path.split('.')) {
        let map = table.as_object_mut().ok_or_else(|| format!("{name} is inside a value that is not an object"))?;
        table = map.entry(name).or_insert_with(|| Value::Object(serde_json::Map::new()));
    }
    let map = table.as_object_mut().ok_or_else(|| format!("{last} is inside a value that is not an object"))?;
    map.insert(last.to_owned(), new);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A default beside a preset was replaced in silence, other values were refused.
    #[test]
    fn what_a_preset_sets_otherwise_is_refused_beside_it_defaults_too() {
        let given = |sets: &[&str]| {
            let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
            set_params(Value::Object(serde_json::Map::new()), &sets)
        };
        let told = "is set by preset = thesis; leave it out, or leave out the preset";
        for set in ["selection.solver=local", "selection.solver=lazy", "candidates.rolls_deg=[0,90]"] {
            let error = given(&["preset=thesis", set]).expect_err("refused").to_string();
            assert_eq!(error, format!("--set {set}: {told}"));
        }
        let file = serde_json::json!({"preset": "thesis", "candidates": {"standoff": "surface"}});
        let error = set_params(file, &[]).expect_err("refused").to_string();
        assert_eq!(error, format!("parameters: /candidates/standoff: {told}"));
        let same = given(&["preset=thesis", "selection.solver=greedy", "candidates.rolls_deg=[0]", "selection.target=0.985"]);
        assert!(same.is_ok(), "what the preset sets, and what it does not set: {same:?}");
        assert!(
            given(&["preset=vantage", "selection.solver=local", "candidates.rolls_deg=[0]"]).is_ok(),
            "the defaults set nothing"
        );
    }
}
