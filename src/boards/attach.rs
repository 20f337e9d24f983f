//! Handles of a board or a card: one mechanism to find them for all kinds.

use alloc::boxed::Box;
use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;

use super::{BoardTable, CardTable, IdentityError};
use crate::advice::{self, Advice, MesaError};
use crate::discovery::{RemoteDescriptor, RemoteTable};
use crate::hal::{AnalogIn, AnalogOut, Counter, PinError, Pins};
use crate::hostmot2::{HostMot2, HostMot2Error, RemoteId};
use crate::sslbp::RemoteLabel;

/// Handles of a kind of remote, found by [`Driver::attach`](crate::driver::Driver::attach): for a
/// kind that this crate supports, or for your own.
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
    /// Table of the required kind of remote.
    const TABLE: &'static RemoteTable;

    /// Finds the handles among the pins of a remote of this kind.
    ///
    /// # Errors
    /// [`AttachError::Pin`] if a pin is missing in the remote's software mode.
    fn find(pins: &Finder<'_>) -> Result<Self, AttachError>;
}

/// Handles of a kind of board, for the board's own functions.
pub trait BoardHandles: Sized {
    /// Table of the required kind of board.
    const TABLE: &'static BoardTable;

    /// Finds the handles among the pins of a board of this kind.
    ///
    /// # Errors
    /// [`AttachError::Pin`] if a pin is missing.
    fn find(pins: &Finder<'_>) -> Result<Self, AttachError>;
}

/// Handles of a whole card, found by [`Driver::attach_card`](crate::driver::Driver::attach_card):
/// those of its remotes, and those of the board's own functions that are on the card.
pub trait CardHandles: Sized {
    /// Table of the required pins of the card's connector.
    const TABLE: &'static CardTable;

    /// Finds the handles of the card.
    ///
    /// # Errors
    /// [`AttachError`] of the first part that does not match.
    fn find(card: &CardFinder<'_>) -> Result<Self, AttachError>;
}

/// Reason why handles of a board or a remote were not found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AttachError {
    /// The firmware is for another board.
    #[error("the board is a {found}, expected a {expected}")]
    OtherBoard {
        /// The requested board.
        expected: &'static str,
        /// The board for which the firmware is made.
        found: String,
    },
    /// The firmware lacks a module of this kind of board.
    #[error(transparent)]
    Module(#[from] HostMot2Error),
    /// No remote takes part on this channel.
    #[error("{remote}: no {expected} takes part")]
    NoRemote {
        /// The address of the remote.
        remote: RemoteId,
        /// The requested kind of remote.
        expected: &'static str,
    },
    /// The remote is another one, or another part of the card.
    #[error("{remote}: {source}")]
    Identity {
        /// The remote that is there.
        remote: RemoteLabel,
        /// The mismatch.
        source: IdentityError,
    },
    /// No connector of the board with this channel has the pins of the card.
    #[error(
        "{remote} is not the first channel of a connector with the pins of a \
         {expected}"
    )]
    NoConnector {
        /// The requested first channel.
        remote: RemoteId,
        /// The requested card.
        expected: &'static str,
    },
    /// The table cannot stand in for a remote that is absent.
    #[error(
        "the table of a {kind} cannot stand for one that is absent in software mode {mode}: {why}"
    )]
    Table {
        /// The kind of remote.
        kind: &'static str,
        /// The configured software mode.
        mode: u8,
        /// Problem of the table.
        why: String,
    },
    /// A pin that this kind of board or remote should have is missing, or is of another kind.
    #[error("{name}: {source}, expected on a {kind}")]
    Pin {
        /// Name of the pin, or its beginning.
        name: String,
        /// The kind of board or remote.
        kind: &'static str,
        /// The cause.
        source: Box<PinError>,
    },
}

impl MesaError for AttachError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::OtherBoard { .. } => Some(advice::CHECK_BOARD_ADDRESS),
            Self::Module(error) => error.advice(),
            Self::NoRemote { .. } => Some(advice::LOOK_AT_MISSING),
            Self::Identity { source, .. } => source.advice(),
            Self::NoConnector { .. } => Some(advice::NAME_FIRST_CHANNEL),
            Self::Table { .. } => Some(advice::COMPLETE_TABLE),
            Self::Pin { .. } => Some(advice::CHECK_MODE),
        }
    }
}

/// The pins of one board or remote, identified by the ends of their names.
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

    /// Finds a handle by its whole name with `find`, for example `DigitalIn::find`.
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

    /// True if a pin or parameter with that name exists.
    pub fn has(&self, name: &str) -> bool {
        let name = format!("{}.{name}", self.prefix);
        self.pins.has(&name)
    }

    /// True if a pin with that name exists. In a software mode that does not transfer a value, a
    /// card has a parameter in its place, which does not count.
    pub fn has_pin(&self, name: &str) -> bool {
        let name = format!("{}.{name}", self.prefix);
        self.pins.has_pin(&name)
    }

    /// Finds a handle that some software modes lack; `None` if there is no pin with its name, or
    /// only a parameter in its place.
    ///
    /// # Errors
    /// [`AttachError::Pin`] if the pin is of another kind.
    pub fn optional<T>(
        &self,
        name: &str,
        find: impl Fn(&Pins, &str) -> Result<T, PinError>,
    ) -> Result<Option<T>, AttachError> {
        if !self.has(name) {
            return Ok(None);
        }
        match self.one(name, find) {
            Err(AttachError::Pin { source, .. })
                if matches!(*source, PinError::WrongKind { .. }) && !self.has_pin(name) =>
            {
                Ok(None)
            }
            found => found.map(Some),
        }
    }

    /// Finds handles whose names end in two digits, from 00 on.
    ///
    /// # Errors
    /// [`AttachError::Pin`] with the name of the first missing one.
    pub fn numbered<T: Copy + Default, const N: usize>(
        &self,
        stem: &str,
        find: impl Fn(&Pins, &str) -> Result<T, PinError>,
    ) -> Result<[T; N], AttachError> {
        self.each(|n| self.one(&format!("{stem}{n:02}"), &find))
    }

    /// Finds handles by their number.
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

    /// Finds what field I/O has in some software modes: the voltages of its first four inputs, the
    /// field voltage, and two MPGs.
    pub(super) fn extras(&self) -> Result<FieldExtras, AttachError> {
        let volts = |n| self.one(&format!("analogin{n}"), AnalogIn::find);
        let mpg = |n| self.one(&format!("enc{n}"), Counter::find);
        let has_volts = self.has_pin("analogin0");
        let has_mpgs = self.has_pin("enc0.count");
        Ok(FieldExtras {
            analog_in: has_volts.then(|| self.each(volts)).transpose()?,
            field_voltage: self.optional("fieldvoltage", AnalogIn::find)?,
            mpgs: has_mpgs.then(|| self.each(mpg)).transpose()?,
        })
    }

    /// Finds an analog output and its enable.
    ///
    /// # Errors
    /// [`AttachError::Pin`].
    pub fn analog_out(&self, name: &str, enable: &str) -> Result<AnalogOut, AttachError> {
        let enable = format!("{}.{enable}", self.prefix);
        self.one(name, |pins, name| AnalogOut::find(pins, name, &enable))
    }
}

/// What field I/O has in some software modes.
pub(super) struct FieldExtras {
    pub analog_in: Option<[AnalogIn; 4]>,
    pub field_voltage: Option<AnalogIn>,
    pub mpgs: Option<[Counter; 2]>,
}

/// The remote on a channel: its description and the prefix of its pins.
pub(super) type FoundDescription<'a> = Option<(&'a RemoteDescriptor, &'a str)>;

/// The parts of one card.
pub struct CardFinder<'a> {
    remotes: &'a dyn Fn(u8) -> FoundDescription<'a>,
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

    /// Finds the handles of the card's encoders, in the order of the card.
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
    /// Finds the handles of the card of this kind that has this first channel.
    pub(crate) fn attach<'a, T: CardHandles>(
        pins: &'a Pins,
        board: &'a str,
        firmware: &HostMot2,
        remotes: &'a dyn Fn(u8) -> FoundDescription<'a>,
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

impl BoardTable {
    /// Finds the handles of a board of exactly this kind.
    pub(crate) fn attach<T: BoardHandles>(
        pins: &Pins,
        prefix: &str,
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
