//! Pins and parameters in HAL's shared memory.
//!
//! The only place where pointers into that memory are followed. Other threads and processes read
//! and write the same values, so each access is a single relaxed atomic load or store of the type
//! that HAL has there; HAL itself promises no more. A pin is reached through its pointer in HAL's
//! memory each time, because `net` and `unlinkp` turn the pointer to a signal and back at run time.

#![expect(
    unsafe_code,
    reason = "pointers into HAL's memory; each block has its reason"
)]

use core::ffi::{CStr, c_int, c_void};
use core::fmt;
use core::ptr::NonNull;
use core::sync::atomic::{AtomicI32, AtomicPtr, AtomicU8, AtomicU32, AtomicU64, Ordering};

use mesa_hal::hal::{HalType, Role, Value};

use crate::ffi::{self, ComponentId, HalError};
use crate::table::Memory;

/// A type of HAL: its number there, and its place in memory.
pub(crate) trait HalValue: Value {
    /// The value in memory. All of its bit patterns are valid.
    type Cell: fmt::Debug;
    /// HAL's number of the type.
    const CODE: c_int;

    fn load(cell: &Self::Cell) -> Self;
    fn store(cell: &Self::Cell, value: Self);
}

macro_rules! hal_value {
    ($type:ty, $cell:ty, $code:literal, $from:expr, $to:expr) => {
        impl HalValue for $type {
            type Cell = $cell;
            const CODE: c_int = $code;

            fn load(cell: &$cell) -> Self {
                $from(cell.load(Ordering::Relaxed))
            }

            fn store(cell: &$cell, value: Self) {
                cell.store($to(value), Ordering::Relaxed);
            }
        }
    };
}

hal_value!(bool, AtomicU8, 1, |bits| bits != 0, u8::from);
hal_value!(f64, AtomicU64, 2, f64::from_bits, f64::to_bits);
hal_value!(i32, AtomicI32, 3, |bits| bits, |value| value);
hal_value!(u32, AtomicU32, 4, |bits| bits, |value| value);

/// A pin or parameter: a pointer in HAL's memory, to its value. The pointer of a parameter always
/// leads to the same value.
#[derive(Debug)]
struct HalPointer<T: HalValue>(NonNull<AtomicPtr<T::Cell>>);

impl<T: HalValue> HalPointer<T> {
    fn cell(&self) -> &T::Cell {
        // SAFETY: the pointer was made from a slot of HAL's memory, which outlives this value (see
        // `HalMemory`), and is aligned there. HAL writes it as a whole.
        let pointer = unsafe { self.0.as_ref() }.load(Ordering::Relaxed);
        // SAFETY: for a parameter, `HalMemory::add` has set the pointer, to another slot. For a
        // pin, `hal_pin_new` has set it, and HAL sets it to nothing but a value of the pin's type
        // in its memory: that of a signal, or the pin's own. A signal that was deleted leaves a
        // place in HAL's memory, which is never unmapped before the component ends. Others access
        // the value too, and so does this component by atomic operations only.
        unsafe { &*pointer }
    }

    fn bits(&self) -> u64 {
        T::load(self.cell()).to_bits()
    }

    fn set_bits(&self, bits: u64) {
        T::store(self.cell(), T::from_bits(bits));
    }
}

/// A pin or parameter of any type.
#[derive(Debug)]
enum AnyPointer {
    Bit(HalPointer<bool>),
    Float(HalPointer<f64>),
    S32(HalPointer<i32>),
    U32(HalPointer<u32>),
}

impl AnyPointer {
    fn bits(&self) -> u64 {
        match self {
            Self::Bit(bit) => bit.bits(),
            Self::Float(number) => number.bits(),
            Self::S32(number) => number.bits(),
            Self::U32(number) => number.bits(),
        }
    }

    fn set_bits(&self, bits: u64) {
        match self {
            Self::Bit(bit) => bit.set_bits(bits),
            Self::Float(number) => number.set_bits(bits),
            Self::S32(number) => number.set_bits(bits),
            Self::U32(number) => number.set_bits(bits),
        }
    }
}

/// The pins and parameters of a board, by numbers in the order in which they were made.
///
/// It is dropped, and not used any more, before `hal_exit` is called for its component: until then
/// HAL's memory is there.
pub(crate) struct HalMemory {
    component: ComponentId,
    slots: Slots,
    pointers: Vec<AnyPointer>,
}

impl fmt::Debug for HalMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "HalMemory({} of {:?})",
            self.pointers.len(),
            self.component
        )
    }
}

// SAFETY: the pointers lead to memory of the whole process, which no thread owns, and are used for
// atomic operations only.
unsafe impl Send for HalMemory {}

/// Reason why a pin or parameter could not be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum MemoryError {
    /// `hal_malloc` has failed.
    #[error("HAL's memory is used up")]
    Full,
    /// More pins and parameters than there was room for.
    #[error("there are more pins than expected")]
    Slots,
    /// HAL has refused it.
    #[error("HAL refuses it (error {0}); another component may have a pin of this name")]
    Refused(c_int),
}

impl From<HalError> for MemoryError {
    fn from(HalError(number): HalError) -> Self {
        Self::Refused(number)
    }
}

impl HalMemory {
    /// Allocates room for pins and parameters with these roles.
    pub fn new(
        component: ComponentId,
        roles: impl ExactSizeIterator<Item = Role>,
    ) -> Result<Self, MemoryError> {
        let pointers = Vec::with_capacity(roles.len());
        // A pointer, and the value of a parameter.
        let slots = roles.map(|role| 1 + usize::from(role.is_param())).sum();
        Ok(Self {
            component,
            slots: Slots::new(slots)?,
            pointers,
        })
    }

    /// Makes a pin or parameter with the direction of its role, and returns its number. Numbers of
    /// 64 bits, which HAL 2.9 does not have, become 32 bits.
    pub fn add(
        &mut self,
        name: &CStr,
        role: Role,
        hal_type: HalType,
    ) -> Result<usize, MemoryError> {
        let pointer = match hal_type {
            HalType::Bit => AnyPointer::Bit(self.pointer(name, role)?),
            HalType::Float => AnyPointer::Float(self.pointer(name, role)?),
            HalType::S32 | HalType::S64 => AnyPointer::S32(self.pointer(name, role)?),
            HalType::U32 | HalType::U64 => AnyPointer::U32(self.pointer(name, role)?),
        };
        self.pointers.push(pointer);
        Ok(self.pointers.len() - 1)
    }

    fn pointer<T: HalValue>(
        &mut self,
        name: &CStr,
        role: Role,
    ) -> Result<HalPointer<T>, MemoryError> {
        let pointer = self.slots.take()?.cast::<*mut c_void>();
        let direction = direction(role);
        let result = if role.is_param() {
            let value = self.slots.take()?.cast::<c_void>().as_ptr();
            // SAFETY: the slot is of HAL's memory, large enough and aligned for a pointer, and
            // nothing else uses it yet.
            unsafe { pointer.write(value) };
            // SAFETY: the name ends with NUL, and HAL copies it. The slot is of HAL's memory, and
            // large enough and aligned for a value of any type.
            unsafe {
                ffi::hal_param_new(name.as_ptr(), T::CODE, direction, value, self.component.0)
            }
        } else {
            let pointer = pointer.as_ptr();
            // SAFETY: as above; the slot takes a pointer, which HAL sets before it returns.
            unsafe {
                ffi::hal_pin_new(name.as_ptr(), T::CODE, direction, pointer, self.component.0)
            }
        };
        if result < 0 {
            return Err(MemoryError::Refused(result));
        }
        Ok(HalPointer(pointer.cast()))
    }
}

impl Memory for HalMemory {
    fn load(&self, index: usize) -> u64 {
        self.pointers.get(index).map_or(0, AnyPointer::bits)
    }

    fn store(&mut self, index: usize, bits: u64) {
        if let Some(pointer) = self.pointers.get(index) {
            pointer.set_bits(bits);
        }
    }
}

/// HAL's number of a direction.
const fn direction(role: Role) -> c_int {
    match role {
        Role::Output => 16,
        Role::Input => 32,
        Role::InOut => 48,
        Role::Property => 64,
        Role::Setting | Role::InRemote => 192,
    }
}

/// Unused slots of HAL's memory, each for a pointer or for a value of any type.
#[derive(Debug)]
struct Slots {
    next: NonNull<u64>,
    left: usize,
}

impl Slots {
    fn new(count: usize) -> Result<Self, MemoryError> {
        let bytes = count.saturating_mul(size_of::<u64>());
        let start = ffi::allocate(bytes).ok_or(MemoryError::Full)?.cast::<u64>();
        if !start.is_aligned() {
            return Err(MemoryError::Full);
        }
        // SAFETY: HAL has returned that many bytes, aligned, which nothing else uses yet.
        unsafe { start.write_bytes(0, count) };
        Ok(Self {
            next: start,
            left: count,
        })
    }

    fn take(&mut self) -> Result<NonNull<u64>, MemoryError> {
        self.left = self.left.checked_sub(1).ok_or(MemoryError::Slots)?;
        let slot = self.next;
        // SAFETY: there were `left` slots before the subtraction, so this one exists, and the
        // next address is at most the end of the memory.
        self.next = unsafe { slot.add(1) };
        Ok(slot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The pointer of a pin to its value, in the place of HAL's memory.
    fn pointer_to<C>(value: &C) -> AtomicPtr<C> {
        AtomicPtr::new(core::ptr::from_ref(value).cast_mut())
    }

    #[test]
    fn pin_follows_the_pointer_of_its_signal() {
        let (own, signal) = (AtomicU32::new(1), AtomicU32::new(2));
        let pointer = pointer_to(&own);
        let pin = HalPointer::<u32>(NonNull::from(&pointer));
        assert_eq!(pin.bits(), 1);
        pointer.store(core::ptr::from_ref(&signal).cast_mut(), Ordering::Relaxed);
        assert_eq!(pin.bits(), 2);
        pin.set_bits(3);
        assert_eq!(
            (own.into_inner(), signal.load(Ordering::Relaxed)),
            (1, 3),
            "the signal has it, and the pin's own value stays"
        );
    }

    #[test]
    fn bit_is_one_byte_and_any_other_than_0_is_on() {
        let bytes = [AtomicU8::new(7), AtomicU8::new(7)];
        let pointer = pointer_to(&bytes[0]);
        let bit = HalPointer::<bool>(NonNull::from(&pointer));
        assert_eq!(bit.bits(), 1);
        bit.set_bits(1);
        bit.set_bits(0);
        let bytes = bytes.map(AtomicU8::into_inner);
        assert_eq!(bytes, [0, 7], "the neighbour stays");
    }

    proptest! {
        #[test]
        fn values_of_any_type_are_kept(float: f64, signed: i32, unsigned: u32, bit: bool) {
            let (f, s, u, b) = (AtomicU64::new(0), AtomicI32::new(0), AtomicU32::new(0), AtomicU8::new(0));
            let pointers = (pointer_to(&f), pointer_to(&s), pointer_to(&u), pointer_to(&b));
            let mut memory = HalMemory {
                component: ComponentId(0),
                slots: Slots { next: NonNull::dangling(), left: 0 },
                pointers: vec![
                    AnyPointer::Float(HalPointer(NonNull::from(&pointers.0))),
                    AnyPointer::S32(HalPointer(NonNull::from(&pointers.1))),
                    AnyPointer::U32(HalPointer(NonNull::from(&pointers.2))),
                    AnyPointer::Bit(HalPointer(NonNull::from(&pointers.3))),
                ],
            };
            let values = [float.to_bits(), signed.to_bits(), unsigned.to_bits(), bit.to_bits()];
            for (index, bits) in values.into_iter().enumerate() {
                memory.store(index, bits);
            }
            for (index, bits) in values.into_iter().enumerate() {
                prop_assert_eq!(memory.load(index), bits);
            }
            prop_assert_eq!(memory.load(values.len()), 0, "no such pin");
        }
    }

    #[test]
    fn directions_are_hals() {
        let all = [
            Role::Output,
            Role::Input,
            Role::InOut,
            Role::Property,
            Role::Setting,
            Role::InRemote,
        ];
        assert_eq!(all.map(direction), [16, 32, 48, 64, 192, 192]);
    }
}
