//! Contents of a snapshot.

use alloc::sync::Arc;
use alloc::vec::Vec;
use core::fmt;
use core::time::Duration;

use super::SnapshotBuffer;
use crate::bus::{BusStatistics, Instant};
use crate::driver::{BoardState, DriverStatistics, OfflineReason, RemoteState};
#[cfg(doc)]
use crate::hal::Pins;
use crate::hal::{
    Age, AnyValue, GroupId, GroupState, HalType, Handle, PinId, PinInfo, Reading, Value,
};
use crate::packed::Packed;
use crate::runner::RunStatistics;
use crate::sslbp::{RemoteFaults, RemoteLabel};

/// All values that the cycle published, of the same time: after the write of a cycle.
///
/// Ages are those at the time when the snapshot was taken; later time is not included. If the
/// snapshot is not [fresh](Self::is_fresh), no pin is valid and no group is armed, whatever the
/// cycle published last.
///
/// With the feature `serde` it is serialized with all statistics, groups by their numbers, remotes,
/// and pins by their names. What does not change, [`infos`](Self::infos) describes.
#[derive(Clone, Debug)]
pub struct Snapshot {
    pub(super) shared: Arc<SnapshotBuffer>,
    pub(super) words: Vec<u64>,
    pub(super) age: Duration,
    pub(super) has_ended: bool,
}

/// A remote in a [`Snapshot`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct RemoteSnapshot {
    /// Its address and its name, in texts as `7i77.0.1`.
    #[cfg_attr(feature = "serde", serde(flatten))]
    pub label: RemoteLabel,
    /// The group of its pins.
    #[cfg_attr(feature = "serde", serde(skip))]
    pub group: GroupId,
    /// Time since which it has been running, or not running, as far as published; or since which
    /// that is unknown, because the board [is not reached](BoardState::is_reached).
    pub since: Instant,
    /// Its state, as last known.
    pub state: RemoteState,
    /// The first reason for going offline since it was last re-armed.
    pub first_fault: Option<OfflineReason>,
    /// Faults reported with its last reply.
    #[cfg_attr(
        feature = "serde",
        serde(serialize_with = "crate::serial_form::flags::serialize")
    )]
    pub faults: RemoteFaults,
    /// Its transfers so far, including failed ones.
    pub transfers: u64,
    /// Its failures so far.
    pub failures: u64,
    /// Number of restarts.
    pub restarts: u64,
}

/// The state of the machine in a line: `cycle 5021: the board runs, groups armed: 3 of 5, re-arm
/// pending: 1`.
impl fmt::Display for Snapshot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = self.cycle();
        let Some((board, groups)) = self.state() else {
            let millis = self.age.as_millis();
            let end = if self.has_ended { "has ended" } else { "hangs" };
            return write!(
                f,
                "the cycle {end}: the last, {number}, was {millis} ms ago"
            );
        };
        write!(f, "cycle {number}: {board}, groups armed: ")?;
        let count = |is: fn(&GroupState) -> bool| {
            let groups = groups.clone();
            groups.filter(|(_, state)| is(state)).count()
        };
        write!(f, "{} of {}", count(|state| state.armed), count(|_| true))?;
        match count(|state| state.rearm_pending) {
            0 => Ok(()),
            pending => write!(f, ", re-arm pending: {pending}"),
        }
    }
}

/// The next value. The words of a snapshot are those of values, so there is always one.
fn next<T: Packed + Default>(words: &mut impl Iterator<Item = u64>) -> T {
    let value = T::unpack(words);
    debug_assert!(value.is_some(), "the words of another layout");
    value.unwrap_or_default()
}

/// The words before those of the pins.
struct Head {
    cycle: u64,
    time: Instant,
    board: (BoardState, Instant),
    run: RunStatistics,
    driver: DriverStatistics,
    bus: BusStatistics,
}

impl Snapshot {
    /// The pins and parameters: as [`Pins::infos`].
    pub fn infos(&self) -> &[PinInfo] {
        &self.shared.layout.infos
    }

    /// Time between publication and the taking of the snapshot, on the clock of this host: less
    /// than a period while the cycle runs.
    pub fn age(&self) -> Duration {
        self.age
    }

    /// True if the cycle had not ended, and had published no longer ago than 100 ms, or 3 periods
    /// if these are longer. A cycle that hangs is treated as absent: its board's watchdog has
    /// bitten.
    pub fn is_fresh(&self) -> bool {
        !self.has_ended && self.age <= self.shared.fresh
    }

    /// The number of the cycle, from 1 on.
    pub fn cycle(&self) -> u64 {
        self.head().cycle
    }

    /// Start of the cycle, on the clock of the bus.
    pub fn time(&self) -> Instant {
        self.head().time
    }

    /// The last known state of the board, and the time since which it has had it.
    pub fn board(&self) -> (BoardState, Instant) {
        self.head().board
    }

    /// Statistics of the runner.
    pub fn run_statistics(&self) -> RunStatistics {
        self.head().run
    }

    /// Statistics of the driver.
    pub fn driver_statistics(&self) -> DriverStatistics {
        self.head().driver
    }

    /// Statistics of the bus.
    pub fn bus_statistics(&self) -> BusStatistics {
        self.head().bus
    }

    /// A pin by its handle: an input as it was read, an output as it was commanded, or a parameter.
    /// A handle of another driver returns zero, not valid.
    pub fn read<K: Copy, T: Value>(&self, pin: Handle<K, T>) -> Reading<T> {
        let found = self.reading(pin.into());
        let Reading { value, valid, age } = found.unwrap_or(Reading {
            value: (HalType::Bit, 0),
            valid: false,
            age: Age::NEVER,
        });
        Reading {
            value: T::from_bits(value.1),
            valid,
            age,
        }
    }

    /// A pin or parameter of any type; `None` for one of another driver.
    pub fn read_any(&self, pin: PinId) -> Option<Reading<AnyValue>> {
        let Reading { value, valid, age } = self.reading(pin)?;
        let (hal_type, bits) = value;
        Some(Reading {
            value: AnyValue { hal_type, bits },
            valid,
            age,
        })
    }

    /// All pins and parameters, in the order of [`infos`](Self::infos). A parameter is always
    /// valid.
    pub fn pins(&self) -> impl Iterator<Item = (&PinInfo, Reading<AnyValue>)> + '_ {
        let layout = &self.shared.layout;
        let all = layout.infos.iter().enumerate();
        all.filter_map(|(index, info)| {
            let pin = layout.pin.beside(index as u32);
            Some((info, self.read_any(pin)?))
        })
    }

    /// The state of a group; `None` for one of another driver.
    pub fn group_state(&self, group: GroupId) -> Option<GroupState> {
        let mut groups = self.shared.layout.groups.iter();
        let number = groups.position(|&other| other == group)?;
        Some(self.group(number))
    }

    /// The state of the machine for an operator, in one call: that of the board and of all groups;
    /// `None` if the snapshot is not [fresh](Self::is_fresh), so that nothing is known. `Display`
    /// writes it in a line.
    ///
    /// ```
    /// # use mesa_hal::{BoardState, Driver, Settings, runner::SnapshotWriter};
    /// # use mesa_hal_sim::machines;
    /// # let board = machines::six_axes_7i92(Default::default());
    /// # let mut driver = Driver::start(board, Settings::default())?;
    /// # let mut writer = SnapshotWriter::new(&driver);
    /// # let snapshots = writer.reader();
    /// # for _ in 0..3 {
    /// #     let _ = driver.read()?;
    /// #     driver.write()?;
    /// #     writer.publish(&driver)?;
    /// # }
    /// let snapshot = snapshots.read()?;
    /// let (board, mut groups) = snapshot.state().ok_or("the cycle hangs, or has ended")?;
    /// let may_start = board == BoardState::Running && groups.all(|(_, state)| state.armed);
    /// # assert!(may_start);
    /// println!("{snapshot}"); // cycle 3: the board runs, groups armed: 5 of 5
    /// # assert!(snapshot.to_string().starts_with("cycle 3: the board runs, groups armed: "));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn state(
        &self,
    ) -> Option<(
        BoardState,
        impl Iterator<Item = (GroupId, GroupState)> + Clone + '_,
    )> {
        self.is_fresh().then(|| (self.board().0, self.groups()))
    }

    /// All groups, with their states.
    pub(super) fn groups(&self) -> impl Iterator<Item = (GroupId, GroupState)> + Clone + '_ {
        let groups = self.shared.layout.groups.iter().enumerate();
        groups.map(|(number, &group)| (group, self.group(number)))
    }

    /// The remotes, by port and channel.
    pub fn remotes(&self) -> impl Iterator<Item = RemoteSnapshot> + '_ {
        let mut words = self.words_from(self.shared.layout.remotes_at);
        let places = self.shared.layout.places.iter();
        places.map(move |&(label, group)| RemoteSnapshot {
            label,
            group,
            since: next(&mut words),
            state: RemoteState::unpack(&mut words).unwrap_or(RemoteState::Running),
            first_fault: next(&mut words),
            faults: next(&mut words),
            transfers: next(&mut words),
            failures: next(&mut words),
            restarts: next(&mut words),
        })
    }

    fn words_from(&self, at: usize) -> impl Iterator<Item = u64> + '_ {
        self.words.iter().skip(at).copied()
    }

    fn head(&self) -> Head {
        let mut words = self.words_from(0);
        let words = &mut words;
        Head {
            cycle: next(words),
            time: next(words),
            board: (next(words), next(words)),
            run: next(words),
            driver: next(words),
            bus: next(words),
        }
    }

    fn group(&self, number: usize) -> GroupState {
        let layout = &self.shared.layout;
        let words = layout.remotes_at.saturating_sub(layout.groups_at);
        let each = words.checked_div(layout.groups.len()).unwrap_or(0);
        let at = number.saturating_mul(each).saturating_add(layout.groups_at);
        let state = GroupState::unpack(&mut self.words_from(at));
        debug_assert!(state.is_some(), "the words of another layout");
        let mut state = state.unwrap_or(GroupState {
            valid: false,
            armed: false,
            age: Age::NEVER,
            faults: 0,
            rearm_pending: false,
        });
        let is_fresh = self.is_fresh();
        state.valid &= is_fresh;
        state.armed &= is_fresh;
        state.rearm_pending &= is_fresh;
        state.age.time = state.age.time.saturating_add(self.age);
        state
    }

    fn reading(&self, pin: PinId) -> Option<Reading<(HalType, u64)>> {
        let layout = &self.shared.layout;
        let index = pin.index();
        let info = layout
            .infos
            .get(index)
            .filter(|_| pin.is_beside(layout.pin))?;
        let value = self.words.get(layout.values_at.saturating_add(index))?;
        let flags = self.words.get(layout.flags_at.saturating_add(index / 64))?;
        let is_bad = flags >> (index % 64) & 1 != 0;
        let group = self.group(*layout.group_of.get(index)? as usize);
        let any = AnyValue {
            hal_type: info.hal_type,
            bits: *value,
        };
        Some(Reading {
            value: (info.hal_type, *value),
            valid: (info.role.is_param() || group.valid && !is_bad) && any.is_finite(),
            age: if is_bad { Age::NEVER } else { group.age },
        })
    }
}
