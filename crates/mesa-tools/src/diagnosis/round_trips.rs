//! Measurement of a board's response times.

use core::time::Duration;

use mesa_hal::bus::{Access, BusError, BusErrorKind, Clock, RegisterBus};

/// Address of HostMot2's cookie, which every firmware has.
const COOKIE: u16 = 0x0100;

/// Requests and their replies, one in each period.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RoundTrips {
    /// Response times, in ascending order.
    times: Vec<Duration>,
    /// Requests without a reply.
    pub lost: u32,
    /// Replies that took longer than a period.
    pub late: u32,
}

impl RoundTrips {
    /// Creates the statistics from measured values.
    pub fn new(mut times: Vec<Duration>, lost: u32, late: u32) -> Self {
        times.sort_unstable();
        Self { times, lost, late }
    }

    /// Reads one register in `exchanges` requests, one in each period, without repeating a lost
    /// one; ends early when `go_on` returns false. Writes nothing to the FPGA. Leaves the deadline
    /// of the bus at one period.
    ///
    /// # Errors
    /// Any bus error other than a lost or late reply: the board is not reachable.
    ///
    /// # Real time
    /// Not for the cycle. Takes one period for each request.
    pub fn measure<B: RegisterBus + Clock>(
        bus: &mut B,
        exchanges: u32,
        period: Duration,
        mut go_on: impl FnMut() -> bool,
    ) -> Result<Self, B::Error> {
        bus.set_cycle(period, Some(period));
        let list = bus.prepare(&[Access::read(COOKIE, 0, 1)], None)?;
        let (mut times, mut lost, mut late) = (Vec::new(), 0, 0);
        for _ in 0..exchanges {
            if !go_on() {
                break;
            }
            let begun = bus.now();
            let mut words = [0];
            let answer = bus
                .start(&list, &words)
                .and_then(|()| bus.finish(&list, &mut words));
            match answer.map_err(|error| (error.kind(), error)) {
                Ok(_) => times.push(bus.now().since(begun)),
                Err((BusErrorKind::Late, _)) => late += 1,
                Err((BusErrorKind::Lost | BusErrorKind::Stale | BusErrorKind::Short, _)) => {
                    lost += 1;
                }
                Err((_, error)) => return Err(error),
            }
            let left = begun.after(period).since(bus.now());
            bus.wait(left);
        }
        Ok(Self::new(times, lost, late))
    }

    /// Number of requests.
    pub fn asked(&self) -> u32 {
        self.times.len() as u32 + self.lost + self.late
    }

    /// Returns the response time that the given share of the replies, 0 to 1, did not exceed; zero
    /// without replies.
    pub fn quantile(&self, share: f64) -> Duration {
        let rank = (self.times.len() as f64 * share).ceil() as usize;
        let at = rank.clamp(1, self.times.len().max(1)) - 1;
        self.times.get(at).copied().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesa_hal_sim::machines;

    #[test]
    fn quantiles_are_ranks() {
        let times = (1..=100).rev().map(Duration::from_micros).collect();
        let trips = RoundTrips::new(times, 2, 1);
        assert_eq!(trips.asked(), 103);
        let micros = [0.0, 0.5, 0.99, 1.0].map(|share| trips.quantile(share).as_micros());
        assert_eq!(micros, [1, 50, 99, 100]);
        assert_eq!(RoundTrips::default().quantile(0.5), Duration::ZERO);
    }

    #[test]
    fn a_board_that_answers_is_asked_as_often_as_wanted() {
        let mut bus = machines::i7i97(1);
        let period = Duration::from_millis(1);
        let trips = RoundTrips::measure(&mut bus, 50, period, || true).unwrap();
        assert_eq!((trips.asked(), trips.lost, trips.late), (50, 0, 0));
        let mut left = 5;
        let mut go_on = || {
            left -= 1;
            left >= 0
        };
        let trips = RoundTrips::measure(&mut bus, 50, period, &mut go_on).unwrap();
        assert_eq!(trips.asked(), 5);
    }
}
