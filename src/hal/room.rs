//! Room for pins.

use alloc::vec::Vec;

/// Smallest number of elements for which room is made.
const LEAST_ROOM: usize = 16;

/// Makes room for one more element: an eighth more than there are, where a vector would double. A
/// machine has hundreds of pins, and a controller little memory.
pub(super) fn for_one_more<T>(all: &mut Vec<T>) -> &mut Vec<T> {
    if all.len() == all.capacity() {
        all.reserve_exact((all.len() / 8).max(LEAST_ROOM));
    }
    all
}
