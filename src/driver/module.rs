//! What takes part in the cycle besides the serial ports.

use core::fmt;

use super::SetupList;
use super::set_up::SetUp;
use crate::bus::{CycleImage, ImagePlan, Instant, Tier, WritePhase, WriteSlot};
use crate::hal::{GroupId, PinStore};
use crate::hostmot2::PortSetup;

/// A part of the board in the cycle: it claims registers at start, then takes its inputs from the
/// image after each read and puts its outputs into it before each write.
///
/// # Real time
/// [`take`](Self::take) and [`put`](Self::put) are called once in a cycle: they must not allocate,
/// wait or panic. A module is a state machine that does one step for each call.
pub trait Module: fmt::Debug + Send {
    /// Writes its set-up. Also done when the board has lost it; nothing drives a pin by then.
    fn set_up(&self, list: &mut SetupList) {
        let _ = list;
    }

    /// Writes what has to wait until the pins have their sources and directions.
    fn start(&self, list: &mut SetupList) {
        let _ = list;
    }

    /// The board has lost its set-up and got it back: counts may stand anywhere.
    fn restarted(&mut self) {}

    /// Claims the registers it reads and writes.
    fn claim(&mut self, plan: &mut ImagePlan);

    /// Takes its inputs from an image that was read without an error.
    fn take(&mut self, cycle: &mut Take<'_>);

    /// Puts its outputs into the image.
    fn put(&mut self, cycle: &mut Put<'_>);
}

/// What a module has after a read.
#[derive(Debug)]
pub struct Take<'a> {
    /// What was read.
    pub image: &'a CycleImage,
    /// Where its inputs go.
    pub pins: &'a mut PinStore,
    /// The group of the board's own pins.
    pub group: GroupId,
    /// When the image was read.
    pub now: Instant,
    /// What happened to the writes since this was called last.
    pub writes: WriteNews,
}

/// What happened to the writes between two reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteNews {
    /// Others than the newest may have been executed, or the newest not: the network lost, delayed
    /// or duplicated packets. See [`BusStatistics::doubts`](crate::bus::BusStatistics::doubts).
    pub is_doubtful: bool,
    /// Settings were written, some of them perhaps again and unchanged.
    pub is_repeated: bool,
}

/// What a module has before a write.
#[derive(Debug)]
pub struct Put<'a> {
    /// What will be written.
    pub image: &'a mut CycleImage,
    /// Where its outputs come from.
    pub pins: &'a mut PinStore,
    /// The group of the board's own pins.
    pub group: GroupId,
    /// When the write began.
    pub now: Instant,
    pub(super) set_up: &'a mut SetUp,
}

impl Put<'_> {
    /// Puts a setting. Only if it differs from what was put before, it is written, alone, and
    /// written again whenever the board's set-up is.
    ///
    /// # Real time
    /// Constant time while nothing changes; else it grows with the registers of the set-up. No
    /// allocation.
    pub fn change(&mut self, slot: Option<SettingSlot>, word: u32) {
        let Some(SettingSlot { slot, address }) = slot else {
            return;
        };
        if self.image.written(slot).first() != Some(&word) {
            self.image.put(slot, word);
            self.set_up.change(address, word);
            self.image.request_write(slot);
        }
    }

    /// Writes a setting again in this cycle, changed or not: it may not have arrived.
    ///
    /// # Real time
    /// Constant time, no allocation.
    pub fn repeat(&mut self, slot: Option<SettingSlot>) {
        if let Some(SettingSlot { slot, .. }) = slot {
            self.image.request_write(slot);
        }
    }

    /// Puts what drives the pins of an I/O port: it is written with all that belongs to the port,
    /// and only to a board that is seen to be set up.
    pub(super) fn drive(&mut self, port: usize, setup: PortSetup) {
        self.set_up.want(port, setup);
    }
}

/// A register that is written when it changes, and not in every cycle: see [`Put::change`].
///
/// A change whose write was perhaps lost is written again.
#[derive(Clone, Copy, Debug)]
pub struct SettingSlot {
    slot: WriteSlot,
    address: u16,
}

impl SettingSlot {
    /// Claims a register that the set-up has written as `initial`.
    pub fn claim(plan: &mut ImagePlan, address: u16, initial: u32) -> Self {
        let slot = plan.write(WritePhase::Data, Tier::Extended, address, 1, initial);
        Self { slot, address }
    }
}
