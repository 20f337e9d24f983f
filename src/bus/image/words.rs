//! The words of the image, and which settings still have to be written.

use alloc::boxed::Box;

use super::{ReadSlot, Setting, WriteSlot};

/// What is read and what is written, one word for each register.
///
/// # Real time
/// No function allocates or panics. A slot of another image is a mistake in the program: it reads
/// as 0 and is not written.
#[derive(Debug)]
pub struct Words {
    pub(super) content: Box<[u32]>,
    /// The places of the slots.
    pub(super) reads: Box<[u16]>,
    pub(super) writes: Box<[u16]>,
    /// The places of the safe words of those that are written.
    pub(super) safes: Box<[u16]>,
    /// The place of the first setting; the others follow.
    pub(super) first_setting: u16,
    pub(super) settings: Box<[SettingState]>,
    /// Settings that are to be written, of those that go with the next write ...
    pub(super) asked: u16,
    /// ... and of those that need a look at the evidence.
    pub(super) asked_guarded: u16,
    /// Settings that were sent and are not confirmed.
    pub(super) sent: u16,
}

/// After so many reads no older write is in flight any more.
const HORIZON: u8 = 100;

/// What becomes of a setting.
#[derive(Clone, Copy, Debug)]
pub(super) struct SettingState {
    pub progress: Progress,
    /// The set-up holds it; otherwise it is written on demand.
    pub is_of_set_up: bool,
    /// It drives a pin, or enables what is driven.
    pub is_guarded: bool,
    pub shown: Option<Shown>,
}

/// Where a setting is read back, and what it must show.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shown {
    pub slot: ReadSlot,
    /// The bits that are certainly set in the board.
    pub expected: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Progress {
    /// The board has it.
    Rests,
    /// It is to be written.
    Asked,
    /// It was sent. It may have been lost, or be undone by an older one that comes late, for so many
    /// reads more.
    Sent(u8),
}

/// A write that holds settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum By {
    /// That of the cycle.
    Cycle,
    /// The one that drives pins, between two looks at the evidence. What is written on demand is not
    /// in it: the watchdog's time would hide a reset from the second look.
    Guarded,
}

impl By {
    const fn holds(self, state: &SettingState) -> bool {
        match self {
            Self::Cycle => !state.is_guarded,
            Self::Guarded => state.is_of_set_up,
        }
    }
}

impl Words {
    /// What was read last.
    #[inline]
    pub fn word(&self, slot: ReadSlot) -> u32 {
        let place = self.reads.get(usize::from(slot.0));
        let word = place.and_then(|&place| self.content.get(usize::from(place)));
        debug_assert!(word.is_some(), "a slot of another image");
        word.copied().unwrap_or(0)
    }

    /// What the next write holds.
    #[inline]
    pub fn put(&mut self, slot: WriteSlot, word: u32) {
        let place = self.writes.get(usize::from(slot.0));
        let old = place.and_then(|&place| self.content.get_mut(usize::from(place)));
        debug_assert!(old.is_some(), "a slot of another image");
        if let Some(old) = old {
            *old = word;
        }
    }

    /// Changes the word that the set-up writes to an output.
    pub fn put_safe(&mut self, slot: WriteSlot, word: u32) {
        let place = self.safes.get(usize::from(slot.0));
        if let Some(old) = place.and_then(|&place| self.content.get_mut(usize::from(place))) {
            *old = word;
        }
    }

    /// Changes a setting: it is written when that is another word than before.
    #[inline]
    pub fn set(&mut self, setting: Setting, word: u32) {
        let place = self.place(setting);
        let Some(old) = self.content.get_mut(place) else {
            debug_assert!(false, "a setting of another image");
            return;
        };
        if core::mem::replace(old, word) != word {
            self.repeat(setting);
        }
    }

    /// Writes a setting again, changed or not: it may not have arrived, or not be what the board has
    /// now.
    pub fn repeat(&mut self, setting: Setting) {
        let Some(state) = self.settings.get_mut(usize::from(setting.0)) else {
            debug_assert!(false, "a setting of another image");
            return;
        };
        match state.progress {
            Progress::Asked => return,
            Progress::Rests => {}
            Progress::Sent(_) => self.sent -= 1,
        }
        state.progress = Progress::Asked;
        if state.is_guarded {
            self.asked_guarded += 1;
        } else {
            self.asked += 1;
        }
    }

    /// Whether what is watched was read as it must be.
    pub fn stands(&self) -> bool {
        self.shown()
            .all(|(_, shown)| self.word(shown.slot) & shown.expected == shown.expected)
    }

    /// Whether the next write holds settings.
    pub fn has_news(&self) -> bool {
        self.asked > 0
    }

    /// Whether settings wait for a [guarded](super::Image::write_guarded) write.
    pub fn has_guarded_news(&self) -> bool {
        self.asked_guarded > 0
    }

    /// The board was heard: whether the newest write, and nothing older after it, has arrived. If not,
    /// what was sent lately is written again.
    pub fn confirm(&mut self, is_certain: bool) {
        if self.sent == 0 {
            return;
        }
        for state in &mut self.settings {
            let Progress::Sent(left) = state.progress else {
                continue;
            };
            state.progress = match left {
                _ if !is_certain => Progress::Asked,
                0 => Progress::Rests,
                _ => Progress::Sent(left - 1),
            };
            if let Progress::Sent(_) = state.progress {
                continue;
            }
            self.sent -= 1;
            if !is_certain {
                let asked = if state.is_guarded {
                    &mut self.asked_guarded
                } else {
                    &mut self.asked
                };
                *asked += 1;
            }
        }
    }

    /// Whether a setting is to be written by this write.
    pub(super) fn is_asked(&self, setting: u16, by: By) -> bool {
        let state = self.settings.get(usize::from(setting));
        state.is_some_and(|state| state.progress == Progress::Asked && by.holds(state))
    }

    /// The settings that this write holds were sent; those that need a look at the evidence are
    /// [confirmed](Self::guarded_sent) by it.
    pub(super) fn sent(&mut self, by: By) {
        for state in &mut self.settings {
            if state.progress == Progress::Asked && !state.is_guarded && by.holds(state) {
                state.progress = Progress::Sent(HORIZON);
                self.asked -= 1;
                self.sent += 1;
            }
        }
    }

    /// Guarded settings are about to be written: until they have arrived, only what was set before
    /// and after is certain.
    pub(super) fn expect_either(&mut self) {
        let (words, first) = (&self.content, usize::from(self.first_setting));
        for (n, state) in self.settings.iter_mut().enumerate() {
            if let (Some(shown), Progress::Asked) = (&mut state.shown, state.progress) {
                shown.expected &= words.get(first + n).copied().unwrap_or(0);
            }
        }
    }

    /// Guarded settings were written, and the evidence was read after it: those that are read back as
    /// they were written, or not at all, have arrived.
    pub fn guarded_sent(&mut self) {
        let first = usize::from(self.first_setting);
        let is_shown = |words: &Self, n, shown: Option<Shown>| {
            let word = words.content.get(first + n).copied();
            shown.is_none_or(|shown| Some(words.word(shown.slot)) == word)
        };
        let all = (0..self.settings.len()).all(|n| {
            let state = self.settings.get(n);
            state.is_none_or(|state| {
                state.progress != Progress::Asked || is_shown(self, n, state.shown)
            })
        });
        if !all {
            return;
        }
        for (n, state) in self.settings.iter_mut().enumerate() {
            if state.progress == Progress::Asked && state.is_guarded {
                state.progress = Progress::Sent(HORIZON);
                if let Some(shown) = &mut state.shown {
                    shown.expected = self.content.get(first + n).copied().unwrap_or(0);
                }
            }
        }
        self.sent += core::mem::take(&mut self.asked_guarded);
    }

    /// The set-up is about to be written: all settings with it.
    pub(super) fn expect_all(&mut self) {
        let first = usize::from(self.first_setting);
        for (n, state) in self.settings.iter_mut().enumerate() {
            if let Some(shown) = &mut state.shown {
                shown.expected = self.content.get(first + n).copied().unwrap_or(0);
            }
        }
    }

    /// The board has the set-up: what was asked for before has not to be written any more. Writes of
    /// what the set-up holds may still come late.
    pub fn all_set(&mut self) {
        (self.asked, self.asked_guarded, self.sent) = (0, 0, 0);
        for state in &mut self.settings {
            state.progress = match state.progress {
                Progress::Sent(left) if state.is_of_set_up => Progress::Sent(left),
                Progress::Asked if state.is_of_set_up => Progress::Sent(HORIZON),
                _ => Progress::Rests,
            };
            self.sent += u16::from(state.progress != Progress::Rests);
        }
    }

    fn shown(&self) -> impl Iterator<Item = (usize, Shown)> + '_ {
        let states = self.settings.iter().enumerate();
        states.filter_map(|(n, state)| Some((n, state.shown?)))
    }

    fn place(&self, setting: Setting) -> usize {
        usize::from(self.first_setting) + usize::from(setting.0)
    }
}
