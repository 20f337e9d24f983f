//! Layout: registers are merged into runs of neighbours, and each gets its place in the word
//! buffer.

use alloc::{vec, vec::Vec};
use core::time::Duration;

use super::exchange::{Exchanges, Lists, PacedReads, ReadsBeside, SettingExchanges};
use super::plan::{ImagePlan, Register, RepeatedWord, StepPlace, Wanted, push};
use super::{Phase, Stage, Words};
use crate::bus::{Access, AccessList, BusError, BusErrorKind, Direction, Hold, RegisterBus};

/// Reads are merged across gaps of up to this many registers, which are read along and ignored: on
/// Ethernet an additional register costs four bytes, and so does a command.
const BRIDGE: u16 = 1;

/// Prepares lists that write `all` in this order, in as few packets as the bus needs. Each but the
/// last one ends with the reads `ack`, whose reply shows that it was executed before the next one
/// is sent; the last one ends with the reads `end`.
fn prepare_parts<B: RegisterBus>(
    bus: &mut B,
    all: &[Access],
    ack: &[Access],
    end: &[Access],
) -> Result<Vec<AccessList>, BusError> {
    match bus.prepare(&[all, end].concat(), None) {
        Ok(list) => Ok(vec![list]),
        Err(error) if error.kind() == BusErrorKind::Invalid && all.len() > 1 => {
            let (first, second) = all.split_at(all.len() / 2);
            let mut lists = prepare_parts(bus, first, ack, ack)?;
            lists.extend(prepare_parts(bus, second, ack, end)?);
            Ok(lists)
        }
        Err(error) => Err(error),
    }
}

impl ImagePlan {
    /// Sorts and merges the registered accesses, gives each register its place in the word buffer,
    /// and has the bus prepare all lists. Nothing is exchanged.
    ///
    /// `held`: if the board paces, the longest time by which it delays the reads of a cycle. The
    /// plan has been [checked](Self::check).
    ///
    /// # Errors
    /// Errors of the bus about a list, for example that it does not fit a packet.
    pub(crate) fn freeze<B: RegisterBus>(
        &self,
        bus: &mut B,
        held: Option<Duration>,
    ) -> Result<(Exchanges, Words), BusError> {
        debug_assert!(self.check().is_ok(), "it was checked");
        let of_driver = |read: &&Register| read.wanted != Wanted::Beside;
        let of_driver: Vec<_> = self.reads.iter().filter(of_driver).copied().collect();
        let reads = Block::new(Direction::Read, &of_driver, 0, BRIDGE);
        let writes = Block::new(Direction::Write, &self.writes, reads.end, BRIDGE);
        let first_setting = writes.end;
        let mut content = vec![0; usize::from(reads.end)];
        content.extend(writes.places.iter().map(|(_, write)| write.word));
        content.extend(self.settings.iter().map(|setting| setting.word));
        content.extend(self.writes.iter().map(|write| write.word));
        let StepAccesses {
            all: set_up,
            renewal,
            quiesce,
        } = self.step_accesses(first_setting, &mut content);
        let read = |extra| reads.runs(|read| extra || read.wanted == Wanted::Cycle);
        let write = writes.runs(|_| true);
        let writes_of = |phase| writes.runs(|write| write.phase == phase);
        let cycle = |extra| [&write[..], &read(extra)].concat();
        let inputs = [
            &writes_of(Phase::First)[..],
            &quiesce,
            &writes_of(Phase::Data),
            &writes_of(Phase::Trigger),
        ];
        let inputs = inputs.concat();
        let inputs_cycle = |extra| [&inputs[..], &read(extra)].concat();
        let evidence = reads.runs(|read| read.phase == Phase::Evidence);
        let status = reads.runs(|read| read.phase == Phase::Status && read.wanted == Wanted::Cycle);
        let mut both = |list: &dyn Fn(bool) -> Vec<Access>, before| {
            let hold = Option::zip(before, held).map(|(before, limit)| Hold { before, limit });
            Ok::<_, BusError>([
                bus.prepare(&list(false), hold)?,
                bus.prepare(&list(true), hold)?,
            ])
        };
        let exchanges = Exchanges {
            lists: Lists {
                read: both(&read, None)?,
                paced: match held {
                    None => None,
                    Some(_) => Some(PacedReads {
                        read: both(&read, Some(0))?,
                        cycle: both(&cycle, Some(write.len()))?,
                        inputs: both(&inputs_cycle, Some(inputs.len()))?,
                    }),
                },
                write: bus.prepare(&write, None)?,
                inputs: bus.prepare(&inputs, None)?,
                status: bus.prepare(&status, None)?,
                evidence: bus.prepare(&evidence, None)?,
                set_up: prepare_parts(bus, &set_up, &status, &evidence)?,
                renewal: prepare_parts(bus, &renewal, &status, &evidence)?,
                quiesce: bus.prepare(&quiesce, None)?,
            },
            parts: SettingExchanges::new(self, writes_of, first_setting),
        };
        let (read_places, write_places) = (reads.index(&self.reads), writes.index(&self.writes));
        let words = Words::new(self, content, read_places, write_places, first_setting);
        Ok((exchanges, words))
    }

    /// The reads of all registers beside a program that drives the board, but those that mark a
    /// time for it ([`Phase::First`]), and the words for them. No other register is read along.
    pub(crate) fn freeze_beside(&self) -> (ReadsBeside, Words) {
        let listened = |read: &&Register| read.phase != Phase::First;
        let listened: Vec<_> = self.reads.iter().filter(listened).copied().collect();
        let reads = Block::new(Direction::Read, &listened, 0, 0);
        let content = vec![0; usize::from(reads.end)];
        let places = reads.index(&self.reads);
        let words = Words::new(&Self::default(), content, places, Vec::new(), reads.end);
        (ReadsBeside(reads.runs(|_| true)), words)
    }

    /// The accesses of the steps in their order. Appends the words of the steps that have no other
    /// place to `content`.
    fn step_accesses(&self, first_setting: u16, content: &mut Vec<u32>) -> StepAccesses {
        let first_safe = first_setting.saturating_add(self.settings.len() as u16);
        let mut accesses = StepAccesses::default();
        for step in self.sorted_steps() {
            let place = match step.again {
                RepeatedWord::Setting(setting) => first_setting.saturating_add(setting.0),
                RepeatedWord::Safe(slot) => first_safe.saturating_add(slot.0),
                RepeatedWord::Word(word) => push(content, word),
            };
            let access = Access::write(step.address, place, 1);
            let quiesces = step.place == StepPlace::In(Stage::Quiesce);
            let is_of_watchdog = matches!(step.place, StepPlace::Opening | StepPlace::Closing);
            accesses.all.push(access);
            if quiesces {
                accesses.quiesce.push(access);
            }
            let lets_go = quiesces && self.drives_pins(step.address);
            if !lets_go && !is_of_watchdog {
                accesses.renewal.push(access);
            }
        }
        accesses
    }

    /// True if a later step writes this register to drive pins.
    fn drives_pins(&self, address: u16) -> bool {
        let drive = StepPlace::In(Stage::Drive);
        let mut steps = self.steps.iter();
        steps.any(|step| step.address == address && step.place == drive)
    }
}

/// The accesses of the steps of a set-up.
#[derive(Default)]
struct StepAccesses {
    all: Vec<Access>,
    /// All but those that let go of pins which a later stage drives, and those of the watchdog,
    /// which would hide that it has bitten.
    renewal: Vec<Access>,
    /// Those of the first stage.
    quiesce: Vec<Access>,
}

/// Registers that are read, or written, in the order of the exchange.
struct Block {
    direction: Direction,
    /// Registers in a gap that are read along.
    bridge: u16,
    /// Each register with its place in the word buffer.
    places: Vec<(u16, Register)>,
    /// One past the last place.
    end: u16,
}

impl Block {
    /// Block behind `first` other words. Registers in gaps that are read along have a place as
    /// well.
    fn new(direction: Direction, registers: &[Register], first: u16, bridge: u16) -> Self {
        let mut registers = registers.to_vec();
        registers.sort_by_key(|register| (register.phase, register.address, register.wanted));
        registers.dedup_by_key(|register| (register.phase, register.address));
        let mut places: Vec<(u16, Register)> = Vec::with_capacity(registers.len());
        let mut end = first;
        for register in registers {
            if let Some((_, before)) = places.last() {
                let gap = (register.address.wrapping_sub(before.address) / 4).wrapping_sub(1);
                let is_near = before.phase == register.phase && gap <= bridge;
                if is_near && direction == Direction::Read {
                    end = end.saturating_add(gap);
                }
            }
            places.push((end, register));
            end = end.saturating_add(1);
        }
        Self {
            direction,
            bridge,
            places,
            end,
        }
    }

    /// The places of `registers`, from which this block was made.
    fn index(&self, registers: &[Register]) -> Vec<u16> {
        let key = |register: &Register| (register.phase, register.address);
        let place = |register| {
            let mut places = self.places.iter();
            let place = places.find(|(_, other)| key(other) == key(register));
            place.map_or(u16::MAX, |(place, _)| *place)
        };
        registers.iter().map(place).collect()
    }

    /// The accesses to the registers that are `wanted`.
    fn runs(&self, wanted: impl Fn(&Register) -> bool) -> Vec<Access> {
        let mut runs: Vec<(Phase, Access)> = Vec::new();
        for &(first, register) in self.places.iter().filter(|(_, register)| wanted(register)) {
            if let Some((phase, run)) = runs.last_mut() {
                let words = first.saturating_sub(run.first);
                let distance = register.address.checked_sub(run.address);
                let is_near = words.saturating_sub(run.count) <= self.bridge;
                if *phase == register.phase && is_near && distance == words.checked_mul(4) {
                    run.count = words.saturating_add(1);
                    continue;
                }
            }
            let run = Access::new(self.direction, register.address, first, 1);
            runs.push((register.phase, run));
        }
        runs.into_iter().map(|(_, run)| run).collect()
    }
}
