//! Firmware files of remotes, and the check that a file is for the card.

use super::advice;
use mesa_hal::sslbp::RemoteName;
use mesa_hal::{Advice, MesaError};

/// Maximum length of a file, in bytes.
const LARGEST: usize = 4 << 20;

/// The firmware of a remote in the format of Mesa's `.BIN` files: an image of its flash memory from
/// offset 0 on. The first block belongs to the bootloader, and is never written.
///
/// No field of such a file is known to contain the card that it is for. The card's name therefore
/// has to be in the file's name, as in Mesa's files (`7I77.BIN`; manual 7I77, "RPD, WPD, AND
/// UFLBP"), or in its contents.
///
/// FACTS 1.6.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FirmwareFile {
    bytes: Vec<u8>,
    names_card: bool,
}

/// Error of a file that is no firmware for the card.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FirmwareError {
    /// The file is empty or too long.
    #[error("the file has {bytes} bytes, expected 1 to {LARGEST}")]
    Length {
        /// Length of the file.
        bytes: usize,
    },
    /// The file is of another kind.
    #[error("the file is {kind}, expected the raw image that Mesa's `.BIN` files are")]
    Kind {
        /// Kind of the file.
        kind: &'static str,
        /// The next step for this kind.
        advice: Advice,
    },
    /// The file is for another card.
    #[error("the file is for a {found}, and the card is a {card}")]
    OtherCard {
        /// Card that the file names.
        found: RemoteName,
        /// Card to be updated.
        card: RemoteName,
    },
    /// The file does not name its card.
    #[error("neither the file's name nor its contents show that it is for a {card}")]
    Unnamed {
        /// Card to be updated.
        card: RemoteName,
    },
}

impl MesaError for FirmwareError {
    fn advice(&self) -> Option<Advice> {
        Some(match self {
            Self::Length { .. } => advice::TAKE_BIN_FILE,
            Self::Kind { advice, .. } => *advice,
            Self::OtherCard { .. } => advice::TAKE_OTHER_FILE,
            Self::Unnamed { .. } => advice::NAME_FILE,
        })
    }
}

/// Other kinds of files: first bytes, name of the kind, advice.
const KINDS: &[(&[u8], &str, Advice)] = &[
    (
        &[0x00, 0x09, 0x0F, 0xF0],
        "an FPGA bitfile",
        advice::WRITE_BITFILE,
    ),
    (b"\x7FELF", "an ELF program", advice::CONVERT_FILE),
    (b"PK\x03\x04", "a ZIP archive", advice::UNPACK_FILE),
    (b"\x1F\x8B", "compressed", advice::UNPACK_FILE),
    (b":0", "in Intel's hex format", advice::CONVERT_FILE),
    (b":1", "in Intel's hex format", advice::CONVERT_FILE),
    (b":2", "in Intel's hex format", advice::CONVERT_FILE),
    (b"S0", "in Motorola's S format", advice::CONVERT_FILE),
];

impl FirmwareFile {
    /// Checks the contents of the file called `file_name`, which is given without its path.
    ///
    /// # Errors
    /// [`FirmwareError`]: the file is not for `card`, or does not name its card.
    pub fn new(
        file_name: &str,
        contents: Vec<u8>,
        card: RemoteName,
    ) -> Result<Self, FirmwareError> {
        let bytes = contents.len();
        if !(1..=LARGEST).contains(&bytes) {
            return Err(FirmwareError::Length { bytes });
        }
        let mut kinds = KINDS.iter();
        if let Some(&(_, kind, advice)) = kinds.find(|(magic, ..)| contents.starts_with(magic)) {
            return Err(FirmwareError::Kind { kind, advice });
        }
        let name = file_name.to_ascii_uppercase();
        let card = RemoteName(card.0.map(|c| c.to_ascii_uppercase()));
        let named = names(name.as_bytes(), card);
        // The contents reveal a file with a wrong name.
        let inside = names(&contents, card);
        match (named, inside) {
            (Named::Other(found), _) | (_, Named::Other(found)) => {
                Err(FirmwareError::OtherCard { found, card })
            }
            (Named::No, Named::No) => Err(FirmwareError::Unnamed { card }),
            (Named::Same, _) | (_, Named::Same) => Ok(Self {
                bytes: contents,
                names_card: inside == Named::Same,
            }),
        }
    }

    /// True if the contents name the card. If not, only the file's name indicates its card.
    pub const fn names_card(&self) -> bool {
        self.names_card
    }

    /// The image, from offset 0 of the flash memory on.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }
}

/// The card that a text names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Named {
    Same,
    Other(RemoteName),
    No,
}

/// Searches for names of Mesa's cards: 7I77, 8I20. The expected one takes precedence over others.
fn names(text: &[u8], card: RemoteName) -> Named {
    let windows = || text.windows(4).filter_map(|four| four.try_into().ok());
    if windows().any(|four: [u8; 4]| four == card.0) {
        return Named::Same;
    }
    let is_card = |four: &[u8; 4]| {
        matches!(four, [b'7' | b'8', b'I', tens, ones]
            if tens.is_ascii_digit() && ones.is_ascii_digit())
    };
    match windows().find(is_card) {
        Some(other) => Named::Other(RemoteName(other)),
        None => Named::No,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CARD: RemoteName = RemoteName(*b"7I77");

    fn take(name: &str, contents: &[u8]) -> Result<FirmwareFile, FirmwareError> {
        FirmwareFile::new(name, contents.to_vec(), CARD)
    }

    #[test]
    fn file_names_its_card_by_its_name_or_by_its_contents() {
        let named = |name, contents| take(name, contents).map(|firmware| firmware.names_card());
        assert_eq!(named("7I77.BIN", &[1, 2]), Ok(false));
        assert_eq!(named("7I77.BIN", b"..7I77.."), Ok(true));
        assert!(take("7i77io-v14.bin", &[1, 2]).is_ok());
        assert!(take("new.bin", b"..7I77..").is_ok());
        let unnamed = take("new.bin", &[1, 2]);
        assert_eq!(unnamed, Err(FirmwareError::Unnamed { card: CARD }));
    }

    #[test]
    fn file_for_another_card_is_refused_whatever_it_is_called() {
        let found = RemoteName(*b"8I20");
        let other = Err(FirmwareError::OtherCard { found, card: CARD });
        assert_eq!(take("8I20T.BIN", &[1, 2]), other);
        assert_eq!(take("7I77.BIN", b"..8I20.."), other);
        assert_eq!(take("new.bin", b"..8I20.."), other);
        // The expected name beside another one, as in a text about both cards.
        assert!(take("7I77.BIN", b"8I20 or 7I77").is_ok());
    }

    #[test]
    fn other_kinds_of_files_are_refused_by_name() {
        for start in KINDS {
            let refused = take("7I77.BIN", start.0);
            assert!(matches!(refused, Err(FirmwareError::Kind { .. })));
        }
        assert_eq!(
            take("7I77.BIN", &[]),
            Err(FirmwareError::Length { bytes: 0 })
        );
        let long = FirmwareFile::new("7I77.BIN", vec![0; LARGEST + 1], CARD);
        assert!(matches!(long, Err(FirmwareError::Length { .. })));
    }
}
