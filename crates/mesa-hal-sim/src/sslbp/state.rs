//! Communication states and the bits of CS. FACTS 4.6; manual 7I77, "CS REGISTER AFTER START".

pub(super) const RESET: u8 = 0x00;
pub(super) const START_TIMER: u8 = 0x01;
pub(super) const WAIT: u8 = 0x02;
pub(super) const SEND_COOKIE: u8 = 0x03;
pub(super) const GET_COOKIE: u8 = 0x04;
pub(super) const SEND_FRAME_TIMEOUT: u8 = 0x05;
pub(super) const GET_FRAME_TIMEOUT: u8 = 0x06;
pub(super) const SEND_CLEAR_STATUS: u8 = 0x07;
pub(super) const GET_CLEAR_STATUS: u8 = 0x08;
pub(super) const SEND_STATUS: u8 = 0x09;
pub(super) const GET_STATUS: u8 = 0x0A;
pub(super) const CHECK_STATUS: u8 = 0x0B;
pub(super) const SEND_UNIT_NUMBER: u8 = 0x0C;
pub(super) const GET_UNIT_NUMBER: u8 = 0x0D;
/// Send states 0E, 10, 12, 14 and get states 0F, 11, 13, 15: one pair for each character.
pub(super) const SEND_NAME: u8 = 0x0E;
pub(super) const LAST_NAME: u8 = 0x15;
pub(super) const CHECK_8I20: u8 = 0x16;
pub(super) const CHECK_7I64: u8 = 0x17;
pub(super) const SEND_CLEAR_7I64: u8 = 0x18;
pub(super) const GET_CLEAR_7I64: u8 = 0x19;
pub(super) const SEND_MODE: u8 = 0x1A;
pub(super) const GET_MODE: u8 = 0x1B;
pub(super) const SEND_DISCOVERY: u8 = 0x1C;
pub(super) const GET_DISCOVERY: u8 = 0x1D;
pub(super) const SEND_OUTPUTS_OFF: u8 = 0x1E;
pub(super) const GET_OUTPUTS_OFF: u8 = 0x1F;
pub(super) const SEND_CLEAR_FAULTS: u8 = 0x20;
pub(super) const GET_CLEAR_FAULTS: u8 = 0x21;
pub(super) const SEND_FAULTS_CLEARED: u8 = 0x22;
pub(super) const GET_FAULTS_CLEARED: u8 = 0x23;
pub(super) const SEND_FAULT: u8 = 0x24;
pub(super) const GET_FAULT: u8 = 0x25;
pub(super) const CHECK_FAULT: u8 = 0x26;
/// Start sequence of the 8I20: a word is written, then read until it is 0. FACTS 11.5.
pub(super) const SEND_CLEAR_8I20: u8 = 0x27;
pub(super) const GET_CLEAR_8I20: u8 = 0x28;
pub(super) const SEND_CLEARED_8I20: u8 = 0x29;
pub(super) const GET_CLEARED_8I20: u8 = 0x2A;
/// The next state of that sequence, which no transcript shows: the channel stays here.
pub(super) const GO_ON_8I20: u8 = 0x2B;
pub(super) const SEND_CHATTER: u8 = 0x3A;
pub(super) const GET_CHATTER: u8 = 0x3B;
pub(super) const SEND_7I64: u8 = 0x3E;
pub(super) const GET_7I64: u8 = 0x3F;
pub(super) const SEND_ACCESS: u8 = 0x40;
pub(super) const GET_ACCESS: u8 = 0x41;
pub(super) const SEND_PROCESS_DATA: u8 = 0x42;
pub(super) const GET_PROCESS_DATA: u8 = 0x43;

/// Bits of CS byte 0: sticky local faults.
pub(super) mod error {
    pub const CRC: u8 = 0x01;
    pub const COOKIE: u8 = 0x02;
    pub const OVERRUN: u8 = 0x04;
    pub const TIMEOUT: u8 = 0x08;
    pub const EXTRA_CHARACTER: u8 = 0x10;
    pub const BREAK: u8 = 0x20;
    pub const REMOTE_FAULT: u8 = 0x40;
    pub const TOO_MANY: u8 = 0x80;
}

/// Bits of CS byte 1: communication status.
pub(super) mod status {
    pub const NOT_READY: u8 = 0x80;
    pub const NO_IDENTITY: u8 = 0x40;
    pub const ERROR: u8 = 0x20;
    pub const REMOTE_FAULT: u8 = 0x01;
}
