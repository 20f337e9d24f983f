//! Smart serial: the SSLBP ports, their pins and the remotes plugged into them.

use mesa_wire::bus::Direction;

use super::{Configuration, RegisterAddress, Settles, SimIoPorts, SimModule};
use crate::fpga::{Fabric, OUTPUT_PIN, gtag};
use crate::sslbp::{InterfaceRegisters, Lines, PortConfig, Register, SslbpPort};
use crate::wire::{Burst, Nanos, RemoteEnd};

/// Maximum number of channels of a port.
const CHANNELS: usize = 8;
/// Maximum number of ports of a module.
const MAX_PORTS: u8 = 4;

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

/// All ports of a module. An instance in its registers' addresses is a channel of a port.
#[derive(Debug)]
pub(super) struct SerialModule {
    ports: Vec<SmartSerial>,
}

impl SerialModule {
    pub(super) fn new(configuration: &Configuration<'_>) -> Self {
        let ports = 0..configuration.module.instances.min(MAX_PORTS);
        let ports = ports.map(|port| SmartSerial::new(configuration, port));
        Self {
            ports: ports.collect(),
        }
    }

    /// The port of an instance, and its register.
    fn locate(&mut self, register: u8, instance: u8) -> Option<(&mut SmartSerial, Register)> {
        let channel = instance % CHANNELS as u8;
        let port = self.ports.get_mut(usize::from(instance) / CHANNELS)?;
        let register = match register {
            COMMAND => Register::Command,
            DATA => Register::Data,
            CS => Register::Cs(channel),
            interface => Register::Interface(channel, interface - CS - 1),
        };
        Some((port, register))
    }
}

impl SimModule for SerialModule {
    fn read(&mut self, fabric: &Fabric, register: u8, instance: u8) -> u32 {
        let found = self.locate(register, instance);
        found.map_or(0, |(port, register)| port.port.read(fabric.now(), register))
    }

    fn write(&mut self, fabric: &mut Fabric, register: u8, instance: u8, value: u32) {
        if let Some((port, register)) = self.locate(register, instance) {
            port.port.write(fabric.now(), register, value);
        }
    }

    /// The firmware of the ports starts from the beginning when the configuration is complete.
    /// Remotes stay plugged in.
    fn reload(&mut self, configuration: &Configuration<'_>) {
        let Configuration { now, complete, .. } = *configuration;
        for port in &mut self.ports {
            port.port = SslbpPort::configured_at(*port.config(), now, complete);
            port.touched = true;
        }
    }

    /// COMMAND and DATA exist once for each port, the others once for each of eight channels.
    fn addresses(&self, configuration: &Configuration<'_>) -> Vec<RegisterAddress> {
        let module = configuration.module;
        let mut each_port = *module;
        each_port.multiple = u32::MAX;
        let of_ports = Configuration {
            module: &each_port,
            ..*configuration
        };
        let of_ports = of_ports.addresses(module.registers).into_iter();
        let of_channels = of_ports.flat_map(|of_port| {
            let is_multiple = module.multiple >> of_port.register & 1 != 0;
            let channels = if is_multiple { CHANNELS as u8 } else { 1 };
            (0..channels).map(move |channel| RegisterAddress {
                address: of_port.address.wrapping_add(4 * u16::from(channel)),
                instance: of_port.instance.saturating_mul(CHANNELS as u8) | channel,
                ..of_port
            })
        });
        of_channels.collect()
    }

    fn settles(&self, _: Direction) -> Settles {
        Settles::Nothing
    }

    fn pins_changed(&mut self, _: Nanos, io: &SimIoPorts) {
        for port in &mut self.ports {
            port.pins_changed(io);
        }
    }

    fn ports(&self) -> &[SmartSerial] {
        &self.ports
    }

    fn ports_mut(&mut self) -> &mut [SmartSerial] {
        &mut self.ports
    }
}

/// An SSLBP port with its lines and remotes.
#[derive(Debug)]
pub struct SmartSerial {
    port: SslbpPort,
    pins: [ChannelPins; CHANNELS],
    /// Channels that the set-up of the pins lets transmit and receive, one bit each.
    transmits: u8,
    receives: u8,
    sockets: [Option<Box<dyn RemoteEnd>>; CHANNELS],
    /// Time of the next spontaneous event of a remote.
    remotes_due: Option<Nanos>,
    /// True if a remote may have changed since the last visit.
    touched: bool,
}

impl SmartSerial {
    /// Instance `instance` of a module; the pin descriptors determine the number of channels.
    fn new(configuration: &Configuration<'_>, instance: u8) -> Self {
        let Configuration {
            firmware, module, ..
        } = *configuration;
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
            transmits: 0,
            receives: 0,
            sockets: [const { None }; CHANNELS],
            remotes_due: None,
            touched: false,
        }
    }

    /// The gateware's build options.
    pub fn config(&self) -> &PortConfig {
        self.port.config()
    }

    /// Takes a new set-up of the pins. A channel transmits only over a pin that is an output with
    /// alternate source, and only while its driver is enabled in the same way. A pin that the FPGA
    /// itself drives receives nothing.
    fn pins_changed(&mut self, io: &SimIoPorts) {
        (self.transmits, self.receives) = (0, 0);
        for (channel, pins) in self.pins.iter().enumerate() {
            let transmits = io.module_drives(pins.transmit)
                && (pins.enable.is_none() || io.module_drives(pins.enable));
            let receives = pins.receive.is_some_and(|pin| !io.is_output(pin));
            self.transmits |= u8::from(transmits) << channel;
            self.receives |= u8::from(receives) << channel;
        }
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
    /// earlier event may be due. `number` is the port's.
    pub(crate) fn visit_remotes(&mut self, now: Nanos, number: usize, fabric: &mut Fabric) {
        for (channel, socket) in self.sockets.iter_mut().enumerate() {
            if let Some(remote) = socket {
                remote.advance(now);
            }
            fabric.after_remote([number, channel], socket.as_deref());
        }
        self.port.skip_to(now);
        self.advance(now, number, fabric);
        self.touched = false;
        self.look_ahead();
        // A remote that is still due now is not visited again before another event.
        self.remotes_due = self.remotes_due.filter(|&due| due > now);
    }

    fn look_ahead(&mut self) {
        let remotes = self.sockets.iter().flatten();
        self.remotes_due = remotes.filter_map(|remote| remote.next_event()).min();
    }

    /// Advances to `to`, over the lines that the pins permit. `number` is the port's.
    pub(crate) fn advance(&mut self, to: Nanos, number: usize, fabric: &mut Fabric) {
        let mut lines = PinnedLines {
            number,
            transmits: self.transmits,
            receives: self.receives,
            sockets: &mut self.sockets,
            fabric,
            talked: false,
        };
        self.port.advance(to, &mut lines);
        if lines.talked {
            self.look_ahead();
        }
    }
}

/// The lines of a port with the current set-up of its pins.
struct PinnedLines<'a> {
    /// Number of the port.
    number: usize,
    transmits: u8,
    receives: u8,
    sockets: &'a mut [Option<Box<dyn RemoteEnd>>; CHANNELS],
    fabric: &'a mut Fabric,
    /// True if a transmission has reached a remote.
    talked: bool,
}

impl Lines for PinnedLines<'_> {
    fn transmit(&mut self, channel: usize, burst: &Burst) {
        if self.transmits >> channel & 1 == 0 {
            return;
        }
        if let Some(Some(remote)) = self.sockets.get_mut(channel) {
            let place = [self.number, channel];
            self.fabric
                .before_remote(place, burst.end(), remote.as_mut());
            remote.advance(burst.end());
            remote.receive(burst);
            self.fabric.after_remote(place, Some(remote.as_ref()));
            self.talked = true;
        }
    }

    fn receive(&mut self, channel: usize) -> Option<Burst> {
        let receives = self.receives >> channel & 1 != 0;
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
