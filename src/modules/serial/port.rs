//! A port with its registers in the image and its remotes' pins.

use alloc::vec::Vec;
use core::mem;
use core::time::Duration;

use super::life::{ChangeContext, LifeChange};
use super::parameter_writer::WrittenParameter;
use super::part::RemotePart;
use super::pins::PortPins;
use super::remote::Remote;
use super::remotes::Remotes;
use super::schedule::{Schedule, is_transferring};
use super::slot::RemoteSlot;
use super::watchdog::{HEARD, Queried};
use super::{PortStatistics, RemoteStatus, RemoteWatchdog};
use crate::bus::{ImagePlan, Instant, Phase, ReadSlot, Words, WriteSlot};
use crate::events::OfflineReason;
use crate::fraction::Fraction;
use crate::hal::{ArmingCondition, ArmingEvent, GroupId, PinStore};
use crate::modules::{Module, ReadCycle, RegisterError, Registrar, WriteCycle};
use crate::remote::ParameterWrite;
use crate::settings::FaultPolicy;
use crate::sslbp::{
    COMMAND_IGNORED, Channel, ChannelMask, ChannelRegisters, CsStatus, DoitTime, MAX_CHANNELS,
    PerChannel, Port, PortImage, PortLayout, PortOperation, PortParameters, TransferResult,
};
use crate::tally::Tally;

/// A serial port in the cycle.
#[derive(Debug)]
pub struct SerialPort {
    /// Call [`taken_over`](Self::taken_over) after using the port outside the cycle.
    pub(crate) port: Port,
    slots: Slots,
    doit: WriteSlot,
    schedule: Schedule,
    remotes: Remotes,
    pins: PortPins,
    /// Time of the last read.
    read_at: Instant,
    /// Duration of the port's transfers according to the sizes of its remotes.
    pub expected_time: DoitTime,
    /// The rest that the application asked for; the schedule's is at least three quarters of a
    /// period.
    asked_rest: Duration,
}

/// The rest of a remote with failures.
fn rest_at(period: Duration, asked: Duration) -> Duration {
    asked.max(period.fraction(3, 4))
}

/// Registers a remote of a port. One that is offline at the start is reported, unless it is absent,
/// which is no event.
fn register_remote(
    r: &mut Registrar<'_>,
    found: RemotePart,
    registers: ChannelRegisters,
    at: Instant,
    policy: &FaultPolicy,
) -> Result<Remote, RegisterError> {
    let (started, watchdog, offline) = (found.started, found.watchdog(), found.offline);
    let label = found.pins.label;
    let slot = RemoteSlot::register(r.image, r.pins, r.status, found, registers, at)?;
    let mut remote = Remote::new(started, watchdog, slot, policy);
    if let Some(reason) = offline {
        let (now, events) = (at, r.events);
        let change = remote.not_started(
            ChangeContext {
                now,
                policy,
                events,
            },
            reason,
        );
        if let Some(event) = change.event.filter(|_| reason != OfflineReason::Absent) {
            r.events.report(at, event.of(label));
        }
    }
    Ok(remote)
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
    pub remotes: Vec<RemotePart>,
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
        let mut all = Vec::new();
        for found in remotes {
            let channel = found.started.channel;
            let Some(registers) = layout.channel(channel) else {
                debug_assert!(false, "port {} has no channel {channel}", layout.instance);
                continue;
            };
            slots.register_channel(r.image, channel, registers);
            if found.offline.is_some() {
                port.machine.set_sizes(&found.started);
            }
            all.push(register_remote(r, found, registers, at, &policy)?);
        }
        let pins = PortPins::register(r, layout.instance)?;
        let mut schedule = Schedule::new(parameters, &policy, at);
        let changeable = all.iter().map(|remote| remote.slot.pins.parameters.len());
        schedule.reserve_requests(changeable.sum::<usize>().saturating_add(1));
        let remotes = Remotes::new(all, r.events.clone(), policy);
        let expected_time = port.doit_time(remotes.configured());
        Ok(Self {
            port,
            slots,
            doit,
            schedule,
            remotes,
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
            self.schedule.transfer_complete(&self.port.machine, now);
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
        let running = self.remotes.running();
        let seen = (words, &self.slots);
        let is_stopped = |channel| CsStatus(seen.cs(channel)).is_stopped();
        (!running.is_empty()).then(|| running.iter().all(is_stopped))
    }

    /// True if every remote that has run was found stopped, without a STOP command and since the
    /// board was set up; `None` if none has run.
    pub(crate) fn appears_reset(&self) -> Option<bool> {
        self.schedule.appears_reset(&self.remotes)
    }

    /// Clears the first fault of remotes whose outputs follow the application (again).
    fn note_armed(&mut self, pins: &PinStore, now: Instant) {
        let awaiting = self.remotes.awaiting_rearm();
        if awaiting.is_empty() {
            return;
        }
        self.remotes.change(awaiting, now, |remote, _| {
            let state = pins.group_state(remote.slot.pins.group);
            if state.is_some_and(|state| state.armed) {
                remote.life.armed()
            } else {
                LifeChange::default()
            }
        });
    }

    /// Restarts all remotes in the next cycles, after they were stopped and the port was used
    /// outside the cycle.
    pub(crate) fn taken_over(&mut self, pins: &mut PinStore, now: Instant) {
        self.port.machine.taken_over();
        self.schedule.taken_over(now);
        self.restart(self.remotes.configured(), pins, now);
    }

    /// Takes the value of a remote's parameter that was written and read back.
    pub(crate) fn parameter_written(
        &mut self,
        pins: &mut PinStore,
        channel: Channel,
        name: &str,
        raw: u64,
    ) {
        if let Some((slot, watchdog)) = self.remotes.slot(channel) {
            slot.pins.publish_parameter(pins, name, raw);
            *watchdog = RemoteWatchdog::of(&slot.pins);
        }
    }

    /// Takes the value of a parameter that the cycle has written.
    #[cold]
    fn parameter_ended(&mut self, pins: &mut PinStore, ended: WrittenParameter) {
        let WrittenParameter { write, kept } = ended;
        if let Some((slot, watchdog)) = self.remotes.slot(write.channel)
            && let Some(raw) = kept
            && let Some(parameter) = slot.pins.parameters.get_mut(usize::from(write.parameter))
        {
            parameter.publish(pins, raw);
            *watchdog = RemoteWatchdog::of(&slot.pins);
        }
    }

    /// Requests the write of a parameter when the port is switched on again.
    pub(crate) fn request_parameter(&mut self, write: ParameterWrite) {
        self.schedule.request(write);
    }

    /// Time for which nothing may be sent to the running remotes, so that their watchdogs must have
    /// bitten; `None` if no remote has a watchdog worth waiting for.
    pub(crate) fn silence(&self) -> Option<Duration> {
        let running = self.remotes.iter().filter(|r| r.life.is_running());
        let quick = running.filter(|remote| !remote.watchdog.is_slow());
        quick.map(|remote| remote.watchdog.silence()).max()
    }

    /// The channels whose remotes transfer, and will continue to. Remotes of a port that was
    /// switched off are about to stop, and their replies are not evaluated any more.
    pub(crate) fn running(&self) -> ChannelMask {
        if self.schedule.run {
            self.remotes.running()
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
    /// Returns the channel of a remote that was not heard, if there is one; nothing is known of its
    /// watchdog.
    pub(crate) fn judge_watchdogs(
        &mut self,
        asked: &Queried,
        silence: Duration,
        pins: &mut PinStore,
        now: Instant,
    ) -> Option<Channel> {
        let mut not_heard = None;
        let machine = &self.port.machine;
        self.remotes.change(asked.channels, now, |remote, _| {
            if !remote.watchdog.is_slow() {
                let link = machine.link(remote.channel());
                let heard = link.good.saturating_sub(asked.good[remote.channel()]);
                let is_faulty = matches!(link.verdict, TransferResult::Faulty(_));
                let is_heard = heard >= HEARD || is_faulty;
                if !remote.judge_watchdog(silence, is_heard) {
                    not_heard = Some(remote.channel());
                }
            }
            LifeChange::default()
        });
        let not_running = asked.channels.difference(self.remotes.running());
        self.restart(not_running, pins, now);
        not_heard
    }

    /// Arms the remotes that come up because the board has its set-up again, with their first good
    /// transfer. True if that is new for one of them.
    pub(crate) fn arm_with_board(&self, pins: &mut PinStore) -> bool {
        let event = ArmingEvent::Request(ArmingCondition::WithBoard);
        let slots = self.remotes.iter().map(|remote| &remote.slot);
        let with_board = slots.filter(|slot| slot.comes_with_board);
        with_board.fold(false, |is_new, slot| {
            pins.change_arming_of(slot.pins.group, event) | is_new
        })
    }

    /// True if the group is that of a remote of this port, and the port is switched off.
    pub(crate) fn is_off(&self, pins: &PinStore, group: GroupId) -> bool {
        let mut groups = self.remotes.iter().map(|remote| remote.slot.pins.group);
        groups.any(|own| own == group) && !self.pins.is_on(pins)
    }

    /// Ends the rows of failed transfers, and reports their numbers.
    pub(crate) fn end_rows(&mut self, now: Instant) {
        let all = self.remotes.configured();
        self.remotes.change(all, now, |remote, at| {
            remote.failures.end_row(at, remote.label());
            LifeChange::default()
        });
    }

    /// Puts what remotes get in a cycle without a transfer: with START their modes, and outputs
    /// where no transfer can be in flight, so that no packet that is on its way when a remote runs
    /// again has outputs of before.
    #[cold]
    fn put_between(&mut self, cycle: &mut WriteCycle<'_>, operation: Option<PortOperation>) {
        let is_idle = operation.is_none() && self.port.machine.is_idle();
        let in_flight = self
            .port
            .machine
            .in_flight()
            .map(|(operation, _)| operation);
        for (life, remote) in self.remotes.slots() {
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
            if is_idle || !life.is_running() {
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
        for (_, slot) in self.remotes.slots() {
            if mask.contains(slot.channel) {
                slot.make_safe(pins);
            }
        }
        self.remotes.change(mask, now, Remote::ask_for_restart);
    }
}

impl Module for SerialPort {
    fn read(&mut self, cycle: &mut ReadCycle<'_>) {
        self.note_armed(cycle.pins, cycle.now);
        let (machine, seen) = (&mut self.port.machine, (cycle.words, &self.slots));
        self.schedule.is_board_running = cycle.is_running;
        let remotes = &mut self.remotes;
        let outcome = self
            .schedule
            .observe(machine, remotes, cycle.now, &seen, cycle.certain);
        let last_read = mem::replace(&mut self.read_at, cycle.now);
        for (life, slot) in remotes.slots() {
            slot.is_confirmed = outcome.good.contains(slot.channel);
            if slot.is_confirmed {
                slot.take(cycle, &outcome);
            } else {
                slot.not_confirmed(life, cycle, &outcome, last_read);
            }
            let link = machine.link(slot.channel);
            slot.fault_pins.publish(cycle.pins, life, link);
        }
        if let Some(ended) = self.schedule.ended.take() {
            self.parameter_ended(cycle.pins, ended);
        }
        let (schedule, machine) = (&self.schedule, &self.port.machine);
        self.pins
            .publish(cycle.pins, schedule, &self.remotes, machine, cycle.now);
        let report = &mut *cycle.report;
        report.good.tally(outcome.good.len());
        report.failed.tally(outcome.failed.len());
        report.offline.tally(outcome.offline.len());
        report.too_short.tally(outcome.too_short.into());
    }

    fn not_read(&mut self, _: &mut PinStore) {
        self.port.machine.not_observed();
        for (_, slot) in self.remotes.slots() {
            slot.is_confirmed = false;
        }
    }

    fn write(&mut self, cycle: &mut WriteCycle<'_>) {
        self.pins
            .fetch(cycle.pins, &mut self.schedule, &mut self.remotes);
        self.note_armed(cycle.pins, cycle.now);
        if !self.schedule.run {
            for (_, slot) in self.remotes.slots() {
                slot.keep_safe(cycle);
            }
        }
        let (machine, remotes) = (&mut self.port.machine, &mut self.remotes);
        let operation = self.schedule.next(machine, remotes, cycle.now, cycle.hold);
        if let Some(PortOperation::Transfer(mask)) = operation {
            for (_, slot) in remotes.slots() {
                slot.put_transfer(cycle, mask.contains(slot.channel));
            }
        } else {
            self.put_between(cycle, operation);
        }
        let command = operation.map_or(COMMAND_IGNORED, |operation| operation.command());
        cycle.words.put(self.doit, command);
        if self.schedule.needs_start_data() {
            cycle.request_extra();
        }
    }

    fn set_period(&mut self, period: Duration, _: &mut PinStore) -> Result<(), RegisterError> {
        self.remotes.policy.rest = rest_at(period, self.asked_rest);
        Ok(())
    }

    fn written(&mut self, now: Instant, arrived: bool) {
        self.port.machine.written(now, arrived);
    }

    /// Fails all remotes together: inputs invalid, outputs safe until re-armed.
    fn make_safe(&mut self, pins: &mut PinStore) {
        for remote in self.remotes.iter() {
            pins.fault(remote.slot.pins.group);
        }
    }

    /// Restarts all remotes that do not run, in the next cycles.
    fn restored(&mut self, pins: &mut PinStore, now: Instant) {
        self.port.machine.doubt();
        for (life, slot) in self.remotes.slots() {
            slot.comes_with_board = life.is_of_board();
            slot.pins.restarted();
        }
        self.schedule.set_up_restored(&mut self.remotes, now);
        let not_running = self.remotes.configured().difference(self.remotes.running());
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
        &self.schedule.statistics
    }

    /// The remotes, by channel.
    pub fn remotes(&self) -> impl Iterator<Item = RemoteStatus<'_>> {
        let machine = &self.port.machine;
        let remotes = self.remotes.iter();
        remotes.map(|remote| remote.status(machine.link(remote.channel())))
    }

    /// Remotes that may have an output on which was on before the last write: the last read
    /// delivered no good transfer of their safe values, and no other evidence shows that all
    /// outputs are off. No frame has reached them since `silent_since`, if that is known.
    pub(crate) fn not_reached(
        &self,
        now: Instant,
        silent_since: Option<Instant>,
    ) -> impl Iterator<Item = RemoteStatus<'_>> {
        let machine = &self.port.machine;
        let not = self.remotes.iter().filter(move |remote| {
            let has_bitten = match (silent_since, remote.watchdog) {
                (Some(since), RemoteWatchdog::Known(_)) => {
                    since.after(remote.watchdog.silence()) <= now
                }
                _ => false,
            };
            let slot = &remote.slot;
            !slot.has_confirmed_safe() && !slot.outputs_state.are_off(now) && !has_bitten
        });
        not.map(|remote| remote.status(machine.link(remote.channel())))
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
