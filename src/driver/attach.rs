//! Typed handles of a board and its remotes.

use super::{Board, Driver};
use crate::boards::{AttachError, BoardHandles, BoardTable, CardHandles, CardTable, RemoteHandles};
use crate::bus::{Clock, RegisterBus};
use crate::discovery::RemoteTable;
use crate::modules::serial::RemoteStatus;
use crate::sslbp::Channel;

impl<B: RegisterBus + Clock> Board<B> {
    /// The handles of the remote on `channel` (0 to 7) of `port`, which has to be of their kind.
    /// Call after [`discover`](Self::discover).
    ///
    /// # Errors
    /// [`AttachError`]: no remote takes part there, it is of another kind or another part of a card
    /// (swapped channels), or it lacks a pin in its software mode.
    pub fn attach<T: RemoteHandles>(&self, port: u8, channel: u8) -> Result<T, AttachError> {
        let stage = self.stages.get(usize::from(port));
        let remote = stage.and_then(|stage| stage.remote(channel));
        let remote = remote.map(|remote| (&remote.descriptor, &*remote.pins.prefix));
        RemoteTable::attach(self.pins(), remote, (port, channel))
    }

    /// The handles of a whole card, with `channel` (0 to 7) of `port` as its first channel: those
    /// of its remotes and of its encoders. Call after [`discover`](Self::discover).
    ///
    /// # Errors
    /// [`AttachError`]: no connector with that channel has the pins of such a card, or one of its
    /// parts does not exist ([`attach`](Self::attach)).
    pub fn attach_card<T: CardHandles>(&self, port: u8, channel: u8) -> Result<T, AttachError> {
        let stage = self.stages.get(usize::from(port));
        let remote = |channel| {
            let remote = stage?.remote(channel)?;
            Some((&remote.descriptor, &*remote.pins.prefix))
        };
        let board = (self.pins(), self.name());
        CardTable::attach(board, self.firmware(), &remote, (port, channel))
    }

    /// The handles of the board's own functions.
    ///
    /// # Errors
    /// [`AttachError`]: the board is of another kind, its firmware lacks a module, or not all
    /// instances are in use.
    pub fn attach_board<T: BoardHandles>(&self) -> Result<T, AttachError> {
        BoardTable::attach((self.pins(), self.name()), self.firmware())
    }
}

impl<B: RegisterBus + Clock> Driver<B> {
    /// As [`Board::attach`].
    ///
    /// # Errors
    /// As [`Board::attach`].
    pub fn attach<T: RemoteHandles>(&self, port: u8, channel: u8) -> Result<T, AttachError> {
        let remote = self.remote(port, channel);
        let remote = remote.map(|remote| (remote.descriptor, &*remote.pins.prefix));
        RemoteTable::attach(self.pins(), remote, (port, channel))
    }

    /// As [`Board::attach_card`].
    ///
    /// # Errors
    /// As [`Board::attach_card`].
    pub fn attach_card<T: CardHandles>(&self, port: u8, channel: u8) -> Result<T, AttachError> {
        let remote = |channel| {
            let remote = self.remote(port, channel)?;
            Some((remote.descriptor, &*remote.pins.prefix))
        };
        let board = (self.pins(), self.name());
        CardTable::attach(board, self.firmware(), &remote, (port, channel))
    }

    /// As [`Board::attach_board`].
    ///
    /// # Errors
    /// As [`Board::attach_board`].
    pub fn attach_board<T: BoardHandles>(&self) -> Result<T, AttachError> {
        BoardTable::attach((self.pins(), self.name()), self.firmware())
    }

    /// The current state of the remote on `channel` (0 to 7) of `port`; `None` if no remote takes
    /// part there.
    pub fn remote(&self, port: u8, channel: u8) -> Option<RemoteStatus<'_>> {
        let port = self.cycle.parts.ports.get(usize::from(port))?;
        port.remote(Channel::new(channel)?)
    }
}
