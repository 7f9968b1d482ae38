//! The time of paths that are run without stopping, beside Python's toppra on the same curves.

use std::time::Instant;

use serde_json::json;
use vantage::cell::time_parameterisation::SmoothPath;
use vantage::cell::{Configuration, Presets, SpecLibrary};

use crate::support::{lines_of, oracle_python};

/// Paths asked about.
const PATHS: usize = 40;
const SPEED_FRACTION: f64 = 0.25;

/// Corners of a path, up to a radian from zero, of which there are 2 to 9.
fn corners(path: usize) -> Vec<Configuration> {
    let step = |axis: usize| [2.0_f64, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0][axis].sqrt();
    let at = |corner: usize| {
        let axes_rad = std::array::from_fn(|axis| 2.0 * ((10 * path + corner + 1) as f64 * step(axis)).fract() - 1.0);
        Configuration::from_axes_rad(axes_rad)
    };
    (0..2 + path % 8).map(at).collect()
}

#[test]
fn times_are_those_of_toppra() {
    let Some(python) = oracle_python() else { return };
    let axes = Presets.cell("e05-transcan").expect("a preset").build(&Presets).expect("a valid preset").axes();
    // Tight corners, and wide ones.
    let tolerance_rad = |path: usize| [0.1_f64, 1.0, 5.0][path % 3].to_radians();
    let paths: Vec<_> = (0..PATHS).map(|path| SmoothPath::through(&corners(path), tolerance_rad(path))).collect();
    let limit = |of: fn(&vantage::cell::Axis) -> f64| axes.0.iter().map(|axis| of(axis) * SPEED_FRACTION).collect::<Vec<_>>();
    let ask = |path: &SmoothPath| {
        let pieces: Vec<_> = path
            .pieces()
            .iter()
            .map(|p| json!({"length": p.length_rad, "start": p.start_rad.axes_rad(), "slope": p.slope, "bend": p.bend_per_rad}))
            .collect();
        let [speed, acceleration] = [limit(|axis| axis.max_speed_rad_per_s), limit(|axis| axis.max_acceleration_rad_per_s2)];
        format!("{}\n", json!({"speed": speed, "acceleration": acceleration, "pieces": pieces}))
    };
    let theirs = lines_of(&python, "time_law_oracle.py", &[], paths.iter().map(ask).collect());
    let start = Instant::now();
    let ours: Vec<f64> = paths.iter().map(|path| path.secs(&axes, SPEED_FRACTION)).collect();
    let ms = start.elapsed().as_secs_f64() * 1e3 / PATHS as f64;
    let off = ours.iter().zip(&theirs).map(|(ours, theirs)| ours / theirs.parse::<f64>().expect("seconds") - 1.0);
    let (least, most) = off.fold((0.0_f64, 0.0_f64), |(least, most), off| (least.min(off), most.max(off)));
    println!("{PATHS} paths: {:.2} to {:.2} % of toppra's times, {ms:.2} ms a path", 100.0 * least, 100.0 * most);
    assert!(least > -0.01 && most < 0.01, "{least} to {most}");
}
