//! Boards in folders like sysfs's: what is refused, what an exchange does, and a driver on a simulated
//! board in mapped memory.

mod cost;
mod driven;
mod exchanges;
mod folder;
mod refusals;
mod unsafe_code;
