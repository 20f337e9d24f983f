//! A port with its registers in the image and its remotes' pins.

use alloc::vec::Vec;

use super::health::{Expected, Health};
use super::pins::PortPins;
use super::recovery::{Recovery, is_transferring};
use super::{FailureCounts, PortStatistics, RemoteState, RemoteStatus, RemoteWatchdog, SetAside};
use crate::bus::{Clock, Instant, ReadSlot, RegisterBus, Setting, Words, WriteSlot};
use crate::discovery::RemoteDescriptor;
use crate::driver::parameters::ParameterWrite;
use crate::hal::{GroupId, PinStore, Pins};
use crate::modules::{Module, ReadCycle, RegisterError, Registrar, WriteCycle};
use crate::remote::RemotePins;
use crate::sslbp::{
    Channel as Number, ChannelMask, ChannelRegisters, Command, DoitTime, Layout,
    MAX_INTERFACE_REGISTERS, Observed, Port, PortError, PortParameters, RemoteFaults,
    StartedRemote, software_mode_word,
};

/// Interface registers of one direction.
const REGISTERS: usize = MAX_INTERFACE_REGISTERS as usize;

/// The parameter that holds a remote's watchdog time, in milliseconds. Manual: 7I77, "FIELD I/O
/// PARAMETERS".
pub(in crate::driver) const WATCHDOG_PARAMETER: &str = "NVWatchDogTimeout";

/// Interface registers that hold what START told.
const START_REGISTERS: u8 = 3;

/// A serial port in the cycle.
#[derive(Debug)]
pub struct SerialPort {
    pub(in crate::driver) port: Port,
    command: ReadSlot,
    data: ReadSlot,
    doit: WriteSlot,
    recovery: Recovery,
    pub(super) remotes: Vec<Remote>,
    pins: PortPins,
    expected: DoitTime,
}

/// A remote in the cycle.
#[derive(Debug)]
pub(in crate::driver) struct Remote {
    pub started: StartedRemote,
    pub descriptor: RemoteDescriptor,
    pub pins: RemotePins,
    pub fault_pins: super::pins::RemoteFaultPins,
    slots: RemoteSlots,
    /// Reads in a row without a new transfer.
    without_news: u32,
    /// The version of the outputs that are in the image.
    put: Option<u64>,
}

/// Where the registers of a channel are in the image.
#[derive(Debug, Default)]
struct RemoteSlots {
    cs: Option<ReadSlot>,
    start: [Option<ReadSlot>; START_REGISTERS as usize],
    inputs: [Option<ReadSlot>; REGISTERS],
    outputs: [Option<WriteSlot>; REGISTERS],
    mode: Option<Setting>,
}

impl Remote {
    pub fn new(
        started: StartedRemote,
        descriptor: RemoteDescriptor,
        pins: RemotePins,
        fault_pins: super::pins::RemoteFaultPins,
    ) -> Self {
        Self {
            started,
            descriptor,
            pins,
            fault_pins,
            slots: RemoteSlots::default(),
            without_news: 0,
            put: None,
        }
    }

    fn register(&mut self, r: &mut Registrar<'_>, registers: ChannelRegisters) {
        let slots = &mut self.slots;
        slots.cs = Some(r.input(registers.cs()));
        let inputs = registers.interfaces_for(self.started.input_bytes());
        for (slot, address) in slots.inputs.iter_mut().zip(inputs) {
            *slot = Some(r.input(address));
        }
        for (slot, address) in slots.start.iter_mut().zip(registers.interfaces()) {
            *slot = Some(r.extra_input(address));
        }
        let outputs = registers.interfaces_for(self.started.output_bytes());
        for (slot, address) in slots.outputs.iter_mut().zip(outputs) {
            *slot = Some(r.process_data(address));
        }
        slots.mode = Some(r.on_demand(registers.cs()));
    }

    /// How long its outputs stay on without process data, as far as its parameter tells: what it
    /// was before counts as well, because it is in use until the next power-up.
    fn watchdog(&self) -> RemoteWatchdog {
        let parameter = self.pins.parameter(&self.descriptor, WATCHDOG_PARAMETER);
        let times = parameter.map(|parameter| (parameter.first(), parameter.known()));
        match times {
            Some((Some(first), Some(known))) => {
                RemoteWatchdog::from_millis(first).or_longer(RemoteWatchdog::from_millis(known))
            }
            _ => RemoteWatchdog::Assumed,
        }
    }

    /// Publishes the inputs of a good transfer.
    fn take(&mut self, cycle: &mut ReadCycle<'_>) {
        let mut words = [0; REGISTERS];
        for (word, slot) in words.iter_mut().zip(self.slots.inputs) {
            *word = slot.map_or(0, |slot| cycle.word(slot));
        }
        self.pins.take_inputs(cycle.pins, &words);
        self.without_news = 0;
    }

    /// Puts the outputs into the image, unless they are there already.
    fn put(&mut self, cycle: &mut WriteCycle<'_>) {
        let version = cycle.pins.output_version(self.pins.group());
        if version.is_some() && version == self.put {
            return;
        }
        self.put = version;
        let mut words = [0; REGISTERS];
        self.pins.put_outputs(cycle.pins, &mut words);
        for (word, slot) in words.into_iter().zip(self.slots.outputs) {
            if let Some(slot) = slot {
                cycle.put(slot, word);
            }
        }
    }
}

impl SerialPort {
    /// Registers COMMAND, DATA, CS and the interface registers that carry data. COMMAND is read
    /// before the data it vouches for, and written after all data. `port` runs in normal mode, with all
    /// `remotes` started.
    pub(in crate::driver) fn register(
        r: &mut Registrar<'_>,
        (port, parameters): (Port, PortParameters),
        mut remotes: Vec<Remote>,
        now: Instant,
    ) -> Result<Self, RegisterError> {
        let policy = r.settings().policy;
        let layout = *port.layout();
        let pins = PortPins::new(r.pins, r.status, r.name, layout.instance(), &policy)?;
        let command = r.status(layout.command());
        let data = r.input(layout.data());
        let doit = r.trigger(layout.command(), Command::IGNORED.word());
        for remote in &mut remotes {
            if let Some(registers) = layout.channel(remote.started.channel) {
                remote.register(r, registers);
            }
        }
        let mut recovery = Recovery::new(parameters, policy, now);
        for remote in &remotes {
            let channel = remote.started.channel;
            let expected = Expected {
                told: port.machine().link(channel).told(),
                unit_mask: u32::MAX,
            };
            let health = Health::new(expected, remote.watchdog(), policy.first_backoff);
            recovery.add(channel, health);
        }
        let expected = port.doit_time(recovery.known());
        Ok(Self {
            port,
            command,
            data,
            doit,
            recovery,
            remotes,
            pins,
            expected,
        })
    }

    /// The software modes of the remotes that are restarted are written with their START.
    fn put_modes(&self, cycle: &mut WriteCycle<'_>, modes: ChannelMask) {
        for remote in &self.remotes {
            if let (Some(mode), true) = (remote.slots.mode, modes.contains(remote.started.channel))
            {
                cycle.set(mode, software_mode_word(remote.started.software_mode));
                cycle.repeat(mode);
            }
        }
    }

    /// Stops all channels, whatever they do.
    pub(in crate::driver) fn stop_all<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
    ) -> Result<(), PortError<B::Error>> {
        self.port.stop_all(bus)
    }

    /// Looks at COMMAND alone: whether a transfer is complete, or none is under way.
    pub(in crate::driver) fn poll(&mut self, words: &Words, now: Instant) -> bool {
        let is_complete = self.is_idle(words);
        if is_complete {
            self.recovery.transfer_complete(self.port.machine(), now);
        }
        is_complete || !is_transferring(self.port.machine())
    }

    /// Whether COMMAND was 0 when it was read last.
    pub(in crate::driver) fn is_idle(&self, words: &Words) -> bool {
        words.word(self.command) == 0
    }

    /// Whether it looks as if the whole board was reset: every channel that ran is stopped, and
    /// nobody asked for it. `None` if it has no remotes to tell by.
    pub(in crate::driver) fn appears_reset(&self) -> Option<bool> {
        (!self.remotes.is_empty()).then(|| self.recovery.appears_reset())
    }

    /// What was before a remote was armed is history.
    fn note_armed(&mut self, pins: &Pins) {
        for remote in &self.remotes {
            let state = pins.group_state(remote.pins.group());
            if state.is_some_and(|state| state.armed) {
                self.recovery.armed(remote.started.channel);
            }
        }
    }

    /// All remotes were stopped behind the cycle's back, and COMMAND is nobody's: they are
    /// restarted in the next cycles.
    pub(in crate::driver) fn taken_over(&mut self, pins: &mut PinStore, now: Instant) {
        self.recovery.taken_over();
        for channel in self.recovery.known().iter() {
            self.restart(channel, pins, now);
        }
    }

    /// A parameter of a remote was written and read back.
    pub(in crate::driver) fn parameter_written(
        &mut self,
        pins: &mut PinStore,
        channel: Number,
        write: &ParameterWrite,
    ) {
        let is_it = |remote: &&mut Remote| remote.started.channel == channel;
        let Some(remote) = self.remotes.iter_mut().find(is_it) else {
            return;
        };
        if let Some(parameter) = remote.pins.parameters_mut().get_mut(write.place) {
            parameter.publish(pins, write.raw);
        }
        self.recovery.set_watchdog(channel, remote.watchdog());
    }
}

impl Module for SerialPort {
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        self.note_armed(cycle.pins);
        let seen = Seen {
            words: cycle.words,
            command: self.command,
            data: self.data,
            remotes: &self.remotes,
        };
        let machine = self.port.machine_mut();
        let outcome = self
            .recovery
            .observe(machine, cycle.now, &seen, cycle.certain);
        let stale_after = self.recovery.policy.stale_after;
        for remote in &mut self.remotes {
            let number = remote.started.channel;
            let group = remote.pins.group();
            if outcome.good.contains(number) {
                remote.take(cycle);
                let reads_before = u64::from(outcome.reads_before);
                cycle
                    .pins
                    .group_good_since(group, reads_before, outcome.started);
            } else if outcome.set_aside.contains(number) {
                remote.pins.fault(cycle.pins);
                remote.pins.restarted();
            } else if outcome.failed.contains(number) {
                cycle.pins.invalidate(group);
            } else {
                remote.no_news(cycle.pins, stale_after);
            }
            if let Some(health) = self.recovery.remote(number) {
                let link = self.port.machine().link(number);
                remote.fault_pins.publish(cycle.pins, health, link);
            }
        }
        self.pins
            .publish(cycle.pins, &self.recovery, self.port.machine());
        let report = &mut *cycle.report;
        report.good += outcome.good.len();
        report.failed += outcome.failed.len();
        report.set_aside += outcome.set_aside.len();
        report.too_short += u32::from(outcome.too_short);
    }

    fn not_read(&mut self, pins: &mut PinStore) {
        self.port.machine_mut().not_observed();
        let stale_after = self.recovery.policy.stale_after;
        for remote in &mut self.remotes {
            remote.no_news(pins, stale_after);
        }
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        self.pins.fetch(cycle.pins, &mut self.recovery);
        self.note_armed(cycle.pins);
        if !self.recovery.run {
            for remote in &self.remotes {
                remote.pins.fault(cycle.pins);
            }
        }
        let machine = self.port.machine_mut();
        let next = self.recovery.next(machine, cycle.now, cycle.hold);
        if !next.modes.is_empty() {
            self.put_modes(cycle, next.modes);
        }
        if next.with_data {
            for remote in &mut self.remotes {
                remote.put(cycle);
            }
        }
        cycle.put(self.doit, next.command.word());
        if self.recovery.needs_start_data() {
            cycle.ask_extra();
        }
    }

    fn written(&mut self, now: Instant, arrived: bool) {
        self.port.machine_mut().written(now, arrived);
    }

    /// All its remotes fail together: inputs not valid, outputs safe until re-armed.
    fn make_safe(&mut self, pins: &mut PinStore) {
        for remote in &self.remotes {
            remote.pins.fault(pins);
        }
    }

    /// All remotes that do not run are restarted in the next cycles.
    fn restored(&mut self, pins: &mut PinStore, now: Instant) {
        self.port.machine_mut().doubt();
        for remote in &mut self.remotes {
            remote.pins.restarted();
        }
        let not_running = self.recovery.known().difference(self.recovery.running());
        for channel in not_running.iter() {
            self.restart(channel, pins, now);
        }
    }
}

impl Remote {
    fn no_news(&mut self, pins: &mut PinStore, stale_after: u32) {
        self.without_news = self.without_news.saturating_add(1);
        if self.without_news >= stale_after {
            pins.invalidate(self.pins.group());
        }
    }
}

/// What an application asks.
impl SerialPort {
    /// Its registers.
    pub fn layout(&self) -> &Layout {
        self.port.layout()
    }

    /// What it did so far.
    pub fn statistics(&self) -> &PortStatistics {
        &self.recovery.statistics
    }

    /// How long its transfers take according to the remotes' sizes.
    pub fn expected_time(&self) -> DoitTime {
        self.expected
    }

    /// Its remotes, by channel.
    pub fn remotes(&self) -> impl Iterator<Item = RemoteStatus<'_>> {
        self.remotes.iter().filter_map(|remote| {
            let channel = remote.started.channel;
            Some(RemoteStatus {
                remote,
                health: self.recovery.remote(channel)?,
                link: self.port.machine().link(channel),
            })
        })
    }

    /// The remote on a channel.
    pub fn remote(&self, channel: Number) -> Option<RemoteStatus<'_>> {
        self.remotes()
            .find(|status| status.started().channel == channel)
    }

    /// Restarts a remote in the next cycles, whatever its pause, but not before its outputs must
    /// be off: it clears the remote's faults. Its outputs are safe from now on until it is re-armed.
    pub(in crate::driver) fn restart(
        &mut self,
        channel: Number,
        pins: &mut PinStore,
        now: Instant,
    ) {
        if let Some(remote) = self
            .remotes
            .iter_mut()
            .find(|remote| remote.started.channel == channel)
        {
            remote.pins.fault(pins);
            remote.pins.restarted();
            self.recovery.restart_now(channel, now);
        }
    }
}

impl RemoteStatus<'_> {
    /// What START told of it.
    pub fn started(&self) -> &StartedRemote {
        &self.remote.started
    }

    /// What discovery found out about it.
    pub fn descriptor(&self) -> &RemoteDescriptor {
        &self.remote.descriptor
    }

    /// Its pins.
    pub fn pins(&self) -> &RemotePins {
        &self.remote.pins
    }

    /// The group of its pins, to re-arm it.
    pub fn group(&self) -> GroupId {
        self.remote.pins.group()
    }

    /// What it is doing.
    pub fn state(&self) -> RemoteState {
        self.health.state
    }

    /// Why it was set aside first since it was re-armed last; later reasons do not replace it.
    /// `None` while nothing has happened since.
    pub fn first_fault(&self) -> Option<SetAside> {
        self.health.first_fault
    }

    /// How long its outputs stay on when nobody talks to it: its own watchdog.
    ///
    /// A period longer than that can not feed it.
    pub fn watchdog(&self) -> RemoteWatchdog {
        self.health.watchdog
    }

    /// What it reported with its last reply, or START found when it could not clear it.
    pub fn faults(&self) -> RemoteFaults {
        self.health.faults
    }

    /// Transfers of its own so far, failed ones included.
    pub fn transfers(&self) -> u64 {
        self.link.transfers()
    }

    /// Its failures so far.
    pub fn failures(&self) -> FailureCounts {
        *self.link.failures()
    }

    /// How often it was restarted.
    pub fn restarts(&self) -> u64 {
        self.health.restarts
    }
}

/// The registers of a port in the image.
struct Seen<'a> {
    words: &'a Words,
    command: ReadSlot,
    data: ReadSlot,
    remotes: &'a [Remote],
}

impl Seen<'_> {
    fn word(&self, slot: Option<ReadSlot>) -> Option<u32> {
        slot.map(|slot| self.words.word(slot))
    }

    fn slots(&self, channel: Number) -> Option<&RemoteSlots> {
        let is_it = |remote: &&Remote| remote.started.channel == channel;
        Some(&self.remotes.iter().find(is_it)?.slots)
    }
}

impl Observed for Seen<'_> {
    fn command(&self) -> u32 {
        self.words.word(self.command)
    }

    fn data(&self) -> u32 {
        self.words.word(self.data)
    }

    fn cs(&self, channel: Number) -> u32 {
        let cs = self.slots(channel).and_then(|slots| self.word(slots.cs));
        cs.unwrap_or(0)
    }

    fn told(&self, channel: Number) -> [u32; 3] {
        let slots = self.slots(channel).map_or([None; 3], |slots| slots.start);
        slots.map(|slot| self.word(slot).unwrap_or(0))
    }
}
