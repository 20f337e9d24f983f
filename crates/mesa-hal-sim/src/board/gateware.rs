//! What the protocol needs of the FPGA behind it.

use super::SimBoard;
use crate::{SimFpga, wire::Nanos};

/// The FPGA behind the protocol: space 0, and what space 4 waits for.
pub trait Gateware {
    /// Lets time pass up to `now`.
    fn advance_to(&mut self, now: Nanos);

    /// Reads the 32-bit register at a byte address, a multiple of 4, at the time reached.
    fn read_register(&mut self, address: u16) -> u32;

    /// Writes the 32-bit register at a byte address, a multiple of 4, at the time reached.
    fn write_register(&mut self, address: u16, value: u32);

    /// Lets time pass until the next rising edge of the DPLL's reference (0) or of one of its
    /// timers (1 to 4), but not past `limit`; returns when it came.
    fn wait_for_timer(&mut self, timer: u8, limit: Nanos) -> Option<Nanos>;

    /// Whether the FPGA is without its configuration; then the board does not answer.
    fn is_in_reset(&self) -> bool {
        false
    }

    /// The FPGA is configured again: registers as after power-up. What is plugged in stays.
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
    /// Which of the user LEDs CR01 to CR04 are lit, whoever has them. CR01 is user LED 3, the highest
    /// bit of a debug value. Manual: 7I97, "BOARD STATUS LEDS".
    pub fn lit_leds(&self) -> [bool; 4] {
        let debug = self.debug_leds();
        [0, 1, 2, 3].map(|led| match debug {
            Some(shown) => shown >> (3 - led) & 1 != 0,
            None => self.gateware().leds().is_lit(led),
        })
    }
}
