//! Handles: what an application keeps of a pin.

use core::fmt;
use core::marker::PhantomData;

/// Where a pin or parameter is, and whose it is.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Key {
    /// The store's own number; 0 belongs to no store.
    pub store: u32,
    pub index: u32,
}

impl Key {
    pub const NOWHERE: Self = Self {
        store: 0,
        index: u32::MAX,
    };
}

/// A set of pins that work or fail together: those of one remote, or of the board itself.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct GroupId(pub(super) Key);

impl fmt::Debug for GroupId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "GroupId({}:{})", self.0.store, self.0.index)
    }
}

impl Default for GroupId {
    /// A group of no store.
    fn default() -> Self {
        Self(Key::NOWHERE)
    }
}

macro_rules! handle {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        pub struct $name<T> {
            pub(super) key: Key,
            value: PhantomData<fn() -> T>,
        }

        impl<T> $name<T> {
            pub(super) const fn new(key: Key) -> Self {
                Self { key, value: PhantomData }
            }

            /// A handle to nothing: reads are never valid, writes are ignored, both are counted
            /// by the store as uses of a foreign handle.
            pub const fn nowhere() -> Self {
                Self::new(Key::NOWHERE)
            }

            /// Whether this is a handle to nothing.
            pub const fn is_nowhere(&self) -> bool {
                self.key.store == 0
            }
        }

        impl<T> Clone for $name<T> {
            fn clone(&self) -> Self {
                *self
            }
        }

        impl<T> Copy for $name<T> {}

        impl<T> PartialEq for $name<T> {
            fn eq(&self, other: &Self) -> bool {
                self.key == other.key
            }
        }

        impl<T> Eq for $name<T> {}

        impl<T> Default for $name<T> {
            fn default() -> Self {
                Self::nowhere()
            }
        }

        impl<T> fmt::Debug for $name<T> {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{}({}:{})", stringify!($name), self.key.store, self.key.index)
            }
        }
    };
}

handle! {
    /// A pin that the machine sets and the application reads.
    ///
    /// Writing it does not compile:
    /// ```compile_fail,E0308
    /// use mesa_hal::hal::{Input, Pins};
    /// fn wrong(pins: &mut Pins, limit_switch: Input<bool>) {
    ///     pins.set(limit_switch, true);
    /// }
    /// ```
    /// while reading it does:
    /// ```
    /// use mesa_hal::hal::{Input, Pins};
    /// fn right(pins: &Pins, limit_switch: Input<bool>) -> bool {
    ///     pins.read(limit_switch).value
    /// }
    /// ```
    Input
}

handle! {
    /// A pin that the application sets and the machine follows.
    ///
    /// A pin of one type does not take the value of another:
    /// ```compile_fail,E0308
    /// use mesa_hal::hal::{Output, Pins};
    /// fn wrong(pins: &mut Pins, volts: Output<f64>) {
    ///     pins.set(volts, true);
    /// }
    /// ```
    Output
}

handle! {
    /// A pin that both sides set, such as `index-enable`: the application switches it on, the
    /// machine switches it off when the index came.
    InOut
}

handle! {
    /// A parameter: a setting of a pin, or of the remote itself.
    Param
}

/// Handles that can be read: [`Input`] and [`InOut`].
pub trait Readable<T>: sealed::Keyed {}
impl<T> Readable<T> for Input<T> {}
impl<T> Readable<T> for InOut<T> {}

/// The part of the handle traits that is the store's own business.
pub(super) mod sealed {
    use super::{InOut, Input, Key, Output, Param};

    pub trait Keyed: Copy {
        #[doc(hidden)]
        #[allow(private_interfaces)]
        fn key(self) -> Key;
    }

    macro_rules! keyed {
        ($name:ident) => {
            impl<T> Keyed for $name<T> {
                #[allow(private_interfaces)]
                fn key(self) -> Key {
                    self.key
                }
            }
        };
    }
    keyed!(Input);
    keyed!(Output);
    keyed!(InOut);
    keyed!(Param);
}
