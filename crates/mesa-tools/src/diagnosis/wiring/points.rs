//! Terminals that an operator can actuate, and their pins.

use std::collections::BTreeSet;

use mesa_hal::hal::{GroupId, HalType, PinId, PinInfo, Pins, Role};

/// Kind of an input, by its reaction when actuated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum PointKind {
    /// Counts when an encoder is turned.
    Counter,
    /// The latch of an encoder's index, which turns off when the encoder is turned past the index.
    /// The pin is `index-enable`.
    Index,
    /// On or off.
    Digital,
    /// A value between limits.
    Analog,
}

/// An input at a terminal.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Pin of the input.
    pub pin: PinId,
    /// Description of the pin.
    pub info: PinInfo,
    /// Kind of the input.
    pub kind: PointKind,
    /// True if the input is to be checked; others are only watched.
    pub is_asked: bool,
    /// Card of the terminal.
    card: Card,
}

/// Card of a terminal: equal terminal names denote one terminal only on the same card.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Card {
    /// Card of a remote.
    Remote(GroupId),
    /// Part of the board, by the prefix of its pins' names.
    Part(String),
    /// Part of the board that is one counter, such as an encoder: all its terminals change when it
    /// is turned.
    Counter(String),
    /// Index of such a part, if it has a latch.
    Index(String),
}

/// Pins of an encoder's index: its latch, and its level.
const LATCH: &str = "index-enable";
const LEVEL: &str = "input-index";

/// Returns the inputs that can be checked, in the order of their pins: one for each terminal. Those
/// that `fits` selects are to be checked, the others are watched.
///
/// A terminal with several pins is checked by the first selected one: its counter if it is an
/// encoder's, else its level, else its value; a counter on digital inputs, such as a handwheel's,
/// only if these are not selected. The index of an encoder on the board is checked by its latch,
/// whichever of its pins is selected. Digital inputs of `remotes` (the groups of their pins) need
/// no terminal, because an unknown card has none.
pub fn points(pins: &Pins, remotes: &[GroupId], fits: impl Fn(&PinInfo) -> bool) -> Vec<Point> {
    let candidate = |(pin, info): (PinId, &PinInfo)| Point::new(pins, pin, info, remotes);
    let all = pins.ids().zip(pins.infos()).filter_map(candidate);
    let is_chosen = |point: &Point| {
        let level = point.index_level(pins);
        fits(&point.info) || level.is_some_and(&fits)
    };
    let (asked, others): (Vec<_>, Vec<_>) = all.partition(is_chosen);
    let mut points = one_for_each_terminal(asked);
    for point in &mut points {
        point.is_asked = true;
    }
    let is_apart = |other: &Point| !points.iter().any(|point| point.shares_terminal(other));
    let others: Vec<_> = one_for_each_terminal(others);
    let others: Vec<_> = others.into_iter().filter(is_apart).collect();
    points.extend(others);
    points.sort_by_key(|point| point.pin.index());
    points
}

impl Point {
    fn new(pins: &Pins, pin: PinId, info: &PinInfo, remotes: &[GroupId]) -> Option<Self> {
        if let Some(part) = index_part(pins, info, remotes) {
            return (info.role == Role::InOut).then(|| Self {
                pin,
                info: info.clone(),
                kind: PointKind::Index,
                is_asked: false,
                card: Card::Index(part),
            });
        }
        let is_of_remote = remotes.contains(&info.group);
        if info.role != Role::Input || !is_of_remote && counts_own_steps(pins, info) {
            return None;
        }
        let kind = match info.hal_type {
            HalType::Bit => PointKind::Digital,
            HalType::Float if info.limits.is_some() => PointKind::Analog,
            HalType::Float => return None,
            _ => PointKind::Counter,
        };
        if info.place.terminal.is_empty() && !(is_of_remote && kind == PointKind::Digital) {
            return None;
        }
        Some(Self {
            pin,
            info: info.clone(),
            kind,
            is_asked: false,
            card: if is_of_remote {
                Card::Remote(info.group)
            } else {
                Card::of_board(pins, &info.name)
            },
        })
    }

    /// The pin of an index's level.
    fn index_level<'a>(&self, pins: &'a Pins) -> Option<&'a PinInfo> {
        let Card::Index(part) = &self.card else {
            return None;
        };
        let level = format!("{part}.{LEVEL}");
        // An error would be compared with all names, to name the one that was meant.
        if !pins.has(&level) {
            return None;
        }
        pins.info_of(pins.find(&level)?)
    }

    /// True if this is the counter of the index's encoder.
    pub(super) fn counts_for(&self, index: &Self) -> bool {
        match (&self.card, &index.card) {
            (Card::Counter(one), Card::Index(two)) => self.kind == PointKind::Counter && one == two,
            _ => false,
        }
    }

    /// Terminals of the input, or its name where no terminal is known.
    fn terminals(&self) -> impl Iterator<Item = &str> {
        let name = &*self.info.name;
        let name = name.strip_suffix("-not").unwrap_or(name);
        let terminal = &*self.info.place.terminal;
        let found = if terminal.is_empty() { name } else { terminal };
        found.split(", ")
    }

    fn shares_terminal(&self, other: &Self) -> bool {
        let is_other = |one: &str| other.terminals().any(|two| one == two);
        self.card == other.card && (self.card.is_counter() || self.terminals().any(is_other))
    }

    fn is_at(&self, other: &Self) -> bool {
        self.card == other.card
            && (self.card.is_counter() || self.terminals().eq(other.terminals()))
    }

    /// True if each of its terminals has an input of its own.
    fn is_covered(&self, all: &[Self]) -> bool {
        let count = self.terminals().count();
        let own = all
            .iter()
            .filter(|other| other.card == self.card && other.terminals().count() < count);
        let own: BTreeSet<&str> = own.flat_map(Self::terminals).collect();
        self.terminals().all(|terminal| own.contains(terminal))
    }
}

impl Card {
    /// The part that a pin of the board itself belongs to.
    fn of_board(pins: &Pins, name: &str) -> Self {
        let part = name.rsplit_once('.').map_or(name, |(part, _)| part);
        if pins.has(&format!("{part}.count")) {
            Self::Counter(part.to_owned())
        } else {
            Self::Part(part.to_owned())
        }
    }

    const fn is_counter(&self) -> bool {
        matches!(self, Self::Counter(_))
    }
}

/// True for a step generator's own count of its steps: nothing at its terminals changes it.
fn counts_own_steps(pins: &Pins, info: &PinInfo) -> bool {
    let part = info.name.rsplit_once('.');
    part.is_some_and(|(part, _)| pins.has(&format!("{part}.position-cmd")))
}

/// The encoder to which an index's latch or level belongs, if the board has such a latch and a
/// terminal for it.
fn index_part(pins: &Pins, info: &PinInfo, remotes: &[GroupId]) -> Option<String> {
    let (part, name) = info.name.rsplit_once('.')?;
    let is_index = matches!(name, LATCH | LEVEL)
        && !info.place.terminal.is_empty()
        && !remotes.contains(&info.group);
    let is_there = |pin: &str| pins.has(&format!("{part}.{pin}"));
    (is_index && is_there("count") && is_there(LATCH)).then(|| part.to_owned())
}

/// Returns the first input of the best kind at each terminal.
fn one_for_each_terminal(mut all: Vec<Point>) -> Vec<Point> {
    // The sort is stable: inputs of one kind stay in order.
    all.sort_by_key(|point| point.kind);
    let mut first: Vec<Point> = Vec::new();
    for point in all {
        if !first.iter().any(|other| other.is_at(&point)) {
            first.push(point);
        }
    }
    let is_own: Vec<bool> = first
        .iter()
        .map(|point| !point.is_covered(&first))
        .collect();
    let own = first.into_iter().zip(is_own);
    own.filter_map(|(point, is_own)| is_own.then_some(point))
        .collect()
}

/// Returns the digital outputs that `fits` selects, in the order of their pins: those of `remotes`
/// (the groups of their pins) and those of the board's own SSR and OutM. I/O pins without a module
/// are left out, because their use has to be configured first. The effect of an output on the
/// machine is not considered.
pub fn outputs(
    pins: &Pins,
    remotes: &[GroupId],
    fits: impl Fn(&PinInfo) -> bool,
) -> Vec<(PinId, PinInfo)> {
    let is_output = |info: &PinInfo| {
        let of_board = [".ssr.", ".outm."].iter().any(|module| {
            let part = info.name.split_once(module);
            part.is_some_and(|(_, rest)| rest.contains(".out-"))
        });
        info.role == Role::Output
            && info.hal_type == HalType::Bit
            && (of_board || remotes.contains(&info.group))
    };
    let all = pins.ids().zip(pins.infos());
    let chosen = all.filter(|(_, info)| is_output(info) && fits(info));
    chosen.map(|(pin, info)| (pin, info.clone())).collect()
}
