//! An Ethernet board apart from its registers: identity, EEPROM, flash memory, reset and reload.

use std::net::Ipv4Addr;
use std::time::Duration;

use crate::common::chance::Chance;
use crate::common::ethernet::{SimLink, WIRE, connect, cut};
use mesa_hal::Settings;
use mesa_hal::boards::FlashLayout;
use mesa_hal::boards::I7i97;
use mesa_hal::bus::{BusErrorKind, Clock, RegisterBus};
use mesa_hal::driver::Driver;
use mesa_hal::ethernet::{
    Area, Bitfile, EthernetBoard, EthernetError, Flash, FlashStep, LedMode, LedTime,
    MultibootFeature,
};
use mesa_hal::lbp16::{ErrorRegister, Space};
use mesa_hal::transport::udp::{UdpBus, UdpConfig};
use mesa_hal::{MesaError, advice};
use mesa_hal_sim::{BoardConfig, SimBoard, machines};

fn link() -> SimLink {
    SimLink::new(machines::i7i97(1))
}

type Bus = UdpBus<SimLink>;

fn bus() -> Bus {
    connect(link())
}

fn flash(bus: &mut Bus) -> Flash<EthernetBoard<'_, Bus>> {
    let board = EthernetBoard::new(bus);
    board.into_flash(FlashLayout::I7I97).expect("an M25P16")
}

/// A made-up configuration for the 7I97's FPGA.
fn configuration(len: usize) -> Vec<u8> {
    let mut data = vec![0xFF; 16];
    data.extend([0xAA, 0x99, 0x55, 0x66]);
    data.extend((data.len()..len).map(|n| (n * 31 + n / 256) as u8));
    data
}

fn bitfile(configuration: &[u8]) -> Bitfile<'_> {
    Bitfile {
        design: "made_up",
        part: FlashLayout::I7I97.part,
        date: "2026/01/01",
        time: "00:00:00",
        configuration,
    }
}

/// Flash memory with a boot block and a fallback, as delivered: without them nothing is written to
/// the user area.
fn as_it_comes(mut flash: Flash<EthernetBoard<'_, Bus>>) -> Flash<EthernetBoard<'_, Bus>> {
    flash.write_boot_block(|_, _| {}).expect("it is written");
    let start = flash.layout().addresses(Area::Fallback).start;
    flash
        .write(Area::Fallback, start, &configuration(300), |_, _| {})
        .expect("it is written when it is named");
    flash
}

#[test]
fn board_reports_its_identity() {
    let mut bus = bus();
    let mut board = EthernetBoard::new(&mut bus);
    let identity = board.identity().expect("identity");
    assert_eq!(identity.card, "7I97");
    assert_eq!(identity.firmware_version, 16);
    assert_eq!(identity.mac.to_string(), "00:60:1b:1b:00:97");
    assert_eq!(identity.eeprom_ip, Ipv4Addr::new(10, 10, 10, 10));
    let netmask = Ipv4Addr::new(255, 255, 255, 0);
    assert_eq!(identity.eeprom_netmask, Some(netmask));
    for space in (0..8).map(Space::from_bits) {
        let info = board.space_info(space);
        assert_eq!(info.is_ok(), space != Space::Unused, "{space:?}: {info:?}");
    }
}

#[test]
fn addresses_in_the_eeprom_are_written_and_read_back() {
    let mut bus = bus();
    let mut board = EthernetBoard::new(&mut bus);
    let address = Ipv4Addr::new(192, 168, 7, 97);
    let netmask = Ipv4Addr::new(255, 255, 0, 0);
    board
        .set_eeprom_ip(address)
        .expect("the address is written");
    board.set_eeprom_netmask(netmask).expect("the netmask too");
    let identity = board.identity().expect("identity");
    assert_eq!(identity.eeprom_ip, address);
    assert_eq!(identity.eeprom_netmask, Some(netmask));
}

/// The visible LEDs while the driver sets one after the other: CR01 first.
fn running_light(driver: &mut Driver<Bus>) -> Vec<[bool; 4]> {
    let card: I7i97 = driver.attach_board().expect("a 7I97");
    let mut seen = Vec::new();
    for n in 0..4 {
        for (k, &led) in card.leds.iter().enumerate() {
            driver.pins_mut().set(led, k == n);
        }
        let _ = driver.read().expect("the board answers");
        driver.write().expect("the board takes it");
        driver.bus_mut().wait(Duration::from_millis(1));
        seen.push(driver.bus_mut().link().board.lit_leds());
    }
    seen
}

#[test]
fn led_pins_show_on_the_leds_once_these_are_given_to_the_fpga() {
    let mut driver = Driver::start(bus(), Settings::default()).expect("a 7I97");
    let one_by_one: Vec<_> = (0..4).map(|n| [0, 1, 2, 3].map(|k| k == n)).collect();
    assert_ne!(running_light(&mut driver), one_by_one, "they count packets");
    for (mode, shows) in [(LedMode::HostMot2, true), (LedMode::Debug, false)] {
        let mut board = EthernetBoard::new(driver.bus_mut());
        let set = board.set_led_mode(LedTime::Now, mode);
        set.expect("the register");
        assert_eq!(board.led_mode(LedTime::Now), Ok(mode));
        let at_start = board.led_mode(LedTime::AtStart);
        assert_eq!(at_start, Ok(LedMode::Debug), "as it was");
        let seen = running_light(&mut driver);
        assert_eq!(seen == one_by_one, shows, "{mode:?}");
    }
}

#[test]
fn led_mode_of_the_eeprom_applies_after_a_restart() {
    let mut bus = bus();
    let mut board = EthernetBoard::new(&mut bus);
    assert_eq!(
        board.led_mode(LedTime::Now),
        Ok(LedMode::Debug),
        "as it comes"
    );
    for mode in [LedMode::HostMot2, LedMode::Debug] {
        let before = board.led_mode(LedTime::Now);
        let set = board.set_led_mode(LedTime::AtStart, mode);
        set.expect("the EEPROM");
        assert_eq!(board.led_mode(LedTime::AtStart), Ok(mode));
        assert_eq!(
            board.led_mode(LedTime::Now),
            before,
            "only from the next start on"
        );
        board.reset().expect("a restart");
        assert_eq!(board.led_mode(LedTime::Now), Ok(mode));
    }
}

#[test]
fn old_firmware_has_no_netmask_and_can_not_be_reloaded() {
    let mut config = BoardConfig::new("7I97");
    config.firmware_version = 14;
    let mut bus = connect(SimLink::to(SimBoard::new(config, machines::i7i97(1))));
    let mut board = EthernetBoard::new(&mut bus);
    assert_eq!(board.identity().expect("identity").eeprom_netmask, None);
    let error = board.set_eeprom_netmask(Ipv4Addr::BROADCAST);
    let needs = |needed| Err(EthernetError::Firmware { needed, found: 14 });
    assert_eq!(error, needs(16));
    let layout = FlashLayout::I7I97;
    assert_eq!(board.reload(layout.user.0, layout.fallback.0), needs(15));
}

#[test]
fn board_counts_what_it_could_not_do() {
    let mut bus = bus();
    let mut board = EthernetBoard::new(&mut bus);
    let before = board.counters().expect("counters");
    assert_eq!(before.errors, ErrorRegister::empty());
    // A command for no element, and a write to read-only space 7.
    let commands = [0x00, 0x42, 0x00, 0x01];
    mesa_hal::ethernet::Lbp16Board::send(&mut bus, &commands).expect("it is sent");
    let commands = [0x01, 0xDD, 0x10, 0x00, 0x34, 0x12];
    mesa_hal::ethernet::Lbp16Board::send(&mut bus, &commands).expect("it is sent");
    bus.wait(Duration::from_millis(1));
    let after = EthernetBoard::new(&mut bus).counters().expect("counters");
    assert!(after.errors.contains(ErrorRegister::PARSE), "{after:?}");
    assert_eq!(after.parse_errors, before.parse_errors + 1);
    assert_eq!(after.write_errors, before.write_errors + 1);
    assert_eq!(after.received_udp, before.received_udp + 3);
}

#[test]
fn errors_are_cleared_and_packets_go_on_being_counted() {
    let mut bus = bus();
    let commands = [0x01, 0xDD, 0x10, 0x00, 0x34, 0x12];
    mesa_hal::ethernet::Lbp16Board::send(&mut bus, &commands).expect("it is sent");
    bus.wait(Duration::from_millis(1));
    let mut board = EthernetBoard::new(&mut bus);
    let before = board.counters().expect("counters");
    assert_eq!(
        (before.errors, before.write_errors),
        (ErrorRegister::WRITE, 1)
    );
    board.clear_errors().expect("cleared");
    let after = board.counters().expect("counters");
    assert_eq!(after.errors, ErrorRegister::empty());
    let errors = [after.parse_errors, after.memory_errors, after.write_errors];
    assert_eq!(errors, [0; 3]);
    assert_eq!((after.received_bad, after.sent_bad), (0, 0));
    assert_eq!(after.received_udp, before.received_udp + 2);
    assert_eq!(bus.read(0x0100), Ok(0x55AA_CAFE));
}

#[test]
fn board_timestamps_show_packet_arrival_and_departure() {
    let mut bus = bus();
    let mut board = EthernetBoard::new(&mut bus);
    let first = board.timestamps().expect("timestamps");
    bus.wait(Duration::from_millis(10));
    let second = EthernetBoard::new(&mut bus)
        .timestamps()
        .expect("timestamps");
    let microseconds = second.receive_done.wrapping_sub(first.receive_done);
    assert!((10_000..10_200).contains(&microseconds), "{microseconds}");
    assert!(second.send_start.wrapping_sub(first.receive_done) < 100);
}

#[test]
fn configuration_is_programmed_and_verified_over_the_network() {
    let mut bus = bus();
    let mut flash = as_it_comes(flash(&mut bus));
    let data = configuration(200_001);
    let mut verified = 0;
    let progress = |stage, bytes| {
        if stage == FlashStep::Verify {
            verified = bytes;
        }
    };
    flash
        .program(&bitfile(&data), Area::User, progress)
        .expect("it is programmed");
    assert_eq!(verified, data.len());
    let other = configuration(200_000);
    flash
        .verify(&bitfile(&other), Area::User, |_, _| {})
        .expect("a prefix is the same");
    let mut changed = data.clone();
    changed[100_000] ^= 0x10;
    let error = flash
        .verify(&bitfile(&changed), Area::User, |_, _| {})
        .expect_err("it differs");
    let address = FlashLayout::I7I97.user.0 + 100_000;
    assert!(
        matches!(error, EthernetError::Differs { address: a, .. } if a == address),
        "{error}"
    );
    // A read need not begin or end on a register boundary.
    let mut bytes = [0; 7];
    flash
        .read(FlashLayout::I7I97.user.0 + 15, &mut bytes)
        .expect("it is read");
    assert_eq!(bytes[..], data[15..22]);
}

#[test]
fn flash_is_not_erased_without_a_boot_block() {
    let mut bus = bus();
    let mut flash = flash(&mut bus);
    let data = configuration(1000);
    let error = flash
        .program(&bitfile(&data), Area::User, |_, _| {})
        .expect_err("no boot block");
    assert!(
        matches!(error, EthernetError::NoBootBlock { address: 0 }),
        "{error}"
    );
}

#[test]
fn lost_packets_only_take_longer() {
    let seed = 0x97_u64;
    let lossy = |seed: u64| {
        let mut chance = Chance(seed);
        move |_: u64, _: &[u8]| {
            if chance.one_in(16) {
                vec![]
            } else {
                vec![WIRE]
            }
        }
    };
    let mut link = link();
    link.to_board = Box::new(lossy(seed));
    link.to_host = Box::new(lossy(seed + 1));
    let mut bus = connect(link);
    let mut flash = as_it_comes(flash(&mut bus));
    let data = configuration(70_000);
    flash
        .program(&bitfile(&data), Area::User, |_, _| {})
        .unwrap_or_else(|error| {
            panic!("seed {seed:#x}: {error}");
        });
    assert!(bus.statistics().lost > 10, "{:?}", bus.statistics());
}

#[test]
fn board_answers_again_after_reset_and_reload() {
    let mut bus = bus();
    let mut board = EthernetBoard::new(&mut bus);
    board.reset().expect("reset");
    board.identity().expect("it answers again");
    let layout = FlashLayout::I7I97;
    board
        .reload(layout.user.0, layout.fallback.0)
        .expect("reload");
    board.identity().expect("it answers again");
    assert_eq!(bus.link().board.restarts(), (1, 1));
    assert_eq!(bus.read(0x0100), Ok(0x55AA_CAFE));
}

#[test]
fn silent_board_is_reported_with_advice() {
    let mut link = link();
    link.to_board = cut();
    let error = UdpBus::new(link, UdpConfig::default()).expect_err("nobody answers");
    assert_eq!(error.kind(), BusErrorKind::Lost);
    assert_eq!(error.advice(), Some(advice::CHECK_BOARD));
}

#[test]
fn every_error_has_advice_apart_from_its_text() {
    use mesa_hal::ethernet::BitfileError::{self, *};
    type Ethernet = EthernetError;
    let (address, bytes, area) = (0x10_0000, 9, Area::User);
    let files: [BitfileError; 6] = [
        NoMark,
        Damaged {
            field: b'a',
            at: 13,
            what: "is cut off",
        },
        NoSync { searched: 9 },
        OtherBoard {
            found: "board on PCI".into(),
            expected: "7I97",
        },
        Multiboot {
            at: 22,
            what: MultibootFeature::Jump,
        },
        TooLarge { bytes, room: 8 },
    ];
    let ethernet: [Ethernet; 11] = [
        Ethernet::Bitfile(NoMark),
        Ethernet::Firmware {
            needed: 16,
            found: 14,
        },
        Ethernet::NotKept {
            space: Space::Eeprom,
            address: 0x20,
            expected: 1,
            found: 2,
        },
        Ethernet::WrongBoard {
            found: "a 7I92".into(),
            expected: "a 7I97".into(),
        },
        Ethernet::NoBootBlock { address },
        Ethernet::OtherBootBlock {
            address,
            expected: 1,
            found: 2,
        },
        Ethernet::NoFallback { address },
        Ethernet::NoUserConfiguration { address },
        Ethernet::NotForConfigurations { area },
        Ethernet::OutsideArea {
            address,
            bytes,
            area,
            expected: "0x100000 to 0x160000".into(),
        },
        Ethernet::Differs {
            address,
            expected: 1,
            found: 2,
        },
    ];
    let files = files
        .iter()
        .map(|error| (error.to_string(), error.advice()));
    let ethernet = ethernet.iter();
    let ethernet = ethernet.map(|error| (error.to_string(), error.advice()));
    for (text, advice) in files.chain(ethernet) {
        let advice = advice.expect(&text).to_string();
        assert!(
            advice.contains(' ') && !text.contains(&advice),
            "{text}; {advice}"
        );
    }
}

#[test]
fn board_7i92_has_its_layout_and_refuses_7i97_files_and_layouts() {
    let mut bus = connect(SimLink::new(machines::i7i92_7i77()));
    let error = EthernetBoard::new(&mut bus)
        .into_flash(FlashLayout::I7I97)
        .expect_err("another board");
    let text = "the board is a 7I92, the layout is that of a 7I97";
    assert_eq!(error.to_string(), text);
    assert_eq!(error.advice(), Some(advice::USE_LAYOUT_OF_BOARD));

    let mut board = EthernetBoard::new(&mut bus);
    let identity = board.identity().expect("identity");
    let layout = *FlashLayout::for_card(&identity.card).expect("a known board");
    let mut flash = as_it_comes(board.into_flash(layout).expect("16 Mbit"));
    let data = configuration(3000);
    let other = Bitfile {
        design: "seveni97.ncd",
        ..bitfile(&data)
    };
    let error = flash
        .program(&other, Area::User, |_, _| {})
        .expect_err("a file for a 7I97");
    let text = error.to_string();
    assert!(text.contains("for a 7i97, and this is a 7I92"), "{text}");
    flash
        .program(&bitfile(&data), Area::User, |_, _| {})
        .expect("it is programmed");
    let kept = bus.link().board.state();
    let mut places = kept.windows(data.len());
    assert!(places.any(|bytes| bytes == data), "it is in the chip");
}
