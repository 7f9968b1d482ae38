//! Finds the number that an equal item got before, at about six bytes an item: the table holds numbers alone, and the items
//! stay where they are. Open addressing with linear probing (D. E. Knuth, *The Art of Computer Programming* 3, §6.4); the
//! hash is keyed at random, so that no file can choose colliding items. What it answers does not depend on the key.

use std::hash::{BuildHasher, Hash};

use super::poll::{Interrupted, Poll};
use super::random_hash::RandomHash;

/// Stands for no number.
const FREE: u32 = u32::MAX;
/// Slots of an empty table.
const MIN_SLOTS: usize = 64;

/// Open-addressing hash table from keys that lie elsewhere to dense ids.
pub(super) struct IdTable {
    slots: Vec<u32>,
    taken: usize,
    hash: RandomHash,
}

impl IdTable {
    /// A table that grows with its items.
    pub(super) fn new() -> Self {
        Self::for_items(0)
    }

    /// A table that holds so many items without growing.
    pub(super) fn for_items(items: usize) -> Self {
        let slots = (items + items.div_ceil(3) + 1).next_power_of_two().max(MIN_SLOTS);
        Self { slots: vec![FREE; slots], taken: 0, hash: RandomHash::new() }
    }

    /// The number of the item with this key; `new` is its number from now on if it had none. `key_of` gives the key of a
    /// number that the table was given.
    ///
    /// # Errors
    /// [`Interrupted`], while the table grows.
    pub(super) fn id<K: Hash + Eq>(
        &mut self,
        key: &K,
        new: u32,
        key_of: impl Fn(u32) -> K,
        poll: &Poll<'_>,
    ) -> Result<u32, Interrupted> {
        let slot = self.slot(key, &key_of);
        if self.slots[slot] != FREE {
            return Ok(self.slots[slot]);
        }
        self.slots[slot] = new;
        self.taken += 1;
        // At three quarters, probing is still short.
        if self.taken > self.slots.len() / 4 * 3 {
            self.grow(key_of, poll)?;
        }
        Ok(new)
    }

    /// Slot of the key, or the free one that it would take.
    fn slot<K: Hash + Eq>(&self, key: &K, key_of: impl Fn(u32) -> K) -> usize {
        let last = self.slots.len() - 1;
        let mut slot = self.hash.hash_one(key) as usize & last;
        while self.slots[slot] != FREE && key_of(self.slots[slot]) != *key {
            slot = (slot + 1) & last;
        }
        slot
    }

    fn grow<K: Hash>(&mut self, key_of: impl Fn(u32) -> K, poll: &Poll<'_>) -> Result<(), Interrupted> {
        let larger = vec![FREE; 2 * self.slots.len()];
        let last = larger.len() - 1;
        for id in std::mem::replace(&mut self.slots, larger).into_iter().filter(|id| *id != FREE) {
            poll.spend(50)?;
            let mut slot = self.hash.hash_one(key_of(id)) as usize & last;
            while self.slots[slot] != FREE {
                slot = (slot + 1) & last;
            }
            self.slots[slot] = id;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_items_get_the_first_ones_number_also_when_the_table_has_grown() {
        let mut table = IdTable::new();
        let items: Vec<u64> = (0..100_000).map(|i| i * i % 30_011).collect();
        let mut first = std::collections::HashMap::new();
        for (item, number) in items.iter().zip(0..) {
            let found = table.id(item, number, |id| items[id as usize], &Poll::never()).expect("not interrupted");
            assert_eq!(found, *first.entry(*item).or_insert(number));
        }
    }
}
