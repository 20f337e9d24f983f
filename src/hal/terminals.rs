//! Screw terminals by ranges, as in the connector tables of the manuals.

use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec::Vec;

/// The terminals of consecutive items of one kind on a connector: inputs, encoders.
///
/// ```
/// use mesa_hal::hal::Terminals;
/// const OUTPUTS: &[Terminals] =
///     &[Terminals::new("TB5 pin ", 0, &["OUT#-", "OUT#+"], &[13, 14, 15, 16])];
/// let place = Terminals::of(OUTPUTS, 1);
/// assert_eq!(place.terminal, "TB5 pin 15, TB5 pin 16");
/// assert_eq!(place.signal, "OUT1-, OUT1+");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Terminals {
    /// Text before the number of a pin: `TB4 pin `.
    pub connector: &'static str,
    /// The number of the first item.
    pub first: u16,
    /// The manual's names of the signals of one item; `#` stands for the item's number.
    pub signals: &'static [&'static str],
    /// The pins of the connector: one for each signal of each item.
    pub pins: &'static [u8],
}

/// A terminal or several, and the signal there.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Place {
    /// Connector and pin, for example `TB8 pin 3`; several are separated by commas. Empty without a
    /// terminal.
    pub terminal: String,
    /// The manual's name, for example `INPUT2`.
    pub signal: String,
}

impl Terminals {
    /// Terminals of the items from number `first` on.
    pub const fn new(
        connector: &'static str,
        first: u16,
        signals: &'static [&'static str],
        pins: &'static [u8],
    ) -> Self {
        Self {
            connector,
            first,
            signals,
            pins,
        }
    }

    /// Three encoders on a block of 24 terminals, of which every third is ground or +5 V: A, B and
    /// index of each, in the order that [`of_signal`](Self::of_signal) expects.
    pub const fn encoders(connector: &'static str, first: u16) -> Self {
        Self {
            connector,
            first,
            signals: &["QA#", "/QA#", "QB#", "/QB#", "IDX#", "/IDX#"],
            pins: &[
                1, 2, 4, 5, 7, 8, 9, 10, 12, 13, 15, 16, 17, 18, 20, 21, 23, 24,
            ],
        }
    }

    /// The place of item `number`.
    pub fn of(ranges: &[Self], number: u16) -> Place {
        Self::each_of(ranges, number).collect()
    }

    /// The terminals of item `number`, one by one.
    pub fn each_of(ranges: &[Self], number: u16) -> impl Iterator<Item = Place> {
        Self::each(ranges).filter_map(move |(n, place)| (n == number).then_some(place))
    }

    /// The terminals of signal A, B or index (0 to 2) of counter `number`, one by one. Each signal
    /// has a third of the counter's terminals, in this order.
    pub fn of_signal(ranges: &[Self], number: u16, signal: usize) -> impl Iterator<Item = Place> {
        let all: Vec<Place> = Self::each_of(ranges, number).collect();
        let each = all.len().div_ceil(3);
        all.into_iter().skip(each.saturating_mul(signal)).take(each)
    }

    /// All terminals with the numbers of their items.
    pub fn each(ranges: &[Self]) -> impl Iterator<Item = (u16, Place)> {
        ranges.iter().flat_map(|range| {
            let things = range.pins.chunks(range.signals.len().max(1));
            (range.first..).zip(things).flat_map(move |(number, pins)| {
                let terminals = pins.iter().zip(range.signals);
                let places = terminals.map(move |(pin, signal)| Place {
                    terminal: format!("{}{pin}", range.connector),
                    signal: signal.replace('#', &number.to_string()),
                });
                places.map(move |place| (number, place))
            })
        })
    }
}

/// Joins several places into one.
impl FromIterator<Self> for Place {
    fn from_iter<I: IntoIterator<Item = Self>>(places: I) -> Self {
        let places = places.into_iter();
        let places = places.filter(|place| *place != Self::default());
        let (terminals, mut signals): (Vec<_>, Vec<_>) =
            places.map(|place| (place.terminal, place.signal)).unzip();
        signals.dedup();
        Self {
            terminal: terminals.join(", "),
            signal: signals.join(", "),
        }
    }
}
