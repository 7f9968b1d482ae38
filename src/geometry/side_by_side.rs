//! Loops over many items on all cores that can be given up: short rounds, with a look between two of them. What
//! comes out does not depend on the number of threads.

use std::ops::Range;

use rayon::prelude::*;

use super::poll::{Interrupted, Poll};
use crate::geometry::parallel;

/// Items of a piece of work.
pub(super) const PIECE: usize = 16_384;
/// Pieces of a round for each thread, so that none waits long for the last.
const PIECES_PER_THREAD: usize = 4;

/// Number of pieces that are worked on between two looks.
pub(super) fn pieces_of_a_round() -> usize {
    PIECES_PER_THREAD * rayon::current_num_threads()
}

/// Places of so many items, piece by piece.
pub(super) fn ranges(items: usize) -> Vec<Range<usize>> {
    (0..items).step_by(PIECE).map(|begin| begin..items.min(begin + PIECE)).collect()
}

/// Results of all pieces, in order.
///
/// # Errors
/// [`Interrupted`].
pub(super) fn map<P: Sync, R: Send>(pieces: &[P], work: impl Fn(&P) -> R + Sync, poll: &Poll<'_>) -> Result<Vec<R>, Interrupted> {
    let mut results = Vec::with_capacity(pieces.len());
    for round in pieces.chunks(pieces_of_a_round()) {
        poll.check()?;
        match round {
            [piece] => results.push(work(piece)),
            _ => results.append(&mut parallel::map(round, &work)),
        }
    }
    Ok(results)
}

/// Works on every piece, which may hold what is to be changed.
///
/// # Errors
/// [`Interrupted`].
pub(super) fn for_each<P: Send>(mut pieces: Vec<P>, work: impl Fn(&mut P) + Sync, poll: &Poll<'_>) -> Result<(), Interrupted> {
    for round in pieces.chunks_mut(pieces_of_a_round()) {
        poll.check()?;
        match round {
            [piece] => work(piece),
            _ => round.par_iter_mut().for_each(&work),
        }
    }
    Ok(())
}

/// Changes every item.
///
/// # Errors
/// [`Interrupted`]; some items are then changed, others not.
pub(super) fn change<T: Send>(items: &mut [T], work: impl Fn(&mut T) + Sync, poll: &Poll<'_>) -> Result<(), Interrupted> {
    for_each(items.chunks_mut(PIECE).collect(), |piece| piece.iter_mut().for_each(&work), poll)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    #[test]
    fn results_come_in_order_and_every_item_is_changed_once() {
        let mut items: Vec<usize> = (0..10 * PIECE + 7).collect();
        let sums = map(&ranges(items.len()), |range| items[range.clone()].iter().sum::<usize>(), &Poll::never());
        let wanted: Vec<usize> = items.chunks(PIECE).map(|chunk| chunk.iter().sum()).collect();
        assert_eq!(sums.expect("not interrupted"), wanted);
        change(&mut items, |item| *item += 1, &Poll::never()).expect("not interrupted");
        assert!(items.iter().enumerate().all(|(place, item)| *item == place + 1));
    }

    #[test]
    fn work_is_given_up_between_two_rounds() {
        let looks = Cell::new(0);
        let second = || {
            looks.set(looks.get() + 1);
            looks.get() == 2
        };
        let pieces = vec![(); pieces_of_a_round() + 1];
        assert_eq!(map(&pieces, |()| (), &Poll::new(&second)), Err(Interrupted));
        assert_eq!(for_each(pieces, |()| (), &Poll::new(&|| true)), Err(Interrupted));
    }
}
