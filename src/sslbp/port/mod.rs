//! The handle of one port, for the time of initialisation: it waits, within bounds.

mod access;
mod local;
mod run;
mod start;
mod stop;
mod transfer;

pub use transfer::{PortWords, Transfer};

use super::{
    Channel, ChannelMask, ChannelRegisters, Layout, Machine, PortError, PortParameters, PortState,
};
use crate::bus::{BusError, RegisterBus};
use alloc::format;
use alloc::string::String;

/// The result of an operation on a port over the bus `B`.
pub type PortResult<T, B> = Result<T, PortError<<B as RegisterBus>::Error>>;

/// One SSLBP port.
///
/// The usual order: [`reset`](Self::reset) (or [`identify`](Self::identify) and
/// [`stop_all`](Self::stop_all)), [`start`](Self::start), then
/// [`transfer`](Self::transfer) in normal mode or [`access`](Self::access) in setup mode.
///
/// # Real time
/// Not for the cycle: every operation waits for the hardware, within bounds. The cycle steps a
/// [`Machine`].
#[derive(Clone, Debug)]
pub struct Port {
    layout: Layout,
    parameters: Option<PortParameters>,
    pub(crate) machine: Machine,
}

impl Port {
    /// A port at `layout`, in an unknown state.
    pub const fn new(layout: Layout) -> Self {
        Self {
            layout,
            parameters: None,
            machine: Machine::new(layout.mask()),
        }
    }

    /// Where its registers are.
    pub const fn layout(&self) -> &Layout {
        &self.layout
    }

    /// What its channels are in.
    pub const fn state(&self) -> PortState {
        self.machine.state
    }

    /// The channels that run.
    pub const fn running(&self) -> ChannelMask {
        self.machine.running
    }

    pub(crate) fn known_parameters<E: BusError>(&self) -> Result<PortParameters, PortError<E>> {
        let needed = "its parameters (call reset or identify first)";
        self.parameters
            .ok_or_else(|| self.wrong_state(needed.into()))
    }

    fn registers<E: BusError>(&self, channel: Channel) -> Result<ChannelRegisters, PortError<E>> {
        self.layout
            .channel(channel)
            .ok_or_else(|| self.no_such_channel(channel.mask()))
    }

    fn require_existing<E: BusError>(&self, mask: ChannelMask) -> Result<(), PortError<E>> {
        let missing = mask.difference(self.layout.mask());
        if missing.is_empty() {
            Ok(())
        } else {
            Err(self.no_such_channel(missing))
        }
    }

    const fn no_such_channel<E: BusError>(&self, missing: ChannelMask) -> PortError<E> {
        PortError::NoSuchChannel {
            port: self.layout.instance,
            missing,
            channels: self.layout.channels,
        }
    }

    /// `needed` names the mode.
    fn require_running<E: BusError>(
        &self,
        state: PortState,
        mask: ChannelMask,
    ) -> Result<(), PortError<E>> {
        self.require_existing(mask)?;
        let missing = mask.difference(self.running());
        if self.state() != state {
            Err(self.wrong_state(format!("a START that leaves it {state}")))
        } else if missing.is_empty() {
            Ok(())
        } else {
            Err(self.wrong_state(format!("a START that succeeded of channels {missing}")))
        }
    }

    fn wrong_state<E: BusError>(&self, needed: String) -> PortError<E> {
        PortError::WrongState {
            port: self.layout.instance,
            needed,
            state: self.state(),
            running: self.running(),
        }
    }
}
