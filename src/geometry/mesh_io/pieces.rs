//! Text in pieces that are parsed side by side. A piece ends where a line does, at a place that the format chooses, and what is
//! read does not depend on where: a reader takes over what it parsed of a piece only if that is all there and certain, and
//! parses again, from the piece's begin and knowing all that went before, where it is not.

use std::ops::Range;

use super::text::Lines;
use crate::geometry::parallel;
use crate::geometry::poll::{Interrupted, Poll};
use crate::geometry::side_by_side::pieces_of_a_round;

/// Bytes of a piece at least: many lines, and few enough that a round of pieces is soon over.
pub(super) const PIECE_BYTES: usize = 64 * 1024;
/// A piece of more than so many usual ones is parsed alone, by the thread that asks whether to go on.
const MAX_USUAL_PIECES: usize = 4;

/// Finds the first place, at or after one beyond the text's begin, where a piece may begin; the text's end if there is none.
pub(super) type NextBegin = fn(&[u8], usize, &Poll<'_>) -> usize;

/// Text that is cut into pieces.
pub(super) struct Pieces<'a> {
    text: &'a [u8],
    place: usize,
    piece_bytes: usize,
    next_begin: NextBegin,
    poll: &'a Poll<'a>,
}

impl<'a> Pieces<'a> {
    pub(super) fn new(text: &'a [u8], piece_bytes: usize, next_begin: NextBegin, poll: &'a Poll<'a>) -> Self {
        Self { text, place: 0, piece_bytes, next_begin, poll }
    }

    /// Places of the next pieces, to be parsed side by side; none at the end.
    pub(super) fn next_round(&mut self) -> Vec<Range<usize>> {
        let mut round = Vec::new();
        while self.place < self.text.len() && round.len() < pieces_of_a_round() {
            let end = (self.next_begin)(self.text, self.place + self.piece_bytes, self.poll);
            let is_long = is_long(end - self.place, self.piece_bytes);
            if is_long && !round.is_empty() {
                break;
            }
            round.push(self.place..end);
            self.place = end;
            if is_long {
                break;
            }
        }
        round
    }
}

/// Returns true for a piece that is parsed alone.
pub(super) fn is_long(bytes: usize, piece_bytes: usize) -> bool {
    bytes > MAX_USUAL_PIECES * piece_bytes
}

/// Parses the pieces of a round; results in order. One that is alone may be long, and asks `poll` on its way.
///
/// # Errors
/// [`Interrupted`].
pub(super) fn parse_round<P: Sync, R: Send>(
    round: &[P],
    parse: impl Fn(&P, &Poll<'_>) -> R + Sync,
    poll: &Poll<'_>,
) -> Result<Vec<R>, Interrupted> {
    poll.check()?;
    Ok(match round {
        [piece] => vec![parse(piece, poll)],
        _ => parallel::map(round, |piece| parse(piece, &Poll::never())),
    })
}

/// The first begin of a line.
pub(super) fn next_line(text: &[u8], from: usize, poll: &Poll<'_>) -> usize {
    // The line before may end in the byte before; between the two bytes of CRLF no line begins.
    let before = text.get(from - 1..).unwrap_or_default();
    match poll.position(before, |&b| b == b'\n' || b == b'\r') {
        Some(end) if before[end..].starts_with(b"\r\n") => from + end + 1,
        Some(end) => from + end,
        None => text.len(),
    }
}

/// The first begin of a line that does not continue the one before it, as one after `\` does.
pub(super) fn next_logical_line(text: &[u8], from: usize, poll: &Poll<'_>) -> usize {
    let mut place = next_line(text, from, poll);
    while poll.spend(20).is_ok() && place < text.len() {
        let before = &text[..place];
        let line = before.strip_suffix(b"\r\n").unwrap_or(&before[..place - 1]);
        if !line.ends_with(b"\\") {
            return place;
        }
        place = next_line(text, place + 1, poll);
    }
    text.len()
}

/// The first begin of a line whose first word is this, in any case.
pub(super) fn next_line_with(word: &[u8], text: &[u8], from: usize, poll: &Poll<'_>) -> usize {
    let mut lines = Lines::new(&text[next_line(text, from, poll)..], 1, poll);
    loop {
        let begin = text.len() - lines.rest().len();
        match lines.next() {
            None => return text.len(),
            Some(line) if line.tokens().next().is_some_and(|first| first.eq_ignore_ascii_case(word)) => return begin,
            Some(_) => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The text, at one place in memory.
    fn text() -> &'static [u8] {
        b"facet a\r\n\r\n outer \\\r\n\\\nloop\rFacet b\n\n\\\r\r"
    }

    /// Begins that are found from every place.
    fn begins(next_begin: NextBegin) -> Vec<usize> {
        let mut begins: Vec<usize> = (1..text().len() + 3).map(|from| next_begin(text(), from, &Poll::never())).collect();
        begins.dedup();
        begins
    }

    #[test]
    fn pieces_begin_where_lines_do() {
        // Once: a literal may lie at several places.
        let (poll, text) = (Poll::never(), text());
        let mut lines = Lines::new(text, 1, &poll).map(|line| line.text.as_ptr() as usize - text.as_ptr() as usize);
        assert_eq!(lines.next(), Some(0));
        let mut wanted: Vec<usize> = lines.collect();
        wanted.push(text.len());
        assert_eq!(begins(next_line), wanted);
    }

    #[test]
    fn continued_lines_stay_together_and_words_are_found() {
        assert_eq!(begins(next_logical_line), [9, 11, 28, 36, 37, text().len()]);
        assert_eq!(begins(|text, from, poll| next_line_with(b"facet", text, from, poll)), [28, text().len()]);
    }

    #[test]
    fn rounds_cover_the_text_and_leave_long_pieces_alone() {
        let text = [&b"a\n".repeat(1000)[..], &[b'x'; 100], b"\n", &b"b\n".repeat(10)].concat();
        let poll = Poll::never();
        let mut pieces = Pieces::new(&text, 8, next_line, &poll);
        let rounds: Vec<_> = std::iter::from_fn(|| Some(pieces.next_round()).filter(|round| !round.is_empty())).collect();
        let cut: Vec<u8> = rounds.iter().flatten().flat_map(|piece| text[piece.clone()].to_vec()).collect();
        assert_eq!(cut, text);
        let long = rounds.iter().find(|round| round.iter().any(|piece| piece.len() > 100)).expect("the long line");
        assert_eq!(long.len(), 1);
    }
}
