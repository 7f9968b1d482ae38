//! `vantage presets`: lists the scanners, robots, turntables, cells and sets of parameters that ship with the program, and prints
//! one as a file to start from.

use std::path::Path;

use serde::Serialize;
use serde_json::Value;

use super::{CliError, output};
use crate::cell::{
    KinematicsSpec, Named, NotFound, Presets, RobotSpec, RotationSpec, SpecKind, SpecLibrary, did_you_mean, preset_text,
};
use crate::planning::params::Preset;
use crate::wire::preset::{all_defaults, set_by};

/// List the presets: scanners, robots, turntables, cells and parameter sets; or print one as a file.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage presets
  vantage presets robot
  vantage presets e05-transcan > my-cell.toml    start your own cell
  vantage presets thesis                         parameters that it sets")]
pub(super) struct PresetsArgs {
    /// Kind to list (scanner, robot, turntable, cell or parameters), or name of a preset to print as TOML [default: list all].
    preset: Option<String>,
}

/// Preset, on a line.
#[derive(Clone, Debug, Serialize)]
struct PresetLine {
    kind: &'static str,
    name: String,
    summary: String,
}

/// List as JSON.
#[derive(Serialize)]
struct PresetList {
    presets: Vec<PresetLine>,
}

/// Kinds of specifications that have presets.
pub(super) const KINDS: [SpecKind; 4] = [SpecKind::Scanner, SpecKind::Robot, SpecKind::Turntable, SpecKind::Cell];
/// Kind of the sets of parameters.
pub(super) const PARAMETERS: &str = "parameters";
/// Sets of parameters, as `--set preset=NAME` takes them.
pub(super) const PARAMETER_SETS: [(&str, &str); 2] = [
    ("vantage", "the defaults: minimise the number of views for the target, then take the best set of that many"),
    ("thesis", "greedy with a = b = 0.5 over the 54 candidates of the thesis"),
];

/// Prints the list, or a preset.
///
/// # Errors
/// [`CliError::BadInput`] for a name that is neither a kind nor a preset.
pub(super) fn run(args: &PresetsArgs) -> Result<(), CliError> {
    let all = list()?;
    let Some(wanted) = &args.preset else { return print(all) };
    // `robots` are meant by `robot`.
    let is_meant = |preset: &&PresetLine| preset.kind == wanted || preset.kind == wanted.trim_end_matches('s');
    let of_kind: Vec<PresetLine> = all.iter().filter(is_meant).cloned().collect();
    if !of_kind.is_empty() {
        return print(of_kind);
    }
    if let Some(text) = KINDS.iter().find_map(|kind| preset_text(*kind, wanted)) {
        let value: Value = toml::from_str(text).map_err(|error| CliError::Failed(error.to_string()))?;
        return output::result(&value, text);
    }
    if let Some((name, summary)) = PARAMETER_SETS.into_iter().find(|(name, _)| name == wanted) {
        let set = parameter_set(name).map_err(|error| CliError::Failed(format!("{name}: {error}")))?;
        return output::result(&set, toml_of(name, summary, &set)?);
    }
    let names: Vec<&str> = all.iter().map(|preset| preset.name.as_str()).collect();
    let kinds = KINDS.map(SpecKind::as_str);
    let question = did_you_mean(wanted, names.iter().copied().chain(kinds).chain([PARAMETERS]));
    Err(CliError::BadInput(format!(
        "{wanted}: is neither a kind of presets ({}, {PARAMETERS}) nor the name of one ({}){question}",
        kinds.join(", "),
        names.join(", ")
    )))
}

/// A preset as the document that a file of it would be; `None` if there is none of the name.
pub(super) fn value_of(name: &str) -> Option<Value> {
    let text = KINDS.iter().find_map(|kind| preset_text(*kind, name));
    let is_set = PARAMETER_SETS.iter().any(|(set, _)| *set == name);
    text.and_then(|text| toml::from_str(text).ok()).or_else(|| is_set.then(|| serde_json::json!({ "preset": name })))
}

/// Remark on a name that no preset has, with the name that was probably meant; `None` for what is no preset's: a path, or a name with an
/// ending.
pub(super) fn none_of(name: &str) -> Option<String> {
    let path = Path::new(name);
    let is_bare = name != "-" && path.extension().is_none() && path.file_name().is_some_and(|file| file == name);
    let of_devices: Vec<String> = KINDS.iter().flat_map(|kind| Presets.names(*kind)).collect();
    let names = of_devices.iter().map(String::as_str).chain(PARAMETER_SETS.map(|(set, _)| set));
    let question = did_you_mean(name, names);
    is_bare.then(|| format!("there is no such preset either (`vantage presets` lists them){question}"))
}

fn print(presets: Vec<PresetLine>) -> Result<(), CliError> {
    let width = presets.iter().map(|preset| preset.name.len()).max().unwrap_or_default();
    let line = |preset: &PresetLine| format!("{:<10}  {:<width$}  {}\n", preset.kind, preset.name, preset.summary);
    let text: String = presets.iter().map(line).collect();
    output::result(&PresetList { presets }, text)
}

fn list() -> Result<Vec<PresetLine>, CliError> {
    let mut all = Vec::new();
    for kind in KINDS {
        for name in Presets.names(kind) {
            let summary = summary(kind, &name).map_err(|error| CliError::Failed(format!("{name}: {error}")))?;
            all.push(PresetLine { kind: kind.as_str(), name, summary });
        }
    }
    let set = |(name, summary): (&str, &str)| PresetLine { kind: PARAMETERS, name: name.to_owned(), summary: summary.to_owned() };
    all.extend(PARAMETER_SETS.map(set));
    Ok(all)
}

/// Parameters that a set sets, as a file of parameters has them: all of them for the defaults, those that differ for another.
fn parameter_set(name: &str) -> Result<Value, serde_json::Error> {
    let preset: Preset = serde_json::from_value(name.into())?;
    if preset != Preset::default() {
        return Ok(set_by(preset));
    }
    Ok(all_defaults())
}

/// A set of parameters as a TOML file, with its source.
fn toml_of(name: &str, summary: &str, set: &Value) -> Result<String, CliError> {
    let text = output::toml(set)?;
    Ok(format!(
        "# Parameters of the preset `{name}`: {summary}.\n# Use it as it is, or change it: vantage plan … --params FILE\n\n{text}"
    ))
}

/// Main figures of a preset.
fn summary(kind: SpecKind, name: &str) -> Result<String, NotFound> {
    Ok(match kind {
        SpecKind::Scanner => {
            let spec = Presets.scanner(name)?;
            let scanner = spec.build().map_err(|errors| NotFound::Unusable(format!("{errors:?}")))?;
            let [x, y, z] = scanner.practical_volume_mm;
            format!(
                "volume {x} × {y} × {z} mm, depth {} to {} mm, focus at {} mm",
                scanner.near_mm, scanner.far_mm, scanner.best_mm
            )
        }
        SpecKind::Robot => {
            let spec = Presets.robot(name)?;
            format!("payload {} kg, {} inverse kinematics", spec.payload_kg, kinematics(&spec))
        }
        SpecKind::Turntable => {
            let spec = Presets.turntable(name)?;
            let range = match spec.rotation {
                RotationSpec::Continuous {} => "endless".to_owned(),
                RotationSpec::Limited { min_deg, max_deg } => format!("{min_deg}° to {max_deg}°"),
            };
            format!("plate {} mm, {range}, {} °/s", spec.plate_diameter_mm, spec.max_speed_deg_per_s)
        }
        SpecKind::Cell => {
            let spec = Presets.cell(name)?;
            let (scanner, robot, table) = (named(&spec.scanner), named(&spec.robot), named(&spec.turntable));
            format!("scanner {scanner}, robot {robot}, turntable {table}")
        }
        SpecKind::Mesh => String::new(),
    })
}

fn kinematics(spec: &RobotSpec) -> &'static str {
    match &spec.kinematics {
        KinematicsSpec::Chain(chain) if chain.build().closed_form().is_none() => "iterative",
        KinematicsSpec::Chain(_) | KinematicsSpec::Opw(_) | KinematicsSpec::Ur(_) => "analytic",
    }
}

fn named<T>(part: &Named<T>) -> &str {
    match part {
        Named::Name(name) => name,
        Named::Inline(_) => "its own",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::planning::params::PlanParams;

    #[test]
    fn every_preset_is_listed_with_its_figures() {
        let all = list().expect("every preset can be read");
        let line = |name: &str| all.iter().find(|preset| preset.name == name).expect("listed").summary.clone();
        assert!(line("transcan-c").starts_with("volume ") && line("transcan-c").contains(" mm, depth "));
        assert_eq!(line("hans-e05"), "payload 5 kg, analytic inverse kinematics");
        assert!(line("minas-a6-500").starts_with("plate 500 mm"), "{}", line("minas-a6-500"));
        assert_eq!(line("e05-transcan"), "scanner transcan-c, robot hans-e05, turntable minas-a6-500");
        for kind in KINDS {
            assert_eq!(all.iter().filter(|preset| preset.kind == kind.as_str()).count(), Presets.names(kind).len());
        }
    }

    #[test]
    fn sets_of_parameters_are_those_that_a_plan_takes() {
        for (name, _) in PARAMETER_SETS {
            serde_json::from_value::<Preset>(name.into()).expect("a preset of parameters");
        }
        let known = crate::wire::parameters::list().into_iter().find(|parameter| parameter.key == "preset").expect("a parameter");
        assert_eq!(known.values, PARAMETER_SETS.map(|(name, _)| name));
    }

    #[test]
    fn a_set_of_parameters_is_printed_as_a_file_that_gives_the_same_plan() {
        for (name, summary) in PARAMETER_SETS {
            let set = parameter_set(name).expect("a set");
            let text = toml_of(name, summary, &set).expect("TOML");
            let read: PlanParams = toml::from_str(&text).expect("a file of parameters");
            let preset: Preset = serde_json::from_value(name.into()).expect("a preset");
            assert_eq!(read, preset.apply(&PlanParams::default()), "{text}");
        }
        let thesis = toml_of("thesis", "", &parameter_set("thesis").expect("a set")).expect("TOML");
        for line in ["solver = \"greedy\"", "strategies = [\"ellipsoid\"]", "standoff = \"first_surface\"", "[candidates]"] {
            assert!(thesis.lines().any(|told| told == line), "{line} is not in\n{thesis}");
        }
        assert!(thesis.lines().count() < 25, "only what it sets:\n{thesis}");
    }

    #[test]
    fn a_misspelled_preset_is_asked_about() {
        let error = run(&PresetsArgs { preset: Some("e5-transcan".to_owned()) }).expect_err("unknown");
        assert!(error.exit_code() == 2 && error.to_string().ends_with("did you mean e05-transcan?"), "{error}");
    }
}
