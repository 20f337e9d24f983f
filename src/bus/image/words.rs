//! The words of the image, and which settings still have to be written.

use alloc::{boxed::Box, vec::Vec};

use crate::bus::Reply;

use super::{Exchanged, ImagePlan, ReadSlot, Setting, Stage, WriteSlot};

/// What is read and what is written, one word for each register.
///
/// # Real time
/// No function allocates. A slot or setting of another image is a mistake in the program: a debug
/// build panics where this image has none of that number, and a release reads 0 and writes nothing.
#[derive(Debug)]
pub struct Words {
    /// What is read, what is written, the settings, the safe words of what is written, and what the
    /// set-up writes besides.
    pub(super) content: Box<[u32]>,
    /// The places of the slots.
    reads: Box<[u16]>,
    writes: Box<[u16]>,
    first_setting: usize,
    settings: Box<[SettingState]>,
    /// There are settings to be written with the next write, ...
    has_news: bool,
    /// ... and between two looks at the evidence, ...
    has_guarded_news: bool,
    /// ... and such as were sent and are not confirmed.
    has_sent: bool,
    /// What the replies showed since [`take_news`](Self::take_news).
    news: Reply,
}

/// The reads after which no older write is in flight any more.
const HORIZON: u8 = 100;

/// What becomes of a setting.
#[derive(Clone, Copy, Debug)]
struct SettingState {
    progress: Progress,
    /// `None`: not part of the set-up, written on demand.
    stage: Option<Stage>,
    /// Where it is read back.
    shown: Option<ReadSlot>,
    /// The bits that are certainly set in the board.
    expected: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Progress {
    /// The board has it.
    Rests,
    /// It is to be written.
    Asked,
    /// It was sent. It may have been lost, or be undone by an older one that comes late, for this many
    /// more reads.
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

impl SettingState {
    /// It drives a pin, or enables what is driven.
    fn is_guarded(&self) -> bool {
        self.stage >= Some(Stage::Drive)
    }

    fn is_asked(&self, by: By) -> bool {
        let is_held = match by {
            By::Cycle => !self.is_guarded(),
            By::Guarded => self.stage.is_some(),
        };
        is_held && self.progress == Progress::Asked
    }
}

impl Words {
    pub(super) fn new(
        plan: &ImagePlan,
        content: Vec<u32>,
        reads: Vec<u16>,
        writes: Vec<u16>,
        first_setting: u16,
    ) -> Self {
        let settings = plan.settings.iter().map(|register| SettingState {
            progress: Progress::Rests,
            stage: register.stage,
            shown: register.shown,
            expected: register.word,
        });
        Self {
            content: content.into(),
            reads: reads.into(),
            writes: writes.into(),
            first_setting: first_setting.into(),
            settings: settings.collect(),
            has_news: false,
            has_guarded_news: false,
            has_sent: false,
            news: Reply::CERTAIN,
        }
    }

    /// A reply has brought words.
    pub(crate) fn heard(&mut self, reply: Reply) {
        self.news = self.news.and(reply);
    }

    /// What all replies showed since the last call.
    pub(crate) fn take_news(&mut self) -> Reply {
        core::mem::replace(&mut self.news, Reply::CERTAIN)
    }

    /// What was read last.
    #[inline]
    pub fn word(&self, slot: ReadSlot) -> u32 {
        let place = self.reads.get(usize::from(slot.0));
        let word = place.and_then(|&place| self.content.get(usize::from(place)));
        debug_assert!(word.is_some(), "a slot of another image");
        word.copied().unwrap_or(0)
    }

    /// The word of a register of the cycle, as it was read or is to be written.
    pub(crate) fn at(&self, register: Exchanged) -> u32 {
        let word = self.content.get(usize::from(register.place));
        word.copied().unwrap_or(0)
    }

    /// A read shows this word in a register.
    #[cfg(test)]
    pub(crate) fn show(&mut self, register: Exchanged, word: u32) {
        self.content[usize::from(register.place)] = word;
    }

    /// Puts the word of an output or a trigger, which the next write holds.
    #[inline]
    pub fn put(&mut self, slot: WriteSlot, word: u32) {
        let place = self.writes.get(usize::from(slot.0));
        let old = place.and_then(|&place| self.content.get_mut(usize::from(place)));
        debug_assert!(old.is_some(), "a slot of another image");
        if let Some(old) = old {
            *old = word;
        }
    }

    /// Changes the word that the set-up writes to an output: it follows from settings that have
    /// changed.
    pub fn put_safe(&mut self, slot: WriteSlot, word: u32) {
        let first = self.first_setting.saturating_add(self.settings.len());
        let safes = self.content.get_mut(first..);
        let safes = safes.and_then(|safes| safes.get_mut(..self.writes.len()));
        let old = safes.and_then(|safes| safes.get_mut(usize::from(slot.0)));
        debug_assert!(old.is_some(), "a slot of another image");
        if let Some(old) = old {
            *old = word;
        }
    }

    /// Changes a setting. Only if it differs from what it was before, it is written, and from then on
    /// with the board's set-up.
    ///
    /// # Real time
    /// Constant time. A setting that [drives a pin](Stage::Drive) costs three exchanges more in this
    /// cycle.
    #[inline]
    pub fn set(&mut self, setting: Setting, word: u32) {
        let number = usize::from(setting.0);
        // Behind the settings there are the safe words.
        let is_ours = number < self.settings.len();
        debug_assert!(is_ours, "a setting of another image");
        let old = self
            .content
            .get_mut(self.first_setting.saturating_add(number));
        if is_ours && old.is_some_and(|old| core::mem::replace(old, word) != word) {
            self.repeat(setting);
        }
    }

    /// Writes a setting again, changed or not: it may not have arrived, or not be what the board has
    /// now.
    pub fn repeat(&mut self, setting: Setting) {
        let state = self.settings.get_mut(usize::from(setting.0));
        debug_assert!(state.is_some(), "a setting of another image");
        if let Some(state) = state {
            state.progress = Progress::Asked;
            self.has_guarded_news |= state.is_guarded();
            self.has_news |= !state.is_guarded();
        }
    }

    /// Whether what is watched was read as it must be.
    pub(crate) fn stands(&self) -> bool {
        self.settings.iter().all(|state| {
            let shows = |slot| self.word(slot) & state.expected == state.expected;
            state.shown.is_none_or(shows)
        })
    }

    /// Whether the next write holds settings.
    pub(crate) fn has_news(&self) -> bool {
        self.has_news
    }

    /// Whether a setting is to be written with the next write.
    pub fn is_news(&self, setting: Setting) -> bool {
        self.is_asked(setting.0, By::Cycle)
    }

    /// Whether settings wait for a [guarded](super::Exchanges::write_guarded) write.
    pub(crate) fn has_guarded_news(&self) -> bool {
        self.has_guarded_news
    }

    /// The board was heard: whether the newest write, and nothing older after it, has arrived. If not,
    /// what was sent lately is written again.
    pub(crate) fn confirm(&mut self, is_certain: bool) {
        if !self.has_sent {
            return;
        }
        self.each_setting(|state, _| {
            if let Progress::Sent(left) = state.progress {
                state.progress = match left.checked_sub(1) {
                    _ if !is_certain => Progress::Asked,
                    Some(left) => Progress::Sent(left),
                    None => Progress::Rests,
                };
            }
        });
    }

    /// Whether a setting is to be written by this write.
    pub(super) fn is_asked(&self, setting: u16, by: By) -> bool {
        let state = self.settings.get(usize::from(setting));
        state.is_some_and(|state| state.is_asked(by))
    }

    /// The settings that this write holds were sent; those that need a look at the evidence are
    /// [confirmed](Self::guarded_sent) by it.
    pub(super) fn sent(&mut self, by: By) {
        self.each_setting(|state, _| {
            if state.is_asked(by) && !state.is_guarded() {
                state.progress = Progress::Sent(HORIZON);
            }
        });
    }

    /// Guarded settings are about to be written: until they have arrived, only what was set before
    /// and after is certain.
    pub(super) fn expect_either(&mut self) {
        self.each_setting(|state, word| {
            if state.progress == Progress::Asked {
                state.expected &= word;
            }
        });
    }

    /// Guarded settings were written, and the evidence was read after it: those that are read back as
    /// they were written, or not at all, have arrived.
    pub(crate) fn guarded_sent(&mut self) {
        let words = self.content.iter().skip(self.first_setting);
        let mut settings = self.settings.iter().zip(words);
        let have_arrived = settings.all(|(state, word)| {
            let is_shown = |slot| self.word(slot) == *word;
            state.progress != Progress::Asked || state.shown.is_none_or(is_shown)
        });
        if have_arrived {
            self.each_setting(|state, word| {
                if state.progress == Progress::Asked && state.is_guarded() {
                    state.progress = Progress::Sent(HORIZON);
                    state.expected = word;
                }
            });
        }
    }

    /// The set-up is about to be written: all settings with it.
    pub(super) fn expect_all(&mut self) {
        self.each_setting(|state, word| state.expected = word);
    }

    /// The board has the set-up: what was asked for before has not to be written any more. Writes of
    /// what the set-up holds may still come late.
    pub(crate) fn all_set(&mut self) {
        self.each_setting(|state, _| {
            state.progress = match state.progress {
                Progress::Sent(left) if state.stage.is_some() => Progress::Sent(left),
                Progress::Asked if state.stage.is_some() => Progress::Sent(HORIZON),
                _ => Progress::Rests,
            };
        });
    }

    /// Changes what becomes of the settings; `change` gets the word of each.
    fn each_setting(&mut self, mut change: impl FnMut(&mut SettingState, u32)) {
        (self.has_news, self.has_guarded_news, self.has_sent) = (false, false, false);
        let words = self.content.iter().skip(self.first_setting);
        for (state, word) in self.settings.iter_mut().zip(words) {
            change(state, *word);
            self.has_guarded_news |= state.is_asked(By::Guarded) && state.is_guarded();
            self.has_news |= state.is_asked(By::Cycle);
            self.has_sent |= matches!(state.progress, Progress::Sent(_));
        }
    }
}
