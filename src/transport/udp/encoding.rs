//! An access list as an LBP16 packet: encoded once, then only patched.

use super::UdpError;
use super::ledger::{Account, Details, Kind, SLOTS};
use super::receiving::Wait;
use super::runs::{Piece, joined, runs};
use crate::bus::{Access, Direction};
use crate::lbp16::{Lbp16Error, MAX_COUNT, MAX_PACKET, RequestBuilder, Space, registers};

/// Scratch registers of the board: the writes' turns, the last write, and the request.
const SLOT: u16 = registers::timer::SCRATCH;
const LAST_WRITE: u16 = SLOT + 2 * SLOTS as u16;
const REQUEST_NUMBER: u16 = LAST_WRITE + 2;
/// Bytes of the board's account at the end of a reply, and how many 16-bit registers they are:
/// its counts of packets, from RXUDPCount on, then the scratch registers.
const BRIEF: Tail = Tail {
    counts: 1,
    first: LAST_WRITE,
    scratch: 3,
};
/// Of a whole cycle, whose write is the last itself.
const OWN: Tail = Tail {
    counts: 1,
    first: REQUEST_NUMBER,
    scratch: 2,
};
const DETAILED: Tail = Tail {
    counts: 4,
    first: SLOT,
    scratch: 8,
};
/// Bytes of a command with its address.
const COMMAND: usize = 4;

/// What the board's account is read by: the last two commands of a request.
#[derive(Clone, Copy, Debug)]
struct Tail {
    /// Registers from RXUDPCount on.
    counts: u8,
    /// First scratch register.
    first: u16,
    /// Scratch registers up to the request's number.
    scratch: u8,
}

impl Tail {
    const fn reply_len(self) -> usize {
        2 * (self.counts as usize + self.scratch as usize)
    }

    fn push(self, request: &mut RequestBuilder<'_>) -> Result<(), Lbp16Error> {
        request.read(Space::Control, registers::control::RX_UDP, self.counts)?;
        request.read(Space::Timer, self.first, self.scratch)?;
        Ok(())
    }
}

/// A packet, and what has to be put into a copy of it and taken out of its reply.
#[derive(Clone, Debug, Default)]
pub(super) struct Encoding {
    packet: Vec<u8>,
    /// Where the number of the request is, if it is answered.
    request_number: Option<usize>,
    write_numbers: Option<WriteNumbers>,
    writes: Vec<Piece>,
    reads: Vec<Piece>,
    /// Where the reply has the time that the board waited, if it waits.
    waited: Option<usize>,
    /// Bytes of the reply before the board's account.
    body_len: usize,
    /// What tells that its writes were executed, if it has any.
    kind: Option<Kind>,
    /// Both ways to ask for the account: the packet ends with one of them.
    tails: [[u8; 2 * COMMAND]; 2],
    /// The most words that the buffer must have, and the access that needs them.
    needs: Option<Access>,
}

/// Where a packet has the number of its write: for its turn, and as the last if it says so.
#[derive(Clone, Debug)]
struct WriteNumbers {
    slot: usize,
    last: Option<usize>,
}

/// How a list is run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Manner {
    /// It is answered even if it reads nothing.
    pub acknowledged: bool,
    /// Before the access of this number the board waits for the reference of its DPLL, at most so
    /// many microseconds.
    pub wait: Option<(usize, u16)>,
}

impl Encoding {
    /// The packet for `accesses`.
    ///
    /// It is answered if it reads anything, or if it is to be acknowledged.
    pub(super) fn accesses(accesses: &[Access], manner: Manner) -> Result<Self, UdpError> {
        if let Some(access) = accesses.iter().find(|a| !is_sound(**a)) {
            return Err(UdpError::bad_access(*access, usize::MAX));
        }
        let has = |direction| accesses.iter().any(|a| a.direction == direction);
        let answered = manner.acknowledged || has(Direction::Read);
        let kind = has(Direction::Write).then_some(match manner {
            Manner { wait: Some(_), .. } => Kind::Cycle,
            _ if answered => Kind::Acknowledged,
            _ => Kind::Alone,
        });
        let (mut writes, mut reads) = (Vec::new(), Vec::new());
        let mut waited = None;
        let mut this = Self::build(answered, kind, |request| {
            let mut push = |request: &mut RequestBuilder<'_>, accesses| {
                for run in runs(accesses) {
                    let place = run.push(request)?;
                    let pieces = match run.direction {
                        Direction::Read => &mut reads,
                        Direction::Write => &mut writes,
                    };
                    pieces.extend(run.pieces(place.start));
                }
                Ok(())
            };
            let Some((before, limit)) = manner.wait else {
                return push(request, accesses);
            };
            let (free, held) = accesses.split_at(before.min(accesses.len()));
            push(request, free)?;
            request.write_words(Space::Timer, registers::timer::HM2_TIMEOUT, &[limit])?;
            let wait = registers::timer::WAIT_FOR_HM2_REFERENCE;
            waited = Some(request.read(Space::Timer, wait, 1)?.start);
            push(request, held)
        })?;
        (this.writes, this.reads, this.waited) = (writes, reads, waited);
        this.needs = accesses.iter().copied().max_by_key(|a| a.words().end);
        Ok(this)
    }

    /// The packet that only asks for the board's account.
    pub(super) fn question() -> Result<Self, UdpError> {
        Self::build(true, None, |_| Ok(()))
    }

    /// The packet that clears the numbers of all writes. It may be executed more than once.
    pub(super) fn clearing() -> Result<Self, UdpError> {
        Self::build(true, None, |request| {
            request.write_words(Space::Timer, SLOT, &[0; SLOTS + 1])?;
            Ok(())
        })
    }

    /// The packet that is a write with a number, and nothing else.
    pub(super) fn first_contact() -> Result<Self, UdpError> {
        Self::build(true, Some(Kind::Acknowledged), |_| Ok(()))
    }

    /// A packet of ready-made commands, which are answered with `reply_len` bytes.
    pub(super) fn raw(commands: &[u8], reply_len: usize) -> Result<Self, UdpError> {
        let mut this = Self::question()?;
        // Between the command that sets the request's number and those that ask for the account.
        let at = this.request_number.map_or(0, |at| at + 4);
        let tail = this.packet.split_off(at.min(this.packet.len()));
        this.packet.extend_from_slice(commands);
        this.packet.extend(tail);
        this.body_len += reply_len;
        check("request", this.packet.len())?;
        check("reply", this.reply_len(true))?;
        Ok(this)
    }

    fn build(
        answered: bool,
        kind: Option<Kind>,
        body: impl FnOnce(&mut RequestBuilder<'_>) -> Result<(), Lbp16Error>,
    ) -> Result<Self, UdpError> {
        let mut buffer = [0; MAX_PACKET];
        let mut request = RequestBuilder::new(&mut buffer);
        let mut this = Self {
            kind,
            ..Self::default()
        };
        let brief = this.brief();
        let all = || -> Result<(), Lbp16Error> {
            if answered {
                let number = request.write_words(Space::Timer, REQUEST_NUMBER, &[0, 0])?;
                this.request_number = Some(number.start);
            }
            body(&mut request)?;
            if let Some(kind) = kind {
                let slot = request.write_words(Space::Timer, SLOT, &[0])?.start;
                let last = match kind {
                    Kind::Cycle => None,
                    _ => Some(request.write_words(Space::Timer, LAST_WRITE, &[0])?.start),
                };
                this.write_numbers = Some(WriteNumbers { slot, last });
            }
            this.body_len = request.reply_len();
            if answered {
                brief.push(&mut request)?;
            }
            Ok(())
        };
        all().map_err(too_long)?;
        this.packet = request.bytes().to_vec();
        if answered {
            this.tails = [tail(brief)?, tail(DETAILED)?];
        }
        check("reply", this.reply_len(true))?;
        Ok(this)
    }

    /// The packet, made in `buffer`, with the values of `words` and the numbers of what waits for its
    /// reply, if anything does, and of its write.
    pub(super) fn packet<'a>(
        &self,
        buffer: &'a mut [u8],
        words: &[u32],
        wait: Option<Wait>,
        write: Option<(u32, usize)>,
    ) -> &'a [u8] {
        let packet = buffer.get_mut(..self.packet.len()).unwrap_or_default();
        put(packet, 0, &self.packet);
        if let (Some(at), Some(wait)) = (self.request_number, wait) {
            put(packet, at, &wait.request.to_le_bytes());
            let [brief, details] = &self.tails;
            let tail = if wait.detailed { details } else { brief };
            let at = packet.len().saturating_sub(tail.len());
            put(packet, at, tail);
        }
        if let (Some(at), Some((number, slot))) = (&self.write_numbers, write) {
            let address = SLOT + 2 * slot as u16;
            let number = (number as u16).to_le_bytes();
            put(packet, at.slot - 2, &address.to_le_bytes());
            put(packet, at.slot, &number);
            if let Some(last) = at.last {
                put(packet, last, &number);
            }
        }
        for piece in &self.writes {
            let values = words.get(piece.words()).unwrap_or_default();
            let bytes = packet.get_mut(piece.bytes()).unwrap_or_default();
            for (target, value) in bytes.chunks_exact_mut(4).zip(values) {
                target.copy_from_slice(&value.to_le_bytes());
            }
        }
        packet
    }

    /// Takes the words of a reply, which has the right size.
    pub(super) fn take(&self, reply: &[u8], words: &mut [u32]) {
        for piece in &self.reads {
            let (values, _) = reply.get(piece.bytes()).unwrap_or_default().as_chunks();
            let targets = words.get_mut(piece.words()).unwrap_or_default();
            for (target, value) in targets.iter_mut().zip(values) {
                *target = u32::from_le_bytes(*value);
            }
        }
    }

    /// How long the board waited before it answered like this, in microseconds, if it was to.
    pub(super) fn waited_us(&self, reply: &[u8]) -> Option<u16> {
        let bytes = reply.get(self.waited?..)?.first_chunk()?;
        Some(u16::from_le_bytes(*bytes))
    }

    /// The number of the request that any reply answers.
    pub(super) fn number(reply: &[u8]) -> Option<u32> {
        reply.last_chunk().copied().map(u32::from_le_bytes)
    }

    /// The board's account in a reply, which has the right size. `detailed`: it was asked for the
    /// whole of it.
    pub(super) fn account(&self, reply: &[u8], detailed: bool) -> Option<Account> {
        let mut words = [0; DETAILED.reply_len() / 2];
        let (tail, _) = reply.get(self.body_len..)?.as_chunks();
        for (word, bytes) in words.iter_mut().zip(tail) {
            *word = u16::from_le_bytes(*bytes);
        }
        let (received, last_write, details) = if detailed {
            let [received, _, _, sent, slots @ .., last_write, _, _] = words;
            (received, last_write, Some(Details { slots, sent }))
        } else {
            let [received, last_write, ..] = words;
            (received, last_write, None)
        };
        let is_own = self.kind == Some(Kind::Cycle);
        Some(Account {
            last_write: (!is_own).then_some(last_write),
            received,
            details,
        })
    }

    /// Whether the packet is answered.
    pub(super) fn is_answered(&self) -> bool {
        self.request_number.is_some()
    }

    /// What tells that its writes were executed, if the packet changes registers of the board.
    pub(super) fn kind(&self) -> Option<Kind> {
        self.kind
    }

    fn brief(&self) -> Tail {
        if self.kind == Some(Kind::Cycle) {
            OWN
        } else {
            BRIEF
        }
    }

    /// Bytes of the packet.
    pub(super) fn request_len(&self) -> usize {
        self.packet.len()
    }

    /// Bytes of the reply; 0 if there is none. `detailed`: with the whole account.
    pub(super) fn reply_len(&self, detailed: bool) -> usize {
        let tail = if detailed { DETAILED } else { self.brief() };
        if self.is_answered() {
            self.body_len + tail.reply_len()
        } else {
            0
        }
    }

    /// Checks that every access has its words in a buffer of this size.
    pub(super) fn check_words(&self, words: usize) -> Result<(), UdpError> {
        match self.needs {
            Some(access) if access.words().end > words => Err(UdpError::bad_access(access, words)),
            _ => Ok(()),
        }
    }
}

fn tail(tail: Tail) -> Result<[u8; 2 * COMMAND], UdpError> {
    let mut buffer = [0; 2 * COMMAND];
    tail.push(&mut RequestBuilder::new(&mut buffer))
        .map_err(too_long)?;
    Ok(buffer)
}

/// A packet of writes that is made for once, in `buffer`: what [`Encoding::packet`] gives for a
/// list. Does not allocate.
pub(super) fn write_packet<'a>(
    buffer: &'a mut [u8],
    accesses: impl Iterator<Item = Access>,
    words: &[u32],
    (number, slot): (u32, usize),
) -> Result<&'a [u8], UdpError> {
    let mut request = RequestBuilder::new(buffer);
    let mut bad = None;
    let all = || -> Result<(), Lbp16Error> {
        for access in joined(accesses) {
            let Some(values) = words.get(access.words()) else {
                bad = Some(access);
                break;
            };
            let parts = values.chunks(usize::from(MAX_COUNT));
            let stride = 4 * u16::from(MAX_COUNT);
            for (n, part) in (0u16..).zip(parts) {
                let address = access.address.wrapping_add(n * stride);
                request.write_doubles(Space::HostMot2, address, part)?;
            }
        }
        let number = [number as u16];
        request.write_words(Space::Timer, SLOT + 2 * slot as u16, &number)?;
        request.write_words(Space::Timer, LAST_WRITE, &number)?;
        Ok(())
    };
    all().map_err(too_long)?;
    let length = request.bytes().len();
    if let Some(access) = bad {
        return Err(UdpError::bad_access(access, words.len()));
    }
    Ok(buffer.get(..length).unwrap_or_default())
}

fn is_sound(access: Access) -> bool {
    let end = u32::from(access.address) + 4 * u32::from(access.count);
    access.address.is_multiple_of(4) && end <= 0x1_0000 && access.words().end <= 0xFFFF
}

fn put(packet: &mut [u8], offset: usize, bytes: &[u8]) {
    let place = packet.get_mut(offset..offset + bytes.len());
    debug_assert!(place.is_some(), "it was made with this place");
    if let Some(place) = place {
        place.copy_from_slice(bytes);
    }
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
fn too_long(error: Lbp16Error) -> UdpError {
    let bytes = match error {
        Lbp16Error::NoRoom { needed, free } => MAX_PACKET - free + needed,
        _ => MAX_PACKET + 1,
    };
    UdpError::TooLong {
        what: "request",
        bytes,
        limit: MAX_PACKET,
    }
}
