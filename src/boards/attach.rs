//! Handles of a board or a card: one way to find them, whatever they are of.

use alloc::boxed::Box;
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;

use super::identity::require;
use super::{BoardTable, CardTable, IdentityError};
use crate::discovery::{RemoteDescriptor, RemoteTable};
use crate::hal::{AnalogOut, Counter, PinError, Pins};
use crate::hostmot2::{HostMot2, HostMot2Error, RemoteId};

/// Handles of a kind of remote, found by [`Driver::attach`](crate::driver::Driver::attach): of one
/// that this crate knows, or of your own.
///
/// ```
/// use mesa_hal::boards::{AttachError, Finder, RemoteHandles};
/// use mesa_hal::discovery::{DataType, ElementTable, RemoteTable};
/// use mesa_hal::hal::{AnalogIn, DigitalOut};
///
/// const VALVES: RemoteTable = RemoteTable::new("valve block", *b"VLV4", &[
///     ElementTable::output("Valve", 4, DataType::Bits),
///     ElementTable::input("Supply", 8, DataType::Unsigned).range(0.0, 36.3, "V"),
/// ]);
///
/// struct Valves {
///     valves: [DigitalOut; 4],
///     supply: AnalogIn,
/// }
///
/// impl RemoteHandles for Valves {
///     const TABLE: &'static RemoteTable = &VALVES;
///
///     fn find(pins: &Finder<'_>) -> Result<Self, AttachError> {
///         Ok(Self {
///             valves: pins.numbered("valve-", DigitalOut::find)?,
///             supply: pins.one("supply", AnalogIn::find)?,
///         })
///     }
/// }
/// ```
pub trait RemoteHandles: Sized {
    /// What the remote has to be.
    const TABLE: &'static RemoteTable;

    /// Finds the handles among the pins of a remote of this kind.
    ///
    /// # Errors
    /// [`AttachError::Pin`] if it lacks one, in its software mode.
    fn find(pins: &Finder<'_>) -> Result<Self, AttachError>;
}

/// Handles of a kind of board: the same for its own functions.
pub trait BoardHandles: Sized {
    /// What the board has to be.
    const TABLE: &'static BoardTable;

    /// Finds the handles among the pins of a board of this kind.
    ///
    /// # Errors
    /// [`AttachError::Pin`] if it lacks one.
    fn find(pins: &Finder<'_>) -> Result<Self, AttachError>;
}

/// Handles of a whole card, found by [`Driver::attach_card`](crate::driver::Driver::attach_card):
/// those of its remotes, and of what is on it of the board's own functions.
pub trait CardHandles: Sized {
    /// What the pins of the card's connector have to be.
    const TABLE: &'static CardTable;

    /// Finds the handles of the card.
    ///
    /// # Errors
    /// [`AttachError`] of the first part that is not as it has to be.
    fn find(card: &CardFinder<'_>) -> Result<Self, AttachError>;
}

/// Why there are no handles of a board or a remote.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AttachError {
    /// The firmware is for another board.
    #[error("this is a {found}, and a {expected} was asked for (is the address another board's?)")]
    OtherBoard {
        /// The board asked for.
        expected: &'static str,
        /// What the firmware says it is for.
        found: String,
    },
    /// The firmware lacks a module of this kind of board.
    #[error(transparent)]
    Module(#[from] HostMot2Error),
    /// No remote takes part there.
    #[error(
        "no remote takes part on {remote}, where a {expected} was asked for; \
         `missing` says why, if it was configured"
    )]
    NoRemote {
        /// The remote.
        remote: RemoteId,
        /// What was asked for.
        expected: &'static str,
    },
    /// It is another remote, or another part of the card.
    #[error("{remote}: {source}")]
    Identity {
        /// The remote.
        remote: RemoteId,
        /// What it is.
        source: IdentityError,
    },
    /// No connector of the board with this channel has the pins of the card.
    #[error(
        "{remote} is not the first one of a connector with the pins of a \
         {expected}: name the card's first channel, or load a firmware that is made for the card"
    )]
    NoConnector {
        /// The remote.
        remote: RemoteId,
        /// The card asked for.
        expected: &'static str,
    },
    /// The table can not stand for a remote that is absent.
    #[error(
        "the table of a {kind} can not stand for one that is absent in software mode {mode}: {why}; \
         plug it in, or complete the table"
    )]
    Table {
        /// The kind of remote.
        kind: &'static str,
        /// The software mode it is configured for.
        mode: u8,
        /// What is wrong with the table.
        why: String,
    },
    /// A pin that belongs to this kind of board or remote is not there, or is of another kind.
    #[error(
        "{name}: {source}. A {kind} has it: does the software mode, the firmware or the number of \
         instances in use differ?"
    )]
    Pin {
        /// What its name begins with, or is.
        name: String,
        /// The kind of board or remote.
        kind: &'static str,
        /// Why.
        source: Box<PinError>,
    },
}

/// The pins of one board or remote, by the ends of their names.
#[derive(Clone, Copy, Debug)]
pub struct Finder<'a> {
    pins: &'a Pins,
    prefix: &'a str,
    kind: &'static str,
}

impl<'a> Finder<'a> {
    /// The pins whose names begin with `prefix` and a dot, of this kind of board or remote.
    pub fn new(pins: &'a Pins, prefix: &'a str, kind: &'static str) -> Self {
        Self { pins, prefix, kind }
    }

    /// A handle that `find` finds by its whole name, for example `DigitalIn::find`.
    ///
    /// # Errors
    /// [`AttachError::Pin`] with the name.
    pub fn one<T>(
        &self,
        name: &str,
        find: impl Fn(&Pins, &str) -> Result<T, PinError>,
    ) -> Result<T, AttachError> {
        let name = format!("{}.{name}", self.prefix);
        find(self.pins, &name).map_err(|source| AttachError::Pin {
            name,
            kind: self.kind,
            source: source.into(),
        })
    }

    /// Whether there is a pin or parameter of that name.
    pub fn has(&self, name: &str) -> bool {
        let name = format!("{}.{name}", self.prefix);
        self.pins.id(&name).is_ok()
    }

    /// Handles whose names end in two digits, from 00 on.
    ///
    /// # Errors
    /// [`AttachError::Pin`] with the name of the first that is not there.
    pub fn numbered<T: Copy + Default, const N: usize>(
        &self,
        stem: &str,
        find: impl Fn(&Pins, &str) -> Result<T, PinError>,
    ) -> Result<[T; N], AttachError> {
        self.each(|n| self.one(&format!("{stem}{n:02}"), &find))
    }

    /// Handles by their number.
    ///
    /// # Errors
    /// The first error of `find`.
    pub fn each<T: Copy + Default, const N: usize>(
        &self,
        find: impl Fn(usize) -> Result<T, AttachError>,
    ) -> Result<[T; N], AttachError> {
        let mut all = [T::default(); N];
        for (n, handle) in all.iter_mut().enumerate() {
            *handle = find(n)?;
        }
        Ok(all)
    }

    /// An analog output and its enable.
    ///
    /// # Errors
    /// [`AttachError::Pin`].
    pub fn analog_out(&self, name: &str, enable: &str) -> Result<AnalogOut, AttachError> {
        let enable = format!("{}.{enable}", self.prefix);
        self.one(name, |pins, name| AnalogOut::find(pins, name, &enable))
    }
}

/// A remote as it is found on a channel: its description and the prefix of its pins.
type Found<'a> = Option<(&'a RemoteDescriptor, &'a str)>;

/// The parts of one card.
pub struct CardFinder<'a> {
    remotes: &'a dyn Fn(u8) -> Found<'a>,
    /// The pins of the board's own functions.
    board: Finder<'a>,
    first: RemoteId,
    encoders: Vec<u16>,
}

impl fmt::Debug for CardFinder<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CardFinder")
            .field("board", &self.board)
            .field("first", &self.first)
            .field("encoders", &self.encoders)
            .finish_non_exhaustive()
    }
}

impl CardFinder<'_> {
    /// The handles of the remote on channel `nth` of the card, from 0 on.
    ///
    /// # Errors
    /// As [`Driver::attach`](crate::driver::Driver::attach).
    pub fn remote<T: RemoteHandles>(&self, nth: u8) -> Result<T, AttachError> {
        let channel = self.first.channel.saturating_add(nth);
        let remote = RemoteId::new(self.first.port, channel);
        RemoteTable::attach(self.board.pins, (self.remotes)(channel), remote)
    }

    /// The handles of the card's encoders, in its order.
    ///
    /// # Errors
    /// [`AttachError::Pin`] if one is not in use.
    pub fn encoders<const N: usize>(&self) -> Result<[Counter; N], AttachError> {
        self.board.each(|n| {
            let number = self.encoders.get(n).copied().unwrap_or(u16::MAX);
            self.board
                .one(&format!("encoder.{number:02}"), Counter::find)
        })
    }
}

impl CardTable {
    /// Finds the handles of the card of this kind whose first channel this is.
    pub(crate) fn attach<'a, T: CardHandles>(
        (pins, board): (&'a Pins, &'a str),
        firmware: &HostMot2,
        remotes: &'a dyn Fn(u8) -> Found<'a>,
        first: RemoteId,
    ) -> Result<T, AttachError> {
        let encoders = T::TABLE.encoders_at(firmware, first);
        T::find(&CardFinder {
            remotes,
            board: Finder::new(pins, board, T::TABLE.name),
            first,
            encoders: encoders
                .ok_or(AttachError::NoConnector {
                    remote: first,
                    expected: T::TABLE.name,
                })?
                .collect(),
        })
    }
}

impl RemoteTable {
    /// Finds the handles of a remote of this kind, and of no other, by its description and the prefix
    /// of its pins.
    pub(crate) fn attach<T: RemoteHandles>(
        pins: &Pins,
        found: Found<'_>,
        remote: RemoteId,
    ) -> Result<T, AttachError> {
        let (descriptor, prefix) = found.ok_or(AttachError::NoRemote {
            remote,
            expected: T::TABLE.title,
        })?;
        require(T::TABLE, descriptor).map_err(|source| AttachError::Identity { remote, source })?;
        T::find(&Finder::new(pins, prefix, T::TABLE.title))
    }
}

impl BoardTable {
    /// Finds the handles of a board of this kind, and of no other.
    pub(crate) fn attach<T: BoardHandles>(
        (pins, prefix): (&Pins, &str),
        firmware: &HostMot2,
    ) -> Result<T, AttachError> {
        let table = T::TABLE;
        if !table.fits(firmware) {
            return Err(AttachError::OtherBoard {
                expected: table.name,
                found: firmware.idrom.board_name.clone(),
            });
        }
        for entry in table.terminals {
            let is_there = entry.modules.iter().any(|m| firmware.find(*m).is_some());
            if let Some(module) = entry.modules.first().filter(|_| !is_there) {
                firmware.require(*module)?;
            }
        }
        T::find(&Finder::new(pins, prefix, table.name))
    }
}
