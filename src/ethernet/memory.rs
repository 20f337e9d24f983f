//! Flash memory through LBP16, with and without its guard.

use core::time::Duration;

use super::packets::{Lbp16Board, QUICK, run};
use super::{EthernetBoard, EthernetError, Flash, FlashLayout, FlashMemory, PAGE};
use crate::lbp16::{Command, Lbp16Error, RequestBuilder, Space, registers};
use registers::{control, flash};

/// A sector of an M25P16 is erased within 3 s.
const ERASE: Duration = Duration::from_secs(4);
/// A page of an M25P16 is written within 5 ms.
const WRITE: Duration = Duration::from_millis(100);
/// Bytes read by one command; the manual's examples do the same.
const BLOCK: usize = 256;
/// Bytes read by one packet.
const PACKET: usize = 4 * BLOCK;

impl<B: Lbp16Board> EthernetBoard<B> {
    /// The board's flash memory, after checking that the board and its chip are those that the
    /// layout is for.
    pub fn into_flash(
        mut self,
        layout: FlashLayout,
    ) -> Result<Flash<UnguardedFlash<B>>, EthernetError<B::Error>> {
        let found = self.identity()?.card;
        if !found.as_str().eq_ignore_ascii_case(layout.board) {
            let expected = layout.board;
            return Err(EthernetError::WrongBoard { found, expected });
        }
        Flash::open(UnguardedFlash(self), layout)
    }
}

impl<B: Lbp16Board> Flash<UnguardedFlash<B>> {
    /// Gives the board back.
    pub fn into_board(self) -> EthernetBoard<B> {
        self.into_inner().0
    }
}

/// The flash memory of a board without a guard: any sector is erased, any page is written, and
/// without the boot block or the fallback configuration the board is lost.
///
/// [`EthernetBoard::into_flash`] is the way that respects the layout.
#[derive(Debug)]
pub struct UnguardedFlash<B>(EthernetBoard<B>);

impl<B: Lbp16Board> UnguardedFlash<B> {
    /// The flash memory of `board`.
    pub fn new(board: EthernetBoard<B>) -> Self {
        Self(board)
    }

    /// Gives the board back.
    pub fn into_board(self) -> EthernetBoard<B> {
        self.0
    }

    fn bus(&mut self) -> &mut B {
        self.0.bus()
    }
}

impl<B: Lbp16Board> FlashMemory for UnguardedFlash<B> {
    type Error = B::Error;

    fn id(&mut self) -> Result<u32, EthernetError<B::Error>> {
        let mut id = [0; 4];
        run(self.bus(), &mut id, QUICK, |request| {
            request.read(Space::Flash, flash::ID, 1).map(drop)
        })?;
        Ok(u32::from_le_bytes(id))
    }

    fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<(), EthernetError<B::Error>> {
        let mut at = address & !3;
        // Addresses and sizes of the memory are multiples of 4; what is asked for need not be.
        let mut skip = (address - at) as usize;
        let mut rest = bytes;
        while !rest.is_empty() {
            let wanted = (rest.len() + skip).next_multiple_of(4).min(PACKET);
            let mut buffer = [0; PACKET];
            let reply = buffer.get_mut(..wanted).unwrap_or_default();
            run(self.bus(), reply, QUICK, |request| {
                read_from(request, at, wanted)
            })?;
            let came = reply.get(skip..).unwrap_or(&[]);
            let (now, later) = rest.split_at_mut(came.len().min(rest.len()));
            for (target, byte) in now.iter_mut().zip(came) {
                *target = *byte;
            }
            at = at.wrapping_add(wanted as u32);
            skip = 0;
            rest = later;
        }
        Ok(())
    }

    fn erase_sector(&mut self, address: u32) -> Result<(), EthernetError<B::Error>> {
        let mut echo = [0; 4];
        run(self.bus(), &mut echo, ERASE, |request| {
            enable(request)?;
            request.write_doubles(Space::Flash, flash::ADDRESS, &[address])?;
            request.write_doubles(Space::Flash, flash::SECTOR_ERASE, &[0])?;
            request.read(Space::Flash, flash::ADDRESS, 1).map(drop)
        })
    }

    fn write_page(
        &mut self,
        address: u32,
        page: &[u8; PAGE],
    ) -> Result<(), EthernetError<B::Error>> {
        let mut echo = [0; 4];
        run(self.bus(), &mut echo, WRITE, |request| {
            enable(request)?;
            request.write_doubles(Space::Flash, flash::ADDRESS, &[address])?;
            let data = Command::write(Space::Flash, (PAGE / 4) as u8)?.without_increment();
            request.command(data, flash::DATA, page)?;
            // Reading the address starts the write and waits for its end.
            request.read(Space::Flash, flash::ADDRESS, 1).map(drop)
        })
    }
}

/// Reading many bytes: the address, then the data port again and again.
fn read_from(
    request: &mut RequestBuilder<'_>,
    address: u32,
    mut bytes: usize,
) -> Result<(), Lbp16Error> {
    request.write_doubles(Space::Flash, flash::ADDRESS, &[address])?;
    while bytes > 0 {
        let now = bytes.min(BLOCK);
        let read = Command::read(Space::Flash, (now / 4) as u8)?.without_increment();
        request.command(read, flash::DATA, &[])?;
        bytes -= now;
    }
    Ok(())
}

/// The enable is cleared at the end of every packet, so it is part of each that writes.
fn enable(request: &mut RequestBuilder<'_>) -> Result<(), Lbp16Error> {
    let enable = [control::ENABLE_FLASH];
    request
        .write_words(Space::Control, control::WRITE_ENABLE, &enable)
        .map(drop)
}
