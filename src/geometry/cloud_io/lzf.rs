//! Unpacks LZF, the compression of PCD files (M. Lehmann's liblzf): an instruction below 32 copies so many bytes and one; others
//! repeat 3 to 264 bytes from up to 8192 bytes before. Only those 8192 bytes are held; what is unpacked goes to a sink.

/// Farthest that a repetition reaches back.
const WINDOW: usize = 8192;

/// A fault at a byte of the packed data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Corrupt {
    pub(super) at: usize,
}

/// Unpacks `packed`, which has to give `length` bytes, to `sink`, some thousand at a time.
pub(super) fn unpack<E>(
    packed: &[u8],
    length: u64,
    mut sink: impl FnMut(&[u8]) -> Result<(), E>,
) -> Result<Result<(), Corrupt>, E> {
    let mut held: Vec<u8> = Vec::with_capacity(4 * WINDOW);
    // Bytes of `held` that the sink has, and bytes that went before them.
    let (mut given, mut dropped, mut at) = (0, 0_u64, 0);
    while at < packed.len() {
        let begin = at;
        let corrupt = Corrupt { at: begin };
        let code = usize::from(packed[at]);
        at += 1;
        if code < 32 {
            let Some(plain) = packed.get(at..at + code + 1) else { return Ok(Err(corrupt)) };
            held.extend_from_slice(plain);
            at += code + 1;
        } else {
            let mut count = code >> 5;
            if count == 7 {
                let Some(more) = packed.get(at) else { return Ok(Err(corrupt)) };
                count += usize::from(*more);
                at += 1;
            }
            let Some(low) = packed.get(at) else { return Ok(Err(corrupt)) };
            at += 1;
            let back = ((code & 31) << 8 | usize::from(*low)) + 1;
            let Some(from) = held.len().checked_sub(back) else { return Ok(Err(corrupt)) };
            for index in 0..count + 2 {
                held.push(held[from + index]);
            }
        }
        if dropped + held.len() as u64 > length {
            return Ok(Err(corrupt));
        }
        if held.len() >= 3 * WINDOW {
            sink(&held[given..])?;
            let drop = held.len() - WINDOW;
            held.drain(..drop);
            (given, dropped) = (held.len(), dropped + drop as u64);
        }
    }
    sink(&held[given..])?;
    Ok(if dropped + held.len() as u64 == length { Ok(()) } else { Err(Corrupt { at }) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unpacked(packed: &[u8], length: u64) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        let end = unpack(packed, length, |part| {
            bytes.extend_from_slice(part);
            Ok::<(), ()>(())
        });
        end.expect("the sink takes all").ok().map(|()| bytes)
    }

    #[test]
    fn copies_and_repetitions_give_the_text_back_and_faults_are_found() {
        assert_eq!(unpacked(b"\x02abc\x20\x02", 6).as_deref(), Some(&b"abcabc"[..]));
        assert_eq!(unpacked(b"\x00a\xe0\x05\x00", 15).as_deref(), Some(&b"a".repeat(15)[..]));
        let long = [&b"\x00a"[..], &[0xe0, 0xff, 0x00].repeat(1000)].concat();
        assert_eq!(unpacked(&long, 264_001), Some(b"a".repeat(264_001)));
        for (packed, length) in
            [(&b"\x02ab"[..], 3), (b"\x20\x00", 3), (b"\xe0", 9), (b"\xe0\x01", 9), (b"\x00a", 2), (b"\x02abc", 2)]
        {
            assert_eq!(unpacked(packed, length), None, "{packed:?}");
        }
    }
}
