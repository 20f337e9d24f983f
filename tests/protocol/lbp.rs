//! The examples of the 7I77 manual's LBP chapter, byte by byte.

use mesa_hal::lbp::{
    Access, COOKIE, Command, DataSize, LbpError, LbpStatus, LocalRead, LocalWrite, Parsed, Parser,
    Request, RpcMemory, RpcNumber, RpcSizes, RpcTable, crc8,
};

/// A frame without its CRC, which the manual's tables leave out; the CRC itself is checked here.
fn without_crc(request: &Request) -> &[u8] {
    let (&crc, body) = request.as_bytes().split_last().unwrap();
    assert_eq!(crc, crc8(body), "CRC over the whole request");
    body
}

struct Ram([u8; 0x100]);

impl RpcMemory for Ram {
    fn read(&mut self, address: u16) -> Result<u8, LbpError> {
        let byte = self.0.get(usize::from(address));
        byte.copied().ok_or(LbpError::Memory { address })
    }

    fn write(&mut self, address: u16, value: u8) -> Result<(), LbpError> {
        let byte = self.0.get_mut(usize::from(address));
        *byte.ok_or(LbpError::Memory { address })? = value;
        Ok(())
    }
}

/// "EXAMPLE LBP COMMANDS": write AA BB CC DD to 0010 with auto-increment.
#[test]
fn example_write_of_four_bytes_with_auto_increment() {
    let access = Access::write(DataSize::Long).incrementing();
    assert_eq!(access.to_byte(), 0b0110_1110);
    let request = Request::access(access, Some(0x10), &[0xAA, 0xBB, 0xCC, 0xDD]).unwrap();
    assert_eq!(
        without_crc(&request),
        [
            0b0110_1110,
            0b0001_0000,
            0b0000_0000,
            0b1010_1010,
            0b1011_1011,
            0b1100_1100,
            0b1101_1101
        ]
    );
}

/// "EXAMPLE LBP COMMANDS": write two more bytes at the current address.
#[test]
fn example_write_of_two_more_bytes() {
    let access = Access::write(DataSize::Word).at_current_address();
    let request = Request::access(access, None, &[0xEE, 0xFF]).unwrap();
    assert_eq!(
        without_crc(&request),
        [0b0110_0001, 0b1110_1110, 0b1111_1111]
    );
}

/// "EXAMPLE LBP COMMANDS": read eight bytes at 0010.
#[test]
fn example_read_of_eight_bytes() {
    let request = Request::access(Access::read(DataSize::Double), Some(0x10), &[]).unwrap();
    assert_eq!(
        without_crc(&request),
        [0b0100_0111, 0b0001_0000, 0b0000_0000]
    );
    assert_eq!(request.reply_len(), 9);
}

/// The three examples one after the other on a remote: the address pointer is left at 0014, and
/// the eight bytes come back.
#[test]
fn examples_in_a_row_leave_the_memory_and_the_pointer_that_the_manual_says() {
    // a list in the RPC table is the same three accesses
    let mut table = RpcTable::default();
    let list = [0x6E, 0x10, 0x00, 0x61, 0x47, 0x10, 0x00, 0x00];
    for (address, byte) in (0..).zip(list) {
        table.write(address, byte).unwrap();
    }
    let mut ram = Ram([0; 0x100]);
    let mut current = 0;
    let number = RpcNumber::new(0).unwrap();
    let data = [0xAA, 0xBB, 0xCC, 0xDD, 0xEE, 0xFF];
    let reply = table
        .execute(number, &data, &mut current, &mut ram)
        .unwrap();
    assert_eq!(
        reply.as_bytes(),
        [0xAA, 0xBB, 0xCC, 0xDD, 0xEE, 0xFF, 0x00, 0x00]
    );
    assert_eq!(ram.0[0x10..0x16], data);
    assert_eq!(
        current, 0x10,
        "a read without auto-increment sets, but does not move it"
    );
}

/// "EXAMPLE RPC COMMAND LIST": RPC5 at 0028, seven bytes, two of them data from the host.
#[test]
fn example_rpc_command_list() {
    let list = [
        0b0110_0101,
        0b0001_0000,
        0b0000_0000,
        0b0100_0101,
        0b0001_0010,
        0b0000_0000,
        0b0000_0000,
    ];
    let mut table = RpcTable::default();
    for (address, byte) in (0x28..).zip(list) {
        table.write(address, byte).unwrap();
    }
    let number = RpcNumber::new(5).unwrap();
    assert_eq!(table.request_len(number), Ok(2));

    let request = Request::rpc(number, &[0b0101_0101, 0b1100_1100], 2).unwrap();
    assert_eq!(
        without_crc(&request),
        [0b1000_0101, 0b0101_0101, 0b1100_1100],
        "the data stream for this RPC"
    );

    let mut ram = Ram([0; 0x100]);
    ram.0[0x12..0x14].copy_from_slice(&[0x34, 0x12]);
    let mut current = 0;
    let data = &without_crc(&request)[1..];
    let reply = table.execute(number, data, &mut current, &mut ram).unwrap();
    assert_eq!(ram.0[0x10..0x12], [0x55, 0xCC]);
    assert_eq!(reply.as_bytes(), [0x34, 0x12]);
}

/// "LOCAL LBP READ COMMANDS" and "LOCAL LBP WRITE COMMANDS": codes of the two lists.
#[test]
fn local_commands_have_the_codes_of_the_lists() {
    let reads = [
        (0xC0, LocalRead::UnitAddress),
        (0xC1, LocalRead::Status),
        (0xC2, LocalRead::CrcEnable),
        (0xC3, LocalRead::CrcErrorCount),
        (0xC4, LocalRead::Reserved(0xC4)),
        (0xCA, LocalRead::RpcMemoryAccess),
        (0xCB, LocalRead::FrameTimeout),
        (0xD0, LocalRead::Name(0)),
        (0xD3, LocalRead::Name(3)),
        (0xD8, LocalRead::AddressLow),
        (0xD9, LocalRead::AddressHigh),
        (0xDA, LocalRead::LbpVersion),
        (0xDB, LocalRead::UnitId),
        (0xDC, LocalRead::RpcPitch),
        (0xDD, LocalRead::RpcSizeLow),
        (0xDE, LocalRead::RpcSizeHigh),
        (0xDF, LocalRead::Cookie),
    ];
    for (code, read) in reads {
        let request = Request::local_read(read);
        assert_eq!(without_crc(&request), [code]);
        assert_eq!(request.reply_len(), 2, "one byte of data and its CRC");
        assert_eq!(Command::from_byte(code), Some(Command::LocalRead(read)));
    }
    let writes = [
        (0xE0, LocalWrite::Reserved(0xE0)),
        (0xE1, LocalWrite::Status),
        (0xE2, LocalWrite::CrcEnable),
        (0xE3, LocalWrite::CrcErrorCount),
        (0xEA, LocalWrite::RpcMemoryAccess),
        (0xEB, LocalWrite::FrameTimeout),
        (0xF7, LocalWrite::Leds),
        (0xF8, LocalWrite::AddressLow),
        (0xF9, LocalWrite::AddressHigh),
        (0xFA, LocalWrite::AddressAdd),
        (0xFD, LocalWrite::UnitId),
        (0xFE, LocalWrite::ResetProcessor),
    ];
    for (code, write) in writes {
        let request = Request::local_write(write, 0x5A);
        assert_eq!(without_crc(&request), [code, 0x5A]);
        assert_eq!(request.reply_len(), 1, "the CRC of no data");
    }
    let reset = Request::local_write(LocalWrite::ResetParser, 0x5A);
    assert_eq!(without_crc(&reset), [0xFF], "no data follows this command");
}

/// "LBP Status bit definitions".
#[test]
fn status_bits_are_where_the_manual_puts_them() {
    assert_eq!(LbpStatus::FRAME_TIMEOUT.bits(), 1 << 6);
    assert_eq!(LbpStatus::INVALID_ADDRESS.bits(), 1 << 5);
    assert_eq!(LbpStatus::BUFFER_OVERFLOW.bits(), 1 << 4);
    assert_eq!(LbpStatus::WATCHDOG.bits(), 1 << 3);
    assert_eq!(LbpStatus::CRC_ERROR.bits(), 1 << 0);
}

/// "CRC": a reply's CRC covers its data; a command without reply data is answered by 00.
#[test]
fn replies_are_checked_for_length_and_crc() {
    let cookie = Request::local_read(LocalRead::Cookie);
    assert_eq!(cookie.as_bytes(), [0xDF, 0x16]);
    assert_eq!(cookie.check_reply(&[COOKIE, 0xA5]), Ok(&[COOKIE][..]));
    assert_eq!(
        cookie.check_reply(&[COOKIE, 0xF0]),
        Err(LbpError::ReplyCrc {
            command: 0xDF,
            expected: 0xA5,
            actual: 0xF0
        })
    );
    assert_eq!(
        cookie.check_reply(&[COOKIE]),
        Err(LbpError::ReplyLength {
            command: 0xDF,
            expected: 2,
            actual: 1
        })
    );
    let status = Request::local_write(LocalWrite::Status, 0);
    assert_eq!(status.as_bytes(), [0xE1, 0x00, 0xB1]);
    assert_eq!(status.check_reply(&[0x00]), Ok(&[][..]));
    assert!(status.check_reply(&[0x01]).is_err());
    assert!(status.check_reply(&[]).is_err());
}

/// "FRAMING": four character times of silence, 16 us at 2.5 Mbaud, reset the parser.
#[test]
fn a_gap_of_more_than_four_characters_resets_the_parser() {
    struct NoRpcs;
    impl RpcSizes for NoRpcs {
        fn request_len(&self, _number: RpcNumber) -> usize {
            0
        }
    }
    let mut parser = Parser::new(400);
    parser.set_timeout(40);
    assert_eq!(parser.push(4_000, 0x44, &NoRpcs), Parsed::Pending);
    assert_eq!(parser.push(8_000, 0x00, &NoRpcs), Parsed::Pending);
    // the next character begins 16.1 us after the last one has ended
    assert_eq!(
        parser.push(8_000 + 16_100 + 4_000, 0xDF, &NoRpcs),
        Parsed::Pending
    );
    let Parsed::Request(request) = parser.push(32_100, 0x16, &NoRpcs) else {
        panic!("the cookie request after the gap was not seen");
    };
    assert_eq!(request.command, Command::LocalRead(LocalRead::Cookie));
    assert_eq!(parser.counts().timeouts, 1);
}
