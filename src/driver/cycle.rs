//! The cycle, without a bus: what a read has brought means, and what is to be written.
//!
//! [`Driver`](super::Driver) exchanges what an [`Order`] asks for, and gives back what came of it.

use core::time::Duration;

use super::beat::Beats;
use super::connection::Connection;
use super::rows::Rows;
use super::{BoardState, CycleReport, DriverStatistics, EventKind, Parts, Rearmed, SerialPort};
use crate::bus::{BusErrorKind, Instant, Reply, Words};
use crate::hal::{GroupId, Input, PinStore};
use crate::modules::events::Sink;
use crate::modules::{Module, ReadCycle, WriteCycle};
use crate::tally::Tally;

/// Everything that takes part in the cycle, and what is known of the board.
///
/// # Real time
/// No function allocates, and each takes a bounded time.
#[derive(Debug)]
pub(super) struct Cycle {
    pub words: Words,
    pub pins: PinStore,
    /// Of the board's own pins.
    pub group: GroupId,
    pub parts: Parts,
    pub statistics: DriverStatistics,
    pub events: Sink,
    connection: Connection,
    beats: Beats,
    /// How late the last read was for the phase-locked loop.
    phase_error_us: Option<Input<f64>>,
    state: BoardState,
    /// The state that the pins show.
    shown: Option<BoardState>,
    rows: Rows,
    /// Reads, and writes, in a row that failed.
    read_failures: u32,
    write_failures: u32,
    /// Writes since the last read; the last one belongs to it.
    writes_since_read: u32,
    /// The next read holds all evidence: something happened since the last one that did which may
    /// have blurred what every cycle reads.
    look_closely: bool,
    /// Somebody asked for more than usual with the last write.
    wants_extra: bool,
    /// Remotes get safe values for the last time: nothing is restarted instead.
    pub is_last: bool,
}

/// What is exchanged next in a write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use = "the board waits for it"]
pub(super) enum Order {
    /// The whole set-up, if it is still the same firmware. Then [`Cycle::put`].
    SetUp,
    /// Settings that drive pins, between two looks at the evidence. Then [`Cycle::guarded`].
    Guarded,
    /// All pins become inputs. Then [`Cycle::quiesced`].
    Quiesce {
        /// The board ran when the write began.
        has_run: bool,
    },
    /// What every cycle writes. Then [`Cycle::sent`] or [`Cycle::write_failed`].
    Cycle {
        /// The next read holds more than usual.
        extra: bool,
        /// No settings are written, because the board is not set up.
        quiet: bool,
    },
    /// Nothing any more.
    Nothing,
}

impl Cycle {
    /// A board that was set up just now, with all outputs off.
    pub fn new(
        (words, pins, group): (Words, PinStore, GroupId),
        parts: Parts,
        connection: Connection,
        events: Sink,
        beats: Beats,
        phase_error_us: Option<Input<f64>>,
    ) -> Self {
        Self {
            words,
            pins,
            group,
            parts,
            statistics: DriverStatistics::default(),
            events,
            connection,
            beats,
            phase_error_us,
            state: BoardState::Running,
            shown: None,
            rows: Rows::default(),
            read_failures: 0,
            write_failures: 0,
            writes_since_read: 0,
            look_closely: true,
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

    /// Writes in a row that failed.
    pub fn write_failures(&self) -> u32 {
        self.write_failures
    }

    /// Something has happened that may have blurred what every cycle reads.
    pub fn look_closely(&mut self) {
        self.look_closely = true;
    }

    /// Whether the last read has seen the last write arrive, and all evidence.
    pub fn is_sure(&self) -> bool {
        !self.look_closely
    }

    /// Whether the next read must hold more than usual.
    pub fn wants_closer_look(&self) -> bool {
        self.look_closely || self.wants_extra
    }

    /// How long a reply may take, when the application has changed that.
    pub fn new_deadline(&mut self, period: Duration) -> Option<Duration> {
        self.connection.new_deadline(&self.pins, period)
    }

    /// Whether the registers that were read are those of a `HostMot2`; if not, what they are.
    pub fn check(&self) -> Result<(), u32> {
        self.connection.check(&self.words)
    }

    /// Everything ends at `now`.
    pub fn end(&mut self, now: Instant) {
        self.rows.end(&self.events, now);
        for port in &mut self.parts.ports {
            port.end_rows(now);
        }
        self.events.end();
    }
}

/// A read.
impl Cycle {
    /// A read begins; whether it has to hold more than usual.
    pub fn begin_read(&mut self) -> bool {
        self.statistics.reads.tally(1);
        self.writes_since_read = 0;
        self.events.begin_cycle(self.statistics.reads);
        self.wants_closer_look()
    }

    /// Takes what a read brought at `at`, in a cycle that begins at `now`. `closely`: it held more than
    /// usual.
    ///
    /// # Errors
    /// No `HostMot2` answers, but this word; and how many reads in a row have failed.
    pub fn read(
        &mut self,
        now: Instant,
        at: Instant,
        closely: bool,
    ) -> Result<CycleReport, (u32, u32)> {
        self.pins.begin_cycle(now);
        if let Err(found) = self.check() {
            let consecutive = self.count_failed_read(now, EventKind::NotThere { found });
            return Err((found, consecutive));
        }
        self.read_failures = 0;
        self.connection.count_exchange(&mut self.pins, false);
        Ok(self.take(now, at, closely))
    }

    /// A read failed as a whole; how many in a row.
    pub fn read_failed(&mut self, now: Instant, why: BusErrorKind) -> u32 {
        self.pins.begin_cycle(now);
        self.count_failed_read(now, EventKind::ReadFailed { why })
    }

    fn count_failed_read(&mut self, now: Instant, what: EventKind) -> u32 {
        self.rows.failed_reads.add(&self.events, now, 1, what);
        self.statistics.read_errors.tally(1);
        self.read_failures = self.read_failures.saturating_add(1);
        self.look_closely = true;
        self.not_read();
        if self.connection.count_exchange(&mut self.pins, true) {
            self.fail(now, BoardState::BusDown);
        }
        self.publish();
        self.read_failures
    }

    /// Everybody takes its inputs from an image that is sound.
    fn take(&mut self, now: Instant, at: Instant, closely: bool) -> CycleReport {
        let reply = self.words.take_news();
        let certain = reply.certain;
        self.words.confirm(certain);
        self.look_closely = !certain || (self.look_closely && !closely);
        let beat = self.beats.arrived(at, reply.slack);
        let mut report = CycleReport {
            lost_writes: reply.lost_writes.into(),
            others: reply.others,
            missed_periods: beat.missed,
            unpaced: beat.is_unpaced,
            slack: reply.slack,
            ..CycleReport::default()
        };
        self.count(at, &reply, &report);
        let was_running = self.is_running();
        let watchdog = &mut self.parts.watchdog;
        let finding = watchdog.examine(&self.words, closely, at, certain);
        self.found(now, finding);
        // What was read with bad evidence is not from the board that was set up.
        if was_running && !self.is_running() {
            self.not_read();
        } else {
            self.take_parts(now, at, certain, &mut report);
        }
        if self.is_running() {
            let error = self.phase_error_us.map(|pin| self.pins.read(pin).value);
            report.locked = error.is_some_and(|error| self.beats.lock(beat, reply.slack, error));
        } else {
            self.beats.unlock();
            self.make_safe();
        }
        self.publish();
        report.board = self.state;
        report
    }

    /// Counts and tells what a read says of the bus.
    fn count(&mut self, at: Instant, reply: &Reply, report: &CycleReport) {
        self.statistics.lost_writes.tally(report.lost_writes);
        self.statistics.missed_periods.tally(report.missed_periods);
        self.statistics.unpaced_cycles.tally(report.unpaced.into());
        let events = &self.events;
        if reply.lost_writes > 0 {
            let (count, row) = (reply.lost_writes, &mut self.rows.lost_writes);
            row.add(events, at, count, EventKind::LostWrites { count });
        }
        if reply.others > 0 {
            self.statistics.others.tally(reply.others.into());
            let (packets, row) = (reply.others, &mut self.rows.others);
            row.add(events, at, packets, EventKind::OtherMaster { packets });
        }
        if report.missed_periods > 0 {
            let count = u32::try_from(report.missed_periods).unwrap_or(u32::MAX);
            let row = &mut self.rows.missed_periods;
            row.add(events, at, count, EventKind::MissedPeriods { count });
        }
        self.rows.look(events, at);
    }

    /// The serial ports first: they may find that the board was reset.
    fn take_parts(&mut self, now: Instant, at: Instant, certain: bool, report: &mut CycleReport) {
        let is_running = self.is_running();
        let mut cycle = ReadCycle {
            words: &self.words,
            pins: &mut self.pins,
            now: at,
            certain,
            is_running,
            report,
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

    fn not_read(&mut self) {
        for part in self.parts.each() {
            part.not_read(&mut self.pins);
        }
    }
}

/// A write.
impl Cycle {
    /// A write begins.
    pub fn write(&mut self, now: Instant) -> Order {
        self.statistics.writes.tally(1);
        self.count_write(now);
        if self.wants_restore() {
            Order::SetUp
        } else {
            self.put(now)
        }
    }

    /// Nobody reads what he acts on: as good as a read that failed, but for its cause.
    fn count_write(&mut self, now: Instant) {
        let missed = self.writes_since_read;
        self.writes_since_read = missed.saturating_add(1);
        if missed == 0 || self.is_last {
            return;
        }
        self.pins.begin_cycle(now);
        self.not_read();
        if missed == self.pins.stale_after() {
            let writes = self.writes_since_read;
            self.events.tell(now, EventKind::NotRead { writes });
            self.make_safe();
        }
    }

    /// Whether the application has cleared the flag of what made everything safe, and with that
    /// asks for the set-up to be written again.
    fn wants_restore(&self) -> bool {
        match self.state {
            BoardState::Running => false,
            BoardState::WatchdogBitten => self.parts.watchdog.is_cleared(&self.pins),
            BoardState::Reset | BoardState::BusDown | BoardState::OtherFirmware => {
                self.connection.is_cleared(&self.pins)
            }
        }
    }

    /// Everybody puts its outputs into the image.
    pub fn put(&mut self, now: Instant) -> Order {
        if self.state == BoardState::OtherFirmware {
            // What its registers do is not known.
            self.written(now, false);
            return Order::Nothing;
        }
        let is_running = self.is_running();
        let mut cycle = WriteCycle {
            words: &mut self.words,
            pins: &mut self.pins,
            now,
            // A board that is not set up gets nothing of its set-up before it gets all of it.
            hold: !is_running || self.is_last,
            changed: true,
            is_running,
            wants_extra: false,
        };
        self.parts.watchdog.write(&mut cycle);
        for port in &mut self.parts.ports {
            port.write(&mut cycle);
        }
        for part in &mut self.parts.modules {
            let version = cycle.pins.output_version(part.group);
            cycle.changed = version.is_none() || version != part.version;
            part.version = version;
            part.module.write(&mut cycle);
        }
        self.wants_extra = cycle.wants_extra;
        if is_running && self.words.has_guarded_news() {
            self.look_closely = true;
            return Order::Guarded;
        }
        self.keep_quiet(now, is_running)
    }

    /// Settings that drive pins were written, or not, because the board is not set up any more. What
    /// did not arrive is tried again with the next write.
    pub fn guarded(&mut self, now: Instant) -> Order {
        self.keep_quiet(now, true)
    }

    /// All pins become inputs in each cycle in which the board is known not to be set up: whatever comes
    /// late drives them for no longer.
    fn keep_quiet(&mut self, now: Instant, has_run: bool) -> Order {
        if matches!(self.state, BoardState::WatchdogBitten | BoardState::Reset) {
            Order::Quiesce { has_run }
        } else {
            self.quiesced(now, has_run)
        }
    }

    /// All pins are inputs, where they had to be.
    pub fn quiesced(&mut self, now: Instant, has_run: bool) -> Order {
        if has_run && !self.is_running() {
            // Nothing of what was put is written.
            self.written(now, false);
            // Before the next write, which looks whether the application has cleared it.
            self.publish();
            return Order::Nothing;
        }
        Order::Cycle {
            extra: self.wants_closer_look(),
            quiet: !self.is_running(),
        }
    }

    /// The write of the cycle begins.
    pub fn sending(&mut self, now: Instant) {
        self.parts.watchdog.sending(now);
        for port in &mut self.parts.ports {
            port.sending(now);
        }
    }

    /// The write of the cycle was sent.
    pub fn sent(&mut self, now: Instant) {
        self.written(now, true);
        self.write_failures = 0;
    }

    /// The write of the cycle failed as a whole; how many in a row.
    pub fn write_failed(&mut self, now: Instant, why: BusErrorKind) -> u32 {
        self.written(now, false);
        self.statistics.write_errors.tally(1);
        self.look_closely = true;
        let (kind, row) = (EventKind::WriteFailed { why }, &mut self.rows.failed_writes);
        row.add(&self.events, now, 1, kind);
        self.write_failures = self.write_failures.saturating_add(1);
        if self.connection.count_exchange(&mut self.pins, true) {
            self.fail(now, BoardState::BusDown);
            // Before the next write, which looks whether the application has cleared it.
            self.publish();
        }
        self.write_failures
    }

    fn written(&mut self, now: Instant, arrived: bool) {
        for part in self.parts.each() {
            part.written(now, arrived);
        }
    }

    /// Settings that drive pins are sent now, ...
    pub fn sending_guarded(&mut self, now: Instant) {
        self.parts.watchdog.sending(now);
    }

    /// ... were sent, ...
    pub fn sent_guarded(&mut self, now: Instant) {
        self.parts.watchdog.written(now, true);
    }

    /// ... and the evidence after it is good.
    pub fn confirm_guarded(&mut self) {
        if self.is_running() {
            self.words.guarded_sent();
        }
    }
}

/// How everything becomes safe, and comes back.
impl Cycle {
    /// All evidence was read alone. Everything becomes safe if the board is not set up any more.
    pub fn looked(&mut self, now: Instant) {
        let finding = self.parts.watchdog.examine(&self.words, true, now, true);
        self.found(now, finding);
    }

    /// Whether the evidence that was read is as the set-up leaves it.
    pub fn shows_set_up(&mut self) -> bool {
        self.parts.watchdog.is_set_up(&self.words)
    }

    /// The board has its set-up back, which was begun at `now`.
    pub fn is_set_up_again(&mut self, now: Instant) {
        self.words.all_set();
        self.look_closely = true;
        for part in self.parts.each() {
            part.restored(&mut self.pins, now);
        }
        self.state = BoardState::Running;
        self.events.tell(now, EventKind::BoardSetUp);
        self.connection.level = 0;
        self.read_failures = 0;
        self.write_failures = 0;
    }

    /// Another firmware answers. The application has to clear the error before it is asked again.
    pub fn is_other_firmware(&mut self, now: Instant) {
        let state = BoardState::OtherFirmware;
        if core::mem::replace(&mut self.state, state) != state {
            self.events.tell(now, EventKind::OtherFirmware);
        }
        // The flag again, also if it was shown before.
        self.shown = None;
        self.publish();
    }

    /// Lets all outputs follow the application again.
    pub fn rearm(&mut self, now: Instant) -> Rearmed {
        let (mut armed, mut is_news) = (0, false);
        if self.is_running() {
            armed = self.pins.rearm_all();
            is_news = self.pins.arm_when_good(self.group);
            for port in &self.parts.ports {
                is_news |= port.arm_what_comes(&mut self.pins);
            }
        }
        let (mut waiting, mut coming) = (0_usize, 0_usize);
        for group in self.pins.groups() {
            let state = self.pins.group_state(group);
            waiting.tally(usize::from(state.is_some_and(|state| !state.armed)));
            coming.tally(usize::from(self.pins.is_awaited(group)));
        }
        if armed > 0 || is_news {
            let [armed, waiting] =
                [armed, waiting].map(|count| u32::try_from(count).unwrap_or(u32::MAX));
            self.events.tell(now, EventKind::Rearmed { armed, waiting });
        }
        Rearmed {
            armed,
            waiting,
            coming,
        }
    }

    /// Makes everything safe if the board is not set up any more.
    fn found(&mut self, now: Instant, failure: Option<BoardState>) {
        if let Some(state) = failure {
            self.note_reset(now);
            self.fail(now, state);
        }
    }

    /// A board that is back without its set-up after it was not heard, or had bitten, was reset as well:
    /// that is told beside what was first.
    fn note_reset(&mut self, now: Instant) {
        let was_silent = matches!(self.state, BoardState::BusDown | BoardState::WatchdogBitten);
        if was_silent && self.parts.watchdog.shows_reset(&self.words) {
            self.enter(now, BoardState::Reset);
        }
    }

    /// The board leaves the running state; everything is safe from now on.
    fn fail(&mut self, now: Instant, state: BoardState) {
        if self.is_running() {
            self.enter(now, state);
        }
        self.make_safe();
    }

    fn enter(&mut self, now: Instant, state: BoardState) {
        self.state = state;
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
        self.events.tell(now, kind);
    }

    /// All inputs are not valid, all outputs safe until re-armed.
    pub fn make_safe(&mut self) {
        self.pins.fault(self.group);
        for part in self.parts.each() {
            part.make_safe(&mut self.pins);
        }
    }

    /// Publishes the driver's own pins.
    fn publish(&mut self) {
        if self.shown.replace(self.state) != Some(self.state) {
            let has_bitten = self.state == BoardState::WatchdogBitten;
            self.parts.watchdog.show(&mut self.pins, has_bitten);
            self.connection.show(&mut self.pins, self.state);
        }
        self.connection.publish(&mut self.pins, &self.statistics);
    }
}

/// Whether every remote of every port is found stopped without a STOP command.
fn appears_reset(ports: &[SerialPort]) -> bool {
    let mut appear = ports
        .iter()
        .filter_map(|port| port.recovery.appears_reset());
    appear.next() == Some(true) && appear.all(|one| one)
}

#[cfg(test)]
mod tests;
