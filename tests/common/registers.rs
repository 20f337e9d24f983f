//! Registers in memory, with the descriptors of FACTS 9.2 and 9.3.

use std::collections::BTreeMap;

use super::bus::{FakeBus, Registers};

/// Words in memory: what is written is read back. Registers that were never set read 0.
#[derive(Clone, Debug, Default)]
pub struct Memory {
    words: BTreeMap<u16, u32>,
    /// Every write, in order.
    pub writes: Vec<(u16, u32)>,
}

pub type MapBus = FakeBus<Memory>;

impl Memory {
    pub fn set(&mut self, address: u16, value: u32) {
        self.words.insert(address, value);
    }

    pub fn get(&self, address: u16) -> u32 {
        self.words.get(&address).copied().unwrap_or(0)
    }
}

impl Registers for Memory {
    fn read(&mut self, address: u16, _: u64) -> u32 {
        self.get(address)
    }

    fn write(&mut self, address: u16, word: u32, _: u64) {
        self.set(address, word);
        self.writes.push((address, word));
    }
}

/// gtag, version, clock, instances, base, registers, strides, mask.
type Module = (u8, u8, u8, u8, u16, u8, u8, u32);

fn firmware(
    name: [[u8; 4]; 2],
    ports: u32,
    modules: &[Module],
    pins: impl IntoIterator<Item = u32>,
) -> MapBus {
    let mut bus = MapBus::default();
    bus.set(0x0100, 0x55AA_CAFE);
    bus.set(0x0104, u32::from_le_bytes(*b"HOST"));
    bus.set(0x0108, u32::from_le_bytes(*b"MOT2"));
    bus.set(0x010C, 0x0400);
    let [name_low, name_high] = name.map(u32::from_le_bytes);
    let header = [
        3,
        0x40,
        0x200,
        name_low,
        name_high,
        9,
        144,
        ports,
        17 * ports,
        17,
        100_000_000,
        200_000_000,
        4,
        0x40,
        0x100,
        0x100,
    ];
    for (address, word) in (0x0400..).step_by(4).zip(header) {
        bus.set(address, word);
    }
    let words = modules.iter().flat_map(
        |&(gtag, version, clock, instances, base, registers, strides, mask)| {
            let [low, high] = base.to_le_bytes();
            [
                u32::from_le_bytes([gtag, version, clock, instances]),
                u32::from_le_bytes([low, high, registers, strides]),
                mask,
            ]
        },
    );
    for (address, word) in (0x0440..).step_by(4).zip(words) {
        bus.set(address, word);
    }
    for (address, word) in (0x0600..).step_by(4).zip(pins) {
        bus.set(address, word);
    }
    bus
}

fn pin(secondary_pin: u8, gtag: u8, unit: u8) -> u32 {
    u32::from_le_bytes([secondary_pin, gtag, unit, 3])
}

/// FACTS 9.2.
pub fn i7i97() -> MapBus {
    let mut pins = Vec::new();
    pins.extend((0..4).map(|unit| pin(0x81, 0x06, unit)));
    for unit in [4, 5] {
        pins.extend([pin(0x81, 0x06, unit), pin(0x83, 0x06, unit)]);
    }
    pins.push(pin(0x83, 0x06, 0));
    for unit in 0..3 {
        pins.extend([1, 2, 3].map(|role| pin(role, 0x0C, unit)));
    }
    pins.push(pin(0x81, 0x0D, 0));
    pins.extend((0x81..=0x86).map(|output| pin(output, 0xC3, 0)));
    pins.push(pin(0xA0, 0xC3, 0));
    pins.extend((0x81..=0x84).map(|line| pin(line, 0x1E, 0)));
    pins.push(pin(0x01, 0x1E, 0));
    pins.extend([0x01, 0x81, 0x91].map(|line| pin(line, 0xC1, 0)));
    pins.resize(51, pin(0, 0, 0));
    firmware(
        [*b"MESA", *b"7I97"],
        3,
        &[
            (0x1A, 0, 1, 1, 0x7000, 7, 0, 0),
            (0x02, 0, 1, 1, 0x0C00, 3, 0, 0),
            (0x03, 0, 1, 3, 0x1000, 5, 0, 0x1F),
            (0x0C, 4, 1, 6, 0x3500, 5, 0, 3),
            (0x0D, 0, 1, 1, 0, 0, 0, 0),
            (0x06, 0, 2, 6, 0x4000, 5, 0, 3),
            (0x1E, 0, 1, 1, 0x8000, 5, 0, 0),
            (0xC3, 0, 1, 1, 0x7D00, 2, 0, 0),
            (0xC1, 0, 1, 1, 0x5A00, 6, 0x10, 0x3C),
            (0x80, 0, 1, 1, 0x0200, 1, 0, 0),
        ],
        pins,
    )
}

pub const I7I92_PINS: usize = 34;

/// FACTS 9.3 with the pins of FACTS 8.1 on the first connector.
pub fn i7i92_with_7i77() -> MapBus {
    let mut pins = vec![
        pin(0x93, 0xC1, 0),
        pin(0x83, 0xC1, 0),
        pin(0x03, 0xC1, 0),
        pin(0x82, 0xC1, 0),
        pin(0x02, 0xC1, 0),
        pin(0x81, 0xC1, 0),
        pin(0x01, 0xC1, 0),
        pin(0x81, 0x0D, 0),
    ];
    for unit in 0..3 {
        pins.extend([1, 2, 3].map(|role| pin(role, 0x0C, unit)));
    }
    pins.resize(I7I92_PINS, pin(0, 0, 0));
    firmware(
        [*b"MESA", *b"7I92"],
        2,
        &[
            (0x02, 0, 1, 1, 0x0C00, 3, 0, 0),
            (0x03, 0, 1, 2, 0x1000, 5, 0, 0x1F),
            (0x0C, 3, 1, 6, 0x3500, 5, 0, 3),
            (0x0D, 0, 1, 1, 0, 0, 0, 0),
            (0xC1, 0, 1, 1, 0x5A00, 6, 0x10, 0x3C),
            (0x80, 0, 1, 1, 0x0200, 1, 0, 0),
        ],
        pins,
    )
}
