//! `vantage calibrate brightness`: the light of the projector's levels, from one capture at each.

use std::path::PathBuf;

use serde::Serialize;

use crate::cell::ExposureSpec;
use crate::cli::files;
use crate::cli::{CliError, output};
use crate::wire::calibration::{BrightnessData, BrightnessDocument};

/// Measure the light at each brightness level of the projector, from one capture of a plate per level.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Example:
  vantage calibrate brightness sweep.json --out exposure.toml")]
pub(super) struct CalibrateBrightnessArgs {
    /// Captures, JSON or TOML: {"full_scale": 255, "ambient_signal": 6, "captures": [{"level": 0, "mean_signal": 31.5, "points":
    /// 20000}, …]}. In addition to the mean grey value (mean_signal), or instead of it: noise_mm, the noise of the points.
    data: PathBuf,
    /// TOML file to write: the section `[exposure]` for the scanner's specification [default: standard output].
    #[arg(long)]
    out: Option<PathBuf>,
}

/// A specification's section by its name.
#[derive(Serialize)]
struct Section {
    exposure: ExposureSpec,
}

/// Identifies the levels.
pub(super) fn run(args: &CalibrateBrightnessArgs) -> Result<(), CliError> {
    let shown = args.data.display().to_string();
    let data: BrightnessData = files::of_kind(files::value(&args.data)?, ("captures of a plate", None), &shown)?;
    let identified = data.identify().map_err(|errors| files::findings(&shown, &errors))?;
    let section = output::toml(&Section { exposure: identified.exposure })?;
    if let Some(path) = &args.out {
        files::write(path, section.as_bytes())?;
    }
    output::result(&identified, text(&identified, &section))
}

fn text(identified: &BrightnessDocument, section: &str) -> String {
    let mut text = String::from("level  gain     U (k = 2)\n");
    for (level, (gain, sd)) in identified.exposure.levels.iter().zip(&identified.relative_sd).enumerate() {
        let of_it = sd.map_or_else(|| "not captured; taken from its neighbours".to_owned(), |sd| format!("{:.2} %", 200.0 * sd));
        text += &format!("{level:>5}  {gain:<7.4}  {of_it}\n");
    }
    let list = |levels: &[u8]| levels.iter().map(u8::to_string).collect::<Vec<_>>().join(", ");
    if let Some(best) = identified.best_level {
        text += &format!("Most of the scene is measured at level {best}.\n");
    }
    if !identified.saturated_levels.is_empty() {
        text += &format!("Saturated, and left out: {}.\n", list(&identified.saturated_levels));
    }
    if !identified.falling_levels.is_empty() {
        let falling = list(&identified.falling_levels);
        text += &format!("Darker than the level before: {falling}; check whether captures are swapped or the scene changed.\n");
    }
    format!("{text}\n{section}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::calibration::BRIGHTNESS_SCHEMA;

    #[test]
    fn the_uncertainty_of_a_gain_is_told_with_its_coverage_factor() {
        let exposure = ExposureSpec::default();
        let relative_sd = exposure.levels.map(|_| Some(0.005)).into();
        let identified = BrightnessDocument {
            schema: BRIGHTNESS_SCHEMA.to_owned(),
            exposure,
            relative_sd,
            best_level: None,
            falling_levels: Vec::new(),
            saturated_levels: Vec::new(),
        };
        let told = text(&identified, "");
        assert!(told.starts_with("level  gain     U (k = 2)\n    0  ") && told.contains("  1.00 %\n"), "{told}");
    }
}
