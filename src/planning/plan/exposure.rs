//! Brightness of the views, and the area that is expected to be lost to darkness and saturation ([`crate::cell::Exposure`]).

/// Brightness of one view, where the materials of the surface are known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewExposure {
    /// Brightness level of each capture, ascending: one, or two at one pose.
    pub levels: Vec<u8>,
    /// Asked area that the view sees, whether it is lit well or not.
    pub seen_area_mm2: f64,
    /// Part of it that is too dark in every capture.
    pub dark_area_mm2: f64,
    /// Part of it that is saturated in a capture, and too dark or saturated in the others.
    pub saturated_area_mm2: f64,
}

impl ViewExposure {
    /// Share of the area seen that is too dark or saturated.
    #[must_use]
    pub fn lost(&self) -> f64 {
        super::share(self.dark_area_mm2 + self.saturated_area_mm2, self.seen_area_mm2)
    }
}

/// Asked area that some view sees and none captures neither too dark nor saturated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureLoss {
    /// Part that is too dark in every view that sees it.
    pub dark_area_mm2: f64,
    /// Part that is saturated in some view.
    pub saturated_area_mm2: f64,
    /// Part of either that counts as measured, since a level by itself would do, and its views are captured at others.
    pub of_measured_area_mm2: f64,
    /// True if the scanner's specification says nothing of its levels, so that they were assumed.
    pub is_assumed: bool,
}
