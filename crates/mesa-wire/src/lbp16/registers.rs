//! Registers and layouts of spaces 2 to 7, as addresses. Sources: the named sections of manual
//! 7I97.

/// Space 2, "ETHERNET EEPROM LAYOUT".
pub mod eeprom {
    /// Bytes of the space.
    pub const LEN: u16 = 0x80;
    /// Bytes before this address cannot be written.
    pub const FIRST_WRITABLE: u16 = 0x20;
    /// MAC address, low word first: three words.
    pub const MAC: u16 = 0x02;
    /// Mark of a simulated board: four words that are reserved or unused, and read only, on a real
    /// board, so that none can be given it.
    pub const SIMULATED: u16 = 0x08;
    /// The words of the mark: `mesa-sim` as text.
    pub const SIMULATED_MARK: [u16; 4] = [
        u16::from_le_bytes(*b"me"),
        u16::from_le_bytes(*b"sa"),
        u16::from_le_bytes(*b"-s"),
        u16::from_le_bytes(*b"im"),
    ];
    /// Card name: sixteen characters.
    pub const CARD_NAME: u16 = 0x10;
    /// IP address, low word first: two words.
    pub const IP_ADDRESS: u16 = 0x20;
    /// Netmask, low word first: two words. Firmware 16 and later.
    pub const NETMASK: u16 = 0x24;
    /// LED mode at power-up: bit 0 is 1 for debug LEDs.
    pub const LED_MODE: u16 = 0x28;
    /// The first firmware version that has a netmask.
    pub const NETMASK_FIRMWARE: u16 = 16;
}

/// Space 3, "FLASH MEMORY REGISTERS".
pub mod flash {
    /// Byte address in the flash; advances by 4 with each access of [`DATA`].
    pub const ADDRESS: u16 = 0x00;
    /// Data port.
    pub const DATA: u16 = 0x04;
    /// Flash id, read only.
    pub const ID: u16 = 0x08;
    /// Writing erases the sector at [`ADDRESS`].
    pub const SECTOR_ERASE: u16 = 0x0C;
    /// Bytes of a page, the unit of a write.
    pub const PAGE: usize = 256;
    /// Bytes of a sector, the unit of an erase.
    pub const SECTOR: usize = 0x1_0000;
}

/// Space 4, "SPACE 4 LBP TIMER/UTILITY AREA".
pub mod timer {
    /// Free-running microseconds; writes have no effect.
    pub const TIME_STAMP: u16 = 0x00;
    /// Writing waits for the written number of microseconds.
    pub const WAIT_US: u16 = 0x02;
    /// Longest wait for HostMot2, in microseconds.
    pub const HM2_TIMEOUT: u16 = 0x04;
    /// Reading or writing waits for the reference output of HostMot2's DPLL.
    pub const WAIT_FOR_HM2_REFERENCE: u16 = 0x06;
    /// The same for timers 1 to 4: four registers.
    pub const WAIT_FOR_HM2_TIMER1: u16 = 0x08;
    /// Eight scratch registers.
    pub const SCRATCH: u16 = 0x10;
}

/// Space 6, "SPACE 6 LBP STATUS/CONTROL AREA".
pub mod control {
    /// See [`ErrorRegister`](crate::lbp16::ErrorRegister).
    pub const ERROR: u16 = 0x00;
    /// Requests that were not a sequence of whole commands.
    pub const PARSE_ERRORS: u16 = 0x02;
    /// Accesses that a space rejected.
    pub const MEMORY_ERRORS: u16 = 0x04;
    /// Writes that were refused.
    pub const WRITE_ERRORS: u16 = 0x06;
    /// Packets received.
    pub const RX_PACKETS: u16 = 0x08;
    /// UDP packets received.
    pub const RX_UDP: u16 = 0x0A;
    /// Bad packets received.
    pub const RX_BAD: u16 = 0x0C;
    /// Packets sent.
    pub const TX_PACKETS: u16 = 0x0E;
    /// UDP packets sent.
    pub const TX_UDP: u16 = 0x10;
    /// Packets that could not be sent.
    pub const TX_BAD: u16 = 0x12;
    /// Bit 0: the LEDs show debug information instead of HostMot2's.
    pub const LED_MODE: u16 = 0x14;
    /// Address in this space of the word that the debug LEDs show.
    pub const DEBUG_LED_POINTER: u16 = 0x16;
    /// Scratch register, for example for sequence numbers.
    pub const SCRATCH: u16 = 0x18;
    /// `5A0N` enables writes to space N until the end of the packet.
    pub const WRITE_ENABLE: u16 = 0x1A;
    /// A non-zero value resets the firmware: up to half a second without replies.
    pub const RESET: u16 = 0x1C;
    /// The FPGA's configuration port (ICAP), for a reload.
    pub const ICAP: u16 = 0x1E;

    /// Value of [`WRITE_ENABLE`] that enables EEPROM writes.
    pub const ENABLE_EEPROM: u16 = 0x5A02;
    /// Value of [`WRITE_ENABLE`] that enables flash writes and erases.
    pub const ENABLE_FLASH: u16 = 0x5A03;
}

/// Space 7, "SPACE 7: LBP READ ONLY AREA".
pub mod read_only {
    /// Card name: sixteen characters.
    pub const CARD_NAME: u16 = 0x00;
    /// Version of the protocol.
    pub const LBP_VERSION: u16 = 0x10;
    /// Version of the firmware.
    pub const FIRMWARE_VERSION: u16 = 0x12;
    /// Option jumpers: source of the IP address.
    pub const JUMPERS: u16 = 0x14;
    /// Start of the reception of the last packet, in microseconds.
    pub const RECEIVE_START: u16 = 0x18;
    /// End of the reception of the last packet, in microseconds.
    pub const RECEIVE_DONE: u16 = 0x1A;
    /// Start of the transmission of the previous reply, in microseconds.
    pub const SEND_START: u16 = 0x1C;
    /// End of the transmission of the previous reply, in microseconds.
    pub const SEND_DONE: u16 = 0x1E;
    /// The first firmware version that can reload the FPGA (FACTS 10.2).
    pub const RELOAD_FIRMWARE: u16 = 15;
}
