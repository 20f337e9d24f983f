//! The frozen image and its exchanges.

use core::time::Duration;

use super::layout::Layout;
use super::parts::Parts;
use super::words::By;
use super::{ReadPhase, Words};
use crate::bus::{Hold, RegisterBus, Reply};

/// A list with the usual registers, and one with the extra ones as well.
#[derive(Debug)]
struct Two<L> {
    usual: L,
    extra: L,
}

impl<L> Two<L> {
    fn new<E>(mut make: impl FnMut(bool) -> Result<L, E>) -> Result<Self, E> {
        Ok(Self {
            usual: make(false)?,
            extra: make(true)?,
        })
    }

    const fn of(&self, extra: bool) -> &L {
        if extra { &self.extra } else { &self.usual }
    }
}

/// What a read of the cycle is to hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ask {
    /// The registers wait for the board's next period, where it paces.
    pub held: bool,
    /// More than the usual registers are read.
    pub extra: bool,
}

/// An exchange whose reply has to be taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Started {
    ask: Ask,
    with_writes: bool,
}

impl Started {
    /// Whether more than the usual registers are read.
    pub const fn extra(self) -> bool {
        self.ask.extra
    }
}

/// The frozen image: prepared lists and the words they move.
///
/// # Real time
/// No function allocates or panics; the exchanges are bounded by the bus.
#[derive(Debug)]
pub struct Image<L> {
    lists: Lists<L>,
    words: Words,
    parts: Parts,
    /// What the replies told since [`take_news`](Self::take_news).
    news: Option<Reply>,
}

#[derive(Debug)]
struct Lists<L> {
    read: Two<L>,
    paced: Option<Paced<L>>,
    write: L,
    status: L,
    evidence: L,
    set_up: L,
    quiesce: L,
}

/// Reads that the board holds back.
#[derive(Debug)]
struct Paced<L> {
    read: Two<L>,
    /// With the writes before them.
    cycle: Two<L>,
}

impl<L> Lists<L> {
    fn of(&self, started: Started) -> &L {
        let Started {
            ask: Ask { held, extra },
            with_writes,
        } = started;
        match &self.paced {
            Some(paced) if with_writes => paced.cycle.of(extra),
            Some(paced) if held => paced.read.of(extra),
            _ => self.read.of(extra),
        }
    }
}

impl Layout {
    /// Has the bus prepare all lists. Nothing is exchanged.
    ///
    /// `held`: the board paces, and holds the reads of a cycle back at most so long.
    ///
    /// # Errors
    /// What the bus says of a list, for example that it does not fit a packet.
    pub fn prepare<B: RegisterBus>(
        self,
        bus: &mut B,
        held: Option<Duration>,
    ) -> Result<Image<B::List>, B::Error> {
        let Self {
            reads,
            writes,
            set_up,
            quiesce,
            parts,
            words,
        } = self;
        let writes = writes.writes();
        let cycle = |extra| [&writes[..], &reads.reads(extra)].concat();
        let evidence = reads.phase(ReadPhase::Evidence, true);
        let set_up = [&set_up[..], &evidence].concat();
        let paced = match held {
            None => None,
            Some(limit) => {
                let hold = |before| Some(Hold { before, limit });
                Some(Paced {
                    read: Two::new(|extra| bus.prepare(&reads.reads(extra), hold(0)))?,
                    cycle: Two::new(|extra| bus.prepare(&cycle(extra), hold(writes.len())))?,
                })
            }
        };
        Ok(Image {
            lists: Lists {
                read: Two::new(|extra| bus.prepare(&reads.reads(extra), None))?,
                paced,
                write: bus.prepare(&writes, None)?,
                status: bus.prepare(&reads.phase(ReadPhase::Status, false), None)?,
                evidence: bus.prepare(&evidence, None)?,
                set_up: bus.prepare(&set_up, None)?,
                quiesce: bus.prepare(&quiesce, None)?,
            },
            parts,
            words,
            news: None,
        })
    }
}

/// What a usual cycle exchanges.
#[derive(Clone, Copy, Debug)]
pub struct CycleLists<'a, L> {
    /// The read, at the host's pace.
    pub read: &'a L,
    /// The write, at the host's pace.
    pub write: &'a L,
    /// All of it, at the board's pace.
    pub paced: Option<&'a L>,
}

impl<L> Image<L> {
    /// The lists of a usual cycle.
    pub fn lists(&self) -> CycleLists<'_, L> {
        let lists = &self.lists;
        CycleLists {
            read: &lists.read.usual,
            write: &lists.write,
            paced: lists.paced.as_ref().map(|paced| &paced.cycle.usual),
        }
    }

    /// The words.
    pub fn words(&self) -> &Words {
        &self.words
    }

    /// The words, to change what is written.
    pub fn words_mut(&mut self) -> &mut Words {
        &mut self.words
    }

    /// What all replies told since this was called last.
    pub fn take_news(&mut self) -> Reply {
        self.news.take().unwrap_or(Reply::CERTAIN)
    }
}

/// Exchanges. On an error, no word that is read has changed.
impl<L> Image<L> {
    /// Sends the request of a read.
    pub fn start_read<B>(&self, bus: &mut B, ask: Ask) -> Result<Started, B::Error>
    where
        B: RegisterBus<List = L>,
    {
        self.start(bus, ask, false)
    }

    /// Writes, and asks for the next reads in the same exchange. Settings that have changed are
    /// written ahead, with all other writes, unless everything is to be `quiet`. `None`: the writes
    /// were made, and the reads were not asked for.
    pub fn start_cycle<B>(
        &mut self,
        bus: &mut B,
        ask: Ask,
        quiet: bool,
    ) -> Result<Option<Started>, B::Error>
    where
        B: RegisterBus<List = L>,
    {
        if quiet || !self.words.has_news() {
            return self.start(bus, ask, true).map(Some);
        }
        self.write(bus, quiet)?;
        Ok(self.start(bus, ask, false).ok())
    }

    fn start<B>(&self, bus: &mut B, ask: Ask, with_writes: bool) -> Result<Started, B::Error>
    where
        B: RegisterBus<List = L>,
    {
        let started = Started { ask, with_writes };
        bus.start(self.lists.of(started), &self.words.content)?;
        Ok(started)
    }

    /// Takes the reply to what was started.
    pub fn finish<B>(&mut self, bus: &mut B, started: Started) -> Result<Reply, B::Error>
    where
        B: RegisterBus<List = L>,
    {
        let reply = bus.finish(self.lists.of(started), &mut self.words.content)?;
        Ok(self.note(reply))
    }

    /// Writes the registers of every cycle, triggers last, and the settings that have changed; without
    /// those if everything is to be `quiet`, because the board is not set up.
    pub fn write<B>(&mut self, bus: &mut B, quiet: bool) -> Result<(), B::Error>
    where
        B: RegisterBus<List = L>,
    {
        if quiet || !self.words.has_news() {
            // A write has no reply of its own: the next read tells what became of it.
            let _ = bus.run(&self.lists.write, &mut self.words.content)?;
            return Ok(());
        }
        self.write_parts(bus, By::Cycle)
    }

    /// Writes the settings of the set-up that have changed, those included that drive pins. The
    /// evidence has to be read before and [after](Words::guarded_sent) it.
    pub fn write_guarded<B>(&mut self, bus: &mut B) -> Result<(), B::Error>
    where
        B: RegisterBus<List = L>,
    {
        self.words.expect_either();
        self.write_parts(bus, By::Guarded)
    }

    fn write_parts<B>(&mut self, bus: &mut B, by: By) -> Result<(), B::Error>
    where
        B: RegisterBus<List = L>,
    {
        let accesses = self.parts.choose(&self.words, by);
        bus.write_all(accesses, &mut self.words.content)?;
        self.words.sent(by);
        Ok(())
    }

    /// Reads the status registers alone.
    pub fn read_status<B>(&mut self, bus: &mut B) -> Result<(), B::Error>
    where
        B: RegisterBus<List = L>,
    {
        let reply = bus.run(&self.lists.status, &mut self.words.content)?;
        self.note(reply);
        Ok(())
    }

    /// Reads all evidence alone.
    pub fn read_evidence<B>(&mut self, bus: &mut B) -> Result<(), B::Error>
    where
        B: RegisterBus<List = L>,
    {
        let reply = bus.run(&self.lists.evidence, &mut self.words.content)?;
        self.note(reply);
        Ok(())
    }

    /// Writes the whole set-up again, with the words that the settings have now, and reads all
    /// evidence after it. Whoever finds it good calls [`Words::all_set`].
    pub fn set_up<B>(&mut self, bus: &mut B) -> Result<(), B::Error>
    where
        B: RegisterBus<List = L>,
    {
        self.words.expect_all();
        let reply = bus.run(&self.lists.set_up, &mut self.words.content)?;
        self.note(reply);
        Ok(())
    }

    /// Writes the first stage of the set-up: nothing is driven.
    pub fn quiesce<B>(&mut self, bus: &mut B) -> Result<(), B::Error>
    where
        B: RegisterBus<List = L>,
    {
        let _ = bus.run(&self.lists.quiesce, &mut self.words.content)?;
        Ok(())
    }

    fn note(&mut self, reply: Reply) -> Reply {
        self.news = Some(self.news.map_or(reply, |before| before.and(reply)));
        reply
    }
}
