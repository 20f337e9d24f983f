//! `rtapi_app` in the hands of a test: loads the component as `loadrt` does, over a HAL on the
//! heap.

#![expect(
    unsafe_code,
    reason = "symbols of shared libraries, and values in HAL's memory"
)]
#![expect(
    clippy::unused_self,
    reason = "there is one HAL in the process: a value of it is the right to use it"
)]

use std::collections::BTreeMap;
use std::ffi::{CStr, CString, c_char, c_int, c_long, c_void};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicPtr, AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

unsafe extern "C" {
    fn dlopen(path: *const c_char, flags: c_int) -> *mut c_void;
    fn dlsym(library: *mut c_void, name: *const c_char) -> *mut c_void;
    fn dlclose(library: *mut c_void) -> c_int;
    fn dlerror() -> *const c_char;
    fn strdup(text: *const c_char) -> *mut c_char;
}

const RTLD_NOW: c_int = 2;
const RTLD_GLOBAL: c_int = 0x100;

/// A pin or parameter: `examples/fake_hal.rs`.
#[repr(C)]
#[derive(Clone, Copy)]
struct Entry {
    name: *const c_char,
    kind: c_int,
    direction: c_int,
    value: *mut c_void,
    pointer: *mut AtomicPtr<c_void>,
}

#[derive(Clone, Copy)]
struct Library(*mut c_void);

// SAFETY: handles of dlopen are the whole process's.
unsafe impl Send for Library {}
// SAFETY: as above.
unsafe impl Sync for Library {}

impl Library {
    fn open(path: &Path, flags: c_int) -> Self {
        let name = CString::new(path.to_str().expect("UTF-8")).expect("no NUL");
        // SAFETY: the name ends with NUL; the libraries are those of this package.
        let library = unsafe { dlopen(name.as_ptr(), flags | RTLD_NOW) };
        if library.is_null() {
            // SAFETY: an error has just happened, so this is a text.
            let error = unsafe { CStr::from_ptr(dlerror()) };
            panic!("{error:?}");
        }
        Self(library)
    }

    fn symbol(self, name: &str) -> Option<*mut c_void> {
        let name = CString::new(name).expect("no NUL");
        // SAFETY: the library is open, and the name ends with NUL.
        let symbol = unsafe { dlsym(self.0, name.as_ptr()) };
        (!symbol.is_null()).then_some(symbol)
    }

    fn function(self, name: &str) -> *mut c_void {
        self.symbol(name).unwrap_or_else(|| panic!("{name}"))
    }
}

/// The folder of this test's program.
fn folder() -> PathBuf {
    let program = std::env::current_exe().expect("a program");
    program.parent().expect("a folder").to_owned()
}

fn fake() -> Library {
    static FAKE: OnceLock<Library> = OnceLock::new();
    *FAKE.get_or_init(|| {
        let path = folder().join("../examples/libfake_hal.so");
        if !path.exists() {
            build_fake();
        }
        Library::open(&path, RTLD_GLOBAL)
    })
}

/// Builds the HAL, which `cargo test --test fake_hal` alone does not.
fn build_fake() {
    let mut cargo = Command::new(env!("CARGO"));
    cargo.args(["build", "--offline", "--example", "fake_hal"]);
    cargo.args([
        "--manifest-path",
        concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml"),
    ]);
    cargo.arg("--target-dir").arg(folder().join("../.."));
    if folder().ends_with("release/deps") {
        cargo.arg("--release");
    }
    assert!(cargo.status().expect("cargo runs").success());
}

/// The only HAL of the process, empty.
pub struct Hal {
    _alone: MutexGuard<'static, ()>,
}

/// The component, loaded.
pub struct Loaded<'a> {
    hal: &'a Hal,
    component: Option<Library>,
    names: BTreeMap<String, Entry>,
}

/// Waits for HAL, which other tests of this process use too.
pub fn hal() -> Hal {
    static ALONE: Mutex<()> = Mutex::new(());
    let alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
    let hal = Hal { _alone: alone };
    hal.messages();
    hal
}

impl Hal {
    /// `loadrt mesa_eth` with these words. The error is the result of the component.
    pub fn load(&self, words: &[(&str, &str)]) -> Result<Loaded<'_>, c_int> {
        self.load_file(&folder().join("libmesa_eth.so"), words)
    }

    /// `loadrt` of a copy of the component under another name.
    pub fn load_as(&self, name: &str, words: &[(&str, &str)]) -> Result<Loaded<'_>, c_int> {
        let copy = std::env::temp_dir().join(format!("{}-{name}", std::process::id()));
        if !copy.exists() {
            std::fs::copy(folder().join("libmesa_eth.so"), &copy).expect("copied");
        }
        self.load_file(&copy, words)
    }

    fn load_file(&self, file: &Path, words: &[(&str, &str)]) -> Result<Loaded<'_>, c_int> {
        fake();
        let component = Library::open(file, RTLD_GLOBAL);
        for (name, value) in words {
            set_parameter(component, name, value);
        }
        // SAFETY: the symbol is the function of this type.
        let result = unsafe {
            let main: extern "C" fn() -> c_int =
                core::mem::transmute(component.function("rtapi_app_main"));
            main()
        };
        if result < 0 {
            // SAFETY: the component has refused to be loaded, and nothing of it is used any more.
            unsafe { dlclose(component.0) };
            assert_eq!(
                self.count(),
                0,
                "a component that was refused leaves nothing"
            );
            return Err(result);
        }
        let names = self.entries();
        Ok(Loaded {
            hal: self,
            component: Some(component),
            names,
        })
    }

    fn count(&self) -> usize {
        // SAFETY: the symbol is the function of this type.
        unsafe {
            let count: extern "C" fn() -> usize =
                core::mem::transmute(fake().function("fake_hal_count"));
            count()
        }
    }

    fn entries(&self) -> BTreeMap<String, Entry> {
        let get = |index| {
            let mut entry = core::mem::MaybeUninit::uninit();
            // SAFETY: the symbol is the function of this type, which fills the entry; its name is a
            // text that ends with NUL.
            unsafe {
                let get: extern "C" fn(usize, *mut Entry) -> bool =
                    core::mem::transmute(fake().function("fake_hal_entry"));
                assert!(get(index, entry.as_mut_ptr()));
                let entry = entry.assume_init();
                let name = CStr::from_ptr(entry.name).to_str().expect("UTF-8");
                (name.to_owned(), entry)
            }
        };
        (0..self.count()).map(get).collect()
    }

    /// Messages since the last call: level and text, one a line.
    pub fn messages(&self) -> String {
        let mut buffer = vec![0; 1 << 20];
        // SAFETY: the symbol is the function of this type, which writes no more than the buffer's
        // length.
        let length = unsafe {
            let messages: extern "C" fn(*mut u8, usize) -> usize =
                core::mem::transmute(fake().function("fake_hal_messages"));
            messages(buffer.as_mut_ptr(), buffer.len())
        };
        String::from_utf8(buffer[..length].to_vec()).expect("UTF-8")
    }

    /// Sets the size of HAL's memory.
    pub fn limit(&self, bytes: usize) {
        // SAFETY: the symbol is the function of this type.
        unsafe {
            let limit: extern "C" fn(usize) =
                core::mem::transmute(fake().function("fake_hal_limit"));
            limit(bytes);
        }
    }
}

/// Stores a word of the `loadrt` line as `rtapi_app` does.
fn set_parameter(component: Library, name: &str, value: &str) {
    let place = component.function(&format!("rtapi_info_address_{name}"));
    let kind = component.function(&format!("rtapi_info_type_{name}"));
    // SAFETY: both symbols are pointers, to the place of the values, and to a text.
    let (place, kind) = unsafe {
        let kind = CStr::from_ptr(kind.cast::<*const c_char>().read());
        (
            place.cast::<*mut c_void>().read(),
            kind.to_str().expect("UTF-8"),
        )
    };
    if kind == "i" {
        let value = value.parse().expect("a number");
        // SAFETY: the type says that it is a number.
        unsafe { place.cast::<c_int>().write(value) };
        return;
    }
    assert_eq!(kind, "s");
    let size = component.function(&format!("rtapi_info_size_{name}"));
    // SAFETY: the symbol is a number.
    let size = unsafe { size.cast::<c_int>().read() };
    let words: Vec<_> = value.split(',').collect();
    assert!(words.len() <= size as usize, "rtapi_app takes no more");
    for (index, word) in words.into_iter().enumerate() {
        let word = CString::new(word).expect("no NUL");
        // SAFETY: there is room for as many texts as the size says, which are never freed.
        unsafe {
            let text = strdup(word.as_ptr());
            place.cast::<*mut c_char>().add(index).write(text);
        }
    }
}

impl Loaded<'_> {
    /// Calls a function as a thread with this period does.
    pub fn call(&self, name: &str, period: c_long) {
        let c_name = CString::new(name).expect("no NUL");
        // SAFETY: the symbol is the function of this type, and the name ends with NUL.
        let is_there = unsafe {
            let call: extern "C" fn(*const c_char, c_long) -> bool =
                core::mem::transmute(fake().function("fake_hal_call"));
            call(c_name.as_ptr(), period)
        };
        assert!(is_there, "no function {name}");
    }

    pub fn messages(&self) -> String {
        self.hal.messages()
    }

    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.names.keys().map(String::as_str)
    }

    /// Type and direction, as `halcmd show` prints them.
    pub fn kind(&self, name: &str) -> (&'static str, &'static str) {
        let entry = self.entry(name);
        let kind = ["bit", "float", "s32", "u32"][usize::try_from(entry.kind - 1).expect("1 to 4")];
        let direction = match entry.direction {
            16 => "IN",
            32 => "OUT",
            48 => "I/O",
            64 => "RO",
            _ => "RW",
        };
        (kind, direction)
    }

    fn entry(&self, name: &str) -> Entry {
        *self.names.get(name).unwrap_or_else(|| panic!("no {name}"))
    }

    fn place(entry: Entry) -> *mut c_void {
        if entry.pointer.is_null() {
            return entry.value;
        }
        // SAFETY: the pointer of a pin is in HAL's memory while the component is loaded.
        unsafe { &*entry.pointer }.load(Ordering::Relaxed)
    }

    /// `getp`
    pub fn get(&self, name: &str) -> f64 {
        let entry = self.entry(name);
        let place = Self::place(entry);
        // SAFETY: the value is of this type, in HAL's memory.
        unsafe {
            match entry.kind {
                1 => f64::from((*place.cast::<AtomicU8>()).load(Ordering::Relaxed)),
                2 => f64::from_bits((*place.cast::<AtomicU64>()).load(Ordering::Relaxed)),
                3 => f64::from((*place.cast::<AtomicU32>()).load(Ordering::Relaxed) as i32),
                _ => f64::from((*place.cast::<AtomicU32>()).load(Ordering::Relaxed)),
            }
        }
    }

    /// `setp`
    pub fn set(&self, name: &str, value: f64) {
        let entry = self.entry(name);
        let place = Self::place(entry);
        // SAFETY: the value is of this type, in HAL's memory.
        unsafe {
            match entry.kind {
                1 => (*place.cast::<AtomicU8>()).store(u8::from(value != 0.0), Ordering::Relaxed),
                2 => (*place.cast::<AtomicU64>()).store(value.to_bits(), Ordering::Relaxed),
                3 => (*place.cast::<AtomicU32>()).store(value as i32 as u32, Ordering::Relaxed),
                _ => (*place.cast::<AtomicU32>()).store(value as u32, Ordering::Relaxed),
            }
        }
    }

    /// `net`: the pin is that signal from now on.
    pub fn link(&self, name: &str, signal: &'static AtomicU64) {
        let entry = self.entry(name);
        let signal = core::ptr::from_ref(signal).cast_mut().cast();
        // SAFETY: the pointer of a pin is in HAL's memory while the component is loaded.
        unsafe { &*entry.pointer }.store(signal, Ordering::Relaxed);
    }

    /// `unloadrt`
    pub fn unload(mut self) {
        self.end();
    }

    fn end(&mut self) {
        let Some(component) = self.component.take() else {
            return;
        };
        // SAFETY: the symbol is the function of this type; nothing of the component is used after
        // it.
        unsafe {
            let exit: extern "C" fn() = core::mem::transmute(component.function("rtapi_app_exit"));
            exit();
            dlclose(component.0);
        }
        assert_eq!(self.hal.count(), 0, "an unloaded component leaves nothing");
    }
}

impl Drop for Loaded<'_> {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            self.end();
        } else if let Some(component) = self.component.take() {
            // SAFETY: as in `end`.
            unsafe {
                let exit: extern "C" fn() =
                    core::mem::transmute(component.function("rtapi_app_exit"));
                exit();
            }
        }
    }
}
