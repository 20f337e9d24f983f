//! Terminals: their short form, the card that they are on, and as a person types them.

use std::fmt::{self, Display};

use mesa_hal::RemoteId;
use mesa_hal::hal::{PinInfo, Place};

/// Connector, pins and signals; a connector with several pins is named once: `TB1 pin 1, 2, 4 QA0,
/// /QA0, QB0`.
pub fn short(place: &Place) -> String {
    let mut text = String::new();
    let mut connector = "";
    for terminal in place.terminal.split(", ") {
        let (before, pin) = terminal.rsplit_once(' ').unwrap_or(("", terminal));
        let is_same = !before.is_empty() && before == connector;
        let separator = if text.is_empty() { "" } else { ", " };
        text += separator;
        text += if is_same { pin } else { terminal };
        connector = before;
    }
    format!("{text} {}", place.signal).trim().to_owned()
}

/// A pin's terminals and signals with their card, `TB8 pin 20 OUTPUT3 of 7i77.0.0`, because several
/// cards have a TB8; empty for a pin without a terminal.
pub fn on_card(info: &PinInfo) -> String {
    match short(&info.place) {
        place if place.is_empty() => place,
        place => format!("{place} of {}", card(&info.name)),
    }
}

/// The terminals of several pins, card by card: `TB8 pin 17, 18 of 7i77.0.0; TB2 pin 1 of
/// 7i77.0.1`.
pub fn on_cards<'a>(infos: impl Iterator<Item = &'a PinInfo>) -> String {
    let mut cards: Vec<(String, Vec<Place>)> = Vec::new();
    for info in infos {
        let card = card(&info.name);
        let place = Place::clone(&info.place);
        match cards.iter_mut().find(|(known, _)| *known == card) {
            Some((_, places)) => places.push(place),
            None => cards.push((card, vec![place])),
        }
    }
    let cards = cards.into_iter().map(|(card, places)| {
        let place = Place {
            signal: String::new(),
            ..places.into_iter().collect()
        };
        format!("{} of {card}", short(&place))
    });
    cards.collect::<Vec<_>>().join("; ")
}

/// The card in a pin's name: the remote that the pin belongs to, else the board.
pub fn card(name: &str) -> String {
    let parts: Vec<&str> = name.split('.').collect();
    let own = parts.windows(3).find(|parts| remote_of(parts).is_some());
    let board = || parts.get(..2).unwrap_or(&parts);
    own.unwrap_or_else(board).join(".")
}

/// Port and channel of the remote in a pin's name, which follow its card (`7i77.0.0.output-03`).
pub fn remote(name: &str) -> Option<RemoteId> {
    let parts: Vec<&str> = name.split('.').collect();
    parts.windows(3).find_map(remote_of)
}

fn remote_of(parts: &[&str]) -> Option<RemoteId> {
    let [card, port, channel] = parts else {
        return None;
    };
    let id = RemoteId::new(port.parse().ok()?, channel.parse().ok()?);
    card.parse::<u32>().is_err().then_some(id)
}

/// The letters at the start of a signal.
fn letters_of(signal: &str) -> &str {
    let end = signal.find(|letter: char| !letter.is_ascii_alphabetic());
    &signal[..end.unwrap_or(signal.len())]
}

/// A terminal or a signal as a person types it: `TB8-20`, `TB8.20`, `TB8 pin 20` or `OUTPUT3`,
/// followed by ` of CARD` if several cards have it. Case is ignored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Typed {
    place: String,
    card: Option<String>,
}

impl From<&str> for Typed {
    fn from(text: &str) -> Self {
        let text = text.trim().to_lowercase();
        let (place, card) = match text.split_once(" of ") {
            Some((place, card)) => (place.trim(), Some(card.trim().to_owned())),
            None => (&*text, None),
        };
        Self {
            place: place.to_owned(),
            card,
        }
    }
}

impl Display for Typed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.place)
    }
}

impl Typed {
    /// True if a pin is at this terminal, or has this signal.
    pub fn fits(&self, info: &PinInfo) -> bool {
        let is_here = |card: &String| self::card(&info.name).to_lowercase().ends_with(card);
        let Place { terminal, signal } = &*info.place;
        let mut signals = signal.split(", ").map(str::to_lowercase);
        let mut terminals = terminal.split(", ");
        // An output has two signals, `OUT0-` and `OUT0+`: either is meant without its sign.
        let fits = signals.any(|signal| {
            signal == self.place || signal.trim_end_matches(['-', '+']) == self.place
        }) || terminals.any(|terminal| self.is_terminal(&terminal.to_lowercase()));
        !self.place.is_empty() && fits && self.card.as_ref().is_none_or(is_here)
    }

    /// True if a pin has a signal of the same letters, some of which may be left out at the end:
    /// `OUT0` is like `OUTPUT0`.
    pub fn is_alike(&self, info: &PinInfo) -> bool {
        let own = letters_of(&self.place);
        let is_like = |signal: &str| {
            let signal = signal.to_lowercase();
            let letters = letters_of(&signal);
            let number = signal[letters.len()..].starts_with(|next: char| next.is_ascii_digit());
            number && (letters.starts_with(own) || own.starts_with(letters) && !letters.is_empty())
        };
        !own.is_empty() && info.place.signal.split(", ").any(is_like)
    }

    /// True for the form of a terminal: a connector and the number of a pin.
    pub fn is_terminal_form(&self) -> bool {
        let number = self.place.rsplit(['-', '.', ' ']).next();
        let connector = self
            .place
            .trim_end_matches(|end: char| end.is_ascii_digit());
        let is_connector = ["tb", "p", "db", "j"].iter().any(|kind| {
            let rest = connector.strip_prefix(kind);
            rest.is_some_and(|rest| rest.starts_with(|first: char| first.is_ascii_digit()))
        });
        is_connector && number.is_some_and(|number| number.parse::<u16>().is_ok())
    }

    fn is_terminal(&self, terminal: &str) -> bool {
        let Some((connector, pin)) = terminal.rsplit_once(" pin ") else {
            return terminal == self.place;
        };
        let rest = self.place.strip_prefix(connector);
        rest.is_some_and(|rest| {
            let number = [" pin ", "-", ".", " "].iter();
            let mut number = number.filter_map(|separator| rest.strip_prefix(separator));
            number.any(|number| number.trim() == pin)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn card_is_that_of_the_remote_or_the_board() {
        for (name, card, remote) in [
            ("hm2_7i92.0.7i77.0.1.analogout0", "7i77.0.1", Some((0, 1))),
            ("hm2_7i97.0.pwmgen.02.value", "hm2_7i97.0", None),
            (
                "hm2_7i97.0.7i72.0.3.output-47-invert",
                "7i72.0.3",
                Some((0, 3)),
            ),
            ("7i77.0.0.output-03", "7i77.0.0", Some((0, 0))),
            ("enable", "enable", None),
        ] {
            assert_eq!(super::card(name), card);
            let remote = remote.map(|(port, channel)| RemoteId::new(port, channel));
            assert_eq!(super::remote(name), remote, "{name}");
        }
    }

    #[test]
    fn connector_is_named_once() {
        for (terminal, signal, expected) in [
            ("", "", ""),
            ("TB8 pin 3", "INPUT2", "TB8 pin 3 INPUT2"),
            (
                "TB1 pin 1, TB1 pin 2, TB2 pin 4",
                "A, /A",
                "TB1 pin 1, 2, TB2 pin 4 A, /A",
            ),
            (
                "P1 pin 11, DB25 pin 6",
                "IO43",
                "P1 pin 11, DB25 pin 6 IO43",
            ),
        ] {
            let place = Place {
                terminal: terminal.to_owned(),
                signal: signal.to_owned(),
            };
            assert_eq!(short(&place), expected);
        }
    }
}
