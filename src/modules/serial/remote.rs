//! A remote of a port: its registers in the image, and its pins.

use alloc::vec::Vec;

use super::RemoteWatchdog;
use super::pins::RemoteFaultPins;
use crate::bus::{Instant, Phase, ReadSlot, Setting, WriteSlot};
use crate::discovery::RemoteDescriptor;
use crate::hal::PinStore;
use crate::modules::{ReadCycle, RegisterError, Registrar, WriteCycle};
use crate::remote::RemotePins;
use crate::sslbp::{
    Channel, ChannelRegisters, MAX_INTERFACE_REGISTERS, StartedRemote, software_mode_word,
};

/// Interface registers of one direction.
const REGISTERS: usize = MAX_INTERFACE_REGISTERS as usize;

/// The parameter that holds a remote's watchdog time, in milliseconds. Manual: 7I77, "FIELD I/O
/// PARAMETERS".
pub const WATCHDOG_PARAMETER: &str = "NVWatchDogTimeout";

/// A remote that takes part: as it was found, or, while it is absent, as its table describes it.
#[derive(Debug)]
pub struct FoundRemote {
    /// What START found; of one that is absent, what it has to find: 0 for a unit number or
    /// tables that are not known, and of the unit number the class in the top byte.
    pub started: StartedRemote,
    /// What discovery found out about it; of one that is absent, what its table says.
    pub descriptor: RemoteDescriptor,
    /// Its pins.
    pub pins: RemotePins,
    /// It was not there, and may come up when it is plugged in.
    pub is_absent: bool,
}

impl FoundRemote {
    /// How long its outputs stay on without process data.
    pub fn watchdog(&self) -> RemoteWatchdog {
        RemoteWatchdog::of(&self.pins)
    }
}

/// A remote in the cycle.
#[derive(Debug)]
pub(super) struct Served {
    pub channel: Channel,
    pub descriptor: RemoteDescriptor,
    pub pins: RemotePins,
    pub fault_pins: RemoteFaultPins,
    inputs: Vec<ReadSlot>,
    outputs: Vec<WriteSlot>,
    mode: Setting,
    mode_word: u32,
    /// The last read brought a good transfer.
    pub has_news: bool,
    /// The last transfer, if it failed: the cycle in which its data was due, and when it was started.
    pub unanswered: Option<(u64, Instant)>,
    /// The version of the outputs that are in the image.
    put: Option<u64>,
    /// Those are not all 0, as they are after START.
    pub drives: bool,
}

impl Served {
    pub fn register(
        r: &mut Registrar<'_>,
        found: FoundRemote,
        registers: ChannelRegisters,
    ) -> Result<Self, RegisterError> {
        let FoundRemote { started, pins, .. } = found;
        let inputs = registers.interfaces_for(started.input_bytes());
        let outputs = registers.interfaces_for(started.sizes.tx);
        if found.is_absent {
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
            outputs: outputs
                .map(|address| r.image.write(Phase::Data, address, 0))
                .collect(),
            mode: r.image.on_demand(registers.cs),
            mode_word: software_mode_word(started.software_mode),
            has_news: false,
            unanswered: None,
            put: None,
            drives: false,
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

    /// It went offline: what it counted may be anywhere when it comes back.
    pub fn lost(&mut self, pins: &mut PinStore) {
        pins.fault(self.pins.group);
        self.unanswered = None;
        self.pins.restarted();
    }

    /// Puts the outputs into the image, unless they are there already.
    pub fn put(&mut self, cycle: &mut WriteCycle<'_>) {
        let version = cycle.pins.output_version(self.pins.group);
        if version.is_some() && version == self.put {
            return;
        }
        self.put = version;
        let mut words = [0; REGISTERS];
        self.pins.put_outputs(cycle.pins, &mut words);
        self.drives = words != [0; REGISTERS];
        for (word, &slot) in words.into_iter().zip(&self.outputs) {
            cycle.words.put(slot, word);
        }
    }

    /// Its software mode is written with its START.
    pub fn put_mode(&self, cycle: &mut WriteCycle<'_>) {
        cycle.words.set(self.mode, self.mode_word);
        cycle.words.repeat(self.mode);
    }
}
