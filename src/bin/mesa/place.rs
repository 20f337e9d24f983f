//! Terminals in few words.

use mesa_hal::hal::{PinInfo, Place};

use crate::pattern::Pattern;

/// What of an encoder its signals feed; nothing else of it is at a terminal of its own.
const FED_BY: [(&str, &str); 3] = [
    ("QA", " rawcounts count position velocity input-a "),
    ("QB", " rawcounts count position velocity input-b "),
    ("IDX", " index-enable input-index "),
];

/// Where a pin is, as far as a pattern means it: all of its place if it means its name; if it means
/// terminals or signals, these. `None` if it means neither, or signals that do not feed this pin.
pub fn meant(info: &PinInfo, pattern: &Pattern) -> Option<Place> {
    let Place { terminal, signal } = &info.place;
    if pattern.fits_text(&info.name) {
        return Some(info.place.clone());
    }
    let terminals: Vec<&str> = terminal.split(", ").collect();
    let signals: Vec<&str> = signal.split(", ").collect();
    if terminals.len() != signals.len() || signals.len() < 2 {
        return pattern.fits(info).then(|| info.place.clone());
    }
    let short = info.name.rsplit('.').next().unwrap_or_default();
    let feeds = |signal: &str| {
        let own = signal.trim_start_matches('/');
        let mut known = FED_BY.iter().filter(|(begin, _)| own.starts_with(begin));
        let known = known.next();
        known.is_none_or(|(_, fed)| fed.contains(&format!(" {short} ")))
    };
    let all = terminals.into_iter().zip(signals);
    let fitting = all.filter(|(terminal, signal)| {
        (pattern.fits_text(terminal) || pattern.fits_text(signal)) && feeds(signal)
    });
    let (terminals, signals): (Vec<_>, Vec<_>) = fitting.unzip();
    (!signals.is_empty()).then(|| Place {
        terminal: terminals.join(", "),
        signal: signals.join(", "),
    })
}

/// Connector, pins and signals; the name of a connector that several pins are on is there once: `TB1
/// pin 1, 2, 4 QA0, /QA0, QB0`.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_connector_is_named_once() {
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
