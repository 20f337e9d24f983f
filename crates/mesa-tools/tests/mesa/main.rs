//! The command `mesa` in the hands of an operator and of a script: output, exit codes, bad input,
//! signals. A folder for each table of commands in `docs/mesa.md`.

mod check;
#[path = "../../../../tests/common/mod.rs"]
mod common;
mod every_command;
#[path = "../interop/mod.rs"]
mod interop;
#[cfg(feature = "interop")]
mod interop_linuxcnc;
#[cfg(feature = "interop")]
mod interop_mesaflash;
#[cfg(feature = "interop")]
mod interop_servo_loop;
mod look;
mod pci;
mod pty;
mod run;
mod setup;
mod sim;
mod terminal;
