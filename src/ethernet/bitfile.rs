//! FPGA configurations as Xilinx bitfiles.

use alloc::format;
use alloc::string::{String, ToString};

use super::spartan6::{Multiboot, MultibootFeature, sync_at};
use crate::advice::{self, Advice, MesaError};

/// A bitfile whose header and configuration data have been checked.
///
/// The header is a list of fields: `a` design name, `b` part, `c` date, `d` time, `e` configuration
/// data (manual 7I97, "BITFILE FORMAT").
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bitfile<'a> {
    /// Name of the design, for example `TopEthernetHostMot2.ncd`.
    pub design: &'a str,
    /// The FPGA that it is for, for example `6slx9tqg144`.
    pub part: &'a str,
    /// Date of the build, as written by its author's tools.
    pub date: &'a str,
    /// Time of the build.
    pub time: &'a str,
    /// The data to load into the FPGA.
    pub configuration: &'a [u8],
}

/// Reason why a file is not a valid bitfile, or must not be written to a board.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BitfileError {
    /// The mark of a bitfile is missing.
    #[error("not a bitfile: it does not begin with the bitfile mark")]
    NoMark,
    /// The header is damaged, or the file is incomplete.
    #[error(
        "the bitfile is damaged at byte {at}: field '{}' {what}",
        char::from(*field)
    )]
    Damaged {
        /// The field.
        field: u8,
        /// Offset of the field.
        at: usize,
        /// The defect.
        what: &'static str,
    },
    /// The synchronisation word is missing: an FPGA would not load the data.
    #[error(
        "the configuration has no synchronisation word AA995566 in its first {searched} bytes; this is no Spartan-6 configuration"
    )]
    NoSync {
        /// Number of bytes searched.
        searched: usize,
    },
    /// The configuration is for another FPGA or another board, where it would not run, or would
    /// drive pins that it must not.
    #[error(
        "the configuration is for a {found}, and this is a {expected}: it would not start or not \
         answer any more, or its pins would drive what they must not"
    )]
    OtherBoard {
        /// FPGA or board that it is for.
        found: String,
        /// The board or FPGA that it was to be written to.
        expected: &'static str,
    },
    /// The file is made for several configurations in one memory. The boot block has the addresses
    /// of user configuration and fallback; a file that sets its own disables the fallback, or does
    /// not start.
    ///
    /// Manual: 7I97, "BITFILE FORMAT".
    #[error("a multiboot file, not a standard one: at byte {at} of its data it {what}")]
    Multiboot {
        /// Offset in the configuration.
        at: usize,
        /// The first multiboot feature.
        what: MultibootFeature,
    },
    /// The configuration is larger than its place in the flash memory.
    #[error("the configuration has {bytes} bytes, its place in the flash memory {room}")]
    TooLarge {
        /// Its size.
        bytes: usize,
        /// Size of its place.
        room: usize,
    },
}

impl MesaError for BitfileError {
    fn advice(&self) -> Option<Advice> {
        Some(match self {
            Self::NoMark => advice::GIVE_BIT_FILE,
            Self::Damaged { .. } => advice::GET_FILE_AGAIN,
            Self::Multiboot { .. } => advice::GIVE_STANDARD_BITFILE,
            Self::NoSync { .. } | Self::OtherBoard { .. } | Self::TooLarge { .. } => {
                advice::GET_FILE_FOR_BOARD
            }
        })
    }
}

const MARK: [u8; 13] = [
    0x00, 0x09, 0x0F, 0xF0, 0x0F, 0xF0, 0x0F, 0xF0, 0x0F, 0xF0, 0x00, 0x00, 0x01,
];

impl<'a> Bitfile<'a> {
    /// Parses a whole file.
    ///
    /// # Errors
    /// [`BitfileError::NoMark`], [`BitfileError::Damaged`] and [`BitfileError::NoSync`];
    /// [`BitfileError::Multiboot`] for an image of a memory with several configurations.
    pub fn parse(file: &'a [u8]) -> Result<Self, BitfileError> {
        let Some(rest) = file.strip_prefix(&MARK) else {
            no_multiboot(file)?;
            return Err(BitfileError::NoMark);
        };
        let mut fields = Fields { file, rest };
        let this = Self {
            design: fields.text(b'a')?,
            part: fields.text(b'b')?,
            date: fields.text(b'c')?,
            time: fields.text(b'd')?,
            configuration: fields.field(b'e', 4)?,
        };
        this.check_sync()?;
        Ok(this)
    }

    /// Upper limit of the padding before the synchronisation word.
    pub(super) const SYNC_WITHIN: usize = 256;

    /// True if a configuration begins in these bytes.
    pub(super) fn has_sync(head: &[u8]) -> bool {
        sync_at(head).is_some()
    }

    fn check_sync(&self) -> Result<(), BitfileError> {
        let searched = self.configuration.len().min(Self::SYNC_WITHIN);
        let head = self.configuration.get(..searched).unwrap_or(&[]);
        if Self::has_sync(head) {
            return Ok(());
        }
        Err(BitfileError::NoSync { searched })
    }

    /// Checks that the file holds a standard configuration, is for a board and the FPGA on it, and
    /// fits into its place.
    ///
    /// Several boards have the same FPGA, so the part does not distinguish them. The design name
    /// does, where it names a board (`7i97_7i77.ncd`, `seveni92.ncd`) or a host interface (Mesa's
    /// top levels: `TopPCIHostMot2.ncd`). A file whose design name contains neither
    /// (`TopEthernet16HostMot2.ncd`) cannot be distinguished from that of another board with the
    /// same interface.
    ///
    /// # Errors
    /// [`BitfileError::NoSync`], [`BitfileError::OtherBoard`], [`BitfileError::Multiboot`] and
    /// [`BitfileError::TooLarge`].
    pub fn check(
        &self,
        board: &'static str,
        part: &'static str,
        room: usize,
    ) -> Result<(), BitfileError> {
        self.check_sync()?;
        if !self.part.eq_ignore_ascii_case(part) {
            return Err(BitfileError::OtherBoard {
                found: self.part.to_string(),
                expected: part,
            });
        }
        self.check_design(board)?;
        no_multiboot(self.configuration)?;
        let bytes = self.configuration.len();
        if bytes > room {
            return Err(BitfileError::TooLarge { bytes, room });
        }
        Ok(())
    }

    fn check_design(&self, expected: &'static str) -> Result<(), BitfileError> {
        // Xilinx's tools append more to the name: `name.ncd;UserID=0xFFFFFFFF`.
        let name = self.design.split(['.', ';']).next().unwrap_or("");
        let name = SPELLED
            .iter()
            .fold(name.to_ascii_lowercase(), |name, (word, digit)| {
                name.replace(word, digit)
            });
        let named = |card: &&str| name.contains(card);
        // Names of daughter cards may appear beside the board's own.
        let is_own = name.contains(&expected.to_ascii_lowercase());
        let other = HOST_CARDS.iter().find(|card| named(card));
        let own = if ON_PCI.contains(&&*expected.to_ascii_lowercase()) {
            "toppci"
        } else {
            "topethernet"
        };
        let mut tops = INTERFACES.iter().filter(|(top, _)| *top != own);
        let interface = tops.find(|(top, _)| named(top));
        let found = match (other, interface) {
            (Some(card), _) if !is_own => card.to_string(),
            (_, Some((_, interface))) => format!("board on {interface}"),
            _ => return Ok(()),
        };
        Err(BitfileError::OtherBoard { found, expected })
    }
}

/// Refuses data for several configurations.
fn no_multiboot(data: &[u8]) -> Result<(), BitfileError> {
    Multiboot::find(data).map_or(Ok(()), |Multiboot { at, what }| {
        Err(BitfileError::Multiboot { at, what })
    })
}

/// Mesa's boards with an FPGA whose names have four characters, in lower case.
const HOST_CARDS: [&str; 28] = [
    "3x20", "4i65", "4i68", "4i69", "4i74", "5i20", "5i21", "5i22", "5i23", "5i24", "5i25", "5i26",
    "6i24", "6i25", "7i43", "7i60", "7i80", "7i90", "7i92", "7i93", "7i94", "7i95", "7i96", "7i97",
    "7i98", "7c80", "7c81", "6c51",
];

/// Boards whose FPGA is on the PCI bus itself, in lower case.
const ON_PCI: [&str; 5] = ["4i74", "5i24", "5i25", "6i24", "6i25"];

/// Names of Mesa's top levels for host interfaces, in lower case: their sources are public.
const INTERFACES: [(&str, &str); 7] = [
    ("topethernet", "Ethernet"),
    ("toppci", "PCI"),
    ("top9030", "PCI"),
    ("top9054", "PCI"),
    ("topepp", "the parallel port"),
    ("topgcspi", "SPI"),
    ("topusb", "USB"),
];

/// Digits as spelled in the names of Mesa's projects (`seveni92`).
const SPELLED: [(&str, &str); 5] = [
    ("three", "3"),
    ("four", "4"),
    ("five", "5"),
    ("six", "6"),
    ("seven", "7"),
];

/// The part of a file that is not parsed yet.
struct Fields<'a> {
    file: &'a [u8],
    rest: &'a [u8],
}

impl<'a> Fields<'a> {
    /// Offset of the rest in the file.
    fn at(&self) -> usize {
        self.file.len().saturating_sub(self.rest.len())
    }

    fn text(&mut self, field: u8) -> Result<&'a str, BitfileError> {
        let at = self.at();
        let bytes = self.field(field, 2)?;
        let text = bytes.split(|&byte| byte == 0).next().unwrap_or(&[]);
        let what = "holds no text";
        core::str::from_utf8(text).map_err(|_| BitfileError::Damaged { field, at, what })
    }

    /// A field: its letter, its length in `length_bytes` bytes (big endian), its content.
    fn field(&mut self, field: u8, length_bytes: usize) -> Result<&'a [u8], BitfileError> {
        let at = self.at();
        let damaged = |what| BitfileError::Damaged { field, at, what };
        let cut_off = || damaged("is cut off");
        let (&found, rest) = self.rest.split_first().ok_or_else(cut_off)?;
        if found != field {
            return Err(damaged("is not there"));
        }
        let (length, rest) = rest.split_at_checked(length_bytes).ok_or_else(cut_off)?;
        let length = length
            .iter()
            .fold(0_usize, |length, &byte| length << 8 | usize::from(byte));
        let (content, rest) = rest.split_at_checked(length).ok_or_else(cut_off)?;
        self.rest = rest;
        Ok(content)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec::Vec;
    use proptest::prelude::*;

    fn file(configuration: &[u8]) -> Vec<u8> {
        let mut file = MARK.to_vec();
        for (field, text) in [
            (b'a', "7i97_made_up.ncd\0"),
            (b'b', "6slx9tqg144\0"),
            (b'c', "2026/11/21\0"),
            (b'd', "07:30:00\0"),
        ] {
            file.push(field);
            file.extend((text.len() as u16).to_be_bytes());
            file.extend(text.as_bytes());
        }
        file.push(b'e');
        file.extend((configuration.len() as u32).to_be_bytes());
        file.extend(configuration);
        file
    }

    fn bitfile_part() -> &'static str {
        "6slx9tqg144"
    }

    fn configuration(len: usize) -> Vec<u8> {
        let mut data = alloc::vec![0xFF; 16];
        data.extend([0xAA, 0x99, 0x55, 0x66]);
        data.resize(len, 0x20);
        data
    }

    #[test]
    fn bitfile_has_design_part_date_and_configuration() {
        let bytes = file(&configuration(340_000));
        let bitfile = Bitfile::parse(&bytes).unwrap();
        assert_eq!(bitfile.design, "7i97_made_up.ncd");
        assert_eq!(bitfile.part, "6slx9tqg144");
        assert_eq!((bitfile.date, bitfile.time), ("2026/11/21", "07:30:00"));
        assert_eq!(bitfile.configuration.len(), 340_000);
        assert_eq!(bitfile.check("7I97", "6SLX9TQG144", 0x6_0000), Ok(()));
    }

    #[test]
    fn bitfile_that_would_brick_the_board_is_refused() {
        let bytes = file(&configuration(1000));
        let bitfile = Bitfile::parse(&bytes).unwrap();
        let error = bitfile.check("7I97", "6slx16ftg256", 0x6_0000).unwrap_err();
        let text = "for a 6slx9tqg144, and this is a 6slx16ftg256: ";
        assert!(error.to_string().contains(text), "{error}");
        let error = bitfile.check("7I97", "6slx9tqg144", 999).unwrap_err();
        assert_eq!(
            error,
            BitfileError::TooLarge {
                bytes: 1000,
                room: 999
            }
        );
        let bytes = file(&[0xFF; 1000]);
        let error = Bitfile::parse(&bytes).unwrap_err();
        assert_eq!(error, BitfileError::NoSync { searched: 256 });
        assert_eq!(Bitfile::parse(b"PNG"), Err(BitfileError::NoMark));
    }

    #[test]
    fn file_for_another_board_is_detected_by_its_design_name() {
        let data = configuration(100);
        let check = |design, board| {
            let bitfile = Bitfile {
                design,
                part: bitfile_part(),
                date: "",
                time: "",
                configuration: &data,
            };
            bitfile.check(board, bitfile_part(), 1000)
        };
        let own = [
            ("7I97", "7i97_7i77.ncd"),
            ("7I97", "SEVENI97;UserID=0xFFFFFFFF"),
            ("7I92", "seveni92.ncd"),
            ("7I92", "7i92_7i77_7i76x2_5i25_pins.ncd"),
            // Names that fit both boards.
            ("7I97", "TopEthernet16HostMot2.ncd;UserID=0xFFFFFFFF"),
            ("7I92", "TopEthernetHostMot2.ncd"),
            ("7I92", "pins_7i77_7i72.ncd"),
            ("7I92", ""),
        ];
        for (board, design) in own {
            assert_eq!(check(design, board), Ok(()), "{design} on a {board}");
        }
        let others = [
            ("7I97", "7i92_7i77.ncd", "7i92"),
            ("7I92", "7I97.ncd", "7i97"),
            ("7I92", "seveni97.ncd", "7i97"),
            ("7I97", "fivei25_7i77x2.ncd", "5i25"),
            ("7I92", "prob_rfx2_6i25.ncd;UserID=7", "6i25"),
        ];
        for (board, design, other) in others {
            let error = check(design, board).expect_err(design);
            let text = format!("for a {other}, and this is a {board}: ");
            assert!(error.to_string().contains(&text), "{design}: {error}");
        }
        for (design, interface) in [
            ("TopPCIHostMot2.ncd", "PCI"),
            ("topgcspihostmot2", "SPI"),
            ("Top9030HostMot2.ncd", "PCI"),
        ] {
            let error = check(design, "7I92").expect_err(design);
            let text = format!("for a board on {interface}, and this is a 7I92: ");
            assert!(error.to_string().contains(&text), "{design}: {error}");
        }
    }

    #[test]
    fn every_cut_and_every_swapped_field_is_noticed() {
        let bytes = file(&configuration(100));
        for len in 0..bytes.len() {
            assert!(Bitfile::parse(&bytes[..len]).is_err(), "{len} bytes");
        }
        let mut wrong = bytes.clone();
        wrong[MARK.len()] = b'b';
        let error = Bitfile::parse(&wrong).unwrap_err();
        let expected = BitfileError::Damaged {
            field: b'a',
            at: 13,
            what: "is not there",
        };
        assert_eq!(error, expected);
    }

    proptest! {
        #[test]
        fn damaged_file_never_panics_and_never_grows(
            damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
            len in any::<prop::sample::Index>(),
        ) {
            let mut bytes = file(&configuration(300));
            // In the header, where the lengths are.
            let header = bytes.len() - 280;
            for (at, byte) in damage {
                bytes[at.index(header)] = byte;
            }
            bytes.truncate(bytes.len() - len.index(64));
            if let Ok(bitfile) = Bitfile::parse(&bytes) {
                let text = bitfile.design.len() + bitfile.part.len();
                prop_assert!(text + bitfile.configuration.len() < bytes.len());
                let is_part = bitfile.part.eq_ignore_ascii_case(bitfile_part());
                let is_taken = bitfile.check("7I97", bitfile_part(), usize::MAX).is_ok();
                prop_assert!(is_part || !is_taken);
            }
        }

        #[test]
        fn arbitrary_bytes_never_panic(tail in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = Bitfile::parse(&tail);
            let mut bytes = MARK.to_vec();
            bytes.extend(&tail);
            let _ = Bitfile::parse(&bytes);
        }
    }
}
