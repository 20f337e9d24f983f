//! The words of the image, and the progress of settings that have to be written.

use alloc::{boxed::Box, vec::Vec};

use crate::bus::Reply;

use super::{ImagePlan, ReadSlot, Setting, Stage, WriteSlot};

/// The words that are read and written, one for each register.
///
/// # Real time
/// No function allocates. A slot or setting of another image is an error in the program: a debug
/// build panics if this image has no such number, and a release build reads 0 and writes nothing.
#[derive(Debug)]
pub struct Words {
    /// The words that are read, the words that are written, the settings, the safe words of
    /// outputs, and the other words of the set-up.
    pub(super) content: Box<[u32]>,
    /// The places of the slots.
    reads: Box<[u16]>,
    writes: Box<[u16]>,
    first_setting: usize,
    settings: Box<[SettingState]>,
    /// Some settings are to be written with the next write.
    has_pending: bool,
    /// Some settings are to be written between two reads of the evidence.
    has_guarded_pending: bool,
    /// Some settings were sent and are not confirmed yet.
    has_sent: bool,
    /// State of all replies since [`take_replies`](Self::take_replies).
    replies: Reply,
}

/// Number of reads after which no older write is still in flight.
pub(crate) const HORIZON: u8 = 100;

/// State of a setting.
#[derive(Clone, Copy, Debug)]
struct SettingState {
    progress: Progress,
    /// `None`: not part of the set-up, written on demand.
    stage: Option<Stage>,
    /// Slot in which it is read back.
    shown: Option<ReadSlot>,
    /// The bits that are certainly set in the board.
    expected: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Progress {
    /// The board has the present word.
    Rests,
    /// To be written.
    Asked,
    /// Sent. For this number of further reads it may still turn out lost, or be undone by an older
    /// write that arrives late.
    Sent(u8),
}

/// Kind of a write that contains settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum WriteKind {
    /// The write of the cycle.
    Cycle,
    /// The write that drives pins, between two reads of the evidence. It does not contain settings
    /// written on demand: the watchdog's time would hide a reset from the second read.
    Guarded,
}

impl SettingState {
    /// True if it drives a pin, or enables something that is driven.
    fn is_guarded(&self) -> bool {
        self.stage >= Some(Stage::Drive)
    }

    fn is_asked(&self, by: WriteKind) -> bool {
        let is_held = match by {
            WriteKind::Cycle => !self.is_guarded(),
            WriteKind::Guarded => self.stage.is_some(),
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
            has_pending: false,
            has_guarded_pending: false,
            has_sent: false,
            replies: Reply::CERTAIN,
        }
    }

    /// Records the state of a reply that has brought words.
    pub(crate) fn add_reply(&mut self, reply: Reply) {
        self.replies = self.replies.and(reply);
    }

    /// Combined state of all replies since the last call.
    pub(crate) fn take_replies(&mut self) -> Reply {
        core::mem::replace(&mut self.replies, Reply::CERTAIN)
    }

    /// Combined state of all replies since the last call of [`take_replies`](Self::take_replies).
    pub(crate) const fn replies(&self) -> Reply {
        self.replies
    }

    /// The word that was read last.
    #[inline]
    pub fn word(&self, slot: ReadSlot) -> u32 {
        let place = self.reads.get(usize::from(slot.0));
        let word = place.and_then(|&place| self.content.get(usize::from(place)));
        debug_assert!(word.is_some(), "a slot of another image");
        word.copied().unwrap_or(0)
    }

    /// Makes a read return this word at a place.
    #[cfg(test)]
    pub(crate) fn show(&mut self, place: usize, word: u32) {
        self.content[place] = word;
    }

    /// Puts the word of an output or a trigger for the next write.
    #[inline]
    pub fn put(&mut self, slot: WriteSlot, word: u32) {
        let place = self.writes.get(usize::from(slot.0));
        let old = place.and_then(|&place| self.content.get_mut(usize::from(place)));
        debug_assert!(old.is_some(), "a slot of another image");
        if let Some(old) = old {
            *old = word;
        }
    }

    /// Changes the word that the set-up writes to an output, because the settings it depends on
    /// have changed.
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

    /// Changes a setting. If the word differs from the one before, it is written now, and again
    /// with every later set-up of the board.
    ///
    /// # Real time
    /// Constant time. A setting that [drives a pin](Stage::Drive) costs three additional exchanges
    /// in this cycle.
    #[inline]
    pub fn set(&mut self, setting: Setting, word: u32) {
        let number = usize::from(setting.0);
        // The safe words follow the settings in the buffer.
        let is_ours = number < self.settings.len();
        debug_assert!(is_ours, "a setting of another image");
        let old = self
            .content
            .get_mut(self.first_setting.saturating_add(number));
        if is_ours && old.is_some_and(|old| core::mem::replace(old, word) != word) {
            self.repeat(setting);
        }
    }

    /// Writes a setting again, changed or not, because it may not have arrived, or the board may
    /// have another word now.
    pub fn repeat(&mut self, setting: Setting) {
        let state = self.settings.get_mut(usize::from(setting.0));
        debug_assert!(state.is_some(), "a setting of another image");
        if let Some(state) = state {
            state.progress = Progress::Asked;
            self.has_guarded_pending |= state.is_guarded();
            self.has_pending |= !state.is_guarded();
        }
    }

    /// True if all evidence registers read as expected.
    pub(crate) fn evidence_matches(&self) -> bool {
        self.settings.iter().all(|state| {
            let shows = |slot| self.word(slot) & state.expected == state.expected;
            state.shown.is_none_or(shows)
        })
    }

    /// True if the next write contains settings.
    pub(crate) fn has_pending(&self) -> bool {
        self.has_pending
    }

    /// True if a setting is to be written with the next write.
    pub fn is_news(&self, setting: Setting) -> bool {
        self.is_asked(setting.0, WriteKind::Cycle)
    }

    /// True if a setting was, or may have been, written after the last but one reply that was
    /// processed.
    pub(crate) fn is_unseen(&self, setting: Setting) -> bool {
        let state = self.settings.get(usize::from(setting.0));
        state.is_some_and(|state| match state.progress {
            Progress::Sent(left) => left.saturating_add(1) >= HORIZON,
            Progress::Asked => true,
            Progress::Rests => false,
        })
    }

    /// True if settings wait for a [guarded](super::Exchanges::write_guarded) write.
    pub(crate) fn has_guarded_pending(&self) -> bool {
        self.has_guarded_pending
    }

    /// Processes a reply. `is_certain`: the newest write has arrived, and no older one after it.
    /// Otherwise, the settings that were sent recently are written again.
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

    /// True if a setting is to be written by this write.
    pub(super) fn is_asked(&self, setting: u16, by: WriteKind) -> bool {
        let state = self.settings.get(usize::from(setting));
        state.is_some_and(|state| state.is_asked(by))
    }

    /// Marks the settings that this write contains as sent, except guarded ones, which
    /// [`guarded_sent`](Self::guarded_sent) marks after the evidence was read.
    pub(super) fn sent(&mut self, by: WriteKind) {
        self.each_setting(|state, _| {
            if state.is_asked(by) && !state.is_guarded() {
                state.progress = Progress::Sent(HORIZON);
            }
        });
    }

    /// Prepares writing guarded settings: until they have arrived, only the bits that are set both
    /// before and after are certain.
    pub(super) fn expect_either(&mut self) {
        self.each_setting(|state, word| {
            if state.progress == Progress::Asked {
                state.expected &= word;
            }
        });
    }

    /// Records that guarded settings were written and the evidence was read after it: settings that
    /// read back as written, or are not read back at all, have arrived.
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

    /// Prepares writing the set-up, with all settings.
    pub(super) fn expect_all(&mut self) {
        self.each_setting(|state, word| state.expected = word);
    }

    /// Records that the board has the set-up: settings requested before need not be written any
    /// more. Older writes of the same settings may still arrive late.
    pub(crate) fn all_set(&mut self) {
        self.each_setting(|state, _| {
            state.progress = match state.progress {
                Progress::Sent(left) if state.stage.is_some() => Progress::Sent(left),
                Progress::Asked if state.stage.is_some() => Progress::Sent(HORIZON),
                _ => Progress::Rests,
            };
        });
    }

    /// Changes the state of all settings; `change` receives the word of each.
    fn each_setting(&mut self, mut change: impl FnMut(&mut SettingState, u32)) {
        (self.has_pending, self.has_guarded_pending, self.has_sent) = (false, false, false);
        let words = self.content.iter().skip(self.first_setting);
        for (state, word) in self.settings.iter_mut().zip(words) {
            change(state, *word);
            self.has_guarded_pending |= state.is_asked(WriteKind::Guarded) && state.is_guarded();
            self.has_pending |= state.is_asked(WriteKind::Cycle);
            self.has_sent |= matches!(state.progress, Progress::Sent(_));
        }
    }
}
