//! The free-running dividers of the encoders: multiplexer and filters, and time stamps.

use crate::wire::Nanos;

/// Clock edges since the configuration of the FPGA.
pub(super) type Clocks = u64;

/// The clock of all the dividers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    hz: u32,
    /// Its period, if it is a whole number.
    period: Option<Nanos>,
    /// Time of the configuration of the FPGA.
    origin: Nanos,
}

impl Clock {
    pub fn new(hz: u32, origin: Nanos) -> Self {
        let hz = hz.max(1);
        let whole = 1_000_000_000 % hz == 0;
        Self {
            hz,
            period: whole.then(|| Nanos::from(1_000_000_000 / hz)),
            origin,
        }
    }

    /// Restarts at a new configuration of the FPGA.
    pub fn restart(&mut self, origin: Nanos) {
        self.origin = origin;
    }

    pub fn hz(&self) -> f64 {
        f64::from(self.hz)
    }

    /// Number of clock edges up to `now`.
    pub fn passed(&self, now: Nanos) -> Clocks {
        let nanos = now.saturating_sub(self.origin);
        match self.period {
            Some(period) => nanos / period,
            None => (u128::from(nanos) * u128::from(self.hz) / 1_000_000_000) as Clocks,
        }
    }

    /// The first clock edge that is not before `now`.
    pub fn next(&self, now: Nanos) -> Clocks {
        let nanos = now.saturating_sub(self.origin);
        match self.period {
            Some(period) => nanos.div_ceil(period),
            None => (u128::from(nanos) * u128::from(self.hz)).div_ceil(1_000_000_000) as Clocks,
        }
    }
}

/// The divider of multiplexer and filters. The divider loads its register whenever it has run out,
/// so that a change of the register waits for that.
#[derive(Clone, Copy, Debug)]
pub(super) struct Divider {
    /// The last three load times, the newest first.
    loaded: [Clocks; 3],
    /// Number of loads.
    count: u64,
    period: Clocks,
    /// The period of loads after the clock edge `.1`, and the period before it (`.2`).
    register: (Clocks, Clocks, Clocks),
}

impl Divider {
    /// A divider whose first load is at the clock edge `first`.
    pub fn new(register: u32, first: Clocks) -> Self {
        let period = period(register);
        Self {
            loaded: [first; 3],
            count: 0,
            period,
            register: (period, 0, period),
        }
    }

    /// Writes the register at the clock edge `now`.
    pub fn write(&mut self, now: Clocks, register: u32) {
        let (present, _, _) = self.register;
        self.register = (period(register), now, present);
    }

    pub fn count(&self) -> u64 {
        self.count
    }

    /// The time of the last load, and of the two before.
    pub fn loaded(&self) -> [Clocks; 3] {
        self.loaded
    }

    fn next(&self) -> Clocks {
        let [last, ..] = self.loaded;
        last + self.period
    }

    /// Advances to the next load.
    pub fn step(&mut self) {
        let [last, before, _] = self.loaded;
        let next = self.next();
        let (present, since, former) = self.register;
        self.period = if next > since { present } else { former };
        self.loaded = [next, last, before];
        self.count += 1;
    }

    /// Advances through all loads up to `to`.
    pub fn run_to(&mut self, to: Clocks) {
        while self.next() <= to {
            self.step();
            self.skip(to, 1);
        }
    }

    /// Advances by the number of loads up to `to`, rounded down to a multiple of `by`.
    pub fn skip(&mut self, to: Clocks, by: u64) {
        self.skip_at_most(to, by, u64::MAX);
    }

    /// The same, by at most `most` loads. Returns their number.
    pub fn skip_at_most(&mut self, to: Clocks, by: u64, most: u64) -> u64 {
        let (present, since, _) = self.register;
        let [last, ..] = self.loaded;
        if last <= since || self.period != present || to <= last {
            return 0;
        }
        let loads = ((to - last) / self.period).min(most) / by * by;
        let at = |load: u64| last + load * self.period;
        // The earlier loads may have been periods of another rate.
        self.loaded = match (loads, self.loaded) {
            (0, loaded) => loaded,
            (1, [_, before, _]) => [at(1), last, before],
            (loads, _) => [at(loads), at(loads - 1), at(loads - 2)],
        };
        self.count += loads;
        loads
    }
}

/// The counter's top bit: it has run out. A counter loaded with this bit runs out at once.
const RUN_OUT: u32 = 0x800;

/// Clocks between loads for a rate register.
pub(super) fn period(register: u32) -> Clocks {
    if register & RUN_OUT != 0 {
        1
    } else {
        Clocks::from(register & (RUN_OUT - 1)) + 2
    }
}

/// The time-stamp counter. It is a function of time until its divider is written.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stamps {
    register: u16,
    present: Stretch,
    /// Continuation after the first count with the divisor that was written last.
    following: Stretch,
}

/// The counter from one of its count edges on.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    /// Clock edge of the first count, and the counter's value after it.
    first: Clocks,
    count: u64,
    period: Clocks,
}

impl Stretch {
    fn after(self, clock: Clocks) -> u64 {
        let counts = clock.saturating_sub(self.first) / self.period;
        self.count + counts
    }

    /// Continues with another period from the first count after a clock edge.
    fn followed(self, clock: Clocks, period: Clocks) -> Self {
        let counts = (clock + self.period).saturating_sub(self.first) / self.period;
        Self {
            first: self.first + counts * self.period,
            count: self.count + counts,
            period,
        }
    }
}

impl Stamps {
    /// Code for the undivided clock.
    const UNDIVIDED: u16 = 0x8000;
    /// From the write of the divider to the last count with the old divisor.
    const TO_LOAD: Clocks = 1;

    pub fn new() -> Self {
        let present = Stretch {
            first: 0,
            count: 0,
            period: Self::period(0),
        };
        Self {
            register: 0,
            present,
            following: present,
        }
    }

    pub fn register(&self) -> u16 {
        self.register
    }

    /// Writes the divisor. A count in progress is completed; the new divisor applies from there on.
    pub fn write(&mut self, now: Clocks, register: u16) {
        self.register = register;
        let (last, period) = (now + Self::TO_LOAD, Self::period(register));
        if self.following.first <= last {
            self.present = self.following;
        }
        self.following = self.present.followed(last, period);
    }

    /// The counter after a clock edge, which is not before the last write.
    pub fn after(&self, clock: Clocks) -> u64 {
        if clock < self.following.first {
            self.present.after(clock)
        } else {
            self.following.after(clock)
        }
    }

    fn period(register: u16) -> Clocks {
        if register & Self::UNDIVIDED != 0 {
            1
        } else {
            Clocks::from(register) + 2
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rate_with_its_top_bit_set_divides_by_one() {
        let mut divider = Divider::new(4, 0);
        divider.run_to(12);
        assert_eq!(divider.loaded(), [12, 6, 0]);
        divider.write(13, 0x800);
        divider.run_to(21);
        // The six clocks of the count in progress still pass.
        assert_eq!(divider.loaded(), [21, 20, 19]);
        assert_eq!(divider.count(), 2 + 4);
        divider.write(21, 0);
        divider.run_to(26);
        assert_eq!(divider.loaded(), [26, 24, 22]);
    }
}
