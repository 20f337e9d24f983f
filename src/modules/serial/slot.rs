//! A remote's place in the cycle: its registers in the image, and its pins.

use alloc::vec::Vec;

use super::fault_pins::RemoteFaultPins;
use super::life::Life;
use super::outcome::ReadOutcome;
use super::part::RemotePart;
use super::watchdog::OutputsState;
use crate::bus::{ImagePlan, Instant, Phase, ReadSlot, Setting, WriteSlot};
use crate::discovery::RemoteDescriptor;
use crate::events::{EventKind, EventSink};
use crate::hal::{ArmingCondition, GroupId, PinError, PinStore};
use crate::hostmot2::RemoteId;
use crate::modules::{ReadCycle, WriteCycle};
use crate::remote::RemotePins;
use crate::sslbp::{
    Channel, ChannelRegisters, MAX_INTERFACE_REGISTERS, PortAccess, RemoteAccess,
    software_mode_word,
};

/// Number of interface registers of one direction.
const REGISTERS: usize = MAX_INTERFACE_REGISTERS as usize;

/// The registers and pins of a remote.
#[derive(Debug)]
pub(super) struct RemoteSlot {
    pub id: RemoteId,
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
    /// An earlier frame whose reply may still come, and then counts as the reply to the present
    /// one, since replies carry no number on the wire (FACTS 5.4): the cycle in which its data was
    /// due, and its time. The last transfer, if it failed; or, before the first transfer after a
    /// START, the chatter frames that the gateware exchanges by itself (FACTS 4.8).
    unanswered: Option<(u64, Instant)>,
    in_image: OutputsInImage,
    /// What is known of the outputs of the remote itself.
    pub outputs_state: OutputsState,
    /// The board got its set-up back, and the remote has not transferred since: it comes up because
    /// of that, unless it has a fault of its own.
    pub comes_with_board: bool,
}

/// The outputs that the image contains.
#[derive(Clone, Copy, Debug, Default)]
struct OutputsInImage {
    /// Their version.
    version: Option<u64>,
    /// They are not all 0, which they are after START.
    drive: bool,
    /// They are the safe values.
    are_safe: bool,
}

impl RemoteSlot {
    /// Registers the registers, and makes the pins of the remote's faults in the group `status`.
    pub fn register(
        image: &mut ImagePlan,
        pins: &mut PinStore,
        status: GroupId,
        found: RemotePart,
        registers: ChannelRegisters,
        (id, started_at): (RemoteId, Instant),
    ) -> Result<Self, PinError> {
        let started = found.started;
        let inputs = registers.interfaces_for(started.input_bytes());
        let outputs = registers.interfaces_for(started.sizes.tx);
        let outputs: Vec<_> = outputs
            .map(|address| image.write(Phase::Data, address, 0))
            .collect();
        let mut data = [None; 2];
        for (n, (address, data)) in registers.interfaces().zip(&mut data).enumerate() {
            *data = (n >= outputs.len()).then(|| image.on_demand(address));
        }
        if found.offline.is_some() {
            pins.fault(found.pins.group);
        }
        Ok(Self {
            id,
            channel: started.channel,
            fault_pins: RemoteFaultPins::new(pins, status, &found.pins.prefix)?,
            descriptor: found.descriptor,
            pins: found.pins,
            inputs: inputs
                .map(|address| image.read(Phase::Data, address))
                .collect(),
            outputs,
            mode: image.on_demand(registers.cs),
            data,
            mode_word: software_mode_word(started.software_mode),
            is_confirmed: false,
            unanswered: Some((0, started_at)),
            in_image: OutputsInImage::default(),
            outputs_state: OutputsState::Off,
            comes_with_board: false,
        })
    }

    /// Takes a good transfer: publishes its inputs, which are as old as the transfer.
    pub fn take(&mut self, cycle: &mut ReadCycle<'_>, outcome: &ReadOutcome) {
        if !self.in_image.drive {
            self.outputs_state = OutputsState::Off;
        }
        let mut words = [0; REGISTERS];
        for (word, &slot) in words.iter_mut().zip(&self.inputs) {
            *word = cycle.words.word(slot);
        }
        self.pins.take_inputs(cycle.pins, &words);
        let this_cycle = cycle.pins.cycle();
        let due = (outcome.due(this_cycle), outcome.started);
        let (due, started) = self.unanswered.take().unwrap_or(due);
        let cycles = this_cycle.saturating_sub(due);
        let group = self.pins.group;
        cycle.pins.group_good_since(group, cycles, started);
        self.comes_with_board = false;
    }

    /// Makes the remote safe, whose counters may contain any value when it comes back.
    pub fn make_safe(&mut self, pins: &mut PinStore) {
        pins.fault(self.pins.group);
        self.unanswered = None;
        self.pins.restarted();
    }

    /// Handles a read that delivered no good transfer, after the one at `last_read`.
    #[cold]
    pub fn not_confirmed(
        &mut self,
        life: &Life,
        cycle: &mut ReadCycle<'_>,
        outcome: &ReadOutcome,
        last_read: Instant,
    ) {
        let channel = self.channel;
        if outcome.offline.contains(channel) {
            self.went_offline(life, cycle);
        } else if outcome.failed.contains(channel) {
            cycle.pins.invalidate(self.pins.group);
            self.unanswered = Some((outcome.due(cycle.pins.cycle()), outcome.started));
        } else if outcome.started_anew.contains(channel) {
            self.unanswered = Some((cycle.pins.cycle().saturating_sub(1), last_read));
        }
        let has_new_fault = outcome.new_faults.contains(channel);
        if has_new_fault || self.comes_with_board {
            self.attempted(life, has_new_fault, cycle);
        }
    }

    /// Handles a running remote that went offline: it will not be armed when it runs again, unless
    /// it comes up because of the board.
    fn went_offline(&mut self, life: &Life, cycle: &mut ReadCycle<'_>) {
        let group = self.pins.group;
        let arming = cycle.pins.arming(group);
        if cycle
            .pins
            .group_state(group)
            .is_some_and(|state| !state.armed)
        {
            cycle.pins.count_loss();
        }
        self.make_safe(cycle.pins);
        match arming.awaits_transfer() {
            Some(condition) if self.comes_with_board && life.is_of_board() => {
                cycle.pins.request_arming(group, condition);
            }
            Some(_) => self.report_cancelled(cycle.events, cycle.now),
            None => {}
        }
    }

    /// Handles the attempts to start a remote that is to be armed. A new fault cancels that: also a
    /// fault of its own that is found when it comes up because of the board. An attempt that fails
    /// again is none.
    fn attempted(&mut self, life: &Life, has_new_fault: bool, cycle: &mut ReadCycle<'_>) {
        let group = self.pins.group;
        let is_awaited = cycle.pins.arming(group).awaits_transfer().is_some();
        let comes_alone = self.comes_with_board && !life.is_of_board();
        if comes_alone {
            self.comes_with_board = false;
            // Commands that were set meanwhile are forgotten.
            cycle.pins.disarm(group);
        }
        if is_awaited && (comes_alone || has_new_fault) {
            cycle.pins.cancel_arming(group);
            self.report_cancelled(cycle.events, cycle.now);
        }
    }

    /// Reports that the remote will not be armed when it runs.
    fn report_cancelled(&self, events: &EventSink, now: Instant) {
        events.tell(now, EventKind::RemoteRearmCancelled { remote: self.id });
    }

    /// Keeps a remote of a port that is switched off safe: it is not armed when it runs again.
    pub fn keep_safe(&self, cycle: &mut WriteCycle<'_>) {
        let group = self.pins.group;
        if cycle.pins.cancel_arming(group) {
            self.report_cancelled(cycle.events, cycle.now);
        }
        cycle.pins.fault(group);
    }

    /// Arms the remote with its first good transfer, if it comes up because the board has its
    /// set-up again. True if that is new.
    pub fn arm_with_board(&self, pins: &mut PinStore) -> bool {
        self.comes_with_board && pins.request_arming(self.pins.group, ArmingCondition::WithBoard)
    }

    /// Puts the outputs into the image, unless they are unchanged.
    pub fn put(&mut self, cycle: &mut WriteCycle<'_>) {
        let version = cycle.pins.output_version(self.pins.group);
        if version.is_some() && version == self.in_image.version {
            return;
        }
        let mut words = [0; REGISTERS];
        self.pins.put_outputs(cycle.pins, &mut words);
        // What was read before is no evidence for them.
        self.is_confirmed = false;
        let state = cycle.pins.group_state(self.pins.group);
        self.in_image = OutputsInImage {
            version,
            drive: words != [0; REGISTERS],
            are_safe: state.is_some_and(|group| !group.armed),
        };
        for (word, &slot) in words.into_iter().zip(&self.outputs) {
            cycle.words.put(slot, word);
        }
    }

    /// Puts the outputs of a transfer, in which the remote takes part if it is in it.
    pub fn put_transfer(&mut self, cycle: &mut WriteCycle<'_>, is_in_it: bool) {
        self.put(cycle);
        if self.in_image.drive && is_in_it {
            self.outputs_state = OutputsState::Driven;
        }
    }

    /// True if the last read delivered a good transfer of safe values.
    pub fn has_confirmed_safe(&self) -> bool {
        self.is_confirmed && self.in_image.are_safe
    }

    /// Sets the words of an access, which are written with its DOIT. Outputs are put anew before
    /// the next transfer.
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
        (self.in_image.version, self.in_image.drive) = (None, true);
    }

    /// Sets the software mode, which is written with START.
    pub fn put_mode(&self, cycle: &mut WriteCycle<'_>) {
        cycle.words.set(self.mode, self.mode_word);
        cycle.words.repeat(self.mode);
    }
}
