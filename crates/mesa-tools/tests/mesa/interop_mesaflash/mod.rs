//! mesaflash (Debian package `mesaflash`) works with the simulated board as with a real one.
//!
//! Runs on loopback and without root; each board has an address of its own in 127/8, because
//! mesaflash always talks to port 27181.

mod flash;

use std::{net::Ipv4Addr, process::Command};

use crate::interop::mesaflash::{Mesaflash, free_address};
use crate::interop::tools::{has_program, skip};
use crate::interop::{self, Scratch, console::Values, mesa};

/// A simulated board for mesaflash.
struct Board {
    board: interop::board::Board,
    device: &'static str,
}

impl Board {
    /// A 7I97 at an address that no other test uses.
    fn i7i97(arguments: &[&str]) -> Self {
        Self::start("7i97", "7i97", arguments)
    }

    fn start(device: &'static str, board: &str, arguments: &[&str]) -> Self {
        let address = free_address();
        let board =
            interop::board::Board::start(address, &[&["--board", board], arguments].concat());
        Self { board, device }
    }

    fn address(&self) -> Ipv4Addr {
        *self.board.address.ip()
    }

    fn its_mesaflash(&self) -> Mesaflash {
        Mesaflash {
            device: self.device,
            address: self.address(),
        }
    }

    /// Runs mesaflash, which must succeed.
    fn mesaflash(&self, arguments: &[&str]) -> String {
        self.its_mesaflash().run(arguments)
    }

    /// Ends the board and returns its summary.
    fn stop(self) -> Values {
        self.board.stop("TERM")
    }
}

/// Asserts that the output of mesaflash contains a text.
fn says(text: &str, expected: &str) {
    assert!(text.contains(expected), "{expected}\n{text}");
}

/// True if the test cannot run here.
fn skipped() -> bool {
    let missing = !has_program("mesaflash");
    if missing {
        skip("mesaflash is not installed");
    }
    missing
}

/// A module in the format of mesaflash.
fn module(name: &str, count: u32, version: u32, registers: u32, base: u32, clock: u32) -> String {
    format!(
        "  Module: {name}\n  There are {count} of {name} in configuration\n  Version: {version}\n  \
         Registers: {registers}\n  BaseAddress: {base:04X}\n  ClockFrequency: {clock}.000 MHz\n"
    )
}

#[test]
fn readhmid_prints_the_firmware_of_a_7i97() {
    if skipped() {
        return;
    }
    let text = Board::i7i97(&[]).mesaflash(&["--readhmid"]);
    for line in [
        "BoardName : MESA7I97",
        "FPGA Size: 9 KGates",
        "FPGA Pins: 144",
        "Number of IO Ports: 3",
        "Width of one I/O port: 17",
        "Clock Low frequency: 100.0000 MHz",
        "Clock High frequency: 200.0000 MHz",
        "IDROM Type: 3",
    ] {
        says(&text, line);
    }
    // FACTS 9.2.
    for expected in [
        module("DPLL", 1, 0, 7, 0x7000, 100),
        module("WatchDog", 1, 0, 3, 0x0C00, 100),
        module("IOPort", 3, 0, 5, 0x1000, 100),
        module("MuxedQCount", 6, 4, 5, 0x3600, 100),
        module("MuxedQCountSel", 1, 0, 0, 0x0000, 100),
        module("PWM", 6, 0, 5, 0x4100, 200),
        module("InMux", 1, 0, 5, 0x8000, 100),
        module("SSR", 1, 0, 2, 0x7D00, 100),
        module("SSerial", 1, 0, 6, 0x5B00, 100),
        module("LED", 1, 0, 1, 0x0200, 100),
    ] {
        assert!(text.contains(&expected), "{expected}\n{text}");
    }
    // The terminal names come from mesaflash; they only match if every pin has its right function.
    let pins: Vec<Vec<&str>> = text
        .lines()
        .map(|line| line.split_whitespace().collect())
        .collect();
    for expected in [
        "TB3-4 0 IOPort PWM 0 PWM (Out)",
        "TB3-24 7 IOPort PWM 5 /Enable (Out)",
        "TB3-4,8,12,16 8 IOPort PWM 0 /Enable (Out)",
        "TB1-1,2,9,10 9 IOPort MuxedQCount 0 MuxQ-A (In)",
        "TB2-15,16,23,24 17 IOPort MuxedQCount 2 MuxQ-IDX (In)",
        "Internal-EncMux 18 IOPort MuxedQCountSel 0 MuxSel0 (Out)",
        "TB5-23,24 24 IOPort SSR 0 Out-05 (Out)",
        "TB4-15,16 31 IOPort SSerial 0 RXData0 (In)",
        "TB4-17,18 32 IOPort SSerial 0 TXData0 (Out)",
        "P1-25/DB25-13 50 IOPort None",
    ] {
        let expected: Vec<&str> = expected.split(' ').collect();
        assert!(pins.contains(&expected), "{expected:?}\n{text}");
    }
}

#[test]
fn readhmid_knows_the_pins_of_a_7i77_behind_a_7i92() {
    if skipped() {
        return;
    }
    let board = Board::start("7i92", "7i92-7i77", &[]);
    let text = board.mesaflash(&["--dbname1", "7I77", "--readhmid"]);
    let pins: Vec<Vec<&str>> = text
        .lines()
        .map(|line| line.split_whitespace().collect())
        .collect();
    // FACTS 8.1; the terminal names come from mesaflash, for a 7I77 on the connector.
    let functions = [
        "TXEn2", "TXData2", "RXData2", "TXData1", "RXData1", "TXData0", "RXData0", "MuxSel0",
        "MuxQ-A", "MuxQ-B", "MuxQ-IDX", "MuxQ-A", "MuxQ-B", "MuxQ-IDX", "MuxQ-A", "MuxQ-B",
        "MuxQ-IDX",
    ];
    for (pin, function) in functions.into_iter().enumerate() {
        let number = pin.to_string();
        let found = pins.iter().any(|words| {
            words.contains(&number.as_str())
                && words.contains(&"IOPort")
                && words.contains(&function)
        });
        assert!(found, "pin {pin}: {function}\n{text}");
    }
    says(&text, "BoardName : MESA7I92");
}

#[test]
fn print_pd_and_xml_list_all_51_pins() {
    if skipped() {
        return;
    }
    let board = Board::i7i97(&[]);
    let text = board.mesaflash(&["--print-pd"]);
    says(&text, "51 HM2 Pin Descriptors");
    assert_eq!(text.matches("Primary Tag: 0x03 (IOPort)").count(), 51);
    assert_eq!(text.matches("Secondary Tag: 0x06 (PWM)").count(), 9);
    assert_eq!(text.matches("Secondary Tag: 0x0C (MuxedQCount)").count(), 9);
    assert_eq!(text.matches("Secondary Tag: 0xC1 (SSerial)").count(), 3);
    let xml = board.mesaflash(&["--readhmid", "--xml"]);
    assert!(xml.contains("<boardname>MESA7I97</boardname>"), "{xml}");
    assert_eq!(xml.matches("<tagname>").count(), 10, "{xml}");
}

#[test]
fn verbose_information_of_all_spaces_is_right() {
    if skipped() {
        return;
    }
    let board = Board::i7i97(&[]);
    let text = board.mesaflash(&["--verbose"]);
    let address = board.address();
    for line in [
        &format!("ip address: {address}"),
        "mac address: 00:60:1B:1B:00:97",
        "protocol: LBP16 version 3",
        "0: HostMot2 (registers, RW, 32-bit) [size=64K]",
        "1: KSZ8851R (registers, RW, 16-bit) [size=256]",
        "2: EtherEEP (EEPROM, RW, 16-bit) [size=128]",
        "3: FPGAFlsh (flash, RW, 32-bit) [size=2M], page size: 256, erase size: 65536",
        "4: Timers (memory, RW, 16-bit) [size=32]",
        "6: LBP16RW (memory, RW, 16-bit) [size=32]",
        "7: LBP16RO (memory, RO, 16-bit) [size=32]",
        "flash size: 16Mb (id: 0x14)",
        "parse errors: 0, mem errors 0, write errors 0",
        "error flags: 0x0000",
        "board firmware version 16",
        "IP address jumpers at boot: fixed from EEPROM",
    ] {
        says(&text, line);
    }
}

#[test]
fn sserial_lists_every_remote_with_its_parameters_and_modes() {
    if skipped() {
        return;
    }
    // On a 7I92, because mesaflash enables the serial pins of the first two I/O ports only, and
    // the channels that are added to a 7I97 are on its third.
    let mut board = Board::start("7i92", "7i92-7i77", &["--remote", "2=7i72"]);
    let text = board.mesaflash(&["--sserial"]);
    for line in [
        "SSLBP Version: 1.43",
        "SSLBP Channels: 3",
        "SSLBP Baud Rate: 2500000",
        "sserial device at channel 0: 7I77 GPIO (unit 0x12",
        "sserial device at channel 1: 7I77 ANALOG (unit 0x11",
        "sserial device at channel 2: 7I72 (unit 0x",
        "NVBaudRate = 2.5Mb",
        "NVWatchDogTimeout = 50ms",
        "SOFTWARE MODE input_output [index 00]",
        "SOFTWARE MODE io_analog [index 01]",
        "SOFTWARE MODE io_analog_fieldvoltage [index 02]",
        "SOFTWARE MODE io_encoder_analog_fieldvoltage [index 03]",
        "SOFTWARE MODE analogout_enables [index 00]",
        // A 16-bit parameter: with an 8-bit one mesaflash prints the bytes of its address as well.
        "SwRevision = 14\n",
        "HwRevision = 2\n",
    ] {
        says(&text, line);
    }
    board.board.console.run("unplug 1");
    let text = board.mesaflash(&["--sserial"]);
    says(&text, "channel 0: 7I77 GPIO");
    assert!(!text.contains("channel 1"), "{text}");
    board.board.console.run("plug 1");
    assert_eq!(board.board.console.show("1")["remote.1.plugged"], "1");
    let text = board.mesaflash(&["--sserial"]);
    says(&text, "channel 1: 7I77 ANALOG");

    let board = Board::i7i97(&["--remote", "0=7i77-analog"]);
    let text = board.mesaflash(&["--sserial"]);
    says(&text, "SSLBP Channels: 1");
    says(&text, "channel 0: 7I77 ANALOG");
}

/// A card whose revision has the 16 bits that mesaflash reads.
const CARD: &str = "\
remote 7X99
unit 0x99000001
hardware 0 standard
mode 0 outputs
  data Output 8 bits out
parameter SwRevision 16 unsigned in 0 65535
parameter NVBaudRate 16 nonvol-unsigned both 0 11 = 9
baud-rate NVBaudRate
";

#[test]
fn printed_sserial_revision_is_that_of_the_written_firmware() {
    if skipped() {
        return;
    }
    let description = Scratch::new("7x99.remote");
    std::fs::write(&description.0, CARD).unwrap();
    let remote = format!("2={}", description.path());
    let mut board = Board::start("7i92", "7i92-7i77", &["--remote", &remote]);
    let printed = |board: &Board| {
        let text = board.mesaflash(&["--sserial"]);
        let (_, card) = text.split_once("channel 2").expect("the card");
        let (_, after) = card.split_once("SwRevision = ").expect("its revision");
        let number: String = after.chars().take_while(char::is_ascii_digit).collect();
        number.parse::<u32>().expect("a number")
    };
    assert_eq!(printed(&board), 14);

    let firmware = Scratch::new("7x99-34.bin");
    let run = |board: &mut Board, line: &str| board.board.console.run(line);
    run(&mut board, &format!("firmware 2 34 {}", firmware.path()));
    run(&mut board, "jumper 2 setup");
    let address = board.board.address.to_string();
    let mesa = |arguments: &[&str]| {
        let output = Command::new(mesa()).args(arguments).output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{text}{error}");
        text
    };
    let update = ["update", "7x99", firmware.path(), "--addr", &address];
    mesa(&[&update[..], &["--at", "0.2", "--yes"]].concat());
    run(&mut board, "jumper 2 operate");
    assert_eq!(printed(&board), 34);
    let text = mesa(&["param", "get", "0.2.swrevision", "--addr", &address]);
    says(&text, "34");
}

#[test]
fn registers_are_read_and_written() {
    if skipped() {
        return;
    }
    let board = Board::i7i97(&[]);
    assert_eq!(board.mesaflash(&["--rpo", "0x100"]).trim(), "55AACAFE");
    // Direction register of the third port, 17 pins.
    assert_eq!(board.mesaflash(&["--rpo", "0x1108"]).trim(), "00000000");
    board.mesaflash(&["--wpo", "0x1108=0x12345"]);
    assert_eq!(board.mesaflash(&["--rpo", "0x1108"]).trim(), "00012345");
}

#[test]
fn ip_address_is_set_and_stays_in_the_state_file() {
    if skipped() {
        return;
    }
    let state = Scratch::new("state");
    let board = Board::i7i97(&["--state", state.path()]);
    let text = board.mesaflash(&["--set", "ip=10.97.0.55"]);
    says(&text, "Board IP updated successfully");
    let text = board.mesaflash(&["--verbose"]);
    says(&text, "    ip address: 10.97.0.55");
    board.stop();
    let board = Board::i7i97(&["--state", state.path()]);
    let text = board.mesaflash(&["--verbose"]);
    says(&text, "    ip address: 10.97.0.55");
    drop(board);
    // The state of a 7I97 does not fit a 7I92: refused, with a reason.
    let output = Command::new(mesa())
        .arg("sim")
        .args([
            "--board",
            "7i92-7i77",
            "--listen",
            "127.0.0.1",
            "--port",
            "0",
        ])
        .args(["--state", state.path()])
        .output()
        .unwrap();
    assert!(!output.status.success());
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(
        error.contains("another MAC address or card name"),
        "{error}"
    );
}

#[test]
fn reset_and_reload_are_survived() {
    if skipped() {
        return;
    }
    let board = Board::i7i97(&[]);
    board.mesaflash(&["--wpo", "0x1108=0x12345"]);
    board.mesaflash(&["--reset"]);
    let direction = board.mesaflash(&["--rpo", "0x1108"]);
    assert_eq!(
        direction.trim(),
        "00012345",
        "a reset leaves the FPGA alone"
    );
    board.mesaflash(&["--reload"]);
    assert_eq!(board.mesaflash(&["--rpo", "0x1108"]).trim(), "00000000");
    let summary = board.stop();
    assert_eq!(
        (&summary["board.resets"][..], &summary["board.reloads"][..]),
        ("1", "1")
    );
}
