//! Watchdog, connection and clock of a board.

use alloc::format;
use alloc::string::ToString;

use super::Maker;
use crate::hal::{GroupId, InOut, Input, Output, Param, PinError, PinStore};

/// The watchdog's pins, and the board's `io_error`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WatchdogPins {
    /// It has bitten; set it to false to go on.
    pub has_bit: InOut<bool>,
    /// After so many nanoseconds without a write it bites. Less than two periods are taken as two
    /// periods, because a write that is lost must not let it bite.
    pub timeout_ns: Param<u32>,
}

impl WatchdogPins {
    /// LinuxCNC's time: 5 ms.
    pub const DEFAULT_TIMEOUT_NS: u32 = 5_000_000;

    /// Makes the watchdog's pins.
    pub fn new(pins: &mut PinStore, group: GroupId, board: &str) -> Result<Self, PinError> {
        let mut make = Maker::new(pins, group, format!("{board}.watchdog."));
        Ok(Self {
            has_bit: make.inout("has_bit")?,
            timeout_ns: make.setting("timeout_ns", Self::DEFAULT_TIMEOUT_NS)?,
        })
    }
}

/// The pins of a connection by Ethernet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EthernetPins {
    /// The connection failed for good; set it to false to try again.
    pub io_error: Param<bool>,
    /// This cycle had an error.
    pub packet_error: Input<bool>,
    /// Reads and writes that failed, counted on from whatever it is set to.
    pub packet_error_total: InOut<u32>,
    /// Rises by the increment for a read or write that failed, and falls by the decrement for a
    /// read that did not, within 0 and the limit. Manual page hm2_eth(9).
    pub packet_error_level: Input<i32>,
    /// The level is at the limit.
    pub packet_error_exceeded: Input<bool>,
    /// By how much the level falls. LinuxCNC 2.9 made it read-only, against its manual page.
    pub packet_error_decrement: Param<i32>,
    /// By how much the level rises.
    pub packet_error_increment: Param<i32>,
    /// The level at which the connection counts as failed: everything is safe, and `io_error` set.
    pub packet_error_limit: Param<i32>,
    /// How long a reply is waited for: up to 99 in per cent of the period, otherwise in
    /// nanoseconds; 0 or less is 80 %. Until it is changed, the bus keeps its own deadline.
    /// Manual page hm2_eth(9), `packet-read-timeout`.
    pub packet_read_timeout: Param<i32>,
}

impl EthernetPins {
    /// Makes the pins of the connection.
    pub fn new(pins: &mut PinStore, group: GroupId, board: &str) -> Result<Self, PinError> {
        let mut make = Maker::new(pins, group, (board.to_string()) + ".");
        Ok(Self {
            io_error: make.setting("io_error", false)?,
            packet_error: make.input("packet-error")?,
            packet_error_total: make.inout("packet-error-total")?,
            packet_error_level: make.input("packet-error-level")?,
            packet_error_exceeded: make.input("packet-error-exceeded")?,
            packet_error_decrement: make.property("packet-error-decrement", 1)?,
            packet_error_increment: make.setting("packet-error-increment", 2)?,
            packet_error_limit: make.setting("packet-error-limit", 10)?,
            packet_read_timeout: make.setting("packet-read-timeout", 80)?,
        })
    }
}

/// The pins of the phase-locked loop that times the board by the cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DpllPins {
    /// When the four timers rise, in microseconds from the read; negative is before it.
    pub timer_us: [Output<f64>; 4],
    /// The loop's frequency in kHz.
    pub base_freq_khz: Output<f64>,
    /// How late the last read was for the loop, in microseconds; negative is early. 0 where the board
    /// paces the cycle, since the loop follows nobody then.
    pub phase_error_us: Input<f64>,
    /// Time constant of its filter.
    pub time_const: Output<u32>,
    /// How much it may correct; 0 lets it run free.
    pub plimit: Output<u32>,
    /// The width of its accumulator.
    pub ddsize: Input<u32>,
    /// Divides its clock.
    pub prescale: Input<u32>,
}

impl DpllPins {
    /// Makes the pins of the loop.
    pub fn new(pins: &mut PinStore, group: GroupId, board: &str) -> Result<Self, PinError> {
        let mut make = Maker::new(pins, group, format!("{board}.dpll."));
        let mut timer_us = [Output::nowhere(); 4];
        for (number, timer) in (1..).zip(&mut timer_us) {
            *timer = make.switch(&format!("{number:02}.timer-us"), 100.0)?;
        }
        Ok(Self {
            timer_us,
            base_freq_khz: make.switch("base-freq-khz", 1.0)?,
            phase_error_us: make.input("phase-error-us")?,
            time_const: make.switch("time-const", 2000)?,
            plimit: make.switch("plimit", 0x0040_0000)?,
            ddsize: make.input("ddsize")?,
            prescale: make.input("prescale")?,
        })
    }
}
