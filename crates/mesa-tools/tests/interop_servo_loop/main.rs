//! The programs of these packages in real use: processes, real sockets, signals, the clock.

#[path = "../../../../tests/common/mod.rs"]
mod common;
mod ending;
#[path = "../interop/mod.rs"]
mod interop;
mod servo_loop;
