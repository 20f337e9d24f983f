//! HM2DPLL: a timer that follows the host's cycle.

use crate::sim::wire::Nanos;

const BASE_RATE: u8 = 0;
const PHASE_ERROR: u8 = 1;
const CONTROL_0: u8 = 2;
const CONTROL_1: u8 = 3;
const TIMERS_12: u8 = 4;
const TIMERS_34: u8 = 5;
const SYNC: u8 = 6;

/// Width of the phase accumulator.
const DDS_SIZE: u32 = 42;

/// The DPLL. REGISTERS, "DPLL".
///
/// Each access to the sync register says "now is the host's cycle": the phase error is how far
/// from that the DPLL's own period begins, in 2^-32 of the period, positive if the host is late.
/// Then a part of the error, at most the phase limit, is taken out.
#[derive(Clone, Copy, Debug)]
pub struct Dpll {
    clock: u32,
    base_rate: u32,
    control_0: u32,
    control_1: u32,
    timers: [u32; 2],
    /// A begin of the DPLL's period.
    origin: f64,
    phase_error: i32,
}

impl Dpll {
    pub(crate) fn new(clock: u32) -> Self {
        Self {
            clock: clock.max(1),
            base_rate: 0,
            control_0: 0,
            control_1: 0,
            timers: [0; 2],
            origin: 0.0,
            phase_error: 0,
        }
    }

    pub(crate) fn read(&mut self, now: Nanos, register: u8) -> u32 {
        let [timers_12, timers_34] = self.timers;
        match register {
            BASE_RATE => self.base_rate,
            PHASE_ERROR => self.phase_error as u32,
            CONTROL_0 => self.control_0,
            CONTROL_1 => self.control_1 | DDS_SIZE,
            TIMERS_12 => timers_12,
            TIMERS_34 => timers_34,
            SYNC => {
                self.sync(now);
                self.phase_error as u32
            }
            _ => 0,
        }
    }

    pub(crate) fn write(&mut self, now: Nanos, register: u8, value: u32) {
        let [timers_12, timers_34] = &mut self.timers;
        match register {
            BASE_RATE => self.base_rate = value,
            CONTROL_0 => self.control_0 = value,
            CONTROL_1 => self.control_1 = value & 0xFFFF_0000,
            TIMERS_12 => *timers_12 = value,
            TIMERS_34 => *timers_34 = value,
            SYNC => self.sync(now),
            _ => {}
        }
    }

    /// The period in nanoseconds, if it runs.
    pub fn period(&self) -> Option<f64> {
        let prescale = f64::from((self.control_0 >> 24).max(1));
        let rate = f64::from(self.base_rate) * f64::from(self.clock);
        let span = (1u64 << DDS_SIZE) as f64;
        (self.base_rate != 0).then(|| prescale * span / rate * 1e9)
    }

    /// The next rising edge after `now` of the reference (0) or of a timer (1 to 4), if the DPLL
    /// runs. A timer's edge is its register's part of the period behind the reference.
    pub fn next_edge(&self, now: Nanos, timer: u8) -> Option<Nanos> {
        let period = self.period()?;
        let [timers_12, timers_34] = self.timers;
        let offset = match timer {
            0 => 0,
            1 => timers_12,
            2 => timers_12 >> 16,
            3 => timers_34,
            4 => timers_34 >> 16,
            _ => return None,
        };
        let first = self.origin + f64::from(offset & 0xFFFF) / 65_536.0 * period;
        let passed = libm::floor((now as f64 - first) / period);
        let edge = libm::ceil(first + (passed + 1.0) * period) as Nanos;
        Some(edge.max(now + 1))
    }

    fn sync(&mut self, now: Nanos) {
        let Some(period) = self.period() else {
            self.phase_error = 0;
            return;
        };
        let turns = (now as f64 - self.origin) / period;
        let whole = libm::round(turns);
        let error = turns - whole;
        self.phase_error = (error * 4_294_967_296.0) as i32;
        let time_constant = f64::from(self.control_1 >> 16) / 65_536.0;
        let limit = f64::from(self.control_0 & 0x00FF_FFFF) / 16_777_216.0;
        let correction = (error * (1.0 - time_constant)).clamp(-limit, limit);
        self.origin += (whole + correction) * period;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timers_rise_at_their_part_of_the_period_behind_the_reference() {
        let mut dpll = Dpll::new(100_000_000);
        assert_eq!(dpll.next_edge(0, 0), None, "stands still");
        // 1 kHz: base rate = 1000 * 2^42 / 100 MHz.
        dpll.write(0, CONTROL_0, 1 << 24);
        dpll.write(0, BASE_RATE, 43_980_465);
        dpll.write(0, TIMERS_12, 0x4000_8000);
        dpll.write(0, TIMERS_34, 0xC000_0000);
        let near = |timer: u8, now: Nanos, expected: Nanos| {
            let edge = dpll.next_edge(now, timer).unwrap();
            assert!(
                edge > now && edge.abs_diff(expected) < 200,
                "{timer}: {edge}"
            );
        };
        near(0, 10_300_000, 11_000_000);
        near(1, 10_300_000, 10_500_000);
        near(2, 10_300_000, 11_250_000);
        near(3, 10_300_000, 11_000_000);
        near(4, 10_300_000, 10_750_000);
        assert_eq!(dpll.next_edge(0, 5), None);
    }
}
