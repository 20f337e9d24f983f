//! Nothing in the cycle allocates: a counting allocator watches.

#[path = "../common/mod.rs"]
mod common;
mod embedded;
mod memory;
mod socket;
mod steppers;
mod udp;
