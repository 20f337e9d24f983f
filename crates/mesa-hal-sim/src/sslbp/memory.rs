//! The interface processor's data memory, and the addresses of its variables.
//!
//! The model keeps its variables at the addresses of local reads and writes, so that a local write
//! acts on the simulated firmware as on the real one.

/// Addresses of the variables of the whole port. FACTS 2.3, T:t01.
pub(super) mod global {
    /// 0x12 for SSLBP; the other parameters follow.
    pub const INTERFACE_TYPE: u16 = 0x00;
    /// Bits of the data port.
    pub const INTERFACE_WIDTH: u16 = 0x01;
    /// Firmware version, high part.
    pub const MAJOR_REVISION: u16 = 0x02;
    /// Firmware version, low part.
    pub const MINOR_REVISION: u16 = 0x03;
    /// Address of channel 0's variables.
    pub const CHANNEL_START: u16 = 0x04;
    /// Distance between two channels' variables.
    pub const CHANNEL_STRIDE: u16 = 0x05;
    /// 0xD8 for Dumb8.
    pub const PROCESSOR_TYPE: u16 = 0x06;
    /// Number of channels of this build.
    pub const CHANNELS: u16 = 0x07;
    /// Names with their own start sequence, four characters each: 8I20, 7I64.
    pub const KNOWN_NAMES: u16 = 0x08;
    /// Constant 1.
    pub const ONE: u16 = 0x29;
    /// Constant FF.
    pub const TRUE: u16 = 0x2B;
    /// High byte of the last START command.
    pub const START_TYPE: u16 = 0x47;
    /// Non-zero after the port has been set up.
    pub const INITIALIZED: u16 = 0x48;
    /// One bit for each channel of this build.
    pub const CHANNEL_MASK: u16 = 0x49;
    /// High byte of the command in work; zero without one.
    pub const COMMAND_IN_WORK: u16 = 0x4E;
    /// Running channels.
    pub const START_BITS: u16 = 0x51;
    /// Channels that still have to stop.
    pub const STOP_BITS: u16 = 0x52;
    /// Channels that are not ready for DOIT.
    pub const NOT_READY_BITS: u16 = 0x53;
    /// Channels that have neither started nor failed yet.
    pub const NOT_STARTED_BITS: u16 = 0x54;
    /// Channels with a requested transfer.
    pub const REQUEST_BITS: u16 = 0x55;
    /// Channels without a valid reply to this DOIT.
    pub const INVALID_BITS: u16 = 0x56;
    /// Channels that this DOIT still waits for.
    pub const NOT_DONE_BITS: u16 = 0x57;
    /// Channels that chattered once; keeps the firmware loop running.
    pub const CHATTER_BITS: u16 = 0x58;
    /// Reply timeout during START, in ticks.
    pub const START_TIMEOUT: u16 = 0x63;
    /// Reply timeout of pass-through accesses, in ticks.
    pub const RUN_TIMEOUT: u16 = 0x64;
}

/// Offsets in a channel's variables. FACTS 2.4.
pub(super) mod channel {
    /// Received characters, 16 bytes.
    pub const RECEIVED: u16 = 0x00;
    /// Communication state (CS byte 2).
    pub const STATE: u16 = 0x10;
    /// Errors of this transfer.
    pub const ERROR: u16 = 0x11;
    /// Sticky errors (CS byte 0).
    pub const ERROR_LOG: u16 = 0x12;
    /// Communication status (CS byte 1).
    pub const STATUS: u16 = 0x13;
    /// Counters: this one and the next six.
    pub const CRC_ERRORS: u16 = 0x14;
    /// Wrong cookies.
    pub const COOKIE_ERRORS: u16 = 0x15;
    /// Characters that completed between the clearing of the FIFO and the check after it.
    pub const OVERRUNS: u16 = 0x16;
    /// Replies that did not arrive in time.
    pub const TIMEOUTS: u16 = 0x17;
    /// Unexpected characters.
    pub const EXTRA_CHARACTERS: u16 = 0x18;
    /// Framing errors.
    pub const BREAKS: u16 = 0x19;
    /// Fault reports of the remote.
    pub const REMOTE_FAULTS: u16 = 0x1A;
    /// Permitted number of errors of one kind.
    pub const ERROR_LIMIT: u16 = 0x1B;
    /// Characters of the pass-through reply, without its CRC.
    pub const REPLY_SIZE: u16 = 0x1C;
    /// 0x80 for an 8I20, 0x74 for a 7I64, 0 otherwise.
    pub const IDENTITY: u16 = 0x1D;
    /// Non-zero: CRCs are neither sent nor expected.
    pub const DISABLE_CRC: u16 = 0x1E;
    /// Time of the last sent frame, in ticks (16 bits).
    pub const SENT_AT: u16 = 0x21;
    /// Reply timeout in ticks.
    pub const TIMEOUT: u16 = 0x23;
    /// Non-zero for remotes that answer the discovery RPC.
    pub const GENERIC: u16 = 0x24;
    /// The remote's fault byte (CS byte 3).
    pub const REMOTE_FAULT: u16 = 0x25;
    /// The remote's name, four characters.
    pub const NAME: u16 = 0x26;
    /// Baud rate, 32 bits.
    pub const BAUD_RATE: u16 = 0x2A;
    /// Characters of a process-data reply, without its CRC.
    pub const RECEIVE_SIZE: u16 = 0x2E;
    /// Characters of process data towards the remote.
    pub const TRANSMIT_SIZE: u16 = 0x2F;
    /// Duration of the last chatter exchange in ticks.
    pub const MEASURED_TIME: u16 = 0x30;
}

/// Address of channel 0's variables.
pub(super) const CHANNEL_START: u16 = 0x70;
/// Distance between the variables of two channels.
pub(super) const CHANNEL_STRIDE: u16 = 0x32;

const SIZE: usize = 1024;
/// Bytes that a reset of the processor clears: the variables of the port and of channels 0 to 2,
/// those of channel 2 up to its name. FACTS 11.2.
const CLEARED: usize = 0x100;

/// 1024 bytes of data memory.
#[derive(Clone, Debug)]
pub(super) struct Memory {
    bytes: [u8; SIZE],
}

impl Memory {
    /// Memory at power-up.
    pub fn new() -> Self {
        Self { bytes: [0; SIZE] }
    }

    /// Sets memory up like the firmware after each reset; memory beyond [`CLEARED`] is kept.
    pub fn set_up(&mut self, channels: u8, baud_rate: u32) {
        let memory = self;
        for byte in memory.bytes.iter_mut().take(CLEARED) {
            *byte = 0;
        }
        memory.set(global::INTERFACE_TYPE, 0x12);
        memory.set(global::INTERFACE_WIDTH, 8);
        memory.set(global::MAJOR_REVISION, 1);
        memory.set(global::MINOR_REVISION, 43);
        memory.set(global::CHANNEL_START, CHANNEL_START as u8);
        memory.set(global::CHANNEL_STRIDE, CHANNEL_STRIDE as u8);
        memory.set(global::PROCESSOR_TYPE, 0xD8);
        memory.set(global::CHANNELS, channels);
        for (address, &character) in (global::KNOWN_NAMES..).zip(b"8I207I64") {
            memory.set(address, character);
        }
        memory.set(global::ONE, 1);
        memory.set(global::TRUE, 0xFF);
        for index in 0..usize::from(channels) {
            for (offset, byte) in (channel::BAUD_RATE..).zip(baud_rate.to_le_bytes()) {
                memory.set_channel(index, offset, byte);
            }
        }
    }

    /// The byte at `address`; addresses wrap round.
    pub fn get(&self, address: u16) -> u8 {
        self.bytes
            .get(usize::from(address) % SIZE)
            .copied()
            .unwrap_or(0)
    }

    /// Stores a byte.
    pub fn set(&mut self, address: u16, value: u8) {
        if let Some(slot) = self.bytes.get_mut(usize::from(address) % SIZE) {
            *slot = value;
        }
    }

    /// Sets bits of a byte.
    pub fn set_bits(&mut self, address: u16, bits: u8) {
        self.set(address, self.get(address) | bits);
    }

    /// Clears bits of a byte.
    pub fn clear_bits(&mut self, address: u16, bits: u8) {
        self.set(address, self.get(address) & !bits);
    }

    /// A variable of channel `index`.
    pub fn channel(&self, index: usize, offset: u16) -> u8 {
        self.get(Self::address(index, offset))
    }

    /// Stores a variable of channel `index`.
    pub fn set_channel(&mut self, index: usize, offset: u16, value: u8) {
        self.set(Self::address(index, offset), value);
    }

    /// Sets bits in a variable of channel `index`.
    pub fn set_channel_bits(&mut self, index: usize, offset: u16, bits: u8) {
        self.set_bits(Self::address(index, offset), bits);
    }

    /// Clears bits in a variable of channel `index`.
    pub fn clear_channel_bits(&mut self, index: usize, offset: u16, bits: u8) {
        self.clear_bits(Self::address(index, offset), bits);
    }

    /// Four bytes of channel `index`, the least significant first.
    pub fn channel_long(&self, index: usize, offset: u16) -> u32 {
        u32::from_le_bytes([
            self.channel(index, offset),
            self.channel(index, offset + 1),
            self.channel(index, offset + 2),
            self.channel(index, offset + 3),
        ])
    }

    fn address(index: usize, offset: u16) -> u16 {
        CHANNEL_START + CHANNEL_STRIDE * index as u16 + offset
    }
}
