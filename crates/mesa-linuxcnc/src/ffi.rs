//! The functions of HAL and RTAPI that the component calls, and the symbols that `rtapi_app` looks
//! up in it.
//!
//! The declarations are those of the interface of LinuxCNC 2.9, `hal.h` and `rtapi.h`, written
//! anew. `rtapi_app` looks up `rtapi_app_main`, `rtapi_app_exit`, and for a word `NAME=VALUE` of the
//! `loadrt` line the pointers `rtapi_info_address_NAME`, to the place of the value, and
//! `rtapi_info_type_NAME`, to its type: `i` for an integer, `s` for a text. With the number
//! `rtapi_info_size_NAME` there is room for so many values, separated by commas.

#![expect(
    unsafe_code,
    reason = "symbols of an interface in C; each block has its reason"
)]

use core::ffi::{CStr, c_char, c_int, c_long, c_uint, c_void};
use core::ptr::NonNull;
use core::sync::atomic::{AtomicI32, AtomicPtr, Ordering};

use crate::MAX_BOARDS;
use crate::component::{self, Step};
use crate::say::Level;

unsafe extern "C" {
    fn hal_init(name: *const c_char) -> c_int;
    safe fn hal_ready(component: c_int) -> c_int;
    safe fn hal_exit(component: c_int) -> c_int;
    safe fn hal_malloc(size: c_long) -> *mut c_void;
    fn hal_export_funct(
        name: *const c_char,
        function: extern "C" fn(*mut c_void, c_long),
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

    /// Makes a function for threads, which does a step of the board with this number.
    pub fn export(self, name: &CStr, step: Step, board: usize) -> Result<(), HalError> {
        let function = match step {
            Step::Read => read,
            Step::Write => write,
            Step::RequestRead => request_read,
            Step::ReadGpio => read_gpio,
            Step::WriteGpio => write_gpio,
        };
        let board = core::ptr::without_provenance_mut(board);
        // SAFETY: the name ends with NUL, and HAL copies it. The function has the type that HAL
        // calls, accepts any argument, and exists until the component is unloaded, before which
        // `hal_exit` removes it.
        let result = unsafe { hal_export_funct(name.as_ptr(), function, board, 1, 0, self.0) };
        checked(result).map(drop)
    }
}

/// Bytes of HAL's shared memory, which stay until the last component of HAL has ended. `None` if the
/// memory is used up.
pub(crate) fn allocate(bytes: usize) -> Option<NonNull<u8>> {
    NonNull::new(hal_malloc(c_long::try_from(bytes).ok()?).cast())
}

/// Prints a line by LinuxCNC's means: into a queue without locks, so also from the cycle.
pub(crate) fn print(level: Level, text: &CStr) {
    // SAFETY: both texts end with NUL; the format takes one text, which is copied before the
    // function returns.
    unsafe { rtapi_print_msg(level as c_int, c"%s\n".as_ptr(), text.as_ptr()) }
}

/// The file that this code was loaded from, as `rtapi_app` has named it. `/proc/self/maps` has it as
/// well, but not for a program with more rights than its user, which `rtapi_app` is.
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

/// Root's rights to files, while the value exists, if the program has them: `rtapi_app` does, and lets
/// its user have them for what its drivers need. Only for this thread.
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

extern "C" fn read(board: *mut c_void, period: c_long) {
    component::run(board.addr(), Step::Read, period);
}

extern "C" fn write(board: *mut c_void, period: c_long) {
    component::run(board.addr(), Step::Write, period);
}

extern "C" fn request_read(board: *mut c_void, period: c_long) {
    component::run(board.addr(), Step::RequestRead, period);
}

extern "C" fn read_gpio(board: *mut c_void, period: c_long) {
    component::run(board.addr(), Step::ReadGpio, period);
}

extern "C" fn write_gpio(board: *mut c_void, period: c_long) {
    component::run(board.addr(), Step::WriteGpio, period);
}

/// Called by `loadrt`, after it has set the parameters. A negative result ends it.
#[unsafe(no_mangle)]
pub extern "C" fn rtapi_app_main() -> c_int {
    component::load()
}

/// Called by `unloadrt`, and at LinuxCNC's end.
#[unsafe(no_mangle)]
pub extern "C" fn rtapi_app_exit() {
    component::unload();
}

/// The words of a module parameter, as `rtapi_app` stores them: pointers to texts.
type Texts = [AtomicPtr<c_char>; MAX_BOARDS];

static BOARD_IP: Texts = [const { AtomicPtr::new(core::ptr::null_mut()) }; MAX_BOARDS];
static CONFIG: Texts = [const { AtomicPtr::new(core::ptr::null_mut()) }; MAX_BOARDS];
static SYSFS: Texts = [const { AtomicPtr::new(core::ptr::null_mut()) }; MAX_BOARDS];
static BOARD_RTNET: Texts = [const { AtomicPtr::new(core::ptr::null_mut()) }; MAX_BOARDS];
static FIREWALL: Texts = [const { AtomicPtr::new(core::ptr::null_mut()) }; MAX_BOARDS];
static DEBUG: AtomicI32 = AtomicI32::new(0);

/// Place of the words of `board_ip=`.
#[unsafe(no_mangle)]
pub static rtapi_info_address_board_ip: &Texts = &BOARD_IP;
/// Type of `board_ip=`: texts.
#[unsafe(no_mangle)]
pub static rtapi_info_type_board_ip: &[u8; 2] = b"s\0";
/// Largest number of words of `board_ip=`.
#[unsafe(no_mangle)]
pub static rtapi_info_size_board_ip: c_int = MAX_BOARDS as c_int;

/// Place of the words of `config=`.
#[unsafe(no_mangle)]
pub static rtapi_info_address_config: &Texts = &CONFIG;
/// Type of `config=`: texts.
#[unsafe(no_mangle)]
pub static rtapi_info_type_config: &[u8; 2] = b"s\0";
/// Largest number of words of `config=`.
#[unsafe(no_mangle)]
pub static rtapi_info_size_config: c_int = MAX_BOARDS as c_int;

/// Place of the word of `sysfs=`: a folder of `mesa sim --pci` in place of /sys.
#[unsafe(no_mangle)]
pub static rtapi_info_address_sysfs: &Texts = &SYSFS;
/// Type of `sysfs=`: a text.
#[unsafe(no_mangle)]
pub static rtapi_info_type_sysfs: &[u8; 2] = b"s\0";
/// Largest number of words of `sysfs=`.
#[unsafe(no_mangle)]
pub static rtapi_info_size_sysfs: c_int = 1;

/// Place of the words of `board_rtnet=`, which hm2_eth has.
#[unsafe(no_mangle)]
pub static rtapi_info_address_board_rtnet: &Texts = &BOARD_RTNET;
/// Type of `board_rtnet=`: texts.
#[unsafe(no_mangle)]
pub static rtapi_info_type_board_rtnet: &[u8; 2] = b"s\0";
/// Largest number of words of `board_rtnet=`.
#[unsafe(no_mangle)]
pub static rtapi_info_size_board_rtnet: c_int = MAX_BOARDS as c_int;

/// Place of the word of `firewall=`, which hm2_eth has.
#[unsafe(no_mangle)]
pub static rtapi_info_address_firewall: &Texts = &FIREWALL;
/// Type of `firewall=`: a text.
#[unsafe(no_mangle)]
pub static rtapi_info_type_firewall: &[u8; 2] = b"s\0";
/// Largest number of words of `firewall=`.
#[unsafe(no_mangle)]
pub static rtapi_info_size_firewall: c_int = 1;

/// Place of `debug=`, which hm2_eth has: accepted, and without effect.
#[unsafe(no_mangle)]
pub static rtapi_info_address_debug: &AtomicI32 = &DEBUG;
/// Type of `debug=`: an integer.
#[unsafe(no_mangle)]
pub static rtapi_info_type_debug: &[u8; 2] = b"i\0";

/// For tests, hence in no release: a module parameter with which a later call of a function panics.
#[cfg(debug_assertions)]
mod panics {
    use super::{AtomicI32, Ordering};

    static PANIC_IN: AtomicI32 = AtomicI32::new(0);

    /// Place of `panic_in=`: the number of calls up to the panic.
    #[unsafe(no_mangle)]
    pub static rtapi_info_address_panic_in: &AtomicI32 = &PANIC_IN;
    /// Type of `panic_in=`: an integer.
    #[unsafe(no_mangle)]
    pub static rtapi_info_type_panic_in: &[u8; 2] = b"i\0";

    /// Counts a call; true if it should panic.
    pub fn is_due() -> bool {
        PANIC_IN.load(Ordering::Relaxed) > 0 && PANIC_IN.fetch_sub(1, Ordering::Relaxed) == 1
    }
}
#[cfg(debug_assertions)]
pub(crate) use panics::is_due as panic_is_due;

/// The words of `board_ip=`, of `config=`, of `sysfs=`, of `board_rtnet=` and of `firewall=`, taken: a later
/// load begins without them, even if the component stays in memory. Text that is not UTF-8 is replaced by the sign for that.
pub(crate) fn take_parameters() -> [Vec<String>; 5] {
    [&BOARD_IP, &CONFIG, &SYSFS, &BOARD_RTNET, &FIREWALL].map(|texts| {
        let taken = texts
            .iter()
            .map(|text| text.swap(core::ptr::null_mut(), Ordering::Relaxed));
        let taken = taken.take_while(|text| !text.is_null());
        // SAFETY: a pointer that is not null was stored by `rtapi_app`, from `strdup`: the text ends
        // with NUL, and is never freed.
        let texts = taken.map(|text| unsafe { CStr::from_ptr(text) });
        texts
            .map(|text| text.to_string_lossy().into_owned())
            .collect()
    })
}
