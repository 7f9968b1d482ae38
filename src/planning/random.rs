//! Pseudo-random numbers that depend on seed and position alone, never on threads: SplitMix64 (Steele, Lea, Flood 2014,
//! *Fast Splittable Pseudorandom Number Generators*).

use nalgebra::{Unit, Vector3};

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
}
