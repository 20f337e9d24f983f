//! An access list as an LBP16 packet: encoded once, then only patched.

use core::ops::Range;
use core::time::Duration;

use super::UdpError;
use super::ledger::{Account, Details, Kind, SLOTS};
use super::receiving::Wait;
use crate::bus::{Access, Direction, Hold};
use crate::lbp16::registers::{control, timer};
use crate::lbp16::{Command, MAX_COUNT, MAX_PACKET, Space};

/// Scratch registers of the board: the writes' turns, the last write, and the request.
const SLOT: u16 = timer::SCRATCH;
const LAST_WRITE: u16 = SLOT + 2 * SLOTS as u16;
const REQUEST_NUMBER: u16 = LAST_WRITE + 2;
/// The board's account at the end of a reply: its counts of packets, from RXUDPCount on, then the
/// scratch registers.
const BRIEF: Tail = Tail::new(1, LAST_WRITE);
/// Of a whole cycle, whose write is the last itself.
const OWN: Tail = Tail::new(1, REQUEST_NUMBER);
const DETAILED: Tail = Tail::new(4, SLOT);
/// Bytes of a command with its address.
const COMMAND: usize = 4;

/// What the board's account is read by: the last two commands of a request.
#[derive(Clone, Copy, Debug)]
struct Tail {
    /// 16-bit registers from RXUDPCount on.
    counts: u8,
    /// First scratch register.
    first: u16,
    /// Scratch registers up to the request's number.
    scratch: u8,
}

impl Tail {
    const fn new(counts: u8, first: u16) -> Self {
        Self {
            counts,
            first,
            scratch: (REQUEST_NUMBER + 4 - first) as u8 / 2,
        }
    }

    const fn reply_len(self) -> usize {
        2 * (self.counts as usize + self.scratch as usize)
    }

    fn commands(self) -> [[u8; COMMAND]; 2] {
        [
            command(
                Direction::Read,
                Space::Control,
                control::RX_UDP,
                self.counts,
            ),
            command(Direction::Read, Space::Timer, self.first, self.scratch),
        ]
    }
}

/// A list of accesses as a packet, and what has to be put into a copy of it and taken out of its
/// reply.
#[derive(Clone, Debug, Default)]
pub struct UdpList {
    /// Which of the lists that were prepared.
    pub(super) number: u32,
    pub(super) accesses: Vec<Access>,
    /// How many words the buffer must have.
    words: usize,
    packet: Vec<u8>,
    /// The packet is answered, and begins with the number of the request.
    pub(super) is_answered: bool,
    /// What tells that its writes were executed, if the packet changes registers of the board.
    pub(super) kind: Option<Kind>,
    /// Where the number of its write is: for its slot, and behind it as the last if it says so.
    write_number: usize,
    writes: Vec<Piece>,
    reads: Vec<Piece>,
    /// How long the board may hold it back, ...
    pub(super) held: Duration,
    /// ... and where the reply has the time that it did.
    waited: Option<usize>,
    /// Bytes of the reply before the board's account.
    body_len: usize,
}

/// Words of the buffer, and where their bytes are in a packet.
#[derive(Clone, Copy, Debug)]
struct Piece {
    offset: u16,
    first: u16,
    count: u16,
}

impl Piece {
    fn words(self) -> Range<usize> {
        let first = usize::from(self.first);
        first..first + usize::from(self.count)
    }

    fn bytes(self) -> Range<usize> {
        let offset = usize::from(self.offset);
        offset..offset + 4 * usize::from(self.count)
    }
}

impl AsRef<[Access]> for UdpList {
    fn as_ref(&self) -> &[Access] {
        &self.accesses
    }
}

impl UdpList {
    /// Bytes of the packet that is sent, without the headers of lower layers.
    pub fn request_bytes(&self) -> usize {
        self.packet.len()
    }

    /// Bytes of its reply; 0 if it has none. A reply that tells of packets that were lost has 16
    /// more.
    pub fn reply_bytes(&self) -> usize {
        self.reply_len(false)
    }
}

/// Making packets.
impl UdpList {
    /// With room for a packet: [`encode`](Self::encode) does not allocate.
    pub(super) fn with_room() -> Self {
        Self {
            packet: Vec::with_capacity(MAX_PACKET),
            accesses: Vec::with_capacity(MAX_PACKET / 4),
            writes: Vec::with_capacity(MAX_PACKET / 4),
            ..Self::default()
        }
    }

    /// The packet for `accesses`, which is answered if it reads anything, or if it is to be
    /// acknowledged. What is held back waits for the reference of the board's DPLL.
    pub(super) fn new(
        accesses: &[Access],
        is_acknowledged: bool,
        hold: Option<Hold>,
    ) -> Result<Self, UdpError> {
        let mut this = Self::default();
        this.encode(accesses, is_acknowledged, hold)?;
        Ok(this)
    }

    /// Becomes the packet that [`new`](Self::new) makes.
    pub(super) fn encode(
        &mut self,
        accesses: &[Access],
        is_acknowledged: bool,
        hold: Option<Hold>,
    ) -> Result<(), UdpError> {
        if let Some(&access) = accesses.iter().find(|access| !is_sound(**access)) {
            let words = usize::from(u16::MAX);
            return Err(UdpError::BadAccess { access, words });
        }
        let limit = hold.map_or(Duration::ZERO, |hold| hold.limit);
        let Ok(limit_us) = u16::try_from(limit.as_micros()) else {
            return Err(UdpError::LongHold { limit });
        };
        self.held = Duration::from_micros(limit_us.into());
        let has = |direction| accesses.iter().any(|access| access.direction == direction);
        let is_answered = is_acknowledged || hold.is_some() || has(Direction::Read);
        let kind = has(Direction::Write).then_some(match hold {
            Some(_) => Kind::Cycle,
            None if is_answered => Kind::Acknowledged,
            None => Kind::Alone,
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
                this.write_timer(timer::HM2_TIMEOUT, &[limit_us]);
                this.waited = Some(this.body_len);
                let address = timer::WAIT_FOR_HM2_REFERENCE;
                let wait = command(Direction::Read, Space::Timer, address, 1);
                this.packet.extend(wait);
                this.body_len += 2;
            }
            this.push_accesses(held);
        })
    }

    /// The packet that only asks for the board's account.
    pub(super) fn question() -> Result<Self, UdpError> {
        Self::answered(None, |_| {})
    }

    /// The packet that clears the numbers of all writes. It may be executed more than once.
    pub(super) fn clearing() -> Result<Self, UdpError> {
        Self::answered(None, |this| {
            this.write_timer(SLOT, &[0; SLOTS + 1]);
        })
    }

    /// The packet that is a write with a number, and nothing else.
    pub(super) fn first_contact() -> Result<Self, UdpError> {
        Self::answered(Some(Kind::Acknowledged), |_| {})
    }

    /// A packet of ready-made commands, which are answered with `reply_len` bytes.
    pub(super) fn raw(commands: &[u8], reply_len: usize) -> Result<Self, UdpError> {
        Self::answered(None, |this| {
            this.packet.extend_from_slice(commands);
            this.body_len += reply_len;
        })
    }

    fn answered(kind: Option<Kind>, body: impl FnOnce(&mut Self)) -> Result<Self, UdpError> {
        let mut this = Self::default();
        this.make(true, kind, body)?;
        Ok(this)
    }

    fn make(
        &mut self,
        is_answered: bool,
        kind: Option<Kind>,
        body: impl FnOnce(&mut Self),
    ) -> Result<(), UdpError> {
        self.packet.clear();
        self.writes.clear();
        self.reads.clear();
        (self.body_len, self.waited) = (0, None);
        (self.is_answered, self.kind) = (is_answered, kind);
        if is_answered {
            self.write_timer(REQUEST_NUMBER, &[0, 0]);
        }
        body(self);
        if kind.is_some() {
            self.write_number = self.write_timer(SLOT, &[0]);
        }
        if kind.is_some_and(|kind| kind != Kind::Cycle) {
            self.write_timer(LAST_WRITE, &[0]);
        }
        if is_answered {
            self.packet.extend(self.brief().commands().as_flattened());
        }
        check("request", self.packet.len())?;
        check("reply", self.reply_len(true))
    }

    /// Adds a write of 16-bit registers; returns where their bytes are.
    fn write_timer(&mut self, address: u16, words: &[u16]) -> usize {
        let count = words.len() as u8;
        self.packet
            .extend(command(Direction::Write, Space::Timer, address, count));
        let at = self.packet.len();
        self.packet
            .extend(words.iter().flat_map(|word| word.to_le_bytes()));
        at
    }

    /// Adds accesses in their order. Neighbouring registers share a command, as many as it takes.
    fn push_accesses(&mut self, accesses: &[Access]) {
        // The newest command, and where it is.
        let mut newest: Option<(usize, Access)> = None;
        for access in accesses {
            let mut rest = *access;
            while rest.count > 0 {
                let end = self.packet.len();
                let (at, mut run) = newest
                    .filter(|(_, run)| goes_on(*run, rest))
                    .unwrap_or((end, Access { count: 0, ..rest }));
                let count = rest.count.min(u16::from(MAX_COUNT) - run.count);
                run.count += count;
                let header = command(run.direction, Space::HostMot2, run.address, run.count as u8);
                if at == end {
                    self.packet.extend(header);
                } else {
                    put(&mut self.packet, at, &header);
                }
                self.push_words(rest, count);
                newest = Some((at, run));
                rest = Access {
                    address: rest.address.wrapping_add(4 * count),
                    first: rest.first + count,
                    count: rest.count - count,
                    ..rest
                };
            }
        }
    }

    /// Adds the first `count` words of an access.
    fn push_words(&mut self, access: Access, count: u16) {
        let bytes = 4 * usize::from(count);
        let (pieces, offset) = match access.direction {
            Direction::Read => {
                self.body_len += bytes;
                (&mut self.reads, self.body_len - bytes)
            }
            Direction::Write => {
                let offset = self.packet.len();
                self.packet.resize(offset + bytes, 0);
                (&mut self.writes, offset)
            }
        };
        let piece = Piece {
            offset: offset as u16,
            first: access.first,
            count,
        };
        match pieces.last_mut() {
            Some(last) if last.bytes().end == offset && last.words().end == piece.words().start => {
                last.count += count;
            }
            _ => pieces.push(piece),
        }
    }
}

/// Running them.
impl UdpList {
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
        if let Some(wait) = wait {
            put(packet, COMMAND, &wait.request.to_le_bytes());
            if wait.detailed {
                let commands = DETAILED.commands();
                let at = packet.len().saturating_sub(commands.as_flattened().len());
                put(packet, at, commands.as_flattened());
            }
        }
        if let Some((number, slot)) = write {
            let (at, number) = (self.write_number, (number as u16).to_le_bytes());
            put(packet, at - 2, &(SLOT + 2 * slot as u16).to_le_bytes());
            put(packet, at, &number);
            if self.kind != Some(Kind::Cycle) {
                put(packet, at + 2 + COMMAND, &number);
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
    pub(super) fn account(&self, reply: &[u8], detailed: bool) -> Account {
        let mut words = [0; DETAILED.reply_len() / 2];
        let (tail, _) = reply.get(self.body_len..).unwrap_or_default().as_chunks();
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
        Account {
            last_write: (!is_own).then_some(last_write),
            received,
            details,
        }
    }

    fn brief(&self) -> Tail {
        if self.kind == Some(Kind::Cycle) {
            OWN
        } else {
            BRIEF
        }
    }

    /// Bytes of the reply; 0 if there is none. `detailed`: with the whole account.
    pub(super) fn reply_len(&self, detailed: bool) -> usize {
        let tail = if detailed { DETAILED } else { self.brief() };
        if self.is_answered {
            self.body_len + tail.reply_len()
        } else {
            0
        }
    }

    /// Checks that every access has its words in a buffer of this size.
    pub(super) fn check_words(&self, words: usize) -> Result<(), UdpError> {
        if self.words <= words {
            return Ok(());
        }
        let is_missing = |access: &&Access| access.words().end > words;
        let access = self
            .accesses
            .iter()
            .copied()
            .find(|access| is_missing(&access));
        Err(UdpError::BadAccess {
            access: access.unwrap_or(Access::read(0, 0, 0)),
            words,
        })
    }
}

/// A command of `count` registers, 1 to 127, of a space's own size, and its address.
fn command(direction: Direction, space: Space, address: u16, count: u8) -> [u8; COMMAND] {
    let command = match direction {
        Direction::Read => Command::read(space, count),
        Direction::Write => Command::write(space, count),
    };
    let [a, b] = command.encode().to_le_bytes();
    let [c, d] = address.to_le_bytes();
    [a, b, c, d]
}

/// Whether a command has room, and ends where an access begins.
fn goes_on(run: Access, next: Access) -> bool {
    let end = u32::from(run.address) + 4 * u32::from(run.count);
    run.direction == next.direction
        && end == u32::from(next.address)
        && run.count < u16::from(MAX_COUNT)
}

fn is_sound(access: Access) -> bool {
    let end = u32::from(access.address) + 4 * u32::from(access.count);
    access.address.is_multiple_of(4) && end <= 0x1_0000 && access.words().end <= 0xFFFF
}

fn check(what: &'static str, bytes: usize) -> Result<(), UdpError> {
    let limit = MAX_PACKET;
    if bytes > limit {
        return Err(UdpError::TooLong { what, bytes, limit });
    }
    Ok(())
}

fn put(packet: &mut [u8], offset: usize, bytes: &[u8]) {
    let place = packet.get_mut(offset..offset + bytes.len());
    debug_assert!(place.is_some(), "it was made with this place");
    if let Some(place) = place {
        place.copy_from_slice(bytes);
    }
}
