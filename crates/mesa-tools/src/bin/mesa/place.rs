//! Short form of terminals.

use mesa_hal::hal::Place;

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
