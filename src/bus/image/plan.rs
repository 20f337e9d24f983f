//! Registration of the modules' registers.

use alloc::vec::Vec;

use crate::advice::{self, Advice, MesaError};
use crate::bus::{Access, BusError, BusErrorKind, RegisterBus};

/// Position of a register within an exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Phase {
    /// Before everything else: reads that latch or mark a time, and writes without which no data
    /// may be executed.
    First,
    /// Reads that show whether the data after them can be trusted.
    Status,
    /// Data.
    Data,
    /// After all data: writes that start something with it.
    Trigger,
    /// After all data: reads that show whether the board still has its set-up. If it has, it had it
    /// while everything before them was read.
    Evidence,
}

/// The stages of the set-up, in their order: nothing is driven early.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// Stops driving all pins.
    Quiesce,
    /// Configures the functions of the modules.
    Configure,
    /// Routes the functions to pins.
    Route,
    /// Drives the pins. Everything before protects this: as long as this stage has not run, each of
    /// the others can be written alone, late or twice, and nothing is driven.
    Drive,
    /// Writes that must wait until the pins are driven.
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

/// Reason why an image cannot be planned: an impossible register, or one that two modules claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("register {address:#06X} {what}")]
#[non_exhaustive]
pub struct ImageError {
    /// The register.
    pub address: u16,
    /// The problem.
    pub what: &'static str,
    /// The next step.
    pub advice: Advice,
}

impl MesaError for ImageError {
    fn advice(&self) -> Option<Advice> {
        Some(self.advice)
    }
}

/// A register of the cycle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Register {
    pub phase: Phase,
    pub address: u16,
    /// For a read: the reads that contain it.
    pub wanted: Wanted,
    /// For a write: its word until another one is put.
    pub word: u32,
}

/// The reads that contain a register.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Wanted {
    /// All.
    Cycle,
    /// Those with extra registers, and those beside another program.
    Extra,
    /// Those beside another program.
    Beside,
}

/// A register that is written when its word changes.
#[derive(Clone, Copy, Debug)]
pub(super) struct SettingRegister {
    /// `None`: not part of the set-up.
    pub stage: Option<Stage>,
    pub address: u16,
    pub word: u32,
    /// True if it drives pins, and a reset clears it.
    is_drive: bool,
    /// It follows another setting of the same register.
    is_next: bool,
    /// Slot in which it is read back as evidence, if the board reads it back.
    pub shown: Option<ReadSlot>,
}

/// A write of the set-up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub place: StepPlace,
    pub address: u16,
    /// Word of the first set-up; `None` to write nothing then.
    first: Option<u32>,
    pub again: RepeatedWord,
}

/// Position of a step in the set-up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum StepPlace {
    Opening,
    In(Stage),
    Closing,
}

/// Word of a step when the set-up is written again.
#[derive(Clone, Copy, Debug)]
pub(super) enum RepeatedWord {
    /// The present word of the setting.
    Setting(Setting),
    /// The safe word of an output.
    Safe(WriteSlot),
    Word(u32),
}

/// The registers of all modules, while they are collected. A single call registers a register
/// completely.
///
/// Addresses are multiples of 4. Any number of modules may read a register, all in the same phase;
/// only one may write it. For set-up: allocates, and writes nothing to the board yet.
#[derive(Clone, Debug, Default)]
pub struct ImagePlan {
    pub(super) reads: Vec<Register>,
    pub(super) writes: Vec<Register>,
    pub(super) settings: Vec<SettingRegister>,
    pub(super) steps: Vec<Step>,
}

impl ImagePlan {
    /// Registers a read in every cycle. Several modules may read the same register.
    pub fn read(&mut self, phase: Phase, address: u16) -> ReadSlot {
        add_read(&mut self.reads, phase, address, Wanted::Cycle)
    }

    /// Registers a read that is made only after a module has
    /// [requested](crate::modules::WriteCycle::request_extra) it, and when the driver checks the
    /// evidence.
    pub fn read_extra(&mut self, phase: Phase, address: u16) -> ReadSlot {
        add_read(&mut self.reads, phase, address, Wanted::Extra)
    }

    /// Registers a read of a register that the module writes, and whose content another program has
    /// determined: [`Board::listen`](crate::Board::listen) reads it, a driver never does. The slot
    /// is for [`Module::listen`](crate::modules::Module::listen) alone.
    pub fn read_back(&mut self, address: u16) -> ReadSlot {
        add_read(&mut self.reads, Phase::Data, address, Wanted::Beside)
    }

    /// Registers a second read of a register, after all data, for [`Board::listen`].
    ///
    /// [`Board::listen`]: crate::Board::listen
    pub(crate) fn read_again(&mut self, address: u16) -> ReadSlot {
        add_read(&mut self.reads, Phase::Evidence, address, Wanted::Beside)
    }

    /// Registers a write in every cycle and with the set-up, which writes `safe`. Nothing else may
    /// write the register, except [steps](Self::step).
    pub fn output(&mut self, address: u16, safe: u32) -> WriteSlot {
        let slot = self.write(Phase::Data, address, safe);
        let place = StepPlace::In(Stage::Configure);
        self.add_step(place, address, Some(safe), RepeatedWord::Safe(slot));
        slot
    }

    /// Registers a write in every cycle, of `word` until another one is put, but not with the
    /// set-up: the content of the register between a reset and the first write must do no harm.
    /// Nothing else may write it, except [steps](Self::step).
    pub fn write(&mut self, phase: Phase, address: u16, word: u32) -> WriteSlot {
        let register = Register {
            phase,
            address,
            wanted: Wanted::Cycle,
            word,
        };
        WriteSlot(push(&mut self.writes, register))
    }

    /// Registers a setting: written with the set-up, when its word changes, and after a reset,
    /// always with its present word. Nothing else may write the register, except
    /// [steps](Self::step).
    ///
    /// A setting of [`Stage::Drive`] or [`Stage::Enable`] that changes in the cycle is only written
    /// to a board that is found to be set up before and after the write.
    pub fn setting(&mut self, stage: Stage, address: u16, word: u32) -> Setting {
        self.add_setting(Some(stage), address, word, false)
    }

    /// Registers settings of one register that takes several words, one after the other: a shift
    /// register. They are written in this order. When one of them changes, all have to be
    /// [repeated](super::Words::repeat) in the same write, so that lost or duplicated packets leave
    /// the same content.
    pub fn sequence<const N: usize>(
        &mut self,
        stage: Stage,
        address: u16,
        words: [u32; N],
    ) -> [Setting; N] {
        let settings = words.map(|word| self.setting(stage, address, word));
        for setting in settings.iter().skip(1) {
            if let Some(register) = self.settings.get_mut(usize::from(setting.0)) {
                register.is_next = true;
            }
        }
        settings
    }

    /// Registers a setting of [`Stage::Drive`] that a reset clears: see [`watch`](Self::watch).
    pub(crate) fn drive(&mut self, address: u16, word: u32) -> Setting {
        self.add_setting(Some(Stage::Drive), address, word, true)
    }

    /// Registers a write in the cycles in which its word changes or is
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
            is_next: false,
            shown: None,
        };
        let setting = Setting(push(&mut self.settings, register));
        if let Some(stage) = stage {
            let again = RepeatedWord::Setting(setting);
            self.add_step(StepPlace::In(stage), address, Some(word), again);
        }
        setting
    }

    /// Changes the word of a setting before the cycle begins, in the set-up as well. The board is
    /// not written.
    pub(crate) fn change(&mut self, setting: Setting, word: u32) {
        if let Some(register) = self.settings.get_mut(usize::from(setting.0)) {
            register.word = word;
        }
        for step in &mut self.steps {
            if matches!(step.again, RepeatedWord::Setting(of) if of == setting) {
                step.first = Some(word);
            }
        }
    }

    /// Detects whether the board, which has been set up, reads back the settings that
    /// [drive](Self::drive) its pins. If so, they become [evidence](super::Words::evidence_matches)
    /// in every read with extra registers.
    ///
    /// # Errors
    /// Errors of the bus.
    pub(crate) fn watch<B: RegisterBus>(&mut self, bus: &mut B) -> Result<(), BusError> {
        let mut reads_back = false;
        let drives = self.settings.iter_mut().filter(|setting| setting.is_drive);
        let mut drives: Vec<_> = drives.collect();
        for drive in drives.iter().filter(|drive| drive.word != 0) {
            reads_back |= bus.read(drive.address)? == drive.word;
        }
        for drive in drives.iter_mut().filter(|_| reads_back) {
            let (reads, address) = (&mut self.reads, drive.address);
            drive.shown = Some(add_read(reads, Phase::Evidence, address, Wanted::Extra));
        }
        Ok(())
    }

    /// Adds a write of the set-up with a fixed word. The order within a stage is that of the calls.
    pub fn step(&mut self, stage: Stage, address: u16, word: u32) {
        let place = StepPlace::In(stage);
        self.add_step(place, address, Some(word), RepeatedWord::Word(word));
    }

    /// Adds a write before all stages, with one word for the first set-up and one for writing it
    /// again.
    pub(crate) fn opening(&mut self, address: u16, first: u32, again: u32) {
        let again = RepeatedWord::Word(again);
        self.add_step(StepPlace::Opening, address, Some(first), again);
    }

    /// Adds a write after all stages, with one word for the first set-up and one for writing it
    /// again.
    pub(crate) fn closing(&mut self, address: u16, first: Option<u32>, again: u32) {
        self.add_step(
            StepPlace::Closing,
            address,
            first,
            RepeatedWord::Word(again),
        );
    }

    fn add_step(
        &mut self,
        place: StepPlace,
        address: u16,
        first: Option<u32>,
        again: RepeatedWord,
    ) {
        self.steps.push(Step {
            place,
            address,
            first,
            again,
        });
    }

    /// Addresses and words of the first set-up, in order.
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

    /// Writes the set-up for the first time: acknowledged, and in one exchange if it fits a packet.
    ///
    /// # Errors
    /// Errors of the bus.
    pub(crate) fn set_up<B: RegisterBus>(&self, bus: &mut B) -> Result<(), BusError> {
        let (accesses, mut words) = Access::writes(self.first_set_up());
        exchange_parts(bus, &accesses, &mut words)
    }

    /// Refuses impossible addresses, registers with two writers, and registers that are read or
    /// written in an unsuitable phase.
    pub(crate) fn check(&self) -> Result<(), ImageError> {
        let of_driver = self.reads.iter().filter(|r| r.wanted != Wanted::Beside);
        let mut reads: Vec<_> = of_driver.map(|r| (r.address, r.phase)).collect();
        reads.sort_unstable();
        reads.dedup();
        let reads: Vec<u16> = reads.into_iter().map(|(address, _)| address).collect();
        let writes = self.writes.iter().map(|write| write.address);
        let settings = self.settings.iter().filter(|setting| !setting.is_next);
        let settings = settings.map(|setting| setting.address);
        let written: Vec<u16> = writes.chain(settings).collect();
        let steps = self.steps.iter().map(|step| &step.address);
        let mut all = reads.iter().chain(&written).chain(steps);
        let odd = all.find(|address| !address.is_multiple_of(4)).copied();
        let refuse = |at: Option<u16>, what, advice| match at {
            Some(address) => Err(ImageError {
                address,
                what,
                advice,
            }),
            None => Ok(()),
        };
        let what = "was registered, and addresses are multiples of 4";
        refuse(odd, what, advice::CHECK_DESCRIPTOR)?;
        let mut late = self.reads.iter().filter(|r| r.phase == Phase::Trigger);
        let is_for_reads = |phase| matches!(phase, Phase::Status | Phase::Evidence);
        let mut unsent = self.writes.iter().filter(|w| is_for_reads(w.phase));
        let misplaced = late.next().or_else(|| unsent.next());
        let what = "was registered for a phase that is not its own: reads have no `Phase::Trigger`, and \
                    writes neither `Phase::Status` nor `Phase::Evidence`";
        let misplaced = misplaced.map(|register| register.address);
        refuse(misplaced, what, advice::CHOOSE_PHASE)?;
        let twice_written = "is written by two modules";
        refuse(twice(written), twice_written, advice::LEAVE_MODULE_OUT)?;
        refuse(
            twice(reads),
            "is read in two phases",
            advice::LEAVE_MODULE_OUT,
        )
    }
}

/// Exchanges accesses in their order, in as few exchanges as the bus needs.
pub(super) fn exchange_parts<B: RegisterBus>(
    bus: &mut B,
    accesses: &[Access],
    words: &mut [u32],
) -> Result<(), BusError> {
    match bus.exchange(accesses, words) {
        Err(error) if error.kind() == BusErrorKind::Invalid && accesses.len() > 1 => {
            let (first, second) = accesses.split_at(accesses.len() / 2);
            exchange_parts(bus, first, words)?;
            exchange_parts(bus, second, words)
        }
        result => result,
    }
}

/// An address that occurs twice.
fn twice(mut addresses: Vec<u16>) -> Option<u16> {
    addresses.sort_unstable();
    let mut pairs = addresses.windows(2);
    let pair = pairs.find(|pair| pair.first() == pair.last())?;
    pair.first().copied()
}

fn add_read(reads: &mut Vec<Register>, phase: Phase, address: u16, wanted: Wanted) -> ReadSlot {
    let register = Register {
        phase,
        address,
        wanted,
        word: 0,
    };
    ReadSlot(push(reads, register))
}

/// Adds to a list; returns the number of the new item.
pub(super) fn push<T>(list: &mut Vec<T>, item: T) -> u16 {
    let number = list.len();
    debug_assert!(
        u16::try_from(number).is_ok(),
        "more than there are registers"
    );
    list.push(item);
    number as u16
}
