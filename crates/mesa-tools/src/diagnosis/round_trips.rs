//! Measurement of a board's response times.

use core::time::Duration;

use mesa_hal::bus::{Access, AccessList, BusError, BusErrorKind, Clock, RegisterBus};

/// Address of HostMot2's cookie, which every firmware has.
const COOKIE: u16 = 0x0100;

/// Time after which a reply is not waited for any more. A reply that comes later still counts as
/// late, and as one that took this time.
const LONGEST: Duration = Duration::from_millis(50);

/// Requests and their replies, one in each period.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RoundTrips {
    /// Response times, late ones included, in ascending order.
    times: Vec<Duration>,
    /// Requests without a reply.
    pub lost: u32,
    /// Longest delay with which this computer ran the program again after a pause.
    pub woken_late: Duration,
}

impl RoundTrips {
    /// Creates the statistics from measured values.
    pub fn new(mut times: Vec<Duration>, lost: u32, woken_late: Duration) -> Self {
        times.sort_unstable();
        Self {
            times,
            lost,
            woken_late,
        }
    }

    /// Reads one register in `exchanges` requests, one in each period, without repeating a lost
    /// one; ends early when `go_on` returns false. A late reply is waited for, and the next request
    /// follows a period after the late one. Writes nothing to the FPGA. Leaves the deadline of the
    /// bus at 50 ms.
    ///
    /// # Errors
    /// Any bus error other than a lost or late reply: the board is not reachable.
    ///
    /// # Real time
    /// Not for the cycle. Takes one period for each request, and more for a late or lost reply.
    pub fn measure<B: RegisterBus + Clock>(
        bus: &mut B,
        exchanges: u32,
        period: Duration,
        mut go_on: impl FnMut() -> bool,
    ) -> Result<Self, BusError> {
        bus.set_cycle(period, Some(LONGEST));
        let list = bus.prepare(&[Access::read(COOKIE, 0, 1)], None)?;
        let mut trips = Self::default();
        let late_before = bus.statistics().late;
        for _ in 0..exchanges {
            if !go_on() {
                break;
            }
            let begun = bus.now();
            trips.add(ask(bus, &list), bus.now().since(begun))?;
            let planned = begun.after(period);
            let left = planned.since(bus.now());
            if !left.is_zero() {
                bus.wait(left);
                trips.woken_late = trips.woken_late.max(bus.now().since(planned));
            }
        }
        trips.settle(bus, &list, late_before);
        trips.times.sort_unstable();
        Ok(trips)
    }

    /// Adds the result of a request.
    fn add(&mut self, answer: Result<(), BusError>, took: Duration) -> Result<(), BusError> {
        let Err(error) = answer else {
            self.times.push(took);
            return Ok(());
        };
        match error.kind() {
            BusErrorKind::Late => self.times.push(took.max(LONGEST)),
            BusErrorKind::Lost | BusErrorKind::Stale | BusErrorKind::Short => self.lost += 1,
            _ => return Err(error),
        }
        Ok(())
    }

    /// Finds the replies that came after they were given up: those are late, and not lost.
    fn settle<B: RegisterBus + Clock>(&mut self, bus: &mut B, list: &AccessList, late_before: u64) {
        if self.lost == 0 {
            return;
        }
        bus.wait(LONGEST);
        // A further request takes them from the socket.
        let _ = ask(bus, list);
        let late = bus.statistics().late.saturating_sub(late_before);
        let known = self.times.iter().filter(|time| **time >= LONGEST).count();
        let found = late.saturating_sub(known as u64).min(self.lost.into());
        self.lost -= found as u32;
        self.times
            .extend(core::iter::repeat_n(LONGEST, found as usize));
    }

    /// Number of replies that took longer than a time.
    pub fn longer_than(&self, time: Duration) -> usize {
        self.times.len() - self.times.partition_point(|took| *took <= time)
    }

    /// Number of requests.
    pub fn asked(&self) -> u32 {
        self.times.len() as u32 + self.lost
    }

    /// Returns the response time that the given share of the replies, 0 to 1, did not exceed; zero
    /// without replies.
    pub fn quantile(&self, share: f64) -> Duration {
        let rank = (self.times.len() as f64 * share).ceil() as usize;
        let at = rank.clamp(1, self.times.len().max(1)) - 1;
        self.times.get(at).copied().unwrap_or_default()
    }
}

/// One request and its reply.
fn ask<B: RegisterBus>(bus: &mut B, list: &AccessList) -> Result<(), BusError> {
    let mut words = [0];
    bus.start(list, &words)?;
    bus.finish(list, &mut words).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesa_hal_sim::machines;

    #[test]
    fn quantiles_are_ranks() {
        let times = (1..=100).rev().map(Duration::from_micros).collect();
        let trips = RoundTrips::new(times, 2, Duration::ZERO);
        assert_eq!(trips.asked(), 102);
        let longer = [0, 50, 99, 100].map(|us| trips.longer_than(Duration::from_micros(us)));
        assert_eq!(longer, [100, 50, 1, 0]);
        let micros = [0.0, 0.5, 0.99, 1.0].map(|share| trips.quantile(share).as_micros());
        assert_eq!(micros, [1, 50, 99, 100]);
        assert_eq!(RoundTrips::default().quantile(0.5), Duration::ZERO);
    }

    #[test]
    fn board_that_answers_is_asked_as_often_as_wanted() {
        let mut bus = machines::i7i97(1);
        let period = Duration::from_millis(1);
        let trips = RoundTrips::measure(&mut bus, 50, period, || true).unwrap();
        assert_eq!((trips.asked(), trips.lost), (50, 0));
        let mut left = 5;
        let mut go_on = || {
            left -= 1;
            left >= 0
        };
        let trips = RoundTrips::measure(&mut bus, 50, period, &mut go_on).unwrap();
        assert_eq!(trips.asked(), 5);
    }
}
