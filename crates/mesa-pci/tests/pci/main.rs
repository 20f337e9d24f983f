//! Boards in folders like sysfs's: what is refused, what an exchange does, and a driver on a
//! simulated board in mapped memory.

mod cost;
mod driven;
mod exchanges;
mod folder;
mod refusals;
#[path = "../../../mesa-tools/tests/interop/tools.rs"]
#[allow(dead_code, unreachable_pub, reason = "shared with mesa-tools")]
mod tools;
mod unsafe_code;
