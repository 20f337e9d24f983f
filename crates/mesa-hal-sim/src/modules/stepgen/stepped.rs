//! The generator tick by tick, as the rules describe it: the reference for the simulation, which
//! goes from event to event.

/// A generator, with one variable for each register of the rules.
#[derive(Clone, Debug, Default)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "they are registers of the hardware"
)]
pub(super) struct Stepped {
    pub rate: i32,
    pub accum: u64,
    pub mode: u8,
    pub dir_setup: u16,
    pub dir_hold: u16,
    pub step_len: u16,
    pub step_space: u16,
    pub table: [u8; 16],
    pub table_max: u8,
    pub pointer: u8,
    top_before: bool,
    negative_before: bool,
    step: bool,
    dir: bool,
    in_pulse: bool,
    pulse: u16,
    in_space: bool,
    space: u16,
    hold: u16,
    setup: u16,
}

/// The divider of the master rate.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SteppedMaster {
    pub rate: u32,
    pub sum: u64,
    was_high: bool,
    pub adds: bool,
}

impl SteppedMaster {
    pub(super) fn tick(&mut self) {
        let high = self.sum >> 32 & 1 != 0;
        self.adds = high != self.was_high;
        self.was_high = high;
        self.sum = (self.sum + u64::from(self.rate)) % (1 << 33);
    }
}

fn top(accum: u64) -> bool {
    accum >> 31 & 1 != 0
}

impl Stepped {
    /// One tick, from the state before it.
    pub(super) fn tick(&mut self, adds: bool) {
        let old = self.clone();
        let negative = old.rate < 0;
        let is = top(old.accum);
        let begins = if old.negative_before {
            is && !old.top_before
        } else {
            !is && old.top_before
        };
        let next = old.accum.wrapping_add_signed(old.rate.into()) % (1 << 48);
        let crosses = if negative {
            !is && top(next)
        } else {
            is && !top(next)
        };
        let blocked = old.in_pulse || old.in_space || old.setup > 0 || negative != old.dir;
        if adds && !(crosses && blocked) {
            self.accum = next;
        }
        match (old.in_space, old.space) {
            (true, 0) => self.in_space = false,
            (true, _) => self.space -= 1,
            _ => {}
        }
        match (old.in_pulse, old.pulse) {
            (true, 0) => {
                (self.in_pulse, self.step) = (false, false);
                (self.in_space, self.space) = (old.step_space > 0, old.step_space);
            }
            (true, _) => self.pulse -= 1,
            _ => {}
        }
        self.setup = old.setup.saturating_sub(1);
        match (begins, old.hold) {
            (true, _) => self.hold = old.dir_hold,
            (_, 1..) => self.hold -= 1,
            _ if negative != old.dir => (self.dir, self.setup) = (negative, old.dir_setup),
            _ => {}
        }
        if begins {
            self.step = true;
            (self.in_pulse, self.pulse) = (old.step_len > 0, old.step_len);
            self.turn_table(old.negative_before);
        }
        self.top_before = is;
        self.negative_before = negative;
    }

    fn turn_table(&mut self, down: bool) {
        self.pointer = match (down, self.pointer) {
            (true, 0) => self.table_max,
            (true, pointer) => pointer - 1,
            (false, pointer) if pointer == self.table_max => 0,
            (false, pointer) => pointer + 1,
        };
    }

    pub(super) fn outputs(&self) -> u8 {
        let bits = |first: bool, second: bool| u8::from(first) + 2 * u8::from(second);
        let outputs = match self.mode & 3 {
            0 => bits(self.step, self.dir),
            1 => bits(self.step && !self.dir, self.step && self.dir),
            2 => {
                let (high, low) = (top(self.accum), self.accum >> 30 & 1 != 0);
                bits(high != low, high)
            }
            _ => self.table[usize::from(self.pointer)],
        };
        match (self.mode & 4, outputs & 3) {
            (4, 1) => outputs + 1,
            (4, 2) => outputs - 1,
            _ => outputs,
        }
    }
}
