//! The functions of HAL, RTAPI and the C library that the component calls.
//!
//! The declarations are those of the interface of LinuxCNC 2.9, `hal.h` and `rtapi.h`, written
//! anew.

#![expect(
    unsafe_code,
    reason = "functions of an interface in C; each block has its reason"
)]

use core::ffi::{CStr, c_char, c_int, c_long, c_uint, c_void};
use core::ptr::NonNull;
use core::sync::atomic::{AtomicPtr, Ordering};

unsafe extern "C" {
    fn hal_init(name: *const c_char) -> c_int;
    safe fn hal_ready(component: c_int) -> c_int;
    safe fn hal_exit(component: c_int) -> c_int;
    safe fn hal_malloc(size: c_long) -> *mut c_void;
    fn hal_export_funct(
        name: *const c_char,
        function: Function,
        argument: *mut c_void,
        uses_float: c_int,
        is_reentrant: c_int,
        component: c_int,
    ) -> c_int;
    pub(crate) fn hal_pin_new(
        name: *const c_char,
        kind: c_int,
        direction: c_int,
        pointer: *mut *mut c_void,
        component: c_int,
    ) -> c_int;
    pub(crate) fn hal_param_new(
        name: *const c_char,
        kind: c_int,
        direction: c_int,
        value: *mut c_void,
        component: c_int,
    ) -> c_int;
    fn hal_param_alias(name: *const c_char, alias: *const c_char) -> c_int;
    fn rtapi_print_msg(level: c_int, format: *const c_char, ...);
    // Of the C library.
    fn dladdr(address: *const c_void, symbol: *mut Symbol) -> c_int;
    safe fn setfsuid(user: c_uint) -> c_int;
}

/// `Dl_info` of the C library.
#[repr(C)]
struct Symbol {
    file: *const c_char,
    base: *mut c_void,
    name: *const c_char,
    address: *mut c_void,
}

/// A function that a thread of HAL calls with the argument of its export and the thread's period in
/// ns.
pub(crate) type Function = extern "C" fn(*mut c_void, c_long);

/// Level of a message. LinuxCNC's realtime process prints these two, and no other: a message at
/// another level is never seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Level {
    /// Printed, and not on the operator's screen.
    Note = 0,
    /// Printed, and on the operator's screen: what the user asked for and does not get, and what
    /// the driver switched off.
    Error = 1,
}

/// A function of HAL has failed: its negative error number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct HalError(pub c_int);

fn checked(result: c_int) -> Result<c_int, HalError> {
    if result < 0 {
        Err(HalError(result))
    } else {
        Ok(result)
    }
}

/// A component of HAL, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ComponentId(pub c_int);

impl ComponentId {
    /// Makes the component. Not for the cycle, like all functions here but [`print`].
    pub fn new(name: &CStr) -> Result<Self, HalError> {
        // SAFETY: the name ends with NUL, and HAL copies it.
        let result = unsafe { hal_init(name.as_ptr()) };
        checked(result).map(Self)
    }

    /// Gives a parameter a second name. HAL finds it by both, and shows the second one.
    pub fn alias(name: &CStr, alias: &CStr) -> Result<(), HalError> {
        // SAFETY: the names end with NUL, and HAL copies them.
        let result = unsafe { hal_param_alias(name.as_ptr(), alias.as_ptr()) };
        checked(result).map(drop)
    }

    /// Declares that all pins, parameters and functions are made.
    pub fn ready(self) -> Result<(), HalError> {
        checked(hal_ready(self.0)).map(drop)
    }

    /// Removes the functions of the component from their threads, and its pins and parameters.
    pub fn exit(self) {
        let _ = hal_exit(self.0);
    }

    /// Makes a function for threads, which is called with the number of a board.
    pub fn export(self, name: &CStr, function: Function, board: usize) -> Result<(), HalError> {
        let board = core::ptr::without_provenance_mut(board);
        // SAFETY: the name ends with NUL, and HAL copies it. The function has the type that HAL
        // calls, accepts any argument, and exists until the component is unloaded, before which
        // `hal_exit` removes it.
        let result = unsafe { hal_export_funct(name.as_ptr(), function, board, 1, 0, self.0) };
        checked(result).map(drop)
    }
}

/// Bytes of HAL's shared memory, which stay until the last component of HAL has ended. `None` if
/// the memory is used up.
pub(crate) fn allocate(bytes: usize) -> Option<NonNull<u8>> {
    NonNull::new(hal_malloc(c_long::try_from(bytes).ok()?).cast())
}

/// Prints a line by LinuxCNC's means: into a queue without locks, so also from the cycle.
pub(crate) fn print(level: Level, text: &CStr) {
    // SAFETY: both texts end with NUL; the format takes one text, which is copied before the
    // function returns.
    unsafe { rtapi_print_msg(level as c_int, c"%s\n".as_ptr(), text.as_ptr()) }
}

/// The file that this code was loaded from, as `rtapi_app` has named it. `/proc/self/maps` has it
/// as well, but not for a program with more rights than its user, which `rtapi_app` is.
pub(crate) fn own_file() -> Option<String> {
    let code = own_file as fn() -> Option<String> as *const c_void;
    let mut symbol = Symbol {
        file: core::ptr::null(),
        base: core::ptr::null_mut(),
        name: core::ptr::null(),
        address: core::ptr::null_mut(),
    };
    // SAFETY: the function writes all fields of a structure of its own type, or none.
    let found = unsafe { dladdr(code, &raw mut symbol) };
    if found == 0 || symbol.file.is_null() {
        return None;
    }
    // SAFETY: the name ends with NUL, and stays while the file is loaded, as it is now.
    let file = unsafe { CStr::from_ptr(symbol.file) };
    Some(file.to_string_lossy().into_owned())
}

/// Root's rights to files, while the value exists, if the program has them: `rtapi_app` does, and
/// lets its user have them for what its drivers need. Only for this thread.
#[derive(Debug)]
pub(crate) struct RootRights {
    user: c_uint,
}

impl RootRights {
    pub fn take() -> Self {
        // The result is the user so far.
        Self {
            user: setfsuid(0) as c_uint,
        }
    }
}

impl Drop for RootRights {
    fn drop(&mut self) {
        setfsuid(self.user);
    }
}

/// The value of a module parameter, as `rtapi_app` stores it: a pointer to a text.
#[repr(transparent)]
#[derive(Debug)]
pub(crate) struct Text(AtomicPtr<c_char>);

impl Text {
    pub const fn new() -> Self {
        Self(AtomicPtr::new(core::ptr::null_mut()))
    }

    /// Takes the text: a later load begins without it, even if the component stays in memory. Bytes
    /// that are not UTF-8 are replaced.
    pub fn take(&self) -> Option<String> {
        let text = self.0.swap(core::ptr::null_mut(), Ordering::Relaxed);
        if text.is_null() {
            return None;
        }
        // SAFETY: a pointer that is not null was stored by `rtapi_app`, from `strdup`: the text
        // ends with NUL, and is never freed.
        let text = unsafe { CStr::from_ptr(text) };
        Some(text.to_string_lossy().into_owned())
    }
}
