//! The bus: packets that only read, few and small.

use core::ops::Range;
use core::time::Duration;
use std::collections::VecDeque;

use mesa_hal::bus::{
    Access, BusError, BusErrorKind, Clock, CustomError, Direction, Instant, RegisterBus,
};
use mesa_hal::ethernet::Lbp16Board;
use mesa_hal::hostmot2::{HostMot2, IdentifyError};
use mesa_hal::lbp16::registers::{control, eeprom, read_only, timer};
use mesa_hal::lbp16::{
    Command, InfoArea, Lbp16Error, Operation, Operations, RequestBuilder, Space, elements,
};
use mesa_hal::transport::udp::{PacketLink, UdpLink};
use mesa_hal::transport::{ReadRefusal, RegisterMap};
use mesa_hal::{Advice, MesaError};

use crate::inventory::InventoryError;

/// Attempts for a packet that is not answered. Each one keeps the interval.
const TRIES: u32 = 3;

/// Number of earlier replies whose length no other one has.
const REMEMBERED: usize = 8;

/// Size of the receive buffer: longer datagrams are no replies.
const BUFFER: usize = 2048;

/// Registers before the description of the firmware: cookie, name, and address of the IDROM.
const COOKIE: Range<u32> = 0x0100..0x0110;

/// Bytes of the IDROM. Source: Mesa's public sources.
const IDROM_BYTES: u32 = 0x400;

/// A board that another program drives: everything that can be read without an effect.
///
/// A reply has no number, because a number would have to be written to the board. Instead, a reply
/// has a length that none of the last eight had, so that a late or repeated one is not taken for
/// it: a request reads up to eight words more than needed.
///
/// # Real time
/// Not for a cycle: it waits between packets.
#[derive(Debug)]
pub struct PassiveBus<L> {
    link: L,
    deadline: Duration,
    /// Registers of the firmware, once it is identified.
    map: Option<RegisterMap>,
    /// Addresses of the IDROM, once its start is known.
    idrom: Range<u32>,
    /// Time of the next packet.
    next: Instant,
    /// Lengths of the last replies that were requested.
    lengths: VecDeque<usize>,
    statistics: PassiveStatistics,
    buffer: Box<[u8]>,
}

/// Packets of a [`PassiveBus`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct PassiveStatistics {
    /// Packets sent.
    pub packets: u64,
    /// Packets without a reply in time.
    pub lost: u64,
}

/// Neighbouring registers of a space, each of the space's own size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Read {
    /// Memory space.
    pub space: Space,
    /// Address of the first register.
    pub address: u16,
    /// Number of registers.
    pub count: u16,
}

impl Read {
    /// `count` registers of HostMot2.
    pub const fn hostmot2(address: u16, count: u16) -> Self {
        Self {
            space: Space::HostMot2,
            address,
            count,
        }
    }

    fn addresses(self) -> Range<u32> {
        let start = u32::from(self.address);
        let bytes = u32::from(self.count) * self.space.element().bytes() as u32;
        start..start + bytes
    }
}

/// Error of a [`PassiveBus`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PassiveError {
    /// A write. Nothing was sent.
    #[error("{WRITE}")]
    Write,
    /// A read that may change something. Nothing was sent.
    #[error("0x{address:04X} of space {space} is not read beside a running program: {refusal}")]
    Refused {
        /// Memory space.
        space: Space,
        /// Address of the register.
        address: u16,
        /// The reason.
        refusal: ReadRefusal,
    },
    /// A packet that is no sequence of commands. Nothing was sent.
    #[error(transparent)]
    Commands(Lbp16Error),
    /// A packet that is too large. Nothing was sent.
    #[error("a packet with {bytes} bytes is too large beside a running program")]
    TooLarge {
        /// Bytes of the request or of its reply, whichever is longer.
        bytes: usize,
    },
    /// The board did not answer, or the packet could not be sent or received.
    #[error(transparent)]
    Bus(#[from] BusError),
}

const WRITE: &str = "a look at a running machine writes nothing";

impl MesaError for PassiveError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Bus(error) => error.advice(),
            _ => None,
        }
    }
}

impl From<PassiveError> for InventoryError {
    fn from(error: PassiveError) -> Self {
        Self::Bus(error.into())
    }
}

/// The error of an exchange by [`RegisterBus`] or [`Lbp16Board`]. That of a refused read has its
/// address as code.
impl From<PassiveError> for BusError {
    fn from(error: PassiveError) -> Self {
        let of = |text| CustomError::new(BusErrorKind::Invalid, text);
        match error {
            PassiveError::Bus(error) => error,
            PassiveError::Write => of(WRITE).into(),
            PassiveError::Refused { address, .. } => {
                let text = "a register that is not read beside a running program";
                of(text).with_code(address.into()).into()
            }
            PassiveError::Commands(_) => of("the packet is no sequence of LBP16 commands").into(),
            PassiveError::TooLarge { bytes } => Self::TooLong {
                what: "packet",
                bytes,
                limit: PassiveBus::<UdpLink>::MAX_DATA,
            },
        }
    }
}

impl<L: PacketLink> PassiveBus<L> {
    /// Least time between two packets. A driver of `mesa-hal` reports a second master at more than
    /// 50 packets a second; a `PassiveBus` sends at most 20.
    pub const INTERVAL: Duration = Duration::from_millis(50);

    /// Most bytes of a request, and of its reply: 26 us on the wire at 100 Mbit/s.
    pub const MAX_BYTES: usize = 280;

    /// The same without the words that distinguish replies.
    const MAX_DATA: usize = Self::MAX_BYTES - 24;

    /// A bus over `link`. Nothing is sent. `deadline` is the longest wait for a reply.
    pub fn new(link: L, deadline: Duration) -> Self {
        Self {
            link,
            deadline,
            map: None,
            idrom: 0..0,
            next: Instant::default(),
            lengths: VecDeque::with_capacity(REMEMBERED),
            statistics: PassiveStatistics::default(),
            buffer: vec![0; BUFFER].into_boxed_slice(),
        }
    }

    /// Reads the description of the firmware, and which registers can be read by it.
    ///
    /// # Errors
    /// As [`HostMot2::identify`].
    pub fn identify(&mut self) -> Result<HostMot2, IdentifyError> {
        let firmware = HostMot2::identify(self)?;
        self.map = Some(RegisterMap::of(&firmware));
        Ok(firmware)
    }

    /// The registers of the firmware; `None` before it is [identified](Self::identify).
    pub fn map(&self) -> Option<&RegisterMap> {
        self.map.as_ref()
    }

    /// Packets so far.
    pub fn packets(&self) -> PassiveStatistics {
        self.statistics
    }

    /// Access to the link.
    pub fn link(&mut self) -> &mut L {
        &mut self.link
    }

    /// Reads registers, in as few packets as their size permits; words in the order of the reads.
    ///
    /// # Errors
    /// [`PassiveError::Refused`] before anything is sent, and errors of the packets.
    pub fn read_all(&mut self, reads: &[Read]) -> Result<Vec<u32>, PassiveError> {
        reads.iter().try_for_each(|read| self.check(*read))?;
        let mut words = Vec::new();
        let mut packet = Packet::default();
        for part in reads.iter().copied().flat_map(parts) {
            if !packet.has_room(part, Self::MAX_DATA) {
                words.extend(self.run(&core::mem::take(&mut packet))?);
            }
            packet.add(part);
        }
        if !packet.parts.is_empty() {
            words.extend(self.run(&packet)?);
        }
        Ok(words)
    }

    fn run(&mut self, packet: &Packet) -> Result<Vec<u32>, PassiveError> {
        let RequestBuilder { bytes, reply_len } = &packet.request;
        let mut reply = self.ask(bytes, *reply_len)?;
        let mut words = Vec::new();
        for (space, bytes) in &packet.parts {
            let (part, rest) = reply.split_at_checked(*bytes).unwrap_or((reply, &[]));
            words.extend(elements(part, space.element()).map(|word| word as u32));
            reply = rest;
        }
        Ok(words)
    }

    /// Checks that a read has no effect.
    fn check(&self, read: Read) -> Result<(), PassiveError> {
        let refused = |address, refusal| PassiveError::Refused {
            space: read.space,
            address,
            refusal,
        };
        if read.space != Space::HostMot2 {
            return check_space(read.space, read.addresses())
                .map_err(|refusal| refused(read.address, refusal));
        }
        for address in read.addresses().step_by(4) {
            let is_description = COOKIE.contains(&address) || self.idrom.contains(&address);
            if is_description {
                continue;
            }
            let known = match (&self.map, u16::try_from(address)) {
                (Some(map), Ok(address)) => map.at(address).map(drop),
                _ => Err(ReadRefusal::NoRegister),
            };
            known.map_err(|refusal| refused(address as u16, refusal))?;
        }
        Ok(())
    }

    /// Sends commands, and returns the beginning of the reply. Repeated if it is lost.
    fn ask(&mut self, commands: &[u8], len: usize) -> Result<&[u8], PassiveError> {
        let mut begun = None;
        for _ in 0..TRIES {
            self.keep_interval();
            let sent = self.link.now();
            begun.get_or_insert(sent);
            let expected = self.send(commands, len)?;
            if self.receive(expected, sent.after(self.deadline))? {
                return Ok(self.buffer.get(..len).unwrap_or_default());
            }
            self.statistics.lost += 1;
        }
        let lost = BusError::GaveUp {
            request: self.statistics.packets as u32,
            tries: TRIES,
            within: self.link.now().since(begun.unwrap_or_default()),
            last: BusErrorKind::Lost,
        };
        Err(lost.into())
    }

    /// Waits until the next packet may be sent.
    fn keep_interval(&mut self) {
        loop {
            let left = self.next.since(self.link.now());
            if left.is_zero() {
                return;
            }
            self.link.sleep(left);
        }
    }

    /// Sends commands whose reply has `len` bytes; returns the length of the reply with the words
    /// that distinguish it.
    fn send(&mut self, commands: &[u8], len: usize) -> Result<usize, PassiveError> {
        let lengths = (0..=REMEMBERED).map(|words| (words, len + 2 * words));
        let mut free = lengths.filter(|(_, length)| !self.lengths.contains(length));
        let (words, length) = free.next().unwrap_or((0, len));
        let mut request = commands.to_vec();
        if words > 0 {
            let mut more = RequestBuilder::default();
            let read = Command::read(Space::ReadOnly, words as u8);
            more.push(read, read_only::CARD_NAME, &[]);
            request.extend(more.bytes);
        }
        if self.lengths.len() == REMEMBERED {
            self.lengths.pop_front();
        }
        self.lengths.push_back(length);
        self.next = self.link.now().after(Self::INTERVAL);
        self.statistics.packets += 1;
        self.link.send(&request).map_err(BusError::from)?;
        Ok(length)
    }

    /// Receives until a reply of this length arrives; `false` if none does.
    fn receive(&mut self, len: usize, until: Instant) -> Result<bool, PassiveError> {
        while let Some(found) = self
            .link
            .receive(&mut self.buffer, until)
            .map_err(BusError::from)?
        {
            if found == len {
                return Ok(true);
            }
            // Datagrams that come faster than they are read would never end.
            if self.link.now() >= until {
                break;
            }
        }
        Ok(false)
    }

    /// Checks a command of a packet that a caller has built.
    fn check_command(
        &self,
        command: Result<Operation<'_>, Lbp16Error>,
    ) -> Result<usize, PassiveError> {
        let Operation {
            command, address, ..
        } = command.map_err(PassiveError::Commands)?;
        if command.write {
            return Err(PassiveError::Write);
        }
        let space = command.space;
        let count = u16::from(command.count);
        let address_or_0 = address.unwrap_or(0);
        let is_info = command.info
            && space != Space::Unused
            && usize::from(address_or_0 / 2 + count) <= InfoArea::WORDS;
        let is_plain = !command.info && command.size == space.element() && command.increment;
        match address {
            Some(_) if is_info => Ok(command.data_len()),
            Some(address) if is_plain => {
                let read = Read {
                    space,
                    address,
                    count,
                };
                self.check(read).map(|()| command.data_len())
            }
            // At the address where another command has ended, or of another size.
            _ => Err(PassiveError::Refused {
                space,
                address: address_or_0,
                refusal: ReadRefusal::NoRegister,
            }),
        }
    }
}

/// A packet that only reads.
#[derive(Debug, Default)]
struct Packet {
    request: RequestBuilder,
    /// Space and bytes of each part of the reply.
    parts: Vec<(Space, usize)>,
}

impl Packet {
    fn has_room(&self, read: Read, limit: usize) -> bool {
        let reply = self.request.reply_len + read.addresses().len();
        reply <= limit && self.request.bytes.len() + 4 <= limit
    }

    fn add(&mut self, read: Read) {
        let command = Command::read(read.space, read.count as u8);
        let bytes = self.request.push(command, read.address, &[]);
        self.parts.push((read.space, bytes.len()));
    }
}

/// A read in parts of at most 32 registers, which fit the rest of a packet well.
fn parts(read: Read) -> impl Iterator<Item = Read> {
    const MOST: u16 = 32;
    let size = read.space.element().bytes() as u16;
    (0..read.count).step_by(MOST.into()).map(move |first| Read {
        address: read.address.saturating_add(first.saturating_mul(size)),
        count: MOST.min(read.count - first),
        ..read
    })
}

impl<L: PacketLink> Clock for PassiveBus<L> {
    fn now(&mut self) -> Instant {
        self.link.now()
    }

    fn wait(&mut self, duration: Duration) {
        self.link.sleep(duration);
    }
}

impl<L: PacketLink> RegisterBus for PassiveBus<L> {
    /// Refuses writes, and reads that may change something, before anything is sent.
    fn exchange(&mut self, accesses: &[Access], words: &mut [u32]) -> Result<(), BusError> {
        let is_write = |access: &Access| access.direction == Direction::Write;
        if accesses.iter().any(is_write) {
            return Err(PassiveError::Write.into());
        }
        let reads = accesses.iter();
        let reads: Vec<_> = reads
            .map(|access| Read::hostmot2(access.address, access.count))
            .collect();
        let mut found = self.read_all(&reads)?.into_iter();
        for access in accesses {
            for (at, word) in access.words().zip(found.by_ref()) {
                // The fourth of the words from the cookie on is the address of the IDROM.
                let address =
                    u32::from(access.address) + 4 * (at - usize::from(access.first)) as u32;
                if self.map.is_none() && address + 4 == COOKIE.end {
                    self.idrom = word..word.saturating_add(IDROM_BYTES);
                }
                if let Some(to) = words.get_mut(at) {
                    *to = word;
                }
            }
        }
        Ok(())
    }
}

/// Refuses packets that write, and reads that may change something, before anything is sent.
impl<L: PacketLink> Lbp16Board for PassiveBus<L> {
    fn run_commands(
        &mut self,
        commands: &[u8],
        reply: &mut [u8],
        _deadline: Duration,
    ) -> Result<(), BusError> {
        let mut len = 0;
        for command in Operations::new(commands) {
            len += self.check_command(command)?;
        }
        let bytes = commands.len().max(len);
        if bytes > Self::MAX_DATA {
            return Err(PassiveError::TooLarge { bytes }.into());
        }
        let found = self.ask(commands, len)?;
        for (to, from) in reply.iter_mut().zip(found) {
            *to = *from;
        }
        Ok(())
    }

    fn send(&mut self, _: &[u8]) -> Result<(), BusError> {
        Err(PassiveError::Write.into())
    }
}

/// Checks a read outside of HostMot2's registers.
///
/// # Errors
/// The reason why it is not done.
///
/// Source: manual 7I97, "7I97 SUPPORTED MEMORY SPACES".
fn check_space(space: Space, addresses: Range<u32>) -> Result<(), ReadRefusal> {
    let within =
        |start: u16, end: u16| addresses.start >= start.into() && addresses.end <= end.into();
    let is_known = match space {
        Space::Eeprom => within(0, eeprom::LEN),
        Space::Timer => within(timer::TIME_STAMP, timer::WAIT_US) || within(timer::SCRATCH, 0x20),
        Space::Control => within(control::ERROR, control::RESET),
        Space::ReadOnly => within(0, 0x20),
        Space::HostMot2 | Space::EthernetChip | Space::Flash | Space::Unused => false,
    };
    if is_known {
        return Ok(());
    }
    Err(match space {
        Space::EthernetChip => {
            ReadRefusal::SideEffect("some registers of the chip change when read")
        }
        Space::Flash => ReadRefusal::SideEffect("the data port advances its address"),
        Space::Timer if within(timer::WAIT_US, timer::SCRATCH) => {
            ReadRefusal::SideEffect("the board waits, and answers nobody meanwhile")
        }
        Space::Control if within(control::RESET, 0x20) => {
            ReadRefusal::SideEffect("it belongs to the reset and the reload of the board")
        }
        // The board would count an error.
        _ => ReadRefusal::NoRegister,
    })
}
