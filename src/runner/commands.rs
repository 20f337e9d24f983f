//! Commands of other threads to the thread of a cycle.

mod outcome;
mod queued;

pub use outcome::CommandOutcome;

use crate::advice::{self, Advice, MesaError};
use crate::hostmot2::RemoteId;
use alloc::boxed::Box;
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::bus::{Clock, RegisterBus};
use crate::driver::{Driver, SerialPort};
use crate::hal::Settable;
use crate::hal::{AnyValue, GroupId, Handle, Param, PinError, PinId, PinInfo, Pins, Role, Value};
use crate::tally::Tally;
use outcome::Outcomes;
use queued::{QueuedCommand, WORDS};

/// Largest number of commands that one cycle takes.
pub const COMMANDS_IN_A_CYCLE: u32 = 16;

/// The largest queue.
const LARGEST: usize = 1 << 16;

/// Commands of other threads for the thread of the cycle, which takes a bounded number in each
/// cycle.
///
/// A [`Runner`](super::Runner) has a queue after a call of
/// [`Runner::commands`](super::Runner::commands), and takes commands after the read of a cycle,
/// before the application's own work, which has the last word. A program with its own loop calls
/// [`take`](Self::take) there.
///
/// ```
/// use mesa_hal::{Driver, Settings, runner::CommandQueue};
/// use mesa_hal_sim::machines;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let board = machines::six_axes_7i92(Default::default());
/// let mut driver = Driver::start(board, Settings::default())?;
/// let lamp = driver.pins().output::<bool>("hm2_7i92.0.7i77.0.0.output-00")?;
/// let mut queue = CommandQueue::new(&driver, 64);
/// let sender = queue.sender(); // `Clone`, and goes to any thread
/// std::thread::spawn(move || sender.set(lamp, true)).join().unwrap()?;
/// let _ = driver.read()?;
/// queue.take(&mut driver);
/// assert!(driver.pins().commanded(lamp));
/// driver.write()?;
/// # Ok(())
/// # }
/// ```
///
/// # Real time
/// [`take`](Self::take) never blocks: senders wait for each other only. Only [`new`](Self::new)
/// allocates.
#[derive(Debug)]
pub struct CommandQueue {
    shared: Arc<CommandBuffer>,
    /// Number of times that faults have disarmed groups, at the last look.
    faults: u64,
    /// Number of looks at which that had grown: a re-arm command counts only if sent after the last
    /// of these.
    epoch: u64,
}

/// Sends commands from any other thread to the thread of the cycle.
///
/// Each function that sends a command returns its number, by which [`outcome`](Self::outcome) knows
/// later whether it was executed, and why not.
///
/// # Errors
/// Each function: [`CommandError`]. No command is sent then.
///
/// # Real time
/// For other threads than that of the cycle: may wait for another sender, not for the cycle. A
/// command is executed in the next cycle, or, where more than 16 commands wait, 16 in each.
#[derive(Clone, Debug)]
pub struct CommandSender {
    shared: Arc<CommandBuffer>,
}

/// Reason why a command was not sent.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CommandError {
    /// The queue is full.
    #[error("the queue of {capacity} commands is full; a cycle takes up to {COMMANDS_IN_A_CYCLE}")]
    Full {
        /// Capacity of the queue.
        capacity: usize,
    },
    /// The queue no longer exists.
    #[error("the cycle has ended, and takes no more commands")]
    Ended,
    /// The pin cannot be set to the value.
    #[error(transparent)]
    Pin(#[from] PinError),
    /// The remote to restart does not exist.
    #[error("{remote}: no remote takes part")]
    NoRemote {
        /// The remote.
        remote: RemoteId,
    },
}

impl MesaError for CommandError {
    fn advice(&self) -> Option<Advice> {
        match self {
            Self::Full { .. } => Some(advice::CHECK_CYCLE),
            Self::Ended | Self::NoRemote { .. } => None,
            Self::Pin(error) => error.advice(),
        }
    }
}

/// Statistics of the commands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct CommandStatistics {
    /// Commands sent.
    pub sent: u64,
    /// Commands taken by the cycle.
    pub taken: u64,
    /// Taken commands without effect: for an output whose group is not armed, for a group that does
    /// not run and cannot be armed, and commands from before the last fault that re-arm, or that
    /// set an output made safe by this fault to another value.
    pub refused: u64,
}

/// A ring buffer: senders write behind a lock of their own, the cycle reads without one.
#[derive(Debug)]
struct CommandBuffer {
    slots: Box<[[AtomicU64; WORDS]]>,
    outcomes: Outcomes,
    /// Number of commands sent, and number of those taken.
    sent: AtomicU64,
    taken: AtomicU64,
    refused: AtomicU64,
    /// The epoch as published to senders.
    epoch: AtomicU64,
    /// Number of times that faults have disarmed each group, as published to senders.
    faults: Box<[(GroupId, AtomicU64)]>,
    /// Held by senders only.
    sending: Mutex<()>,
    has_ended: AtomicBool,
    infos: Vec<PinInfo>,
    /// Any pin, which identifies the driver that the pins belong to.
    pin: PinId,
    remotes: Vec<RemoteId>,
}

impl CommandQueue {
    /// A queue for a driver, with a `capacity` of 1 to 65,536 commands; other values are limited to
    /// this range.
    pub fn new<B: RegisterBus + Clock>(driver: &Driver<B>, capacity: usize) -> Self {
        let capacity = capacity.clamp(1, LARGEST);
        let slots = (0..capacity).map(|_| <[AtomicU64; WORDS]>::default());
        let pins = driver.pins();
        let remotes = driver.ports().iter().flat_map(SerialPort::remotes);
        let groups = pins.groups().map(|group| {
            let faults = pins.group_state(group).map_or(0, |state| state.faults);
            (group, AtomicU64::new(faults))
        });
        Self {
            shared: Arc::new(CommandBuffer {
                slots: slots.collect(),
                outcomes: Outcomes::new(capacity),
                faults: groups.collect(),
                sent: AtomicU64::new(0),
                taken: AtomicU64::new(0),
                refused: AtomicU64::new(0),
                epoch: AtomicU64::new(0),
                sending: Mutex::new(()),
                has_ended: AtomicBool::new(false),
                infos: pins.infos().to_vec(),
                pin: pins.ids().next().unwrap_or_default(),
                remotes: remotes.map(|remote| remote.label.id).collect(),
            }),
            faults: faults(driver),
            epoch: 0,
        }
    }

    /// A sender for another thread. Does not allocate.
    pub fn sender(&self) -> CommandSender {
        CommandSender {
            shared: Arc::clone(&self.shared),
        }
    }

    /// Executes waiting commands, between the read and the write of a cycle: at most 16, and none
    /// after one that re-arms everything. Returns their number.
    ///
    /// A re-arm command that was sent before a fault is void after it, and counted as refused: it
    /// was meant for an earlier fault. A fault of a group that was not armed, but ran, counts as
    /// well. The same holds for a command that sets an output whose group
    /// is not armed, which would have no effect, or an output that a fault has made safe since,
    /// even if the group has been re-armed meanwhile; and for commands sent for another driver. All
    /// other commands are executed regardless of faults: a command that switches an output off
    /// (sets it to its safe value) must not be lost because of a fault.
    ///
    /// # Real time
    /// Bounded, no allocation. Re-arming a board that has lost its set-up takes the time of
    /// [`Driver::rearm`].
    pub fn take<B: RegisterBus + Clock>(&mut self, driver: &mut Driver<B>) -> u32 {
        let is_other = driver.pins().ids().next().unwrap_or_default() != self.shared.pin;
        if is_other {
            self.shared.refuse_all();
            return 0;
        }
        self.look(driver);
        let mut count = 0;
        while count < COMMANDS_IN_A_CYCLE
            && let Some((number, command)) = self.shared.next()
        {
            count.tally(1);
            let outcome = self.execute(driver, command);
            if outcome.is_refused() {
                self.shared.refused.fetch_add(1, Ordering::Relaxed);
            }
            self.shared.outcomes.store(number, outcome);
            if matches!(command, QueuedCommand::Rearm(_)) {
                break;
            }
        }
        self.look(driver);
        count
    }

    fn execute<B: RegisterBus + Clock>(
        &mut self,
        driver: &mut Driver<B>,
        command: QueuedCommand,
    ) -> CommandOutcome {
        if command.epoch().is_some_and(|epoch| epoch != self.epoch) {
            return CommandOutcome::AfterFault;
        }
        match command {
            QueuedCommand::Set(pin, value, faults) => {
                return set(driver.pins_mut(), pin, value, faults);
            }
            QueuedCommand::Rearm(_) => {
                if driver.rearm().is_err() {
                    return CommandOutcome::NoSetUp;
                }
            }
            QueuedCommand::RearmGroup(group, _) => {
                if driver.pins_mut().rearm(group).is_err() {
                    return CommandOutcome::NotRunning;
                }
            }
            QueuedCommand::RearmWhenRunning(_) => {
                let _ = driver.rearm_when_running();
            }
            QueuedCommand::RearmGroupWhenRunning(group, _) => {
                if driver.rearm_group_when_running(group).is_err() {
                    return CommandOutcome::PortOff;
                }
            }
            QueuedCommand::Restart(remote) => {
                // The groups that this disarms were disarmed on request, not by a fault.
                let before = faults(driver);
                driver.restart(remote);
                let more = faults(driver).wrapping_sub(before);
                self.faults = self.faults.wrapping_add(more);
            }
        }
        CommandOutcome::Done
    }

    /// Checks for faults since the last look: if there were any, earlier re-arm commands are void.
    /// A [`Runner`](super::Runner) looks after its write, before other threads can see the findings
    /// of the write; [`take`](Self::take) looks by itself.
    pub(super) fn look<B: RegisterBus + Clock>(&mut self, driver: &Driver<B>) {
        let faults = faults(driver);
        if core::mem::replace(&mut self.faults, faults) != faults {
            self.epoch = self.epoch.wrapping_add(1);
            self.shared.epoch.store(self.epoch, Ordering::Release);
        }
        for (group, known) in &self.shared.faults {
            if let Some(state) = driver.pins().group_state(*group) {
                known.store(state.faults, Ordering::Release);
            }
        }
    }
}

/// Sets a pin or a setting, if that has an effect. `faults` is the fault count of the pin's group
/// when the command was sent.
fn set(pins: &mut Pins, pin: PinId, value: AnyValue, faults: u64) -> CommandOutcome {
    let is_output = pins
        .info_of(pin)
        .is_some_and(|info| info.role == Role::Output);
    let faults_now = pins.faults_against(pin, value);
    if faults_now.is_some() && is_output && !pins.follows(pin) {
        CommandOutcome::NotArmed
    } else if faults_now.is_some_and(|now| now != faults) {
        CommandOutcome::AfterFault
    } else if pins.set_any(pin, value).is_err() {
        // It was checked when it was sent, for the pins of the queue's driver.
        CommandOutcome::OtherDriver
    } else {
        CommandOutcome::Done
    }
}

/// Number of faults so far: of groups that were armed or ran, and of the board.
fn faults<B: RegisterBus + Clock>(driver: &Driver<B>) -> u64 {
    let statistics = driver.statistics();
    let of_board = [
        statistics.watchdog_bites,
        statistics.resets,
        statistics.bus_down,
    ];
    let losses = driver.pins().losses();
    of_board.into_iter().fold(losses, u64::wrapping_add)
}

/// Notifies senders that commands are no longer taken.
impl Drop for CommandQueue {
    fn drop(&mut self) {
        self.shared.has_ended.store(true, Ordering::Release);
    }
}

impl CommandSender {
    /// The outcome of a command, by the number that was returned when it was sent. Known until as
    /// many commands as the queue holds have been taken after it.
    ///
    /// ```
    /// use mesa_hal::runner::{CommandOutcome, CommandQueue};
    /// # use mesa_hal::{Driver, Settings};
    /// # use mesa_hal_sim::machines;
    /// # let board = machines::six_axes_7i92(Default::default());
    /// # let mut driver = Driver::start(board, Settings::default())?;
    /// let lamp = driver.pins().output::<bool>("hm2_7i92.0.7i77.0.0.output-00")?;
    /// let mut queue = CommandQueue::new(&driver, 64);
    /// let sender = queue.sender();
    /// driver.restart((0, 0)); // its outputs are safe until they are re-armed
    /// let number = sender.set(lamp, true)?;
    /// assert_eq!(sender.outcome(number), CommandOutcome::Waiting);
    /// queue.take(&mut driver);
    /// assert_eq!(sender.outcome(number), CommandOutcome::NotArmed);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn outcome(&self, number: u64) -> CommandOutcome {
        let shared = &*self.shared;
        // Loaded in this order, so that a command that has been taken since is not taken for one
        // that never will be.
        let has_ended = shared.has_ended.load(Ordering::Acquire);
        let taken = shared.taken.load(Ordering::Acquire);
        if number >= shared.sent.load(Ordering::Acquire) {
            return CommandOutcome::Unknown;
        }
        if let Some(outcome) = shared.outcomes.load(number) {
            return outcome;
        }
        let oldest = taken.saturating_sub(shared.slots.len() as u64);
        match number {
            _ if number >= taken && has_ended => CommandOutcome::Ended,
            // Taken, and about to be executed.
            _ if number >= oldest => CommandOutcome::Waiting,
            _ => CommandOutcome::Unknown,
        }
    }
}

impl CommandSender {
    /// Sets an output, or a pin that both sides set. A value out of range is limited and counted,
    /// as always. The cycle refuses and counts a command for an output whose group is not armed at
    /// that time.
    pub fn set<K: Settable, T: Value>(
        &self,
        pin: Handle<K, T>,
        value: T,
    ) -> Result<u64, CommandError> {
        self.set_any(pin.into(), value.into())
    }

    /// Changes a setting.
    pub fn set_param<T: Value>(&self, param: Param<T>, value: T) -> Result<u64, CommandError> {
        self.set_any(param.into(), value.into())
    }

    /// Sets a pin or a setting of any type.
    pub fn set_any(&self, pin: PinId, value: AnyValue) -> Result<u64, CommandError> {
        let shared = &*self.shared;
        let info = shared.infos.get(pin.index());
        let info = info.filter(|_| pin.is_beside(shared.pin));
        let info = info.ok_or(PinError::ForeignHandle)?;
        info.check_settable(value)?;
        let mut faults = shared.faults.iter();
        let faults = faults.find(|(group, _)| *group == info.group);
        let faults = faults.map_or(0, |(_, faults)| faults.load(Ordering::Acquire));
        self.send(QueuedCommand::Set(pin, value, faults))
    }

    /// Re-arms everything: [`Driver::rearm`].
    pub fn rearm(&self) -> Result<u64, CommandError> {
        self.send(QueuedCommand::Rearm(self.epoch()))
    }

    /// Re-arms everything as soon as it runs: [`Driver::rearm_when_running`].
    pub fn rearm_when_running(&self) -> Result<u64, CommandError> {
        self.send(QueuedCommand::RearmWhenRunning(self.epoch()))
    }

    /// Re-arms one group as soon as it runs: [`Driver::rearm_group_when_running`].
    pub fn rearm_group_when_running(&self, group: GroupId) -> Result<u64, CommandError> {
        self.check(group)?;
        self.send(QueuedCommand::RearmGroupWhenRunning(group, self.epoch()))
    }

    /// Re-arms one group: [`Pins::rearm`](crate::hal::Pins::rearm).
    pub fn rearm_group(&self, group: GroupId) -> Result<u64, CommandError> {
        self.check(group)?;
        self.send(QueuedCommand::RearmGroup(group, self.epoch()))
    }

    fn check(&self, group: GroupId) -> Result<(), CommandError> {
        let is_own = PinId::from_word(group.to_word()).is_beside(self.shared.pin);
        is_own.then_some(()).ok_or(PinError::ForeignHandle.into())
    }

    /// Restarts a remote: [`Driver::restart`].
    pub fn restart(&self, remote: impl Into<RemoteId>) -> Result<u64, CommandError> {
        let remote = remote.into();
        if !self.shared.remotes.contains(&remote) {
            return Err(CommandError::NoRemote { remote });
        }
        self.send(QueuedCommand::Restart(remote))
    }

    /// Statistics of the commands of all senders so far.
    pub fn statistics(&self) -> CommandStatistics {
        let shared = &*self.shared;
        // Loaded in this order, so that the number taken never exceeds the number sent.
        let refused = shared.refused.load(Ordering::Acquire);
        let taken = shared.taken.load(Ordering::Acquire);
        CommandStatistics {
            sent: shared.sent.load(Ordering::Acquire),
            taken,
            refused,
        }
    }

    fn epoch(&self) -> u64 {
        self.shared.epoch.load(Ordering::Acquire)
    }

    /// Sends a command; returns its number.
    fn send(&self, command: QueuedCommand) -> Result<u64, CommandError> {
        let shared = &*self.shared;
        // The guarded state is consistent at every point, so that a poisoned lock can be used.
        let _one_at_a_time = shared
            .sending
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        if shared.has_ended.load(Ordering::Acquire) {
            return Err(CommandError::Ended);
        }
        let sent = shared.sent.load(Ordering::Relaxed);
        let waiting = sent.saturating_sub(shared.taken.load(Ordering::Acquire));
        let slot = shared.slot(sent);
        let Some(slot) = slot.filter(|_| waiting < shared.slots.len() as u64) else {
            let capacity = shared.slots.len();
            return Err(CommandError::Full { capacity });
        };
        for (slot, word) in slot.iter().zip(command.to_words()) {
            slot.store(word, Ordering::Relaxed);
        }
        // Hands the words over to the cycle.
        shared.sent.store(sent.wrapping_add(1), Ordering::Release);
        Ok(sent)
    }
}

impl CommandBuffer {
    /// Takes a command, with its number. Called in one thread only.
    fn next(&self) -> Option<(u64, QueuedCommand)> {
        let taken = self.taken.load(Ordering::Relaxed);
        if taken == self.sent.load(Ordering::Acquire) {
            return None;
        }
        let words = self.slot(taken)?.each_ref();
        let words = words.map(|word| word.load(Ordering::Relaxed));
        // Returns the words to the senders.
        self.taken.store(taken.wrapping_add(1), Ordering::Release);
        Some((taken, QueuedCommand::from_words(words)))
    }

    /// Takes all waiting commands without executing any. Called in the thread that takes.
    fn refuse_all(&self) {
        let sent = self.sent.load(Ordering::Acquire);
        let taken = self.taken.load(Ordering::Relaxed);
        for number in taken..sent {
            self.outcomes.store(number, CommandOutcome::OtherDriver);
        }
        let waiting = sent.saturating_sub(taken);
        self.refused.fetch_add(waiting, Ordering::Relaxed);
        self.taken.store(sent, Ordering::Release);
    }

    fn slot(&self, number: u64) -> Option<&[AtomicU64; WORDS]> {
        let index = number.checked_rem(self.slots.len() as u64)?;
        self.slots.get(index as usize)
    }
}

#[cfg(test)]
mod tests;
