//! One DOIT of process data, with the machine of a port stepped as in the cycle.

use mesa_hal::bus::{Access, Clock, RegisterBus};
use mesa_hal::sslbp::{
    Channel, ChannelMask, CsStatus, MAX_INTERFACE_REGISTERS, PerChannel, Port, PortEvent,
    PortImage, PortLayout, PortOperation, StartFailure, StartedRemote, TransferResult,
};
use std::time::Duration;

/// The interface registers of each channel; those that the layout does not have are unused.
pub type PortWords = PerChannel<[u32; MAX_INTERFACE_REGISTERS as usize]>;

/// Output process data: the first words of these channels.
pub fn port_words<const N: usize>(words: [(Channel, &[u32]); N]) -> PortWords {
    let mut all = PortWords::default();
    for (channel, words) in words {
        all[channel][..words.len()].copy_from_slice(words);
    }
    all
}

/// All registers of a port, read in one exchange.
#[derive(Default)]
pub struct Registers {
    command: u32,
    data: u32,
    cs: PerChannel<u32>,
    interface: PortWords,
}

impl Registers {
    pub fn read<B: RegisterBus>(bus: &mut B, layout: PortLayout) -> Self {
        let mut addresses = vec![layout.command, layout.data()];
        for channel in layout.mask().iter() {
            addresses.push(layout.cs(channel).unwrap());
            addresses.extend(layout.interfaces(channel));
        }
        let accesses: Vec<_> = (0..)
            .zip(&addresses)
            .map(|(n, &address)| Access::read(address, n, 1))
            .collect();
        let mut words = vec![0; addresses.len()];
        bus.exchange(&accesses, &mut words).unwrap();
        let mut registers = Self {
            command: words[0],
            data: words[1],
            ..Self::default()
        };
        let interfaces = usize::from(layout.interface_registers);
        for (channel, words) in Channel::ALL
            .into_iter()
            .zip(words[2..].chunks(1 + interfaces))
        {
            registers.cs[channel] = words[0];
            registers.interface[channel][..interfaces].copy_from_slice(&words[1..]);
        }
        registers
    }
}

impl PortImage for Registers {
    fn command(&self) -> u32 {
        self.command
    }

    fn data(&self) -> u32 {
        self.data
    }

    fn cs(&self, channel: Channel) -> u32 {
        self.cs[channel]
    }

    fn interfaces(&self, channel: Channel) -> [u32; 3] {
        let [first, second, third, ..] = self.interface[channel];
        [first, second, third]
    }
}

/// The channels that a START has started.
pub fn started(outcomes: &[Result<StartedRemote, StartFailure>]) -> ChannelMask {
    let remotes = outcomes.iter().flatten();
    remotes.map(|remote| remote.channel).collect()
}

/// Result of a DOIT.
pub struct Transfer {
    /// The channels without a good reply: their words are the last good ones, not new.
    pub failed: ChannelMask,
    /// CS of each channel; a remote fault shows only here (FACTS 5.3).
    pub cs: PerChannel<CsStatus>,
    /// The input process data.
    pub inputs: PortWords,
}

/// Writes `outputs`, runs a DOIT of the channels of `mask`, and reads their inputs.
pub fn doit<B: RegisterBus + Clock>(
    port: &mut Port,
    bus: &mut B,
    mask: ChannelMask,
    outputs: &PortWords,
) -> Transfer {
    let layout = *port.layout();
    let machine = &mut port.machine;
    assert!(machine.is_idle());
    bus.wait(Duration::from_micros(1));
    for channel in mask.iter() {
        let count = machine.link(channel).sizes.tx.div_ceil(4);
        let addresses = layout.interfaces(channel).take(count.into());
        for (address, word) in addresses.zip(outputs[channel]) {
            bus.write(address, word).unwrap();
        }
    }
    let command = machine.begin(PortOperation::Transfer(mask));
    bus.write(layout.command, command).unwrap();
    machine.written(bus.now(), true);
    for _ in 0..100 {
        bus.wait(Duration::from_micros(50));
        let registers = Registers::read(bus, layout);
        if let PortEvent::Complete(_) = machine.observe(bus.now(), &registers, true) {
            let has_failed = |channel: &Channel| {
                matches!(machine.link(*channel).verdict, TransferResult::Failed(_))
            };
            return Transfer {
                failed: mask.iter().filter(has_failed).collect(),
                cs: PerChannel(registers.cs.0.map(CsStatus)),
                inputs: registers.interface,
            };
        }
    }
    panic!("{:?} is never complete", machine.in_flight());
}
