//! Pseudo-random numbers that depend on seed and position alone, never on threads: SplitMix64 (Steele, Lea, Flood 2014,
//! *Fast Splittable Pseudorandom Number Generators*).

use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};

/// Increment of SplitMix64: 2⁶⁴ divided by the golden ratio, odd.
const GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

/// Finaliser of SplitMix64.
#[must_use]
pub fn split_mix(seed: u64) -> u64 {
    let mut z = seed.wrapping_add(GAMMA);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A stream of numbers of its own for each seed and name.
pub struct Stream(u64);

impl Stream {
    /// The stream that `names` single out under `seed`.
    #[must_use]
    pub fn new(seed: u64, names: &[u64]) -> Self {
        Self(names.iter().fold(split_mix(seed), |state, name| split_mix(state ^ name)))
    }

    /// Uniform from 0 to below 1.
    pub fn unit(&mut self) -> f64 {
        let bits = split_mix(self.0) >> 11;
        self.0 = self.0.wrapping_add(GAMMA);
        bits as f64 / (1_u64 << 53) as f64
    }

    /// Uniform from −`half` to below `half`.
    pub fn within(&mut self, half: f64) -> f64 {
        (2.0 * self.unit() - 1.0) * half
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller 1958, *A Note on the Generation of Random Normal Deviates*).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }

    /// Uniform on the sphere.
    pub fn direction(&mut self) -> Unit<Vector3<f64>> {
        let (z, azimuth_rad) = (self.within(1.0), self.unit() * std::f64::consts::TAU);
        let across = (1.0 - z * z).sqrt();
        Unit::new_normalize(Vector3::new(across * azimuth_rad.cos(), across * azimuth_rad.sin(), z))
    }

    /// Three axes at right angles, right-handed, uniform over all rotations, so that each is uniform on the sphere (Shoemake 1992,
    /// *Uniform Random Rotations*, Graphics Gems III).
    pub fn axes(&mut self) -> [Unit<Vector3<f64>>; 3] {
        let across = self.unit();
        let [first_rad, second_rad] = [(); 2].map(|()| self.unit() * std::f64::consts::TAU);
        let [first, second] = [(1.0 - across).sqrt(), across.sqrt()];
        let [x, y, z] = [first * first_rad.sin(), first * first_rad.cos(), second * second_rad.sin()];
        let turn = UnitQuaternion::new_normalize(Quaternion::new(second * second_rad.cos(), x, y, z));
        [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()].map(|axis| turn * axis)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_axes_are_at_right_angles_and_each_is_spread_over_the_sphere() {
        const FRAMES: u32 = 4_000;
        let mut stream = Stream::new(7, &[]);
        let (mut sums, mut squares) = ([Vector3::<f64>::zeros(); 3], [Vector3::<f64>::zeros(); 3]);
        for _ in 0..FRAMES {
            let axes = stream.axes().map(Unit::into_inner);
            assert!((axes[0].cross(&axes[1]) - axes[2]).norm() < 1e-12, "{axes:?}");
            for (place, axis) in axes.iter().enumerate() {
                sums[place] += *axis;
                squares[place] += axis.component_mul(axis);
            }
        }
        // Standard errors of the means: √(1/3 / 4000) = 0.009, and √(4/45 / 4000) = 0.005.
        for (sum, square) in sums.iter().zip(&squares) {
            assert!((sum / f64::from(FRAMES)).amax() < 0.04, "{sum}");
            assert!((square / f64::from(FRAMES)).add_scalar(-1.0 / 3.0).amax() < 0.02, "{square}");
        }
    }
}
