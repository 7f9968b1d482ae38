//! Points evenly spread and the same everywhere (J. H. Halton, *Numerische Mathematik* 2, 1960).

/// One base an axis.
pub(super) const PRIMES: [u32; 7] = [2, 3, 5, 7, 11, 13, 17];

/// Element `index` of the sequence in `base`, 0 to 1.
pub(super) fn halton(mut index: u32, base: u32) -> f64 {
    let (mut fraction, mut value) = (1.0, 0.0);
    while index > 0 {
        fraction /= f64::from(base);
        value += fraction * f64::from(index % base);
        index /= base;
    }
    value
}
