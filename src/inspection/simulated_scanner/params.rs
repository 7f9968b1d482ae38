//! Knobs of the simulated scanner. By default it returns all that its optics see, without noise beyond that of the plan.

use crate::cell::{FieldError, Findings};
use crate::planning::params::knob::params;

params! {
    /// The simulated scanner: its grid, its noise, its weaknesses, and the errors of its poses.
    SimulationParams {
        /// Every n-th pixel of the left camera, in both directions, has a point.
        step_px: u32 = 1, [1.0, 64.0] "px";
        /// Seed of everything random.
        seed: u64 = 0;
        /// Standard deviation across a surface that is seen straight on at the best focus, mm; 0 is none. The default is
        /// `regions.noise.best_mm` of the plan.
        noise_best_mm: Option<f64> = None, [0.0, 10.0] "mm";
        /// Relative increase of the noise at the ends of the working depth. The default is `regions.noise.depth_gain` of the plan.
        noise_depth_gain: Option<f64> = None, [0.0, 100.0] "";
        /// Standard deviation of noise that neighbouring pixels share, as an error of the disparity, pixels.
        correlated_noise_px: f64 = 0.0, [0.0, 10.0] "px";
        /// Distance over which pixels share it.
        correlation_px: f64 = 20.0, [1.0, 1000.0] "px";
        /// Worst incidences between which the rate of return falls from 1 to 0; none, or two, ascending.
        grazing_deg: Vec<f64> = Vec::new(), [0.0, 90.0] "°", entries [0, 2];
        /// Angle around the mirror direction of the projector's light within which a camera sees nothing but glare; 0 is none.
        lobe_deg: f64 = 0.0, [0.0, 90.0] "°";
        /// Distance from a step of depth within which nothing returns, pixels; 0 is none.
        edge_px: f64 = 0.0, [0.0, 1000.0] "px";
        /// Smallest depth discontinuity that counts as an edge, mm.
        edge_step_mm: f64 = 5.0, [0.01, 1000.0] "mm";
        /// Distance from a concave corner within which nothing returns; 0 is none.
        concave_mm: f64 = 0.0, [0.0, 100.0] "mm";
        /// Angle between the faces of a corner, measured in the air, below which it is concave.
        concave_dihedral_deg: f64 = 120.0, [1.0, 175.0] "°";
        /// Diffuse albedo of the part where no other is given.
        albedo: f64 = 0.5, [0.0, 1.0] "";
        /// Brightness level of the projector.
        brightness: u8 = 5, [0.0, 9.0] "";
        /// Signals, relative to that of albedo 0.5 seen straight on at the best focus and level 5, between which a point returns;
        /// none, or two, ascending.
        signal: Vec<f64> = Vec::new(), [0.0, 1e6] "", entries [0, 2];
        /// Angle by which each view is turned off its pose, about an axis at random.
        view_error_deg: f64 = 0.0, [0.0, 180.0] "°";
        /// Distance by which each view is shifted off its pose, in a direction at random.
        view_error_mm: f64 = 0.0, [0.0, 1e4] "mm";
        /// Angle by which the part is turned off its pose, about an axis at random through the centre of its box.
        part_error_deg: f64 = 0.0, [0.0, 180.0] "°";
        /// Distance by which the part is shifted off its pose, in a direction at random.
        part_error_mm: f64 = 0.0, [0.0, 1e4] "mm";
        /// Points of plate and fixture return too.
        with_surroundings: bool = false;
    }
}

impl SimulationParams {
    /// Checks every range; pointers begin with `/sim`.
    ///
    /// # Errors
    /// Every value that is out of its range.
    pub fn check(&self) -> Result<(), Vec<FieldError>> {
        let mut findings = Findings::default();
        self.check_ranges("/sim", &mut findings);
        let mut check_pair = |name: &str, pair: &[f64]| {
            let is_pair = pair.is_empty() || pair.len() == 2 && pair[0] < pair[1];
            findings
                .require(is_pair, format!("/sim/{name}"), || format!("is {pair:?}; allowed are no numbers, or two, ascending"));
        };
        check_pair("grazing_deg", &self.grazing_deg);
        check_pair("signal", &self.signal);
        findings.into_result()
    }
}
