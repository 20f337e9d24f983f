//! The host's clock.

use core::time::Duration;
use std::time::Instant as HostInstant;

use super::{Clock, Instant};

/// The host's monotonic clock, from when it was made.
#[derive(Clone, Copy, Debug)]
pub struct HostClock {
    origin: HostInstant,
}

/// Below this the kernel's wake-up is less exact than looking again and again.
pub(crate) const SPIN: Duration = Duration::from_micros(20);

impl HostClock {
    /// A clock that begins now.
    pub fn new() -> Self {
        Self {
            origin: HostInstant::now(),
        }
    }

    /// Waits until `deadline`: sleeps, and looks again and again at the end.
    pub fn sleep_until(&self, deadline: Instant) {
        let left = deadline.since(self.read());
        if left > SPIN {
            std::thread::sleep(left.saturating_sub(SPIN));
        }
        while self.read() < deadline {
            core::hint::spin_loop();
        }
    }

    /// The time.
    pub fn read(&self) -> Instant {
        Instant::from_nanos(self.origin.elapsed().as_nanos() as u64)
    }
}

impl Default for HostClock {
    fn default() -> Self {
        Self::new()
    }
}

impl Clock for HostClock {
    fn now(&mut self) -> Instant {
        self.read()
    }

    fn wait(&mut self, duration: Duration) {
        self.sleep_until(self.read().after(duration));
    }

    fn sleep(&mut self, duration: Duration) {
        std::thread::sleep(duration);
    }
}
