//! The board itself in the cycle: is it there, and is its watchdog fed.

use alloc::format;
use core::time::Duration;

use super::{BoardState, DriverStatistics};
use crate::boards::fpga::{EthernetPins, FpgaPins, WatchdogPins};
use crate::bus::{CycleImage, ImagePlan, ReadPhase, ReadSlot, Tier, WritePhase, WriteSlot};
use crate::hal::{GroupId, Input, PinError, Pins, Spec};
use crate::hostmot2::{Watchdog, WatchdogStatus, WatchdogTime};

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
    state: BoardState,
    /// What the pins show.
    is_shown: Option<BoardState>,
    /// The watchdog's time has to be written with the next write.
    set_time: bool,
    cookie: Option<ReadSlot>,
    status: Option<ReadSlot>,
    /// A register that reads otherwise when the board has lost its set-up, and its bits.
    evidence: Option<(u16, u32)>,
    evidence_slot: Option<ReadSlot>,
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
        pins: &mut Pins,
        group: GroupId,
        name: &str,
        watchdog: Watchdog,
        timeout: Duration,
        error_limit: u32,
    ) -> Result<Self, PinError> {
        let timeout_ns = u32::try_from(timeout.as_nanos()).unwrap_or(u32::MAX);
        let watchdog_pins = WatchdogPins::new(pins, group, name)?;
        pins.publish_param(watchdog_pins.timeout_ns, timeout_ns);
        let bus = EthernetPins::new(pins, group, name)?;
        let limit = pins.param(bus.packet_error_increment);
        let limit = limit.saturating_mul(i32::try_from(error_limit).unwrap_or(i32::MAX));
        pins.publish_param(bus.packet_error_limit, limit);
        let lost_writes = Spec::new(format!("{name}.lost-writes"));
        let lost_writes = pins.add_input(group, lost_writes)?;
        Ok(Self {
            watchdog,
            timeout_ns,
            state: BoardState::Running,
            is_shown: None,
            set_time: true,
            cookie: None,
            status: None,
            evidence: None,
            evidence_slot: None,
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

    /// Names bits of a register that are set by set-up and read back as set: when they do not any
    /// more, the board has lost its set-up.
    pub fn watch(&mut self, address: u16, bits: u32) {
        self.evidence = Some((address, bits));
    }

    pub fn claim(&mut self, plan: &mut ImagePlan) {
        self.cookie = Some(plan.read(ReadPhase::Status, Tier::Cycle, COOKIE_ADDRESS, 1));
        self.status = Some(plan.read_data(self.watchdog.status));
        self.evidence_slot = self
            .evidence
            .map(|(address, _)| plan.read(ReadPhase::Data, Tier::Extended, address, 1));
        self.pet = Some(plan.write_data(self.watchdog.reset, Watchdog::PET));
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

    /// Whether the watchdog has bitten.
    pub fn has_bitten(&self, image: &CycleImage) -> bool {
        let status = self.status.and_then(|slot| image.word(slot));
        status.is_none_or(|word| {
            WatchdogStatus::from_bits_retain(word).contains(WatchdogStatus::HAS_BIT)
        })
    }

    /// Whether an extended read tells if the board is still set up.
    pub fn has_evidence(&self) -> bool {
        self.evidence_slot.is_some()
    }

    /// Whether the board is not set up any more: it was reset, or the set-up never arrived. Of an
    /// extended read.
    pub fn has_lost_set_up(&self, image: &CycleImage) -> bool {
        let word = self.evidence_slot.and_then(|slot| image.word(slot));
        match (self.evidence, word) {
            (Some((_, bits)), Some(word)) => word & bits != bits,
            _ => false,
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
        self.set_time = true;
        self.error_level = 0;
    }

    pub fn tier_of_write(&self) -> Tier {
        if self.set_time {
            Tier::Extended
        } else {
            Tier::Cycle
        }
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

    /// Feeds the watchdog, unless everything has to stay safe.
    pub fn put(&mut self, image: &mut CycleImage, pins: &Pins) {
        let timeout_ns = pins.param(self.pins.watchdog.timeout_ns);
        self.set_time |= timeout_ns != self.timeout_ns;
        self.timeout_ns = timeout_ns;
        let time = self
            .watchdog
            .time_for(Duration::from_nanos(timeout_ns.into()));
        if let (Some(pet), Some(slot)) = (self.pet, self.time) {
            let fed = self.is_running();
            image.put(pet, if fed { Watchdog::PET } else { 0 });
            image.put(slot, time.0);
        }
    }

    pub fn written(&mut self) {
        self.set_time = false;
    }

    /// Counts an exchange; `true` when the error level has reached its limit. Each failure adds the
    /// increment, each success takes the decrement off, and the level stays within 0 and the limit:
    /// manual page hm2_eth(9).
    pub fn count_exchange(&mut self, pins: &mut Pins, failed: bool) -> bool {
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
            pins.publish_inout(of.packet_error_total, total.saturating_add(1));
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

    pub fn publish(&mut self, pins: &mut Pins, statistics: &DriverStatistics) {
        let bitten = self.state == BoardState::WatchdogBitten;
        let io_error = matches!(self.state, BoardState::BusDown | BoardState::Reset);
        let count = |n: u64| u32::try_from(n).unwrap_or(u32::MAX);
        let of = &self.pins;
        if self.is_shown != Some(self.state) {
            // Once, so that it stays cleared when the application clears it to go on.
            self.is_shown = Some(self.state);
            pins.publish_inout(of.watchdog.has_bit, bitten);
            pins.publish_param(of.bus.io_error, io_error);
        }
        pins.publish(of.lost_writes, count(statistics.lost_writes));
        pins.group_good(self.group);
    }
}
