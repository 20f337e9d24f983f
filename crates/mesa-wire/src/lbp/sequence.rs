//! The accesses that read or write one value in a remote's memory, step by step and without I/O.

use core::time::Duration;

use super::{LocalLocation, NonvolatileMemory, RemoteAccess};
use crate::time::Instant;

/// What a [`ParameterSequence`] needs next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SequenceStep {
    /// This access. Its outcome goes to [`ParameterSequence::accessed`].
    Access(RemoteAccess),
    /// Nothing before this time: the memory is being written.
    Wait(Instant),
    /// Nothing more.
    Done(SequenceOutcome),
}

/// How a [`ParameterSequence`] has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SequenceOutcome {
    /// The value that was read last; `None` if an access failed. A write may have been executed
    /// although its reply was lost.
    pub value: Option<u64>,
    /// The non-volatile memory could not be deselected: the remote may still take an access to its
    /// working memory for one to this memory.
    pub is_still_selected: bool,
}

/// Reads or writes one value in a memory of a remote. The caller performs the accesses and repeats
/// those that fail ([`AccessRetry`]).
///
/// A value in non-volatile memory is written only if it differs, because such memory wears out, and
/// is read back until the memory has kept it. The memory is deselected in every case: the selection
/// may have been executed although its reply was lost.
///
/// Source: FACTS 6.3.
///
/// # Real time
/// Every function takes constant time and does not allocate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParameterSequence {
    memory: Option<NonvolatileMemory>,
    access: RemoteAccess,
    mask: u64,
    state: State,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Selects the memory.
    Select,
    /// Reads the present value.
    Compare,
    Write,
    /// Reads the value back, from a time on, with the number of earlier readings that found another
    /// value.
    ReadBack {
        not_before: Instant,
        readings: u8,
    },
    /// Deselects the memory.
    Deselect {
        value: Option<u64>,
    },
    Ended(SequenceOutcome),
}

/// Wait before non-volatile memory is read back for the first time.
const FIRST_PAUSE: Duration = Duration::from_millis(10);
/// Wait between two readings.
const PAUSE: Duration = Duration::from_millis(20);
/// Readings of non-volatile memory after a write, until it has the value.
const READINGS: u8 = 8;

impl ParameterSequence {
    /// The longest time for which the sequence waits for non-volatile memory, without its accesses.
    pub const LONGEST_WAIT: Duration =
        FIRST_PAUSE.saturating_add(PAUSE.saturating_mul(READINGS as u32 - 1));

    /// The sequence of an access to this memory; `None` for the working memory. Of what is read
    /// only the bits in `mask` count.
    pub const fn new(memory: Option<NonvolatileMemory>, access: RemoteAccess, mask: u64) -> Self {
        let state = match (memory, access.written()) {
            (Some(_), _) => State::Select,
            (None, Some(_)) => State::Write,
            (None, None) => State::Compare,
        };
        Self {
            memory,
            access,
            mask,
            state,
        }
    }

    /// The next step.
    pub fn next(&self, now: Instant) -> SequenceStep {
        let select = |memory| RemoteAccess::WriteLocal(LocalLocation::NONVOLATILE, memory);
        SequenceStep::Access(match self.state {
            State::Select => select(self.memory.map_or(0, |memory| memory as u8)),
            State::Write => self.access,
            State::ReadBack { not_before, .. } if now < not_before => {
                return SequenceStep::Wait(not_before);
            }
            State::Compare | State::ReadBack { .. } => self.access.read_back(),
            State::Deselect { .. } => select(0),
            State::Ended(outcome) => return SequenceStep::Done(outcome),
        })
    }

    /// Takes the outcome of the access: the value that it read (any for a write), or `None` if it
    /// failed, also when repeated.
    pub fn accessed(&mut self, now: Instant, value: Option<u64>) {
        let is_nonvolatile = self.memory.is_some();
        let wanted = self.access.written();
        let read = value.map(|value| value & self.mask);
        let is_there = read == wanted;
        self.state = match (self.state, read) {
            (State::Ended(_), _) => return,
            (State::Deselect { value: kept }, None) => Self::ended(kept, true),
            (State::Deselect { value: kept }, Some(_)) => Self::ended(kept, false),
            (_, None) => self.deselect(None),
            (State::Select, Some(_)) => State::Compare,
            (State::Compare, Some(_)) if wanted.is_some() && !is_there => State::Write,
            (State::Write, Some(_)) => State::ReadBack {
                not_before: if is_nonvolatile {
                    now.after(FIRST_PAUSE)
                } else {
                    now
                },
                readings: 0,
            },
            (State::ReadBack { readings, .. }, Some(_))
                if !is_there && is_nonvolatile && readings.saturating_add(1) < READINGS =>
            {
                State::ReadBack {
                    not_before: now.after(PAUSE),
                    readings: readings.saturating_add(1),
                }
            }
            (State::Compare | State::ReadBack { .. }, Some(_)) => self.deselect(read),
        };
    }

    /// Deselects the memory if one is selected.
    fn deselect(&self, value: Option<u64>) -> State {
        if self.memory.is_some() {
            State::Deselect { value }
        } else {
            Self::ended(value, false)
        }
    }

    const fn ended(value: Option<u64>, is_still_selected: bool) -> State {
        State::Ended(SequenceOutcome {
            value,
            is_still_selected,
        })
    }
}

/// The attempts of one access.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AccessRetry {
    failed: u8,
}

impl AccessRetry {
    /// Number of attempts of an access.
    pub const ATTEMPTS: u8 = 3;

    /// Pause after a failed access: longer than its timer, so that neither the timer nor a late
    /// reply is attributed to the next access (FACTS 5.4).
    pub const PAUSE: Duration = Duration::from_millis(60);

    /// Counts a failed attempt; returns true if another one is permitted, after the
    /// [pause](Self::PAUSE). After the last one the count begins anew.
    pub const fn failed(&mut self) -> bool {
        self.failed = self.failed.saturating_add(1);
        let is_permitted = self.failed < Self::ATTEMPTS;
        if !is_permitted {
            self.failed = 0;
        }
        is_permitted
    }

    /// Begins the count anew after an access that succeeded.
    pub const fn succeeded(&mut self) {
        self.failed = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lbp::AccessSize;
    use alloc::vec::Vec;

    const EEPROM: Option<NonvolatileMemory> = Some(NonvolatileMemory::Eeprom);
    const MASK: u64 = 0xFF;

    fn write(value: u64) -> RemoteAccess {
        RemoteAccess::Write {
            address: 0x40,
            size: AccessSize::for_bits(8).expect("a size"),
            value,
        }
    }

    /// A memory that shows a written value after some readings.
    struct Memory {
        value: u64,
        readings_to_keep: u8,
        written: Option<u64>,
        selected: bool,
        failing: Option<usize>,
        accesses: Vec<RemoteAccess>,
    }

    impl Memory {
        fn of(value: u64, readings_to_keep: u8) -> Self {
            Self {
                value,
                readings_to_keep,
                written: None,
                selected: false,
                failing: None,
                accesses: Vec::new(),
            }
        }

        fn exchange(&mut self, access: RemoteAccess) -> Option<u64> {
            let number = self.accesses.len();
            self.accesses.push(access);
            if let RemoteAccess::WriteLocal(_, memory) = access {
                self.selected = memory != 0;
            }
            if self.failing == Some(number) {
                return None;
            }
            if let RemoteAccess::Write { value, .. } = access {
                self.written = Some(value);
            } else if matches!(access, RemoteAccess::Read { .. })
                && let Some(value) = self.written
            {
                if self.readings_to_keep == 0 {
                    self.value = value;
                }
                self.readings_to_keep = self.readings_to_keep.saturating_sub(1);
            }
            // Bits beyond the parameter's are not its own.
            Some(self.value | 0x100)
        }

        fn run(&mut self, mut sequence: ParameterSequence) -> (SequenceOutcome, Duration) {
            let mut now = Instant::default();
            loop {
                match sequence.next(now) {
                    SequenceStep::Access(access) => {
                        let value = self.exchange(access);
                        sequence.accessed(now, value);
                    }
                    SequenceStep::Wait(until) => now = until,
                    SequenceStep::Done(outcome) => {
                        return (outcome, now.since(Instant::default()));
                    }
                }
            }
        }
    }

    #[test]
    fn equal_value_is_not_written() {
        let mut memory = Memory::of(7, 0);
        let (outcome, waited) = memory.run(ParameterSequence::new(EEPROM, write(7), MASK));
        assert_eq!((outcome.value, waited), (Some(7), Duration::ZERO));
        assert_eq!(memory.accesses.len(), 3, "{:?}", memory.accesses);
        assert!(!memory.selected && memory.written.is_none());
    }

    #[test]
    fn slow_memory_is_read_until_it_has_the_value() {
        for late in 0..READINGS {
            let mut memory = Memory::of(7, late);
            let (outcome, _) = memory.run(ParameterSequence::new(EEPROM, write(9), MASK));
            assert_eq!(outcome.value, Some(9), "{late} readings without the value");
        }
        let mut memory = Memory::of(7, READINGS);
        let (outcome, waited) = memory.run(ParameterSequence::new(EEPROM, write(9), MASK));
        assert_eq!(outcome.value, Some(7), "the memory keeps its value");
        assert_eq!(waited, ParameterSequence::LONGEST_WAIT);
        assert!(!memory.selected);
    }

    #[test]
    fn memory_is_deselected_whichever_access_fails() {
        for failing in 0..4 {
            let mut memory = Memory::of(7, 0);
            memory.failing = Some(failing);
            let (outcome, _) = memory.run(ParameterSequence::new(EEPROM, write(9), MASK));
            assert_eq!(outcome.value, None, "access {failing} fails");
            assert!(!outcome.is_still_selected && !memory.selected);
        }
        let mut memory = Memory::of(7, 0);
        memory.failing = Some(4);
        let (outcome, _) = memory.run(ParameterSequence::new(EEPROM, write(9), MASK));
        assert_eq!(outcome.value, Some(9));
        assert!(outcome.is_still_selected, "the deselection failed");
    }

    #[test]
    fn working_memory_is_written_and_read_back_once() {
        let mut memory = Memory::of(7, 1);
        let (outcome, waited) = memory.run(ParameterSequence::new(None, write(9), MASK));
        assert_eq!((outcome.value, waited), (Some(7), Duration::ZERO));
        assert_eq!(memory.accesses.len(), 2);
        let (outcome, _) = memory.run(ParameterSequence::new(None, write(9).read_back(), MASK));
        assert_eq!(outcome.value, Some(9), "a read");
    }
}
