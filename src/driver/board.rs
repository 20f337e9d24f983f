//! The board itself in the cycle: is it there, and is its watchdog fed.

use alloc::format;
use core::time::Duration;

use super::evidence::Evidence;
use super::{BoardState, DriverStatistics};
use crate::boards::fpga::{EthernetPins, FpgaPins, WatchdogPins};
use crate::bus::{CycleImage, ImagePlan, ReadPhase, ReadSlot, Tier, WritePhase, WriteSlot};
use crate::hal::{GroupId, Input, PinError, PinStore, Pins, Spec};
use crate::hostmot2::{Watchdog, WatchdogTime};

/// Where every HostMot2 has its cookie, and what it is.
const COOKIE_ADDRESS: u16 = 0x0100;
const COOKIE: u32 = 0x55AA_CAFE;
/// Less is never waited for a reply, whatever the application sets: as in LinuxCNC.
const SHORTEST_DEADLINE: Duration = Duration::from_micros(100);

/// The registers of the board itself, and what is known of its state.
#[derive(Debug)]
pub(super) struct Board {
    watchdog: Watchdog,
    timeout_ns: u32,
    /// No shorter time is taken, because the period could not feed it.
    shortest: Duration,
    state: BoardState,
    /// What the pins show.
    is_shown: Option<BoardState>,
    pub evidence: Evidence,
    cookie: Option<ReadSlot>,
    pet: Option<WriteSlot>,
    time: Option<WriteSlot>,
    /// The group of the driver's own pins, which are valid whatever fails.
    group: GroupId,
    /// LinuxCNC's `packet-error-level`.
    error_level: i32,
    /// LinuxCNC's `packet-read-timeout`, as it was last.
    read_timeout: i32,
    pins: BoardPins,
}

#[derive(Clone, Copy, Debug)]
struct BoardPins {
    watchdog: WatchdogPins,
    bus: EthernetPins,
    lost_writes: Input<u32>,
}

/// What the board's own registers say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum BoardCheck {
    /// It is there.
    There,
    /// Something else answers.
    NotThere(u32),
}

impl Board {
    pub fn new(
        pins: &mut PinStore,
        group: GroupId,
        name: &str,
        watchdog: Watchdog,
        (timeout, period): (Duration, Duration),
        error_limit: u32,
    ) -> Result<Self, PinError> {
        let timeout_ns = u32::try_from(timeout.as_nanos()).unwrap_or(u32::MAX);
        let watchdog_pins = WatchdogPins::new(pins, group, name)?;
        pins.publish(watchdog_pins.timeout_ns, timeout_ns);
        let bus = EthernetPins::new(pins, group, name)?;
        let limit = pins.param(bus.packet_error_increment);
        let limit = limit.saturating_mul(i32::try_from(error_limit).unwrap_or(i32::MAX));
        pins.publish(bus.packet_error_limit, limit);
        let lost_writes = Spec::new(format!("{name}.lost-writes"));
        let lost_writes = pins.add_input(group, lost_writes)?;
        Ok(Self {
            watchdog,
            timeout_ns,
            shortest: period.saturating_mul(2),
            state: BoardState::Running,
            is_shown: None,
            evidence: Evidence::new(watchdog),
            cookie: None,
            pet: None,
            time: None,
            group,
            error_level: 0,
            read_timeout: pins.param(bus.packet_read_timeout),
            pins: BoardPins {
                watchdog: watchdog_pins,
                bus,
                lost_writes,
            },
        })
    }

    pub fn claim(&mut self, plan: &mut ImagePlan) {
        self.cookie = Some(plan.read(ReadPhase::Status, Tier::Cycle, COOKIE_ADDRESS, 1));
        self.evidence.claim(plan);
        // First, so that a board that was reset bites before it is given a time: see `evidence`.
        let (first, pet) = (WritePhase::First, Watchdog::PET);
        self.pet = Some(plan.write(first, Tier::Cycle, self.watchdog.reset, 1, pet));
        self.time = Some(plan.write(
            WritePhase::Data,
            Tier::Extended,
            self.watchdog.time,
            1,
            WatchdogTime::DISABLED.0,
        ));
    }

    /// Leaves the handles of its pins.
    pub fn tell(&self, made: &mut FpgaPins) {
        made.watchdog = self.pins.watchdog;
        made.ethernet = self.pins.bus;
    }

    pub fn watchdog(&self) -> &Watchdog {
        &self.watchdog
    }

    /// The watchdog's time as it was written last.
    pub fn timeout(&self) -> Duration {
        Duration::from_nanos(self.timeout_ns.into())
    }

    pub fn state(&self) -> BoardState {
        self.state
    }

    pub fn is_running(&self) -> bool {
        self.state == BoardState::Running
    }

    /// Whether the registers are those of a HostMot2.
    pub fn check(&self, image: &CycleImage) -> BoardCheck {
        match self.cookie.and_then(|slot| image.word(slot)) {
            Some(COOKIE) => BoardCheck::There,
            other => BoardCheck::NotThere(other.unwrap_or(0)),
        }
    }

    /// Leaves the running state for another; `false` if it had done so before.
    pub fn fail(&mut self, state: BoardState) -> bool {
        let news = self.is_running();
        if news {
            self.state = state;
        }
        news
    }

    /// The board has its set-up again.
    pub fn restored(&mut self) {
        self.state = BoardState::Running;
        self.error_level = 0;
    }

    /// How long a reply may take, when the application has changed that.
    pub fn new_deadline(&mut self, pins: &Pins, period: Duration) -> Option<Duration> {
        let timeout = pins.param(self.pins.bus.packet_read_timeout);
        if core::mem::replace(&mut self.read_timeout, timeout) == timeout {
            return None;
        }
        let deadline = match u32::try_from(timeout).unwrap_or(0) {
            0 => period.saturating_mul(4) / 5,
            percent @ 1..100 => period.saturating_mul(percent) / 100,
            nanos => Duration::from_nanos(nanos.into()),
        };
        Some(deadline.max(SHORTEST_DEADLINE))
    }

    /// Feeds the watchdog, unless everything has to stay safe; and gives it its time, if it has
    /// none yet, or another one. Returns whether the write holds the time.
    pub fn put(&mut self, image: &mut CycleImage, pins: &Pins) -> bool {
        let timeout_ns = pins.param(self.pins.watchdog.timeout_ns);
        let is_new = core::mem::replace(&mut self.timeout_ns, timeout_ns) != timeout_ns;
        let (Some(pet), Some(slot)) = (self.pet, self.time) else {
            return false;
        };
        let (is_running, has_time) = (self.is_running(), self.evidence.has_time());
        let fed = is_running && has_time;
        image.put(pet, if fed { Watchdog::PET } else { 0 });
        if !is_running || (self.evidence.is_in_cycle() && !is_new) {
            return false;
        }
        let timeout = Duration::from_nanos(timeout_ns.into());
        let time = self.watchdog.time_for(timeout.max(self.shortest));
        self.evidence.give(time);
        image.put(slot, time.0);
        image.request_write(slot);
        true
    }

    /// Counts an exchange; `true` when the error level has reached its limit. Each failure adds the
    /// increment, each success takes the decrement off, and the level stays within 0 and the limit:
    /// manual page hm2_eth(9).
    pub fn count_exchange(&mut self, pins: &mut PinStore, failed: bool) -> bool {
        let of = &self.pins.bus;
        let limit = pins.param(of.packet_error_limit).max(1);
        self.error_level = if failed {
            let more = pins.param(of.packet_error_increment).max(1);
            self.error_level.saturating_add(more).min(limit)
        } else {
            let less = pins.param(of.packet_error_decrement).max(0);
            self.error_level.saturating_sub(less).clamp(0, limit)
        };
        if failed {
            // From what the application may have set it to.
            let total = pins.read(of.packet_error_total).value;
            pins.publish(of.packet_error_total, total.saturating_add(1));
        }
        let exceeded = self.error_level == limit;
        pins.publish(of.packet_error, failed);
        pins.publish(of.packet_error_level, self.error_level);
        pins.publish(of.packet_error_exceeded, exceeded);
        failed && exceeded
    }

    /// Whether the application has cleared the flag of what made everything safe, and with that
    /// asks for the set-up to be written again.
    pub fn wants_restore(&self, pins: &Pins) -> bool {
        match self.state {
            BoardState::Running => false,
            BoardState::WatchdogBitten => !pins.read(self.pins.watchdog.has_bit).value,
            BoardState::Reset | BoardState::BusDown => !pins.param(self.pins.bus.io_error),
        }
    }

    pub fn publish(&mut self, pins: &mut PinStore, statistics: &DriverStatistics) {
        let bitten = self.state == BoardState::WatchdogBitten;
        let io_error = matches!(self.state, BoardState::BusDown | BoardState::Reset);
        let count = |n: u64| u32::try_from(n).unwrap_or(u32::MAX);
        let of = &self.pins;
        if self.is_shown != Some(self.state) {
            // Once, so that it stays cleared when the application clears it to go on.
            self.is_shown = Some(self.state);
            pins.publish(of.watchdog.has_bit, bitten);
            pins.publish(of.bus.io_error, io_error);
        }
        pins.publish(of.lost_writes, count(statistics.lost_writes));
        pins.group_good(self.group);
    }
}
