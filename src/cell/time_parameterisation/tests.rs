use super::SmoothPath;
use crate::cell::{Axes, Configuration, Presets, SpecLibrary};

fn axes() -> Axes {
    Presets.cell("e05-transcan").expect("preset").build(&Presets).expect("builds").axes()
}

/// Evenly spread configurations, up to a radian from zero.
fn spread(count: usize) -> Vec<Configuration> {
    let step = |axis: usize| [2.0_f64, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0][axis].sqrt();
    (1..=count).map(|i| std::array::from_fn(|axis| 2.0 * (i as f64 * step(axis)).fract() - 1.0)).collect()
}

#[test]
fn a_straight_way_takes_the_time_of_the_trapezoid() {
    let axes = axes();
    for ends in spread(40).windows(2) {
        let exact = axes.move_secs(&ends[0], &ends[1], 0.25);
        let found = SmoothPath::through(ends, 0.001).secs(&axes, 0.25);
        // Where speed first meets its limit between two grid points, the grid is a little late.
        assert!((found / exact - 1.0).abs() < 2e-3, "{found} for {exact}");
    }
}

#[test]
fn the_curve_passes_its_corners_within_the_tolerance_and_has_no_kink() {
    for tolerance_rad in [1e-3, 2e-2] {
        let points = spread(12);
        let path = SmoothPath::through(&points, tolerance_rad);
        let end = |piece: &super::Piece| {
            let t = piece.length_rad;
            let place = super::map(|a| piece.start_rad[a] + t * piece.slope[a] + 0.5 * t * t * piece.bend_per_rad[a]);
            (place, super::map(|a| piece.slope[a] + t * piece.bend_per_rad[a]))
        };
        for pair in path.pieces().windows(2) {
            let (place, slope) = end(&pair[0]);
            let off = |a: &Configuration, b: &Configuration| super::joint_distance_rad(a, b);
            assert!(off(&place, &pair[1].start_rad) < 1e-12 && off(&slope, &pair[1].slope) < 1e-9);
        }
        assert_eq!(path.pieces()[0].start_rad, points[0]);
        assert!(super::joint_distance_rad(&end(path.pieces().last().expect("pieces")).0, &points[11]) < 1e-12);
        for (corner, piece) in points[1..11].iter().zip(path.pieces().iter().filter(|piece| piece.bend_per_rad != [0.0; 7])) {
            let t = 0.5 * piece.length_rad;
            let middle = super::map(|a| piece.start_rad[a] + t * piece.slope[a] + 0.5 * t * t * piece.bend_per_rad[a]);
            let off = super::map(|a| (middle[a] - corner[a]).abs()).into_iter().fold(0.0, f64::max);
            assert!(off <= tolerance_rad * (1.0 + 1e-9) && off > 0.9 * tolerance_rad, "{off}");
        }
    }
}

#[test]
fn not_stopping_is_quicker_and_a_wider_corner_quicker_still() {
    let axes = axes();
    let points = spread(9);
    let stops = axes.path_secs(&points, 0.25);
    let secs = |tolerance_rad| SmoothPath::through(&points, tolerance_rad).secs(&axes, 0.25);
    let [sharp, wide] = [1e-3, 5e-2].map(secs);
    assert!(wide < sharp && sharp < stops, "{wide} {sharp} {stops}");
    assert_eq!(SmoothPath::through(&points[..1], 0.1).secs(&axes, 0.25), 0.0);
    assert_eq!(SmoothPath::through(&[points[0], points[0]], 0.1).secs(&axes, 0.25), 0.0);
}
