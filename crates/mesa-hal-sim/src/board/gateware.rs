//! The interface between the protocol and the FPGA.

use super::SimBoard;
use crate::{SimFpga, wire::Nanos};

/// The FPGA behind the protocol: space 0, and the timers that space 4 waits for.
pub trait Gateware {
    /// Advances to `now`.
    fn advance_to(&mut self, now: Nanos);

    /// Reads the 32-bit register at a byte address, a multiple of 4, at the time reached.
    fn read_register(&mut self, address: u16) -> u32;

    /// Writes the 32-bit register at a byte address, a multiple of 4, at the time reached.
    fn write_register(&mut self, address: u16, value: u32);

    /// Advances to the next rising edge of the DPLL's reference (0) or of one of its timers (1 to
    /// 4), but not past `limit`; returns the time of the edge.
    fn wait_for_timer(&mut self, timer: u8, limit: Nanos) -> Option<Nanos>;

    /// True if the FPGA has no configuration; the board then does not answer.
    fn is_in_reset(&self) -> bool {
        false
    }

    /// Configures the FPGA again: registers as after power-up. Remotes stay plugged in.
    fn reconfigure(&mut self);
}

impl Gateware for SimFpga {
    fn advance_to(&mut self, now: Nanos) {
        SimFpga::advance_to(self, now);
    }

    fn read_register(&mut self, address: u16) -> u32 {
        SimFpga::read_register(self, address)
    }

    fn write_register(&mut self, address: u16, value: u32) {
        SimFpga::write_register(self, address, value);
    }

    fn wait_for_timer(&mut self, timer: u8, limit: Nanos) -> Option<Nanos> {
        let edge = self
            .dpll()
            .and_then(|dpll| dpll.next_edge(self.now(), timer));
        let edge = edge.filter(|&edge| edge <= limit);
        SimFpga::advance_to(self, edge.unwrap_or(limit));
        edge
    }

    fn is_in_reset(&self) -> bool {
        SimFpga::is_in_reset(self)
    }

    fn reconfigure(&mut self) {
        self.reload();
    }
}

impl SimBoard<SimFpga> {
    /// State of the user LEDs CR01 to CR04, lit or not, whichever side owns them. CR01 is user LED
    /// 3, the highest bit of a debug value. Manual: 7I97, "BOARD STATUS LEDS".
    pub fn lit_leds(&self) -> [bool; 4] {
        let debug = self.debug_leds();
        [0, 1, 2, 3].map(|led| match debug {
            Some(shown) => shown >> (3 - led) & 1 != 0,
            None => self.gateware().leds().is_lit(led),
        })
    }
}
