//! Typed handles of a board and its remotes.

use super::{Configured, Driver};
use crate::boards::{AttachError, BoardHandles, BoardTable, CardHandles, CardTable, RemoteHandles};
use crate::bus::{Clock, RegisterBus};
use crate::discovery::RemoteTable;
use crate::hostmot2::RemoteId;
use crate::modules::serial::RemoteStatus;
use crate::sslbp::Channel;

impl<B: RegisterBus + Clock> Configured<B> {
    /// The handles of a remote, which has to be of their kind.
    ///
    /// # Errors
    /// [`AttachError`]: no remote takes part there, it is of another kind or another part of a card
    /// (swapped channels), or it lacks a pin in its software mode.
    pub fn attach<T: RemoteHandles>(&self, remote: impl Into<RemoteId>) -> Result<T, AttachError> {
        let remote = remote.into();
        let stage = self.0.stages.get(usize::from(remote.port));
        let found = stage.and_then(|stage| stage.remote(remote.channel));
        let found = found.map(|found| (&found.descriptor, &*found.pins.prefix));
        RemoteTable::attach(self.pins(), found, remote)
    }

    /// The handles of a whole card with `first` as its first channel: those of its remotes and of
    /// its encoders.
    ///
    /// # Errors
    /// [`AttachError`]: no connector with that channel has the pins of such a card, or one of its
    /// parts does not exist ([`attach`](Self::attach)).
    pub fn attach_card<T: CardHandles>(
        &self,
        first: impl Into<RemoteId>,
    ) -> Result<T, AttachError> {
        let first = first.into();
        let stage = self.0.stages.get(usize::from(first.port));
        let remote = |channel| {
            let remote = stage?.remote(channel)?;
            Some((&remote.descriptor, &*remote.pins.prefix))
        };
        let (pins, board) = (self.pins(), self.name());
        CardTable::attach(pins, board, self.firmware(), &remote, first)
    }

    /// The handles of the board's own functions.
    ///
    /// # Errors
    /// [`AttachError`]: the board is of another kind, its firmware lacks a module, or not all
    /// instances are in use.
    pub fn attach_board<T: BoardHandles>(&self) -> Result<T, AttachError> {
        BoardTable::attach(self.pins(), self.name(), self.firmware())
    }
}

impl<B: RegisterBus + Clock> Driver<B> {
    /// As [`Configured::attach`].
    ///
    /// # Errors
    /// As [`Configured::attach`].
    pub fn attach<T: RemoteHandles>(&self, remote: impl Into<RemoteId>) -> Result<T, AttachError> {
        let remote = remote.into();
        let found = self.remote(remote);
        let found = found.map(|found| (found.descriptor, &*found.pins.prefix));
        RemoteTable::attach(self.pins(), found, remote)
    }

    /// As [`Configured::attach_card`].
    ///
    /// # Errors
    /// As [`Configured::attach_card`].
    pub fn attach_card<T: CardHandles>(
        &self,
        first: impl Into<RemoteId>,
    ) -> Result<T, AttachError> {
        let first = first.into();
        let remote = |channel| {
            let remote = self.remote((first.port, channel))?;
            Some((remote.descriptor, &*remote.pins.prefix))
        };
        let (pins, board) = (self.pins(), self.name());
        CardTable::attach(pins, board, self.firmware(), &remote, first)
    }

    /// As [`Configured::attach_board`].
    ///
    /// # Errors
    /// As [`Configured::attach_board`].
    pub fn attach_board<T: BoardHandles>(&self) -> Result<T, AttachError> {
        BoardTable::attach(self.pins(), self.name(), self.firmware())
    }

    /// The current state of a remote; `None` if no remote takes part at this address.
    pub fn remote(&self, remote: impl Into<RemoteId>) -> Option<RemoteStatus<'_>> {
        let RemoteId { port, channel } = remote.into();
        let port = self.cycle.parts.ports.get(usize::from(port))?;
        port.remote(Channel::new(channel)?)
    }
}
