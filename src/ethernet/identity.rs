//! Identity of a board: one packet that writes nothing, and its answer.

use alloc::borrow::ToOwned;
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use core::net::Ipv4Addr;

use super::packets::QUICK;
use super::{EthernetBoard, EthernetError, Lbp16Board};
use crate::lbp16::registers::{eeprom, read_only};
use crate::lbp16::{Command, InfoArea, Lbp16Error, RequestBuilder, Space, text};

/// The address of a network interface. `Display` writes it as usual: `00:60:1b:1b:00:97`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MacAddress(pub [u8; 6]);

impl fmt::Display for MacAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (n, byte) in self.0.iter().enumerate() {
            let colon = if n == 0 { "" } else { ":" };
            write!(f, "{colon}{byte:02x}")?;
        }
        Ok(())
    }
}

#[cfg(feature = "serde")]
impl serde::Serialize for MacAddress {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Source of a board's IP address at its start, selected by its two address jumpers. `Display`
/// describes it in words, [`of_card`](Self::of_card) with the positions of the jumpers.
///
/// Source: manual 7I97, "IP ADDRESS SELECTION"; FACTS 9.6 for the 7I97T. The assignment of the
/// word's bits to the jumpers is mesaflash's reading, not confirmed by a manual.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
#[non_exhaustive]
pub enum AddressSource {
    /// Both down: 192.168.1.121.
    Fixed,
    /// Down and up: the address in the EEPROM; the factory setting is 10.10.10.10.
    Eeprom,
    /// Up and down: a BOOTP or DHCP server.
    BootP,
    /// Both up on a 7I97T: 192.168.1.121, and the fallback configuration of the FPGA.
    Fallback,
    /// Both up on other boards, which the manual of the 7I97 calls invalid.
    Invalid,
}

impl AddressSource {
    /// The address of a board whose jumpers select [`Fixed`](Self::Fixed).
    pub const FIXED: Ipv4Addr = Ipv4Addr::new(192, 168, 1, 121);
    /// The factory setting of the address in the EEPROM.
    pub const FACTORY_EEPROM: Ipv4Addr = Ipv4Addr::new(10, 10, 10, 10);

    /// The source that the word of the jumpers selects on this card.
    pub fn from_jumpers(word: u16, card: &str) -> Self {
        match word & 3 {
            0 => Self::Fixed,
            1 => Self::Eeprom,
            2 => Self::BootP,
            _ if card == Identity::I7I97T => Self::Fallback,
            _ => Self::Invalid,
        }
    }

    /// Describes the source in words, with the positions of the jumpers of this card. For a card
    /// whose manual is not among the sources here, the names of the jumpers are not known: first
    /// and second.
    pub fn of_card(self, card: &str) -> String {
        let [first, second] = match card {
            "7I97" => ["W16", "W17"],
            Identity::I7I97T => ["W11", "W12"],
            _ => ["first address jumper", "second"],
        };
        let [one, two] = match self {
            Self::Fixed => ["down", "down"],
            Self::Eeprom => ["down", "up"],
            Self::BootP => ["up", "down"],
            Self::Fallback | Self::Invalid => ["up", "up"],
        };
        format!("{self} ({first} {one}, {second} {two})")
    }
}

impl fmt::Display for AddressSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Fixed => "fixed 192.168.1.121",
            Self::Eeprom => "from EEPROM",
            Self::BootP => "from BOOTP",
            Self::Fallback => "fixed 192.168.1.121 with fallback firmware",
            Self::Invalid => "invalid",
        })
    }
}

/// Identity and network settings of a board.
///
/// Source: manual 7I97, "SPACE 7: LBP READ ONLY AREA" and "ETHERNET EEPROM LAYOUT".
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Identity {
    /// The card's name without padding, for example `7I97`; `?` if it is not text.
    pub card: String,
    /// The MAC address in the EEPROM.
    pub mac: MacAddress,
    /// Version of the protocol.
    pub lbp_version: u16,
    /// Version of the firmware that answers.
    pub firmware_version: u16,
    /// The jumpers, as the board reads them.
    pub jumpers: u16,
    /// The source of the IP address, according to the jumpers.
    pub address_from: AddressSource,
    /// The IP address in the EEPROM, which the board uses if its jumpers select it.
    pub eeprom_ip: Ipv4Addr,
    /// The netmask in the EEPROM; firmware 16 and later have one.
    pub eeprom_netmask: Option<Ipv4Addr>,
}

/// Words of the answer: an info area, name to jumpers, MAC address, IP address, netmask.
const WORDS: usize = InfoArea::WORDS + 11 + 3 + 2 + 2;

impl Identity {
    /// The name of a 7I97T.
    const I7I97T: &str = "7I97T";

    /// Records that the board is a 7I97T according to its firmware ([`Idrom::is_7i97t`]), whatever
    /// the card's name is: its jumpers have other meanings than those of a 7I97.
    ///
    /// [`Idrom::is_7i97t`]: crate::hostmot2::Idrom::is_7i97t
    pub fn set_7i97t(&mut self) {
        Self::I7I97T.clone_into(&mut self.card);
        self.address_from = AddressSource::from_jumpers(self.jumpers, Self::I7I97T);
    }

    /// Bytes of the answer to the [`question`](Self::question).
    pub const ANSWER: usize = 2 * WORDS;

    /// The packet that requests the identity of a board. Writes nothing, so that it disturbs
    /// neither a board that another program drives nor any other device that receives it.
    pub fn question() -> Vec<u8> {
        let mut request = RequestBuilder::default();
        let reads = [
            (
                Command::read_info(Space::ReadOnly, InfoArea::WORDS as u8),
                0,
            ),
            (Command::read(Space::ReadOnly, 11), read_only::CARD_NAME),
            (Command::read(Space::Eeprom, 3), eeprom::MAC),
            (Command::read(Space::Eeprom, 2), eeprom::IP_ADDRESS),
            (Command::read(Space::Eeprom, 2), eeprom::NETMASK),
        ];
        for (read, address) in reads {
            request.push(read, address, &[]);
        }
        debug_assert_eq!(request.reply_len, Self::ANSWER);
        request.bytes
    }

    /// Parses the answer to the [`question`](Self::question).
    ///
    /// # Errors
    /// [`Lbp16Error::Cookie`]: the answer is not that of an LBP16 board.
    pub fn parse(answer: &[u8; Self::ANSWER]) -> Result<Self, Lbp16Error> {
        let mut words = [0; WORDS];
        for (word, bytes) in words.iter_mut().zip(answer.as_chunks().0) {
            *word = u16::from_le_bytes(*bytes);
        }
        let [i0, i1, i2, i3, i4, i5, i6, i7, words @ ..] = words;
        InfoArea::parse(Space::ReadOnly, [i0, i1, i2, i3, i4, i5, i6, i7])?;
        let [n0, n1, n2, n3, n4, n5, n6, n7, words @ ..] = words;
        let name = [n0, n1, n2, n3, n4, n5, n6, n7].map(u16::to_le_bytes);
        let [lbp_version, firmware_version, jumpers, words @ ..] = words;
        // The low word of each comes first.
        let [
            mac_low,
            mac_middle,
            mac_high,
            ip_low,
            ip_high,
            mask_low,
            mask_high,
        ] = words;
        let [[m0, m1], [m2, m3], [m4, m5]] = [mac_high, mac_middle, mac_low].map(u16::to_be_bytes);
        let address = |low, high| Ipv4Addr::from_bits(u32::from(high) << 16 | u32::from(low));
        let has_netmask = firmware_version >= eeprom::NETMASK_FIRMWARE;
        Ok(Self {
            address_from: AddressSource::from_jumpers(jumpers, text(name.as_flattened())),
            card: text(name.as_flattened()).to_owned(),
            mac: MacAddress([m0, m1, m2, m3, m4, m5]),
            lbp_version,
            firmware_version,
            jumpers,
            eeprom_ip: address(ip_low, ip_high),
            eeprom_netmask: has_netmask.then(|| address(mask_low, mask_high)),
        })
    }
}

impl<B: Lbp16Board> EthernetBoard<'_, B> {
    /// The identity of the board, if it is an LBP16 board at all. Writes nothing.
    ///
    /// # Errors
    /// [`Lbp16Error::Cookie`], and errors of the bus.
    pub fn identity(&mut self) -> Result<Identity, EthernetError> {
        let mut answer = [0; Identity::ANSWER];
        let question = Identity::question();
        let ran = self.bus.run_commands(&question, &mut answer, QUICK);
        ran.map_err(EthernetError::Bus)?;
        Ok(Identity::parse(&answer)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lbp16::Operations;
    use alloc::string::ToString;
    use proptest::prelude::*;

    /// Manual: 7I97, "ETHERNET EEPROM LAYOUT", "MEMORY SPACE 7 LAYOUT".
    fn answer(firmware: u16, jumpers: u16) -> [u8; Identity::ANSWER] {
        let mut words = [0_u16; WORDS];
        words[0] = 0x5A07;
        words[8..10].copy_from_slice(&[*b"7I", *b"97"].map(u16::from_le_bytes));
        words[16..19].copy_from_slice(&[3, firmware, jumpers]);
        words[19..22].copy_from_slice(&[0x0097, 0x1B1B, 0x0060]);
        words[22..26].copy_from_slice(&[0x0A0A, 0x0A0A, 0xFF00, 0xFFFF]);
        let mut answer = [0; Identity::ANSWER];
        for (bytes, word) in answer.chunks_mut(2).zip(words) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        answer
    }

    /// FACTS 9.6.
    #[test]
    fn jumpers_of_a_7i97t_have_their_own_names_and_meaning() {
        let both_up = |card| AddressSource::from_jumpers(3, card).of_card(card);
        assert_eq!(both_up("7I97"), "invalid (W16 up, W17 up)");
        assert_eq!(
            both_up("7I97T"),
            "fixed 192.168.1.121 with fallback firmware (W11 up, W12 up)"
        );
        let eeprom = AddressSource::from_jumpers(1, "7I97T");
        assert_eq!(eeprom.of_card("7I97T"), "from EEPROM (W11 down, W12 up)");
        // Named as a 7I97 until its firmware is known.
        let mut identity = Identity::parse(&answer(16, 3)).unwrap();
        assert_eq!(identity.address_from, AddressSource::Invalid);
        identity.set_7i97t();
        assert_eq!(identity.address_from, AddressSource::Fallback);
        assert_eq!(identity.card, "7I97T");
    }

    #[test]
    fn answer_is_read_field_by_field() {
        let identity = Identity::parse(&answer(16, 0)).unwrap();
        assert_eq!(identity.card, "7I97");
        assert_eq!(identity.mac.to_string(), "00:60:1b:1b:00:97");
        assert_eq!((identity.lbp_version, identity.firmware_version), (3, 16));
        assert_eq!(identity.address_from, AddressSource::Fixed);
        assert_eq!(identity.eeprom_ip, AddressSource::FACTORY_EEPROM);
        let netmask = Ipv4Addr::new(255, 255, 255, 0);
        assert_eq!(identity.eeprom_netmask, Some(netmask));
        let old = Identity::parse(&answer(15, 2)).unwrap();
        let found = (old.eeprom_netmask, old.address_from);
        assert_eq!(found, (None, AddressSource::BootP));
    }

    #[test]
    fn jumpers_are_named_as_the_manual_of_the_card_names_them() {
        let words =
            [0, 1, 2, 3].map(|word| AddressSource::from_jumpers(word, "7I97").of_card("7I97"));
        assert_eq!(words[0], "fixed 192.168.1.121 (W16 down, W17 down)");
        assert_eq!(words[1], "from EEPROM (W16 down, W17 up)");
        assert_eq!(words[2], "from BOOTP (W16 up, W17 down)");
        assert_eq!(words[3], "invalid (W16 up, W17 up)");
        let other = AddressSource::Eeprom.of_card("7I92");
        assert_eq!(other, "from EEPROM (first address jumper down, second up)");
    }

    #[test]
    fn question_writes_nothing() {
        let question = Identity::question();
        let operations = Operations::new(&question).map(Result::unwrap);
        let read = operations.map(|operation| {
            assert!(!operation.command.write);
            operation.command.data_len()
        });
        assert_eq!(read.sum::<usize>(), Identity::ANSWER);
    }

    proptest! {
        #[test]
        fn arbitrary_answers_never_panic(bytes in prop::collection::vec(any::<u8>(), Identity::ANSWER)) {
            let mut bytes: [u8; Identity::ANSWER] = bytes.try_into().unwrap();
            prop_assert_eq!(Identity::parse(&bytes).is_ok(), bytes[..2] == [0x07, 0x5A]);
            bytes[..2].copy_from_slice(&[0x07, 0x5A]);
            prop_assert!(Identity::parse(&bytes).is_ok());
        }
    }
}
