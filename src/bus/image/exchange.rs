//! The exchanges of a frozen image.

use alloc::vec::Vec;

use super::Phase;
use super::plan::{ImagePlan, exchange_parts};
use super::words::{Words, WriteKind};
use crate::bus::{Access, AccessList, BusError, RegisterBus};

/// Requested form of a cycle's read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReadRequest {
    /// The registers wait for the board's next period, if the board paces.
    pub held: bool,
    /// The extra registers are read as well.
    pub extra: bool,
    /// The writes that precede the read in the same exchange.
    pub after: Option<CycleWrites>,
}

/// The writes of a cycle, besides those that every cycle has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CycleWrites {
    /// The settings that have changed.
    Settings,
    /// None: the board may not be set up, so no setting is written.
    Quiet,
    /// Those by which all pins become inputs, before the data: the board is not set up. They are in
    /// the same exchange, so that over a network each reply still shows which writes have arrived.
    Inputs,
}

/// The prepared lists of a frozen image, which transfer its [`Words`].
///
/// # Real time
/// No function allocates or panics; the exchanges are bounded by the bus.
#[derive(Debug)]
pub struct Exchanges {
    pub(super) lists: Lists,
    pub(super) parts: SettingExchanges,
}

#[derive(Debug)]
pub(super) struct Lists {
    /// With the usual registers, and with the extra ones as well.
    pub read: [AccessList; 2],
    pub paced: Option<PacedReads>,
    pub write: AccessList,
    /// As [`write`](Self::write), and all pins become inputs.
    pub inputs: AccessList,
    pub status: AccessList,
    pub evidence: AccessList,
    /// In the order in which they are exchanged: one, unless the set-up is larger than a packet.
    pub set_up: Vec<AccessList>,
    /// The set-up, without the writes that let go of pins first, and without those of the watchdog.
    pub renewal: Vec<AccessList>,
    pub quiesce: AccessList,
}

/// Reads that the board delays until its next period.
#[derive(Debug)]
pub(super) struct PacedReads {
    pub read: [AccessList; 2],
    /// With the writes before them.
    pub cycle: [AccessList; 2],
    /// With the writes before them by which all pins become inputs.
    pub inputs: [AccessList; 2],
}

impl Lists {
    fn of(&self, ask: ReadRequest) -> &AccessList {
        let [usual, extra] = match &self.paced {
            Some(paced) => match ask.after {
                Some(CycleWrites::Inputs) => &paced.inputs,
                Some(_) => &paced.cycle,
                None if ask.held => &paced.read,
                None => &self.read,
            },
            None => &self.read,
        };
        if ask.extra { extra } else { usual }
    }
}

/// The lists of a usual cycle.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct CycleLists<'a> {
    /// The read, at the host's pace.
    pub read: &'a AccessList,
    /// The write, at the host's pace.
    pub write: &'a AccessList,
    /// Write and read in one list, at the board's pace.
    pub paced: Option<&'a AccessList>,
}

impl Exchanges {
    /// The place of the word of a register that is read in a cycle.
    #[cfg(test)]
    pub(crate) fn place_read(&self, address: u16) -> Option<usize> {
        let [_, read] = &self.lists.read;
        let mut accesses = read.as_ref().iter();
        accesses.find_map(|access| {
            let number = usize::from(address.checked_sub(access.address)? / 4);
            access.words().nth(number)
        })
    }
}

/// The reads beside a program that drives the board.
#[derive(Debug)]
pub(crate) struct ReadsBeside(pub(super) Vec<Access>);

impl ReadsBeside {
    /// Reads all registers, in as many exchanges as the bus needs. On an error, some words are
    /// those of before.
    pub fn read<B: RegisterBus>(&self, bus: &mut B, words: &mut Words) -> Result<(), BusError> {
        exchange_parts(bus, &self.0, &mut words.content)
    }
}

/// Exchanges. On an error, no word that is read has changed.
impl Exchanges {
    /// The lists of a usual cycle.
    pub fn lists(&self) -> CycleLists<'_> {
        let Lists {
            read, write, paced, ..
        } = &self.lists;
        CycleLists {
            read: &read[0],
            write,
            paced: paced.as_ref().map(|paced| &paced.cycle[0]),
        }
    }

    /// Sends the request of a read; [`finish`](Self::finish) receives its reply.
    pub fn start_read<B: RegisterBus>(
        &self,
        bus: &mut B,
        words: &Words,
        ask: ReadRequest,
    ) -> Result<ReadRequest, BusError> {
        bus.start(self.lists.of(ask), &words.content)?;
        Ok(ask)
    }

    /// Writes, and requests the next read in the same exchange. Changed settings are written in a
    /// separate exchange before it, together with all other writes, if they belong to the `form`.
    /// Returns `None` if the writes were made but the read could not be requested.
    pub fn start_cycle<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        words: &mut Words,
        ask: ReadRequest,
        form: CycleWrites,
    ) -> Result<Option<ReadRequest>, BusError> {
        if form != CycleWrites::Settings || !words.has_pending() {
            let after = Some(form);
            let with_writes = ReadRequest { after, ..ask };
            return self.start_read(bus, words, with_writes).map(Some);
        }
        self.write(bus, words, form)?;
        Ok(self.start_read(bus, words, ask).ok())
    }

    /// Receives the reply to a started read.
    pub fn finish<B: RegisterBus>(
        &self,
        bus: &mut B,
        words: &mut Words,
        started: ReadRequest,
    ) -> Result<(), BusError> {
        let reply = bus.finish(self.lists.of(started), &mut words.content)?;
        words.add_reply(reply);
        Ok(())
    }

    /// Writes the registers of every cycle, triggers last, and what else belongs to the `form`.
    pub fn write<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        words: &mut Words,
        form: CycleWrites,
    ) -> Result<(), BusError> {
        let list = match form {
            CycleWrites::Settings if words.has_pending() => {
                return self.write_parts(bus, words, WriteKind::Cycle);
            }
            CycleWrites::Settings | CycleWrites::Quiet => &self.lists.write,
            CycleWrites::Inputs => &self.lists.inputs,
        };
        // A write has no reply of its own: its result shows in the next read.
        let _ = bus.run(list, &mut words.content)?;
        Ok(())
    }

    /// Writes the settings of the set-up that have changed, including those that drive pins. The
    /// evidence must be read before and [after](Words::guarded_sent) this call.
    pub fn write_guarded<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        words: &mut Words,
    ) -> Result<(), BusError> {
        words.expect_either();
        self.write_parts(bus, words, WriteKind::Guarded)
    }

    fn write_parts<B: RegisterBus>(
        &mut self,
        bus: &mut B,
        words: &mut Words,
        by: WriteKind,
    ) -> Result<(), BusError> {
        let accesses = self.parts.choose(words, by);
        for packet in packets(accesses) {
            bus.write_all(packet, &mut words.content)?;
        }
        words.sent(by);
        Ok(())
    }

    /// Reads only the status registers.
    pub fn read_status<B: RegisterBus>(
        &self,
        bus: &mut B,
        words: &mut Words,
    ) -> Result<(), BusError> {
        let reply = bus.run(&self.lists.status, &mut words.content)?;
        words.add_reply(reply);
        Ok(())
    }

    /// Reads only the evidence registers, all of them.
    pub fn read_evidence<B: RegisterBus>(
        &self,
        bus: &mut B,
        words: &mut Words,
    ) -> Result<(), BusError> {
        let reply = bus.run(&self.lists.evidence, &mut words.content)?;
        words.add_reply(reply);
        Ok(())
    }

    /// Writes the whole set-up again, with the present words of the settings, and reads all
    /// evidence after it. A set-up that is larger than a packet is written in parts, each after the
    /// reply to the one before, and what drives pins with the last. If the evidence matches, the
    /// caller calls [`Words::all_set`].
    pub fn set_up<B: RegisterBus>(&self, bus: &mut B, words: &mut Words) -> Result<(), BusError> {
        run_all(bus, words, &self.lists.set_up)
    }

    /// As [`set_up`](Self::set_up), for a board that still has its set-up: settings that were lost
    /// are written, and outputs get their safe words, but no pin is let go of meanwhile. The select
    /// line of multiplexed encoders is one of them. The watchdog is left alone, so that the
    /// evidence, which is read behind it, still shows a bite or a reset of any moment before.
    pub fn renew<B: RegisterBus>(&self, bus: &mut B, words: &mut Words) -> Result<(), BusError> {
        run_all(bus, words, &self.lists.renewal)
    }

    /// Writes the first stage of the set-up: nothing is driven.
    pub fn quiesce<B: RegisterBus>(&self, bus: &mut B, words: &mut Words) -> Result<(), BusError> {
        let _ = bus.run(&self.lists.quiesce, &mut words.content)?;
        Ok(())
    }
}

/// Runs lists that contain the settings.
fn run_all<B: RegisterBus>(
    bus: &mut B,
    words: &mut Words,
    lists: &[AccessList],
) -> Result<(), BusError> {
    words.expect_all();
    for list in lists {
        let reply = bus.run(list, &mut words.content)?;
        words.add_reply(reply);
    }
    Ok(())
}

/// Bytes of writes that fit a packet of any bus, with what the bus adds.
const PACKET: usize = 1_300;

/// The accesses in their order, a packet each: many settings that change at once, as the tables of
/// twelve step generators, need more than one.
fn packets(mut rest: &[Access]) -> impl Iterator<Item = &[Access]> {
    core::iter::from_fn(move || {
        let mut bytes = 0_usize;
        let mut fits = |access: &Access| {
            bytes = bytes.saturating_add(
                usize::from(access.count)
                    .saturating_mul(4)
                    .saturating_add(4),
            );
            bytes <= PACKET
        };
        // At least one, however large it is.
        let count = rest.iter().take_while(|access| fits(access)).count().max(1);
        let (packet, after) = rest.split_at_checked(count)?;
        rest = after;
        Some(packet)
    })
}

/// All writes, as needed for exchanges that contain settings.
#[derive(Debug)]
pub(super) struct SettingExchanges {
    first: Vec<Access>,
    data: Vec<Access>,
    /// Single accesses, stage by stage, each with its number.
    settings: Vec<(u16, Access)>,
    triggers: Vec<Access>,
    /// The accesses of the next write; its capacity suffices for all of them.
    chosen: Vec<Access>,
}

impl SettingExchanges {
    pub fn new(
        plan: &ImagePlan,
        writes: impl Fn(Phase) -> Vec<Access>,
        first_setting: u16,
    ) -> Self {
        let mut settings: Vec<_> = (0u16..).zip(&plan.settings).collect();
        settings.sort_by_key(|(_, setting)| setting.stage);
        let settings = settings.into_iter().map(|(n, setting)| {
            let place = first_setting.saturating_add(n);
            (n, Access::write(setting.address, place, 1))
        });
        Self {
            first: writes(Phase::First),
            data: writes(Phase::Data),
            settings: settings.collect(),
            triggers: writes(Phase::Trigger),
            chosen: Vec::with_capacity(plan.writes.len().saturating_add(plan.settings.len())),
        }
    }

    /// Chooses the data and the settings that belong to this kind of write. The write of the cycle
    /// contains all other writes as well, in the same places as without settings. A write that
    /// drives pins ends with the watchdog's word, which comes first otherwise: the watchdog bites
    /// on a board that was reset before or meanwhile, because its time is then 0.
    fn choose(&mut self, words: &Words, by: WriteKind) -> &[Access] {
        let (before, after) = match by {
            WriteKind::Cycle => (&self.first[..], &self.triggers),
            WriteKind::Guarded => (&[][..], &self.first),
        };
        let asked = self.settings.iter().filter(|(n, _)| words.is_asked(*n, by));
        self.chosen.clear();
        self.chosen.extend_from_slice(before);
        self.chosen.extend_from_slice(&self.data);
        self.chosen.extend(asked.map(|(_, access)| access));
        self.chosen.extend_from_slice(after);
        &self.chosen
    }
}
