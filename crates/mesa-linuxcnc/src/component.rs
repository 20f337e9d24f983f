//! The functions of the cycle, the end, and panics.

use core::ffi::{c_long, c_void};
#[cfg(debug_assertions)]
use core::sync::atomic::{AtomicI32, Ordering};
use core::time::Duration;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};

use mesa_hal::bus::DynBus;
use mesa_hal::transport::Recording;

use crate::MAX_BOARDS;
use crate::cycle::Cycle;
use crate::ffi::{ComponentId, Function, Level};
use crate::interface::Interface;
use crate::log::at_set_up;
use crate::memory::HalMemory;

/// A function of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Step {
    Read,
    Write,
    RequestRead,
    ReadGpio,
    WriteGpio,
}

impl Step {
    /// The functions that a board has.
    pub const fn all(interface: Interface) -> &'static [Self] {
        match interface {
            Interface::Ethernet => &[Self::Read, Self::Write, Self::RequestRead],
            Interface::Pci => &[
                Self::Read,
                Self::Write,
                Self::RequestRead,
                Self::ReadGpio,
                Self::WriteGpio,
            ],
        }
    }

    /// True for a function of a thread that is faster than that of the cycle.
    const fn is_fast(self) -> bool {
        matches!(self, Self::ReadGpio | Self::WriteGpio)
    }

    /// The end of the function's name in HAL.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Write => "write",
            Self::RequestRead => "read-request",
            Self::ReadGpio => "read_gpio",
            Self::WriteGpio => "write_gpio",
        }
    }

    /// The function that HAL's threads call, with the number of the board as its argument.
    pub fn function(self) -> Function {
        extern "C" fn read(board: *mut c_void, period: c_long) {
            run(board.addr(), Step::Read, period);
        }
        extern "C" fn write(board: *mut c_void, period: c_long) {
            run(board.addr(), Step::Write, period);
        }
        extern "C" fn request_read(board: *mut c_void, period: c_long) {
            run(board.addr(), Step::RequestRead, period);
        }
        extern "C" fn read_gpio(board: *mut c_void, period: c_long) {
            run(board.addr(), Step::ReadGpio, period);
        }
        extern "C" fn write_gpio(board: *mut c_void, period: c_long) {
            run(board.addr(), Step::WriteGpio, period);
        }
        match self {
            Self::Read => read,
            Self::Write => write,
            Self::RequestRead => request_read,
            Self::ReadGpio => read_gpio,
            Self::WriteGpio => write_gpio,
        }
    }
}

pub(crate) type BoardCycle = Cycle<Recording<DynBus>, HalMemory>;

/// The boards that are loaded. A lock is poisoned by a panic in the cycle of its board, which does
/// nothing any more then.
static BOARDS: [Mutex<Option<BoardCycle>>; MAX_BOARDS] = [const { Mutex::new(None) }; MAX_BOARDS];

/// The component, while it is loaded.
static COMPONENT: Mutex<Option<ComponentId>> = Mutex::new(None);

/// For tests, hence in no release: the number of calls of a function up to a panic.
#[cfg(debug_assertions)]
pub(crate) static PANIC_IN: AtomicI32 = AtomicI32::new(0);

/// Counts a call; true if it should panic.
#[cfg(debug_assertions)]
fn count_to_panic() -> bool {
    PANIC_IN.load(Ordering::Relaxed) > 0 && PANIC_IN.fetch_sub(1, Ordering::Relaxed) == 1
}

/// Keeps the component for its end.
pub(crate) fn keep(component: ComponentId) {
    *locked(&COMPONENT) = Some(component);
}

/// Hands a board to the functions of the cycle.
pub(crate) fn keep_board(number: usize, cycle: BoardCycle) {
    if let Some(slot) = BOARDS.get(number) {
        *locked(slot) = Some(cycle);
    }
}

/// Does a step of a board, in a thread of HAL.
///
/// A panic ends the board's cycle: its watchdog then switches its outputs off, and LinuxCNC goes
/// on.
///
/// # Real time
/// That of the step. A board whose step another thread does at this moment is left out.
fn run(board: usize, step: Step, period: c_long) {
    let Some(place) = BOARDS.get(board) else {
        return;
    };
    let result = catch_unwind(AssertUnwindSafe(|| {
        let mut guard = match lock(place, step) {
            Ok(guard) => guard,
            // After a panic. HAL may have changed what was shown then.
            Err(TryLockError::Poisoned(cycle)) => return abandon(&mut cycle.into_inner()),
            // Another thread has the board.
            Err(TryLockError::WouldBlock) => return,
        };
        let Some(cycle) = guard.as_mut() else {
            return;
        };
        #[cfg(debug_assertions)]
        assert!(!count_to_panic(), "a panic on request");
        let period = Duration::from_nanos(u64::try_from(period).unwrap_or(0));
        match step {
            Step::Read => cycle.read(period),
            Step::Write => {
                cycle.write(period);
                cycle.print_bus();
            }
            Step::RequestRead => cycle.request_read(period),
            Step::ReadGpio => cycle.read_gpio(),
            Step::WriteGpio => cycle.write_gpio(),
        }
    }));
    if result.is_err() {
        let mut cycle = locked(place);
        abandon(&mut cycle);
        let (name, step) = (cycle.as_ref().map_or("a board", Cycle::name), step.name());
        at_set_up(
            Level::Error,
            &format_args!(
                "a panic in {name}.{step}, whose text is above, is an error of the component itself: the board \
                 is not driven any more, and its watchdog switches its outputs off; load it again"
            ),
        );
    }
}

/// Tries of a function of the cycle to get a board that a faster thread has: some ten microseconds.
/// That thread needs it for a few accesses.
const TRIES: u32 = 2_000;

/// The board for a step. A faster thread is not held up: it leaves a board out that the cycle has.
fn lock(
    place: &Mutex<Option<BoardCycle>>,
    step: Step,
) -> Result<MutexGuard<'_, Option<BoardCycle>>, TryLockError<MutexGuard<'_, Option<BoardCycle>>>> {
    for _ in 1..TRIES {
        match place.try_lock() {
            Err(TryLockError::WouldBlock) if !step.is_fast() => core::hint::spin_loop(),
            locked => return locked,
        }
    }
    place.try_lock()
}

/// Shows in HAL that a board is not driven after a panic.
fn abandon(cycle: &mut Option<BoardCycle>) {
    if let Some(cycle) = cycle {
        cycle.show_abandoned();
    }
}

/// Stops all boards, and removes the component.
pub(crate) fn unload() {
    for place in &BOARDS {
        let _ = catch_unwind(AssertUnwindSafe(|| stop(place)));
    }
    if let Some(component) = locked(&COMPONENT).take() {
        component.exit();
    }
}

fn stop(place: &Mutex<Option<BoardCycle>>) {
    match place.lock() {
        Ok(mut cycle) => {
            if let Some(cycle) = cycle.take() {
                cycle.stop();
            }
        }
        // The state of its driver is unknown, and its watchdog has bitten: it is left as it is,
        // without its pins, which HAL removes.
        Err(poisoned) => core::mem::forget(poisoned.into_inner().take()),
    }
    place.clear_poison();
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
