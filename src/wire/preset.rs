//! Parameters given beside a preset. Once read, a default that was given is as if it were not, and the preset would replace it in
//! silence: so the document itself is looked at.

use serde_json::{Map, Value};

use crate::cell::FieldError;
use crate::planning::params::{PlanParams, Preset};

/// Parameters that a preset sets otherwise than the defaults, as a document of parameters has them.
#[must_use]
pub fn set_by(preset: Preset) -> Value {
    let default = PlanParams::default();
    let [set, default] = [preset.apply(&default), default].map(|params| serde_json::to_value(params).unwrap_or_default());
    difference(set, &default).unwrap_or_else(|| Value::Object(Map::new()))
}

/// Defaults of all parameters, as a document of parameters has them.
#[must_use]
pub fn all_defaults() -> Value {
    let all = serde_json::to_value(PlanParams::default()).unwrap_or_default();
    difference(all, &Value::Null).unwrap_or_else(|| Value::Object(Map::new()))
}

/// Fields of a value that differ from `other`, without those that are not given; `None` if there are none.
fn difference(value: Value, other: &Value) -> Option<Value> {
    match value {
        Value::Object(fields) => {
            let differing = fields.into_iter().filter_map(|(name, field)| {
                let differing = difference(field, other.get(&name).unwrap_or(&Value::Null))?;
                Some((name, differing))
            });
            let differing: Map<String, Value> = differing.collect();
            (!differing.is_empty()).then_some(Value::Object(differing))
        }
        value @ (Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) | Value::Array(_)) => {
            (value != *other && !value.is_null()).then_some(value)
        }
    }
}

/// Refuses what a document of parameters gives beside a preset that sets it otherwise, defaults too. `params` is the document as it
/// was read.
///
/// # Errors
/// Every field that the preset sets otherwise.
pub fn check_beside_preset(given: &Value, params: &PlanParams) -> Result<(), Vec<FieldError>> {
    let read = serde_json::to_value(params).unwrap_or_default();
    let mut pointers = Vec::new();
    set_otherwise(&set_by(params.preset), given, &read, "", &mut pointers);
    let name = read["preset"].as_str().unwrap_or_default();
    let error = |pointer: String| {
        let detail = format!("is set by preset = {name}; leave it out, or leave out the preset");
        FieldError { pointer, detail }
    };
    let errors: Vec<FieldError> = pointers.into_iter().map(error).collect();
    if errors.is_empty() { Ok(()) } else { Err(errors) }
}

/// Adds the pointers of the fields that are in `set` and `given`, and that `read` has with another value than `set`.
fn set_otherwise(set: &Value, given: &Value, read: &Value, at: &str, pointers: &mut Vec<String>) {
    if let Value::Object(fields) = set {
        for (name, field) in fields {
            if let Some(given) = given.get(name) {
                set_otherwise(field, given, &read[name], &format!("{at}/{name}"), pointers);
            }
        }
    } else if read != set {
        pointers.push(at.to_owned());
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::wire::decode;

    fn refused(given: &Value) -> Vec<String> {
        let params: PlanParams = decode(given).expect("parameters");
        let errors = check_beside_preset(given, &params).err().unwrap_or_default();
        errors.into_iter().map(|error| error.to_string()).collect()
    }

    #[test]
    fn what_a_preset_sets_otherwise_is_refused_beside_it_defaults_too() {
        let told = "is set by preset = thesis; leave it out, or leave out the preset";
        let candidates = json!({"rolls_deg": [0, 90]});
        let given = json!({"preset": "thesis", "selection": {"solver": "local", "target": 0.985}, "candidates": candidates});
        let found = refused(&given);
        assert_eq!(found.len(), 2, "{found:?}");
        for (found, pointer) in found.iter().zip(["/candidates/rolls_deg", "/selection/solver"]) {
            assert!(found.starts_with(pointer) && found.ends_with(told), "{found}");
        }
    }

    #[test]
    fn what_a_preset_sets_itself_and_what_it_does_not_set_may_stand_beside_it() {
        let candidates = json!({"rolls_deg": [0]});
        let same = json!({"preset": "thesis", "selection": {"solver": "greedy", "target": 0.985}, "candidates": candidates});
        assert_eq!(refused(&same), [""; 0]);
        let default = json!({"preset": "vantage", "selection": {"solver": "local"}, "candidates": {"rolls_deg": [0]}});
        assert_eq!(refused(&default), [""; 0], "the defaults set nothing");
        assert_eq!(refused(&json!({"selection": {"solver": "lazy"}})), [""; 0]);
    }

    /// A client sends the parameters of a job again as it was shown them.
    #[test]
    fn all_parameters_with_a_preset_applied_may_stand_beside_it() {
        let applied = Preset::Thesis.apply(&PlanParams { preset: Preset::Thesis, ..PlanParams::default() });
        assert_eq!(refused(&serde_json::to_value(applied).expect("JSON")), [""; 0]);
    }
}
