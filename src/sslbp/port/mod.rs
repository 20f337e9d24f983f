//! A port during initialisation: runs operations on its bus, with bounded waits.

mod access;
mod local;
mod run;
mod start;
mod stop;

pub use access::PortLink;

use super::{
    ChannelExchange, ChannelMask, DoitTime, PortError, PortLayout, PortMachine, PortParameters,
    PortState,
};
use crate::advice::{self, Advice};
use crate::bus::RegisterBus;
use alloc::format;
use alloc::string::String;

/// The result of an operation on a port over the bus `B`.
pub(crate) type PortResult<T> = Result<T, PortError>;

/// The assumed clock of a processor whose parameters have not been read, in hertz.
const USUAL_CLOCK: u32 = 100_000_000;

/// An SSLBP port.
#[derive(Clone, Debug)]
pub struct Port {
    layout: PortLayout,
    parameters: Option<PortParameters>,
    /// Its state machine; the cycle steps it without a [`SetupPort`].
    pub machine: PortMachine,
}

impl Port {
    /// A port at `layout`, in an unknown state.
    pub fn new(layout: PortLayout) -> Self {
        Self {
            layout,
            parameters: None,
            machine: PortMachine::new(layout.mask()),
        }
    }

    /// Register addresses of the port.
    pub const fn layout(&self) -> &PortLayout {
        &self.layout
    }

    /// State of its channels.
    pub const fn state(&self) -> PortState {
        self.machine.state
    }

    /// The running channels.
    pub const fn running(&self) -> ChannelMask {
        self.machine.running
    }

    /// Access to the port through its bus.
    pub const fn on<'a, B>(&'a mut self, bus: &'a mut B) -> SetupPort<'a, B> {
        SetupPort { port: self, bus }
    }

    /// Duration of a transfer of these channels, with the sizes that START returned. A clock of 100
    /// MHz is assumed until the parameters have been read.
    pub(crate) fn doit_time(&self, mask: ChannelMask) -> DoitTime {
        let clock_hz = self.parameters.map_or(USUAL_CLOCK, |known| known.clock_hz);
        let exchange = |channel| ChannelExchange::usual(channel, self.machine.link(channel).sizes);
        DoitTime::expected(self.layout.channels, clock_hz, mask.iter().map(exchange))
    }
}

/// A port on its bus, outside the cycle.
///
/// The usual order: [`reset`](Self::reset) (or [`identify`](Self::identify) and
/// [`stop_all`](Self::stop_all)), [`start`](Self::start), then [`access`](Self::access) in setup
/// mode; in normal mode the cycle steps [`Port::machine`].
///
/// # Real time
/// Not for the cycle: every operation waits for the hardware, within bounds.
#[derive(Debug)]
pub struct SetupPort<'a, B> {
    /// The port.
    pub port: &'a mut Port,
    /// Its bus.
    pub bus: &'a mut B,
}

impl<B: RegisterBus> SetupPort<'_, B> {
    pub(crate) fn known_parameters(&self) -> PortResult<PortParameters> {
        let needed = "its parameters";
        let known = self.port.parameters;
        known.ok_or_else(|| self.wrong_state(needed.into(), Some(advice::IDENTIFY_PORT)))
    }

    fn require_existing(&self, mask: ChannelMask) -> PortResult<()> {
        let missing = mask.difference(self.port.layout.mask());
        if missing.is_empty() {
            return Ok(());
        }
        let last = self.port.layout.channels - 1;
        let (found, expected) = (format!("{missing}"), format!("0 to {last}"));
        Err(self.unexpected(
            "the requested channel".into(),
            found,
            expected,
            Some(advice::LEAVE_CHANNEL_OUT),
        ))
    }

    fn wrong_state(&self, needed: String, advice: Option<Advice>) -> PortError {
        PortError::WrongState {
            port: self.port.layout.instance,
            needed,
            state: self.port.state(),
            running: self.port.running(),
            advice,
        }
    }

    fn not_kept(&self, what: String, read: u64, written: u64, advice: Advice) -> PortError {
        let expected = format!("{written:#04X}, which was written");
        self.unexpected(what, format!("{read:#04X}"), expected, Some(advice))
    }

    fn unexpected(
        &self,
        what: String,
        found: String,
        expected: String,
        advice: Option<Advice>,
    ) -> PortError {
        PortError::Unexpected {
            port: self.port.layout.instance,
            what: what.into(),
            found,
            expected,
            advice,
        }
    }
}
