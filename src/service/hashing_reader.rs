//! A reader that hashes on the way, so that a file can be verified without being held in memory.

use std::io::{self, Read};

use sha2::{Digest, Sha256};

use crate::geometry::Poll;
use crate::wire::hex;

/// Bytes hashed at a time.
const PIECE_BYTES: usize = 1 << 20;

/// A reader that hashes all bytes read from it.
pub(crate) struct HashingReader<R> {
    source: R,
    hash: Sha256,
}

impl<R: Read> HashingReader<R> {
    /// A reader of `source`, from its first byte.
    pub(crate) fn new(source: R) -> Self {
        Self { source, hash: Sha256::new() }
    }

    /// Reads the rest and returns the SHA-256 of all bytes, lower-case hexadecimal; `None` if `poll` says stop.
    pub(crate) fn finish(mut self, poll: &Poll<'_>) -> io::Result<Option<String>> {
        let mut rest = Vec::new();
        while self.by_ref().take(PIECE_BYTES as u64).read_to_end(&mut rest)? > 0 {
            if poll.check().is_err() {
                return Ok(None);
            }
            rest.clear();
        }
        Ok(Some(hex(&self.hash.finalize())))
    }
}

impl<R: Read> Read for HashingReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.source.read(buffer)?;
        self.hash.update(&buffer[..count]);
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_that_of_all_bytes_however_many_were_read() {
        let bytes: Vec<u8> = (0..3_000_000_u32).map(|i| (i ^ i >> 7) as u8).collect();
        let wanted = hex(&Sha256::digest(&bytes));
        for read in [0, 1, 84, 2_000_000, bytes.len()] {
            let mut hashed = HashingReader::new(&bytes[..]);
            hashed.read_exact(&mut vec![0; read]).expect("there");
            assert_eq!(hashed.finish(&Poll::never()).expect("readable"), Some(wanted.clone()), "{read}");
        }
        assert_eq!(HashingReader::new(&bytes[..]).finish(&Poll::new(&|| true)).expect("readable"), None);
    }
}
