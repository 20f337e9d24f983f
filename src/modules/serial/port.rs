//! A port with its registers in the image and its remotes' pins.

use alloc::vec::Vec;
use core::mem;
use core::time::Duration;

use super::health::{Arming, Health};
use super::parameter_writer::WrittenParameter;
use super::pins::PortPins;
use super::recovery::{Recovery, is_transferring};
use super::remote::{FoundRemote, RemoteSlot};
use super::watchdog::{HEARD, OutputsState, Queried};
use super::{OfflineReason, PortStatistics, RemoteStatus, RemoteWatchdog};
use crate::bus::{ImagePlan, Instant, Phase, ReadSlot, Words, WriteSlot};
use crate::fraction::Fraction;
use crate::hal::{GroupId, PinStore};
use crate::hostmot2::RemoteId;
use crate::modules::{Module, ReadCycle, RegisterError, Registrar, WriteCycle};
use crate::remote::ParameterWrite;
use crate::sslbp::{
    COMMAND_IGNORED, Channel, ChannelMask, ChannelRegisters, CsStatus, DoitTime, MAX_CHANNELS,
    PerChannel, Port, PortImage, PortLayout, PortOperation, PortParameters, RemoteFaults,
    TransferResult,
};
use crate::tally::Tally;

/// A serial port in the cycle.
#[derive(Debug)]
pub struct SerialPort {
    /// Call [`taken_over`](Self::taken_over) after using the port outside the cycle.
    pub(crate) port: Port,
    slots: Slots,
    doit: WriteSlot,
    pub(crate) recovery: Recovery,
    remotes: Vec<RemoteSlot>,
    pins: PortPins,
    /// Time of the last read.
    read_at: Instant,
    /// Duration of the port's transfers according to the sizes of its remotes.
    pub expected_time: DoitTime,
    /// The rest that the application asked for; the recovery's is at least three quarters of a
    /// period.
    asked_rest: Duration,
}

/// The rest of a remote with failures.
fn rest_at(period: Duration, asked: Duration) -> Duration {
    asked.max(period.fraction(3, 4))
}

/// Positions of the registers of a port in the image. Registers of channels without a remote are
/// not read.
#[derive(Debug)]
struct Slots {
    command: ReadSlot,
    data: ReadSlot,
    /// CS and interface registers 0 to 2.
    channels: PerChannel<[ReadSlot; 4]>,
}

/// A port that runs in normal mode, with all its remotes started except those that are offline.
#[derive(Debug)]
pub(crate) struct StartedPort {
    pub port: Port,
    pub parameters: PortParameters,
    pub remotes: Vec<FoundRemote>,
    /// Time after the start.
    pub at: Instant,
}

impl Slots {
    /// Registers COMMAND and DATA.
    fn register(image: &mut ImagePlan, layout: PortLayout) -> Self {
        let command = image.read(Phase::Status, layout.command);
        Self {
            command,
            data: image.read(Phase::Data, layout.data()),
            channels: PerChannel([[command; 4]; MAX_CHANNELS as usize]),
        }
    }

    /// Registers CS and the interface registers of a channel.
    fn register_channel(&mut self, image: &mut ImagePlan, channel: Channel, at: ChannelRegisters) {
        let [cs, interfaces @ ..] = &mut self.channels[channel];
        *cs = image.read(Phase::Data, at.cs);
        for (slot, address) in interfaces.iter_mut().zip(at.interfaces()) {
            *slot = image.read_extra(Phase::Data, address);
        }
    }
}

impl SerialPort {
    /// Registers COMMAND, DATA, CS and the interface registers with process data. COMMAND is read
    /// before the data that it validates, and written after all data.
    pub(crate) fn register(
        r: &mut Registrar<'_>,
        started: StartedPort,
    ) -> Result<Self, RegisterError> {
        let StartedPort {
            mut port,
            parameters,
            remotes,
            at,
        } = started;
        let mut policy = r.settings.fault_policy;
        let asked_rest = policy.rest;
        policy.rest = rest_at(r.settings.period, asked_rest);
        let layout = *port.layout();
        let mut slots = Slots::register(r.image, layout);
        let doit = r
            .image
            .write(Phase::Trigger, layout.command, COMMAND_IGNORED);
        let (mut healths, mut served) = (Vec::new(), Vec::new());
        for remote in remotes {
            let channel = remote.started.channel;
            let Some(registers) = layout.channel(channel) else {
                debug_assert!(false, "port {} has no channel {channel}", layout.instance);
                continue;
            };
            slots.register_channel(r.image, channel, registers);
            let mut health = Health::new(remote.started, remote.watchdog(), &policy);
            let sink = Some((r.events.clone(), layout.instance));
            if let Some(reason) = remote.offline {
                port.machine.set_sizes(&remote.started);
                if !remote.is_absent() {
                    // That an optional remote is absent is no event.
                    health.event_sink.clone_from(&sink);
                }
                health = health.not_started(at, reason, &policy);
            }
            health.event_sink = sink;
            healths.push(health);
            served.push(RemoteSlot::register(r, remote, registers, at)?);
        }
        let pins = PortPins::register(r, layout.instance)?;
        let mut recovery = Recovery::new(healths, parameters, policy, at);
        let changeable = served.iter().map(|remote| remote.pins.parameters.len());
        recovery.reserve_requests(changeable.sum::<usize>().saturating_add(1));
        let expected_time = port.doit_time(recovery.known);
        Ok(Self {
            port,
            slots,
            doit,
            recovery,
            remotes: served,
            pins,
            read_at: at,
            expected_time,
            asked_rest,
        })
    }

    /// Notes the begin of the cycle's write: the commands in it may be executed from now on.
    pub(crate) fn sending(&mut self, now: Instant) {
        self.port.machine.sending(now);
    }

    /// Evaluates COMMAND alone: returns true if a transfer is complete, or none is in flight.
    pub(crate) fn poll(&mut self, words: &Words, now: Instant) -> bool {
        let is_complete = self.is_idle(words);
        if is_complete {
            self.recovery.transfer_complete(&self.port.machine, now);
        }
        is_complete || !is_transferring(&self.port.machine)
    }

    /// True if the last read of COMMAND was 0.
    pub(crate) fn is_idle(&self, words: &Words) -> bool {
        words.word(self.slots.command) == 0
    }

    /// True if the channels of all remotes that run read as stopped, which no bite does, and the
    /// driver has not stopped them; `None` if none runs.
    pub(crate) fn reads_stopped(&self, words: &Words) -> Option<bool> {
        let running = self.recovery.running();
        let seen = (words, &self.slots);
        let is_stopped = |channel| CsStatus(seen.cs(channel)).is_stopped();
        (!running.is_empty()).then(|| running.iter().all(is_stopped))
    }

    /// Clears the first fault of remotes whose outputs follow the application (again).
    fn note_armed(&mut self, pins: &PinStore, now: Instant) {
        let marked = self.recovery.marked();
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

    /// Restarts all remotes in the next cycles, after they were stopped and the port was used
    /// outside the cycle.
    pub(crate) fn taken_over(&mut self, pins: &mut PinStore, now: Instant) {
        self.port.machine.taken_over();
        self.recovery.taken_over(now);
        self.restart(self.recovery.known, pins, now);
    }

    /// Takes the value of a remote's parameter that was written and read back.
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

    /// Takes the value of a parameter that the cycle has written.
    #[cold]
    fn parameter_ended(&mut self, pins: &mut PinStore, ended: WrittenParameter) {
        let WrittenParameter { write, kept } = ended;
        let mut remotes = self.remotes.iter_mut().zip(&mut self.recovery.remotes);
        if let Some((remote, health)) = remotes.find(|(remote, _)| remote.channel == write.channel)
            && let Some(raw) = kept
            && let Some(parameter) = remote.pins.parameters.get_mut(usize::from(write.parameter))
        {
            parameter.publish(pins, raw);
            health.watchdog = RemoteWatchdog::of(&remote.pins);
        }
    }

    /// Requests the write of a parameter when the port is switched on again.
    pub(crate) fn request_parameter(&mut self, write: ParameterWrite) {
        self.recovery.request(write);
    }

    /// Time for which nothing may be sent to the running remotes, so that their watchdogs must have
    /// bitten; `None` if no remote has a watchdog worth waiting for.
    pub(crate) fn silence(&self) -> Option<Duration> {
        let running = self.recovery.remotes.iter().filter(|r| r.is_running());
        let quick = running.filter(|remote| !remote.watchdog.is_slow());
        quick.map(|remote| remote.watchdog.silence()).max()
    }

    /// The channels whose remotes transfer, and will continue to. Remotes of a port that was
    /// switched off are about to stop, and their replies are not evaluated any more.
    pub(crate) fn running(&self) -> ChannelMask {
        if self.recovery.run {
            self.recovery.running()
        } else {
            ChannelMask::NONE
        }
    }

    /// Notes the numbers of good transfers of the remotes to test, before they are queried.
    pub(crate) fn query(&self, channels: ChannelMask) -> Queried {
        let mut good = PerChannel::default();
        for channel in channels.iter() {
            good[channel] = self.port.machine.link(channel).good;
        }
        Queried { channels, good }
    }

    /// Judges the watchdogs of remotes that got no frame for their [silence](Self::silence), and
    /// were queried then: the watchdog of a remote that was heard and did not report its bite
    /// counts as off. Remotes that did are restarted. `silence` is the duration; a remote with a
    /// much shorter time of its own may use any time up to that.
    ///
    /// Returns the channel of a remote that was not heard, if there is one; nothing is known of its watchdog.
    pub(crate) fn judge_watchdogs(
        &mut self,
        asked: &Queried,
        silence: Duration,
        pins: &mut PinStore,
        now: Instant,
    ) -> Option<Channel> {
        let mut not_heard = None;
        for health in &mut self.recovery.remotes {
            let channel = health.channel();
            if !asked.channels.contains(channel) || health.watchdog.is_slow() {
                continue;
            }
            // Another fault may be the reason for going offline; the bite is reported beside it.
            let is_reported = health.faults.contains(RemoteFaults::WATCHDOG);
            let is_cause = health.cause == Some(OfflineReason::Watchdog);
            let has_bitten = (is_cause || is_reported) && !health.is_running();
            let link = self.port.machine.link(channel);
            let heard = link.good.saturating_sub(asked.good[channel]);
            let is_faulty = matches!(link.verdict, TransferResult::Faulty(_));
            let own = health.watchdog.silence();
            if has_bitten {
                if silence > own.fraction(5, 4) || health.watchdog == RemoteWatchdog::Assumed {
                    health.watchdog = RemoteWatchdog::Known(silence);
                }
            } else if heard >= HEARD || is_faulty {
                health.watchdog = RemoteWatchdog::Off;
            } else {
                not_heard = Some(channel);
            }
        }
        let not_running = asked.channels.difference(self.recovery.running());
        self.restart(not_running, pins, now);
        not_heard
    }

    /// Arms the remotes that come up because the board has its set-up again, with their first good
    /// transfer. True if that is new for one of them.
    pub(crate) fn arm_what_comes(&self, pins: &mut PinStore) -> bool {
        let remotes = self.remotes.iter().zip(&self.recovery.remotes);
        let coming = remotes.filter(|(_, health)| health.arming.comes_with_board);
        coming.fold(false, |is_news, (served, _)| {
            pins.arm_when_good(served.pins.group) | is_news
        })
    }

    /// True if the group is that of a remote of this port, and the port is switched off.
    pub(crate) fn is_off(&self, pins: &PinStore, group: GroupId) -> bool {
        let mut groups = self.remotes.iter().map(|served| served.pins.group);
        groups.any(|own| own == group) && !self.pins.is_on(pins)
    }

    /// Keeps all remotes of a port that is switched off safe: none is armed when it runs again.
    fn switched_off(&mut self, cycle: &mut WriteCycle<'_>) {
        for (remote, health) in self.remotes.iter().zip(&self.recovery.remotes) {
            if cycle.pins.not_awaited(remote.pins.group) {
                health.not_awaited(cycle.now);
            }
        }
        self.make_safe(cycle.pins);
    }

    /// Ends the rows of failed transfers, and reports their numbers.
    pub(crate) fn end_rows(&mut self, now: Instant) {
        for health in &mut self.recovery.remotes {
            health.end_row(now);
        }
    }

    /// Puts what remotes get in a cycle without a transfer: with START their modes, and outputs where
    /// no transfer can be in flight, so that no packet that is on its way when a remote runs again
    /// has outputs of before.
    #[cold]
    fn put_between(&mut self, cycle: &mut WriteCycle<'_>, operation: Option<PortOperation>) {
        let is_idle = operation.is_none() && self.port.machine.is_idle();
        let in_flight = self
            .port
            .machine
            .in_flight()
            .map(|(operation, _)| operation);
        for (remote, health) in self.remotes.iter_mut().zip(&self.recovery.remotes) {
            // The words of an access stay until it is complete.
            match operation.or(in_flight) {
                Some(PortOperation::Access(channel, access)) if channel == remote.channel => {
                    if operation.is_some() {
                        remote.put_access(cycle, access);
                    }
                    continue;
                }
                _ => {}
            }
            if is_idle || !health.is_running() {
                remote.put(cycle);
            }
            if let Some(PortOperation::Start(_, mask)) = operation
                && mask.contains(remote.channel)
            {
                remote.put_mode(cycle);
            }
        }
    }

    /// Restarts remotes in the next cycles, regardless of their pauses, but not before their
    /// outputs must be off; this clears their faults. Their outputs are safe from now on until they
    /// are re-armed.
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
        let last_read = mem::replace(&mut self.read_at, cycle.now);
        for (served, health) in self.remotes.iter_mut().zip(&mut self.recovery.remotes) {
            let (channel, group) = (served.channel, served.pins.group);
            served.is_confirmed = outcome.good.contains(channel);
            if served.is_confirmed {
                if !served.drives {
                    health.outputs = OutputsState::Off;
                }
                served.take(cycle);
                let due = cycle.pins.cycle().saturating_sub(reads_before);
                let (due, started) = served.unanswered.take().unwrap_or((due, outcome.started));
                let cycles = cycle.pins.cycle().saturating_sub(due);
                cycle.pins.group_good_since(group, cycles, started);
                health.arming = Arming::default();
            } else {
                served.not_confirmed(health, cycle, &outcome, last_read);
            }
            let link = machine.link(channel);
            served.fault_pins.publish(cycle.pins, health, link);
        }
        if let Some(ended) = self.recovery.ended.take() {
            self.parameter_ended(cycle.pins, ended);
        }
        let machine = &self.port.machine;
        self.pins
            .publish(cycle.pins, &self.recovery, machine, cycle.now);
        let report = &mut *cycle.report;
        report.good.tally(outcome.good.len());
        report.failed.tally(outcome.failed.len());
        report.offline.tally(outcome.offline.len());
        report.too_short.tally(outcome.too_short.into());
    }

    fn not_read(&mut self, _: &mut PinStore) {
        self.port.machine.not_observed();
        for served in &mut self.remotes {
            served.is_confirmed = false;
        }
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        self.pins.fetch(cycle.pins, &mut self.recovery);
        self.note_armed(cycle.pins, cycle.now);
        if !self.recovery.run {
            self.switched_off(cycle);
        }
        let machine = &mut self.port.machine;
        let operation = self.recovery.next(machine, cycle.now, cycle.hold);
        if let Some(PortOperation::Transfer(mask)) = operation {
            for (remote, health) in self.remotes.iter_mut().zip(&mut self.recovery.remotes) {
                remote.put(cycle);
                if remote.drives && mask.contains(remote.channel) {
                    health.outputs = OutputsState::Driven;
                }
            }
        } else {
            self.put_between(cycle, operation);
        }
        let command = operation.map_or(COMMAND_IGNORED, |operation| operation.command());
        cycle.words.put(self.doit, command);
        if self.recovery.needs_start_data() {
            cycle.request_extra();
        }
    }

    fn set_period(&mut self, period: Duration, _: &mut PinStore) -> Result<(), RegisterError> {
        self.recovery.policy.rest = rest_at(period, self.asked_rest);
        Ok(())
    }

    fn written(&mut self, now: Instant, arrived: bool) {
        self.port.machine.written(now, arrived);
    }

    /// Fails all remotes together: inputs invalid, outputs safe until re-armed.
    fn make_safe(&mut self, pins: &mut PinStore) {
        for remote in &self.remotes {
            pins.fault(remote.pins.group);
        }
    }

    /// Restarts all remotes that do not run, in the next cycles.
    fn restored(&mut self, pins: &mut PinStore, now: Instant) {
        self.port.machine.doubt();
        for health in &mut self.recovery.remotes {
            health.arming.comes_with_board = health.is_of_board();
        }
        for remote in &mut self.remotes {
            remote.pins.restarted();
        }
        self.recovery.set_up_again(now);
        let not_running = self.recovery.known.difference(self.recovery.running());
        self.restart(not_running, pins, now);
    }
}

/// Functions for applications.
impl SerialPort {
    /// The registers of the port.
    pub fn layout(&self) -> &PortLayout {
        self.port.layout()
    }

    /// The statistics so far.
    pub fn statistics(&self) -> &PortStatistics {
        &self.recovery.statistics
    }

    /// The remotes, by channel.
    pub fn remotes(&self) -> impl Iterator<Item = RemoteStatus<'_>> {
        let remotes = self.remotes.iter().zip(&self.recovery.remotes);
        remotes.map(|(served, health)| {
            let link = self.port.machine.link(served.channel);
            RemoteStatus {
                id: RemoteId::new(self.layout().instance, served.channel.index()),
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

    /// Remotes that may have an output on which was on before the last write: the last read
    /// delivered no good transfer of their safe values, and no other evidence shows that all outputs
    /// are off. No frame has reached them since `silent_since`, if that is known.
    pub(crate) fn not_reached(
        &self,
        now: Instant,
        silent_since: Option<Instant>,
    ) -> impl Iterator<Item = RemoteStatus<'_>> {
        let pairs = self.remotes.iter().zip(&self.recovery.remotes);
        let not = pairs.map(move |(served, health)| {
            let has_bitten = match (silent_since, health.watchdog) {
                (Some(since), RemoteWatchdog::Known(_)) => {
                    since.after(health.watchdog.silence()) <= now
                }
                _ => false,
            };
            !served.has_confirmed_safe() && !health.outputs.are_off(now) && !has_bitten
        });
        let not = self.remotes().zip(not);
        not.filter_map(|(status, is_not)| is_not.then_some(status))
    }

    /// The remote on a channel.
    pub fn remote(&self, channel: Channel) -> Option<RemoteStatus<'_>> {
        self.remotes()
            .find(|status| status.started.channel == channel)
    }
}

/// The registers of a port, as read.
impl PortImage for (&Words, &Slots) {
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

    fn interfaces(&self, channel: Channel) -> [u32; 3] {
        let [_, interfaces @ ..] = self.1.channels[channel];
        interfaces.map(|slot| self.0.word(slot))
    }
}
