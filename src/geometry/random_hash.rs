//! A hash for tables of coordinates and names, keyed at random so that no file can choose colliding items: words are multiplied
//! to 128 bits, whose halves are folded: a multiplication a word. Tables lose time and nothing else to collisions.

use std::hash::{BuildHasher, Hasher, RandomState};

/// Makes hashes of one random key.
#[derive(Clone, Copy)]
pub(crate) struct RandomHash {
    key: [u64; 2],
}

/// Hash of what was written so far.
pub(crate) struct FoldedHash {
    state: u64,
    factor: u64,
}

impl RandomHash {
    pub(crate) fn new() -> Self {
        let random = RandomState::new();
        // An odd factor loses no bit of the words.
        Self { key: [random.hash_one(0), random.hash_one(1) | 1] }
    }
}

impl BuildHasher for RandomHash {
    type Hasher = FoldedHash;

    fn build_hasher(&self) -> FoldedHash {
        FoldedHash { state: self.key[0], factor: self.key[1] }
    }
}

impl FoldedHash {
    fn fold(a: u64, b: u64) -> u64 {
        let product = u128::from(a) * u128::from(b);
        product as u64 ^ (product >> 64) as u64
    }
}

impl Hasher for FoldedHash {
    fn write(&mut self, bytes: &[u8]) {
        let (words, rest) = bytes.as_chunks::<8>();
        words.iter().for_each(|word| self.write_u64(u64::from_le_bytes(*word)));
        if !rest.is_empty() {
            let mut word = [0; 8];
            word[..rest.len()].copy_from_slice(rest);
            self.write_u64(u64::from_le_bytes(word));
        }
    }

    fn write_u64(&mut self, word: u64) {
        // Turned, so that the same words in another order have another hash.
        self.state = Self::fold(self.state.rotate_left(23) ^ word, self.factor);
    }

    fn write_usize(&mut self, word: usize) {
        self.write_u64(word as u64);
    }

    fn finish(&self) -> u64 {
        Self::fold(self.state ^ self.factor.rotate_left(32), self.factor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbouring_points_fall_evenly_into_high_and_low_bits() {
        let hash = RandomHash::new();
        let (mut high, mut low) = (vec![0_u32; 256], vec![0_u32; 256]);
        for x in 0..64_i64 {
            for y in 0..64_i64 {
                for point in [[x, y, 0], [x, 0, -y], [(x as f64 / 8.0).to_bits() as i64, y << 40, 7]] {
                    let hash = hash.hash_one(point);
                    high[(hash >> 56) as usize] += 1;
                    low[hash as usize % 256] += 1;
                }
            }
        }
        // 48 are expected in each of the 256; more than three times that is no chance.
        assert!(high.iter().chain(&low).all(|count| *count < 150), "{high:?} {low:?}");
    }

    #[test]
    fn order_length_and_key_make_a_difference() {
        let hash = RandomHash::new();
        assert_ne!(hash.hash_one([1, 2, 3]), hash.hash_one([3, 2, 1]));
        assert_ne!(hash.hash_one(&b"ab"[..]), hash.hash_one(&b"ab\0"[..]));
        assert_eq!(hash.hash_one(&b"a name of a group"[..]), hash.hash_one(&b"a name of a group"[..]));
        assert_ne!(RandomHash::new().hash_one(7), RandomHash::new().hash_one(7));
    }
}
