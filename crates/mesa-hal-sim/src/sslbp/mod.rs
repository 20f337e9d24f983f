//! The SSLBP gateware: an interface processor with its firmware, host registers and UARTs.
//!
//! [`SslbpPort`] behaves like version 1.43 of the gateware, as recorded in the transcripts. Its
//! firmware is one endless loop that visits all channels, one after the other, and polls for a
//! command of the host after each pass; every channel is a state machine of its own:
//!
//! | file | what |
//! |---|---|
//! | `port` | the outside: registers, time, lines |
//! | `registers` | COMMAND, DATA, CS and interface registers, each with its in and out side |
//! | `firmware` | the main loop, initialisation, stopping |
//! | `commands` | commands, their completion, local reads and writes |
//! | `start` | the states of a START |
//! | `transfer` | chatter, process data, pass-through |
//! | `frame` | sending and receiving frames, timeouts, errors |
//! | `memory`, `state` | the variables and the state codes |
//! | `uart`, `clock` | UARTs, tick timer |
//! | `timing` | every calibrated cost |
//!
//! # Sources
//! FACTS 2 to 6 and the transcripts. The order of the loop, the layout of its variables and the
//! error counted by each step come, as facts alone, from the firmware's published sources (revision
//! 42); every behaviour that a transcript shows is compared with it by
//! `tests/gateware_conformance/main.rs`.
//!
//! # Not confirmed by a transcript
//! The variant with seven interface registers is assumed to have the same firmware with more data
//! bytes (28 out, 28 in and the fault byte) and FIFOs of 32 characters. Clocks other than 100 MHz
//! are assumed to change only the processor's pace and the rounding of bit and tick times. Of an
//! 8I20's own normal start only the beginning is known: the simulated one stops at state 2A.

mod clock;
mod commands;
mod config;
mod firmware;
mod frame;
mod lines;
mod memory;
mod port;
mod registers;
mod start;
mod state;
mod timing;
mod transfer;
mod uart;

#[cfg(test)]
mod tests;

pub use config::{
    InterfaceRegisters, MAX_CHANNELS, MAX_INTERFACE_REGISTERS, MINOR_REVISION, PortConfig,
};
pub use lines::{Lines, NoLines};
pub use port::SslbpPort;
pub use registers::Register;
