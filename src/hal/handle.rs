//! Handles: what an application keeps of a pin.

use core::fmt;
use core::marker::PhantomData;

use super::Value;

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
    /// ```compile_fail,E0277
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

impl<T> InOut<T> {
    /// The application's half of it: a handle that sets it and does not read it.
    pub const fn as_output(self) -> Output<T> {
        Output::new(self.key)
    }
}

/// A handle, and the type of what it is a handle of.
pub trait Handle: sealed::Keyed {
    /// What the pin or parameter holds.
    type Value: Value;
}

/// What an application reads: [`Input`] and [`InOut`].
#[diagnostic::on_unimplemented(message = "{Self} is no pin that can be read")]
pub trait Readable: Handle {}

/// What an application sets: [`Output`] and [`InOut`].
#[diagnostic::on_unimplemented(message = "{Self} is no pin that an application can set")]
pub trait Settable: Handle {}

/// What a driver gives values: [`Input`], [`InOut`] and [`Param`].
#[diagnostic::on_unimplemented(message = "{Self} is nothing that a driver can publish")]
pub trait Publishable: Handle {
    /// Outputs may depend on it.
    #[doc(hidden)]
    const IS_SHARED: bool;
}

impl<T: Value> Readable for Input<T> {}
impl<T: Value> Readable for InOut<T> {}
impl<T: Value> Settable for Output<T> {}
impl<T: Value> Settable for InOut<T> {}
impl<T: Value> Publishable for Input<T> {
    const IS_SHARED: bool = false;
}
impl<T: Value> Publishable for InOut<T> {
    const IS_SHARED: bool = true;
}
impl<T: Value> Publishable for Param<T> {
    const IS_SHARED: bool = true;
}

/// The part of the handle traits that is the store's own business.
pub(super) mod sealed {
    use super::{Handle, InOut, Input, Key, Output, Param, Value};

    pub trait Keyed: Copy {
        #[doc(hidden)]
        #[allow(private_interfaces)]
        fn key(self) -> Key;
    }

    macro_rules! keyed {
        ($($name:ident),*) => {$(
            impl<T> Keyed for $name<T> {
                #[allow(private_interfaces)]
                fn key(self) -> Key {
                    self.key
                }
            }

            impl<T: Value> Handle for $name<T> {
                type Value = T;
            }
        )*};
    }
    keyed!(Input, Output, InOut, Param);
}
