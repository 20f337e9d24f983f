//! The two halves of a cycle.

use core::time::Duration;

use super::pace::Answer;
use super::{BoardState, CycleError, CycleReport, Driver, EventKind, Pace, SerialPort};
use crate::bus::{BusError, BusErrorKind, Clock, Instant, RegisterBus, Reply, Words};
use crate::modules::{Module, ReadCycle, WriteCycle};
use crate::tally::Tally;

/// Between two polls of COMMAND.
const POLL_PAUSE: Duration = Duration::from_micros(1);
/// Ends the polling on a bus whose clock stands still.
const MAX_POLLS: u32 = 100_000;

impl<B: RegisterBus + Clock> Driver<B> {
    /// Reads the board once and takes what it brought.
    ///
    /// # Errors
    /// [`CycleError::Read`] and [`CycleError::NotThere`]: no input was taken, all grow older.
    /// Faults of single remotes are no errors; they are in the report and on the pins.
    ///
    /// # Real time
    /// One exchange, bounded by the bus. Where the [board paces](Pace::Board), it waits for the
    /// next period, at most for five quarters of one besides the deadline of the bus. No
    /// allocation.
    pub fn read(&mut self) -> Result<CycleReport, CycleError<B::Error>> {
        let result = self.read_board();
        if self.trace.is_some() {
            let failed = result.as_ref().err().map(CycleError::kind);
            self.trace_read(failed);
        }
        result
    }

    fn read_board(&mut self) -> Result<CycleReport, CycleError<B::Error>> {
        self.statistics.reads.tally(1);
        self.writes_since_read = 0;
        self.events.begin_cycle(self.statistics.reads);
        let asked = self.wants_closer_look();
        let Answer { extra, at, result } = self.pacer.read(&mut *self.bus, &mut self.image, asked);
        let now = self.bus.now();
        self.pins.begin_cycle(now);
        if let Err(source) = result {
            let why = source.kind();
            let consecutive = self.read_failed(now, EventKind::ReadFailed { why });
            return Err(CycleError::Read {
                source,
                consecutive,
            });
        }
        if let Err(found) = self.connection.check(&self.image.words) {
            let consecutive = self.read_failed(now, EventKind::NotThere { found });
            return Err(CycleError::NotThere { found, consecutive });
        }
        self.read_failures = 0;
        self.connection.count_exchange(&mut self.pins, false);
        Ok(self.take(at, extra))
    }

    /// Everybody takes its inputs from an image that is sound, and was read at `now`.
    fn take(&mut self, now: Instant, closely: bool) -> CycleReport {
        let Reply {
            certain,
            lost_writes,
            others,
            slack,
        } = self.image.take_news();
        self.image.words.confirm(certain);
        self.look_closely = !certain || (self.look_closely && !closely);
        let beat = self.pacer.arrived(now, slack);
        let mut report = CycleReport {
            lost_writes: lost_writes.into(),
            others,
            missed_periods: beat.missed,
            unpaced: beat.is_unpaced,
            slack,
            ..CycleReport::default()
        };
        self.statistics.lost_writes.tally(report.lost_writes);
        self.statistics.missed_periods.tally(beat.missed);
        self.statistics.unpaced_cycles.tally(beat.is_unpaced.into());
        if report.lost_writes > 0 {
            let (count, row) = (lost_writes, &mut self.rows.lost_writes);
            row.add(&self.events, now, count, EventKind::LostWrites { count });
        }
        if others > 0 {
            self.statistics.others.tally(others.into());
            let (packets, row) = (others, &mut self.rows.others);
            row.add(
                &self.events,
                now,
                packets,
                EventKind::OtherMaster { packets },
            );
        }
        if beat.missed > 0 {
            let count = u32::try_from(beat.missed).unwrap_or(u32::MAX);
            let (kind, row) = (
                EventKind::MissedPeriods { count },
                &mut self.rows.missed_periods,
            );
            row.add(&self.events, now, count, kind);
        }
        self.rows.look(&self.events, now);
        let was_running = self.is_running();
        let words = &self.image.words;
        let finding = self.parts.watchdog.examine(words, closely, now, certain);
        self.found(finding);
        // What was read with bad evidence is not from the board that was set up.
        if was_running && !self.is_running() {
            self.not_read();
        } else {
            self.take_parts(now, certain, &mut report);
        }
        if self.is_running() {
            let error = self.phase_error_us.map(|pin| self.pins.read(pin).value);
            report.locked = error.is_some_and(|error| self.pacer.lock(beat, slack, error));
        } else {
            self.pacer.unlock();
            self.make_safe();
        }
        self.publish();
        report.board = self.state;
        report
    }

    /// The serial ports first: they may find that the board was reset.
    fn take_parts(&mut self, now: Instant, certain: bool, report: &mut CycleReport) {
        let mut cycle = ReadCycle {
            words: &self.image.words,
            pins: &mut self.pins,
            now,
            certain,
            is_running: self.state == BoardState::Running,
            report,
        };
        for port in &mut self.parts.ports {
            port.read(&mut cycle);
        }
        let is_running = self.state == BoardState::Running;
        if appears_reset(&self.parts.ports) {
            self.fail(BoardState::Reset);
        } else if is_running {
            for part in &mut self.parts.modules {
                part.module.read(&mut cycle);
            }
            self.pins.group_good_since(self.group, 0, now);
        }
    }

    /// Writes the outputs to the board and starts the transfers to its remotes.
    ///
    /// A port's transfer is started only when the last read has seen the one before end; otherwise
    /// its remotes keep what they have.
    ///
    /// A write without a read before it is a cycle without news: ages grow. After
    /// [`stale_after`](super::FaultPolicy::stale_after) of them in a row no input is valid and
    /// everything is safe until it is read again and re-armed: [`EventKind::NotRead`].
    ///
    /// # Errors
    /// [`CycleError::Write`]: the outputs may not have arrived; the next read finds out.
    ///
    /// # Real time
    /// One exchange, bounded by the bus. No allocation. In a cycle in which a module has changed a
    /// setting that drives pins, as the direction or the open drain of an I/O pin, three exchanges
    /// more: the evidence that the board is set up is read before and after they are written.
    pub fn write(&mut self) -> Result<(), CycleError<B::Error>> {
        let result = self.write_board();
        if self.trace.is_some() {
            let failed = result.as_ref().err().map(CycleError::kind);
            self.trace_written(failed);
        }
        result
    }

    fn write_board(&mut self) -> Result<(), CycleError<B::Error>> {
        let mut now = self.bus.now();
        self.statistics.writes.tally(1);
        self.count_write(now);
        if self.wants_restore() && self.write_set_up().is_ok() {
            now = self.bus.now();
        }
        if self.state == BoardState::OtherFirmware {
            // What its registers do is not known.
            self.written(now, false);
            return Ok(());
        }
        let was_running = self.is_running();
        self.put(now);
        // What fails is tried again with the next write; this one goes on without it.
        let _ = self.write_guarded();
        self.keep_quiet();
        if was_running && !self.is_running() {
            // Nothing of what was put is written.
            let now = self.bus.now();
            self.written(now, false);
            // Before the next write, which looks whether the application has cleared it.
            self.publish();
            return Ok(());
        }
        if let Some(deadline) = self.connection.new_deadline(&self.pins, self.pacer.period) {
            self.bus.set_cycle(self.pacer.period, Some(deadline));
        }
        let ask = (self.wants_closer_look(), !self.is_running());
        let begun = self.bus.now();
        self.parts.watchdog.sending(begun);
        for port in &mut self.parts.ports {
            port.sending(begun);
        }
        let result = self.pacer.write(&mut *self.bus, &mut self.image, ask);
        let done = self.bus.now();
        self.written(done, result.is_ok());
        match result {
            Ok(()) => {
                self.write_failures = 0;
                Ok(())
            }
            Err(source) => {
                self.statistics.write_errors.tally(1);
                self.look_closely = true;
                let why = source.kind();
                let (kind, row) = (EventKind::WriteFailed { why }, &mut self.rows.failed_writes);
                row.add(&self.events, done, 1, kind);
                self.write_failures = self.write_failures.saturating_add(1);
                let consecutive = self.write_failures;
                if self.connection.count_exchange(&mut self.pins, true) {
                    self.fail(BoardState::BusDown);
                    // Before the next write, which looks whether the application has cleared it.
                    self.publish();
                }
                Err(CycleError::Write {
                    source,
                    consecutive,
                })
            }
        }
    }

    #[cold]
    fn trace_read(&mut self, failed: Option<BusErrorKind>) {
        let now = (self.statistics.reads, self.bus.now());
        if let Some(trace) = &mut self.trace {
            trace.read(now, failed, &self.image.words);
        }
    }

    #[cold]
    fn trace_written(&mut self, failed: Option<BusErrorKind>) {
        let now = (self.statistics.reads, self.bus.now());
        if let Some(trace) = &mut self.trace {
            trace.written(now, failed, &self.image.words);
        }
    }

    fn written(&mut self, now: Instant, arrived: bool) {
        for part in self.parts.each() {
            part.written(now, arrived);
        }
    }

    /// Everybody puts its outputs into the image.
    fn put(&mut self, now: Instant) {
        let is_running = self.is_running();
        let mut cycle = WriteCycle {
            words: &mut self.image.words,
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
    }

    /// Sends the request of the next read ahead, which then only takes the reply: with several
    /// boards, send all requests, then read all boards. LinuxCNC's `read-request`.
    ///
    /// Call it when the board is to be sampled, after [`write`](Self::write) and right before
    /// `read`. It does nothing where the [board paces](Pace::Board) or requests can not be in
    /// flight, and when it fails, the next read says why.
    ///
    /// # Real time
    /// One packet out. No allocation.
    pub fn request_read(&mut self) {
        if self.pacer.pace == Pace::Host {
            let extra = self.wants_closer_look();
            self.pacer.start_read(&mut *self.bus, &self.image, extra);
        }
    }

    /// Waits until the transfers that the last write started are complete, or `limit` is over.
    ///
    /// The "read-modify-write" of the manual's "NORMAL MODE OPERATION", and the way to measure how
    /// long a transfer takes: the time goes into [`PortStatistics::doit`].
    ///
    /// # Errors
    /// Those of the bus. `Ok(false)` when the limit came first, and at once where the
    /// [board paces](Pace::Board): it is asked for the next period already.
    ///
    /// # Real time
    /// Bounded by `limit` and one exchange, and by a number of polls on a bus whose clock stands
    /// still. No allocation.
    ///
    /// [`PortStatistics::doit`]: super::PortStatistics::doit
    pub fn wait_transfers(&mut self, limit: Duration) -> Result<bool, B::Error> {
        self.wait_ports(limit, SerialPort::poll)
    }

    /// Waits until all ports are, or `limit` is over; not where the board paces.
    pub(super) fn wait_ports(
        &mut self,
        limit: Duration,
        mut are: impl FnMut(&mut SerialPort, &Words, Instant) -> bool,
    ) -> Result<bool, B::Error> {
        if self.pacer.pace == Pace::Board {
            return Ok(false);
        }
        // A reply that was asked for ahead is older than what is waited for.
        self.pacer.forget_started(&mut *self.bus, &mut self.image);
        let start = self.bus.now();
        for _ in 0..MAX_POLLS {
            self.image.read_status(&mut *self.bus)?;
            let now = self.bus.now();
            let mut all = true;
            for port in &mut self.parts.ports {
                all &= are(port, &self.image.words, now);
            }
            if all {
                return Ok(true);
            }
            if now.since(start) >= limit {
                return Ok(false);
            }
            self.bus.wait(POLL_PAUSE);
        }
        Ok(false)
    }

    /// Whether the next read must hold more than usual.
    fn wants_closer_look(&self) -> bool {
        self.look_closely || self.wants_extra
    }

    /// Publishes the driver's own pins.
    pub(super) fn publish(&mut self) {
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
