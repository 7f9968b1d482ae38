//! Captures of one scene at several brightness levels (`vantage.brightness_data/1`) and the levels identified from them
//! (`vantage.brightness/1`).

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::cell::calibration::brightness::{BrightnessLevels, BrightnessSweep, LevelCapture};
use crate::cell::{ExposureSpec, FieldError};
use crate::wire::words::rounded_to;

/// Schema name of the result.
pub const BRIGHTNESS_SCHEMA: &str = "vantage.brightness/1";

/// Captures of one scene, such as a white plate from the zenith: one at each level.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct BrightnessData {
    /// Schema name, `vantage.brightness_data/1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub schema: Option<String>,
    /// Grey value of a saturated pixel, 1 to 65535. Default 255.
    #[serde(default = "full_scale")]
    pub full_scale: f64,
    /// Mean grey value with the projector off. Default 0.
    #[serde(default)]
    pub ambient_signal: f64,
    /// Light that the scene scatters relative to a white surface that faces the projector at the best focus, 0.001 to 10: albedo ·
    /// cos(incidence) · (best focus / distance)². Default: not known; the grey value of white is then not identified.
    #[serde(default)]
    pub relative_light: Option<f64>,
    /// The captures, at most one a level.
    pub captures: Vec<LevelCaptureDocument>,
}

fn full_scale() -> f64 {
    255.0
}

/// One capture: grey values, the noise of the points, or both.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, expecting = "an object")]
pub struct LevelCaptureDocument {
    /// Brightness level, 0 to 9.
    pub level: u8,
    /// Mean grey value of the fully lit scene.
    #[serde(default)]
    pub mean_signal: Option<f64>,
    /// Standard deviation of a pixel's grey value. Default 2.
    #[serde(default)]
    pub sd_signal: Option<f64>,
    /// Noise of the measured points, one standard deviation, mm.
    #[serde(default)]
    pub noise_mm: Option<f64>,
    /// Number of pixels or points that the figures are of, at least 10.
    pub points: u32,
    /// Share of the scene that was measured.
    #[serde(default)]
    pub returned: Option<f64>,
}

/// Grey values by which a pixel's signal is taken to scatter where that is not said.
const USUAL_SD: f64 = 2.0;

impl BrightnessData {
    /// Identifies the levels.
    ///
    /// # Errors
    /// Figures out of range; too few levels.
    pub fn identify(&self) -> Result<BrightnessDocument, Vec<FieldError>> {
        let capture = |capture: &LevelCaptureDocument| LevelCapture {
            level: capture.level,
            signal: capture.mean_signal.map(|mean| [mean, capture.sd_signal.unwrap_or(USUAL_SD)]),
            noise_mm: capture.noise_mm,
            points: capture.points,
            returned: capture.returned,
        };
        let sweep = BrightnessSweep {
            full_scale: self.full_scale,
            ambient_signal: self.ambient_signal,
            relative_light: self.relative_light,
            captures: self.captures.iter().map(capture).collect(),
        };
        Ok(BrightnessDocument::of(&sweep.identify()?, self.full_scale))
    }
}

/// Identified brightness levels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct BrightnessDocument {
    /// Schema name, `vantage.brightness/1`.
    pub schema: String,
    /// Section of a scanner specification.
    pub exposure: ExposureSpec,
    /// Standard deviation of each level's gain, as a share of it; `null` where no capture tells the level, and it follows from its
    /// neighbours.
    pub relative_sd: Vec<Option<f64>>,
    /// Level at which the largest share of the scene was measured; `null` if no share was given.
    pub best_level: Option<u8>,
    /// Levels whose captures were darker than those of the level before by more than their noise: mixed up, or the scene changed.
    pub falling_levels: Vec<u8>,
    /// Levels whose captures were saturated.
    pub saturated_levels: Vec<u8>,
}

impl BrightnessDocument {
    fn of(levels: &BrightnessLevels, full_scale: f64) -> Self {
        let rounded = |value: f64| rounded_to(value, 6);
        Self {
            schema: BRIGHTNESS_SCHEMA.to_owned(),
            exposure: ExposureSpec {
                levels: levels.gains.map(|level| rounded(level.gain)),
                full_scale,
                white_signal: levels.white_signal.map(rounded),
                min_modulation: None,
            },
            relative_sd: levels.gains.iter().map(|level| level.relative_sd).collect(),
            best_level: levels.best_level,
            falling_levels: levels.falling.clone(),
            saturated_levels: levels.saturated.clone(),
        }
    }
}
