//! What the rest of this module needs of a board: LBP16 packets with answers.

use core::time::Duration;

use crate::bus::{Clock, RegisterBus};
use crate::lbp16::{MAX_PACKET, RequestBuilder, RequestError, Space};

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

/// Why something could not be asked of a board, or done with it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EthernetError<E> {
    /// The board did not answer.
    #[error(transparent)]
    Bus(E),
    /// The commands do not fit into a packet.
    #[error(transparent)]
    Request(RequestError),
    /// What answers is no LBP16 board, or not in the way it is known.
    #[error(
        "space {space}: cookie 0x{found:04X}, expected 0x{expected:04X}; is this a Mesa board?"
    )]
    Cookie {
        /// The space.
        space: u8,
        /// The cookie read.
        found: u16,
        /// What it should be.
        expected: u16,
    },
    /// The firmware can not do this.
    #[error("this needs firmware version {needed}, the board has {found}; update its firmware")]
    Firmware {
        /// The first version that can.
        needed: u16,
        /// The version on the board.
        found: u16,
    },
    /// What was written reads back differently.
    #[error(
        "EEPROM address 0x{address:02X} reads 0x{found:04X} after writing 0x{expected:04X}; try again"
    )]
    NotWritten {
        /// Address of the word.
        address: u16,
        /// What was written.
        expected: u16,
        /// What is there.
        found: u16,
    },
    /// A register of the board's network side does not keep what was written.
    #[error(
        "register 0x{address:02X} of space 6 reads 0x{found:04X} after writing 0x{expected:04X}; \
         this firmware may not have it: update it"
    )]
    NotTaken {
        /// Address of the register.
        address: u16,
        /// What was written.
        expected: u16,
        /// What is there.
        found: u16,
    },
}

/// How long anything but flash memory takes at most.
pub(super) const QUICK: Duration = Duration::from_millis(50);

/// Runs the packet that `build` makes; the reply fills `reply`.
pub(super) fn run<B: Lbp16Board>(
    board: &mut B,
    reply: &mut [u8],
    deadline: Duration,
    build: impl FnOnce(&mut RequestBuilder<'_>) -> Result<(), RequestError>,
) -> Result<(), EthernetError<B::Error>> {
    let mut buffer = [0; MAX_PACKET];
    let mut request = RequestBuilder::new(&mut buffer);
    build(&mut request).map_err(EthernetError::Request)?;
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
