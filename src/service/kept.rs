//! Values of the keys used lately: as many as fit, the one unused for longest gives way.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Values with their keys, the one used last first.
#[derive(Debug)]
pub(super) struct Kept<T> {
    max: usize,
    entries: Mutex<VecDeque<(String, T)>>,
}

impl<T: Clone> Kept<T> {
    /// Room for `max` values.
    pub(super) fn new(max: usize) -> Self {
        Self { max, entries: Mutex::default() }
    }

    /// Value of a key; asking counts as use.
    pub(super) fn get(&self, key: &str) -> Option<T> {
        let mut entries = self.lock();
        let at = entries.iter().position(|(other, _)| other == key)?;
        let entry = entries.remove(at)?;
        let value = entry.1.clone();
        entries.push_front(entry);
        Some(value)
    }

    /// Keeps a value, in place of an earlier one of the same key.
    pub(super) fn put(&self, key: String, value: T) {
        let mut entries = self.lock();
        entries.retain(|(other, _)| *other != key);
        entries.push_front((key, value));
        entries.truncate(self.max);
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<(String, T)>> {
        // Whole after every operation, also where a thread died in between.
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::Kept;

    #[test]
    fn the_value_unused_for_longest_gives_way() {
        let kept = Kept::new(2);
        kept.put("a".into(), 1);
        kept.put("b".into(), 2);
        assert_eq!(kept.get("a"), Some(1));
        kept.put("c".into(), 3);
        assert_eq!([kept.get("a"), kept.get("b"), kept.get("c")], [Some(1), None, Some(3)]);
        kept.put("a".into(), 4);
        assert_eq!([kept.get("a"), kept.get("c")], [Some(4), Some(3)]);
        assert_eq!(kept.lock().len(), 2);
    }
}
