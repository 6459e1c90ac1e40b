//! Collecting into a vector of fixed room.

use heapless::Vec;

/// The items, as many as there is room for. Every caller has room for all; `heapless`' own `collect` panics
/// where there is none, and the compiler cannot tell that it never comes to that (`./ci.sh panics`).
pub fn collect<T, const N: usize>(items: impl IntoIterator<Item = T>) -> Vec<T, N> {
    let mut vec = Vec::new();
    for item in items {
        if vec.push(item).is_err() {
            break;
        }
    }
    vec
}
