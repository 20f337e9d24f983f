//! Publication of a cycle's values to other threads.

#[cfg(feature = "serde")]
mod form;
mod view;

pub use view::{RemoteSnapshot, Snapshot};

use crate::advice::{self, Advice, MesaError};
use alloc::boxed::Box;
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::slice;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering, fence};
use core::time::Duration;

use super::RunStatistics;
use crate::bus::{Clock, HostClock, Instant, RegisterBus};
use crate::driver::{BoardState, Driver, RemoteState, RemoteStatus, SerialPort};
use crate::hal::{GroupId, PinError, PinId, PinInfo, Pins};
use crate::packed::{Packed, WordSink};
use crate::sslbp::RemoteLabel;
use crate::tally::Tally;

/// Published values are valid for this time; for 3 periods, if these are longer.
const MAX_AGE: Duration = Duration::from_millis(100);
const MAX_AGE_PERIODS: u32 = 3;

/// Number of tries of a reader to get a consistent set.
const TRIES: u32 = 100;

/// Publishes all state of a driver to other threads, once in each cycle: for a GUI, a logger or a
/// scope.
///
/// A [`Runner`](super::Runner) has a writer after a call of
/// [`Runner::snapshot`](super::Runner::snapshot); a program with its own loop calls
/// [`publish`](Self::publish) at the end of each cycle.
///
/// ```
/// use mesa_hal::{Driver, Settings, runner::SnapshotWriter};
/// use mesa_hal_sim::machines;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let board = machines::six_axes_7i92(Default::default());
/// let mut driver = Driver::start(board, Settings::default())?;
/// let limit = driver.pins().input::<bool>("hm2_7i92.0.7i77.0.0.input-02")?;
/// let mut writer = SnapshotWriter::new(&driver);
/// let reader = writer.reader(); // `Clone`, and goes to any thread
/// let _ = driver.read()?;
/// driver.write()?;
/// writer.publish(&driver)?;
/// let seen = std::thread::spawn(move || reader.read()).join().unwrap()?;
/// assert_eq!(seen.cycle(), 1);
/// assert!(!seen.read(limit).value);
/// # Ok(())
/// # }
/// ```
///
/// # Real time
/// [`publish`](Self::publish) stores one word for each pin and a few for each remote, and never
/// blocks: readers neither lock nor delay it. It does not allocate; [`new`](Self::new) does.
#[derive(Debug)]
pub struct SnapshotWriter {
    shared: Arc<SnapshotBuffer>,
    sequence: u64,
    since: ChangeTimes,
}

/// Times of the last changes of state.
#[derive(Debug)]
struct ChangeTimes {
    board: (BoardState, Instant),
    /// For each remote, true while it runs, and the time since; `None` while the board is not
    /// reached.
    remotes: Vec<(Option<bool>, Instant)>,
}

/// Takes snapshots, in any thread.
#[derive(Clone, Debug)]
pub struct SnapshotReader {
    shared: Arc<SnapshotBuffer>,
}

/// Reason why there is no snapshot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SnapshotError {
    /// Nothing was published yet.
    #[error("no cycle has ended yet")]
    NotYet,
    /// Each copy was disturbed by a new cycle.
    #[error(
        "no whole set of values in {tries} tries: each copy took longer than the cycle leaves \
         between two"
    )]
    Torn {
        /// Number of tries.
        tries: u32,
    },
}

impl MesaError for SnapshotError {
    fn advice(&self) -> Option<Advice> {
        Some(match self {
            Self::NotYet => advice::TRY_NEXT_PERIOD,
            Self::Torn { .. } => advice::TRY_LATER,
        })
    }
}

/// State shared by the writer and its readers.
///
/// A sequence lock: the number is odd while words are written, and a new even one afterwards. A
/// reader that finds the same even number before and after its copy has a consistent set.
#[derive(Debug)]
struct SnapshotBuffer {
    sequence: AtomicU64,
    words: Box<[AtomicU64]>,
    /// Time of publication, in nanoseconds on `clock`.
    published: AtomicU64,
    clock: HostClock,
    /// Time for which the words are fresh.
    fresh: Duration,
    has_ended: AtomicBool,
    layout: SnapshotLayout,
}

/// Constant data, and the positions of the words that change.
#[derive(Debug)]
struct SnapshotLayout {
    infos: Vec<PinInfo>,
    /// Any pin, which identifies the driver that the pins belong to.
    pin: PinId,
    groups: Vec<GroupId>,
    /// The number of each pin's group.
    group_of: Vec<u32>,
    places: Vec<(RemoteLabel, GroupId)>,
    /// The first words of the groups, the remotes, the values and the flags.
    groups_at: usize,
    remotes_at: usize,
    values_at: usize,
    flags_at: usize,
}

struct SnapshotWords<'a>(slice::Iter<'a, AtomicU64>);

impl WordSink for SnapshotWords<'_> {
    fn put(&mut self, value: u64) {
        if let Some(word) = self.0.next() {
            word.store(value, Ordering::Relaxed);
        }
    }
}

impl SnapshotWriter {
    /// A writer for a driver. Nothing is published yet.
    pub fn new<B: RegisterBus + Clock>(driver: &Driver<B>) -> Self {
        let now = driver.pins().now();
        let places = remotes(driver).map(|remote| (remote.label, remote.pins.group));
        let places: Vec<_> = places.collect();
        let since = ChangeTimes {
            board: (driver.board_state(), now),
            remotes: places.iter().map(|_| (Some(true), now)).collect(),
        };
        let (layout, words) = SnapshotLayout::new(driver, places, &since);
        let words = (0..words).map(|_| AtomicU64::new(0)).collect();
        Self {
            shared: Arc::new(SnapshotBuffer {
                sequence: AtomicU64::new(0),
                words,
                published: AtomicU64::new(0),
                clock: HostClock::new(),
                fresh: MAX_AGE.max(driver.period().saturating_mul(MAX_AGE_PERIODS)),
                has_ended: AtomicBool::new(false),
                layout,
            }),
            sequence: 0,
            since,
        }
    }

    /// A reader for another thread. Does not allocate.
    pub fn reader(&self) -> SnapshotReader {
        SnapshotReader {
            shared: Arc::clone(&self.shared),
        }
    }

    /// Publishes the state after a cycle. The statistics of a run, which only a
    /// [`Runner`](super::Runner) has, are all zero here.
    ///
    /// # Errors
    /// [`PinError::ForeignHandle`] if the writer was made for another driver; nothing is published
    /// then.
    ///
    /// # Real time
    /// In proportion to the number of pins; never blocks, no allocation.
    pub fn publish<B: RegisterBus + Clock>(&mut self, driver: &Driver<B>) -> Result<(), PinError> {
        self.publish_run(driver, &RunStatistics::default())
    }

    /// As [`publish`](Self::publish), with the statistics of a run.
    ///
    /// # Errors
    /// As [`publish`](Self::publish).
    ///
    /// # Real time
    /// As [`publish`](Self::publish).
    pub fn publish_run<B: RegisterBus + Clock>(
        &mut self,
        driver: &Driver<B>,
        run: &RunStatistics,
    ) -> Result<(), PinError> {
        if !self.shared.layout.is_of(driver.pins()) {
            return Err(PinError::ForeignHandle);
        }
        self.since.look(driver);
        let SnapshotBuffer {
            sequence,
            words,
            published,
            ..
        } = &*self.shared;
        let now = self.shared.now();
        sequence.store(self.sequence.wrapping_add(1), Ordering::Relaxed);
        // No new word becomes visible before the odd number.
        fence(Ordering::Release);
        record(driver, run, &self.since, &mut SnapshotWords(words.iter()));
        published.store(now, Ordering::Relaxed);
        self.sequence = self.sequence.wrapping_add(2);
        sequence.store(self.sequence, Ordering::Release);
        Ok(())
    }
}

impl SnapshotBuffer {
    /// Nanoseconds on the clock of this host.
    fn now(&self) -> u64 {
        self.clock.read().as_nanos()
    }
}

/// Notifies readers that nothing more will be published.
impl Drop for SnapshotWriter {
    fn drop(&mut self) {
        self.shared.has_ended.store(true, Ordering::Release);
    }
}

impl ChangeTimes {
    fn look<B: RegisterBus + Clock>(&mut self, driver: &Driver<B>) {
        let now = driver.pins().now();
        if self.board.0 != driver.board_state() {
            self.board = (driver.board_state(), now);
        }
        for (since, remote) in self.remotes.iter_mut().zip(remotes(driver)) {
            let is_reached = driver.board_state().is_reached();
            let runs = is_reached.then_some(remote.state == RemoteState::Running);
            if since.0 != runs {
                *since = (runs, now);
            }
        }
    }
}

fn remotes<B: RegisterBus + Clock>(driver: &Driver<B>) -> impl Iterator<Item = RemoteStatus<'_>> {
    let ports = driver.ports().iter();
    ports.flat_map(SerialPort::remotes)
}

/// All words of a cycle, in the order of the [`SnapshotLayout`].
fn record<B: RegisterBus + Clock>(
    driver: &Driver<B>,
    run: &RunStatistics,
    since: &ChangeTimes,
    to: &mut impl WordSink,
) {
    record_head(driver, run, since, to);
    record_groups(driver.pins(), to);
    record_remotes(driver, since, to);
    record_values(driver.pins(), to);
    record_flags(driver.pins(), to);
}

fn record_head<B: RegisterBus + Clock>(
    driver: &Driver<B>,
    run: &RunStatistics,
    since: &ChangeTimes,
    to: &mut impl WordSink,
) {
    driver.pins().cycle().pack(to);
    driver.pins().now().pack(to);
    since.board.0.pack(to);
    since.board.1.pack(to);
    run.pack(to);
    driver.statistics().pack(to);
    driver.bus().statistics().pack(to);
}

fn record_groups(pins: &Pins, to: &mut impl WordSink) {
    for state in pins.groups().filter_map(|group| pins.group_state(group)) {
        state.pack(to);
    }
}

fn record_remotes<B: RegisterBus + Clock>(
    driver: &Driver<B>,
    since: &ChangeTimes,
    to: &mut impl WordSink,
) {
    for (remote, &(_, since)) in remotes(driver).zip(&since.remotes) {
        since.pack(to);
        remote.state.pack(to);
        remote.first_fault.pack(to);
        remote.faults.pack(to);
        for count in [remote.transfers, remote.failures.total(), remote.restarts] {
            to.put(count);
        }
    }
}

fn record_values(pins: &Pins, to: &mut impl WordSink) {
    pins.raw_values().for_each(|(bits, _)| to.put(bits));
}

/// One bit for each pin: its last value was refused or withheld.
fn record_flags(pins: &Pins, to: &mut impl WordSink) {
    let (mut flags, mut count) = (0, 0);
    for (_, is_bad) in pins.raw_values() {
        flags |= u64::from(is_bad) << count;
        count.tally(1);
        if count == u64::BITS {
            to.put(flags);
            (flags, count) = (0, 0);
        }
    }
    to.put(flags);
}

impl SnapshotLayout {
    /// The layout, and the number of words.
    fn new<B: RegisterBus + Clock>(
        driver: &Driver<B>,
        places: Vec<(RemoteLabel, GroupId)>,
        since: &ChangeTimes,
    ) -> (Self, usize) {
        let pins = driver.pins();
        let groups: Vec<_> = pins.groups().collect();
        let group_of = pins.infos().iter().map(|info| {
            let group = groups.iter().position(|&group| group == info.group);
            debug_assert!(group.is_some(), "a group of another store");
            group.unwrap_or_default() as u32
        });
        let mut words = 0;
        record_head(driver, &RunStatistics::default(), since, &mut words);
        let groups_at = words;
        record_groups(pins, &mut words);
        let remotes_at = words;
        record_remotes(driver, since, &mut words);
        let values_at = words;
        record_values(pins, &mut words);
        let flags_at = words;
        record_flags(pins, &mut words);
        let layout = Self {
            infos: pins.infos().to_vec(),
            pin: pins.ids().next().unwrap_or_default(),
            group_of: group_of.collect(),
            groups,
            places,
            groups_at,
            remotes_at,
            values_at,
            flags_at,
        };
        (layout, words)
    }

    fn is_of(&self, pins: &Pins) -> bool {
        let pin = pins.ids().next().unwrap_or_default();
        pin == self.pin && pins.infos().len() == self.infos.len()
    }
}

impl SnapshotReader {
    /// The pins and parameters, in the order of their values: as [`Pins::infos`].
    pub fn infos(&self) -> &[PinInfo] {
        &self.shared.layout.infos
    }

    /// The values that the cycle published last. They are old if the cycle has ended, or hangs: see
    /// [`Snapshot::is_fresh`].
    ///
    /// # Errors
    /// [`SnapshotError`].
    ///
    /// # Real time
    /// For other threads than that of the cycle: allocates, tries at most 100 times, and yields its
    /// CPU between two tries.
    pub fn read(&self) -> Result<Snapshot, SnapshotError> {
        let mut snapshot = Snapshot {
            shared: Arc::clone(&self.shared),
            words: Vec::new(),
            age: Duration::MAX,
            has_ended: false,
        };
        self.read_into(&mut snapshot)?;
        Ok(snapshot)
    }

    /// As [`read`](Self::read), into an earlier snapshot, without allocation. After an error the
    /// values of the snapshot belong to no cycle.
    ///
    /// # Errors
    /// [`SnapshotError`].
    pub fn read_into(&self, snapshot: &mut Snapshot) -> Result<(), SnapshotError> {
        let shared = &*self.shared;
        if !Arc::ptr_eq(&self.shared, &snapshot.shared) {
            snapshot.shared = Arc::clone(&self.shared);
        }
        snapshot.words.resize(shared.words.len(), 0);
        for _ in 0..TRIES {
            let before = shared.sequence.load(Ordering::Acquire);
            if before == 0 {
                return Err(SnapshotError::NotYet);
            }
            if before.is_multiple_of(2) {
                // If the end is visible here, the words read below are the last ones.
                snapshot.has_ended = self.has_ended();
                for (copy, word) in snapshot.words.iter_mut().zip(&shared.words) {
                    *copy = word.load(Ordering::Relaxed);
                }
                let published = shared.published.load(Ordering::Relaxed);
                // No word is loaded after the number.
                fence(Ordering::Acquire);
                if shared.sequence.load(Ordering::Relaxed) == before {
                    let age = shared.now().saturating_sub(published);
                    snapshot.age = Duration::from_nanos(age);
                    return Ok(());
                }
            }
            std::thread::yield_now();
        }
        Err(SnapshotError::Torn { tries: TRIES })
    }

    /// True if the writer no longer exists: the last published values are final.
    pub fn has_ended(&self) -> bool {
        self.shared.has_ended.load(Ordering::Acquire)
    }
}

#[cfg(test)]
mod tests;
