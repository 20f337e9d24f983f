//! Shared parts of tests and benches: machines, buses, networks on virtual time, recordings.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each program that includes this uses what it needs"
)]

pub mod bus;
pub mod chance;
pub mod descriptors;
pub mod ethernet;
pub mod fpga;
pub mod image;
pub mod machine;
pub mod once;
pub mod recording;
pub mod replay;
pub mod transfer;
pub mod valves;
pub mod watch;
