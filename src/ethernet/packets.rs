//! Interface of the rest of this module to a board: LBP16 packets with answers.

use core::time::Duration;

use super::EthernetError;
use crate::bus::{BusError, Clock};
use crate::lbp16::registers::control;
use crate::lbp16::{Command, Lbp16Error, RequestBuilder, Space};

/// A board that executes LBP16 commands.
///
/// For set-up only: a packet without a reply is sent again a bounded number of times, so executing
/// it twice must be harmless. All packets of this module are.
pub trait Lbp16Board: Clock {
    /// Executes `commands` as one packet, and fills `reply` with the data read.
    ///
    /// `deadline` is for each try.
    ///
    /// # Errors
    /// No reply of this length arrived.
    fn run_commands(
        &mut self,
        commands: &[u8],
        reply: &mut [u8],
        deadline: Duration,
    ) -> Result<(), BusError>;

    /// Sends commands that the board will not answer, because it restarts.
    ///
    /// # Errors
    /// The commands were not sent.
    fn send(&mut self, commands: &[u8]) -> Result<(), BusError>;
}

/// An Ethernet board, apart from its HostMot2 registers.
///
/// All functions are for set-up: they take milliseconds, and repeat lost packets. Every error
/// except [`EthernetError::Bus`] comes from the answer of the board, or from the arguments.
#[derive(Debug)]
pub struct EthernetBoard<'a, B> {
    pub(super) bus: &'a mut B,
}

/// Longest time of any operation except those on flash memory.
pub(super) const QUICK: Duration = Duration::from_millis(50);

impl<'a, B: Lbp16Board> EthernetBoard<'a, B> {
    /// The board behind a bus.
    pub fn new(bus: &'a mut B) -> Self {
        Self { bus }
    }

    /// Runs the packet that `build` makes; the answer fills `reply`.
    pub(super) fn run<T>(
        &mut self,
        reply: &mut [u8],
        deadline: Duration,
        build: impl FnOnce(&mut RequestBuilder) -> Result<T, Lbp16Error>,
    ) -> Result<(), EthernetError> {
        let mut request = RequestBuilder::default();
        build(&mut request)?;
        self.bus
            .run_commands(&request.bytes, reply, deadline)
            .map_err(EthernetError::Bus)
    }

    /// As [`run`](Self::run), for a packet that reads `N` words.
    pub(super) fn ask<const N: usize, T>(
        &mut self,
        build: impl FnOnce(&mut RequestBuilder) -> Result<T, Lbp16Error>,
    ) -> Result<[u16; N], EthernetError> {
        let mut reply = [[0; 2]; N];
        self.run(reply.as_flattened_mut(), QUICK, build)?;
        Ok(reply.map(u16::from_le_bytes))
    }

    /// Reads `N` neighbouring 16-bit registers.
    pub(super) fn words<const N: usize>(
        &mut self,
        space: Space,
        address: u16,
    ) -> Result<[u16; N], EthernetError> {
        self.ask(|request| request.read(space, address, N as u8))
    }

    /// Writes neighbouring 16-bit registers, reads them back, and compares the bits of `mask`.
    pub(super) fn write_words<const N: usize>(
        &mut self,
        space: Space,
        address: u16,
        words: [u16; N],
        mask: u16,
    ) -> Result<(), EthernetError> {
        let found: [u16; N] = self.ask(|request| {
            if space == Space::Eeprom {
                // Cleared at the end of every packet, so it precedes the write in the same packet.
                let enable = control::ENABLE_EEPROM.to_le_bytes();
                request.write(Space::Control, control::WRITE_ENABLE, &enable)?;
            }
            let data = words.map(u16::to_le_bytes);
            request.write(space, address, data.as_flattened())?;
            request.read(space, address, N as u8)
        })?;
        let places = (address..).step_by(2);
        for (address, (expected, found)) in places.zip(words.into_iter().zip(found)) {
            if (expected ^ found) & mask != 0 {
                return Err(EthernetError::NotKept {
                    space,
                    address,
                    expected,
                    found,
                });
            }
        }
        Ok(())
    }

    /// Writes several values to one control register; the board does not answer.
    pub(super) fn send_control(
        &mut self,
        address: u16,
        values: &[u16],
    ) -> Result<(), EthernetError> {
        let mut request = RequestBuilder::default();
        for value in values {
            let write = Command::write(Space::Control, 1).standing();
            request.command(write, address, &value.to_le_bytes())?;
        }
        self.bus.send(&request.bytes).map_err(EthernetError::Bus)
    }
}
