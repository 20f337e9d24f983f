//! The words of the `loadrt` line.

use std::net::{Ipv4Addr, SocketAddrV4};

use crate::ffi;
use mesa_hal::{ParseError, Settings};

/// Port of the boards.
const PORT: u16 = 27_181;

/// A board of the `loadrt` line.
#[derive(Clone, Debug)]
pub(crate) struct BoardParameters {
    /// Its address.
    pub address: SocketAddrV4,
    /// Its word of `config=`.
    pub config: String,
    /// The same, as settings.
    pub settings: Settings,
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
    #[error("board_ip={word}: not an IP address; expected four numbers, for example 10.10.10.10")]
    Address {
        /// The word.
        word: String,
    },
    /// An address twice.
    #[error("board_ip={word}: the address is there twice")]
    Twice {
        /// The word.
        word: String,
    },
    /// More configurations than boards.
    #[error("config={word}: there are more words in config= than boards in board_ip=")]
    Surplus {
        /// The first word without a board.
        word: String,
    },
    /// Error in a configuration.
    #[error("config= of board_ip={board}: {error}")]
    Config {
        /// The address of the board.
        board: String,
        /// The error, with the word.
        error: ParseError,
    },
}

/// Takes the words of the `loadrt` line.
pub(crate) fn take() -> Result<Vec<BoardParameters>, WordError> {
    let [boards, configs] = ffi::take_parameters();
    parse(&boards, &configs)
}

fn parse(boards: &[String], configs: &[String]) -> Result<Vec<BoardParameters>, WordError> {
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
        if parsed.iter().any(|board| board.address == address) {
            return Err(WordError::Twice { word: word.into() });
        }
        let config = configs.get(number).map_or("", String::as_str);
        let settings = Settings::from_hostmot2(config).map_err(|error| WordError::Config {
            board: word.into(),
            error,
        })?;
        parsed.push(BoardParameters {
            address,
            config: config.into(),
            settings,
        });
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
        let parsed = parse(&words(boards), &words(configs));
        parsed.expect_err("an error").to_string()
    }

    #[test]
    fn each_board_gets_its_configuration() {
        let boards = words(&["10.10.10.10", "127.0.0.1:1234", "10.10.10.12"]);
        let configs = words(&[
            "num_encoders=3 sserial_port_0=00xxxxxx",
            "sserial_port_0=xx",
        ]);
        let parsed = parse(&boards, &configs).expect("words");
        let ports: Vec<_> = parsed.iter().map(|board| board.address.port()).collect();
        assert_eq!(ports, [27_181, 1234, 27_181]);
        assert_eq!(parsed[0].settings.instances[&Gtag::ENCODER], 3);
        assert_eq!(parsed[1].settings.instances[&Gtag::SSERIAL], 0);
        assert!(parsed[2].settings.serial_ports.is_empty());
    }

    #[test]
    fn an_error_names_the_word() {
        assert!(error(&[], &[]).starts_with("board_ip= is missing"));
        assert!(error(&["10.10.10"], &[]).starts_with("board_ip=10.10.10: not an IP address"));
        assert!(error(&["7i97"], &[]).contains("board_ip=7i97:"));
        let twice = error(&["10.10.10.10", "10.10.10.10:27181"], &[]);
        assert!(twice.starts_with("board_ip=10.10.10.10:27181: "), "{twice}");
        assert!(error(&["10.10.10.10"], &["", "num_leds=1"]).starts_with("config=num_leds=1: "));
        let word = error(&["10.10.10.10"], &["num_encoder=6"]);
        assert!(word.contains("num_encoder=6"), "{word}");
    }

    proptest! {
        #[test]
        fn arbitrary_words_never_panic(boards: Vec<String>, configs: Vec<String>) {
            let _ = parse(&boards, &configs);
        }
    }
}
