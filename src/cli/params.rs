//! `vantage params`: lists the parameters of a plan, with default, range, unit and meaning.

use serde::Serialize;

use super::{CliError, output};
use crate::cell::did_you_mean;
use crate::wire::parameters::{self, Parameter};

/// List the planning parameters for --set and --params, with default, range, unit and meaning.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage params
  vantage params selection
  vantage params selection.target
  vantage params --json")]
pub(super) struct ParamsArgs {
    /// Parameter, group of parameters, or part of a name [default: all parameters].
    name: Option<String>,
}

/// List as JSON.
#[derive(Serialize)]
struct ParameterList {
    parameters: Vec<Parameter>,
}

/// Prints the list.
///
/// # Errors
/// [`CliError::BadInput`] if no parameter has the name.
pub(super) fn run(args: &ParamsArgs) -> Result<(), CliError> {
    let parameters = found(args.name.as_deref().unwrap_or_default())?;
    let mut text: String = parameters.iter().map(described).collect();
    if parameters.iter().any(|parameter| is_region(&parameter.key)) {
        text.push_str(&regions());
    }
    output::result(&ParameterList { parameters }, text)
}

/// Returns true if the parameter takes a region of the part, or several.
fn is_region(key: &str) -> bool {
    key == "regions.exclude" || key.ends_with(".region")
}

/// The kinds of regions, each by an example.
fn regions() -> String {
    let examples: String = REGIONS.iter().map(|(example, meaning)| format!("    {example}\n        {meaning}\n")).collect();
    format!(
        "A region of the part, in mm along the axes of its file, is one of\n{examples}Example: --set \
         'regions.exclude=[{}]'\n",
        REGIONS[1].0
    )
}

/// An example of each kind of region, and its meaning.
const REGIONS: [(&str, &str); 6] = [
    (r#"{"kind": "faces", "faces": [0, 1, 2]}"#, "faces of the file, counted from 0"),
    (r#"{"kind": "box", "min_mm": [0, 0, 0], "max_mm": [20, 10, 5]}"#, "box along the axes"),
    (r#"{"kind": "sphere", "centre_mm": [0, 0, 10], "radius_mm": 5}"#, "ball"),
    (r#"{"kind": "half_space", "point_mm": [0, 0, 3], "normal": [0, 0, 1]}"#, "all points p with (p - point) · normal ≤ 0"),
    (
        r#"{"kind": "plane", "point_mm": [0, 0, 3], "normal": [0, 0, 1], "within_mm": 0.5}"#,
        "all points no farther from the plane than within_mm",
    ),
    (r#"{"kind": "name", "name": "flange"}"#, "named group of an OBJ file (g, o)"),
];

/// Parameters that a name means: one of this name, else those of a group, else those that begin so, else those that contain it.
fn found(name: &str) -> Result<Vec<Parameter>, CliError> {
    let all = parameters::list();
    let matches: [&dyn Fn(&str) -> bool; 4] = [
        &|key| key == name,
        &|key| key.strip_prefix(name).is_some_and(|rest| rest.starts_with(['.', '['])),
        &|key| key.starts_with(name),
        &|key| key.contains(name),
    ];
    for is_meant in matches {
        let meant: Vec<Parameter> = all.iter().filter(|parameter| is_meant(&parameter.key)).cloned().collect();
        if !meant.is_empty() {
            return Ok(meant);
        }
    }
    let question = did_you_mean(name, all.iter().map(|parameter| parameter.key.as_str()));
    let told = format!("is not a parameter, nor part of the name of one{question} (`vantage params` lists all)");
    Err(CliError::BadInput(format!("{name}: {told}")))
}

/// Parameters, each on a line with its meaning on the next: the end of a help text.
pub(super) fn for_help(parameters: &[Parameter]) -> String {
    format!("\n\nParameters for --set:\n{}", parameters.iter().map(described).collect::<String>())
}

/// A parameter on a line, with its meaning on the next.
fn described(parameter: &Parameter) -> String {
    let default = match parameter.default_text() {
        none if none.is_empty() => String::new(),
        default => format!(" = {default}"),
    };
    let range = match parameter.range_text() {
        none if none.is_empty() => String::new(),
        range => format!("    ({range})"),
    };
    format!("{}{default}{range}\n    {}\n", parameter.key, parameter.description)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::params::Region;

    fn keys(name: &str) -> Vec<String> {
        found(name).expect("found").into_iter().map(|parameter| parameter.key).collect()
    }

    #[test]
    fn a_name_means_a_parameter_a_group_a_beginning_or_a_part() {
        assert_eq!(keys("selection.target"), ["selection.target"], "not selection.target_of");
        assert!(keys("selection").len() > 8 && keys("selection").iter().all(|key| key.starts_with("selection.")));
        assert_eq!(keys("selection.max_v"), ["selection.max_views"]);
        assert_eq!(keys("clearance"), ["motion.clearance_mm"]);
        assert!(keys("").len() > 80);
        let error = found("selection.maxviews").expect_err("unknown");
        assert!(
            error.exit_code() == 2 && error.to_string().contains("; did you mean selection.max_views? (`vantage params`"),
            "{error}"
        );
    }

    #[test]
    fn regions_are_told_by_an_example_of_every_kind() {
        let text = regions();
        let mut kinds: Vec<String> = Vec::new();
        for (example, _) in REGIONS {
            let region: Region = serde_json::from_str(example).expect("a region");
            assert!(text.contains(example));
            // The same fields, none left to a default.
            let (written, given) = (serde_json::to_value(&region).expect("JSON"), serde_json::from_str(example).expect("JSON"));
            let fields = |value: &serde_json::Value| value.as_object().expect("an object").keys().cloned().collect::<Vec<_>>();
            assert_eq!(fields(&written), fields(&given));
            kinds.push(written["kind"].to_string());
        }
        let refused = serde_json::from_str::<Region>(r#"{"kind": "?"}"#).expect_err("no kind").to_string();
        let known = refused.split('`').skip(3).step_by(2).map(|kind| format!("{kind:?}")).collect::<Vec<_>>();
        assert_eq!(kinds, known);
        assert!(is_region("materials.regions[].region") && !is_region("regions.noise.budget"));
    }

    #[test]
    fn a_parameter_is_told_with_default_range_and_meaning() {
        let told = described(&found("selection.target").expect("found")[0]);
        let meaning = "Share of the area named by `target_of` at which selection stops. A higher target takes more views.";
        assert_eq!(told, format!("selection.target = 0.985    (0 to 1)\n    {meaning}\n"));
        let told = described(&found("selection.solver").expect("found")[0]);
        assert!(told.starts_with("selection.solver = \"local\"    (greedy, lazy, local, certified)\n"), "{told}");
        let told = described(&found("scan.settle_secs").expect("found")[0]);
        assert!(told.contains("(0 to 60 s)"), "{told}");
    }
}
