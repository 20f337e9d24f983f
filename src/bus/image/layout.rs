//! Registers become runs of neighbours, and each gets its place in the word buffer.

use alloc::{boxed::Box, vec, vec::Vec};

use super::parts::Parts;
use super::plan::{Content, ImagePlan, ReadPhase, StepPlace, WritePhase};
use super::words::{Progress, SettingState, Shown};
use super::{ImageError, Stage, Words};
use crate::bus::Access;

/// Reads of registers so many registers apart are merged, and what lies between is read along and
/// ignored: on Ethernet one register more costs four bytes, as does a command.
const BRIDGE: u16 = 1;

/// Everything that is exchanged, before a bus has prepared it.
#[derive(Debug)]
pub struct Layout {
    pub(super) reads: ReadLayout,
    pub(super) writes: WriteLayout,
    pub(super) set_up: Vec<Access>,
    pub(super) quiesce: Vec<Access>,
    pub(super) parts: Parts,
    pub(super) words: Words,
}

impl ImagePlan {
    /// Sorts and merges what was registered, and gives each register its place in the word buffer.
    ///
    /// # Errors
    /// Registers that can not be.
    pub fn lay_out(&self) -> Result<Layout, ImageError> {
        self.check()?;
        let reads = ReadLayout::new(self)?;
        let writes = WriteLayout::new(self, reads.words());
        let first_setting = reads.words() + self.writes.len() as u16;
        let mut words = vec![0; usize::from(reads.words())];
        words.extend(writes.words());
        words.extend(self.settings.iter().map(|setting| setting.word));
        let mut safes = vec![u16::MAX; self.writes.len()];
        let (mut set_up, mut quiesce) = (Vec::new(), Vec::new());
        for step in self.sorted_steps() {
            let mut constant = |word| {
                words.push(word);
                (words.len() - 1) as u16
            };
            let place = match step.content {
                Content::Setting(setting) => first_setting + setting.0,
                Content::Words { again, .. } => constant(again),
                Content::Safe(slot) => {
                    let place = constant(self.safe(slot).unwrap_or(0));
                    if let Some(safe) = safes.get_mut(usize::from(slot.0)) {
                        *safe = place;
                    }
                    place
                }
            };
            let access = Access::write(step.address, place, 1);
            set_up.push(access);
            if step.place == StepPlace::In(Stage::Quiesce) {
                quiesce.push(access);
            }
        }
        let words = Words {
            content: words.into_boxed_slice(),
            reads: reads.index.clone().into_boxed_slice(),
            writes: writes.index.clone().into_boxed_slice(),
            safes: safes.into_boxed_slice(),
            first_setting,
            settings: self.states(),
            asked: 0,
            asked_guarded: 0,
            sent: 0,
        };
        Ok(Layout {
            parts: Parts::new(self, &writes, first_setting),
            reads,
            writes,
            set_up,
            quiesce,
            words,
        })
    }

    fn states(&self) -> Box<[SettingState]> {
        let states = self.settings.iter().map(|register| SettingState {
            progress: Progress::Rests,
            is_of_set_up: register.stage.is_some(),
            is_guarded: matches!(register.stage, Some(Stage::Drive | Stage::Enable)),
            shown: register.shown.map(|slot| Shown {
                slot,
                expected: register.word,
            }),
        });
        states.collect()
    }
}

/// The registers that are read.
#[derive(Debug)]
pub(super) struct ReadLayout {
    /// In the order of the exchange; the position is the place in the word buffer.
    registers: Vec<Place>,
    /// The place of each slot.
    pub index: Vec<u16>,
}

#[derive(Clone, Copy, Debug)]
struct Place {
    phase: ReadPhase,
    address: u16,
    is_extra: bool,
    /// Nobody has registered it: it lies between two others.
    is_gap: bool,
}

impl ReadLayout {
    pub fn new(plan: &ImagePlan) -> Result<Self, ImageError> {
        let mut registers: Vec<Place> = plan
            .reads
            .iter()
            .map(|read| Place {
                phase: read.phase,
                address: read.address,
                is_extra: read.is_extra,
                is_gap: false,
            })
            .collect();
        registers.sort_by_key(|place| (place.phase, place.address, place.is_extra));
        registers.dedup_by_key(|place| (place.phase, place.address));
        let mut addresses: Vec<u16> = registers.iter().map(|place| place.address).collect();
        addresses.sort_unstable();
        if let Some(&[address, ..]) = addresses.windows(2).find(|two| two.first() == two.last()) {
            return Err(ImageError::ReadInTwoPhases { address });
        }
        let registers = with_gaps(&registers);
        let place = |phase, address| {
            let key = (phase, address);
            registers.partition_point(|place| (place.phase, place.address) < key) as u16
        };
        let reads = plan.reads.iter();
        let index = reads.map(|read| place(read.phase, read.address)).collect();
        Ok(Self { registers, index })
    }

    pub fn words(&self) -> u16 {
        self.registers.len() as u16
    }

    /// The accesses of one exchange, with `extra` ones or without.
    pub fn reads(&self, extra: bool) -> Vec<Access> {
        self.runs(|place| extra || !place.is_extra)
    }

    /// The accesses of one phase.
    pub fn phase(&self, phase: ReadPhase, extra: bool) -> Vec<Access> {
        self.runs(|place| place.phase == phase && (extra || !place.is_extra))
    }

    fn runs(&self, is_read: impl Fn(&Place) -> bool) -> Vec<Access> {
        let mut runs: Vec<(ReadPhase, Access)> = Vec::new();
        for (first, place) in (0u16..).zip(&self.registers) {
            if place.is_gap || !is_read(place) {
                continue;
            }
            if let Some((phase, run)) = runs.last_mut() {
                let places = first - run.first;
                let distance = place.address.checked_sub(run.address);
                let is_near = places - run.count <= BRIDGE;
                if *phase == place.phase && is_near && distance == places.checked_mul(4) {
                    run.count = places + 1;
                    continue;
                }
            }
            runs.push((place.phase, Access::read(place.address, first, 1)));
        }
        runs.into_iter().map(|(_, run)| run).collect()
    }
}

/// The registers between neighbours that are read along have a place as well.
fn with_gaps(registers: &[Place]) -> Vec<Place> {
    let mut all: Vec<Place> = Vec::with_capacity(registers.len());
    for &place in registers {
        if let Some(&before) = all.last() {
            let gap = (place.address.wrapping_sub(before.address) / 4).wrapping_sub(1);
            if before.phase == place.phase && gap <= BRIDGE {
                all.extend((1..=gap).map(|n| Place {
                    address: before.address + 4 * n,
                    is_gap: true,
                    ..before
                }));
            }
        }
        all.push(place);
    }
    all
}

/// The registers that are written in every cycle.
#[derive(Debug)]
pub(super) struct WriteLayout {
    /// Phase, address and first word, in the order of the exchange.
    registers: Vec<(WritePhase, u16, u32)>,
    /// The place of its first register in the word buffer.
    first: u16,
    /// The place of each slot.
    pub index: Vec<u16>,
}

impl WriteLayout {
    /// Behind `first` other words.
    pub fn new(plan: &ImagePlan, first: u16) -> Self {
        let writes = plan.writes.iter();
        let mut registers: Vec<_> = writes
            .map(|write| (write.phase, write.address, write.word))
            .collect();
        registers.sort_by_key(|&(phase, address, _)| (phase, address));
        let place = |phase, address| {
            let is_before = |&(p, a, _): &(_, _, _)| (p, a) < (phase, address);
            first + registers.partition_point(is_before) as u16
        };
        let writes = plan.writes.iter();
        let index = writes
            .map(|write| place(write.phase, write.address))
            .collect();
        Self {
            registers,
            first,
            index,
        }
    }

    pub fn words(&self) -> impl Iterator<Item = u32> + '_ {
        self.registers.iter().map(|&(_, _, word)| word)
    }

    /// The accesses of one phase.
    pub fn phase(&self, wanted: WritePhase) -> Vec<Access> {
        let mut runs: Vec<Access> = Vec::new();
        for (place, &(phase, address, _)) in (self.first..).zip(&self.registers) {
            if phase != wanted {
                continue;
            }
            match runs.last_mut() {
                Some(run)
                    if u32::from(run.address) + 4 * u32::from(run.count) == u32::from(address) =>
                {
                    run.count += 1;
                }
                _ => runs.push(Access::write(address, place, 1)),
            }
        }
        runs
    }

    /// The accesses of a cycle.
    pub fn writes(&self) -> Vec<Access> {
        let phases = [WritePhase::First, WritePhase::Data, WritePhase::Trigger];
        phases
            .into_iter()
            .flat_map(|phase| self.phase(phase))
            .collect()
    }
}
