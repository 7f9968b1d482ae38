use super::SmoothPath;
use crate::cell::{Axes, Configuration, Presets, SpecLibrary};

fn axes() -> Axes {
    Presets.cell("e05-transcan").expect("preset").build(&Presets).expect("builds").axes()
}

/// Evenly spread configurations, up to a radian from zero.
fn spread(count: usize) -> Vec<Configuration> {
    let step = |axis: usize| [2.0_f64, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0][axis].sqrt();
    let at = |i: usize| std::array::from_fn(|axis| 2.0 * (i as f64 * step(axis)).fract() - 1.0);
    (1..=count).map(|i| Configuration::from_axes_rad(at(i))).collect()
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
        let place = super::Piece::at;
        let end = |piece: &super::Piece| {
            let t = piece.length_rad;
            (place(piece, t), super::map(|a| piece.slope[a] + t * piece.bend_per_rad[a]))
        };
        for pair in path.pieces().windows(2) {
            let (place, slope) = end(&pair[0]);
            let off_slope = slope.iter().zip(&pair[1].slope).map(|(a, b)| (b - a).powi(2)).sum::<f64>().sqrt();
            assert!(place.distance_rad(&pair[1].start_rad) < 1e-12 && off_slope < 1e-9);
        }
        assert_eq!(path.pieces()[0].start_rad, points[0]);
        assert!(end(path.pieces().last().expect("pieces")).0.distance_rad(&points[11]) < 1e-12);
        for (corner, piece) in points[1..11].iter().zip(path.pieces().iter().filter(|piece| !piece.is_straight())) {
            let off = corner.max_turn_rad(&place(piece, 0.5 * piece.length_rad));
            assert!(off <= tolerance_rad * (1.0 + 1e-9) && off > 0.9 * tolerance_rad, "{off}");
            let chords = piece.chords();
            assert!(chords.len() > 5 && chords[0] == piece.start_rad, "{}", chords.len());
            for (chord, ends) in chords.windows(2).enumerate() {
                let share = (chord as f64 + 0.5) / (chords.len() - 1) as f64;
                let off = ends[0].toward(&ends[1], 0.5).max_turn_rad(&place(piece, share * piece.length_rad));
                assert!(off <= super::CHORD_RAD * (1.0 + 1e-6), "{off}");
            }
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
