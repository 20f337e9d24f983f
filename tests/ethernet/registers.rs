//! Direct access to registers of every space.

use crate::common::chance::Chance;
use crate::common::ethernet::{SimLink, WIRE, connect};
use mesa_hal::bus::RegisterBus;
use mesa_hal::ethernet::{EthernetBoard, EthernetError};
use mesa_hal::lbp16::Space;
use mesa_hal::{MesaError, advice};
use mesa_hal_sim::machines;

#[test]
fn registers_of_every_space_are_read_as_what_they_are() {
    let mut bus = connect(SimLink::new(machines::i7i97(1)));
    let mut board = EthernetBoard::new(&mut bus);
    // The cookie of HostMot2 and the name of its configuration.
    let words = board.peek(Space::HostMot2, 0x0100, 3).expect("registers");
    assert_eq!(words, [0x55AA_CAFE, 0x5453_4F48, 0x3254_4F4D]);
    // The chip id of a KSZ8851, which the manual's info areas name.
    let id = board.peek(Space::EthernetChip, 0xC0, 1).expect("the id");
    assert_eq!(id[0] >> 8, 0x88);
    let identity = board.identity().expect("identity");
    let words = board.peek(Space::Eeprom, 0x20, 2).expect("the address");
    assert_eq!(words[1] << 16 | words[0], identity.eeprom_ip.to_bits());
    assert_eq!(board.peek(Space::Flash, 0x08, 1), Ok(vec![0x14]));
    assert_eq!(board.peek(Space::ReadOnly, 0x12, 1), Ok(vec![16]));
    let all = board.peek(Space::HostMot2, 0, 16384).expect("all of them");
    assert_eq!((all.len(), all[64]), (16384, 0x55AA_CAFE));
}

#[test]
fn invalid_registers_are_refused_with_reason_and_no_change() {
    let mut bus = connect(SimLink::new(machines::i7i97(1)));
    let mut board = EthernetBoard::new(&mut bus);
    let eeprom = board.peek(Space::Eeprom, 0, 0x40).expect("the EEPROM");
    let reads = [
        (Space::HostMot2, 0x102, 1, "multiples of 4"),
        (Space::Timer, 1, 1, "multiples of 2"),
        (Space::Timer, 0, 0, "one register is the least"),
        (Space::Control, 0xFFFE, 2, "ends at 0x10000"),
        (Space::Eeprom, 0x200, 1, "counts an error"),
        (Space::Unused, 0, 1, "counts an error"),
    ];
    let writes = [
        (Space::ReadOnly, 0x12, "cannot be written"),
        (Space::Eeprom, 0x1E, "from 0x20 on"),
        (Space::Flash, 0x0C, "its own commands"),
        (Space::Timer, 0x10, "numbers its packets there"),
    ];
    let read = |(space, address, count, reason)| (board.peek(space, address, count), reason);
    let mut refused: Vec<_> = reads.map(read).into();
    refused.extend(writes.map(|(space, address, why)| (board.poke(space, address, &[1]), why)));
    for (result, reason) in refused {
        let error = result.expect_err(reason);
        let is_that = matches!(error, EthernetError::NoRegister { .. });
        let text = error.to_string();
        assert!(
            is_that && text.contains(reason) && error.advice() == Some(advice::SEE_BOARD_MANUAL),
            "{text}"
        );
    }
    assert!(board.poke(Space::HostMot2, 0x1000, &[0; 128]).is_err());
    assert_eq!(board.peek(Space::Eeprom, 0, 0x40), Ok(eeprom));
}

#[test]
fn written_registers_read_back_on_a_bad_network() {
    let mut link = SimLink::new(machines::i7i97(1));
    let lossy = |seed: u64| {
        let mut chance = Chance(seed);
        move |_: u64, _: &[u8]| if chance.one_in(4) { vec![] } else { vec![WIRE] }
    };
    link.to_board = Box::new(lossy(7));
    link.to_host = Box::new(lossy(8));
    let mut bus = connect(link);
    for value in 1..=50 {
        let mut board = EthernetBoard::new(&mut bus);
        let read = board.poke(Space::Control, 0x16, &[0x1_0008, value]);
        assert_eq!(read, Ok(vec![8, value]));
        let read = board.poke(Space::Eeprom, 0x40, &[value]);
        assert_eq!(read, Ok(vec![value]));
    }
    assert!(bus.statistics().lost > 10, "{:?}", bus.statistics());
}
