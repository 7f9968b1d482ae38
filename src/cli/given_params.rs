//! Parameters of a plan as the command line gives them: a file, and `--set` options on top.

use std::path::Path;

use serde_json::Value;

use super::check::warn;
use super::{CliError, doubts, files, output, set_value};
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

/// Warns of every `--set` that has no effect.
pub(super) fn warn_of_replaced(sets: &[String]) {
    for (earlier, later) in replaced(sets) {
        let detail = format!("has no effect, as --set {later} comes after it");
        output::warning(&format!("--set {earlier}"), "", &detail, "leave one of the two out");
    }
}

/// Options that a later one with another value replaces, each with that one: of the same parameter, or of a group that holds it.
fn replaced(sets: &[String]) -> Vec<(&str, &str)> {
    fn key(set: &str) -> &str {
        set.split_once('=').map_or(set, |(key, _)| key)
    }
    fn replaces(later: &str, earlier: &str) -> bool {
        let rest = key(earlier).strip_prefix(key(later));
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    }
    let pairs = sets.iter().enumerate().filter_map(|(number, earlier)| {
        let last = sets[number + 1..].iter().rev().find(|later| replaces(later, earlier)).filter(|last| *last != earlier)?;
        Some((earlier.as_str(), last.as_str()))
    });
    pairs.collect()
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
    warn_of_replaced(sets);
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
            finding.detail = with_range(&finding.detail, &allowed(&key));
        }
    }
    CliError::Findings(findings)
}

/// The message with a range, before any advice. With its unit and the number of entries, the range says more than that of the field's
/// shape, which it takes the place of.
fn with_range(detail: &str, range: &str) -> String {
    let (told, rest) = detail.split_once(ALLOWED).unwrap_or((detail, ""));
    match (range.is_empty(), rest.split_once("; ")) {
        (true, _) => detail.to_owned(),
        (false, Some((_, advice))) => format!("{told}{range}; {advice}"),
        (false, None) => format!("{told}{range}"),
    }
}

/// Beginning of the range in a message.
const ALLOWED: &str = "; allowed is ";

/// Range of a parameter, for the end of a message on a value of another kind; empty if it has none.
fn allowed(key: &str) -> String {
    let known = parameters::list().into_iter().find(|parameter| parameter.key == key);
    known
        .map(|parameter| parameter.range_text())
        .filter(|range| !range.is_empty())
        .map_or_else(String::new, |range| format!("{ALLOWED}{range}"))
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

    /// The last of two was taken, and nothing was said.
    #[test]
    fn options_that_a_later_one_replaces_are_found_with_it() {
        let sets = |sets: &[&str]| -> Vec<String> { sets.iter().map(|set| (*set).to_owned()).collect() };
        let twice = sets(&["selection.target=0.9", "seed=1", "selection.target=0.95"]);
        assert_eq!(replaced(&twice), [("selection.target=0.9", "selection.target=0.95")]);
        let whole = sets(&["selection.target=0.9", "selection={\"max_views\":4}"]);
        assert_eq!(replaced(&whole), [(whole[0].as_str(), whole[1].as_str())], "the group replaces all that is in it");
        let back = sets(&["seed=1", "seed=2", "seed=1"]);
        assert_eq!(replaced(&back), [("seed=2", "seed=1")]);
        for unlike in [
            &["selection={\"max_views\":4}", "selection.target=0.9"][..],
            &["seed=1", "seed=1"],
            &["limits.camera_deg=60", "limits.camera=60"],
            &["seed=1"],
        ] {
            assert!(replaced(&sets(unlike)).is_empty(), "{unlike:?}");
        }
    }

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
