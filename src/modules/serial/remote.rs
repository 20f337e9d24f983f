//! A remote of a port: its registers in the image, and its pins.

use alloc::vec::Vec;

use super::RemoteWatchdog;
use super::pins::RemoteFaultPins;
use crate::bus::{ReadSlot, Setting, WriteSlot};
use crate::discovery::RemoteDescriptor;
use crate::hal::PinStore;
use crate::modules::{ReadCycle, Registrar, WriteCycle};
use crate::remote::RemotePins;
use crate::sslbp::{ChannelRegisters, MAX_INTERFACE_REGISTERS, StartedRemote, software_mode_word};

/// Interface registers of one direction.
const REGISTERS: usize = MAX_INTERFACE_REGISTERS as usize;

/// The parameter that holds a remote's watchdog time, in milliseconds. Manual: 7I77, "FIELD I/O
/// PARAMETERS".
pub(crate) const WATCHDOG_PARAMETER: &str = "NVWatchDogTimeout";

/// A remote that takes part, and its pins.
#[derive(Debug)]
pub(crate) struct Remote {
    pub started: StartedRemote,
    pub descriptor: RemoteDescriptor,
    pub pins: RemotePins,
    pub fault_pins: RemoteFaultPins,
    /// It was absent at the start, and has not run yet.
    pub is_absent: bool,
}

impl Remote {
    /// One that has been started.
    pub fn new(
        started: StartedRemote,
        descriptor: RemoteDescriptor,
        pins: RemotePins,
        fault_pins: RemoteFaultPins,
    ) -> Self {
        Self {
            started,
            descriptor,
            pins,
            fault_pins,
            is_absent: false,
        }
    }

    /// One that was absent at the start. `expected` is what is known of its kind: the unit number
    /// holds its class in the top byte, or is 0; so are the tables where they are not known.
    pub fn absent(
        expected: StartedRemote,
        descriptor: RemoteDescriptor,
        pins: RemotePins,
        fault_pins: RemoteFaultPins,
    ) -> Self {
        Self {
            is_absent: true,
            ..Self::new(expected, descriptor, pins, fault_pins)
        }
    }

    /// How long its outputs stay on without process data, as far as its parameter tells: what it
    /// was before counts as well, because it is in use until the next power-up.
    pub fn watchdog(&self) -> RemoteWatchdog {
        let parameter = self.pins.parameter(&self.descriptor, WATCHDOG_PARAMETER);
        let times = parameter.map(|parameter| (parameter.first(), parameter.known()));
        match times {
            Some((Some(first), Some(known))) => {
                RemoteWatchdog::from_millis(first).or_longer(RemoteWatchdog::from_millis(known))
            }
            _ => RemoteWatchdog::Assumed,
        }
    }

    /// It runs for the first time, and told this.
    pub fn plugged_in(&mut self, [unit_number, _, tables]: [u32; 3]) {
        self.is_absent = false;
        self.started.unit_number = unit_number;
        self.started.ptoc = tables as u16;
        self.started.gtoc = (tables >> 16) as u16;
    }
}

/// A remote in the cycle.
#[derive(Debug)]
pub(super) struct Served {
    pub remote: Remote,
    inputs: Vec<ReadSlot>,
    outputs: Vec<WriteSlot>,
    mode: Setting,
    /// Reads in a row without a new transfer.
    without_news: u32,
    /// The version of the outputs that are in the image.
    put: Option<u64>,
}

impl Served {
    pub fn register(r: &mut Registrar<'_>, remote: Remote, registers: ChannelRegisters) -> Self {
        let inputs = registers.interfaces_for(remote.started.input_bytes());
        let outputs = registers.interfaces_for(remote.started.output_bytes());
        if remote.is_absent {
            remote.pins.fault(r.pins());
        }
        Self {
            inputs: inputs.map(|address| r.input(address)).collect(),
            outputs: outputs.map(|address| r.process_data(address)).collect(),
            mode: r.on_demand(registers.cs()),
            remote,
            without_news: 0,
            put: None,
        }
    }

    /// Publishes the inputs of a good transfer.
    pub fn take(&mut self, cycle: &mut ReadCycle<'_>) {
        let mut words = [0; REGISTERS];
        for (word, &slot) in words.iter_mut().zip(&self.inputs) {
            *word = cycle.word(slot);
        }
        self.remote.pins.take_inputs(cycle.pins, &words);
        self.without_news = 0;
    }

    /// Its inputs grow older.
    pub fn no_news(&mut self, pins: &mut PinStore, stale_after: u32) {
        self.without_news = self.without_news.saturating_add(1);
        if self.without_news >= stale_after {
            pins.invalidate(self.remote.pins.group());
        }
    }

    /// It went offline: what it counted may be anywhere when it comes back.
    pub fn lost(&mut self, pins: &mut PinStore) {
        self.remote.pins.fault(pins);
        self.remote.pins.restarted();
    }

    /// Puts the outputs into the image, unless they are there already.
    pub fn put(&mut self, cycle: &mut WriteCycle<'_>) {
        let pins = &self.remote.pins;
        let version = cycle.pins.output_version(pins.group());
        if version.is_some() && version == self.put {
            return;
        }
        self.put = version;
        let mut words = [0; REGISTERS];
        pins.put_outputs(cycle.pins, &mut words);
        for (word, &slot) in words.into_iter().zip(&self.outputs) {
            cycle.put(slot, word);
        }
    }

    /// Its software mode is written with its START.
    pub fn put_mode(&self, cycle: &mut WriteCycle<'_>) {
        let word = software_mode_word(self.remote.started.software_mode);
        cycle.set(self.mode, word);
        cycle.repeat(self.mode);
    }
}
