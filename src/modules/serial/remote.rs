//! A remote of a port: its registers in the image, and its pins.

use alloc::vec::Vec;

use super::health::{Arming, Health};
use super::pins::RemoteFaultPins;
use super::recovery::ReadOutcome;
use super::{OfflineReason, RemoteWatchdog};
use crate::bus::{Instant, Phase, ReadSlot, Setting, WriteSlot};
use crate::discovery::RemoteDescriptor;
use crate::hal::{Awaited, PinStore};
use crate::modules::{ReadCycle, RegisterError, Registrar, WriteCycle};
use crate::remote::RemotePins;
use crate::sslbp::{
    Channel, ChannelRegisters, MAX_INTERFACE_REGISTERS, PortAccess, RemoteAccess, StartedRemote,
    software_mode_word,
};

/// Number of interface registers of one direction.
const REGISTERS: usize = MAX_INTERFACE_REGISTERS as usize;

/// Name of the parameter for a remote's watchdog time, in milliseconds. Manual: 7I77, "FIELD I/O
/// PARAMETERS".
pub const WATCHDOG_PARAMETER: &str = "NVWatchDogTimeout";

/// A remote that takes part: as found, whether it runs or not, or, while absent, as described by
/// its table.
#[derive(Debug)]
#[non_exhaustive]
pub struct FoundRemote {
    /// The identity that START reported. For an absent remote, the expected identity: 0 for an
    /// unknown unit number or unknown tables, and the class of the unit number in the top byte.
    pub started: StartedRemote,
    /// The description from discovery; for an absent remote, from its table.
    pub descriptor: RemoteDescriptor,
    /// The pins of the remote.
    pub pins: RemotePins,
    /// Reason for which the remote does not run at the start; it is offline from then on, and tried
    /// again. `None` if it runs, or has not been started yet.
    pub offline: Option<OfflineReason>,
}

impl FoundRemote {
    /// The remote's own watchdog: the time for which its outputs stay on without process data.
    pub fn watchdog(&self) -> RemoteWatchdog {
        RemoteWatchdog::of(&self.pins)
    }

    /// True if the remote was absent: it may come up when it is plugged in.
    pub fn is_absent(&self) -> bool {
        self.offline == Some(OfflineReason::Absent)
    }
}

/// A remote in the cycle.
#[derive(Debug)]
pub(super) struct RemoteSlot {
    pub channel: Channel,
    pub descriptor: RemoteDescriptor,
    pub pins: RemotePins,
    pub fault_pins: RemoteFaultPins,
    inputs: Vec<ReadSlot>,
    outputs: Vec<WriteSlot>,
    /// CS: the software mode for START, and the command of an access.
    mode: Setting,
    mode_word: u32,
    /// Those of interface registers 0 and 1 that have no outputs, for the data of an access.
    data: [Option<Setting>; 2],
    /// The last read delivered a good transfer of the outputs in the image.
    pub is_confirmed: bool,
    /// An earlier frame whose reply may still come, and then counts as the reply to the present one,
    /// since replies carry no number on the wire (FACTS 5.4): the cycle in which its data was due,
    /// and its time. The last transfer, if it failed; or, before the first transfer after a START,
    /// the chatter frames that the gateware exchanges by itself (FACTS 4.8).
    pub unanswered: Option<(u64, Instant)>,
    /// The version of the outputs in the image.
    put: Option<u64>,
    /// The outputs in the image are not all 0, which they are after START.
    pub drives: bool,
    /// The outputs in the image are the safe values.
    is_safe: bool,
}

impl RemoteSlot {
    pub fn register(
        r: &mut Registrar<'_>,
        found: FoundRemote,
        registers: ChannelRegisters,
        started_at: Instant,
    ) -> Result<Self, RegisterError> {
        let FoundRemote { started, pins, .. } = found;
        let inputs = registers.interfaces_for(started.input_bytes());
        let outputs = registers.interfaces_for(started.sizes.tx);
        let outputs: Vec<_> = outputs
            .map(|address| r.image.write(Phase::Data, address, 0))
            .collect();
        let mut data = [None; 2];
        for (n, (address, data)) in registers.interfaces().zip(&mut data).enumerate() {
            *data = (n >= outputs.len()).then(|| r.image.on_demand(address));
        }
        if found.offline.is_some() {
            r.pins.fault(pins.group);
        }
        Ok(Self {
            channel: started.channel,
            fault_pins: RemoteFaultPins::new(r.pins, r.status, &pins.prefix)?,
            descriptor: found.descriptor,
            pins,
            inputs: inputs
                .map(|address| r.image.read(Phase::Data, address))
                .collect(),
            outputs,
            mode: r.image.on_demand(registers.cs),
            data,
            mode_word: software_mode_word(started.software_mode),
            is_confirmed: false,
            unanswered: Some((0, started_at)),
            put: None,
            drives: false,
            is_safe: false,
        })
    }

    /// Publishes the inputs of a good transfer.
    pub fn take(&mut self, cycle: &mut ReadCycle<'_>) {
        let mut words = [0; REGISTERS];
        for (word, &slot) in words.iter_mut().zip(&self.inputs) {
            *word = cycle.words.word(slot);
        }
        self.pins.take_inputs(cycle.pins, &words);
    }

    /// Handles that the remote went offline: its counters may contain any value when it comes back.
    pub fn lost(&mut self, pins: &mut PinStore) {
        pins.fault(self.pins.group);
        self.unanswered = None;
        self.pins.restarted();
    }

    /// Handles a read that delivered no good transfer, after the one at `last_read`.
    #[cold]
    pub fn not_confirmed(
        &mut self,
        health: &mut Health,
        cycle: &mut ReadCycle<'_>,
        outcome: &ReadOutcome,
        last_read: Instant,
    ) {
        let channel = self.channel;
        if outcome.offline.contains(channel) {
            self.went_offline(health, cycle);
        } else if outcome.failed.contains(channel) {
            cycle.pins.invalidate(self.pins.group);
            let due = cycle
                .pins
                .cycle()
                .saturating_sub(outcome.reads_before.into());
            self.unanswered = Some((due, outcome.started));
        } else if outcome.started_anew.contains(channel) {
            self.unanswered = Some((cycle.pins.cycle().saturating_sub(1), last_read));
        }
        if health.arming != Arming::default() {
            self.attempted(health, cycle);
        }
    }

    /// Handles a running remote that went offline: it will not be armed when it runs again, unless it
    /// comes up because of the board.
    fn went_offline(&mut self, health: &Health, cycle: &mut ReadCycle<'_>) {
        let group = self.pins.group;
        let is_of_board = health.arming.comes_with_board && health.is_of_board();
        let awaited = cycle.pins.awaited(group);
        let state = cycle.pins.group_state(group);
        if state.is_some_and(|state| !state.armed) {
            cycle.pins.count_loss();
        }
        self.lost(cycle.pins);
        if awaited == Awaited::No || awaited == Awaited::AfterSetUp {
            return;
        }
        if is_of_board {
            cycle.pins.is_awaited_anew(group, awaited);
        } else {
            health.not_awaited(cycle.now);
        }
    }

    /// Handles the attempts to start a remote that is to be armed. A new fault cancels that: also a
    /// fault of its own that is found when it comes up because of the board. An attempt that fails
    /// again is none.
    fn attempted(&self, health: &mut Health, cycle: &mut ReadCycle<'_>) {
        let group = self.pins.group;
        let awaited = cycle.pins.awaited(group);
        let is_new = core::mem::take(&mut health.arming.has_new_fault);
        let comes_alone = health.arming.comes_with_board && !health.is_of_board();
        health.arming.comes_with_board &= !comes_alone;
        if comes_alone {
            // Commands that were set meanwhile are forgotten.
            cycle.pins.disarm(group);
        }
        let is_awaited = awaited.is_with_transfer();
        if is_awaited && (comes_alone || is_new) {
            cycle.pins.not_awaited(group);
            health.not_awaited(cycle.now);
        }
    }

    /// Puts the outputs into the image, unless they are unchanged.
    pub fn put(&mut self, cycle: &mut WriteCycle<'_>) {
        let version = cycle.pins.output_version(self.pins.group);
        if version.is_some() && version == self.put {
            return;
        }
        self.put = version;
        let mut words = [0; REGISTERS];
        self.pins.put_outputs(cycle.pins, &mut words);
        self.drives = words != [0; REGISTERS];
        // What was read before is no evidence for them.
        self.is_confirmed = false;
        let state = cycle.pins.group_state(self.pins.group);
        self.is_safe = state.is_some_and(|group| !group.armed);
        for (word, &slot) in words.into_iter().zip(&self.outputs) {
            cycle.words.put(slot, word);
        }
    }

    /// True if the last read delivered a good transfer of safe values.
    pub fn has_confirmed_safe(&self) -> bool {
        self.is_confirmed && self.is_safe
    }

    /// Sets the words of an access, which are written with its DOIT. Outputs are put anew before the
    /// next transfer.
    pub fn put_access(&mut self, cycle: &mut WriteCycle<'_>, access: RemoteAccess) {
        let data = access.data_words();
        for (n, word) in data.into_iter().flatten().enumerate() {
            if let Some(&slot) = self.outputs.get(n) {
                cycle.words.put(slot, word);
            }
            if let Some(&Some(setting)) = self.data.get(n) {
                cycle.words.set(setting, word);
                cycle.words.repeat(setting);
            }
        }
        cycle.words.set(self.mode, access.cs_word());
        cycle.words.repeat(self.mode);
        self.put = None;
        self.drives = true;
    }

    /// Sets the software mode, which is written with START.
    pub fn put_mode(&self, cycle: &mut WriteCycle<'_>) {
        cycle.words.set(self.mode, self.mode_word);
        cycle.words.repeat(self.mode);
    }
}
