//! A file with the firmware of a remote, and whether it is for this card.

use mesa_hal::sslbp::RemoteName;

/// The most bytes of a file.
const LARGEST: usize = 4 << 20;

/// The firmware of a remote, as Mesa's `.BIN` files have it: an image of its flash memory from offset 0
/// on. Its first block is the bootloader's, and is never written.
///
/// Nothing in such a file is known to say which card it is for, so the file's own name has to, as those
/// of Mesa do (`7I77.BIN`; manual 7I77, "RPD, WPD, AND UFLBP"), or its contents.
///
/// FACTS 1.6.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Firmware {
    bytes: Vec<u8>,
    names_card: bool,
}

/// Why a file is no firmware for a card.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FirmwareError {
    /// It is empty, or too long.
    #[error(
        "the file has {bytes} bytes, expected 1 to {LARGEST}; take the `.BIN` file for the card"
    )]
    Length {
        /// Its length.
        bytes: usize,
    },
    /// It is another kind of file.
    #[error("the file is {kind}, expected the raw image that Mesa's `.BIN` files are; {hint}")]
    Kind {
        /// What it looks like.
        kind: &'static str,
        /// What to do with it.
        hint: &'static str,
    },
    /// It is for another card.
    #[error("the file is for a {found}, and this is a {card}; take the file for this card")]
    OtherCard {
        /// The card that it names.
        found: RemoteName,
        /// The card that is to be updated.
        card: RemoteName,
    },
    /// It does not say which card it is for.
    #[error(
        "neither the file's name nor its contents say which card it is for; if it is for a {card}, give \
         it a name that begins with {card}, as Mesa's files have"
    )]
    Unnamed {
        /// The card that is to be updated.
        card: RemoteName,
    },
}

const TO_BINARY: &str = "convert it to a raw binary";

/// What other files begin with, what they are, and what to do with them.
const KINDS: &[(&[u8], &str, &str)] = &[
    (
        &[0x00, 0x09, 0x0F, 0xF0],
        "an FPGA bitfile",
        "that is for `mesa flash`",
    ),
    (b"\x7FELF", "an ELF program", TO_BINARY),
    (
        b"PK\x03\x04",
        "a ZIP archive",
        "unpack it and take the file for this card",
    ),
    (
        b"\x1F\x8B",
        "compressed",
        "unpack it and take the file for this card",
    ),
    (b":0", "in Intel's hex format", TO_BINARY),
    (b":1", "in Intel's hex format", TO_BINARY),
    (b":2", "in Intel's hex format", TO_BINARY),
    (b"S0", "in Motorola's S format", TO_BINARY),
];

impl Firmware {
    /// Takes the contents of the file that is called `file_name`, without its path.
    ///
    /// # Errors
    /// [`FirmwareError`]: it is not for `card`, or does not say so.
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
        if let Some(&(_, kind, hint)) = kinds.find(|(magic, ..)| contents.starts_with(magic)) {
            return Err(FirmwareError::Kind { kind, hint });
        }
        let name = file_name.to_ascii_uppercase();
        let card = RemoteName(card.0.map(|c| c.to_ascii_uppercase()));
        let named = names(name.as_bytes(), card);
        // A file that was given the wrong name still says what it is.
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

    /// Whether its contents name the card. If not, only the name of the file says what it is for.
    pub const fn names_card(&self) -> bool {
        self.names_card
    }

    /// Its bytes, from offset 0 of the flash memory on.
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

/// Looks for the names of Mesa's cards: 7I77, 8I20. The one that is expected counts before others.
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

    fn take(name: &str, contents: &[u8]) -> Result<Firmware, FirmwareError> {
        Firmware::new(name, contents.to_vec(), CARD)
    }

    #[test]
    fn a_file_names_its_card_by_its_name_or_by_its_contents() {
        let named = |name, contents| take(name, contents).map(|firmware| firmware.names_card());
        assert_eq!(named("7I77.BIN", &[1, 2]), Ok(false));
        assert_eq!(named("7I77.BIN", b"..7I77.."), Ok(true));
        assert!(take("7i77io-v14.bin", &[1, 2]).is_ok());
        assert!(take("new.bin", b"..7I77..").is_ok());
        let unnamed = take("new.bin", &[1, 2]);
        assert_eq!(unnamed, Err(FirmwareError::Unnamed { card: CARD }));
    }

    #[test]
    fn a_file_for_another_card_is_refused_whatever_it_is_called() {
        let found = RemoteName(*b"8I20");
        let other = Err(FirmwareError::OtherCard { found, card: CARD });
        assert_eq!(take("8I20T.BIN", &[1, 2]), other);
        assert_eq!(take("7I77.BIN", b"..8I20.."), other);
        assert_eq!(take("new.bin", b"..8I20.."), other);
        // Its own name beside that of another, as in a text about both.
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
        let long = Firmware::new("7I77.BIN", vec![0; LARGEST + 1], CARD);
        assert!(matches!(long, Err(FirmwareError::Length { .. })));
    }
}
