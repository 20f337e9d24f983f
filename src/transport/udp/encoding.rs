//! An access list as an LBP16 packet: encoded once, then only patched.

use super::UdpError;
use crate::bus::{Access, Direction};

/// The most bytes of a request or a reply (manual 7I97, "SPACE 3: FPGA FLASH EEPROM CHIP ACCESS":
/// about 1450 fit into a packet).
pub(super) const MAX_PACKET: usize = 1450;

/// Scratch registers of the board for the numbers of requests, and of write packets (FACTS 10.1).
const REQUEST_NUMBER: u16 = 0x0010;
const WRITE_NUMBER: u16 = 0x0014;
/// Both numbers, read at the end of a reply.
const NUMBERS_BYTES: usize = 8;

/// A packet, and what has to be put into it and taken out of its reply.
#[derive(Clone, Debug, Default)]
pub(super) struct Encoding {
    packet: Vec<u8>,
    request_number: Option<usize>,
    write_number: Option<usize>,
    writes: Vec<Piece>,
    reads: Vec<Piece>,
    reply_len: usize,
    words: usize,
}

/// Words of the buffer, and where they are in a packet.
#[derive(Clone, Copy, Debug)]
struct Piece {
    offset: usize,
    first: usize,
    count: usize,
}

/// The command that is being extended while neighbours follow.
#[derive(Clone, Copy)]
struct Open {
    direction: Direction,
    /// Where its count is in the packet.
    at: usize,
    next: u32,
    count: u16,
}

impl Encoding {
    /// The packet for `accesses`.
    ///
    /// It is answered if it reads anything, or if `acknowledged`.
    pub(super) fn new(accesses: &[Access], acknowledged: bool) -> Result<Self, UdpError> {
        let mut this = Self::default();
        let has = |direction| accesses.iter().any(|a| a.direction == direction);
        let answered = acknowledged || has(Direction::Read);
        if answered {
            this.request_number = Some(this.push_number(REQUEST_NUMBER));
        }
        let mut open = None;
        for access in accesses {
            this.push_access(*access, &mut open)?;
        }
        if has(Direction::Write) {
            this.write_number = Some(this.push_number(WRITE_NUMBER));
        }
        if answered {
            this.push_read_back();
        }
        check("request", this.packet.len())?;
        check("reply", this.reply_len)?;
        Ok(this)
    }

    /// The packet that asks for the number of the last write the board executed.
    pub(super) fn question() -> Self {
        let mut this = Self::default();
        this.request_number = Some(this.push_number(REQUEST_NUMBER));
        this.push_read_back();
        this
    }

    /// The packet that sets both numbers, and nothing else.
    pub(super) fn first_contact() -> Self {
        let mut this = Self::default();
        this.request_number = Some(this.push_number(REQUEST_NUMBER));
        this.write_number = Some(this.push_number(WRITE_NUMBER));
        this.push_read_back();
        this
    }

    /// The packet, with numbers and values put in.
    pub(super) fn packet(
        &mut self,
        words: &[u32],
        request: u32,
        write: impl FnOnce() -> u32,
    ) -> &[u8] {
        patch(&mut self.packet, self.request_number, request);
        if self.write_number.is_some() {
            patch(&mut self.packet, self.write_number, write());
        }
        for piece in &self.writes {
            let values = words.iter().skip(piece.first).take(piece.count);
            let bytes = self.packet.iter_mut().skip(piece.offset);
            for (byte, value) in bytes.zip(values.flat_map(|word| word.to_le_bytes())) {
                *byte = value;
            }
        }
        &self.packet
    }

    /// Takes the words of a reply; `false`, and nothing taken, if it has not the right size.
    pub(super) fn take(&self, reply: &[u8], words: &mut [u32]) -> bool {
        if reply.len() != self.reply_len {
            return false;
        }
        for piece in &self.reads {
            let values = reply.get(piece.offset..).unwrap_or(&[]).chunks_exact(4);
            let targets = words.iter_mut().skip(piece.first).take(piece.count);
            for (target, value) in targets.zip(values) {
                *target = word(value);
            }
        }
        true
    }

    /// The numbers at the end of a reply: the request's, and the last executed write's.
    pub(super) fn numbers(reply: &[u8]) -> Option<(u32, u32)> {
        let tail = reply.len().checked_sub(NUMBERS_BYTES)?;
        let (request, write) = reply.get(tail..)?.split_at(4);
        Some((word(request), word(write)))
    }

    /// Whether the packet is answered.
    pub(super) fn is_answered(&self) -> bool {
        self.request_number.is_some()
    }

    /// Whether the packet changes anything on the board.
    pub(super) fn has_writes(&self) -> bool {
        self.write_number.is_some()
    }

    /// Bytes of the reply.
    pub(super) fn reply_len(&self) -> usize {
        self.reply_len
    }

    /// Checks that every access has its words in a buffer of this size.
    pub(super) fn check_words(&self, accesses: &[Access], words: usize) -> Result<(), UdpError> {
        if self.words <= words {
            return Ok(());
        }
        let outside = accesses.iter().find(|a| a.words().end > words);
        outside.map_or(Ok(()), |access| Err(bad_access(*access, words)))
    }

    fn push_access(&mut self, access: Access, open: &mut Option<Open>) -> Result<(), UdpError> {
        let end = u32::from(access.address) + 4 * u32::from(access.count);
        if !access.address.is_multiple_of(4) || end > 0x1_0000 {
            return Err(bad_access(access, usize::MAX));
        }
        self.words = self.words.max(access.words().end);
        let mut address = access.address;
        let mut first = access.words().start;
        let mut left = access.count;
        while left > 0 {
            let count = self.extend(access.direction, address, left, open);
            let piece = |offset| Piece {
                offset,
                first,
                count: usize::from(count),
            };
            let bytes = 4 * usize::from(count);
            match access.direction {
                Direction::Read => {
                    self.reads.push(piece(self.reply_len));
                    self.reply_len += bytes;
                }
                Direction::Write => {
                    self.writes.push(piece(self.packet.len()));
                    self.packet.resize(self.packet.len() + bytes, 0);
                }
            }
            first += usize::from(count);
            address = address.wrapping_add(4 * count);
            left -= count;
        }
        Ok(())
    }

    /// Extends the open command by up to `left` registers, or opens the next one; returns by how
    /// many.
    fn extend(
        &mut self,
        direction: Direction,
        address: u16,
        left: u16,
        open: &mut Option<Open>,
    ) -> u16 {
        let fits = |o: &Open| {
            o.direction == direction && o.next == u32::from(address) && o.count < MAX_COUNT
        };
        let mut current = open.take().filter(fits).unwrap_or_else(|| {
            let at = self.packet.len();
            self.push_command(0, address);
            Open {
                direction,
                at,
                next: u32::from(address),
                count: 0,
            }
        });
        let count = left.min(MAX_COUNT - current.count);
        current.count += count;
        current.next += 4 * u32::from(count);
        let bytes = command(space0(direction), current.count).to_le_bytes();
        for (target, byte) in self.packet.iter_mut().skip(current.at).zip(bytes) {
            *target = byte;
        }
        *open = Some(current);
        count
    }

    /// A write of one of the numbers; returns where in the packet it goes.
    fn push_number(&mut self, address: u16) -> usize {
        self.push_command(command(WRITE | SPACE4, 2), address);
        let at = self.packet.len();
        self.packet.extend_from_slice(&[0; 4]);
        at
    }

    fn push_read_back(&mut self) {
        self.push_command(command(SPACE4, 4), REQUEST_NUMBER);
        self.reply_len += NUMBERS_BYTES;
    }

    fn push_command(&mut self, command: u16, address: u16) {
        self.packet.extend_from_slice(&command.to_le_bytes());
        self.packet.extend_from_slice(&address.to_le_bytes());
    }
}

const WRITE: u16 = 1 << 15;
const SPACE0: u16 = 2 << 8;
const SPACE4: u16 = 4 << 10 | 1 << 8;
const MAX_COUNT: u16 = 127;

fn command(what: u16, count: u16) -> u16 {
    what | 1 << 14 | 1 << 7 | count
}

fn space0(direction: Direction) -> u16 {
    match direction {
        Direction::Read => SPACE0,
        Direction::Write => WRITE | SPACE0,
    }
}

fn patch(packet: &mut [u8], at: Option<usize>, number: u32) {
    let target = at.and_then(|at| packet.get_mut(at..at + 4));
    if let Some(target) = target {
        target.copy_from_slice(&number.to_le_bytes());
    }
}

fn word(bytes: &[u8]) -> u32 {
    bytes
        .iter()
        .rev()
        .fold(0, |word, &byte| word << 8 | u32::from(byte))
}

fn check(what: &'static str, bytes: usize) -> Result<(), UdpError> {
    if bytes <= MAX_PACKET {
        return Ok(());
    }
    Err(UdpError::TooLong {
        what,
        bytes,
        limit: MAX_PACKET,
    })
}

fn bad_access(access: Access, words: usize) -> UdpError {
    UdpError::BadAccess {
        address: access.address,
        first: access.words().start,
        end: access.words().end,
        words,
    }
}
