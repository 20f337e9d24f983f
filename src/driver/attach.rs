//! Typed handles of a board and its remotes.

use super::Driver;
use crate::boards::{AttachError, BoardHandles, BoardTable, RemoteHandles};
use crate::bus::{Clock, RegisterBus};
use crate::discovery::RemoteTable;
use crate::sslbp::Channel;

impl<B: RegisterBus + Clock> Driver<B> {
    /// The handles of the remote on `channel` (0 to 7) of `port`, which has to be of their kind.
    ///
    /// # Errors
    /// [`AttachError`]: no remote takes part there, it is of another kind or another part of a card
    /// (swapped channels), or it lacks a pin in its software mode.
    pub fn attach<T: RemoteHandles>(&self, port: u8, channel: u8) -> Result<T, AttachError> {
        let ports = self.ports().get(usize::from(port));
        let remote = ports.and_then(|ports| ports.remote(Channel::new(channel)?));
        let Some(remote) = remote else {
            return Err(AttachError::NoRemote {
                port,
                channel,
                expected: T::TABLE.title,
            });
        };
        let names = (self.pins(), &*remote.pins.prefix);
        RemoteTable::attach(names, remote.descriptor, (port, channel))
    }

    /// The handles of the board's own functions.
    ///
    /// # Errors
    /// [`AttachError`]: it is another board, its firmware lacks a module, or not all instances are
    /// in use.
    pub fn attach_board<T: BoardHandles>(&self) -> Result<T, AttachError> {
        BoardTable::attach((self.pins(), self.name()), self.firmware())
    }
}
