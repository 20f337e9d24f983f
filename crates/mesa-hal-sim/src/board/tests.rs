use proptest::prelude::*;

use super::*;
use mesa_wire::lbp16::{Command, RequestBuilder};

/// Registers that keep their words, and an edge of every timer each millisecond.
#[derive(Debug, Default)]
struct Registers {
    words: std::collections::BTreeMap<u16, u32>,
    now: Nanos,
    edges: bool,
    configured: u32,
}

impl Gateware for Registers {
    fn advance_to(&mut self, now: Nanos) {
        assert!(now >= self.now, "time never goes back");
        self.now = now;
    }

    fn read_register(&mut self, address: u16) -> u32 {
        assert!(address.is_multiple_of(4));
        match address {
            0x0100 => 0x55AA_CAFE,
            _ => self.words.get(&address).copied().unwrap_or(0),
        }
    }

    fn write_register(&mut self, address: u16, value: u32) {
        assert!(address.is_multiple_of(4));
        self.words.insert(address, value);
    }

    fn wait_for_timer(&mut self, _timer: u8, limit: Nanos) -> Option<Nanos> {
        let edge = (self.now / 1_000_000 + 1) * 1_000_000;
        (self.edges && edge <= limit).then_some(edge)
    }

    fn reconfigure(&mut self) {
        self.words.clear();
        self.configured += 1;
    }
}

fn board() -> SimBoard<Registers> {
    SimBoard::new(BoardConfig::new("7I97"), Registers::default())
}

fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<char> = text.chars().filter(|c| !c.is_whitespace()).collect();
    let byte = |pair: &[char]| u8::from_str_radix(&pair.iter().collect::<String>(), 16).unwrap();
    digits.chunks(2).map(byte).collect()
}

/// Sends a packet when the board is idle.
fn run(board: &mut SimBoard<Registers>, request: &[u8]) -> Vec<u8> {
    let mut reply = Vec::new();
    let now = board.time().max(board.silent_until) + 10_000;
    let sent = board.handle_packet(now, request, &mut reply);
    assert_eq!(sent.is_some(), !reply.is_empty());
    reply
}

fn word(board: &mut SimBoard<Registers>, space: Space, address: u16) -> u16 {
    let mut request = RequestBuilder::default();
    request.read(space, address, 1).unwrap();
    let reply = run(board, &request.bytes);
    u16::from_le_bytes([reply[0], reply[1]])
}

#[test]
fn sample_run_of_the_manual_works() {
    // Manual: 7I97, "ELBPCOM".
    let mut board = board();
    assert_eq!(run(&mut board, &hex("01420001")), hex("fecaaa55"));
    let set = hex("01D91A00025A 82C920000100a8C0");
    assert_eq!(run(&mut board, &set), [0_u8; 0]);
    assert_eq!(run(&mut board, &hex("82492000")), hex("0100a8c0"));
}

#[test]
fn ethernet_chip_returns_its_id() {
    // Manual: 7I97, "SPACE 1: ETHERNET CHIP ACCESS": 0145C000.
    let mut board = board();
    assert_eq!(run(&mut board, &hex("0145C000")), hex("7288"));
    assert_eq!(word(&mut board, Space::EthernetChip, 0x10), 0x0097);
}

#[test]
fn eeprom_writes_need_the_enable_in_the_same_packet() {
    let mut board = board();
    run(&mut board, &hex("01D91A00025A"));
    run(&mut board, &hex("82C920000100a8C0"));
    assert_eq!(run(&mut board, &hex("82492000")), hex("0a0a0a0a"));
    assert_eq!(board.status(0x06), 1, "one write error");
    assert_eq!(board.status(0x00), ErrorRegister::WRITE.bits());
    let wrong_space = hex("01D91A00035A 82C920000100a8C0");
    run(&mut board, &wrong_space);
    assert_eq!(run(&mut board, &hex("82492000")), hex("0a0a0a0a"));
    assert_eq!(board.status(0x06), 2);
}

#[test]
fn mac_and_card_name_can_not_be_written() {
    let mut board = board();
    run(&mut board, &hex("01D91A00025A 83C902000000 0000 0000"));
    assert_eq!(run(&mut board, &hex("83490200")), hex("9700 1b1b 6000"));
    assert_eq!(board.status(0x06), 1);
}

#[test]
fn page_of_flash_is_written_and_read_as_the_manual_does() {
    // Manual: 7I97, "SPACE 3: FPGA FLASH EEPROM CHIP ACCESS", with the enable and the data in the
    // packet after the address, and the commit in a third, as mesaflash does it (FACTS 10.2).
    let mut board = board();
    run(&mut board, &hex("01CE0000 00C00000"));
    let mut write = hex("01D91A00035A 40CE0400");
    write.extend((0..=255).map(|n: u8| n ^ 0x5A));
    run(&mut board, &write);
    assert_eq!(run(&mut board, &hex("014E0000")), hex("00C10000"));
    let read = run(&mut board, &hex("01CE0000 00C00000 404E0400"));
    let expected: Vec<_> = (0..=255).map(|n: u8| n ^ 0x5A).collect();
    assert_eq!(read, expected);
    let before = board.time();
    let erase = hex("01D91A00035A 01CE0000 00000000 01CE0C00 00000000 014E0000");
    assert_eq!(run(&mut board, &erase), hex("00000000"));
    assert!(
        board.time() - before > 500_000_000,
        "an erase takes its time"
    );
    let read = run(&mut board, &hex("01CE0000 00C00000 404E0400"));
    assert!(read.iter().all(|&byte| byte == 0xFF));
    assert_eq!(run(&mut board, &hex("014E0800")), hex("14000000"));
}

#[test]
fn flash_without_its_enable_stays() {
    let mut board = board();
    run(
        &mut board,
        &hex("01CE0000 00C00000 01CE0400 00000000 014E0000"),
    );
    run(&mut board, &hex("01D91A00025A 01CE0C00 00000000"));
    assert_eq!(board.status(0x06), 2);
    let read = run(&mut board, &hex("01CE0000 00C00000 014E0400"));
    assert_eq!(read, hex("ffffffff"));
}

#[test]
fn info_areas_describe_every_space() {
    let mut board = board();
    let mut names = Vec::new();
    for space in (0..8).map(Space::from_bits) {
        let mut request = RequestBuilder::default();
        let read = Command::read_info(space, 8);
        request.command(read, 0, &[]).unwrap();
        let reply = run(&mut board, &request.bytes);
        let mut words = [0; 8];
        for (word, pair) in words.iter_mut().zip(reply.chunks(2)) {
            *word = u16::from_le_bytes([pair[0], pair[1]]);
        }
        match InfoArea::parse(space, words) {
            Ok(area) => names.push(area.name().to_owned()),
            Err(_) => assert_eq!(space, Space::Unused),
        }
    }
    let expected = [
        "HostMot2", "KSZ8851R", "EtherEEP", "FPGAFlsh", "Timers", "LBP16RW", "LBP16RO",
    ];
    assert_eq!(names, expected);
    assert_eq!(board.status(0x04), 1, "the space that does not exist");
}

#[test]
fn info_area_shows_where_the_pointer_of_the_space_stands() {
    let mut board = board();
    run(&mut board, &hex("85420004"));
    assert_eq!(run(&mut board, &hex("01610600")), hex("1404"));
}

#[test]
fn errors_are_counted_by_kind_and_can_be_cleared() {
    let mut board = board();
    run(&mut board, &hex("0042"));
    run(&mut board, &hex("8102"));
    assert_eq!(
        board.status(0x02),
        1,
        "count 0; a command without address is none"
    );
    assert_eq!(
        run(&mut board, &hex("01410001")),
        hex("0000"),
        "16 bits of space 0"
    );
    assert_eq!(
        run(&mut board, &hex("01514000")),
        hex("0000"),
        "past the end"
    );
    assert_eq!(board.status(0x04), 2);
    run(&mut board, &hex("01DD0000 0000"));
    assert_eq!(board.status(0x06), 1, "space 7 is read only");
    assert_eq!(board.status(0x00), 0b111);
    run(&mut board, &hex("84D90000 0000 0000 0000 0000"));
    assert_eq!(
        run(&mut board, &hex("84590000")),
        hex("0000 0000 0000 0000")
    );
}

#[test]
fn commands_before_a_parse_error_are_executed() {
    let mut board = board();
    let request = hex("01C20010 78563412 01420010 0142");
    assert_eq!(run(&mut board, &request), hex("78563412"));
    assert_eq!(board.status(0x02), 1);
}

#[test]
fn bad_access_keeps_the_rest_of_the_reply_in_place() {
    let mut board = board();
    let request = hex("01420001 01570000 01420001");
    assert_eq!(
        run(&mut board, &request),
        hex("fecaaa55 0000000000000000 fecaaa55")
    );
}

#[test]
fn packets_are_counted_and_stamped() {
    let mut board = board();
    run(&mut board, &hex("01420001"));
    run(&mut board, &hex("01C20010 00000000"));
    let counters = run(&mut board, &hex("86590800"));
    assert_eq!(counters, hex("0300 0300 0000 0100 0100 0000"));
    let stamps: Vec<_> = [0x18, 0x1A, 0x1C, 0x1E]
        .map(|at| word(&mut board, Space::ReadOnly, at))
        .into();
    assert!(stamps[0] < stamps[1] && stamps[2] < stamps[3], "{stamps:?}");
}

#[test]
fn microsecond_timer_runs_and_waits_are_waited() {
    let mut board = board();
    // Time stamp, wait 500 us, time stamp; writing the time stamp has no effect.
    let request = hex("01510000 01D10000 0000 01D10200 F401 01510000 01510200");
    let reply = run(&mut board, &request);
    let stamp = |at: usize| u16::from_le_bytes([reply[at], reply[at + 1]]);
    assert_eq!(stamp(2).wrapping_sub(stamp(0)), 500);
    assert_eq!(stamp(4), 500, "reads return the last wait");
}

#[test]
fn waiting_for_a_timer_ends_at_its_edge_or_at_the_time_out() {
    let mut board = board();
    board.gateware_mut().edges = true;
    board.advance_to(5_400_000);
    // Time-out 2000 us; wait for timer 1.
    let reply = run(&mut board, &hex("01D10400 D007 01510800"));
    let waited = u16::from_le_bytes([reply[0], reply[1]]);
    assert!((565..=575).contains(&waited), "{waited}");
    assert_eq!(board.status(0), 0);
    board.gateware_mut().edges = false;
    let before = board.time();
    let reply = run(&mut board, &hex("01510600"));
    assert_eq!(u16::from_le_bytes([reply[0], reply[1]]), 2000);
    assert!(board.time() - before >= 2_000_000);
    assert_eq!(board.status(0), ErrorRegister::HM2_TIMEOUT.bits());
    run(&mut board, &hex("01D10E00 0000"));
    assert!(board.time() - before >= 4_000_000, "writing waits too");
}

#[test]
fn scratch_registers_keep_what_they_are_given() {
    let mut board = board();
    // FACTS 10.1: counters of LinuxCNC at 4:0x10 and 4:0x14.
    let reply = run(&mut board, &hex("84D11000 01020304 05060708 84511000"));
    assert_eq!(reply, hex("0102030405060708"));
    run(&mut board, &hex("01D91800 3412"));
    assert_eq!(word(&mut board, Space::Control, 0x18), 0x1234);
}

#[test]
fn reset_takes_a_while_and_clears_the_firmware_but_not_the_fpga() {
    let mut board = board();
    run(&mut board, &hex("01C20010 78563412 01D11000 FFFF"));
    let at = board.time() + 1000;
    let mut reply = Vec::new();
    board.handle_packet(at, &hex("01D91C000100"), &mut reply);
    let cookie = hex("01420001");
    assert_eq!(
        board.handle_packet(at + 1_000_000, &cookie, &mut reply),
        None
    );
    assert!(
        board
            .handle_packet(at + 500_000_000, &cookie, &mut reply)
            .is_some()
    );
    assert_eq!(word(&mut board, Space::Timer, 0x10), 0);
    assert_eq!(run(&mut board, &hex("01420010")), hex("78563412"));
    assert_eq!(board.restarts(), (0, 1));
}

/// The 14 writes with which mesaflash reloads the FPGA.
fn reload() -> Vec<u8> {
    let words = [
        0xFFFF_u16, 0xFFFF, 0xAA99, 0x5566, 0x3261, 0, 0x3281, 0x0B00, 0x30A1, 0x000E, 0x2000,
        0x2000, 0x2000, 0x2000,
    ];
    let mut request = Vec::new();
    for word in words {
        request.extend(hex("01D91E00"));
        request.extend(word.to_le_bytes());
    }
    request
}

#[test]
fn reload_brings_the_fpga_up_again() {
    let mut board = board();
    run(&mut board, &hex("01C20010 78563412"));
    let at = board.time() + 1000;
    let mut reply = Vec::new();
    assert_eq!(board.handle_packet(at, &reload(), &mut reply), None);
    let cookie = hex("01420001");
    assert_eq!(
        board.handle_packet(at + 1_000_000, &cookie, &mut reply),
        None
    );
    assert_eq!(run(&mut board, &cookie), hex("fecaaa55"));
    assert_eq!(run(&mut board, &hex("01420010")), hex("00000000"));
    assert_eq!(board.restarts(), (1, 0));
    assert_eq!(board.gateware().configured, 1);
}

#[test]
fn leds_show_a_space_6_register_in_debug_mode() {
    // Manual: 7I97, "MEMORY SPACE 6 LAYOUT", LEDMode and DebugLEDPtr.
    // Manual: 7I97, "BOARD STATUS LEDS": the LEDs count packets by default.
    let mut board = board();
    assert_eq!(board.debug_leds(), Some(0), "no packets yet");
    run(&mut board, &hex("01D91400 0000"));
    assert_eq!(board.debug_leds(), None, "they belong to HostMot2");
    run(&mut board, &hex("01D91400 0100"));
    assert_eq!(board.debug_leds(), Some(2), "packets received");
    run(&mut board, &hex("01D91600 1800 01D91800 3412"));
    assert_eq!(board.debug_leds(), Some(0x1234), "the scratch register");
    run(&mut board, &hex("01D91400 FEFF"));
    assert_eq!(board.debug_leds(), None, "only the lowest bit counts");

    // Manual: 7I97, "ETHERNET EEPROM LAYOUT", DEBUG LED Mode: the LEDs' source after power-up.
    run(&mut board, &hex("01D91400 0100 01D91A00025A 01C928000000"));
    assert!(board.debug_leds().is_some(), "not before that");
    let state = board.state();
    run(&mut board, &hex("01D91C000100"));
    assert_eq!(board.debug_leds(), None, "after a reset");
    let mut restored = self::board();
    restored.restore(&state).unwrap();
    assert_eq!(restored.debug_leds(), None, "after a power cycle");
}

#[test]
fn state_survives_a_power_cycle_of_the_same_board_only() {
    let mut first = board();
    run(&mut first, &hex("01D91A00025A 82C920000100a8C0"));
    run(
        &mut first,
        &hex("01D91A00035A 01CE0000 00C00000 01CE0400 78563412 014E0000"),
    );
    let state = first.state();
    let mut second = board();
    second.restore(&state).unwrap();
    assert_eq!(run(&mut second, &hex("82492000")), hex("0100a8c0"));
    let read = run(&mut second, &hex("01CE0000 00C00000 014E0400"));
    assert_eq!(read, hex("78563412"));

    let mut other = SimBoard::new(BoardConfig::new("7I92"), Registers::default());
    assert_eq!(other.restore(&state), Err(StateError::OtherBoard));
    assert_eq!(other.restore(b"#!/bin/sh"), Err(StateError::NoState));
    assert!(matches!(
        other.restore(&state[..1000]),
        Err(StateError::Length { actual: 1000, .. })
    ));
}

#[test]
fn reply_too_long_for_a_packet_is_not_sent() {
    let mut board = board();
    let mut request = Vec::new();
    for _ in 0..3 {
        request.extend(hex("FF420000"));
    }
    assert_eq!(run(&mut board, &request), [0_u8; 0]);
    assert_eq!(board.status(0x12), 1);
    assert_eq!(board.status(0), ErrorRegister::TRANSMIT.bits());
    assert_eq!(run(&mut board, &[0; 1473]), [0_u8; 0]);
    assert_eq!(board.status(0x0C), 1);
}

/// Commands that are valid more often than at random.
fn command() -> impl Strategy<Value = Vec<u8>> {
    let word = any::<u16>();
    let small = 0_u16..0x40;
    (
        word,
        prop_oneof![small, any::<u16>()],
        prop::collection::vec(any::<u8>(), 0..40),
    )
        .prop_map(|(command, address, data)| {
            let mut bytes = (command & !0x0078).to_le_bytes().to_vec();
            bytes.extend(address.to_le_bytes());
            bytes.extend(data);
            bytes
        })
}

proptest! {
    #[test]
    fn board_survives_any_bytes(
        packets in prop::collection::vec(
            prop_oneof![prop::collection::vec(any::<u8>(), 0..1600), command()], 0..20),
        edges: bool,
    ) {
        let mut board = board();
        board.gateware_mut().edges = edges;
        for packet in &packets {
            let reply = run(&mut board, packet);
            prop_assert!(reply.len() <= MAX_PACKET);
        }
        // The board still answers, perhaps after a silent time, and the cookie is intact.
        prop_assert_eq!(run(&mut board, &hex("01420001")), hex("fecaaa55"));
    }

    #[test]
    fn replies_have_the_length_that_the_host_expects(
        reads in prop::collection::vec((0..8_u16, any::<u16>(), 1..20_u8), 1..8),
    ) {
        let mut request = RequestBuilder::default();
        for (space, address, count) in reads {
            request.read(Space::from_bits(space), address, count).unwrap();
        }
        let reply = run(&mut board(), &request.bytes);
        prop_assert_eq!(reply.len(), request.reply_len);
    }
}
