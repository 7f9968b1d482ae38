//! Order of items by a number each.
//!
//! One sort, of keys with their places, serves items of every type. `sort_by` is compiled anew for each closure, some six kilobytes each.

/// Sorts items by a number each, in ascending [total order](f64::total_cmp). The sort is stable, and each number is computed once.
pub fn sort_ascending<T>(items: &mut [T], number: impl FnMut(&T) -> f64) {
    let keys = items.iter().map(number).map(ascending_key).collect();
    arrange(items, order(keys));
}

/// Sorts items by a number each, in descending [total order](f64::total_cmp). The sort is stable, and each number is computed once.
pub fn sort_descending<T>(items: &mut [T], number: impl FnMut(&T) -> f64) {
    let keys = items.iter().map(number).map(|number| !ascending_key(number)).collect();
    arrange(items, order(keys));
}

/// Places of numbers in ascending order; equal numbers keep theirs.
#[must_use]
pub fn ascending(numbers: &[f64]) -> Vec<usize> {
    order(numbers.iter().copied().map(ascending_key).collect())
}

/// Places of numbers in descending order; equal numbers keep theirs.
#[must_use]
pub fn descending(numbers: &[f64]) -> Vec<usize> {
    order(numbers.iter().map(|number| !ascending_key(*number)).collect())
}

/// Integer whose order is the total order of the numbers (IEEE 754-2008, 5.10): sign and magnitude as two's complement.
fn ascending_key(number: f64) -> i64 {
    let bits = number.to_bits() as i64;
    bits ^ (((bits >> 63) as u64) >> 1) as i64
}

/// Places of keys in ascending order; equal keys keep theirs.
fn order(keys: Vec<i64>) -> Vec<usize> {
    let mut placed: Vec<(i64, usize)> = keys.into_iter().zip(0..).collect();
    placed.sort_unstable();
    placed.into_iter().map(|(_, place)| place).collect()
}

/// Brings items into the order of these places.
fn arrange<T>(items: &mut [T], mut order: Vec<usize>) {
    for at in 0..items.len() {
        // An item that was at a place before this one has been swapped to where this place's item went.
        let mut from = order[at];
        while from < at {
            from = order[from];
        }
        order[at] = from;
        items.swap(at, from);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_order_is_that_of_a_stable_sort(numbers in proptest::collection::vec(prop_oneof![any::<f64>(), (-2_i8..2).prop_map(f64::from)], 0..40)) {
            let numbered: Vec<(usize, f64)> = numbers.iter().copied().enumerate().collect();
            let (mut up, mut down) = (numbered.clone(), numbered.clone());
            up.sort_by(|a, b| a.1.total_cmp(&b.1));
            down.sort_by(|a, b| b.1.total_cmp(&a.1));
            let places = |sorted: &[(usize, f64)]| sorted.iter().map(|(place, _)| *place).collect::<Vec<_>>();
            prop_assert_eq!(ascending(&numbers), places(&up));
            prop_assert_eq!(descending(&numbers), places(&down));
            let (mut sorted, mut reversed) = (numbered.clone(), numbered);
            sort_ascending(&mut sorted, |(_, number)| *number);
            sort_descending(&mut reversed, |(_, number)| *number);
            prop_assert_eq!(places(&sorted), places(&up));
            prop_assert_eq!(places(&reversed), places(&down));
        }
    }
}
