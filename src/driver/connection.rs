//! The connection to the board: presence of the board, and failed exchanges.

use core::time::Duration;

use super::DriverStatistics;
use crate::bus::{Phase, ReadSlot, Words};
use crate::fraction::Fraction;
use crate::hal::{GroupId, InOut, Input, Param, PinStore, Pins};
use crate::hostmot2::{COOKIE, COOKIE_ADDRESS};
use crate::modules::{RegisterError, Registrar};

/// Lower limit of the deadline for a reply, for any setting of the application: as in LinuxCNC.
const SHORTEST_DEADLINE: Duration = Duration::from_micros(100);

/// The connection by Ethernet: LinuxCNC's pins and parameters, and their state.
#[derive(Debug)]
pub(super) struct Connection {
    cookie: ReadSlot,
    /// The group of the driver's own pins, which stay valid after any failure.
    group: GroupId,
    lost_writes: Input<u32>,
    /// The connection failed for good; set to false to try again.
    io_error: Param<bool>,
    /// This cycle had an error.
    packet_error: Input<bool>,
    /// Number of failed reads and writes, counted on from any value that the application sets.
    packet_error_total: InOut<u32>,
    /// Rises by the increment for a failed read or write, and falls by the decrement for a
    /// successful read, within 0 and the limit. Manual page hm2_eth(9).
    packet_error_level: Input<i32>,
    /// The level is at the limit.
    packet_error_exceeded: Input<bool>,
    /// Decrement of the level. LinuxCNC 2.9 made it read-only, against its manual page.
    packet_error_decrement: Param<i32>,
    /// Increment of the level.
    packet_error_increment: Param<i32>,
    /// The level at which the connection counts as failed: everything is safe, and `io_error` set.
    packet_error_limit: Param<i32>,
    /// Deadline for a reply: up to 99 in per cent of the period, otherwise in nanoseconds; 0 or
    /// less is 80 %. Until it is changed, the bus keeps its own deadline.
    /// Manual page hm2_eth(9), `packet-read-timeout`.
    packet_read_timeout: Param<i32>,
    /// LinuxCNC's `packet-error-level`; set to 0 when the board has its set-up again.
    pub level: i32,
    /// The last value of LinuxCNC's `packet-read-timeout`.
    read_timeout: i32,
}

/// Increment of the level for a failure.
const INCREMENT: i32 = 2;
const READ_TIMEOUT: i32 = 80;

impl Connection {
    pub fn register(r: &mut Registrar<'_>) -> Result<Self, RegisterError> {
        let errors = i32::try_from(r.settings.bus_error_limit).unwrap_or(i32::MAX);
        let limit = INCREMENT.saturating_mul(errors);
        let (cookie, group) = (r.image.read(Phase::Status, COOKIE_ADDRESS), r.group);
        let mut make = r.maker("");
        Ok(Self {
            cookie,
            group,
            io_error: make.setting("io_error", false)?,
            packet_error: make.input("packet-error")?,
            packet_error_total: make.inout("packet-error-total")?,
            packet_error_level: make.input("packet-error-level")?,
            packet_error_exceeded: make.input("packet-error-exceeded")?,
            packet_error_decrement: make.property("packet-error-decrement", 1)?,
            packet_error_increment: make.setting("packet-error-increment", INCREMENT)?,
            packet_error_limit: make.setting("packet-error-limit", limit)?,
            packet_read_timeout: make.setting("packet-read-timeout", READ_TIMEOUT)?,
            lost_writes: make.input("lost-writes")?,
            level: 0,
            read_timeout: READ_TIMEOUT,
        })
    }

    /// Checks that the registers are those of a HostMot2; the error is the word in place of its
    /// cookie.
    pub fn check(&self, words: &Words) -> Result<(), u32> {
        match words.word(self.cookie) {
            COOKIE => Ok(()),
            other => Err(other),
        }
    }

    /// Lets [`new_deadline`](Self::new_deadline) return any deadline but the usual one again.
    pub fn forget_deadline(&mut self) {
        self.read_timeout = READ_TIMEOUT;
    }

    /// The deadline of a reply, if the application has changed it.
    pub fn new_deadline(&mut self, pins: &Pins, period: Duration) -> Option<Duration> {
        let timeout = pins.param(self.packet_read_timeout);
        if core::mem::replace(&mut self.read_timeout, timeout) == timeout {
            return None;
        }
        let deadline = match u32::try_from(timeout).unwrap_or(0) {
            0 => period.fraction(4, 5),
            percent @ 1..100 => period.fraction(percent, 100),
            nanos => Duration::from_nanos(nanos.into()),
        };
        Some(deadline.max(SHORTEST_DEADLINE))
    }

    /// Counts an exchange; `true` when the error level has reached its limit. Each failure adds the
    /// increment, each success subtracts the decrement, and the level stays within 0 and the limit:
    /// manual page hm2_eth(9).
    pub fn count_exchange(&mut self, pins: &mut PinStore, failed: bool) -> bool {
        if !failed && self.level == 0 && !pins.read(self.packet_error).value {
            return false;
        }
        let limit = pins.param(self.packet_error_limit).max(1);
        self.level = if failed {
            let more = pins.param(self.packet_error_increment).max(1);
            self.level.saturating_add(more).min(limit)
        } else {
            let less = pins.param(self.packet_error_decrement).max(0);
            self.level.saturating_sub(less).clamp(0, limit)
        };
        if failed {
            // Counted on from a value that the application may have set.
            let total = pins.read(self.packet_error_total).value;
            pins.publish(self.packet_error_total, total.saturating_add(1));
        }
        let exceeded = self.level == limit;
        pins.publish(self.packet_error, failed);
        pins.publish(self.packet_error_level, self.level);
        pins.publish(self.packet_error_exceeded, exceeded);
        failed && exceeded
    }

    /// True if the application has cleared the error.
    pub fn is_cleared(&self, pins: &Pins) -> bool {
        !pins.param(self.io_error)
    }

    /// Publishes `io_error`.
    pub fn show(&self, pins: &mut PinStore, is_error: bool) {
        pins.publish(self.io_error, is_error);
    }

    pub fn publish(&self, pins: &mut PinStore, statistics: &DriverStatistics) {
        let lost = u32::try_from(statistics.lost_writes).unwrap_or(u32::MAX);
        pins.publish(self.lost_writes, lost);
        pins.group_good(self.group);
    }
}
