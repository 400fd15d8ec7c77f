//! Work that all threads share.
//!
//! Each closure that is given to rayon is compiled with its own copy of the machinery that splits and joins; here there is
//! one for each type of result. Where an item is too little work for a call through a pointer, a part is the item.

use rayon::prelude::*;

/// What `make` makes of every number below `count`, in their order.
pub fn map<T: Send>(count: usize, make: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    (0..count).into_par_iter().map(make).collect()
}

/// What `make` makes of every part of `size` items, the last of which may have fewer, with the number of its first item.
///
/// # Panics
/// When `size` is 0.
pub fn map_parts<I: Sync, T: Send>(items: &[I], size: usize, make: &(dyn Fn(usize, &[I]) -> T + Sync)) -> Vec<T> {
    map(items.len().div_ceil(size), &|part| {
        let first = part * size;
        make(first, &items[first..items.len().min(first + size)])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_cover_all_items_in_order() {
        let items: Vec<usize> = (0..1003).collect();
        for size in [1, 10, 1003, 5000] {
            let parts = map_parts(&items, size, &|first, part| {
                assert_eq!(part[0], first);
                part.to_vec()
            });
            assert_eq!(parts.concat(), items);
        }
        assert!(map_parts(&items[..0], 7, &|_, _| ()).is_empty());
    }
}
