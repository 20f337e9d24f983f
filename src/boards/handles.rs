//! Arrays of handles.

use crate::hal::PinError;

/// An array of handles, each found by its number.
pub(super) fn handles<T: Copy + Default, const N: usize>(
    find: impl Fn(usize) -> Result<T, PinError>,
) -> Result<[T; N], PinError> {
    let mut all = [T::default(); N];
    for (n, handle) in all.iter_mut().enumerate() {
        *handle = find(n)?;
    }
    Ok(all)
}
