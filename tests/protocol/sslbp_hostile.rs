//! The driver on a bus with arbitrary answers: every operation ends.

use crate::common::bus::{FakeBus, Registers};
use crate::common::chance::Chance;
use crate::common::replay::{MODULE, Replay};
use mesa_hal::discovery::{DiscoveryOptions, discover_port};
use mesa_hal::lbp::RemoteLink;
use mesa_hal::sslbp::{
    AccessSize, Channel, ChannelVariable, NonvolatileMemory, Port, PortLayout, PortLink,
    RemoteAccess, StartMode,
};
use proptest::prelude::*;

/// Registers that read values derived from a seed.
struct Hostile {
    chance: Chance,
    /// COMMAND reads 0 once in this number of reads.
    idle_every: u64,
}

impl Hostile {
    fn bus(seed: u64, idle_every: u64) -> FakeBus<Self> {
        let chance = Chance(seed);
        FakeBus::over(Self { chance, idle_every })
    }
}

impl Registers for Hostile {
    fn read(&mut self, address: u16, _: u64) -> u32 {
        let word = self.chance.word();
        let idle =
            address == MODULE.base && self.idle_every != 0 && self.chance.one_in(self.idle_every);
        // CS of a good channel, every other time, so that operations progress.
        let fine = address >> 8 == 0x5C && word & 1 == 0;
        match (idle, fine) {
            (true, _) => 0,
            (_, true) => [0x0000_C100, 0x0040_0000][(word >> 1 & 1) as usize],
            _ => word,
        }
    }

    fn write(&mut self, _: u16, _: u32, _: u64) {}
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn every_operation_ends_whatever_the_registers_read(
        seed: u64,
        idle_every in 0u64..4,
        is_stopped: bool,
        is_identified: bool,
    ) {
        let mut bus = Hostile::bus(seed, idle_every);
        bus.is_stopped = is_stopped;
        let bus = &mut bus;
        let mut port = Port::new(PortLayout::new(&MODULE, 0, 8).unwrap());
        let zero = Channel::ALL[0];
        let starts = Channel::ALL.map(|channel| (channel, 0));
        let _ = port.on(bus).reset();
        if is_identified {
            // After the reset, which forgets the identification: nothing starts without it.
            port.on(&mut Replay::new(Vec::new())).identify().unwrap();
        }
        let _ = port.on(bus).stop_all();
        let _ = port.on(bus).start(StartMode::Normal, &starts);
        let _ = port.on(bus).stop(zero.mask());
        let options = DiscoveryOptions { accesses: 64, ..DiscoveryOptions::default() };
        let _ = discover_port(&mut port, bus, &starts, &options);
        let _ = port.on(bus).access(zero, RemoteAccess::Read { address: 0x100, size: AccessSize::Double });
        let memory = NonvolatileMemory::Eeprom;
        let _ = PortLink { port: &mut port, bus, channel: zero }.access(Some(memory), RemoteAccess::Write { address: 0x24, size: AccessSize::Word, value: 50 });
        let _ = port.on(bus).set_baud_rate(zero, 115_200);
        let _ = port.on(bus).read_variable::<7>(zero, ChannelVariable::ErrorCounters);
        // 20,000 polls end each wait; there are at most some dozens of waits.
        prop_assert!(bus.exchanges < 2_000_000, "{} exchanges", bus.exchanges);
    }
}
