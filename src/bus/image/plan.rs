//! What modules register, while it is collected.

use alloc::vec::Vec;

use crate::bus::{Access, RegisterBus};

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

/// Why an image can not be planned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// A register that is none.
    #[error(
        "register {address:#06X} was registered: addresses are multiples of 4; check the module's \
         descriptor"
    )]
    BadAddress {
        /// The address.
        address: u16,
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
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Read {
    pub phase: ReadPhase,
    /// Only in reads that hold more than usual.
    pub is_extra: bool,
    pub address: u16,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Write {
    pub phase: WritePhase,
    pub address: u16,
    /// The word until another one is put.
    pub word: u32,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Register {
    /// `None`: not part of the set-up.
    pub stage: Option<Stage>,
    pub address: u16,
    pub word: u32,
    /// Where it is read back as evidence, if the board reads it back.
    pub shown: Option<ReadSlot>,
}

/// A write of the set-up.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub place: StepPlace,
    pub address: u16,
    pub content: Content,
}

/// When a step is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum StepPlace {
    Opening,
    In(Stage),
    Closing,
}

/// What a step writes.
#[derive(Clone, Copy, Debug)]
pub(super) enum Content {
    /// The current word.
    Setting(Setting),
    /// The safe word of an output.
    Safe(WriteSlot),
    /// At first (`None`: nothing), and when the set-up is written again.
    Words { first: Option<u32>, again: u32 },
}

/// The registers of all modules, while they are collected.
///
/// Belongs to set-up: it allocates.
#[derive(Clone, Debug, Default)]
pub struct ImagePlan {
    pub(super) reads: Vec<Read>,
    pub(super) writes: Vec<Write>,
    pub(super) settings: Vec<Register>,
    drives: Vec<Setting>,
    steps: Vec<Step>,
}

impl ImagePlan {
    /// No register yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// A register that is read in every cycle. Several may name the same.
    pub fn read(&mut self, phase: ReadPhase, address: u16) -> ReadSlot {
        self.add_read(phase, false, address)
    }

    /// A register that is only read when somebody asks for more than usual.
    pub fn read_extra(&mut self, phase: ReadPhase, address: u16) -> ReadSlot {
        self.add_read(phase, true, address)
    }

    fn add_read(&mut self, phase: ReadPhase, is_extra: bool, address: u16) -> ReadSlot {
        self.reads.push(Read {
            phase,
            is_extra,
            address,
        });
        ReadSlot(last(&self.reads))
    }

    /// A register that is written in every cycle and with the set-up, then as `safe`. Nothing else
    /// may write it, but for [steps](Self::step).
    pub fn output(&mut self, address: u16, safe: u32) -> WriteSlot {
        let slot = self.write(WritePhase::Data, address, safe);
        self.add_step(
            StepPlace::In(Stage::Configure),
            address,
            Content::Safe(slot),
        );
        slot
    }

    /// A register that is written in every cycle, as `word` until another one is put, and not with the
    /// set-up. Nothing else may write it, but for [steps](Self::step).
    pub fn write(&mut self, phase: WritePhase, address: u16, word: u32) -> WriteSlot {
        self.writes.push(Write {
            phase,
            address,
            word,
        });
        WriteSlot(last(&self.writes))
    }

    /// A register that is written with the set-up and when its word changes. Nothing else may write
    /// it, but for [steps](Self::step).
    pub fn setting(&mut self, stage: Stage, address: u16, word: u32) -> Setting {
        let setting = self.add_setting(Some(stage), address, word);
        self.add_step(StepPlace::In(stage), address, Content::Setting(setting));
        setting
    }

    /// A register that is written when its word changes or somebody asks for it, and never with the
    /// set-up.
    pub fn on_demand(&mut self, address: u16) -> Setting {
        self.add_setting(None, address, 0)
    }

    fn add_setting(&mut self, stage: Option<Stage>, address: u16, word: u32) -> Setting {
        self.settings.push(Register {
            stage,
            address,
            word,
            shown: None,
        });
        Setting(last(&self.settings))
    }

    /// A setting of [`Stage::Drive`] that a reset clears: see [`watch`](Self::watch).
    pub fn drive(&mut self, address: u16, word: u32) -> Setting {
        let setting = self.setting(Stage::Drive, address, word);
        self.drives.push(setting);
        setting
    }

    /// Looks whether the board, which has been set up, reads back what [drives](Self::drive) its
    /// pins. If so, that is [evidence](super::Words::stands) in every read that holds more than usual.
    ///
    /// # Errors
    /// Those of the bus.
    pub fn watch<B: RegisterBus>(&mut self, bus: &mut B) -> Result<(), B::Error> {
        let mut reads_back = false;
        let of = |plan: &Self, setting: Setting| plan.settings.get(usize::from(setting.0)).copied();
        for &setting in &self.drives {
            if let Some(register) = of(self, setting).filter(|register| register.word != 0) {
                reads_back |= bus.read(register.address)? == register.word;
            }
        }
        if !reads_back {
            return Ok(());
        }
        for setting in core::mem::take(&mut self.drives) {
            let Some(register) = of(self, setting) else {
                continue;
            };
            let shown = Some(self.read_extra(ReadPhase::Evidence, register.address));
            if let Some(kept) = self.settings.get_mut(usize::from(setting.0)) {
                *kept = Register { shown, ..register };
            }
        }
        Ok(())
    }

    /// A write of the set-up whose word stays. The order within a stage is that of the calls.
    pub fn step(&mut self, stage: Stage, address: u16, word: u32) {
        let content = Content::Words {
            first: Some(word),
            again: word,
        };
        self.add_step(StepPlace::In(stage), address, content);
    }

    /// A write before all stages: `first` at first, `again` when the set-up is written again.
    pub fn opening(&mut self, address: u16, first: u32, again: u32) {
        let first = Some(first);
        self.add_step(StepPlace::Opening, address, Content::Words { first, again });
    }

    /// A write after all stages: `first` at first, `again` when the set-up is written again.
    pub fn closing(&mut self, address: u16, first: Option<u32>, again: u32) {
        self.add_step(StepPlace::Closing, address, Content::Words { first, again });
    }

    fn add_step(&mut self, place: StepPlace, address: u16, content: Content) {
        self.steps.push(Step {
            place,
            address,
            content,
        });
    }

    /// Addresses and words of the set-up as it is written first, in order.
    pub fn first_set_up(&self) -> Vec<(u16, u32)> {
        let word = |step: &Step| match step.content {
            Content::Words { first, .. } => first,
            Content::Safe(slot) => self.safe(slot),
            Content::Setting(setting) => {
                let register = self.settings.get(usize::from(setting.0));
                register.map(|register| register.word)
            }
        };
        let steps = self.sorted_steps();
        let steps = steps.iter();
        steps
            .filter_map(|step| Some((step.address, word(step)?)))
            .collect()
    }

    pub(super) fn safe(&self, slot: WriteSlot) -> Option<u32> {
        Some(self.writes.get(usize::from(slot.0))?.word)
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
    pub fn set_up<B: RegisterBus>(&self, bus: &mut B) -> Result<(), B::Error> {
        let list = self.first_set_up();
        let accesses: Vec<_> = (0u16..)
            .zip(&list)
            .map(|(n, &(address, _))| Access::write(address, n, 1))
            .collect();
        let mut words: Vec<_> = list.iter().map(|&(_, word)| word).collect();
        bus.exchange(&accesses, &mut words)
    }

    /// Refuses registers that can not be, or that two write.
    pub fn check(&self) -> Result<(), ImageError> {
        let reads = self.reads.iter().map(|read| read.address);
        let steps = self.steps.iter().map(|step| step.address);
        let writes = self.writes.iter().map(|write| write.address);
        let settings = self.settings.iter().map(|setting| setting.address);
        let mut written: Vec<u16> = writes.chain(settings).collect();
        let all = reads.chain(steps).chain(written.iter().copied());
        for address in all {
            if !address.is_multiple_of(4) {
                return Err(ImageError::BadAddress { address });
            }
        }
        written.sort_unstable();
        match written.windows(2).find(|pair| pair.first() == pair.last()) {
            Some(&[address, ..]) => Err(ImageError::WrittenTwice { address }),
            _ => Ok(()),
        }
    }
}

fn last<T>(list: &[T]) -> u16 {
    debug_assert!(
        u16::try_from(list.len()).is_ok(),
        "more registers than there are"
    );
    list.len().saturating_sub(1) as u16
}
