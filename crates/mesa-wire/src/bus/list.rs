//! Prepared lists of accesses.

use super::Access;
use alloc::boxed::Box;
use core::any::Any;
use core::fmt::Debug;

/// The form in which a bus runs a list of accesses: the accesses themselves, or an encoded packet.
pub trait ListForm: Any + Debug + Send {
    /// The accesses of the list.
    fn accesses(&self) -> &[Access];
}

impl ListForm for Box<[Access]> {
    fn accesses(&self) -> &[Access] {
        self
    }
}

/// A list of accesses that a bus has checked, in the form in which it runs them.
///
/// Made by [`RegisterBus::prepare`](super::RegisterBus::prepare). The accesses can still be read
/// from it, on every bus.
#[derive(Debug)]
pub struct AccessList(Box<dyn ListForm>);

impl AccessList {
    /// A list for a bus that runs the accesses as they are.
    pub fn new(accesses: &[Access]) -> Self {
        Self::encoded(Box::<[Access]>::from(accesses))
    }

    /// A list in a form of the bus's own.
    pub fn encoded(form: impl ListForm) -> Self {
        Self(Box::new(form))
    }

    /// The form of the list. `None` if it has another one: a bus of another type prepared it.
    pub fn form<F: ListForm>(&self) -> Option<&F> {
        let form: &dyn Any = &*self.0;
        form.downcast_ref()
    }
}

impl AsRef<[Access]> for AccessList {
    fn as_ref(&self) -> &[Access] {
        self.0.accesses()
    }
}
