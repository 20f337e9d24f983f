//! The words of the `loadrt` line.

use std::net::{Ipv4Addr, SocketAddrV4};

use crate::config::{Config, ConfigError};
use crate::interface::Interface;
use core::fmt;
use mesa_hal::ParseError;
use mesa_pci::{PciDevice, SYSFS};
use std::path::Path;

/// Port of the boards.
const PORT: u16 = 27_181;

/// Where a board is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum BoardPlace {
    /// On the network.
    Ethernet(SocketAddrV4),
    /// On the PCI bus.
    Pci(PciDevice),
    /// In a folder of the user's in place of /sys.
    InFolder(PciDevice),
}

impl fmt::Display for BoardPlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ethernet(address) => write!(f, "board_ip={address}"),
            Self::Pci(device) | Self::InFolder(device) => {
                write!(f, "{} at {}", device.board().name, device.address())
            }
        }
    }
}

/// A board of the `loadrt` line.
#[derive(Clone, Debug)]
pub(crate) struct BoardParameters {
    /// Its place.
    pub place: BoardPlace,
    /// Its word of `config=`.
    pub words: String,
    /// The same, parsed.
    pub config: Config,
}

/// Error in the words of the `loadrt` line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum WordError {
    /// No board.
    #[error(
        "board_ip= is missing: name the address of each board, for example board_ip=10.10.10.10"
    )]
    NoBoard,
    /// Not an address.
    #[error("board_ip={}: not an IP address; expected four numbers, for example 10.10.10.10", ParseError::shortened(.word))]
    Address {
        /// The word.
        word: String,
    },
    /// An address twice.
    #[error("board_ip={}: the address is there twice", ParseError::shortened(.word))]
    Twice {
        /// The word.
        word: String,
    },
    /// More configurations than boards.
    #[error(
        "config={}: there is no board for this word: a comma begins the words of the next board, and \
         words of the same board are separated by spaces",
        ParseError::shortened(.word)
    )]
    Surplus {
        /// The first word without a board.
        word: String,
    },
    /// Addresses for a component that finds its boards.
    #[error(
        "board_ip={}: mesa_pci takes the boards on the PCI bus in the order of their addresses", ParseError::shortened(.word))]
    NotOnPci {
        /// The word.
        word: String,
    },
    /// No board on the PCI bus.
    #[error("no board on the PCI bus below {root}: `mesa list --pci` shows what is there")]
    NoPciBoard {
        /// `/sys`, or the folder in its place.
        root: String,
    },
    /// More boards than a component takes.
    #[error(
        "{count} boards on the PCI bus, and at most {} are driven",
        crate::MAX_BOARDS
    )]
    TooMany {
        /// Number of boards.
        count: usize,
    },
    /// The folder of the bus cannot be read.
    #[error("sysfs={root}: {error}")]
    Sysfs {
        /// The folder.
        root: String,
        /// Why.
        error: String,
    },
    /// A word with another value than it takes.
    #[error("{name}={word}: expected {expected}")]
    Value {
        /// Name of the word.
        name: &'static str,
        /// Its value.
        word: String,
        /// The values that it can have.
        expected: &'static str,
    },
    /// Error in a configuration.
    #[error("config= of {board}: {error}")]
    Config {
        /// The address of the board.
        board: String,
        /// The error, with the word.
        error: ConfigError,
    },
}

/// The words of the `loadrt` line, each with its values.
#[derive(Clone, Debug, Default)]
pub(crate) struct Words {
    /// `board_ip=`.
    pub boards: Vec<String>,
    /// `config=`.
    pub configs: Vec<String>,
    /// `sysfs=`.
    pub sysfs: Vec<String>,
    /// `board_rtnet=`.
    pub networks: Vec<String>,
    /// `firewall=`.
    pub firewalls: Vec<String>,
    /// `trace=`.
    pub trace: i32,
}

/// Cycles of `trace=`: ten seconds, usually.
const TRACE: core::ops::RangeInclusive<usize> = 0..=10_000;

impl Words {
    /// The number of cycles whose words on the bus are kept, and printed when an exchange fails.
    pub fn trace(&self) -> Result<usize, WordError> {
        let cycles = usize::try_from(self.trace).ok();
        let cycles = cycles.filter(|cycles| TRACE.contains(cycles));
        cycles.ok_or_else(|| WordError::Value {
            name: "trace",
            word: self.trace.to_string(),
            expected: "a number of cycles, 0 to 10000",
        })
    }
}

/// Parses the words of the `loadrt` line.
pub(crate) fn parse(
    interface: Interface,
    words: &Words,
) -> Result<Vec<BoardParameters>, WordError> {
    let Words {
        boards,
        configs,
        sysfs,
        networks,
        firewalls,
        trace: _,
    } = words;
    check_network(networks, firewalls)?;
    match interface {
        Interface::Ethernet => on_network(boards, configs),
        Interface::Pci => {
            if let Some(word) = boards.iter().find(|word| !word.is_empty()) {
                return Err(WordError::NotOnPci { word: word.clone() });
            }
            match sysfs.first() {
                None => on_pci(SYSFS, BoardPlace::Pci, configs),
                Some(folder) => on_pci(folder, BoardPlace::InFolder, configs),
            }
        }
    }
}

/// Checks `board_rtnet=` and `firewall=`, which hm2_eth has for its network. Here the network is
/// that of the kernel, and its firewall stays as it is.
fn check_network(networks: &[String], firewalls: &[String]) -> Result<(), WordError> {
    let is_posix = |word: &&String| word.is_empty() || *word == "posix";
    let other = |name, expected, word: &String| WordError::Value {
        name,
        word: word.clone(),
        expected,
    };
    if let Some(word) = networks.iter().find(|word| !is_posix(word)) {
        let expected =
            "posix, because this component drives a board over the kernel's own network alone";
        return Err(other("board_rtnet", expected, word));
    }
    let is_known = |word: &&String| ["", "auto", "iptables", "nft", "none"].contains(&&***word);
    if let Some(word) = firewalls.iter().find(|word| !is_known(word)) {
        let expected = "auto, iptables, nft or none; all leave the firewall as it is";
        return Err(other("firewall", expected, word));
    }
    Ok(())
}

/// The boards on the PCI bus, each with its configuration.
fn on_pci(
    root: &str,
    place: fn(PciDevice) -> BoardPlace,
    configs: &[String],
) -> Result<Vec<BoardParameters>, WordError> {
    let found = mesa_pci::search(Path::new(root)).map_err(|error| WordError::Sysfs {
        root: root.into(),
        error: error.to_string(),
    })?;
    if found.is_empty() {
        return Err(WordError::NoPciBoard { root: root.into() });
    }
    if found.len() > crate::MAX_BOARDS {
        return Err(WordError::TooMany { count: found.len() });
    }
    if let Some(word) = configs.get(found.len()) {
        return Err(WordError::Surplus { word: word.clone() });
    }
    let boards = found.into_iter().enumerate();
    boards
        .map(|(number, device)| BoardParameters::new(place(device), configs, number))
        .collect()
}

impl BoardParameters {
    /// The board with a number, and its word of `config=`.
    fn new(place: BoardPlace, configs: &[String], number: usize) -> Result<Self, WordError> {
        let words = configs.get(number).map_or("", String::as_str);
        let config = Config::parse(words).map_err(|error| WordError::Config {
            board: place.to_string(),
            error,
        })?;
        Ok(Self {
            place,
            words: words.into(),
            config,
        })
    }
}

fn on_network(boards: &[String], configs: &[String]) -> Result<Vec<BoardParameters>, WordError> {
    if boards.iter().all(String::is_empty) {
        return Err(WordError::NoBoard);
    }
    if let Some(word) = configs.get(boards.len()) {
        return Err(WordError::Surplus { word: word.clone() });
    }
    let mut parsed: Vec<BoardParameters> = Vec::with_capacity(boards.len());
    for (number, word) in boards.iter().enumerate() {
        let word = word.trim();
        let address = address(word).ok_or_else(|| WordError::Address { word: word.into() })?;
        let place = BoardPlace::Ethernet(address);
        if parsed.iter().any(|board| board.place == place) {
            return Err(WordError::Twice { word: word.into() });
        }
        parsed.push(BoardParameters::new(place, configs, number)?);
    }
    Ok(parsed)
}

/// An address, with its port if that is not the usual one.
fn address(word: &str) -> Option<SocketAddrV4> {
    let with_port = word.parse().ok();
    with_port.or_else(|| Some(SocketAddrV4::new(word.parse::<Ipv4Addr>().ok()?, PORT)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesa_hal::hostmot2::Gtag;
    use proptest::prelude::*;

    fn words(words: &[&str]) -> Vec<String> {
        words.iter().map(|&word| word.to_owned()).collect()
    }

    fn error(boards: &[&str], configs: &[&str]) -> String {
        let parsed = on_network(&words(boards), &words(configs));
        parsed.expect_err("an error").to_string()
    }

    #[test]
    fn each_board_gets_its_configuration() {
        let boards = words(&["10.10.10.10", "127.0.0.1:1234", "10.10.10.12"]);
        let configs = words(&[
            "num_encoders=3 sserial_port_0=00xxxxxx",
            "sserial_port_0=xx",
        ]);
        let parsed = on_network(&boards, &configs).expect("words");
        let places: Vec<_> = parsed.iter().map(|board| board.place.to_string()).collect();
        let expected = ["10.10.10.10:27181", "127.0.0.1:1234", "10.10.10.12:27181"];
        assert_eq!(
            places,
            expected.map(|address| format!("board_ip={address}"))
        );
        assert_eq!(parsed[0].config.settings.instances[&Gtag::ENCODER], 3);
        assert_eq!(parsed[1].config.settings.instances[&Gtag::SSERIAL], 0);
        assert!(parsed[2].config.settings.serial_ports.is_empty());
    }

    #[test]
    fn error_names_the_word() {
        assert!(error(&[], &[]).starts_with("board_ip= is missing"));
        assert!(error(&["10.10.10"], &[]).starts_with("board_ip=10.10.10: not an IP address"));
        assert!(error(&["7i97"], &[]).contains("board_ip=7i97:"));
        let twice = error(&["10.10.10.10", "10.10.10.10:27181"], &[]);
        assert!(twice.starts_with("board_ip=10.10.10.10:27181: "), "{twice}");
        let comma = error(&["10.10.10.10"], &["num_encoders=1", "num_leds=1"]);
        assert!(comma.starts_with("config=num_leds=1: "), "{comma}");
        assert!(comma.contains("separated by spaces"), "{comma}");
        let word = error(&["10.10.10.10"], &["num_encoder=6"]);
        assert!(word.contains("num_encoder=6"), "{word}");
    }

    #[test]
    fn words_of_hm2_eth_for_its_network_are_taken() {
        for (networks, firewalls) in [
            (&[][..], &["auto"][..]),
            (&["posix"], &["iptables"]),
            (&["posix", "posix"], &["nft"]),
            (&["", "posix"], &["none"]),
        ] {
            assert_eq!(check_network(&words(networks), &words(firewalls)), Ok(()));
        }
        for (networks, firewalls, said) in [
            (
                &["posix", "evl"][..],
                &[][..],
                "board_rtnet=evl: expected posix, ",
            ),
            (
                &[],
                &["ufw"],
                "firewall=ufw: expected auto, iptables, nft or none",
            ),
        ] {
            let error = check_network(&words(networks), &words(firewalls));
            let error = error.expect_err(said).to_string();
            assert!(error.starts_with(said), "{error}");
        }
    }

    proptest! {
        #[test]
        fn arbitrary_words_never_panic(boards: Vec<String>, configs: Vec<String>) {
            let _ = on_network(&boards, &configs);
        }
    }
}
