//! Settings that decide how late cycles are.

use mesa_tools::diagnosis::{Host, ThreadSettings};

/// Settings of the thread of the cycle, and of this computer, that decide how late cycles are.
#[derive(Clone, Debug, Default)]
pub struct Setting {
    /// `None` if it cannot be read.
    pub thread: Option<ThreadSettings>,
    /// CPUs of the computer.
    pub cpus: usize,
    pub isolated: Vec<usize>,
    pub has_realtime_kernel: bool,
}

impl Setting {
    /// Settings of the calling thread.
    pub fn now() -> Self {
        let host = Host::here();
        Self {
            thread: host.thread(),
            cpus: host.cpus().map_or(0, |cpus| cpus.len()),
            isolated: host.isolated().unwrap_or_default(),
            has_realtime_kernel: host.is_realtime() != Some(false),
        }
    }
}
