//! Smart serial: the SSLBP ports, their pins and the remotes plugged into them.

use super::SimIoPorts;
use crate::fpga::firmware::{OUTPUT_PIN, SimFirmware, SimModuleDescriptor, gtag};
use crate::sslbp::{InterfaceRegisters, Lines, PortConfig, Register, SslbpPort};
use crate::wire::{Burst, Nanos, RemoteEnd};

/// Maximum number of channels of a port.
pub(crate) const CHANNELS: usize = 8;

const COMMAND: u8 = 0;
const DATA: u8 = 1;
const CS: u8 = 2;

/// The I/O pins of one channel.
#[derive(Clone, Copy, Debug, Default)]
struct ChannelPins {
    receive: Option<usize>,
    transmit: Option<usize>,
    /// TXEN or /TXEN, if the firmware has one.
    enable: Option<usize>,
}

/// Observer of transmissions to remotes.
pub(crate) trait Watcher {
    /// Called before the remote of `channel` takes the transmission that ends at `now`.
    fn before(&mut self, channel: usize, now: Nanos, remote: &mut dyn RemoteEnd);
    /// Called after the remote has taken it, or when something else may have changed what is
    /// plugged into the channel.
    fn after(&mut self, channel: usize, remote: Option<&dyn RemoteEnd>);
}

/// An SSLBP port with its lines and remotes.
#[derive(Debug)]
pub struct SmartSerial {
    port: SslbpPort,
    pins: [ChannelPins; CHANNELS],
    sockets: [Option<Box<dyn RemoteEnd>>; CHANNELS],
    /// Time of the next spontaneous event of a remote.
    remotes_due: Option<Nanos>,
    /// True if a remote may have changed since the last visit.
    touched: bool,
}

impl SmartSerial {
    /// Instance `instance` of a module; the pin descriptors determine the number of channels.
    pub(crate) fn new(firmware: &SimFirmware, module: &SimModuleDescriptor, instance: u8) -> Self {
        let layout = if module.gtag == gtag::SSERIAL_B {
            InterfaceRegisters::Seven
        } else {
            InterfaceRegisters::Three
        };
        let channels = firmware
            .pins
            .iter()
            .filter(|pin| pin.secondary == module.gtag && pin.unit == instance)
            .map(|pin| pin.pin & 0x0F)
            .max()
            .unwrap_or(1);
        let config = PortConfig::new(channels, firmware.clock(module.clock))
            .with_interface_registers(layout)
            .with_minor_revision(firmware.sslbp_minor);
        let pins = core::array::from_fn(|channel| {
            let number = channel as u8 + 1;
            let pin = |kind: u8| firmware.pin(module.gtag, instance, kind | number);
            ChannelPins {
                receive: pin(0),
                transmit: pin(OUTPUT_PIN),
                enable: pin(OUTPUT_PIN | 0x10).or_else(|| pin(OUTPUT_PIN | 0x20)),
            }
        });
        Self {
            port: SslbpPort::new(config),
            pins,
            sockets: [const { None }; CHANNELS],
            remotes_due: None,
            touched: false,
        }
    }

    /// The gateware's build options.
    pub fn config(&self) -> &PortConfig {
        self.port.config()
    }

    /// Reloads the FPGA at `now`, with its configuration complete at `configured`: from then on the
    /// port's firmware starts from the beginning. Remotes stay plugged in.
    pub(crate) fn reload(&mut self, now: Nanos, configured: Nanos) {
        self.port = SslbpPort::configured_at(*self.port.config(), now, configured);
        self.touched = true;
    }

    /// Plugs a remote into a channel and returns the one that was there.
    pub fn plug(
        &mut self,
        channel: usize,
        remote: Option<Box<dyn RemoteEnd>>,
    ) -> Option<Box<dyn RemoteEnd>> {
        let socket = self.sockets.get_mut(channel)?;
        self.touched = true;
        core::mem::replace(socket, remote)
    }

    /// The remote plugged into a channel.
    pub fn remote(&self, channel: usize) -> Option<&dyn RemoteEnd> {
        self.sockets.get(channel)?.as_deref()
    }

    /// Mutable access to the remote plugged into a channel.
    pub fn remote_mut(&mut self, channel: usize) -> Option<&mut dyn RemoteEnd> {
        self.touched = true;
        match self.sockets.get_mut(channel)? {
            Some(remote) => Some(remote.as_mut()),
            None => None,
        }
    }

    pub(crate) fn read(&mut self, now: Nanos, register: u8, channel: u8) -> u32 {
        self.port.read(now, Self::register(register, channel))
    }

    pub(crate) fn write(&mut self, now: Nanos, register: u8, channel: u8, value: u32) {
        self.port
            .write(now, Self::register(register, channel), value);
    }

    pub(crate) fn next_event(&self) -> Option<Nanos> {
        self.port.next_event()
    }

    /// Time of the next event of a remote that needs no transmission to it.
    pub(crate) fn remotes_due(&self) -> Option<Nanos> {
        self.remotes_due
    }

    /// True if a remote may have changed since the last visit.
    pub(crate) fn is_touched(&self) -> bool {
        self.touched
    }

    /// Advances all remotes to `now`, and lets the port sample the levels of their lines. No
    /// earlier event may be due.
    pub(crate) fn visit_remotes(&mut self, now: Nanos, io: &SimIoPorts, watcher: &mut dyn Watcher) {
        for (channel, socket) in self.sockets.iter_mut().enumerate() {
            if let Some(remote) = socket {
                remote.advance(now);
            }
            watcher.after(channel, socket.as_deref());
        }
        self.port.skip_to(now);
        self.advance(now, io, watcher);
        self.touched = false;
        self.look_ahead();
        // A remote that is still due now is not visited again before another event.
        self.remotes_due = self.remotes_due.filter(|&due| due > now);
    }

    fn look_ahead(&mut self) {
        let remotes = self.sockets.iter().flatten();
        self.remotes_due = remotes.filter_map(|remote| remote.next_event()).min();
    }

    /// Advances to `to`, over the lines that the pins permit.
    pub(crate) fn advance(&mut self, to: Nanos, io: &SimIoPorts, watcher: &mut dyn Watcher) {
        let mut lines = PinnedLines {
            pins: &self.pins,
            sockets: &mut self.sockets,
            io,
            watcher,
            talked: false,
        };
        self.port.advance(to, &mut lines);
        if lines.talked {
            self.look_ahead();
        }
    }

    fn register(register: u8, channel: u8) -> Register {
        match register {
            COMMAND => Register::Command,
            DATA => Register::Data,
            CS => Register::Cs(channel),
            interface => Register::Interface(channel, interface - CS - 1),
        }
    }
}

/// The lines of a port with the current set-up of its pins.
struct PinnedLines<'a> {
    pins: &'a [ChannelPins; CHANNELS],
    sockets: &'a mut [Option<Box<dyn RemoteEnd>>; CHANNELS],
    io: &'a SimIoPorts,
    watcher: &'a mut dyn Watcher,
    /// True if a transmission has reached a remote.
    talked: bool,
}

impl PinnedLines<'_> {
    /// A channel transmits only over a pin that is an output with alternate source, and only while
    /// its driver is enabled in the same way.
    fn transmits(&self, channel: usize) -> bool {
        self.pins.get(channel).is_some_and(|pins| {
            self.io.module_drives(pins.transmit)
                && (pins.enable.is_none() || self.io.module_drives(pins.enable))
        })
    }

    /// A pin that the FPGA itself drives receives nothing.
    fn receives(&self, channel: usize) -> bool {
        let pin = self.pins.get(channel).and_then(|pins| pins.receive);
        pin.is_some_and(|pin| !self.io.is_output(pin))
    }
}

impl Lines for PinnedLines<'_> {
    fn transmit(&mut self, channel: usize, burst: &Burst) {
        if !self.transmits(channel) {
            return;
        }
        if let Some(Some(remote)) = self.sockets.get_mut(channel) {
            self.watcher.before(channel, burst.end(), remote.as_mut());
            remote.advance(burst.end());
            remote.receive(burst);
            self.watcher.after(channel, Some(remote.as_ref()));
            self.talked = true;
        }
    }

    fn receive(&mut self, channel: usize) -> Option<Burst> {
        let receives = self.receives(channel);
        let burst = self.sockets.get_mut(channel)?.as_mut()?.transmit()?;
        receives.then_some(burst)
    }

    fn held_low(&mut self, channel: usize, now: Nanos) -> bool {
        match self.sockets.get_mut(channel) {
            Some(Some(remote)) => {
                remote.advance(now);
                remote.holds_line_low()
            }
            _ => false,
        }
    }
}
