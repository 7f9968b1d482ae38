//! Runs a numeric kernel with the widest vector instructions of the CPU at hand, chosen at run time, so that one binary
//! suits every x86-64 CPU. A kernel is plain Rust that the compiler vectorises; each level only widens the registers it
//! may use. Rust neither reorders floating-point sums nor contracts a·b + c, and every operation that a kernel uses is
//! correctly rounded by IEEE 754, so a kernel gives the same bits at every level.
//!
//! The only module with `unsafe`: a function compiled for instructions that the CPU may lack may be called only where it
//! has them. The proof is a value of [`SimdLevel`]: its fields are private, and [`SimdLevel::available`] makes one only
//! for instructions that were detected.

/// A computation that is compiled once a level.
pub trait Kernel {
    /// Result of the computation.
    type Output;

    /// The computation. Mark it, and what it calls in its loops, `#[inline(always)]`: only what is inlined here is
    /// compiled for the level's instructions.
    fn run(self) -> Self::Output;
}

/// Vector instructions that this CPU has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SimdLevel(Instructions);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Instructions {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl SimdLevel {
    /// The level of every CPU of the target: SSE2 on x86-64.
    pub const PORTABLE: Self = Self(Instructions::Portable);

    /// All levels of this CPU, narrowest first.
    #[must_use]
    pub fn available() -> Vec<Self> {
        #[cfg_attr(not(target_arch = "x86_64"), expect(unused_mut, reason = "one level there"))]
        let mut levels = vec![Self::PORTABLE];
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
            let avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl");
            levels.extend(avx2.then_some(Self(Instructions::Avx2)));
            levels.extend((avx2 && avx512).then_some(Self(Instructions::Avx512)));
        }
        levels
    }

    /// The widest level of this CPU.
    #[must_use]
    pub fn widest() -> Self {
        Self::available().last().copied().unwrap_or(Self::PORTABLE)
    }

    /// `portable`, `avx2`, `avx512`.
    #[must_use]
    pub fn as_str(self) -> &'static str {
        match self.0 {
            Instructions::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => "avx512",
        }
    }

    /// Runs `kernel` compiled for this level.
    #[inline]
    #[cfg_attr(target_arch = "x86_64", expect(unsafe_code, reason = "calls code compiled for instructions that were detected"))]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self.0 {
            Instructions::Portable => kernel.run(),
            // SAFETY: a value with these instructions is made in `available` alone, after they were detected, and a CPU
            // does not lose instructions while a process runs.
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2 => unsafe { with_avx2(kernel) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx512 => unsafe { with_avx512(kernel) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn with_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl")]
fn with_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

/// Asks for what lies behind a reference to be brought near the CPU, all of its cache lines; nothing else depends on it.
#[inline(always)]
#[cfg_attr(target_arch = "x86_64", expect(unsafe_code, reason = "calls an instruction that has no safe form"))]
#[cfg_attr(not(target_arch = "x86_64"), expect(unused_variables, reason = "nothing to ask for there"))]
pub(super) fn prefetch<T>(value: &T) {
    /// Bytes of a cache line.
    #[cfg(target_arch = "x86_64")]
    const LINE: usize = 64;
    #[cfg(target_arch = "x86_64")]
    for first in (0..size_of::<T>()).step_by(LINE) {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let line = std::ptr::from_ref(value).cast::<i8>().wrapping_add(first);
        // SAFETY: SSE is part of x86-64, and a prefetch reads nothing: it may be of any address.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(line) };
    }
}

/// The machine's minimum, for kernels: `b` where `a` is NaN. `f32::min` has a rule for either, at two to three times the
/// cost.
#[inline(always)]
#[must_use]
pub fn simd_min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The machine's maximum, for kernels: `b` where `a` is NaN.
#[inline(always)]
#[must_use]
pub fn simd_max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// `std::array::from_fn` for kernels. The library's, and `map` of an array, may be compiled apart from the kernel, without its
/// vector instructions, and called for every value.
#[inline(always)]
#[must_use]
pub fn simd_from_fn<T: Copy + Default, const N: usize>(value: impl Fn(usize) -> T) -> [T; N] {
    let mut values = [T::default(); N];
    for place in 0..N {
        values[place] = value(place);
    }
    values
}

/// The whole part of 0 ≤ x < 2²³, for kernels: what `as i32` gives, which the compiler turns into one conversion a lane.
/// Beyond those bounds any number.
#[inline(always)]
#[must_use]
pub fn floor_to_i32(x: f32) -> i32 {
    // At this size the step from one f32 to the next is 1: the sum is rounded to the nearest whole number, and its last
    // bits are that number.
    const STEPS_OF_ONE: f32 = 8_388_608.0;
    let sum = x + STEPS_OF_ONE;
    let nearest = sum.to_bits().wrapping_sub(STEPS_OF_ONE.to_bits()) as i32;
    nearest.wrapping_sub(i32::from(sum - STEPS_OF_ONE > x))
}

#[cfg(test)]
mod tests {
    use super::{Kernel, SimdLevel, floor_to_i32};

    #[test]
    fn whole_parts_are_those_of_a_conversion() {
        for number in (0..4096).chain([65_535, 1 << 20, (1 << 23) - 1]) {
            let first = number as f32;
            for x in [first, first.next_up(), first + 0.25, first + 0.5, first + 0.75, (first + 1.0).next_down()] {
                assert_eq!(floor_to_i32(x), x as i32, "{x}");
            }
        }
    }

    struct Polynomial<'a>(&'a mut [f32; 64]);

    impl Kernel for Polynomial<'_> {
        type Output = ();

        #[inline(always)]
        fn run(self) {
            for x in self.0 {
                *x = (*x * 1.1 + 0.3) * *x / (*x * *x + 1.0).sqrt();
            }
        }
    }

    #[test]
    fn every_level_gives_the_same_bits() {
        let values: [f32; 64] = std::array::from_fn(|i| (i as f32 - 31.7) * 0.37);
        let results: Vec<_> = SimdLevel::available()
            .into_iter()
            .map(|level| {
                let mut values = values;
                level.run(Polynomial(&mut values));
                values.map(f32::to_bits)
            })
            .collect();
        assert!(results.windows(2).all(|pair| pair[0] == pair[1]), "levels {:?} differ", SimdLevel::available());
    }

    #[test]
    fn the_widest_level_is_the_last_and_names_differ() {
        let names: Vec<_> = SimdLevel::available().into_iter().map(SimdLevel::as_str).collect();
        assert_eq!(names[0], "portable");
        assert_eq!(names.last(), Some(&SimdLevel::widest().as_str()));
        let distinct: std::collections::BTreeSet<_> = names.iter().collect();
        assert_eq!(distinct.len(), names.len());
    }
}
