//! Brightness of the views and the area expected to be lost to it, in `plan.json`, `viewpoints.json` and `coverage.json`.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::planning::plan::{ExposureLoss, ViewExposure, share};

/// Brightness of a view, and the area that it sees and that is expected to be lost to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct ViewExposureDocument {
    /// Brightness level of each capture, 0 to 9, ascending: one, or two at one pose.
    pub levels: Vec<u8>,
    /// Asked area that the view sees, whether it is lit well or not.
    pub seen_area_mm2: f64,
    /// Part of it that is too dark in every capture.
    pub dark_area_mm2: f64,
    /// Part of it that is saturated in a capture, and too dark or saturated in the others.
    pub saturated_area_mm2: f64,
}

impl From<&ViewExposure> for ViewExposureDocument {
    fn from(exposure: &ViewExposure) -> Self {
        let ViewExposure { levels, seen_area_mm2, dark_area_mm2, saturated_area_mm2 } = exposure.clone();
        Self { levels, seen_area_mm2, dark_area_mm2, saturated_area_mm2 }
    }
}

/// Asked area that some view sees, but that is expected to be too dark or saturated in every view that sees it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(expecting = "an object")]
pub struct ExposureLossDocument {
    /// Area that is too dark in every view that sees it.
    pub dark_area_mm2: f64,
    /// Area that is saturated in some view.
    pub saturated_area_mm2: f64,
    /// Dark and saturated area together, as a share of the asked area.
    pub of_asked: f64,
    /// Part of the dark and saturated area that nevertheless counts as measured: some level would suit it, but its views are
    /// captured at others.
    pub of_measured_area_mm2: f64,
    /// True if the scanner's specification has no `exposure`, so that its levels were assumed.
    pub levels_assumed: bool,
}

impl ExposureLossDocument {
    /// The loss beside the asked area.
    pub(in crate::wire) fn of(loss: &ExposureLoss, asked_area_mm2: f64) -> Self {
        // Adding 0 turns −0, the sum of nothing, into 0.
        let [dark_area_mm2, saturated_area_mm2, of_measured_area_mm2] =
            [loss.dark_area_mm2, loss.saturated_area_mm2, loss.of_measured_area_mm2].map(|area_mm2| area_mm2 + 0.0);
        let of_asked = share(dark_area_mm2 + saturated_area_mm2, asked_area_mm2);
        Self { dark_area_mm2, saturated_area_mm2, of_asked, of_measured_area_mm2, levels_assumed: loss.is_assumed }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_lost_is_not_minus_nothing() {
        let nothing: f64 = std::iter::empty::<f64>().sum();
        let loss =
            ExposureLoss { dark_area_mm2: nothing, saturated_area_mm2: -0.0, of_measured_area_mm2: -0.0, is_assumed: false };
        let text = serde_json::to_string(&ExposureLossDocument::of(&loss, 100.0)).expect("JSON");
        assert!(!text.contains('-'), "{text}");
    }
}
