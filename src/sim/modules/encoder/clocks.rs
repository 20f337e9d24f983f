//! The free-running dividers of the encoders: multiplexer and filters, and time stamps.

use crate::sim::wire::Nanos;

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
    /// The counter after the clock edge `.1`, and the edge at which it counts next.
    base: (u64, Clocks),
    next: Clocks,
}

impl Stamps {
    /// Divides by the clock itself.
    const UNDIVIDED: u16 = 0x8000;

    pub fn new() -> Self {
        Self {
            register: 0,
            base: (0, 0),
            next: 2,
        }
    }

    pub fn register(&self) -> u16 {
        self.register
    }

    /// A new divisor holds from the next count on; the clock itself at once.
    pub fn write(&mut self, now: Clocks, register: u16) {
        // A count in progress still comes.
        let soon = now + 1;
        self.base = (self.after(soon), soon);
        self.next = if self.register & Self::UNDIVIDED != 0 || self.next > soon {
            self.next.max(soon + 1)
        } else {
            let period = self.period();
            self.next + ((soon - self.next) / period + 1) * period
        };
        self.register = register;
        if register & Self::UNDIVIDED != 0 {
            self.next = soon + 1;
        }
    }

    /// The counter after a clock edge, which is not before the last write.
    pub fn after(&self, clock: Clocks) -> u64 {
        let (count, _) = self.base;
        if clock < self.next {
            return count;
        }
        count + 1 + (clock - self.next) / self.period()
    }

    fn period(&self) -> Clocks {
        if self.register & Self::UNDIVIDED != 0 {
            1
        } else {
            Clocks::from(self.register) + 2
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
