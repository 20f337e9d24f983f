//! The host's clock.

use core::time::Duration;

use rustix::time::{ClockId, clock_gettime};

use super::{Clock, Instant};

/// The host's monotonic clock, counted from its creation. On Linux the clock includes time in which
/// the host was suspended (`CLOCK_BOOTTIME`), so that a reply that has waited through a suspend is
/// late, and ages include the suspend. Time in which a virtual machine is stopped is included only
/// if its hypervisor counts it.
#[derive(Clone, Copy, Debug)]
pub struct HostClock {
    origin: Duration,
}

#[cfg(target_os = "linux")]
const HOST_CLOCK: ClockId = ClockId::Boottime;
#[cfg(not(target_os = "linux"))]
const HOST_CLOCK: ClockId = ClockId::Monotonic;

/// Time of the host's clock since an origin that the host chooses.
fn host_time() -> Duration {
    let time = clock_gettime(HOST_CLOCK);
    let nanos = u32::try_from(time.tv_nsec).unwrap_or(0);
    Duration::new(u64::try_from(time.tv_sec).unwrap_or(0), nanos)
}

/// Below this remaining time the clock is polled: the kernel's wake-up is less exact.
pub const SPIN: Duration = Duration::from_micros(20);

impl HostClock {
    /// A clock that starts at zero now.
    pub fn new() -> Self {
        Self {
            origin: host_time(),
        }
    }

    /// Waits until `deadline`: sleeps first, and polls the clock at the end.
    pub fn sleep_until(&self, deadline: Instant) {
        let left = deadline.since(self.read());
        if left > SPIN {
            std::thread::sleep(left.saturating_sub(SPIN));
        }
        while self.read() < deadline {
            core::hint::spin_loop();
        }
    }

    /// The current time.
    pub fn read(&self) -> Instant {
        Instant::from_nanos(host_time().saturating_sub(self.origin).as_nanos() as u64)
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

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    /// `/proc/uptime` includes time in suspend. The test detects the wrong clock on a host that has
    /// been suspended, or under `unshare --time --boottime SECONDS`.
    #[test]
    fn host_clock_counts_time_in_suspend() {
        let uptime = || {
            let text = std::fs::read_to_string("/proc/uptime").unwrap();
            let seconds: f64 = text.split(' ').next().unwrap().parse().unwrap();
            Duration::from_secs_f64(seconds)
        };
        // `/proc/uptime` counts in steps of 10 ms.
        let before = uptime().saturating_sub(Duration::from_millis(20));
        let time = host_time();
        let after = uptime() + Duration::from_millis(20);
        assert!(
            (before..=after).contains(&time),
            "{before:?} {time:?} {after:?}"
        );
    }
}
