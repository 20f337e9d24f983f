//! Requests and replies of a host, against the LBP chapter of the 7I77's manual. Its examples that
//! a remote executes are in `crates/mesa-hal-sim/src/devices/tests`.

use mesa_hal::lbp::{
    AccessSize, COOKIE, LbpError, LbpStatus, LocalLocation as L, RemoteAccess, Request, crc8,
};

/// A frame without its CRC, which the manual's tables leave out; the CRC itself is checked here.
fn without_crc(request: &Request) -> &[u8] {
    let (&crc, body) = request.as_bytes().split_last().unwrap();
    assert_eq!(crc, crc8(body), "CRC over the whole request");
    body
}

/// "EXAMPLE LBP COMMANDS": read eight bytes at 0010; a write of four without auto-increment.
#[test]
fn example_read_of_eight_bytes_and_a_write_of_four() {
    let (address, size) = (0x10, AccessSize::Double);
    let request = Request::access(RemoteAccess::Read { address, size });
    assert_eq!(
        without_crc(&request),
        [0b0100_0111, 0b0001_0000, 0b0000_0000]
    );
    assert_eq!(request.reply_len(), 9);
    let (size, value) = (AccessSize::Long, 0xDDCC_BBAA);
    let request = Request::access(RemoteAccess::Write {
        address,
        size,
        value,
    });
    assert_eq!(
        without_crc(&request),
        [0b0110_0110, 0x10, 0x00, 0xAA, 0xBB, 0xCC, 0xDD]
    );
    assert_eq!(request.reply_len(), 1);
}

/// "EXAMPLE RPC COMMAND LIST": the data stream for RPC5.
#[test]
fn example_rpc_command_list() {
    let request = Request::rpc(0x85, &[0b0101_0101, 0b1100_1100], 2);
    assert_eq!(
        without_crc(&request),
        [0b1000_0101, 0b0101_0101, 0b1100_1100]
    );
    assert_eq!(request.reply_len(), 3);
}

/// "LOCAL LBP READ COMMANDS" and "LOCAL LBP WRITE COMMANDS": codes of the two lists.
#[test]
fn local_commands_have_the_codes_of_the_lists() {
    let reads = [
        (0xC0, L::UNIT_ADDRESS),
        (0xC1, L::STATUS),
        (0xC2, L::CRC_ENABLE),
        (0xC3, L::CRC_ERROR_COUNT),
        (0xC4, L::new(4).unwrap()),
        (0xCA, L::RPC_MEMORY_ACCESS),
        (0xCB, L::FRAME_TIMEOUT),
        (0xD0, L::NAME),
        (0xD8, L::ADDRESS_LOW),
        (0xD9, L::ADDRESS_HIGH),
        (0xDA, L::LBP_VERSION),
        (0xDB, L::UNIT_ID),
        (0xDC, L::RPC_PITCH),
        (0xDD, L::RPC_SIZE_LOW),
        (0xDE, L::RPC_SIZE_HIGH),
        (0xDF, L::COOKIE),
    ];
    for (code, location) in reads {
        let request = Request::access(RemoteAccess::ReadLocal(location));
        assert_eq!(without_crc(&request), [code]);
        assert_eq!(request.reply_len(), 2, "one byte of data and its CRC");
    }
    let writes = [
        (0xE0, L::new(0).unwrap()),
        (0xE1, L::STATUS),
        (0xE2, L::CRC_ENABLE),
        (0xE3, L::CRC_ERROR_COUNT),
        (0xEA, L::RPC_MEMORY_ACCESS),
        (0xEB, L::FRAME_TIMEOUT),
        (0xF7, L::LEDS),
        (0xF8, L::ADDRESS_LOW),
        (0xF9, L::ADDRESS_HIGH),
        (0xFA, L::ADDRESS_ADD),
        (0xFD, L::SET_UNIT_ID),
        (0xFE, L::RESET_PROCESSOR),
    ];
    for (code, location) in writes {
        let request = Request::access(RemoteAccess::WriteLocal(location, 0x5A));
        assert_eq!(without_crc(&request), [code, 0x5A]);
        assert_eq!(request.reply_len(), 1, "the CRC of no data");
    }
    let reset = Request::access(RemoteAccess::WriteLocal(L::RESET_PARSER, 0x5A));
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
    let cookie = Request::access(RemoteAccess::ReadLocal(L::COOKIE));
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
    let status = Request::access(RemoteAccess::WriteLocal(L::STATUS, 0));
    assert_eq!(status.as_bytes(), [0xE1, 0x00, 0xB1]);
    assert_eq!(status.check_reply(&[0x00]), Ok(&[][..]));
    assert!(status.check_reply(&[0x01]).is_err());
    assert!(status.check_reply(&[]).is_err());
}
