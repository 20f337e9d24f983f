//! A port with its registers in the image and its remotes' pins.

use alloc::vec::Vec;
use core::time::Duration;

use super::health::Health;
use super::pins::PortPins;
use super::recovery::{Recovery, is_transferring};
use super::remote::{FoundRemote, Served};
use super::watchdog::Outputs;
use super::{OfflineReason, PortStatistics, RemoteStatus, RemoteWatchdog};
use crate::bus::{Instant, Phase, ReadSlot, Words, WriteSlot};
use crate::fraction::Fraction;
use crate::hal::PinStore;
use crate::modules::{Module, ReadCycle, RegisterError, Registrar, WriteCycle};
use crate::sslbp::{
    COMMAND_IGNORED, Channel, ChannelMask, DoitTime, Layout, MAX_CHANNELS, Observed, Operation,
    PerChannel, Port, PortParameters, RemoteFaults,
};
use crate::tally::Tally;

/// A serial port in the cycle.
#[derive(Debug)]
pub struct SerialPort {
    /// Whoever uses it for something else calls [`taken_over`](Self::taken_over) then.
    pub(crate) port: Port,
    slots: Slots,
    doit: WriteSlot,
    pub(crate) recovery: Recovery,
    remotes: Vec<Served>,
    pins: PortPins,
    /// How long its transfers take according to the remotes' sizes.
    pub expected_time: DoitTime,
}

/// Where the registers of a port are in the image. Those of channels without a remote are not asked
/// for.
#[derive(Debug)]
struct Slots {
    command: ReadSlot,
    data: ReadSlot,
    /// CS and interface registers 0 to 2.
    channels: PerChannel<[ReadSlot; 4]>,
}

impl SerialPort {
    /// Registers COMMAND, DATA, CS and the interface registers that carry data. COMMAND is read
    /// before the data it vouches for, and written after all data. `port` runs in normal mode, with
    /// all `remotes` started but those that are absent.
    pub(crate) fn register(
        r: &mut Registrar<'_>,
        (mut port, parameters): (Port, PortParameters),
        remotes: Vec<FoundRemote>,
        now: Instant,
    ) -> Result<Self, RegisterError> {
        let policy = r.settings.fault_policy;
        let layout = *port.layout();
        let command = r.image.read(Phase::Status, layout.command);
        let mut slots = Slots {
            command,
            data: r.image.read(Phase::Data, layout.data()),
            channels: PerChannel([[command; 4]; MAX_CHANNELS as usize]),
        };
        let doit = r
            .image
            .write(Phase::Trigger, layout.command, COMMAND_IGNORED);
        let (mut healths, mut served) = (Vec::new(), Vec::new());
        for remote in remotes {
            let (started, is_absent) = (remote.started, remote.is_absent);
            let channel = started.channel;
            let Some(registers) = layout.channel(channel) else {
                debug_assert!(false, "port {} has no channel {channel}", layout.instance);
                continue;
            };
            let [cs, told @ ..] = &mut slots.channels[channel];
            *cs = r.image.read(Phase::Data, registers.cs);
            for (slot, address) in told.iter_mut().zip(registers.interfaces()) {
                *slot = r.image.read_extra(Phase::Data, address);
            }
            let remote = Served::register(r, remote, registers)?;
            let mut health = Health::new(started, RemoteWatchdog::of(&remote.pins), &policy);
            if is_absent {
                port.machine.set_sizes(&started);
                health = health.absent(now, &policy);
            }
            health.told = Some((r.events.clone(), layout.instance));
            healths.push(health);
            served.push(remote);
        }
        let pins = PortPins::register(r, layout.instance)?;
        let recovery = Recovery::new(healths, parameters, policy, now);
        let expected_time = port.doit_time(recovery.known);
        Ok(Self {
            port,
            slots,
            doit,
            recovery,
            remotes: served,
            pins,
            expected_time,
        })
    }

    /// The write of the cycle begins: what it starts may be executed from now on.
    pub(crate) fn sending(&mut self, now: Instant) {
        self.port.machine.sending(now);
    }

    /// Looks at COMMAND alone: whether a transfer is complete, or none is in flight.
    pub(crate) fn poll(&mut self, words: &Words, now: Instant) -> bool {
        let is_complete = self.is_idle(words);
        if is_complete {
            self.recovery.transfer_complete(&self.port.machine, now);
        }
        is_complete || !is_transferring(&self.port.machine)
    }

    /// Whether COMMAND was 0 when it was read last.
    pub(crate) fn is_idle(&self, words: &Words) -> bool {
        words.word(self.slots.command) == 0
    }

    /// What was before the outputs of a remote follow the application (again) is history.
    fn note_armed(&mut self, pins: &PinStore, now: Instant) {
        let marked = self.recovery.marked;
        if marked.is_empty() {
            return;
        }
        for (served, health) in self.remotes.iter().zip(&mut self.recovery.remotes) {
            let state = pins.group_state(served.pins.group);
            if marked.contains(served.channel) && state.is_some_and(|state| state.armed) {
                health.armed(now);
            }
        }
        self.recovery.update();
    }

    /// All remotes were stopped, and the port was used for something else: they are restarted in the
    /// next cycles.
    pub(crate) fn taken_over(&mut self, pins: &mut PinStore, now: Instant) {
        self.port.machine.taken_over();
        self.recovery.taken_over();
        self.restart(self.recovery.known, pins, now);
    }

    /// A parameter of a remote was written and read back.
    pub(crate) fn parameter_written(
        &mut self,
        pins: &mut PinStore,
        channel: Channel,
        name: &str,
        raw: u64,
    ) {
        let mut remotes = self.remotes.iter_mut().zip(&mut self.recovery.remotes);
        if let Some((remote, health)) = remotes.find(|(remote, _)| remote.channel == channel) {
            remote.pins.publish_parameter(pins, name, raw);
            health.watchdog = RemoteWatchdog::of(&remote.pins);
        }
    }

    /// How long nothing may be sent to the remotes that run, so that their watchdogs must have bitten;
    /// `None` if there is none whose watchdog is waited for.
    pub(crate) fn silence(&self) -> Option<Duration> {
        let running = self.recovery.remotes.iter().filter(|r| r.is_running());
        let quick = running.filter(|remote| !remote.watchdog.is_slow());
        quick.map(|remote| remote.watchdog.silence()).max()
    }

    /// The channels whose remotes transfer, and go on to. Those of a port that was switched off are about
    /// to stop: nobody asks them any more.
    pub(crate) fn running(&self) -> ChannelMask {
        if self.recovery.run {
            self.recovery.running
        } else {
            ChannelMask::NONE
        }
    }

    /// Nothing was sent to these remotes for their [silence](Self::silence), and then they were asked:
    /// the watchdog of one that did not report its bite counts as off. Those that did are restarted.
    /// `silence` is for how long; one whose own time is much shorter may use any up to that.
    pub(crate) fn judge_watchdogs(
        &mut self,
        asked: ChannelMask,
        silence: Duration,
        pins: &mut PinStore,
        now: Instant,
    ) {
        for health in &mut self.recovery.remotes {
            if !asked.contains(health.channel()) || health.watchdog.is_slow() {
                continue;
            }
            // Beside another fault, which is why it went offline, the bite is told as well.
            let is_told = health.faults.contains(RemoteFaults::WATCHDOG);
            let is_cause = health.cause == Some(OfflineReason::Watchdog);
            let has_bitten = (is_cause || is_told) && !health.is_running();
            let own = health.watchdog.silence();
            if !has_bitten {
                health.watchdog = RemoteWatchdog::Off;
            } else if silence > own.fraction(5, 4) || health.watchdog == RemoteWatchdog::Assumed {
                health.watchdog = RemoteWatchdog::Known(silence);
            }
        }
        let not_running = asked.difference(self.recovery.running);
        self.restart(not_running, pins, now);
    }

    /// Remotes that come up because the board has its set-up again are armed with their first good
    /// transfer. True if that is new of one.
    pub(crate) fn arm_what_comes(&self, pins: &mut PinStore) -> bool {
        let remotes = self.remotes.iter().zip(&self.recovery.remotes);
        let coming = remotes.filter(|(_, health)| health.comes_with_board);
        coming.fold(false, |is_news, (served, _)| {
            pins.arm_when_good(served.pins.group) | is_news
        })
    }

    /// Nothing comes any more: failed transfers that were not told are told now.
    pub(crate) fn end_rows(&mut self, now: Instant) {
        for health in &mut self.recovery.remotes {
            health.end_row(now);
        }
    }

    /// Restarts remotes in the next cycles, whatever their pauses, but not before their outputs must
    /// be off: it clears their faults. Their outputs are safe from now on until they are re-armed.
    pub(crate) fn restart(&mut self, mask: ChannelMask, pins: &mut PinStore, now: Instant) {
        for remote in &mut self.remotes {
            if mask.contains(remote.channel) {
                remote.lost(pins);
            }
        }
        self.recovery.restart_now(mask, now);
    }
}

impl Module for SerialPort {
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        self.note_armed(cycle.pins, cycle.now);
        let (machine, seen) = (&mut self.port.machine, (cycle.words, &self.slots));
        self.recovery.is_board_running = cycle.is_running;
        let outcome = self
            .recovery
            .observe(machine, cycle.now, &seen, cycle.certain);
        let reads_before = u64::from(outcome.reads_before);
        for (served, health) in self.remotes.iter_mut().zip(&mut self.recovery.remotes) {
            let (channel, group) = (served.channel, served.pins.group);
            served.has_news = outcome.good.contains(channel);
            if served.has_news {
                if !served.drives {
                    health.outputs = Outputs::Off;
                }
                served.take(cycle);
                let due = cycle.pins.cycle().saturating_sub(reads_before);
                // The reply can be the late one to the transfer that failed before: nothing on the
                // wire numbers them (FACTS 5.4).
                let (due, started) = served.unanswered.take().unwrap_or((due, outcome.started));
                let cycles = cycle.pins.cycle().saturating_sub(due);
                cycle.pins.group_good_since(group, cycles, started);
                health.comes_with_board = false;
            } else if outcome.offline.contains(channel) {
                let is_awaited = health.is_of_board() && cycle.pins.is_awaited(group);
                served.lost(cycle.pins);
                if is_awaited {
                    cycle.pins.arm_when_good(group);
                }
            } else if outcome.failed.contains(channel) {
                cycle.pins.invalidate(group);
                let due = cycle.pins.cycle().saturating_sub(reads_before);
                served.unanswered = Some((due, outcome.started));
            }
            if health.comes_with_board && !health.is_of_board() {
                // A fault of its own voids what it was to be armed by.
                health.comes_with_board = false;
                cycle.pins.disarm(group);
            }
            let link = machine.link(channel);
            served.fault_pins.publish(cycle.pins, health, link);
        }
        self.pins.publish(cycle.pins, &self.recovery, machine);
        let report = &mut *cycle.report;
        report.good.tally(outcome.good.len());
        report.failed.tally(outcome.failed.len());
        report.offline.tally(outcome.offline.len());
        report.too_short.tally(outcome.too_short.into());
    }

    fn not_read(&mut self, _: &mut PinStore) {
        self.port.machine.not_observed();
        for served in &mut self.remotes {
            served.has_news = false;
        }
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        self.pins.fetch(cycle.pins, &mut self.recovery);
        self.note_armed(cycle.pins, cycle.now);
        if !self.recovery.run {
            self.make_safe(cycle.pins);
        }
        let machine = &mut self.port.machine;
        let operation = self.recovery.next(machine, cycle.now, cycle.hold);
        for (remote, health) in self.remotes.iter_mut().zip(&mut self.recovery.remotes) {
            match operation {
                Some(Operation::Transfer(mask)) => {
                    remote.put(cycle);
                    if remote.drives && mask.contains(remote.channel) {
                        health.outputs = Outputs::Driven;
                    }
                }
                Some(Operation::Start(_, mask)) if mask.contains(remote.channel) => {
                    remote.put_mode(cycle);
                }
                _ => {}
            }
        }
        let command = operation.map_or(COMMAND_IGNORED, |operation| operation.command());
        cycle.words.put(self.doit, command);
        if self.recovery.needs_start_data() {
            cycle.ask_extra();
        }
    }

    fn written(&mut self, now: Instant, arrived: bool) {
        self.port.machine.written(now, arrived);
    }

    /// All its remotes fail together: inputs not valid, outputs safe until re-armed.
    fn make_safe(&mut self, pins: &mut PinStore) {
        for remote in &self.remotes {
            pins.fault(remote.pins.group);
        }
    }

    /// All remotes that do not run are restarted in the next cycles.
    fn restored(&mut self, pins: &mut PinStore, now: Instant) {
        self.port.machine.doubt();
        for health in &mut self.recovery.remotes {
            health.comes_with_board = health.is_of_board();
        }
        for remote in &mut self.remotes {
            remote.pins.restarted();
        }
        self.recovery.set_up_again();
        let not_running = self.recovery.known.difference(self.recovery.running);
        self.restart(not_running, pins, now);
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

    /// Its remotes, by channel.
    pub fn remotes(&self) -> impl Iterator<Item = RemoteStatus<'_>> {
        let remotes = self.remotes.iter().zip(&self.recovery.remotes);
        remotes.map(|(served, health)| {
            let link = self.port.machine.link(served.channel);
            RemoteStatus {
                started: &health.started,
                descriptor: &served.descriptor,
                pins: &served.pins,
                state: health.state,
                first_fault: health.first_fault,
                watchdog: health.watchdog,
                faults: health.faults,
                transfers: link.transfers,
                failures: &link.failures,
                restarts: health.restarts,
            }
        })
    }

    /// Remotes that may have an output on which was on before the last write: the last read brought no
    /// good transfer of theirs, and nothing else says that all are off.
    pub(crate) fn not_reached(&self, now: Instant) -> impl Iterator<Item = RemoteStatus<'_>> {
        let pairs = self.remotes.iter().zip(&self.recovery.remotes);
        let not =
            pairs.map(move |(served, health)| !served.has_news && !health.outputs.are_off(now));
        let not = self.remotes().zip(not);
        not.filter_map(|(status, is_not)| is_not.then_some(status))
    }

    /// The remote on a channel.
    pub fn remote(&self, channel: Channel) -> Option<RemoteStatus<'_>> {
        self.remotes()
            .find(|status| status.started.channel == channel)
    }
}

/// The registers of a port as a read brought them.
impl Observed for (&Words, &Slots) {
    fn command(&self) -> u32 {
        self.0.word(self.1.command)
    }

    fn data(&self) -> u32 {
        self.0.word(self.1.data)
    }

    fn cs(&self, channel: Channel) -> u32 {
        let [cs, ..] = self.1.channels[channel];
        self.0.word(cs)
    }

    fn told(&self, channel: Channel) -> [u32; 3] {
        let [_, told @ ..] = self.1.channels[channel];
        told.map(|slot| self.0.word(slot))
    }
}
