//! Inputs that no controller would send: those of a corpus with bytes changed, cut out, doubled and joined, and plain noise.

/// Inputs of a fuzz test.
pub(crate) const INPUTS: usize = 1_000_000;
/// Largest input, bytes.
const MAX_BYTES: usize = 2048;

/// Calls `take` with [`INPUTS`] inputs, the same in every run.
pub(crate) fn each_mangled(corpus: &[impl AsRef<[u8]>], mut take: impl FnMut(&[u8])) {
    let corpus: Vec<&[u8]> = corpus.iter().map(AsRef::as_ref).collect();
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let mut input = Vec::with_capacity(MAX_BYTES);
    for _ in 0..INPUTS {
        input.clear();
        if random.below(16) == 0 {
            let length = random.below(64);
            input.extend((0..length).map(|_| random.next() as u8));
        } else {
            input.extend(corpus[random.below(corpus.len())]);
            (0..=random.below(4)).for_each(|_| mutate(&mut input, &corpus, &mut random));
            input.truncate(MAX_BYTES);
        }
        take(&input);
    }
}

fn mutate(input: &mut Vec<u8>, corpus: &[&[u8]], random: &mut Random) {
    let at = random.below(input.len() + 1);
    match random.below(6) {
        0 => input.truncate(at),
        1 => input.insert(at, random.next() as u8),
        2 => input.splice(at..at, corpus[random.below(corpus.len())].iter().copied()).for_each(drop),
        3 => input.drain(at..(at + random.below(8)).min(input.len())).for_each(drop),
        _ => {
            let byte = random.next() as u8;
            input.get_mut(at).into_iter().for_each(|place| *place = if byte & 1 == 0 { byte } else { *place ^ 1 << (byte >> 5) });
        }
    }
}

/// Marsaglia's xorshift64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 >> 11
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit.max(1) as u64) as usize
    }
}
