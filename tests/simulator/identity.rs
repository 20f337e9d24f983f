//! What the simulated FPGA says about itself, as the first thing a driver reads.

use mesa_hal::bus::RegisterBus;
use mesa_hal::sim::{SimFpga, gtag, machines};

fn descriptors(fpga: &mut SimFpga) -> Vec<[u32; 3]> {
    let words: Vec<u32> = (0..96).map(|n| fpga.read_register(0x440 + 4 * n)).collect();
    let rows = words.chunks(3).map(|row| [row[0], row[1], row[2]]);
    rows.take_while(|row| row[0] & 0xFF != 0).collect()
}

#[test]
fn cookie_name_and_idrom_stand_where_facts_9_1_says() {
    let mut fpga = machines::i7i92_7i77();
    let words: Vec<u32> = [0x100, 0x104, 0x108, 0x10C]
        .map(|address| fpga.read_register(address))
        .to_vec();
    assert_eq!(words, [0x55AA_CAFE, 0x5453_4F48, 0x3254_4F4D, 0x400]);
    let idrom: Vec<u32> = (0..16).map(|n| fpga.read_register(0x400 + 4 * n)).collect();
    assert_eq!(
        idrom,
        [
            3,
            0x40,
            0x200,
            0x4153_454D,
            0x3239_4937,
            9,
            144,
            2,
            34,
            17,
            100_000_000,
            200_000_000,
            4,
            0x40,
            0x100,
            0x100
        ]
    );
}

#[test]
fn the_7i97_has_the_modules_and_pins_of_facts_9_2() {
    let mut fpga = machines::i7i97(1);
    let expected = [
        [0x0101_001A, 0x0007_7000, 0x00],
        [0x0101_0002, 0x0003_0C00, 0x00],
        [0x0301_0003, 0x0005_1000, 0x1F],
        [0x0601_040C, 0x0005_3500, 0x03],
        [0x0101_000D, 0x0000_0000, 0x00],
        [0x0602_0006, 0x0005_4000, 0x03],
        [0x0101_001E, 0x0005_8000, 0x00],
        [0x0101_00C3, 0x0002_7D00, 0x00],
        [0x0101_00C1, 0x1006_5A00, 0x3C],
        [0x0101_0080, 0x0001_0200, 0x00],
    ];
    assert_eq!(descriptors(&mut fpga), expected);
    let pin = |fpga: &mut SimFpga, n: u16| fpga.read_register(0x600 + 4 * n);
    assert_eq!(pin(&mut fpga, 0), 0x0300_0681);
    assert_eq!(pin(&mut fpga, 7), 0x0305_0683);
    assert_eq!(pin(&mut fpga, 17), 0x0302_0C03);
    assert_eq!(pin(&mut fpga, 25), 0x0300_C3A0);
    assert_eq!(pin(&mut fpga, 31), 0x0300_C101);
    assert_eq!(pin(&mut fpga, 50), 0x0300_0000);
    assert_eq!(pin(&mut fpga, 51), 0);
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
