//! An access list as an LBP16 packet: encoded once, then only patched.

use alloc::vec::Vec;
use core::ops::Range;
use core::time::Duration;

use super::ledger::{Account, Details, SLOTS, WriteEvidence, WriteNumber};
use super::wait::Wait;
use crate::bus::BoardIdentity;
use crate::bus::{Access, AccessList, BusError, Direction, Hold, ListForm};
use crate::lbp16::registers::{control, eeprom, read_only, timer};
use crate::lbp16::{Command, MAX_COUNT, MAX_PACKET, RequestBuilder, Space};

/// Scratch registers of the board: the slots of the writes, the last write, and the request.
const SLOT: u16 = timer::SCRATCH;
const LAST_WRITE: u16 = SLOT + 2 * SLOTS as u16;
const REQUEST_NUMBER: u16 = LAST_WRITE + 2;
/// The address behind them.
const END: u16 = REQUEST_NUMBER + 4;
/// The board's account at the end of a reply: its packet counts from RXUDPCount on, then the
/// scratch registers.
const BRIEF: Tail = Tail(1, LAST_WRITE);
/// The account in the reply to a whole cycle, whose write is the last one itself.
const OWN: Tail = Tail(1, REQUEST_NUMBER);
const DETAILED: Tail = Tail(4, SLOT);
/// Bytes of an address.
const ADDRESS: usize = 2;
/// Bytes of a command with its address.
const COMMAND: usize = 4;
/// Bytes of a [`Tail`].
const TAIL: usize = 2 * COMMAND;

/// The last two commands of a request, which read the board's account: the number of 16-bit
/// registers from RXUDPCount on, and the first of the scratch registers up to the request's number.
#[derive(Clone, Copy, Debug)]
struct Tail(u8, u16);

impl Tail {
    const fn scratch(self) -> u8 {
        END.saturating_sub(self.1) as u8 / 2
    }

    const fn reply_len(self) -> usize {
        let registers = (self.0 as usize).saturating_add(self.scratch() as usize);
        registers.saturating_mul(2)
    }

    /// Writes the commands to the end of a packet.
    fn put(self, packet: &mut [u8]) {
        let counts = Command::read(Space::Control, self.0).encode();
        let scratch = Command::read(Space::Timer, self.scratch()).encode();
        let words = [counts, control::RX_UDP, scratch, self.1].map(u16::to_le_bytes);
        let at = packet.len().saturating_sub(TAIL);
        put(packet, at, words.as_flattened());
    }
}

/// A list of accesses as a packet, with the places of the values in it and in its reply.
#[derive(Clone, Debug, Default)]
pub struct UdpList {
    /// Number among the prepared lists.
    pub(super) number: u32,
    pub(super) accesses: Vec<Access>,
    /// Number of words that the buffer must have.
    words: usize,
    /// The packet; the length of its reply is without the board's account.
    request: RequestBuilder,
    /// The packet is answered, and begins with the number of the request.
    pub(super) is_answered: bool,
    /// Evidence that its writes were executed, if the packet changes registers of the board.
    pub(super) kind: Option<WriteEvidence>,
    /// Offset of the address of the slot register, which is followed by the number of the write.
    slot: usize,
    /// Offset of the number for the last-write register, if the packet sets that register.
    last_write: Option<usize>,
    writes: Vec<Piece>,
    reads: Vec<Piece>,
    /// Longest time that the board may hold the packet back.
    pub(super) held: Duration,
    /// Offset in the reply of the time that the board held the packet back.
    waited: Option<usize>,
}

/// Words of the buffer, and the position of their bytes in a packet. Small, since each cycle reads
/// them all.
#[derive(Clone, Debug)]
struct Piece {
    words: Range<u16>,
    bytes: Range<u16>,
}

fn wide(range: &Range<u16>) -> Range<usize> {
    range.start.into()..range.end.into()
}

impl ListForm for UdpList {
    fn accesses(&self) -> &[Access] {
        &self.accesses
    }
}

impl UdpList {
    /// The packet of a list.
    ///
    /// # Errors
    /// [`BusError::OtherBus`]: a bus of another type prepared the list.
    pub(super) fn of(list: &AccessList) -> Result<&Self, BusError> {
        list.form().ok_or(BusError::OtherBus)
    }
}

/// Encoding.
impl UdpList {
    /// A list with room for a packet: [`encode`](Self::encode) does not allocate.
    pub(super) fn with_room() -> Self {
        Self {
            request: RequestBuilder {
                bytes: Vec::with_capacity(MAX_PACKET),
                reply_len: 0,
            },
            accesses: Vec::with_capacity(MAX_PACKET / 4),
            writes: Vec::with_capacity(MAX_PACKET / 4),
            ..Self::default()
        }
    }

    /// The packet for `accesses`, which is answered if it reads anything or is to be acknowledged.
    /// The part that is held back waits for the reference of the board's DPLL.
    pub(super) fn new(
        accesses: &[Access],
        is_acknowledged: bool,
        hold: Option<Hold>,
    ) -> Result<Self, BusError> {
        let mut this = Self::default();
        this.encode(accesses, is_acknowledged, hold)?;
        Ok(this)
    }

    /// Replaces the list by the packet that [`new`](Self::new) makes.
    pub(super) fn encode(
        &mut self,
        accesses: &[Access],
        is_acknowledged: bool,
        hold: Option<Hold>,
    ) -> Result<(), BusError> {
        let words = usize::from(u16::MAX);
        accesses.iter().try_for_each(|access| access.check(words))?;
        let limit = hold.map_or(Duration::ZERO, |hold| hold.limit);
        let Ok(limit_us) = u16::try_from(limit.as_micros()) else {
            return Err(BusError::LongHold { limit });
        };
        self.held = Duration::from_micros(limit_us.into());
        let has = |direction| accesses.iter().any(|access| access.direction == direction);
        let is_answered = is_acknowledged || hold.is_some() || has(Direction::Read);
        let kind = has(Direction::Write).then_some(match hold {
            Some(_) => WriteEvidence::Cycle,
            None if is_answered => WriteEvidence::Acknowledged,
            None => WriteEvidence::Alone,
        });
        self.accesses.clear();
        self.accesses.extend_from_slice(accesses);
        let ends = accesses.iter().map(|access| access.words().end);
        self.words = ends.max().unwrap_or(0);
        self.make(is_answered, kind, |this| {
            let before = hold.map_or(accesses.len(), |hold| hold.before);
            let (free, held) = accesses.split_at(before.min(accesses.len()));
            this.push_accesses(free);
            if hold.is_some() {
                this.write_timer(timer::HM2_TIMEOUT, &limit_us.to_le_bytes());
                let wait = Command::read(Space::Timer, 1);
                let waited = this.request.push(wait, timer::WAIT_FOR_HM2_REFERENCE, &[]);
                this.waited = Some(waited.start);
            }
            this.push_accesses(held);
        })
    }

    /// The packet that only asks for the board's account.
    pub(super) fn question() -> Result<Self, BusError> {
        Self::answered(None, &[], 0)
    }

    /// The packet that asks for the identity of the [board](Self::board).
    pub(super) fn identity() -> Result<Self, BusError> {
        let mut request = RequestBuilder::default();
        request.push(Command::read(Space::Eeprom, 3), eeprom::MAC, &[]);
        let name = Command::read(Space::ReadOnly, 8);
        request.push(name, read_only::CARD_NAME, &[]);
        Self::answered(None, &request.bytes, request.reply_len)
    }

    /// Parses the reply to [`identity`](Self::identity).
    pub(super) fn board(reply: &[u8]) -> BoardIdentity {
        let mut board = BoardIdentity::default();
        let (mac, card) = reply.split_at_checked(board.mac.len()).unwrap_or_default();
        // The low byte of the low word comes first.
        for (byte, received) in board.mac.iter_mut().rev().zip(mac) {
            *byte = *received;
        }
        put(&mut board.card, 0, card.get(..16).unwrap_or_default());
        board
    }

    /// The packet that clears the numbers of all writes. Executing it more than once is harmless.
    pub(super) fn clearing() -> Result<Self, BusError> {
        const REGISTERS: usize = SLOTS + 1;
        let mut request = RequestBuilder::default();
        let clear = Command::write(Space::Timer, REGISTERS as u8);
        request.push(clear, SLOT, &[0; 2 * REGISTERS]);
        Self::answered(None, &request.bytes, 0)
    }

    /// The packet of ready-made commands, which are answered with `reply_len` bytes.
    pub(super) fn answered(
        kind: Option<WriteEvidence>,
        commands: &[u8],
        reply_len: usize,
    ) -> Result<Self, BusError> {
        let mut this = Self::default();
        this.make(true, kind, |this| {
            this.request.bytes.extend_from_slice(commands);
            let all = this.request.reply_len.saturating_add(reply_len);
            this.request.reply_len = all;
        })?;
        Ok(this)
    }

    fn make(
        &mut self,
        is_answered: bool,
        kind: Option<WriteEvidence>,
        body: impl FnOnce(&mut Self),
    ) -> Result<(), BusError> {
        self.request.bytes.clear();
        self.writes.clear();
        self.reads.clear();
        (self.request.reply_len, self.waited, self.last_write) = (0, None, None);
        (self.is_answered, self.kind) = (is_answered, kind);
        if is_answered {
            self.write_timer(REQUEST_NUMBER, &[0; 4]);
        }
        body(self);
        if kind.is_some() {
            let number = self.write_timer(SLOT, &[0; 2]);
            self.slot = number.saturating_sub(ADDRESS);
        }
        if kind.is_some_and(|kind| kind != WriteEvidence::Cycle) {
            self.last_write = Some(self.write_timer(LAST_WRITE, &[0; 2]));
        }
        if is_answered {
            self.request.bytes.extend([0; TAIL]);
            self.tail(false).put(&mut self.request.bytes);
        }
        let (request, reply) = (self.request.bytes.len(), self.reply_len(true));
        for (what, bytes) in [("request", request), ("reply", reply)] {
            let limit = MAX_PACKET;
            if bytes > limit {
                return Err(BusError::TooLong { what, bytes, limit });
            }
        }
        Ok(())
    }

    /// Adds a write of 16-bit registers; returns the offset of their bytes.
    fn write_timer(&mut self, address: u16, data: &[u8]) -> usize {
        let write = Command::write(Space::Timer, data.len() as u8 / 2);
        self.request.push(write, address, data).start
    }

    /// Adds accesses in their order. Neighbouring registers share a command, up to its limit.
    fn push_accesses(&mut self, accesses: &[Access]) {
        // Offset of the newest command, and its registers.
        let mut newest: Option<(usize, Access)> = None;
        for access in accesses {
            let mut next = *access;
            for _ in 0..access.count {
                let begun = newest.filter(|(_, run)| goes_on(*run, next));
                let (at, mut run) = begun.unwrap_or_else(|| {
                    let mut command = Command::read(Space::HostMot2, 0);
                    command.write = next.direction == Direction::Write;
                    let at = self.request.bytes.len();
                    self.request.push(command, next.address, &[]);
                    (at, Access { count: 0, ..next })
                });
                run.count = run.count.saturating_add(1);
                // The lowest bits of a command are its count; `goes_on` keeps it within its field.
                if let Some(low) = self.request.bytes.get_mut(at) {
                    *low = low.saturating_add(1);
                }
                newest = Some((at, run));
                self.push_word(next.direction, next.first);
                // No register follows the last one of the board.
                next.address = next.address.wrapping_add(4);
                next.first = next.first.wrapping_add(1);
            }
        }
    }

    /// Adds the place of a word. An offset that exceeds any packet is truncated; the packet is
    /// refused later.
    fn push_word(&mut self, direction: Direction, word: u16) {
        let (pieces, at) = match direction {
            Direction::Read => {
                let at = self.request.reply_len;
                self.request.reply_len = at.saturating_add(4);
                (&mut self.reads, at)
            }
            Direction::Write => {
                let at = self.request.bytes.len();
                self.request.bytes.extend([0; 4]);
                (&mut self.writes, at)
            }
        };
        let (words, at) = (word..word.saturating_add(1), at as u16);
        let bytes = at..at.wrapping_add(4);
        match pieces.last_mut() {
            Some(last) if last.words.end == word && last.bytes.end == bytes.start => {
                (last.words.end, last.bytes.end) = (words.end, bytes.end);
            }
            _ => pieces.push(Piece { words, bytes }),
        }
    }
}

/// Use in an exchange.
impl UdpList {
    /// The packet, made in `buffer`, with the values of `words` and the numbers of its request and
    /// its write, where it has them.
    pub(super) fn packet<'a>(
        &self,
        buffer: &'a mut [u8],
        words: &[u32],
        wait: Option<Wait>,
        write: Option<WriteNumber>,
    ) -> &'a [u8] {
        let template = &self.request.bytes;
        let packet = buffer.get_mut(..template.len()).unwrap_or_default();
        put(packet, 0, template);
        if let Some(wait) = wait {
            put(packet, COMMAND, &wait.request.to_le_bytes());
            if wait.detailed {
                DETAILED.put(packet);
            }
        }
        if let Some(WriteNumber { number, slot }) = write {
            let register = SLOT.saturating_add((slot as u16).saturating_mul(2));
            let words = [register, number as u16].map(u16::to_le_bytes);
            put(packet, self.slot, words.as_flattened());
            if let Some(at) = self.last_write {
                put(packet, at, &words[1]);
            }
        }
        for piece in &self.writes {
            let values = words.get(wide(&piece.words)).unwrap_or_default();
            let bytes = packet.get_mut(wide(&piece.bytes)).unwrap_or_default();
            for (target, value) in bytes.chunks_exact_mut(4).zip(values) {
                target.copy_from_slice(&value.to_le_bytes());
            }
        }
        packet
    }

    /// Copies the words out of a reply, which must have the right size.
    pub(super) fn take(&self, reply: &[u8], words: &mut [u32]) {
        for piece in &self.reads {
            let bytes = reply.get(wide(&piece.bytes)).unwrap_or_default();
            let (values, _) = bytes.as_chunks();
            let targets = words.get_mut(wide(&piece.words)).unwrap_or_default();
            for (target, value) in targets.iter_mut().zip(values) {
                *target = u32::from_le_bytes(*value);
            }
        }
    }

    /// Time in microseconds that the board held the packet back before it sent this reply; `None`
    /// if the packet is not held back.
    pub(super) fn waited_us(&self, reply: &[u8]) -> Option<u16> {
        let bytes = reply.get(self.waited?..)?.first_chunk()?;
        Some(u16::from_le_bytes(*bytes))
    }

    /// The number of the request that any reply answers.
    pub(super) fn number(reply: &[u8]) -> Option<u32> {
        reply.last_chunk().copied().map(u32::from_le_bytes)
    }

    /// The board's account in a reply, which must have the right size. `detailed`: the details were
    /// requested.
    pub(super) fn account(&self, reply: &[u8], detailed: bool) -> Account {
        let mut words = [0; DETAILED.reply_len() / 2];
        let tail = reply.get(self.request.reply_len..).unwrap_or_default();
        let (tail, _) = tail.as_chunks();
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
        let is_own = self.kind == Some(WriteEvidence::Cycle);
        Account {
            last_write: (!is_own).then_some(last_write),
            received,
            details,
        }
    }

    fn tail(&self, detailed: bool) -> Tail {
        match self.kind {
            _ if detailed => DETAILED,
            Some(WriteEvidence::Cycle) => OWN,
            _ => BRIEF,
        }
    }

    /// Bytes of the reply; 0 without a reply. `detailed`: with the details.
    pub(super) fn reply_len(&self, detailed: bool) -> usize {
        if self.is_answered {
            let tail = self.tail(detailed).reply_len();
            self.request.reply_len.saturating_add(tail)
        } else {
            0
        }
    }

    /// Checks that every access has its words in a buffer of this size.
    pub(super) fn check_words(&self, words: usize) -> Result<(), BusError> {
        if self.words <= words {
            return Ok(());
        }
        let mut accesses = self.accesses.iter();
        let missing = accesses.find(|access| access.words().end > words);
        missing.map_or(Ok(()), |&access| Err(BusError::BadAccess { access, words }))
    }
}

/// True if the command has room, and ends where the next access begins.
fn goes_on(run: Access, next: Access) -> bool {
    run.direction == next.direction
        && end(run) == u32::from(next.address)
        && run.count < u16::from(MAX_COUNT)
}

/// The address behind its registers.
fn end(access: Access) -> u32 {
    let bytes = u32::from(access.count).saturating_mul(4);
    bytes.saturating_add(access.address.into())
}

fn put(packet: &mut [u8], offset: usize, bytes: &[u8]) {
    let place = packet.get_mut(offset..);
    let place = place.and_then(|rest| rest.get_mut(..bytes.len()));
    debug_assert!(place.is_some(), "it was made with this place");
    if let Some(place) = place {
        place.copy_from_slice(bytes);
    }
}
