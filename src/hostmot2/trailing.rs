//! Entries behind the end of the module descriptors.

use super::Gtag;
use super::idrom::MODULE_WORDS;
use core::fmt;

/// An entry behind the end of the module descriptors, which LinuxCNC and mesaflash ignore: the
/// width of an input module (a hint), or the charge pump of a board.
///
/// Its clock is not known, and the module is not driven.
///
/// Source: FACTS 9.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct TrailingEntry {
    /// Its slot in the table of module descriptors, counted from 0.
    pub slot: u8,
    /// Tag of the module, or of a hint: see [`hint`](Self::hint).
    pub tag: u8,
    /// Version of the module.
    pub version: u8,
    /// Number of instances; 0 in a hint.
    pub instances: u8,
    /// Address of its first register; 0 in a hint without one.
    pub base: u16,
    /// Multiple-register mask of a module; in a hint the number of inputs.
    pub mask: u32,
}

impl TrailingEntry {
    /// True for the words of a hint, wherever they are found: its tag, clock tag 0 and no
    /// instances.
    pub(super) fn is_hint([what, ..]: [u32; MODULE_WORDS]) -> bool {
        let [tag, _, clock_tag, instances] = what.to_le_bytes();
        hint(tag).is_some() && (clock_tag, instances) == (0, 0)
    }

    /// Parses an entry; `None` if the slot is empty.
    pub(super) fn parse(slot: usize, words: [u32; MODULE_WORDS]) -> Option<Self> {
        let [what, place, mask] = words;
        let [tag, version, _, instances] = what.to_le_bytes();
        (tag != Gtag::NONE.0).then_some(Self {
            slot: slot as u8,
            tag,
            version,
            instances,
            base: place as u16,
            mask,
        })
    }

    /// The input module and instance whose number of inputs the entry contains, if it is a hint.
    pub const fn hint(&self) -> Option<(Gtag, u8)> {
        match self.instances {
            0 => hint(self.tag),
            _ => None,
        }
    }
}

const fn hint(tag: u8) -> Option<(Gtag, u8)> {
    match tag {
        0x1F..=0x22 => Some((Gtag::IN_MUX, tag - 0x1F)),
        0x24..=0x27 => Some((Gtag::IN_M, tag - 0x24)),
        _ => None,
    }
}

/// Prints `width of InMux (1E) 0: 16 inputs`, or the module.
impl fmt::Display for TrailingEntry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.hint() {
            Some((gtag, instance)) => {
                write!(f, "width of {gtag} {instance}: {} inputs", self.mask)
            }
            None => write!(f, "{}", Gtag(self.tag)),
        }
    }
}
