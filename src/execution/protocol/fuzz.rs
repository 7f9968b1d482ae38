//! Inputs that no peer would send: messages with bytes changed, left out, doubled and cut, and plain noise.

/// Inputs of one codec.
pub(crate) const INPUTS: usize = 1_000_000;

/// Hands [`INPUTS`] inputs to `take`, made from `messages`.
pub(crate) fn fuzz(messages: &[Vec<u8>], mut take: impl FnMut(&[u8])) {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    for round in 0..INPUTS {
        let mut input = messages[random.below(messages.len())].clone();
        if round % 8 == 0 {
            input = (0..random.below(40)).map(|_| random.below(256) as u8).collect();
        }
        for _ in 0..random.below(4) {
            let at = random.below(input.len().max(1));
            match random.below(4) {
                0 if at < input.len() => input[at] = random.below(256) as u8,
                1 if at < input.len() => drop(input.remove(at)),
                2 => input.truncate(at),
                _ => input.extend_from_within(at.min(input.len())..),
            }
        }
        take(&input);
    }
}

/// G. Marsaglia, "Xorshift RNGs", Journal of Statistical Software 8(14), 2003.
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % limit.max(1) as u64) as usize
    }
}
