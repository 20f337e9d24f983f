//! The two halves of a cycle, on the bus.

use core::time::Duration;

use super::cycle::{CycleWrite, Exchange, Next, Outcome, Separate};
use super::{CycleError, CycleReport, Driver, Pace, SerialPort};
use crate::bus::{BusError, Clock, Effort, Instant, ReadRequest, RegisterBus, Words};

/// Pause between two polls of COMMAND.
const POLL_PAUSE: Duration = Duration::from_micros(1);
/// Ends the polling on a bus whose clock stands still.
const MAX_POLLS: u32 = 100_000;

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
        let read = self.cycle.begin_read();
        self.run(read)?;
        Ok(self.cycle.report)
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
        let now = self.bus.now();
        let write = self.cycle.begin_write(now);
        self.run(write)
    }

    /// Reads a board that waits to be re-armed, without a write, so that its positions are
    /// followed and stay exact: see [`faults`](crate::guides::faults), "Positions". For an
    /// application that neither reads nor writes meanwhile, like the component for LinuxCNC.
    /// Returns true if the board was read.
    ///
    /// Inputs keep their values, which are not valid. A read that fails is neither counted nor
    /// reported, because the fault before it was; a reset that it finds is.
    ///
    /// # Real time
    /// One exchange. None, and false, for a board that runs, or in whose place another one has
    /// answered. No allocation.
    pub fn follow(&mut self) -> bool {
        let follow = self.cycle.begin_following();
        follow.is_some_and(|follow| self.run(follow).is_ok())
    }

    /// Does the exchanges that the cycle orders, up to the end of the operation.
    pub(super) fn run(&mut self, mut next: Next) -> Result<(), CycleError> {
        loop {
            next = match next {
                Next::Order(order) => {
                    let outcome = self.exchange(order.exchange());
                    let now = self.bus.now();
                    self.cycle.after(order, outcome, now)
                }
                Next::End(result) => return result,
            }
        }
    }

    fn exchange(&mut self, exchange: Exchange) -> Outcome {
        match exchange {
            Exchange::Read { extra } => {
                let (bus, words) = (&mut self.bus, &mut self.cycle.words);
                self.pacer.read(bus, &self.exchanges, words, extra)
            }
            Exchange::Write(form) => self.write_cycle(form),
            Exchange::Separate(exchange) => self.exchange_apart(exchange),
        }
    }

    fn write_cycle(&mut self, form: CycleWrite) -> Outcome {
        let period = self.pacer.period;
        if let Some(deadline) = self.cycle.new_deadline(period) {
            self.bus.set_cycle(period, Some(deadline));
        }
        let from = self.bus.now();
        let (bus, words) = (&mut self.bus, &mut self.cycle.words);
        let result = self.pacer.write(bus, &mut self.exchanges, words, form);
        Outcome::new(from, result)
    }

    /// Does an exchange that is neither the read nor the write of a cycle.
    #[cold]
    fn exchange_apart(&mut self, exchange: Separate) -> Outcome {
        // A reply that was requested before shows nothing of the board's present state.
        self.forget_started();
        let from = self.bus.now();
        let mut is_same = true;
        let (bus, words) = (&mut self.bus, &mut self.cycle.words);
        let result = match exchange {
            Separate::Evidence => self.exchanges.read_evidence(bus, words),
            Separate::Status => self.exchanges.read_status(bus, words),
            Separate::Guarded => self.exchanges.write_guarded(bus, words),
            Separate::Quiesce => self.exchanges.quiesce(bus, words),
            Separate::SetUp => self.exchanges.set_up(bus, words),
            Separate::Renewal => self.exchanges.renew(bus, words),
            Separate::Firmware => {
                let compared = self.description.is_still(bus, Effort::Once);
                compared.map(|same| is_same = same)
            }
            Separate::Everything => self.read_all(),
        };
        Outcome {
            is_same,
            ..Outcome::new(from, result)
        }
    }

    /// Reads all registers in a separate exchange.
    fn read_all(&mut self) -> Result<(), BusError> {
        let (bus, words) = (&mut self.bus, &mut self.cycle.words);
        let ask = ReadRequest {
            held: false,
            extra: true,
            after: None,
        };
        let started = self.exchanges.start_read(bus, words, ask)?;
        self.exchanges.finish(bus, words, started)
    }

    /// Discards the read that was requested ahead.
    pub(super) fn forget_started(&mut self) {
        let (bus, words) = (&mut self.bus, &mut self.cycle.words);
        self.pacer.forget_started(bus, &self.exchanges, words);
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
            let (bus, words) = (&mut self.bus, &self.cycle.words);
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
            let (bus, words) = (&mut self.bus, &mut self.cycle.words);
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
