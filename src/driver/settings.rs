//! What an application asks for before its driver starts.

use alloc::vec::Vec;
use core::time::Duration;

use super::{EncoderSetup, FaultPolicy, GpioConfig, Pace, SerialConfig, StartError};
use crate::boards::BoardTable;
use crate::bus::BusError;
use crate::modules::watchdog::WatchdogRegisters;

/// The most serial ports of a board.
pub(super) const MAX_PORTS: usize = 4;

/// What a driver is to be.
///
/// Everything has a default that fits a board on the bench: all ports with all their channels in
/// mode 0, all encoders, 1 ms.
#[derive(Clone, Debug)]
pub struct Settings {
    pub(crate) number: u8,
    pub(crate) period: Duration,
    /// `None`: it follows the period.
    pub(crate) watchdog: Option<Duration>,
    pub(crate) ports: [Option<SerialConfig>; MAX_PORTS],
    /// A port that was configured and that no board has.
    pub(crate) port_beyond: Option<u8>,
    pub(crate) encoders: EncoderSetup,
    /// `None` for what the board is made for.
    pub(crate) pwm_hz: Option<u32>,
    /// Leave the phase-locked loop alone.
    pub(crate) no_dpll: bool,
    /// Whether the phase-locked loop follows the reads, or they follow it.
    pub(crate) pace: Pace,
    pub(crate) gpio: Vec<(u16, GpioConfig)>,
    pub(crate) policy: FaultPolicy,
    pub(crate) bus_error_limit: u32,
    pub(crate) boards: Vec<&'static BoardTable>,
}

impl Default for Settings {
    fn default() -> Self {
        Self::new()
    }
}

impl Settings {
    /// What fits a board on the bench.
    #[must_use]
    pub fn new() -> Self {
        Self {
            number: 0,
            period: Duration::from_millis(1),
            watchdog: None,
            ports: [None; MAX_PORTS],
            port_beyond: None,
            encoders: EncoderSetup::default(),
            pwm_hz: None,
            no_dpll: false,
            pace: Pace::default(),
            gpio: Vec::new(),
            policy: FaultPolicy::default(),
            bus_error_limit: 5,
            boards: Vec::new(),
        }
    }

    /// Adds a kind of board that this crate does not know. Those that are added count before those
    /// that are built in.
    #[must_use]
    pub fn board(mut self, table: &'static BoardTable) -> Self {
        self.boards.push(table);
        self
    }

    /// The number of the board in pin names, for several boards of a kind; 0 at first.
    #[must_use]
    pub fn board_number(mut self, number: u8) -> Self {
        self.number = number;
        self
    }

    /// The period of the cycle: what the transfers must fit into, and what feeds the watchdogs. 1 us
    /// to 800 ms; 1 ms at first.
    ///
    /// What is not set otherwise follows it: the board's [`watchdog`](Self::watchdog), and the
    /// deadline of a reply, which is 80 % of it.
    #[must_use]
    pub fn period(mut self, period: Duration) -> Self {
        self.period = period;
        self
    }

    /// Who decides when a cycle begins; the host at first.
    #[must_use]
    pub fn pace(mut self, pace: Pace) -> Self {
        self.pace = pace;
        self
    }

    /// The time after which the board's watchdog bites without a write. If this is not called: five
    /// periods, and at least 5 ms. It runs from the first write on.
    ///
    /// Less than two periods are refused by [`Driver::start`](super::Driver::start), because one write that is lost
    /// must not let it bite.
    #[must_use]
    pub fn watchdog(mut self, timeout: Duration) -> Self {
        self.watchdog = Some(timeout);
        self
    }

    /// Which channels of serial port `port` (0 to 3) are used, and how.
    ///
    /// A port that is not mentioned is used with the default: whatever is there, in mode 0. One that
    /// the firmware does not have is refused by [`Driver::start`](super::Driver::start).
    #[must_use]
    pub fn serial_port(mut self, port: u8, config: SerialConfig) -> Self {
        match self.ports.get_mut(usize::from(port)) {
            Some(slot) => *slot = Some(config),
            None => self.port_beyond = Some(port),
        }
        self
    }

    /// How the encoders are set up.
    #[must_use]
    pub fn encoders(mut self, setup: EncoderSetup) -> Self {
        self.encoders = setup;
        self
    }

    /// The PWM frequency of all generators in Hz. At first what the board is made for: on a 7I97
    /// 48 kHz, or 96 kHz with dither where the firmware has it; else 20 kHz.
    #[must_use]
    pub fn pwm_frequency(mut self, hz: u32) -> Self {
        self.pwm_hz = Some(hz);
        self
    }

    /// How I/O pin `pin` begins, which must be one that no module uses. The others are inputs.
    #[must_use]
    pub fn gpio(mut self, pin: u16, config: GpioConfig) -> Self {
        self.gpio.push((pin, config));
        self
    }

    /// Leaves the phase-locked loop alone: for a period that it can not follow.
    #[must_use]
    pub fn without_dpll(mut self) -> Self {
        self.no_dpll = true;
        self
    }

    /// When remotes go offline, and how they come back.
    #[must_use]
    pub fn fault_policy(mut self, policy: FaultPolicy) -> Self {
        self.policy = policy;
        self
    }

    /// The `limit`-th read or write in a row that fails makes everything safe; 5 at first.
    ///
    /// Fewer in a row do it, too, when others failed shortly before: failures are counted as
    /// LinuxCNC counts them, see
    /// [`packet_error_level`](super::ConnectionPins::packet_error_level). A failure adds
    /// `packet-error-increment` (2), a read that succeeds takes `packet-error-decrement` (1) off, and
    /// `packet-error-limit` is set to `limit` increments: 10.
    #[must_use]
    pub fn bus_error_limit(mut self, limit: u32) -> Self {
        self.bus_error_limit = limit.max(1);
        self
    }

    /// The time after which the board's watchdog bites.
    pub(crate) fn watchdog_time(&self) -> Duration {
        let follows = self.period.saturating_mul(5);
        let usual = WatchdogRegisters::DEFAULT_TIMEOUT;
        self.watchdog.unwrap_or(follows.max(usual))
    }

    /// Refuses times that do not fit each other, and completes what follows the period.
    pub(super) fn checked<E: BusError>(mut self) -> Result<Self, StartError<E>> {
        let period = self.period;
        if !(Duration::from_micros(1)..=Duration::from_millis(800)).contains(&period) {
            return Err(StartError::BadPeriod { period });
        }
        let (watchdog, needed) = (self.watchdog_time(), period * WATCHDOG_FEEDS);
        if watchdog < needed {
            return Err(StartError::WatchdogTooShort {
                watchdog,
                needed,
                period,
            });
        }
        let rest = self.policy.rest.max(FaultPolicy::SHORTEST_REST);
        self.policy.rest = rest.max(period * 3 / 4);
        Ok(self)
    }
}

/// How often a watchdog must be fed within its time: a write, or a transfer, may be lost.
pub(super) const WATCHDOG_FEEDS: u32 = 2;
