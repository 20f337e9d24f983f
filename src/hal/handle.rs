//! Handles: small copyable references to pins, kept by an application.

use core::marker::PhantomData;

/// Position of a pin or parameter, and the store that it belongs to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(super) struct Key {
    /// The store's own number; 0 belongs to no store.
    pub store: u32,
    pub index: u32,
}

/// A set of pins that work or fail together: those of one remote, or of the board itself. The
/// default belongs to no store.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct GroupId(pub(super) Key);

/// A handle of a pin or parameter of type `T`; its kind `K` determines the permitted operations:
/// see [`Input`], [`Output`], [`InOut`] and [`Param`].
///
/// The default refers to nothing: reads are never valid, writes are ignored, and the store counts
/// both as uses of a foreign handle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Handle<K, T> {
    pub(super) key: Key,
    of: PhantomData<(K, T)>,
}

impl<K: PartialEq, T: PartialEq> Eq for Handle<K, T> {}

impl<K, T> Handle<K, T> {
    pub(super) const fn new(key: Key) -> Self {
        Self {
            key,
            of: PhantomData,
        }
    }
}

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
pub type Input<T> = Handle<kind::InputKind, T>;

/// A pin that the application sets and the machine follows.
///
/// A pin of one type does not take the value of another:
/// ```compile_fail,E0308
/// use mesa_hal::hal::{Output, Pins};
/// fn wrong(pins: &mut Pins, volts: Output<f64>) {
///     pins.set(volts, true);
/// }
/// ```
pub type Output<T> = Handle<kind::OutputKind, T>;

/// A pin that both sides set, such as `index-enable`: the application switches it on, the machine
/// switches it off when the index has come.
pub type InOut<T> = Handle<kind::InOutKind, T>;

/// A parameter: a setting of a pin, or of the remote itself.
pub type Param<T> = Handle<kind::ParamKind, T>;

impl<T> InOut<T> {
    /// The machine's half: a handle that reads or publishes the pin and does not set it.
    pub const fn as_input(self) -> Input<T> {
        Input::new(self.key)
    }

    /// The application's half: a handle that sets the pin and does not read it.
    pub const fn as_output(self) -> Output<T> {
        Output::new(self.key)
    }
}

/// Kinds of handles, and the operations that each permits.
pub(crate) mod kind {
    /// Kind of an [`Input`](super::Input).
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub struct InputKind;

    /// Kind of an [`Output`](super::Output).
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub struct OutputKind;

    /// Kind of an [`InOut`](super::InOut).
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub struct InOutKind;

    /// Kind of a [`Param`](super::Param).
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub struct ParamKind;

    /// Kinds of handles that an application can read: those of [`Input`](super::Input) and
    /// [`InOut`](super::InOut).
    #[diagnostic::on_unimplemented(message = "{Self} is not a pin that can be read")]
    pub trait Readable: Copy {}
    impl Readable for InputKind {}
    impl Readable for InOutKind {}

    /// Kinds of handles that an application can set: those of [`Output`](super::Output) and
    /// [`InOut`](super::InOut).
    #[diagnostic::on_unimplemented(message = "{Self} is not a pin that an application can set")]
    pub trait Settable: Copy {}
    impl Settable for OutputKind {}
    impl Settable for InOutKind {}

    /// Kinds of handles to which a driver can give values.
    #[diagnostic::on_unimplemented(message = "{Self} is not a pin that a driver can publish")]
    pub trait Publishable: Copy {}
    impl Publishable for InputKind {}
    impl Publishable for InOutKind {}
    impl Publishable for ParamKind {}
}
