//! The phase-locked loop, in clocks: accumulator, limit, filter, integrator and outputs.

/// Width of the phase accumulator.
pub(super) const DDS_SIZE: u32 = 42;

const TURN: u64 = 1 << DDS_SIZE;
const HALF: u64 = TURN / 2;

/// Bits of the accumulator below those that the phase register shows.
const HIDDEN: u32 = DDS_SIZE - 32;

/// Range of [`PhaseLoop::next_change`] in steps: several periods at the fastest filter.
const LOOK_AHEAD: u32 = 1 << 17;

/// The registers of the loop, after `clocks` clock edges.
///
/// Three nested counters divide the clock: the prescaler gives the steps of the accumulator, and
/// the time constant, which is a prescaler too, gives those of the filter. The result of a step on
/// the phase error passes through two registers before it reaches the accumulator.
///
/// All words have the gateware's widths: correction, limit, filter and integrator have 24 bits,
/// signed, in 2^-42 of a period per step. They wrap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PhaseLoop {
    clocks: u64,
    pub base_rate: u32,
    pub filter_prescale: u16,
    pub timers: [u16; 4],
    /// The phase at the last sync.
    pub phase_error: i32,
    prescale: u8,
    limit: i32,
    prescale_count: u8,
    filter_count: u16,
    accumulator: u64,
    /// The phase error, clamped to the limit.
    bounded: i32,
    filtered: i32,
    integral: i32,
    correction: i32,
    /// The timers' outputs, which are registered: they follow the phase one clock later.
    timer_levels: [bool; 4],
}

impl Default for PhaseLoop {
    /// The state after configuration: all registers 0, and the outputs high.
    fn default() -> Self {
        Self {
            clocks: 0,
            base_rate: 0,
            filter_prescale: 0,
            timers: [0; 4],
            phase_error: 0,
            prescale: 0,
            limit: 0,
            prescale_count: 0,
            filter_count: 0,
            accumulator: 0,
            bounded: 0,
            filtered: 0,
            integral: 0,
            correction: 0,
            timer_levels: [true; 4],
        }
    }
}

impl PhaseLoop {
    /// The 32 readable bits of the phase.
    pub fn phase(&self) -> u32 {
        (self.accumulator >> HIDDEN) as u32
    }

    pub fn set_phase(&mut self, phase: u32) {
        let hidden = self.accumulator & ((1 << HIDDEN) - 1);
        self.accumulator = u64::from(phase) << HIDDEN | hidden;
    }

    /// Prescale and the present correction; the limit cannot be read back.
    pub fn control_0(&self) -> u32 {
        u32::from(self.prescale) << 24 | self.correction as u32 & 0x00FF_FFFF
    }

    /// Sets prescale and limit; clears the error, the filter and the integrator.
    pub fn set_control_0(&mut self, value: u32) {
        self.prescale = (value >> 24) as u8;
        self.limit = wrapped(value as i32);
        (self.phase_error, self.filtered, self.integral) = (0, 0, 0);
    }

    /// Clocks per step of the accumulator; 0 counts through all 8 bits.
    pub fn clocks_per_step(&self) -> u64 {
        match self.prescale {
            0 => 256,
            prescale => prescale.into(),
        }
    }

    /// The level of the reference (0) or of a timer (1 to 4).
    pub fn level(&self, output: u8) -> Option<bool> {
        match output.checked_sub(1) {
            None => Some(self.phase_is_high(0)),
            Some(timer) => self.timer_levels.get(usize::from(timer)).copied(),
        }
    }

    /// Advances to `clocks` clocks in all.
    pub fn run_to(&mut self, clocks: u64) {
        while self.clocks < clocks {
            let room = clocks - self.clocks - 1;
            self.skip(self.uniform().min(room));
            self.clock();
        }
    }

    /// The number of the clock edge at which an output next changes; the flag is true if it rises.
    /// `None` if the output does not change within sight while the registers stay unchanged.
    pub fn next_change(&self, output: u8) -> Option<(u64, bool)> {
        let mut ahead = *self;
        let before = ahead.level(output)?;
        for _ in 0..LOOK_AHEAD {
            let uniform = ahead.uniform();
            let change = ahead.clocks_to_change(output);
            if uniform == u64::MAX && change.is_none() && ahead.is_shown(output) {
                return None;
            }
            ahead.skip(uniform.min(change.unwrap_or(u64::MAX - 1)));
            ahead.clock();
            if ahead.level(output)? != before {
                return Some((ahead.clocks - 1, !before));
            }
        }
        None
    }

    /// Clocks from now on in which nothing changes but the counters and, uniformly, the
    /// accumulator. `u64::MAX` if that never ends.
    fn uniform(&self) -> u64 {
        if self.correction != self.next_correction() || self.bounded != self.next_bounded() {
            return 0;
        }
        if (self.filtered, self.integral) == self.next_filter() {
            return u64::MAX;
        }
        let steps = u64::from(self.filter_count.wrapping_sub(1));
        self.clocks_to_step() + steps * self.clocks_per_step()
    }

    /// Advances by `clocks` in which only the counters and the accumulator change.
    fn skip(&mut self, clocks: u64) {
        self.clocks += clocks;
        let first = self.clocks_to_step();
        let per_step = self.clocks_per_step();
        let Some(since_first) = clocks.checked_sub(first + 1) else {
            self.prescale_count = self.prescale_count.wrapping_sub(clocks as u8);
            return;
        };
        let steps = since_first / per_step + 1;
        let rest = since_first % per_step;
        self.prescale_count = self.prescale.wrapping_sub(rest as u8);
        self.accumulator = self.accumulator_after(steps);
        self.count_filter(steps);
    }

    /// Advances by one clock edge.
    fn clock(&mut self) {
        self.clocks += 1;
        for (timer, level) in self.timers.into_iter().zip(&mut self.timer_levels) {
            *level = is_high(self.accumulator, timer);
        }
        let correction = self.next_correction();
        if self.prescale_count == 1 {
            self.step();
        } else {
            self.prescale_count = self.prescale_count.wrapping_sub(1);
        }
        self.correction = correction;
    }

    /// Advances by one step of the accumulator.
    fn step(&mut self) {
        self.prescale_count = self.prescale;
        self.accumulator = self.accumulator_after(1);
        if self.filter_count == 1 {
            (self.filtered, self.integral) = self.next_filter();
        }
        self.count_filter(1);
        self.bounded = self.next_bounded();
    }

    /// Advances the filter's prescaler by `steps`.
    fn count_filter(&mut self, steps: u64) {
        let first = u64::from(self.filter_count.wrapping_sub(1));
        let period = match self.filter_prescale {
            0 => 1 << 16,
            prescale => prescale.into(),
        };
        self.filter_count = match steps.checked_sub(first + 1) {
            None => self.filter_count.wrapping_sub(steps as u16),
            Some(since) => self.filter_prescale.wrapping_sub((since % period) as u16),
        };
    }

    fn accumulator_after(&self, steps: u64) -> u64 {
        let moved = i128::from(steps) * i128::from(self.rate());
        (i128::from(self.accumulator) + moved).rem_euclid(i128::from(TURN)) as u64
    }

    /// Change of the phase per step.
    fn rate(&self) -> i64 {
        i64::from(self.base_rate) - i64::from(self.correction)
    }

    fn next_correction(&self) -> i32 {
        wrapped(self.filtered + (self.bounded >> 4) + self.integral)
    }

    fn next_bounded(&self) -> i32 {
        let (error, limit) = (self.phase_error >> 8, self.limit);
        if error > limit {
            limit
        } else if error < wrapped(-limit) {
            wrapped(-limit)
        } else {
            error
        }
    }

    /// Filter and integrator after the next step of the filter.
    fn next_filter(&self) -> (i32, i32) {
        let towards = (self.bounded >> 8) - (self.filtered >> 8);
        (
            wrapped(self.filtered + towards),
            wrapped(self.integral + (self.bounded >> 12)),
        )
    }

    /// Clocks before the one that makes the next step.
    fn clocks_to_step(&self) -> u64 {
        self.prescale_count.wrapping_sub(1).into()
    }

    fn phase_is_high(&self, timer: u16) -> bool {
        is_high(self.accumulator, timer)
    }

    /// True if an output already shows the present phase.
    fn is_shown(&self, output: u8) -> bool {
        self.level(output) == Some(self.phase_is_high(self.offset(output)))
    }

    fn offset(&self, output: u8) -> u16 {
        let timer = usize::from(output).checked_sub(1);
        timer
            .and_then(|timer| self.timers.get(timer))
            .map_or(0, |&timer| timer)
    }

    /// Clocks before the one at which an output changes, at a constant rate.
    fn clocks_to_change(&self, output: u8) -> Option<u64> {
        if !self.is_shown(output) {
            return Some(0);
        }
        let delay = u64::from(output != 0);
        let phase = turned(self.accumulator, self.offset(output)) % HALF;
        let rate = self.rate();
        let steps = match rate.signum() {
            0 => return None,
            1 => (HALF - phase).div_ceil(rate.unsigned_abs()),
            _ => phase / rate.unsigned_abs() + 1,
        };
        Some(self.clocks_to_step() + (steps - 1) * self.clocks_per_step() + delay)
    }
}

/// The phase of a timer: ahead by its register.
fn turned(accumulator: u64, timer: u16) -> u64 {
    (accumulator + (u64::from(timer) << (DDS_SIZE - 16))) % TURN
}

/// Outputs are high in the first half of their turn.
fn is_high(accumulator: u64, timer: u16) -> bool {
    turned(accumulator, timer) < HALF
}

/// The value truncated to a signed word of 24 bits, as in the hardware.
fn wrapped(value: i32) -> i32 {
    value << 8 >> 8
}
