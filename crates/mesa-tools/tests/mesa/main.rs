//! The command `mesa` in the hands of an operator and of a script: output, exit codes, bad input,
//! signals.

#[path = "../../../../tests/common/mod.rs"]
mod common;
mod doctor;
mod files;
mod firewall;
mod firmwares;
mod flash;
mod hal;
mod info;
#[path = "../interop/mod.rs"]
mod interop;
mod ip;
mod latency;
mod led;
mod list;
mod manual;
mod param;
mod pins;
mod pty;
mod raw;
mod registers;
mod restart;
mod run;
mod scope;
mod second_master;
mod set;
mod set_safety;
mod sim;
mod sim_control;
mod sim_machine;
mod sim_watch;
mod terminal;
mod update;
mod watch;
mod wiring;
mod wiring_ends;
mod wiring_outputs;
