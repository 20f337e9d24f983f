//! The free-running dividers of the encoders: multiplexer and filters, and time stamps.

use crate::wire::Nanos;

/// Clock edges since the FPGA was configured.
pub(super) type Clocks = u64;

/// The clock that everything here runs on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    hz: u32,
    /// Its period, if it is a whole number.
    period: Option<Nanos>,
    /// When the FPGA was configured.
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

    /// The FPGA is configured again.
    pub fn restart(&mut self, origin: Nanos) {
        self.origin = origin;
    }

    pub fn hz(&self) -> f64 {
        f64::from(self.hz)
    }

    /// How many clock edges there were up to `now`.
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

/// The divider of multiplexer and filters. It is loaded with its register whenever it has run out,
/// so that a change waits for that.
#[derive(Clone, Copy, Debug)]
pub(super) struct Divider {
    /// The last three times that it was loaded, the newest first.
    loaded: [Clocks; 3],
    /// How often it was loaded.
    count: u64,
    period: Clocks,
    /// What is loaded after `.1`, and what was before.
    register: (Clocks, Clocks, Clocks),
}

impl Divider {
    /// A divider that was loaded first at the clock edge `first`.
    pub fn new(register: u32, first: Clocks) -> Self {
        let period = period(register);
        Self {
            loaded: [first; 3],
            count: 0,
            period,
            register: (period, 0, period),
        }
    }

    /// Its register is written at the clock edge `now`.
    pub fn write(&mut self, now: Clocks, register: u32) {
        let (present, _, _) = self.register;
        self.register = (period(register), now, present);
    }

    pub fn count(&self) -> u64 {
        self.count
    }

    /// When it was loaded last, and the two times before.
    pub fn loaded(&self) -> [Clocks; 3] {
        self.loaded
    }

    fn next(&self) -> Clocks {
        let [last, ..] = self.loaded;
        last + self.period
    }

    /// Goes on to the next time that it is loaded.
    pub fn step(&mut self) {
        let [last, before, _] = self.loaded;
        let next = self.next();
        let (present, since, former) = self.register;
        self.period = if next > since { present } else { former };
        self.loaded = [next, last, before];
        self.count += 1;
    }

    /// Goes on through all loads up to `to`.
    pub fn run_to(&mut self, to: Clocks) {
        while self.next() <= to {
            self.step();
            self.skip(to, 1);
        }
    }

    /// Goes on by as many loads as there are up to `to`, or by a multiple of `by` below that.
    pub fn skip(&mut self, to: Clocks, by: u64) {
        let (present, since, _) = self.register;
        let [last, ..] = self.loaded;
        if last <= since || self.period != present || to <= last {
            return;
        }
        let loads = (to - last) / self.period / by * by;
        let at = |load: u64| last + load * self.period;
        // The times before may have been periods of another rate.
        self.loaded = match (loads, self.loaded) {
            (0, loaded) => loaded,
            (1, [_, before, _]) => [at(1), last, before],
            (loads, _) => [at(loads), at(loads - 1), at(loads - 2)],
        };
        self.count += loads;
    }
}

/// The counter's top bit: it has run out. Loaded with it, it runs out at once.
const RUN_OUT: u32 = 0x800;

/// Clocks from load to load, of a rate register.
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
    /// What the counter does after the first count with the divisor that was written last.
    following: Stretch,
}

/// The counter from an edge on that it counts at.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    /// The clock edge of the first count, and the counter after it.
    first: Clocks,
    count: u64,
    period: Clocks,
}

impl Stretch {
    fn after(self, clock: Clocks) -> u64 {
        let counts = clock.saturating_sub(self.first) / self.period;
        self.count + counts
    }

    /// The first count after a clock edge, and what follows it with another period.
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
    /// Divides by the clock itself.
    const UNDIVIDED: u16 = 0x8000;
    /// From the write of the divider to the last count that it does not change.
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

    /// A count in progress still comes; a new divisor holds from there on.
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
    fn a_rate_with_its_top_bit_set_divides_by_one() {
        let mut divider = Divider::new(4, 0);
        divider.run_to(12);
        assert_eq!(divider.loaded(), [12, 6, 0]);
        divider.write(13, 0x800);
        divider.run_to(21);
        // The six clocks that had begun still pass.
        assert_eq!(divider.loaded(), [21, 20, 19]);
        assert_eq!(divider.count(), 2 + 4);
        divider.write(21, 0);
        divider.run_to(26);
        assert_eq!(divider.loaded(), [26, 24, 22]);
    }
}
