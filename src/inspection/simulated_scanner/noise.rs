//! Noise of a simulated view: independent from cell to cell, and shared by neighbouring pixels.

use super::SimulatedScanner;
use crate::planning::random::Stream;

/// Names of the streams of random numbers.
const CELL: u64 = 0x6365_6c6c;
const SHARED: u64 = 0x7368_6172_6564;
const RETURN: u64 = 0x7265_7475_726e;

/// Random numbers of one view.
pub(super) struct ViewNoise {
    seed: u64,
    viewpoint: u64,
    correlated_px: f64,
    correlation_px: f64,
    columns: usize,
    step_px: f64,
    /// Change of depth with the disparity at 1 mm, 1 / (f · b), per px and mm.
    depth_per_px: f64,
}

impl ViewNoise {
    pub(super) fn new(scanner: &SimulatedScanner<'_>, viewpoint: u32) -> Self {
        let [left, right] = scanner.scanner.devices.cameras();
        let baseline_mm = (right.scanner_from_device.origin_mm() - left.scanner_from_device.origin_mm()).norm();
        Self {
            seed: scanner.sim.seed,
            viewpoint: u64::from(viewpoint),
            correlated_px: scanner.sim.correlated_noise_px,
            correlation_px: scanner.sim.correlation_px,
            columns: scanner.grid.size.columns,
            step_px: scanner.grid.step_px,
            depth_per_px: 1.0 / (left.lens.focal_px() * baseline_mm),
        }
    }

    /// A normal number of a cell's own.
    pub(super) fn of_cell(&self, cell: usize) -> f64 {
        Stream::new(self.seed, &[CELL, self.viewpoint, cell as u64]).normal()
    }

    /// A uniform number of a cell's own, from 0 to below 1: a point returns where it is below the rate of return.
    pub(super) fn draw(&self, cell: usize) -> f64 {
        Stream::new(self.seed, &[RETURN, self.viewpoint, cell as u64]).unit()
    }

    /// Error of the depth that a cell shares with its neighbours, mm: normal numbers on a lattice over the image, joined
    /// linearly and scaled to the same deviation everywhere, as an error of the disparity; dz = z² / (f · b) · dd.
    pub(super) fn shared_mm(&self, cell: usize, depth_mm: f64) -> f64 {
        if self.correlated_px <= 0.0 {
            return 0.0;
        }
        let place = [cell % self.columns, cell / self.columns].map(|number| number as f64 * self.step_px / self.correlation_px);
        let [column, row] = place.map(f64::floor);
        let [s, t] = [place[0] - column, place[1] - row];
        let (mut sum, mut squares) = (0.0, 0.0);
        for (right, down, weight) in [(0, 0, (1.0 - s) * (1.0 - t)), (1, 0, s * (1.0 - t)), (0, 1, (1.0 - s) * t), (1, 1, s * t)]
        {
            let names = [SHARED, self.viewpoint, column as u64 + right, row as u64 + down];
            sum += weight * Stream::new(self.seed, &names).normal();
            squares += weight * weight;
        }
        self.correlated_px * sum / squares.sqrt() * depth_mm * depth_mm * self.depth_per_px
    }
}
