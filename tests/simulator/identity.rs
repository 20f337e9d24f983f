//! The simulated FPGA's description of itself, which a driver reads first.

use mesa_hal::bus::RegisterBus;
use mesa_hal_sim::{SimFpga, gtag, machines};

fn descriptors(fpga: &mut SimFpga) -> Vec<[u32; 3]> {
    let words: Vec<u32> = (0..96).map(|n| fpga.read_register(0x440 + 4 * n)).collect();
    let rows = words.chunks(3).map(|row| [row[0], row[1], row[2]]);
    rows.take_while(|row| row[0] & 0xFF != 0).collect()
}

/// Words of the identification of a public firmware of Mesa's: header of the IDROM, module
/// descriptors up to the null one, entries behind that with their slots, pin descriptors.
struct Words<'a> {
    header: [u32; 16],
    modules: &'a [[u32; 3]],
    behind_end: &'a [(u16, [u32; 3])],
    pins: &'a [u32],
}

impl Words<'_> {
    /// All words from 0x0400 to 0x07FF: those that are not listed are 0.
    fn all(&self) -> Vec<u32> {
        let mut all = vec![0; 256];
        all[..16].copy_from_slice(&self.header);
        let modules = (0..).zip(self.modules.iter().copied());
        for (slot, words) in modules.chain(self.behind_end.iter().copied()) {
            let first = 16 + 3 * usize::from(slot);
            all[first..first + 3].copy_from_slice(&words);
        }
        all[0x70..0x70 + self.pins.len()].copy_from_slice(self.pins);
        all
    }
}

fn idrom(fpga: &mut SimFpga) -> Vec<u32> {
    (0..256)
        .map(|n| fpga.read_register(0x400 + 4 * n))
        .collect()
}

fn header(board: [u8; 4], [size, pins, ports, io]: [u32; 4]) -> [u32; 16] {
    let [mesa, board] = [*b"MESA", board].map(u32::from_le_bytes);
    let clocks = [100_000_000, 200_000_000];
    let strides = [4, 0x40, 0x100, 0x100];
    let mut words = [
        3, 0x40, 0x1C0, mesa, board, size, pins, ports, io, 17, 0, 0, 0, 0, 0, 0,
    ];
    words[10..12].copy_from_slice(&clocks);
    words[12..].copy_from_slice(&strides);
    words
}

/// 7I97D of Mesa's newer public sources. FACTS 9.2.
const MODULES_7I97: [[u32; 3]; 10] = [
    [0x0101_001A, 0x0007_7000, 0x00],
    [0x0101_0002, 0x0003_0C00, 0x00],
    [0x0301_0003, 0x0005_1000, 0x1F],
    [0x0601_040C, 0x0005_3600, 0x03],
    [0x0101_000D, 0x0000_0000, 0x00],
    [0x0101_00C1, 0x1006_5B00, 0x3C],
    [0x0602_0006, 0x0005_4100, 0x03],
    [0x0101_00C3, 0x0002_7D00, 0x03],
    [0x0101_001E, 0x0005_8000, 0x1F],
    [0x0101_0080, 0x0001_0200, 0x00],
];
const PINS_7I97: [u32; 53] = [
    0x0300_0681,
    0x0301_0681,
    0x0302_0681,
    0x0303_0681,
    0x0304_0681,
    0x0304_0683,
    0x0305_0681,
    0x0305_0683,
    0x0300_0683,
    0x0300_0C01,
    0x0300_0C02,
    0x0300_0C03,
    0x0301_0C01,
    0x0301_0C02,
    0x0301_0C03,
    0x0302_0C01,
    0x0302_0C02,
    0x0302_0C03,
    0x0300_0D81,
    0x0300_C381,
    0x0300_C382,
    0x0300_C383,
    0x0300_C384,
    0x0300_C385,
    0x0300_C386,
    0x0300_C3A0,
    0x0300_1E81,
    0x0300_1E82,
    0x0300_1E83,
    0x0300_1E84,
    0x0300_1E01,
    0x0300_C101,
    0x0300_C181,
    0x0300_C191,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x0300_0000,
    0x4000_C482,
    0x4000_C481,
];

/// 7I77x2 of the 7I92. FACTS 9.3.
const MODULES_7I77X2: [[u32; 3]; 6] = [
    [0x0101_0002, 0x0003_0C00, 0x00],
    [0x0201_0003, 0x0005_1000, 0x1F],
    [0x0C01_040C, 0x0005_3600, 0x03],
    [0x0101_000D, 0x0000_0000, 0x00],
    [0x0101_00C1, 0x1006_5B00, 0x3C],
    [0x0101_0080, 0x0001_0200, 0x00],
];
const PINS_7I77X2: [u32; 34] = [
    0x0300_C193,
    0x0300_C183,
    0x0300_C103,
    0x0300_C182,
    0x0300_C102,
    0x0300_C181,
    0x0300_C101,
    0x0300_0D81,
    0x0300_0C01,
    0x0300_0C02,
    0x0300_0C03,
    0x0301_0C01,
    0x0301_0C02,
    0x0301_0C03,
    0x0302_0C01,
    0x0302_0C02,
    0x0302_0C03,
    0x0300_C196,
    0x0300_C186,
    0x0300_C106,
    0x0300_C185,
    0x0300_C105,
    0x0300_C184,
    0x0300_C104,
    0x0306_0D81,
    0x0303_0C01,
    0x0303_0C02,
    0x0303_0C03,
    0x0304_0C01,
    0x0304_0C02,
    0x0304_0C03,
    0x0305_0C01,
    0x0305_0C02,
    0x0305_0C03,
];

/// The first modules of the 7I92's 7I77_7I74D, which has a DPLL, up to the mux select.
const MODULES_7I77_7I74D: [[u32; 3]; 5] = [
    [0x0101_001A, 0x0007_7000, 0x00],
    [0x0101_0002, 0x0003_0C00, 0x00],
    [0x0201_0003, 0x0005_1000, 0x1F],
    [0x0601_040C, 0x0005_3600, 0x03],
    [0x0101_000D, 0x0000_0000, 0x00],
];

/// The 7I80DB's 7I76x2_7I77x2 of 2016: multiplexed encoders (16 of them) and serial ports (two).
const ENCODERS_OF_2016: [u32; 3] = [0x1001_030C, 0x0005_3500, 0x03];
const SERIAL_OF_2016: [u32; 3] = [0x0201_00C1, 0x1006_5A00, 0x3C];

#[test]
fn cookie_and_name_are_at_the_addresses_of_facts_9_1() {
    let mut fpga = machines::i7i92_7i77();
    let words = [0x100, 0x104, 0x108, 0x10C].map(|address| fpga.read_register(address));
    assert_eq!(words, [0x55AA_CAFE, 0x5453_4F48, 0x3254_4F4D, 0x400]);
}

#[test]
fn simulated_7i97_is_laid_out_as_the_real_one() {
    let real = Words {
        header: header(*b"7I97", [9, 144, 3, 51]),
        modules: &MODULES_7I97,
        behind_end: &[
            (30, [0x0101_00C4, 0x0001_1E00, 0x01]),
            (31, [0x0000_001F, 0, 0x10]),
        ],
        pins: &PINS_7I97,
    };
    assert_eq!(idrom(&mut machines::i7i97(1)), real.all());
}

#[test]
fn simulated_7i92_for_two_7i77_is_laid_out_as_the_real_one() {
    let real = Words {
        header: header(*b"7I92", [9, 144, 2, 34]),
        modules: &MODULES_7I77X2,
        behind_end: &[],
        pins: &PINS_7I77X2,
    };
    let mut fpga = SimFpga::new(machines::firmware_7i92_7i77x2());
    assert_eq!(idrom(&mut fpga), real.all());
}

/// Its second connector is free: no public firmware is like that.
#[test]
fn firmware_7i92_for_one_7i77_has_dpll_and_empty_descriptor() {
    let mut fpga = machines::i7i92_7i77();
    let words = idrom(&mut fpga);
    assert_eq!(words[..16], header(*b"7I92", [9, 144, 2, 34]));
    let modules = descriptors(&mut fpga);
    assert_eq!(modules[..5], MODULES_7I77_7I74D);
    let [_, _, _, _, serial, led] = MODULES_7I77X2;
    let [_, _, _, _, _, _, mut pwm, ..] = MODULES_7I97;
    pwm[0] &= 0x00FF_FFFF;
    assert_eq!(modules[5..], [serial, pwm, led]);
    assert_eq!(words[0x70..0x70 + 17], PINS_7I77X2[..17]);
    assert_eq!(words[0x70 + 17..0x70 + 34], [0x0300_0000; 17]);
    assert_eq!(words[0x70 + 34..], [0; 144 - 34]);
    // PWM is absent.
    for address in [0x4100, 0x4200, 0x4300, 0x4500] {
        fpga.write_register(address, 1);
    }
    assert_eq!(fpga.counters().unknown_writes, 4);
}

#[test]
fn simulated_7i80_of_2016_has_the_addresses_of_that_time() {
    let mut fpga = machines::i7i80_of_2016();
    let words = idrom(&mut fpga);
    assert_eq!(words[..16], header(*b"7I80", [16, 256, 4, 68]));
    let modules = descriptors(&mut fpga);
    let of = |tag: u32| modules.iter().find(|words| words[0] & 0xFF == tag);
    let instances = |[what, place, mask]: [u32; 3], count: u32| {
        Some([what & 0x00FF_FFFF | count << 24, place, mask])
    };
    assert_eq!(of(0x0C).copied(), instances(ENCODERS_OF_2016, 6));
    assert_eq!(of(0xC1).copied(), instances(SERIAL_OF_2016, 1));
    assert_eq!(of(0x06).copied(), Some([0x0202_0006, 0x0005_4000, 0x03]));
    assert_eq!(of(0x1A), None);
    assert_eq!(words[0x70..0x70 + 17], PINS_7I77X2[..17]);
}

#[test]
fn channels_and_pin_descriptors_of_a_7i97_agree() {
    for channels in 1..=8 {
        let fpga = machines::i7i97(channels);
        assert_eq!(fpga.firmware().pins.len(), 51);
        let port = fpga.serial_port(0).expect("the port");
        assert_eq!(port.config().channels(), usize::from(channels));
        let highest = fpga.firmware().pins.iter();
        let highest = highest.filter(|pin| pin.secondary == gtag::SSERIAL);
        assert_eq!(highest.map(|pin| pin.pin & 0x0F).max(), Some(channels));
    }
}

#[test]
fn unknown_addresses_read_zero_and_are_counted() {
    let mut fpga = machines::i5i25_7i77();
    fpga.write(0x0000, 0x1234_5678).expect("tolerated");
    assert_eq!(fpga.read(0x0000).expect("tolerated"), 0);
    fpga.write(0x0100, 0).expect("tolerated");
    assert_eq!(fpga.read(0x0100).expect("cookie"), 0x55AA_CAFE);
    let counters = fpga.counters();
    assert_eq!((counters.unknown_reads, counters.unknown_writes), (1, 1));
    assert_eq!(counters.rom_writes, 1);
}

#[test]
fn every_address_can_be_read_and_written() {
    for firmware in [
        machines::firmware_7i97(8),
        machines::firmware_7i92_7i77x2(),
        machines::with_seven_interface_registers(machines::firmware_serial(&[8, 8, 8, 8])),
    ] {
        let mut fpga = SimFpga::new(firmware);
        for value in [u32::MAX, 0, 0x5555_5555] {
            for address in (0..=0xFFFC).step_by(4) {
                fpga.write_register(address, value);
                fpga.read_register(address);
            }
            let later = fpga.now() + 1_000_000;
            fpga.advance_to(later);
        }
    }
}
