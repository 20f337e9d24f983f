//! A port with its registers in the image and its remotes' pins.

use alloc::vec::Vec;

use super::health::{Expected, Health};
use super::pins::PortPins;
use super::recovery::{Recovery, is_transferring};
use super::remote::{Remote, Served};
use super::{PortStatistics, RemoteStatus};
use crate::bus::{Clock, Instant, ReadSlot, RegisterBus, Words, WriteSlot};
use crate::hal::PinStore;
use crate::modules::{Module, ReadCycle, RegisterError, Registrar, WriteCycle};
use crate::sslbp::{
    Channel, ChannelRegisters, Command, DoitTime, Layout, MAX_CHANNELS, Observed, Port, PortError,
    PortParameters, ReplyFormat,
};

/// A serial port in the cycle.
#[derive(Debug)]
pub struct SerialPort {
    port: Port,
    slots: Slots,
    doit: WriteSlot,
    recovery: Recovery,
    remotes: Vec<Served>,
    pins: PortPins,
    expected: DoitTime,
}

/// Where the registers of a port are in the image. Those of channels without a remote are not asked
/// for.
#[derive(Debug)]
struct Slots {
    command: ReadSlot,
    data: ReadSlot,
    cs: [ReadSlot; MAX_CHANNELS as usize],
    told: [[ReadSlot; 3]; MAX_CHANNELS as usize],
}

impl SerialPort {
    /// Registers COMMAND, DATA, CS and the interface registers that carry data. COMMAND is read
    /// before the data it vouches for, and written after all data. `port` runs in normal mode, with
    /// all `remotes` started but those that are absent.
    pub(crate) fn register(
        r: &mut Registrar<'_>,
        (mut port, parameters): (Port, PortParameters),
        remotes: Vec<Remote>,
        now: Instant,
    ) -> Result<Self, RegisterError> {
        let policy = r.settings().fault_policy;
        let layout = *port.layout();
        let pins = PortPins::register(r, layout.instance())?;
        let command = r.status(layout.command());
        let mut slots = Slots {
            command,
            data: r.input(layout.data()),
            cs: [command; MAX_CHANNELS as usize],
            told: [[command; 3]; MAX_CHANNELS as usize],
        };
        let doit = r.trigger(layout.command(), Command::IGNORED.word());
        let mut recovery = Recovery::new(parameters, policy, now);
        let mut served = Vec::new();
        for remote in remotes {
            let started = &remote.started;
            let channel = started.channel;
            let Some(registers) = layout.channel(channel) else {
                debug_assert!(false, "port {} has no channel {channel}", layout.instance());
                continue;
            };
            slots.register(r, channel, registers);
            let health = if remote.is_absent {
                let data_only = started.reply_format() == ReplyFormat::DataOnly;
                let machine = port.machine_mut();
                machine.set_sizes(channel, started.sizes, data_only);
                let tables = u32::from(started.gtoc) << 16 | u32::from(started.ptoc);
                let name = u32::from_le_bytes(started.name.0);
                let expected = Expected::of_kind(started.unit_number, name, tables);
                Health::absent(expected, &policy, now)
            } else {
                let expected = Expected::exactly(port.machine().link(channel).told());
                Health::new(expected, remote.watchdog(), policy.first_backoff)
            };
            recovery.add(channel, health);
            served.push(Served::register(r, remote, registers));
        }
        let expected = port.doit_time(recovery.known());
        Ok(Self {
            port,
            slots,
            doit,
            recovery,
            remotes: served,
            pins,
            expected,
        })
    }

    /// The port, to use it for something else; [`taken_over`](Self::taken_over) must follow.
    pub(crate) const fn port_mut(&mut self) -> &mut Port {
        &mut self.port
    }

    /// Stops all channels, whatever they do.
    pub(crate) fn stop_all<B: RegisterBus + Clock>(
        &mut self,
        bus: &mut B,
    ) -> Result<(), PortError<B::Error>> {
        self.port.stop_all(bus)
    }

    /// Looks at COMMAND alone: whether a transfer is complete, or none is in flight.
    pub(crate) fn poll(&mut self, words: &Words, now: Instant) -> bool {
        let is_complete = self.is_idle(words);
        if is_complete {
            self.recovery.transfer_complete(self.port.machine(), now);
        }
        is_complete || !is_transferring(self.port.machine())
    }

    /// Whether COMMAND was 0 when it was read last.
    pub(crate) fn is_idle(&self, words: &Words) -> bool {
        words.word(self.slots.command) == 0
    }

    /// Whether it looks as if the whole board was reset: every channel that ran is stopped, without a
    /// STOP command. `None` if it has no remotes to tell by.
    pub(crate) fn appears_reset(&self) -> Option<bool> {
        self.recovery.appears_reset()
    }

    /// What was before a remote was armed is history.
    fn note_armed(&mut self, pins: &PinStore) {
        let marked = self.recovery.marked();
        if marked.is_empty() {
            return;
        }
        for Served { remote, .. } in &self.remotes {
            let channel = remote.started.channel;
            let state = pins.group_state(remote.pins.group());
            if marked.contains(channel) && state.is_some_and(|state| state.armed) {
                self.recovery.armed(channel);
            }
        }
    }

    /// All remotes were stopped, and the port was used for something else: they are restarted in the
    /// next cycles.
    pub(crate) fn taken_over(&mut self, pins: &mut PinStore, now: Instant) {
        self.port.machine_mut().taken_over();
        self.recovery.taken_over();
        for channel in self.recovery.known().iter() {
            self.restart(channel, pins, now);
        }
    }

    /// A parameter of a remote, the one at this place, was written and read back.
    pub(crate) fn parameter_written(
        &mut self,
        pins: &mut PinStore,
        channel: Channel,
        place: usize,
        raw: u64,
    ) {
        let mut remotes = self.remotes.iter_mut().map(|served| &mut served.remote);
        let Some(remote) = remotes.find(|remote| remote.started.channel == channel) else {
            return;
        };
        if let Some(parameter) = remote.pins.parameters_mut().get_mut(place) {
            parameter.publish(pins, raw);
        }
        self.recovery.set_watchdog(channel, remote.watchdog());
    }

    /// Restarts a remote in the next cycles, whatever its pause, but not before its outputs must
    /// be off: it clears the remote's faults. Its outputs are safe from now on until it is re-armed.
    pub(crate) fn restart(&mut self, channel: Channel, pins: &mut PinStore, now: Instant) {
        let is_it = |served: &&mut Served| served.remote.started.channel == channel;
        if let Some(served) = self.remotes.iter_mut().find(is_it) {
            served.lost(pins);
            self.recovery.restart_now(channel, now);
        }
    }
}

impl Module for SerialPort {
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        self.note_armed(cycle.pins);
        let seen = Seen {
            words: cycle.words,
            slots: &self.slots,
        };
        let machine = self.port.machine_mut();
        let outcome = self
            .recovery
            .observe(machine, cycle.now, &seen, cycle.certain);
        let stale_after = self.recovery.policy.stale_after;
        for served in &mut self.remotes {
            let channel = served.remote.started.channel;
            let group = served.remote.pins.group();
            if outcome.good.contains(channel) {
                served.take(cycle);
                let reads_before = u64::from(outcome.reads_before);
                cycle
                    .pins
                    .group_good_since(group, reads_before, outcome.started);
            } else if outcome.offline.contains(channel) {
                served.lost(cycle.pins);
            } else if outcome.failed.contains(channel) {
                cycle.pins.invalidate(group);
            } else {
                served.no_news(cycle.pins, stale_after);
            }
            let link = machine.link(channel);
            let remote = &mut served.remote;
            if let Some(health) = self.recovery.remote(channel) {
                if remote.is_absent && health.is_running() {
                    remote.plugged_in(link.told());
                }
                remote.fault_pins.publish(cycle.pins, health, link);
            }
        }
        self.pins.publish(cycle.pins, &self.recovery, machine);
        let report = &mut *cycle.report;
        report.good += outcome.good.len();
        report.failed += outcome.failed.len();
        report.offline += outcome.offline.len();
        report.too_short += u32::from(outcome.too_short);
    }

    fn not_read(&mut self, pins: &mut PinStore) {
        self.port.machine_mut().not_observed();
        let stale_after = self.recovery.policy.stale_after;
        for served in &mut self.remotes {
            served.no_news(pins, stale_after);
        }
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        self.pins.fetch(cycle.pins, &mut self.recovery);
        self.note_armed(cycle.pins);
        if !self.recovery.run {
            self.make_safe(cycle.pins);
        }
        let machine = self.port.machine_mut();
        let next = self.recovery.next(machine, cycle.now, cycle.hold);
        for served in &mut self.remotes {
            if next.with_data {
                served.put(cycle);
            } else if next.modes.contains(served.remote.started.channel) {
                served.put_mode(cycle);
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
        for served in &self.remotes {
            served.remote.pins.fault(pins);
        }
    }

    /// All remotes that do not run are restarted in the next cycles.
    fn restored(&mut self, pins: &mut PinStore, now: Instant) {
        self.port.machine_mut().doubt();
        for served in &mut self.remotes {
            served.remote.pins.restarted();
        }
        let not_running = self.recovery.known().difference(self.recovery.running());
        for channel in not_running.iter() {
            self.restart(channel, pins, now);
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
        self.remotes.iter().filter_map(|served| {
            let channel = served.remote.started.channel;
            Some(RemoteStatus {
                remote: &served.remote,
                health: self.recovery.remote(channel)?,
                link: self.port.machine().link(channel),
            })
        })
    }

    /// The remote on a channel.
    pub fn remote(&self, channel: Channel) -> Option<RemoteStatus<'_>> {
        self.remotes()
            .find(|status| status.started().channel == channel)
    }
}

impl Slots {
    fn register(&mut self, r: &mut Registrar<'_>, channel: Channel, registers: ChannelRegisters) {
        let index = usize::from(channel.index());
        if let Some(cs) = self.cs.get_mut(index) {
            *cs = r.input(registers.cs());
        }
        if let Some(told) = self.told.get_mut(index) {
            for (slot, address) in told.iter_mut().zip(registers.interfaces()) {
                *slot = r.extra_input(address);
            }
        }
    }
}

/// The registers of a port as a read brought them.
struct Seen<'a> {
    words: &'a Words,
    slots: &'a Slots,
}

impl Observed for Seen<'_> {
    fn command(&self) -> u32 {
        self.words.word(self.slots.command)
    }

    fn data(&self) -> u32 {
        self.words.word(self.slots.data)
    }

    fn cs(&self, channel: Channel) -> u32 {
        let slot = self.slots.cs.get(usize::from(channel.index()));
        slot.map_or(0, |&slot| self.words.word(slot))
    }

    fn told(&self, channel: Channel) -> [u32; 3] {
        let slots = self.slots.told.get(usize::from(channel.index()));
        slots.map_or([0; 3], |slots| slots.map(|slot| self.words.word(slot)))
    }
}
