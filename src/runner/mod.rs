//! The thread of a cycle: how it ends, and what it needs of the operating system.

#[cfg(feature = "realtime")]
mod stop;

#[cfg(feature = "realtime")]
pub use stop::{Signal, Stop};
