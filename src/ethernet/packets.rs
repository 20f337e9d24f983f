//! What the rest of this module needs of a board: LBP16 packets with answers.

use core::time::Duration;

use super::EthernetError;
use crate::bus::{Clock, RegisterBus};
use crate::lbp16::{Lbp16Error, MAX_PACKET, RequestBuilder, Space};

/// A board that executes LBP16 commands.
///
/// For set-up only: a packet of which no reply came is sent again a bounded number of times, so
/// it must do no harm twice. Nothing in this module does.
pub trait Lbp16Board: RegisterBus + Clock {
    /// Executes `commands` as one packet, and fills `reply` with what they read.
    ///
    /// `deadline` is for each try.
    fn run_commands(
        &mut self,
        commands: &[u8],
        reply: &mut [u8],
        deadline: Duration,
    ) -> Result<(), Self::Error>;

    /// Sends commands that the board will not answer, because it restarts.
    fn send(&mut self, commands: &[u8]) -> Result<(), Self::Error>;
}

impl<B: Lbp16Board + ?Sized> Lbp16Board for &mut B {
    fn run_commands(
        &mut self,
        commands: &[u8],
        reply: &mut [u8],
        deadline: Duration,
    ) -> Result<(), Self::Error> {
        (**self).run_commands(commands, reply, deadline)
    }

    fn send(&mut self, commands: &[u8]) -> Result<(), Self::Error> {
        (**self).send(commands)
    }
}

/// How long anything but flash memory takes at most.
pub(super) const QUICK: Duration = Duration::from_millis(50);

/// Runs the packet that `build` makes; the reply fills `reply`.
pub(super) fn run<B: Lbp16Board>(
    board: &mut B,
    reply: &mut [u8],
    deadline: Duration,
    build: impl FnOnce(&mut RequestBuilder<'_>) -> Result<(), Lbp16Error>,
) -> Result<(), EthernetError<B::Error>> {
    let mut buffer = [0; MAX_PACKET];
    let mut request = RequestBuilder::new(&mut buffer);
    build(&mut request)?;
    board
        .run_commands(request.bytes(), reply, deadline)
        .map_err(EthernetError::Bus)
}

/// Reads `N` neighbouring 16-bit registers.
pub(super) fn read_words<const N: usize, B: Lbp16Board>(
    board: &mut B,
    space: Space,
    address: u16,
) -> Result<[u16; N], EthernetError<B::Error>> {
    let mut reply = [[0; 2]; N];
    let count = u8::try_from(N).unwrap_or(u8::MAX);
    run(board, reply.as_flattened_mut(), QUICK, |request| {
        request.read(space, address, count).map(drop)
    })?;
    Ok(reply.map(u16::from_le_bytes))
}
