//! The two halves of a cycle, on the bus.

use core::time::Duration;

use super::cycle::{CycleWrite, Order};
use super::pace::ReadResult;
use super::{BoardState, CycleError, CycleReport, Driver, Pace, SerialPort};
use crate::bus::{BusError, BusErrorKind, Clock, Effort, Instant, ReadRequest, RegisterBus, Words};

/// Pause between two polls of COMMAND.
const POLL_PAUSE: Duration = Duration::from_micros(1);
/// Ends the polling on a bus whose clock stands still.
const MAX_POLLS: u32 = 100_000;

/// The device that answers at the board's address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Responder {
    /// The board with the firmware that was set up.
    Same,
    /// No `HostMot2`, as during a reset.
    Absent,
    /// Another board, or another firmware.
    Other,
}

impl<B: RegisterBus + Clock> Driver<B> {
    /// Reads the board once and takes its inputs.
    ///
    /// # Errors
    /// [`CycleError::Read`] and [`CycleError::NotThere`]: no input was taken, all grow older.
    /// Faults of single remotes are no errors; they are in the report and on the pins.
    ///
    /// # Real time
    /// One exchange, bounded by the bus. Where the [board paces](Pace::Board), it waits for the
    /// next period, at most for five quarters of one besides the deadline of the bus. No
    /// allocation.
    pub fn read(&mut self) -> Result<CycleReport, CycleError> {
        let result = self.read_board();
        if self.trace.is_some() {
            let failed = result.as_ref().err().map(CycleError::kind);
            self.trace_read(failed);
        }
        result
    }

    fn read_board(&mut self) -> Result<CycleReport, CycleError> {
        let asked = self.cycle.begin_read();
        let words = &mut self.cycle.words;
        let answer = self
            .pacer
            .read(&mut *self.bus, &self.exchanges, words, asked);
        let ReadResult {
            extra,
            from,
            at,
            result,
        } = answer;
        self.cycle.asked(from);
        let now = self.bus.now();
        if let Err(source) = result {
            let consecutive = self.cycle.read_failed(now, source.kind());
            return Err(CycleError::Read {
                source,
                consecutive,
            });
        }
        let read = self.cycle.read(now, at, extra);
        read.map_err(|(found, consecutive)| CycleError::NotThere { found, consecutive })
    }

    /// Writes the outputs to the board and starts the transfers to its remotes.
    ///
    /// A port's transfer is started only when the last read has found the previous one complete;
    /// otherwise the remotes of the port keep their data.
    ///
    /// A write without a preceding read is a cycle without new inputs: ages grow. After
    /// [`stale_after`](super::FaultPolicy::stale_after) of them in a row all inputs are invalid and
    /// everything is safe until it is read again and re-armed: [`EventKind::NotRead`].
    ///
    /// # Errors
    /// [`CycleError::Write`]: the outputs may not have arrived; the next read detects that.
    ///
    /// # Real time
    /// One exchange, bounded by the bus. No allocation. In a cycle in which a module has changed a
    /// setting that drives pins, such as the direction or the open drain of an I/O pin, three
    /// exchanges more: the evidence that the board is set up is read before and after the setting
    /// is written.
    ///
    /// [`EventKind::NotRead`]: super::EventKind::NotRead
    pub fn write(&mut self) -> Result<(), CycleError> {
        let result = self.write_board();
        if self.trace.is_some() {
            let failed = result.as_ref().err().map(CycleError::kind);
            self.trace_written(failed);
        }
        result
    }

    /// Does the exchanges that the cycle orders. A failed exchange other than the last one is
    /// repeated with the next write; this write continues without it.
    fn write_board(&mut self) -> Result<(), CycleError> {
        let mut now = self.bus.now();
        let mut order = self.cycle.write(now);
        loop {
            order = match order {
                Order::SetUp => {
                    if self.write_set_up().is_ok() {
                        now = self.bus.now();
                    }
                    self.cycle.put(now)
                }
                Order::Guarded => {
                    let _ = self.write_guarded();
                    let now = self.bus.now();
                    self.cycle.guarded(now)
                }
                Order::Quiesce => {
                    let (bus, words) = (&mut *self.bus, &mut self.cycle.words);
                    let _ = self.exchanges.quiesce(bus, words);
                    let now = self.bus.now();
                    self.cycle.quiesced(now)
                }
                Order::Cycle(form) => return self.write_cycle(form),
                Order::Nothing => return Ok(()),
            };
        }
    }

    fn write_cycle(&mut self, form: CycleWrite) -> Result<(), CycleError> {
        let period = self.pacer.period;
        if let Some(deadline) = self.cycle.new_deadline(period) {
            self.bus.set_cycle(period, Some(deadline));
        }
        let begun = self.bus.now();
        self.cycle.sending(begun);
        let (bus, words) = (&mut *self.bus, &mut self.cycle.words);
        let result = self.pacer.write(bus, &mut self.exchanges, words, form);
        let done = self.bus.now();
        match result {
            Ok(()) => {
                self.cycle.sent(done);
                Ok(())
            }
            Err(source) => {
                let consecutive = self.cycle.write_failed(done, source.kind());
                Err(CycleError::Write {
                    source,
                    consecutive,
                })
            }
        }
    }

    /// Writes settings that drive pins. They could drive pins that the rest of the set-up protects,
    /// so the evidence of the set-up is checked before and after the write.
    fn write_guarded(&mut self) -> Result<(), BusError> {
        self.forget_started();
        self.look()?;
        if !self.cycle.is_running() {
            return Ok(());
        }
        let begun = self.bus.now();
        self.cycle.sending_guarded(begun);
        let (bus, words) = (&mut *self.bus, &mut self.cycle.words);
        self.exchanges.write_guarded(bus, words)?;
        let now = self.bus.now();
        self.cycle.sent_guarded(now);
        self.look()?;
        self.cycle.confirm_guarded();
        Ok(())
    }

    /// Reads a board that waits to be re-armed, without a write, so that its positions are
    /// followed and stay exact: see [`faults`](crate::guides::faults), "Positions". For an
    /// application that neither reads nor writes meanwhile, like the component for LinuxCNC.
    /// Returns true if the board was read.
    ///
    /// Inputs keep their values, which are not valid. A read that fails is neither counted nor reported,
    /// because the fault before it was; a reset that it finds is.
    ///
    /// # Real time
    /// One exchange. None, and false, for a board that runs, or in whose place another one has answered.
    /// No allocation.
    pub fn follow(&mut self) -> bool {
        let state = self.cycle.state();
        if matches!(state, BoardState::Running | BoardState::OtherFirmware) {
            return false;
        }
        self.forget_started();
        if self.read_all().is_err() || self.cycle.check().is_err() {
            return false;
        }
        let now = self.bus.now();
        self.cycle.followed(now);
        true
    }

    /// Reads all registers before the set-up, of a board that is not set up.
    fn survey(&mut self) -> Result<(), BusError> {
        self.read_all()?;
        let now = self.bus.now();
        self.cycle.surveyed(now);
        Ok(())
    }

    /// Reads all registers in a separate exchange.
    fn read_all(&mut self) -> Result<(), BusError> {
        self.cycle.asked(self.bus.now());
        let (bus, words) = (&mut *self.bus, &mut self.cycle.words);
        let ask = ReadRequest {
            held: false,
            extra: true,
            after: None,
        };
        let started = self.exchanges.start_read(bus, words, ask)?;
        self.exchanges.finish(bus, words, started)
    }

    /// Reads all evidence in a separate exchange.
    fn look(&mut self) -> Result<(), BusError> {
        self.cycle.asked(self.bus.now());
        let (bus, words) = (&mut *self.bus, &mut self.cycle.words);
        self.exchanges.read_evidence(bus, words)?;
        let now = self.bus.now();
        self.cycle.looked(now);
        Ok(())
    }

    /// Writes the set-up that the board has lost. If the evidence then shows the set-up, the board
    /// runs, and so does its watchdog; otherwise the state is unchanged. Another firmware gets no
    /// part of it, because its registers have other meanings, and its pins other wires.
    pub(super) fn write_set_up(&mut self) -> Result<(), CycleError> {
        match self.set_up_same() {
            Ok(true) => Ok(()),
            Ok(false) => {
                let now = self.bus.now();
                self.cycle.is_other_firmware(now);
                Err(CycleError::OtherFirmware)
            }
            Err(source) => Err(CycleError::Write {
                source,
                consecutive: self.cycle.write_failures().saturating_add(1),
            }),
        }
    }

    /// Detects if the board is the one that the driver was started with.
    pub(super) fn responder(&mut self) -> Result<Responder, BusError> {
        // A read around a reset is no evidence of another firmware, so that is read twice.
        for _ in 0..2 {
            // An FPGA without its configuration could get it back in the middle of an exchange, and
            // take the end of the set-up, which drives the pins, without its beginning.
            let (bus, words) = (&mut *self.bus, &mut self.cycle.words);
            self.exchanges.read_status(bus, words)?;
            if self.cycle.check().is_err() {
                return Ok(Responder::Absent);
            }
            if self.description.is_still(&mut *self.bus, Effort::Once)? {
                return Ok(Responder::Same);
            }
        }
        Ok(Responder::Other)
    }

    /// Returns false if another firmware answers.
    fn set_up_same(&mut self) -> Result<bool, BusError> {
        let now = self.bus.now();
        // A reply that was requested before shows nothing of the board's present state.
        self.forget_started();
        match self.responder()? {
            Responder::Same => {}
            Responder::Absent => return Ok(true),
            Responder::Other => return Ok(false),
        }
        // The set-up would hide that the board was reset while it did not answer, and what its
        // counters show of that.
        self.survey()?;
        if self.cycle.is_standing() {
            return self.renew(now).map(|()| true);
        }
        let Self {
            bus,
            exchanges,
            cycle,
            ..
        } = self;
        let set_up = exchanges.set_up(&mut **bus, &mut cycle.words);
        let is_set_up = set_up.map(|()| cycle.shows_set_up());
        if matches!(is_set_up, Ok(true)) {
            cycle.is_set_up_again(now);
        } else {
            // The board may be set up, and its watchdog is not fed.
            self.quiesce();
        }
        is_set_up.map(|_| true)
    }

    /// Renews the set-up of a board that still has it. If it has lost it meanwhile, another set-up is
    /// needed.
    fn renew(&mut self, begun: Instant) -> Result<(), BusError> {
        let (bus, words) = (&mut *self.bus, &mut self.cycle.words);
        let renewed = self.exchanges.renew(bus, words);
        if renewed.is_ok() {
            let now = self.bus.now();
            self.cycle.looked(now);
        }
        if renewed.is_ok() && self.cycle.is_standing() {
            self.cycle.is_set_up_again(begun);
        } else {
            // A board that was reset meanwhile may drive pins without a watchdog.
            self.quiesce();
        }
        renewed
    }

    /// Lets go of all pins.
    fn quiesce(&mut self) {
        let (bus, words) = (&mut *self.bus, &mut self.cycle.words);
        // What fails here is tried again with the next write.
        let _ = self.exchanges.quiesce(bus, words);
        self.cycle.note_quiesced();
    }

    /// Discards the read that was requested ahead.
    pub(super) fn forget_started(&mut self) {
        let (bus, words) = (&mut *self.bus, &mut self.cycle.words);
        self.pacer.forget_started(bus, &self.exchanges, words);
    }

    #[cold]
    fn trace_read(&mut self, failed: Option<BusErrorKind>) {
        let (cycle, now) = (self.cycle.statistics.reads, self.bus.now());
        if let Some(trace) = &mut self.trace {
            trace.read(cycle, now, failed, &self.cycle.words);
        }
    }

    #[cold]
    fn trace_written(&mut self, failed: Option<BusErrorKind>) {
        let (cycle, now) = (self.cycle.statistics.reads, self.bus.now());
        if let Some(trace) = &mut self.trace {
            trace.written(cycle, now, failed, &self.cycle.words);
        }
    }

    /// Sends the request of the next read ahead, so that the read only takes the reply: with
    /// several boards, send all requests, then read all boards. LinuxCNC's `read-request`.
    ///
    /// Call it at the time at which the board is to be sampled, after [`write`](Self::write) and
    /// right before `read`. No effect where the [board paces](Pace::Board) or requests cannot be in
    /// flight; if it fails, the next read returns the reason.
    /// # Real time
    /// One packet out. No allocation.
    pub fn request_read(&mut self) {
        if self.pacer.pace == Pace::Host {
            let extra = self.cycle.wants_closer_look();
            let (bus, words) = (&mut *self.bus, &self.cycle.words);
            self.pacer.start_read(bus, &self.exchanges, words, extra);
        }
    }

    /// Waits until the transfers that the last write started are complete, or `limit` is over.
    ///
    /// Used for the "read-modify-write" of the manual's "NORMAL MODE OPERATION", and for measuring
    /// the duration of a transfer, which is recorded in [`PortStatistics::doit`].
    ///
    /// # Errors
    /// Those of the bus. `Ok(false)` when the limit came first, and at once where the [board
    /// paces](Pace::Board), because the next period has already been requested.
    ///
    /// # Real time
    /// Bounded by `limit` and one exchange, and by a number of polls on a bus whose clock stands
    /// still. No allocation.
    ///
    /// [`PortStatistics::doit`]: super::PortStatistics::doit
    pub fn wait_transfers(&mut self, limit: Duration) -> Result<bool, BusError> {
        self.wait_ports(limit, SerialPort::poll)
    }

    /// Waits until `are` is true for all ports, or `limit` is over; not where the board paces.
    pub(super) fn wait_ports(
        &mut self,
        limit: Duration,
        mut are: impl FnMut(&mut SerialPort, &Words, Instant) -> bool,
    ) -> Result<bool, BusError> {
        if self.pacer.pace == Pace::Board {
            return Ok(false);
        }
        // A reply that was requested ahead is older than the awaited state.
        self.forget_started();
        let start = self.bus.now();
        for _ in 0..MAX_POLLS {
            let (bus, words) = (&mut *self.bus, &mut self.cycle.words);
            self.exchanges.read_status(bus, words)?;
            let now = self.bus.now();
            let mut all = true;
            for port in &mut self.cycle.parts.ports {
                all &= are(port, &self.cycle.words, now);
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
}
