//! The cycle: `read()` and `write()` on a planned image, faults, recovery, statistics.
//!
//! A [`Driver`] is built once, which finds out what is there, sets it up and plans the registers
//! of a cycle. Then the application calls, once in each period:
//!
//! 1. [`Driver::read`]: one exchange. It is validated as a whole before any pin changes; then
//!    each part of the board takes its inputs.
//! 2. its own work on [`Driver::pins`] and [`Driver::pins_mut`];
//! 3. [`Driver::write`]: each part puts its outputs; one exchange, with DOIT after all data.
//!
//! The application waits for the next period between the two, or lets the board do that:
//! [`Pace::Board`].
//!
//! This is the manual's "cyclic access with write before read": what is read are the replies to
//! the last write. For read-modify-write call [`Driver::wait_transfers`] between `write` and `read`.
//!
//! # What can fail, and what happens then
//! In short; fault by fault in [`faults`].
//! - A transfer of a remote: its inputs are not taken, not valid, and grow older. Too many of
//!   them: the remote is set aside alone, its outputs are safe, and it is tried again with growing
//!   pauses, in small steps inside the cycle. See [`RemoteState`], [`FaultPolicy`].
//! - A remote reports a fault: it is set aside at once and not talked to, so that its own watchdog
//!   switches all its outputs off, and it is started again afterwards. See [`FaultPolicy`],
//!   [`RemoteStatus::faults`], [`RemoteStatus::first_fault`].
//! - The bus: nothing is taken; when it fails too often, everything is safe. See
//!   [`Builder::bus_error_limit`].
//! - The board's watchdog bites, or the board is reset: everything is safe. See [`BoardState`].
//!
//! Outputs that became safe stay so until the application re-arms them: one remote with
//! [`Pins::rearm`](crate::hal::Pins::rearm), everything with [`Driver::rearm`].
//!
//! # Real time
//! `read` and `write` do one exchange each, whose time the bus bounds; the rest is in proportion
//! to the words of process data. They do not allocate, log, or panic, and they do not wait, but
//! `read` for the next period of a board that paces.

mod attach;
mod board;
mod build;
mod config;
mod error;
#[doc = include_str!("../../docs/neighbours.md")]
pub mod neighbours {}

#[doc = include_str!("../../docs/faults.md")]
pub mod faults {}
mod evidence;
#[cfg(feature = "log")]
mod messages;
mod module;
mod modules;
mod pace;
mod parameters;
mod recovery;
mod remark;
mod report;
mod serial;
mod set_up;
mod settings;
mod setup_list;
mod stop;

pub use build::{Builder, EncoderSetup, GpioConfig};
pub use config::{RemoteConfig, SerialConfig, SerialConfigError};
pub use error::{BuildError, CycleError, MissingReason, MissingRemote};
pub use module::{Module, Put, SettingSlot, Take, WriteNews};
pub use pace::{Pace, PaceError};
pub use parameters::RemoteParameterError;
pub use remark::{Remark, RemarkKind};
pub use report::{BoardState, CycleReport, DriverStatistics, Rearmed};
pub use serial::{
    Failure, FailureCounts, FaultPolicy, PortStatistics, RemoteState, RemoteStatus, RemoteWatchdog,
    SerialPort, SetAside, TimeHistogram,
};
pub use settings::Settings;
pub use setup_list::SetupList;

use alloc::{boxed::Box, string::String, vec::Vec};
use core::time::Duration;

use crate::boards::fpga::FpgaPins;
use crate::bus::{Clock, CycleImage, ImageLists, ImageSize, Instant, RegisterBus, Reply, Tier};
use crate::hal::{GroupId, PinStore, Pins};
use crate::hostmot2::{HostMot2, IoPorts};
use board::{Board, BoardCheck};
use pace::{Answer, Beat, Pacer};
use set_up::{SetUp, SetUpLists};

/// A board with everything on it, in the cycle.
///
/// Dropping it stops every port and lets the watchdog bite: see [`shutdown`](Self::shutdown).
#[derive(Debug)]
pub struct Driver<B: RegisterBus + Clock> {
    bus: B,
    firmware: HostMot2,
    name: String,
    period: Duration,
    image: CycleImage,
    lists: Lists<B::List>,
    pins: PinStore,
    group: GroupId,
    board: Board,
    ports: Vec<SerialPort>,
    modules: Vec<Box<dyn Module>>,
    set_up: SetUp,
    /// The I/O ports.
    places: IoPorts,
    fpga_pins: FpgaPins,
    missing: Vec<MissingRemote>,
    remarks: Vec<Remark>,
    statistics: DriverStatistics,
    pacer: Pacer,
    /// What replies told since the last read, but its own.
    news: Reply,
    read_failures: u32,
    write_failures: u32,
    /// What happened to the writes since the modules took their inputs.
    writes: WriteNews,
    /// The next read holds all evidence: something happened since the last one that did which may
    /// have blurred what every cycle reads.
    look_closely: bool,
    /// Remotes are told safe values for the last time: nothing is restarted instead.
    is_last: bool,
    is_shut_down: bool,
}

/// What is exchanged, as the bus runs it.
#[derive(Debug)]
struct Lists<L> {
    image: ImageLists<L>,
    set_up: SetUpLists<L>,
}

impl<B: RegisterBus + Clock> Driver<B> {
    /// Starts to build a driver for the board on `bus`.
    pub fn builder(bus: B) -> Builder<B> {
        Builder::new(bus)
    }

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
        if self.is_shut_down {
            return Err(CycleError::ShutDown);
        }
        self.statistics.reads += 1;
        let tier = self.tier_of_read();
        let lists = &self.lists.image;
        let Answer { tier, at, result } =
            self.pacer.read(&mut self.bus, &mut self.image, lists, tier);
        let now = self.bus.now();
        self.pins.begin_cycle(now);
        match result {
            Ok(reply) => self.heard(reply),
            Err(source) => {
                let consecutive = self.read_failed();
                return Err(CycleError::Read {
                    source,
                    consecutive,
                });
            }
        }
        if let BoardCheck::NotThere(found) = self.board.check(&self.image) {
            let consecutive = self.read_failed();
            return Err(CycleError::NotThere { found, consecutive });
        }
        self.read_failures = 0;
        self.board.count_exchange(&mut self.pins, false);
        Ok(self.take(at, tier))
    }

    /// Everybody takes its inputs from an image that is sound, and was read at `now`.
    fn take(&mut self, now: Instant, tier: Tier) -> CycleReport {
        let Reply {
            certain,
            lost_writes,
            slack,
        } = core::mem::replace(&mut self.news, Reply::CERTAIN);
        let (lost_writes, doubtful) = (u64::from(lost_writes), !certain);
        self.statistics.lost_writes += lost_writes;
        self.writes.is_doubtful |= doubtful;
        self.image.confirm_writes(!doubtful);
        self.set_up.confirm(!doubtful);
        self.look_closely = doubtful || (self.look_closely && tier == Tier::Cycle);
        let beat = self.pacer.arrived(now, slack);
        let mut report = CycleReport {
            lost_writes,
            missed_periods: beat.missed,
            unpaced: beat.is_unpaced,
            slack,
            ..CycleReport::default()
        };
        self.statistics.missed_periods += beat.missed;
        self.statistics.unpaced_cycles += u64::from(beat.is_unpaced);
        let was_running = self.board.is_running();
        let evidence = &mut self.board.evidence;
        let finding = evidence.examine(&self.image, tier, now, !doubtful);
        self.found(finding);
        // What was read with bad evidence is not from the board that was set up.
        if was_running && !self.board.is_running() {
            for port in &mut self.ports {
                port.not_read(&mut self.pins);
            }
        } else {
            self.take_ports(now, doubtful, &mut report);
        }
        if self.board.is_running() {
            self.take_modules(now);
            report.locked = self.is_locked(beat, slack);
        } else {
            self.pacer.unlock();
            self.make_safe();
        }
        self.board.publish(&mut self.pins, &self.statistics);
        report.board = self.board.state();
        report
    }

    fn is_locked(&mut self, beat: Beat, slack: Option<Duration>) -> bool {
        let Some(dpll) = self.fpga_pins.dpll else {
            return false;
        };
        let error = self.pins.read(dpll.phase_error_us).value;
        self.pacer.lock(beat, slack, error)
    }

    fn take_ports(&mut self, now: Instant, doubtful: bool, report: &mut CycleReport) {
        for port in &mut self.ports {
            let outcome = port.take(&self.image, &mut self.pins, now, doubtful);
            report.good += outcome.good.len();
            report.failed += outcome.failed.len();
            report.set_aside += outcome.set_aside.len();
            report.too_short += u32::from(outcome.too_short);
        }
        if appears_reset(&self.ports) {
            self.fail(BoardState::Reset);
        }
    }

    fn take_modules(&mut self, now: Instant) {
        let mut cycle = Take {
            image: &self.image,
            pins: &mut self.pins,
            group: self.group,
            now,
            writes: core::mem::take(&mut self.writes),
        };
        for module in &mut self.modules {
            module.take(&mut cycle);
        }
        self.pins.group_good_since(self.group, 0, now);
    }

    /// Writes the outputs to the board and starts the transfers to its remotes.
    ///
    /// A port's transfer is started only when the last read has seen the one before end; otherwise
    /// its remotes keep what they have.
    ///
    /// # Errors
    /// [`CycleError::Write`]: the outputs may not have arrived; the next read finds out.
    ///
    /// # Real time
    /// One exchange, bounded by the bus. No allocation. In a cycle in which the application has
    /// changed the direction or the open drain of an I/O pin, one exchange more that looks whether
    /// the board is set up, and two for each port with such a pin.
    pub fn write(&mut self) -> Result<(), CycleError<B::Error>> {
        if self.is_shut_down {
            return Err(CycleError::ShutDown);
        }
        let mut now = self.bus.now();
        self.statistics.writes += 1;
        if self.board.wants_restore(&self.pins) && self.write_set_up().is_ok() {
            now = self.bus.now();
        }
        let was_running = self.board.is_running();
        self.put(now);
        // What fails is tried again with the next write; this one goes on without it.
        let _ = self.open_gates();
        self.keep_quiet();
        if was_running && !self.board.is_running() {
            self.give_up_write();
            return Ok(());
        }
        self.writes.is_repeated |= self.image.has_requests();
        if let Some(deadline) = self.board.new_deadline(&self.pins, self.period) {
            self.bus.set_cycle_deadline(deadline);
        }
        let lists = &self.lists.image;
        let result = self.image.exchange_writes(&mut self.bus, lists);
        let done = self.bus.now();
        if self.board.is_running() {
            self.board.evidence.fed(done);
        }
        for port in &mut self.ports {
            port.written(done, result.is_ok());
        }
        let next = self.tier_of_read();
        let lists = &self.lists.image;
        self.pacer
            .ask_ahead(&mut self.bus, &self.image, lists, next);
        match result {
            Ok(()) => {
                self.write_failures = 0;
                Ok(())
            }
            Err(source) => {
                self.statistics.write_errors += 1;
                self.look_closely = true;
                self.write_failures = self.write_failures.saturating_add(1);
                let consecutive = self.write_failures;
                if self.board.count_exchange(&mut self.pins, true) {
                    self.fail(BoardState::BusDown);
                    // Before the next write, which looks whether the application has cleared it.
                    self.board.publish(&mut self.pins, &self.statistics);
                }
                Err(CycleError::Write {
                    source,
                    consecutive,
                })
            }
        }
    }

    /// The board was found not to be set up when its outputs were put already: nothing of them is
    /// written.
    fn give_up_write(&mut self) {
        let now = self.bus.now();
        for port in &mut self.ports {
            port.written(now, false);
        }
        // Before the next write, which looks whether the application has cleared it.
        self.board.publish(&mut self.pins, &self.statistics);
    }

    /// Everybody puts its outputs into the image.
    fn put(&mut self, now: Instant) {
        // A board that is not set up gets nothing of its set-up before it gets all of it.
        let hold = !self.board.is_running();
        for port in &mut self.ports {
            let pins = &mut self.pins;
            port.put(&mut self.image, pins, now, hold || self.is_last);
        }
        let mut cycle = Put {
            image: &mut self.image,
            pins: &mut self.pins,
            group: self.group,
            now,
            set_up: &mut self.set_up,
        };
        for module in &mut self.modules {
            module.put(&mut cycle);
        }
        self.look_closely |= self.board.put(&mut self.image, &self.pins);
        if hold {
            self.image.forget_requests();
        }
    }

    /// Sends the request of the next read ahead, which then only takes the reply: with several
    /// boards, send all requests, then read all boards. LinuxCNC's `read-request`.
    ///
    /// Call it when the board is to be sampled, after [`write`](Self::write) and right before
    /// `read`. It does nothing where the [board paces](Pace::Board) or requests can not be under
    /// way, and when it fails, the next read says why.
    ///
    /// # Real time
    /// One packet out. No allocation.
    pub fn request_read(&mut self) {
        if self.pacer.pace() == Pace::Host && !self.is_shut_down {
            let tier = self.tier_of_read();
            let lists = &self.lists.image;
            self.pacer.post(&mut self.bus, &self.image, lists, tier);
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
    pub fn wait_transfers(&mut self, limit: Duration) -> Result<bool, B::Error> {
        self.wait_ports(limit, SerialPort::poll)
    }

    /// Waits until all ports are, or `limit` is over; not where the board paces.
    fn wait_ports(
        &mut self,
        limit: Duration,
        mut are: impl FnMut(&mut SerialPort, &CycleImage, Instant) -> bool,
    ) -> Result<bool, B::Error> {
        if self.pacer.pace() == Pace::Board {
            return Ok(false);
        }
        // A reply that was asked for ahead is older than what is waited for.
        self.forget_posted();
        let start = self.bus.now();
        for _ in 0..MAX_POLLS {
            let reply = self
                .image
                .exchange_status(&mut self.bus, &self.lists.image)?;
            self.heard(reply);
            let now = self.bus.now();
            let mut all = true;
            for port in &mut self.ports {
                all &= are(port, &self.image, now);
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

    /// Keeps what a reply told for the next [`take`](Self::take).
    fn heard(&mut self, reply: Reply) {
        self.news = self.news.and(reply);
    }

    /// What was asked for ahead is of no use any more.
    fn forget_posted(&mut self) {
        let lists = &self.lists.image;
        let reply = self
            .pacer
            .forget_posted(&mut self.bus, &mut self.image, lists);
        self.heard(reply);
    }

    /// What the next read must hold.
    fn tier_of_read(&self) -> Tier {
        match read_tier(&self.ports) {
            Tier::Cycle if self.look_closely => Tier::Evidence,
            tier => tier,
        }
    }
}

/// Between two polls of COMMAND.
const POLL_PAUSE: Duration = Duration::from_micros(1);
/// Ends the polling on a bus whose clock stands still.
const MAX_POLLS: u32 = 100_000;

/// Whether every remote of every port is found stopped, by nobody's order.
fn appears_reset(ports: &[SerialPort]) -> bool {
    let mut appear = ports.iter().filter_map(SerialPort::appears_reset);
    appear.next() == Some(true) && appear.all(|one| one)
}

fn read_tier(ports: &[SerialPort]) -> Tier {
    if ports
        .iter()
        .any(|port| port.tier_of_read() == Tier::Extended)
    {
        Tier::Extended
    } else {
        Tier::Cycle
    }
}

/// What an application asks.
impl<B: RegisterBus + Clock> Driver<B> {
    /// All pins and parameters.
    pub fn pins(&self) -> &Pins {
        &self.pins
    }

    /// All pins and parameters, to set them.
    pub fn pins_mut(&mut self) -> &mut Pins {
        &mut self.pins
    }

    /// The pins of the board's own modules. [`I7i97`](crate::boards::I7i97) has those of a 7I97 by
    /// their terminals.
    pub fn fpga_pins(&self) -> &FpgaPins {
        &self.fpga_pins
    }

    /// The group of the board's own pins.
    pub fn group(&self) -> GroupId {
        self.group
    }

    /// What the names of its pins begin with, for example `hm2_7i92.0`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The period it was planned for.
    pub fn period(&self) -> Duration {
        self.period
    }

    /// What the board's firmware says of itself.
    pub fn firmware(&self) -> &HostMot2 {
        &self.firmware
    }

    /// The serial ports.
    pub fn ports(&self) -> &[SerialPort] {
        &self.ports
    }

    /// Remotes that were configured and do not take part, with the reason.
    pub fn missing(&self) -> &[MissingRemote] {
        &self.missing
    }

    /// What is odd about the remotes that run: where they differ from the built-in tables of their
    /// kind, and problems of their tables that do not keep them from running.
    pub fn remarks(&self) -> &[Remark] {
        &self.remarks
    }

    /// State of the board itself.
    pub fn board_state(&self) -> BoardState {
        self.board.state()
    }

    /// What was counted so far.
    pub fn statistics(&self) -> DriverStatistics {
        self.statistics
    }

    /// What a cycle moves over the bus.
    pub fn image_size(&self) -> ImageSize {
        self.image.size()
    }

    /// The image, for people who want to see its accesses.
    pub fn image(&self) -> &CycleImage {
        &self.image
    }

    /// The lists of a cycle, as the bus runs them.
    pub fn lists(&self) -> &ImageLists<B::List> {
        &self.lists.image
    }

    /// The bus.
    pub fn bus(&self) -> &B {
        &self.bus
    }

    /// The bus, for example to let its time pass. Do not write to the board's registers.
    pub fn bus_mut(&mut self) -> &mut B {
        &mut self.bus
    }
}
