//! An access list as an LBP16 packet: encoded once, then only patched.

use core::ops::Range;

use super::UdpError;
use crate::bus::{Access, Direction};
use crate::lbp16::{BuildError, MAX_COUNT, MAX_PACKET, RequestBuilder, Space, registers};

/// Scratch registers of the board for the numbers of requests, and of write packets behind it
/// (FACTS 10.1).
const REQUEST_NUMBER: u16 = registers::timer::SCRATCH;
const WRITE_NUMBER: u16 = REQUEST_NUMBER + 4;
/// Both numbers, as 16-bit registers and as bytes.
const NUMBERS: u8 = 4;
const NUMBERS_BYTES: usize = 8;

/// A packet, and what has to be put into it and taken out of its reply.
#[derive(Clone, Debug, Default)]
pub(super) struct Encoding {
    packet: Vec<u8>,
    request_number: Option<Range<usize>>,
    write_number: Option<Range<usize>>,
    writes: Vec<Piece>,
    reads: Vec<Piece>,
    reply_len: usize,
}

/// Words of the buffer, and where their bytes are in a packet.
#[derive(Clone, Copy, Debug)]
struct Piece {
    offset: usize,
    first: usize,
    count: usize,
}

impl Encoding {
    /// The packet for `accesses`.
    ///
    /// It is answered if it reads anything, or if `acknowledged`.
    pub(super) fn accesses(accesses: &[Access], acknowledged: bool) -> Result<Self, UdpError> {
        if let Some(access) = accesses.iter().find(|a| !is_sound(**a)) {
            return Err(UdpError::bad_access(*access, usize::MAX));
        }
        let has = |direction| accesses.iter().any(|a| a.direction == direction);
        let answered = acknowledged || has(Direction::Read);
        let (mut writes, mut reads) = (Vec::new(), Vec::new());
        let mut this = Self::build(answered, has(Direction::Write), |request| {
            for run in runs(accesses) {
                let place = run.push(request)?;
                let pieces = match run.direction {
                    Direction::Read => &mut reads,
                    Direction::Write => &mut writes,
                };
                pieces.extend(run.pieces(place.start));
            }
            Ok(())
        })?;
        (this.writes, this.reads) = (writes, reads);
        Ok(this)
    }

    /// The packet that asks for the number of the last write the board executed.
    pub(super) fn question() -> Result<Self, UdpError> {
        Self::build(true, false, |_| Ok(()))
    }

    /// The packet that sets both numbers, and nothing else.
    pub(super) fn first_contact() -> Result<Self, UdpError> {
        Self::build(true, true, |_| Ok(()))
    }

    /// A packet of ready-made commands, which are answered with `reply_len` bytes.
    pub(super) fn raw(commands: &[u8], reply_len: usize) -> Result<Self, UdpError> {
        let mut this = Self::question()?;
        // Between the command that sets the request's number and the one that reads it back.
        let at = this.request_number.clone().map_or(0, |range| range.end);
        let tail = this.packet.split_off(at.min(this.packet.len()));
        this.packet.extend_from_slice(commands);
        this.packet.extend(tail);
        this.reply_len += reply_len;
        check("request", this.packet.len())?;
        check("reply", this.reply_len)?;
        Ok(this)
    }

    fn build(
        answered: bool,
        writes: bool,
        body: impl FnOnce(&mut RequestBuilder<'_>) -> Result<(), BuildError>,
    ) -> Result<Self, UdpError> {
        let mut buffer = [0; MAX_PACKET];
        let mut request = RequestBuilder::new(&mut buffer);
        let mut this = Self::default();
        let all = || -> Result<(), BuildError> {
            let number = |request: &mut RequestBuilder<'_>, address| {
                request
                    .write_words(Space::Timer, address, &[0, 0])
                    .map(Some)
            };
            if answered {
                this.request_number = number(&mut request, REQUEST_NUMBER)?;
            }
            body(&mut request)?;
            if writes {
                this.write_number = number(&mut request, WRITE_NUMBER)?;
            }
            if answered {
                request.read(Space::Timer, REQUEST_NUMBER, NUMBERS)?;
            }
            Ok(())
        };
        all().map_err(too_long)?;
        this.packet = request.bytes().to_vec();
        this.reply_len = request.reply_len();
        check("reply", this.reply_len)?;
        Ok(this)
    }

    /// The packet, with numbers and values put in.
    pub(super) fn packet(
        &mut self,
        words: &[u32],
        request: u32,
        write: impl FnOnce() -> u32,
    ) -> &[u8] {
        if let Some(range) = &self.request_number {
            put(&mut self.packet, range.start, [request]);
        }
        if let Some(range) = &self.write_number {
            put(&mut self.packet, range.start, [write()]);
        }
        for piece in &self.writes {
            let values = words.iter().skip(piece.first).take(piece.count);
            put(&mut self.packet, piece.offset, values.copied());
        }
        &self.packet
    }

    /// Takes the words of a reply, which has the right size.
    pub(super) fn take(&self, reply: &[u8], words: &mut [u32]) {
        for piece in &self.reads {
            let values = reply.get(piece.offset..).unwrap_or(&[]).chunks_exact(4);
            let targets = words.iter_mut().skip(piece.first).take(piece.count);
            for (target, value) in targets.zip(values) {
                *target = word(value);
            }
        }
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

    /// Whether the packet changes registers of the board.
    pub(super) fn has_writes(&self) -> bool {
        self.write_number.is_some()
    }

    /// Bytes of the reply.
    pub(super) fn reply_len(&self) -> usize {
        self.reply_len
    }
}

/// Checks that every access has its words in a buffer of this size.
pub(super) fn check_words(accesses: &[Access], words: usize) -> Result<(), UdpError> {
    match accesses.iter().find(|a| a.words().end > words) {
        Some(access) => Err(UdpError::bad_access(*access, words)),
        None => Ok(()),
    }
}

/// Neighbouring registers, as many as one command takes.
struct Run {
    direction: Direction,
    address: u16,
    count: u16,
    /// First word and number of words of each access, in order.
    words: Vec<(usize, usize)>,
}

/// The accesses in their order, neighbours joined and long ones split.
fn runs(accesses: &[Access]) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for access in accesses {
        let (mut address, mut left) = (access.address, access.count);
        let mut first = access.words().start;
        while left > 0 {
            let joins = |run: &Run| {
                let next = u32::from(run.address) + 4 * u32::from(run.count);
                let room = run.count < u16::from(MAX_COUNT);
                run.direction == access.direction && next == u32::from(address) && room
            };
            if !runs.last().is_some_and(joins) {
                runs.push(Run {
                    direction: access.direction,
                    address,
                    count: 0,
                    words: Vec::new(),
                });
            }
            let Some(run) = runs.last_mut() else { break };
            let count = left.min(u16::from(MAX_COUNT) - run.count);
            run.count += count;
            run.words.push((first, usize::from(count)));
            first += usize::from(count);
            address = address.wrapping_add(4 * count);
            left -= count;
        }
    }
    runs
}

impl Run {
    /// Adds the command; returns where its data are, in the request or the reply.
    fn push(&self, request: &mut RequestBuilder<'_>) -> Result<Range<usize>, BuildError> {
        let count = self.count as u8;
        match self.direction {
            Direction::Read => request.read(Space::HostMot2, self.address, count),
            Direction::Write => {
                let zeros = [0; MAX_COUNT as usize];
                let zeros = zeros.get(..usize::from(count)).unwrap_or(&[]);
                request.write_doubles(Space::HostMot2, self.address, zeros)
            }
        }
    }

    /// The words of each access, from byte `offset` of the packet on.
    fn pieces(&self, offset: usize) -> impl Iterator<Item = Piece> {
        self.words.iter().scan(offset, |offset, &(first, count)| {
            let piece = Piece {
                offset: *offset,
                first,
                count,
            };
            *offset += 4 * count;
            Some(piece)
        })
    }
}

fn is_sound(access: Access) -> bool {
    let end = u32::from(access.address) + 4 * u32::from(access.count);
    access.address.is_multiple_of(4) && end <= 0x1_0000
}

fn put(packet: &mut [u8], offset: usize, words: impl IntoIterator<Item = u32>) {
    let bytes = words.into_iter().flat_map(u32::to_le_bytes);
    for (target, byte) in packet.iter_mut().skip(offset).zip(bytes) {
        *target = byte;
    }
}

fn word(bytes: &[u8]) -> u32 {
    let value = |word, &byte| word << 8 | u32::from(byte);
    bytes.iter().rev().fold(0, value)
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

/// The only way in which commands of checked accesses do not fit into a request.
fn too_long(error: BuildError) -> UdpError {
    let bytes = match error {
        BuildError::NoRoom { needed, free } => MAX_PACKET - free + needed,
        _ => MAX_PACKET + 1,
    };
    UdpError::TooLong {
        what: "request",
        bytes,
        limit: MAX_PACKET,
    }
}
