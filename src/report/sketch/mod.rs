//! Sketches of hardware as standalone SVG files, for its user to see what was meant: a scanner from the side; a cell from above and
//! from the side. To scale; lengths in millimetres.

mod cell;
mod scanner;
#[cfg(test)]
mod tests;

pub use cell::cell_svg;
pub use scanner::scanner_svg;

/// Map of millimetres to the drawing: x to the right, y up.
#[derive(Clone, Copy, Debug)]
struct Scale {
    /// Place of the origin in the drawing.
    origin: [f64; 2],
    per_mm: f64,
}

impl Scale {
    /// The largest scale at which a range of millimetres fits a window, centred in it.
    fn fit(x_mm: [f64; 2], y_mm: [f64; 2], at: [f64; 2], size: [f64; 2]) -> Self {
        let [width_mm, height_mm] = [x_mm, y_mm].map(|[from, to]| (to - from).max(1.0));
        let per_mm = (size[0] / width_mm).min(size[1] / height_mm);
        let [middle_x, middle_y] = [x_mm, y_mm].map(|[from, to]| 0.5 * (from + to));
        let centre = [at[0] + 0.5 * size[0], at[1] + 0.5 * size[1]];
        Self { origin: [centre[0] - per_mm * middle_x, centre[1] + per_mm * middle_y], per_mm }
    }

    fn at(&self, [x_mm, y_mm]: [f64; 2]) -> [f64; 2] {
        [self.origin[0] + self.per_mm * x_mm, self.origin[1] - self.per_mm * y_mm]
    }

    fn length(&self, length_mm: f64) -> f64 {
        self.per_mm * length_mm
    }
}

/// Range of numbers, grown to hold each of `values`.
fn range(values: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let finite = values.into_iter().filter(|value| value.is_finite());
    finite.fold([0.0, 0.0], |[low, high], value| [low.min(value), high.max(value)])
}
