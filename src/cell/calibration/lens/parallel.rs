//! Independent results of numbered pieces of work, in their order whatever the number of threads.

use rayon::prelude::*;

/// Results of `work` for 0 … `count` − 1.
pub(super) fn each<T: Send>(count: usize, work: impl Fn(usize) -> T + Send + Sync) -> Vec<T> {
    (0..count).into_par_iter().map(work).collect()
}
