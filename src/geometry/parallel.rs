//! Results of independent work on many items, in the order of the items on any number of threads. rayon's loop behind them is compiled
//! once, and not once more for every closure, as its iterators are: those made up a fifth of the code that a release build optimises.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// Blocks of items for each thread: enough that none waits long for the last, and that a lock for each costs nothing.
const BLOCKS_PER_THREAD: usize = 32;

/// Results of `work` for every item, in order.
pub(crate) fn map<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    joined(items.len(), of_blocks(items.len(), &|block| items[block].iter().map(&work).collect()))
}

/// Results of `work` for 0 … `count` − 1, in order.
pub(crate) fn map_range<R: Send>(count: usize, work: impl Fn(usize) -> R + Sync) -> Vec<R> {
    joined(count, of_blocks(count, &|block| block.map(&work).collect()))
}

/// Results of `work` for every item, in order. Once one has failed, no other is begun.
///
/// # Errors
/// The first error in the order of the items, of those that were met.
pub(crate) fn try_map<T: Sync, R: Send, E: Send>(items: &[T], work: impl Fn(&T) -> Result<R, E> + Sync) -> Result<Vec<R>, E> {
    try_map_range(items.len(), |index| work(&items[index]))
}

/// Results of `work` for 0 … `count` − 1, in order. Once one has failed, no other is begun.
///
/// # Errors
/// The first error in the order of the items, of those that were met, as of [`try_map`].
pub(crate) fn try_map_range<R: Send, E: Send>(count: usize, work: impl Fn(usize) -> Result<R, E> + Sync) -> Result<Vec<R>, E> {
    let has_failed = AtomicBool::new(false);
    let of_block = |block: Range<usize>| {
        let mut results = Vec::with_capacity(block.len());
        for index in block {
            if has_failed.load(Ordering::Relaxed) {
                break;
            }
            results.push(work(index).inspect_err(|_| has_failed.store(true, Ordering::Relaxed))?);
        }
        Ok(results)
    };
    let blocks = of_blocks(count, &of_block).into_iter().collect::<Result<_, E>>()?;
    Ok(joined(count, blocks))
}

/// Results of `work` for chunks of `length` items, the last of which may be shorter, in order. Once one has failed, no other is begun.
///
/// # Errors
/// The first error in the order of the chunks, of those that were met, as of [`try_map`].
pub(crate) fn try_map_chunks<T: Sync, R: Send, E: Send>(
    items: &[T],
    length: usize,
    work: impl Fn(&[T]) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E> {
    let of_chunk = |chunk: usize| work(&items[chunk * length..items.len().min((chunk + 1) * length)]);
    try_map_range(items.len().div_ceil(length), of_chunk)
}

/// Results of `of_block` for blocks that follow each other and hold 0 … `count` − 1.
fn of_blocks<B: Send>(count: usize, of_block: &(dyn Fn(Range<usize>) -> B + Sync)) -> Vec<B> {
    let length = count.div_ceil(BLOCKS_PER_THREAD * rayon::current_num_threads()).max(1);
    let blocks: Vec<Mutex<Option<B>>> = (0..count).step_by(length).map(|_| Mutex::new(None)).collect();
    for_each(blocks.len(), &|index| {
        let begin = index * length;
        let found = of_block(begin..count.min(begin + length));
        *blocks[index].lock().unwrap_or_else(PoisonError::into_inner) = Some(found);
    });
    blocks.into_iter().filter_map(|block| block.into_inner().unwrap_or_else(PoisonError::into_inner)).collect()
}

/// Does the work of 0 … `count` − 1 on all threads of the pool.
fn for_each(count: usize, work: &(dyn Fn(usize) + Sync)) {
    match count {
        1 => work(0),
        _ => (0..count).into_par_iter().for_each(work),
    }
}

/// All items of the blocks, `count` together.
fn joined<R>(count: usize, blocks: Vec<Vec<R>>) -> Vec<R> {
    let mut all = Vec::with_capacity(count);
    for mut block in blocks {
        all.append(&mut block);
    }
    all
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::AtomicUsize;

    use super::*;

    /// Numbers of items below, at and above one block a thread.
    const COUNTS: [usize; 6] = [0, 1, 2, 63, 64, 10_007];

    #[test]
    fn results_come_in_order() {
        for count in COUNTS {
            let items: Vec<usize> = (0..count).collect();
            let squares: Vec<usize> = items.iter().map(|item| item * item).collect();
            assert_eq!(map(&items, |item| item * item), squares);
            assert_eq!(map_range(count, |item| item * item), squares);
            assert_eq!(try_map(&items, |item| Ok::<_, ()>(item * item)), Ok(squares.clone()));
            assert_eq!(try_map_chunks(&items, 7, |chunk| Ok::<_, ()>(chunk.to_vec())).map(|chunks| chunks.concat()), Ok(items));
            assert_eq!(try_map_range(count, |item| Ok::<_, ()>(item * item)), Ok(squares));
        }
    }

    #[test]
    fn a_failure_is_returned_and_ends_the_rest() {
        let begun = AtomicUsize::new(0);
        let work = |item: usize| {
            begun.fetch_add(1, Ordering::Relaxed);
            if item == 700 { Err(item) } else { Ok(item) }
        };
        assert_eq!(try_map_range(701, work), Err(700), "the last");
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
        begun.store(0, Ordering::Relaxed);
        let count = 1_000_000;
        assert_eq!(alone.install(|| try_map_range(count, work)), Err(700));
        assert!(begun.load(Ordering::Relaxed) < count / 2, "{begun:?} of {count}");
    }
}
