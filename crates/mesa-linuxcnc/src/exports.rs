//! The symbols that `rtapi_app` looks up in the component.
//!
//! These are `rtapi_app_main`, `rtapi_app_exit`, and for a word `NAME=VALUE` of the `loadrt` line
//! the pointers `rtapi_info_address_NAME`, to the place of the value, and `rtapi_info_type_NAME`,
//! to its type: `i` for an integer, `s` for a text. With the number `rtapi_info_size_NAME` there is
//! room for so many values, separated by commas.

#![expect(
    unsafe_code,
    reason = "symbols without mangled names, which no other library of the process has"
)]

use core::ffi::c_int;
use core::sync::atomic::{AtomicI32, Ordering};

use crate::MAX_BOARDS;
use crate::component;
use crate::ffi::Text;
use crate::load;
use crate::parameters::Words;

/// Called by `loadrt`, after it has set the parameters. A negative result ends it.
#[unsafe(no_mangle)]
pub extern "C" fn rtapi_app_main() -> c_int {
    load::load(&words())
}

/// Called by `unloadrt`, and at LinuxCNC's end.
#[unsafe(no_mangle)]
pub extern "C" fn rtapi_app_exit() {
    component::unload();
}

type Texts = [Text; MAX_BOARDS];

static BOARD_IP: Texts = [const { Text::new() }; MAX_BOARDS];
static CONFIG: Texts = [const { Text::new() }; MAX_BOARDS];
static SYSFS: Texts = [const { Text::new() }; MAX_BOARDS];
static BOARD_RTNET: Texts = [const { Text::new() }; MAX_BOARDS];
static FIREWALL: Texts = [const { Text::new() }; MAX_BOARDS];
static DEBUG: AtomicI32 = AtomicI32::new(0);
static TRACE: AtomicI32 = AtomicI32::new(0);

/// Takes the words of the `loadrt` line.
fn words() -> Words {
    let taken = |texts: &Texts| texts.iter().map_while(Text::take).collect();
    Words {
        boards: taken(&BOARD_IP),
        configs: taken(&CONFIG),
        sysfs: taken(&SYSFS),
        networks: taken(&BOARD_RTNET),
        firewalls: taken(&FIREWALL),
        trace: TRACE.swap(0, Ordering::Relaxed),
    }
}

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

/// Place of `trace=`: a number of cycles.
#[unsafe(no_mangle)]
pub static rtapi_info_address_trace: &AtomicI32 = &TRACE;
/// Type of `trace=`: an integer.
#[unsafe(no_mangle)]
pub static rtapi_info_type_trace: &[u8; 2] = b"i\0";

/// Place of `panic_in=`, for tests: the number of calls of a function up to a panic.
#[cfg(debug_assertions)]
#[unsafe(no_mangle)]
pub static rtapi_info_address_panic_in: &AtomicI32 = &component::PANIC_IN;
/// Type of `panic_in=`: an integer.
#[cfg(debug_assertions)]
#[unsafe(no_mangle)]
pub static rtapi_info_type_panic_in: &[u8; 2] = b"i\0";
