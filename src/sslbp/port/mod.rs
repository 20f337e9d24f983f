//! The handle of one port, for the time of initialisation: it waits, within bounds.

mod access;
mod local;
mod run;
mod start;
mod stop;
mod transfer;

pub use start::ChannelStart;
pub use transfer::{ChannelWords, PortWords, Transfer};

use super::{
    Channel, ChannelMask, ChannelRegisters, Layout, Machine, Needed, PortError, PortParameters,
    PortState, Processor,
};
use crate::bus::{BusError, RegisterBus};

/// The result of an operation on a port over the bus `B`.
pub type PortResult<T, B> = Result<T, PortError<<B as RegisterBus>::Error>>;

/// One SSLBP port.
///
/// All operations wait within bounds and belong to initialisation; for the cycle take
/// [`Layout`], [`Command`](super::Command), [`CsStatus`](super::CsStatus) and
/// [`DoitTime`](super::DoitTime) alone.
///
/// The usual order: [`reset`](Self::reset) (or [`identify`](Self::identify) and
/// [`stop_all`](Self::stop_all)), [`start`](Self::start), then
/// [`transfer`](Self::transfer) in normal mode or [`remote_read`](Self::remote_read) and
/// [`remote_write`](Self::remote_write) in setup mode.
///
/// # Real time
/// Not for the cycle: every operation waits for the hardware.
#[derive(Clone, Debug)]
pub struct Port {
    layout: Layout,
    parameters: Option<PortParameters>,
    machine: Machine,
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

    /// What it runs its operations with.
    pub const fn machine(&self) -> &Machine {
        &self.machine
    }

    /// The machine, to step it in the cycle.
    pub(crate) const fn machine_mut(&mut self) -> &mut Machine {
        &mut self.machine
    }

    /// Its local parameters, once [`reset`](Self::reset) or [`identify`](Self::identify) has read
    /// them.
    pub const fn parameters(&self) -> Option<&PortParameters> {
        self.parameters.as_ref()
    }

    /// The processor that runs it, as far as it is known: with the recorded clock of 100 MHz before
    /// the parameters have been read.
    pub fn processor(&self) -> Processor {
        let usual = Processor::usual(self.layout.channels());
        let clock_hz = self.parameters.map(|parameters| parameters.clock_hz);
        Processor {
            clock_hz: clock_hz.unwrap_or(usual.clock_hz),
            ..usual
        }
    }

    /// What its channels are in.
    pub const fn state(&self) -> PortState {
        self.machine.state()
    }

    /// The channels that run.
    pub const fn running(&self) -> ChannelMask {
        self.machine.running()
    }

    fn known_parameters<E: BusError>(&self) -> Result<&PortParameters, PortError<E>> {
        let port = self.layout.instance();
        self.parameters
            .as_ref()
            .ok_or(PortError::NotIdentified { port })
    }

    fn registers<E: BusError>(&self, channel: Channel) -> Result<ChannelRegisters, PortError<E>> {
        self.layout
            .channel(channel)
            .ok_or(PortError::NoSuchChannel {
                port: self.layout.instance(),
                missing: channel.mask(),
                channels: self.layout.channels(),
            })
    }

    fn require_existing<E: BusError>(&self, mask: ChannelMask) -> Result<(), PortError<E>> {
        let missing = mask.difference(self.layout.mask());
        if missing.is_empty() {
            return Ok(());
        }
        Err(PortError::NoSuchChannel {
            port: self.layout.instance(),
            missing,
            channels: self.layout.channels(),
        })
    }

    fn require_running<E: BusError>(
        &self,
        state: PortState,
        mask: ChannelMask,
    ) -> Result<(), PortError<E>> {
        self.require_existing(mask)?;
        if self.state() != state {
            return Err(self.wrong_state(match state {
                PortState::Setup => Needed::Setup,
                PortState::Normal => Needed::Normal,
                PortState::Stopped | PortState::Unknown => Needed::Stopped,
            }));
        }
        let missing = mask.difference(self.running());
        if missing.is_empty() {
            Ok(())
        } else {
            Err(self.wrong_state(Needed::Started(missing)))
        }
    }

    fn wrong_state<E: BusError>(&self, needed: Needed) -> PortError<E> {
        PortError::WrongState {
            port: self.layout.instance(),
            needed,
            state: self.state(),
            running: self.running(),
        }
    }
}
