//! How everything becomes safe, and comes back.

use super::{BoardState, CycleError, Driver, EventKind, Rearmed};
use crate::bus::{Clock, Effort, Instant, RegisterBus};
use crate::modules::Module;
use crate::sslbp::Channel;
use crate::tally::Tally;

/// Who answers where the board was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Answering {
    /// The board with the firmware that was set up.
    Same,
    /// No HostMot2, as during a reset.
    Nobody,
    /// Another board, or another firmware.
    Other,
}

impl<B: RegisterBus + Clock> Driver<B> {
    /// Lets all outputs follow the application again, after whatever made them safe.
    ///
    /// A board that has lost its set-up gets it back first, all of it in one exchange, and is asked
    /// whether it has it; if it is the same firmware that answers. What was set before this call is
    /// forgotten, be it before the fault, while it lasted or in the same cycle: outputs that were not
    /// armed start from their safe values and follow what is set from now on.
    ///
    /// After a bite or a reset the board's own outputs follow with the next good read, and remotes
    /// when they run again: they are counted as coming, and armed by this call, unless a fault comes
    /// before. What is set until then is forgotten as well. Other remotes that do not run yet are
    /// counted as waiting only; so is everything, if the board has lost its set-up again meanwhile.
    ///
    /// # Errors
    /// Those of the bus, and [`CycleError::OtherFirmware`]; then nothing is armed.
    ///
    /// # Real time
    /// As `write`, and eight more exchanges when the board has to be set up again, after the reply that
    /// is waited for where the board paces. No allocation.
    pub fn rearm(&mut self) -> Result<Rearmed, CycleError<B::Error>> {
        if !self.is_running() {
            self.write_set_up()?;
        }
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
            let now = self.bus.now();
            self.events.tell(now, EventKind::Rearmed { armed, waiting });
        }
        Ok(Rearmed {
            armed,
            waiting,
            coming,
        })
    }

    /// Restarts the remote on `channel` (0 to 7) of `port` in the next cycles, which clears the
    /// faults it reports: at once, but for one that is offline not before its own watchdog must have
    /// bitten. Its outputs are safe until it is re-armed. `false`, and nothing is done, if none takes
    /// part there.
    pub fn restart(&mut self, port: u8, channel: u8) -> bool {
        let now = self.bus.now();
        let port = self.parts.ports.get_mut(usize::from(port));
        let Some((port, channel)) = port.zip(Channel::new(channel)) else {
            return false;
        };
        let is_there = port.remote(channel).is_some();
        port.restart(channel.mask(), &mut self.pins, now);
        is_there
    }

    pub(super) fn is_running(&self) -> bool {
        self.state == BoardState::Running
    }

    /// Whether the application has cleared the flag of what made everything safe, and with that
    /// asks for the set-up to be written again.
    pub(super) fn wants_restore(&self) -> bool {
        match self.state {
            BoardState::Running => false,
            BoardState::WatchdogBitten => self.parts.watchdog.is_cleared(&self.pins),
            BoardState::Reset | BoardState::BusDown | BoardState::OtherFirmware => {
                self.connection.is_cleared(&self.pins)
            }
        }
    }

    /// Writes the set-up that the board has lost. If the board shows that it has it, it runs, and so
    /// does its watchdog; else everything stays as it is. Another firmware gets nothing: its registers
    /// have other meanings, and its pins other wires.
    pub(super) fn write_set_up(&mut self) -> Result<(), CycleError<B::Error>> {
        let is_same = self.set_up_same();
        match is_same {
            Ok(true) => Ok(()),
            Ok(false) => {
                self.is_other_firmware();
                Err(CycleError::OtherFirmware)
            }
            Err(source) => Err(CycleError::Write {
                source,
                consecutive: self.write_failures.saturating_add(1),
            }),
        }
    }

    /// Another firmware answers. The application has to clear the error before it is asked again.
    pub(super) fn is_other_firmware(&mut self) {
        let state = BoardState::OtherFirmware;
        if core::mem::replace(&mut self.state, state) != state {
            let now = self.bus.now();
            self.events.tell(now, EventKind::OtherFirmware);
        }
        // The flag again, also if it was shown before.
        self.shown = None;
        self.publish();
    }

    /// Whether the board is the one that the driver was started with.
    pub(super) fn who_answers(&mut self) -> Result<Answering, B::Error> {
        let Self { bus, image, .. } = self;
        // What is read around a reset is no firmware: another one says so twice.
        for _ in 0..2 {
            // An FPGA without its configuration could have it again in the middle of an exchange, and
            // take the end of the set-up, which drives the pins, without its beginning.
            image.read_status(&mut **bus)?;
            if self.connection.check(&image.words).is_err() {
                return Ok(Answering::Nobody);
            }
            if self.description.is_still(&mut **bus, Effort::Once)? {
                return Ok(Answering::Same);
            }
        }
        Ok(Answering::Other)
    }

    /// False if another firmware answers.
    fn set_up_same(&mut self) -> Result<bool, B::Error> {
        let now = self.bus.now();
        // What was asked for before says nothing of the board as it is now.
        self.pacer.forget_started(&mut *self.bus, &mut self.image);
        match self.who_answers()? {
            Answering::Same => {}
            Answering::Nobody => return Ok(true),
            Answering::Other => return Ok(false),
        }
        let Self { bus, image, .. } = self;
        let is_set_up = image
            .set_up(&mut **bus)
            .map(|()| self.parts.watchdog.is_set_up(&image.words));
        if !matches!(is_set_up, Ok(true)) {
            // It may be set up, and nobody feeds it.
            let _ = image.quiesce(&mut **bus);
            return is_set_up.map(|_| true);
        }
        image.words.all_set();
        self.look_closely = true;
        for part in self.parts.each() {
            part.restored(&mut self.pins, now);
        }
        self.state = BoardState::Running;
        self.events.tell(now, EventKind::BoardSetUp);
        self.connection.level = 0;
        self.read_failures = 0;
        self.write_failures = 0;
        Ok(true)
    }

    /// Writes settings that drive pins, where they have changed. That could drive what the rest of
    /// the set-up protects, so the board shows before and after it that it is set up. What did not
    /// arrive is tried again with the next write.
    pub(super) fn write_guarded(&mut self) -> Result<(), B::Error> {
        if !self.is_running() || !self.image.words.has_guarded_news() {
            return Ok(());
        }
        self.pacer.forget_started(&mut *self.bus, &mut self.image);
        self.look_closely = true;
        self.look()?;
        if !self.is_running() {
            return Ok(());
        }
        let begun = self.bus.now();
        self.parts.watchdog.sending(begun);
        self.image.write_guarded(&mut *self.bus)?;
        let now = self.bus.now();
        self.parts.watchdog.written(now, true);
        self.look()?;
        if self.is_running() {
            self.image.words.guarded_sent();
        }
        Ok(())
    }

    /// Reads all evidence alone, and makes everything safe if the board is not set up any more.
    fn look(&mut self) -> Result<(), B::Error> {
        self.image.read_evidence(&mut *self.bus)?;
        let now = self.bus.now();
        let words = &self.image.words;
        let finding = self.parts.watchdog.examine(words, true, now, true);
        self.found(finding);
        Ok(())
    }

    /// Makes everything safe if the board is not set up any more.
    pub(super) fn found(&mut self, failure: Option<BoardState>) {
        if let Some(state) = failure {
            self.note_reset();
            self.fail(state);
        }
    }

    /// A board that is back without its set-up after it was not heard, or had bitten, was reset as well:
    /// that is told beside what was first.
    fn note_reset(&mut self) {
        let was_silent = matches!(self.state, BoardState::BusDown | BoardState::WatchdogBitten);
        if was_silent && self.parts.watchdog.shows_reset(&self.image.words) {
            self.enter(BoardState::Reset);
        }
    }

    /// Makes all pins inputs, in each cycle in which the board is known not to be set up: whatever
    /// comes late drives them for no longer.
    pub(super) fn keep_quiet(&mut self) {
        if matches!(self.state, BoardState::WatchdogBitten | BoardState::Reset) {
            // What fails here fails in the write that follows, which reports it.
            let _ = self.image.quiesce(&mut *self.bus);
        }
    }

    /// A read failed as a whole, at `now`; how many in a row.
    pub(super) fn read_failed(&mut self, now: Instant, what: EventKind) -> u32 {
        self.rows.failed_reads.add(&self.events, now, 1, what);
        self.statistics.read_errors.tally(1);
        self.read_failures = self.read_failures.saturating_add(1);
        self.look_closely = true;
        self.not_read();
        if self.connection.count_exchange(&mut self.pins, true) {
            self.fail(BoardState::BusDown);
        }
        self.publish();
        self.read_failures
    }

    /// Nobody reads what he acts on: as good as a read that failed, but for its cause.
    pub(super) fn count_write(&mut self, now: Instant) {
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

    pub(super) fn not_read(&mut self) {
        for part in self.parts.each() {
            part.not_read(&mut self.pins);
        }
    }

    /// The board leaves the running state; everything is safe from now on.
    pub(super) fn fail(&mut self, state: BoardState) {
        if self.is_running() {
            self.enter(state);
        }
        self.make_safe();
    }

    fn enter(&mut self, state: BoardState) {
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
        let now = self.bus.now();
        self.events.tell(now, kind);
    }

    /// All inputs are not valid, all outputs safe until re-armed.
    pub(super) fn make_safe(&mut self) {
        self.pins.fault(self.group);
        for part in self.parts.each() {
            part.make_safe(&mut self.pins);
        }
    }
}
