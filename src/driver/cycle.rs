//! The cycle, without a bus: evaluates reads, and decides [what to write](write).

mod order;
mod rearm;
mod set_up;
mod write;

pub(super) use order::{CycleWrite, Exchange, Next, Outcome, Separate};

use core::time::Duration;

use super::arrival::ArrivalClock;
use super::parts::Parts;
use super::rows::EventRows;
use super::{BoardState, CycleError, CycleReport, DriverStatistics, EventKind, SerialPort};
use crate::bus::{Instant, Reply, Words};
use crate::events::EventSink;
use crate::hal::{ArmingEvent, GroupId, Input, PinStore};
use crate::modules::dpll::Dpll;
use crate::modules::watchdog::EvidenceRead;
use crate::modules::{Module, Outage, ReadCycle, RunOnCycle};
use crate::tally::Tally;
use order::{Order, Then};

/// Writes after a fault before a set-up that a pin asks for: a packet from before the fault that a
/// network delivers late, or twice, would drive the outputs that are set up.
const QUIET_WRITES: u32 = 4;

/// How far what was read proves that the board is still set up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Evidence {
    /// The last read has confirmed the last write.
    Certain,
    /// An event since the last full check may have masked a reset: the next read includes the extra
    /// evidence registers.
    Doubtful,
    /// Settings that drive pins were sent, and no evidence has been read since.
    Unproven,
}

/// All parts of the cycle, and the state of the board: a state machine without a bus.
///
/// # Calls and their order
/// 1. An operation begins with one of [`begin_read`](Self::begin_read),
///    [`begin_write`](Self::begin_write), [`begin_set_up`](Self::begin_set_up),
///    [`begin_identification`](Self::begin_identification) and
///    [`begin_following`](Self::begin_following). Each returns the [`Next`] step.
/// 2. If that is an [`Order`], the driver does its exchange with [`words`](Self::words), and passes
///    the order back with the outcome: [`after`](Self::after) consumes it, and returns the next
///    step. Only the cycle makes an order, so no outcome can be passed twice or for another
///    exchange.
/// 3. At the [end](Next::End) the operation has a result. After a good read, the report is in
///    [`report`](Self::report).
///
/// Everything else is called between two operations: access to pins and parts, re-arming
/// ([`rearm`](Self::rearm), [`rearm_when_running`](Self::rearm_when_running)),
/// [`make_safe`](Self::make_safe), [`look_closely`](Self::look_closely), and questions. An
/// operation that is given up between two steps leaves the board as after a failed exchange; only
/// [`end`](Self::end) is called after it.
///
/// # Real time
/// No function allocates, and each takes a bounded time.
#[derive(Debug)]
pub(super) struct BoardCycle {
    pub words: Words,
    pub pins: PinStore,
    /// The group of the board's own pins.
    pub group: GroupId,
    pub parts: Parts,
    pub statistics: DriverStatistics,
    pub events: EventSink,
    /// The report of the last good read.
    pub report: CycleReport,
    arrivals: ArrivalClock,
    /// Lateness of the last read for the phase-locked loop.
    phase_error_us: Option<Input<f64>>,
    state: BoardState,
    /// What has happened to a board that is not set up.
    outage: Outage,
    /// Time of the request of the last read.
    asked: Instant,
    /// The state that was published last.
    shown: Option<BoardState>,
    /// The application has asked for the set-up that the board has lost: by a call, or by clearing
    /// the flag that shows the fault.
    is_set_up_wanted: bool,
    rows: EventRows,
    /// [`DriverStatistics::read_errors`] at the last good read, or the last set-up: those since
    /// then are consecutive.
    old_read_errors: u64,
    /// Consecutive failed writes.
    write_failures: u32,
    /// Writes since the last read, including the one that belongs to it.
    writes_since_read: u32,
    evidence: Evidence,
    /// Writes that are left of [`QUIET_WRITES`].
    quiet_writes: u32,
    /// A module asked for the extra registers with the last write.
    wants_extra: bool,
    /// Remotes get safe values for the last time, and no restart takes the place of that transfer.
    pub is_last: bool,
}

impl BoardCycle {
    /// A board that has just been set up, with all outputs off.
    pub fn new(
        words: Words,
        pins: PinStore,
        group: GroupId,
        parts: Parts,
        events: EventSink,
        arrivals: ArrivalClock,
    ) -> Self {
        let dpll = parts.of::<Dpll>().next();
        Self {
            phase_error_us: dpll.map(|dpll| dpll.pins.phase_error_us),
            words,
            pins,
            group,
            parts,
            statistics: DriverStatistics::default(),
            events,
            report: CycleReport::default(),
            arrivals,
            state: BoardState::Running,
            outage: Outage::default(),
            asked: Instant::default(),
            shown: None,
            is_set_up_wanted: false,
            rows: EventRows::default(),
            old_read_errors: 0,
            write_failures: 0,
            writes_since_read: 0,
            evidence: Evidence::Doubtful,
            quiet_writes: 0,
            wants_extra: false,
            is_last: false,
        }
    }

    pub fn state(&self) -> BoardState {
        self.state
    }

    pub fn is_running(&self) -> bool {
        self.state == BoardState::Running
    }

    /// True if the state is an error of the connection, which the application clears to continue.
    const fn has_error(&self) -> bool {
        !matches!(self.state, BoardState::Running | BoardState::WatchdogBitten)
    }

    /// Requests the extra evidence registers, after an event that may have masked a reset.
    pub fn look_closely(&mut self) {
        self.evidence = self.evidence.max(Evidence::Doubtful);
    }

    /// True if the last read has confirmed the last write, and all evidence.
    pub fn is_sure(&self) -> bool {
        self.evidence == Evidence::Certain
    }

    /// True if the next read must include the extra registers.
    pub fn wants_closer_look(&self) -> bool {
        !self.is_sure() || self.wants_extra
    }

    /// The deadline of a reply, if the application has changed it.
    pub fn new_deadline(&mut self, period: Duration) -> Option<Duration> {
        self.parts.connection.new_deadline(&self.pins, period)
    }

    /// Checks that the registers were read from a `HostMot2`; the error is the word in place of its
    /// cookie.
    fn check(&self) -> Result<(), u32> {
        self.parts.connection.check(&self.words)
    }

    /// Ends all rows and the events at `now`.
    pub fn end(&mut self, now: Instant) {
        self.rows.end(&self.events, now);
        for port in &mut self.parts.ports {
            port.end_rows(now);
        }
        self.events.end();
    }
}

/// Operations.
impl BoardCycle {
    /// Begins a read.
    pub fn begin_read(&mut self) -> Next {
        self.statistics.reads.tally(1);
        self.writes_since_read = 0;
        self.events.begin_cycle(self.statistics.reads);
        let extra = self.wants_closer_look();
        Next::order(Exchange::Read { extra }, Then::Read)
    }

    /// Begins to read a board that waits to be re-armed; `None` for one that runs, or in whose
    /// place another one has answered.
    pub fn begin_following(&self) -> Option<Next> {
        let is_read = !matches!(self.state, BoardState::Running | BoardState::OtherFirmware);
        is_read.then(|| Next::separate(Separate::Everything, Then::Follow))
    }

    /// Continues the operation that has ordered an exchange, after that has ended with this
    /// `outcome`. `now` is the present time; the inputs of a read have their age from it.
    #[inline]
    pub fn after(&mut self, order: Order, outcome: Outcome, now: Instant) -> Next {
        match order.then {
            Then::Read => Next::End(self.after_read(outcome, now)),
            Then::Write => Next::End(self.after_write(outcome, now)),
            Then::Release => self.end_without_write(now),
            Then::Guard(step) => self.after_guard(&step, outcome, now),
            Then::Follow => Next::End(self.after_following(outcome, now)),
            Then::SetUp(set_up) => self.after_set_up(set_up, outcome, now),
        }
    }
}

/// A read.
impl BoardCycle {
    fn after_read(&mut self, outcome: Outcome, now: Instant) -> Result<(), CycleError> {
        self.asked = outcome.from;
        self.pins.begin_cycle(now);
        if let Err(source) = outcome.result {
            let why = source.kind();
            let consecutive = self.count_failed_read(now, EventKind::ReadFailed { why });
            return Err(CycleError::Read {
                source,
                consecutive,
            });
        }
        if let Err(found) = self.check() {
            let consecutive = self.count_failed_read(now, EventKind::NotThere { found });
            return Err(CycleError::NotThere { found, consecutive });
        }
        self.old_read_errors = self.statistics.read_errors;
        self.parts.connection.count_exchange(&mut self.pins, false);
        self.report = self.take(now, outcome.at, outcome.extra);
        Ok(())
    }

    /// Handles a read without inputs; returns the number of consecutive ones.
    fn count_failed_read(&mut self, now: Instant, what: EventKind) -> u32 {
        self.rows.failed_reads.add(&self.events, now, 1, what);
        self.statistics.read_errors.tally(1);
        self.look_closely();
        self.not_read();
        if self.parts.connection.count_exchange(&mut self.pins, true) {
            self.fail(now, BoardState::BusDown);
        }
        self.publish();
        self.failed_reads()
    }

    /// Number of consecutive failed reads.
    fn failed_reads(&self) -> u32 {
        let errors = self.statistics.read_errors;
        u32::try_from(errors.saturating_sub(self.old_read_errors)).unwrap_or(u32::MAX)
    }

    /// Lets every module take its inputs from the valid image read at `at`.
    fn take(&mut self, now: Instant, at: Instant, closely: bool) -> CycleReport {
        let reply = self.words.take_replies();
        let certain = reply.certain;
        self.words.confirm(certain);
        self.evidence = if certain && (closely || self.is_sure()) {
            Evidence::Certain
        } else {
            Evidence::Doubtful
        };
        let arrival = self.arrivals.arrived(at, reply.slack);
        let mut report = CycleReport {
            lost_writes: reply.lost_writes.into(),
            foreign_packets: reply.foreign_packets,
            missed_periods: arrival.missed,
            unpaced: arrival.is_unpaced,
            slack: reply.slack,
            ..CycleReport::default()
        };
        self.count(at, &reply, &report);
        let was_running = self.is_running();
        let read = EvidenceRead {
            words: &self.words,
            at,
            closely,
            is_certain: certain,
        };
        let finding = self.parts.watchdog.examine(&read);
        self.apply_finding(now, finding);
        self.note_bite(finding, certain || reply.lost_writes == 0);
        // With bad evidence, the inputs are not those of a board that is set up.
        if was_running && !self.is_running() {
            self.not_read();
        } else {
            self.take_parts(now, at, certain, &mut report);
        }
        if self.is_running() {
            let error = self.phase_error_us.map(|pin| self.pins.read(pin).value);
            report.locked =
                error.is_some_and(|error| self.arrivals.lock(arrival, reply.slack, error));
        } else {
            self.arrivals.unlock();
            self.make_safe();
            self.run_on(at);
        }
        self.publish();
        report.board = self.state;
        report
    }

    /// Counts and reports the bus errors of a read.
    fn count(&mut self, at: Instant, reply: &Reply, report: &CycleReport) {
        self.statistics.lost_writes.tally(report.lost_writes);
        self.statistics.missed_periods.tally(report.missed_periods);
        self.statistics.unpaced_cycles.tally(report.unpaced.into());
        let events = &self.events;
        if reply.lost_writes > 0 {
            let (count, row) = (reply.lost_writes, &mut self.rows.lost_writes);
            row.add(events, at, count, EventKind::LostWrites { count });
        }
        if reply.foreign_packets > 0 {
            self.statistics
                .foreign_packets
                .tally(reply.foreign_packets.into());
            let (packets, row) = (reply.foreign_packets, &mut self.rows.foreign_packets);
            row.add(events, at, packets, EventKind::OtherMaster { packets });
        }
        if report.missed_periods > 0 {
            let count = u32::try_from(report.missed_periods).unwrap_or(u32::MAX);
            let row = &mut self.rows.missed_periods;
            row.add(events, at, count, EventKind::MissedPeriods { count });
        }
        self.rows.look(events, at);
    }

    /// Lets the serial ports read first, because they may find that the board was reset.
    fn take_parts(&mut self, now: Instant, at: Instant, certain: bool, report: &mut CycleReport) {
        let is_running = self.is_running();
        let mut cycle = ReadCycle {
            words: &self.words,
            pins: &mut self.pins,
            asked: self.asked,
            now: at,
            certain,
            is_running,
            report,
            events: &self.events,
        };
        for port in &mut self.parts.ports {
            port.read(&mut cycle);
        }
        if appears_reset(&self.parts.ports) {
            self.fail(now, BoardState::Reset);
        } else if is_running {
            for part in &mut self.parts.modules {
                part.module.read(&mut cycle);
            }
            self.pins.group_good_since(self.group, 0, at);
        }
    }

    /// Lets every module follow what runs on in a board that is not set up.
    fn run_on(&mut self, at: Instant) {
        if self.state == BoardState::OtherFirmware {
            return;
        }
        self.outage.shows_bite = self.parts.watchdog.shows_bite(&self.words);
        let cycle = RunOnCycle {
            words: &self.words,
            asked: self.asked,
            now: at,
            outage: &self.outage,
        };
        for part in &mut self.parts.modules {
            part.module.run_on(&cycle);
        }
    }

    fn not_read(&mut self) {
        for part in self.parts.each() {
            part.not_read(&mut self.pins);
        }
    }
}

/// Set-up.
impl BoardCycle {
    /// Replaces the clock by that of another period.
    pub fn change_clock(&mut self, arrivals: ArrivalClock) {
        self.arrivals = arrivals;
        self.parts.connection.forget_deadline();
    }
}

/// Safe states and recovery.
impl BoardCycle {
    /// Evaluates a separate read of all evidence. Makes everything safe if the board is not set up
    /// any more.
    fn evidence_read(&mut self, now: Instant) {
        self.examine(now, true, false);
    }

    fn examine(&mut self, now: Instant, is_certain: bool, have_all_arrived: bool) {
        self.evidence = self.evidence.min(Evidence::Doubtful);
        let read = EvidenceRead {
            words: &self.words,
            at: now,
            closely: true,
            is_certain,
        };
        let finding = self.parts.watchdog.examine(&read);
        self.apply_finding(now, finding);
        self.note_bite(finding, have_all_arrived);
    }

    /// Evaluates a separate read of all registers of a board that waits to be re-armed.
    fn after_following(&mut self, outcome: Outcome, now: Instant) -> Result<(), CycleError> {
        self.asked = outcome.from;
        let consecutive = self.failed_reads();
        let failed = |source| CycleError::Read {
            source,
            consecutive,
        };
        outcome.result.map_err(failed)?;
        let absent = |found| CycleError::NotThere { found, consecutive };
        self.check().map_err(absent)?;
        let replies = self.words.replies();
        let certain = replies.certain;
        self.examine(now, certain, certain || replies.lost_writes == 0);
        self.run_on(now);
        self.publish();
        Ok(())
    }

    /// Makes everything safe if the board is not set up any more.
    fn apply_finding(&mut self, now: Instant, failure: Option<BoardState>) {
        if let Some(mut state) = failure {
            // The first write after a reset makes the watchdog bite. A bite alone stops no channel.
            let ports = self.parts.ports.iter();
            let stopped = |port: &SerialPort| port.reads_stopped(&self.words);
            if state == BoardState::WatchdogBitten && all_true(ports.filter_map(stopped)) {
                state = BoardState::Reset;
            }
            self.note_reset(now);
            self.fail(now, state);
        }
    }

    /// Notes that a board that was silent, or had bitten, and has lost its set-up, was reset as
    /// well: the reset is reported in addition to the first fault.
    fn note_reset(&mut self, now: Instant) {
        let was_silent = matches!(self.state, BoardState::BusDown | BoardState::WatchdogBitten);
        if was_silent && self.parts.watchdog.shows_reset(&self.words) {
            self.enter(now, BoardState::Reset);
        }
    }

    /// Leaves the running state, if the board is in it; everything is safe from now on.
    fn fail(&mut self, now: Instant, state: BoardState) {
        if self.is_running() {
            self.quiet_writes = QUIET_WRITES;
            self.enter(now, state);
        }
        let is_reset = state == BoardState::Reset;
        self.outage.was_reset |= is_reset;
        self.outage.has_released |= is_reset || state == BoardState::WatchdogBitten;
        self.make_safe();
    }

    /// Notes when the watchdog has bitten, at the first read that shows it.
    fn note_bite(&mut self, finding: Option<BoardState>, have_all_arrived: bool) {
        let outage = &mut self.outage;
        if finding == Some(BoardState::WatchdogBitten) && outage.last_feed.is_none() {
            outage.last_feed = self.parts.watchdog.bitten_after(have_all_arrived);
        }
    }

    fn enter(&mut self, now: Instant, state: BoardState) {
        (self.state, self.is_set_up_wanted) = (state, false);
        let statistics = &mut self.statistics;
        let (count, kind) = match state {
            BoardState::WatchdogBitten => {
                (&mut statistics.watchdog_bites, EventKind::WatchdogBitten)
            }
            BoardState::Reset => (&mut statistics.resets, EventKind::BoardReset),
            BoardState::BusDown | BoardState::Running | BoardState::OtherFirmware => {
                (&mut statistics.bus_down, EventKind::BusDown)
            }
        };
        count.tally(1);
        self.events.report(now, kind);
        self.cancel_rearm(now, ArmingEvent::Cancel);
    }

    /// Makes all inputs invalid, and all outputs safe until re-armed.
    pub fn make_safe(&mut self) {
        self.cancel_rearm(self.pins.now(), ArmingEvent::CancelTransfer);
        self.pins.fault(self.group);
        for part in self.parts.each() {
            part.make_safe(&mut self.pins);
        }
    }

    /// Publishes the driver's own pins.
    fn publish(&mut self) {
        if self.shown.replace(self.state) != Some(self.state) {
            let has_bitten = self.state == BoardState::WatchdogBitten;
            let has_error = self.has_error();
            self.parts.watchdog.show(&mut self.pins, has_bitten);
            self.parts.connection.show(&mut self.pins, has_error);
        }
        self.parts
            .connection
            .publish(&mut self.pins, &self.statistics);
    }
}

/// True if every remote of every port was found stopped without a STOP command.
fn appears_reset(ports: &[SerialPort]) -> bool {
    let ports = ports.iter();
    all_true(ports.filter_map(SerialPort::appears_reset))
}

/// True if there are answers, and all are true.
fn all_true(mut answers: impl Iterator<Item = bool>) -> bool {
    answers.next() == Some(true) && answers.all(|one| one)
}

#[cfg(test)]
mod tests;
