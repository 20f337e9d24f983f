//! The hexadecimal LBP16 examples of the 7I97 manual, in both roles: the host builds these bytes,
//! and the board executes them as the manual describes.

use mesa_hal::MesaError;
use mesa_hal::lbp16::{Command, Lbp16Error, Operations, RequestBuilder, Space};
use mesa_hal_sim::{BoardConfig, SimBoard, SimFpga, machines};

fn hex(text: &str) -> Vec<u8> {
    let digits: Vec<u8> = text
        .chars()
        .filter_map(|digit| digit.to_digit(16))
        .map(|digit| digit as u8)
        .collect();
    assert!(digits.len().is_multiple_of(2), "{text}");
    digits.chunks(2).map(|d| d[0] << 4 | d[1]).collect()
}

/// Packets of a host. The manual omits the increment bit where one element is transferred.
#[derive(Default)]
struct Host(Vec<u8>);

impl Host {
    fn command(mut self, command: Command, address: u16, data: &[u8]) -> Self {
        let mut request = RequestBuilder::default();
        request.command(command, address, data).unwrap();
        self.0.extend(request.bytes);
        self
    }

    fn read(self, space: Space, address: u16, count: u8) -> Self {
        let read = Command::read(space, count);
        self.command(read.standing(), address, &[])
    }

    fn read_on(self, space: Space, count: u8) -> Self {
        let read = Command::read(space, count);
        let on = Command {
            address: false,
            ..read.standing()
        };
        self.command(on, 0, &[])
    }

    fn write(self, space: Space, address: u16, data: &[u8]) -> Self {
        let count = data.len() / space.element().bytes();
        let write = Command::write(space, count as u8);
        self.command(write.standing(), address, data)
    }

    fn enable(self, space: u8) -> Self {
        self.write(Space::Control, 0x1A, &[space, 0x5A])
    }
}

struct Board(SimBoard<SimFpga>);

impl Board {
    fn new() -> Self {
        Self(SimBoard::new(BoardConfig::new("7I97"), machines::i7i97(1)))
    }

    fn answers(&mut self, request: &[u8]) -> Vec<u8> {
        for operation in Operations::new(request) {
            operation.unwrap();
        }
        let mut reply = Vec::new();
        let now = self.0.time() + 1_000_000;
        self.0.handle_packet(now, request, &mut reply);
        assert_eq!(self.0.status(0), 0, "no error");
        reply
    }
}

/// "SPACE 0: HOSTMOT2 REGISTERS": read first 5 entries in hostmot2 IDROM.
#[test]
fn first_five_entries_of_the_idrom_are_read() {
    let request = hex("85420004");
    let read = Command::read(Space::HostMot2, 5);
    assert_eq!(Host::default().command(read, 0x0400, &[]).0, request);
    let reply = Board::new().answers(&request);
    assert_eq!(
        reply,
        hex("03000000 40000000 c0010000") // type, offsets of modules and pins
            .into_iter()
            .chain(*b"MESA7I97")
            .collect::<Vec<_>>()
    );
}

/// "SPACE 0: HOSTMOT2 REGISTERS": write 4 GPIO ports starting at 0x1000.
#[test]
fn four_gpio_ports_are_written() {
    let data = "AAAAAAAA BBBBBBBB CCCCCCCC DDDDDDDD";
    let request = hex(&format!("84C20010 {data}"));
    let write = Command::write(Space::HostMot2, 4);
    let built = Host::default().command(write, 0x1000, &hex(data));
    assert_eq!(built.0, request);
    let [Ok(operation)] = Operations::new(&request).collect::<Vec<_>>()[..] else {
        panic!("one command");
    };
    let words: Vec<_> = operation.elements().collect();
    assert_eq!(words, [0xAAAA_AAAA, 0xBBBB_BBBB, 0xCCCC_CCCC, 0xDDDD_DDDD]);
    assert_eq!(Board::new().answers(&request), [0_u8; 0]);
}

/// "SPACE 1: ETHERNET CHIP ACCESS": read Ethernet chip CIDER register.
#[test]
fn id_of_the_ethernet_chip_is_read() {
    let request = hex("0145C000");
    let built = Host::default().read(Space::EthernetChip, 0xC0, 1);
    assert_eq!(built.0, request);
    // KSZ8851-16: family 88, chip 7.
    let reply = Board::new().answers(&request);
    assert_eq!(reply[1], 0x88);
    assert_eq!(reply[0] >> 4, 7);
}

/// "SPACE2: ETHERNET EEPROM CHIP ACCESS" and "ELBPCOM": write EEPROM IP address.
#[test]
fn ip_address_is_written() {
    let mut board = Board::new();
    for (request, address) in [
        ("01D91A00025A 82C920002000A8C0", "2000A8C0"),
        ("01D91A00025A 82C920000100a8C0", "0100A8C0"),
    ] {
        let write = Command::write(Space::Eeprom, 2);
        let built = Host::default().enable(2);
        let built = built.command(write, 0x20, &hex(address));
        assert_eq!(built.0, hex(request));
        assert_eq!(board.answers(&hex(request)), [0_u8; 0]);
        // "ELBPCOM": read EEPROM IP address at 0x0020.
        let read = Command::read(Space::Eeprom, 2);
        assert_eq!(Host::default().command(read, 0x20, &[]).0, hex("82492000"));
        assert_eq!(board.answers(&hex("82492000")), hex(address));
    }
}

/// "ELBPCOM": read hostmot2 cookie at 0x100.
#[test]
fn cookie_is_read() {
    let request = hex("01420001");
    let built = Host::default().read(Space::HostMot2, 0x0100, 1);
    assert_eq!(built.0, request);
    assert_eq!(Board::new().answers(&request), hex("fecaaa55"));
}

/// "SPACE 3: FPGA FLASH EEPROM CHIP ACCESS": write a page at 0xC000, then read it as in the example
/// that reads 1024 bytes at 00123456, then erase.
#[test]
fn flash_memory_is_written_read_and_erased() {
    let mut board = Board::new();
    let page: Vec<u8> = (0..=255).collect();

    // The manual's "01CE00000C00000" has lost a digit.
    let mut write = hex("01D91A00035A 01CE0000 00C00000 40CE0400");
    write.extend(&page);
    write.extend(hex("014E0000"));
    let built = Host::default()
        .enable(3)
        .write(Space::Flash, 0, &0xC000_u32.to_le_bytes())
        .write(Space::Flash, 4, &page)
        .read(Space::Flash, 0, 1);
    assert_eq!(built.0, write);
    assert_eq!(board.answers(&write), hex("00C10000"), "the address after");

    let built = Host::default()
        .write(Space::Flash, 0, &0x0012_3456_u32.to_le_bytes())
        .read(Space::Flash, 4, 64)
        .read_on(Space::Flash, 64)
        .read_on(Space::Flash, 64)
        .read_on(Space::Flash, 64);
    assert_eq!(built.0, hex("01CE000056341200 404E0400 400E 400E 400E"));
    assert_eq!(board.answers(&built.0), [0xFF; 1024]);
    let read = hex("01CE0000 00C00000 404E0400 400E 400E 400E");
    let reply = board.answers(&read);
    assert_eq!(reply[..256], page);
    assert_eq!(reply[256..], [0xFF; 768]);

    let erase = hex("01D91A00035A 01CE0000 00000100 01CE0C00 00000000 014E0000");
    let built = Host::default()
        .enable(3)
        .write(Space::Flash, 0, &0x0001_0000_u32.to_le_bytes())
        .write(Space::Flash, 12, &[0; 4])
        .read(Space::Flash, 0, 1);
    assert_eq!(built.0, erase);
    assert_eq!(board.answers(&erase), hex("00000100"));
    assert_eq!(board.answers(&read)[..256], page, "another sector");
    let own = hex("01D91A00035A 01CE0000 00C00000 01CE0C00 00000000 014E0000");
    board.answers(&own);
    assert_eq!(board.answers(&read), [0xFF; 1024]);
}

/// A hint follows a semicolon, or is a question.
#[test]
fn every_error_contains_the_next_step() {
    let errors: [&dyn MesaError; 5] = [
        &Lbp16Error::Count { count: 200 },
        &Lbp16Error::BadCommand {
            offset: 4,
            word: 0x4200,
        },
        &Lbp16Error::CutOff {
            offset: 4,
            what: "an address",
            expected: 2,
            found: 1,
        },
        &Lbp16Error::DataLength {
            expected: 8,
            found: 1,
        },
        &Lbp16Error::Cookie {
            space: Space::Unused,
            expected: 0x5A05,
            found: 0,
        },
    ];
    for error in errors {
        assert!(error.advice().is_some(), "{error}");
    }
}
