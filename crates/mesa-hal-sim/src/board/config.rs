//! Configuration of a simulated board, apart from its FPGA.

use core::net::Ipv4Addr;

use crate::wire::Nanos;

/// Source of the board's IP address: its address jumpers. The simulated board has the address that
/// it is given, whatever the jumpers are.
///
/// Manual: 7I97, "IP ADDRESS SELECTION"; FACTS 9.6 for the 7I97T.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum AddressJumpers {
    /// 192.168.1.121.
    Fixed = 0,
    /// The address in the EEPROM.
    Eeprom = 1,
    /// BootP.
    BootP = 2,
    /// Both up: invalid, but on a 7I97T 192.168.1.121 and the fallback configuration.
    Both = 3,
}

/// Identity and timing of a simulated Ethernet board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardConfig {
    /// Card name, padded with zeros.
    pub name: [u8; 16],
    /// MAC address in the EEPROM.
    pub mac: [u8; 6],
    /// The EEPROM says that the board is simulated, in words that a real board reserves. False: as
    /// on a real board, whose outputs no program may leave on for longer than it would there.
    pub is_marked: bool,
    /// IP address in the EEPROM.
    pub ip: Ipv4Addr,
    /// Netmask in the EEPROM; firmware 16 and later has one.
    pub netmask: Ipv4Addr,
    /// Source of the IP address.
    pub jumpers: AddressJumpers,
    /// Version of the protocol, space 7.
    pub lbp_version: u16,
    /// Version of the firmware, space 7: 15 supports a reload, 16 has a netmask.
    pub firmware_version: u16,
    /// Time that the board's processor needs for a packet before executing it. Not confirmed.
    pub packet_time: Nanos,
    /// Time per element of a command. Not confirmed.
    pub access_time: Nanos,
    /// Silent time after a reset of the board's firmware (manual: up to half a second).
    pub reset_time: Nanos,
    /// Silent time after a reload of the FPGA.
    pub reload_time: Nanos,
}

impl BoardConfig {
    /// A board of this name with Mesa's defaults; characters past 16 are dropped.
    pub fn new(name: &str) -> Self {
        let mut padded = [0; 16];
        for (slot, byte) in padded.iter_mut().zip(name.bytes()) {
            *slot = byte;
        }
        Self {
            name: padded,
            mac: [0x00, 0x60, 0x1B, 0x1B, 0x00, 0x97],
            is_marked: true,
            ip: Ipv4Addr::new(10, 10, 10, 10),
            netmask: Ipv4Addr::new(255, 255, 255, 0),
            jumpers: AddressJumpers::Eeprom,
            lbp_version: 3,
            firmware_version: 16,
            packet_time: 15_000,
            access_time: 80,
            reset_time: 200_000_000,
            reload_time: 300_000_000,
        }
    }
    /// The MAC address in words, low word first.
    pub(super) fn mac_words(&self) -> [u16; 3] {
        let mut words = [0; 3];
        for (word, pair) in words.iter_mut().rev().zip(self.mac.chunks(2)) {
            *word = pair
                .iter()
                .fold(0, |word, &byte| word << 8 | u16::from(byte));
        }
        words
    }

    /// The card name in words.
    pub(super) fn name_words(&self) -> [u16; 8] {
        let mut words = [0; 8];
        for (word, pair) in words.iter_mut().zip(self.name.chunks(2)) {
            *word = pair
                .iter()
                .rev()
                .fold(0, |word, &byte| word << 8 | u16::from(byte));
        }
        words
    }
}
