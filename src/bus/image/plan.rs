//! What modules register, while it is collected.

use alloc::vec::Vec;

use crate::bus::{Access, RegisterBus};

/// When a register is read or written within an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Phase {
    /// Before everything else: reads that latch or mark a time, and writes without which no data may
    /// be executed.
    First,
    /// Reads that say whether the data after them can be trusted.
    Status,
    /// Data.
    Data,
    /// After all data: writes that start something with it.
    Trigger,
    /// After all data: reads that show whether the board still has its set-up. If they do, it had it
    /// while everything before them was read.
    Evidence,
}

/// The steps of the set-up, in their order: nothing is driven early.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// Drives nothing.
    Quiesce,
    /// What modules do.
    Configure,
    /// Which pins they do it on.
    Route,
    /// Drives the pins. Everything before protects this: while it is not done, each of the others can
    /// be written alone, late or twice, and nothing is driven.
    Drive,
    /// What has to wait until the pins are driven.
    Enable,
}

/// A register that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ReadSlot(pub(super) u16);

/// A register that is written in every cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct WriteSlot(pub(super) u16);

/// A register that is written when its word changes, and with the set-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Setting(pub(super) u16);

/// Why an image can not be planned: a register that is none, or that two modules want.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("register {address:#06X} {what}")]
pub struct ImageError {
    /// The register.
    pub address: u16,
    /// What is wrong with it, and what to do.
    pub what: &'static str,
}

/// A register of the cycle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Register {
    pub phase: Phase,
    pub address: u16,
    /// Of one that is read: only in reads that hold more than usual.
    pub is_extra: bool,
    /// Of one that is written: its word until another one is put.
    pub word: u32,
}

/// A register that is written when its word changes.
#[derive(Clone, Copy, Debug)]
pub(super) struct SettingRegister {
    /// `None`: not part of the set-up.
    pub stage: Option<Stage>,
    pub address: u16,
    pub word: u32,
    /// It drives pins, and a reset clears it.
    is_drive: bool,
    /// Where it is read back as evidence, if the board reads it back.
    pub shown: Option<ReadSlot>,
}

/// A write of the set-up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub place: StepPlace,
    pub address: u16,
    /// What it writes at first; `None`: nothing.
    first: Option<u32>,
    pub again: Again,
}

/// When a step is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum StepPlace {
    Opening,
    In(Stage),
    Closing,
}

/// What a step writes when the set-up is written again.
#[derive(Clone, Copy, Debug)]
pub(super) enum Again {
    /// The word that the setting has then.
    Setting(Setting),
    /// The safe word of an output.
    Safe(WriteSlot),
    Word(u32),
}

/// The registers of all modules, while they are collected. Registering one says everything about it.
///
/// Addresses are multiples of 4. Any number of modules may read a register, all in the same phase;
/// one may write it. Belongs to set-up: it allocates, and nothing is written to the board yet.
#[derive(Clone, Debug, Default)]
pub struct ImagePlan {
    pub(super) reads: Vec<Register>,
    pub(super) writes: Vec<Register>,
    pub(super) settings: Vec<SettingRegister>,
    steps: Vec<Step>,
}

impl ImagePlan {
    /// A register that is read in every cycle. Several may name the same.
    pub fn read(&mut self, phase: Phase, address: u16) -> ReadSlot {
        add_read(&mut self.reads, phase, address, false)
    }

    /// A register that is only read after somebody
    /// [asked](crate::modules::WriteCycle::ask_extra) for it, and when the driver looks closely.
    pub fn read_extra(&mut self, phase: Phase, address: u16) -> ReadSlot {
        add_read(&mut self.reads, phase, address, true)
    }

    /// A register that is written in every cycle and with the set-up, then as `safe`. Nothing else
    /// may write it, but for [steps](Self::step).
    pub fn output(&mut self, address: u16, safe: u32) -> WriteSlot {
        let slot = self.write(Phase::Data, address, safe);
        let place = StepPlace::In(Stage::Configure);
        self.add_step(place, address, Some(safe), Again::Safe(slot));
        slot
    }

    /// A register that is written in every cycle, as `word` until another one is put, and not with the
    /// set-up: what it has after a reset until then must do no harm. Nothing else may write it, but for
    /// [steps](Self::step).
    pub fn write(&mut self, phase: Phase, address: u16, word: u32) -> WriteSlot {
        let register = Register {
            phase,
            address,
            is_extra: false,
            word,
        };
        WriteSlot(push(&mut self.writes, register))
    }

    /// A register that is written with the set-up, when its word changes, and after a reset: always
    /// with the word it has then. Nothing else may write it, but for [steps](Self::step).
    ///
    /// One of [`Stage::Drive`] or [`Stage::Enable`] that changes in the cycle is only written to a
    /// board that is seen to be set up before and after it.
    pub fn setting(&mut self, stage: Stage, address: u16, word: u32) -> Setting {
        self.add_setting(Some(stage), address, word, false)
    }

    /// A setting of [`Stage::Drive`] that a reset clears: see [`watch`](Self::watch).
    pub(crate) fn drive(&mut self, address: u16, word: u32) -> Setting {
        self.add_setting(Some(Stage::Drive), address, word, true)
    }

    /// A register that is written in the cycles in which its word changes or is
    /// [repeated](super::Words::repeat), and never with the set-up.
    pub fn on_demand(&mut self, address: u16) -> Setting {
        self.add_setting(None, address, 0, false)
    }

    fn add_setting(
        &mut self,
        stage: Option<Stage>,
        address: u16,
        word: u32,
        is_drive: bool,
    ) -> Setting {
        let register = SettingRegister {
            stage,
            address,
            word,
            is_drive,
            shown: None,
        };
        let setting = Setting(push(&mut self.settings, register));
        if let Some(stage) = stage {
            let again = Again::Setting(setting);
            self.add_step(StepPlace::In(stage), address, Some(word), again);
        }
        setting
    }

    /// Looks whether the board, which has been set up, reads back what [drives](Self::drive) its
    /// pins. If so, that is [evidence](super::Words::stands) in every read that holds more than usual.
    ///
    /// # Errors
    /// Those of the bus.
    pub(crate) fn watch<B: RegisterBus>(&mut self, bus: &mut B) -> Result<(), B::Error> {
        let mut reads_back = false;
        let drives = self.settings.iter_mut().filter(|setting| setting.is_drive);
        let mut drives: Vec<_> = drives.collect();
        for drive in drives.iter().filter(|drive| drive.word != 0) {
            reads_back |= bus.read(drive.address)? == drive.word;
        }
        for drive in drives.iter_mut().filter(|_| reads_back) {
            let (reads, address) = (&mut self.reads, drive.address);
            drive.shown = Some(add_read(reads, Phase::Evidence, address, true));
        }
        Ok(())
    }

    /// A write of the set-up whose word stays. The order within a stage is that of the calls.
    pub fn step(&mut self, stage: Stage, address: u16, word: u32) {
        let place = StepPlace::In(stage);
        self.add_step(place, address, Some(word), Again::Word(word));
    }

    /// A write before all stages: `first` at first, `again` when the set-up is written again.
    pub(crate) fn opening(&mut self, address: u16, first: u32, again: u32) {
        let again = Again::Word(again);
        self.add_step(StepPlace::Opening, address, Some(first), again);
    }

    /// A write after all stages: `first` at first, `again` when the set-up is written again.
    pub(crate) fn closing(&mut self, address: u16, first: Option<u32>, again: u32) {
        self.add_step(StepPlace::Closing, address, first, Again::Word(again));
    }

    fn add_step(&mut self, place: StepPlace, address: u16, first: Option<u32>, again: Again) {
        self.steps.push(Step {
            place,
            address,
            first,
            again,
        });
    }

    /// Addresses and words of the set-up as it is written first, in order.
    pub(crate) fn first_set_up(&self) -> Vec<(u16, u32)> {
        let steps = self.sorted_steps().into_iter();
        steps
            .filter_map(|step| Some((step.address, step.first?)))
            .collect()
    }

    /// The steps in the order of their stages.
    pub(super) fn sorted_steps(&self) -> Vec<Step> {
        let mut steps = self.steps.clone();
        steps.sort_by_key(|step| step.place);
        steps
    }

    /// Writes the set-up for the first time: in one exchange, acknowledged.
    ///
    /// # Errors
    /// Those of the bus.
    pub(crate) fn set_up<B: RegisterBus>(&self, bus: &mut B) -> Result<(), B::Error> {
        let (accesses, mut words) = Access::writes(self.first_set_up());
        bus.exchange(&accesses, &mut words)
    }

    /// Refuses registers that can not be, that two write, or that are read or written at a time that
    /// does not fit.
    pub(crate) fn check(&self) -> Result<(), ImageError> {
        let mut reads: Vec<_> = self.reads.iter().map(|r| (r.address, r.phase)).collect();
        reads.sort_unstable();
        reads.dedup();
        let reads: Vec<u16> = reads.into_iter().map(|(address, _)| address).collect();
        let writes = self.writes.iter().map(|write| write.address);
        let settings = self.settings.iter().map(|setting| setting.address);
        let written: Vec<u16> = writes.chain(settings).collect();
        let steps = self.steps.iter().map(|step| &step.address);
        let mut all = reads.iter().chain(&written).chain(steps);
        let odd = all.find(|address| !address.is_multiple_of(4)).copied();
        let refuse = |at: Option<u16>, what| match at {
            Some(address) => Err(ImageError { address, what }),
            None => Ok(()),
        };
        let hint = "was registered: addresses are multiples of 4; check the module's descriptor";
        refuse(odd, hint)?;
        let mut late = self.reads.iter().filter(|r| r.phase == Phase::Trigger);
        let is_for_reads = |phase| matches!(phase, Phase::Status | Phase::Evidence);
        let mut unsent = self.writes.iter().filter(|w| is_for_reads(w.phase));
        let misplaced = late.next().or_else(|| unsent.next());
        let hint = "was registered for a phase that is not its own: reads have no `Phase::Trigger`, and \
                    writes neither `Phase::Status` nor `Phase::Evidence`; choose `Phase::Data`";
        refuse(misplaced.map(|register| register.address), hint)?;
        let hint = "is written by two modules; leave one of them out";
        refuse(twice(written), hint)?;
        let hint = "is read in two phases; leave one of the modules out";
        refuse(twice(reads), hint)
    }
}

/// An address that is there twice.
fn twice(mut addresses: Vec<u16>) -> Option<u16> {
    addresses.sort_unstable();
    let mut pairs = addresses.windows(2);
    let pair = pairs.find(|pair| pair.first() == pair.last())?;
    pair.first().copied()
}

fn add_read(reads: &mut Vec<Register>, phase: Phase, address: u16, is_extra: bool) -> ReadSlot {
    let register = Register {
        phase,
        address,
        is_extra,
        word: 0,
    };
    ReadSlot(push(reads, register))
}

/// Adds to a list; returns the number of what was added.
pub(super) fn push<T>(list: &mut Vec<T>, item: T) -> u16 {
    let number = list.len();
    debug_assert!(
        u16::try_from(number).is_ok(),
        "more than there are registers"
    );
    list.push(item);
    number as u16
}
