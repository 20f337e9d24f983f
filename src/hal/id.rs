//! Pins and groups without kind and type.

#[cfg(any(feature = "serde", feature = "std"))]
use super::GroupId;
use super::Handle;
use super::handle::Key;

/// A pin or parameter of any kind and type. The default belongs to no store.
///
/// ```
/// use mesa_hal::hal::{AnyValue, PinError, PinMaker, PinStore};
/// # fn main() -> Result<(), PinError> {
/// let mut store = PinStore::default();
/// let group = store.add_group();
/// let mut make = PinMaker::new(&mut store, group, "card.");
/// make.output::<bool>("lamp", false)?;
/// let lamp = store.id("card.lamp")?;
/// store.set_any(lamp, AnyValue::from(true))?;
/// assert_eq!(store.read_any(lamp).value.to_string(), "true");
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PinId(Key);

impl PinId {
    pub(super) const fn new(key: Key) -> Self {
        Self(key)
    }

    pub(super) const fn key(self) -> Key {
        self.0
    }

    /// Index of the pin or parameter in [`Pins::infos`](super::Pins::infos).
    pub const fn index(self) -> usize {
        self.0.index as usize
    }

    /// The store and the index in one word, for a queue.
    #[cfg(feature = "std")]
    pub(crate) const fn to_word(self) -> u64 {
        (self.0.store as u64) << 32 | self.0.index as u64
    }

    /// The pin or parameter from a word that [`to_word`](Self::to_word) returned.
    #[cfg(feature = "std")]
    pub(crate) const fn from_word(word: u64) -> Self {
        Self(Key {
            store: (word >> 32) as u32,
            index: word as u32,
        })
    }

    /// True if both belong to the same store.
    #[cfg(feature = "std")]
    pub(crate) const fn is_beside(self, other: Self) -> bool {
        self.0.store == other.0.store
    }

    /// The pin or parameter with the given index in the same store.
    #[cfg(feature = "std")]
    pub(crate) const fn beside(self, index: u32) -> Self {
        Self(Key {
            store: self.0.store,
            index,
        })
    }
}

#[cfg(feature = "std")]
impl GroupId {
    /// The store and the index in one word, for a queue.
    pub(crate) const fn to_word(self) -> u64 {
        PinId(self.0).to_word()
    }

    /// The group from a word that [`to_word`](Self::to_word) returned.
    pub(crate) const fn from_word(word: u64) -> Self {
        Self(PinId::from_word(word).0)
    }
}

#[cfg(feature = "serde")]
impl serde::Serialize for PinId {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_u32(self.0.index)
    }
}

#[cfg(feature = "serde")]
impl serde::Serialize for GroupId {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        PinId(self.0).serialize(serializer)
    }
}

/// The pin or parameter of a handle, without its kind and type.
impl<K, T> From<Handle<K, T>> for PinId {
    fn from(handle: Handle<K, T>) -> Self {
        Self(handle.key)
    }
}
