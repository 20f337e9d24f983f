//! A HAL on the heap, in the place of LinuxCNC's `hal_lib.so` and `rtapi_app`: the functions that
//! `mesa_eth` calls, and others by which a test looks at pins, parameters and messages.
//!
//! It is as strict as HAL: names are there once and have at most 47 characters, pointers of pins
//! and values of parameters are in memory of `hal_malloc`, and a component that has ended leaves
//! nothing.

#![expect(
    unsafe_code,
    reason = "the symbols of an interface in C, and pointers from its callers"
)]
#![expect(
    clippy::not_unsafe_ptr_arg_deref,
    clippy::missing_panics_doc,
    reason = "as in HAL: texts end with NUL, pointers lead to what HAL made, and a wrong call ends the test"
)]

use std::ffi::{CStr, CString, c_char, c_int, c_long, c_void};
use std::sync::Mutex;

const EINVAL: c_int = -22;
const ENOMEM: c_int = -12;
/// Longest name.
const MAX_NAME: usize = 47;

/// A pin or parameter, as a test sees it.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Its name.
    pub name: *const c_char,
    /// 1 bit, 2 float, 3 s32, 4 u32.
    pub kind: c_int,
    /// 16 IN, 32 OUT, 48 I/O, 64 RO, 192 RW.
    pub direction: c_int,
    /// Its own value.
    pub value: *mut c_void,
    /// The place of a pin's pointer; null for a parameter.
    pub pointer: *mut *mut c_void,
}

/// A function of a thread.
pub type Function = extern "C" fn(*mut c_void, c_long);

struct Hal {
    component: Option<CString>,
    next: c_int,
    is_ready: bool,
    memory: Vec<Box<[u64]>>,
    limit: usize,
    entries: Vec<Entry>,
    names: Vec<CString>,
    functions: Vec<(CString, Function, usize)>,
    messages: Vec<u8>,
}

// SAFETY: the pointers lead to memory that this HAL owns, and that every thread may use.
unsafe impl Send for Hal {}

static HAL: Mutex<Hal> = Mutex::new(Hal {
    component: None,
    next: 1,
    is_ready: false,
    memory: Vec::new(),
    limit: 1 << 20,
    entries: Vec::new(),
    names: Vec::new(),
    functions: Vec::new(),
    messages: Vec::new(),
});

fn hal<T>(work: impl FnOnce(&mut Hal) -> T) -> T {
    work(&mut HAL.lock().expect("no panic"))
}

impl Hal {
    /// The name, if it fits HAL and is new.
    fn new_name(&self, name: *const c_char) -> Option<CString> {
        // SAFETY: the caller gives a text that ends with NUL.
        let name = unsafe { CStr::from_ptr(name) }.to_owned();
        let is_new = !self.names.contains(&name);
        (is_new && (1..=MAX_NAME).contains(&name.as_bytes().len())).then_some(name)
    }

    fn has(&self, place: *const c_void) -> bool {
        let place = place.addr();
        place.is_multiple_of(8)
            && self.memory.iter().any(|block| {
                let start = block.as_ptr().addr();
                (start..start + 8 * block.len()).contains(&place)
            })
    }

    fn allocate(&mut self, bytes: usize) -> *mut c_void {
        let used: usize = self.memory.iter().map(|block| 8 * block.len()).sum();
        if used + bytes > self.limit {
            return core::ptr::null_mut();
        }
        // HAL's memory is not cleared.
        let mut block = vec![0x5A5A_5A5A_5A5A_5A5A; bytes.div_ceil(8)].into_boxed_slice();
        let start = block.as_mut_ptr().cast();
        self.memory.push(block);
        start
    }

    fn add(&mut self, name: CString, mut entry: Entry) {
        entry.name = name.as_ptr();
        self.names.push(name);
        self.entries.push(entry);
    }

    /// The parameter with this name, before the component is ready.
    fn param(&self, name: &CStr) -> Option<Entry> {
        let mut entries = self.names.iter().zip(&self.entries);
        let (_, entry) = entries.find(|(other, _)| other.as_c_str() == name)?;
        (!self.is_ready && entry.pointer.is_null()).then_some(*entry)
    }

    fn owns(&self, component: c_int) -> bool {
        self.component.is_some() && component == self.next
    }
}

/// HAL's `hal_init`.
#[unsafe(no_mangle)]
pub extern "C" fn hal_init(name: *const c_char) -> c_int {
    hal(|hal| {
        let Some(name) = hal.new_name(name) else {
            return EINVAL;
        };
        if hal.component.is_some() {
            return EINVAL;
        }
        hal.component = Some(name);
        hal.next += 1;
        hal.next
    })
}

/// HAL's `hal_ready`.
#[unsafe(no_mangle)]
pub extern "C" fn hal_ready(component: c_int) -> c_int {
    hal(|hal| {
        let is_first = hal.owns(component) && !core::mem::replace(&mut hal.is_ready, true);
        if is_first { 0 } else { EINVAL }
    })
}

/// HAL's `hal_exit`.
#[unsafe(no_mangle)]
pub extern "C" fn hal_exit(component: c_int) -> c_int {
    hal(|hal| {
        if !hal.owns(component) {
            return EINVAL;
        }
        hal.component = None;
        hal.is_ready = false;
        hal.entries.clear();
        hal.names.clear();
        hal.functions.clear();
        // An access after the end meets memory that is not there, and valgrind tells.
        hal.memory.clear();
        0
    })
}

/// HAL's `hal_malloc`.
#[unsafe(no_mangle)]
pub extern "C" fn hal_malloc(bytes: c_long) -> *mut c_void {
    hal(|hal| hal.allocate(usize::try_from(bytes).expect("not negative")))
}

/// HAL's `hal_pin_new`.
#[unsafe(no_mangle)]
pub extern "C" fn hal_pin_new(
    name: *const c_char,
    kind: c_int,
    direction: c_int,
    pointer: *mut *mut c_void,
    component: c_int,
) -> c_int {
    hal(|hal| {
        let is_right = hal.owns(component) && !hal.is_ready && hal.has(pointer.cast());
        let (Some(name), true) = (hal.new_name(name), is_right) else {
            return EINVAL;
        };
        if !(1..=4).contains(&kind) || ![16, 32, 48].contains(&direction) {
            return EINVAL;
        }
        let value = hal.allocate(8);
        if value.is_null() {
            return ENOMEM;
        }
        // SAFETY: both are in the memory of this HAL, aligned, and large enough.
        unsafe {
            value.cast::<u64>().write(0);
            pointer.write(value);
        }
        let entry = Entry {
            name: core::ptr::null(),
            kind,
            direction,
            value,
            pointer,
        };
        hal.add(name, entry);
        0
    })
}

/// HAL's `hal_param_new`.
#[unsafe(no_mangle)]
pub extern "C" fn hal_param_new(
    name: *const c_char,
    kind: c_int,
    direction: c_int,
    value: *mut c_void,
    component: c_int,
) -> c_int {
    hal(|hal| {
        let is_right = hal.owns(component) && !hal.is_ready && hal.has(value);
        let (Some(name), true) = (hal.new_name(name), is_right) else {
            return EINVAL;
        };
        if !(1..=4).contains(&kind) || ![64, 192].contains(&direction) {
            return EINVAL;
        }
        let entry = Entry {
            name: core::ptr::null(),
            kind,
            direction,
            value,
            pointer: core::ptr::null_mut(),
        };
        hal.add(name, entry);
        0
    })
}

/// HAL's `hal_param_alias`, with both names beside each other.
#[unsafe(no_mangle)]
pub extern "C" fn hal_param_alias(name: *const c_char, alias: *const c_char) -> c_int {
    hal(|hal| {
        // SAFETY: the caller gives a text that ends with NUL.
        let name = unsafe { CStr::from_ptr(name) };
        let Some(entry) = hal.param(name) else {
            return EINVAL;
        };
        let Some(alias) = hal.new_name(alias) else {
            return EINVAL;
        };
        hal.add(alias, entry);
        0
    })
}

/// HAL's `hal_export_funct`.
#[unsafe(no_mangle)]
pub extern "C" fn hal_export_funct(
    name: *const c_char,
    function: Function,
    argument: *mut c_void,
    _uses_float: c_int,
    _is_reentrant: c_int,
    component: c_int,
) -> c_int {
    hal(|hal| {
        let (Some(name), true) = (hal.new_name(name), hal.owns(component) && !hal.is_ready) else {
            return EINVAL;
        };
        hal.functions.push((name, function, argument.addr()));
        0
    })
}

/// RTAPI's `rtapi_print_msg`, of which `mesa_eth` uses one form: a text and the end of a line. A
/// function with a variable number of arguments gets the first ones as any other does.
#[unsafe(no_mangle)]
pub extern "C" fn rtapi_print_msg(level: c_int, format: *const c_char, text: *const c_char) {
    // SAFETY: the caller gives texts that end with NUL.
    let (format, text) = unsafe { (CStr::from_ptr(format), CStr::from_ptr(text)) };
    assert_eq!(format, c"%s\n");
    hal(|hal| {
        hal.messages.extend(format!("{level} ").bytes());
        hal.messages.extend(text.to_bytes());
        hal.messages.push(b'\n');
    });
}

/// Number of pins and parameters.
#[unsafe(no_mangle)]
pub extern "C" fn fake_hal_count() -> usize {
    hal(|hal| hal.entries.len())
}

/// A pin or parameter. The name is there until the component ends.
#[unsafe(no_mangle)]
pub extern "C" fn fake_hal_entry(index: usize, entry: *mut Entry) -> bool {
    hal(|hal| {
        let Some(found) = hal.entries.get(index) else {
            return false;
        };
        // SAFETY: the caller gives a place for it.
        unsafe { entry.write(*found) };
        true
    })
}

/// Calls a function as a thread of HAL does; false if it does not exist.
#[unsafe(no_mangle)]
pub extern "C" fn fake_hal_call(name: *const c_char, period: c_long) -> bool {
    // SAFETY: the caller gives a text that ends with NUL.
    let name = unsafe { CStr::from_ptr(name) };
    let found = hal(|hal| {
        let mut functions = hal.functions.iter();
        let found = functions.find(|(own, ..)| hal.is_ready && own.as_c_str() == name)?;
        Some((found.1, found.2))
    });
    let Some((function, argument)) = found else {
        return false;
    };
    function(core::ptr::without_provenance_mut(argument), period);
    true
}

/// Copies the messages so far into a buffer, as `LEVEL TEXT` lines, and forgets them. Returns their
/// length.
#[unsafe(no_mangle)]
pub extern "C" fn fake_hal_messages(buffer: *mut u8, room: usize) -> usize {
    hal(|hal| {
        let messages = core::mem::take(&mut hal.messages);
        let length = messages.len().min(room);
        // SAFETY: the caller gives a buffer with that room.
        unsafe { buffer.copy_from_nonoverlapping(messages.as_ptr(), length) };
        length
    })
}

/// Sets the size of HAL's memory.
#[unsafe(no_mangle)]
pub extern "C" fn fake_hal_limit(bytes: usize) {
    hal(|hal| hal.limit = bytes);
}
