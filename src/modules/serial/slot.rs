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
use crate::hal::{ArmingEvent, GroupId, PinError, PinStore};
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
        started_at: Instant,
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
        self.forget_transfers();
    }

    /// Takes nothing that was transferred before as a part of what comes.
    fn forget_transfers(&mut self) {
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
            // It will not be armed when it runs again, unless it comes up because of the board.
            let event = if self.comes_with_board && life.is_of_board() {
                ArmingEvent::OfflineWithBoard
            } else {
                ArmingEvent::Offline
            };
            cycle.pins.invalidate(self.pins.group);
            self.change_arming(event, cycle.pins, cycle.events, cycle.now);
            self.forget_transfers();
        } else if outcome.failed.contains(channel) {
            cycle.pins.invalidate(self.pins.group);
            self.unanswered = Some((outcome.due(cycle.pins.cycle()), outcome.started));
        } else if outcome.started_anew.contains(channel) {
            self.unanswered = Some((cycle.pins.cycle().saturating_sub(1), last_read));
        }
        if self.comes_with_board && !life.is_of_board() {
            // A fault of its own, found when it comes up because of the board: commands that were
            // set meanwhile are forgotten.
            self.comes_with_board = false;
            self.change_arming(ArmingEvent::Fault, cycle.pins, cycle.events, cycle.now);
        } else if outcome.new_faults.contains(channel) {
            // An attempt to start it that fails again is no new fault.
            self.change_arming(
                ArmingEvent::CancelTransfer,
                cycle.pins,
                cycle.events,
                cycle.now,
            );
        }
    }

    /// Keeps a remote of a port that is switched off safe: it is not armed when it runs again.
    pub fn keep_safe(&self, cycle: &mut WriteCycle<'_>) {
        cycle.pins.invalidate(self.pins.group);
        self.change_arming(ArmingEvent::PortOff, cycle.pins, cycle.events, cycle.now);
    }

    /// Changes the arming of the remote, and reports if it will therefore not be armed when it
    /// runs.
    fn change_arming(
        &self,
        event: ArmingEvent,
        pins: &mut PinStore,
        events: &EventSink,
        now: Instant,
    ) {
        if pins.change_arming_of(self.pins.group, event) {
            events.report(
                now,
                EventKind::RemoteRearmCancelled {
                    remote: self.pins.label,
                },
            );
        }
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
