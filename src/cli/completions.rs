//! `vantage completions`: prints a completion script for a shell. Values are completed too: names of presets, units, languages of
//! controllers, keys of parameters, files and folders. The scripts are static, since clap's dynamic ones are not stable yet:
//! in bash a parameter is completed up to its `=`, elsewhere with its closed list of values.

use clap::builder::PossibleValuesParser;
use clap::{Arg, Command, CommandFactory, ValueHint};
use clap_complete::Shell;

use super::presets::{KINDS, PARAMETER_SETS, PARAMETERS};
use super::{Cli, CliError, output};
use crate::cell::{Presets, SpecKind, SpecLibrary};
use crate::geometry::LengthUnit;
use crate::geometry::demo_parts::DemoPart;
use crate::program::dialects::Dialect;
use crate::wire::parameters;

/// Print a shell completion script.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  vantage completions bash > /etc/bash_completion.d/vantage
  vantage completions zsh > ~/.zfunc/_vantage
  vantage completions fish > ~/.config/fish/completions/vantage.fish")]
pub(super) struct CompletionsArgs {
    /// Shell that will load the script.
    shell: Shell,
}

/// Prints the script.
///
/// # Errors
/// [`CliError::Failed`] if standard output cannot be written.
pub(super) fn run(args: &CompletionsArgs) -> Result<(), CliError> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut with_values(Cli::command(), args.shell), "vantage", &mut script);
    output::bytes(&script)
}

/// The command with values to complete, in every command below it.
fn with_values(command: Command, shell: Shell) -> Command {
    command.mut_args(|arg| with_value(arg, shell)).mut_subcommands(|below| with_values(below, shell))
}

/// An argument with the values that its name stands for. A preset may also be a file; where no preset fits, shells go on to files.
fn with_value(arg: Arg, shell: Shell) -> Arg {
    let presets = |kind| Presets.names(kind);
    let among = |arg: Arg, values: Vec<String>| arg.value_parser(PossibleValuesParser::new(values)).hide_possible_values(true);
    match arg.get_id().as_str() {
        "cell" => {
            let none = "none".to_owned();
            among(arg, presets(SpecKind::Cell).into_iter().chain([none]).collect())
        }
        "scanner" => among(arg, presets(SpecKind::Scanner)),
        "robot" => among(arg, presets(SpecKind::Robot)),
        "turntable" => among(arg, presets(SpecKind::Turntable)),
        "unit" => among(arg, LengthUnit::ALL.map(|unit| unit.as_str().to_owned()).into()),
        "dialect" => among(arg, Dialect::ALL.map(|dialect| dialect.as_str().to_owned()).into()),
        "part" => among(arg, DemoPart::ALL.map(|part| part.as_str().to_owned()).into()),
        "preset" => among(arg, preset_words()),
        "name" if arg.is_positional() => among(arg, keys().collect()),
        // `Other` keeps bash from adding a blank after the `=`.
        "sets" => among(arg, settings(shell)).value_hint(ValueHint::Other),
        "mesh" | "file" | "files" | "urdf" | "params" | "features" | "plan" | "fixture" | "config" => {
            arg.value_hint(ValueHint::FilePath)
        }
        "data" | "to" | "packages" | "surfaces" => arg.value_hint(ValueHint::DirPath),
        "from" if !arg.is_positional() => arg.value_hint(ValueHint::DirPath),
        _ => arg,
    }
}

/// Keys that `--set` takes.
fn keys() -> impl Iterator<Item = String> {
    parameters::list().into_iter().map(|parameter| parameter.key).filter(|key| !key.contains("[]"))
}

/// Settings to begin with: each key up to its `=`, and with each value of its closed list. Bash breaks words at `=`.
fn settings(shell: Shell) -> Vec<String> {
    let parameters = parameters::list().into_iter().filter(|parameter| !parameter.key.contains("[]"));
    let with_values = shell != Shell::Bash;
    let settings = parameters.flat_map(|parameter| {
        // A list is written in brackets, which no shell completes.
        let is_list = parameter.default.is_array();
        let values = parameter.values.into_iter().filter(move |_| with_values && !is_list);
        let values: Vec<String> = values.map(|value| format!("{}={value}", parameter.key)).collect();
        [format!("{}=", parameter.key)].into_iter().chain(values)
    });
    settings.collect()
}

/// Kinds and names that `vantage presets` takes.
fn preset_words() -> Vec<String> {
    let kinds = KINDS.map(|kind| kind.as_str().to_owned()).into_iter().chain([PARAMETERS.to_owned()]);
    let names = KINDS.into_iter().flat_map(|kind| Presets.names(kind));
    kinds.chain(names).chain(PARAMETER_SETS.map(|(name, _)| name.to_owned())).collect()
}
