//! The process image of a cycle: every register that is read and written, planned once.
//!
//! At start each module claims its registers in an [`ImagePlan`]. [`ImagePlan::freeze`] sorts and
//! merges them into access lists that the bus prepares, and the resulting [`CycleImage`] is then
//! exchanged every cycle. Registers that start something (DOIT) come after all data by
//! construction, because they are claimed as [`WritePhase::Trigger`].

mod layout;
mod requests;

use alloc::{boxed::Box, vec::Vec};
use core::fmt;
use core::time::Duration;

use super::{Access, Hold, RegisterBus, Reply};
use layout::{Layout, build};
use requests::Requests;

/// When a register is read within an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ReadPhase {
    /// Before everything else: reads that latch or mark a time.
    Latch,
    /// Registers that say whether the data after them can be trusted.
    Status,
    /// Data.
    Data,
    /// After all data: registers that say whether the board is still the one that was set up. What
    /// was read before them was, if they say so.
    Evidence,
}

/// When a register is written within an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum WritePhase {
    /// Before everything else: what must come before data that may not be executed without it.
    First,
    /// Data.
    Data,
    /// After all data: registers that start something with it.
    Trigger,
}

/// In which exchanges a register takes part.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Tier {
    /// In every one.
    Cycle,
    /// A read: in the extended ones, and in those that hold all evidence.
    Evidence,
    /// A read: only in the extended ones, which are run instead of the normal ones when somebody
    /// needs more than usual, for example while a remote comes back. A write: only when it was
    /// [asked for](CycleImage::request_write), each register by itself.
    Extended,
}

/// The read words of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ReadSlot {
    index: u16,
    count: u16,
}

/// The write words of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct WriteSlot {
    index: u16,
    count: u16,
}

/// How an image is laid out, and how large it may become.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageLimits {
    /// Reads of registers this many registers apart are merged, and what lies between is read
    /// along and ignored. On Ethernet one register more costs four bytes, as does a command.
    /// Writes are never bridged.
    pub bridge: u16,
}

impl Default for ImageLimits {
    /// Gaps of one register are bridged.
    fn default() -> Self {
        Self { bridge: 1 }
    }
}

/// Why an image can not be planned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError<E> {
    /// A claim has no register, or one that is not in the address space.
    #[error(
        "claim of {count} registers at {address:#06X}: \
         addresses are multiples of 4 below 0x10000; check the module's descriptor"
    )]
    BadClaim {
        /// First address.
        address: u16,
        /// Number of registers.
        count: u16,
    },
    /// Two modules want to write the same register.
    #[error("register {address:#06X} is written by two modules; leave one of them out")]
    WrittenTwice {
        /// The address.
        address: u16,
    },
    /// Two modules read the same register at different times within an exchange.
    #[error("register {address:#06X} is read in two phases; leave one of the modules out")]
    ReadInTwoPhases {
        /// The address.
        address: u16,
    },
    /// The bus can not hold reads back until the board's clock begins a period.
    #[error("this bus can not let the board pace the cycle; let the host pace it")]
    NotPaced,
    /// The bus refuses the list.
    #[error(transparent)]
    Bus(E),
}

/// Words, accesses and bytes of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImageSize {
    /// Registers read in a normal cycle, bridged ones included.
    pub read_words: u32,
    /// Runs of neighbouring registers read in a normal cycle.
    pub read_accesses: u32,
    /// Registers written in a normal cycle.
    pub write_words: u32,
    /// Runs of neighbouring registers written in a normal cycle.
    pub write_accesses: u32,
}

/// A claim: registers of one module that belong together.
#[derive(Clone, Copy, Debug)]
struct Claim<P> {
    phase: P,
    tier: Tier,
    address: u16,
    count: u16,
    initial: u32,
}

/// The claims of all modules, while they are collected.
///
/// Belongs to set-up: it allocates.
#[derive(Clone, Debug, Default)]
pub struct ImagePlan {
    reads: Vec<Claim<ReadPhase>>,
    writes: Vec<Claim<WritePhase>>,
}

impl ImagePlan {
    /// No claim yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Claims `count` neighbouring registers to be read. Several claims may name the same register.
    pub fn read(&mut self, phase: ReadPhase, tier: Tier, address: u16, count: u16) -> ReadSlot {
        let index = self.reads.len() as u16;
        self.reads.push(Claim {
            phase,
            tier,
            address,
            count,
            initial: 0,
        });
        ReadSlot { index, count }
    }

    /// Claims one register to be read as data in every cycle.
    pub fn read_data(&mut self, address: u16) -> ReadSlot {
        self.read(ReadPhase::Data, Tier::Cycle, address, 1)
    }

    /// Claims `count` neighbouring registers to be written; until something is put there, each
    /// is written as `initial`. No other claim may name one of them.
    pub fn write(
        &mut self,
        phase: WritePhase,
        tier: Tier,
        address: u16,
        count: u16,
        initial: u32,
    ) -> WriteSlot {
        let index = self.writes.len() as u16;
        self.writes.push(Claim {
            phase,
            tier,
            address,
            count,
            initial,
        });
        WriteSlot { index, count }
    }

    /// Claims one register to be written as data in every cycle.
    pub fn write_data(&mut self, address: u16, initial: u32) -> WriteSlot {
        self.write(WritePhase::Data, Tier::Cycle, address, 1, initial)
    }

    /// Lays the image out and has the bus prepare its lists. Nothing is exchanged yet.
    ///
    /// `held`: the board holds the reads back until its next period, at most so long.
    pub fn freeze<B: RegisterBus>(
        &self,
        bus: &mut B,
        limits: ImageLimits,
        held: Option<Duration>,
    ) -> Result<Frozen<B::List>, ImageError<B::Error>> {
        let reads = build(&self.reads, limits.bridge)?.unshared_phases()?;
        let writes = build(&self.writes, 0)?.unshared()?;
        if held.is_some() && !bus.can_hold() {
            return Err(ImageError::NotPaced);
        }
        let in_every_cycle = |run: &layout::Run| run.tier == Tier::Cycle;
        let mut prepare =
            |accesses: &[_], hold| bus.prepare(accesses, hold).map_err(ImageError::Bus);
        let cycle = reads.accesses(super::Direction::Read, in_every_cycle);
        let mut lists = |hold| {
            let extended = reads.accesses(super::Direction::Read, |_| true);
            let evidence = reads.accesses(super::Direction::Read, |run| run.tier != Tier::Extended);
            Ok(Tiers {
                cycle: prepare(&cycle, hold)?,
                evidence: prepare(&evidence, hold)?,
                extended: prepare(&extended, hold)?,
            })
        };
        let read = lists(None)?;
        let held = match held {
            Some(limit) => Some(lists(Some(Hold { before: 0, limit }))?),
            None => None,
        };
        let write = writes.accesses(super::Direction::Write, in_every_cycle);
        let (all_writes, is_extended) = writes.separate_writes();
        // All of them at once must fit, too.
        prepare(&all_writes, None)?;
        let evidence = reads.accesses(super::Direction::Read, |run| {
            run.phase == ReadPhase::Evidence as u8
        });
        let status = reads.accesses(super::Direction::Read, |run| {
            run.tier == Tier::Cycle && run.phase == ReadPhase::Status as u8
        });
        let lists = ImageLists {
            status: prepare(&status, None)?,
            evidence: prepare(&evidence, None)?,
            write: prepare(&write, None)?,
            read,
            held,
        };
        let image = CycleImage {
            size: size(&reads, &writes, in_every_cycle),
            read_accesses: cycle,
            write_accesses: write,
            requests: Requests::new(all_writes, is_extended),
            read_words: reads.initial_words(),
            write_words: writes.initial_words(),
            read_index: reads.into_index(),
            write_index: writes.into_index(),
        };
        Ok((image, lists))
    }
}

fn size(reads: &Layout, writes: &Layout, keep: impl Fn(&layout::Run) -> bool + Copy) -> ImageSize {
    let (read_accesses, read_words) = reads.extent(keep);
    let (write_accesses, write_words) = writes.extent(keep);
    ImageSize {
        read_words,
        read_accesses,
        write_words,
        write_accesses,
    }
}

/// An image and its lists.
type Frozen<L> = (CycleImage, ImageLists<L>);

/// The lists of an image, as its bus runs them.
#[derive(Debug)]
pub struct ImageLists<L> {
    read: Tiers<L>,
    /// The same reads held back by the board, if it paces.
    held: Option<Tiers<L>>,
    write: L,
    status: L,
    evidence: L,
}

/// The same words in a normal and in an extended exchange.
#[derive(Debug)]
struct Tiers<L> {
    cycle: L,
    evidence: L,
    extended: L,
}

impl<L> ImageLists<L> {
    /// What a normal cycle reads.
    pub const fn read(&self) -> &L {
        &self.reads().cycle
    }

    /// What a normal cycle writes.
    pub const fn write(&self) -> &L {
        &self.write
    }

    const fn reads(&self) -> &Tiers<L> {
        match &self.held {
            Some(held) => held,
            None => &self.read,
        }
    }
}

impl<L> Tiers<L> {
    const fn of(&self, tier: Tier) -> &L {
        match tier {
            Tier::Cycle => &self.cycle,
            Tier::Evidence => &self.evidence,
            Tier::Extended => &self.extended,
        }
    }
}

/// The frozen image: the words that its [lists](ImageLists) move.
///
/// # Real time
/// No function allocates or panics; the exchanges are bounded by the bus. A slot of another image
/// reads as `None` and is not written.
pub struct CycleImage {
    size: ImageSize,
    read_accesses: Box<[Access]>,
    write_accesses: Box<[Access]>,
    /// Writes that are not made in every cycle.
    requests: Requests,
    read_words: Box<[u32]>,
    write_words: Box<[u32]>,
    /// First word of each claim.
    read_index: Box<[u16]>,
    write_index: Box<[u16]>,
}

impl CycleImage {
    /// What a normal cycle moves.
    pub const fn size(&self) -> ImageSize {
        self.size
    }

    /// The first word of a claim.
    pub fn word(&self, slot: ReadSlot) -> Option<u32> {
        self.words(slot).first().copied()
    }

    /// All words of a claim; empty if it is not of this image.
    pub fn words(&self, slot: ReadSlot) -> &[u32] {
        range(&self.read_index, slot.index, slot.count)
            .and_then(|range| self.read_words.get(range))
            .unwrap_or(&[])
    }

    /// Puts the first word of a claim.
    pub fn put(&mut self, slot: WriteSlot, word: u32) {
        if let Some(first) = self.words_mut(slot).first_mut() {
            *first = word;
        }
    }

    /// What will be written, to change it; empty if the claim is not of this image.
    pub fn words_mut(&mut self, slot: WriteSlot) -> &mut [u32] {
        range(&self.write_index, slot.index, slot.count)
            .and_then(|range| self.write_words.get_mut(range))
            .unwrap_or(&mut [])
    }

    /// What will be written.
    pub fn written(&self, slot: WriteSlot) -> &[u32] {
        range(&self.write_index, slot.index, slot.count)
            .and_then(|range| self.write_words.get(range))
            .unwrap_or(&[])
    }

    /// Reads the registers of `tier` at once, held back by nobody; on an error no word has changed.
    pub fn exchange_reads<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        lists: &ImageLists<B::List>,
        tier: Tier,
    ) -> Result<Reply, B::Error> {
        bus.run(lists.read.of(tier), &mut self.read_words)
    }

    /// Asks for the registers of `tier`, when the board's next period begins if it paces;
    /// [`finish_reads`](Self::finish_reads) takes the reply.
    pub fn start_reads<B: RegisterBus>(
        &self,
        bus: &mut B,
        lists: &ImageLists<B::List>,
        tier: Tier,
    ) -> Result<(), B::Error> {
        bus.start(lists.reads().of(tier), &self.read_words)
    }

    /// Takes the registers of `tier` that were asked for; on an error no word has changed.
    pub fn finish_reads<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        lists: &ImageLists<B::List>,
        tier: Tier,
    ) -> Result<Reply, B::Error> {
        bus.finish(lists.reads().of(tier), &mut self.read_words)
    }

    /// Reads the status registers alone; on an error no word has changed.
    pub fn exchange_status<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        lists: &ImageLists<B::List>,
    ) -> Result<Reply, B::Error> {
        bus.run(&lists.status, &mut self.read_words)
    }

    /// Reads all registers of [`ReadPhase::Evidence`] alone; on an error no word has changed.
    pub fn exchange_evidence<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        lists: &ImageLists<B::List>,
    ) -> Result<Reply, B::Error> {
        bus.run(&lists.evidence, &mut self.read_words)
    }

    /// The next write holds these registers of the extended tier. They are written again whenever
    /// [`confirm_writes`](Self::confirm_writes) says that this may not have arrived, or may have
    /// been undone by an older write.
    pub fn request_write(&mut self, slot: WriteSlot) {
        let range = range(&self.write_index, slot.index, slot.count).unwrap_or_default();
        self.requests.add(range);
    }

    /// Writes the registers of every cycle and those that were asked for, triggers last.
    pub fn exchange_writes<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        lists: &ImageLists<B::List>,
    ) -> Result<(), B::Error> {
        if self.requests.is_empty() {
            return bus.run(&lists.write, &mut self.write_words).map(|_| ());
        }
        let (accesses, wanted) = self.requests.list();
        bus.write_some(accesses, wanted, &mut self.write_words)?;
        self.requests.sent();
        Ok(())
    }

    /// Nothing that was asked for is written any more.
    pub fn forget_requests(&mut self) {
        self.requests.clear();
    }

    /// Whether the next write holds more than those of every cycle.
    pub fn has_requests(&self) -> bool {
        !self.requests.is_empty()
    }

    /// The board was heard: whether it is certain that the newest write was the last that was
    /// executed. If not, what was asked for lately is written again.
    pub fn confirm_writes(&mut self, is_certain: bool) {
        self.requests.confirm(is_certain);
    }

    /// The accesses of a normal read, for people who want to see them.
    pub fn read_accesses(&self) -> &[Access] {
        &self.read_accesses
    }

    /// The accesses of a normal write, for people who want to see them.
    pub fn write_accesses(&self) -> &[Access] {
        &self.write_accesses
    }
}

impl fmt::Debug for CycleImage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CycleImage")
            .field("size", &self.size)
            .finish_non_exhaustive()
    }
}

fn range(index: &[u16], claim: u16, count: u16) -> Option<core::ops::Range<usize>> {
    let first = usize::from(*index.get(usize::from(claim))?);
    Some(first..first + usize::from(count))
}

#[cfg(test)]
mod tests;
